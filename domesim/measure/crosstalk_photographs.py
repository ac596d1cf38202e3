"""Crosstalk from photographs through the eyewear, and its map over the screen.

Through one glass, with black subtracted, a pixel sees o of the eye's own picture and t of the other
one's. Lens, screen and vignetting are in both alike: t/o is the share that leaks. Over a cell of
the screen it is sum(t)/sum(o), and its error follows from what t - q o leaves, summed over blocks
of pixels, for neighbours share noise where colours were interpolated. The cells are then smoothed
(`domesim.measure.smoothing`).

Corners of the screen are known within an error. By that, cells are a little elsewhere than they are
said to be, and show what their map's slope times that distance makes of it: to first order, a
change for each of the corners' independent errors.

A camera is linear in light: with photographs of the primaries, A_own and A_other (camera channel,
RGB), C = A_own^-1 A_other as from a colorimeter (`domesim.readings.crosstalk`), whatever the
camera's colours are. With white alone, each primary is taken to leak into its own alike.

The map multiplies the matrices: s = q over the screen's own sum(t)/sum(o).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.colour import BT709_LUMINANCE
from domesim.light.ties import ascending, root_of, upright
from domesim.measure.photographs import Corners, Glass, Photographs, on_screen
from domesim.measure.smoothing import smoothed
from domesim.readings.crosstalk import BRIGHTEST_LEAK, without_small_negatives
from domesim.readings.meter import EYES
from domesim.readings.response import SIGMAS

Floats = NDArray[np.float64]

UNDERSTATED = 1.2
"""Rms error of a map over pixels, over what smoothing says of its cells: beyond the outermost
cells' middles it goes on as a straight line. Of made-up screens, of 5 to 15 pixels a cell."""
_KEPT, _ROUNDING = 0.99, 1e-12
"""Share of the variance of a map's errors that its changes keep; and the variance, relative to the
squared mean of the map, up to which it is rounding."""
BLOCK, LEAST_PIXELS = 4, 400
"""Side of a block, pixels, and least number of blocks in a cell."""


@final
@dataclass(frozen=True, eq=False)
class CrosstalkMap:
    """What one eye sees of the other's picture, over the screen.

    Parameters
    ----------
    eye
        The eye that sees: left or right.
    matrix, matrix_error
        (own primary, other primary) C of the whole screen, in linear RGB, and standard errors.
    system, system_error
        Share of white that leaks, over the whole screen.
    share, share_error
        (row, col) what multiplies the matrix, and standard errors.
    matrix_changes
        (change, own primary, other primary) what independent errors, one standard deviation each,
        change the matrix by.
    changes
        (change, row, col) what independent errors, one standard deviation each, change the share
        by, while the whole screen's figure stays.
    of_primaries
        Whether primaries were photographed; else one figure stands for all.
    notes
        What a person should know, a line each.
    """

    eye: str
    matrix: Floats
    matrix_error: Floats
    system: float
    system_error: float
    share: Floats
    share_error: Floats
    matrix_changes: Floats
    changes: Floats
    of_primaries: bool
    notes: tuple[str, ...]

    def report(self) -> list[str]:
        """Lines for a person."""
        map_ = self.system * self.share
        least, most = (
            np.unravel_index(ascending(each)[0], map_.shape)
            for each in (map_.ravel(), -map_.ravel())
        )
        worst = float((self.share_error / self.share).max())
        lines = [
            f"crosstalk to the {self.eye} eye: system {self.system:.3%} ± {self.system_error:.3%}; "
            f"from {map_[least]:.2%} {_place_in_words(least, map_.shape)} to {map_[most]:.2%} "
            f"{_place_in_words(most, map_.shape)}, each ± {worst:.1%} of its value or less"
        ]
        if np.ptp(np.diag(self.matrix)) > 0 or np.count_nonzero(self.matrix) > 3:
            for name, row, errors in zip("RGB", self.matrix, self.matrix_error, strict=True):
                cells = zip("RGB", row, errors, strict=True)
                entries = ", ".join(f"{n} {value:.2%} ± {error:.2%}" for n, value, error in cells)
                lines.append(f"  own {name} sees of the other's {entries}")
        return [*lines, *(f"  {note}" for note in self.notes)]


