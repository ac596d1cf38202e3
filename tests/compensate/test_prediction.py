"""Prediction: what stands above the thresholds, by hand and by what must not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.prediction import (
    MARKED,
    Combination,
    Prediction,
    Triage,
    Verdict,
    predict,
    regions,
    triage,
)
from compensate.vision.differences import visible_difference
from compensate.vision.glare import StrayLight
from compensate.vision.masking import transducer
from compensate.vision.saliency import gbvs
from compensate.vision.tvi import MesopicBlend, threshold
from domesim.errors import InputError
from domesim.observation.crosstalk import leak_matrices
from domesim.scene import DomeScene, StereoScene, load_dome, load_stereo

PAPER = Prediction(combination=Combination.PAPER, saliency=False)
LOCAL = Prediction(combination=Combination.LOCAL_CONTRAST)
ROWS, COLS, PER_DEGREE = 48, 64, 8.0
WHITE = 50.0
LEAK = 0.05


def stereo(leaks: object = LEAK, *, black: float = 0.0, degrees: float = 8.0) -> StereoScene:
    """A pair of `degrees` across; `leaks` of one number are alike for both eyes."""
    paper = load_stereo("stereo_polarised_paper")
    seats = {
        name: replace(seat, matrices=leak_matrices(leaks), share=None)
        for name, seat in paper.seats.items()
    }
    viewing = replace(paper.viewing, extent=degrees, image_area=0.75 * degrees**2)
    assert paper.projector.white == WHITE
    return replace(paper, seats=seats, viewing=viewing, ambient=np.full((2, 3), black))


def pair(left: object, right: object, rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    """Grey light from luminances, cd/m²: numbers or (row, col)."""
    planes = [np.broadcast_to(np.asarray(eye) / WHITE, (rows, cols)) for eye in (left, right)]
    return np.repeat(np.stack(planes)[..., None], 3, axis=-1).astype(np.float32)


def places(rows: int = ROWS, cols: int = COLS, degrees: float = 8.0) -> tuple[object, object]:
    """Row and column of the pixels' centres, degrees from the middle."""
    row, col = np.mgrid[:rows, :cols] + 0.5
    return (row - rows / 2) * degrees / cols, (col - cols / 2) * degrees / cols


def spot(width: float, **size: object) -> np.ndarray:
    down, across = places(**size)
    return np.exp(-((down**2 + across**2) / (2 * width**2)))


def dome(name: str = "dome_hemisphere", degrees: float = 8.0) -> DomeScene:
    """A dome that is small to the eye, so that mechanisms have pixels."""
    scene = load_dome(name)
    return replace(scene, viewing=replace(scene.viewing, extent=degrees, image_area=degrees**2))


def fulldome(luminance: object, scene: DomeScene, size: int = 64) -> np.ndarray:
    plane = np.broadcast_to(np.asarray(luminance) / scene.projector.white, (size, size))
    return np.repeat(plane[None, ..., None], 3, axis=-1).astype(np.float32)


# TVI.


@pytest.mark.parametrize("blend", MesopicBlend)
@pytest.mark.parametrize("grey", [0.02, 1.0, 30.0])
@pytest.mark.parametrize(("size", "seen"), [(0.97, False), (1.03, True)])
def test_a_flat_veil_on_flat_grey_is_seen_from_its_threshold_on(
    blend: MesopicBlend, grey: float, size: float, seen: bool
) -> None:
    veil = float(size * threshold(np.array([grey]), blend)[0])
    other = 20.0
    posed = pose(pair(grey, other), stereo([[veil / other], [0.0]]))
    found = predict(posed, settings=Prediction(blend=blend))
    assert found.residual[0] == pytest.approx(veil, rel=1e-3)
    assert found.tvi[0] == pytest.approx(size, rel=1e-3)
    assert found.masking[0] == pytest.approx(transducer(size) ** 2, rel=0.01)
    assert (found.mask[0] == seen).all()
    assert not found.mask[1].any()
    assert found.visible.shares == (float(seen), 0.0)
    assert found.share == seen / 2


