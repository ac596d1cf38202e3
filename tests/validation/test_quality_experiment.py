"""Quality: the experiment, its figures, and mistakes that must turn it red."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mistakes import change, failed, no_colorvideovdp

from compensate.aim import Aim
from testing.places import dome_at, stereo_at
from validation import inputs, laws, panel
from validation.experiment import Work
from validation.experiments import quality
from validation.experiments.quality import measuring, verdict
from validation.experiments.quality.measuring import KNOB, SLOW, WAYS, Cell
from validation.inputs import CHOOSING, Input
from validation.judges import flip


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Small, without the judges that take seconds a picture, and by a default that is lawful."""
    sharp = replace(panel.PANEL[0], judge=no_colorvideovdp)
    monkeypatch.setattr(panel, "PANEL", (sharp,))
    monkeypatch.setattr(inputs, "QUICK_WIDTH", 48)
    monkeypatch.setattr(inputs, "QUICK_SIZE", 32)
    lawful = {measuring.DEFAULT: ("subtractive", Aim())}
    monkeypatch.setattr(quality, "WAYS", {**measuring.WAYS, **lawful})


def test_without_judges_the_laws_hold(tmp_path):
    finding = quality.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert quality.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert not finding.judged
    assert any("not judged in a quick run" in why for why in finding.left_out)
    ways = len(WAYS) + len(SLOW) + len(KNOB)
    assert [len(one.panels) for one in finding.pictures] == [1 + ways] * 2
    asked = {law.name for law in laws.LAWS if any(law.name in c.what for c in finding.checks)}
    assert {"order", "bound", "harm", "dark"} <= asked


def few(monkeypatch, tmp_path, kept):
    """Some inputs of both halves, small, at the usual place only."""
    monkeypatch.setenv("DOMESIM_DATA", str(tmp_path))
    monkeypatch.setattr(inputs, "CROSSTALK", (0.05,))
    monkeypatch.setattr(inputs, "ALBEDOS", (0.5,))
    monkeypatch.setattr(inputs, "CROSSTALK_PLACES", ((0.05, 15.0),))
    monkeypatch.setattr(inputs, "ALBEDO_PLACES", ((0.5, 15.0),))
    monkeypatch.setattr(inputs, "WIDEST", 48)
    monkeypatch.setattr(inputs, "DOME_SIZE", 32)
    wanted = inputs.wanted

    def chosen(work):
        found, left_out = wanted(work)
        return {name: one for name, one in found.items() if name in kept}, left_out

    monkeypatch.setattr(inputs, "wanted", chosen)


def test_missing_judges_are_not_judged(monkeypatch, tmp_path):
    few(monkeypatch, tmp_path, {"credits", "smooth limb"})
    finding = quality.run(Work(quick=False))
    assert any("not judged; ColorVideoVDP need" in why for why in finding.left_out)
    assert not any("ColorVideoVDP" in check.what for check in finding.checks)
    assert any("law of limb" in check.what for check in finding.checks)


def test_all_judges_see_the_reporting_half(monkeypatch, tmp_path):
    asked = []

    def loss(desired, seen, scene):
        asked.append(scene.views)
        return 10 - float(np.abs(np.sqrt(np.maximum(seen, 0)) - np.sqrt(desired)).mean())

    both = [panel.Judge(name, True, name != "another", loss) for name in (verdict.JUDGE, "another")]
    monkeypatch.setattr(panel, "PANEL", tuple(both))
    few(monkeypatch, tmp_path, {"credits", "generated", "nebula", "chess"})
    finding = quality.run(Work(quick=False))
    ways = len(WAYS) + len(SLOW) + len(KNOB)
    assert (
        len(asked) == 2 * 2 * ways
    )  # of "generated" and "chess", which settings were chosen on, none
    assert any("pillars" in why for why in finding.left_out)
    assert any(check.what.startswith("domes: another, the default") for check in finding.checks)
    assert finding.figures["quality.domemasters.inputs"] == 1
    means = [
        finding.figures[f"quality.domemasters.another.{way}"] for way in ("nothing", "default")
    ]
    assert finding.figures["quality.domemasters.better_by"] == 2 * (means[1] > means[0])
    rows = 2 * [2, 2, ways]
    assert [len(table.rows) for table in finding.tables][:6] == rows
    assert len(finding.tables[-1].rows) == 4


def test_light_taken_from_what_is_exact_turns_it_red(monkeypatch):
    change(monkeypatch, measuring, "subtractive", lambda posed, light: 0.8 * light)
    found = failed(quality.run(Work()))
    assert any(what.startswith("light of what is exact") for what in found)


def test_a_lifted_black_turns_it_red(monkeypatch):
    change(monkeypatch, measuring, "subtractive", lambda posed, light: 0.02 + 0.98 * light)
    found = failed(quality.run(Work()))
    assert any(what.startswith("law of dark: the default") for what in found)
    assert any("laws that nothing or subtraction breaks" in what for what in found)


