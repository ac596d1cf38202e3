"""Cameras of known place that photograph the registration pattern: are they found again?"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import exit_code
from image_files import store
from scipy.spatial.transform import Rotation

from domesim.errors import InputError
from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.file import read_survey
from domesim.measure.dome.registration import registered
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import dome_patterns
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from testing.surveys import theatre_file

DOME = Dome(5.0, np.radians(85), tilt=0.15)
PATTERN = dome_patterns(DOME, Codes(16, floating=False, transfer="linear"), 4)[0]
MARKERS = np.array(
    [
        [marker[name] for name in ("azimuth_deg", "angle_deg", "radius_deg")]
        for marker in PATTERN.parameters["markers"]
    ]
)
LIT = PATTERN.codes(1024, 1024)[0].astype(float)
FISHEYE = Camera((0.3, -0.8, -0.2), (0.3, 0.4, 1.6), np.radians(190), (0.03, -0.02, 0.06))
PINHOLE = Camera(
    (0.3, -2.0, -0.4),
    (0.3, 1.0, 1.6),
    np.radians(95),
    (0.02, 0.03, -0.05),
    mapping="perspective",
    distortion=-0.06,
)


def photograph(camera: Camera, rows=640, cols=640, noise=0.02, lit=LIT):
    """What the camera sees, with stray light and an exit sign."""
    u, v = places_in(rows, cols)
    surface, points = looked_at(Theatre(DOME, (0.5, 0.5, 0.5)), camera, u, v)
    on = surface == SURFACES["screen"]
    row, col = DOME.pixel_of(DOME.toward(points[on]), len(lit))
    light = np.full((rows, cols, 3), 0.6)
    light[on] += lit[row, col]
    light[-30:-24, 200:212] = 1.5
    return light + noise * np.random.default_rng(0).standard_normal(light.shape)


def stated(camera: Camera) -> Camera:
    """The same by a tape measure and a protractor."""
    return replace(
        camera,
        position=tuple(np.add(camera.position, (0.1, -0.12, 0.08))),
        look_at=tuple(np.add(camera.look_at, (0.2, -0.1, 0.15))),
        field=camera.field * 1.02,
        turn=(0.0, 0.0, 0.0),
        distortion=0.0,
    )


def off(found: Camera, camera: Camera, cols: int) -> float:
    """Largest angle between rays of both, degrees."""
    u, v = (part[::16, ::16] for part in places_in(480, cols))
    inside = camera.sees(u, v)
    cosine = np.sum(found.rays(u, v) * camera.rays(u, v), -1)[inside]
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1)).max()))


@pytest.mark.parametrize(
    ("camera", "size"), [(FISHEYE, (640, 640)), (PINHOLE, (480, 640))], ids=["fisheye", "pinhole"]
)
def test_a_camera_is_found_again(camera, size):
    start = stated(camera)
    assert off(start, camera, size[1]) > 2
    found = registered(DOME, MARKERS, photograph(camera, *size), start)
    assert np.abs(np.subtract(found.camera.position, camera.position)).max() < 0.02
    away = np.subtract(found.camera.position, camera.position) / found.position_error
    assert np.abs(away).max() < 5
    assert max(found.position_error) < 0.02
    assert off(found.camera, camera, size[1]) < 0.25
    assert found.rms < np.radians(0.15)
    assert found.dots > 0.8 * found.of
    if camera.mapping == "perspective":
        assert found.camera.distortion == pytest.approx(camera.distortion, abs=0.01)


@pytest.mark.parametrize("camera", [FISHEYE, PINHOLE], ids=["fisheye", "pinhole"])
def test_places_are_where_rays_go(camera):
    u, v = (part[::5, ::5] for part in places_in(48, 64))
    inside = camera.sees(u, v)
    points = np.asarray(camera.position) + 3.0 * camera.rays(u, v)
    again = np.stack(camera.places(points))
    assert np.allclose(again[:, inside], np.stack([u, v])[:, inside], atol=1e-9)


def test_a_pinhole_keeps_straight_lines_and_its_field():
    camera = replace(PINHOLE, distortion=0.0, turn=(0.0, 0.0, 0.0))
    left, middle, right = camera.rays(np.array([-1.0, 0, 1]), np.zeros(3))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(95)
    ahead = np.subtract(camera.look_at, camera.position)
    assert middle == pytest.approx(ahead / np.linalg.norm(ahead))
    assert np.dot(np.cross(left, right), camera.rays(np.array([0.37]), np.zeros(1))[0]) < 1e-12


def test_a_turn_is_a_rotation():
    turn = (0.3, -0.2, 0.5)
    u, v = places_in(8)
    straight = replace(FISHEYE, turn=(0.0, 0.0, 0.0)).rays(u, v)
    turned = replace(FISHEYE, turn=turn).rays(u, v)
    wanted = Rotation.from_rotvec(turn).apply(straight.reshape(-1, 3)).reshape(straight.shape)
    assert np.allclose(turned, wanted)


def test_dots_that_are_not_there_are_told():
    with pytest.raises(InputError, match=r"found \d of \d+ dots where the stated camera"):
        registered(DOME, MARKERS, photograph(FISHEYE, lit=0 * LIT), FISHEYE)


def test_a_camera_that_looks_elsewhere_is_told():
    elsewhere = replace(FISHEYE, look_at=(3.0, -2.0, 1.0))
    with pytest.raises(InputError, match="registration: "):
        registered(DOME, MARKERS, photograph(FISHEYE), elsewhere)


@pytest.mark.parametrize("turn", ["turned", "mirrored"])
def test_a_picture_that_fits_in_another_way_is_told(turn):
    """From the centre the dots' places look the same after quarter turns, and in a mirror."""
    camera = Camera((0.0, 0, 0), tuple(DOME.to_room[:, 2]), np.radians(175))
    seen = photograph(camera, noise=0.005)
    assert registered(DOME, MARKERS, seen, camera).dots == len(MARKERS)
    wrong = np.rot90(seen) if turn == "turned" else seen[:, ::-1]
    with pytest.raises(InputError, match="turned or mirrored"):
        registered(DOME, MARKERS, wrong, camera)


