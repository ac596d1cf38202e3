"""Panoramas -> domemasters: light of all directions, sampled where a dome's pixels point.

An *equirectangular* panorama has longitude along its columns, the front in the middle, and latitude
along its rows, the room's zenith on top. A *cube strip* has six square faces side by side, each
turned as FFmpeg's ``v360`` has it: seen from the cube's middle, the bottom of the upper face and
the top of the lower one lie at the front's.

A pixel of the domemaster is the mean over its area, of as many samples as the panorama has pixels
there, at least four; each is interpolated linearly. Rows near a pole have the same few directions
many times over: they are averaged first along the arc that is a pixel at the equator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.strips import in_strips
from domesim.room.dome import Dome

Floats = NDArray[np.floating]

FACES = "rludfb"
"""Letters of a cube's faces: right, left, up, down, front, back."""

_AXES = {  # of a face in the room: to its right, down and out (x right, y front, z up)
    "f": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "r": ((0, -1, 0), (0, 0, -1), (1, 0, 0)),
    "b": ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "l": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
    "u": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "d": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}
_MARGIN = 1  # pixels around a picture, from where it goes on
_TRIED = 1 << 18  # places at which the loss is taken
_MOST = 8  # samples along a side of a domemaster's pixel


class Panorama(ABC):
    """Light of all directions in one picture. Abstract."""

    @property
    @abstractmethod
    def density(self) -> float:
        """Pixels per radian, at the equator or in the middle of a face."""

    @abstractmethod
    def sampled(self, directions: Floats) -> Floats:
        """(..., primary) light along unit vectors (..., xyz) of the room."""


@final
class Equirectangular(Panorama):
    """Longitude by latitude.

    Parameters
    ----------
    light
        (row, col, primary), linear, twice as wide as high.

    Raises
    ------
    InputError
        If it has another shape.
    """

    def __init__(self, light: Floats) -> None:
        rows, cols = light.shape[:2]
        if cols != 2 * rows or rows < 2:
            raise InputError(
                f"an equirectangular panorama is twice as wide as high, got {cols} x {rows} px"
            )
        self._shape = rows, cols
        even = _evened(light)
        across = np.roll(even, cols // 2, axis=1)  # beyond a pole
        even = np.concatenate([across[:_MARGIN], even, across[-_MARGIN:]])
        self._light = np.pad(even, ((0, 0), (_MARGIN, _MARGIN), (0, 0)), mode="wrap")

    @property
    def density(self) -> float:
        """See `Panorama`."""
        return float(self._shape[1] / (2 * np.pi))

    def sampled(self, directions: Floats) -> Floats:
        """See `Panorama`."""
        x, y, z = np.moveaxis(directions, -1, 0)
        rows, cols = self._shape
        row = (0.5 - np.arcsin(np.clip(z, -1, 1)) / np.pi) * rows - 0.5
        col = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * cols - 0.5
        return _interpolated(self._light, row, col)


@final
class CubeStrip(Panorama):
    """Six faces side by side.

    Parameters
    ----------
    light
        (row, col, primary), linear, six times as wide as high.
    faces
        The letters of `FACES` in the order of the strip.

    Raises
    ------
    InputError
        If it has another shape, or the faces are not the six.
    """

    def __init__(self, light: Floats, faces: str) -> None:
        side, cols = light.shape[:2]
        if cols != 6 * side:
            raise InputError(f"a cube strip is six times as wide as high, got {cols} x {side} px")
        if sorted(faces) != sorted(FACES):
            raise InputError(
                f"faces of a cube are {', '.join(FACES)} in their order, got {faces!r}"
            )
        self._side, self._faces = side, faces
        margin = ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN), (0, 0))
        self._light = [np.pad(face, margin, mode="edge") for face in np.split(light, 6, axis=1)]

    @property
    def density(self) -> float:
        """See `Panorama`."""
        return float(self._side / 2)

    def sampled(self, directions: Floats) -> Floats:
        """See `Panorama`."""
        axes = np.array([_AXES[letter] for letter in self._faces], np.float64)
        face = np.argmax(directions @ axes[:, 2].T, axis=-1)
        result = np.empty((*face.shape, self._light[0].shape[-1]), self._light[0].dtype)
        for k, light in enumerate(self._light):
            on = face == k
            across, down, out = (directions[on] @ axes[k].T).T
            place = (np.stack([down, across]) / out + 1) * (self._side / 2) - 0.5
            result[on] = _interpolated(light, *place)
        return result


