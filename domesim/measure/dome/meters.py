"""A dome by a meter alone: its light and its reflected share, by the closed form of a bare dome.

With direct white W (cd/m²), a pattern's share b of the screen's light, and q, the reflected light
of a white picture over its direct light (`domesim.observation.spherical.bare_gain`), the screen
shows W (a + q b) under a pattern: a is 1 where it is lit and 0 where it is not, and what is
reflected is the same everywhere. Black adds what it is. So

    luminance of a place                W (a + q b) + K
    lux on the screen there             pi/rho (W (a + q b)) + K
    lux in the middle, towards the      W (∫ a cos dω + q b ∫ cos dω) + K
    dome's zenith

A place that is lit by one half of the screen and not by the other tells q without any scale:
(q/2) / (1 + q/2). In the middle rings do, whose direct light goes with the cosine and whose
reflected light with their area. One picture alone tells W (1 + q): then the albedo is taken as
described, and white follows within its error. A colorimeter that read the primaries, too, tells
q of each.

Light of a projector is not even, and a lux meter's response is not the cosine. Both are nuisances
of mean 0 (`UNEVEN`, `COSINE`); readings have the noise that repeats show or that is stated, and
half a digit.

The albedo is not the paint's but that of a bare dome that reflects as much as the room does, with
its floor and its seats.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, brentq, least_squares
from scipy.stats import chi2

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.light.ties import ascending
from domesim.measure.dome.fit import BRIGHTEST, Known, inverse
from domesim.measure.dome.meter_table import MIDDLE, SIDES, MeterTask, Reading, patterns_of
from domesim.observation.spherical import bare_gain
from domesim.observation.uncertain import SIGMAS
from domesim.room.lenses import lens_gains
from domesim.scene import DomeScene
from domesim.scene.fields import three

Floats = NDArray[np.float64]

UNEVEN = 0.05
"""Rms of a projector's light over the screen, about its mean: smooth (spherical harmonics up to
degree 3, isotropic), and else unknown."""
COSINE = 0.03
"""How much a lux meter may over- or underrate light from the side: class B of DIN 5032-7."""
DESCRIBED = 0.25
"""Standard error of a described albedo where the readings do not tell it: it may be any paint's."""
TELLING = 0.3
"""Half of a 95 % interval from which readings do not tell an albedo."""
LARGEST_MODEL_ERROR = 0.1
"""Relative error of the model at each reading from which nothing is answered."""

_SIZE, _DEGREE = 256, 3
_HEIGHTS, _ASIDE = (0.35, 0.5, 0.65), 5.0
"""Where a place on the screen may be: shares of the half-angle, and degrees to either side."""
_PRIMARIES = {"red": (1.0, 0.0, 0.0), "green": (0.0, 1.0, 0.0), "blue": (0.0, 0.0, 1.0)}
_DARKEST, _EXACT = 0.02, 1e-6
_CHANCE = 1e-3


@final
@dataclass(frozen=True, eq=False)
class Metered:
    """What a meter told of a dome.

    Attributes
    ----------
    white, white_error
        Direct light of a white picture, cd/m², and its standard error.
    albedo, albedo_error
        (primary,) of a bare dome that reflects as much, and standard errors.
    correlations
        (white and each primary's albedo, the same).
    of_primaries
        Whether primaries were read; else one albedo stands for all.
    assumed
        The described albedo, where the readings do not tell it; else None.
    black, black_error
        Light of a black picture, cd/m², and its standard error.
    bounds
        Least and largest direct white, cd/m², whatever albedo the screen has, if that is assumed.
    chi2, degrees, model_error
        Of the fit by noise alone; relative error of the model that was added.
    """

    white: float
    white_error: float
    albedo: Floats
    albedo_error: Floats
    correlations: Floats
    of_primaries: bool
    assumed: float | None
    black: float
    black_error: float
    bounds: tuple[float, float] | None
    chi2: float
    degrees: int
    model_error: float

    @property
    def darkest(self) -> float:
        """Below that a black picture is not told, cd/m²."""
        return SIGMAS * self.black_error

    @property
    def black_told(self) -> bool:
        """Whether the meter saw a black picture at all."""
        return self.black > self.darkest


def metered(task: MeterTask) -> Metered:
    """White and albedo as readings tell them.

    Raises
    ------
    InputError
        If no picture and no black was read at one place, or readings contradict each other.
    """
    seen = _seen(task)
    problem = _Problem(task, seen)
    solution = problem.solved()
    noise = problem.misfit(solution)
    if problem.degrees > 0 and chi2.sf(noise, problem.degrees) < _CHANCE:
        solution = problem.allowed_for(solution)
    found = problem.answers(solution, noise)
    if (SIGMAS * found.albedo_error < TELLING).all():
        return found
    # The readings leave the albedo open
    described = _albedo_of(task.scene)

    def held(albedo: float, error: float) -> Metered:
        problem = _Problem(task, seen, Known(three(albedo), three(error), assumed=True))
        return problem.answers(problem.solved(), noise)

    low, high = sorted(held(rho, _EXACT).white for rho in (_DARKEST, BRIGHTEST))
    return replace(held(described, DESCRIBED), assumed=described, bounds=(low, high))


