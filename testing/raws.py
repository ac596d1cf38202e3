"""Raw files of a camera's sensor, written by tifffile alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

RGGB, BGGR, GRBG, GBRG = (0, 1, 1, 2), (2, 1, 1, 0), (1, 0, 2, 1), (1, 2, 0, 1)
"""Primaries of the pixels of two rows: top left, top right, bottom left, bottom right."""
_COLOUR_FILTER, _LINEAR_RAW = 32803, 34892


def store_raw(
    path: Path,
    light: NDArray[np.float64],
    *,
    bits: int = 14,
    black: Sequence[int] = (512, 512, 512, 512),
    pattern: Sequence[int] = RGGB,
    orientation: int = 1,
    seconds: float = 0.0,
) -> NDArray[np.uint16]:
    """Writes a DNG whose pixels of 2 x 2 see one place of light.

    Parameters
    ----------
    path
        The file.
    light
        (row, col, primary), 1 being full.
    bits
        Of a code.
    black
        Codes of no light, of the four pixels.
    pattern
        Primaries of the four pixels, such as `RGGB`.
    orientation
        Exif's number.
    seconds
        The exposure that the camera writes down; 0 if it does not.

    Returns
    -------
    codes
        (row, col) of the sensor.
    """
    rows, cols, _ = light.shape
    white = 2**bits - 1
    codes = np.empty((2 * rows, 2 * cols), np.uint16)
    for number, (row, col) in enumerate(np.ndindex(2, 2)):
        one = light[..., pattern[number]] * (white - black[number]) + black[number]
        codes[row::2, col::2] = np.clip(np.round(one), 0, white)
    _write(path, codes, white, orientation, [
        *([(33434, "2I", 1, (round(1e6 * seconds), 1_000_000), True)] if seconds else []),
        (33421, "H", 2, (2, 2), True),          # CFARepeatPatternDim
        (33422, "B", 4, tuple(pattern), True),  # CFAPattern
        (50711, "H", 1, 1, True),               # CFALayout
        (50713, "H", 2, (2, 2), True),          # BlackLevelRepeatDim
        (50714, "I", 4, tuple(black), True),    # BlackLevel
    ])  # fmt: skip
    return codes


def store_linear_raw(path: Path, light: NDArray[np.float64]) -> None:
    """Writes a converter's DNG, of three colours a pixel.

    Parameters
    ----------
    path
        The file.
    light
        (row, col, primary), 1 being full.
    """
    codes = np.round(light * 65535).astype(np.uint16)
    _write(path, codes, 65535, 1, [])


def _write(path: Path, codes: NDArray[np.uint16], white: int, turn: int, tags: list) -> None:  # type: ignore[type-arg]
    mosaic = codes.ndim == 2
    identity = tuple(number for one in np.eye(3).ravel() for number in (int(one), 1))
    tifffile.imwrite(
        path,
        codes,
        photometric=_COLOUR_FILTER if mosaic else _LINEAR_RAW,
        planarconfig=None if mosaic else "contig",
        metadata=None,
        extratags=[
            (274, "H", 1, turn, True),
            (50706, "B", 4, (1, 4, 0, 0), True),  # DNGVersion
            (50708, "s", 0, "Made up", True),     # UniqueCameraModel
            (50717, "I", 1, white, True),         # WhiteLevel
            (50721, "2i", 9, identity, True),     # ColorMatrix1
            (50778, "H", 1, 21, True),            # CalibrationIlluminant1: D65
            *tags,
        ],
    )  # fmt: skip
