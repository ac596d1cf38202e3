"""A display by its readings: primaries, white, black, and light by code value.

A reading without black lies along its primary's own XYZ vector M; its signal y = net·M/|M|, in
cd/m², is the light. The gamma model y = a code^gamma is fitted to the ramp of each primary by
generalised least squares (black, subtracted from all, makes their errors dependent). One gamma,
their weighted mean, is kept where it is within `MISFIT` of L* at every level, or within the noise;
else the ramp itself becomes a table, made to rise by isotonic regression where it dips by less than
the noise. A real CRT, for instance, has an offset that a pure power cannot follow near black.

What does not fit together is reported, with lines: additivity, W - K against (R - K) + (G - K) +
(B - K); readings below black; ramps that fall or jump; a primary that changes colour with level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import curve_fit, isotonic_regression
from scipy.stats import chi2

from domesim.host.numbers import decimal, ratio
from domesim.light.transfer import Gamma, MeasuredTable, Transfer
from domesim.readings.meter import Mean, Session, words
from domesim.readings.tables import Mistakes

Floats = NDArray[np.float64]

ADDITIVITY_WARNING, ADDITIVITY_LIMIT = 0.02, 0.10
"""Shares of W by which R + G + B may miss it: beyond the first it is told, beyond the second
refused (a white segment, or rows that are wrong)."""
SIGMAS = 4.0
"""Differences up to this many standard errors are noise: so many are looked at that 3 would refuse
one good rig in fifty."""
CHANCE = 1e-3
"""Probability of the residuals below which noise does not explain them, and weighting levels by
their noise has no sense: then each counts the same."""
MISFIT = 1.0
"""Largest error of the gamma model in CIE L* of the primary's own full light, about one step that
can be seen."""
DRIFT_WARNING, DRIFT_LIMIT = 0.01, 0.05
"""Change of chromaticity (CIE 1976 u'v') with level that is reported, and that is refused."""
DRIFT_FROM = 0.05
"""Share of full light below which chromaticity is too uncertain to judge."""
DEPENDENT = 1e3
"""Condition of the primaries' directions beyond which they are one colour; BT.709's is 3."""
MIN_LEVELS = 4
"""Levels of a ramp, full one included, below which no response is fitted."""
FLATTEST = 0.9
"""Share of full light that no display reaches at half the code."""
STEEPEST, STEEPEST_FROM = 8.0, 0.1
"""Local exponent that no display has, for levels from the second figure on: a jump."""


@final
@dataclass(frozen=True, eq=False)
class Response:
    """Code value -> linear light.

    Parameters
    ----------
    transfer
        A gamma for all primaries, or a table with a curve for each.
    exponents, errors
        (3,) gamma fitted to each primary alone, and its standard error.
    rms
        (3,) rms error of that fit, share of full light.
    misfit
        (3,) largest error of the common gamma beyond the noise, in L*.
    repaired
        What was levelled, in words.
    """

    transfer: Transfer
    exponents: Floats
    errors: Floats
    rms: Floats
    misfit: Floats
    repaired: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Display:
    """One projector through one filter.

    Parameters
    ----------
    name
        In words.
    primaries
        (XYZ, RGB) of full R, G and B, without black, cd/m².
    primaries_variance, black_variance
        (XYZ, RGB) of each reading's own error, and (XYZ,) of black's, which all share.
    white
        (XYZ,) of full white without black, cd/m²: read, or else R + G + B.
    black
        (XYZ,) cd/m²; None if it was not read.
    white_variance
        (XYZ,) of the reading (or sum), without black's.
    additivity, additivity_error
        (XYZ,) (W - R - G - B)/W and its standard error; None without a reading of W.
    drift
        (RGB,) largest change of u'v' chromaticity over the ramp; 0 without one.
    response
        None without ramps.
    notes
        What a person should know, a line each.
    """

    name: str
    primaries: Floats
    primaries_variance: Floats
    black_variance: Floats
    white: Floats
    white_variance: Floats
    black: Floats | None
    additivity: Floats | None
    additivity_error: Floats | None
    drift: Floats
    response: Response | None
    notes: tuple[str, ...]

    @property
    def chromaticities(self) -> Floats:
        """(RGBW, xy) CIE 1931."""
        colours = np.vstack([self.primaries.T, self.white])
        return np.asarray(colours[:, :2] / colours.sum(axis=1, keepdims=True))

    @property
    def scene_key(self) -> str | None:
        """``response`` of a scene's ``[projector]``, of white; None without ramps."""
        if self.response is None:
            return None
        curve = self.response.transfer
        if isinstance(curve, Gamma):
            return f'"{curve.exponent:.3f}"'
        assert isinstance(curve, MeasuredTable)
        light = curve.light @ (self.primaries[1] / self.primaries[1].sum())
        levels = zip(curve.codes, light, strict=True)
        return f"[{', '.join(f'[{code:.6g}, {shown:.6g}]' for code, shown in levels)}]"

    @property
    def contrast(self) -> float:
        """Luminance of white over that of black; infinite without black."""
        black = 0.0 if self.black is None else float(self.black[1])
        return float((self.white[1] + black) / black) if black else np.inf

    def report(self) -> list[str]:
        """Lines for a person."""
        white = f"white {decimal(self.white[1], 4)} cd/m²"
        dark = "black not read"
        if self.black is not None:
            dark = f"black {decimal(self.black[1])} cd/m², contrast {ratio(self.contrast)}"
        places = [
            f"{n} {x:.4f} {y:.4f}" for n, (x, y) in zip("RGBW", self.chromaticities, strict=True)
        ]
        lines = [f"{self.name}: {white}, {dark}", f"  chromaticities xy: {', '.join(places)}"]
        if self.additivity is not None and self.additivity_error is not None:
            parts = zip("XYZ", self.additivity, self.additivity_error, strict=True)
            told_parts = ", ".join(f"{n} {share:+.1%} ± {error:.1%}" for n, share, error in parts)
            lines.append(f"  W against R + G + B: {told_parts}")
        if self.response is not None:
            lines.append(f"  response: {_response_in_words(self.response)}")
            lines.append(f"  [projector] of a scene: response = {self.scene_key}")
            if self.drift.any():
                lines.append(
                    f"  chromaticity moves by up to {self.drift.max():.4f} (u'v') with level"
                )
        return [*lines, *(f"  {note}" for note in self.notes)]