@pytest.mark.parametrize("combination", [Combination.WITH_VEILS, Combination.LOCAL_CONTRAST])
def test_the_eyes_own_light_covers_pollution_beside_bright_things(
    combination: Combination,
) -> None:
    # two ghosts of the same light on black, of which one lies beside a lamp
    down, across = places()
    ghosts = 1.0 * ((np.hypot(down, across + 2) < 0.4) | (np.hypot(down, across - 2.5) < 0.4))
    lamp = np.where(np.hypot(down, across + 3.6) < 0.8, WHITE, 0.02)
    posed = pose(pair(lamp, ghosts), stereo([[LEAK], [0.0]]))
    found = {
        age: predict(
            posed,
            settings=Prediction(combination=combination, eye=StrayLight(age) if age else None),
        ).prediction[0]
        for age in (0, 25, 70)
    }
    beside, away = (np.hypot(down, across + x) < 0.3 for x in (2, -2.5))
    none, young, old = (found[age] for age in (0, 25, 70))
    assert old[beside].mean() <= young[beside].mean() < 0.6 * none[beside].mean()
    assert old[away].mean() > 0.95 * none[away].mean()


def test_the_residual_is_averaged_over_an_area() -> None:
    right = np.zeros((ROWS, COLS))
    right[20, 20] = WHITE
    posed = pose(pair(1.0, right), stereo())
    for side in (1, 3, 5):
        found = predict(posed, settings=Prediction(area=side / PER_DEGREE)).tvi[0]
        touched = found > 0.01 * found.max()
        assert touched.sum() == side**2
        assert touched[20, 20]
        assert found.max() == pytest.approx(
            LEAK * WHITE / side**2 / threshold(np.array([1.0]))[0], rel=0.01
        )


def test_a_dark_ghost_counts_like_a_bright_one() -> None:
    """As compensation may leave it."""
    scene = stereo(0.0)
    posed = pose(pair(5.0, 5.0), scene)
    change = 3.0 * spot(0.5)
    brighter, darker = (predict(posed, pair(5.0 + k * change, 5.0)) for k in (1, -1))
    np.testing.assert_allclose(brighter.residual, -darker.residual, atol=1e-5)
    np.testing.assert_array_equal(brighter.tvi > 1, darker.tvi > 1)
    assert darker.mask[0].any()
    assert not darker.mask[1].any()


# The combinations.


def test_a_uniform_veil_in_a_dome_is_not_missed() -> None:
    scene = dome()
    posed = pose(fulldome(3.0, scene), scene)
    found, papers = predict(posed), predict(posed, settings=PAPER)
    # a third of the light, far above TVI
    assert found.tvi[0, posed.screen].min() > 1.5
    assert found.mask[0, posed.screen].all()
    assert found.share == pytest.approx(1)
    # the paper's product sees nothing of it, in the middle nor at the rim of the screen
    assert papers.masking.max() < 0.01
    assert not papers.mask.any()
    np.testing.assert_array_equal(papers.tvi, found.tvi)


@pytest.mark.parametrize("combination", [Combination.WITH_VEILS, Combination.PAPER])
def test_the_maps_make_the_prediction(combination: Combination) -> None:
    posed = pose(pair(spot(0.5) + 0.2, 8 * spot(1.0)), stereo())
    for saliency in (False, True):
        settings = Prediction(0.3, combination, saliency)
        found = predict(posed, settings=settings)
        product = (found.tvi > 1) * (1 - 2.0**-found.masking)
        if saliency:
            product *= found.saliency
        assert found.prediction == pytest.approx(product, abs=1e-5)
        assert found.mask.any()
        assert not found.mask.all()
        np.testing.assert_array_equal(found.mask, found.prediction > 0.3)
        assert found.share == pytest.approx(found.mask.mean())


def test_local_contrast_is_that_of_what_is_seen() -> None:
    posed = pose(pair(spot(0.5) + 0.2, 8 * np.roll(spot(0.5), 9, axis=1)), stereo())
    to_xyz = (posed.scene.projector.to_xyz * WHITE).T
    wanted, seen = (light @ to_xyz for light in (posed.desired, posed.seen(posed.desired)))
    visible = 1 - 2.0 ** -visible_difference(wanted, seen, PER_DEGREE)
    for saliency in (None, True):
        found = predict(posed, settings=Prediction(0.3, LOCAL.combination, saliency))
        product = visible * found.saliency if saliency else visible
        assert found.prediction == pytest.approx(product, abs=1e-4)
        np.testing.assert_array_equal(found.mask, found.prediction > 0.3)
        assert found.mask.any()
        assert not found.mask.all()
    # the maps of eqs. 10 and 11 stay, without what the veils add
    papers = predict(posed, settings=PAPER)
    np.testing.assert_array_equal(found.tvi, papers.tvi)
    np.testing.assert_array_equal(found.masking, papers.masking)


