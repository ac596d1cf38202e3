"""A dome theatre can be measured from photographs: albedos, and honest intervals for them.

Rationale
    Whoever compensates a real theatre needs its albedos. `domesim measure dome` fits them to
    photographs of test patterns by radiosity. Here the photographs are path-traced, with noise,
    vignetting and ambient light, by a camera that is not quite where it is said to be, over a floor
    that is not quite as deep as drawn; the fit knows only how large such errors may be. Random
    theatres tell whether its 95 % intervals hold the truth so often. Photographs that cannot tell
    albedo from gain must not be answered. And what counts in the end is the picture: compensate
    with what was measured, and look at it in the theatre as it is.
Expected
    With noise of 1 % a pixel: screen albedo within 0.5 % and floor albedo within 2 % (root mean
    square, and 95 of 100 theatres), 90 to 98 % of the intervals hold the truth (quick: chi-square
    of a few theatres not improbable), at most 60 CPU-seconds a theatre. White and black of the
    screen alone determine nothing, nor do patterns of one level. Compensated with the measured
    scene, the residual is within 10 % of what it is with the true one, and below that with the
    closed form.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from domesim.errors import InputError
from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.fit import Known, Survey
from domesim.measure.dome.model import RESOLUTION, nominal_albedos, surfaces_of
from domesim.measure.dome.nuisances import Errors
from domesim.measure.dome.photographs import Photographs
from domesim.measure.dome.run import survey_of
from domesim.observation.radiosity import radiosity
from domesim.observation.uncertain import SIGMAS
from domesim.pathtrace.tracer import Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Albedo, Floor, Theatre, Wall
from domesim.scene import DomeScene
from domesim.scene.fields import three
from domesim.scene.loading import scene_of_text
from domesim.scene.writing import as_toml
from testing.laboratory import (
    LEFT,
    NOISE,
    ORDINARY,
    Faults,
    left_over,
    night_and_day,
    patterns_for,
    photographed,
)
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    between,
    equal,
    require_tracer,
)

Floats = NDArray[np.float64]

ASSUMED = Errors()
"""What the fit is told; the laboratory's errors are drawn from the same."""
QUICK, FULL = 1, 100
"""Theatres."""
QUICK_RESOLUTION = 8
"""Resolution of radiosity in a quick run, at which floor albedos come out 0.2 % too large."""
PATTERN, PHOTOGRAPH, WALKS = 128, 96, 32
FIELD = np.radians(220.0)
MEASURED = ("gain", "screen", "floor")


@final
@dataclass(frozen=True)
class Trial:
    """One theatre.

    Attributes
    ----------
    off
        Parameter -> found over true less 1, one a primary.
    z
        Parameter -> found less true in standard errors, one a primary.
    width
        Parameter -> half of the 95 % interval over the value, one a primary.
    plausible
        Whether noise alone explained the residuals.
    model_error
        What was added to the noise.
    complete
        Whether all was answered.
    cpu_s
        CPU time of the fit, s.
    """

    off: dict[str, tuple[float, ...]]
    z: dict[str, tuple[float, ...]]
    width: dict[str, tuple[float, ...]]
    plausible: bool
    model_error: float
    complete: bool
    cpu_s: float


@final
@dataclass(frozen=True)
class Ambiguity:
    """A set of photographs, and what it determined.

    Attributes
    ----------
    answered
        Figures that were answered.
    asked
        Figures in all.
    said
        What was said of the others.
    off
        Largest relative error of the answered ones.
    """

    answered: int
    asked: int
    said: str
    off: float


@final
@dataclass(frozen=True)
class Residuals:
    """What is left of the pollution after compensation, rms over the screen, of white.

    Attributes
    ----------
    untouched
        Without compensation.
    truth, measured
        By the whole theatre's transport with true and with measured albedos.
    closed
        By the closed form with the described albedo.
    closed_measured
        By the closed form with the measured albedo.

    Negative where noise outweighs it (`rms_difference`).
    """

    untouched: float
    truth: float
    measured: float
    closed: float
    closed_measured: float


