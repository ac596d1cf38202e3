"""What belongs to the grade stays: light without a picture, codes without crosstalk, colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from image_files import store
from rigs import Rig

from compensate.figures import Appraisal
from compensate.own import LinearWeighting, own_problem
from compensate.pose import Stage
from compensate.solve import solved
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_master, write_frame
from domesim.frames.video import frame_paths
from domesim.light.planes import planes_of
from domesim.light.rounding import ROUNDING
from domesim.observation.projector import conversion
from domesim.scene import load_scene
from domesim.scene.screening import decoded, encoded

ROWS, COLS = 36, 64
HALF = COLS // 2
STEREO: dict[str, Any] = {
    "name": "rig",
    "screen": {"width_m": 10.0, "height_m": 5.625},
    "projector": {"primaries": "BT.709", "white_cd_m2": 15.42, "black_cd_m2": 0.0095},
    "crosstalk": {"share": 0.018},
    "viewing": {"distance_m": 14.0, "adaptation_cd_m2": 5.0},
}
MIXED = [[0.012, 0.002, 0.0], [0.001, 0.01, -0.0005], [0.0, 0.003, 0.016]]
SYSTEMS: dict[str, dict[str, Any]] = {
    "one share": {},
    "by primary": {"crosstalk": {"share": [0.008, 0.011, 0.02]}},
    "by eye": {"crosstalk": {"to_left": 0.006, "to_right": [0.02, 0.015, 0.011]}},
    "mixed primaries": {"crosstalk": {"to_left": MIXED, "to_right": 0.01}},
    "a seat": {"seats": [{"name": "aisle", "factor": 1.7}]},
    "a lit room": {"ambient": {"luminance_cd_m2": 0.02}},
}


def described(name: str) -> dict[str, Any]:
    """Content of the scene file of a system."""
    return STEREO | SYSTEMS[name]


def matrices(content: dict[str, Any]) -> np.ndarray:
    """(eye, 3, 3) crosstalk, read from a scene's content by this test alone."""
    told = content["crosstalk"]
    each = [told.get(eye, told.get("share")) for eye in ("to_left", "to_right")]
    full = [np.array(c) if np.ndim(c) == 2 else np.diag(np.broadcast_to(c, 3)) for c in each]
    return np.stack(full) * content.get("seats", [{}])[0].get("factor", 1.0)


def dark_of(content: dict[str, Any]) -> float:
    """Light without a picture, of white."""
    lit = content["projector"]["black_cd_m2"] + content.get("ambient", {}).get("luminance_cd_m2", 0)
    return float(lit / content["projector"]["white_cd_m2"])


def model(content: dict[str, Any], x: np.ndarray) -> np.ndarray:
    """Observed = x + C x' + black, by NumPy alone."""
    x = np.asarray(x, np.float64)
    leaks = [np.einsum("ij,rcj->rci", c, x[1 - eye]) for eye, c in enumerate(matrices(content))]
    return x + np.stack(leaks) + dark_of(content)


def pictures() -> np.ndarray:
    """A pair of which the right view's first half is black, and the left has a ramp there."""
    rng = np.random.default_rng(3)
    pair = 0.1 + 0.6 * rng.random((2, ROWS, COLS, 3))
    pair[0, :, :HALF] = np.linspace(0, 1, HALF)[None, :, None] * np.array([1.0, 0.9, 0.7])
    pair[1, :, :HALF] = 0
    pair[0, :8, HALF:] = 0.0
    return pair.astype(np.float32)


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_is_seen_is_the_master_and_its_black(name: str) -> None:
    content, desired = described(name), pictures()
    posed = Stage(load_scene(content)).pose(desired)
    graded = desired + dark_of(content)
    np.testing.assert_allclose(posed.wanted, graded, atol=2e-7)
    lights = {method: solved(posed, method).light for method in ("none", "subtractive")}
    lights["default"] = solved(posed, "perceptual").light
    np.testing.assert_array_equal(lights["none"], desired)
    for light in lights.values():
        np.testing.assert_allclose(posed.seen(light), model(content, light), atol=3e-7)
    seen, free = model(content, lights["subtractive"]), lights["subtractive"] > 0
    np.testing.assert_allclose(seen[free], graded[free], atol=1e-6)
    assert 0.3 < free.mean() < 0.8
    assert (seen[~free] > graded[~free] - 1e-6).all()
    untouched = model(content, desired) - graded
    assert np.abs(untouched[free]).max() > 5e-3


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_papers_equation_takes_black_out(name: str) -> None:
    content, desired = described(name), pictures()
    scene = load_scene(content).with_grade("taken-out", "taken-out")
    posed = Stage(scene).pose(desired)
    light = solved(posed, "subtractive").light
    np.testing.assert_array_equal(posed.wanted, desired)
    free = light > 0
    np.testing.assert_allclose(model(content, light)[free], desired[free], atol=1e-6)


