"""What the frames of a show share, and what they must not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pairs import COLOURED, pair

from compensate import aim
from compensate.figures import Appraisal
from compensate.fourier import Fourier
from compensate.master import solve_frame
from compensate.pose import Stage, pose
from compensate.ruler import Ruler
from compensate.weighting import PerceptualWeighting
from domesim.frames import ColourTag, Frame, Master
from domesim.light import strips, transfer
from domesim.observation.crosstalk import Crosstalk
from domesim.scene import Scene, load_scene
from domesim.scene.screening import decoded, encoded, mean_luminance, within_range
from domesim.scene.stereo import StereoScene

LINEAR = ColourTag("linear", "BT.709", "the test")
SRGB = ColourTag("srgb", "P3-D65", "the test")


def stereo(matrices: np.ndarray = COLOURED) -> StereoScene:
    paper = load_scene("stereo_polarised_paper")
    assert isinstance(paper, StereoScene)
    seats = {name: replace(seat, matrices=matrices) for name, seat in paper.seats.items()}
    return replace(paper, seats=seats, ambient=np.array([[0.1, 0.2, 0.3], [0.2, 0.1, 0.4]]))


def cinema() -> StereoScene:
    """With maps, other primaries than the masters', and all its seats looking."""
    silver = load_scene("stereo_cinema_silver")
    assert isinstance(silver, StereoScene)
    return silver.seen_from(*silver.seats)


def frame(light: np.ndarray, colour: ColourTag = LINEAR, bits: int = 32) -> Master:
    frames = tuple(
        Frame(view, Path(f"{number}.exr"), colour, bits, bits == 32)
        for number, view in enumerate(light)
    )
    return Master(frames, "single" if len(frames) == 1 else "files")


def lit(rows: int = 24, cols: int = 40, seed: int = 0) -> np.ndarray:
    """A pair in which nothing clips."""
    return 0.3 + 0.5 * pair(rows, cols, seed, np.float32)


CASES: dict[str, tuple[Scene, np.ndarray]] = {
    "pair": (stereo(), pair(24, 40, 0, np.float32)),
    "exact pair": (stereo(), lit()),
    "all seats": (cinema(), pair(24, 40, 0, np.float32)),
    "dome": (load_scene("dome_imax"), pair(40, 40, 0, np.float32)[:1]),
}


