"""Albedos, gain and ambient light from what places show of patterns: least squares.

Photograph k of pattern j shows at place b, in each primary,

    y_kb = g f_jb(rho) prod_s (1 + eta_s e_sjb) + a_b + noise

with f the light of `domesim.measure.dome.model` (1 = direct white), g the gain: what white by
direct light alone is in the photographs' unit. The a_b, ambient light, are free at every place:
they enter linearly and are eliminated (the residuals of a place lose what is common to its
photographs [1]), so a place that was photographed under one pattern only tells nothing. What is
known of the geometry and of the camera only within an error enters as nuisances eta_s, of mean 0
and variance 1, whose effects e are relative changes of the light; so do albedos that are known from
elsewhere.

A meter sees all primaries at once: sum_p w_p g_p f_jb(rho_p) + a_b, with the primaries' shares w_p
in the luminance of white. Beside photographs in a unit of their own, whose gains g_p are arbitrary,
it shows L sum_p w_p f_jb(rho_p) + a_b, where white's luminance L is one more unknown.

With whitened residuals r and Jacobian J (nuisances' and known values' rows included) the covariance
is (J'J)^-1. Directions in which J is nearly 0 are explanations that the data cannot tell apart.
What is uncertain by more than `WIDEST` is not answered. An interval that the linear covariance
claims is believed if at its ends, with all else fitted anew, chi² rises as it should (the profile
likelihood [2]).

If residuals are larger than noise allows, the model is wrong by something that is not among the
nuisances. A relative error of the model, independent at all places, is then added to the noise, as
large as makes chi² what it should be; it is reported.

[1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973). [2] D. J. Venzon, S. H.
Moolgavkar, Applied Statistics 37, 87 (1988).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, brentq, least_squares
from scipy.stats import chi2

from domesim.errors import InputError
from domesim.light.ties import ascending
from domesim.measure.dome.model import Interreflection, Places
from domesim.observation.uncertain import SIGMAS

Floats = NDArray[np.float64]

WIDEST = 0.1
"""Half of a 95 % interval from which a figure is no answer: of albedos, of a gain's logarithm."""
BRIGHTEST = 0.98
"""Largest albedo of a surface."""
LARGEST_MODEL_ERROR = 0.03
"""Relative error of the model at each place from which nothing is answered: the description, or
what is held, is wrong."""
_NARROW = WIDEST / 5
"""Half of an interval within which chi² is as good as quadratic: its ends need no test."""
_RISE = 0.5
"""Share of the chi² that should be gained at an interval's end, below which it is not believed."""
IMPROBABLE = 3.0
"""Standard deviations from which something described is doubted."""
_TELLING = 0.3
"""Least standard deviation of what can be found, below which photographs do not tell a thing."""
_ALIKE = 0.7
"""Correlation from which two nuisances cannot be distinguished."""
_LEANING = 0.3
"""Standard error over the assumed one from which a figure leans on what was assumed."""
_SAME = 1e-6
"""Relative difference of variances, and share of a direction, that rounding may leave."""
_FIXED = 1e-7
"""Standard error of what is exactly known."""

_MOST = 40
"""Evaluations of a fit; sound ones take about 8, and those of undetermined ones wander."""

GAIN = "gain"


@final
@dataclass(frozen=True)
class Known:
    """What is known from elsewhere.

    Parameters
    ----------
    value
        One number a primary.
    error
        Its standard error, likewise; 0 if it is to be taken as exact.
    assumed
        Whether nobody said so, and it stands in for nothing. Then the figure is answered however
        uncertain it is, and is told as what it is.
    """

    value: tuple[float, float, float]
    error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    assumed: bool = False