def test_steps_of_shadows_stay_where_there_is_hardly_crosstalk() -> None:
    steps = np.repeat(np.array([0, 2, 4, 6, 8, 10], np.float32) * 1e-4, 4)
    desired = np.broadcast_to(steps[None, None, :, None], (2, 6, 24, 3)).copy()
    content = STEREO | {"crosstalk": {"share": 1e-6}}
    light = solved(Stage(load_scene(content)).pose(desired), "perceptual").light
    np.testing.assert_allclose(light, desired, atol=1e-8)
    lost = load_scene(content).with_grade("taken-out")
    assert solved(Stage(lost).pose(desired), "perceptual").light[0, 0, :12].max() == 0


def test_black_and_ambient_light_are_chosen_apart() -> None:
    content = described("a lit room")
    white, projector = 15.42, 0.0095
    kept = {choice: load_scene(content, grade={"ambient": choice}).kept for choice in CHOICES}
    np.testing.assert_allclose(kept["kept"], (projector + 0.02) / white)
    np.testing.assert_allclose(kept["taken-out"], projector / white)
    scene = load_scene(content, grade={"black": "taken-out"})
    np.testing.assert_allclose(scene.kept, 0.02 / white)
    assert scene.graded == (
        "black of 0.0095 cd/m² is pollution and is taken out (--black taken-out), ambient light of "
        "0.02 cd/m² is part of the grade and stays (--ambient kept)"
    )
    with pytest.raises(InputError, match="black is kept or taken-out, got 'left'"):
        scene.with_grade("left")


CHOICES = ("kept", "taken-out")


@pytest.mark.parametrize("scene", ["dome_imax", "dome_stereo_polarised", "cinema_2d"])
@pytest.mark.parametrize("choice", CHOICES)
def test_any_scene_can_choose(scene: str, choice: str) -> None:
    chosen = load_scene(scene).with_grade(choice, choice)
    size = 48
    desired = np.full((chosen.views, size, size, 3), 0.3, np.float32)
    screen = chosen.screen(size, size)
    desired *= screen[..., None]
    posed = Stage(chosen).pose(desired)
    none = posed.observation.observe(np.zeros_like(desired))
    direct = posed.observation.direct(desired)
    wanted = direct + none if choice == "kept" else direct
    np.testing.assert_allclose(posed.wanted[:, screen], wanted[:, screen], atol=1e-6)
    assert none[:, screen].min() > 1e-6
    light = solved(posed, "subtractive").light
    np.testing.assert_allclose(posed.seen(light)[:, screen], wanted[:, screen], atol=3e-5)
    appraisal = Appraisal(posed)
    assert appraisal.loss(light) == pytest.approx(0, abs=1e-4)
    weights = chosen.projector.luminance_weights
    polluted = posed.observation.observe(desired) - posed.wanted
    areas = posed.setting.areas
    mean = np.einsum("rc,vrcp,p->", areas, polluted, weights) / (areas.sum() * chosen.views)
    assert appraisal.pollution == pytest.approx(mean * chosen.projector.white, rel=2e-3)


def test_domes_take_out_and_screens_keep_by_default() -> None:
    defaults = {name: load_scene(name).grade for name in ("dome_imax", "cinema_2d", "stereo_room")}
    assert vars(defaults["dome_imax"]) == {
        "black": "taken-out",
        "ambient": "taken-out",
        "gamut": "clipped",
    }
    assert set(vars(defaults["cinema_2d"]).values()) == {"kept"}
    assert defaults["stereo_room"] == defaults["cinema_2d"]


