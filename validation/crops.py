"""Pictures of what is seen, cut out and brightened so that ghosts can be judged on a display.

Of a stereo pair the crop is the left eye's: a square, half as high as the picture, where the master
is dark and subtraction leaves most. Of a domemaster it is everything.
"""

from __future__ import annotations

from functools import cached_property
from typing import final

import numpy as np
from scipy.ndimage import uniform_filter

from compensate.pose import Posed
from domesim.light import Light
from validation import drawing
from validation.experiment import Panel
from validation.judges import luminance

DARK = 0.02
"""Light below which ghosts stand out, 1 = white."""
BRIGHTER = (10, 5, 2)
"""Factors by which a crop may be brightened: the first that is not too much is taken."""
TOO_BRIGHT = 0.25
"""Share of a crop that may be shown white."""
WIDTH = 400
"""Width of a crop on the page, about, pixels."""


@final
class Crop:
    """Where a master is looked at, and how bright that is shown.

    Parameters
    ----------
    posed
        The master in its scene; vision models do not matter.
    """

    def __init__(self, posed: Posed) -> None:
        self._posed = posed

    @cached_property
    def window(self) -> tuple[slice, slice]:
        """Rows and cols."""
        posed = self._posed
        rows, cols = posed.screen.shape
        if posed.scene.views == 1:
            return slice(rows), slice(cols)
        side = min(rows // 2, cols)
        master = luminance(posed.wanted[:1], posed.scene)[0]
        error = np.abs(luminance(posed.residual(posed.subtractive)[:1], posed.scene)[0])
        there = uniform_filter(error * (master < DARK), side, mode="constant")
        half = side // 2
        inside = there[half : rows - side + half + 1, half : cols - side + half + 1]
        row, col = np.unravel_index(int(np.argmax(inside)), inside.shape)
        return slice(int(row), int(row) + side), slice(int(col), int(col) + side)

    @cached_property
    def brighter(self) -> int:
        """Factor by which the crop is brightened."""
        crop = self._posed.wanted[0, *self.window]
        white = ((times, np.mean(np.max(crop, axis=-1) * times > 1)) for times in BRIGHTER)
        return next((times for times, share in white if share <= TOO_BRIGHT), 1)

    @property
    def master(self) -> tuple[Panel, int]:
        """Picture of what should be seen, and the factor by which it is brightened."""
        return self.panel("master", self._posed.wanted), self.brighter

    def panel(self, title: str, light: Light, *, brighter: float | None = None) -> Panel:
        """Picture of what is seen in the crop.

        Parameters
        ----------
        title
            Title of the picture.
        light
            (view, row, col, primary) of the whole picture, of which the first view is shown.
        brighter
            Factor by which to brighten it; by default that of the crop.
        """
        crop = light[:1, *self.window]
        times = max(1, round(WIDTH / crop.shape[1]))
        return drawing.panel(
            title,
            crop.repeat(times, axis=1).repeat(times, axis=2),
            self._posed.scene,
            what="Domemaster" if self._posed.scene.views == 1 else "Left eye, dark crop",
            brightest=1 / (self.brighter if brighter is None else brighter),
        )


def caption(subject: str, brighter: int, *, views: int) -> str:
    """Caption of crops of a subject, which says by what factor they are brightened."""
    what = (
        "what is seen of the whole domemaster"
        if views == 1
        else f"what the left eye sees where the master is dark (below {DARK:.0%}) and subtraction "
        f"leaves most"
    )
    return (
        f"{subject}: {what}. Shown {brighter} times brighter than it is: exaggerated, so that "
        f"ghosts can be judged on a display."
    )
