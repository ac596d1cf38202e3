"""Quality: which method shows what is wanted best, by two judges that no objective knows.

Rationale
    Stereo pairs in `stereo_polarised_paper` with crosstalk of 1, 2, 5 and 10 %, and domemasters in
    `dome_hemisphere` with albedos of 0.3, 0.5 and 0.7, each at a white of 5, 15 and 48 cd/m², a
    black of 1/2000 of it (the least sequential contrast of SMPTE RP 431-2's reference projector)
    and an adaptation to 1/10 of it (chosen, as in the scenes). Every method knows the pollution
    exactly. What is seen is compared with the master by ColorVideoVDP and by FLIP. For pairs there
    is the *ghost contour*, for the paper's reason to compensate is that conflicting edges hinder
    fusion: with e and g the luminance that is seen too much, now and of the untouched master, C =
    sqrt(sum (grad e . n)² / sum (grad g . n)²), n = grad g / |grad g|: the slopes of the error
    across the edges of the other eye's picture, 1 if nothing is done and 0 if none of them is left;
    an edge that is overcorrected counts as one that is left. Gradients are of planes smoothed as
    for the ghost edge energy (`compensate.ghosts`). The sums go over edges where subtraction
    clips: of the pixels where it shows more light than is wanted in some primary, the fewest that
    hold nine tenths of the sum of |grad g|² there. It is given of light, and of contrast: of log(Y
    + 0.01) in place of the luminance Y (1 = white), which forgives what a veil hides. A *new
    artefact* is a place where ColorVideoVDP's heatmap has lost 0.5 JOD more than with subtraction
    and more than with nothing. Of domemasters, in which pollution takes the hue of what is dark,
    there is its shift in the darker half (u'v', around white). Pictures are averaged down by whole
    numbers of pixels, and seen as large as the screen: with 10 pixels a degree at most, finer
    ringing cannot be seen. Inputs are the sample: gains are averaged over an input's pollutions and
    luminances first, and intervals are Student's over inputs. Pollutions and luminances weigh
    alike.
Expected
    Where subtraction leaves what is seen (its JOD is below 9.9), weighting local contrast gains at
    least 0.1 JOD over it on average, and the 95 % interval of the gain lies above 0; no frame is
    more than 0.02 JOD below the better of subtraction and nothing; the ghost contour where
    subtraction clips falls to half of subtraction's; new artefacts cover at most 1 % of any screen;
    in domes the hue of the darker half shifts less than half as much as with subtraction. Two laws
    hold whatever judges say: what minimises a visible error has the least of all, well below
    subtraction's, and within its certified gap of 1e-3.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from domesim.light import Light
from validation import judges
from validation.experiment import Finding, Panel, Pictures, Work
from validation.experiments.quality import inputs, plots, tables, verdict
from validation.experiments.quality.inputs import Input, Place, words
from validation.experiments.quality.judging import Case, Cell, measure
from validation.experiments.quality.pictures import side_by_side
from validation.experiments.quality.ways import MAIN, SHOWN, WAYS


def run(work: Work) -> Finding:
    """Every way for every input at every place."""
    wanted, left_out = inputs.wanted(work)
    luminances = (inputs.USUAL_LUMINANCE,) if work.quick else inputs.LUMINANCES
    cells: dict[Place, dict[str, Cell]] = {}
    pictures: list[Pictures] = []
    for name, one in wanted.items():
        light = cache(one.read)
        for pollution in one.pollutions:
            for white in luminances:
                case = cache(partial(_case, light, one, pollution, white))
                place = (name, pollution, white)
                shown = (pollution, white) == (one.usual, inputs.USUAL_LUMINANCE)
                cells[place] = _measured(work, place, case, pictures=shown)
                if shown:
                    title = f"{words(place)}: master"
                    master = work.step(title, tuple[Panel, int], partial(_master, case))
                    rows = [cells[place][way].panels for way in SHOWN]
                    pictures.append(side_by_side(place, one, master, rows))
    every = [cell for ways in cells.values() for cell in ways.values()]
    judged = all(cell.quality is not None for cell in every)
    left_out += judges.left_out(
        {
            "FLIP": [cell.flip for cell in every],
            "ColorVideoVDP": [cell.quality for cell in every],
        }
    )
    if work.quick:
        left_out.append("What is expected of the judges: with a full run; two inputs say nothing")
    checks = list(verdict.laws(cells))
    if judged and not work.quick:
        checks += verdict.expectations(cells)
    return Finding(
        result=verdict.told(cells, wanted, judged=judged),
        checks=tuple(checks),
        tables=tuple(tables.written(cells, wanted, judged=judged)),
        plots=tuple(plots.drawn(cells, wanted)) if judged else (),
        pictures=tuple(pictures),
        figures=tables.by_name(cells),
        left_out=tuple(left_out),
    )


def _measured(
    work: Work, place: Place, case: Callable[[], Case], *, pictures: bool
) -> dict[str, Cell]:
    """Every way at a place, a step each."""

    def one(name: str) -> Cell:
        return measure(case(), WAYS[name], pictures=pictures and name in SHOWN)

    ways = WAYS if place[2] == inputs.USUAL_LUMINANCE else MAIN
    return {name: work.step(f"{words(place)}: {name}", Cell, partial(one, name)) for name in ways}


def _case(light: Callable[[], Light], one: Input, pollution: float, white: float) -> Case:
    return Case(light, one.scene(pollution, white))


def _master(case: Callable[[], Case]) -> tuple[Panel, int]:
    return case().crop.master