@final
@dataclass(frozen=True, eq=False)
class Meter:
    """Which places a meter read, beside photographs of the others.

    Parameters
    ----------
    places
        (place,) whether a meter read it; its readings stand where those of the first primary would.
    weights
        (primary,) shares of the primaries in the luminance of white.
    white
        Whether white's luminance is an unknown of its own, as photographs do not tell it; otherwise
        the photographs' gain is in cd/m².
    """

    places: NDArray[np.bool_]
    weights: Floats
    white: bool


@final
@dataclass(frozen=True, eq=False)
class Evidence:
    """The data of a fit.

    Parameters
    ----------
    places
        Where.
    pattern
        (photograph,) index of the pattern that each shows.
    value, variance
        (photograph, place, primary); infinite variance where nothing was seen.
    area
        (place,) share of the screen, of those that are on it.
    names, effects
        Names of nuisances, and their effects: (nuisance, pattern, place, primary) relative changes
        of light by one standard deviation of each.
    about
        (nuisance,) values of nuisances that `places` allow for, in standard deviations; 0 if None.
    meter
        If some places were read by a meter that sees all primaries at once.
    """

    places: Places
    pattern: NDArray[np.int64]
    value: Floats
    variance: Floats
    area: Floats
    names: tuple[str, ...] = ()
    effects: Floats | None = None
    about: Floats | None = None
    meter: Meter | None = None


@final
@dataclass(frozen=True, eq=False)
class Survey:
    """Albedos, gain and ambient light that were fitted, with their errors.

    Attributes
    ----------
    names
        (parameter,) such as ``screen``; the same for each primary.
    value, error
        (parameter, primary) and standard errors; the gain in the photographs' unit, or in cd/m² and
        the same for all primaries if a meter alone tells it.
    covariance
        (primary, parameter, primary, parameter), of the gain's logarithm and of the albedos.
    answered
        (parameter, primary) whether the data (and what was known) determine it; nothing if the
        search did not end.
    confusions
        Which explanations the data cannot tell apart, a line each.
    ambient, ambient_error
        (primary,) mean over the screen, in units of projector white.
    nuisances
        Name -> (found, standard error) in units of what was stated.
    doubts
        Which of these are improbable, a line each.
    leaning
        What was assumed, of figures that the photographs tell little of.
    chi2, degrees, model_error
        Chi² by noise alone and its degrees of freedom; relative error of the model that was added.
    residual
        (photograph, place, primary) measured less modelled, in standard errors of all kinds.
    modelled
        (photograph, place, primary) light, with what is ambient.
    """

    names: tuple[str, ...]
    value: Floats
    error: Floats
    covariance: Floats
    answered: NDArray[np.bool_]
    confusions: tuple[str, ...]
    ambient: Floats
    ambient_error: Floats
    nuisances: Mapping[str, tuple[float, float]]
    doubts: tuple[str, ...]
    leaning: Mapping[str, Known]
    chi2: float
    degrees: int
    model_error: float
    residual: Floats
    modelled: Floats

    @property
    def complete(self) -> bool:
        """Whether the data determine all figures."""
        return bool(self.answered.all())

    @property
    def plausible(self) -> bool:
        """Whether noise alone explains the residuals."""
        return bool(chi2.sf(self.chi2, self.degrees) > 1e-3)

    @property
    def correlations(self) -> Floats:
        """(figure, figure): all of R, then of G and of B."""
        size = 3 * len(self.names)
        covariance = self.covariance.reshape(size, size)
        spread = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(spread, spread))


