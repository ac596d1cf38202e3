"""Statements about noisy figures whose own errors are known.

A z-score is a difference over its standard error. If the standard errors are honest and nothing is
biased, z-scores are standard normal: their sum of squares is chi-square distributed [1], which
`assert_unbiased` tests, and their distribution function is the normal one, which `calibration`
tests [2].

[1] K. Pearson, Philosophical Magazine 50, 157 (1900). [2] A. N. Kolmogorov, Giornale dell'Istituto
Italiano degli Attuari 4, 83 (1933).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from domesim.errors import InputError
from domesim.light.guarded import guarded

FALSE_ALARM = 1e-3
"""How often a test fails although nothing is wrong; with a fixed seed it does so always or never.
"""


@guarded(found="*s", error="*s", truth="*s")
def bias_p(found: ArrayLike, error: ArrayLike, truth: ArrayLike) -> tuple[float, float]:
    """P-values of estimates being unbiased: by their spread, and by what all share.

    Parameters
    ----------
    found, error, truth
        Independent estimates, their standard errors, and what they estimate: same shapes.

    Returns
    -------
    spread, shared
        P-values of the sum of squared z-scores, which errors of either sign raise, and of their
        sum, which a bias that all share moves.

    Raises
    ------
    InputError
        If a standard error is not above 0.
    """
    found, error, truth = np.broadcast_arrays(found, error, truth)
    if not np.all(np.asarray(error) > 0):
        raise InputError(f"standard errors must be above 0, got {np.min(error):g}")
    z = ((found - truth) / error).ravel()
    spread = float(stats.chi2.sf(np.sum(z**2), len(z)))
    shared = float(2 * stats.norm.sf(abs(z.sum()) / np.sqrt(len(z))))
    return spread, shared


@guarded(found="*s", error="*s", truth="*s")
def assert_unbiased(
    found: ArrayLike, error: ArrayLike, truth: ArrayLike, *, false_alarm: float = FALSE_ALARM
) -> None:
    """Raise if figures are further from the truth than their standard errors allow.

    Parameters
    ----------
    found, error, truth
        As for `bias_p`.
    false_alarm
        Probability of raising when all is well.

    Raises
    ------
    AssertionError
        If the sum of squared z-scores, or the sum of z-scores, is improbably large.
    InputError
        If a standard error is not above 0.
    """
    spread, shared = bias_p(found, error, truth)
    # Errors of either sign, and a bias that all share: half the false alarms each
    if min(spread, shared) < false_alarm / 2:
        found, error, truth = (x.ravel() for x in np.broadcast_arrays(found, error, truth))
        worst = int(np.argmax(np.abs((found - truth) / error)))
        raise AssertionError(
            f"biased: chi-square p {spread:.1e}, mean p {shared:.1e} of {len(found)} figures; the "
            f"worst is {found[worst]:.6g} ± {error[worst]:.1g}, expected {truth[worst]:.6g}"
        )


@guarded
def calibration(z: ArrayLike) -> float:
    """P-value of z-scores being standard normal (Kolmogorov-Smirnov); at least two are needed."""
    if np.size(z) < 2:
        raise InputError(f"calibration takes two z-scores or more, got {np.size(z)}")
    return float(stats.kstest(np.ravel(z), "norm").pvalue)


@guarded(model="row col *s", first="row col *s", second="row col *s", share="row col")
def rms_difference(
    model: ArrayLike, first: ArrayLike, second: ArrayLike, share: ArrayLike
) -> float:
    """Rms over pixels of a model's error, where the truth is known by two independent noisy ones.

    The product of both differences has the squared error as its mean, whatever their noise.

    Parameters
    ----------
    model, first, second
        (row, col, ...) the model's picture and two estimates of the true one.
    share
        (row, col) weights, adding up to 1.

    Returns
    -------
    rms
        Error in units of the pictures; below 0 where chance makes the sum negative.
    """
    model, first, second = (np.asarray(part, np.float64) for part in (model, first, second))
    products = (model - first) * (model - second)
    square = np.einsum("ij,ij...->...", np.asarray(share), products)
    return float(np.sign(np.mean(square)) * np.sqrt(np.abs(np.mean(square))))


@final
@dataclass(frozen=True)
class Estimate:
    """A mean over inputs, and its 95 % interval; NaN if there are too few inputs.

    Attributes
    ----------
    mean, low, high
        The mean, and the ends of its interval.
    inputs
        How many there are.
    """

    mean: float
    low: float
    high: float
    inputs: int

    @property
    def written(self) -> str:
        """In words."""
        if self.inputs == 0:
            return "nothing (no input)"
        if self.inputs == 1:
            return f"{self.mean:+.3f} (1 input)"
        return f"{self.mean:+.3f} ({self.low:+.3f} to {self.high:+.3f}, {self.inputs} inputs)"


def estimate(by_input: Iterable[float]) -> Estimate:
    """Mean of independent figures of unknown spread, with Student's interval."""
    values = np.array(list(by_input))
    count = len(values)
    if count == 0:
        return Estimate(np.nan, np.nan, np.nan, 0)
    mean = float(values.mean())
    if count == 1:
        return Estimate(mean, np.nan, np.nan, 1)
    half = float(stats.t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count))
    return Estimate(mean, mean - half, mean + half, count)