def test_no_input_that_was_looked_at_is_reported(monkeypatch):
    looked_at = {"notice", "ten stars", "smooth limb", "dark reds", "night", "lamps"}
    assert looked_at <= CHOOSING
    found, left_out = inputs.wanted(Work(quick=False))
    assert found.keys() >= CHOOSING - {why.partition(":")[0] for why in left_out}
    reported = {name: one for name, one in found.items() if name not in CHOOSING}
    domes, pairs = (
        [name for name, one in reported.items() if one.kind == kind]
        for kind in (inputs.DOMEMASTERS, inputs.PAIRED)
    )
    assert (len(domes), len(pairs)) >= (13, 8)
    if not left_out:
        assert len(domes) >= 16
        assert len(pairs) >= 10
    assert len(found["magnitudes"].balls) == 3
    assert found["nebula"].balls == []


def test_a_brighter_scene_has_a_brighter_black():
    stereo, dome = stereo_at(0.1, 48.0), dome_at(0.7, 5.0)
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


NAMES = (verdict.JUDGE, verdict.OTHER, "FLIP")


def cell(worth: float, added: float = 1e-4, lit: float = 1.0, kept: float = 1.0, **laws_) -> Cell:
    """A way that all judges find `worth`."""
    judged = {verdict.JUDGE: worth, verdict.OTHER: worth, "FLIP": 10 - worth}
    plain = {
        "light kept where exact": kept,
        "5th percentile of it": kept,
        "shifted where exact": 0.0,
        "light of lit things": lit,
        measuring.ADDED: added,
    }
    return Cell(judged, laws_, plain)


def case(ours: Cell, nothing: float = 8.0, subtraction: float = 8.5) -> dict[str, Cell]:
    found = {name: cell(7.0) for name in (*WAYS, *SLOW, *KNOB)}
    return found | {
        measuring.NOTHING: cell(nothing),
        measuring.SUBTRACTION: cell(subtraction),
        measuring.DEFAULT: ours,
    }


WANTED = {
    **{name: Input(lambda: None, dome_at, (0.5,), 0.5) for name in ("a", "b", "night")},
    **{name: Input(lambda: None, stereo_at, (0.05,), 0.05) for name in ("p", "q")},
}


def cells(**changed: Cell) -> verdict.Cells:
    good = {"a": cell(8.9), "b": cell(8.91), "night": cell(5.0), "p": cell(8.6)}
    return {(name, 0.5, 15.0): case(one) for name, one in {**good, **changed}.items()}


def off(one: Cell, judge: str, figure: float) -> Cell:
    """The same, but for what one judge says."""
    return replace(one, judged={**one.judged, judge: figure})


@pytest.fixture
def _three_judges(monkeypatch):
    judges = [panel.Judge(name, name != "FLIP", name != "FLIP", flip) for name in NAMES]
    monkeypatch.setattr(panel, "PANEL", tuple(judges))


@pytest.mark.usefixtures("_three_judges")
@pytest.mark.parametrize(
    ("changed", "caught"),
    [
        ({}, []),
        ({"night": cell(1.0)}, []),  # of the choosing half, it proves nothing of judges
        ({"night": cell(5.0, order=0.2)}, ["law of order: the default, worst of 1 cases (night"]),
        ({"a": cell(8.9, bound=2.2), "b": cell(8.9, bound=1.0)}, ["worst of 2 cases (a at"]),
        ({"a": cell(8.47), "b": cell(9.6)}, ["worst case (a at"]),
        ({"a": cell(8.6), "b": cell(8.6)}, ["subtraction, mean over inputs"]),
        ({n: off(cell(8.9), "FLIP", 3.1) for n in "ab"}, ["FLIP", "share of inputs", "mean rank"]),
        ({"p": off(cell(8.6), "FLIP", 2.01)}, ["pairs: FLIP, the default over nothing"]),
        ({"p": cell(8.6, added=1.8e-4)}, [measuring.ADDED]),
        ({"p": cell(8.6, lit=0.9)}, ["lit things"]),
        ({"a": cell(8.9, kept=0.95)}, ["exact and not lifted, median, least"]),
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


@pytest.mark.usefixtures("_three_judges")
def test_another_setting_of_the_default_is_no_other_method():
    best = {name: cell(9.9) for name in KNOB}
    found = {place: {**ways, **best} for place, ways in cells().items()}
    assert all(check.passed for check in verdict.checks(found, WANTED, judged=True))
    assert min(verdict.ranks(found, panel.PANEL).values()) < 3


def test_equal_pictures_have_a_mean_psnr():
    judge = panel.Judge("FLIP", True, False, flip)
    same = {("a", 0.5, 15.0): case(off(cell(8), "FLIP", np.inf))}
    assert verdict.better(same, judge, measuring.SUBTRACTION) == pytest.approx(100 - 1.5)
