"""3D domes in scene files, and in all commands."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import outcome_of
from rigs import Rig
from stored_masters import store

from compensate.ruler import NO_DIFFERENCE
from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.observation.dome_pair import direct_crosstalk
from domesim.readings.meter import read_readings
from domesim.readings.pair import measured_pair
from domesim.scene import load_dome
from domesim.scene.loading import scene_of_text

DOME = """
name = "3D"
[dome]
radius_m = 3.0
[screen]
albedo = [0.6, 0.5, 0.4]
[projector]
white_cd_m2 = 10.0
black_cd_m2 = 0.01
[viewing]
adaptation_cd_m2 = 1.0
[stereo]
"""
SHUTTER = DOME + 'system = "shutter"\nshare = 0.03\n'
POLARISED = DOME + 'system = "polarised"\nto_left = 0.02\nto_right = [0.01, 0.02, 0.03]\n'


def scene(text):
    return scene_of_text(text, "mine.toml", Path())


def pair(folder, size=64):
    """Files of dark views with lamps in different places."""
    folder.mkdir(exist_ok=True)
    files = []
    for eye, shift in (("L", 0), ("R", 3)):
        pixels = np.full((size, size, 3), 0.01, np.float32)
        pixels[20:28, 30 + shift : 40 + shift] = 0.8
        files.append(store(folder / f"{eye}.exr", pixels))
    return files


def test_what_a_file_says_is_what_is_seen():
    shutter, polarised = scene(SHUTTER), scene(POLARISED)
    assert shutter.views == polarised.views == 2
    light = np.zeros((2, 32, 32, 3))
    light[1] = shutter.screen(32, 32)[..., None]  # the right view is white, the left one black
    black = 0.001
    on = shutter.screen(32, 32)
    reflected = shutter.one_eye.observation(32, 32).observe(light[1:])[0][on] - 1 - black
    seen = shutter.observation(32, 32).observe(light)[:, on]
    assert seen[0] == pytest.approx(0.03 * (1 + reflected) + black)
    assert seen[1] == pytest.approx(1 + reflected + black)
    # Half of what is reflected goes either way, and then leaks
    seen = polarised.observation(32, 32).observe(light)[:, on]
    own, other = 1 + reflected / 2, reflected / 2
    assert seen[0] == pytest.approx(other + 0.02 * own + black)
    assert seen[1] == pytest.approx(own + np.array([0.01, 0.02, 0.03]) * other + black)
    turned = scene(POLARISED + "kept_by_reflection = -1.0\n")
    assert turned.observation(32, 32).observe(light)[0, on].mean() > seen[0].mean()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (DOME + 'system = "shutter"\n', ("stereo", "share")),
        (SHUTTER + "to_left = 0.1\n", ("stereo", "share")),
        (SHUTTER + "kept_by_reflection = 0.5\n", ("kept_by_reflection", "leave it out")),
        (DOME + 'system = "shutter"\nshare = -0.2\n', ("stereo", "must add light")),
        (
            POLARISED.replace("[stereo]", "[screen.lobe]\nshare = 0.2\nroughness = 0.3\n[stereo]")
            + "kept_by_reflection = -0.5\n",
            ("stereo.kept_by_reflection", "lobe"),
        ),
    ],
)
def test_what_cannot_be_is_refused(text, words):
    with pytest.raises(InputError) as refusal:
        scene(text)
    for word in words:
        assert word in str(refusal.value)


def test_a_stored_transport_is_of_one_view():
    assert scene(SHUTTER).digest == scene(SHUTTER).one_eye.digest == scene(POLARISED).digest
    with_floor = SHUTTER.replace("[stereo]", "[floor]\nheight_m = -1.0\nalbedo = 0.2\n[stereo]")
    assert "closed form" in scene(with_floor).approximation


def test_commands_take_a_pair(tmp_path, capfd):
    left, right = pair(tmp_path / "in")
    shown = ("--left", left, "--right", right, "--scene", "dome_stereo_polarised", "--json")
    found = outcome_of(capfd, "compensate", *shown, "--out", tmp_path / "c").figures()
    (frame,) = found["frames"]
    assert frame["loss_after"] < frame["loss_before"] + NO_DIFFERENCE
    seen = outcome_of(capfd, "observe", *shown, "--out", tmp_path / "o").figures()
    assert seen["frames"][0]["pollution_cd_m2"] > 0
    brighter = read_frame(tmp_path / "o" / "L.exr").pixels.mean()
    assert brighter > read_frame(left).pixels.mean()
    paper = outcome_of(
        capfd, "compensate", *shown, "--weighting", "paper", "--out", tmp_path / "p"
    ).figures()
    assert paper["frames"][0]["gap"] <= 1e-3
    outcome_of(capfd, "predict", *shown, "--out", tmp_path / "q").figures()


def test_rendering_shows_either_eye(tmp_path, capfd):
    left, right = pair(tmp_path / "in", size=32)
    path = tmp_path / "mine.toml"
    path.write_text(POLARISED)
    out = tmp_path / "seen.exr"
    arguments = ("render", path, "--master", left, "--master", right, "--error", "0.05")
    found = outcome_of(capfd, *arguments, "--out", out, "--json").figures()
    theatre = scene(POLARISED)
    light = np.stack([read_frame(each).pixels for each in (left, right)])
    light = light * theatre.screen(32, 32)[None, :, :, None]
    seen = theatre.observation(32, 32).observe(light)[:, theatre.screen(32, 32)]
    for eye, expected in zip("LR", seen, strict=True):
        layers = read_frame(out.with_name(f"seen_{eye}.exr")).pixels[theatre.screen(32, 32)]
        white = theatre.projector.white
        assert layers.mean() / white == pytest.approx(expected.mean(), rel=0.01)
        assert out.with_name(f"seen_{eye}.png").is_file()
    assert found["left"]["mean_cd_m2"]["seen"] > found["left"]["mean_cd_m2"]["direct"]
    outcome_of(capfd, *arguments[:4], "--out", out).is_refused("left, then right")
    _, other = pair(tmp_path / "other", size=48)
    outcome_of(capfd, *arguments[:4], "--master", other, "--out", out).is_refused("one size")


def test_readings_of_full_pictures_tell_direct_crosstalk(tmp_path, capfd):
    mixed = "to_left = [[0.02, 0.01, 0.0], [0.003, 0.03, 0.002], [0.0, 0.02, 0.01]]"
    polarised = scene(POLARISED.replace("to_left = 0.02", mixed))
    path = tmp_path / "mine.toml"
    path.write_text(SHUTTER.replace("albedo = [0.6, 0.5, 0.4]", "albedo = 0.5"))
    light = np.zeros((2, 32, 32, 3))
    on = polarised.screen(32, 32)
    observation, seen = polarised.observation(32, 32), np.zeros((2, 3, 2, 3))
    for view, p in np.ndindex(2, 3):
        light[:] = 0
        light[view, on, p] = 1
        seen[:, :, view, p] = observation.linear(light)[:, on].mean(axis=1)
    measured = np.stack([np.linalg.solve(seen[v, :, v], seen[v, :, 1 - v]) for v in range(2)])
    found = direct_crosstalk(measured, *polarised.reflected_by_views(32))
    assert found == pytest.approx(polarised.stereo.leaks, abs=1e-4)
    # A matrix of readings is read as it is, and reflected light taken out
    readings = tmp_path / "rig.csv"
    readings.write_text(Rig().csv())
    out = tmp_path / "new.toml"
    arguments = ("measure", "crosstalk", readings, "--dome", path, "--out", out, "--json")
    figures = outcome_of(capfd, *arguments).figures()
    written = tomllib.loads(out.read_text())["stereo"]
    assert written["to_left"] == pytest.approx(np.round(figures["direct"][0], 6))
    # Shutters keep reflected light apart, so that it tells nothing
    pair = measured_pair(read_readings(readings, black=None))
    assert np.array(written["to_right"]) == pytest.approx(pair.common_matrices[1], abs=1e-5)
    assert load_dome(out).stereo.system == "shutter"
    path.write_text(POLARISED)
    less = ("measure", "crosstalk", readings, "--dome", path, "--out", tmp_path / "y.toml")
    outcome_of(capfd, *less).is_refused("no crosstalk is left", "albedo")
    flat = ("measure", "crosstalk", readings, "--dome", "dome_imax", "--out", tmp_path / "x.toml")
    outcome_of(capfd, *flat).is_refused("3D dome", "[stereo]")
