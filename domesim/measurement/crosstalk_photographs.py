"""Crosstalk from photographs through the eyewear: how much, and how it varies over the screen.

Through one glass, with black subtracted, a pixel sees o of the eye's own picture and t of the other
one's. Lens, screen and vignetting are in both alike: t/o is the share that leaks. Over a cell of
the screen it is sum(t)/sum(o), and its error follows from what t - q o leaves, summed over blocks
of pixels, for neighbours share noise where colours were interpolated. The cells are then smoothed
(`domesim.measurement.smoothing`).

A camera is linear in light: with photographs of the primaries, A_own and A_other (camera channel,
RGB), C = A_own^-1 A_other as from a colorimeter (`domesim.measurement.crosstalk`), whatever the
camera's colours are. With white alone, each primary is taken to leak into its own alike.

The map multiplies the matrices: s = q over the screen's own sum(t)/sum(o).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.measurement.crosstalk import BRIGHTEST_LEAK, without_small_negatives
from domesim.measurement.photographs import Glass, Photographs, on_screen
from domesim.measurement.readings import EYES
from domesim.measurement.response import SIGMAS
from domesim.measurement.smoothing import smoothed

Floats = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of camera channels, as if they were BT.709: the weights of the map, not of the matrices."""
BLOCK, LEAST_PIXELS = 4, 400
"""Side of a block, pixels, and how many a cell must have for blocks to be told apart."""


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
    notes: tuple[str, ...]

    def report(self) -> list[str]:
        """Lines for a person."""
        map_ = self.system * self.share
        least, most = (np.unravel_index(at, map_.shape) for at in (map_.argmin(), map_.argmax()))
        worst = float((self.share_error / self.share).max())
        lines = [
            f"crosstalk to the {self.eye} eye: system {self.system:.3%} ± {self.system_error:.3%}; "
            f"from {map_[least]:.2%} {_told(least, map_.shape)} to {map_[most]:.2%} "
            f"{_told(most, map_.shape)}, each ± {worst:.1%} of its value or less"
        ]
        if np.ptp(np.diag(self.matrix)) > 0 or np.count_nonzero(self.matrix) > 3:
            for name, row, errors in zip("RGB", self.matrix, self.matrix_error, strict=True):
                cells = zip("RGB", row, errors, strict=True)
                told = ", ".join(f"{n} {value:.2%} ± {error:.2%}" for n, value, error in cells)
                lines.append(f"  own {name} sees of the other's {told}")
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
        `domesim.measurement.photographs.read_photographs`.
    cells
        Rows and cols of the maps.
    aspect
        Width of the screen over its height.
    allow_negative
        See `domesim.measurement.crosstalk.measured_crosstalk`.

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

    def spread(self, residual: Floats) -> float:
        """Standard error of the sum over the screen of pixels that should be 0."""
        return float(np.sqrt(self._squares(residual).sum()))

    def _squares(self, residual: Floats) -> Floats:
        """(cell,) squared standard error of the residual's sum."""
        sums = np.bincount(self.block, residual)
        of_block = np.zeros(len(sums), np.int64)
        of_block[self.block] = self.cell
        count = self.cells[0] * self.cells[1]
        blocks = np.bincount(of_block, minlength=count)
        squares = np.bincount(of_block, sums**2, count)
        # The cell's ratio was fitted to the same pixels.
        return np.asarray(squares * blocks / np.maximum(blocks - 1, 1))


def _map(
    photographs: Photographs, glass: Glass, parts: _Parts, aspect: float, allow_negative: bool
) -> CrosstalkMap:
    eye, other = glass.eye, EYES[1 - EYES.index(glass.eye)]
    where = f"{photographs.source}: crosstalk to the {eye} eye"
    own_light, leak = (
        (glass.white(projector)[parts.on] @ LUMINANCE).astype(np.float64)
        for projector in (eye, other)
    )
    cells = np.bincount(parts.cell, own_light)
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
    share, share_error = smoothed(q, np.maximum(error, 1e-9), aspect)
    if not (system > 0 and share.min() > 0):
        raise InputError(
            f"{where}: no crosstalk above the noise ({system:.3%} ± {system_error:.3%}) on some "
            f"parts of the screen; expose longer, take more photographs, or use readings"
        )
    if glass.has_primaries:
        matrix, matrix_error = _matrix(glass, eye, other, parts)
        matrix, notes = without_small_negatives(where, matrix, matrix_error, allow_negative)
    else:
        matrix, matrix_error = system * np.eye(3), system_error * np.eye(3)
        notes = ["of white alone: each primary is taken to leak as much, into its own only"]
    return CrosstalkMap(
        eye,
        matrix,
        matrix_error,
        system,
        system_error,
        share / system,
        share_error / system,
        tuple(notes),
    )


def _matrix(glass: Glass, eye: str, other: str, parts: _Parts) -> tuple[Floats, Floats]:
    """C of the whole screen, and standard errors to first order."""
    own, leak = (
        [glass.net[projector][primary][parts.on].astype(np.float64) for primary in "RGB"]
        for projector in (eye, other)
    )
    a_own, a_other = (np.stack([p.sum(axis=0) for p in net], axis=1) for net in (own, leak))
    matrix = np.linalg.solve(a_own, a_other)
    shape = np.sum(own, axis=0)
    variance = np.empty((3, 3))
    for primary, net in enumerate(leak):
        for channel in range(3):
            # What a smooth map leaves of one photograph is its noise.
            like = shape[:, channel]
            q = np.bincount(parts.cell, net[:, channel]) / np.bincount(parts.cell, like)
            variance[channel, primary] = parts.spread(net[:, channel] - q[parts.cell] * like) ** 2
    inverse = np.asarray(np.linalg.inv(a_own), np.float64) ** 2
    return matrix, np.sqrt(inverse @ (variance + variance @ matrix**2))


def _told(at: tuple[np.intp, ...], shape: tuple[int, ...]) -> str:
    """Where on the screen, in words."""
    names = (("top", "middle", "bottom"), ("left", "centre", "right"))
    words = [name[int(3 * i / count)] for name, i, count in zip(names, at, shape, strict=True)]
    return f"at the {' '.join(words)}"
