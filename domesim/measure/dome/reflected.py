"""Reflected light of a screen, from what its places show of patterns: no geometry is needed.

Photograph k of pattern j shows at place b, in each primary,

    y_kb = w_b (x_jb + phi_jb) + a_b + noise        phi_jb = sum_il m_i(b) C_il e_jl

with x_jb direct light, m_i smooth functions on the screen, e_jl the mean over the screen of
x_j m_l, and C the core of a `Transport`. What a place shows of one unit of its own direct light,
w_b (gain, vignetting, a screen's lobe), and ambient light a_b are free everywhere: a place that was
lit in some photographs and dark in others tells its own w_b. They are eliminated [1], and C comes
from the rest.

Patterns tell C only as far as they differ. What they leave open is held by two expectations: that
light goes both ways alike, C = C', but for a share of it; and that C_il is small where m_i or m_l
is fine, of standard deviation

    size * DECAY^((degree_i + degree_l) / 2) * (1 if i = l, else MIXING)

Size and share are such that the photographs are most probable [2], and the size is then taken
`CAUTION` times as large, for a room has a few parts that are much larger than the others. C_00, the
light of an integrating sphere, is free. The covariance of what is found includes what was left
open.

[1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973). [2] D. J. C. MacKay, Neural
Computation 4, 415 (1992), section 3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from domesim.errors import InputError
from domesim.light.ties import ascending
from domesim.measure.dome.responses import Responses

Floats = NDArray[np.float64]

DECAY, MIXING = 0.4, 0.25
"""DECAY and MIXING of the module's docstring: about those of tabulated theatres."""
CAUTION = 2.0
TRIED = {
    "size": (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4),
    "one_way": (0.01, 0.03, 0.1, 0.3, 1.0),
}
"""What is tried: size is relative to C_00."""
_FREE = 10.0
"""Standard deviation of C_00."""
_HIDDEN = 0.5
"""Share of the usual gain below which a place is taken to be hidden from the camera."""
_STEPS = 12
_SETTLED = 1e-5


@final
@dataclass(frozen=True)
class Expectation:
    """How large the core's parts are expected to be; see the module's docstring."""

    size: float = 0.05
    one_way: float = 0.1


@final
@dataclass(frozen=True, eq=False)
class Core:
    """What was found of one primary.

    Attributes
    ----------
    core
        (function, function) C.
    gain, ambient
        (place,) w_b and a_b; 0 at places that do not count.
    counted
        (place,) bool.
    hidden
        How many places do not brighten as they should.
    chi2, degrees
        Weighted squared residuals and their degrees of freedom.
    expectation
        What was expected.
    uncertainty
        Uncertainty of C.
    """

    core: Floats
    gain: Floats
    ambient: Floats
    counted: NDArray[np.bool_]
    hidden: int
    chi2: float
    degrees: int
    expectation: Expectation
    uncertainty: Uncertainty

    def shown(self, responses: Responses, primary: int) -> Floats:
        """(photograph, place) light by this fit; what was seen where no place counts."""
        reflected = responses.excitation[:, primary] @ self.core.T @ responses.functions
        light = self.gain * (responses.direct[..., primary] + reflected) + self.ambient
        return np.where(self.counted, light, responses.value[..., primary])


@final
@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of a core's parts."""

    _factor: tuple[Floats, bool]
    _turn: csr_array

    def of(self, combinations: Floats) -> Floats:
        """(n, n) covariance of sums over C of combinations (n, function, function)."""
        flat = self._turn @ combinations.reshape(len(combinations), -1).T
        return np.asarray(flat.T @ cho_solve(self._factor, flat))


def fitted(
    responses: Responses,
    primary: int,
    expectation: Expectation | None = None,
    start: Floats | None = None,
) -> Core:
    """The core of one primary.

    Parameters
    ----------
    responses
        What places show.
    primary
        Which.
    expectation
        Held if given; else the most probable of `TRIED`.
    start
        (function, function) core to start from.

    Raises
    ------
    InputError
        If no place was photographed lit and unlit, with a third photograph to tell anything.
    """
    problem = _Problem(responses, primary)
    size = len(responses.basis)
    core = np.zeros((size, size)) if start is None else start.copy()
    # With nothing reflected yet: which places the camera sees
    gain = problem.local(core).gain
    hidden = problem.counted & (gain < _HIDDEN * np.median(gain[problem.counted]))
    problem.leave_out(hidden)
    held = Expectation() if expectation is None else expectation
    for step in range(_STEPS):
        system = problem.linearised(core)
        if expectation is None and step in (1, 2):
            held = system.most_probable(held, core[0, 0])
            held = replace(held, size=CAUTION * held.size)
        change = system.solution(held, core[0, 0]) - core
        core = core + change
        if (expectation is not None or step > 2) and np.abs(change).max() < _SETTLED:
            break
    local = problem.local(core)
    seen = problem.weight > 0
    return Core(
        core=core,
        gain=local.gain,
        ambient=local.ambient,
        counted=problem.counted,
        hidden=int(hidden.sum()),
        chi2=float(np.sum(problem.weight * local.residual**2)),
        degrees=int(seen.sum() - 2 * problem.counted.sum()),
        expectation=held,
        uncertainty=system.uncertainty(held, core[0, 0]),
    )


