"""Albedo maps: domemasters of what multiplies a screen's albedo, place by place.

Values are shares, 0..1, one for all primaries or one for each: code values of a PNG, samples of an
EXR, or numbers. No curve applies to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError, reason
from domesim.host.files import read_plain
from domesim.room.dome import Dome
from domesim.room.masks import LARGEST, shares_of
from domesim.room.theatre import Paint

Floats = NDArray[np.float64]

Map: TypeAlias = str | Sequence[str] | NDArray[Any]
"""A file; three, one a primary; or (row, col) or (row, col, primary) numbers."""

_FINEST = 1024
"""Pixels a side that are kept: means of a finer map's."""


def paint_of(given: Map, dome: Dome, folder: Path) -> Paint:
    """Makes paint of an albedo map.

    Parameters
    ----------
    given
        Above 0 and at most 1 on the screen; off it, it does not count.
    dome
        The screen.
    folder
        Where files lie.

    Returns
    -------
    paint
        Of at most a million pixels.

    Raises
    ------
    InputError
        If a file cannot be read, or the map is none.
    """
    if isinstance(given, np.ndarray):
        factors = given[..., None] if given.ndim == 2 else given
        name = "screen.albedo_map"
    else:
        names = [given] if isinstance(given, str) else list(given)
        planes = [_read(folder / each) for each in names]
        name = f"screen.albedo_map {', '.join(names)}"
        if len({plane.shape for plane in planes}) > 1 or (len(planes) > 1 < planes[0].shape[2]):
            raise InputError(f"{name}: wanted one map, or three of grey of one size")
        factors = np.concatenate(planes, axis=2)
    rows, cols, primaries = factors.shape if factors.ndim == 3 else (0, 0, 0)
    if rows != cols or rows < 2 or primaries not in (1, 3):
        raise InputError(
            f"{name}: wanted a square domemaster of one or three primaries, got {factors.shape}"
        )
    on = dome.inside(rows, cols)
    least, most = float(factors[on].min()), float(factors[on].max())
    if not 0 < least <= most <= 1:
        raise InputError(
            f"{name}: wanted shares above 0 and at most 1 on the screen, got {least:g} to {most:g}"
        )
    # A pixel that the rim cuts has its neighbour's paint
    row, col = scipy.ndimage.distance_transform_edt(
        ~on, return_distances=False, return_indices=True
    )
    paint = Paint(np.asarray(factors, np.float64)[row, col])
    return paint if rows <= _FINEST else Paint(paint.on(_FINEST, _FINEST))


def _read(path: Path) -> Floats:
    """(row, col, primary) of a file; one primary if all are alike."""
    if path.suffix.lower() == ".exr":
        from domesim.frames import ColourTag  # noqa: PLC0415 - few scenes have maps
        from domesim.frames.reading import read_image  # noqa: PLC0415

        as_it_is = ColourTag("linear", "BT.709", "an albedo map")
        values = np.asarray(
            read_image(path, repair=False, grey=True, colour=as_it_is).pixels, np.float64
        )
    else:
        try:
            values = shares_of(read_plain(path, LARGEST), str(path))
        except OSError as error:
            raise InputError(f"{path}: wanted an albedo map, got '{reason(error)}'") from error
    if values.ndim == 2:
        return values[..., None]
    return values[..., :1] if (values == values[..., :1]).all() else values