def test_the_threshold_is_the_combinations_own() -> None:
    assert (Prediction().least, PAPER.least, LOCAL.least) == (0.05, 0.05, MARKED)
    assert Prediction(0.2, Combination.LOCAL_CONTRAST).least == 0.2
    posed = pose(pair(0.1, 8 * spot(0.5)), stereo())
    seen = predict(posed, settings=LOCAL)
    np.testing.assert_array_equal(seen.mask, seen.prediction > MARKED)
    assert 0 < seen.share < predict(posed, settings=replace(LOCAL, threshold=0.05)).share


# Saliency.


def test_it_is_the_other_eyes_saliency() -> None:
    left, right = 20 * spot(0.4), np.roll(30 * spot(0.7), 18, axis=1)
    light = pair(left, right)
    found = predict(pose(light, stereo()), settings=Prediction(combination=Combination.PAPER))
    for eye in (0, 1):
        assert found.saliency[eye] == pytest.approx(gbvs(light[1 - eye]), abs=0.02)
        assert found.saliency[eye] != pytest.approx(gbvs(light[eye]), abs=0.3)
    assert found.mask[0].any()
    assert found.salient == found.share


# What must not matter, and what must.


def test_a_faint_frame_is_not_stretched_to_a_full_mask() -> None:
    left, right = 2 * spot(0.4), np.roll(20 * spot(0.7), 10, axis=1)
    bright, faint = (
        predict(pose(scale * pair(left, right), stereo()))
        for scale in (np.float32(1), np.float32(1e-4))
    )
    assert bright.share > 0.05
    assert faint.residual.max() > 0
    assert faint.share == 0
    assert faint.prediction.max() == 0
    assert faint.masking.max() < 0.01


def test_a_frame_without_pollution_has_empty_maps() -> None:
    found = triage(pose(pair(spot(0.5), spot(1.0)), stereo(0.0)))
    assert found.untouched.tvi.max() == 0
    assert found.untouched.masking.max() == 0
    assert (found.untouched.share, found.subtracted.share) == (0, 0)
    assert found.verdict is Verdict.NOTHING


POLLUTED = stereo(black=0.01).with_grade("taken-out")


@pytest.mark.parametrize("scene", [dome("dome_imax"), POLLUTED], ids=["dome", "pair"])
def test_the_rooms_own_light_is_no_pollution(scene: DomeScene | StereoScene) -> None:
    size = (1, 64, 64, 3) if isinstance(scene, DomeScene) else (2, ROWS, COLS, 3)
    posed = pose(np.zeros(size, np.float32), scene)
    assert Appraisal(posed).pollution > 0.005
    for settings in (Prediction(), LOCAL):
        found = triage(posed, settings)
        assert found.untouched.residual.max() == found.untouched.prediction.max() == 0
        assert found.verdict is Verdict.NOTHING
    graded = pose(posed.desired, scene.with_grade("kept", "kept"))
    assert abs(Appraisal(graded).pollution) < 1e-8
    for settings in (Prediction(), LOCAL):
        found = triage(graded, settings)
        assert found.untouched.residual.max() == found.untouched.prediction.max() == 0
    # nor is it an error to take it away where that can be done
    grey = pose(np.full(size, 0.5, np.float32), scene)
    assert triage(grey).subtracted.share == 0
    assert np.abs(predict(grey, grey.subtractive).residual).max() < 1e-4


@pytest.mark.parametrize(
    ("combination", "coarse", "finer"),
    [
        *((Combination.WITH_VEILS, 1, finer) for finer in (2, 4, 3)),
        (Combination.LOCAL_CONTRAST, 2, 4),  # of 16 pixels per degree, and reduced to as many
    ],
)
def test_a_finer_picture_has_the_same_pollution(
    combination: Combination, coarse: int, finer: int
) -> None:
    def share(factor: int) -> Triage:
        size = {"rows": factor * ROWS, "cols": factor * COLS}
        left = 0.05 + 2 * spot(0.5, **size)
        right = np.roll(30 * spot(0.8, **size), 12 * factor, axis=1)
        return triage(pose(pair(left, right, **size), stereo()), Prediction(None, combination))

    one, other = share(coarse), share(finer)
    assert 0.01 < one.untouched.share < 0.6
    assert other.untouched.share == pytest.approx(one.untouched.share, rel=0.05)
    assert other.subtracted.share == pytest.approx(one.subtracted.share, rel=0.05)
    assert other.untouched.mask.shape == (2, finer * ROWS, finer * COLS)