def test_black_that_is_said_to_be_subtracted_and_is_not(tmp_path: Path) -> None:
    rows = ["projector,filter,channel,level,X,Y,Z"]
    rows += [",".join(map(str, row)) for row in Rig(ramps=False).rows()]
    (tmp_path / "rig.csv").write_text("\n".join(rows))
    content = {key: STEREO[key] for key in ("screen", "viewing")}
    readings = {"readings": str(tmp_path / "rig.csv")}
    content |= {"name": "measured", "projector": {}, "crosstalk": readings}
    kept = load_scene(content)
    assert kept.kept.min() > 1e-4
    assert load_scene(content, grade={"black": "taken-out"}).kept.max() == 0
    with pytest.raises(InputError, match=r"black is in these readings.*\[grade\] black"):
        load_scene(content, crosstalk={**readings, "black": "subtracted"})


# Codes


def codes(bits: int, seed: int = 0) -> np.ndarray:
    """(view, row, col, 3) of which the right view's first half is black, and the left has ramps."""
    largest = (1 << bits) - 1
    pair = np.random.default_rng(seed).integers(largest // 2, largest, (2, ROWS, COLS, 3))
    ramp = np.rint(np.linspace(0, largest, HALF * ROWS)).reshape(ROWS, HALF)
    pair[0, :, :HALF] = ramp[..., None]
    pair[1, :, :HALF] = 0
    return pair / largest


SRGB = ColourTag("srgb", "BT.709", "test")
LINEAR = ColourTag("linear", "BT.709", "test")


def pair_of(folder: Path, suffix: str, bits: int) -> tuple[Any, ...]:
    """The arguments that name a pair of files."""
    files = [folder / f"{eye}.0001{suffix}" for eye in "lr"]
    floating = suffix == ".exr"
    for path, pixels in zip(files, codes(16 if floating else bits), strict=True):
        kind = np.float16 if bits == 16 else np.float32
        kept = pixels.astype(kind).astype(np.float32) if floating else pixels.astype(np.float32)
        colour = LINEAR if floating else SRGB
        write_frame(Frame(kept, path, colour, bits, floating=floating), path)
    return "--left", files[0], "--right", files[1], "--encoding", "linear" if floating else "srgb"


def scene_file(folder: Path, **changes: str) -> Path:
    projector = {"primaries": "BT.709"} | changes
    path = folder / "rig.toml"
    path.write_text(
        f"""name = "rig"
[screen]
width_m = 10.0
height_m = 5.625
[projector]
primaries = "{projector["primaries"]}"
white_cd_m2 = 15.42
black_cd_m2 = 0.0095
[crosstalk]
share = 0.018
[viewing]
distance_m = 14.0
adaptation_cd_m2 = 5.0
"""
    )
    return path


FORMATS = {".dpx": (10,), ".exr": (16, 32), ".tif": (16,), ".png": (8,)}


@pytest.mark.parametrize(
    ("suffix", "bits"), [(suffix, bits) for suffix, each in FORMATS.items() for bits in each]
)
@pytest.mark.parametrize("dither", ["none", "tpdf"])
def test_codes_without_crosstalk_stay(
    run: Run, tmp_path: Path, out: Path, suffix: str, bits: int, dither: str
) -> None:
    arguments = pair_of(tmp_path, suffix, bits)
    how = ("--scene", scene_file(tmp_path), "--method", "subtractive", "--dither", dither)
    assert run("compensate", *arguments, *how, "--out", out).code == 0
    old = read_master([arguments[1], arguments[3]]).pixels
    new = read_master([out / path.name for path in (arguments[1], arguments[3])]).pixels
    assert (old[0, :, HALF:] != new[0, :, HALF:]).mean() > 0.5
    if dither == "none" or suffix == ".exr":
        np.testing.assert_array_equal(new[0, :, :HALF], old[0, :, :HALF])
        return
    off = (new[0, :, :HALF] - old[0, :, :HALF]) * ((1 << bits) - 1)
    assert abs(off.mean()) < 0.02


def film_of(path: Path, codec: str, pixels: str, views: np.ndarray) -> Path:
    import av  # noqa: PLC0415 - of an extra

    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=24)
        stream.width, stream.height, stream.pix_fmt = views.shape[2], views.shape[1], pixels
        for number, view in enumerate(views):
            frame = av.VideoFrame.from_ndarray(np.rint(view * 65535).astype(np.uint16), "rgb48le")
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path


