"""``domesim measure dome`` on photographs that were path-traced in a theatre it never sees."""

from __future__ import annotations

import json
import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import outcome_of
from matplotlib.image import imread

from domesim.frames import ColourTag, Frame, write_frame
from domesim.measure.dome import run as dome_run
from domesim.measure.dome.camera import Camera
from domesim.observation.radiosity import radiosity
from domesim.scene import load_dome
from domesim.scene.writing import as_toml
from testing.laboratory import Faults, patterns_for, photographed
from testing.statistics import assert_unbiased

NAMES = ("black", "white", "front", "right", "zenith", "rim", "sectors")
AMBIENT = (0.002, 0.003, 0.004)
FAULTS = Faults(
    gain=(0.4, 0.5, 0.6),
    vignetting=0.02,
    camera_m=(0.02, -0.01, 0.015),
    turn_deg=(0.2, -0.3, 0.1),
)
THEATRE = """\
name = "plan"
description = "A small theatre."

[dome]
radius_m = 4.0
tilt_deg = 5.0

[screen]
albedo = {screen}
perforation = 0.2

[floor]
height_m = -1.2
albedo = {floor}

[projector]
white_cd_m2 = 8.0

[viewing]
adaptation_cd_m2 = 0.5
"""
TRUE = THEATRE.format(screen=[0.7, 0.65, 0.6], floor=[0.16, 0.12, 0.1])
PLAN = THEATRE.format(screen=0.5, floor=0.3)
SURVEY = """\
theatre = "plan.toml"

[camera]
position_m = [0.1, -0.5, -0.3]
look_at_m = [0.0, 1.5, 1.0]
field_deg = 220.0
"""
CAMERA = Camera((0.1, -0.5, -0.3), (0.0, 1.5, 1.0), np.radians(220.0))
LINEAR = ColourTag("linear", "BT.709", "the test")


