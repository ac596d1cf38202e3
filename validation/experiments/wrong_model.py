"""Compensation by the closed form is worth most of what it could be in a real theatre.

Rationale
    The closed form knows nothing but the bare screen. A real theatre has a floor, seats, walls and
    lamps, perhaps a gain lobe: its model is wrong there. Light that is taken off for reflections
    that were thought too weak leaves the rest of them; that rest is what a wrong model costs. So
    compensate with the closed form, observe in the path-traced theatre, and compare with
    compensation by the tabulated operator, and with doing nothing.
Expected
    In every theatre the closed form beats doing nothing, in visible error and to two judges that
    nobody optimised for. Tabulation, which predicts the added light within 2 %, is never worse; but
    behind a perforated screen whose shell is lit the picture shines back through the holes, too
    sharp for its smooth patterns: by more than 5 %. Neither raises the contrast of a full
    checkerboard, whose black cannot be projected any blacker; both raise a soft one's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.master import Posed, pose
from compensate.solver.admm import ADMM
from domesim.light import Light
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.scene import Scene, load_scene
from domesim.screening import decoded, mean_luminance, within_range
from validation import judges
from validation.drawing import pictures, plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Pictures,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
)
from validation.masters import bundled_night

Images: TypeAlias = NDArray[np.float64]

METHODS: Mapping[str, str] = {
    "untouched": "nothing",
    "subtractive": "subtraction, closed form",
    "closed_form": "perceptual, closed form",
    "tabulated": "perceptual, tabulated",
}
"""What is projected, for people."""

SOFT = 0.25
"""Light of the soft checkerboard's dark fields."""

PATTERNS: Mapping[
    str, tuple[str, Callable[[Scene, int], Light], Callable[[Light, Scene], float]]
] = {
    "checkerboard": ("checkerboard", judges.checkerboard, judges.checkerboard_contrast),
    "soft_checkerboard": (
        f"soft checkerboard ({1 / SOFT:g} : 1)",
        lambda scene, size: judges.checkerboard(scene, size, SOFT),
        judges.checkerboard_contrast,
    ),
    "black_in_white": ("black in white", judges.black_in_white, judges.black_over_white),
}
"""Test patterns: for people, the picture, and the figure of what is seen of it."""

SHOWN_WHITE = 0.25
"""Light that the pictures show as white."""


@final
@dataclass(frozen=True)
class Effort:
    """How much to do.

    Parameters
    ----------
    size
        Pixels a side of the domemaster; divides the bundled night's 1024.
    walks, repeats
        Walks a pixel, and how many times: the repeats' spread is the uncertainty.
    error, most
        Relative standard error of the tabulated operator, and most walks for it.
    blur
        Of the traced light before judges see it, degrees.
    """

    size: int = 512
    walks: int = 2
    repeats: int = 8
    error: float = 5e-4
    most: float = 2e7
    blur: float = 4.0


QUICK: Mapping[str, Effort] = {"dome_planetarium": Effort(256, repeats=6, error=2e-3, most=2e5)}
FULL: Mapping[str, Effort] = {
    "dome_planetarium": Effort(),
    "dome_imax": Effort(),
    "dome_led": Effort(walks=4, error=3e-3),
    "dome_dark": Effort(walks=6, error=1e-3, blur=0.5),
}
"""Not coarser: with pixels of 1.4° instead of 0.35° ColorVideoVDP misses the detail that veils hide
and prefers doing nothing."""


@final
@dataclass(frozen=True)
class Estimate:
    """A figure, and the same figure without each of several repeats (the jackknife)."""

    value: float
    without: tuple[float, ...]

    @property
    def error(self) -> float:
        """Standard error."""
        spread = np.asarray(self.without)
        return float(np.sqrt((len(spread) - 1) * np.mean((spread - spread.mean()) ** 2)))

    def less(self, other: Estimate) -> Estimate:
        """The difference from another figure of the same repeats."""
        pairs = zip(self.without, other.without, strict=True)
        return Estimate(self.value - other.value, tuple(mine - its for mine, its in pairs))

    def root(self, scale: float = 1.0) -> Estimate:
        """Root of a mean square, times `scale`; 0 where chance has made the square negative."""
        value, *without = np.sqrt(np.maximum((self.value, *self.without), 0)) * scale
        return Estimate(float(value), tuple(map(float, without)))


