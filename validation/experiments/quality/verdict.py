"""What is expected of the figures, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TypeAlias

import numpy as np

from testing.statistics import Estimate, estimate
from validation import laws, panel
from validation.experiment import Cell as Entry
from validation.experiment import Check, Column, Table, at_least, at_most, equal
from validation.experiments.quality.measuring import (
    ADDED,
    DEFAULT,
    KNOB,
    NOTHING,
    SUBTRACTION,
    WAYS,
    Cell,
)
from validation.inputs import CHOOSING, DOMEMASTERS, PAIRED, Input, Place, kinds, words

SHORT = 0.02
"""JOD that are no difference."""
JUDGE, OTHER = "ColorVideoVDP", "FovVideoVDP"
"""The judges whose figures are JOD."""
BEST = 100.0
"""PSNR that counts as that of equal pictures, dB, in means."""
ADDED_BEFORE = 5.3e-4
"""`ADDED` of the default before these laws, mean over the reporting half."""

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
    """JOD of ColorVideoVDP over the better of nothing and subtraction."""
    plain = max(ways[name].judged[JUDGE] for name in (NOTHING, SUBTRACTION))
    return ways[way].judged[JUDGE] - plain


def gain(cells: Cells, way: str) -> Estimate:
    """Mean of `beyond` over inputs."""
    by_input: dict[str, list[float]] = {}
    for place, ways in cells.items():
        by_input.setdefault(place[0], []).append(beyond(ways, way))
    return estimate(float(np.mean(values)) for values in by_input.values())


def better(cells: Cells, judge: panel.Judge, other: str) -> float:
    """How much better the default is than another way by a judge, mean over cases."""
    ours, theirs = (mean_of(cells, judge, way) for way in (DEFAULT, other))
    return (ours - theirs) * (1 if judge.higher_is_better else -1)


def ranks(
    cells: Cells, judges: Iterable[panel.Judge], names: Iterable[str] = ()
) -> dict[str, float]:
    """Mean rank of each way over cases and judges, 1 = best; of all that every case has."""
    found: dict[str, list[float]] = {name: [] for name in names or _common(cells)}
    for judge in judges:
        for ways in cells.values():
            badness = {name: _badness(ways[name], judge) for name in found}
            for name, value in badness.items():
                below = sum(other < value for other in badness.values())
                ties = sum(other == value for other in badness.values())
                found[name].append(below + (ties + 1) / 2)
    return {name: float(np.mean(values)) for name, values in found.items()}


def last(cells: Cells, judges: Iterable[panel.Judge]) -> dict[str, list[str]]:
    """Input -> judges by which the default is the last of all ways, in the mean of its cases."""
    found: dict[str, list[str]] = {}
    for name in dict.fromkeys(place[0] for place in cells):
        some = {place: ways for place, ways in cells.items() if place[0] == name}
        for judge in judges:
            sign = -1 if judge.higher_is_better else 1
            ours, *others = (
                sign * mean_of(some, judge, way)
                for way in (DEFAULT, *(way for way in _common(some) if way != DEFAULT))
            )
            if ours > max(others):
                found.setdefault(name, []).append(judge.name)
    return found


def checks(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> Iterator[Check]:
    """The laws; and, if all judges are there, what is expected of them on the reporting half."""
    yield from _of_laws(cells)
    ours = reported(cells)
    yield from _of_exact([ways[DEFAULT].plain for ways in ours.values()])
    pairs = of_kind(ours, wanted, PAIRED)
    lit = [ways[DEFAULT].plain["light of lit things"] for ways in pairs.values()]
    if lit:
        yield at_least("pairs: light of lit things over the master's, least", min(lit), 0.97)
    if judged:
        yield from _of_domes(of_kind(ours, wanted, DOMEMASTERS))
        yield from _of_pairs(pairs)


def _of_laws(cells: Cells) -> Iterator[Check]:
    for law in laws.LAWS:
        found = {
            place: ways[DEFAULT].laws[law.name]
            for place, ways in cells.items()
            if law.name in ways[DEFAULT].laws
        }
        if found:
            worst = max(found, key=lambda place: found[place])
            what = f"law of {law.name}: the default, worst of {len(found)} cases ({words(worst)})"
            yield at_most(what, found[worst], law.bound)
    broken = sum(len(laws_broken(ways[way])) for ways in cells.values() for way in _PLAIN)
    yield equal("laws that nothing or subtraction breaks, in all cases", broken, 0)


def _of_exact(figures: list[dict[str, float]]) -> Iterator[Check]:
    """The law: what is exact and is not lifted stays."""
    kept, fifth, shifted = (
        [plain[name] for plain in figures if name in plain]
        for name in ("light kept where exact", "5th percentile of it", "shifted where exact")
    )
    if not kept:
        return
    what = "of what is exact and not lifted"
    yield at_least(f"light {what}, median, least of all cases", min(kept), 0.98)
    yield at_most(f"light {what}, median, largest of all cases", max(kept), 1.05)
    yield at_least(f"light {what}, 5th percentile, least of all cases", min(fifth), 0.9)
    yield at_most(
        f"share {what} whose u'v' shifts by more than 0.01, the largest", max(shifted), 0.025
    )


def _of_domes(cells: Cells) -> Iterator[Check]:
    for judge in panel.PANEL:
        bound = -SHORT if judge.name == OTHER else 0.0
        what = f"domes: {judge.name}, the default over nothing, mean"
        yield at_least(what, better(cells, judge, NOTHING), bound)
    for judge in panel.PANEL:
        if judge.of_structure:
            what = f"domes: {judge.name}, the default over subtraction, mean"
            yield at_least(what, better(cells, judge, SUBTRACTION), 0.0)
    by_rank = ranks(_usual(cells), panel.PANEL, _methods(_usual(cells)))
    yield at_most(
        "domes: mean rank of the default with all judges, over the best other method's",
        by_rank.pop(DEFAULT) / min(by_rank.values()),
        1.0,
    )
    inputs = len({place[0] for place in cells})
    yield at_most(
        "domes: share of inputs by which the default is last by any judge",
        len(last(cells, panel.PANEL)) / inputs,
        1 / 8,
    )
    over = f"domes: {JUDGE}, the default over the better of nothing and subtraction"
    worst = min(cells, key=lambda place: beyond(cells[place], DEFAULT))
    yield at_least(f"{over}, mean over inputs", gain(cells, DEFAULT).mean, 0.12, "JOD")
    yield at_least(
        f"{over}, worst case ({words(worst)})", beyond(cells[worst], DEFAULT), -SHORT, "JOD"
    )


def _of_pairs(cells: Cells) -> Iterator[Check]:
    for judge in panel.PANEL:
        in_jod = judge.name in (JUDGE, OTHER)
        for other in _PLAIN if in_jod else (NOTHING,):
            what = f"pairs: {judge.name}, the default over {other}, mean"
            yield at_least(what, better(cells, judge, other), -SHORT if in_jod else 0.0)
    below = f"more than {SHORT:g} JOD below the better of nothing and subtraction"
    yield at_most(
        f"pairs: share of cases {below}",
        _short(cells) / len(cells),
        1 / 12,
    )
    added = [ways[DEFAULT].plain[ADDED] for ways in cells.values() if ADDED in ways[DEFAULT].plain]
    yield at_most(f"pairs: {ADDED}, mean over cases", float(np.mean(added)), ADDED_BEFORE / 3)


def told(cells: Cells, wanted: Mapping[str, Input]) -> str:
    """What was found, in words."""
    half = reported(cells)
    text = (
        f"{len(half)} cases (an input at a pollution and a luminance) of "
        f"{len({place[0] for place in half})} inputs that no setting was chosen on; "
        f"{len(cells) - len(half)} cases of inputs that settings were chosen on."
    )
    for kind in (DOMEMASTERS, PAIRED):
        some = of_kind(half, wanted, kind)
        heard = [judge for judge in panel.PANEL if _heard(some, judge)]
        if some and JUDGE in (judge.name for judge in heard):
            worst = min(beyond(ways, DEFAULT) for ways in some.values())
            by_rank = ranks(_usual(some), heard)
            text += (
                f"\n\nReporting {kind}: {gain(some, DEFAULT).written} JOD over the better of "
                f"nothing and subtraction, {worst:+.3f} in the worst case; more than {SHORT:g} "
                f"below it in {_short(some)} of {len(some)} cases. Mean ranks with "
                f"{len(heard)} judges: "
                + ", ".join(f"{name} {rank:.2f}" for name, rank in by_rank.items())
                + ". Last by some judge: "
                + "; ".join(f"{n} ({', '.join(j)})" for n, j in last(some, heard).items())
                + "."
            )
    return text


def figures(cells: Cells, wanted: Mapping[str, Input]) -> dict[str, float | None]:
    """What may be quoted, of the reporting half."""
    found: dict[str, float | None] = {}
    for kind in (DOMEMASTERS, PAIRED):
        part = of_kind(reported(cells), wanted, kind)
        heard = [judge for judge in panel.PANEL if _heard(part, judge)]
        if not part or JUDGE not in (judge.name for judge in heard):
            continue
        ours = gain(part, DEFAULT)
        found[f"quality.{kind}.gain"] = ours.mean
        found[f"quality.{kind}.gain.low"] = ours.low
        found[f"quality.{kind}.gain.high"] = ours.high
        found[f"quality.{kind}.worst"] = min(beyond(ways, DEFAULT) for ways in part.values())
        found[f"quality.{kind}.short"] = float(_short(part))
        found[f"quality.{kind}.cases"] = float(len(part))
        found[f"quality.{kind}.inputs"] = float(ours.inputs)
        found[f"quality.{kind}.better_by"] = float(
            sum(better(part, judge, NOTHING) > 0 for judge in heard)
        )
        found[f"quality.{kind}.subtraction_better_by"] = float(
            sum(better(part, judge, SUBTRACTION) < 0 for judge in heard)
        )
        found[f"quality.{kind}.judges"] = float(len(heard))
        for way in (*_PLAIN, DEFAULT):
            found |= {
                f"quality.{kind}.{judge.name}.{way}": mean_of(part, judge, way) for judge in heard
            }
        for name, rank in ranks(part, heard, (*_PLAIN, DEFAULT)).items():
            found[f"quality.{kind}.rank.{name}"] = rank
    return found


def tables(cells: Cells, wanted: Mapping[str, Input]) -> Iterator[Table]:
    """Ranks by judge, laws and plain figures by way, and all cases."""
    half = reported(cells)
    for kind in (DOMEMASTERS, PAIRED):
        part = of_kind(half, wanted, kind)
        if part:
            yield _by_judge(kind, part)
            yield _by_judge(kind, _usual(part))
            yield _plain(kind, part)
    yield _by_law(cells)
    yield _by_place(cells)


def _by_judge(kind: str, cells: Cells) -> Table:
    names = _common(cells)
    return Table(
        caption=(
            f"Reporting {kind}, {len(cells)} cases: mean of each judge's figures, and mean ranks "
            f"(1 = best)."
        ),
        columns=(
            Column(name="judge"),
            Column(name="of structure"),
            *(Column(name=name, digits=".4g") for name in names),
            *(Column(name=f"rank of {name}", digits=".2f") for name in names),
        ),
        rows=tuple(
            (
                judge.name,
                judge.of_structure,
                *(mean_of(cells, judge, name) for name in names),
                *ranks(cells, [judge]).values(),
            )
            for judge in panel.PANEL
            if _heard(cells, judge)
        ),
    )


def _plain(kind: str, cells: Cells) -> Table:
    ways = list(dict.fromkeys(name for every in cells.values() for name in every))
    names = list(
        dict.fromkeys(
            name for every in cells.values() for cell in every.values() for name in cell.plain
        )
    )
    rows: list[tuple[Entry, ...]] = []
    for way in ways:
        some = [every[way].plain for every in cells.values() if way in every]
        means = (_mean(plain.get(name) for plain in some) for name in names)
        rows.append((way, len(some), *means))
    return Table(
        caption=f"Reporting {kind}: plain figures, means. Shares where no unit is said.",
        columns=(
            Column(name="way"),
            Column(name="cases"),
            *(Column(name=name, digits=".3g") for name in names),
        ),
        rows=tuple(rows),
    )


def _by_law(cells: Cells) -> Table:
    ways = list(dict.fromkeys(name for every in cells.values() for name in every))
    rows: list[tuple[Entry, ...]] = []
    for law in laws.LAWS:
        for way in ways:
            found = [
                every[way].laws[law.name]
                for every in cells.values()
                if way in every and law.name in every[way].laws
            ]
            if found:
                broken = sum(figure > law.bound for figure in found)
                rows.append((law.name, law.bound, way, len(found), max(found), broken))
    return Table(
        caption="Laws: the worst figure of each way, and the cases in which it breaks the law.",
        columns=(
            Column(name="law"),
            Column(name="bound"),
            Column(name="way"),
            Column(name="cases"),
            Column(name="worst"),
            Column(name="broken"),
        ),
        rows=tuple(rows),
    )


def _by_place(cells: Cells) -> Table:
    rows: list[tuple[Entry, ...]] = [
        (
            *place,
            "choosing" if place[0] in CHOOSING else "reporting",
            *(ways[name].judged.get(JUDGE) for name in WAYS),
            ", ".join(laws_broken(ways[DEFAULT])),
        )
        for place, ways in cells.items()
    ]
    return Table(
        caption=(
            "All cases: ColorVideoVDP of each method, JOD, and laws that the default breaks. "
            "Pollution is crosstalk or albedo."
        ),
        columns=(
            Column(name="input"),
            Column(name="pollution", digits="g"),
            Column(name="white", unit="cd/m²", digits="g"),
            Column(name="half"),
            *(Column(name=name, digits=".3f") for name in WAYS),
            Column(name="broken"),
        ),
        rows=tuple(rows),
    )


_PLAIN = (NOTHING, SUBTRACTION)


def laws_broken(cell: Cell) -> list[str]:
    """Laws that a way breaks at a place."""
    return [law.name for law in laws.LAWS if cell.laws.get(law.name, -np.inf) > law.bound]


def _badness(cell: Cell, judge: panel.Judge) -> float:
    return cell.judged[judge.name] * (-1 if judge.higher_is_better else 1)


def mean_of(cells: Cells, judge: panel.Judge, way: str) -> float:
    """Mean of a judge's figures of a way."""
    return float(np.mean([min(ways[way].judged[judge.name], BEST) for ways in cells.values()]))


def _common(cells: Cells) -> list[str]:
    """Ways that all cases have."""
    every = list(cells.values())
    return [name for name in every[0] if all(name in ways for ways in every)] if every else []


def _methods(cells: Cells) -> list[str]:
    """Ways that all cases have, without other settings of the default."""
    return [name for name in _common(cells) if name not in KNOB]


def _usual(cells: Cells) -> Cells:
    """Those at which all ways were tried; all, if there are none."""
    most = max((len(ways) for ways in cells.values()), default=0)
    return {place: ways for place, ways in cells.items() if len(ways) == most}


def _short(cells: Cells) -> int:
    """Cases that fall short by more than `SHORT`."""
    return sum(beyond(ways, DEFAULT) < -SHORT for ways in cells.values())


def _heard(cells: Cells, judge: panel.Judge) -> bool:
    return all(judge.name in ways[DEFAULT].judged for ways in cells.values())


def _mean(values: Iterable[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None
