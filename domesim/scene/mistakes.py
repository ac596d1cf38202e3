"""Mistakes in a scene file, as lines for the person who wrote it: each with its path."""

from __future__ import annotations

import difflib
import json
import re
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, final, get_args

from pydantic import BaseModel, ValidationError

from domesim.errors import InputError
from domesim.scene.fields import TAGS

_MOST = 50  # mistakes that are told


def all_mistakes(error: ValidationError, where: str, model: type[BaseModel]) -> str:
    """One line for each mistake that pydantic found in `where`, a file that `model` describes."""
    # Nobody reads a thousand, and each of an unknown key takes a millisecond
    found, more = error.errors()[:_MOST], max(0, error.error_count() - _MOST)
    mistakes = list(dict.fromkeys(_mistake(item, model) for item in found))
    if len(mistakes) + more == 1:
        return f"{where}: {mistakes[0]}"
    return "\n  ".join(_listed(f"{where} has {len(mistakes) + more} mistakes:", mistakes, more))


def _listed(head: str, mistakes: Sequence[str], more: int) -> list[str]:
    return [head, *mistakes, *([f"and {more} more"] if more else [])]


@final
class Mistakes:
    """Collects what is wrong with a scene file, to report all of it at once."""

    def __init__(self) -> None:
        self._found: list[str] = []

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note a mistake that is raised inside, and go on."""
        try:
            yield
        except InputError as error:
            self._found.append(str(error))

    def refuse(self) -> None:
        """Raises all mistakes that were noted.

        Raises
        ------
        InputError
            If there are any.
        """
        if len(self._found) == 1:
            raise InputError(self._found[0])
        if self._found:
            head, more = f"has {len(self._found)} mistakes:", max(0, len(self._found) - _MOST)
            raise InputError("\n  ".join(_listed(head, self._found[:_MOST], more)))


def _mistake(item: Any, model: type[BaseModel]) -> str:
    path = _key_path(item["loc"])
    match item["type"]:
        case "extra_forbidden":
            known = _keys_at(item["loc"][:-1], model)
            hint = suggestion(str(item["loc"][-1]), known) or f"; known: {', '.join(known)}"
            return f"{path}: is not a key of a scene{hint}"
        case "missing":
            return f"{path}: is missing"
        case "value_error":
            message = str(item["ctx"]["error"])
            return f"{path}: {message}" if path else message
        case "model_type":
            wanted = f"a section [{path}]"
        case "too_long":
            wanted = f"{item['ctx']['max_length']} values"
        case _:
            wanted = item["msg"].removeprefix("Input should be ")
    return f"{path}: must be {wanted}, got {reprlib.repr(item['input'])}"


def _key_path(location: Iterable[int | str]) -> str:
    """``screen.albedo[1]``, without the tags of the union, which are no keys."""
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in TAGS:
            key = part if re.fullmatch(r"[\w-]+", part, re.ASCII) else json.dumps(part)
            path += f".{key}" if path else key
    return path


def _keys_at(location: Iterable[int | str], model: type[BaseModel]) -> list[str]:
    for part in location:
        if isinstance(part, int) or part not in model.model_fields:
            continue  # the number or name of one of several
        inner = _models_in(model.model_fields[part].annotation)
        if not inner:
            return []
        model = inner[0]
    return list(model.model_fields)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Models in an annotation such as `X`, ``X | None``, ``tuple[X, ...]`` or ``dict[str, X]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def suggestion(name: str, known: list[str]) -> str:
    """The known name that is nearest to `name`, as a question; nothing if none is near."""
    close = difflib.get_close_matches(name[:80], known, 1)
    return f" (did you mean {close[0]!r}?)" if close else ""