def _response_in_words(response: Response) -> str:
    fits = zip("RGB", response.exponents, response.errors, response.rms, strict=True)
    gammas = ", ".join(f"{n} {g:.3f} ± {e:.3f} (rms {r:.2%})" for n, g, e, r in fits)
    if isinstance(response.transfer, Gamma):
        return f"gamma {response.transfer.exponent:.3f}; {gammas}"
    return (
        f"a table, for a gamma misses by up to {response.misfit.max():.1f} L*; "
        f"the best gammas are {gammas}"
    )


def measured_display(session: Session) -> Display:
    """The display that a session of readings shows.

    Parameters
    ----------
    session
        Readings of R, G and B at level 1, of K unless black was subtracted, and optionally of W
        and of ramps.

    Raises
    ------
    InputError
        If readings are missing, or with everything that does not fit together, each with its line.
    """
    mistakes = Mistakes(session.source)
    display = checked_display(session, mistakes)
    mistakes.raise_any()
    assert display is not None
    return display


def checked_display(
    session: Session, mistakes: Mistakes, *, with_response: bool = True
) -> Display | None:
    """Returns the display of a session, or None, having noted what is wrong in `mistakes`.

    Parameters
    ----------
    session
        See `measured_display`.
    mistakes
        Those of the file so far.
    with_response
        Whether to fit ramps.
    """
    before = len(mistakes.found)
    full = [mean for channel in "RGB" if (mean := _full(session, channel, mistakes)) is not None]
    if session.dark is None and session.black == "included":
        mistakes.add(
            0, f"{session.name}: no reading of K; measure it, or say that black is subtracted"
        )
    _note_darker_than_black(session, mistakes)
    if len(mistakes.found) > before:
        return None
    primaries = np.stack([session.net(mean) for mean in full], axis=1)
    _note_dependent(session, primaries, mistakes)
    if len(mistakes.found) > before:
        return None
    notes: list[str] = []
    white = session.full("W")
    additivity, error = None, None
    if white is None:
        notes.append("additivity: not checked, there is no reading of W; white is R + G + B")
    else:
        additivity, error = _additivity(session, full, white, notes, mistakes)
    ramps = [_ramp(session, channel, mistakes) for channel in "RGB"]
    drift = np.array([_drift(session, ramp, notes, mistakes) for ramp in ramps])
    curves = ramps if all(len(ramp) >= MIN_LEVELS for ramp in ramps) else []
    grey = () if curves else _ramp(session, "W", mistakes)
    if len(mistakes.found) > before:
        return None
    if with_response and len(grey) >= MIN_LEVELS:
        curves = [grey, grey, grey]
        notes.append("response: from the ramp of W, taken to hold for each primary")
    elif with_response and not curves:
        notes.append(f"response: not fitted, there are no ramps of {MIN_LEVELS} levels or more")
    response = _fitted(session, curves) if with_response and curves else None
    if response is not None:
        notes += response.repaired
    return Display(
        name=session.name,
        primaries=primaries,
        primaries_variance=np.stack([mean.variance for mean in full], axis=1),
        black_variance=session.dark_variance,
        white=primaries.sum(axis=1) if white is None else session.net(white),
        white_variance=np.sum([mean.variance for mean in ([white] if white else full)], axis=0),
        black=None if session.dark is None else session.dark.xyz,
        additivity=additivity,
        additivity_error=error,
        drift=drift,
        response=response,
        notes=tuple(notes),
    )