@final
@dataclass(frozen=True)
class Made:
    """A domemaster of a panorama.

    Attributes
    ----------
    light
        (row, col, primary) linear light; 0 outside the circle.
    loss
        How far the panorama is off when it is sampled from the domemaster again, on the dome: the
        root mean square over solid angle, as a share of that of its light.
    """

    light: Floats
    loss: float


def domemaster_of(panorama: Panorama, dome: Dome, size: int | None = None) -> Made:
    """Make a domemaster of a panorama.

    Parameters
    ----------
    panorama
        The light around.
    dome
        Its half-angle, and how its zenith leans to the front; the panorama's horizon is level.
    size
        Pixels along a side; as dense as the panorama if None.

    Returns
    -------
    made
        The domemaster, and what is lost in it.

    Raises
    ------
    InputError
        If `size` is less than 2.
    """
    usual = 2 * round(panorama.density * dome.half_angle)
    size = max(2, usual) if size is None else size
    if size < 2:
        raise InputError(f"a domemaster has at least 2 x 2 pixels, got {size} x {size}")
    density = size / 2 / dome.half_angle
    finer = int(np.clip(np.ceil(2 * panorama.density / density), 2, _MOST))

    def mean(_: int, rows: slice) -> Floats:
        part = slice(rows.start * finer, rows.stop * finer)
        directions = dome.directions(size * finer, size * finer, part) @ dome.to_room.T
        found = panorama.sampled(directions)
        blocks = found.reshape(rows.stop - rows.start, finer, size, finer, -1)
        return np.asarray(blocks.mean(axis=(1, 3)))

    light = np.concatenate(in_strips(mean, (1, size, size * finer**2)))
    loss = _loss(panorama, dome, light)
    return Made(light * dome.inside(size, size)[..., None], loss)


def _loss(panorama: Panorama, dome: Dome, light: Floats) -> float:
    # Evenly by solid angle: by height over the rim, and by the golden angle around
    places = np.arange(_TRIED)
    rim = np.cos(dome.half_angle)
    theta = np.arccos(rim + (1 - rim) * (places + 0.5) / _TRIED)
    turns = np.pi * (3 - np.sqrt(5)) * places
    directions = [np.sin(theta) * np.cos(turns), np.sin(theta) * np.sin(turns), np.cos(theta)]
    wanted = panorama.sampled(np.stack(directions, -1) @ dome.to_room.T)
    row, col = (
        (theta / dome.half_angle * way(turns) + 1) * (len(light) / 2) - 0.5
        for way in (np.sin, np.cos)
    )
    margin = ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN), (0, 0))
    found = _interpolated(np.pad(light, margin, mode="edge"), row, col, order=3)
    scale = float(np.sqrt(np.mean(np.square(wanted, dtype=np.float64))))
    off = float(np.sqrt(np.mean(np.square(found - wanted, dtype=np.float64))))
    return off / scale if scale else 0.0


def _evened(light: Floats) -> Floats:
    """Rows averaged along the arc that is a pixel's at the equator."""
    rows, cols = light.shape[:2]
    latitudes = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
    result = np.array(light)
    for row, width in enumerate(np.minimum(1 / np.cos(latitudes), cols)):
        if width > 1 + 1e-9:
            sums = np.concatenate(
                [np.zeros((1, light.shape[2])), np.cumsum(light[row], 0, np.float64)]
            )
            result[row] = (_summed(sums, width / 2) - _summed(sums, -width / 2)) / width
    return result


def _summed(sums: Floats, away: float) -> Floats:
    """Integral of a row that goes around, from its start to `away` from each pixel's middle."""
    cols = len(sums) - 1
    turns, place = np.divmod(np.arange(cols) + 0.5 + away, cols)
    below = place.astype(np.intp)
    part = (place - below)[:, None]
    inner = sums[below] * (1 - part) + sums[np.minimum(below + 1, cols)] * part
    return np.asarray(inner + turns[:, None] * sums[-1])


def _interpolated(light: Floats, row: Floats, col: Floats, order: Literal[1, 3] = 1) -> Floats:
    """(..., primary) light of a picture with a margin, counted from its first pixel's middle."""
    places = np.stack([row + _MARGIN, col + _MARGIN])
    planes = [
        scipy.ndimage.map_coordinates(light[..., p], places, order=order, mode="nearest")
        for p in range(light.shape[2])
    ]
    return np.stack(planes, axis=-1)
