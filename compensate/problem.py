"""The optimisation problem: what to project within the projector's bounds (eqs. 3, 5, 7).

    min_x  1/2 ||lambda(K (psi(x) - aim))||² + 1/2 mu ||m^1/2 K L (x - anchor)||²
           with  lower <= x <= upper

With an affine psi it is a convex quadratic with bound constraints, solved in *linear light*. The
small mu keeps frequencies that the eye cannot see from filling with noise. K is 1, as in the paper,
or turns light into local contrast; it multiplies each pixel of what is
seen, and L is how a pixel's light is seen in its own place (`AdjointObservation.local`). Without K
the regulariser is plain, 1/2 mu ||x - anchor||². The stiffness m is 1, or more where changes of
light would be seen by themselves. The aim is what is desired, as in the paper, or
another picture that can be reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import final

from compensate.weighting import Weighting
from domesim.light import Array, Light, dot, namespace, require_light, total
from domesim.observation.base import AdjointObservation
from domesim.observation.frozen import Frozen
from domesim.strips import in_parts

Bound = Array | float


@final
class Problem:
    """A bound-constrained least squares over projected light.

    Parameters
    ----------
    observation
        psi: what is seen of projected light.
    weighting
        lambda: how much a residual matters.
    desired
        (view, row, col, primary) light that should be *seen*: D times the master, without
        pollution and ambient light.
    bounds
        Lower and upper bound of the projected light: numbers, or arrays that broadcast with it.
        Where they are equal, a pixel is pinned.
    anchor, regularisation
        x_0 and mu of the regulariser. Without an anchor, mu must be 0. It may be (primary,)
        numbers, one for what is seen of each; without a contrast they are alike.
    negligible
        A difference in cost that nobody can see: solvers need not go on for less.
    contrast
        (seen view, row, col, 1) K, above 0; None for 1.
    aim
        What residuals are taken from, of the desired light's shape; None for that itself.
    stiffness
        (1, row, col, 1) m, at least 1, what mu is multiplied by there. It is one for all seen
        views, which a solver's steps in single pixels ask for, and takes a contrast. None for 1.

    Raises
    ------
    ValueError
        If shapes or counts disagree, a lower bound is above its upper, a contrast is not above 0,
        or a stiffness below 1.
    """

    def __init__(
        self,
        observation: AdjointObservation,
        weighting: Weighting,
        desired: Light,
        bounds: tuple[Bound, Bound] = (0.0, 1.0),
        *,
        anchor: Light | None = None,
        regularisation: float | Sequence[float] = 0.0,
        negligible: float = 0.0,
        contrast: Array | None = None,
        aim: Light | None = None,
        stiffness: Array | None = None,
    ) -> None:
        require_light(desired, observation.seen_shape, who="Problem's desired light")
        if aim is not None:
            require_light(aim, desired.shape, who="Problem's aim")
        if weighting.shape != observation.seen_shape:
            raise ValueError(
                f"weighting takes {weighting.shape}, but the observation gives "
                f"{observation.seen_shape}"
            )
        if contrast is not None and contrast.shape != (*observation.seen_shape[:3], 1):
            raise ValueError(
                f"contrast takes {(*observation.seen_shape[:3], 1)}, got {contrast.shape}"
            )
        damping = _of_each(regularisation, desired.shape[3])
        if contrast is None and len(set(damping)) > 1:
            raise ValueError("without a contrast, all primaries have one regularisation")
        like_one = (1, *observation.seen_shape[1:3], 1)
        if stiffness is not None and (contrast is None or stiffness.shape != like_one):
            raise ValueError(f"stiffness takes a contrast and {like_one}, got {stiffness.shape}")
        if any(damping) and anchor is None:
            raise ValueError("a regularised problem needs an anchor, got none")
        if anchor is not None:
            require_light(anchor, observation.shape, who="Problem's anchor")
        xp = namespace(desired)
        self.observation = observation
        self.weighting = weighting
        self.desired = desired
        self.aim = desired if aim is None else aim
        self.lower, self.upper = (
            xp.asarray(bound, dtype=desired.dtype, device=desired.device) for bound in bounds
        )
        self.anchor = anchor
        self.damping = damping
        self.negligible = negligible
        self.contrast = contrast
        self.stiffness = stiffness
        if contrast is not None and not bool(xp.all(contrast > 0)):
            raise ValueError("contrast must be above 0 everywhere")
        if stiffness is not None and not bool(xp.all(stiffness >= 1)):
            raise ValueError("stiffness must be at least 1 everywhere")
        if bool(xp.any(self.lower > self.upper)):
            raise ValueError("a lower bound is above its upper bound")

    @property
    def regularisation(self) -> float:
        """Mu; of primaries that differ, the least."""
        return min(self.damping)

    @property
    def ffts(self) -> int:
        """FFTs of planes done so far on behalf of this problem; a share counts as one."""
        return math.ceil(self.weighting.fourier.count)

    def residual(self, light: Light) -> Light:
        """K (psi(x) - aim)."""
        seen = self.observation.observe(light)
        contrast, result = self.contrast, namespace(seen).empty_like(seen)

        def work(view: int, rows: slice) -> None:
            part = seen[view, rows, ...] - self.aim[view, rows, ...]
            if contrast is not None:
                part *= contrast[view, rows, ...]
            result[view, rows, ...] = part

        in_parts(work, seen.shape, seen)
        return result

    def cost(self, light: Light) -> float:
        """The objective at `light`."""
        return 0.5 * self.weighting.energy(self.residual(light)) + self.penalty(light)

    def gradient(self, light: Light) -> Light:
        """Its gradient, (view, row, col, primary)."""
        return self.quadratic(light)[1]

    def quadratic(self, light: Light) -> tuple[float, Light]:
        """The objective and its gradient, sharing their transforms."""
        energy, weighted = self.weighting.quadratic(self.residual(light))
        weighted = self.contrasted(weighted)
        penalty, gradient = self.penalty_and_gradient(light, weighted)
        return 0.5 * energy + penalty, gradient

    def penalty_and_gradient(self, light: Light, weighted: Light) -> tuple[float, Light]:
        """The regulariser's part of the cost, and the whole gradient; needs no FFT.

        Parameters
        ----------
        light
            Where, (view, row, col, primary).
        weighted
            K lambda'lambda of the residual there, (seen view, row, col, primary).
        """
        if self.anchor is None:
            return 0.0, self.observation.adjoint(weighted)
        change = light - self.anchor
        gradient = self._damped(change)
        change *= gradient  # in place: of a large picture, each copy is a gigabyte
        penalty = 0.5 * float(total(change))
        del change
        gradient += self.observation.adjoint(weighted)
        return penalty, gradient

    def curvature(self, direction: Light) -> tuple[float, Light]:
        """<d, H d> and H d of the (constant) Hessian H."""
        seen = self.contrasted(self.observation.linear(direction))
        energy, weighted = self.weighting.quadratic(seen)
        product = self.observation.adjoint(self.contrasted(weighted))
        damped = self._damped(direction)
        return energy + dot(direction, damped), product + damped

    def project(self, light: Light) -> Light:
        """The nearest light within the bounds."""
        xp = namespace(light)
        return xp.minimum(xp.maximum(light, self.lower), self.upper)

    def optimality(self, light: Light) -> float:
        """Largest KKT residual |x - P(x - gradient)|; 0 exactly at the minimiser."""
        return self.kkt_residual(light, self.gradient(light))

    def kkt_residual(self, light: Light, gradient: Light) -> float:
        """`optimality` of a light whose gradient is known."""
        xp = namespace(light)
        lower, upper = (xp.broadcast_to(bound, light.shape) for bound in (self.lower, self.upper))

        def work(view: int, rows: slice) -> float:
            x = light[view, rows, ...]
            best = xp.maximum(x - gradient[view, rows, ...], lower[view, rows, ...])
            return float(xp.max(xp.abs(x - xp.minimum(best, upper[view, rows, ...]))))

        return max(in_parts(work, light.shape, light))

    def frozen(self, at: Light) -> Problem:
        """The same problem with the pollution of the light `at` (eq. 9)."""
        return self.observed_by(Frozen(self.observation, at))

    def observed_by(self, observation: AdjointObservation) -> Problem:
        """The same problem with another `observation` of the same shapes."""
        return self._with(observation, self.weighting)

    def weighted_by(self, weighting: Weighting) -> Problem:
        """The same problem with another `weighting` of the same shape."""
        return self._with(self.observation, weighting)

    def sent(self, send: Callable[[Array], Array]) -> Problem:
        """The same problem, of arrays that `send` makes of its own, as on a GPU."""
        return self._with(self.observation, self.weighting, send)

    def _with(
        self,
        observation: AdjointObservation,
        weighting: Weighting,
        send: Callable[[Array], Array] = lambda array: array,
    ) -> Problem:
        return Problem(
            observation,
            weighting,
            send(self.desired),
            (send(self.lower), send(self.upper)),
            anchor=None if self.anchor is None else send(self.anchor),
            regularisation=self.damping,
            negligible=self.negligible,
            contrast=None if self.contrast is None else send(self.contrast),
            aim=None if self.aim is self.desired else send(self.aim),
            stiffness=None if self.stiffness is None else send(self.stiffness),
        )

    def penalty(self, light: Light) -> float:
        """The regulariser's part of the cost."""
        if self.anchor is None:
            return 0.0
        change = light - self.anchor
        return 0.5 * dot(change, self._damped(change))

    def _damped(self, change: Light) -> Light:
        """Mu L' m K² L of a change of light."""
        if self.contrast is None:
            return self.regularisation * change
        # A plane's weights first: of large pictures, each copy of all primaries counts
        weights = self.contrast**2
        if self.stiffness is not None:
            weights *= self.stiffness
        local = self.observation.local(change) * weights
        local *= namespace(local).asarray(self.damping, dtype=local.dtype, device=local.device)
        return self.observation.local_adjoint(local)

    def contrasted(self, seen: Light) -> Light:
        """K times a difference of what is seen, (seen view, row, col, primary)."""
        return seen if self.contrast is None else seen * self.contrast


def _of_each(regularisation: float | Sequence[float], primaries: int) -> tuple[float, ...]:
    """Mu of each primary."""
    if not isinstance(regularisation, Sequence):
        return (regularisation,) * primaries
    if len(regularisation) != primaries:
        raise ValueError(f"{primaries} primaries take one mu each, got {len(regularisation)}")
    return tuple(regularisation)
