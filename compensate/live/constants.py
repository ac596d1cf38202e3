"""What a scene means for a live picture: numbers and small maps that all its frames share.

Live pictures are made by the aim of `compensate.aim` and exact clipped subtraction, as files are.
What varies smoothly over the screen is kept by cells, at most 64 across, and is linear in between:
of a dome the direct gain, ambient light, and the modes of its reflections; of a pair the map of its
crosstalk. `compensate.live.dome`, `pair` and `shader` compute with nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias, cast, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from compensate.aim import Sight, dome, pair
from compensate.blocks import smooth
from domesim.errors import InputError
from domesim.light.blocks import block_sums
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.lowrank import LowRankObservation
from domesim.scene import DomeScene, Scene
from domesim.scene.grade import TAKEN_OUT

CELLS = 64
"""Most cells across a picture."""
SETTLED = 1e-3
"""Change of a dome's floor, as a share of white, after which Newton's step is exact to 1e-5."""
STEPS = 30
"""Newton steps at most; of a moving picture one or two are usual."""

Floats: TypeAlias = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class DomeConstants:
    """A dome for pictures of one size.

    Light here is over the direct gain D: that of a floor f is f / D, which is what subtraction
    takes off the projected light.

    Parameters
    ----------
    screen
        (row, col) bool.
    weights
        (primary,) of luminance.
    dark
        Luminance below which the eye loses contrast, of white.
    block, radius
        Pixels along a block's side, and the radius of the guided mean, blocks.
    cell
        Pixels along a cell's side: a multiple of `block`.
    gain
        (cell row, cell col): D.
    ambient
        (primary, cell row, cell col): ambient light over D.
    spread
        (rank, cell row, cell col): modes over D.
    collect
        (rank, cell row, cell col): what a unit of light on a pixel excites.
    core
        (primary, rank, rank): how the modes excite each other.
    kept
        (1, primary) light without a picture that belongs to the grade.
    """

    screen: NDArray[np.bool_]
    weights: Floats
    dark: float
    block: int
    radius: int
    cell: int
    gain: Floats
    ambient: Floats
    spread: Floats
    collect: Floats
    core: Floats
    kept: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """(row, col) of a view."""
        rows, cols = self.screen.shape
        return rows, cols


@final
@dataclass(frozen=True, eq=False)
class PairConstants:
    """A stereo system for pairs of one size.

    Parameters
    ----------
    rows, cols
        Of each view.
    weights
        (primary,) of luminance.
    block
        Pixels along a side of the blocks that veils are computed by.
    down, across
        (place, of) by which a ghost's local mean weighs a column of blocks, and a row.
    cell
        Pixels along a cell's side; 0 if the map is flat.
    share
        (view, cell row, cell col) of the map, or (view, 1, 1).
    matrices
        (view, primary, primary): what an eye sees of the other's light where the map is 1.
    black
        (view, primary) light without any picture.
    kept
        (view, primary) how much of that belongs to the grade.
    """

    rows: int
    cols: int
    weights: Floats
    block: int
    down: Floats
    across: Floats
    cell: int
    share: Floats
    matrices: Floats
    black: Floats
    kept: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """(row, col) of a view."""
        return self.rows, self.cols


Constants: TypeAlias = DomeConstants | PairConstants


def constants_of(scene: Scene, rows: int, cols: int) -> Constants:
    """Computes what a scene means for live pictures of one size.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    rows, cols
        Size of a view, pixels.

    Returns
    -------
    constants
        Of a dome, or of a pair.

    Raises
    ------
    InputError
        If the scene is of several seats or a 3D dome, its crosstalk is a table from grey to grey,
        a lens scatters light, a room reflects a pair, a dome whose lens is not corrected keeps
        light without a picture, or it cannot show such a picture.
    """
    if scene.several_seats:
        raise InputError(f"{scene.name}: live pictures are for one seat; name one (--seat)")
    observation = scene.solvable(rows, cols)
    sight = Sight(
        scene.screen(rows, cols),
        scene.projector.luminance_weights,
        scene.projector.white,
        scene.viewing.pixels_per_degree(rows, cols),
    )
    if isinstance(scene, DomeScene) and scene.black_differs:
        raise InputError(
            f"{scene.name}: live pictures are of projectors whose black is the same all over the "
            f"screen, not of units with a black_cd_m2 or an uplift; compensate the show as files "
            f"(domesim compensate)"
        )
    if isinstance(observation, LowRankObservation):
        if scene.kept.any() and not observation.has_unit_gain:
            raise InputError(
                f"{scene.name}: live pictures keep light without a picture only where lenses are "
                f"corrected; use --black {TAKEN_OUT} and --ambient {TAKEN_OUT}"
            )
        return _of_dome(observation, sight, scene.kept)
    if isinstance(observation, Crosstalk) and scene.views == 2 and observation.black.ndim == 2:
        return _of_pair(observation, sight, scene.kept)
    raise InputError(
        f"{scene.name}: live pictures are of domes and rooms with one view, or of linear "
        f"crosstalk of a pair, not of many views, displays before a photograph, 3D domes, tables "
        f"from grey to grey, scattered light ([lens]), or 3D screens with a [room]; compensate "
        f"such shows as files (domesim compensate)"
    )


def turns_of(k: PairConstants) -> int:
    """Returns how often the eyes take turns until subtraction is exact to 1e-5.

    Each gains what the strongest crosstalk leaves of the other's last change.
    """
    strength = max(
        float(np.linalg.norm(matrix, 2) * share.max())
        for matrix, share in zip(k.matrices, k.share, strict=True)
    )
    return 1 + math.ceil(math.log(1e-5) / math.log(min(max(strength, 1e-5), 0.9)))


def _of_dome(observation: LowRankObservation, sight: Sight, kept: Floats) -> DomeConstants:
    f, screen = observation.factors, observation.screen
    block, radius = dome.block_of(sight.density)
    cell = block * -(-max(screen.shape) // (CELLS * block))
    on = screen.astype(np.float64)
    count = block_sums(on, cell)
    there = count > 0

    def by_cells(planes: NDArray[np.floating]) -> Floats:
        """Means over the screen; beyond it, those of the nearest cell."""
        means = block_sums(on * planes, cell) / np.maximum(count, 1)
        if there.all():
            return np.asarray(means)
        nearest = distance_transform_edt(~there, return_distances=False, return_indices=True)
        return np.asarray(means[(..., *cast("tuple[NDArray[np.intp], ...]", nearest))])

    gain = np.asarray(f.direct_gain, np.float64)
    return DomeConstants(
        screen=screen,
        weights=sight.weights,
        dark=dome.DARK / sight.white,
        block=block,
        radius=radius,
        cell=cell,
        gain=by_cells(gain),
        ambient=by_cells(f.ambient / gain),
        spread=by_cells(f.spread / gain),
        collect=by_cells(f.collect),
        core=np.asarray(f.core, np.float64),
        kept=kept,
    )


def _of_pair(observation: Crosstalk, sight: Sight, kept: Floats) -> PairConstants:
    rows, cols = observation.shape[1:3]
    block, sigma = pair.block_of(sight.density)
    cell, share = 0, observation.share.max(axis=(1, 2), keepdims=True)
    if np.ptp(observation.share, axis=(1, 2)).any():
        cell = -(-max(rows, cols) // CELLS)
        share = block_sums(observation.share, cell) / block_sums(np.ones((rows, cols)), cell)
    return PairConstants(
        rows=rows,
        cols=cols,
        weights=sight.weights,
        block=block,
        down=_means(-(-rows // block), sigma),
        across=_means(-(-cols // block), sigma),
        cell=cell,
        share=share,
        matrices=observation.matrices,
        black=observation.black,
        kept=kept,
    )


def _means(count: int, sigma: float) -> Floats:
    """(place, of) weights of the local means of a line of `count` values."""
    return np.asarray(smooth(np.eye(count)[:, None, :], sigma)[:, 0, :].T)
