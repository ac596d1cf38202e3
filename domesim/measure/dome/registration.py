"""Where a camera is and looks, from a photograph of the *registration* pattern.

The pattern's dots are found as blobs of light, each is matched with the one that the stated camera
would see nearest to it, and position, direction, field of view (and a pinhole's distortion) are
fitted to the blobs' centroids, robustly; then all is matched again. As the dots are on a sphere,
parallax tells the position as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from domesim.errors import InputError
from domesim.measure.dome.camera import Camera, folding
from domesim.room.dome import Dome
from domesim.scene.fields import three

Floats = NDArray[np.float64]

FEWEST = 8
"""Dots that must be found."""
WIDEST = np.radians(1.0)
"""Rms distance of found dots from where the fitted camera sees them, from which it is none."""
_WIDER = 0.1
"""Largest change of the field's logarithm, each time."""
_NOISY = 8.0
"""Standard deviations of noise below which a pixel is no part of a blob."""
_BRIGHT = 0.3
"""Share of the brightest dot's light above which a pixel is part of a blob."""
_SEVERAL = 3
"""How often dots are matched."""
_LARGER = 1.3
"""How much larger dots are than others for their blobs to be: as much."""


@final
@dataclass(frozen=True)
class Registered:
    """A camera that was found.

    Attributes
    ----------
    camera
        The camera.
    dots, of
        How many dots were matched, and how many the camera could see.
    rms
        Distance between dots found and foretold, radians.
    position_error, turn_error
        Standard errors: m, and radians.
    """

    camera: Camera
    dots: int
    of: int
    rms: float
    position_error: tuple[float, float, float]
    turn_error: tuple[float, float, float]

    def in_words(self) -> str:
        """The same for a person."""
        x, y, z = self.camera.position
        right, up, ahead = (f"{1000 * part:.0f}" for part in self.position_error)
        return (
            f"camera: from {self.dots} of {self.of} dots, {np.degrees(self.rms):.2f}° rms off: at "
            f" [{x:.3f}, {y:.3f}, {z:.3f}] m ± [{right}, {up}, {ahead}] mm, field "
            f"{np.degrees(self.camera.field):.2f}°"
        )


def registered(dome: Dome, markers: Floats, photograph: Floats, start: Camera) -> Registered:
    """The camera that took a photograph of the registration pattern.

    Parameters
    ----------
    dome
        The screen.
    markers
        (marker, 3) azimuth, angle from the zenith and radius, degrees, of `patterns.json`.
    photograph
        (row, col, primary) linear light.
    start
        The camera as it is stated: within about a quarter of the distance between dots.

    Raises
    ------
    InputError
        If too few dots are found where they should be, or they are turned or mirrored.
    """
    places = dome.surface(*np.radians(markers[:, 1::-1].T)) @ dome.to_room.T
    blobs, sizes = _blobs(photograph)
    cols = photograph.shape[1]
    camera, matched, seen = start, np.zeros(0, np.int64), np.zeros(0, np.int64)
    for turn in range(_SEVERAL):
        matched, seen, of = _matched(camera, places, blobs, photograph.shape[:2])
        if len(matched) < FEWEST:
            raise InputError(
                f"registration: found {len(matched)} of {of} dots where the stated camera would "
                f"see them, wanted {FEWEST} or more; photograph the registration pattern in the "
                f"dark, sharply, with all other light off, and state position, look_at and field "
                f"to within a few degrees"
            )
        camera, covariance = _fitted(camera, places[matched], blobs[seen], free=turn > 0)
    u, v = camera.places(places[matched])
    off = np.hypot(*(np.stack([u, v]) - blobs[seen].T)) / camera.pixels_in(1.0, cols) * cols / 2
    rms = float(np.sqrt(np.mean(off**2)))
    if rms > WIDEST:
        raise InputError(
            f"registration: dots are {np.degrees(rms):.1f}° (rms) from where any camera of this "
            f"kind would see them; check mapping, field_deg, and the dome's shape"
        )
    _require_upright(markers[matched], sizes[seen])
    spread = three(np.sqrt(np.diag(covariance)[:3]))
    return Registered(
        camera, len(matched), of, rms, spread, three(np.sqrt(np.diag(covariance)[3:6]))
    )


