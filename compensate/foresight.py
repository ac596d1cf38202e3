"""What a measured room will leave of the pollution, and how sure that is.

What is seen of the light that is projected differs from what is wanted by

    r(z) = r + sum_k z_k c_k

with z_k independent standard normal numbers (`domesim.observation.uncertain`). So its mean square
is a quadratic form in z, whose coefficients are the means of r², r c_k and c_k c_l. Its
distribution is taken from draws of z, which cost nothing; they are the same ones for each frame.
What is visible of r is likewise a quadratic form: of weighted r and c_k. There, only a few
uncorrelated combinations of the c_k are weighted, those with the most light. Of the others, one sum
with random signs is weighted; the share of its light that is visible stands for each of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Array, Light, dot
from domesim.light.ties import upright
from domesim.observation.uncertain import Changes

Floats = NDArray[np.float64]

LEVEL = 0.95
_DRAWS = 4000
_MOST, _LEAST = 4, 0.003
"""Combinations that are weighted: how many, and with what share of the strongest one's light."""


@final
@dataclass(frozen=True)
class Interval:
    """A figure that is not known exactly: median, and the ends of its 95 % interval."""

    low: float
    likely: float
    high: float

    @property
    def ends(self) -> tuple[float, float, float]:
        """The interval's low end, its median and its high end."""
        return self.low, self.likely, self.high

    def times(self, unit: float) -> Interval:
        """The same in another unit."""
        return Interval(unit * self.low, unit * self.likely, unit * self.high)


@final
@dataclass(frozen=True)
class Foreseen:
    """Size of the residual that will be left.

    Parameters
    ----------
    light
        Root-mean-square of the residual, over screen, views and primaries; 1 = projector white.
    weighted
        Norm of the weighted residual.
    """

    light: Interval
    weighted: Interval


def foreseen(residual: Light, changes: Changes, weigh: Callable[[Light], Array]) -> Foreseen:
    """Foresees how large a residual may be in fact.

    Parameters
    ----------
    residual
        (seen view, row, col, primary) by all that is known.
    changes
        Changes of what is seen.
    weigh
        The vision model, linear.
    """
    square, crossed, own = changes.products(residual)
    z = np.random.default_rng(0).standard_normal((_DRAWS, len(own)))
    light = _roots(square, crossed, own, z)
    values, vectors = np.linalg.eigh(own)
    vectors = upright(vectors)  # the random signs below are theirs
    strong = np.flatnonzero(values > _LEAST * values.max(initial=0.0))[-_MOST:]
    seen = [weigh(residual), *(weigh(changes.seen(vectors[:, k])) for k in strong)]
    products = np.array([[dot(one, other) for other in seen] for one in seen])
    turned = z @ vectors
    weak = np.setdiff1d(np.flatnonzero(values > 0), strong)
    rest = turned[:, weak] ** 2 @ values[weak]
    share = 0.0
    if len(weak):
        signs = np.random.default_rng(1).choice([-1.0, 1.0], len(weak))
        one = weigh(changes.seen(vectors[:, weak] @ signs))
        share = dot(one, one) / values[weak].sum()
    weighted = _roots(
        products[0, 0] + share * rest, products[0, 1:], products[1:, 1:], turned[:, strong]
    )
    return Foreseen(light, weighted)


def _roots(square: float | Floats, crossed: Floats, own: Floats, z: Floats) -> Interval:
    """Quantiles of sqrt(square + 2 z'crossed + z'own z) over the draws z (draw, change)."""
    drawn = square + 2 * z @ crossed + np.sum((z @ own) * z, axis=1)
    ends = [(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2]
    low, likely, high = np.sqrt(np.maximum(np.quantile(drawn, ends), 0))
    return Interval(float(low), float(likely), float(high))
