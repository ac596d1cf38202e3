"""Photographs through the eyewear: known maps are found again, the rest is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from image_files import store
from rigs import LEFT, RIGHT, TO_LEFT, Rig, refused
from studio import CAMERA, NOISE, SIZE, Studio, random_maps, save, store_all

from domesim.errors import InputError
from domesim.measure.crosstalk_photographs import crosstalk_maps
from domesim.measure.photographs import Corners, by_edges, read_photographs
from domesim.measure.smoothing import smoothed
from domesim.readings.meter import read_readings
from domesim.readings.pair import measured_pair
from domesim.scene import load_stereo
from domesim.scene.crosstalk_maps import load_maps
from testing.screens import SMALL, photographed, screen
from testing.statistics import assert_unbiased, calibration

CELLS, FINER = (5, 7), (9, 11)
ASPECT = 77 / 45


def truth(studio, cells):
    """(view, row, col) share of white that leaks, over cells; by the camera's luminance."""
    v, h = (n // c for n, c in zip(SIZE, cells, strict=True))
    means = studio.maps.reshape(2, cells[0], v, cells[1], h).mean(axis=(2, 4))
    weights = np.array([0.2126, 0.7152, 0.0722])
    white = [
        (weights @ CAMERA @ own @ leak.sum(1)) / (weights @ CAMERA @ own.sum(1))
        for own, leak in zip((LEFT, RIGHT), studio.matrices, strict=True)
    ]
    return means * np.array(white)[:, None, None]


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """(case, view, row, col) found, its error, and the truth."""
    folder = tmp_path_factory.mktemp("photographs")
    rows = []
    for seed in range(100):
        studio = Studio(random_maps(np.random.default_rng(seed)), NOISE)
        path = store_all(folder, studio, seed=1000 + seed)
        maps = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
        found = np.stack([each.system * each.share for each in maps])
        error = np.stack([each.system * each.share_error for each in maps])
        whole = [(each.system, each.system_error) for each in maps]
        light = studio.falloff.reshape(5, 9, 7, 11).mean(axis=(1, 3))
        rows.append((found, error, truth(studio, CELLS), whole, light))
    return rows


def test_maps_are_found_again(cases):
    found, error, wanted = (np.stack([case[i] for case in cases]) for i in range(3))
    off = np.abs(found / wanted - 1)
    assert np.sqrt(np.mean(off**2)) < 0.01
    assert np.quantile(off, 0.9) < 0.02
    whole = [
        (system / np.average(case[2][v], weights=case[4]) - 1)
        for case in cases
        for v, (system, _) in enumerate(case[3])
    ]
    assert np.abs(whole).max() < 0.01
    covered = np.abs(found - wanted) < 1.96 * error
    assert 0.90 < covered.mean() < 0.98
    by_case = covered.mean(axis=(1, 2, 3))
    assert np.mean(by_case > 0.7) > 0.95


def test_a_camera_without_noise_sees_the_truth(tmp_path):
    studio = Studio(random_maps(np.random.default_rng(3)))
    maps = crosstalk_maps(read_photographs(store_all(tmp_path, studio)), FINER, ASPECT)
    found = np.stack([each.system * each.share for each in maps])
    assert found == pytest.approx(truth(studio, FINER), rel=4e-3)


def test_vignetting_cancels(tmp_path):
    maps = random_maps(np.random.default_rng(4))
    found = []
    for vignetting in (0.1, 0.8):
        path = store_all(tmp_path, Studio(maps, vignetting=vignetting))
        left, _ = crosstalk_maps(read_photographs(path), FINER, ASPECT)
        found.append(left.system * left.share)
    assert found[0] == pytest.approx(found[1], rel=8e-3)


def test_flat_systems_are_unbiased_and_their_errors_honest(tmp_path):
    """Where crosstalk is the same everywhere, the whole screen's figure is exact."""
    flat, z = np.ones((2, *SIZE)), []
    for seed in range(60):
        studio = Studio(flat, NOISE)
        path = store_all(tmp_path, studio, seed=seed)
        maps = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
        wanted = truth(studio, CELLS)[:, 0, 0]
        z += [(m.system - w) / m.system_error for m, w in zip(maps, wanted, strict=True)]
    assert_unbiased(z, 1.0, 0.0)
    assert calibration(z) > 1e-3


def test_readings_and_photographs_agree(tmp_path):
    """The same rig, by a colorimeter and by a camera of other colours."""
    (tmp_path / "rig.csv").write_text(Rig(ramps=False).csv())
    pair = measured_pair(read_readings(tmp_path / "rig.csv"))
    studio = Studio(np.ones((2, 90, 154)), NOISE)
    path = store_all(tmp_path, studio, primaries=True)
    maps = crosstalk_maps(read_photographs(path), CELLS, ASPECT, allow_negative=True)
    for by_meter, by_camera in zip(pair.crosstalk, maps, strict=True):
        off = (by_camera.matrix - by_meter.matrix) / by_camera.matrix_error
        assert np.abs(off).max() < 4
        assert np.sqrt(np.mean(off**2)) < 1.6
        assert (np.diag(by_camera.matrix_error) / np.diag(by_meter.matrix)).max() < 0.02


def test_errors_of_matrices_are_calibrated(tmp_path):
    z = []
    for seed in range(40):
        studio = Studio(np.ones((2, *SIZE)), NOISE)
        path = store_all(tmp_path, studio, seed=seed, primaries=True)
        maps = crosstalk_maps(read_photographs(path), CELLS, ASPECT, allow_negative=True)
        for each, matrix in zip(maps, studio.matrices, strict=True):
            # Small negatives are set to 0: only entries that are far above it
            far = matrix > 5 * each.matrix_error
            z += ((each.matrix - matrix) / each.matrix_error)[far].tolist()
    z = np.array(z)
    assert 0.90 < np.mean(np.abs(z) < 1.96) < 0.98
    assert abs(z.mean()) < 4 / np.sqrt(len(z))


def test_a_screen_that_is_a_part_of_the_photograph(tmp_path):
    """Seen askew, with a bright wall around: only what the corners hold counts."""
    rng = np.random.default_rng(0)
    rows, cols = 200, 260
    corners = [[30, 20], [235, 42], [220, 170], [24, 185]]
    listed = store_all(tmp_path, Studio(np.ones((2, rows, cols))), extra=f"corners = {corners}")
    place = read_photographs(listed).place
    x, y = place[..., 0], place[..., 1]
    assert place[20, 30] == pytest.approx([0, 0], abs=0.01)
    assert place[170, 220] == pytest.approx([1, 1], abs=0.01)
    wanted = np.where((x >= 0) & (x < 1) & (y >= 0) & (y < 1), 1 + x + 0.3 * y, 20)
    studio = Studio(np.stack([wanted, wanted]), (1e-4, 0))
    path = store_all(tmp_path, studio, extra=f"corners = {corners}", seed=int(rng.integers(9)))
    left, _ = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
    v, u = ((np.arange(n) + 0.5) / n for n in CELLS)
    expected = 1 + u[None, :] + 0.3 * v[:, None]
    ratio = left.share / expected
    assert ratio / ratio.mean() == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("wrong", [0.5, 1.0])
def test_corners_are_found_by_the_edges_of_the_picture(wrong):
    rng = np.random.default_rng(8)
    glasses, corners, _ = photographed(rng, SMALL)
    read = Corners(corners.at + wrong * rng.standard_normal((4, 2)), np.eye(8), "read off")
    found = by_edges(glasses, read)
    assert found.origin == "by the picture's edges"
    assert np.abs(found.at - corners.at).max() < 0.1
    assert 0.05 <= found.error < 0.1


def test_maps_are_as_unsure_as_their_corners():
    screens = [screen(seed, 1.0, SMALL) for seed in range(2)]
    exact, stated = (np.mean([one.held[way] for one in screens]) for way in ("exact", "stated"))
    assert exact < 0.75
    assert 0.85 < stated < 0.99


def test_an_error_of_corners_may_be_stated(tmp_path):
    rng = np.random.default_rng(11)
    studio = Studio(random_maps(rng), NOISE)
    found = []
    for number, error in enumerate((0.0, 2.0)):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = store_all(folder, studio, extra=f"corners_error = {error}")
        photographs = read_photographs(path)
        assert photographs.corners.error == pytest.approx(error)
        found.append(crosstalk_maps(photographs, CELLS, ASPECT))
    for sure, unsure in zip(*found, strict=True):
        assert (unsure.share_error > sure.share_error).all()
        assert unsure.share == pytest.approx(sure.share)
        assert unsure.system_error > sure.system_error


def test_repeated_photographs_are_averaged(tmp_path):
    studio = Studio(np.ones((2, *SIZE)), NOISE)
    path = store_all(tmp_path, studio)
    one, _ = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
    again = tmp_path / "again"
    again.mkdir()
    store_all(again, studio, seed=7)
    text = path.read_text()
    for name in ("left-right-W.exr", "left-black.exr", "left-left-W.exr"):
        text = text.replace(f'"{name}"', f'["{name}", "again/{name}"]')
    path.write_text(text)
    two, _ = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
    assert two.system_error == pytest.approx(one.system_error / np.sqrt(2), rel=0.1)


def test_noise_below_black_is_no_damage(tmp_path):
    """A raw converter subtracts the sensor's black level; were it clipped, ghosts would grow."""
    studio = Studio(np.ones((2, *SIZE)), NOISE, dark=(0.0, 0.0, 0.0))
    path = store_all(tmp_path, studio)
    left, _ = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
    assert (
        abs(left.system / truth(studio, CELLS)[0, 0, 0] - 1) < 4 * left.system_error / left.system
    )
    spoilt = np.full((*SIZE, 3), 0.1, np.float32)
    spoilt[4, 5, 1] = np.nan
    save(tmp_path / "left-black.exr", spoilt)
    with pytest.raises(InputError, match=r"left-black\.exr: wanted finite samples, got 1 NaN"):
        read_photographs(path)


def test_smoothing_keeps_what_is_there():
    rng = np.random.default_rng(1)
    v, u = ((np.arange(n) + 0.5) / n for n in (9, 15))
    shape = 1 + np.sin(3 * u)[None, :] * np.cos(2 * v)[:, None]
    error = np.where(u < 0.5, 0.02, 0.1)[None, :] * np.ones((9, 1))
    mean, covariance = smoothed(shape + error * rng.standard_normal(shape.shape), error, 15 / 9)
    sure = np.sqrt(np.diag(covariance)).reshape(shape.shape)
    assert np.sqrt(np.mean((mean - shape) ** 2)) < 0.3 * np.sqrt(np.mean(error**2))
    assert (sure < error).all()
    assert sure[:, 12].mean() > 2 * sure[:, 2].mean()
    flat, _ = smoothed(1 + error * rng.standard_normal(shape.shape), error, 15 / 9)
    assert np.ptp(flat) < 0.02


# The command


@pytest.mark.parametrize("primaries", [False, True])
def test_a_scene_and_its_map(run, tmp_path, primaries):
    size = (90, 150)
    studio = Studio(random_maps(np.random.default_rng(5), size), NOISE)
    path = store_all(tmp_path, studio, primaries=primaries)
    out = tmp_path / "out" / "mine.toml"
    options = ("--width", "12", "--height", "7.2", "--distance", "15", "--adaptation", "5")
    code, told, err = run("measure", "crosstalk", path, "--out", out, *options, "--allow-negative")
    assert (code, err) == (0, "")
    assert "crosstalk to the right eye: system 1." in told
    assert f"--transport {out.with_suffix('.npz')}" in told
    scene, maps = load_stereo(out), load_maps(out.with_suffix(".npz"))
    assert maps.share.shape == (1, 2, 9, 15)
    mapped = scene.with_maps(maps)
    assert "measured: photographs.toml" in mapped.facts()["Crosstalk"]
    white = mapped.observation(*size).observe(
        np.stack([np.zeros((*size, 3)), np.ones((*size, 3))]).astype(np.float32)
    )[0]
    wanted = studio.maps[0][..., None] * TO_LEFT.sum(axis=1)
    if primaries:
        assert np.abs(np.median(white / wanted, axis=(0, 1)) - 1).max() < 0.02
    inner = (slice(5, -5), slice(5, -5))
    share = white[inner].mean(-1) / wanted[inner].mean(-1)
    assert share.mean() == pytest.approx(1, abs=0.02 if primaries else 0.15)
    assert share.std() < 0.02


def test_white_that_no_camera_knows_is_assumed_and_said(tmp_path, run):
    """The sheet leaves it a comment: whoever has no meter has nothing to write."""
    studio = Studio(random_maps(np.random.default_rng(7)), NOISE)
    path = store_all(tmp_path, studio, projector=False)
    code, out, _ = run("measure", "crosstalk", path, "--out", tmp_path / "m.toml")
    assert code == 0
    assert "Assumed, as projector.white_cd_m2 was not given: 15.4 cd/m²" in out
    assert load_stereo(tmp_path / "m.toml").projector.white == 15.4
    assert (
        '"projector.white_cd_m2, projector.black_cd_m2" = "assumed"'
        in (tmp_path / "m.toml").read_text()
    )


def test_figures_and_a_map_of_another_scene(run, tmp_path):
    path = store_all(tmp_path, Studio(random_maps(np.random.default_rng(6), (90, 150)), NOISE))
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    code, out, _ = run("measure", "crosstalk", path, "--out", one, "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["assumed"] == ["primaries", "width", "height", "distance", "adaptation"]
    left = figures["eyes"]["left"]
    assert np.shape(left["share"]) == np.shape(left["share_standard_error"]) == (9, 15)
    run("measure", "crosstalk", path, "--out", two, "--width", "9")
    for name in ("l", "r"):
        save(tmp_path / f"{name}.exr", np.full((8, 16, 3), 0.25 + 0.1 * (name == "l"), np.float32))
    views = ("--left", tmp_path / "l.exr", "--right", tmp_path / "r.exr")
    seen = tmp_path / "seen"
    options = (*views, "--scene", one, "--transport", one.with_suffix(".npz"), "--out", seen)
    assert run("observe", *options)[0] == 0
    other = two.with_suffix(".npz")
    lines = refused(
        run("observe", *views, "--scene", one, "--transport", other, "--out", seen),
        "are of 'two'", "measure again",
    )  # fmt: skip
    assert len(lines) == 1


# Refusals


def spoil_swapped(folder, text):
    return text.replace('left = "left-left-W.exr"', 'left = "x"').replace(
        'right = "left-right-W.exr"', 'right = "left-left-W.exr"'
    ).replace('left = "x"', 'left = "left-right-W.exr"')  # fmt: skip


def spoil_size(folder, text):
    save(folder / "right-left-W.exr", np.full((44, 77, 3), 0.1, np.float32))
    return text


def spoil_saturated(folder, text):
    bright = np.full((*SIZE, 3), 0.7, np.float32)
    bright[3, 5:50] = 1.0
    save(folder / "left-left-W.exr", bright)
    return text


def spoil_dark(folder, text):
    save(folder / "left-left-W.exr", np.full((*SIZE, 3), 0.001, np.float32))
    return text


def spoil_below_black(folder, text):
    save(folder / "right-left-W.exr", np.full((*SIZE, 3), 0.001, np.float32))
    return text


def spoil_srgb(folder, text):
    return spoil_depth(folder, text, np.uint16)


def spoil_depth(folder, text, kind=np.uint8):
    store(folder / "photo.png", np.full((*SIZE, 3), 100, kind))
    spoiled = text.replace("left-black.exr", "photo.png")
    if kind == np.uint16:
        return spoiled
    return spoiled.replace("[photographs]", '[photographs]\nencoding = "linear"')


def replaced(old, new):
    def spoil(folder, text):
        assert old in text
        return text.replace(old, new, 1)

    return spoil


RGB = ", ".join(f'{name} = "left-left-W.exr"' for name in "RGB")
REFUSED = {
    "eyes exchanged": (spoil_swapped, "were the glasses or the projectors exchanged?"),
    "another size": (spoil_size, "must be as large as left-black.exr, 77 x 45, got 77 x 44"),
    "saturated": (spoil_saturated, "left-left-W.exr: 1.3% of the screen's pixels are saturated"),
    "no light": (spoil_dark, "must be brighter than black all over the screen"),
    "black brighter": (spoil_below_black, "must be brighter than black, got -"),
    "not linear": (spoil_srgb, 'say encoding = "linear"'),
    "a picture of 8 bits": (spoil_depth, "of 10 bits or more, got 8"),
    "no such file": (replaced("left-black.exr", "none.exr"), "none.exr"),
    "a dark white": (replaced("= 15.4", "= -1.0"), "projector.white_cd_m2: input should be"),
    "an unknown key": (replaced("black =", "blakc ="), "photographs.left"),
    "no right glass": (
        replaced("[photographs.right]", "[other]"),
        "photographs.right: field required",
    ),
    "corners turned": (
        replaced("[photographs]", "[photographs]\ncorners = [[0,0],[0,40],[70,40],[70,0]]"),
        "corners must be [col, row] of the top left",
    ),
    "corners elsewhere": (
        replaced("[photographs]", "[photographs]\ncorners = [[900,0],[990,0],[990,90],[900,90]]"),
        "corners must hold the screen, got 0 pixels",
    ),
    "corners surer than sure": (
        replaced("[photographs]", "[photographs]\ncorners_error = -1.0"),
        "photographs.corners_error: input should be greater than or equal to 0",
    ),
    "corners too near": (
        replaced("[photographs]", "[photographs]\ncorners = [[10,10],[22,10],[22,20],[10,20]]"),
        "at least 4 pixels in each of 15 x 9 cells",
    ),
    "half of the primaries": (
        replaced('left = "left-left-W.exr"', 'left = { W = "left-left-W.exr", R = "a" }'),
        "all of R, G and B, or none",
    ),
    "other colours": (
        replaced('left = "left-left-W.exr"', f"left = {{ {RGB} }}"),
        "the same colours of both projectors",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("spoil", "word"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused(run, tmp_path, spoil, word):
    path = store_all(tmp_path, Studio(np.ones((2, *SIZE)), NOISE))
    path.write_text(spoil(tmp_path, path.read_text()))
    before = {file.name for file in tmp_path.iterdir()}
    lines = refused(run("measure", "crosstalk", path, "--out", tmp_path / "o.toml"), word)
    assert len(lines) == 1
    assert {file.name for file in tmp_path.iterdir()} == before


def test_black_is_in_the_photographs(run, tmp_path):
    path = store_all(tmp_path, Studio(np.ones((2, *SIZE))))
    outcome = run("measure", "crosstalk", path, "--out", tmp_path / "o.toml", "--black", "included")
    assert len(refused(outcome, "photographs have their own of black")) == 1


def test_integers_that_say_nothing_can_be_called_linear(tmp_path):
    studio = Studio(np.ones((2, *SIZE)), NOISE)
    path = store_all(tmp_path, studio)
    rng = np.random.default_rng(0)
    text = path.read_text().replace(".exr", ".tif")
    for file in list(tmp_path.glob("*.exr")):
        through, *shown = file.stem.split("-")
        picture = studio.photograph(rng, *([shown[0], through] if len(shown) > 1 else []))
        codes = np.round(np.clip(picture, 0, 1) * 65535).astype(np.uint16)
        store(file.with_suffix(".tif"), codes)
    path.write_text(text)
    with pytest.raises(InputError, match='say encoding = "linear"'):
        read_photographs(path)
    path.write_text(text.replace("[photographs]", '[photographs]\nencoding = "linear"'))
    left, _ = crosstalk_maps(read_photographs(path), CELLS, ASPECT)
    assert left.system == pytest.approx(truth(studio, CELLS)[0, 0, 0], rel=0.02)
