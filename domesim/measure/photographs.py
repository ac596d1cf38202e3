"""Photographs of a 3D screen through the eyewear: what a file that lists them says, and what is
seen in them.

    [photographs]
    corners = [[102, 80], [1801, 92], [1795, 1010], [98, 1003]]
    encoding = "linear"
    saturation = 0.98

    [photographs.left]                      # through the left glass
    black = "left-glass/black.exr"
    left = "left-glass/left-white.exr"      # the left eye's picture is white, the right one's black
    right = ["left-glass/right-white.exr", "left-glass/right-white-2.exr"]

    [photographs.right]                     # through the right glass
    black = "right-glass/black.exr"
    left = { W = "...", R = "...", G = "...", B = "..." }
    right = { W = "...", R = "...", G = "...", B = "..." }

    [projector]
    white_cd_m2 = 15.4
    black_cd_m2 = 0.01
    primaries = "P3-D65"

A list of files is averaged. ``corners`` are those of the picture on the screen, from the top left
one clockwise, as [col, row] in pixels of the photograph; without them it shows nothing else. They
are refined by the picture's edges, where these are seen against darker surroundings, unless
``corners_error``, the standard error of each number in pixels, is stated.
``encoding`` is for files that do not say that they are linear, ``saturation`` the value of a full
pixel (1.0 of integers; of floats what the largest samples share).
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from domesim.errors import InputError
from domesim.frames.encodings import encoding_named
from domesim.host.texts import toml_in
from domesim.light.ties import root_of
from domesim.measure.edges import found_corners
from domesim.measure.raws import (
    MOST_CLIPPED,
    clipped,
    photograph_named,
    read_photograph,
    refuse_slipped,
    written_exposure,
)
from domesim.measure.rounding import scatter_of, shared_rounding, step_of
from domesim.readings.meter import EYES
from domesim.readings.tables import text_of

Floats = NDArray[np.float64]
Samples = NDArray[np.float32]
"""(row, col, camera channel) linear."""

READ_OFF, CROPPED = 0.5, 12**-0.5
"""Standard error of each coordinate of a corner if none is stated, pixels: as a person reads it off
the picture; and of a photograph that was cropped to the screen, which is done at whole pixels."""
_NEARLY = 0.995
_WHOLE: Floats = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
_WHITE, _PRIMARIES = ("W",), ("R", "G", "B")

Files = Annotated[str, Field(min_length=1)] | Annotated[list[str], Field(min_length=1)]


_Corner = Annotated[list[float], Field(min_length=2, max_length=2)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)


class _Colours(_Section):
    W: Files | None = None
    R: Files | None = None
    G: Files | None = None
    B: Files | None = None


class _Glass(_Section):
    black: Files
    left: Files | _Colours
    right: Files | _Colours


class _Photographs(_Section):
    left: _Glass
    right: _Glass
    corners: Annotated[list[_Corner], Field(min_length=4, max_length=4)] | None = None
    corners_error: Annotated[float, Field(ge=0)] | None = None
    encoding: str | None = None
    saturation: Annotated[float, Field(gt=0)] | None = None


class _Projector(_Section):
    white_cd_m2: Annotated[float, Field(gt=0)] | None = None
    black_cd_m2: Annotated[float, Field(ge=0)] = 0.0
    primaries: str | None = None


class _File(_Section):
    photographs: _Photographs
    projector: _Projector = _Projector()


@final
@dataclass(frozen=True, eq=False)
class Glass:
    """What was photographed through one glass, black subtracted.

    Parameters
    ----------
    eye
        Whose glass: left or right.
    net
        Projector -> channel -> (row, col, camera channel).
    """

    eye: str
    net: Mapping[str, Mapping[str, Samples]]

    def white(self, projector: str) -> Samples:
        """Light of a projector's white: photographed, or the sum of its primaries."""
        shown = self.net[projector]
        if "W" in shown:
            return shown["W"]
        return np.asarray(shown["R"] + shown["G"] + shown["B"])

    @property
    def has_primaries(self) -> bool:
        """Whether both projectors' primaries were photographed."""
        return all(set(_PRIMARIES) <= set(shown) for shown in self.net.values())


@final
@dataclass(frozen=True, eq=False)
class Corners:
    """Where the picture on the screen ends, in pixels of the photograph.

    Parameters
    ----------
    at
        (corner, 2) col and row: top left, top right, bottom right, bottom left.
    covariance
        (8, 8) of their errors, px²: col and row of the first corner, then of the others.
    origin
        Where they come from, in words.
    """

    at: Floats
    covariance: Floats
    origin: str

    @property
    def error(self) -> float:
        """Standard error of a coordinate, pixels (root mean square)."""
        return float(np.sqrt(np.mean(np.diag(self.covariance))))

    def in_words(self) -> str:
        """The same for a person."""
        ends = ", ".join(f"[{col:.2f}, {row:.2f}]" for col, row in self.at)
        return f"corners, {self.origin}: {ends}, each ± {self.error:.2g} pixels"

    def places(self, across: Floats, down: Floats) -> Floats:
        """(..., 2) places on the screen of pixels, as of `Photographs`."""
        return _taken(_perspective(self.at, _WHOLE), across, down)

    def shifts(self, cells: tuple[int, int]) -> Floats:
        """(change, row, col, 2): how far the middles of cells are from where they should be.

        By independent errors of one standard deviation each, in shares of the screen's width and
        height.
        """
        rows, cols = cells
        u, v = np.meshgrid((np.arange(cols) + 0.5) / cols, (np.arange(rows) + 0.5) / rows)
        seen = _taken(_perspective(_WHOLE, self.at), u, v)
        return np.array(
            [
                _taken(_perspective(self.at + step, _WHOLE), seen[..., 0], seen[..., 1])
                - np.stack([u, v], -1)
                for step in root_of(self.covariance).reshape(-1, 4, 2)
            ]
        )


