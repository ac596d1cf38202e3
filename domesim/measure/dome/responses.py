"""Photographs of patterns -> what small areas of the screen show of each, without any geometry.

Only the screen's shape is known, and where the camera is. Photographs are binned to at most `BINS`
blocks a side. A block counts in a photograph if all of its pixels see the screen, away from edges
of that photograph's pattern: there, a camera that is a little elsewhere than stated would see
something else. Whatever hides the screen from the camera is not known here; such a block does not
brighten as it should, and the fit leaves it out (`domesim.measure.dome.reflected`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median
from scipy.stats import chi2

from domesim.errors import InputError
from domesim.measure.dome.camera import SURFACES, looked_at, places_in
from domesim.measure.dome.photographs import (
    MARGIN,
    Photographs,
    PixelNoise,
    away_from_edges,
    direct_light,
    noise_of,
)
from domesim.observation.basis import ScreenBasis
from domesim.room.lenses import lens_gains
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]

BINS = 72
"""Most blocks a side of a photograph: 3 degrees of a field of 220."""
_CELLS = 4
"""Areas a side of a photograph in which noise is measured."""
_MEDIAN = float(chi2.median(1))
"""Median of the square of a standard normal number."""
_EDGE = 50.0
"""Times the median's variance from which on a difference is an edge; heavy tails reach far."""
_FINEST = 256
"""Pixels a side of patterns, of which finer detail does not show in reflected light."""


@final
@dataclass(frozen=True, eq=False)
class Responses:
    """What places of the screen show of each photographed pattern.

    Attributes
    ----------
    value, variance
        (photograph, place, primary) light at unit exposure; infinite variance where nothing counts.
    direct
        (photograph, place, primary) direct light of the pattern there.
    excitation
        (photograph, primary, function) means over the screen of pattern times `basis`.
    pattern
        (photograph,) index of the pattern that each shows.
    basis, functions
        Functions on the screen, and (function, place) their values.
    places
        (2, place) to the right and down in the domemaster, -1..1.
    noise
        Of a pixel, by photograph and primary.
    pixels
        Of a place.
    """

    value: Floats
    variance: Floats
    direct: Floats
    excitation: Floats
    pattern: NDArray[np.int64]
    basis: ScreenBasis
    functions: Floats
    places: Floats
    noise: Sequence[Sequence[PixelNoise]]
    pixels: int

    def weighed(self, light: Floats, *, shared: bool = False) -> Responses:
        """The same with the noise of places that show that much light, `value`'s shape.

        Rounding is `shared` by all places, or counts at each alone (`PixelNoise.of_means`).
        """
        variance = np.empty_like(self.variance)
        for shot, each in enumerate(self.noise):
            for primary, noise in enumerate(each):
                variance[shot, :, primary] = noise.of_means(
                    light[shot, :, primary], self.pixels, shared=shared
                )
        return replace(self, variance=np.where(np.isfinite(self.variance), variance, np.inf))

    def only(self, kept: NDArray[np.bool_]) -> Responses:
        """Responses of some photographs, chosen by (photograph,) bool."""
        return replace(
            self,
            value=self.value[kept],
            variance=self.variance[kept],
            direct=self.direct[kept],
            excitation=self.excitation[kept],
            pattern=self.pattern[kept],
            noise=[each for each, one in zip(self.noise, kept, strict=True) if one],
        )


