"""The optimisation problem: what to project within the projector's bounds (eqs. 3, 5, 7).

    min_x  1/2 ||lambda(psi(x) - desired)||² + 1/2 mu ||L (x - anchor)||²
           with  lower <= x <= upper

With an affine psi it is a convex quadratic with bound constraints, solved in *linear light*. The
small mu keeps frequencies that the eye cannot see from filling with noise; L is how a pixel's light
is seen in its own place (`AdjointObservation.local`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

from compensate.weighting import Weighting
from domesim.errors import InputError
from domesim.light import Array, Light, dot, namespace, require_finite, require_light, total
from domesim.light.strips import in_parts
from domesim.observation.base import AdjointObservation
from domesim.observation.frozen import Frozen

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
        x_0 and mu of the regulariser. Without an anchor, mu must be 0.
    negligible
        A difference in cost that nobody can see: solvers need not go on for less.

    Raises
    ------
    InputError
        If shapes disagree, or a lower bound is above its upper.
    """

    def __init__(
        self,
        observation: AdjointObservation,
        weighting: Weighting,
        desired: Light,
        bounds: tuple[Bound, Bound] = (0.0, 1.0),
        *,
        anchor: Light | None = None,
        regularisation: float = 0.0,
        negligible: float = 0.0,
    ) -> None:
        require_light(desired, observation.seen_shape, who="Problem's desired light")
        if weighting.shape != observation.seen_shape:
            raise InputError(
                f"weighting takes {weighting.shape}, but the observation gives "
                f"{observation.seen_shape}"
            )
        if regularisation and anchor is None:
            raise InputError("a regularised problem needs an anchor, got none")
        if anchor is not None:
            require_light(anchor, observation.shape, who="Problem's anchor")
        xp = namespace(desired)
        self.observation = observation
        self.weighting = weighting
        self.desired = desired
        self.lower, self.upper = (
            xp.asarray(bound, dtype=desired.dtype, device=desired.device) for bound in bounds
        )
        self.anchor = anchor
        self.regularisation = regularisation
        self.negligible = negligible
        if bool(xp.any(self.lower > self.upper)):
            raise InputError("a lower bound is above its upper bound")

    @property
    def ffts(self) -> int:
        """FFTs of planes done so far on behalf of this problem; a share counts as one."""
        return math.ceil(self.weighting.fourier.count)

    def residual(self, light: Light) -> Light:
        """Returns psi(x) - desired, (seen view, row, col, primary)."""
        return self.observation.observe(light) - self.desired

    def cost(self, light: Light) -> float:
        """Returns the objective at `light`."""
        return 0.5 * self.weighting.energy(self.residual(light)) + self.penalty(light)  # eq. 3

    def gradient(self, light: Light) -> Light:
        """Returns the objective's gradient, (view, row, col, primary)."""
        return self.quadratic(light)[1]

    def quadratic(self, light: Light) -> tuple[float, Light]:
        """Returns the objective and its gradient, which share their transforms."""
        energy, weighted = self.weighting.quadratic(self.residual(light))
        penalty, gradient = self.penalty_and_gradient(light, weighted)
        return 0.5 * energy + penalty, gradient

    def penalty_and_gradient(self, light: Light, weighted: Light) -> tuple[float, Light]:
        """Computes the regulariser's part of the cost, and the whole gradient; it needs no FFT.

        Parameters
        ----------
        light
            (view, row, col, primary).
        weighted
            (seen view, row, col, primary) lambda'lambda of its residual.

        Returns
        -------
        penalty, gradient
            A number, and (view, row, col, primary).
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
        """Returns <d, H d> and H d of the (constant) Hessian H."""
        energy, weighted = self.weighting.quadratic(self.observation.linear(direction))
        product = self.observation.adjoint(weighted)
        damped = self._damped(direction)
        return energy + dot(direction, damped), product + damped

    def begun(self, start: Light, who: str) -> Light:
        """Looks at the light that a solver begins with, and brings it within the bounds.

        Parameters
        ----------
        start
            (view, row, col, primary).
        who
            Name of the solver, for the message.

        Returns
        -------
        light
            As of `project`.

        Raises
        ------
        InputError
            If it is no light of this problem, or has values that are not finite.
        """
        require_light(start, self.observation.shape, who=who)
        require_finite(start, who=who)
        return self.project(start)

    def project(self, light: Light) -> Light:
        """Returns the nearest light within the bounds."""
        xp = namespace(light)
        return xp.minimum(xp.maximum(light, self.lower), self.upper)

    def optimality(self, light: Light) -> float:
        """Returns the largest KKT residual |x - P(x - gradient)|; 0 at the minimiser."""
        return self.kkt_residual(light, self.gradient(light))

    def kkt_residual(self, light: Light, gradient: Light) -> float:
        """Computes `optimality` of a light whose gradient is known.

        Parameters
        ----------
        light, gradient
            (view, row, col, primary).

        Returns
        -------
        residual
            Largest |x - P(x - gradient)|.
        """
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
            regularisation=self.regularisation,
            negligible=self.negligible,
        )

    def penalty(self, light: Light) -> float:
        """Returns the regulariser's part of the cost."""
        if self.anchor is None:
            return 0.0
        change = light - self.anchor
        return 0.5 * dot(change, self._damped(change))

    def _damped(self, change: Light) -> Light:
        """Mu L' L of a change of light."""
        return self.observation.local_adjoint(self.regularisation * self.observation.local(change))
