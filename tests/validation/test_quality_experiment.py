"""Quality: the experiment, its figures, and mistakes that must turn it red."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from findings import change, failed, no_colorvideovdp

from validation import inputs, judges, panel
from validation.experiment import Work
from validation.experiments import quality
from validation.experiments.quality import measuring, verdict
from validation.experiments.quality.measuring import KNOB, WAYS, Cell
from validation.inputs import CHOOSING, Input


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Small, without the judges that take seconds a picture."""
    sharp = replace(panel.PANEL[0], judge=no_colorvideovdp)
    monkeypatch.setattr(panel, "PANEL", (sharp,))
    monkeypatch.setattr(inputs, "QUICK_WIDTH", 48)
    monkeypatch.setattr(inputs, "QUICK_SIZE", 32)


def test_without_judges_the_laws_hold(tmp_path):
    finding = quality.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert quality.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert any("ColorVideoVDP" in why and "metrics" in why for why in finding.left_out)
    assert [len(one.panels) for one in finding.pictures] == [1 + len(WAYS) + len(KNOB)] * 2
    (law,) = (check for check in finding.checks if "ghost contour" in check.what)
    assert law.found < 1e-9


def test_all_judges_see_the_reporting_half_and_some_the_choosing(monkeypatch, tmp_path):
    asked = []

    def loss(desired, seen, scene):
        asked.append(scene.views)
        return 10 - float(np.abs(np.sqrt(np.maximum(seen, 0)) - np.sqrt(desired)).mean())

    both = [panel.Judge(name, True, name != "another", loss) for name in (verdict.JUDGE, "another")]
    monkeypatch.setattr(panel, "PANEL", tuple(both))
    monkeypatch.setenv("DOMESIM_DATA", str(tmp_path))
    monkeypatch.setattr(inputs, "CROSSTALK", (0.05,))
    monkeypatch.setattr(inputs, "ALBEDOS", (0.5,))
    monkeypatch.setattr(inputs, "LUMINANCES", (15.0,))
    monkeypatch.setattr(inputs, "CHOSEN_CROSSTALK", ((0.05, 15.0),))
    monkeypatch.setattr(inputs, "CHOSEN_ALBEDOS", ((0.5, 15.0),))
    monkeypatch.setattr(inputs, "WIDEST", 48)
    monkeypatch.setattr(inputs, "DOME_SIZE", 32)
    kept = {"snow", "generated", "nebula", "chess"}
    wanted = inputs.wanted

    def few(work):
        found, left_out = wanted(work)
        return {name: one for name, one in found.items() if name in kept}, left_out

    monkeypatch.setattr(inputs, "wanted", few)
    finding = quality.run(Work(quick=False))
    ways = len(WAYS) + len(KNOB)
    assert len(asked) == ways * (1 + 1) + ways * (2 + 2)
    assert any("pillars" in why for why in finding.left_out)
    assert any(check.what.startswith("domes: gain") for check in finding.checks)
    assert finding.figures["quality.domemasters.inputs"] == 1
    assert [len(table.rows) for table in finding.tables] == [2, ways, 2, ways, 4]


def darkened(monkeypatch):
    """The default takes light from what is exact."""
    change(monkeypatch, measuring, "perceptual", lambda posed, light: 0.8 * light)


def test_light_taken_from_what_is_exact_turns_it_red(monkeypatch):
    darkened(monkeypatch)
    assert any(what.startswith("light of what is exact") for what in failed(quality.run(Work())))


def test_a_brighter_scene_has_a_brighter_black():
    stereo, dome = inputs.stereo_at(0.1, 48.0), inputs.dome_at(0.7, 5.0)
    dark = stereo.observation(9, 16).observe(np.zeros((2, 9, 16, 3), np.float32))
    assert dark == pytest.approx(1 / 2000)
    light = np.zeros((2, 9, 16, 3), np.float32)
    light[1] = 1
    assert stereo.observation(9, 16).observe(light)[0] == pytest.approx(0.1 + 1 / 2000)
    assert dome.albedo == (0.7, 0.7, 0.7)
    dark = dome.observation(8, 8).observe(np.zeros((1, 8, 8, 3), np.float32))
    assert dark[:, dome.screen(8, 8)] == pytest.approx(1 / 2000)
    assert (stereo.viewing.adaptation, dome.viewing.adaptation) == pytest.approx((4.8, 0.5))


# What is expected


def cell(jod: float, contour: float | None = None, kept: float = 1.0, lit: float = 1.0) -> Cell:
    judged = {"ColorVideoVDP": jod}
    return Cell(
        judged, kept, kept, 0.0, (1.0,) * 3, 0.0, 1.0, 0.0, 0.1, contour, contour, contour, lit, ()
    )


def case(ours: Cell, nothing: float = 8.0, subtraction: float = 8.5) -> dict[str, Cell]:
    found = {name: cell(7.0, 0.9) for name in WAYS}
    return found | {
        measuring.LOWER: cell(8.9),
        measuring.NOTHING: cell(nothing, 1.0),
        measuring.SUBTRACTION: cell(subtraction, 0.8),
        measuring.DEFAULT: ours,
    }


WANTED = {
    **{name: Input(lambda: None, inputs.dome_at, (0.5,), 0.5) for name in ("a", "b", "night")},
    **{name: Input(lambda: None, inputs.stereo_at, (0.05,), 0.05) for name in ("p", "q")},
}


def cells(**changed: Cell) -> verdict.Cells:
    good = {"a": cell(8.9), "b": cell(8.91), "night": cell(5.0), "p": cell(8.6, 0.4)}
    return {(name, 0.5, 15.0): case(one) for name, one in {**good, **changed}.items()}


@pytest.fixture
def _one_judge(monkeypatch):
    monkeypatch.setattr(panel, "PANEL", (replace(panel.PANEL[0], judge=judges.flip),))


@pytest.mark.usefixtures("_one_judge")
@pytest.mark.parametrize(
    ("changed", "caught"),
    [
        ({}, []),
        ({"night": cell(1.0)}, []),  # of the choosing half, it proves nothing
        ({"a": cell(8.44), "b": cell(9.6)}, ["worst case (a at", "lower end"]),
        ({"b": cell(8.49)}, ["mean over inputs", "lower end"]),
        ({"p": cell(8.44, 0.4)}, ["pairs: gain"]),
        ({"p": cell(8.6, 0.6)}, ["ghost contour of light", "of contrast", "other eye"]),
        ({"p": cell(8.6, 0.4, lit=0.9)}, ["lit things"]),
        ({"a": cell(8.9, kept=0.95)}, ["exact and not lifted, median, least"]),
        ({"a": cell(8.9, kept=1.15)}, ["exact and not lifted, median, largest"]),
        ({"a": cell(8.9, kept=0.85)}, ["median, least", "5th percentile"]),
    ],
)
def test_what_falls_short_turns_it_red(changed, caught):
    assert "night" in CHOOSING
    found = [
        check.what
        for check in verdict.checks(cells(**changed), WANTED, judged=True)
        if not check.passed
    ]
    assert len(found) >= len(caught)
    for words in caught:
        assert any(words in what for what in found), (words, found)
    if not caught:
        assert found == []
