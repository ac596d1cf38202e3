"""A mistake turns each of the stereo experiments red. `make validate` runs them without."""

from __future__ import annotations

import numpy as np
import pytest
from mistakes import failed

from compensate.aim import pair
from compensate.methods import STEREO
from domesim.pathtrace import polarised
from domesim.scene import StereoScene, load_stereo
from validation import data
from validation.experiment import Work, load_experiment
from validation.experiments import (
    fig2_fig6_deghosting,
    fig10_seats,
    polarised_crosstalk,
)


@pytest.fixture
def _few(monkeypatch):
    """One theatre or system of several that are measured alike; `make validate` has them all."""
    monkeypatch.setattr(fig10_seats, "SCENES", fig10_seats.SCENES[:1])


def more_depolarising(monkeypatch):
    """The tracer's screen scatters 2 % more than it should."""
    honest = polarised.silver

    def silver(screen):
        described = honest(screen)
        return {**described, "weight": 1.02 * described["weight"]}

    monkeypatch.setattr(polarised, "silver", silver)


def ours_is_subtraction(monkeypatch):
    """The perceptual method ends where it starts."""
    monkeypatch.setitem(STEREO, "perceptual", STEREO["subtractive"])


def one_seat_for_all(monkeypatch):
    """Wherever one asks for a seat, it is the sweet spot."""
    honest = StereoScene._share
    monkeypatch.setattr(
        StereoScene, "_share", lambda self, name, *size: honest(self, "sweet spot", *size)
    )


@pytest.mark.usefixtures("_few")
@pytest.mark.parametrize(
    ("name", "mutate"),
    [
        pytest.param("polarised_crosstalk", more_depolarising, marks=pytest.mark.long),
        ("fig2_fig6_deghosting", ours_is_subtraction),
        ("fig10_seats", one_seat_for_all),
    ],
)
def test_mutations_turn_an_experiment_red(name, mutate, monkeypatch):
    mutate(monkeypatch)
    finding = load_experiment(name).run(Work(quick=True))
    assert not finding.passed


@pytest.mark.usefixtures("_few")
def test_veils_that_are_too_bright_harm_a_seat(monkeypatch):
    monkeypatch.setattr(pair, "SHARE", 12.0)
    red = failed(load_experiment("fig10_seats").run(Work(quick=True)))
    assert red
    assert all("that the default gains over subtraction" in what for what in red)


def test_the_line_by_hand_is_the_depolarised_share_over_the_rest():
    """Lipton's figures: s 0.021 on a gain of 2.4, and 300 : 1 twice."""
    theatre = load_stereo(polarised_crosstalk.SCENE).theatre
    assert theatre is not None
    assert polarised_crosstalk.by_hand(theatre, 0.0) == pytest.approx(
        0.0105 / (2.4 - 0.0105) + 2 / 300, rel=0.01
    )


def test_the_region_holds_a_ghost_that_cannot_be_subtracted():
    scene = load_stereo(fig2_fig6_deghosting.STEREO_SCENE)
    posed = fig2_fig6_deghosting.pose(
        fig2_fig6_deghosting.pair(fig2_fig6_deghosting.GENERATED, 128, scene), scene
    )
    rows, cols = fig2_fig6_deghosting.uncorrectable(posed)
    assert (rows.stop - rows.start, cols.stop - cols.start) == (18, 32)
    left = posed.seen(posed.subtractive) - posed.wanted
    energy = np.sum(left**2, axis=(0, 3))
    assert energy[rows, cols].mean() > 2 * energy.mean()


def test_pairs_that_are_not_there_are_left_out(monkeypatch, tmp_path):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    found, left_out = data.present(fig2_fig6_deghosting.DATA)
    assert (found, len(left_out)) == ([], len(fig2_fig6_deghosting.DATA))


@pytest.mark.parametrize(("ours", "others", "passes"), [(0, 0, 1), (0, 1, 1), (2, 1, 0), (1, 0, 0)])
def test_no_error_at_all_is_the_least(ours: float, others: float, passes: bool) -> None:
    """Of a pair that subtraction shows exactly, all methods have an error of 0."""
    errors = {"subtractive": others, "none": 3.0, "perceptual": ours}
    seen = {name: fig2_fig6_deghosting.Seen(error, 0, 0, 0) for name, error in errors.items()}
    outcome = fig2_fig6_deghosting.Outcome((4, 3), seen, 0.0)
    assert fig2_fig6_deghosting._least("pair", outcome).passed == bool(passes)
