"""The command predict: what it writes and says, of domes and pairs, and what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run
from stored_masters import store, written

from compensate.plain import PlainRuler
from compensate.pose import Stage
from compensate.prediction import MARKED, Prediction, regions, remaining, triage
from compensate.shows.predicting import Predicting
from compensate.visible import SEEN
from domesim.frames import read_master
from domesim.scene import load_scene
from domesim.scene.choice import SceneChoice

DOME, STEREO = "dome_hemisphere", "stereo_polarised_paper"
ROWS, COLS = 60, 96
KINDS = ("masking", "prediction", "saliency", "tvi")
CHANNELS = ("TVI", "masking", "saliency", "prediction", "mask", "subtracted")


def view(place: int, light: float = 0.9, black: float = 0.0) -> np.ndarray:
    pixels = np.full((ROWS, COLS, 3), black, np.float32)
    pixels[20:44, place : place + 20] = light
    return pixels


def pair(folder: Path, **light: float) -> tuple[object, ...]:
    folder.mkdir(exist_ok=True)
    left = store(folder / "l.exr", view(12, **light), "float")
    return "--left", left, "--right", store(folder / "r.exr", view(60, **light), "float")


def fulldome(path: Path, light: float = 0.5, size: int = 48) -> Path:
    pixels = np.zeros((size, size, 3), np.float32)
    pixels[20:30, 8:40] = light
    return store(path, pixels, "float")


def figures(run: Run, *arguments: object) -> dict[str, object]:
    return run("predict", *arguments, "--json").figures()


def channels(path: Path) -> dict[str, np.ndarray]:
    image = oiio.ImageBuf(str(path))
    assert image.spec().format == oiio.HALF
    assert image.spec().getattribute("compression") == "zip"
    planes = image.get_pixels(oiio.FLOAT)
    return {name: planes[..., k] for k, name in enumerate(image.spec().channelnames)}


def names(stem: str) -> list[str]:
    return sorted([f"{stem}.maps.exr", *(f"{stem}.{kind}.png" for kind in KINDS)])


def test_a_dome(run: Run, tmp_path: Path, out: Path) -> None:
    master = fulldome(tmp_path / "m.exr")
    outcome = run("predict", master, "--scene", DOME, "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert written(out) == names("m")
    found = figures(run, master, "--scene", DOME, "--out", out)
    assert (found["scene"], found["threshold"], found["combination"]) == (DOME, 0.05, "with-veils")
    (frame,) = found["frames"]
    scene = load_scene(DOME)
    posed, _ = Stage(scene).pose_frame(read_master([master]))
    wanted = triage(posed)
    assert frame["input"] == str(master)
    assert frame["output"] == str(out / "m.maps.exr")
    assert sorted(frame["pictures"]) == [str(out / f"m.{kind}.png") for kind in KINDS]
    assert frame["visible"] == wanted.untouched.share > 0.5
    assert frame["visible_by_view"] == [frame["visible"]]
    assert frame["visible_subtracted"] == wanted.subtracted.share
    assert frame["visible_salient"] == wanted.untouched.salient
    assert frame["verdict"] == wanted.verdict.name.lower() == "compensate"
    boxes = regions(wanted.subtracted.mask, round(48 / 180))
    assert frame["regions"] == [[r.start, r.stop, c.start, c.stop] for r, c in boxes]
    assert f"{wanted.untouched.share:.0%} of the screen" in outcome.out
    assert f"{wanted.subtracted.share:.0%} after subtraction: compensation worth" in outcome.out
    ruler = PlainRuler(posed.wanted, scene, posed.screen)
    for name, light in (("master", posed.wanted), ("untouched", posed.seen(posed.desired))):
        faintest = ruler.faintest(ruler.black(light))
        assert frame[f"faintest_star_{name}"] == pytest.approx(faintest._asdict())
        assert faintest.told in outcome.out
    assert "The faintest star falls from" in outcome.out


def test_the_maps_are_read_back(run: Run, tmp_path: Path, out: Path) -> None:
    master = fulldome(tmp_path / "m.exr")
    assert run("predict", master, "--scene", DOME, "--out", out).code == 0
    maps = channels(out / "m.maps.exr")
    assert sorted(maps) == sorted(CHANNELS)
    posed, _ = Stage(load_scene(DOME)).pose_frame(read_master([master]))
    wanted = triage(posed)
    for name in CHANNELS[:4]:
        of = getattr(wanted.untouched, name.lower())[0]
        np.testing.assert_allclose(maps[name], of, rtol=2**-11, atol=2**-25, err_msg=name)
    np.testing.assert_array_equal(maps["mask"], wanted.untouched.mask[0])
    np.testing.assert_array_equal(maps["subtracted"], wanted.subtracted.mask[0])


def test_a_pair(run: Run, tmp_path: Path, out: Path) -> None:
    found = figures(run, *pair(tmp_path / "in"), "--scene", STEREO, "--out", out)
    assert found["seats"] == ["sweet spot"]
    assert written(out) == sorted(names("l") + names("r"))
    (frame,) = found["frames"]
    assert frame["visible"] == pytest.approx(np.mean(frame["visible_by_view"]))
    assert frame["verdict"] == "compensate"
    left, right = (channels(out / f"{eye}.maps.exr") for eye in "lr")
    # the ghost is where the other eye's picture is, and so is saliency
    for maps, place in ((left, 70), (right, 22)):
        assert np.argwhere(maps["mask"])[:, 1].mean() == pytest.approx(place, abs=2)
        assert np.unravel_index(maps["saliency"].argmax(), (ROWS, COLS))[1] == pytest.approx(
            place, abs=9
        )
        # nothing can be subtracted from black
        np.testing.assert_array_equal(maps["mask"], maps["subtracted"])
    assert [maps["mask"].mean() for maps in (left, right)] == pytest.approx(
        frame["visible_by_view"]
    )


def test_pictures_show_the_map_and_the_map_times_the_ghost(
    run: Run, tmp_path: Path, out: Path
) -> None:
    arguments = (*pair(tmp_path / "in"), "--scene", STEREO, "--out", out)
    (frame,) = figures(run, *arguments)["frames"]
    maps = channels(out / "l.maps.exr")
    for kind in KINDS:
        image = oiio.ImageBuf(str(out / f"l.{kind}.png"))
        spec = image.spec()
        assert (spec.width, spec.height, spec.nchannels) == (2 * COLS + 4, ROWS, 1)
        caption = spec.getattribute("ImageDescription")
        assert f"{frame['brightened']} times brighter" in caption
        codes = image.get_pixels(oiio.FLOAT)[..., 0]
        shown = {
            "tvi": np.minimum(maps["TVI"] / 2, 1),
            "masking": 1 - 2.0 ** -maps["masking"],
            "saliency": maps["saliency"],
            "prediction": (maps["mask"] + maps["subtracted"]) / 2,
        }[kind]
        np.testing.assert_allclose(codes[:, :COLS], shown, atol=0.004, err_msg=kind)
        ghost = codes[:, COLS + 4 :]
        assert ghost[32, 70] > 0.7 if kind != "saliency" else ghost[32, 70] > 0.4
        assert ghost[5, 5] < 0.05
        assert ghost.max() <= 1
    white = load_scene(STEREO).projector.white
    posed, _ = Stage(load_scene(STEREO)).pose_frame(read_master([arguments[1], arguments[3]]))
    ghost = np.abs(triage(posed).untouched.residual) / white
    assert 0.5 < np.quantile(ghost, 0.999) * frame["brightened"] <= 1


def test_large_pictures_are_reduced(run: Run, tmp_path: Path, out: Path) -> None:
    left, right = (np.repeat(view(place), 22, axis=1)[:40] for place in (12, 60))
    files = [store(tmp_path / f"{k}.exr", eye) for k, eye in enumerate((left, right))]
    arguments = ("--left", files[0], "--right", files[1], "--scene", STEREO, "--out", out)
    assert run("predict", *arguments).code == 0
    # By 4 to what a prediction tells apart
    assert channels(out / "0.maps.exr")["TVI"].shape == (10, 528)
    spec = oiio.ImageBuf(str(out / "0.tvi.png")).spec()
    assert (spec.width, spec.height) == (2 * 528 + 4, 10)


def test_verdicts_and_the_summary_of_a_sequence(run: Run, tmp_path: Path, out: Path) -> None:
    (tmp_path / "in").mkdir()
    # nothing; a ghost in the dark; one that can be subtracted; a larger one in the dark
    lights = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.02), (1.0, 0.0)]
    for number, (light, black) in enumerate(lights, 1):
        for eye, place in (("L", 12), ("R", 60)):
            pixels = view(place, light, black)
            if number == 4:
                pixels[5:55, place - 8 : place + 24] = light
            store(tmp_path / "in" / f"{eye}.{number:04d}.exr", pixels, "float")
    arguments = (
        "--left",
        tmp_path / "in" / "L.####.exr",
        "--right",
        tmp_path / "in" / "R.####.exr",
    )
    arguments += ("--scene", STEREO, "--out", out, "--workers", 0)
    done = run("predict", *arguments, "--json")
    found = json.loads(done.out)
    assert done.err.startswith("domesim: L.0002.maps.exr")  # ghosts come and go
    assert "black moves by up to" in done.err
    assert [frame["verdict"] for frame in found["frames"]] == [
        "nothing",
        "compensate",
        "subtract",
        "compensate",
    ]
    order = [int(Path(files[0]).stem[-4:]) for files in found["worst"]]
    # What subtraction removes wholly gains most, though less of it is visible afterwards
    assert order == [3, 4, 2, 1]
    gained = [frame["gained"] for frame in found["frames"]]
    assert gained[0] == 0 < gained[1] < gained[3] < gained[2]
    lost = found["frames"][2]["lost"]
    assert gained[2] == lost["none"] - min(lost["perceptual"], lost["subtractive"])
    summary = run("predict", *arguments).out.splitlines()[-1]
    assert "1 subtraction is enough; 2 compensation worth while" in summary
    worst = summary.split("Most to be gained: ")[1]
    assert re.findall(r"L\.(\d{4})\.exr", worst) == ["0003", "0004", "0002"]


def test_settings_reach_the_prediction(run: Run, tmp_path: Path, out: Path) -> None:
    master = fulldome(tmp_path / "m.exr", 0.2)
    base = (master, "--scene", DOME, "--out", out)
    plain = figures(run, *base)["frames"][0]
    paper = figures(run, *base, "--combination", "paper")
    assert paper["saliency"] is True
    assert paper["frames"][0]["visible"] < 0.7 * plain["visible"]
    salient = figures(run, *base, "--saliency")
    assert salient["frames"][0]["visible"] == plain["visible_salient"] < plain["visible"]
    without = figures(run, *base, "--combination", "paper", "--no-saliency")
    assert without["saliency"] is False
    assert without["frames"][0]["visible"] >= paper["frames"][0]["visible"]
    strict = figures(run, *base, "--threshold", "0.9", "--saliency")
    assert strict["frames"][0]["visible"] < salient["frames"][0]["visible"]
    contrast = figures(run, *base, "--combination", "local-contrast")
    assert (contrast["threshold"], contrast["saliency"]) == (MARKED, False)
    posed, _ = Stage(load_scene(DOME)).pose_frame(read_master([master]))
    assert contrast["frames"][0]["visible_subtracted"] == remaining(posed, SEEN).share
    assert contrast["frames"][0]["visible"] < 0.7 * plain["visible"]
    blend = figures(run, *base, "--mesopic", "cie-191")
    assert blend["mesopic"] == "cie-191"
    assert blend["age"] is None
    assert figures(run, *base, "--age", "70")["age"] == 70
    aged = channels(out / "m.maps.exr")["TVI"]
    assert run("predict", *base, "--mesopic", "cie-191").code == 0
    before = channels(out / "m.maps.exr")["TVI"]
    assert run("predict", *base).code == 0
    found = channels(out / "m.maps.exr")["TVI"]
    assert (found != before).any()
    assert (found != aged).any()


def test_a_seat_of_a_dome_is_one_that_it_has(run: Run, tmp_path: Path, out: Path) -> None:
    base = (fulldome(tmp_path / "m.exr", 0.2), "--scene", "dome_planetarium", "--out", out)
    assert figures(run, *base, "--seat", "front")["seats"] == ["front"]
    run("predict", *base, "--seat", "balcony").is_refused("no seat 'balcony'", "front, centre")
    run("observe", *base, "--seat", "front").is_refused("--seat front", "same light")


def test_a_default_threshold_is_the_same_job_as_its_figure() -> None:
    default, given, other = (
        Predicting(SceneChoice(DOME), Prediction(threshold)).settings()
        for threshold in (None, 0.05, 0.06)
    )
    assert default == given != other


def test_neither_inputs_nor_frames_are_replaced(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    master = fulldome(folder / "m.exr")
    before = master.read_bytes()
    assert run("predict", master, "--scene", DOME, "--out", folder).code == 0
    assert written(folder) == sorted(["m.exr", *names("m")])
    assert master.read_bytes() == before
    # maps and pictures may have an input's name, too
    maps, picture = folder / "a.maps.exr", folder / "a.tvi.png"
    left = store(folder / "a.png", view(12), "uint8")
    store(maps, view(60))
    store(picture, view(60), "uint8")
    for right, words in (
        (maps, ("input itself",)),
        (picture, ("got the input itself", "another folder")),
    ):
        before = right.read_bytes()
        arguments = ("--left", left, "--right", right, "--scene", STEREO, "--out", folder)
        run("predict", *arguments).is_refused(right.name, *words)
        assert right.read_bytes() == before


def test_nothing_is_half_written(
    run: Run, tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture's place is taken by a folder: none of the frame's files is there."""
    master = fulldome(tmp_path / "m.exr")
    (out / "m.saliency.png").mkdir(parents=True)
    run("predict", master, "--scene", DOME, "--out", out).is_refused("m.saliency.png")
    assert written(out) == ["m.saliency.png"]