def crosstalk_maps(
    photographs: Photographs,
    cells: tuple[int, int],
    aspect: float,
    *,
    allow_negative: bool = False,
) -> tuple[CrosstalkMap, CrosstalkMap]:
    """Crosstalk to the left and to the right eye.

    Parameters
    ----------
    photographs
        `domesim.measure.photographs.read_photographs`.
    cells
        Rows and cols of the maps.
    aspect
        Width of the screen over its height.
    allow_negative
        See `domesim.readings.crosstalk.measured_crosstalk`.

    Raises
    ------
    InputError
        If there is no light, the other eye's picture is as bright as half the own one or darker
        than black, or a cell of the screen has no pixels.
    """
    rows, cols = cells
    place = photographs.place
    on = on_screen(place)
    cell = (place[on][:, 1] * rows).astype(np.int64) * cols + (place[on][:, 0] * cols).astype(int)
    pixels = np.bincount(cell, minlength=rows * cols)
    if pixels.min() < 4:
        raise InputError(
            f"{photographs.source}: the screen must have at least 4 pixels in each of {cols} x "
            f"{rows} cells, got {pixels.min()}; take larger photographs, or check corners"
        )
    side = BLOCK if pixels.min() >= LEAST_PIXELS else 1
    row, col = np.nonzero(on)
    block = (row // side) * (on.shape[1] // side + 1) + col // side
    blocks = np.unique(cell * (block.max() + 1) + block, return_inverse=True)[1]
    parts = _Parts(on, cell, blocks, cells)
    left, right = (
        _map(photographs, glass, parts, aspect, allow_negative) for glass in photographs.glasses
    )
    return left, right


@final
@dataclass(frozen=True, eq=False)
class _Parts:
    """Which pixels are (row, col) on the screen, and of each its cell and its block."""

    on: NDArray[np.bool_]
    cell: NDArray[np.int64]
    block: NDArray[np.int64]
    cells: tuple[int, int]

    def ratio(self, other: Floats, own: Floats) -> tuple[Floats, Floats, float, float]:
        """(row, col) sum(other)/sum(own) and standard errors; and those of the whole screen.

        Parameters
        ----------
        other, own
            (pixel on the screen,)
        """
        count = self.cells[0] * self.cells[1]
        light = np.bincount(self.cell, own, count)
        q = np.bincount(self.cell, other, count) / light
        squares = self._squares(other - q[self.cell] * own)
        error = np.sqrt(squares) / light
        whole = float(other.sum() / own.sum())
        return (
            q.reshape(self.cells),
            error.reshape(self.cells),
            whole,
            float(np.sqrt(squares.sum()) / own.sum()),
        )

    def covariance(self, residuals: Floats) -> Floats:
        """(residual, residual) of sums over the screen of (residual, pixel) that should be 0."""
        return np.array(
            [[self._products(one, other).sum() for other in residuals] for one in residuals]
        )

    def _squares(self, residual: Floats) -> Floats:
        """(cell,) squared standard error of the residual's sum."""
        return self._products(residual, residual)

    def _products(self, one: Floats, other: Floats) -> Floats:
        """(cell,) covariance of two residuals' sums."""
        products = np.bincount(self.block, one) * np.bincount(self.block, other)
        of_block = np.zeros(len(products), np.int64)
        of_block[self.block] = self.cell
        count = self.cells[0] * self.cells[1]
        blocks = np.bincount(of_block, minlength=count)
        sums = np.bincount(of_block, products, count)
        # The cell's ratio was fitted to the same pixels.
        return np.asarray(sums * blocks / np.maximum(blocks - 1, 1))


def _map(
    photographs: Photographs, glass: Glass, parts: _Parts, aspect: float, allow_negative: bool
) -> CrosstalkMap:
    eye, other = glass.eye, EYES[1 - EYES.index(glass.eye)]
    where = f"{photographs.source}: crosstalk to the {eye} eye"
    own_light, leak = (
        # As if the camera's channels were BT.709's: weights of the map, not of the matrices
        (glass.white(projector)[parts.on] @ BT709_LUMINANCE).astype(np.float64)
        for projector in (eye, other)
    )
    cells = np.asarray(np.bincount(parts.cell, own_light), np.float64)
    if not cells.min() > 0:
        raise InputError(
            f"{where}: the own picture's white must be brighter than black all over the screen, "
            f"got {cells.min():.3g} in one part of it; check the files and the corners"
        )
    q, error, system, system_error = parts.ratio(leak, own_light)
    if system > BRIGHTEST_LEAK:
        raise InputError(
            f"{where}: the other projector must be much dimmer than the own one through this "
            f"glass, got {system:.0%} of it; were the glasses or the projectors exchanged?"
        )
    if system < -SIGMAS * system_error:
        raise InputError(
            f"{where}: the other projector's white must be brighter than black, got {system:.2%} "
            f"of the own white; did the exposure or the room's light change?"
        )
    share, covariance = smoothed(q, np.maximum(error, 1e-9), aspect)
    moved, moved_system = _moved(share, cells.reshape(share.shape), photographs.corners)
    if photographs.rounding > 0:  # adds the same to the other's light all over
        added = photographs.rounding * np.linalg.norm(BT709_LUMINANCE)
        pixels = np.bincount(parts.cell)
        moved = np.concatenate([moved, added * (pixels / cells)[None]])
        moved_system = np.append(moved_system, added * pixels.sum() / cells.sum())
    covariance = covariance + moved.T @ moved
    system_error = float(np.hypot(system_error, np.linalg.norm(moved_system)))
    if not (system > 0 and share.min() > 0):
        raise InputError(
            f"{where}: no crosstalk above the noise ({system:.3%} ± {system_error:.3%}) on some "
            f"parts of the screen; expose longer, take more photographs, or use readings"
        )
    if glass.has_primaries:
        matrix, matrix_error, matrix_changes = _matrix(glass, eye, other, parts)
        scaled = moved_system[:, None, None] / system * matrix
        matrix_error = np.hypot(matrix_error, np.linalg.norm(scaled, axis=0))
        matrix_changes = np.concatenate([matrix_changes, scaled])
        matrix, notes = without_small_negatives(where, matrix, matrix_error, allow_negative)
    else:
        matrix, matrix_error = system * np.eye(3), system_error * np.eye(3)
        matrix_changes = matrix_error[None]
        notes = ["read of white alone: each primary is taken to leak as much, into itself"]
    return CrosstalkMap(
        eye,
        matrix,
        matrix_error,
        system,
        system_error,
        share / system,
        np.sqrt(np.maximum(np.diag(covariance), 0)).reshape(share.shape) / system,
        matrix_changes,
        _changes(share, covariance, cells.reshape(share.shape)) / system,
        glass.has_primaries,
        tuple(notes),
    )


def _moved(share: Floats, light: Floats, corners: Corners) -> tuple[Floats, Floats]:
    """What wrong corners change, by one standard deviation of each independent error.

    (change, cell) of a map (row, col), and (change,) of the whole screen's figure: what there is of
    the other picture's `light` along the edges comes in or goes out.
    """
    rows, cols = share.shape
    shifts = corners.shifts(share.shape)
    across, down = shifts[..., 0], shifts[..., 1]
    slopes = np.gradient(share, 1 / rows, 1 / cols)
    off = (share - np.sum(share * light) / light.sum()) * light
    right, below = off * across * cols, off * down * rows
    edges = (right[..., -1] - right[..., 0]).sum(-1) + (below[:, -1] - below[:, 0]).sum(-1)
    cells = down * slopes[0] + across * slopes[1]
    return cells.reshape(-1, share.size), np.asarray(edges / light.sum())


def _changes(share: Floats, covariance: Floats, light: Floats) -> Floats:
    """(change, row, col) of a map's errors, without what the whole screen's figure is off by."""
    mean = np.outer(share.ravel(), light.ravel()) / np.sum(share * light)
    left = np.eye(share.size) - mean
    values, vectors = np.linalg.eigh(left @ covariance @ left.T)
    values, vectors = values[::-1], upright(vectors[:, ::-1])
    kept = np.cumsum(values) - values < _KEPT * values.sum()
    kept &= values > _ROUNDING * share.mean() ** 2
    scaled = UNDERSTATED * vectors[:, kept] * np.sqrt(values[kept])
    return np.asarray(scaled.T.reshape(-1, *share.shape))


def _matrix(glass: Glass, eye: str, other: str, parts: _Parts) -> tuple[Floats, Floats, Floats]:
    """C of the whole screen, standard errors to first order, and what each of the ghosts' does."""
    own, leak = (
        [glass.net[projector][primary][parts.on].astype(np.float64) for primary in "RGB"]
        for projector in (eye, other)
    )
    a_own, a_other = (np.stack([p.sum(axis=0) for p in net], axis=1) for net in (own, leak))
    matrix = np.linalg.solve(a_own, a_other)
    inverse = np.asarray(np.linalg.inv(a_own), np.float64)
    shape = np.sum(own, axis=0)
    variance = np.empty((3, 3))
    changes = []
    for channel in range(3):
        # What a smooth map leaves of one photograph is its noise.
        like = shape[:, channel]
        light = np.bincount(parts.cell, like)
        shares = [np.bincount(parts.cell, net[:, channel]) / light for net in leak]
        residuals = [
            net[:, channel] - q[parts.cell] * like for net, q in zip(leak, shares, strict=True)
        ]
        # The same black was subtracted from all, and a channel sees several primaries.
        covariance = parts.covariance(np.array(residuals))
        variance[channel] = np.diag(covariance)
        changes += [np.outer(inverse[:, channel], change) for change in root_of(covariance)]
    error = np.sqrt(inverse**2 @ (variance + variance @ matrix**2))
    return matrix, error, np.array(changes)


def _place_in_words(at: tuple[np.intp, ...], shape: tuple[int, ...]) -> str:
    """Where on the screen, in words."""
    names = (("top", "middle", "bottom"), ("left", "centre", "right"))
    words = [name[int(3 * i / count)] for name, i, count in zip(names, at, shape, strict=True)]
    return f"at the {' '.join(words)}"
