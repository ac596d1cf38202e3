"""Two observations in a row: the second observes what the first shows."""

from __future__ import annotations

from typing import final

from domesim.light import Light
from domesim.observation.base import AdjointObservation


@final
class Followed(AdjointObservation):
    """psi = then after first: ``then.observe(first.observe(x))``.

    Direct light D x is `first`'s: nothing of `then` is wanted but light as it is. A solver that
    knows both parts takes them apart (`compensate.solver.admm.dome`); any other takes the whole by
    its adjoint.

    Parameters
    ----------
    first, then
        The parts, in light's order.

    Raises
    ------
    ValueError
        If what `first` shows has not the shape that `then` takes.
    """

    def __init__(self, first: AdjointObservation, then: AdjointObservation) -> None:
        if first.seen_shape != then.shape:
            raise ValueError(
                f"Followed takes a first part that shows {then.shape}, got {first.seen_shape}"
            )
        self.first, self.then = first, then

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The first part's."""
        return self.first.shape

    @property
    def seen_shape(self) -> tuple[int, int, int, int]:
        """The last part's."""
        return self.then.seen_shape

    def local(self, light: Light) -> Light:
        """See `AdjointObservation`."""
        return self.then.local(self.first.local(light))

    def local_adjoint(self, light: Light) -> Light:
        """See `AdjointObservation`."""
        return self.first.local_adjoint(self.then.local_adjoint(light))

    def _observe(self, light: Light) -> Light:
        return self.then.observe(self.first.observe(light))

    def _direct(self, light: Light) -> Light:
        return self.then.direct(self.first.direct(light))

    def _linear(self, light: Light) -> Light:
        return self.then.linear(self.first.linear(light))

    def _adjoint(self, light: Light) -> Light:
        return self.first.adjoint(self.then.adjoint(light))

    def _direct_adjoint(self, light: Light) -> Light:
        return self.first.direct_adjoint(self.then.direct_adjoint(light))
