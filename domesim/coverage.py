"""Which places of a dome's screen its projectors reach, and where the holes are."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from domesim.dome import Dome, strips
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, write_frame
from domesim.lenses import DARK, field_weight
from domesim.scene import DomeScene
from domesim.theatre import Theatre

_SIZE = 256
_HOLE = (0.84, 0.37, 0.0)  # vermilion: also the colour-blind tell it from grey
_GREYS = (0.0, 0.3, 0.5, 0.65, 0.8)  # of places that 1, 2, ... projectors reach


@final
@dataclass(frozen=True)
class Coverage:
    """How many projectors reach each place.

    Parameters
    ----------
    dome
        The screen.
    count
        (row, col) projectors that reach a pixel of the domemaster.
    """

    dome: Dome
    count: NDArray[np.int64]

    @cached_property
    def holes(self) -> NDArray[np.bool_]:
        """(row, col): pixels of the screen that no projector reaches."""
        return np.asarray(self._screen & (self.count == 0))

    @property
    def dark(self) -> float:
        """Their share of the screen's pixels."""
        return float(self.holes.sum() / self._screen.sum())

    @property
    def blended(self) -> float:
        """Share of the screen's pixels that two or more projectors reach."""
        return float((self._screen & (self.count > 1)).sum() / self._screen.sum())

    @property
    def whole(self) -> bool:
        """Whether no more is dark than pixels at the rim."""
        return self.dark <= DARK

    def told(self) -> list[str]:
        """Each hole from the largest on, of those with a tenth of the darkness, in words."""
        labels, _ = scipy.ndimage.label(self.holes)
        sizes = np.bincount(labels.ravel())[1:]
        order = np.argsort(-sizes, kind="stable")
        large = [number for number in order if sizes[number] >= 0.1 * self.holes.sum()]
        return [
            f"{sizes[number] / self._screen.sum():.1%} {self._place(labels == number + 1)}"
            for number in large
        ]

    def draw(self, path: Path) -> None:
        """Write a picture: holes are orange; the more projectors, the lighter the grey."""
        shades = np.array(_GREYS)[np.minimum(self.count, len(_GREYS) - 1)]
        shades[~self._screen] = 0
        pixels = np.repeat(shades[:, :, None], 3, axis=2).astype(np.float32)
        pixels[self.holes] = _HOLE
        tag = ColourTag("srgb", "BT.709", "domesim")
        write_frame(Frame(pixels, path, tag, 8, floating=False), path)

    @cached_property
    def _screen(self) -> NDArray[np.bool_]:
        return self.dome.inside(*self.count.shape)

    def _place(self, hole: NDArray[np.bool_]) -> str:
        x, y, z = self.dome.directions(*self.count.shape)[hole].T
        theta = np.degrees(np.arccos(np.clip(z, -1, 1)))
        across = np.stack([x, y]) / np.maximum(np.hypot(x, y), 1e-9)
        ahead = across.mean(1)
        where = "all round"
        if np.hypot(*ahead) > 0.5:
            turn = np.degrees(np.arctan2(*ahead))
            where = f"{abs(turn):.0f}° to the {'right' if turn > 0 else 'left'} of the front"
        return f"{where}, {theta.min():.0f}° to {theta.max():.0f}° from the dome's zenith"


def coverage(theatre: Theatre, size: int = _SIZE) -> Coverage:
    """How many projectors reach each pixel of a domemaster of `size` x `size`."""
    count = np.zeros((size, size), np.int64)
    for strip in strips(size, size):
        points = theatre.dome.points(size, size, strip)
        for lens in theatre.lenses:
            count[strip] += field_weight(lens, points) > 0
    return Coverage(theatre.dome, count if theatre.lenses else count + 1)


def require_covered(scene: DomeScene, name: str, drawn: Path | None = None) -> None:
    """See that a theatre's projectors light all of its screen, before hours of work.

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
    found = coverage(scene.theatre)
    if found.whole:
        return
    see = f"domesim scene check {shlex.quote(name)} --out holes.png"
    raise InputError(
        f"{name}: projectors leave {found.dark:.1%} of the screen dark: {'; '.join(found.told())}. "
        f"Widen their fields, aim them elsewhere or add projectors. "
        f"{f'See {see}' if drawn is None else f'See {drawn}'}"
    )