def _full(session: Session, channel: str, mistakes: Mistakes) -> Mean | None:
    mean = session.full(channel)
    if mean is None:
        mistakes.add(0, f"{session.name}: no reading of {channel} at level 1; measure it")
    return mean


def _note_darker_than_black(session: Session, mistakes: Mistakes) -> None:
    dark = session.dark
    if dark is None or session.black == "subtracted":
        return
    colours = [mean for name, means in session.means.items() if name != "K" for mean in means]
    darker = []
    for mean in colours:
        noise = SIGMAS * np.sqrt(mean.variance + dark.variance)
        if (mean.xyz < dark.xyz - noise).any():
            darker.append(mean)
    for mean in darker[:1]:
        more = f" (and {len(darker) - 1} more readings)" if len(darker) > 1 else ""
        mistakes.add(
            mean.lines[0],
            f"{session.name}: {mean.place} must not be darker than black, got XYZ "
            f"{words(mean.xyz)} below K {words(dark.xyz)} of line {dark.lines[0]}{more}; if black "
            f"is subtracted already, say so (black: subtracted; as an option, --black subtracted), "
            f"else measure again",
        )


def _note_dependent(session: Session, primaries: Floats, mistakes: Mistakes) -> None:
    lengths = np.linalg.norm(primaries, axis=0)
    if not (lengths > 0).all():
        channel = "RGB"[int(np.argmin(lengths))]  # the first of those that are exactly 0
        mistakes.add(
            0, f"{session.name}: {channel} must be brighter than black, got no light; measure again"
        )
        return
    condition = float(np.linalg.cond(primaries / lengths))
    if condition > DEPENDENT:
        mistakes.add(
            0,
            f"{session.name}: R, G and B must be different colours, got nearly the same "
            f"(condition {condition:.0f}); are channels mixed up?",
        )


def _additivity(
    session: Session, full: list[Mean], mean: Mean, notes: list[str], mistakes: Mistakes
) -> tuple[Floats, Floats]:
    """(XYZ,) by how much W misses the sum, as a share of W, and its standard error."""
    white = session.net(mean)
    if not (white > 0).all():
        mistakes.add(
            mean.lines[0],
            f"{session.name}: W must be brighter than black, got XYZ {words(white)} without black; "
            f"measure again, or leave the row out",
        )
        return np.zeros(3), np.zeros(3)
    miss = white - np.sum([session.net(part) for part in full], axis=0)
    # Black is subtracted three times on one side and once on the other.
    own = np.sum([part.variance for part in [mean, *full]], axis=0)
    error = np.sqrt(own + 4 * session.dark_variance)
    share = miss / white
    told_share = ", ".join(f"{n} {s:+.1%}" for n, s in zip("XYZ", share, strict=True))
    real = np.abs(miss) > SIGMAS * error
    if (real & (np.abs(share) > ADDITIVITY_LIMIT)).any():
        way_out = (
            "switch off white boost and colour modes, or look for a wrong row or unit"
            if not _holds_black(session, miss, white, error)
            else "black is in these readings, once in W and three times in the sum: leave 'black = "
            '"subtracted"\' out. Whether pictures keep it, [grade] black of the scene says'
        )
        mistakes.add(
            mean.lines[0],
            f"{session.name}: W must be R + G + B within {ADDITIVITY_LIMIT:.0%}, got "
            f"{told_share} (W less black against the sum); {way_out}",
        )
    elif (np.abs(share) > ADDITIVITY_WARNING).any():
        notes.append(
            f"additivity: R + G + B misses W by more than {ADDITIVITY_WARNING:.0%}: {told_share}"
            f"{'' if real.any() else ', which may be noise'}"
        )
    return share, np.asarray(error / white)