@pytest.mark.parametrize("case", CASES)
def test_the_next_frame_of_a_size_needs_no_new_weighting(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, light = CASES[case]
    built = []
    build = PerceptualWeighting.__call__
    monkeypatch.setattr(
        PerceptualWeighting, "__call__", lambda *args: built.append(1) or build(*args)
    )
    observed = []
    kind = type(scene)
    observe = kind.observation
    monkeypatch.setattr(kind, "observation", lambda *args: observed.append(1) or observe(*args))
    stage = Stage(scene)
    first = stage.pose_frame(frame(light))[0]
    once = len(observed)
    second = stage.pose_frame(frame(light[:, ::-1].copy()))[0]
    assert len(built) == 0  # the paper's is made where it is asked for
    assert second.problem.weighting is first.problem.weighting
    assert len(built) == 1
    assert len(observed) == once
    smaller = light[:, :-2, :-2]
    third = stage.pose_frame(frame(smaller))[0]
    assert third.problem.desired.shape[1:] == smaller.shape[1:]
    assert len(built) == 2
    alone = pose(second.desired, scene)
    assert Appraisal(second).loss_before == pytest.approx(Appraisal(alone).loss_before, rel=1e-6)


def test_figures_are_not_counted_as_the_solvers_transforms() -> None:
    """They may be computed while the next frame is solved, with the same weighting."""
    scene, light = CASES["all seats"]
    posed = pose(light, scene)
    before = posed.problem.ffts
    assert (
        Appraisal(posed).visible_error(posed.desired)
        > Appraisal(posed).visible_error(posed.subtractive)
        > 0
    )
    assert posed.problem.ffts == before
    posed.problem.quadratic(posed.subtractive)
    assert posed.problem.ffts > before


@pytest.mark.parametrize("case", CASES)
def test_float32_to_the_end(case: str) -> None:
    scene, light = CASES[case]
    posed, _ = Stage(scene).pose_frame(frame(light))
    solution = solve_frame(frame(light), posed, 0.0, "perceptual")
    outcome = solution.outcome()
    arrays = {
        "desired": posed.desired,
        "wanted": posed.problem.desired,
        "subtractive": posed.subtractive,
        "residual": posed.residual(posed.desired),
        "seen": posed.seen(posed.desired),
        "light": outcome.light,
        "pixels": outcome.frame.pixels,
        "observed": scene.observation(*light.shape[1:3]).observe(light),
    }
    assert {name: array.dtype for name, array in arrays.items()} == dict.fromkeys(
        arrays, np.dtype(np.float32)
    )


def test_a_frame_in_which_nothing_clips_costs_no_transform(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor a vision model: reading and writing it take longer than all of it."""
    stage = Stage(stereo())
    stage.pose_frame(frame(lit(seed=1)))
    for step in ("forward", "inverse"):
        monkeypatch.setattr(Fourier, step, lambda *_: pytest.fail("transformed"))
    for place, seen in ((aim, "veiled"), (Ruler, "lost")):
        monkeypatch.setattr(place, seen, lambda *_: pytest.fail("looked at"))
    posed, _ = stage.pose_frame(frame(lit()))
    figures = solve_frame(frame(lit()), posed, 0.0, "perceptual").figures(
        Appraisal(posed), 0, brief=True
    )
    assert figures.loss_before is None
    assert (figures.loss_after, figures.distance, figures.ghost_edges) == (0, 0, 0)
    assert figures.pollution > 0
    monkeypatch.undo()
    assert Appraisal(posed).loss_before == pytest.approx(
        Appraisal(pose(posed.desired, stereo())).loss_before
    )
    untouched = solve_frame(frame(lit()), posed, 0.0, "none").figures(
        Appraisal(posed), 0, brief=True
    )
    assert untouched.loss_before == untouched.loss_after > 0


def mean_of_whole(light: np.ndarray, scene: Scene) -> float:
    """`mean_luminance` by its definition, on the whole array in float64."""
    areas = scene.pixel_areas(*light.shape[1:3])
    mean = np.einsum("ij,vijp->p", areas, light.astype(np.float64)) / (areas.sum() * len(light))
    return float(mean @ scene.projector.luminance_weights) * scene.projector.white


@pytest.fixture
def _strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures are several."""
    monkeypatch.setattr(strips, "SAMPLES", 700)


@pytest.mark.usefixtures("_strips")
@pytest.mark.parametrize("case", CASES)
def test_figures_in_strips_are_those_of_the_whole(case: str) -> None:
    scene, light = CASES[case]
    posed = pose(light, scene)
    added = np.asarray(posed.residual(posed.desired))
    assert Appraisal(posed).pollution == pytest.approx(mean_of_whole(added, scene), rel=1e-5)
    too_bright = np.asarray(posed.single.residual(posed.subtractive))[:, posed.screen] > 1e-5
    clipped = np.mean(np.any(too_bright, axis=-1))
    assert Appraisal(posed).clipped == pytest.approx(clipped, abs=1e-12)
    assert mean_luminance(light, scene) == pytest.approx(mean_of_whole(light, scene), rel=1e-5)


@pytest.mark.usefixtures("_strips")
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("bits", [8, 32])
def test_a_master_in_strips_is_that_of_the_whole(case: str, bits: int) -> None:
    scene, light = CASES[case]
    light = light * 1.3
    codes = np.rint(light.clip(0, 1) * 255).astype(np.float32) / np.float32(255)
    master = frame(codes if bits == 8 else light, SRGB if bits == 8 else LINEAR, bits)
    found = decoded(master, scene)
    curve = transfer.named(master.colour.transfer, white=scene.projector.white)
    expected = scene.projector.decode(master.pixels, curve, master.colour.primaries)
    np.testing.assert_array_equal(found, expected)
    screen = scene.screen(*light.shape[1:3])
    within, share = within_range(found, screen)
    on = screen[None, :, :, None]
    np.testing.assert_array_equal(within, np.where(on, found.clip(0, 1), found))
    slack = 8 * np.finfo(np.float32).eps
    beyond = np.any((found < -slack) | (found > 1 + slack), axis=-1)
    assert share == pytest.approx(np.mean(beyond[:, screen]))
    assert share > 0 or bits == 8
    bright = 1.2 * found
    stored, clipped = encoded(master, bright, scene, screen)
    pixels = scene.projector.encode(bright, curve, master.colour.primaries)
    least, largest = master.code_range
    np.testing.assert_array_equal(
        stored.pixels, np.where(on, pixels.clip(least, largest), master.pixels)
    )
    outside = np.any((pixels < least - 0.5 / 65535) | (pixels > largest + 0.5 / 65535), axis=-1)
    assert clipped == pytest.approx(np.mean(outside[:, screen]))
    assert (clipped > 0) == (bits == 8)


@pytest.mark.usefixtures("_strips")
@pytest.mark.parametrize("share", [None, (0.5, 1.5)])
def test_crosstalk_in_strips_is_that_of_the_whole(share: tuple[float, float] | None) -> None:
    light = np.random.default_rng(0).random((2, 30, 40, 3), np.float32)
    varying = None if share is None else np.linspace(*share, 2 * 30 * 40).reshape(2, 30, 40)
    black = np.array([[0.01, 0.02, 0.03], [0.04, 0.05, 0.06]])
    crosstalk = Crosstalk(30, 40, COLOURED, share=varying, black=black)
    expected = light + crosstalk.leaked(light) + black[:, None, None, :]
    np.testing.assert_allclose(crosstalk.observe(light), expected, atol=1e-6)


@pytest.mark.parametrize("brightest", [1.0, 1.5])
def test_halves_that_are_decoded_anew_give_what_their_light_gives(brightest: float) -> None:
    """No picture of a dome's master is made; what is over white, or off the screen, is one case."""
    scene, random = load_scene("dome_imax"), np.random.default_rng(5)
    light = brightest * random.random((1, 50, 50, 3), np.float32) ** 6
    light[0, 18:25, 18:25] = 0.001
    light[0, 21, 21] = 0.9  # a star
    halves = light.astype(np.float16)
    found = []
    for codes in (halves, halves.astype(np.float32)):
        posed, out_of_range = Stage(scene).pose_frame(frame(codes, bits=16))
        solution = solve_frame(frame(codes, bits=16), posed, out_of_range, "perceptual")
        figures = vars(solution.figures(Appraisal(posed), 0.0)) | {"seconds": 0}
        assert "desired" not in vars(posed)
        assert (posed.whole is None) is (codes is halves)
        found.append((solution.result.light, posed.desired, figures))
    (result, desired, figures), (expected, wanted, others) = found
    np.testing.assert_array_equal(result, expected)
    np.testing.assert_array_equal(desired, wanted)
    assert figures == others
    assert bool(figures["out_of_range"]) is (brightest > 1)
    assert figures["stars"] is not None