@final
@dataclass(frozen=True)
class Seen:
    """What one method's light looks like in the path-traced theatre.

    Attributes
    ----------
    believed
        Visible error that its own model promises, JND rms.
    visible
        Visible error, JND rms.
    added
        Mean luminance above the master's, cd/m².
    flip, jod
        By `validation.judges`; None if the judge is not installed.
    contrast
        Pattern -> its figure.
    """

    believed: float
    visible: Estimate
    added: Estimate
    flip: Estimate | None
    jod: Estimate | None
    contrast: dict[str, Estimate]


@final
@dataclass(frozen=True)
class Outcome:
    """One theatre.

    Attributes
    ----------
    seen
        Method -> what is seen of it.
    off_by
        Model -> rms error over the screen of the light that it adds to the untouched master, over
        the mean of that light.
    rough
        What blurring the traced light leaves out, likewise.
    clipped
        Share of the screen's pixels where exact subtraction needs less light than none.
    ghost
        Whether light comes back through the screen's holes from a shell behind it.
    missing
        Judges that are not installed.
    shown
        Pictures.
    """

    seen: dict[str, Seen]
    off_by: dict[str, Estimate]
    rough: Estimate
    clipped: float
    ghost: bool
    missing: tuple[str, ...]
    shown: Pictures

    @property
    def kept(self) -> float:
        """Share of what tabulation gains over doing nothing that the closed form gains."""
        nothing, closed, best = (
            self.seen[name].visible.value for name in ("untouched", "closed_form", "tabulated")
        )
        return (nothing - closed) / (nothing - best)


@final
@dataclass(frozen=True)
class _Look:
    """A picture in the theatre: (row, col, primary) direct and (repeat, ...) all other light."""

    direct: Images
    added: Images

    @property
    def seen(self) -> Images:
        """(repeat, row, col, primary)."""
        return self.direct + self.added


def measure(name: str, effort: Effort, seed: int = 0) -> Outcome:
    """Compensate the bundled night for a bundled theatre by each method, and look at it there."""
    scene = load_scene(name)
    tracer = Tracer(scene.theatre)
    transport = tabulate(
        scene.theatre,
        error=effort.error,
        most=effort.most,
        seed=seed,
        tracer=tracer,
        provenance={"scene": scene.name, "digest": scene.digest},
    ).transport
    models = {"closed_form": scene, "tabulated": scene.with_transport(transport)}
    real = _Real(scene, tracer, effort, seed)

    master = _night(scene, effort.size)
    posed = {model: pose(master, knows) for model, knows in models.items()}
    lights = _projected(posed)
    looks = real.look(lights)
    untouched, wanted = looks["untouched"], looks["untouched"].direct
    predicted = {model: one.problem.observation.observe(master)[0] for model, one in posed.items()}
    judged, missing = real.judged(wanted, looks)
    contrasts = _contrasts(models, real)
    return Outcome(
        seen={
            method: Seen(
                posed["tabulated" if method == "tabulated" else "closed_form"].visible_error(light),
                _visible_error(looks[method].seen - wanted, posed["closed_form"]),
                _jackknife(looks[method].seen - wanted, mean_luminance, scene),
                judged.get(("flip", method)),
                judged.get(("jod", method)),
                contrasts[method],
            )
            for method, light in lights.items()
        },
        off_by={
            model: real.off_by(real.blurred(light - untouched.seen), untouched)
            for model, light in predicted.items()
        },
        rough=real.off_by(real.smooth(untouched) - untouched.seen, untouched),
        clipped=posed["tabulated"].clipped,
        ghost=scene.theatre.shines_back,
        missing=missing,
        shown=pictures(
            f"{name}: the master, and what is seen of it in the path-traced theatre, "
            f"{1 / SHOWN_WHITE:g} times brighter than it is.",
            {"master": wanted[None]}
            | {
                f"seen: {METHODS[method]}": real.smooth(looks[method])[None]
                for method in ("untouched", "closed_form", "tabulated")
            },
            scene,
            brightest=SHOWN_WHITE,
        ),
    )