# The fit.


@final
@dataclass(frozen=True, eq=False)
class _Share:
    """What of a picture a meter reads at a place: its direct and its reflected light.

    Both go with 1 + the nuisances' values times the effects.
    """

    direct: float
    direct_effects: Floats
    reflected: float
    reflected_effects: Floats


@final
@dataclass(frozen=True, eq=False)
class _Seen:
    """Readings that count, what of a picture each saw, and the screen's projected angle, sr.

    Where not all primaries were read in colour, luminance of white is all that counts.
    """

    readings: tuple[Reading, ...]
    shares: tuple[_Share, ...]
    projected: float
    of_primaries: bool


def _seen(task: MeterTask) -> _Seen:
    """Readings that count.

    Raises
    ------
    InputError
        If no picture was read, or no black at some place.
    """
    coloured = {one.pattern for one in task.readings if len(one.value) > 1}
    of_primaries = set(_PRIMARIES) <= coloured
    readings = task.readings
    if not of_primaries:
        readings = tuple(
            replace(one, value=one.value[len(one.value) // 2 :][:1])
            for one in readings
            if one.pattern not in _PRIMARIES
        )
    field = _Field(task.scene)
    each = {(one.pattern, one.place): one for one in readings}
    shares = {key: field.share(one) for key, one in each.items()}
    if not any(share.direct > 0 for share in shares.values()):
        raise InputError("wanted a reading of a lit picture, such as white, got none")
    for place in dict.fromkeys(one.place for one in readings):
        if ("black", place) not in each:
            raise InputError(f"place {place}: no reading of black; read it there, too")
    return _Seen(
        readings,
        tuple(shares[one.pattern, one.place] for one in readings),
        field.projected,
        of_primaries,
    )


@final
class _Field:
    """The screen in small: its light, and how it may be uneven."""

    def __init__(self, scene: DomeScene) -> None:
        self.dome = dome = scene.dome
        self.patterns = patterns_of(dome)
        self.gain = lens_gains(scene.theatre, _SIZE, _SIZE).sum(0)
        self.areas = dome.screen_areas(_SIZE, _SIZE)
        directions = dome.directions(_SIZE, _SIZE)
        away = dome.distance(directions)
        facing = np.sum(dome.normals(directions) * directions, -1)
        self.angles = self.areas * np.abs(facing) / away**2  # sr, from the middle
        self.cosine = np.maximum(directions[..., 2], 0.0)
        self.projected = float(np.sum(self.angles * self.cosine))  # sr
        self.modes = self._uneven(directions)

    def _uneven(self, directions: Floats) -> Floats:
        """(mode, row, col) of mean 0 over the screen: an isotropic field of rms `UNEVEN`."""
        x, y, z = np.moveaxis(directions, -1, 0)
        polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
        waves: list[Floats] = []
        for degree, order in itertools.product(range(1, _DEGREE + 1), range(_DEGREE + 1)):
            if order <= degree:
                wave = scipy.special.sph_harm_y(degree, order, polar, azimuth)
                waves += [wave.real] if order == 0 else [2**0.5 * wave.real, 2**0.5 * wave.imag]
        weight = self.areas / self.areas.sum()
        modes = np.stack(waves)
        modes = modes - np.sum(modes * weight, (1, 2), keepdims=True)
        return np.asarray(UNEVEN * modes / np.sqrt(np.sum(modes**2 * weight)))

    def share(self, one: Reading) -> _Share:
        """What of a pattern a meter reads.

        Raises
        ------
        InputError
            If the pattern's edge is at the place.
        """
        pattern = self.patterns[one.pattern]
        lit = pattern.mask(_SIZE, _SIZE)[0] * max(pattern.colours[0]) * self.gain
        sent = lit * self.areas / np.sum(self.gain * self.areas)
        reflected = float(sent.sum())
        of_reflected = self._effects(self.modes, sent)
        if one.place != MIDDLE:
            row, col = self._place(one.place)
            direct = float(np.mean(lit[row, col]))
            if len(set((lit[row, col] > 0).tolist())) > 1:
                raise InputError(
                    f"the edge of {one.pattern} is at the place {one.place}: read it where it is "
                    f"wholly lit, or wholly dark"
                )
            sideways = COSINE if one.lux else 0.0
            effects = np.append(self.modes[:, row[0], col[0]], sideways)
            return _Share(direct, effects, reflected, np.append(of_reflected, 0.0))
        seen = self.angles * self.cosine
        direct = lit * seen
        side = COSINE * (1 - self.cosine**2)[None]
        of_direct = self._effects(np.concatenate([self.modes, side]), direct)
        of_side = float(np.sum(side * seen) / self.projected)
        of_reflected = np.append(of_reflected, of_side)
        return _Share(float(direct.sum()), of_direct, reflected * self.projected, of_reflected)

    def _place(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pixels round a place on the screen, its middle first."""
        azimuth = np.radians(SIDES[name] + np.array([0.0, 0, 0, -_ASIDE, _ASIDE]))
        lean = self.dome.half_angle * np.array([_HEIGHTS[1], _HEIGHTS[0], _HEIGHTS[2]] + [0.5] * 2)
        x, y = np.sin(lean) * np.cos(azimuth), np.sin(lean) * np.sin(azimuth)
        return self.dome.pixel_of(np.stack([x, y, np.cos(lean)], -1), _SIZE)

    @staticmethod
    def _effects(modes: Floats, weight: Floats) -> Floats:
        total = float(weight.sum())
        return np.sum(modes * weight, (1, 2)) / total if total > 0 else np.zeros(len(modes))


@final
class _Problem:
    """Residuals of readings.

    Parameters: direct white (primary, channel), albedos (primary,), black (place, channel), and
    nuisances. One primary stands for white where primaries were not read.
    """

    def __init__(self, task: MeterTask, seen: _Seen, known: Known | None = None) -> None:
        self._known, self._readings, self._shares = known, seen.readings, seen.shares
        self._projected = seen.projected
        self._described = _albedo_of(task.scene)
        self._gain_of = partial(bare_gain, dome=task.scene.dome)
        self.of_primaries = seen.of_primaries
        self._channels, self._primaries = (3, 3) if self.of_primaries else (1, 1)
        self._lux = self._readings[0].lux
        self._nuisances = len(self._shares[0].direct_effects)
        self._places = list(dict.fromkeys(one.place for one in self._readings))
        self._at = np.array([self._places.index(one.place) for one in self._readings])
        amounts = [_PRIMARIES.get(one.pattern, (1.0, 1.0, 1.0)) for one in self._readings]
        self._amounts = np.array(amounts)[:, : self._primaries]
        self._direct, self._reflected = (
            np.array([getattr(share, name) for share in self._shares])
            for name in ("direct", "reflected")
        )
        self._direct_effects, self._reflected_effects = (
            np.stack([getattr(share, f"{name}_effects") for share in self._shares])
            for name in ("direct", "reflected")
        )
        lux_there = [one.lux and one.place != MIDDLE for one in self._readings]
        self._on_screen = np.array(lux_there)
        self._values = np.stack([one.value for one in self._readings])
        self._variance = task.noise.variance(self._values)
        self._model_error = 0.0

    @property
    def degrees(self) -> int:
        """Degrees of freedom: the number of readings less those of what is looked for."""
        free = self._primaries * self._channels + len(self._places) * self._channels
        return int(self._values.size) - free - (0 if self._known else self._primaries)

    def solved(self) -> OptimizeResult:
        """The best fit."""
        white, primaries = self._channels * self._primaries, self._primaries
        rest = len(self._places) * self._channels + self._nuisances
        start = np.zeros(white + primaries + rest)
        start[:white] = self._first_white().ravel()
        start[white : white + primaries] = (
            self._described if self._known is None else self._known.value[0]
        )
        low = np.full(len(start), -np.inf)
        high = np.full(len(start), np.inf)
        low[white : white + primaries], high[white : white + primaries] = _DARKEST / 2, 0.99
        return least_squares(
            self._residual, start, bounds=(low, high), x_scale="jac", xtol=1e-12, ftol=1e-12
        )

    def misfit(self, solution: OptimizeResult) -> float:
        """Chi² of readings and nuisances."""
        return float(solution.fun @ solution.fun)

    def allowed_for(self, solution: OptimizeResult) -> OptimizeResult:
        """The best fit with a model error that makes chi² equal its degrees of freedom.

        Raises
        ------
        InputError
            If that is beyond `LARGEST_MODEL_ERROR`, with the reading that fits least.
        """
        before = solution

        def excess(logarithm: float) -> float:
            nonlocal solution
            self._model_error = float(np.exp(logarithm))
            solution = self.solved()
            return self.misfit(solution) - self.degrees

        if excess(np.log(LARGEST_MODEL_ERROR)) > 0:
            raise InputError(self._contradiction(before))
        found = brentq(excess, np.log(1e-5), np.log(LARGEST_MODEL_ERROR), xtol=1e-3)
        excess(float(found))
        return solution

    def answers(self, solution: OptimizeResult, noise: float) -> Metered:
        """The fitted figures."""
        x, primaries, channels = solution.x, self._primaries, self._channels
        covariance = inverse(solution.jac, np.maximum(np.abs(x), 0.1))
        luminance = channels // 2  # Y of XYZ
        direct, albedo, black, _ = self._parts(x)
        white = float(direct[:, luminance].sum())
        at_white = np.zeros((1 + primaries, len(x)))
        at_white[0, luminance : primaries * channels : channels] = 1
        at_white[1:, primaries * channels :][:, :primaries] = np.eye(primaries)
        own = at_white @ covariance @ at_white.T
        mine = [0, 1, 2, 3] if self.of_primaries else [0, 1, 1, 1]
        own = own[np.ix_(mine, mine)]
        spread = np.sqrt(np.diag(own))
        scales = np.array([self._black_scale(place, albedo) for place in self._places])
        first = primaries * (channels + 1) + luminance
        at = first + channels * np.arange(len(self._places))
        mean = scales / len(scales)
        return Metered(
            white=white,
            white_error=float(spread[0]),
            albedo=np.broadcast_to(albedo, 3).copy(),
            albedo_error=spread[1:],
            correlations=own / np.outer(spread, spread),
            of_primaries=self.of_primaries,
            assumed=None,
            black=float(mean @ black[:, luminance]),
            black_error=float(np.sqrt(mean @ covariance[np.ix_(at, at)] @ mean)),
            bounds=None,
            chi2=noise,
            degrees=self.degrees,
            model_error=self._model_error,
        )

    def _black_scale(self, place: str, albedo: Floats) -> float:
        """Luminance of a black picture, over what was read of it."""
        if not self._lux:
            return 1.0
        return 1 / self._projected if place == MIDDLE else float(np.mean(albedo)) / np.pi

    def _parts(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Direct white (primary, channel), albedos, blacks (place, channel), nuisances."""
        white = self._primaries * self._channels
        after = white + self._primaries
        blacks = after + len(self._places) * self._channels
        return (
            x[:white].reshape(self._primaries, self._channels),
            x[white:after],
            x[after:blacks].reshape(len(self._places), self._channels),
            x[blacks:],
        )

    def _modelled(self, x: Floats) -> Floats:
        """(reading, channel) what the meter should say."""
        direct, albedo, black, odd = self._parts(x)
        q = np.array([self._gain_of(float(rho)) for rho in albedo])
        seen = self._direct * (1 + self._direct_effects @ odd)
        back = self._reflected * (1 + self._reflected_effects @ odd)
        light = seen[:, None] + q * back[:, None]
        light = np.where(self._on_screen[:, None], light * np.pi / albedo, light)
        return np.asarray((self._amounts * light) @ direct + black[self._at])

    def _residual(self, x: Floats) -> Floats:
        said = self._modelled(x)
        root = np.sqrt(self._variance + (self._model_error * self._values) ** 2)
        rows = [((said - self._values) / root).ravel(), self._parts(x)[3]]
        if self._known is not None:
            albedo = self._parts(x)[1]
            count = len(albedo)
            rows.append((albedo - self._known.value[:count]) / self._known.error[:count])
        return np.concatenate(rows)

    def _first_white(self) -> Floats:
        """(primary, channel) direct light by the brightest reading of each."""
        first = np.empty((self._primaries, self._channels))
        for p in range(self._primaries):
            alone = self._amounts[:, p] * (self._amounts.sum(1) == 1)
            brightest = int(ascending(-alone * self._values.sum(1), 0.0)[0])
            one, share = self._readings[brightest], self._shares[brightest]
            scale = share.direct + 0.3 * share.reflected
            if one.lux and one.place != MIDDLE:
                scale *= np.pi / self._described
            first[p] = self._values[brightest] / max(scale, 1e-3)
        return first

    def _contradiction(self, solution: OptimizeResult) -> str:
        """Which reading fits least, in words."""
        self._model_error = 0.0
        variance = self._variance.copy()
        left = []
        for at in range(len(self._readings)):
            self._variance = variance.copy()
            self._variance[at] = np.inf
            left.append(self.misfit(self.solved()))
        worst = int(ascending(left, 1e-6)[0])
        self._variance = variance.copy()
        self._variance[worst] = np.inf
        wanted = self._modelled(self.solved().x)[worst]
        self._variance = variance
        one = self._readings[worst]
        return (
            f"line {one.line}: {one.pattern} at {one.place} must be about "
            f"{decimal(float(wanted[self._channels // 2]))} by the other readings, got "
            f"{decimal(float(one.value[self._channels // 2]))}; is the row "
            f"wrong, or exchanged with another? Read it again"
        )


def _albedo_of(scene: DomeScene) -> float:
    """The described albedo, its holes counted in."""
    return float(np.clip(np.mean(scene.theatre.screen_albedo), _DARKEST, BRIGHTEST))
