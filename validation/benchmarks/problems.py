"""What solvers are tried on: the classes of problems, each at any size.

Flat pictures are `size` wide and 1080/2048 as high. Photographs (1920 x 1080) are continued by
their mirror image to 2048 x 1080, and beyond; smaller sizes are means over pixels. So larger
pictures have finer pixels, on the same screen: 43 a degree at 2048, 172 at 8192, which no eye
resolves. The *wide* pair is on a screen that grows with it, 43 pixels a degree at any size, and
smaller ones are parts of the photograph: what grows is the picture, and nothing else. All start at
exact clipped subtraction, which is also the regulariser's anchor, with the product's weighting
(low-frequency gain 0.1) and mu (1e-4).

The *dome* is flat, too: uniform pollution, 0.3 of the mean light, over all of a rectangle. Its
picture is a band of the bundled night, dark sky above the lit observatory, of which subtraction
clips two thirds; a generated night of `testing.masters` would be easier (a few per cent). The
bundled night has 1024 pixels a side: beyond, it is interpolated, and lacks fine detail.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.ndimage import zoom

from compensate.bundled import bundled_night
from compensate.fourier import padded_size
from compensate.pose import Eye, Posed, pose
from compensate.problem import Problem
from compensate.solver.baselines import clipped_subtraction
from compensate.weighting import (
    REGULARISATION,
    CsfWeighting,
    PerceptualWeighting,
    Weighting,
    csf_gains,
)
from domesim.light import Light
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.room.viewing import Viewing
from domesim.scene import Scene, load_dome, load_scene
from domesim.scene.screening import decoded
from testing.masters import night
from testing.pairs import averaged, generated
from validation.data import from_data

POLLUTION = 0.3
"""k: what a white dome adds to itself."""
CROSSTALK = 0.05
PHOTOGRAPH = "trunks"
STEREO = "stereo_polarised_paper"
DOME, DOME_3D = "dome_imax", "dome_stereo_polarised"
FULL = 2048
"""Width of a flat picture at its full size."""
_BAND = (slice(None), slice(400, 872), slice(64, 960))  # of the bundled night
_VISIBLE = 1e-5  # of white: more than this is clipped


@final
@dataclass(frozen=True)
class Task:
    """A problem, and where to start.

    Parameters
    ----------
    problem
        What to minimise.
    start
        Feasible light.
    screen
        (row, col) bool: pixels that count.
    """

    problem: Problem
    start: Light
    screen: NDArray[np.bool_]

    @property
    def planes(self) -> int:
        """Projected planes: views times primaries."""
        return int(self.start.shape[0] * self.start.shape[3])

    @property
    def clipped(self) -> float:
        """Share of the screen's pixels where subtraction needs less light than none."""
        error = self.problem.residual(self.start)[:, self.screen]
        return float(np.mean(np.any(error > _VISIBLE, axis=-1)))


@final
class Case:
    """One problem of one size.

    Parameters
    ----------
    name
        In `PROBLEMS`, or another.
    size
        Columns.
    pose
        The problem of a master in that precision.
    desired
        Master light.
    """

    def __init__(self, name: str, size: int, pose: Callable[[Light], Task], desired: Light) -> None:
        self.name, self.size = name, size
        self._pose, self._desired = pose, desired

    def posed(self, dtype: DTypeLike) -> Task:
        """The problem in that precision, with nothing computed yet."""
        return self._pose(self._desired.astype(dtype))

    @cached_property
    def single(self) -> Task:
        """In float32, for solvers."""
        return self.posed(np.float32)

    @cached_property
    def double(self) -> Task:
        """In float64, for the truth and for solvers that need it."""
        return self.posed(np.float64)


def night_dome(size: int, scene: str = DOME, seed: int = 0) -> Case:
    """A generated RGB night in a theatre: easy, for few of its pixels clip."""
    return Case("night", size, _in_theatre(scene), night(size, seed))


def _dome(size: int) -> Case:
    scene = load_scene(STEREO)
    rows, cols = _shape(size)
    band = _bundled(load_dome(DOME))[_BAND]
    desired = _grey(_resized(band, rows, cols), scene)
    ones = np.ones((1, rows, cols))
    core = np.full((1, 1, 1), POLLUTION / (rows * cols))
    factors = LowRank(ones[0], ones, core, ones, np.zeros((1, rows, cols)))
    observation = LowRankObservation(factors, np.ones((rows, cols), bool))

    def task(light: Light) -> Task:
        return _posed(observation, _one_channel(scene, rows, cols, 1), light)

    return Case("dome", size, task, desired)


def _dome_rgb(size: int) -> Case:
    desired = _resized(_bundled(load_dome(DOME)), size, size)
    return Case("dome-rgb", size, _in_theatre(DOME), desired)