@final
@dataclass(frozen=True, eq=False)
class Foretold:
    """What a core foretells of a photograph that it was not fitted to.

    Attributes
    ----------
    off
        (place,) seen less foretold, in units of white's direct light.
    variance
        (place,) of the noise in that: the photograph's, and of local gain and ambient light.
    reflected
        (place,) the reflected light that is foretold.
    counted
        (place,) bool: where there is anything to compare.
    """

    off: Floats
    variance: Floats
    reflected: Floats
    counted: NDArray[np.bool_]


def foretold(
    responses: Responses,
    primary: int,
    kept: NDArray[np.bool_],
    counted: NDArray[np.bool_],
    core: Floats,
    photograph: int,
) -> Foretold:
    """What a core foretells of a photograph.

    Parameters
    ----------
    responses
        What places show: of all photographs.
    primary
        Which.
    kept
        (photograph,) bool: from which gains and ambient light are taken.
    counted
        (place,) bool: those that count in the fit of the core.
    core
        (function, function) of the kept photographs, or a part of it.
    photograph
        Which is foretold.
    """
    problem = _Problem(responses.only(kept), primary)
    problem.leave_out(~counted)
    local = problem.local(core)
    reflected = core @ responses.excitation[photograph, primary] @ problem.functions
    shown = responses.direct[photograph, :, primary] + reflected
    noise = responses.variance[photograph, :, primary]
    here = problem.counted & np.isfinite(noise)
    gain = np.where(here, local.gain, 1.0)
    off = (responses.value[photograph, :, primary] - local.ambient) / gain - shown
    own = local.variance(shown) + np.where(here, noise, 0.0)
    return Foretold(np.where(here, off, 0.0), own / gain**2, reflected, here)


@final
@dataclass(frozen=True, eq=False)
class _Local:
    """Lines through what places show against the light that is foretold there.

    Attributes
    ----------
    gain, ambient
        (place,) slopes and beginnings; 0 where nothing counts.
    residual
        (photograph, place) seen less fitted.
    middle, weight, spread
        (place,) mean light, sum of weights, and weighted sum of squares about the mean.
    """

    gain: Floats
    ambient: Floats
    residual: Floats
    middle: Floats
    weight: Floats
    spread: Floats

    def variance(self, light: Floats) -> Floats:
        """(place,) of the line at some light."""
        return np.asarray(1 / self.weight + (light - self.middle) ** 2 / self.spread)


@final
class _Problem:
    """One primary's data, and what they say of a core."""

    def __init__(self, responses: Responses, primary: int) -> None:
        self._value = responses.value[..., primary]
        self._direct = responses.direct[..., primary]
        self._excitation = responses.excitation[:, primary]
        self.functions = responses.functions
        self.degrees = responses.basis.degrees
        self.weight = 1 / responses.variance[..., primary]
        lit = np.where(self.weight > 0, self._direct, np.nan)
        with np.errstate(invalid="ignore"):
            differs = np.fmax.reduce(lit, 0) - np.fmin.reduce(lit, 0) > 0.2 * np.nanmax(lit)
        self.counted = differs & ((self.weight > 0).sum(0) >= 3)
        if not self.counted.any():
            raise InputError(
                f"primary {'RGB'[primary]}: no place on the screen was photographed lit and unlit "
                f"and under a third pattern, so that direct and reflected light cannot be told "
                f"apart; photograph halves, sectors and rings besides black and white"
            )
        self.leave_out(~self.counted)

    def leave_out(self, places: NDArray[np.bool_]) -> None:
        """Count no more of these."""
        self.counted = self.counted & ~places
        self.weight = np.where(self.counted, self.weight, 0.0)

    def reflected(self, core: Floats) -> Floats:
        """(photograph, place) phi."""
        return np.asarray(self._excitation @ core.T @ self.functions)

    def local(self, core: Floats) -> _Local:
        """Gains and ambient light that fit best."""
        shown, weight = self._direct + self.reflected(core), self.weight
        total = np.maximum(weight.sum(0), 1e-300)
        middle, seen = (np.sum(weight * part, 0) / total for part in (shown, self._value))
        centred = shown - middle
        spread = np.maximum(np.sum(weight * centred**2, 0), 1e-300)
        gain = np.sum(weight * centred * (self._value - seen), 0) / spread * self.counted
        ambient = (seen - gain * middle) * self.counted
        residual = np.where(self.counted, self._value - gain * shown - ambient, 0.0)
        return _Local(gain, ambient, residual, middle, total, spread)

    def linearised(self, core: Floats) -> _System:
        """Normal equations near a core, gains and ambient light eliminated."""
        local, here = self.local(core), self.counted
        shown, root = (self._direct + self.reflected(core))[:, here], np.sqrt(self.weight[:, here])
        first = root / np.linalg.norm(root, axis=0)
        second = root * shown
        second = second - first * np.sum(first * second, 0)
        second = second / np.linalg.norm(second, axis=0)
        functions, scaled = self.functions[:, here], self.functions[:, here] * local.gain[here]
        count = len(functions)
        # Rows of the Jacobian at a place are its functions times (photograph, function) `enters`.
        enters = root.T[..., None] * self._excitation
        inner = np.einsum("bkf,bkg->bfg", enters, enters, optimize=True)
        for along in (first, second):
            part = np.einsum("kb,bkf->bf", along, enters, optimize=True)
            inner -= part[:, :, None] * part[:, None, :]
        # Both are symmetric in their functions: half of the pairs is enough.
        i, j = np.triu_indices(count)
        half = (scaled[i] * scaled[j]) @ inner[:, i, j]
        pair = np.zeros((count, count), np.int64)
        pair[i, j] = pair[j, i] = np.arange(len(i))
        matrix = half[pair[:, None, :, None], pair[None, :, None, :]].reshape(count**2, count**2)
        slope = scaled @ ((root * local.residual[:, here]).T[:, :, None] * enters).sum(1)
        return _System(matrix, slope.ravel() + matrix @ core.ravel(), self.degrees)


