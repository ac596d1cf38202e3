"""Compensation by the closed form is worth most of what it could be, in simulated theatres with
floor and seats.

Rationale
    The closed form knows nothing but the bare screen. A real theatre has a floor, seats, walls and
    lamps, perhaps a gain lobe: its model is wrong there. Light that is taken off for reflections
    that were thought too weak leaves the rest of them; that rest is what a wrong model costs. So
    compensate the bundled night by the default with the closed form, observe in the path-traced
    theatre, and compare with the default with the tabulated operator, with plain subtraction, and
    with doing nothing: by quality lost (ColorVideoVDP's, `compensate.ruler`), and by FLIP.
Expected
    In every theatre the closed form loses less quality than doing nothing, by a difference that
    counts (0.02 JOD), and has less FLIP. Tabulation, which predicts the added light within 2 %, is
    never worse by such a difference; but behind a perforated screen whose shell is lit the picture
    shines back through the holes, too sharp for its smooth patterns: by more than 5 %.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.bundled import bundled_night
from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.ruler import NO_DIFFERENCE, Ruler
from compensate.solve import solved
from domesim.light import Light
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.scene import DomeScene, load_dome
from domesim.scene.screening import decoded, mean_luminance, within_range
from testing.pairs import averaged
from validation import judges
from validation.drawing import pictures
from validation.experiment import (
    Check,
    Column,
    Finding,
    Pictures,
    Table,
    Work,
    at_least,
    at_most,
    require_tracer,
)

Images: TypeAlias = NDArray[np.float64]

METHODS: Mapping[str, str] = {
    "untouched": "uncompensated",
    "subtractive": "subtraction, closed form",
    "closed_form": "default, closed form",
    "tabulated": "default, tabulated",
}
"""What is projected, for people."""

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
        Walks a pixel, and how many times: two or more.
    error, most
        Relative standard error of the tabulated operator, and most walks for it.
    blur
        Blur of the traced light before judges see it, degrees.
    """

    size: int = 512
    walks: int = 2
    repeats: int = 4
    error: float = 5e-4
    most: float = 2e7
    blur: float = 4.0


