"""Anderson acceleration of a fixed-point iteration s <- s + r(s).

With the last residuals r_i and the points t_i = s_i + r_i that they led to, the next point is the
combination of the t_i whose residuals, combined alike, are least (Walker & Ni 2011, *SIAM Journal
on Numerical Analysis* 49, 1715-1735, eq. 2.2):

    s <- sum alpha_i t_i,     alpha = argmin ||sum alpha_i r_i||,  sum alpha_i = 1
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from domesim.light import Array, dot

_GROWN = 2.0  # times the last residual: the acceleration begins anew
_DAMPING = 1e-8  # of the inner products' trace


@final
class Anderson:
    """The history of an iteration.

    Parameters
    ----------
    memory
        How many old points it combines with the newest; 0 for none.
    """

    def __init__(self, memory: int) -> None:
        self.memory = memory
        self._points: list[Array] = []
        self._residuals: list[Array] = []
        self._gram = np.zeros((0, 0))

    def next(self, point: Array, residual: Array) -> Array:
        """The next s, from t = s + r and r scaled so that its norm tells."""
        if not self.memory:
            return point
        products = np.array([dot(residual, other) for other in [residual, *self._residuals]])
        if len(products) > 1 and products[0] > _GROWN**2 * self._gram[0, 0]:
            self._points, self._residuals, products = [], [], products[:1]
        kept = slice(None, self.memory)
        size = len(products)
        gram = np.zeros((size, size))
        gram[1:, 1:] = self._gram[: size - 1, : size - 1]
        gram[0], gram[:, 0] = products, products
        points = [point, *self._points]
        result: Any = sum(float(a) * t for a, t in zip(_least(gram), points, strict=True))
        self._points, self._residuals = points[kept], [residual, *self._residuals][kept]
        self._gram = gram[kept, kept]
        return result


def _least(gram: Any) -> Any:
    """Weights, which sum to 1, of the shortest combination of vectors with that Gram matrix."""
    differences = gram[0, 0] - gram[0, 1:][None, :] - gram[1:, 0][:, None] + gram[1:, 1:]
    differences = differences + _DAMPING * np.trace(differences) * np.eye(len(differences))
    if not np.trace(differences) > 0:
        return np.eye(len(gram))[0]
    old = np.linalg.solve(differences, gram[0, 0] - gram[1:, 0])
    return np.concatenate([[1 - old.sum()], old])
