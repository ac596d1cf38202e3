"""Figures 1 (right) and 9, remade: in a dome, fine dark detail lost to subtraction is seen again.

Rationale
    The bundled night scene in a giant dome, as `domesim demo` shows it. The paper says of its
    Fig. 9: subtractive methods "can only correctly compensate the projected image in image regions
    with enough signal and negative values are clamped to black, leading to loss of detail"; its own
    compensation "retains more of these dark details while maintaining a final observed image that
    is perceptually closer to the unpolluted original", and (section 6) "increases the relative
    contrast". *Dark* is the half of the screen where the master is below its median. *Detail* is
    what differs from the dark pixels' mean within about a degree (a Gaussian's sigma); its share
    that is seen is the slope of what is seen against the master. *Relative contrast* is the rms
    difference from the mean of all pixels within about a degree, over that mean. Weber contrast of
    0.25 to 1 and of 2 to 10 degrees (such as the Milky Way), stars, and black over the untouched
    one's are `compensate.plain`'s. How much worse it looks is ColorVideoVDP's (`compensate.ruler`).
Expected
    Subtraction loses more than nine tenths of the dark detail. Perceptual compensation shows at
    least twice as much of it, and more contrast of 2 to 10 degrees. Its relative contrast in the
    dark is higher than with subtraction and without compensation. It loses less of the quality than
    either by a difference that counts (0.02 JOD), keeps all stars in order, and its dark half is
    darker than untouched.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.bundled import bundled_night
from compensate.page.comparison import Comparison, compare_methods
from compensate.plain import PlainFigures, PlainRuler
from compensate.ruler import NO_DIFFERENCE
from domesim.light import Light
from domesim.scene import load_dome
from validation.drawing import pictures
from validation.experiment import Check, Column, Finding, Pictures, Table, Work, at_least, at_most
from validation.judges import luminance
from validation.seen import mean_within, saturation_and_hue

Floats = NDArray[np.floating[Any]]

THEATRE = "dome_imax"
"""Theatre of the demo; the others are looked at when there is time."""
OTHERS = ("dome_planetarium",)
TITLES: Mapping[str, str] = {
    "master": "Master",
    "none": "Seen, untouched",
    "subtractive": "Seen, subtractive",
    "perceptual": "Seen, perceptual",
}
"""Titles of the pictures, by method."""
ROWS: Mapping[str, str] = {**TITLES, "raised-black": "Seen, raised black"}
BRIGHTER = 8
"""Factor by which the pictures are brightened."""
REACH = 1.0
"""Reach of detail (sigma of the mean that is subtracted), degrees."""


@dataclass(frozen=True)
class Seen:
    """What the audience sees of one method.

    Attributes
    ----------
    lost
        Quality lost, JOD.
    detail
        Slope of the dark detail seen against the master's.
    plain
        Black, Weber contrast, stars.
    contrast
        Relative contrast in the dark.
    dark
        Mean luminance of the dark half, cd/m².
    hue, saturation
        Shift of hue of the dark half, degrees, and its saturation over the master's.
    """

    lost: float
    detail: float
    plain: PlainFigures
    contrast: float
    dark: float
    hue: float
    saturation: float


@dataclass(frozen=True)
class Outcome:
    """All methods in one theatre.

    Attributes
    ----------
    seen
        By method; the master, too.
    clipped
        Share of the screen where exact subtraction needs less light than none.
    pictures
        Master, and what is seen.
    """

    seen: dict[str, Seen]
    clipped: float
    pictures: Pictures


def measure(scene: str = THEATRE) -> Outcome:
    """The bundled night in a theatre."""
    frame = bundled_night()
    theatre = load_dome(scene)
    comparison = compare_methods(frame, theatre, solver=None, weighting=None)
    best = comparison.outcomes["perceptual"].figures
    problem = comparison.posed.problem
    observed = {
        name: problem.observation.observe(one.light) for name, one in comparison.outcomes.items()
    }
    lights = {"master": problem.desired, **observed}
    own = PlainRuler(comparison.posed.wanted, theatre, comparison.posed.screen)
    black = own.black(observed["none"])
    caption = (
        f"The bundled night in {scene}, shown {BRIGHTER} times brighter than it is: exaggerated, "
        f"so that the dark half can be judged on a display."
    )
    return Outcome(
        {
            name: _measured(name, light, comparison, own.figures(light, black))
            for name, light in lights.items()
        },
        best.clipped,
        pictures(
            caption,
            {title: _halved(lights[name]) for name, title in TITLES.items()},
            theatre,
            brightest=1 / BRIGHTER,
        ),
    )


def _measured(name: str, light: Light, comparison: Comparison, plain: PlainFigures) -> Seen:
    scene, screen = comparison.posed.scene, comparison.posed.screen
    seen, wanted = (
        luminance(one, scene)[0] * scene.projector.white
        for one in (light, comparison.posed.problem.desired)
    )
    dark = screen & (wanted < np.median(wanted[screen]))
    per_degree = scene.viewing.pixels_per_degree(*screen.shape)
    sigma = REACH * per_degree
    around = mean_within(seen, screen, sigma)
    detail = (seen - mean_within(seen, dark, sigma))[dark]
    detail_wanted = (wanted - mean_within(wanted, dark, sigma))[dark]
    desired = comparison.posed.wanted
    colours = saturation_and_hue(desired, light, scene)
    assert colours is not None
    return Seen(
        0.0 if name == "master" else comparison.outcomes[name].figures.loss_after,
        float(np.sum(detail * detail_wanted) / np.sum(detail_wanted**2)),
        plain,
        float(np.sqrt(np.mean((seen / around - 1)[dark] ** 2))),
        float(seen[dark].mean()),
        colours.hue_shift,
        colours.saturation,
    )


def _halved(light: Light) -> Light:
    """Half as many pixels a side."""
    view, rows, cols, primaries = light.shape
    return light.reshape(view, rows // 2, 2, cols // 2, 2, primaries).mean(axis=(2, 4))


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    theatres = (THEATRE,) if work.quick else (THEATRE, *OTHERS)
    found = work.each({name: name for name in theatres}, Outcome, measure)
    outcome = found[THEATRE]
    return Finding(
        result=_result(outcome),
        advice=(
            f"Contrast is paid for with black: the dark half is seen at "
            f"{outcome.seen['perceptual'].dark:.2g} cd/m² (subtraction "
            f"{outcome.seen['subtractive'].dark:.2g}). A lower --lift keeps it darker, for less "
            f"contrast: look before you ship."
        ),
        checks=tuple(check for name, one in found.items() for check in _checks(name, one)),
        tables=tuple(_table(name, one) for name, one in found.items()),
        pictures=tuple(one.pictures for one in found.values()),
        figures={
            **{f"demo.{name}.lost": s.lost for name, s in outcome.seen.items() if name != "master"},
            "demo.clipped": outcome.clipped,
            **{f"demo.{name}.dark_detail": seen.detail for name, seen in outcome.seen.items()},
            **{
                f"demo.{name}.{key}": value
                for name, seen in outcome.seen.items()
                for key, value in vars(seen.plain).items()
                if key != "hue_shift"
            },
            **{f"demo.{name}.hue": seen.hue for name, seen in outcome.seen.items()},
            **{f"demo.{name}.saturation": seen.saturation for name, seen in outcome.seen.items()},
            **{f"demo.{name}.dark": seen.dark for name, seen in outcome.seen.items()},
        },
        left_out=(
            "Figure 8: `domesim predict` writes it, for any picture. Figures 2, 6 and 10 have "
            "experiments of their own; figure 1 (left) is one more example of them.",
        ),
    )


def _result(outcome: Outcome) -> str:
    none, subtractive, ours = (outcome.seen[m] for m in ("none", "subtractive", "perceptual"))
    master, raised = outcome.seen["master"], outcome.seen["raised-black"]
    closer = ours.lost < min(none.lost, subtractive.lost)
    around = ours.contrast > max(none.contrast, subtractive.contrast)
    return (
        f'The paper: subtraction "can only correctly compensate ... regions with enough signal", '
        f'and clamping leads "to loss of detail". {_held(subtractive.detail < 0.5)}: '
        f"{outcome.clipped:.0%} of the screen is clamped, and {1 - subtractive.detail:.0%} of the "
        f"fine dark detail is lost.\n\n"
        f'The paper: perceptual compensation "retains more of these dark details" and is '
        f'"perceptually closer to the unpolluted original". '
        f"{_held(subtractive.detail < ours.detail, closer)}: {ours.detail:.0%} of the fine dark "
        f"detail (within about a degree) is seen, for light is lifted with its surroundings. Of "
        f"the Weber contrast of 2 to 10 degrees, such as the Milky Way's, "
        f"{ours.plain.contrast_coarse:.0%} are seen (untouched {none.plain.contrast_coarse:.0%}, "
        f"subtraction {subtractive.plain.contrast_coarse:.0%}), and "
        f"{ours.plain.stars_in_order:.0%} of the stars are in order. "
        f"{ours.lost:.2f} JOD of quality are lost instead of {subtractive.lost:.2f} (untouched "
        f"{none.lost:.2f}, raised black {raised.lost:.2f}).\n\n"
        f"The dark half keeps {ours.saturation:.0%} of its saturation (subtraction "
        f"{subtractive.saturation:.0%}), and its hue shifts by {ours.hue:.0f}° (subtraction "
        f"{subtractive.hue:.0f}°). Contrast is paid for with black: it is "
        f"{ours.dark / master.dark:.1f} times as bright as it should be ({ours.dark:.3f} cd/m²; "
        f"master {master.dark:.3f}, untouched {none.dark:.3f}, subtraction "
        f"{subtractive.dark:.3f}).\n\n"
        f'The paper: it "increases the relative contrast". {_held(around)}. Against '
        f"everything within a degree, dark pixels have {_change(ours.contrast, none.contrast)} "
        f"contrast than uncompensated and {_change(ours.contrast, subtractive.contrast)} than with "
        f"subtraction."
    )


def _held(*parts: bool) -> str:
    return "True" if all(parts) else "True in part" if any(parts) else "Not true here"


def _change(found: float, other: float) -> str:
    ratio = found / other
    if ratio >= 3:
        return f"{ratio:.0f} times more"
    return f"{abs(ratio - 1):.0%} {'more' if ratio > 1 else 'less'}"


def _checks(theatre: str, outcome: Outcome) -> Iterator[Check]:
    none, subtractive, ours = (outcome.seen[m] for m in ("none", "subtractive", "perceptual"))
    yield at_least(f"{theatre}: share of the screen clamped", outcome.clipped, 0.5)
    yield at_most(f"{theatre}: dark detail seen, subtractive", subtractive.detail, 0.1)
    yield at_least(
        f"{theatre}: dark detail seen, over that of subtraction",
        ours.detail / subtractive.detail,
        2,
    )
    yield at_most(
        f"{theatre}: dark half, over that of no compensation", ours.dark / none.dark, 0.95
    )
    for what, shown, before in (
        ("contrast of 2 to 10°", ours.plain.contrast_coarse, subtractive.plain.contrast_coarse),
        ("stars in order", ours.plain.stars_in_order, none.plain.stars_in_order),
    ):
        if shown is not None and before is not None:
            ratio = shown / before
            yield at_least(f"{theatre}: {what}, over subtraction or untouched", ratio, 0.99)
    for name, other in (("no compensation", none), ("subtraction", subtractive)):
        yield at_least(
            f"{theatre}: relative contrast in the dark, over that of {name}",
            ours.contrast / other.contrast,
            1.01,
        )
        yield at_least(
            f"{theatre}: quality gained over {name}", other.lost - ours.lost, NO_DIFFERENCE, "JOD"
        )


def _table(theatre: str, outcome: Outcome) -> Table:
    return Table(
        caption=f"What is seen of the bundled night in {theatre}; dark is below the median.",
        columns=(
            Column(name="seen"),
            Column(name="quality lost", unit="JOD"),
            Column(name="fine dark detail seen", unit="%", digits=".1f"),
            Column(name="contrast seen, 0.25 to 1°", unit="%", digits=".1f"),
            Column(name="contrast seen, 2 to 10°", unit="%", digits=".1f"),
            Column(name="stars in order", unit="%", digits=".1f"),
            Column(name="black over untouched", digits=".2f"),
            Column(name="relative contrast in the dark", digits=".3f"),
            Column(name="dark half", unit="cd/m²"),
            Column(name="its hue shifts by", unit="°", digits=".1f"),
            Column(name="its saturation", digits=".2f"),
        ),
        rows=tuple(
            (
                ROWS[name],
                one.lost,
                100 * one.detail,
                *(
                    None if share is None else 100 * share
                    for share in (
                        one.plain.contrast_fine,
                        one.plain.contrast_coarse,
                        one.plain.stars_in_order,
                    )
                ),
                one.plain.black,
                one.contrast,
                one.dark,
                one.hue,
                one.saturation,
            )
            for name, one in outcome.seen.items()
        ),
    )
