"""``domesim scene new``: what it writes loads, says where it is from, and means what was asked."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.room.lenses import lobe_gain
from domesim.scene import load_scene
from domesim.scene.drafts import SYSTEMS, DomeWish, StereoWish, dome_draft, stereo_draft
from domesim.scene.loading import scene_of_text

DRAFTS = {
    "centre": dome_draft(DomeWish(6.0), "mine"),
    "cove": dome_draft(DomeWish(7.5, 20.0, projectors=5, albedo=0.5, gain=1.2), "mine"),
    "lumens": dome_draft(DomeWish(9.0, lumens=20_000.0, layout="ring", projectors=2), "mine"),
    **{name: stereo_draft(StereoWish(name, 8.0), "mine") for name in SYSTEMS},
}


@pytest.mark.parametrize("text", DRAFTS.values(), ids=DRAFTS)
def test_each_figure_has_a_comment_and_a_source(text):
    content = tomllib.loads(text)
    sources = content["sources"]
    body, _, _ = text.partition("\n[sources]\n")
    heading, before = "", ""
    count = 0
    for line in body.splitlines():
        if line.startswith("["):
            heading = line.strip("[]")
        elif " = " in line and not line.startswith(("#", "description")):
            key = line.split(" = ")[0]
            assert "  # " in line or before.startswith("# "), line
            place = f"{heading}.{key}"
            known = any(
                place == part or place.startswith(f"{part}.")
                for listed in sources
                for part in listed.split(", ")
            )
            assert known or not heading, place
            count += 1
        before = line
    assert count >= 8


@pytest.mark.parametrize("text", DRAFTS.values(), ids=DRAFTS)
def test_drafts_load(text):
    scene = scene_of_text(text, "mine.toml", Path())
    assert scene.name == "mine"
    assert scene.projector.white > scene.projector.black > 0


def test_a_gain_above_the_albedo_is_a_lobe_of_just_that_gain():
    for albedo, gain in ((0.5, 0.8), (0.4, 1.3), (0.3, 3.0)):
        text = dome_draft(DomeWish(5.0, albedo=albedo, gain=gain), "mine")
        theatre = scene_of_text(text, "mine.toml", Path()).theatre
        up = np.array([0.0, 0.0, 1.0])
        assert albedo * lobe_gain(theatre.lobe, up, up, up) == pytest.approx(gain, rel=1e-3)
    alone = scene_of_text(dome_draft(DomeWish(5.0, gain=0.4), "mine"), "mine.toml", Path())
    assert alone.theatre.lobe is None
    assert alone.theatre.albedo == (0.4, 0.4, 0.4)


def test_lumens_are_those_of_the_screen():
    text = dome_draft(DomeWish(5.0, albedo=0.5, perforation=0.0, lumens=9000.0), "mine")
    scene = scene_of_text(text, "mine.toml", Path())
    assert scene.projector.white == pytest.approx(0.5 * 9000 / (2 * np.pi * 25) / np.pi)
    assert scene.projector.white / scene.projector.black == pytest.approx(5000, rel=0.01)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"gain": 1.3}, "has a lobe"),
        ({"gain": 0.3, "albedo": 0.5}, "at least the albedo"),
        ({"white": 5.0, "lumens": 900.0}, "one of the two"),
        ({"projectors": 3, "layout": "centre"}, "one stands in the centre"),
        ({"projectors": 0}, "1 to 24"),
        ({"tilt": 80.0}, "0 to 60 degrees"),
        ({"seats": (70, 3)}, "1 to 60"),
        ({"radius": float("nan")}, "1 to 100 m"),
    ],
)
def test_what_cannot_be_is_refused(wrong, told):
    with pytest.raises(InputError, match=told):
        DomeWish(**{"radius": 5.0, **wrong})


def test_the_command_writes_a_theatre_that_passes_its_check(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ("--radius", 7.5, "--tilt", 20, "--projectors", 5, "--layout", "cove")
    more = ("--seats", "4x6", "--albedo", 0.5)
    figures = run("scene", "new", "mine", *options, *more, "--json").figures()
    assert figures["output"] == "mine.toml"
    scene = load_scene("mine.toml")
    assert (scene.dome.radius, len(scene.theatre.lenses)) == (7.5, 5)
    assert len(scene.theatre.seats) == 24
    checked = run("scene", "check", "mine.toml", "--json").figures()
    assert checked["dark_share"] <= 1e-3
    assert checked["seats"] == 24
    before = Path("mine.toml").read_bytes()
    run("scene", "new", "mine.toml", *options).is_refused("mine.toml", "that is there")
    assert Path("mine.toml").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--kind", "cinema", "--radius", 5), ("--kind cinema", "dome or stereo")),
        (("--radius", 5, "--width", 3), ("--width", "not for --kind dome")),
        (("--kind", "stereo", "--width", 5, "--half-angle", 90), ("--half-angle",)),
        (("--tilt", 5), ("--radius", "missing")),
        (("--kind", "stereo", "--system", "silver"), ("--width", "missing")),
        (("--kind", "stereo", "--system", "red-green", "--width", 5), ("red-green", "spectral")),
        (("--radius", 5, "--layout", "corner"), ("corner", "cove, ring, centre")),
        (("--radius", 5, "--seats", "many"), ("--seats many", "9x16")),
    ],
)
def test_wrong_options_are_one_line_and_write_nothing(run, tmp_path, options, told):
    run("scene", "new", tmp_path / "a.toml", *options).is_refused(*told)
    assert not (tmp_path / "a.toml").exists()


def test_it_asks_on_a_terminal(tmp_path):
    """Enter takes what is proposed; an answer that cannot be is asked for again."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "domesim", "scene", "new", "mine"]
    path = os.pathsep.join([str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        command, cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    os.close(theirs)
    os.write(ours, b"6\n99\n10\n3\n\n4x5\n\n\n\n")
    told = b""
    try:
        while part := os.read(ours, 4096):
            told += part
    except OSError:  # the terminal's other end is closed
        pass
    finally:
        os.close(ours)
    assert process.wait(timeout=300) == 0, told.decode()
    assert "--tilt: must be 0 to 60" in told.decode()
    scene = load_scene(tmp_path / "mine.toml")
    assert scene.dome.radius == 6
    assert np.degrees(scene.dome.tilt) == pytest.approx(10)
    assert [lens.name for lens in scene.theatre.lenses] == ["cove 1", "cove 2", "cove 3"]
    assert len(scene.theatre.seats) == 20
    assert scene.sources["dome.tilt_deg"] == "given"
    assert scene.sources["screen.albedo"].startswith("chosen")


def test_a_plain_room_is_what_surveys_take(run, tmp_path):
    """A closed form of few surfaces knows all that is in it."""
    asked = ("scene", "new", tmp_path / "a.toml", "--radius", "7.5", "--projectors", "5", "--plain")
    assert run(*asked)[0] == 0
    scene = load_scene(str(tmp_path / "a.toml"))
    assert scene.theatre.beyond_enclosure == ()
    assert scene.theatre.floor
    code, _, complaint = run(*asked[:2], tmp_path / "b.toml", *asked[3:], "--seats", "2x3")
    assert code == 2
    assert "--seats contradicts --plain" in complaint