@final
class _System:
    """Quadratic chi² of a core: C' matrix C - 2 right' C."""

    def __init__(self, matrix: Floats, right: Floats, degrees: NDArray[np.int64]) -> None:
        self._count = len(degrees)
        self._degrees = degrees
        self._turn = both_ways(self._count)
        self._matrix = self._turn @ (self._turn @ matrix).T
        self._right = self._turn @ right

    def solution(self, expectation: Expectation, mean: float) -> Floats:
        """(function, function) most probable core."""
        factor = self._factor(expectation, mean)
        solved = self._turn.T @ cho_solve(factor, self._right)
        return np.asarray(solved.reshape(self._count, -1))

    def uncertainty(self, expectation: Expectation, mean: float) -> Uncertainty:
        """Uncertainty of the most probable core."""
        return Uncertainty(self._factor(expectation, mean), self._turn)

    def most_probable(self, start: Expectation, mean: float) -> Expectation:
        """The expectation under which the data are most probable, each of its two in turn."""
        best = start
        for name, values in 2 * list(TRIED.items()):
            tried = [replace(best, **{name: value}) for value in values]
            best = tried[ascending([-self._evidence(each, mean) for each in tried])[0]]
        return best

    def _evidence(self, expectation: Expectation, mean: float) -> float:
        """Logarithm of the data's probability, but for what all expectations share."""
        factor = self._factor(expectation, mean)
        fit = self._right @ cho_solve(factor, self._right)
        volume = 2 * np.sum(np.log(np.diag(factor[0])))
        return float((fit - volume - np.sum(np.log(self._spread(expectation, mean) ** 2))) / 2)

    def _factor(self, expectation: Expectation, mean: float) -> tuple[Floats, bool]:
        prior = np.diag(self._spread(expectation, mean) ** -2)
        factor, lower = cho_factor(self._matrix + prior)
        return factor, lower

    def _spread(self, expectation: Expectation, mean: float) -> Floats:
        """(part,) standard deviations of sums and differences."""
        together = self._degrees[:, None] + self._degrees
        size = max(abs(mean), 1e-3) * expectation.size
        spread = size * DECAY ** (together / 2)
        spread *= np.where(np.eye(self._count, dtype=bool), 1.0, MIXING)
        spread[0, 0] = _FREE
        sums, differences = np.triu_indices(self._count), np.triu_indices(self._count, 1)
        return np.concatenate([spread[sums], expectation.one_way * spread[differences]])


def both_ways(count: int) -> csr_array:
    """(part, function²) orthogonal: sums C_il + C_li of the core's parts, then differences."""
    place = np.arange(count**2).reshape(count, count)
    i, j = np.triu_indices(count)
    sums = np.where(i == j, 0.5, np.sqrt(0.5))
    k, m = np.triu_indices(count, 1)
    root = np.full(len(k), np.sqrt(0.5))
    rows = np.concatenate([np.arange(len(i))] * 2 + [len(i) + np.arange(len(k))] * 2)
    cols = np.concatenate([place[i, j], place[j, i], place[k, m], place[m, k]])
    return csr_array((np.concatenate([sums, sums, root, -root]), (rows, cols)))
