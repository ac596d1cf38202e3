"""Things that are what they hold: compared and hashed by their values, arrays among them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ByValue:
    """Base of frozen dataclasses (``eq=False``) with arrays or mappings in their fields.

    Fields of ``compare=False`` do not count.
    """

    def __eq__(self, other: object) -> bool:
        """Whether it is of the same class and holds the same."""
        return self is other or (type(self) is type(other) and _values(self) == _values(other))

    def __hash__(self) -> int:
        """Hash of what it holds."""
        return hash(_values(self))


def _values(value: Any) -> Hashable:
    """What a value holds, in tuples."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if hasattr(value, "model_dump"):  # a section of a scene's file
        return type(value).__name__, _values(vars(value))
    if is_dataclass(value):
        held = (getattr(value, field.name) for field in fields(value) if field.compare)
        return type(value).__name__, *map(_values, held)
    if isinstance(value, Mapping):
        return tuple(sorted((key, _values(each)) for key, each in value.items()))
    if isinstance(value, list | tuple):
        return tuple(map(_values, value))
    held_as_it_is: Hashable = value
    return held_as_it_is
