"""Quality: the experiment, its figures, and mistakes that must turn it red."""

from __future__ import annotations

import numpy as np
import pytest
from findings import change, failed, no_colorvideovdp

from validation import judges, pairs
from validation.experiment import Work
from validation.experiments import quality
from validation.experiments.quality import gains, inputs, judging
from validation.experiments.quality.judging import Cell
from validation.experiments.quality.ways import WAYS


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Tiny, without the judge that takes seconds a picture."""
    monkeypatch.setattr(judges, "colorvideovdp_map", no_colorvideovdp)
    monkeypatch.setattr(inputs, "QUICK_WIDTH", 48)
    monkeypatch.setattr(inputs, "QUICK_SIZE", 32)


@pytest.fixture
def _judge(monkeypatch):
    """A judge that counts differences of the roots of light."""

    def loss(desired, seen, scene):
        roots = [np.sqrt(np.maximum(light, 0).mean(axis=-1)) for light in (desired, seen)]
        lost = 20 * np.abs(roots[0] - roots[1])
        return 10 - float(lost.mean()), lost

    monkeypatch.setattr(judges, "colorvideovdp_map", loss)
    monkeypatch.setattr(judges, "flip", lambda *args: float(loss(*args)[1].mean()) / 10)


def test_without_judges_the_laws_hold(tmp_path):
    finding = quality.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert quality.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert "ColorVideoVDP: it needs pip install 'domesim[metrics]'" in finding.left_out
    assert [len(one.panels) for one in finding.pictures] == [5, 5]
    assert [len(table.rows) for table in finding.tables] == [6, len(WAYS), 2]
    assert finding.figures["quality.generated.0.05.15.none.contour"] == pytest.approx(1)
    assert finding.figures["quality.night.0.5.15.none.contour"] is None


@pytest.mark.usefixtures("_judge")
def test_a_full_run_says_what_the_judges_found(monkeypatch, tmp_path):
    monkeypatch.setenv(pairs.FOLDER, str(tmp_path))
    monkeypatch.setattr(inputs, "WIDEST", 32)
    monkeypatch.setattr(inputs, "CROSSTALK", (0.05,))
    monkeypatch.setattr(inputs, "ALBEDOS", (0.5,))
    monkeypatch.setattr(inputs, "LUMINANCES", (15.0, 48.0))
    finding = quality.run(Work(quick=False))
    assert any("pillars" in why and pairs.FOLDER in why for why in finding.left_out)
    assert any(check.what.startswith("local contrast: gain") for check in finding.checks)
    assert [len(one.panels) for one in finding.pictures] == [9, 9, 9]
    assert [len(table.rows) for table in finding.tables] == [3, 6, len(WAYS), 5, 6]
    assert len(finding.plots) == 3
    assert "3 inputs" in finding.result
    assert "FLIP" in finding.result


def idle(monkeypatch):
    """Perceptual methods show what subtraction does."""
    change(monkeypatch, judging, "perceptual", lambda posed, light: posed.subtractive)


def half_way(monkeypatch):
    """Perceptual methods go half the way."""
    change(monkeypatch, judging, "perceptual", lambda posed, light: 0.5 * (light + posed.desired))


@pytest.mark.parametrize(
    ("mutate", "caught"),
    [
        (idle, "local contrast: visible error over subtraction's"),
        (half_way, "local contrast: cost over the least"),
    ],
)
@pytest.mark.long
def test_mistakes_turn_it_red(mutate, caught, monkeypatch):
    mutate(monkeypatch)
    assert any(what.startswith(caught) for what in failed(quality.run(Work())))


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


# What a way is worth


def cell(jod, contour=None, error=1.0):
    return Cell(
        clipped=0.5,
        error=error,
        cost=1.0,
        allowed=True,
        flip=None,
        quality=jod,
        contour=contour,
        contrast_contour=contour,
        hue=None,
        seconds=0.0,
        status="CONVERGED",
        gap=0.0,
        new=None,
        panels=(),
    )


CELLS = {
    ("a", 0.1, 5.0): {
        "none": cell(8.0),
        "subtractive": cell(9.0, 0.8),
        "contrast": cell(9.5, 0.2),
    },
    ("a", 0.2, 5.0): {
        "none": cell(9.2),
        "subtractive": cell(9.0, 0.8),
        "contrast": cell(9.1, 0.8),
    },
    ("b", 0.1, 5.0): {
        "none": cell(9.0),
        "subtractive": cell(9.8, 0.9),
        "contrast": cell(9.7, 0.1),
    },
    ("c", 0.1, 5.0): {"none": cell(9.0), "subtractive": cell(9.95), "contrast": cell(10.0)},
}


def test_gains_are_means_over_an_input_where_subtraction_is_seen():
    assert gains.gains(CELLS, "contrast") == pytest.approx({"a": 0.3, "b": -0.1})


def test_shortfalls_are_against_the_better_of_both():
    assert list(gains.shortfalls(CELLS, "contrast").values()) == pytest.approx(
        [-0.5, 0.1, 0.1, -0.05]
    )


def test_errors_that_rank_as_the_judge_does():
    cases = {
        ("a", 0.1, 5.0): {
            "none": cell(8.0, error=4.0),
            "subtractive": cell(9.0, error=3.0),
            "contrast": cell(9.5, error=2.0),
        },
        ("b", 0.1, 5.0): {
            "none": cell(9.01, error=2.0),
            "subtractive": cell(9.4, error=3.0),
            "contrast": cell(9.0, error=2.5),
        },
    }
    # Of b, nothing is too near; subtraction is better, and its error says that it is not
    assert gains.alike(cases, "contrast") == (3, 2)
    assert gains.falling_back(cases, "contrast", 1.0) == pytest.approx((0, 0.05, 0.4))
    assert gains.falling_back(cases, "contrast", 1.3) == pytest.approx((1, 0.25, 0.0))


def test_falls_of_the_contour_are_geometric_means_over_inputs():
    found = gains.falls(CELLS, "contrast")
    assert list(found.values()) == pytest.approx([4, 1, 9])
    assert gains.geometric(found) == pytest.approx(np.sqrt(2 * 9))
