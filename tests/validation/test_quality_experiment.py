"""Quality: the experiment, its figures, and mistakes that must turn it red."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation import judges, pairs
from validation.experiment import Missing, Work
from validation.experiments import quality
from validation.experiments.quality import Cell, estimate, ghost_contour


def _missing(*args):
    raise Missing("needs ColorVideoVDP: pip install 'domesim[metrics]'")


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Tiny, without the judge that takes seconds a picture."""
    monkeypatch.setattr(judges, "colorvideovdp_map", _missing)
    monkeypatch.setattr(quality, "QUICK_WIDTH", 48)
    monkeypatch.setattr(quality, "QUICK_SIZE", 32)


@pytest.fixture
def _judge(monkeypatch):
    """A judge that counts differences of the roots of light."""

    def loss(desired, seen, scene):
        roots = [np.sqrt(np.maximum(light, 0).mean(axis=-1)) for light in (desired, seen)]
        lost = 20 * np.abs(roots[0] - roots[1])
        return 10 - float(lost.mean()), lost

    monkeypatch.setattr(judges, "colorvideovdp_map", loss)
    monkeypatch.setattr(judges, "flip", lambda *args: float(loss(*args)[1].mean()) / 10)


def failed(finding) -> list[str]:
    return [check.what for check in finding.checks if not check.passed]


def test_without_judges_the_laws_hold(tmp_path):
    finding = quality.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert quality.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert "ColorVideoVDP: it needs pip install 'domesim[metrics]'" in finding.left_out
    assert [len(one.panels) for one in finding.pictures] == [5, 5]
    assert [len(table.rows) for table in finding.tables] == [6, 15, 2]
    assert finding.figures["quality.generated.0.05.15.none.contour"] == pytest.approx(1)
    assert finding.figures["quality.night.0.5.15.none.contour"] is None


@pytest.mark.usefixtures("_judge")
def test_a_full_run_says_what_the_judges_found(monkeypatch, tmp_path):
    monkeypatch.setenv(pairs.FOLDER, str(tmp_path))
    monkeypatch.setattr(quality, "WIDEST", 32)
    monkeypatch.setattr(quality, "CROSSTALK", (0.05,))
    monkeypatch.setattr(quality, "ALBEDOS", (0.5,))
    monkeypatch.setattr(quality, "LUMINANCES", (15.0, 48.0))
    finding = quality.run(Work(quick=False))
    assert any("pillars" in why and pairs.FOLDER in why for why in finding.left_out)
    assert any(check.what.startswith("local contrast: gain") for check in finding.checks)
    assert [len(one.panels) for one in finding.pictures] == [9, 9, 9]
    assert [len(table.rows) for table in finding.tables] == [3, 6, 15, 6]
    assert len(finding.plots) == 3
    assert "3 inputs" in finding.result
    assert "FLIP" in finding.result


def idle(monkeypatch):
    """Perceptual methods show what subtraction does."""
    honest = quality.solved

    def solved(posed, method, solver=None):
        return honest(posed, "subtractive" if method == "perceptual" else method, solver)

    monkeypatch.setattr(quality, "solved", solved)


def half_way(monkeypatch):
    """Perceptual methods go half the way."""
    honest = quality.solved

    def solved(posed, method, solver=None):
        found = honest(posed, method, solver)
        if method != "perceptual":
            return found
        return replace(found, light=0.5 * (found.light + posed.desired))

    monkeypatch.setattr(quality, "solved", solved)


@pytest.mark.parametrize(
    ("mutate", "caught"),
    [
        (idle, "local contrast: visible error over subtraction's"),
        (half_way, "local contrast: visible error over the least"),
    ],
)
def test_mistakes_turn_it_red(mutate, caught, monkeypatch):
    mutate(monkeypatch)
    assert any(what.startswith(caught) for what in failed(quality.run(Work())))


def test_a_brighter_scene_has_a_brighter_black():
    stereo, dome = quality.stereo_at(0.1, 48.0), quality.dome_at(0.7, 5.0)
    dark = stereo.observation(9, 16).observe(np.zeros((2, 9, 16, 3), np.float32))
    assert dark == pytest.approx(1 / 2000)
    light = np.zeros((2, 9, 16, 3), np.float32)
    light[1] = 1
    assert stereo.observation(9, 16).observe(light)[0] == pytest.approx(0.1 + 1 / 2000)
    assert dome.albedo == (0.7, 0.7, 0.7)
    dark = dome.observation(8, 8).observe(np.zeros((1, 8, 8, 3), np.float32))
    assert dark[:, dome.screen(8, 8)] == pytest.approx(1 / 2000)
    assert (stereo.viewing.adaptation, dome.viewing.adaptation) == pytest.approx((4.8, 0.5))


