"""``domesim measure dome --without-geometry``: files in, a scene and a transport out."""

from __future__ import annotations

import json

import numpy as np
import pytest
from image_files import store
from made_up_domes import GAIN, THEATRE, store_survey, truth

from domesim.frames import read_frame
from domesim.observation.transport import load_transport
from domesim.scene import load_dome

KEPT = (0, 1, 2, 3, 6, 8, 10, 12, 13)
"""Patterns: black, white, two halves, three sectors, two rings."""
PLAN = f"""\
name = "plan"
description = "A theatre with whatever is in it."

[dome]
radius_m = 4.0
half_angle_deg = 85.0
tilt_deg = {float(np.degrees(THEATRE.dome.tilt))!r}

[screen]
albedo = 0.5

[screen.lobe]
share = 0.2
roughness = 0.4

[floor]
height_m = -1.0
albedo = 0.9

[seating]
rows = 3
seats_per_row = 5
first_row_m = 1.0
albedo = 0.1

[projector]
white_cd_m2 = 8.0

[viewing]
adaptation_cd_m2 = 0.5

[sources]
"dome" = "the plan"
"floor" = "guessed"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("survey")
    store_survey(place, PLAN, KEPT)
    return place


def test_the_scene_and_its_transport_compensate(folder, run):
    out = folder / "measured.toml"
    measure = ("measure", "dome", folder / "survey.toml", "--without-geometry", "--out", out)
    code, said, complaint = run(*measure, "--json")
    assert (code, complaint) == (0, "")
    figures = json.loads(said)
    white = truth().mean_gain()
    assert figures["reflected_of_white"] == pytest.approx(white, rel=0.01)
    assert figures["gain"] == pytest.approx(GAIN, rel=0.05)
    assert figures["transport"] == str(folder / "measured.npz")
    scene = load_dome(out)
    theatre = scene.theatre
    assert (theatre.lobe, theatre.floor, theatre.solids) == (None, None, ())
    assert scene.sources["dome"] == "the plan"
    assert "floor" not in scene.sources
    assert scene.measured is not None
    assert {"theatre.toml", "1.exr", "patterns/1.png"} <= set(scene.measured.sha256)
    # Without its transport, the scene reflects as much of white by the closed form.
    light = np.ones((1, 32, 32, 3)) * scene.screen(32, 32)[None, ..., None]
    alone = scene.observation(32, 32)
    share = scene.pixel_areas(32, 32) / scene.pixel_areas(32, 32).sum()
    closed = np.tensordot(share, (alone.observe(light) - light)[0], 2) - scene.ambient / 8.0
    assert closed == pytest.approx(white, rel=0.01)
    stored = load_transport(folder / "measured.npz")
    whole = scene.with_transport(stored)
    assert whole.approximation is None
    assert "photographs" in whole.facts()["Model"]
    dark = whole.observation(32, 32).observe(0 * light)[0][scene.screen(32, 32)]
    assert dark.mean(0) == pytest.approx(np.full(3, 0.003), rel=0.05)
    # And the rest of the program takes both.
    master, result = folder / "master.exr", folder / "compensated"
    store(master, (0.3 * light[0]).astype(np.float32))
    both = ("--scene", out, "--transport", folder / "measured.npz", "--out", result, "--json")
    code, said, complaint = run("compensate", master, *both)
    assert (code, complaint) == (0, "")
    # As sure as the transport is: what is left of an even picture is a small part of what bounces
    low, likely, high = json.loads(said)["frames"][0]["light_left"]
    assert 0 < low < likely < high < 0.05 * 0.3 * white.max()
    middle = np.asarray(read_frame(result / "master.exr").pixels, np.float64)[12:20, 12:20].mean(
        (0, 1)
    )
    assert np.all(middle < 0.3 / (1 + 0.8 * white))
    assert np.all(middle > 0.3 / (1 + 1.2 * white) - 0.01)


@pytest.mark.long
def test_what_was_found_is_told(folder, run):
    out = folder / "told.toml"
    code, said, _ = run(
        "measure", "dome", folder / "survey.toml", "--without-geometry", "--out", out
    )
    assert code == 0
    assert "9 photographs of black and 8 patterns" in said
    assert "error of the reflected light of patterns left out, by number of modes: 1: " in said
    assert f"--scene {out} --transport {folder / 'told.npz'}" in said


@pytest.mark.parametrize("option", [("--hold", "floor=0.1"), ("--residual", "residual.png")])
def test_options_of_albedos_are_refused(folder, run, option):
    survey, out = folder / "survey.toml", folder / "none.toml"
    code, _, complaint = run("measure", "dome", survey, "--without-geometry", "--out", out, *option)
    assert code == 2
    assert f"{option[0]} is of albedos" in complaint
    assert not out.exists()


def test_readings_are_refused(folder, run):
    survey = folder / "meter.toml"
    survey.write_text(
        'theatre = "theatre.toml"\n[[readings]]\npattern = "patterns/1.png"\n'
        'place_m = [0.0, 0.0, 4.0]\nunit = "cd/m2"\nvalue = 6.0\nerror = 0.1\n'
    )
    out = folder / "none.toml"
    code, _, complaint = run("measure", "dome", survey, "--without-geometry", "--out", out)
    assert code == 2
    assert "--without-geometry needs photographs" in complaint
