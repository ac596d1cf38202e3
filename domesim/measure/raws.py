"""Photographs of measurements: linear files, and cameras' raw files as their sensor saw them.

A raw file is read by LibRaw (rawpy, extra ``raw``), and nothing is done to it: no white balance, no
matrix, no brightening, no demosaicing. Its black is subtracted, its white level is 1, and 2 x 2
pixels of the sensor make one of the photograph (the mean of both greens), turned as the camera was
held.
"""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames import Frame
from domesim.frames.colour import ColourTag
from domesim.frames.encodings import encoding_named
from domesim.frames.formats.base import CameraRawError
from domesim.frames.frame import Header
from domesim.frames.reading import read_image

MOST_CLIPPED = 1e-3
"""Share of pixels: some are stuck in any camera."""
_LEAST_BITS = 10
_EXPOSURE = ("expTime", "isoSpeed", "aperture")
_SLIPPED = 1.15
"""Times from which an exposure is another one: cameras' steps are thirds of a stop, 1.26, and are
rounded by up to a tenth (1/60 s is 1/64)."""
_JPEGS, _NOT_PHOTOGRAPHS = (".jpg", ".jpeg", ".heic", ".heif"), (".xmp", ".json", ".txt", ".pp3")
_NEARLY = 0.995  # of a full pixel
_TURNS = {0: 0, 3: 2, 5: 1, 6: 3}  # LibRaw's flip -> quarters, counter-clockwise


def photograph_named(path: Path) -> Path:
    """The photograph that a list names, with or without what its camera calls it after the point.

    Parameters
    ----------
    path
        As it is named: ``white`` finds ``white.NEF``. A JPEG beside a raw file is not meant.

    Raises
    ------
    InputError
        If several files could be meant.
    """
    if path.exists():
        return path
    there = [
        each
        for each in sorted(path.parent.glob(f"{glob.escape(path.name)}.*"))
        if each.suffix.lower() not in _NOT_PHOTOGRAPHS
    ]
    found = [each for each in there if each.suffix.lower() not in _JPEGS] or there
    if len(found) > 1:
        names = ", ".join(each.name for each in found)
        raise InputError(f"{path}: wanted one photograph of that name, got {names}; say which")
    return found[0] if found else path


def read_photograph(path: Path, colour: ColourTag | None = None) -> Frame:
    """A photograph, negative where a camera's noise is below its black.

    Parameters
    ----------
    path
        A picture, or a camera's raw file.
    colour
        What the code values of a picture mean, if not what the file says.

    Raises
    ------
    InputError
        If it cannot be read, or has so few bits that it has a curve, too, whatever is said of it;
        if it is a raw file of another filter than Bayer's, or the extra ``raw`` is not installed.
    """
    try:
        frame = read_image(path, repair=False, signed=True, colour=colour)
    except CameraRawError:
        frame = _of_sensor(path)
    if frame.bits < _LEAST_BITS:
        raise InputError(
            f"{path}: a photograph must be raw and linear, of {_LEAST_BITS} bits or more, got "
            f"{frame.bits}; use the camera's raw file, or develop it without a curve "
            f"({ADVICE['develop'].given()}, or a linear EXR)"
        )
    return frame


def clipped(frame: Frame, full: float | None = None) -> tuple[float, NDArray[np.bool_]]:
    """Which pixels of a photograph are as bright as the camera can tell.

    Parameters
    ----------
    frame
        As read by `read_photograph`.
    full
        Value of a full pixel, if it is known; else 1 of integers, and of floats the largest, which
        only clipped samples share.

    Returns
    -------
    limit, pixels
        The value of a full pixel; (row, col) of booleans.
    """
    if full is None and frame.floating:
        largest = float(frame.pixels.max())
        return largest, np.asarray((frame.pixels == largest).any(axis=-1))
    limit = 1.0 if full is None else full
    return limit, np.asarray((frame.pixels >= _NEARLY * limit).any(axis=-1))


def written_exposure(frame: Frame) -> float | None:
    """The exposure that the camera wrote down: s x ISO / aperture²; None if it did not.

    Parameters
    ----------
    frame
        As read by `read_photograph`.
    """
    said = {name: value for name, _, value in frame.header.attributes if name in _EXPOSURE}
    if "expTime" not in said:
        return None
    return float(
        said["expTime"] * said.get("isoSpeed", 100.0) / 100 / said.get("aperture", 1.0) ** 2
    )


