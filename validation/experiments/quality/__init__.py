"""Quality: which method shows what is wanted best, on pictures that no setting was chosen on.

Rationale
    Inputs are of two halves: settings were chosen on the one, and all that is claimed is of the
    other. Stereo pairs are shown in `stereo_polarised_paper`
    with crosstalk of 2, 5 and 10 %, domemasters in `dome_hemisphere` with albedos of 0.3, 0.5 and
    0.7, each at a white of 5, 15 and 48 cd/m², a black of 1/2000 of it (the least sequential
    contrast of SMPTE RP 431-2's reference projector) and an adaptation to 1/10 of it. Every method
    knows the pollution exactly. Ten judges compare what is seen with the master (`panel`); six of
    them judge structure and contrast. Plain figures stand beside them (`seen`). For pairs there is
    the *ghost contour* (`contour`), of light and of contrast, and the share of the other eye's
    slopes in the residual's. Gains are averaged over an input's pollutions and luminances first,
    and intervals are Student's over inputs.
Expected
    What the choosing half has, the reporting half has as well. Domes gain at least 0.25 JOD over
    the better of nothing and subtraction, with an interval above 0.1, and no case of a dome is more
    than 0.02 JOD below it; pairs lose nothing in the mean. Of all methods, the default has the best
    mean rank with the judges of structure in pairs; in domes a lower lift has, of 1. What
    subtraction shows exactly, where the base is not lifted, keeps 0.98 to 1.05 of its light in the
    median and 0.9 in its 5th percentile, and at most 2.5 % of it shifts by more than 0.01 in u'v'.
    Ghost contours fall to 1/1.5 of subtraction's, and lit things keep 0.97 of their light.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from domesim.light import Light
from validation import inputs, panel
from validation.crops import caption
from validation.experiment import Finding, Panel, Pictures, Work
from validation.experiments.quality import verdict
from validation.experiments.quality.measuring import KNOB, WAYS, Case, Cell, measure
from validation.inputs import CHOOSING, DOMEMASTERS, Input, Place, words


def run(work: Work) -> Finding:
    """Every way for every input at every place."""
    wanted, left_out = inputs.wanted(work)
    cells: dict[Place, dict[str, Cell]] = {}
    pictures: list[Pictures] = []
    for name, one in wanted.items():
        light = cache(one.read)
        for place in inputs.places(work, name, one):
            case = cache(partial(_case, light, one, place))
            cells[place] = _measured(work, place, one, case)
            if _usual(place, one):
                pictures.append(_side_by_side(work, place, one, case, cells[place]))
    judged = {judge for ways in cells.values() for cell in ways.values() for judge in cell.judged}
    missing = [judge.name for judge in panel.PANEL if judge.name not in judged]
    if missing:
        left_out.append(f"{', '.join(missing)}: they need pip install 'domesim[metrics]'")
    if work.quick:
        left_out.append("What is expected of the judges: with a full run; two inputs say nothing")
    return Finding(
        result=verdict.told(cells, wanted),
        checks=tuple(verdict.checks(cells, wanted, judged=not (missing or work.quick))),
        tables=tuple(verdict.tables(cells, wanted)),
        pictures=tuple(pictures),
        figures=verdict.figures(cells, wanted),
        left_out=tuple(left_out),
    )


def _measured(work: Work, place: Place, one: Input, case: Callable[[], Case]) -> dict[str, Cell]:
    """Every way at a place, a step each. The choosing half has the judges of structure only."""
    usual = _usual(place, one)
    ways = {**WAYS, **KNOB} if usual else WAYS
    judges = panel.PANEL
    if place[0] in CHOOSING:
        judges = tuple(judge for judge in judges if judge.of_structure)
    if work.quick:
        judges = tuple(judge for judge in judges if judge.name == verdict.JUDGE)

    def measured(name: str) -> Cell:
        return measure(case(), ways[name], judges, name if usual else "")

    where = words(place)
    return {name: work.step(f"{where}: {name}", Cell, partial(measured, name)) for name in ways}


def _usual(place: Place, one: Input) -> bool:
    return place[1:] == (one.usual, inputs.USUAL_LUMINANCE)


def _case(light: Callable[[], Light], one: Input, place: Place) -> Case:
    return Case(light, one.scene(*place[1:]))


def _side_by_side(
    work: Work, place: Place, one: Input, case: Callable[[], Case], ways: dict[str, Cell]
) -> Pictures:
    """What is wanted, and what is seen of each way."""

    def master() -> tuple[Panel, int]:
        return case().crop.master

    first, brighter = work.step(f"{words(place)}: master", tuple[Panel, int], master)
    text = caption(words(place), brighter, views=1 if one.kind == DOMEMASTERS else 2)
    panels = (panel for cell in ways.values() for panel in cell.panels)
    return Pictures(caption=text, panels=(first, *panels))