@final
@dataclass(frozen=True)
class Drawn:
    """A theatre as it is and as it is described, and the camera."""

    real: Theatre
    described: Theatre
    camera: Camera
    faults: Faults
    ambient: Albedo


def drawn(seed: int) -> Drawn:
    """A random theatre: with a floor and a wall below a leaning dome."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(3, 12)
    dome = Dome(radius, np.radians(rng.uniform(80, 90)), np.radians(rng.uniform(0, 15)))
    height = min(dome.lowest, 0.0) - rng.uniform(0.15, 0.35) * radius

    def albedo(low: float, high: float) -> Albedo:
        x, y, z = (float(value) for value in rng.uniform(low, high) * rng.uniform(0.85, 1.15, 3))
        return x, y, z

    wall = Wall(dome.widest, height, dome.lowest, albedo(0.05, 0.15))
    floor = Floor(height, dome.widest, albedo(0.05, 0.3))
    real = Theatre(dome, albedo(0.3, 0.75), floor=floor, wall=wall)
    drop = rng.normal() * ASSUMED.floor_m
    known = wall.albedo[0] * (1 + 0.3 * rng.normal())
    described = replace(
        real,
        albedo=(0.5, 0.5, 0.5),
        floor=Floor(height + drop, floor.radius, (0.15, 0.15, 0.15)),
        wall=Wall(wall.radius, height + drop, wall.top, (max(known, 0.02),) * 3),
    )
    x, y, z = (float(v) for v in rng.uniform((-0.1, -0.2, -0.08), (0.1, 0.0, 0.08)) * radius)
    return Drawn(
        real=real,
        described=described,
        camera=Camera((x, y, z), (x, y + 1.5, z + 1.0), FIELD),
        faults=Faults(
            noise=NOISE,
            gain=albedo(0.5, 1.0),
            vignetting=float(-rng.normal() * ASSUMED.vignetting),
            camera_m=three(rng.normal(size=3) * ASSUMED.camera_m),
            turn_deg=three(rng.normal(size=3) * ASSUMED.pointing_deg),
        ),
        ambient=albedo(0.0005, 0.005),
    )


def trial(seed: int, resolution: int = RESOLUTION) -> Trial:
    """Photograph and measure one random theatre."""
    case = drawn(seed)
    patterns = patterns_for(case.real.dome, PATTERN)
    shots = photographed(
        case.real,
        case.camera,
        patterns,
        case.faults,
        ambient=case.ambient,
        size=PHOTOGRAPH,
        walks=WALKS,
        seed=seed,
    )
    started = time.process_time()
    _, found = survey_of(
        case.described, patterns, shots, {}, ASSUMED, profile=False, resolution=resolution
    )
    seconds = time.process_time() - started
    truth = np.concatenate([[case.faults.gain], nominal_albedos(case.real)])

    def each(values: Floats) -> dict[str, tuple[float, ...]]:
        return {
            name: tuple(row.tolist())
            for name, row in zip(found.names, values, strict=True)
            if name in MEASURED
        }

    return Trial(
        off=each(found.value / truth - 1),
        z=each((found.value - truth) / found.error),
        width=each(SIGMAS * found.error / found.value),
        plausible=found.plausible,
        model_error=found.model_error,
        complete=found.complete,
        cpu_s=seconds,
    )


CASES: Mapping[str, tuple[tuple[int, ...], bool, bool]] = {
    "white": ((1,), True, False),
    "white and black, the screen only": ((0, 1), False, False),
    "white and black, the screen only, gain and floor known": ((0, 1), False, True),
}
"""Name -> patterns, whether the floor is seen, and whether gain and floor are known."""


def ambiguity(name: str, seed: int, resolution: int = RESOLUTION) -> Ambiguity:
    """What some photographs of a theatre determine."""
    case = drawn(seed)
    chosen, sees_floor, knows = CASES[name]
    patterns = patterns_for(case.real.dome, PATTERN)
    patterns = patterns[list(chosen)]
    shots = photographed(
        case.real, case.camera, patterns, case.faults, ambient=case.ambient, seed=seed
    )
    if not sees_floor:
        shots = _upper_part(case.described, shots)
    known = {}
    if knows:
        x, y, z = (float(0.01 * value) for value in case.faults.gain)
        known = {"gain": Known(case.faults.gain, (x, y, z)), "floor": _known_floor(case.real)}
    truth = np.concatenate([[case.faults.gain], nominal_albedos(case.real)])
    rows = [0, 1, 2]
    try:
        _, found = survey_of(case.described, patterns, shots, known, ASSUMED, resolution=resolution)
    except InputError as error:
        return Ambiguity(0, 9, str(error), 0.0)
    good = found.answered[rows]
    off = np.abs(found.value / truth - 1)[rows]
    return Ambiguity(
        int(good.sum()), good.size, _said(found), float(off[good].max()) if good.any() else 0.0
    )


def _said(found: Survey) -> str:
    return found.confusions[0] if found.confusions else "all determined"


def _known_floor(theatre: Theatre) -> Known:
    assert theatre.floor is not None
    return Known(theatre.floor.albedo)


def _upper_part(theatre: Theatre, shots: Photographs) -> Photographs:
    """The photographs where they show the screen; black elsewhere, whatever was there."""
    surface, _ = looked_at(theatre, shots.camera, *places_in(shots.light.shape[1]))
    kept = surface == SURFACES["screen"]
    return replace(shots, light=np.where(kept[..., None], shots.light, 0.0))


_PLAN: Mapping[str, Any] = {
    "name": "measured",
    "dome": {"radius_m": 6.0, "tilt_deg": 10.0},
    "screen": {"albedo": [0.6, 0.55, 0.5]},
    "floor": {"height_m": -2.2, "albedo": [0.25, 0.2, 0.15]},
    "wall": {"albedo": 0.1},
    "projector": {"white_cd_m2": 8.0},
    "viewing": {"adaptation_cd_m2": 0.8},
}


def _scene(albedos: Mapping[str, Sequence[float]]) -> DomeScene:
    content: dict[str, Any] = dict(_PLAN)
    for name, albedo in albedos.items():
        content[name] = {**content[name], "albedo": [float(value) for value in albedo]}
    scene = scene_of_text(as_toml(content), "plan", Path())
    assert isinstance(scene, DomeScene)
    return scene


def compensated(
    size: int, walks: int, seed: int, resolution: int = RESOLUTION
) -> tuple[Residuals, Residuals]:
    """Residuals of a night, part of which clips, and of a day, where nothing does."""
    real, described = _scene({}), _scene({"screen": [0.45] * 3, "floor": [0.1] * 3})
    patterns = patterns_for(real.dome, PATTERN)
    camera = Camera((0.2, -0.8, -0.3), (0.2, 0.7, 0.7), FIELD)
    shots = photographed(real.theatre, camera, patterns, ORDINARY, seed=seed)
    _, found = survey_of(
        described.theatre, patterns, shots, {}, ASSUMED, profile=False, resolution=resolution
    )
    surfaces = surfaces_of(described.theatre)
    measured = _scene(dict(zip(surfaces, found.value[1:], strict=True)))

    def whole(scene: DomeScene) -> DomeScene:
        return scene.with_transport(radiosity(scene.theatre, resolution=8))

    models = {
        "truth": whole(real),
        "measured": whole(measured),
        "closed": described,
        "closed_measured": measured,
    }
    tracer = Tracer(real.theatre)
    dark, bright = (
        Residuals(**left_over(tracer, picture, models, walks, seed))
        for picture in night_and_day(real, size, seed)
    )
    return dark, bright


def run(work: Work) -> Finding:
    """Measure theatres."""
    require_tracer()
    count = QUICK if work.quick else FULL
    fine = QUICK_RESOLUTION if work.quick else RESOLUTION
    trials = list(
        work.each(
            {f"theatre {number}": 1000 * work.seed + number for number in range(count)},
            Trial,
            lambda seed: trial(seed, fine),
        ).values()
    )
    names = list(CASES)[:2] if work.quick else list(CASES)
    cases = work.each(
        {name: name for name in names}, Ambiguity, lambda name: ambiguity(name, work.seed, fine)
    )
    size, walks = (48, 32) if work.quick else (128, 128)
    dark, bright = work.step(
        "compensated",
        tuple[Residuals, Residuals],
        lambda: compensated(size, walks, work.seed, fine),
    )
    coverage = {name: _coverage(trials, name) for name in MEASURED}
    together = float(np.mean(list(coverage.values())))
    rms = {name: _rms(trials, name) for name in MEASURED}
    return Finding(
        result=(
            f"{count} random theatres, photographed with noise of {NOISE:.0%} a pixel: the "
            f"screen's albedo was off by {rms['screen']:.2%}, the floor's by {rms['floor']:.2%} "
            f"(rms). {together:.1%} of the 95 % intervals hold the truth. A theatre took "
            f"{np.median([one.cpu_s for one in trials]):.1f} CPU-seconds.\n\n"
            f"A night, compensated with what was measured and seen in the theatre as it is, is "
            f"left with {dark.measured / dark.truth:.3f} times the residual that the true albedos "
            f"leave, and with {dark.closed / dark.truth:.3f} times by the closed form of the "
            f"described theatre. Of a day, where nothing clips, "
            f"{max(bright.measured, 0) / bright.untouched:.2%} of the reflected light remain, "
            f"{bright.closed / bright.untouched:.0%} by the closed form."
        ),
        advice="Photograph black, white and several half-lit patterns, with the floor in view; "
        "measure the camera's place and the floor's height to 2 cm.",
        checks=_checks(trials, coverage, cases, dark, bright, quick=work.quick),
        tables=(
            _trials_table(trials, coverage),
            _cases_table(cases),
            _residual_table(dark, bright),
        ),
        plots=(_calibration(trials),),
        figures={
            "theatres": count,
            "coverage": together,
            "screen_rms": rms["screen"],
            "floor_rms": rms["floor"],
            "cpu_s": float(np.median([one.cpu_s for one in trials])),
            "residual_over_truth": dark.measured / dark.truth,
            "closed_form_over_truth": dark.closed / dark.truth,
        },
    )


def _all(trials: Sequence[Trial], name: str, what: str) -> Floats:
    return np.array([getattr(one, what)[name] for one in trials])


def _coverage(trials: Sequence[Trial], name: str) -> float:
    return float(np.mean(np.abs(_all(trials, name, "z")) < SIGMAS))


def _rms(trials: Sequence[Trial], name: str) -> float:
    return float(np.sqrt(np.mean(_all(trials, name, "off") ** 2)))


def _checks(
    trials: Sequence[Trial],
    coverage: Mapping[str, float],
    cases: Mapping[str, Ambiguity],
    dark: Residuals,
    bright: Residuals,
    *,
    quick: bool,
) -> tuple[Check, ...]:
    checks = []
    for name, bound in (("screen", 0.005), ("floor", 0.02)):
        off = np.abs(_all(trials, name, "off"))
        checks.append(at_most(f"{name} albedo: rms relative error", _rms(trials, name), bound))
        worst = float(np.quantile(off.max(1), 0.95))
        checks.append(at_most(f"{name} albedo: error of 95 in 100 theatres", worst, bound))
    if quick:
        # Primaries and parameters of a theatre share its geometry: a theatre counts once.
        z = [float(np.sqrt(np.mean(np.square(_all([one], "screen", "z"))))) for one in trials]
        chance = float(stats.chi2.sf(np.sum(np.square(z)), len(z)))
        checks.append(at_least("screen albedo: p-value of its errors", chance, 1e-3))
    else:
        checks += [
            between(f"{name}: share of 95 % intervals that hold the truth", share, 0.9, 0.98)
            for name, share in coverage.items()
        ]
    checks.append(at_most("CPU time of a theatre", max(one.cpu_s for one in trials), 60, "s"))
    incomplete = sum(not one.complete for one in trials)
    checks.append(equal("theatres not answered", incomplete, 0))
    for name, case in cases.items():
        wanted = case.asked if CASES[name][2] else 0
        checks.append(equal(f"{name}: figures answered", case.answered, wanted))
    checks += [
        at_most("night: residual, measured over true albedos", dark.measured / dark.truth, 1.1),
        at_least("night: residual, closed form over measured", dark.closed / dark.measured, 1.0),
        at_most("day: reflected light left, measured", bright.measured / bright.untouched, 0.02),
        at_least("day: reflected light left, closed form", bright.closed / bright.untouched, 0.05),
    ]
    return tuple(checks)


def _trials_table(trials: Sequence[Trial], coverage: Mapping[str, float]) -> Table:
    return Table(
        caption="Random theatres: relative errors and intervals, over primaries and theatres.",
        columns=(
            Column(name="figure"),
            Column(name="rms error", unit="%"),
            Column(name="largest error", unit="%"),
            Column(name="mean error", unit="%"),
            Column(name="half of the 95 % interval, median", unit="%"),
            Column(name="intervals that hold the truth", unit="%"),
            Column(name="rms z"),
        ),
        rows=tuple(
            (
                name,
                100 * _rms(trials, name),
                100 * float(np.abs(_all(trials, name, "off")).max()),
                100 * float(_all(trials, name, "off").mean()),
                100 * float(np.median(_all(trials, name, "width"))),
                100 * coverage[name],
                float(np.sqrt(np.mean(_all(trials, name, "z") ** 2))),
            )
            for name in MEASURED
        ),
    )


def _cases_table(cases: Mapping[str, Ambiguity]) -> Table:
    return Table(
        caption="What photographs determine: gain, screen and floor albedo in three primaries.",
        columns=(
            Column(name="photographs of"),
            Column(name="answered"),
            Column(name="asked"),
            Column(name="largest error of answers", unit="%"),
            Column(name="what is said"),
        ),
        rows=tuple(
            (name, case.answered, case.asked, 100 * case.off, case.said)
            for name, case in cases.items()
        ),
    )


def _residual_table(dark: Residuals, bright: Residuals) -> Table:
    names = {
        "untouched": "none",
        "truth": "whole theatre, true albedos",
        "measured": "whole theatre, measured albedos",
        "closed_measured": "closed form, measured albedo",
        "closed": "closed form, described albedo",
    }
    return Table(
        caption=LEFT,
        columns=(
            Column(name="compensation"),
            Column(name="night", unit="%"),
            Column(name="day", unit="%"),
        ),
        rows=tuple(
            (told, 100 * getattr(dark, name), 100 * getattr(bright, name))
            for name, told in names.items()
        ),
    )


def _calibration(trials: Sequence[Trial]) -> Plot:
    def draw(axes: Any) -> None:
        levels = np.linspace(0.05, 0.99, 60)
        for name in MEASURED:
            z = np.abs(_all(trials, name, "z")).ravel()
            held = [np.mean(z < stats.norm.ppf(0.5 + level / 2)) for level in levels]
            axes.plot(100 * levels, 100 * np.array(held), label=name)
        axes.plot((0, 100), (0, 100), "k:", lw=1)
        axes.set(xlabel="interval, %", ylabel="intervals that hold the truth, %")
        axes.legend(fontsize=8)

    return plot(
        "How often intervals of a given confidence hold the truth. On the dotted line they are "
        "honest; above it, cautious.",
        "Curves of coverage against confidence, near the diagonal.",
        draw,
    )