def run(work: Work) -> Finding:
    """Compensate for, and look at, each theatre."""
    efforts = QUICK if work.quick else FULL
    found = work.each(
        {name: (name, effort) for name, effort in efforts.items()},
        Outcome,
        lambda case: measure(*case, seed=work.seed),
    )
    missing = {reason: None for outcome in found.values() for reason in outcome.missing}
    return Finding(
        result="\n\n".join(_theatre(name, outcome) for name, outcome in found.items()),
        advice=_advice(found),
        checks=tuple(check for name, outcome in found.items() for check in _checks(name, outcome)),
        tables=tuple(_table(name, outcome) for name, outcome in found.items()),
        plots=(_plot(found),),
        pictures=tuple(outcome.shown for outcome in found.values()),
        figures=_figures(found),
        left_out=tuple(missing),
    )


def _night(scene: Scene, size: int) -> Light:
    """(1, size, size, primary): the bundled night in mean light, within the projector's range."""
    light = decoded(bundled_night(), scene)[0]
    finer = len(light) // size
    coarse = light.reshape(size, finer, size, finer, -1).mean((1, 3))[None]
    return within_range(coarse, scene.dome.inside(size, size))[0]


def _projected(posed: Mapping[str, Posed]) -> dict[str, Light]:
    """What each of `METHODS` projects."""
    closed, tabulated = posed["closed_form"], posed["tabulated"]
    return {
        "untouched": closed.desired,
        "subtractive": closed.subtractive,
        "closed_form": ADMM()(closed.problem, closed.subtractive).light,
        "tabulated": ADMM()(tabulated.problem, tabulated.subtractive).light,
    }


@final
@dataclass(frozen=True)
class _Real:
    """The theatre as the path tracer sees it: the truth, but for noise."""

    scene: Scene
    tracer: Tracer
    effort: Effort
    seed: int

    def look(self, lights: Mapping[str, Light]) -> dict[str, _Look]:
        """Path-trace each light several times, all with the same random numbers.

        What is common to two methods is then common to their noise, which leaves their difference.
        """
        scene, effort = self.scene, self.effort
        rows, cols = next(iter(lights.values())).shape[1:3]
        black = scene.ambient / scene.projector.white * scene.dome.inside(rows, cols)[..., None]
        direct: dict[str, Images] = {}
        added: dict[str, list[Images]] = {name: [] for name in lights}
        for repeat in range(effort.repeats):
            settings = Settings(
                least=effort.walks, most=effort.walks, seed=1 + 1000 * self.seed + repeat
            )
            real = PathTracedDome(scene.theatre, rows, cols, settings, tracer=self.tracer)
            for name, light in lights.items():
                observed = real.trace(light)
                direct[name] = observed.direct[0].astype(np.float64)
                added[name].append((observed.mean - observed.direct)[0] + black)
        return {name: _Look(direct[name], np.array(added[name], np.float64)) for name in lights}

    def blurred(self, images: Images) -> Images:
        """(..., row, col, primary) light on the screen, with a Gaussian's blur."""
        rows, cols = images.shape[-3:-1]
        screen = self.scene.dome.inside(rows, cols)[..., None].astype(np.float64)
        pixels = self.effort.blur * self.scene.viewing.pixels_per_degree(rows, cols)
        light, cover = (
            gaussian_filter(part, pixels, axes=(-3, -2)) for part in (images * screen, screen)
        )
        return np.asarray(light / np.maximum(cover, 1e-6) * screen)

    def smooth(self, look: _Look, repeats: slice = slice(None)) -> Images:
        """(row, col, primary): what is seen, with the noise of the added light blurred away.

        Added light is smooth. Its noise is not, and a judge would find that.
        """
        return look.direct + self.blurred(look.added[repeats].mean(0))

    def off_by(self, residuals: Images, look: _Look) -> Estimate:
        """Rms over the screen of noisy residuals, over the mean of the light that is added."""
        share = self.scene.dome.screen_areas(*look.direct.shape[:2])[..., None]
        share = share / (3 * share.sum())
        added = float(np.sum(share * look.added.mean(0)))
        square = _energy(residuals, lambda residual: float(np.sum(share * residual**2)))
        return square.root(1 / added)

    def judged(
        self, wanted: Images, looks: Mapping[str, _Look]
    ) -> tuple[dict[tuple[str, str], Estimate], tuple[str, ...]]:
        """(judge, method) -> by halves of the repeats; and which judges are missing."""
        found: dict[tuple[str, str], Estimate] = {}
        missing = []
        for name, judge in (("flip", judges.flip), ("jod", judges.colorvideovdp)):
            try:
                for method, look in looks.items():
                    halves = [self.smooth(look, slice(part, None, 2)) for part in (0, 1)]
                    scores = tuple(judge(wanted[None], half[None], self.scene) for half in halves)
                    found[name, method] = Estimate(sum(scores) / 2, scores)
            except Missing as reason:
                missing.append(str(reason))
        return found, tuple(missing)