def test_a_fold_is_no_distortion():
    with pytest.raises(InputError, match="k1 must leave the picture unfolded"):
        replace(PINHOLE, distortion=-0.3)


SURVEY = """\
theatre = "theatre.toml"

[camera]
mapping = "perspective"
position_m = [0.4, -2.1, -0.3]
look_at_m = [0.4, 1.0, 1.6]
field_deg = 96.0
registration = "dots.exr"

[[photographs]]
file = "dots.exr"
pattern = "patterns/0001_registration.png"
"""


@pytest.fixture
def folder(tmp_path):
    """A survey of one photograph, of a rectangular picture, with its patterns."""
    (tmp_path / "theatre.toml").write_text(theatre_file(DOME))
    (tmp_path / "survey.toml").write_text(SURVEY)
    store(tmp_path / "dots.exr", photograph(PINHOLE, 480, 640).astype(np.float32))
    made = ("--dome", "--scene", tmp_path / "theatre.toml", "--size", "64")
    assert not exit_code("measure", "patterns", *made, "--out", tmp_path / "patterns", "--quiet")
    return tmp_path


def test_a_survey_takes_the_camera_from_the_registration_pattern(folder):
    task = read_survey(folder / "survey.toml")
    assert task.registered is not None
    assert task.photographs is not None
    camera = task.photographs.camera
    assert np.abs(np.subtract(camera.position, PINHOLE.position)).max() < 0.02
    assert off(camera, PINHOLE, 640) < 0.25
    assert "dots.exr" in task.digests
    assert re.match(r"camera: from \d+ of \d+ dots, 0\.\d\d° rms off", task.registered.in_words())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('mapping = "perspective"', 'mapping = "domemaster"'), "a domemaster has no position_m"),
        (("field_deg = 96.0", ""), "a perspective needs position_m, look_at_m and field_deg"),
        (("field_deg = 96.0", "field_deg = 170.0"), "at most 150 degrees, got 170"),
        (("field_deg = 96.0", "field_deg = 40.0"), "dots.exr: registration: "),
        (('mapping = "perspective"', "k1 = 0.1"), "k1 is of a perspective"),
        (('"dots.exr"\n\n', '"dots.exr"\npatterns = "elsewhere"\n\n'), "patterns.json"),
    ],
)
def test_mistakes_of_a_camera(folder, change, message):
    (folder / "survey.toml").write_text(SURVEY.replace(*change))
    with pytest.raises(InputError, match=re.escape(message)):
        read_survey(folder / "survey.toml")


def test_patterns_of_another_dome_are_refused(folder):
    (folder / "theatre.toml").write_text(theatre_file(replace(DOME, half_angle=np.radians(90))))
    with pytest.raises(InputError, match="half-angle of 90 degrees; write patterns of this"):
        read_survey(folder / "survey.toml")