def refuse_slipped(exposures: Sequence[tuple[Path, float | None, float]], *, way_out: str) -> None:
    """See that photographs were exposed as somebody says.

    Parameters
    ----------
    exposures
        Of each photograph: its file, what the camera wrote down, what is said of it.
    way_out
        What to do about one that was not.

    Raises
    ------
    InputError
        If a camera wrote down another exposure, relative to that of the others.
    """
    known = [(path, written / said) for path, written, said in exposures if written is not None]
    if not known:
        return
    usual = float(np.median([each for _, each in known]))
    path, most = max(known, key=lambda one: abs(np.log(one[1] / usual)))
    if abs(np.log(most / usual)) > np.log(_SLIPPED):
        raise InputError(
            f"{path}: by what the camera wrote into it, it was exposed {most / usual:.3g} times as "
            f"much as is said, compared with the other photographs; {way_out}"
        )


def require_reader(source: Path | str) -> Any:
    """LibRaw's bindings.

    Parameters
    ----------
    source
        What needs them, for the message.

    Raises
    ------
    InputError
        If the extra ``raw`` is not installed.
    """
    try:
        import rawpy  # noqa: PLC0415 - most photographs are pictures
    except ModuleNotFoundError:
        raise InputError(
            f"{source}: cameras' raw files need the extra 'raw': pip install 'domesim[raw]'. Or "
            f"develop it ({ADVICE['develop'].given()})."
        ) from None
    return rawpy


def _of_sensor(path: Path) -> Frame:
    rawpy = require_reader(path)
    try:
        with rawpy.imread(str(path)) as raw:
            return _developed(path, raw)
    except rawpy.LibRawError as error:
        words = str(error.args[0].decode() if isinstance(error.args[0], bytes) else error)
        raise InputError(
            f"{path}: wanted a camera's raw file, got one that LibRaw cannot read ({words}). Copy "
            f"it again from the camera."
        ) from None


def _developed(path: Path, raw: Any) -> Frame:
    """LibRaw's own development scales by the brightest pixel, so its numbers are not used."""
    pattern = raw.raw_pattern
    if pattern is None or pattern.shape != (2, 2) or sorted(raw.color_desc) != sorted(b"RGBG"):
        raise InputError(
            f"{path}: wanted a raw file with a Bayer filter (2 x 2 pixels: red, two greens, blue), "
            f"got another. Develop it without white balance ({ADVICE['develop'].given()})."
        )
    codes = raw.raw_image_visible
    rows, cols = (side // 2 for side in codes.shape)
    white, colours = raw.white_level, raw.raw_colors_visible[:2, :2]
    sums, counts = np.zeros((rows, cols, 3), np.float32), np.zeros(3, np.float32)
    full = np.zeros((rows, cols, 3), np.bool_)
    for row, col in np.ndindex(2, 2):
        own = colours[row, col]
        black = raw.black_level_per_channel[own]
        one = codes[row : 2 * rows : 2, col : 2 * cols : 2]
        primary = "RGB".index(chr(raw.color_desc[own]))
        sums[..., primary] += (one.astype(np.float32) - black) / (white - black)
        counts[primary] += 1
        full[..., primary] |= one >= white
    pixels = np.asarray(sums / counts, np.float32)
    np.maximum(pixels, 1, out=pixels, where=full)
    turned = np.ascontiguousarray(np.rot90(pixels, _TURNS.get(raw.sizes.flip, 0)))
    linear = encoding_named("linear")
    header = Header(attributes=_said_of_the_exposure(raw.other))
    return Frame(turned, path, linear, bits=white.bit_length(), floating=False, header=header)


def _said_of_the_exposure(said: Any) -> tuple[tuple[str, str, float], ...]:
    """What the camera wrote down, as OpenEXR's standard attributes; 0 is nothing."""
    values = (said.shutter_speed, said.iso_speed, said.aperture)
    named = zip(_EXPOSURE, values, strict=True)
    return tuple((name, "float", float(value)) for name, value in named if value > 0)
