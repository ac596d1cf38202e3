"""Quality: which method shows what is wanted best, on pictures that no setting was chosen on.

Rationale
    Inputs are of two halves: settings were chosen, and pictures looked at, on the one; all that is
    claimed is of the other. Stereo pairs are shown in `stereo_polarised_paper` with crosstalk of 2,
    5 and 10 %, domemasters in `dome_hemisphere` with albedos of 0.3, 0.5 and 0.7, at a white of 5,
    15 or 48 cd/m² (`inputs.CROSSTALK_PLACES`, `ALBEDO_PLACES`), a black of 1/2000 of it (the least
    sequential contrast of SMPTE RP 431-2's reference projector) and an adaptation to 1/10 of it.
    Every method knows the pollution exactly. Before any figure counts, what is seen must keep the
    laws (`laws`), on every case of both halves. Of the reporting half nine judges compare it with
    the master (`panel`) and have one vote each; six of them judge structure and contrast. Plain
    figures stand beside them (`seen`). The paper's weighting and other lifts are tried at the usual
    place only: an albedo of 0.5 or a crosstalk of 5 %, at 15 cd/m². Gains are averaged over an
    input's cases first, and intervals are Student's over inputs.
Expected
    The default keeps every law, as nothing and subtraction do. Domes: in the mean it is better than
    nothing by every judge (by FovVideoVDP at least -0.02 JOD) and better than subtraction by every
    judge of structure; it has the best mean rank of all methods, and is last by any judge in at
    most one input of eight. By ColorVideoVDP it is 0.12 JOD over the better of nothing and
    subtraction in the mean, and in no case more than 0.02 JOD below. Pairs: in the mean it is no
    worse than nothing by any judge, nor than subtraction by those of JOD (0.02 JOD are no
    difference); at most one case of
    twelve is more than 0.02 JOD below the better; pure black gets at most a third of the light that
    the default before these laws gave it, and lit things keep 0.97 of theirs. What subtraction
    shows exactly, where the base is not lifted, keeps 0.98 to 1.05 of its light in the median and
    0.9 in its 5th percentile, and at most 2.5 % of it shifts by more than 0.01 in u'v'.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from domesim.light import Light
from validation import inputs, panel
from validation.experiment import Finding, Panel, Pictures, Work
from validation.experiments.quality import verdict
from validation.experiments.quality.measuring import KNOB, SLOW, WAYS, Case, Cell, measure
from validation.inputs import DOMEMASTERS, Input, Place, words


def run(work: Work) -> Finding:
    """Every way for every input at every place."""
    wanted, left_out = inputs.wanted(work)
    cells: dict[Place, dict[str, Cell]] = {}
    pictures: list[Pictures] = []
    for name, one in wanted.items():
        light = cache(one.read)
        for place in inputs.places(work, name, one):
            case = cache(partial(_case, one, light, place))
            cells[place] = _measured(work, place, one, case)
            if _usual(place, one):
                pictures.append(_side_by_side(work, place, one, case, cells[place]))
    heard = {judge for ways in cells.values() for cell in ways.values() for judge in cell.judged}
    missing = [judge.name for judge in panel.PANEL if judge.name not in heard]
    if work.quick:
        left_out.append("What is expected of the judges: not judged in a quick run")
    elif missing:
        left_out.append(
            f"What is expected of the judges: not judged; {', '.join(missing)} need "
            f"pip install 'domesim[metrics]'"
        )
    return Finding(
        result=verdict.told(cells, wanted),
        checks=tuple(verdict.checks(cells, wanted, judged=not (missing or work.quick))),
        tables=tuple(verdict.tables(cells, wanted)),
        pictures=tuple(pictures),
        figures=verdict.figures(cells, wanted),
        left_out=tuple(left_out),
        judged=not (missing or work.quick),
    )


def _measured(work: Work, place: Place, one: Input, case: Callable[[], Case]) -> dict[str, Cell]:
    """Every way at a place, a step each; judges are heard of the reporting half alone."""
    usual, reported = _usual(place, one), place[0] not in inputs.CHOOSING
    ways = {**WAYS, **SLOW, **KNOB} if usual and (reported or work.quick) else WAYS
    judges = panel.PANEL if reported and not work.quick else ()

    def measured(name: str) -> Cell:
        return measure(case(), ways[name], judges, name if usual else "", work.heard)

    where = words(place)
    return {name: work.step(f"{where}: {name}", Cell, partial(measured, name)) for name in ways}


def _usual(place: Place, one: Input) -> bool:
    return place[1:] == (one.usual, inputs.USUAL_LUMINANCE)


def _case(one: Input, light: Callable[[], Light], place: Place) -> Case:
    return Case(one, light, one.scene(*place[1:]))


def _side_by_side(
    work: Work, place: Place, one: Input, case: Callable[[], Case], ways: dict[str, Cell]
) -> Pictures:
    """What is wanted, and what is seen of each way."""

    def master() -> tuple[Panel, int]:
        return case().picture("master", case().plain.wanted), case().brighter

    first, brighter = work.step(f"{words(place)}: master", tuple[Panel, int], master)
    where = (
        "the whole domemaster" if one.kind == DOMEMASTERS else "the left eye's region of a ghost"
    )
    text = f"{words(place)}: {where}, {brighter} times brighter than it is."
    panels = (panel for cell in ways.values() for panel in cell.panels)
    return Pictures(caption=text, panels=(first, *panels))