def _holds_black(session: Session, miss: Floats, white: Floats, error: Floats) -> bool:
    """Whether readings that are said to be without black add up once it is subtracted."""
    if session.black != "subtracted" or session.dark is None:
        return False
    left = np.abs(miss + 2 * session.dark.xyz)
    return bool((left <= np.maximum(SIGMAS * error, ADDITIVITY_WARNING * white)).all())


def _ramp(session: Session, channel: str, mistakes: Mistakes) -> tuple[Mean, ...]:
    """The levels of a channel, if they rise as a display's do."""
    ramp = session.means.get(channel, ())
    full = session.full(channel)
    # White that is black is refused elsewhere.
    if full is None or not session.net(full).any():
        return ()
    y, variance, _ = _signal(session, ramp)
    for i, (low, high) in enumerate(pairwise(ramp)):
        noise = SIGMAS * float(np.sqrt(variance[i] + variance[i + 1]))
        got = (
            f"got {decimal(y[i], 4)} then {decimal(y[i + 1], 4)} for {channel} from level "
            f"{low.level:g} (line {low.lines[0]}) to {high.level:g}"
        )
        if y[i + 1] < y[i] - noise:
            mistakes.add(
                high.lines[0],
                f"{session.name}: light must rise with level, {got}, beyond the noise "
                f"({decimal(noise, 2)}); is a row wrong, exchanged or in another unit?",
            )
        elif low.level >= STEEPEST_FROM:
            steepest = (high.level / low.level) ** STEEPEST
            if y[i + 1] > steepest * (y[i] + noise) + noise:
                mistakes.add(
                    high.lines[0],
                    f"{session.name}: light must rise smoothly, {got}; is a row wrong or in "
                    f"another unit?",
                )
    for mean, light in zip(ramp, y, strict=True):
        if mean.level <= 0.5 and light > FLATTEST * y[-1]:
            mistakes.add(
                mean.lines[0],
                f"{session.name}: {mean.place} must be well below full light, got "
                f"{decimal(light, 4)} of {decimal(y[-1], 4)}; did the picture change?",
            )
            break
    return ramp


def _signal(session: Session, ramp: Sequence[Mean]) -> tuple[Floats, Floats, float]:
    """(level,) light along the primary, its own variance, and the variance that black adds."""
    direction = session.net(ramp[-1])
    direction = direction / np.linalg.norm(direction)
    y = np.array([session.net(mean) @ direction for mean in ramp])
    variance = np.array([mean.variance @ direction**2 for mean in ramp])
    return y, variance, float(session.dark_variance @ direction**2)


def _drift(session: Session, ramp: Sequence[Mean], notes: list[str], mistakes: Mistakes) -> float:
    if len(ramp) < 2 or ramp[-1].level != 1:
        return 0.0
    full = session.net(ramp[-1])
    largest, place = 0.0, ramp[-1]
    for mean in ramp[:-1]:
        net = session.net(mean)
        share = float(net @ full / (full @ full))
        error = np.sqrt(mean.variance + session.dark_variance + share**2 * ramp[-1].variance)
        if share < DRIFT_FROM or (np.abs(net - share * full) <= SIGMAS * error).all():
            continue
        drift = float(np.linalg.norm(uv(net) - uv(full)))
        if drift > DRIFT_LIMIT:
            mistakes.add(
                mean.lines[0],
                f"{session.name}: {mean.place} must have the colour of full {mean.channel}, got "
                f"XYZ {words(net)} without black, u'v' {drift:.2f} off; is the row another "
                f"channel's?",
            )
        if drift > largest:
            largest, place = drift, mean
    if DRIFT_WARNING < largest <= DRIFT_LIMIT:
        notes.append(
            f"{place.channel} changes colour with level: u'v' {largest:.3f} off at {place.level:g} "
            f"(line {place.lines[0]})"
        )
    return largest


def uv(xyz: ArrayLike) -> Floats:
    """(..., 2) CIE 1976 u'v' chromaticity of (..., 3) XYZ."""
    x, y, z = np.moveaxis(np.asarray(xyz, np.float64), -1, 0)
    return np.asarray(np.stack([4 * x, 9 * y], -1) / (x + 15 * y + 3 * z)[..., None])