QUICK: Mapping[str, Effort] = {"dome_planetarium": Effort(256, error=2e-3, most=2e5)}
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
class Seen:
    """What one method's light looks like in the path-traced theatre.

    Attributes
    ----------
    lost
        Quality lost, JOD.
    added
        Mean luminance above the master's, cd/m².
    flip
        FLIP; None if it is not installed.
    """

    lost: float
    added: float
    flip: float | None


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
    shown
        Pictures.
    """

    seen: dict[str, Seen]
    off_by: dict[str, float]
    rough: float
    clipped: float
    ghost: bool
    shown: Pictures

    @property
    def kept(self) -> float:
        """Share of tabulation's gain in quality that the closed form gives."""
        nothing, closed, best = (
            self.seen[name].lost for name in ("untouched", "closed_form", "tabulated")
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
    scene = load_dome(name)
    tracer = Tracer(scene.theatre)
    transport = tabulate(
        scene.theatre,
        error=effort.error,
        most=effort.most,
        seed=seed,
        tracer=tracer,
        provenance={"scene": scene.name, "digest": scene.digest},
    ).transport
    real = _Real(scene, tracer, effort, seed)
    master = _night(scene, effort.size)
    models = {"closed_form": scene, "tabulated": scene.with_transport(transport)}
    posed = {model: pose(master, knows) for model, knows in models.items()}
    closed = posed["closed_form"]
    looks = real.look(
        {"untouched": closed.desired, "subtractive": closed.subtractive}
        | {model: solved(one, "perceptual").light for model, one in posed.items()}
    )
    untouched, wanted = looks["untouched"], looks["untouched"].direct
    predicted = {model: one.observation.observe(master)[0] for model, one in posed.items()}
    smooth = {method: real.smooth(look) for method, look in looks.items()}
    ruler = Ruler(_light(wanted), scene, closed.screen)
    return Outcome(
        seen={
            method: Seen(
                ruler.lost(_light(light)),
                mean_luminance((looks[method].seen.mean(0) - wanted)[None], scene),
                judges.if_installed(judges.flip, _light(wanted), _light(light), scene),
            )
            for method, light in smooth.items()
        },
        off_by={
            model: real.off_by(real.blurred(light - untouched.seen), untouched)
            for model, light in predicted.items()
        },
        rough=real.off_by(smooth["untouched"] - untouched.seen, untouched),
        clipped=Appraisal(closed).clipped,
        ghost=scene.theatre.shines_back,
        shown=pictures(
            f"{name}: the master, and what is seen of it in the path-traced theatre, "
            f"{1 / SHOWN_WHITE:g} times brighter than it is.",
            {"master": _light(wanted)}
            | {f"seen: {METHODS[method]}": _light(light) for method, light in smooth.items()},
            scene,
            brightest=SHOWN_WHITE,
        ),
    )


def run(work: Work) -> Finding:
    """Compensate for, and look at, each theatre."""
    require_tracer()
    efforts = QUICK if work.quick else FULL
    found = work.each(
        {name: (name, effort) for name, effort in efforts.items()},
        Outcome,
        lambda case: measure(*case, seed=work.seed),
    )
    kept = [outcome.kept for outcome in found.values()]
    ends = dict.fromkeys(f"{100 * share:.0f} %" for share in (min(kept), max(kept)))
    return Finding(
        result="\n\n".join(_theatre(name, outcome) for name, outcome in found.items()),
        advice=(
            f"No tabulation yet? Compensate anyway: in these simulated theatres the bare dome's "
            f"formula gives {' to '.join(ends)} of the quality that the tabulated room gains. "
            f"Where the picture is black, nothing helps but a darker screen."
        ),
        checks=tuple(check for name, outcome in found.items() for check in _checks(name, outcome)),
        tables=(_table(found),),
        pictures=tuple(outcome.shown for outcome in found.values()),
        figures=_figures(found),
        left_out=tuple(
            judges.left_out({"FLIP": [s.flip for one in found.values() for s in one.seen.values()]})
        ),
    )


def _light(image: Images) -> Light:
    """As one view, in single precision."""
    return np.asarray(image[None], np.float32)


def _night(scene: DomeScene, size: int) -> Light:
    """(1, size, size, primary): the bundled night in mean light, within the projector's range."""
    light = decoded(bundled_night(), scene)
    coarse = averaged(light, light.shape[1] // size)
    return within_range(coarse, scene.dome.inside(size, size))[0]


@final
@dataclass(frozen=True)
class _Real:
    """The theatre as the path tracer sees it: the truth, but for noise."""

    scene: DomeScene
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

    def smooth(self, look: _Look) -> Images:
        """(row, col, primary): what is seen, with the noise of the added light blurred away.

        Added light is smooth. Its noise is not, and a judge would find that.
        """
        return look.direct + self.blurred(look.added.mean(0))

    def off_by(self, residuals: Images, look: _Look) -> float:
        """Rms over the screen of noisy residuals, over the mean of the light that is added."""
        share = self.scene.dome.screen_areas(*look.direct.shape[:2])[..., None]
        share = share / (3 * share.sum())
        return common_rms(residuals, share) / float(np.sum(share * look.added.mean(0)))


def common_rms(residuals: Images, share: Images) -> float:
    """Rms of what noisy (repeat, row, col, primary) residuals have in common; `share` adds up to 1.

    The square of their mean would have the noise's own square in it. The mean over pairs of
    *different* repeats of r_i r_j has not: ((sum of all)² - sum of squares) / (n² - n).
    """
    count = len(residuals)
    own, total = np.sum(share * residuals**2), np.sum(share * residuals.sum(0) ** 2)
    return float(np.sqrt(max(total - own, 0.0) / (count * (count - 1))))


def _checks(name: str, outcome: Outcome) -> Iterator[Check]:
    nothing, closed, best = (
        outcome.seen[method] for method in ("untouched", "closed_form", "tabulated")
    )
    gained = nothing.lost - closed.lost
    yield at_least(f"{name}: quality that the closed form gains", gained, NO_DIFFERENCE, "JOD")
    lost = best.lost - closed.lost
    what = f"{name}: quality lost, tabulated less closed form"
    yield at_most(what, lost, NO_DIFFERENCE, "JOD")
    what = f"{name}: error of the tabulated prediction, over the mean added light"
    if outcome.ghost:
        # Known not to be smooth: a limit, to be noticed when it falls
        yield at_least(what, outcome.off_by["tabulated"], 0.05)
    else:
        yield at_most(what, outcome.off_by["tabulated"], 0.02)
    yield at_most(f"{name}: what blurring leaves out, over it", outcome.rough, 0.05)
    if closed.flip is not None and nothing.flip is not None:
        ratio = closed.flip / nothing.flip
        yield at_most(f"{name}: FLIP, closed form over uncompensated", ratio, 0.98)


def _theatre(name: str, outcome: Outcome) -> str:
    """What was found in one theatre, for people."""
    nothing, subtracted, closed, best = (outcome.seen[method].lost for method in METHODS)
    ghost = (
        " What shines back through the holes from the lit shell behind the screen is a blurred "
        "picture, which the operator's smooth patterns cannot carry."
    )
    return (
        f"{name}: projected as it is, the night loses {nothing:.2f} JOD, subtracted by the closed "
        f"form {subtracted:.2f}. Compensated by the default it loses {closed:.2f} with the closed "
        f"form and {best:.2f} with the tabulated operator: the closed form gives "
        f"{outcome.kept:.0%} of that gain, although it is {outcome.off_by['closed_form']:.0%} off "
        f"about the added light (tabulated: {outcome.off_by['tabulated']:.1%}). On "
        f"{outcome.clipped:.0%} of the screen exact correction would need negative light; a better "
        f"model of the room cannot help there.{ghost * outcome.ghost}"
    )


def _table(found: Mapping[str, Outcome]) -> Table:
    return Table(
        caption="The bundled night, observed by path tracing.",
        columns=(
            Column(name="theatre"),
            Column(name="compensation"),
            Column(name="quality lost", unit="JOD", digits=".3f"),
            Column(name="added light, mean", unit="cd/m²"),
            Column(name="FLIP", digits=".3f"),
        ),
        rows=tuple(
            (name, METHODS[method], seen.lost, seen.added, seen.flip)
            for name, outcome in found.items()
            for method, seen in outcome.seen.items()
        ),
    )


def _figures(found: Mapping[str, Outcome]) -> dict[str, float | None]:
    figures: dict[str, float | None] = {}
    for name, outcome in found.items():
        for method, seen in outcome.seen.items():
            start = f"wrong_model.{name}.{method}"
            figures |= {f"{start}.{what}": value for what, value in vars(seen).items()}
        for model, error in outcome.off_by.items():
            figures[f"wrong_model.{name}.{model}.off_by"] = error
        figures[f"wrong_model.{name}.closed_form.kept"] = outcome.kept
    return figures