def survey(
    light: Interreflection,
    evidence: Evidence,
    start: Floats,
    surfaces: Sequence[str],
    known: Mapping[str, Known] | None = None,
    *,
    profile: bool = True,
) -> Survey:
    """Fit albedos and gain.

    Parameters
    ----------
    light
        The theatre's model.
    evidence
        What was seen.
    start
        (surface, primary) albedos to start from.
    surfaces
        Their names.
    known
        What is known of surfaces, or of the gain, from elsewhere.
    profile
        Whether to test intervals at their ends, for some seconds.

    Raises
    ------
    InputError
        If something is said to be known that the theatre has not, or nothing is lit.
    """
    names = (GAIN, *surfaces)
    known = {} if known is None else known
    for name in known:
        if name not in names:
            raise InputError(f"{name} cannot be held: the theatre has {', '.join(names)}")
    problem = _Problem(light, evidence, names, known)
    begin = problem.start(start)
    solution = problem.solved(begin)
    noise = float(solution.fun[: problem.rows] @ solution.fun[: problem.rows])
    degrees = problem.degrees
    if degrees > 0 and chi2.sf(noise, degrees) < 1e-3:
        solution = problem.allowed_for(solution)
    return problem.answers(solution, noise, profile=profile)


@final
class _Problem:
    """Residuals and their Jacobian.

    Parameters: (primary, [ln gain, albedos]), then nuisances, then ln white if that is one.
    """

    def __init__(
        self,
        light: Interreflection,
        evidence: Evidence,
        names: tuple[str, ...],
        known: Mapping[str, Known],
    ) -> None:
        self._light, self._evidence, self._names = light, evidence, names
        self._seen = light.seen_from(evidence.places)
        self._count = len(names)
        self._known = known
        self._effects = evidence.effects
        self._nuisances = 0 if evidence.effects is None else len(evidence.effects)
        self._about = np.zeros(self._nuisances) if evidence.about is None else evidence.about
        self._white = evidence.meter is not None and evidence.meter.white
        self._model_error = 0.0
        self._last: tuple[bytes, tuple[Floats, Floats]] | None = None
        self._held: dict[int, float] = {}

    @property
    def rows(self) -> int:
        """Number of residuals of data."""
        return int(self._evidence.value.size)

    @property
    def degrees(self) -> int:
        """Degrees of freedom: the number of data less those of ambient lights and parameters."""
        free = 3 * sum(name not in self._known for name in self._names)
        if self._white:
            free += 3 if GAIN in self._known else 1
        seen = np.isfinite(self._evidence.variance)
        return int(seen.sum() - seen.any(0).sum()) - free

    def start(self, albedos: Floats) -> Floats:
        """A first guess: gains from what patterns have brightened."""
        places, value = self._evidence.places, self._evidence.value
        direct = places.direct[self._evidence.pattern]
        seen = np.isfinite(self._evidence.variance)
        if self._evidence.meter is not None:
            seen[:, self._evidence.meter.places] = False
        guess = np.zeros((3, self._count))
        for p in range(3):
            steps, rises = (_range(part[..., p], seen[..., p]) for part in (direct, value))
            if places.lux is not None:
                rises = np.where(places.lux, rises * np.mean(albedos[0]) / np.pi, rises)
            lit = steps > 0.5 * max(steps.max(initial=0.0), 1e-9)
            rise = rises[lit] / steps[lit]
            if not lit.any() or not np.median(rise) > 0:
                raise InputError(
                    f"primary {'RGB'[p]}: no place on the screen was photographed lit and unlit; "
                    f"add photographs of other patterns, black first"
                )
            guess[p, 0] = np.log(np.median(rise))
            guess[p, 1:] = np.clip(albedos[:, p], 0.02, BRIGHTEST - 0.02)
            for name, what in self._known.items():
                at = self._names.index(name)
                if name != GAIN:
                    guess[p, at] = what.value[p]
                elif not self._white:
                    guess[p, at] = np.log(what.value[p])
        begin = np.concatenate([guess.ravel(), np.zeros(self._nuisances + self._white)])
        if self._white:
            begin[-1] = self._first_white(begin)
        return begin

    def _first_white(self, x: Floats) -> float:
        """Logarithm of white's luminance, by readings at a first guess of all else."""
        seen = np.isfinite(self._evidence.variance[..., 0]) & self._metered
        modelled, _ = self._modelled(x)
        steps, rises = (_range(part[..., 0], seen) for part in (modelled, self._evidence.value))
        lit = steps > 0.5 * max(steps.max(initial=0.0), 1e-9)
        if not lit.any() or not np.median(rises[lit]) > 0:
            raise InputError(
                "no place was read lit and unlit; add readings of another pattern, black first"
            )
        return float(np.log(np.median(rises[lit] / steps[lit])))

    @property
    def _metered(self) -> NDArray[np.bool_]:
        """(place,) whether a meter read it, beside photographs."""
        meter = self._evidence.meter
        return np.zeros(self._evidence.area.shape, bool) if meter is None else meter.places

    @property
    def _parameter_of(self) -> NDArray[np.int64]:
        """Index (primary, figure) of a figure's parameter."""
        index = np.arange(3 * self._count).reshape(3, self._count)
        if self._white:
            index[:, 0] = 3 * self._count + self._nuisances
        return index

    def solved(self, start: Floats, held: Mapping[int, float] | None = None) -> OptimizeResult:
        """The best fit; some parameters held."""
        self._held = {} if held is None else dict(held)
        low = np.concatenate([np.tile([-np.inf] + [0.0] * (self._count - 1), 3)])
        high = np.concatenate([np.tile([np.inf] + [BRIGHTEST] * (self._count - 1), 3)])
        loose = np.full(self._nuisances + self._white, np.inf)
        start = start.copy()
        for at, value in self._held.items():
            start[at] = value
        bounds = np.concatenate([low, -loose]), np.concatenate([high, loose])
        start = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
        return least_squares(
            self._residual,
            start,
            self._jacobian,
            bounds,
            x_scale="jac",
            xtol=1e-9,
            ftol=1e-9,
            max_nfev=_MOST,
        )

    def allowed_for(self, solution: OptimizeResult) -> OptimizeResult:
        """The best fit with a model error that makes chi² equal its degrees of freedom."""
        for _ in range(2):

            def excess(logarithm: float, at: Floats = solution.x) -> float:
                self._model_error = float(np.exp(logarithm))
                own = self._residual(at)[: self.rows]
                return float(own @ own) - self.degrees

            low, high = np.log(1e-6), np.log(10.0)
            # Beyond that it is no model at all: chi² says so.
            self._model_error = float(
                np.exp(brentq(excess, low, high, xtol=1e-3))
                if excess(high) < 0 < excess(low)
                else 0
            )
            solution = self.solved(solution.x)
        return solution

    def answers(self, solution: OptimizeResult, noise: float, *, profile: bool) -> Survey:
        """The fitted figures, and which of them the data leave open."""
        x, jacobian = solution.x, solution.jac
        covariance = inverse(jacobian, self._scales())
        spread = np.sqrt(np.diag(covariance))
        figures = self._parameter_of
        error = spread[figures]
        answered = (SIGMAS * error < WIDEST) & (solution.status > 0)
        wrong = self._model_error > LARGEST_MODEL_ERROR
        unsure = answered & (SIGMAS * error > _NARROW) & (profile and not wrong)
        for p, at in zip(*np.nonzero(unsure), strict=True):
            name = self._names[at]
            exact = name in self._known and self._known[name].error[p] == 0
            if not exact and not self._rises(solution, int(figures[p, at]), float(error[p, at])):
                answered[p, at] = False
        leaning = {}
        for name, what in self._known.items():
            at = self._names.index(name)
            if what.assumed:
                answered[:, at] = solution.status > 0
                if np.any(error[:, at] > _LEANING * np.asarray(what.error)):
                    leaning[name] = what
        shared = covariance[np.ix_(figures.ravel(), figures.ravel())]
        confusions = self._confusions(shared, answered)
        if wrong:
            answered[:] = False
            confusions = (
                f"the description does not explain the photographs: each place is off by "
                f"{self._model_error:.1%}; check the geometry, the camera, which pattern each "
                f"photograph shows, exposures, and what is held",
            )
        value = x[figures]
        value[:, 0] = np.exp(value[:, 0])
        # Ambient light follows from photographs
        gain = np.exp(x[: 3 * self._count : self._count])
        ambient, ambient_error = self._ambient(x, covariance)
        shown_error = error.copy()
        shown_error[:, 0] *= value[:, 0]
        own = solution.fun[: self.rows].reshape(self._evidence.value.shape)
        root = np.sqrt(self._variance(self._modelled(x)[0]))
        left = own * np.where(np.isfinite(root), root, 0.0)
        mine = slice(3 * self._count, 3 * self._count + self._nuisances)
        eta = x[mine] + self._about, spread[mine]
        return Survey(
            names=self._names,
            value=value.T,
            error=shown_error.T,
            covariance=shared.reshape(*figures.shape, *figures.shape),
            answered=answered.T,
            confusions=confusions,
            ambient=ambient / gain,
            ambient_error=ambient_error / gain,
            nuisances={
                name: (float(a), float(b))
                for name, a, b in zip(self._evidence.names, *eta, strict=True)
            },
            doubts=_doubts(self._evidence.names, eta[0], covariance[mine, mine]),
            leaning=leaning,
            chi2=noise,
            degrees=self.degrees,
            model_error=self._model_error,
            residual=own,
            modelled=self._evidence.value - left,
        )

    def _scales(self) -> Floats:
        """What a parameter may plausibly differ by."""
        return np.concatenate([np.tile([1.0] + [0.3] * (self._count - 1), 3),
                               np.ones(self._nuisances + self._white)])  # fmt: skip

    def _rises(self, solution: OptimizeResult, at: int, error: float) -> bool:
        """Whether chi² rises by what it should to both ends of an interval."""
        for side in (-1, 1):
            end = solution.x[at] + side * SIGMAS * error
            albedo = at < 3 * self._count and at % self._count > 0
            if albedo and not 0 < end < BRIGHTEST:
                continue  # albedos end there by themselves
            other = self.solved(solution.x, {at: end})
            self._held = {}
            if 2 * (other.cost - solution.cost) < _RISE * SIGMAS**2:
                return False
        return True

    def _confusions(self, covariance: Floats, answered: NDArray[np.bool_]) -> tuple[str, ...]:
        """Tells, for each primary that is not answered, the change that the data notice least."""
        count, lines = self._count, []
        scales = self._scales()[:count]
        for p in np.flatnonzero(~answered.all(1)):
            own = covariance[p * count :, p * count :][:count, :count] / np.outer(scales, scales)
            weakest = _weakest(own) * scales
            size = weakest / np.abs(weakest).max() * 0.1
            members = [
                f"{name} {change:+.0%}" if name == GAIN else f"{name} albedo {change:+.3f}"
                for name, change in zip(self._names, size, strict=True)
                if abs(change) > 0.005
            ]
            open_ = [name for name, good in zip(self._names, answered[p], strict=True) if not good]
            lines.append(
                f"{'RGB'[p]}: {', '.join(open_)} cannot be told; the photographs look nearly the "
                f"same with {', '.join(members)}"
            )
        return tuple(lines)

    def _ambient(self, x: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """(primary,) mean over the screen of the light that all photographs of a place share."""
        value, error = np.zeros(3), np.zeros(3)
        modelled, slopes = self._modelled(x)
        weight = 1 / self._variance(modelled)
        share = weight / np.maximum(weight.sum(0), 1e-300)
        area = self._evidence.area
        for p in range(3):
            local = np.sum(share[..., p] * (self._evidence.value - modelled)[..., p], 0)
            value[p] = area @ local
            slope = -np.einsum("b,kb,nkb->n", area, share[..., p], slopes[..., p])
            own = np.sum(area**2 / np.maximum(weight[..., p].sum(0), 1e-300))
            error[p] = np.sqrt(own + slope @ covariance @ slope)
        return value, error

    def _variance(self, modelled: Floats) -> Floats:
        return np.asarray(self._evidence.variance + (self._model_error * modelled) ** 2)

    def _modelled(self, x: Floats) -> tuple[Floats, Floats]:
        """(photograph, place, primary) light without ambient, and (parameter, ...) its slopes."""
        key = x.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        count, evidence = self._count, self._evidence
        eta = x[3 * count : 3 * count + self._nuisances]
        light = np.empty(evidence.value.shape)
        slopes = np.zeros((len(x), *light.shape))
        for p in range(3):
            mine = x[p * count : (p + 1) * count]
            shown, change = self._light.shown(p, mine[1:], evidence.places, self._seen)
            gain = np.exp(mine[0])
            bent = np.ones_like(shown)
            if self._effects is not None:
                factors = 1 + eta[:, None, None] * self._effects[..., p]
                bent = factors.prod(0)
                effects = gain * shown * _others(factors) * self._effects[..., p]
                slopes[3 * count : 3 * count + len(eta), ..., p] = effects[:, evidence.pattern]
            light[..., p] = (gain * shown * bent)[evidence.pattern]
            slopes[p * count, ..., p] = light[..., p]
            slopes[p * count + 1 : (p + 1) * count, ..., p] = (gain * change * bent)[
                :, evidence.pattern
            ]
        if evidence.meter is not None:
            self._mix(x, light, slopes, evidence.meter)
        self._last = key, (light, slopes)
        return light, slopes

    def _mix(self, x: Floats, light: Floats, slopes: Floats, meter: Meter) -> None:
        """Put what a meter sees where it read."""
        gains = slice(0, 3 * self._count, self._count)
        here = meter.places
        # What the meter sees of what photographs would show in each primary
        weights = meter.weights * np.exp(x[-1] - x[gains]) if self._white else meter.weights
        luminance, change = light[:, here] @ weights, slopes[:, :, here] @ weights
        if self._white:
            change[gains] = 0
            change[-1] = luminance
        light[:, here], slopes[:, :, here] = 0, 0
        light[:, here, 0], slopes[:, :, here, 0] = luminance, change

    def _residual(self, x: Floats) -> Floats:
        modelled, _ = self._modelled(x)
        root = np.sqrt(self._variance(modelled))
        left = self._without_ambient((self._evidence.value - modelled) / root, root)
        return np.concatenate([left.ravel(), self._priors(x)[0]])

    def _jacobian(self, x: Floats) -> Floats:
        modelled, slopes = self._modelled(x)
        root = np.sqrt(self._variance(modelled))
        rows = self._without_ambient(-slopes / root, root).reshape(len(x), -1)
        result = np.concatenate([rows, self._priors(x)[1].T], 1).T
        for at in self._held:
            result[:, at] = 0
            result[-len(self._held) + list(self._held).index(at), at] = 1 / _FIXED
        return result

    def _without_ambient(self, whitened: Floats, root: Floats) -> Floats:
        """Residuals (..., photograph, place, primary) less their part along 1 / root."""
        along = 1 / root
        along = along / np.maximum(np.linalg.norm(along, axis=0), 1e-300)
        common = np.sum(whitened * along, axis=-3, keepdims=True)
        return np.asarray(whitened - common * along)

    def _priors(self, x: Floats) -> tuple[Floats, Floats]:
        """Residuals of what is known from elsewhere, and (row, parameter) their slopes."""
        rows, slopes = [], []

        def add(at: int, value: float, error: float) -> None:
            error = max(error, _FIXED)
            rows.append((x[at] - value) / error)
            slope = np.zeros(len(x))
            slope[at] = 1 / error
            slopes.append(slope)

        for name, what in self._known.items():
            at = self._names.index(name)
            if name == GAIN and self._white:
                assert self._evidence.meter is not None
                weights = self._evidence.meter.weights
                value, error = float(weights @ what.value), float(weights @ what.error)
                add(len(x) - 1, float(np.log(value)), error / value)
                continue
            for p in range(3):
                value, error = what.value[p], what.error[p]
                if name == GAIN:
                    value, error = float(np.log(value)), error / value
                add(p * self._count + at, value, error)
        for s in range(self._nuisances):
            add(3 * self._count + s, -float(self._about[s]), 1.0)
        for at, held in self._held.items():
            add(at, held, 0.0)
        return np.array(rows), np.array(slopes).reshape(len(rows), len(x))


def _doubts(names: Sequence[str], value: Floats, covariance: Floats) -> tuple[str, ...]:
    """What is described wrongly by more than `IMPROBABLE` standard deviations.

    If a nuisance of prior variance 1 is found with variance s², the mean of all that could be found
    has variance 1 - s². Those that do the same to the photographs share what was found by their
    priors, so they are in doubt together, and the data do not say which it was.
    """
    spread = np.sqrt(np.diag(covariance))
    moved = np.sqrt(np.maximum(1 - spread**2, _TELLING**2))
    left = [int(at) for at in np.flatnonzero(np.abs(value) > IMPROBABLE * moved)]
    alike = np.abs(covariance) > _ALIKE * np.outer(spread, spread)
    lines = []
    for at in np.array(left, int)[ascending(-np.abs(value[left]) / moved[left])].tolist():
        if at not in left:
            continue
        group = [at, *(other for other in left if other != at and alike[at, other])]
        left = [other for other in left if other not in group]
        values = [f"{names[one]} is {value[one]:+.1f} ± {spread[one]:.1f}" for one in group]
        line = f"{' and '.join(values)} of its stated error"
        lines.append(
            line
            if len(group) == 1
            else f"{line}, or one of both more: the photographs do not tell them apart"
        )
    return tuple(lines)


def _others(factors: Floats) -> Floats:
    """(factor, ...) product of all other factors, any of which may be 0."""
    one = np.ones_like(factors[:1])
    before = np.cumprod(np.concatenate([one, factors[:-1]]), 0)
    after = np.cumprod(np.concatenate([one, factors[:0:-1]]), 0)[::-1]
    return np.asarray(before * after)


def _weakest(covariance: Floats) -> Floats:
    """(parameter,) direction of the largest variance, with the first albedo that is in it above 0.

    Of several with the same variance, as of surfaces that nobody sees, that albedo's part counts.
    """
    values, vectors = np.linalg.eigh(covariance)
    space = vectors[:, values >= (1 - _SAME) * values[-1]]
    shares = np.sum(space**2, 1)
    first = [*range(1, len(shares)), 0]
    return np.asarray(space @ space[next(at for at in first if shares[at] > _SAME)])


def _range(values: Floats, seen: NDArray[np.bool_]) -> Floats:
    """(place,) largest less smallest of what was seen of (photograph, place) values."""
    high = np.where(seen, values, -np.inf).max(0)
    low = np.where(seen, values, np.inf).min(0)
    return np.asarray(np.where(seen.any(0), high - low, 0.0))


def inverse(jacobian: Floats, scales: Floats) -> Floats:
    """(J'J)^-1 by the SVD of the scaled Jacobian: the covariance of what was fitted.

    A direction without any weight has a large, not an infinite, variance: that of a change which is
    a million times what is plausible.

    Parameters
    ----------
    jacobian
        (residual, parameter) of whitened residuals.
    scales
        (parameter,) what each may plausibly differ by.
    """
    # Fewer residuals than parameters leave directions without any weight, too.
    missing = max(0, jacobian.shape[1] - jacobian.shape[0])
    whole = np.pad(jacobian * scales, ((0, missing), (0, 0)))
    _, values, rows = np.linalg.svd(whole, full_matrices=False)
    turned = rows / np.maximum(values, 1e-6)[:, None]
    return np.asarray((turned.T @ turned) * np.outer(scales, scales))