def shots(names: tuple[str, ...]) -> str:
    return "".join(
        f'\n[[photographs]]\nfile = "{name}.exr"\npattern = "pattern_{name}.exr"\n'
        for name in names
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A survey of all patterns, and one of white and black."""
    place = tmp_path_factory.mktemp("survey")
    (place / "true.toml").write_text(TRUE)
    (place / "plan.toml").write_text(PLAN)
    theatre = load_dome(place / "true.toml").theatre
    patterns = patterns_for(theatre.dome, 64)
    taken = photographed(theatre, CAMERA, patterns, FAULTS, ambient=AMBIENT, walks=24, seed=4)
    for name, pattern, light in zip(NAMES, patterns, taken.light, strict=True):
        for path, pixels in ((f"pattern_{name}.exr", pattern), (f"{name}.exr", light)):
            frame = Frame(pixels.astype(np.float32), place / path, LINEAR, 32, True)
            write_frame(frame, place / path)
    (place / "survey.toml").write_text(SURVEY + shots(NAMES))
    (place / "two.toml").write_text(SURVEY + shots(NAMES[:2]))
    return place


@pytest.fixture
def run(capfd):
    """The command: its exit code, standard output and standard error."""
    return lambda *arguments: outcome_of(capfd, "measure", "dome", *arguments)


@pytest.fixture
def _coarse(monkeypatch) -> None:
    """Photographs are explained by fewer patches, where it is not the last digit that counts."""
    monkeypatch.setattr(dome_run, "survey_of", partial(dome_run.survey_of, resolution=8))


def test_a_theatre_is_measured_and_its_scene_loads(folder, run):
    out, picture = folder / "measured.toml", folder / "residual.png"
    code, said, _ = run(folder / "survey.toml", "--out", out, "--residual", picture, "--json")
    assert code == 0
    figures = json.loads(said)
    names = ("screen", "floor")
    truth = [np.array([0.7, 0.65, 0.6]) * 0.8, np.array([0.16, 0.12, 0.1])]
    values = [figures["values"][name] for name in names]
    errors = [figures["standard_errors"][name] for name in names]
    assert_unbiased(values, errors, truth)
    assert np.abs(np.divide(values, truth) - 1)[0].max() < 0.005
    assert np.abs(np.divide(values, truth) - 1)[1].max() < 0.02
    scene, plan = load_dome(out), load_dome(folder / "plan.toml")
    assert np.allclose(scene.albedo, values[0])
    assert scene.digest != plan.digest
    assert scene.measured is not None
    assert set(scene.measured.sha256) >= {"plan.toml", "white.exr", "pattern_white.exr"}
    assert 0 < scene.reflected_error[0] < 0.01
    assert "(95 %)" in scene.facts()["Measured"]
    # Black is relative to white, whose luminance the camera does not tell.
    assert scene.projector.white == 8.0
    weights = scene.projector.luminance_weights
    assert scene.ambient == pytest.approx(8 * (weights @ figures["ambient_of_white"]))
    assert picture.stat().st_size > 1000
    # Provenance does not change what light does.
    content = tomllib.loads(out.read_text())
    content.pop("measured")
    out.write_text(as_toml(content))
    assert load_dome(out).digest == scene.digest


@pytest.mark.long
@pytest.mark.usefixtures("_coarse")
def test_white_of_so_many_lumens_is_that_of_the_measured_screen(folder, run):
    """Black is a share of it: the described screen, half as bright, would have another."""
    plan = PLAN.replace("white_cd_m2 = 8.0", "lumens = 5000.0")
    (folder / "lumens.toml").write_text(plan)
    (folder / "of_lumens.toml").write_text(
        SURVEY.replace("plan.toml", "lumens.toml") + shots(NAMES)
    )
    out = folder / "of_lumens_measured.toml"
    code, said, _ = run(folder / "of_lumens.toml", "--out", out, "--json")
    assert code == 0
    figures = json.loads(said)
    (folder / "lumens.toml").write_text(
        plan.replace("albedo = 0.5", f"albedo = {[v / 0.8 for v in figures['values']['screen']]}")
    )
    scene, white = load_dome(out), load_dome(folder / "lumens.toml").projector.white
    assert scene.projector.white == pytest.approx(white)
    weights = scene.projector.luminance_weights
    assert scene.ambient == pytest.approx(white * (weights @ figures["ambient_of_white"]))


@pytest.mark.long
@pytest.mark.usefixtures("_coarse")
def test_what_the_photographs_do_not_tell_is_not_answered(folder, run):
    out = folder / "two_measured.toml"
    code, said, complaint = run(folder / "two.toml", "--out", out, "--json")
    assert code == 2
    assert "no scene was written" in complaint
    assert not out.exists()
    figures = json.loads(said)
    assert figures["output"] is None
    assert figures["values"]["screen"] == [None] * 3
    assert len(figures["undetermined"]) == 3
    assert figures["undetermined"][0].startswith("R: gain, screen, floor cannot be told")


@pytest.mark.long
@pytest.mark.usefixtures("_coarse")
def test_what_is_known_is_enough(folder, run):
    survey, out = folder / "known.toml", folder / "held.toml"
    known = """
[known]
screen = { value = [0.56, 0.52, 0.48], error = 0.02 }
floor = { value = [0.16, 0.12, 0.1] }
"""
    survey.write_text(SURVEY + shots(NAMES[:2]) + known)
    code, _, complaint = run(survey, "--out", out, "--quiet")
    assert (code, complaint) == (0, "")
    scene = load_dome(out)
    assert scene.theatre.floor.albedo == pytest.approx((0.16, 0.12, 0.1), rel=1e-5)
    assert np.allclose(scene.albedo, (0.56, 0.52, 0.48), atol=0.02)


def test_readings_of_a_meter_are_enough(folder, run):
    survey, out = folder / "meter.toml", folder / "read.toml"
    places = {"cd/m2": (0.05, 6.0), "lux": (0.3, 40.0)}
    rows = [
        f'[[readings]]\npattern = "pattern_{pattern}.exr"\nplace_m = [0.0, 0.0, 4.0]\n'
        f'unit = "{unit}"\nvalue = {values[lit]}\nerror = {values[lit] / 100}\n'
        for unit, values in places.items()
        for lit, pattern in enumerate(("black", "white"))
    ]
    survey.write_text('theatre = "plan.toml"\n' + "".join(rows))
    code, said, _ = run(survey, "--out", out, "--hold", "floor=0.12", "--json")
    assert code == 0
    assert json.loads(said)["values"]["screen"][0] == pytest.approx(np.pi * 5.95 / 39.7, rel=1e-4)
    scene = load_dome(out)
    assert scene.measured.unit == "cd/m2"
    assert 4 < scene.projector.white < 6
    assert scene.ambient == pytest.approx(0.05, rel=1e-3)


@pytest.mark.long
@pytest.mark.usefixtures("_coarse")
def test_photographs_and_a_meter_tell_white(folder, run):
    true = load_dome(folder / "true.toml")
    patterns = patterns_for(true.theatre.dome, 64)
    seen_by_all = radiosity(true.theatre, resolution=8).observation(64, 64)
    light = [seen_by_all.observe(pattern[None])[0] for pattern in patterns[:2]]
    local = true.theatre.dome.points(64, 64)[40, 24] @ true.theatre.dome.to_room.T
    rows = "".join(
        f'\n[[readings]]\npattern = "pattern_{pattern}.exr"\nplace_m = {local.tolist()}\n'
        f'unit = "cd/m2"\nvalue = {value}\nerror = {value / 100}\n'
        for pattern, value in (
            (name, 0.02 + 5.5 * float(true.projector.luminance_weights @ seen[40, 24]))
            for name, seen in zip(NAMES, light, strict=False)
        )
    )
    survey, out, picture = (folder / f"both{end}" for end in (".toml", "_measured.toml", ".png"))
    survey.write_text(SURVEY + shots(NAMES) + rows)
    code, said, _ = run(survey, "--out", out, "--residual", picture, "--json")
    assert code == 0
    figures = json.loads(said)
    white, error = (figures[name]["gain"][0] for name in ("values", "standard_errors"))
    assert_unbiased(white, error, 5.5)
    assert 0.009 < error / white < 0.012
    scene = load_dome(out)
    assert scene.measured.unit == "cd/m2"
    assert scene.projector.white == pytest.approx(white)
    weights = scene.projector.luminance_weights
    assert scene.ambient == pytest.approx(white * (weights @ figures["ambient_of_white"]))
    height, width = imread(picture).shape[:2]
    assert width == len(NAMES) * height
    code, _, complaint = run(survey, "--out", out, "--without-geometry")
    assert code == 2
    assert "takes photographs only; leave the readings out" in complaint


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("floor=-1", "--hold 'floor=-1': wanted gain, screen, floor or wall"),
        ("roof=0.1", "--hold 'roof=0.1': wanted gain"),
        ("floor=0.1,x", "--hold 'floor=0.1,x'"),
        ("wall=0.1", "wall cannot be held: the theatre has gain, screen, floor"),
    ],
)
def test_what_cannot_be_held(folder, run, text, message):
    code, _, complaint = run(folder / "two.toml", "--out", folder / "none.toml", "--hold", text)
    assert code == 2
    assert message in complaint


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("field_deg = 220.0", ""), "a fisheye needs position_m, look_at_m and field_deg"),
        (('"white.exr"', '"gone.exr"'), "gone.exr"),
        (('"plan.toml"', '"dome_imax"'), "wanted a theatre of Lambertian screen, floor and wall"),
        (("exposure", "exposition"), "exposition: is not a key"),
        (("[camera]", "[camera"), "not valid TOML"),
        (("[[photographs]]", "[[pictures]]"), "pictures: is not a key"),
    ],
)
def test_mistakes_of_a_survey_file(folder, run, change, message):
    text = SURVEY + shots(NAMES[:2]) + "exposure = 1.0\n"
    path = folder / "wrong.toml"
    path.write_text(text.replace(*change))
    code, _, complaint = run(path, "--out", folder / "none.toml")
    assert code == 2
    assert message in complaint
    assert not (folder / "none.toml").exists()


def test_a_theatre_that_is_too_much_is_told_before_photographs_are_looked_for(folder, run):
    text = (SURVEY + shots(NAMES[:2])).replace('"plan.toml"', '"dome_planetarium"')
    (folder / "seats.toml").write_text(text.replace(".exr", "-not-taken-yet.exr"))
    code, _, complaint = run(folder / "seats.toml", "--out", folder / "none.toml")
    assert code == 2
    assert "got solids (seats, risers, audience" in complaint
    assert "--without-geometry" in complaint
