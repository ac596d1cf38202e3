"""The engine's entry for stereo pairs: left and right in, what to project out."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from compensated import compensate_frame
from pairs import pair

from compensate.figures import Appraisal
from compensate.master import compensate
from compensate.methods import STEREO
from compensate.pose import pose
from compensate.solve import solved
from compensate.weighting import PerceptualWeighting
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, Master
from domesim.observation.crosstalk import leak_matrices
from domesim.scene import StereoScene, load_stereo
from domesim.scene.screening import decoded
from domesim.scene.stereo import Seat

LINEAR = ColourTag("linear", "BT.709", "the test")
ROWS, COLS = 40, 64


DARK = (0.0, 0.0)


def system(crosstalk: float = 0.05) -> StereoScene:
    paper = load_stereo("stereo_polarised_paper")
    viewing = replace(paper.viewing, extent=2.0, image_area=2.5)
    leak = leak_matrices(crosstalk)
    seats = {name: replace(seat, matrices=leak) for name, seat in paper.seats.items()}
    return replace(paper, seats=seats, viewing=viewing, ambient=DARK)


def light(seed: int = 0) -> np.ndarray:
    return pair(ROWS, COLS, seed, np.float32)


def master(bits: int = 32) -> Master:
    frames = [
        Frame(view, Path(f"{eye}.exr"), LINEAR, bits, True)
        for eye, view in zip("LR", light(), strict=True)
    ]
    return Master(tuple(frames), "files")


@pytest.mark.parametrize("method", STEREO)
def test_every_method_stays_in_range(method):
    outcome = compensate_frame(master(), system(), method=method)
    assert outcome.frame.pixels.shape == (2, ROWS, COLS, 3)
    assert outcome.light.min() >= 0
    assert outcome.light.max() <= 1
    assert (outcome.light != light()).any() == (method != "none")


def test_ours_has_the_least_visible_error():
    posed = pose(light(), system(), PerceptualWeighting())
    errors = {name: Appraisal(posed).visible_error(solved(posed, name).light) for name in STEREO}
    others = min(error for name, error in errors.items() if name != "perceptual")
    assert errors["perceptual"] < 0.95 * others
    assert errors["none"] > errors["subtractive"]


def test_the_figures_tell_of_ghosts():
    figures = {
        name: compensate_frame(master(), system(), method=name).figures
        for name in ("none", "subtractive", "perceptual")
    }
    assert figures["none"].ghost_edges == pytest.approx(1)
    assert figures["subtractive"].ghost_edges < 1
    assert 0.05 < figures["none"].clipped < 1
    assert figures["perceptual"].ghost_edges < figures["none"].ghost_edges
    leaked = 0.05 * light() @ system().projector.luminance_weights * 50.0
    assert figures["none"].pollution == pytest.approx(leaked.mean(), rel=1e-4)


def test_a_ghost_without_edges_has_no_figure_of_them():
    """Full white for one eye, black for the other: the pattern that crosstalk is measured with."""
    views = np.stack([np.ones((ROWS, COLS, 3)), np.zeros((ROWS, COLS, 3))]).astype(np.float32)
    frames = [Frame(view, Path("x.exr"), LINEAR, 32, True) for view in views]
    for method in ("none", "raised-black-local", "perceptual"):
        figures = compensate_frame(Master(tuple(frames), "files"), system(), method=method).figures
        assert figures.ghost_edges is None
        json.dumps(asdict(figures), allow_nan=False)


def test_halved_views_are_refused():
    paper = load_stereo("stereo_polarised_paper")
    for packing, rows, cols in (("side-by-side", 54, 48), ("top-bottom", 27, 96)):
        half = Frame(np.ones((rows, cols, 3), np.float32), Path("x.exr"), LINEAR, 32, True)
        with pytest.raises(InputError, match=r"views at half (width|height)\?.*Stretch"):
            decoded(Master((half, half), packing), paper)
        assert decoded(Master((half, half), "files"), paper).shape == (2, rows, cols, 3)


def test_a_seat_of_twice_the_weight_counts_as_two():
    scene = system().seen_from("sweet spot")
    sweet, left = (system().seats[name] for name in ("sweet spot", "left"))

    def solution(**seats):
        several = replace(scene, seats=seats, chosen=tuple(seats))
        return compensate(light(), several, weighting=PerceptualWeighting()).light

    weighted = solution(a=replace(sweet, weight=2.0), b=left)
    assert np.abs(weighted - solution(a=sweet, again=sweet, b=left)).max() <= 2e-3
    assert np.abs(weighted - solution(a=sweet, b=left)).max() > 5e-3


def test_the_figures_of_several_seats_are_the_mean_of_theirs():
    posed = pose(light(), system(0.03).seen_from("sweet spot", "left", "right"))
    answer = solved(posed, "perceptual").light
    by_seat = Appraisal(posed).look(answer).by_seat
    assert list(by_seat) == ["sweet spot", "left", "right"]
    assert np.mean(list(by_seat.values())) == pytest.approx(Appraisal(posed).loss(answer))


def test_a_table_is_seen_as_it_is():
    scene = load_stereo("stereo_shutter")
    scene = replace(scene, viewing=system().viewing)
    posed = pose(light(), scene, PerceptualWeighting())
    exact = scene.observation(ROWS, COLS)
    result = solved(posed, "perceptual")
    assert Appraisal(posed).visible_error(result.light) < 0.9 * Appraisal(posed).visible_error(
        posed.subtractive
    )
    residual = exact.observe(result.light) - posed.problem.desired
    assert np.array_equal(posed.residual(result.light), residual)
    with pytest.raises(InputError, match="'paper' is not known for stereo_shutter"):
        solved(posed, "paper")


def test_seats_have_their_maps():
    scene = load_stereo("stereo_cinema_silver")
    for name, seat in scene.seats.items():
        share = scene.seen_from(name).observation(54, 90).share
        assert share.shape == (2, 54, 90)
        cells = share.reshape(2, 9, 6, 15, 6).mean((2, 4))
        # Linear between the cells' centres, so that only the outer ones differ
        assert cells[:, 1:-1, 1:-1] == pytest.approx(seat.share[:, 1:-1, 1:-1], rel=1e-2)
    flat = replace(scene, seats={"here": Seat(leak_matrices(0.02))}, chosen=("here",))
    assert np.ptp(flat.observation(4, 5).share) == 0