def _contrasts(models: Mapping[str, Scene], real: _Real) -> dict[str, dict[str, Estimate]]:
    """Method -> pattern -> its figure."""
    found: dict[str, dict[str, Estimate]] = {method: {} for method in METHODS}
    for pattern, (_, draw, figure) in PATTERNS.items():
        drawn = draw(real.scene, min(real.effort.size, 128))
        lights = _projected({model: pose(drawn, knows) for model, knows in models.items()})
        for method, look in real.look(lights).items():
            found[method][pattern] = _jackknife(look.seen, figure, real.scene)
    return found


def _jackknife(images: Images, figure: Callable[[Light, Scene], float], scene: Scene) -> Estimate:
    """A figure of the mean of (repeat, row, col, primary) images."""
    total, count = images.sum(0), len(images)
    without = tuple(figure((total - image)[None] / (count - 1), scene) for image in images)
    return Estimate(figure(total[None] / count, scene), without)


def _energy(residuals: Images, energy: Callable[[Images], float]) -> Estimate:
    """Energy of what noisy (repeat, row, col, primary) residuals have in common.

    Of their mean, it would have the noise's own energy in it. The mean over pairs of *different*
    repeats of <r_i, r_j> has not: (||sum of all||² - sum of ||each||²) / (n² - n).
    """
    total, count = residuals.sum(0), len(residuals)
    own = np.array([energy(residual) for residual in residuals])

    def of_pairs(total: Images, own: float, count: int) -> float:
        return (energy(total) - own) / (count * (count - 1))

    return Estimate(
        of_pairs(total, float(own.sum()), count),
        tuple(
            of_pairs(total - residual, float(own.sum() - its), count - 1)
            for residual, its in zip(residuals, own, strict=True)
        ),
    )


def _visible_error(residuals: Images, posed: Posed) -> Estimate:
    """As `Posed.visible_error`, of noisy (repeat, row, col, primary) residuals."""
    weighting, scene = posed.problem.weighting, posed.scene
    thresholds = scene.projector.white / scene.viewing.adaptation * weighting.peak
    energy = _energy(residuals, lambda residual: weighting.energy(residual[None]))
    return energy.root(thresholds / float(np.sqrt(np.count_nonzero(posed.screen))))