@pytest.mark.parametrize("settings", [Prediction(), LOCAL])
def test_nothing_counts_off_the_screen(settings: Prediction) -> None:
    scene = dome()
    light = fulldome(0.1 + 5 * np.roll(spot(0.4, rows=64), 14, axis=0), scene)
    other = light.copy()
    off = ~pose(light, scene).screen
    other[:, off] = np.random.default_rng(0).random((off.sum(), 3))
    posed = pose(light, scene)
    one, *others = (
        predict(posed, settings=settings),
        predict(pose(other, scene), settings=settings),
        predict(posed, other, settings),
    )
    assert one.prediction.max() > 0.1
    for name in ("residual", "tvi", "masking", "saliency", "prediction", "mask"):
        maps = getattr(one, name)
        assert not maps[:, off].any(), name
        for two in others:
            np.testing.assert_array_equal(maps, getattr(two, name), err_msg=name)


def test_shares_are_of_the_screens_area() -> None:
    """Pixels at the rim of a domemaster are smaller screen than its middle's."""
    scene = dome()
    row, col = np.mgrid[:64, :64] - 31.5
    luminance = np.where(np.hypot(row, col) < 29, 0.02, 8.0)
    posed = pose(fulldome(luminance, scene), scene)
    found = predict(posed)
    weighted = float(posed.setting.areas[found.mask[0]].sum() / posed.setting.areas.sum())
    assert found.share == pytest.approx(weighted)
    assert abs(weighted - found.mask.sum() / posed.screen.sum()) > 0.01


# Verdicts.


def test_what_subtraction_removes_needs_no_solving() -> None:
    # 10 % crosstalk, seen everywhere, and light enough everywhere to take it away
    bright = triage(pose(pair(20 + 10 * spot(0.5), 25 + 20 * spot(1.0)), stereo(0.1)))
    assert bright.untouched.share > 0.1
    assert bright.subtracted.share == 0
    assert bright.verdict is Verdict.SUBTRACT
    # a ghost in the dark stays
    dark = triage(pose(pair(0.0, 25 * spot(1.0)), stereo(0.1)))
    assert 0 < dark.subtracted.share <= dark.untouched.share
    assert dark.verdict is Verdict.COMPENSATE


def test_negligible_is_an_area_in_square_degrees() -> None:
    posed = pose(pair(0.0, 25 * spot(0.3)), stereo())
    visible = triage(posed).untouched.visible.shares[0] * 48  # of the right eye nothing
    assert triage(posed, Prediction(negligible=1.01 * visible)).verdict is Verdict.NOTHING
    assert triage(posed, Prediction(negligible=0.9 * visible)).verdict is not Verdict.NOTHING


@pytest.mark.parametrize(
    ("combination", "saliency"),
    [*((each, False) for each in Combination), (Combination.PAPER, True)],
)
@pytest.mark.parametrize(("kind", "eye"), [("dome", None), ("pair", StrayLight(60))])
def test_the_quick_mask_is_the_mask(
    kind: str, eye: StrayLight | None, combination: Combination, saliency: bool
) -> None:
    settings = Prediction(0.05, combination, saliency, eye=eye)
    if kind == "pair":
        light = pair(0.05 + spot(0.4), np.roll(30 * spot(0.3), 16, axis=1))
        posed = pose(light, stereo())
    else:
        scene = dome()
        posed = pose(fulldome(0.01 + 8 * np.roll(spot(0.7, rows=64), 9, axis=0), scene), scene)
    full, quick = predict(posed, posed.subtractive, settings), triage(posed, settings).subtracted
    assert full.mask.any()
    assert np.mean(full.mask != quick.mask) < 0.005
    assert quick.share == pytest.approx(full.share, rel=0.02)


# Small things.