# The ghost contour


def ghost() -> np.ndarray:
    """The left eye's: a bar in the left half, a fainter one in the right half."""
    planes = np.zeros((2, 24, 40))
    planes[0, 6:18, 8:12] = 1.0
    planes[0, 6:18, 28:32] = 0.5
    return planes


EVERYWHERE = np.ones((2, 24, 40), bool)


@pytest.mark.parametrize(("share", "contour"), [(1.0, 1.0), (0.25, 0.25), (0.0, 0.0), (-0.5, 0.5)])
def test_contour_of_a_share_of_the_ghost(share, contour):
    found = ghost_contour(share * ghost() + 0.3, ghost(), EVERYWHERE, 10.0)
    assert found == pytest.approx(contour, abs=1e-12)


def test_contour_is_of_the_pixels_asked_for():
    right = EVERYWHERE.copy()
    right[:, :, :20] = False
    error = ghost()
    error[:, :, 20:] *= 0.3  # what is elsewhere does not count
    assert ghost_contour(error, ghost(), right, 10.0) == pytest.approx(0.3)


def test_edges_along_the_ghosts_do_not_count():
    """A ramp along the bar's long edges, away from its ends."""
    middle = np.zeros_like(EVERYWHERE)
    middle[0, 10:14, 4:16] = True
    ramp = np.broadcast_to(0.1 * np.arange(24.0)[:, None], (2, 24, 40))
    plain, steeper = (
        ghost_contour(0.5 * ghost() + error, ghost(), middle, 10.0) for error in (0 * ramp, ramp)
    )
    assert plain == pytest.approx(0.5)
    assert steeper == pytest.approx(0.5, rel=1e-3)


def test_faint_edges_do_not_count():
    """Texture far below the ghost's edges, which doubles: the ghost's tenth that is left out."""
    texture = 1e-3 * np.random.default_rng(0).standard_normal((2, 24, 40))
    error = ghost() + 10 * texture
    assert ghost_contour(error, ghost() + texture, EVERYWHERE, 10.0) == pytest.approx(1, abs=0.02)


def test_without_a_ghost_there_is_no_contour():
    assert ghost_contour(ghost(), 0 * ghost() + 0.2, EVERYWHERE, 10.0) is None
    assert ghost_contour(ghost(), ghost(), ~EVERYWHERE, 10.0) is None


# Statistics


def test_students_interval():
    """By hand: sd 1, n 4, t 3.182."""
    values = np.array([-1.0, -0.2, 0.2, 1.0])
    values = 2 + values / values.std(ddof=1)
    found = estimate(values)
    assert (found.mean, found.inputs) == (pytest.approx(2), 4)
    assert (found.low, found.high) == pytest.approx((2 - 1.5912, 2 + 1.5912), abs=1e-4)
    assert np.isnan(estimate([1.0]).low)
    assert np.isnan(estimate([]).mean)
    assert [estimate(some).written for some in ([], [0.1])] == [
        "nothing (no input)",
        "+0.100 (1 input)",
    ]


def test_intervals_of_gains_cover_what_they_should():
    random = np.random.default_rng(0)
    found = [estimate(random.normal(0.1, 1.0, 8)) for _ in range(2000)]
    assert np.mean([one.low <= 0.1 <= one.high for one in found]) == pytest.approx(0.95, abs=0.02)


def cell(jod, contour=None):
    return Cell(0.5, 1.0, None, jod, contour, contour, 0.0, "CONVERGED", 0.0, None, ())


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
    assert quality.gains(CELLS, "contrast") == pytest.approx({"a": 0.3, "b": -0.1})


def test_shortfalls_are_against_the_better_of_both():
    assert list(quality.shortfalls(CELLS, "contrast").values()) == pytest.approx(
        [-0.5, 0.1, 0.1, -0.05]
    )


def test_falls_of_the_contour_are_geometric_means_over_inputs():
    found = quality.falls(CELLS, "contrast")
    assert list(found.values()) == pytest.approx([4, 1, 9])
    assert quality.geometric(found) == pytest.approx(np.sqrt(2 * 9))