def responses_of(
    theatre: Theatre,
    patterns: Floats,
    photographs: Photographs,
    degree: int,
    *,
    margin: float = MARGIN,
) -> Responses:
    """Bin photographs, and leave out what is near edges.

    Parameters
    ----------
    theatre
        Its screen and projectors; whatever else is in it does not matter.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    photographs
        What was seen of them.
    degree
        Degree of the functions on the screen.
    margin
        Distance that is kept from edges, radians of the camera's view.

    Raises
    ------
    InputError
        If the camera sees nothing of the screen.
    """
    bare = screen_alone(theatre)
    camera, size = photographs.camera, photographs.light.shape[1:3]
    surface, points = looked_at(bare, camera, *places_in(*size))
    on_screen = surface == SURFACES["screen"]
    if not on_screen.any():
        raise InputError(
            f"the camera at {camera.position} m sees nothing of the screen; does it look elsewhere?"
        )
    lit = direct_light(bare, patterns)
    dome = bare.dome
    rays = dome.toward(points)
    row, col = dome.pixel_of(rays[on_screen], lit.shape[1])
    reach = camera.pixels_in(margin, size[1])
    step = -(-max(size) // BINS)
    light = photographs.light / photographs.exposure[:, None, None, None]
    shape = len(light), -(-size[0] // step), -(-size[1] // step), 3
    value, variance = np.zeros(shape), np.full(shape, np.inf)
    direct = np.zeros(shape)
    parts = 2 * _CELLS**2
    levels, scatter = np.zeros((2, len(light), parts, 3))
    count = np.zeros((len(light), parts), np.int64)
    for pattern, one in enumerate(lit):
        seen = np.zeros((*size, 3))
        seen[on_screen] = one[row, col]
        clear = away_from_edges(surface, seen[None], reach) & on_screen
        bright = seen.sum(-1) > seen.sum(-1).max() / 2
        whole = _blocks(clear.astype(np.float64), step) > 1 - 1e-9
        for shot in np.flatnonzero(photographs.pattern == pattern):
            direct[shot] = _blocks(seen, step)
            value[shot] = _blocks(light[shot], step)
            levels[shot], scatter[shot], count[shot] = _scatter(
                light[shot], clear, bright, photographs.steps[shot]
            )
            variance[shot][whole] = 1.0
    counted = np.isfinite(variance).any((0, 3))
    theta = np.arccos(np.clip(rays[..., 2], -1, 1)) / dome.half_angle
    scale = theta / np.maximum(np.hypot(rays[..., 0], rays[..., 1]), 1e-300)
    basis = ScreenBasis(dome, degree)
    u, v = (_blocks(rays[..., axis] * scale, step)[counted] for axis in (0, 1))
    responses = Responses(
        value=value[:, counted],
        variance=variance[:, counted],
        direct=direct[:, counted],
        excitation=excitations(bare, patterns, basis)[photographs.pattern],
        pattern=photographs.pattern,
        basis=basis,
        functions=basis.at(u, v),
        places=np.stack([u, v]),
        noise=noise_of(levels, scatter, count, photographs.steps),
        pixels=step**2,
    )
    return responses.weighed(responses.value)


def screen_alone(theatre: Theatre) -> Theatre:
    """The same screen and projectors without anything else; a lobe is the camera's to see."""
    return replace(theatre.enclosure, floor=None, wall=None, perforation=0.0)


def excitations(theatre: Theatre, patterns: Floats, basis: ScreenBasis) -> Floats:
    """(pattern, primary, function): means over the screen of direct light times functions."""
    count, size = patterns.shape[:2]
    step = next((f for f in range(1, size + 1) if size % f == 0 and size // f <= _FINEST), 1)
    coarse = size // step
    areas = basis.dome.screen_areas(size, size)
    gains = lens_gains(theatre, size, size).sum(0)
    flux = (patterns * (areas * gains / areas.sum())[..., None]).reshape(
        count, coarse, step, coarse, step, 3
    )
    functions = basis.at(*places_in(coarse)).reshape(len(basis), -1)
    power = flux.sum((2, 4)).reshape(count, -1, 3)
    return np.asarray(np.einsum("kxp,fx->kpf", power, functions, optimize=True))


def _blocks(picture: Floats, step: int) -> Floats:
    """Means over blocks of `step` x `step` pixels; what is beyond the picture is 0."""
    rows, cols = picture.shape[:2]
    missing = [(0, -rows % step), (0, -cols % step)] + [(0, 0)] * (picture.ndim - 2)
    whole = np.pad(picture, missing)
    parts = whole.reshape(whole.shape[0] // step, step, whole.shape[1] // step, step, -1)
    return np.asarray(parts.mean((1, 3)).reshape(*parts.shape[:3:2], *picture.shape[2:]))


def _scatter(
    light: Floats, clear: NDArray[np.bool_], bright: NDArray[np.bool_], steps: Floats
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """(area, primary) light and half of the squared difference of neighbours; (area,) pairs.

    Means over parts of the picture, lit and dark ones apart, of all differences but those that are
    much larger than the median: edges of what hides the screen are no noise.
    """
    down, across = (np.arange(size) * _CELLS // size for size in light.shape[:2])
    label = np.where(clear, 2 * (down[:, None] * _CELLS + across) + bright, -1)
    pairs = (label[:, 1:] == label[:, :-1]) & (label[:, 1:] >= 0)
    own = label[:, 1:][pairs]
    count = np.bincount(own, minlength=2 * _CELLS**2)
    some = np.flatnonzero(count)
    levels, locals_ = np.zeros((2, len(count), 3))
    for primary in range(3):
        plane = light[..., primary]
        near = plane[:, 1:][pairs], plane[:, :-1][pairs]
        levels[some, primary] = median((near[0] + near[1]) / 2, own, some)
        square = (near[0] - near[1]) ** 2 / 2
        local = np.zeros(len(count))
        local[some] = median(square, own, some) / _MEDIAN
        small = square <= _EDGE * np.maximum(local[own], steps[primary] ** 2)
        number = np.maximum(np.bincount(own[small], minlength=len(count)), 1)
        locals_[:, primary] = np.bincount(own[small], square[small], len(count)) / number
    return levels, locals_, count
