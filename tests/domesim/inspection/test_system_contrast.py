"""System contrast: what it is made of, and that the bundled cinema's is a cinema's."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from PIL import Image

from compensate.report_card import crosstalk, to_the_eye
from domesim.errors import InputError
from domesim.inspection import contrast as module
from domesim.inspection.contrast import Contrast, contrast, means
from domesim.inspection.photometry import ghost
from domesim.observation.glare import Scatter
from domesim.scene import CinemaScene, StereoScene, load_scene, load_stereo
from domesim.scene.choice import SceneChoice
from domesim.scene.flat import LENS, ROOM
from domesim.scene.loading import scene_content, scene_of_text
from domesim.scene.writing import as_toml


@pytest.fixture(scope="module")
def cinema() -> CinemaScene:
    scene = load_scene("cinema_2d")
    assert isinstance(scene, CinemaScene)
    return scene


def test_parts_add_up_and_the_room_is_most(cinema):
    found = contrast(cinema)
    assert sum(found.parts.values()) == pytest.approx(found.dark, rel=0.03)
    assert max(found.parts, key=found.parts.__getitem__) == ROOM
    assert found.black == pytest.approx(cinema.ambient, rel=1e-6)
    assert found.ansi == pytest.approx(found.lit / found.dark)


def test_fields_are_read_in_their_middles():
    board = np.kron(np.add.outer(np.arange(4), np.arange(4)) % 2, np.ones((25, 40)))
    middle = (np.arange(100) % 25 // 5 == 2)[:, None] & (np.arange(160) % 40 // 8 == 2)
    seen = np.where(middle, 3 * board + 1, 7.0)
    assert means(board[None], seen[None]) == (4, 1)


def test_without_a_room_only_what_is_sent_counts(cinema):
    bare = replace(cinema, way=cinema.way.only())
    found = contrast(bare)
    projector = bare.projector
    assert found.ansi == pytest.approx(found.sequential, rel=1e-6)
    assert found.sequential == pytest.approx((projector.white + bare.ambient) / bare.ambient)


def test_the_cinema_is_within_what_cinemas_should_have(cinema):
    # SMPTE RP 431-2 for theatres: 1200 : 1, and 100 : 1 within a frame
    found = contrast(cinema)
    assert found.sequential > 1200
    assert 100 < found.ansi < 500
    lit, dark = to_the_eye(cinema)
    assert found.lit / 4 < lit < found.lit
    assert dark > found.dark


@pytest.mark.long
def test_a_directed_screen_sees_less_of_the_room():
    pair = load_stereo("stereo_room")
    room = replace(pair.way.room, gain=1.0, half_gain=None)
    matt = replace(pair, way=replace(pair.way, room=room))
    assert contrast(pair).parts[ROOM] < 0.6 * contrast(matt).parts[ROOM]
    with pytest.raises(InputError, match=r"neither \[lens\] nor \[room\]"):
        contrast(pair.crosstalk_alone)


def test_contrast_does_not_depend_on_the_board_s_pixels(cinema, monkeypatch):
    narrow = replace(cinema, way=replace(cinema.way, scatters={LENS: Scatter(0.05, 4.0, 2e-3)}))
    lens = replace(narrow, way=narrow.way.only(LENS))
    found = []
    for pixels in (5, 25):
        monkeypatch.setattr(module, "_FIELD", pixels)
        found.append([contrast(lens).ansi, contrast(narrow).dark, contrast(narrow).lit])
    assert found[0] == pytest.approx(found[1], rel=0.01)


def test_commands_take_a_cinema(run: Run, tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (27, 48, 3)) ** 2 // 255
    Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "m.png")
    common = (str(tmp_path / "m.png"), "--scene", "cinema_2d", "--out")
    for command in ("observe", "compensate"):
        assert run(command, *common, tmp_path / command).code == 0
    paper = ["--weighting", "paper"]
    if importlib.util.find_spec("torch") is not None:
        paper += ["--device", "torch"]
    told = run("compensate", *common, tmp_path / "paper", *paper)
    assert told.code == 0
    assert "no fast solver knows this composition" in told.out
    assert run("scene", "check", "cinema_2d", "--json").figures()["ansi_contrast"] > 100
    assert run("report-card", "cinema_2d", "--json").figures()["eye_veil_cd_m2"] > 0
    run("tabulate", "cinema_2d", "--out", tmp_path / "t.npz").is_refused("2-D cinema")


def test_without_black_contrast_is_infinite():
    found = Contrast(48.0, 0.0, 48.0, 0.0, {ROOM: 0.0})
    assert found.share(ROOM) == 0
    assert found.lines()[1].startswith("ANSI contrast: infinite")


def test_a_screen_that_reaches_the_walls_is_said_to_be_approximate(cinema):
    assert cinema.approximation is None
    room = replace(cinema.way.room, size=(12.4, 8.0, 24.0))
    near = replace(cinema, way=replace(cinema.way, room=room))
    assert "0.2 m of another surface" in near.approximation


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens": None}, "needs a [lens], whose throw_m"),
        ({"room": None}, "screen.gain: counts with a [room] only"),
        (
            {"lens": None, "port_glass": None, "room": None, "screen.gain": None},
            "needs [crosstalk] (3D), or [room] or [lens] (2-D)",
        ),
        ({"room.width_m": 10.0}, "must fit the room's front"),
        ({"room.polarised": True}, "room.polarised: only 3D systems have it"),
    ],
)
def test_files_that_cannot_be_are_refused(changes, message):
    content = scene_content("cinema_2d")
    for key, value in changes.items():
        section, _, name = key.partition(".")
        where, last = (content[section], name) if name else (content, section)
        if value is None:
            del where[last]
        else:
            where[last] = value
    with pytest.raises(InputError) as refusal:
        scene_of_text(as_toml(content), "mine.toml", Path())
    assert message in str(refusal.value)


def silver(**room: object) -> dict[str, Any]:
    """A file of the polarised cinema with the room of another, and a gain."""
    content = scene_content("stereo_cinema_silver")
    content["room"] = scene_content("stereo_room")["room"] | {"width_m": 30.0, "height_m": 20.0}
    content["room"] |= room
    content["screen"] |= {"gain": 1.8, "half_gain_deg": 35.0}
    return content


def built(content: dict[str, Any]) -> StereoScene:
    scene = scene_of_text(as_toml(content), "mine.toml", Path())
    assert isinstance(scene, StereoScene)
    return scene


def test_a_polarised_system_has_a_screen_with_gain_and_mixes_what_the_room_reflects():
    assert built(silver()).way.mixed
    with pytest.raises(InputError, match=r"room.polarised: \[crosstalk.polarisation\] says"):
        built(silver(polarised=False))
    matt = silver()
    del matt["screen"]["gain"], matt["screen"]["half_gain_deg"]
    with pytest.raises(InputError, match=r"screen\.gain: is missing"):
        built(matt)


def test_crosstalk_is_that_of_the_filters_alone():
    pair = load_stereo("stereo_room")
    alone = pair.crosstalk_alone
    assert crosstalk(pair) == crosstalk(alone)
    found, bare = ghost(pair, "sweet spot"), ghost(alone, "sweet spot")
    assert found.shares == pytest.approx(bare.shares, abs=0)
    assert crosstalk(pair)["left"].system == pytest.approx(0.005, abs=2e-4)


def test_several_seats_in_a_room_are_refused_when_they_are_named(tmp_path):
    scene = tmp_path / "mine.toml"
    scene.write_text(as_toml(silver()))
    with pytest.raises(InputError, match=r"known for one seat at a time; name one of"):
        SceneChoice(str(scene), seat="all").load()


def test_a_scene_with_a_lens_says_that_uncertainty_is_not_computed():
    content = scene_content("stereo_room")
    content["crosstalk"] |= {"to_left_error": 0.001, "to_right_error": 0.001}
    del content["room"], content["screen"]["gain"], content["screen"]["half_gain_deg"]
    scene = built(content)
    assert scene.uncertain(4, 5) is None
    assert "not for lens and room" in scene.facts()["Uncertainty"]
    assert "Uncertainty" not in scene.crosstalk_alone.facts()