@final
@dataclass(frozen=True, eq=False)
class Photographs:
    """Everything that a file lists.

    Parameters
    ----------
    source
        The file's name.
    glasses
        Left, right.
    place
        (row, col, 2) where on the screen each pixel is: shares of its width and height from the top
        left; outside 0..1 off it.
    corners
        Corners of the screen.
    white, black
        Luminance of a projector's white and of black through its glass, cd/m²; white is None if the
        file does not say.
    primaries
        Name of the projectors'; None if the file does not say.
    digest
        SHA-256 of all files.
    rounding
        Standard error of light, black subtracted, that all pixels share: the codes are coarser than
        the noise of the dark.
    """

    source: str
    glasses: tuple[Glass, Glass]
    place: Floats
    corners: Corners
    white: float | None
    black: float
    primaries: str | None
    digest: str
    rounding: float = 0.0


def lists_photographs(path: Path) -> bool:
    """Whether a file is a TOML one with [photographs]."""
    if path.suffix.lower() != ".toml":
        return False
    try:
        return "photographs" in toml_in(text_of(path))
    except tomllib.TOMLDecodeError:
        return False


def read_photographs(path: Path) -> Photographs:
    """The photographs that a file lists.

    Raises
    ------
    InputError
        If the file says something else, a photograph cannot be read, is not linear, is saturated,
        or has another size than the others.
    """
    try:
        file = _File.model_validate(toml_in(text_of(path)))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"] if not str(part).startswith("_"))
        raise InputError(f"{path}: {where}: {first['msg'].lower()}") from None
    listed = file.photographs
    reader = _Reader(path.parent, listed.encoding, listed.saturation)
    glasses = []
    for eye in EYES:
        section: _Glass = getattr(listed, eye)
        black = reader.mean(section.black)
        shown = {name: _channels(path, eye, name, getattr(section, name)) for name in EYES}
        if set(shown["left"]) != set(shown["right"]):
            raise InputError(
                f"{path}: photographs.{eye} must show the same colours of both projectors, got "
                f"{', '.join(shown['left'])} of the left and {', '.join(shown['right'])} of the "
                f"right one"
            )
        net = {
            name: {channel: reader.mean(files) - black for channel, files in channels.items()}
            for name, channels in shown.items()
        }
        glasses.append(Glass(eye, net))
    assert reader.size is not None
    corners = _corners(path, listed, reader.size)
    if listed.corners is not None and listed.corners_error is None:
        corners = by_edges(glasses, corners)
    rows, cols = reader.size
    place = corners.places(*np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5))
    on = on_screen(place)
    if np.count_nonzero(on) < 64:
        raise InputError(
            f"{path}: photographs.corners must hold the screen, got {np.count_nonzero(on)} pixels"
        )
    reader.refuse_saturated(on)
    reader.refuse_slipped()
    lit = file.projector
    return Photographs(
        str(path),
        (glasses[0], glasses[1]),
        place,
        corners,
        lit.white_cd_m2,
        lit.black_cd_m2,
        lit.primaries,
        reader.digest(path),
        reader.rounding,
    )


def by_edges(glasses: Sequence[Glass], stated: Corners) -> Corners:
    """Corners where the eyes' own white pictures end; as they are stated if that is not seen.

    Parameters
    ----------
    glasses
        Photographs through them.
    stated
        Where corners are within 4 pixels or so.
    """
    whites = np.array([glass.white(glass.eye) for glass in glasses], np.float64)
    corners = found_corners(whites.sum(axis=(0, -1)), stated.at)
    return stated if corners is None else Corners(*corners, "by the picture's edges")


def on_screen(place: Floats) -> NDArray[np.bool_]:
    """(row, col): which pixels are, of their `place` in `Photographs`."""
    return np.asarray(((place >= 0) & (place < 1)).all(axis=-1))


def _channels(path: Path, eye: str, projector: str, section: Files | _Colours) -> dict[str, Files]:
    if not isinstance(section, _Colours):
        return {"W": section}
    listed = {name: files for name, files in dict(section).items() if files is not None}
    if not (set(_WHITE) <= set(listed) or set(_PRIMARIES) <= set(listed)):
        raise InputError(
            f"{path}: photographs.{eye}.{projector} must have W, or R, G and B, got "
            f"{', '.join(listed) or 'nothing'}"
        )
    if set(listed) & set(_PRIMARIES) and not set(_PRIMARIES) <= set(listed):
        raise InputError(
            f"{path}: photographs.{eye}.{projector} must have all of R, G and B, or none, got "
            f"{', '.join(listed)}"
        )
    return listed


