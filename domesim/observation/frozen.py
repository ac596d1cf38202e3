"""Pollution that stays what it was at one given light (the paper's eq. 9)."""

from __future__ import annotations

from typing import final

from domesim.light import Light
from domesim.observation.base import AdjointObservation


@final
class Frozen(AdjointObservation):
    """``psi(x) = D x + (psi(at) - D at)``: what each iteration of the paper's method minimises.

    Parameters
    ----------
    observation
        The true observation.
    at
        (view, row, col, primary) light whose pollution is kept.
    """

    def __init__(self, observation: AdjointObservation, at: Light) -> None:
        self._inner = observation
        self._pollution = observation.observe(at) - observation.direct(at)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return self._inner.shape

    def _observe(self, light: Light) -> Light:
        return self._inner.direct(light) + self._pollution  # eq. 9

    def _direct(self, light: Light) -> Light:
        return self._inner.direct(light)

    def _linear(self, light: Light) -> Light:
        return self._inner.direct(light)

    def _adjoint(self, light: Light) -> Light:
        return self._inner.direct_adjoint(light)

    def _direct_adjoint(self, light: Light) -> Light:
        return self._inner.direct_adjoint(light)
