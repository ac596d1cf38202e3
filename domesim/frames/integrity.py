"""Errors for files that are damaged or cut short."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from domesim.errors import InputError

LARGEST_SIDE = 32768
"""Pixels; a header that claims more is taken for damaged, before memory is asked for."""

SQUARE = 0.01
"""Largest relative difference of a pixel's sides: files state ratios in few digits."""


EQUIRECTANGULAR = "equirectangular"
"""The projection of panoramas that a domemaster is made of."""


class DamagedError(ValueError):
    """A part of a file is missing or wrong; says what was got."""


def damaged(path: Path, label: str, got: str) -> InputError:
    """The error for a file that is incomplete or damaged."""
    return InputError(f"{path}: wanted a complete {label}, got {got}. Copy or render it again.")


def projected(path: Path, projection: str) -> InputError:
    """The error for a picture that says that it is a panorama."""
    way = " (domesim domemaster --from equirectangular)" if projection == EQUIRECTANGULAR else ""
    return InputError(
        f"{path}: wanted a picture as it is projected, got one that says it is {projection}. Make "
        f"a domemaster of it first{way}."
    )


@contextmanager
def enough_memory(path: Path) -> Iterator[None]:
    """Turns a lack of memory into an error for a person."""
    try:
        yield
    except MemoryError as error:
        raise InputError(
            f"{path}: wanted memory for a picture of this size, got none. Use a smaller one, or a "
            "machine with more."
        ) from error


def refuse_sides(path: Path, cols: int, rows: int) -> None:
    """Refuses a picture that is larger than any master."""
    if not (0 < cols <= LARGEST_SIDE and 0 < rows <= LARGEST_SIDE):
        raise InputError(
            f"{path}: wanted 1 to {LARGEST_SIDE} px a side, got {cols} x {rows}. "
            "The header is probably damaged: copy or render it again."
        )
