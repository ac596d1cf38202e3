"""What people saw: figures of made-up people, whose rule is known, and of the real ones."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from compensate.ruler import PEOPLE, PEOPLE_SAY, agreeing
from validation import data
from validation.experiment import Work
from validation.experiments import people
from validation.experiments.people import (
    JUDGES,
    MECHANISMS,
    RULES,
    VEILS,
    agreement,
    errors,
    run,
    veils,
)

Rows = list[dict[str, str]]


def conditions(rule: str, spread: float = 0.0) -> Rows:
    """Gratings over flat veils that made-up people match by a rule, and one over noise."""
    rows = [
        {
            "background": "flat",
            "luminance_cd_m2": f"{light * more:g}",
            "picture_cd_m2": f"{light:g}",
            "reference_cd_m2": f"{light:g}",
            "cycles_per_degree": cycles,
            "direction": direction,
            "base": "0.3",
            "physical": f"{0.3 / more:.9g}",
            "matched": "1",
        }
        for light in (1.0, 100.0)
        for more in (2.0, 5.0)
        for cycles in ("2", "4")
        for direction in MECHANISMS
    ]
    matched = RULES[rule](veils(rows)) * 10 ** (spread * (-1.0) ** np.arange(len(rows)))
    for row, contrast in zip(rows, matched, strict=True):
        row["matched"] = f"{contrast:.9g}"
    noise = dict(rows[0], background="noise", picture_cd_m2="", reference_cd_m2="", matched="9")
    return [noise, *rows]


def films(agreeing_: Callable[[float], bool]) -> Rows:
    """Pairs of films, each a scene of its own, in which people agree by how far apart they are."""
    apart = [0.05, 0.07, 0.2, 0.4, 0.8, 0.9, 3.0]
    return [
        {
            "scene": f"scene {number}",
            "condition": name,
            "colorvideovdp_jod": f"{8 + step * judged:g}",
            "people_jod": f"{8 + step * (1 if agreeing_(step) else -1) * judged:g}",
        }
        for number, step in enumerate(apart)
        for name, judged in (("one", 0), ("other", 1))
    ]


def store(folder: Path, rows: Mapping[str, Rows]) -> None:
    (folder / "people").mkdir()
    for name, table in rows.items():
        with (folder / "people" / name).open("w", newline="") as file:
            file.write("# made up\n")
            writer = csv.DictWriter(file, list(table[0]))
            writer.writeheader()
            writer.writerows(table)


@pytest.mark.parametrize("rule", RULES)
def test_the_rule_that_people_follow_has_no_error(rule: str) -> None:
    found = errors(conditions(rule))
    assert found[rule] == pytest.approx(0, abs=1e-6)
    assert min(value for name, value in found.items() if name != rule) > 0.01
    assert errors(conditions(rule, 0.1))[rule] == pytest.approx(0.1)


def test_pairs_are_counted_within_scenes_by_how_far_apart_they_are() -> None:
    found = agreement(films(lambda apart: apart > 0.06))
    assert found.pairs == (2, 1, 1, 2, 1)
    assert found.share == (0.5, 1, 1, 1, 1)
    assert agreement(films(lambda apart: False)).share == (0,) * 5


def test_people_who_follow_another_rule_are_not_as_expected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store(tmp_path, {VEILS: conditions("physical"), JUDGES: films(lambda apart: False)})
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    finding = run(Work())
    assert len(finding.failed) == len(finding.checks)
    assert "'physical' predicts" in finding.result
    table = finding.tables[0]
    assert [row[2] for row in table.rows] == [4] * 6


def _there() -> bool:
    return all((data.data_folder() / "people" / name).is_file() for name in (VEILS, JUDGES))


@pytest.mark.skipif(not _there(), reason="the data of people are not there")
def test_people_are_as_expected_and_not_with_rules_exchanged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    finding = run(Work())
    assert finding.passed, finding.failed
    exchanged = dict(zip(RULES, [*list(RULES.values())[1:], RULES["less threshold"]], strict=True))
    monkeypatch.setattr(people, "RULES", exchanged)
    assert len(run(Work()).failed) >= len(RULES)


def test_words_and_numbers_are_the_same() -> None:
    shares = [100 * share for share in PEOPLE.values()]
    for share, apart in zip(shares, [0.05, 0.2, 0.5, 0.9, 4.0], strict=True):
        assert agreeing(2.0, 2.0 - apart) == f"people order {share:.0f} of 100 such pairs so"
        assert f" {share:.0f}" in PEOPLE_SAY
    for edge in PEOPLE:
        assert math.isinf(edge) or f"{edge:g} JOD" in PEOPLE_SAY