class _Reader:
    """Reads photographs of one size, and remembers which samples were full."""

    def __init__(self, folder: Path, encoding: str | None, saturation: float | None) -> None:
        self._folder = folder
        self._colour = None if encoding is None else encoding_named(encoding)
        self._saturation = saturation
        self._full: list[tuple[Path, float, NDArray[np.bool_]]] = []
        self._first: Path | None = None
        self._read: list[Path] = []
        self._steps: list[float] = []
        self._scatter: list[Floats] = []
        self._written: list[tuple[Path, float | None, float]] = []
        self.size: tuple[int, int] | None = None

    def mean(self, files: Files) -> Samples:
        """(row, col, camera channel): the mean of all."""
        names = [files] if isinstance(files, str) else files
        return np.asarray(np.mean([self._one(self._folder / name) for name in names], axis=0))

    def refuse_saturated(self, on: NDArray[np.bool_]) -> None:
        brightest = max(value for _, value, _ in self._full)
        for path, value, full in self._full:
            share = float(np.mean(full[on]))
            if value >= _NEARLY * brightest and share > MOST_CLIPPED:
                raise InputError(
                    f"{path}: {share:.1%} of the screen's pixels are saturated; expose all "
                    f"photographs shorter, or say what value is full (saturation)"
                )

    def refuse_slipped(self) -> None:
        refuse_slipped(
            self._written, way_out="take it again: all must have one time, ISO and aperture"
        )

    def digest(self, path: Path) -> str:
        digest = hashlib.sha256(path.read_bytes())
        for file in self._read:
            digest.update(hashlib.sha256(file.read_bytes()).digest())
        return digest.hexdigest()

    @property
    def rounding(self) -> float:
        """Standard error that pixels share, of the darkest photograph less another."""
        step = min((each for each in self._steps if each > 0), default=0.0)
        if step == 0:
            return 0.0
        scatter = [np.minimum(each / step**2, 1).mean() for each in self._scatter]
        return float(step * np.sqrt(2 * shared_rounding(np.array(min(scatter)))))

    def _one(self, path: Path) -> Samples:
        path = photograph_named(path)
        frame = read_photograph(path, self._colour)
        if frame.colour.transfer != "linear":
            raise InputError(
                f"{path}: wanted a linear photograph, got {frame.colour.named} "
                f'({frame.colour.source}); if it is linear, say encoding = "linear" in '
                f"[photographs], else develop it so"
            )
        size = frame.pixels.shape[:2]
        if self.size is None or self._first is None:
            self.size, self._first = (size[0], size[1]), path
        elif size != self.size:
            raise InputError(
                f"{path}: must be as large as {self._first.name}, {self.size[1]} x {self.size[0]}, "
                f"got {size[1]} x {size[0]}; the camera must not move between photographs"
            )
        self._read.append(path)
        self._steps.append(step_of([frame.pixels]))
        self._scatter.append(scatter_of(frame.pixels))
        self._written.append((path, written_exposure(frame), 1.0))
        self._full.append((path, *clipped(frame, self._saturation)))
        return frame.pixels


def _corners(path: Path, section: _Photographs, size: tuple[int, int]) -> Corners:
    """As they are stated, or those of the whole photograph."""
    rows, cols = size
    whole = [[0.0, 0.0], [cols, 0.0], [cols, rows], [0.0, rows]]
    at = np.array(section.corners or whole, np.float64)
    edges = np.roll(at, -1, axis=0) - at
    if min(float(np.linalg.det(edges[[i - 1, i]])) for i in range(4)) <= 0:
        raise InputError(
            f"{path}: photographs.corners must be [col, row] of the top left, top right, bottom "
            f"right and bottom left corner, got {section.corners}"
        )
    error = section.corners_error
    origin = "as stated"
    if section.corners is None:
        error, origin = CROPPED if error is None else error, "of the photograph"
    elif error is None:
        error, origin = READ_OFF, "as stated, for no edges are seen there"
    return Corners(at, error**2 * np.eye(8), origin)


def _perspective(given: Floats, wanted: Floats) -> Floats:
    """(3, 3) that takes four given points (point, 2) to wanted ones."""
    lines = []
    for (x, y), (u, v) in zip(given, wanted, strict=True):
        lines += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    solved = np.linalg.solve(np.array(lines, float), np.ravel(wanted))
    return np.append(solved, 1.0).reshape(3, 3)


def _taken(perspective: Floats, x: Floats, y: Floats) -> Floats:
    """(..., 2) where points are taken to."""
    a, b, depth = (row[0] * x + row[1] * y + row[2] for row in perspective)
    depth = np.where(np.abs(depth) > 1e-12, depth, np.inf)
    return np.stack([a / depth, b / depth], -1)
