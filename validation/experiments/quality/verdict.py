"""What is expected of the figures, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TypeAlias

import numpy as np

from validation import panel
from validation.experiment import Cell as Entry
from validation.experiment import Check, Column, Table, at_least, at_most
from validation.experiments.quality.measuring import (
    DEFAULT,
    LOWER,
    NOTHING,
    SUBTRACTION,
    WAYS,
    Cell,
)
from validation.inputs import (
    CHOOSING,
    DOMEMASTERS,
    PAIRED,
    Input,
    Place,
    kinds,
    words,
)
from validation.statistics import Estimate, estimate

SHORT = 0.02
"""JOD below the better of nothing and subtraction that nobody minds."""
JUDGE = "ColorVideoVDP"

Cells: TypeAlias = Mapping[Place, Mapping[str, Cell]]
"""What every way does, by its name."""


def reported(cells: Cells) -> Cells:
    """Those of inputs that no setting was chosen on."""
    return {place: ways for place, ways in cells.items() if place[0] not in CHOOSING}


def of_kind(cells: Cells, wanted: Mapping[str, Input], kind: str) -> Cells:
    """Those of pairs, or of domemasters."""
    names = kinds(wanted).get(kind, [])
    return {place: ways for place, ways in cells.items() if place[0] in names}


def beyond(ways: Mapping[str, Cell], way: str) -> float:
    """JOD over the better of nothing and subtraction."""
    plain = max(ways[name].judged[JUDGE] for name in (NOTHING, SUBTRACTION))
    return ways[way].judged[JUDGE] - plain


def gain(cells: Cells, way: str) -> Estimate:
    """Mean of `beyond` over inputs."""
    by_input: dict[str, list[float]] = {}
    for place, ways in cells.items():
        by_input.setdefault(place[0], []).append(beyond(ways, way))
    return estimate(float(np.mean(values)) for values in by_input.values())


def ranks(
    cells: Cells, judges: Iterable[panel.Judge], names: Iterable[str] = tuple(WAYS)
) -> dict[str, float]:
    """Mean rank of each way over cases and judges, 1 = best."""
    found: dict[str, list[float]] = {name: [] for name in names}
    for judge in judges:
        for ways in cells.values():
            sign = -1 if judge.higher_is_better else 1
            values = {name: sign * ways[name].judged[judge.name] for name in found}
            for name, value in values.items():
                below = sum(other < value for other in values.values())
                ties = sum(other == value for other in values.values())
                found[name].append(below + (ties + 1) / 2)
    return {name: float(np.mean(values)) for name, values in found.items()}


def falls(cells: Cells, figure: str) -> list[float]:
    """How many times less than subtraction's a figure of pairs is, case by case."""
    found = []
    for ways in cells.values():
        plain, ours = (getattr(ways[name], figure) for name in (SUBTRACTION, DEFAULT))
        if plain is not None and ours is not None and min(abs(plain), abs(ours)) > 0:
            found.append(abs(plain / ours))
    return found


