"""Small pictures of frames, for a job's report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from domesim.frames.colour import ColourTag
from domesim.frames.formats import FORMATS
from domesim.frames.formats.png import colour_chunks, with_colour_chunks
from domesim.frames.writing import bare_specification
from domesim.host.writing import write_whole
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.light.transfer import SRGB

FOLDER = "small"
"""Folder of the small pictures, in the job's folder."""

SIDE = 120
"""Longest side of one, pixels, about."""

_FINER = 3  # samples of a pixel, across
_GAP = 4


def thinned(light: Light) -> Light:
    """Takes every n-th row and column of (view, row, col, primary), for a small picture."""
    step = thinning(light.shape[1:3])
    return light[:, ::step, ::step]


def thinning(size: tuple[int, ...]) -> int:
    """Returns n of `thinned` for a picture of so many rows and columns."""
    return max(1, max(size) // (_FINER * SIDE))


def small_of(folder: Path, output: str) -> Path:
    """Path of a result's small picture."""
    return folder / FOLDER / f"{output}.png"


def write_small(place: Path, pictures: Sequence[NDArray[np.floating]]) -> None:
    """Write pictures beside each other, as sRGB.

    Parameters
    ----------
    place
        The file; its folder is made, in one that there is.
    pictures
        (row, col, 3) each, linear in the display's primaries (BT.709), 1.0 = white; of one size.

    Raises
    ------
    InputError, OSError
        If it cannot be written.
    """
    parts = [_reduced(np.clip(picture, 0, 1)) for picture in pictures]
    gap = np.full((len(parts[0]), _GAP, 3), 0.2)
    light = np.hstack([each for part in parts for each in (gap, part)][1:])
    pixels = np.rint(255 * SRGB().encode(light)).astype(np.uint8)
    names, size = ("R", "G", "B"), (pixels.shape[1], pixels.shape[0])
    spec = bare_specification(names, ("uint8",) * 3, size, [])
    png = FORMATS["png"].encoded(place, spec, pixels)
    place.parent.mkdir(exist_ok=True)  # not the job's folder: its loss is reported
    colour = colour_chunks(ColourTag("srgb", "BT.709", "computed"))
    write_whole(place, with_colour_chunks(png, colour))


def _reduced(picture: NDArray[np.floating]) -> NDArray[np.floating]:
    """Means over whole blocks of pixels."""
    block = max(1, round(max(picture.shape[:2]) / SIDE))
    rows, cols = (side // block * block for side in picture.shape[:2])
    return np.asarray(light_means(picture[None, :rows, :cols], block)[0])