def test_films_without_crosstalk_are_those_that_are_left_alone(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("av")
    ramp = np.broadcast_to(np.linspace(0, 1, COLS)[None, None, :, None], (2, ROWS, COLS, 3))
    films = [
        film_of(tmp_path / f"{eye}.mov", "prores_ks", "yuv444p10le", view)
        for eye, view in (("l", ramp), ("r", 0 * ramp))
    ]
    found = {}
    for method in ("none", "subtractive"):
        folder = tmp_path / method
        result = run(
            "compensate", "--left", films[0], "--right", films[1], "--encoding", "srgb",
            "--scene", scene_file(tmp_path), "--method", method, "--format", "mov",
            "--dither", "none", "--as-given", "--workers", 0, "--out", folder, "--json",
        )  # fmt: skip
        film = next(Path(each) for each in result.figures()["films"] if "l" in Path(each).stem)
        found[method] = [read_master([path]).pixels for path in frame_paths(film)]
    for one, other in zip(*found.values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(found["none"]) == 2


# Colours


def p3_pair(folder: Path) -> tuple[Any, ...]:
    """A pair in P3 of saturated colours, black on the right's first half."""
    rng = np.random.default_rng(8)
    views = rng.random((2, ROWS, COLS, 3)).astype(np.float32) ** 2
    views[:, ::3, :, 0] *= 0.02
    views[0, :, HALF:] = 0.2 + 0.7 * views[0, :, HALF:]
    views[1, :, :HALF] = 0
    files = [store(folder / f"{eye}.exr", view) for eye, view in zip("lr", views, strict=True)]
    return "--left", files[0], "--right", files[1], "--encoding", "linear:p3-d65"


def test_a_wider_master_keeps_its_colours(run: Run, tmp_path: Path) -> None:
    arguments, told = p3_pair(tmp_path), {}
    for name, primaries, gamut in (
        ("kept", "BT.709", ()),
        ("clipped", "BT.709", ("--gamut", "clipped")),
        ("own", "P3-D65", ()),
    ):
        scene = scene_file(tmp_path, primaries=primaries)
        how = ("--scene", scene, "--method", "subtractive", "--out", tmp_path / name, *gamut)
        told[name] = run("compensate", *arguments, *how, "--json").figures()["frames"][0]
    files = [path.name for path in (arguments[1], arguments[3])]
    old = read_master([arguments[1], arguments[3]]).pixels
    new = {name: read_master([tmp_path / name / each for each in files]).pixels for name in told}
    alone = old[0, :, :HALF]
    np.testing.assert_array_equal(new["kept"][0, :, :HALF], alone)
    assert np.abs(new["clipped"][0, :, :HALF] - alone).max() > 0.05
    assert np.abs(new["kept"] - old).max() < 0.03  # by no more than ghosts are, P3 or not
    assert told["kept"]["out_of_range"] == told["clipped"]["out_of_range"] > 0.2
    assert told["own"]["out_of_range"] == 0
    to_rig = conversion("P3-D65", "BT.709").T

    def ghosts(codes: np.ndarray) -> np.ndarray:
        """What the narrow rig shows beside what it shows of the master alone."""
        shown, alone = (np.clip(each.astype(float) @ to_rig, 0, 1) for each in (codes, old))
        return model(described("one share"), shown) - alone - dark_of(STEREO)

    within = ((old @ to_rig > 1e-3) & (old @ to_rig < 1)).all(axis=-1)
    assert within[:, :, HALF:].mean() > 0.2
    left = {name: np.abs(ghosts(pixels))[within].max() for name, pixels in new.items()}
    wide = np.abs(model(described("one share"), new["own"]) - old - dark_of(STEREO))
    own = wide[(new["own"] > 0).all(axis=-1) & within].max()
    assert np.abs(ghosts(old))[within].max() > 0.01
    assert abs(left["kept"] - left["clipped"]) < 1e-3
    free = within & (new["kept"] > 0).all(axis=-1) & (new["clipped"] @ to_rig > 1e-4).all(axis=-1)
    assert np.abs(ghosts(new["kept"]))[free].max() < own + 1e-3


def test_highlights_are_told_and_stay(run: Run, tmp_path: Path, out: Path) -> None:
    views = np.full((2, ROWS, COLS, 3), 0.4, np.float32)
    views[1, :, :HALF] = 0
    views[0, 3, 5] = views[0, 3, HALF + 5] = 4.0
    files = [store(tmp_path / f"{eye}.exr", view) for eye, view in zip("lr", views, strict=True)]
    arguments = ("--left", files[0], "--right", files[1], "--encoding", "linear")
    how = ("--scene", scene_file(tmp_path), "--method", "subtractive", "--out", out)
    result = run("compensate", *arguments, *how)
    assert result.code == 0
    assert f"out of the projector's range: {200 / (2 * ROWS * COLS):.2g}% of the screen" in (
        result.out + result.err
    )
    found = read_master([out / "l.exr", out / "r.exr"]).pixels[0, 3]
    assert found[5].tolist() == [4.0] * 3
    # The other eye is shown 0.4 less a ghost of white, and leaks that
    leak = 0.018 * (0.4 - 0.018 * (1 - 0.018 * 0.4))
    np.testing.assert_allclose(found[HALF + 5], 4 - leak, atol=1e-4)


# What is said


@pytest.mark.parametrize(
    ("choice", "words"),
    [("kept", "is part of the grade and stays"), ("taken-out", "is pollution and is taken out")],
)
def test_every_report_says_which(run: Run, tmp_path: Path, choice: str, words: str) -> None:
    arguments = pair_of(tmp_path, ".png", 8)
    told = f"black of 0.0095 cd/m² {words} (--black {choice})"
    chosen = () if choice == "kept" else ("--black", choice)
    numbered = [str(each).replace("0001", "####") for each in arguments]
    scene, folder = scene_file(tmp_path), tmp_path / "seen"
    how = (*numbered, "--as-given", "--scene", scene, *chosen, "--workers", 0, "--out", folder)
    assert f"rig: {told}" in run("observe", *how).out
    assert f"<p>rig: {told}.</p>" in (folder / "job" / "report.html").read_text()
    found = run("observe", *how, "--json").figures()
    assert found["black"] == choice
    (frame,) = found["frames"]
    polluted = frame["pollution_cd_m2"]
    assert polluted == pytest.approx(ghosts_of(arguments) + (0.0095 if chosen else 0), rel=1e-3)
    assert told in run("report-card", scene, *arguments, *chosen).out


def ghosts_of(arguments: tuple[Any, ...]) -> float:
    """Mean luminance of the ghosts of a pair, cd/m²."""
    scene = load_scene(STEREO)
    light = decoded(read_master([arguments[1], arguments[3]], colour=SRGB), scene)
    return float(0.018 * 15.42 * (light @ scene.projector.luminance_weights).mean())


def test_a_weighting_of_ones_own_keeps_black_too() -> None:
    scene, desired = load_scene(STEREO), pictures()
    plain = LinearWeighting(desired.shape, lambda light: light, lambda light: light)
    for graded in (scene, scene.with_grade("taken-out")):
        problem = own_problem(desired, graded, None, plain)
        np.testing.assert_allclose(problem.desired, desired + graded.kept[0, 0], atol=1e-7)
    observation = scene.observation(ROWS, COLS)
    np.testing.assert_array_equal(own_problem(desired, scene, observation).desired, desired)
    np.testing.assert_array_equal(
        Stage(scene, observation=observation).pose(desired).wanted, desired
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_encoding_leaves_the_light_that_it_is_given(tmp_path: Path, kind: type) -> None:
    """A linear master in the scene's own primaries: its codes are light, perhaps in one array."""
    views = np.random.default_rng(0).random((2, ROWS, COLS, 3), np.float32)
    files = [store(tmp_path / f"{eye}.exr", view) for eye, view in zip("LR", views, strict=True)]
    master = read_master(files)
    scene = load_scene("stereo_polarised_paper")
    own = decoded(master, scene)
    # Within rounding of the master's, but not the same: codes are the master's, light stays
    light = (own + np.float32(0.5 * ROUNDING)).astype(kind)
    light[0, :4] += 0.01
    kept = light.copy()
    screen = scene.screen(ROWS, COLS)
    result, _ = encoded(master, light, scene, screen, before=planes_of(own))
    assert (light == kept).all()
    assert (result.pixels[1] == master.pixels[1]).all()
    assert (result.pixels[0, 4:] == master.pixels[0, 4:]).all()
    assert (result.pixels[0, :4] != master.pixels[0, :4]).all()