def _blobs(photograph: Floats) -> tuple[Floats, Floats]:
    """(blob, uv) centroids, and (blob,) areas in pixels."""
    light = photograph.sum(-1)
    rows, cols = light.shape
    light = light - np.median(light)
    noise = float(np.median(np.abs(light))) / 0.6745
    numbers, count = ndimage.label(
        light > max(_BRIGHT * float(np.quantile(light, 0.9995)), _NOISY * noise)
    )
    if not count:
        return np.zeros((0, 2)), np.zeros(0)
    index = np.arange(1, count + 1)
    row, col = np.array(ndimage.center_of_mass(np.maximum(light, 0), numbers, index)).T
    areas = np.bincount(np.ravel(numbers))[1:].astype(np.float64)
    return np.stack([(2 * col + 1 - cols) / cols, (2 * row + 1 - rows) / cols], -1), areas


def _matched(
    camera: Camera, places: Floats, blobs: Floats, size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Indices of places and of their blobs, and how many places the camera could see."""
    u, v = camera.places(places)
    with np.errstate(invalid="ignore"):
        inside = camera.sees(u, v) & (np.abs(v) < size[0] / size[1]) & np.isfinite(u)
    seen = np.flatnonzero(inside)
    if not len(blobs) or len(seen) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), len(seen)
    expected = np.stack([u, v], -1)[seen]
    apart = np.asarray(cKDTree(expected).query(expected, 2)[0])[:, 1]
    away, nearest = (np.asarray(part) for part in cKDTree(blobs).query(expected))
    back = np.asarray(cKDTree(expected).query(blobs)[1])
    good = (away < 0.4 * apart) & (back[nearest] == np.arange(len(seen)))
    return seen[good], nearest[good], len(seen)


def _fitted(camera: Camera, places: Floats, blobs: Floats, *, free: bool) -> tuple[Camera, Floats]:
    """The camera that sees places where blobs are; distortion is fitted if `free`."""
    bent = free and camera.mapping == "perspective" and len(places) >= 2 * FEWEST

    def moved(x: Floats) -> Camera:
        step = np.asarray(x[:3])
        return replace(
            camera,
            position=three(np.add(camera.position, step)),
            look_at=three(np.add(camera.look_at, step)),
            turn=three(np.add(camera.turn, x[3:6])),
            field=float(camera.field * np.exp(x[6])),
            distortion=camera.distortion + (float(x[7]) if bent else 0.0),
        )

    def off(x: Floats) -> Floats:
        u, v = moved(x).places(places)
        return np.concatenate([u - blobs[:, 0], v - blobs[:, 1]])

    low, high = np.full(7 + bent, -np.inf), np.full(7 + bent, np.inf)
    low[6], high[6] = -_WIDER, _WIDER
    if bent:
        low[7] = 0.95 * folding(camera.field * np.exp(_WIDER)) - camera.distortion
        low[7], high[7] = min(low[7], -1e-6), 1.0
    solution = least_squares(
        off, np.zeros(7 + bent), bounds=(low, high), loss="soft_l1", f_scale=0.005, x_scale="jac"
    )
    slopes = np.asarray(solution.jac)
    # Dots all over the screen tell all parameters: no singular value is lost in rounding
    inverse = np.linalg.pinv(slopes.T @ slopes)
    variance = float(np.sum(off(solution.x) ** 2)) / max(1, 2 * len(places) - len(solution.x))
    return moved(solution.x), inverse * variance


def _require_upright(markers: Floats, sizes: Floats) -> None:
    """The larger dots must be at the front and on the right, where the pattern has them."""
    factor = markers[:, 2] / markers[:, 2].min()
    usual = np.median(sizes[factor < _LARGER])
    for one in np.unique(np.round(factor[factor > _LARGER], 3)):
        own = sizes[np.isclose(factor, one, atol=1e-3)]
        if np.median(own) < _LARGER * usual:
            raise InputError(
                "registration: the larger dots are not at the front and on the right; the picture "
                "is turned or mirrored, or the camera looks elsewhere than stated"
            )
