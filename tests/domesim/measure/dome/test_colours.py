"""A camera that mixes the projector's primaries tells the same as one that does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from image_files import store
from made_up_domes import CAMERA, GAIN, THEATRE, patterns, seen, truth

from domesim.errors import InputError
from domesim.measure.dome.colours import mixing, unmixed
from domesim.measure.dome.file import read_survey
from domesim.measure.dome.responses import responses_of
from domesim.measure.dome.without_geometry import found_in
from domesim.measure.raws import read_photograph
from testing.raws import store_raw
from testing.surveys import theatre_file

MIX = np.array([[0.9, 0.25, 0.03], [0.15, 0.8, 0.2], [0.02, 0.1, 0.7]])
"""(channel, primary) of a camera without a matrix of its own."""
PURE = MIX / np.diag(MIX)
NAMES = ("black", "red", "green", "blue")


def colours() -> np.ndarray:
    """(pattern, row, col, primary): full black, red, green and blue."""
    return patterns()[1] * np.concatenate([np.zeros((1, 3)), np.eye(3)])[:, None, None]


def camera_raw(lit: np.ndarray, seed: int) -> np.ndarray:
    light = seen(truth(), lit, size=48, noise=0.0, read_out=0.0).light @ MIX.T
    spread = np.hypot(0.01 * light, 1e-3)
    return light + spread * np.random.default_rng(seed).standard_normal(light.shape)


def test_the_matrix_is_found():
    black, *primaries = camera_raw(colours(), 1)
    assert mixing(black, primaries) == pytest.approx(PURE, abs=1e-3)


def test_mixing_is_undone():
    light = np.random.default_rng(0).random((5, 7, 3))
    assert np.allclose(unmixed(light @ PURE.T, PURE), light)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A survey in a camera's own colours; black and red were exposed longer."""
    place = tmp_path_factory.mktemp("colours")
    kept = [0, 1, 2, 3, 6, 8, 12, 13]
    text = 'theatre = "theatre.toml"\n[camera]\n'
    text += f"position_m = {list(CAMERA.position)}\nlook_at_m = {list(CAMERA.look_at)}\n"
    text += f"field_deg = {float(np.degrees(CAMERA.field))}\n[colours]\n"
    for name, light in zip(NAMES, camera_raw(colours(), 1), strict=True):
        times = {"black": 50.0, "red": 2.0}.get(name, 1.0)
        store(place / f"{name}.exr", (times * light).astype(np.float32))
        text += f'{name} = {{ file = "{name}.exr", exposure = {times} }}\n'
    lit = patterns()[kept]
    for number, (pattern, light) in enumerate(zip(lit, camera_raw(lit, 2), strict=True)):
        store(place / f"p{number}.png", np.round(255 * pattern).astype(np.uint8))
        store(place / f"{number}.exr", light.astype(np.float32))
        text += f'[[photographs]]\nfile = "{number}.exr"\npattern = "p{number}.png"\n'
    (place / "theatre.toml").write_text(theatre_file(THEATRE.dome))
    (place / "survey.toml").write_text(text)
    return place


def test_a_survey_in_the_cameras_colours(folder):
    task = read_survey(folder / "survey.toml")
    found = found_in(responses_of(THEATRE, task.patterns, task.photographs, 4), THEATRE)
    white = truth().mean_gain()
    assert found.white == pytest.approx(white, rel=0.01)
    assert found.gain == pytest.approx(np.array(GAIN) * np.diag(MIX), rel=0.03)
    assert found.misfit < 1.1
    assert "red.exr" in task.digests
    # Primaries reflect differently; taken as they come, the camera's would be wrong.
    mixed = replace(task.photographs, light=task.photographs.light @ PURE.T)
    off = found_in(responses_of(THEATRE, task.patterns, mixed, 4), THEATRE).white / white - 1
    assert np.abs(off).max() > 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ('"red.exr", exposure = 2.0', '"black.exr", exposure = 50.0'),
            "colours.red: wanted a photo",
        ),
        (('blue = { file = "blue', 'blue = { file = "green'), "sees the primaries nearly alike"),
        (('theatre = "', 'unit = "cd/m2"\ntheatre = "'), "they tell no cd/m2"),
        (('blue = { file = "blue.exr", exposure = 1.0 }\n', ""), "blue"),
    ],
)
def test_mistakes_of_colours(folder, change, message):
    text = (folder / "survey.toml").read_text()
    assert change[0] in text
    (folder / "wrong.toml").write_text(text.replace(*change, 1))
    with pytest.raises(InputError, match=message.replace(".", r"\.")):
        read_survey(folder / "wrong.toml")


def test_raw_files_tell_what_linear_ones_tell(folder):
    """The fisheye's circle is somewhere on a sensor that is no square."""
    text = (folder / "survey.toml").read_text().replace(".exr", ".dng")
    lights = {path: read_photograph(path).pixels for path in folder.glob("*.exr")}
    scale = 0.9 / max(light.max() for light in lights.values())
    for path, light in lights.items():
        sensor = np.pad(scale * light, ((5, 3), (20, 8), (0, 0)))
        store_raw(path.with_suffix(".dng"), sensor, bits=16)
    there = text.replace("[camera]\n", "[camera]\ncircle_px = [44, 29, 24]\n")
    (folder / "raw.toml").write_text(there)
    raw, linear = (read_survey(folder / f"{name}.toml").photographs for name in ("raw", "survey"))
    assert np.abs(raw.light / scale - linear.light).max() < 3e-5 / scale
    (folder / "raw.toml").write_text(there.replace("44, 29", "44, 19"))
    with pytest.raises(InputError, match=r"circle_px must lie in the photograph, 76 x 56"):
        read_survey(folder / "raw.toml")


def test_a_clipped_photograph_is_refused(folder):
    light = np.full((48, 48, 3), 0.3)
    light[:8] = 2.0
    store(folder / "clipped.exr", np.minimum(light, 1).astype(np.float32))
    text = (folder / "survey.toml").read_text().replace('"1.exr"', '"clipped.exr"')
    (folder / "wrong.toml").write_text(text)
    with pytest.raises(InputError, match=r"clipped.exr: 16.7% of the pixels are saturated"):
        read_survey(folder / "wrong.toml")
