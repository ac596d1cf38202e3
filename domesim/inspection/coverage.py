"""Which places of a dome's screen its projectors reach, and where the holes are."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.dome import Dome, strips
from domesim.room.lenses import DARK, field_weight
from domesim.room.theatre import Theatre
from domesim.scene import DomeScene

_SIZE = 256


@final
@dataclass(frozen=True)
class Coverage:
    """Number of projectors that reach each place.

    Parameters
    ----------
    dome
        The screen.
    count
        (row, col) projectors that reach a pixel of the domemaster.
    edges
        (row, col) sum of their soft edges, before they are evened out: 1 where one projector
        alone lights a place, between its edges.
    """

    dome: Dome
    count: NDArray[np.int64]
    edges: NDArray[np.float64]

    @cached_property
    def holes(self) -> NDArray[np.bool_]:
        """(row, col): pixels of the screen that no projector reaches."""
        return np.asarray(self.screen & (self.count == 0))

    @property
    def dark(self) -> float:
        """Share of the screen's pixels that no projector reaches."""
        return float(self.holes.sum() / self.screen.sum())

    @property
    def blended(self) -> float:
        """Share of the screen's pixels that two or more projectors reach."""
        return float((self.screen & (self.count > 1)).sum() / self.screen.sum())

    @property
    def weakest(self) -> float:
        """Least sum of soft edges of a place that is lit."""
        return float(self.edges[self.screen & (self.count > 0)].min())

    @property
    def most(self) -> float:
        """Largest sum of soft edges."""
        return float(self.edges[self.screen].max())

    @property
    def whole(self) -> bool:
        """Whether projectors reach all of the screen, but for pixels at the rim."""
        return self.dark <= DARK

    def holes_in_words(self) -> list[str]:
        """Describes the holes that have a tenth of the darkness or more, the largest first."""
        labels, _ = scipy.ndimage.label(self.holes)
        sizes = np.bincount(labels.ravel())[1:]
        order = np.argsort(-sizes, kind="stable")
        large = [number for number in order if sizes[number] >= 0.1 * self.holes.sum()]
        return [
            f"{sizes[number] / self.screen.sum():.1%} {self._place(labels == number + 1)}"
            for number in large
        ]

    @cached_property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col): pixels of the screen."""
        return self.dome.inside(*self.count.shape)

    def _place(self, hole: NDArray[np.bool_]) -> str:
        x, y, z = self.dome.directions(*self.count.shape)[hole].T
        theta = np.degrees(np.arccos(np.clip(z, -1, 1)))
        across = np.stack([x, y]) / np.maximum(np.hypot(x, y), 1e-9)
        ahead = across.mean(1)
        where = "all round"
        if np.hypot(*ahead) > 0.5:
            turn = round(float(np.degrees(np.arctan2(*ahead))), 6)
            side = "left" if -180 < turn < 0 else "right"  # right of those in the middle
            where = f"{abs(turn):.0f}° to the {side} of the front"
        return f"{where}, {theta.min():.0f}° to {theta.max():.0f}° from the dome's zenith"


def coverage(theatre: Theatre, size: int = _SIZE) -> Coverage:
    """How many projectors reach each pixel of a domemaster of `size` x `size`."""
    count, edges = np.zeros((size, size), np.int64), np.zeros((size, size))
    if not theatre.lenses:
        return Coverage(theatre.dome, count + 1, edges + 1)
    for strip in strips(size, size):
        points = theatre.dome.points(size, size, strip)
        for lens in theatre.lenses:
            weight = field_weight(lens, points)
            count[strip] += weight > 0
            edges[strip] += weight
    return Coverage(theatre.dome, count, edges)


def require_covered(scene: DomeScene, name: str, drawn: Path | None = None) -> None:
    """Refuses a theatre whose projectors leave some of its screen dark.

    Parameters
    ----------
    scene
        The theatre.
    name
        Its name, or its file's path.
    drawn
        Where a picture of the holes is already.

    Raises
    ------
    InputError
        If more than pixels at the rim stays dark; it says where.
    """
    if not scene.theatre.lenses:
        return
    lit = coverage(scene.theatre)
    if lit.whole:
        return
    see = f"domesim scene check {shlex.quote(name)} --out holes.png"
    raise InputError(
        f"{name}: projectors leave {lit.dark:.1%} of the screen dark: "
        f"{'; '.join(lit.holes_in_words())}. Widen their fields, aim them elsewhere or add "
        f"projectors. "
        f"{f'See {see}' if drawn is None else f'See {drawn}'}"
    )