def _dome_3d(size: int) -> Case:
    one = _resized(_bundled(load_dome(DOME)), size, size)
    pair = np.concatenate([one, np.roll(one, size // 100, axis=2)])
    return Case("dome-3d-rgb", size, _in_theatre(DOME_3D), pair)


def _photo(size: int) -> Case:
    return _grey_pair("photo", size, _photograph(size))


def _synthetic(size: int) -> Case:
    return _grey_pair("synthetic", size, _drawing(size))


def _photo_rgb(size: int) -> Case:
    return _colour_pair("photo-rgb", size, _photograph(size))


def _photo_rgb_wide(size: int) -> Case:
    viewing, wider = load_scene(STEREO).viewing, size / FULL
    grown = replace(
        viewing, extent=viewing.extent * wider, image_area=viewing.image_area * wider**2
    )
    return _colour_pair("photo-rgb-wide", size, _continued(_shape(size)), grown)


def _synthetic_rgb(size: int) -> Case:
    return _colour_pair("synthetic-rgb", size, _drawing(size))


def _map(size: int) -> Case:
    rows, cols = _shape(size)
    row, col = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : cols * 1j]
    # 1 % where a seat to the left, or right, of the middle looks straight on; 2 % farthest off
    off = np.stack([(col - seat) ** 2 + 0.3 * row**2 for seat in (-0.2, 0.2)])
    share = 1 + off / off.max()
    observation = Crosstalk(rows, cols, leak_matrices(0.01, 1), share=share)
    return _grey_pair("map", size, _drawing(size), observation)


PROBLEMS: Mapping[str, tuple[str, Callable[[int], Case]]] = {
    "dome": ("dome, k 0.3, one channel", _dome),
    "dome-rgb": ("dome_imax, RGB disc", _dome_rgb),
    "dome-3d-rgb": ("dome_stereo_polarised, two RGB discs", _dome_3d),
    "photo": ("photographed pair, 5 %, one channel", _photo),
    "synthetic": ("generated pair, 5 %, one channel", _synthetic),
    "photo-rgb": ("photographed pair, 5 %, RGB", _photo_rgb),
    "photo-rgb-wide": ("photographed pair, 5 %, RGB, 43 pixels a degree", _photo_rgb_wide),
    "synthetic-rgb": ("generated pair, 5 %, RGB", _synthetic_rgb),
    "map": ("generated pair, 1 to 2 % from place to place", _map),
}
"""Name -> title, and the problem of a size."""


def _shape(size: int) -> tuple[int, int]:
    return round(size * 1080 / FULL), size


def _photograph(size: int) -> Light:
    times = max(1, FULL // size)
    rows, cols = _shape(size)
    return averaged(_continued((rows * times, cols * times)), times)


def _continued(shape: tuple[int, int]) -> Light:
    """The middle of the photograph and its mirror images."""
    light, _ = from_data(PHOTOGRAPH, load_scene(STEREO))
    short = [max(0, side - had) for side, had in zip(shape, light.shape[1:3], strict=True)]
    margins = [(0, 0), *((side // 2, side - side // 2) for side in short), (0, 0)]
    return _centre(np.pad(light, margins, "symmetric"), shape)


def _drawing(size: int) -> Light:
    rows, cols = _shape(size)
    return _centre(generated(size), (rows, cols))


def _bundled(scene: Scene) -> Light:
    return decoded(bundled_night(), scene).clip(0, 1)


def _resized(light: Light, rows: int, cols: int) -> Light:
    """Means over whole pixels, then linear interpolation."""
    smaller = averaged(light, max(1, min(light.shape[1] // rows, light.shape[2] // cols)))
    factors = (1, rows / smaller.shape[1], cols / smaller.shape[2], 1)
    return zoom(smaller, factors, order=1, mode="nearest", grid_mode=True).clip(0, 1)


def _centre(light: Light, shape: tuple[int, int]) -> Light:
    top, left = ((had - side) // 2 for had, side in zip(light.shape[1:3], shape, strict=True))
    return light[:, top : top + shape[0], left : left + shape[1]]


def _grey(light: Light, scene: Scene) -> Light:
    return (light.astype(np.float64) @ scene.projector.luminance_weights)[..., None].clip(0, 1)


def _in_theatre(name: str) -> Callable[[Light], Task]:
    return _posed_in(load_dome(name), PerceptualWeighting())


def _posed_in(scene: Scene, eye: Eye) -> Callable[[Light], Task]:
    """As the product poses it."""

    def task(light: Light) -> Task:
        posed: Posed = pose(light, scene, eye)
        return Task(posed.problem, posed.subtractive, posed.screen)

    return task


def _grey_pair(
    name: str,
    size: int,
    pair: Light,
    observation: Crosstalk | None = None,
) -> Case:
    scene = load_scene(STEREO)
    rows, cols = pair.shape[1:3]
    seen = observation or Crosstalk(rows, cols, leak_matrices(CROSSTALK, 1))

    def task(light: Light) -> Task:
        return _posed(seen, _one_channel(scene, rows, cols, 2), light)

    return Case(name, size, task, _grey(pair, scene))


def _colour_pair(name: str, size: int, pair: Light, viewing: Viewing | None = None) -> Case:
    scene = load_scene(STEREO)
    rows, cols = pair.shape[1:3]
    observation = Crosstalk(rows, cols, leak_matrices(CROSSTALK))
    screen = np.ones((rows, cols), bool)
    seen_from = viewing or scene.viewing

    def task(light: Light) -> Task:
        weights = scene.projector.luminance_weights
        return _posed(observation, PerceptualWeighting()(seen_from, weights, screen, 2), light)

    return Case(name, size, task, pair)


def _one_channel(scene: Scene, rows: int, cols: int, views: int) -> CsfWeighting:
    """`PerceptualWeighting`'s luminance."""
    settings = PerceptualWeighting()
    padded = (padded_size(rows, settings.padding), padded_size(cols, settings.padding))
    gains, peak = csf_gains(scene.viewing, (rows, cols), padded, settings.low_frequency)
    support = np.ones((rows, cols), bool)
    return CsfWeighting(gains[None], np.ones((1, 1)), support, padded, peak, views)


def _posed(observation: AdjointObservation, weighting: Weighting, desired: Light) -> Task:
    plain = Problem(observation, weighting, desired)
    start, _ = clipped_subtraction(plain)
    start = np.asarray(start, desired.dtype)
    problem = Problem(observation, weighting, desired, anchor=start, regularisation=REGULARISATION)
    return Task(problem, start, np.ones(desired.shape[1:3], bool))
