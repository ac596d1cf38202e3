"""The orrery: repeatable, in range, moving, and with a left and a right eye that see depth."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import exit_code
from numpy.typing import NDArray

from domesim import commands
from domesim.frames import read_frame
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.plugins import register
from domesim.room.dome import Dome
from scenes.artwork.orrery import hall, orrery
from scenes.artwork.orrery.cameras import DomeView, FlatView, View, views
from scenes.artwork.orrery.orrery import PLANETS, Orrery
from scenes.artwork.orrery.picture import Picture, Settings, Studio

SIZE = 48
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
VIEWS: list[View] = [
    DomeView(),
    DomeView(-0.05, 4.0),
    DomeView(0.05, 4.0),
    FlatView(),
    FlatView(-0.05, 4.0),
    FlatView(0.05, 4.0),
]


@pytest.fixture(scope="module")
def studio() -> Studio:
    """Mono and stereo, of one small hall."""
    return Studio(Settings(size=SIZE, samples=4), {"": DomeView()})


@pytest.fixture(scope="module")
def picture(studio: Studio) -> Picture:
    return studio.frame(0.0)[""]


# What turns.


def test_after_a_loop_everything_is_where_it_was() -> None:
    machine = Orrery(seed=3, loop=20.0)
    for before, after in zip(machine.bodies(1.5), machine.bodies(21.5), strict=True):
        np.testing.assert_allclose(after.centre, before.centre, atol=1e-9)
        np.testing.assert_allclose(after.axes, before.axes, atol=1e-9)
    np.testing.assert_allclose(machine.machine(21.5), machine.machine(1.5), atol=1e-9)
    assert not np.allclose(machine.machine(11.5), machine.machine(1.5), atol=0.1)


def test_planets_keep_to_their_orbits_and_touch_nothing() -> None:
    for time in np.linspace(0.0, 60.0, 97):
        placed = Orrery().bodies(float(time))
        planets = [body for body in placed if body.body in PLANETS]
        for planet in planets:
            distance = np.linalg.norm(planet.centre - orrery.CENTRE)
            assert distance == pytest.approx(planet.body.orbit)
        for first in placed:
            assert first.centre[2] - first.body.radius > 2.0  # over the heads of the audience
            assert np.linalg.norm(first.centre - orrery.CENTRE) > orrery.SUN_RADIUS + 0.2
            assert np.hypot(*first.centre[:2]) < hall.RADIUS - 1.0
            for second in placed:
                apart = np.linalg.norm(first.centre - second.centre)
                assert second is first or apart > first.body.radius + second.body.radius


def test_rings_are_lit_on_the_side_the_audience_sees() -> None:
    for time in np.linspace(0.0, 60.0, 25):
        (ringed,) = (one for one in Orrery().bodies(float(time)) if one.body.name == "ringed")
        axis = ringed.axes[:, 2]
        from_sun = axis @ (orrery.CENTRE - ringed.centre)
        from_audience = axis @ (DomeView.eye - ringed.centre)
        assert from_sun < 0
        assert from_audience < 0


def test_another_seed_starts_elsewhere() -> None:
    first, second = (Orrery(seed=seed).bodies(0.0)[0].centre for seed in (7, 8))
    assert np.linalg.norm(first - second) > 0.05


# Who looks at it.


@pytest.mark.parametrize("view", VIEWS)
def test_places_are_where_directions_point(view: View) -> None:
    toward = view.directions(32)
    row, col = view.places(toward, 32)
    rows, cols = np.indices(view.shape(32)) + 0.5
    inside = view.inside(32)
    np.testing.assert_allclose(row[inside], rows[inside], atol=1e-4)
    np.testing.assert_allclose(col[inside], cols[inside], atol=1e-4)


@pytest.mark.parametrize("view", VIEWS)
def test_sensors_look_in_the_same_directions(view: View) -> None:
    mi = load_mitsuba()
    register(mi)
    row, col = np.nonzero(view.inside(32))
    rows, cols = view.shape(32)
    aim = mi.Point2f(((col + 0.5) / cols).astype("f"), ((row + 0.5) / rows).astype("f"))
    ray, _ = view.sensor(mi, 32).sample_ray(0.0, 0.5, aim, mi.Point2f(0.5))
    np.testing.assert_allclose(np.array(ray.d).T, view.directions(32)[row, col], atol=1e-6)


def seen_at(view: View, point: NDArray[np.float64], size: int = 1000) -> float:
    """Column, pixels, where `point` (xyz) is seen, by search along the row of the middle."""
    mi = load_mitsuba()
    register(mi)
    across = np.linspace(0.3, 0.7, 40001, dtype=np.float32)
    down = 0.75 if isinstance(view, DomeView) else 0.5
    aim = mi.Point2f(across, np.full_like(across, down))
    ray, _ = view.sensor(mi, size).sample_ray(0.0, 0.5, aim, mi.Point2f(0.5))
    origin, toward = np.array(ray.o + 0 * ray.d).T, np.array(ray.d).T
    miss = np.linalg.norm(np.cross(point - origin, toward), axis=1)
    assert miss.min() < 1e-3 * np.linalg.norm(point)
    return float(across[miss.argmin()]) * size


@pytest.mark.parametrize("kind", ["dome-stereo", "stereo"])
def test_what_is_near_has_crossed_parallax_and_what_is_far_has_not(kind: str) -> None:
    left, right = views(kind, interaxial=0.1, convergence=5.0).values()
    if kind == "stereo":
        ahead = FlatView.aim - FlatView.eye
        ahead = ahead / np.linalg.norm(ahead)
        eye = FlatView.eye
    else:
        ahead, eye = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5)]), DomeView.eye
    parallax = [
        seen_at(right, eye + distance * ahead) - seen_at(left, eye + distance * ahead)
        for distance in (2.5, 5.0, 1000.0)
    ]
    assert parallax[0] < -3.0
    assert abs(parallax[1]) < 0.05
    assert parallax[2] > 3.0
    # The stars are drawn as far as that.
    stars = [float(view.places(ahead, 1000)[1]) for view in (left, right)]
    assert stars[1] - stars[0] == pytest.approx(parallax[2], abs=0.2)


def test_infinite_convergence_leaves_the_stars_alone() -> None:
    for kind in ("dome-stereo", "stereo"):
        left, right = views(kind, convergence=np.inf).values()
        np.testing.assert_array_equal(left.directions(16), right.directions(16))


# The pictures.


def test_same_seed_same_picture(studio: Studio, picture: Picture) -> None:
    np.testing.assert_array_equal(studio.frame(0.0)[""], picture)


def test_the_sun_is_bright_in_front_and_most_is_dark(picture: Picture) -> None:
    """The sun is 5 m above the audience's eyes and 3.2 m to the front: 32.6 degrees off zenith."""
    luminance = picture @ LUMINANCE
    circle = Dome(radius=1.0, half_angle=np.pi / 2).inside(SIZE, SIZE)
    row = int((1 + np.arctan2(3.2, 5.0) / (np.pi / 2)) * SIZE / 2)
    assert luminance[row, SIZE // 2 - 1 : SIZE // 2 + 1].min() > 0.5
    assert np.mean(luminance[circle] < 0.03) > 0.4


# The command.

Run = Callable[..., int]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    entry = EntryPoint("master", "scenes.artwork.command:master", "domesim.commands")
    other = EntryPoint("observe", "domesim.commands.observe:observe", "domesim.commands")
    monkeypatch.setattr(commands, "entry_points", lambda group: [entry, other])
    return lambda *arguments: exit_code("master", *arguments)


SMALL = ("--size", 32, "--samples", 1)


def test_command_writes_numbered_frames(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run("--out", tmp_path, "--frames", "3-5x2", *SMALL, "--json") == 0
    names = ["orrery.0003.exr", "orrery.0005.exr"]
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == names
    figures = json.loads(capfd.readouterr().out)
    assert [Path(file).name for frame in figures["frames"] for file in frame["files"]] == names
    assert figures["frames"][1]["time_s"] == pytest.approx(4 / 24)
    frame = read_frame(tmp_path / names[0])
    assert frame.pixels.shape == (32, 32, 3)
    assert (frame.bits, frame.floating) == (16, True)
    assert (frame.colour.transfer, frame.colour.primaries) == ("linear", "BT.709")
    assert frame.colour.source.startswith("file")
    spec = oiio.ImageInput.open(str(tmp_path / names[0])).spec()
    assert spec.get_string_attribute("compression") == "zip"
    assert "seed 7" in spec.get_string_attribute("ImageDescription")