def _fitted(session: Session, ramps: Sequence[Sequence[Mean]]) -> Response:
    fits = [_GammaFit.of(session, ramp) for ramp in ramps]
    weights = np.array([1 / fit.error**2 for fit in fits])
    exponents = np.array([fit.exponent for fit in fits])
    common = float(weights @ exponents / weights.sum())
    misfit = np.array([fit.misfit(common) for fit in fits])
    transfer: Transfer = Gamma(common)
    repaired: list[str] = []
    if misfit.max() > MISFIT:
        transfer, repaired = _table(session, ramps)
    return Response(
        transfer,
        exponents,
        np.array([fit.error for fit in fits]),
        np.array([fit.rms for fit in fits]),
        misfit,
        tuple(repaired),
    )


@final
@dataclass(frozen=True, eq=False)
class _GammaFit:
    """y = a code^exponent, fitted to one ramp."""

    codes: Floats
    y: Floats
    noise: Floats
    covariance: Floats
    exponent: float
    error: float

    @staticmethod
    def of(session: Session, ramp: Sequence[Mean]) -> _GammaFit:
        codes = np.array([mean.level for mean in ramp])
        y, variance, shared = _signal(session, ramp)
        noise = np.sqrt(variance + shared)
        covariance = np.diag(variance) + shared
        gain, exponent, error = _power(codes, y, covariance)
        residual = y - gain * codes**exponent
        misses = float(residual @ np.linalg.solve(covariance, residual))
        if chi2.sf(misses, len(y) - 2) < CHANCE:
            _, exponent, error = _power(codes, y, None)
            covariance = np.eye(len(y))
        return _GammaFit(codes, y, noise, covariance, exponent, error)

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean((self._relative(self.exponent) - self.y / self.y[-1]) ** 2)))

    def misfit(self, exponent: float) -> float:
        """Largest error in L* that the noise does not explain."""
        model, seen = self._relative(exponent), self.y / self.y[-1]
        noise = SIGMAS * self.noise / self.y[-1]
        error = np.abs(_lightness(model) - _lightness(seen))
        return float(np.max(np.where(np.abs(model - seen) > noise, error, 0.0)))

    def _relative(self, exponent: float) -> Floats:
        """The model with its best gain, in units of the reading at full level."""
        shape = self.codes**exponent
        weighted = np.linalg.solve(self.covariance, shape)
        return np.asarray(shape * (weighted @ self.y) / (weighted @ shape) / self.y[-1])


def _power(codes: Floats, y: Floats, covariance: Floats | None) -> tuple[float, float, float]:
    """Gain, exponent and its standard error; from the residuals' size without a covariance."""
    fitted, spread = curve_fit(
        lambda code, gain, exponent: gain * code**exponent,
        codes,
        y,
        p0=(y[-1], 2.2),
        sigma=covariance,
        absolute_sigma=covariance is not None,
    )
    return float(fitted[0]), float(fitted[1]), float(np.sqrt(spread[1, 1]))


def _lightness(share: Floats) -> Floats:
    """CIE 1976 L* of light as a share of white."""
    return np.where(share > (6 / 29) ** 3, 116 * np.cbrt(share) - 16, (29 / 3) ** 3 * share)


def _table(session: Session, ramps: Sequence[Sequence[Mean]]) -> tuple[MeasuredTable, list[str]]:
    codes = np.unique([0.0, *(mean.level for ramp in ramps for mean in ramp)])
    curves, repaired = [], []
    for ramp in ramps:
        levels = np.array([0.0, *(mean.level for mean in ramp)])
        y, variance, _ = _signal(session, ramp)
        light = np.concatenate([[0.0], y / y[-1]])
        # Black is 0 by definition: nothing moves it.
        weights = np.concatenate([[1e6 / variance.min()], 1 / variance])
        fitted = isotonic_regression(light, weights=weights)
        blocks = fitted.blocks
        for first, last in pairwise(blocks):
            if last - first > 1:
                fall = float(np.max(-np.diff(light[first:last])))
                repaired.append(
                    f"{ramp[0].channel}: a dip of {fall:.2%} of full light from level "
                    f"{levels[first]:g} to {levels[last - 1]:g}, within the noise, was levelled"
                )
        # A level block becomes one point, so that the curve rises strictly.
        middle = np.array([levels[a:b].mean() for a, b in pairwise(blocks)])
        middle[0], middle[-1] = 0.0, 1.0
        knots = np.maximum(fitted.x[blocks[:-1]], 0.0)
        knots, rising = np.unique(knots / knots[-1], return_index=True)
        curves.append(np.interp(codes, middle[rising], knots ** (1 / 2.2)) ** 2.2)
    return MeasuredTable(codes, np.stack(curves, axis=1)), list(dict.fromkeys(repaired))
