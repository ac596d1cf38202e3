"""Settings of a session -> response, shares of light, and how sure they are.

Each block has settings y_i from below and from above, in units in which all have about the same
noise. Its value is the mean m of both sides' means. Three things make it unsure:

- *noise*, v / 4 (1 / n_below + 1 / n_above). Three settings a side tell v badly, so it is moderated
  by that of all blocks, v_0, as if that had `_PRIOR` degrees of freedom (Smyth 2004);
- *a bias of one side*: who stops early on one side alone moves m by half of what lies between the
  sides' means. Nobody knows which side errs: `_ONE_SIDED` of that distance is its standard error;
- *the response*, whose errors all shares of an eye have in common.

Slips (a key pressed too early) are left out: settings further than `_SLIP` robust standard
deviations from the median of their block. That spread is all blocks' together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.measure.by_eye.session import EACH, STEP, Eye, Settings
from domesim.observation.uncertain import SIGMAS

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SLIP = 4.5
_PRIOR = 2.0
_ONE_SIDED = 0.18
"""These three were chosen on seeds that the experiment `by_eye` does not report."""
_TO_SIGMA = 1.4826
"""Standard deviation over the median distance from the median."""
_EXPONENTS, _SPREAD = np.array([2.2, 0.0]), np.array([0.4, 0.12])
"""ln L = gamma ln v + bend (ln v)²: what displays have, and how much they differ.