def checks(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> Iterator[Check]:
    """Laws; and, if all judges are there, what is expected of them on the reporting half."""
    yield at_most(
        "nothing done: difference of its ghost contour to 1, the largest",
        max((abs((ways[NOTHING].contour or 1) - 1) for ways in cells.values()), default=0.0),
        1e-9,
    )
    ours = reported(cells)
    yield from _of_exact([ways[DEFAULT] for ways in ours.values()])
    if not judged:
        return
    domes, pairs = (of_kind(ours, wanted, kind) for kind in (DOMEMASTERS, PAIRED))
    over = "over the better of nothing and subtraction"
    found = gain(domes, DEFAULT)
    yield at_least(f"domes: gain {over}, mean over inputs", found.mean, 0.25, "JOD")
    yield at_least(f"domes: gain {over}, lower end of its 95 % interval", found.low, 0.1, "JOD")
    worst = min(domes, key=lambda place: beyond(domes[place], DEFAULT))
    yield at_least(
        f"domes: gain {over}, worst case ({words(worst)})",
        beyond(domes[worst], DEFAULT),
        -SHORT,
        "JOD",
    )
    yield at_least(f"pairs: gain {over}, mean over inputs", gain(pairs, DEFAULT).mean, 0.0, "JOD")
    for what, figure in (("of light", "contour"), ("of contrast", "contrast_contour")):
        yield at_least(
            f"pairs: subtraction's ghost contour {what} over the default's, mean over cases",
            float(np.mean(falls(pairs, figure))),
            1.5,
        )
    yield at_least(
        "pairs: subtraction's share of the other eye's slopes over the default's, median",
        float(np.median(falls(pairs, "other_eye"))),
        1.5,
    )
    yield at_least(
        "pairs: light of lit things over the master's, least of all cases",
        min(ways[DEFAULT].lit for ways in pairs.values()),
        0.97,
    )
    for kind, part, way in (("domes", _usual(domes), LOWER), ("pairs", pairs, DEFAULT)):
        names = [way, *(name for name in WAYS if name != DEFAULT)]
        by_rank = ranks(part, (judge for judge in panel.PANEL if judge.of_structure), names)
        yield at_most(
            f"{kind}: mean rank of {way} with the judges of structure, over the best other's",
            by_rank.pop(way) / min(by_rank.values()),
            1.0,
        )


def _usual(cells: Cells) -> Cells:
    """Those at which the knob was turned."""
    return {place: ways for place, ways in cells.items() if LOWER in ways}


def _of_exact(cells: list[Cell]) -> Iterator[Check]:
    """The law: what is exact and is not lifted stays."""
    kept = [cell.kept for cell in cells if cell.kept is not None]
    fifth = [cell.kept_fifth for cell in cells if cell.kept_fifth is not None]
    shifted = [cell.shifted for cell in cells if cell.shifted is not None]
    if not kept:
        return
    what = "of what is exact and not lifted"
    yield at_least(f"light {what}, median, least of all cases", min(kept), 0.98)
    yield at_most(f"light {what}, median, largest of all cases", max(kept), 1.05)
    yield at_least(f"light {what}, 5th percentile, least of all cases", min(fifth), 0.9)
    yield at_most(
        f"share {what} whose u'v' shifts by more than 0.01, the largest", max(shifted), 0.025
    )


def told(cells: Cells, wanted: Mapping[str, Input]) -> str:
    """What was found, in words."""
    half = reported(cells)
    text = (
        f"{len(half)} cases (an input at a pollution and a luminance) of "
        f"{len({place[0] for place in half})} inputs that no setting was chosen on; "
        f"{len(cells) - len(half)} cases of inputs that settings were chosen on."
    )
    for kind in (DOMEMASTERS, PAIRED):
        for title, part in (("Reporting", half), ("choosing", _others(cells))):
            some = of_kind(part, wanted, kind)
            if some and all(JUDGE in ways[DEFAULT].judged for ways in some.values()):
                worst = min(beyond(ways, DEFAULT) for ways in some.values())
                text += (
                    f"\n\n{title} {kind}: {gain(some, DEFAULT).written} JOD over the better of "
                    f"nothing and subtraction, {worst:+.3f} in the worst case; more than {SHORT:g} "
                    f"below it in {_short(some)} of {len(some)} cases."
                )
                judges = [j for j in panel.PANEL if j.of_structure and _heard(some, j)]
                by_rank = ranks(some, judges)
                text += (
                    " Mean ranks with the judges of structure: "
                    + ", ".join(f"{name} {rank:.2f}" for name, rank in by_rank.items())
                    + "."
                )
    return text


def figures(cells: Cells, wanted: Mapping[str, Input]) -> dict[str, float | None]:
    """What the README quotes, of the reporting half."""
    found: dict[str, float | None] = {}
    for kind in (DOMEMASTERS, PAIRED):
        part = of_kind(reported(cells), wanted, kind)
        if not part or any(JUDGE not in ways[DEFAULT].judged for ways in part.values()):
            continue
        ours = gain(part, DEFAULT)
        found[f"quality.{kind}.gain"] = ours.mean
        found[f"quality.{kind}.gain.low"] = ours.low
        found[f"quality.{kind}.gain.high"] = ours.high
        found[f"quality.{kind}.worst"] = min(beyond(ways, DEFAULT) for ways in part.values())
        found[f"quality.{kind}.paper"] = gain(part, "paper's weighting").mean
        found[f"quality.{kind}.short"] = float(_short(part))
        found[f"quality.{kind}.cases"] = float(len(part))
        found[f"quality.{kind}.inputs"] = float(ours.inputs)
        if kind == PAIRED:
            found["quality.contour"] = float(np.mean(falls(part, "contour")))
    return found


def tables(cells: Cells, wanted: Mapping[str, Input]) -> Iterator[Table]:
    """Ranks by judge, plain figures by way, and all cases."""
    half = reported(cells)
    for kind in (DOMEMASTERS, PAIRED):
        part = of_kind(half, wanted, kind)
        if not part:
            continue
        yield _by_judge(kind, part)
        yield _plain(kind, part)
    yield _by_place(cells)


def _by_judge(kind: str, cells: Cells) -> Table:
    known = [judge for judge in panel.PANEL if _heard(cells, judge)]
    return Table(
        caption=f"Reporting {kind}: mean of each judge's figures, and mean ranks (1 = best).",
        columns=(
            Column(name="judge"),
            Column(name="of structure"),
            *(Column(name=name, digits=".4g") for name in WAYS),
            *(Column(name=f"rank of {name}", digits=".2f") for name in WAYS),
        ),
        rows=tuple(
            (
                judge.name,
                judge.of_structure,
                *(_mean(ways[name].judged[judge.name] for ways in cells.values()) for name in WAYS),
                *ranks(cells, [judge]).values(),
            )
            for judge in known
        ),
    )


def _plain(kind: str, cells: Cells) -> Table:
    names = list(dict.fromkeys(name for ways in cells.values() for name in ways))
    rows: list[tuple[Entry, ...]] = []
    for name in names:
        some = [ways[name] for ways in cells.values() if name in ways]
        rows.append(
            (
                name,
                len(some),
                *(_mean(cell.structure[band] for cell in some) for band in range(3)),
                _mean(cell.hue for cell in some),
                _mean(cell.saturation for cell in some),
                max((100 * cell.halos for cell in some if cell.halos is not None), default=None),
                _mean(cell.black for cell in some),
                _mean(cell.kept for cell in some),
                _mean(cell.contour for cell in some),
                _mean(cell.contrast_contour for cell in some),
                min(cell.lit for cell in some),
            )
        )
    return Table(
        caption=f"Reporting {kind}: plain figures, means (of lifts 1 and 4 over usual cases).",
        columns=(
            Column(name="way"),
            Column(name="cases"),
            *(
                Column(name=f"structure of {size}", digits=".2f")
                for size in ("0.25-1°", "2-10°", "10-30°")
            ),
            Column(name="hue shift in the dark", unit="°", digits=".0f"),
            Column(name="saturation in the dark", digits=".2f"),
            Column(name="halos, most", unit="% of the screen", digits=".2f"),
            Column(name="black", unit="cd/m²", digits=".3f"),
            Column(name="light kept where exact", digits=".3f"),
            Column(name="ghost contour", digits=".3f"),
            Column(name="of contrast", digits=".3f"),
            Column(name="light of lit things, least", digits=".3f"),
        ),
        rows=tuple(rows),
    )


def _by_place(cells: Cells) -> Table:
    rows: list[tuple[Entry, ...]] = [
        (
            *place,
            "choosing" if place[0] in CHOOSING else "reporting",
            *(ways[name].judged.get(JUDGE) for name in WAYS),
            ways[DEFAULT].kept,
            ways[SUBTRACTION].contour,
            ways[DEFAULT].contour,
        )
        for place, ways in cells.items()
    ]
    return Table(
        caption="All cases: ColorVideoVDP of each method, JOD. Pollution is crosstalk or albedo.",
        columns=(
            Column(name="input"),
            Column(name="pollution", digits="g"),
            Column(name="white", unit="cd/m²", digits="g"),
            Column(name="half"),
            *(Column(name=name, digits=".3f") for name in WAYS),
            Column(name="light kept where exact", digits=".3f"),
            Column(name="contour, subtraction", digits=".3f"),
            Column(name="contour, default", digits=".3f"),
        ),
        rows=tuple(rows),
    )


def _short(cells: Cells) -> int:
    """Cases that fall short by more than `SHORT`."""
    return sum(beyond(ways, DEFAULT) < -SHORT for ways in cells.values())


def _heard(cells: Cells, judge: panel.Judge) -> bool:
    return all(judge.name in ways[DEFAULT].judged for ways in cells.values())


def _others(cells: Cells) -> Cells:
    return {place: ways for place, ways in cells.items() if place[0] in CHOOSING}


def _mean(values: Iterable[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None
