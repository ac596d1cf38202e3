"""Veils take contrast from people by its distance from threshold; small JODs divide people.

Rationale
    Others have asked people, and published what they said. The data files are not part of this
    project, as one states no licence: the folder of the test data holds them, in ``people``.
    *Veils* (Kim, Ashraf, Chapiro, Mantiuk, SIGGRAPH Asia 2025; means of 16 observers): a grating
    seen over a veil was matched by the contrast of one without. Of 32 conditions over flat veils
    the match's luminance is known. Four rules predict the matched contrast. *Physical*: that which
    is left on the screen. *Less threshold*: contrasts match that are as far above their thresholds,
    c - t, by castleCSF (`compensate.vision.castle`) at their own luminances, for gratings of 1
    deg², which the authors do not state: other areas are tried. *Over threshold*: c / t are the
    same. *Discounted*: the veil is not seen at all.
    *Judges* (AR-DAVID, SIGGRAPH Asia 2024; 432 distorted films over backgrounds): how often do
    people order two films of one scene as ColorVideoVDP does?
Expected
    The root-mean-square errors of log10 contrast are 0.061 (less threshold), 0.099 (physical),
    0.118 (over threshold) and 0.571 (discounted); less threshold is best at all areas from 1 to 25
    deg². People order 51 % of pairs ColorVideoVDP's way that it puts less than 0.1 JOD apart, 60 %
    up to 0.3, 72 % up to 0.6, 81 % up to 1, and 91 % beyond: what `compensate.ruler` says beside
    each figure of quality.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.plain import GRATING
from compensate.ruler import PEOPLE
from compensate.vision.castle import ACHROMATIC, RED_GREEN, YELLOW_VIOLET, castle
from validation.data import FOLDER, data_folder
from validation.experiment import (
    Cell,
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    between,
)

VEILS, JUDGES = "veil_contrast_2025.csv", "ar_david_2024.csv"
"""Files in the folder ``people`` of the test data."""
MECHANISMS = {"achromatic": ACHROMATIC, "red-green": RED_GREEN, "yellow-violet": YELLOW_VIOLET}
AREA, AREAS = GRATING, (GRATING, 4.0, 9.0, 25.0)
"""Areas of the gratings, deg²: that of the expected figures, and those that are tried."""

EXPECTED = {
    "less threshold": 0.061,
    "physical": 0.099,
    "over threshold": 0.118,
    "discounted": 0.571,
}
"""Rule -> rms error of log10 contrast."""

Floats = NDArray[np.floating[Any]]
Row = Mapping[str, str]


@final
@dataclass(frozen=True)
class Veils:
    """Conditions over flat veils, each an array (condition,).

    Attributes
    ----------
    base, physical, matched
        Contrast of the picture alone, over the veil, and of what matches it without a veil.
    threshold, reference
        Threshold contrast at the luminance of picture and veil, and at that of the match.
    """

    base: Floats
    physical: Floats
    matched: Floats
    threshold: Floats
    reference: Floats


RULES: Mapping[str, Callable[[Veils], Floats]] = {
    "less threshold": lambda v: v.physical - v.threshold + v.reference,
    "physical": lambda v: v.physical,
    "over threshold": lambda v: v.physical * v.reference / v.threshold,
    "discounted": lambda v: v.base,
}
"""Rule -> the contrast that it says would match."""


@final
@dataclass(frozen=True)
class Agreement:
    """How often people order two films of one scene as ColorVideoVDP does.

    Attributes
    ----------
    pairs
        Number of pairs, by how far apart ColorVideoVDP puts them: as `PEOPLE`.
    share
        Share of them that people order so.
    least, most
        The same of one scene alone.
    """

    pairs: tuple[int, ...]
    share: tuple[float, ...]
    least: tuple[float, ...]
    most: tuple[float, ...]


def veils(rows: Sequence[Row], area: float = AREA) -> Veils:
    """Reads conditions whose match's luminance is known.

    Parameters
    ----------
    rows
        Of the file `VEILS`.
    area
        Of the gratings, deg².
    """
    known = [row for row in rows if row["reference_cd_m2"]]

    def column(name: str) -> Floats:
        return np.array([float(row[name]) for row in known])

    def threshold(luminance: str) -> Floats:
        frequency = column("cycles_per_degree")
        return np.array(
            [
                1 / float(castle(rho, light, MECHANISMS[row["direction"]], area=area))
                for rho, light, row in zip(frequency, column(luminance), known, strict=True)
            ]
        )

    return Veils(
        column("base"),
        column("physical"),
        column("matched"),
        threshold("luminance_cd_m2"),
        threshold("reference_cd_m2"),
    )


def errors(rows: Sequence[Row], area: float = AREA) -> dict[str, float]:
    """Returns the rms error of log10 contrast of each of `RULES`, over flat veils."""
    conditions = veils(rows, area)
    return {
        name: float(np.sqrt(np.mean(np.log10(rule(conditions) / conditions.matched) ** 2)))
        for name, rule in RULES.items()
    }


def agreement(rows: Sequence[Row]) -> Agreement:
    """Counts the pairs of films of one scene that people order as ColorVideoVDP does.

    Parameters
    ----------
    rows
        Of the file `JUDGES`.
    """
    by_scene = []
    for scene in sorted({row["scene"] for row in rows}):
        judge, people = (
            np.array([float(row[name]) for row in rows if row["scene"] == scene])
            for name in ("colorvideovdp_jod", "people_jod")
        )
        one, other = np.triu_indices(len(judge), 1)
        apart = judge[one] - judge[other]
        by_scene.append((np.abs(apart), apart * (people[one] - people[other]) > 0))
    edges = [0.0, *PEOPLE]
    pairs = np.empty((len(by_scene), len(PEOPLE)), int)
    agreed = np.empty_like(pairs)
    for scene_number, (apart, same) in enumerate(by_scene):
        for number, (low, high) in enumerate(pairwise(edges)):
            within = (apart >= low) & (apart < high)
            pairs[scene_number, number] = np.count_nonzero(within)
            agreed[scene_number, number] = np.count_nonzero(same & within)
    shares = agreed / np.maximum(pairs, 1)
    return Agreement(
        tuple(pairs.sum(0).tolist()),
        tuple((agreed.sum(0) / np.maximum(pairs.sum(0), 1)).tolist()),
        tuple(shares.min(0).tolist()),
        tuple(shares.max(0).tolist()),
    )


def read(folder: Path, name: str) -> list[Row]:
    """Reads a file of the folder ``people``.

    Raises
    ------
    Missing
        If it is not there.
    """
    path = folder / "people" / name
    if not path.is_file():
        raise Missing(f"needs {path}; set {FOLDER} to the folder of the test data")
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    del work  # it takes no time
    folder = data_folder()
    conditions = read(folder, VEILS)
    found, by_area = errors(conditions), {area: errors(conditions, area) for area in AREAS}
    judged = agreement(read(folder, JUDGES))
    best = min(found, key=lambda name: found[name])
    return Finding(
        result=(
            f"Over flat veils the rule '{best}' predicts what people match best: its errors of "
            f"log10 contrast are {found[best]:.3f} (rms), those of the physical contrast "
            f"{found['physical']:.3f}. Nobody sees through a veil ({found['discounted']:.3f}). "
            f"Over veils of other kinds people match up to {_most(conditions):.2f} times the "
            f"physical contrast.\n"
            f"People order two films as ColorVideoVDP does in "
            + ", ".join(
                f"{share:.0%} of {pairs} pairs {_apart(number)}"
                for number, (share, pairs) in enumerate(
                    zip(judged.share, judged.pairs, strict=True)
                )
            )
            + "."
        ),
        advice="Do not choose by less than 0.3 JOD: look, or ask people.",
        checks=tuple(_checks(found, by_area, judged)),
        tables=(
            _by_condition(conditions),
            _by_area(by_area),
            _structured(conditions),
            _judged(judged),
        ),
        figures={
            **{f"people.{name.replace(' ', '_')}": value for name, value in found.items()},
            **{f"people.agreed.{high:g}": s for high, s in zip(PEOPLE, judged.share, strict=True)},
        },
        left_out=(
            "Structured veils: the rules are of flat ones, and the luminance of the match is not "
            "in the data.",
            "Preferences for brightness against contrast, studies of display-adaptive tone "
            "mapping, and surveys of planetariums: no figures by condition are at hand.",
            "The dark of domes: the veils had 2 to 690 cd/m².",
        ),
    )


def _checks(
    found: Mapping[str, float],
    by_area: Mapping[float, Mapping[str, float]],
    judged: Agreement,
) -> Iterator[Check]:
    for name, expected in EXPECTED.items():
        yield between(
            f"'{name}': rms error of log10 contrast", found[name], expected - 5e-4, expected + 5e-4
        )
    yield at_least(
        "least lead of 'less threshold' before the next rule, at all areas",
        min(
            min(each[name] for name in RULES if name != "less threshold") - each["less threshold"]
            for each in by_area.values()
        ),
        0.0,
    )
    for number, (share, expected) in enumerate(zip(judged.share, PEOPLE.values(), strict=True)):
        yield between(
            f"pairs {_apart(number)} that people order so",
            100 * share,
            100 * expected - 0.5,
            100 * expected + 0.5,
            "%",
        )


def _apart(number: int) -> str:
    low, high = [0.0, *PEOPLE][number : number + 2]
    if not low:
        return f"less than {high:g} JOD apart"
    return f"more than {low:g} JOD apart" if np.isinf(high) else f"{low:g} to {high:g} JOD apart"


def _by_condition(rows: Sequence[Row]) -> Table:
    cells: list[tuple[Cell, ...]] = []
    keys = sorted({(row["direction"], float(row["picture_cd_m2"] or 0)) for row in rows})
    for direction, picture in keys:
        some = [
            row
            for row in rows
            if row["direction"] == direction and float(row["picture_cd_m2"] or 0) == picture
        ]
        count = len(veils(some).matched)
        if count:
            cells.append((direction, picture, count, *errors(some).values()))
    return Table(
        caption="Rms error of log10 contrast over flat veils, by direction of colour and luminance "
        "of the picture.",
        columns=(
            Column(name="direction"),
            Column(name="picture", unit="cd/m²", digits="g"),
            Column(name="conditions"),
            *(Column(name=name, digits=".3f") for name in RULES),
        ),
        rows=tuple(cells),
    )


def _by_area(by_area: Mapping[float, Mapping[str, float]]) -> Table:
    return Table(
        caption="The same of all, by the area that castleCSF is told.",
        columns=(
            Column(name="area", unit="deg²", digits="g"),
            *(Column(name=name, digits=".3f") for name in RULES),
        ),
        rows=tuple((area, *each.values()) for area, each in by_area.items()),
    )


def _structured(rows: Sequence[Row]) -> Table:
    some = [row for row in rows if not row["reference_cd_m2"]]
    return Table(
        caption="Contrast that people match over veils of other kinds, 30 cd/m².",
        columns=(
            Column(name="veil"),
            Column(name="of the picture alone", digits=".2f"),
            Column(name="physical", digits=".2f"),
            Column(name="matched", digits=".3f"),
        ),
        rows=tuple(
            (row["background"], *(float(row[key]) for key in ("base", "physical", "matched")))
            for row in some
        ),
    )


def _most(rows: Sequence[Row]) -> float:
    """Largest ratio of matched to physical contrast over veils that are not in `veils`."""
    other = [row for row in rows if not row["reference_cd_m2"]]
    return max((float(row["matched"]) / float(row["physical"]) for row in other), default=1.0)


def _judged(found: Agreement) -> Table:
    return Table(
        caption="Pairs of films of one scene that people order as ColorVideoVDP does.",
        columns=(
            Column(name="by ColorVideoVDP"),
            Column(name="pairs"),
            Column(name="ordered so", unit="%", digits=".1f"),
            Column(name="scene with fewest", unit="%", digits=".1f"),
            Column(name="scene with most", unit="%", digits=".1f"),
        ),
        rows=tuple(
            (_apart(number), pairs, 100 * share, 100 * least, 100 * most)
            for number, (pairs, share, least, most) in enumerate(
                zip(found.pairs, found.share, found.least, found.most, strict=True)
            )
        ),
    )