sRGB is gamma 2.30 and bend 0.12, within 1 % of light from 1/64 to 1."""


@final
@dataclass(frozen=True)
class Mean:
    """The value of one block.

    Parameters
    ----------
    value
        In the block's unit.
    variance, degrees
        Of the noise of `value`, and its degrees of freedom.
    one_sided
        Variance for want of knowing which side errs.
    apart
        Mean from above less mean from below.
    kept
        (setting,) whether it is no slip.
    """

    value: float
    variance: float
    degrees: float
    one_sided: float
    apart: float
    kept: Flags

    @property
    def slips(self) -> int:
        """How many settings were left out."""
        return int(np.sum(~self.kept))


def means_of(values: Sequence[Floats], above: Sequence[Flags], step: float) -> list[Mean]:
    """The value of each of several blocks whose settings have about the same noise.

    Parameters
    ----------
    values
        For each block (setting,) what was set.
    above
        For each block (setting,) whether that came from above.
    step
        Of the page, in the same unit: settings are uniform in it.
    """
    away = [np.abs(y - np.median(y)) for y in values]
    scale = max(_TO_SIGMA * float(np.median(np.concatenate(away))), step)
    kept = [_kept(part <= _SLIP * scale, up) for part, up in zip(away, above, strict=True)]
    sides = [(y[up & k], y[~up & k]) for y, up, k in zip(values, above, kept, strict=True)]
    squares = [sum(float(side.var()) * len(side) for side in pair) for pair in sides]
    free = [sum(map(len, pair)) - 2 for pair in sides]
    pooled = sum(squares) / sum(free)
    found = []
    for k, (high, low) in enumerate(sides):
        degrees = free[k] + _PRIOR
        noise = (squares[k] + _PRIOR * pooled) / degrees + step**2 / 12
        of_sides = noise * (1 / len(high) + 1 / len(low))
        apart = float(high.mean() - low.mean())
        unknown = _ONE_SIDED**2 * max(apart**2 - of_sides, 0.0)
        middle = _middle(values[k], above[k], kept[k])
        found.append(Mean(middle, of_sides / 4, degrees, unknown, apart, kept[k]))
    return found


def _kept(near: Flags, above: Flags) -> Flags:
    """What is near the others; all of a side that has nothing there."""
    return np.asarray(near | (above & ~near[above].any()) | (~above & ~near[~above].any()))


@final
@dataclass(frozen=True)
class Response:
    """Light of code values: ln L = exponents · (ln v, (ln v)²).

    Parameters
    ----------
    exponents, covariance
        (2,) and (2, 2).
    degrees
        Degrees of freedom of their noise.
    gammas
        (level,) exponents of the power laws that the matched codes alone would have.
    """

    exponents: Floats
    covariance: Floats
    degrees: float
    gammas: tuple[float, ...]

    def light(self, codes: Floats, exponents: Floats | None = None) -> Floats:
        """L of code values 0..1; 0 for 0."""
        gamma, bend = self.exponents if exponents is None else exponents
        logs = np.log(np.maximum(codes, 1e-6))
        return np.asarray(np.where(codes > 0, np.exp(gamma * logs + bend * logs**2), 0.0))


def response_of(ratios: Sequence[Mean]) -> Response:
    """The response of matched codes.

    Parameters
    ----------
    ratios
        For each level ln v_k / v_(k-1).
    """
    steps = np.array([each.value for each in ratios])
    codes = np.cumsum(steps)
    lights = -np.log(4.0) * np.arange(1, len(steps) + 1)
    rows = np.stack([codes, codes**2], 1)
    summed = np.tril(np.ones((len(steps), len(steps))))
    spread = summed @ np.diag([each.variance + each.one_sided for each in ratios]) @ summed.T
    exponents, prior = _EXPONENTS, np.diag(1 / _SPREAD**2)
    for _ in range(4):  # errors are those of codes: light's depend on the slope
        slope = exponents[0] + 2 * exponents[1] * codes
        weight = np.linalg.inv(slope[:, None] * spread * slope)
        covariance = np.linalg.inv(rows.T @ weight @ rows + prior)
        exponents = covariance @ (rows.T @ weight @ lights + prior @ _EXPONENTS)
    degrees = min(each.degrees for each in ratios)
    return Response(exponents, covariance, degrees, tuple(lights / codes))


@final
@dataclass(frozen=True)
class Shares:
    """What one eye, or both, set of R, G and B.

    Parameters
    ----------
    eye
        Who looked.
    response
        Of the display that it looked at.
    value
        (primary,) share of full light.
    error
        (primary,) standard error, such that 1.96 of it to either side hold 95 %: Student's t is
        counted in.
    correlation
        (primary, primary) of errors: all rest on one response.
    means
        How each was set.
    """

    eye: Eye
    response: Response
    value: Floats
    error: Floats
    correlation: Floats
    means: tuple[Mean, ...]


@final
@dataclass(frozen=True)
class Estimate:
    """What a session tells.

    Parameters
    ----------
    shares
        Of each eye.
    learning, learning_error
        By how much the last setting of a share differs from the first one, over the share, and its
        standard error.
    apart
        By how much settings from above are above those from below, over the share, median.
    slips
        How many settings were left out.
    """

    shares: tuple[Shares, ...]
    learning: float
    learning_error: float
    apart: float
    slips: int


def estimated(settings: Sequence[Settings]) -> Estimate:
    """What settings tell.

    Parameters
    ----------
    settings
        Of all blocks of a session.
    """
    matches = [each for each in settings if each.block.task == "match"]
    nulls = [each for each in settings if each.block.task == "null"]
    ratios = means_of(
        [np.log(np.maximum(each.code, 1e-3) / each.base) for each in matches],
        [each.above for each in matches],
        STEP,
    )
    eyes = list(dict.fromkeys(each.block.eye for each in settings))
    responses = {
        eye: response_of(
            [mean for mean, of in zip(ratios, matches, strict=True) if of.block.eye == eye]
        )
        for eye in eyes
    }
    lights = [_answered(each, responses[each.block.eye]) for each in nulls]
    units = [_unit(each, responses[each.block.eye]) for each in nulls]
    means = means_of(
        [light / unit for light, unit in zip(lights, units, strict=True)],
        [each.above for each in nulls],
        STEP * float(_EXPONENTS[0]),
    )
    found = [
        _shares(
            eye,
            responses[eye],
            [
                (of, mean, unit)
                for of, mean, unit in zip(nulls, means, units, strict=True)
                if of.block.eye == eye
            ],
        )
        for eye in eyes
    ]
    slips = sum(each.slips for each in (*ratios, *means))
    apart = float(np.median([mean.apart / max(mean.value, 1e-9) for mean in means]))
    return Estimate(tuple(found), *_learning(nulls, means, lights, units), apart, slips)


def _answered(settings: Settings, response: Response, exponents: Floats | None = None) -> Floats:
    """(setting,) light that answers what is nulled."""
    light = response.light(settings.code, exponents)
    if settings.block.eye == "both":
        return light
    return response.light(settings.base, exponents) - light


def _unit(settings: Settings, response: Response) -> float:
    """Light by which settings' noise is alike: the grey's, as contrast is seen; or their own."""
    light = settings.code if settings.block.eye == "both" else settings.base
    return float(np.median(response.light(light)))


def _shares(eye: Eye, response: Response, nulls: Sequence[tuple[Settings, Mean, float]]) -> Shares:
    units = np.array([unit for _, _, unit in nulls])
    noise = np.array([mean.variance for _, mean, _ in nulls]) * units**2
    own = noise + np.array([mean.one_sided for _, mean, _ in nulls]) * units**2
    degrees = np.array([mean.degrees for _, mean, _ in nulls])
    slopes = np.array([_slope(of, mean, response) for of, mean, _ in nulls])
    shared = slopes @ response.covariance @ slopes.T
    covariance = np.diag(own) + shared
    total = np.diag(covariance)
    # Welch and Satterthwaite's degrees of freedom
    tails = noise**2 / degrees + np.diag(shared) ** 2 / response.degrees
    wider = scipy.stats.t.ppf(0.975, total**2 / tails) / SIGMAS
    return Shares(
        eye,
        response,
        units * np.array([mean.value for _, mean, _ in nulls]),
        np.sqrt(total) * wider,
        covariance / np.sqrt(np.outer(total, total)),
        tuple(mean for _, mean, _ in nulls),
    )


def _slope(settings: Settings, mean: Mean, response: Response) -> Floats:
    """(2,) change of a share by the response's exponents."""

    def share(exponents: Floats) -> float:
        return _middle(_answered(settings, response, exponents), settings.above, mean.kept)

    steps = 1e-4 * np.eye(2)
    at = response.exponents
    return np.array([(share(at + step) - share(at - step)) / 2e-4 for step in steps])


def _middle(values: Floats, above: Flags, kept: Flags) -> float:
    """Mean of both sides' means."""
    return float(values[above & kept].mean() + values[~above & kept].mean()) / 2


def _learning(
    nulls: Sequence[Settings],
    means: Sequence[Mean],
    lights: Sequence[Floats],
    units: Sequence[float],
) -> tuple[float, float]:
    """How much settings change from the first to the last of a block, over its share."""
    orders, changes = [], []
    for of, mean, light, unit in zip(nulls, means, lights, units, strict=True):
        share = max(unit * mean.value, 1e-9)
        for side in (of.above, ~of.above):
            mine = np.flatnonzero(side & mean.kept)
            orders.append(mine - mine.mean())
            changes.append((light[mine] - light[mine].mean()) / share)
    order, change = np.concatenate(orders), np.concatenate(changes)
    power = float(order @ order)
    slope = float(order @ change) / power
    left = change - slope * order
    variance = float(left @ left) / (len(order) - 2 * len(nulls) - 1)
    last = 2 * EACH - 1
    return slope * last, float(np.sqrt(variance / power)) * last
