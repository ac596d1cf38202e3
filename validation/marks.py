"""How much of the judge's marks a predicted mask holds, and how large it is for that.

ColorVideoVDP's heatmap marks a pixel where it has `MARKED` JOD or more. A threshold of the
prediction is tuned on some inputs: the largest of `LEVELS` with which the mask holds `KEPT` of the
marked pixels of each. On others it is tried.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.pose import Posed
from compensate.prediction import Prediction, predict
from compensate.visible import SEEN
from domesim.light import Light
from validation.judges import colorvideovdp_map

MARKED = 1.0
"""JOD that the judge's heatmap has at least where it marks a difference."""
LEVELS = tuple(round(0.3 + 0.02 * k, 2) for k in range(61))
"""Thresholds of the prediction, JOD."""
KEPT = 0.96
"""Share of the marked pixels that a mask must hold: a little more than is wanted elsewhere."""


@final
@dataclass(frozen=True)
class Agreement:
    """Pixels of one input, summed over its places.

    Attributes
    ----------
    seen
        Pixels on the screen.
    marked
        Pixels that the judge marks.
    held, taken
        Pixels in the mask and marked, and in the mask at all, by `LEVELS`.
    veils
        The same two of the mask of thresholds and masking (`Combination.WITH_VEILS`).
    """

    seen: int
    marked: int
    held: tuple[int, ...]
    taken: tuple[int, ...]
    veils: tuple[int, int]

    def __add__(self, other: Agreement) -> Agreement:
        """Agreement over the pixels of both."""

        def summed(one: Iterable[int], two: Iterable[int]) -> tuple[int, ...]:
            return tuple(a + b for a, b in zip(one, two, strict=True))

        held, taken = summed(self.veils, other.veils)
        return Agreement(
            self.seen + other.seen,
            self.marked + other.marked,
            summed(self.held, other.held),
            summed(self.taken, other.taken),
            (held, taken),
        )

    def at(self, level: float) -> tuple[float, float]:
        """Share of the marked pixels that the mask holds, and its area over theirs."""
        place = LEVELS.index(level)
        return self.held[place] / self.marked, self.taken[place] / self.marked

    @property
    def before(self) -> tuple[float, float]:
        """The two figures of `at` for the mask of thresholds and masking."""
        return self.veils[0] / self.marked, self.veils[1] / self.marked


def agreement(posed: Posed, light: Light) -> Agreement:
    """Compares the prediction's masks with the judge's marks for light that is projected.

    Raises
    ------
    Missing
        If cvvdp is not installed.
    """
    room = posed.seen(np.zeros_like(posed.desired))
    wanted = posed.wanted[: posed.scene.views] + room
    _, lost = colorvideovdp_map(wanted, posed.seen(light), posed.scene)
    marked = (lost >= MARKED)[:, posed.screen]
    chance = predict(posed, light, SEEN).prediction[:, posed.screen]
    jod = -np.log2(1 - np.minimum(chance, 0.999))
    veils = predict(posed, light, Prediction()).mask[:, posed.screen]
    masks = [jod > level for level in LEVELS]
    return Agreement(
        seen=marked.size,
        marked=int(marked.sum()),
        held=tuple(int((mask & marked).sum()) for mask in masks),
        taken=tuple(int(mask.sum()) for mask in masks),
        veils=(int((veils & marked).sum()), int(veils.sum())),
    )


def tuned(inputs: Iterable[Agreement]) -> float:
    """The largest level with which the mask holds `KEPT` of each; the least if none does."""
    marked = [each for each in inputs if each.marked]
    fitting = [level for level in LEVELS if all(each.at(level)[0] >= KEPT for each in marked)]
    return max(fitting, default=LEVELS[0])