@pytest.mark.parametrize("combination", Combination)
@pytest.mark.parametrize("size", [2, 17])
def test_small_domes(size: int, combination: Combination) -> None:
    """Seen as large as they are: under a pixel per degree."""
    scene = load_dome("dome_imax")
    light = fulldome(13 * np.random.default_rng(size).random((size, size)) ** 4, scene, size)
    found = triage(pose(light, scene), Prediction(combination=combination))
    assert np.isfinite(found.untouched.masking).all()
    assert found.untouched.mask.shape == (1, size, size)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"threshold": 1.0}, "threshold"),
        ({"threshold": -0.1}, "threshold"),
        ({"threshold": np.nan}, "threshold"),
        ({"area": 0.0}, "area"),
        ({"negligible": -1.0}, "negligible"),
    ],
)
def test_settings_that_mean_nothing(settings: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Prediction(**settings)


# Regions.


def rectangles(mask: np.ndarray, margin: int = 0) -> list[tuple[int, int, int, int]]:
    return [(r.start, r.stop, c.start, c.stop) for r, c in regions(mask, margin)]


def test_regions_are_bounding_boxes() -> None:
    mask = np.zeros((20, 30), bool)
    mask[3:5, 4] = mask[5, 5] = True  # joined at a corner
    mask[15, 20:29] = True
    assert rectangles(mask) == [(3, 6, 4, 6), (15, 16, 20, 29)]
    assert rectangles(mask, 2) == [(1, 8, 2, 8), (13, 18, 18, 30)]
    assert regions(np.zeros((4, 5), bool), 3) == []


def test_eyes_share_their_regions() -> None:
    mask = np.zeros((2, 12, 20), bool)
    mask[0, 2, 3] = mask[1, 2, 4] = mask[1, 9, 17] = True
    assert rectangles(mask) == [(2, 3, 3, 5), (9, 10, 17, 18)]


@pytest.mark.parametrize("margin", [0, 1, 4])
@pytest.mark.parametrize("seed", range(4))
def test_regions_hold_all_and_are_disjoint(seed: int, margin: int) -> None:
    mask = np.random.default_rng(seed).random((40, 60)) > 0.985
    times = np.zeros(mask.shape, int)
    for rows, cols in regions(mask, margin):
        times[rows, cols] += 1
    assert times.max() == 1
    for row, col in np.argwhere(mask):
        around = times[
            max(0, row - margin) : row + margin + 1, max(0, col - margin) : col + margin + 1
        ]
        assert around.all()


def test_a_seat_counts_alone() -> None:
    """Of several seats, the first."""
    paper = load_stereo("stereo_polarised_paper")
    light = pair(0.0, 40 * spot(0.3))

    def tvi(*names: str) -> np.ndarray:
        return predict(pose(light, paper.seen_from(*names))).tvi

    np.testing.assert_allclose(tvi("left", "sweet spot"), tvi("left"), rtol=1e-5)
    assert (tvi("left")[0] > 1.05 * tvi("sweet spot")[0])[24, 32]


@pytest.mark.parametrize("combination", Combination)
def test_a_texture_masks_what_is_like_it(combination: Combination) -> None:
    """At one mean luminance, so that it is not TVI that differs."""
    scene = stereo(0.1)
    _, across = places()
    wave = np.cos(2 * np.pi * 2 * across)
    window = spot(1.0)
    ghost = 20 * (1 + wave) * window
    left = {"plain": 10.0, "like it": 10 + 9 * wave, "across": (10 + 9 * wave[:, :1].T)}
    left["across"] = 10 + 9 * np.cos(2 * np.pi * 2 * places()[0])
    settings = Prediction(combination=combination, saliency=False)
    found = {
        name: predict(pose(pair(luminance, ghost), scene), settings=settings)
        for name, luminance in left.items()
    }
    middle = (0, slice(18, 30), slice(24, 40))
    v = {name: float(each.masking[middle].mean()) for name, each in found.items()}
    assert v["like it"] < 0.5 * v["plain"]
    assert v["like it"] < 0.7 * v["across"]


def test_exchanged_eyes_have_exchanged_masks() -> None:
    left, right = 20 * spot(0.4), np.roll(30 * spot(0.7), 18, axis=1)
    for settings in (Prediction(), Prediction(combination=Combination.PAPER)):
        one, other = (
            predict(pose(light, stereo()), settings=settings)
            for light in (pair(left, right), pair(right, left))
        )
        np.testing.assert_array_equal(one.mask, other.mask[::-1])
        np.testing.assert_allclose(one.saliency, other.saliency[::-1], atol=1e-5)
        assert (one.mask[0] != one.mask[1]).any()