def _checks(name: str, outcome: Outcome) -> Iterator[Check]:
    nothing, closed, best = (
        outcome.seen[method] for method in ("untouched", "closed_form", "tabulated")
    )
    yield at_most(
        f"{name}: visible error by the closed form, over that of nothing",
        closed.visible.value / nothing.visible.value,
        0.75,
    )
    gained = best.visible.less(closed.visible)
    yield at_most(
        f"{name}: visible error, tabulated less closed form (bound: 1 % and two standard errors)",
        gained.value,
        0.01 * closed.visible.value + 2 * gained.error,
        "JND rms",
    )
    what = f"{name}: error of the tabulated prediction, over the mean added light"
    if outcome.ghost:
        # Known not to be smooth: a limit, to be noticed when it falls
        yield at_least(what, outcome.off_by["tabulated"].value, 0.05)
    else:
        yield at_most(what, outcome.off_by["tabulated"].value, 0.02)
    yield at_most(f"{name}: what blurring leaves out, over it", outcome.rough.value, 0.05)
    if closed.flip is not None and nothing.flip is not None:
        fall = closed.flip.less(nothing.flip).value
        yield at_most(f"{name}: FLIP, closed form less nothing", fall, 0)
    if closed.jod is not None and nothing.jod is not None:
        rise = closed.jod.less(nothing.jod).value
        yield at_least(f"{name}: ColorVideoVDP, closed form less nothing", rise, 0, "JOD")
    full, soft = (
        closed.contrast[pattern].value / nothing.contrast[pattern].value
        for pattern in ("checkerboard", "soft_checkerboard")
    )
    yield at_most(f"{name}: contrast of the checkerboard, closed form over nothing", full, 1.01)
    yield at_least(f"{name}: contrast of the soft one, closed form over nothing", soft, 1.1)


def _advice(found: Mapping[str, Outcome]) -> str:
    name, worst = min(found.items(), key=lambda item: item[1].kept)
    return (
        f"Compensate by the closed form if a theatre is not tabulated: in a real room it is worth "
        f"{worst.kept:.0%} or more of what tabulation is ({name} is the worst of {len(found)}). "
        f"No compensation raises the contrast of white and black fields, whose black cannot be "
        f"projected any blacker: that takes paint."
    )


def _theatre(name: str, outcome: Outcome) -> str:
    """What was found in one theatre, for people."""
    nothing, closed, best = (
        outcome.seen[method] for method in ("untouched", "closed_form", "tabulated")
    )
    soft = [seen.contrast["soft_checkerboard"].value for seen in (nothing, closed, best)]
    ghost = (
        " What shines back through the holes from the lit shell behind the screen is a blurred "
        "picture, which the operator's smooth patterns cannot carry."
    )
    return (
        f"{name}: projected as it is, the night has a visible error of "
        f"{_with_error(nothing.visible)} JND. Compensated by the closed form it has "
        f"{_with_error(closed.visible)} (believed: {closed.believed:.3g}), by the tabulated "
        f"operator {_with_error(best.visible)}: the closed form is worth {outcome.kept:.1%} of "
        f"tabulation, although it is {outcome.off_by['closed_form'].value:.0%} off about the added "
        f"light (tabulated: {outcome.off_by['tabulated'].value:.1%}). {outcome.clipped:.0%} of the "
        f"screen would need less light than none, and there no model helps. A soft checkerboard of "
        f"{1 / SOFT:g} : 1 is seen as {soft[0]:.2f} untouched, {soft[1]:.2f} by the closed form "
        f"and {soft[2]:.2f} tabulated.{ghost * outcome.ghost}{_verdicts(outcome)}"
    )


