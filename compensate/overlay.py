"""Overlays: what a server adds to compensated frames, such as subtitles, counted in advance.

The server composites its overlay o, of opacity a, over the frames x that it is given; that is what
is projected, and it leaks into other views as any light does:

    x' = (1 - a) x + a o,        0 <= x <= 1,    so that    a o <= x' <= (1 - a) + a o

The wanted picture is the master composited likewise. So x' is found as ever, within these bounds:
where a title is, its light is given, and the other view subtracts the title's ghost. The frame is
then x = (x' - a o) / (1 - a). Under an opaque title nothing of x is seen; there it is the master's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from domesim.light.blocks import light_means


@final
@dataclass(frozen=True, eq=False)
class Overlay:
    """An overlay of each view.

    Parameters
    ----------
    light
        (view, row, col, primary) its light over black, a o; 1 = projector white.
    clear
        (view, row, col, 1) what it lets through, 1 - a, in 0..1.
    """

    light: Light
    clear: NDArray[Any]

    def over(self, light: Light) -> Light:
        """Composites it over light, (view, row, col, primary): what the server shows of that."""
        return np.asarray(self.light + self.clear * light)

    def under(self, shown: Light, master: Light) -> Light:
        """Takes it away from what the server is to show.

        Parameters
        ----------
        shown
            (view, row, col, primary) light within `bounds`.
        master
            Light of the master, which stays where nothing of the frame is seen.

        Returns
        -------
        light
            Of the frame, in 0..1.
        """
        seen = self.clear > 0
        below = (shown - self.light) / np.where(seen, self.clear, 1)
        return np.where(seen, np.clip(below, 0, 1), master)

    def in_small(self, step: int) -> Overlay:
        """Averages it over blocks of `step` x `step` pixels."""
        return Overlay(light_means(self.light, step), light_means(self.clear, step))

    @property
    def bounds(self) -> tuple[Light, Light]:
        """The least and the most light that the server can show."""
        return self.light, np.asarray(self.light + self.clear)
