"""The one abstraction that all display systems share: from projected to observed light.

An observation is ``psi(x) = D x + phi(x) + ambient`` (eq. 2 of the paper with a direct gain and
ambient light): D is the direct gain (identity for a corrected lens), phi the light pollution, and
ambient what is there without any picture.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from domesim.light import Light, require_light


class Observation(ABC):
    """What the audience sees of projected light."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary) of the light that it observes."""

    @property
    def seen_shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary) of observed light: other views than those of `shape` only if
        several seats look at once.
        """
        return self.shape

    @abstractmethod
    def _observe(self, light: Light) -> Light: ...

    @abstractmethod
    def _direct(self, light: Light) -> Light: ...

    def observe(self, light: Light) -> Light:
        """Returns psi(x), of `seen_shape`: what is seen of projected `light`, of `shape`.

        Raises
        ------
        ValueError
            If `light` has not this observation's shape.
        """
        return self._observe(self._guarded(light, "observes"))

    def direct(self, light: Light) -> Light:
        """Returns D x: what would be seen without pollution and ambient light."""
        return self._direct(self._guarded(light, "observes"))

    def _guarded(self, light: Light, does: str) -> Light:
        require_light(light, self.shape, who=f"{type(self).__name__} {does}")
        return light


class AdjointObservation(Observation):
    """An observation that is affine in the light, with the adjoint of its linear part A = D + phi.

    ``<A x, y> = <x, adjoint(y)>`` in the plain (unweighted) dot product.
    """

    @abstractmethod
    def _linear(self, light: Light) -> Light: ...

    @abstractmethod
    def _adjoint(self, light: Light) -> Light: ...

    @abstractmethod
    def _direct_adjoint(self, light: Light) -> Light: ...

    def linear(self, light: Light) -> Light:
        """A x = psi(x) - psi(0)."""
        return self._linear(self._guarded(light, "observes"))

    def adjoint(self, light: Light) -> Light:
        """A' y: the adjoint of `linear`."""
        return self._adjoint(self._guarded_seen(light))

    def direct_adjoint(self, light: Light) -> Light:
        """D' y: the adjoint of `direct`."""
        return self._direct_adjoint(self._guarded_seen(light))

    def local(self, light: Light) -> Light:
        """Returns what pixels show in their own place: D x, with the other view where views mix."""
        return self.direct(light)

    def local_adjoint(self, light: Light) -> Light:
        """The adjoint of `local`."""
        return self.direct_adjoint(light)

    def _guarded_seen(self, light: Light) -> Light:
        require_light(light, self.seen_shape, who=f"{type(self).__name__} has an adjoint for")
        return light