def _verdicts(outcome: Outcome) -> str:
    """How the judges order the methods, best first."""
    said = ""
    for judge, scores, best_first in (
        ("FLIP", {method: seen.flip for method, seen in outcome.seen.items()}, 1),
        ("ColorVideoVDP", {method: seen.jod for method, seen in outcome.seen.items()}, -1),
    ):
        known = {method: score.value for method, score in scores.items() if score is not None}
        order = sorted(known, key=lambda method: best_first * known[method])
        ranked = ", ".join(f"{METHODS[method]} {known[method]:.3f}" for method in order)
        said += f" {judge}, best first: {ranked}." if known else ""
    return said


def _with_error(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} ± {estimate.error:.1g}"


def _table(name: str, outcome: Outcome) -> Table:
    rows = tuple(
        (
            METHODS[method],
            seen.believed,
            seen.visible.value,
            seen.visible.error,
            seen.added.value,
            *(None if score is None else score.value for score in (seen.flip, seen.jod)),
            *(seen.contrast[pattern].value for pattern in PATTERNS),
        )
        for method, seen in outcome.seen.items()
    )
    errors = [max(seen.added.error for seen in outcome.seen.values())]
    errors += [
        max(seen.contrast[pattern].error for seen in outcome.seen.values()) for pattern in PATTERNS
    ]
    return Table(
        caption=(
            f"{name}, the bundled night and test patterns, observed by path tracing. FLIP: 0 is "
            f"the same as the master. ColorVideoVDP: 10 is. Checkerboards: bright over dark; black "
            f"in white: the black disc over the white. Standard errors are at most "
            f"{errors[0]:.1g} cd/m² of the added light, and "
            f"{', '.join(f'{error:.1g}' for error in errors[1:])} of the patterns."
        ),
        columns=(
            Column(name="compensation"),
            Column(name="visible error, believed", unit="JND rms"),
            Column(name="visible error, seen", unit="JND rms"),
            Column(name="± standard error", unit="JND rms", digits=".1g"),
            Column(name="added light, mean", unit="cd/m²"),
            Column(name="FLIP"),
            Column(name="ColorVideoVDP", unit="JOD", digits=".3f"),
            *(Column(name=title) for title, _, _ in PATTERNS.values()),
        ),
        rows=rows,
    )


def _plot(found: Mapping[str, Outcome]) -> Plot:
    nothing = np.array([outcome.seen["untouched"].visible.value for outcome in found.values()])

    def draw(axes: Any) -> None:
        across = np.arange(len(found))
        for number, (method, title) in enumerate(METHODS.items()):
            seen = [outcome.seen[method] for outcome in found.values()]
            place = across + 0.2 * (number - 1.5)
            height = [one.visible.value for one in seen] / nothing
            error = [2 * one.visible.error for one in seen] / nothing
            axes.bar(place, height, 0.19, yerr=error, label=title)
            axes.plot(place, [one.believed for one in seen] / nothing, "_", color="black", ms=12)
        axes.set(xticks=across, ylabel="visible error, that of nothing = 1")
        axes.set_xticklabels(found)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)

    return plot(
        "Visible error of the bundled night as it is seen in the path-traced theatres (bars, with "
        "two standard errors), and what the model that was compensated with makes of it (dashes).",
        "Groups of four bars: both perceptual ones are far below those of nothing and subtraction.",
        draw,
    )


def _figures(found: Mapping[str, Outcome]) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name, outcome in found.items():
        for method, seen in outcome.seen.items():
            values = {"visible": seen.visible, "added": seen.added, **seen.contrast}
            scores = {"flip": seen.flip, "jod": seen.jod}
            values |= {judge: score for judge, score in scores.items() if score is not None}
            start = f"wrong_model.{name}.{method}"
            figures |= {f"{start}.{what}": one.value for what, one in values.items()}
            figures[f"{start}.visible_standard_error"] = seen.visible.error
            figures[f"{start}.believed"] = seen.believed
        for model, error in outcome.off_by.items():
            figures[f"wrong_model.{name}.{model}.off_by"] = error.value
        figures[f"wrong_model.{name}.closed_form.kept"] = outcome.kept
    return figures
