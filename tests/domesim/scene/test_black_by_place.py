"""Black is the sum of the projectors' that reach a place; overlaps can be hidden; lamps count."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stored_masters import store

from compensate.live.constants import constants_of
from compensate.master import solve_frame
from compensate.pose import Stage, pose
from domesim.errors import InputError
from domesim.frames import read_master
from domesim.measure.dome.measured import projector_section
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tracer import Settings
from domesim.room.dome import Dome
from domesim.room.lenses import field_weight
from domesim.room.theatre import Lamp, Lens, Mask, Theatre
from domesim.room.unlit import lamp_light, projectors_black, uplift
from domesim.room.viewing import large_threshold
from domesim.scene import DomeFile, load_dome, load_scene
from domesim.scene.screening import decoded
from domesim.scene.writing import as_toml

DOME = Dome(5.0, np.radians(90), 0.3)
SIZE = 96
BLACKS = (0.001, 0.002, 0.004, 0.0015, 0.003)


def cove(**more) -> Theatre:
    """Five fisheyes under the rim that throw across, each with a black of its own."""
    lenses = []
    for k, black in enumerate(BLACKS):
        angle = 2 * np.pi * k / 5
        x, y = 4.0 * float(np.sin(angle)), 4.0 * float(np.cos(angle))
        lens = Lens(f"P{k}", (x, y, -0.5), (-x, -y, 3.5), 0.0, field=1.9, blend=0.3)
        lenses.append(replace(lens, black=black))
    return Theatre(DOME, (0.5, 0.4, 0.3), lenses=tuple(lenses), **more)


def scene_content(**projector) -> dict:
    """The same cove as the content of a scene's file; white is 8 cd/m²."""
    units = [
        {
            "name": lens.name,
            "position_m": list(lens.position),
            "look_at_m": list(lens.look_at),
            "field_deg": float(np.degrees(lens.field)),
            "blend_deg": float(np.degrees(lens.blend)),
            "black_cd_m2": 8 * lens.black,
        }
        for lens in cove().lenses
    ]
    return {
        "name": "cove",
        "dome": {"radius_m": 5.0, "tilt_deg": float(np.degrees(0.3))},
        "screen": {"albedo": [0.5, 0.4, 0.3]},
        "projector": {"white_cd_m2": 8.0, "units": units, **projector},
        "viewing": {"adaptation_cd_m2": 1.0},
    }


def reached(lens: Lens, points: np.ndarray) -> np.ndarray:
    """Whether a fisheye's field holds points, by the angle to its axis."""
    axis = np.subtract(lens.look_at, lens.position)
    way = points - np.asarray(lens.position)
    cosine = way @ axis / np.linalg.norm(axis) / np.linalg.norm(way, axis=-1)
    return np.asarray(cosine >= np.cos(lens.field / 2))


def test_a_place_has_the_blacks_of_all_that_reach_it():
    theatre, points = cove(), DOME.points(SIZE, SIZE)
    wanted = sum(lens.black * reached(lens, points) for lens in theatre.lenses)
    black = projectors_black(theatre, SIZE, SIZE)
    on = DOME.inside(SIZE, SIZE)
    assert black[on] == pytest.approx(wanted[on])
    assert not black[~on].any()
    assert len(np.unique(black[on])) > 5


def test_blends_of_glass_dim_black_too():
    theatre = cove()
    lenses = tuple(replace(lens, blends_black=True) for lens in theatre.lenses)
    points, on = DOME.points(SIZE, SIZE), DOME.inside(SIZE, SIZE)
    wanted = sum(lens.black * field_weight(lens, points) for lens in lenses)
    black = projectors_black(replace(theatre, lenses=lenses), SIZE, SIZE)
    assert black[on] == pytest.approx(wanted[on])
    assert black.sum() < projectors_black(theatre, SIZE, SIZE).sum()


def test_what_a_projector_adds_to_its_black_is_seen_where_its_map_has_it():
    lens = Lens("one", (0, 0, 0), (0, 1, 3), 0.0, "perspective", 1.0, 1.0, black=0.001)
    lift = np.zeros((2, 2))
    lift[:, 1] = 0.004  # right of its axis
    theatre = Theatre(
        DOME,
        (0.5,) * 3,
        lenses=(replace(lens, uplift=Mask(lift)), Lens("rest", (0, 0, 0), (0, 0, 1), field=7.0)),
    )
    black, field = (
        projectors_black(theatre, SIZE, SIZE),
        field_weight(lens, DOME.points(SIZE, SIZE)),
    )
    on = DOME.inside(SIZE, SIZE)
    assert np.allclose(black[on & (field == 0)], 0)
    assert black[on & (field > 0)].max() == pytest.approx(0.005)
    assert black[on & (field > 0)].min() == pytest.approx(0.001)
    x = DOME.points(SIZE, SIZE)[..., 0]
    assert x[on & (black > 0.0045)].min() > -0.2


def degrees_apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.sum(first * second, -1), -1, 1)))


def test_overlaps_are_hidden_by_the_least_that_does_it():
    contrast = 0.05
    theatre, hidden = cove(), cove(black_contrast=contrast)
    size = 48
    on, toward = DOME.inside(size, size), DOME.directions(size, size)
    black, lifted = (projectors_black(each, size, size) for each in (theatre, hidden))
    assert np.all(lifted[on] >= black[on] * (1 - 1e-9))
    # Not more than the light of some place demands ...
    fine = 2 * size
    there, bright = DOME.inside(fine, fine), projectors_black(theatre, fine, fine)
    angle = degrees_apart(toward[on][:, None], DOME.directions(fine, fine)[there][None])
    demanded = (bright[there][None] * np.exp(-contrast * angle)).max(1)
    step = np.degrees(DOME.half_angle) * 2 / fine
    np.testing.assert_allclose(lifted[on], demanded, rtol=2 * contrast * step)
    # ... and no less: neighbours differ by what is not seen
    for axis in (0, 1):
        one, other = (np.moveaxis(each, axis, 0) for each in (lifted, on))
        both = other[1:] & other[:-1]
        apart = degrees_apart(*(np.moveaxis(toward, axis, 0)[s] for s in (np.s_[1:], np.s_[:-1])))
        change = np.abs(np.diff(np.log(np.where(other, one, 1)), axis=0))
        assert np.all((change <= contrast * (apart + 1.0))[both])
        steep = np.abs(np.diff(np.log(np.where(on, black, 1)), axis=axis))
        assert steep.max() > 5 * change[both].max()
    assert np.sum(lifted - black) < 0.8 * np.sum((black.max() - black)[on])


def test_nothing_is_lifted_where_black_is_even():
    lens = Lens("one", (0, 0, 0), (0, 0, 1), field=7.0, black=0.002)
    even = Theatre(DOME, (0.5,) * 3, lenses=(lens,), black_contrast=0.02)
    assert np.allclose(uplift(even, DOME.points(SIZE, SIZE)), 0, atol=1e-12)


def test_large_areas_are_seen_by_less_contrast_in_more_light():
    # Crumey's table of C for large targets: a few per cent under a dome, under 1 % by day
    found = large_threshold(np.array([1e-4, 5e-3, 0.1, 10.0, 1000.0]))
    assert np.all(np.diff(found) < 0)
    assert found[1] == pytest.approx(0.0189, rel=0.05)
    assert large_threshold(np.array(0.0)) == large_threshold(np.array(1e-5))


@pytest.mark.parametrize("even", [None, pytest.param("projectors", marks=pytest.mark.long)])
def test_the_black_that_is_seen_is_the_traced_sum_of_the_projectors(even):
    scene = load_dome(scene_content(**({} if even is None else {"even_black": even})))
    theatre, light = scene.theatre, np.zeros((1, SIZE, SIZE, 3), np.float32)
    tracer = None
    traced = np.zeros((SIZE, SIZE, 3))
    points, on = DOME.points(SIZE, SIZE), DOME.inside(SIZE, SIZE)
    parts = [lens.black * reached(lens, points) for lens in theatre.lenses]
    if even:
        parts.append(uplift(theatre, points))
    for k, part in enumerate(parts):
        settings = Settings(error=0.01, seed=k + 1)
        room = PathTracedDome(theatre, SIZE, SIZE, settings, tracer=tracer)
        tracer = room.tracer
        picture = np.repeat((part * on)[None, :, :, None], 3, axis=3)
        traced += room.trace(picture).mean[0]
    seen = scene.observation(SIZE, SIZE).observe(light)[0]
    np.testing.assert_allclose(seen[on], traced[on], rtol=0.02)
    np.testing.assert_allclose(seen[on].mean(0), traced[on].mean(0), rtol=3e-3)
    weights = scene.projector.luminance_weights
    assert scene.projector.black == pytest.approx(
        8 * float(np.average(seen @ weights, weights=DOME.screen_areas(SIZE, SIZE))), rel=0.01
    )
    assert np.allclose(scene.black_frame(SIZE, SIZE), seen, rtol=1e-5, atol=1e-9)


def test_compensation_takes_black_off_place_by_place():
    """Of a grey master nothing of the overlaps is left; by their mean they would be seen."""
    scene = load_dome(scene_content())
    grey = np.where(scene.screen(SIZE, SIZE)[None, :, :, None], np.float32(0.3), 0)
    grey = np.repeat(grey, 3, axis=3).astype(np.float32)
    room = scene.observation(SIZE, SIZE)
    on = scene.screen(SIZE, SIZE)
    projected = pose(grey, scene).subtractive
    np.testing.assert_allclose(room.observe(projected)[0][on], 0.3, rtol=1e-5)
    lenses = tuple(replace(lens, black=0.0) for lens in scene.theatre.lenses)
    by_mean = replace(scene, theatre=replace(scene.theatre, lenses=lenses))
    left = room.observe(pose(grey, by_mean).subtractive)[0][on]
    assert np.ptp(left[:, 0]) > 0.004


def test_frames_hide_overlaps_where_projectors_cannot(tmp_path):
    """A black master's frame makes the black that projectors would have made."""
    lifted, by_projectors = (
        load_dome(scene_content(even_black=each)) for each in ("frames", "projectors")
    )
    black = np.zeros((SIZE, SIZE, 3), np.float32)
    frame = read_master([store(tmp_path / "black.exr", black, "float")])
    posed, out_of_range = Stage(lifted).pose_frame(frame)
    made = solve_frame(frame, posed, out_of_range, "perceptual").outcome().frame
    light = decoded(made, lifted)
    on = lifted.screen(SIZE, SIZE)
    assert light[0][on].min() == pytest.approx(0, abs=1e-6)
    assert light[0][on].max() > 0.3 * max(BLACKS)
    assert not light[0][~on].any()
    seen = lifted.observation(SIZE, SIZE).observe(light)[0][on]
    np.testing.assert_allclose(seen, by_projectors.black_frame(SIZE, SIZE)[on], rtol=2e-3)
    bare = load_dome(scene_content()).observation(SIZE, SIZE)
    none = np.zeros_like(light)
    np.testing.assert_allclose(
        lifted.observation(SIZE, SIZE).observe(none), bare.observe(none), rtol=1e-5
    )
    assert by_projectors.lift(SIZE, SIZE) is None


def test_lamps_light_the_screen_as_traced():
    lamps = (
        Lamp("left", (-3.0, 0.5, -0.5), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1), (0.2, 1.0, 0.4)),
        Lamp("low", (1.0, -2.0, -0.8), (0.3, 0.0, 0.0), (0.0, 0.2, 0.1), (0.5, 0.5, 0.0)),
    )
    theatre = Theatre(DOME, (0.5, 0.4, 0.3), lamps=lamps)
    on = DOME.inside(SIZE, SIZE)
    traced = PathTracedDome(theatre, SIZE, SIZE, Settings(error=0.005, seed=2))
    light = np.full((1, SIZE, SIZE, 3), 1e-3, np.float32)
    found = traced.trace(light).ambient
    assert found is not None
    content = scene_content()
    content["projector"] = {"white_cd_m2": 8.0}
    scene = load_dome(content)
    scene = replace(scene, theatre=replace(scene.theatre, lamps=lamps))
    seen = scene.observation(SIZE, SIZE).observe(np.zeros_like(light))[0]
    assert seen[on].mean(0) == pytest.approx(found.mean[on].mean(0), rel=0.01)
    bright = on & (seen[..., 1] > np.median(seen[on][:, 1]))
    off = seen[bright] / np.maximum(found.mean[bright], 1e-9) - 1
    assert np.abs(np.median(off[:, 1])) < 0.02
    assert (
        lamp_light(theatre, SIZE, SIZE)[on].max() > 3 * lamp_light(theatre, SIZE, SIZE)[on].mean()
    )


@pytest.mark.parametrize(
    ("projector", "units", "message"),
    [
        ({"black_cd_m2": 0.01}, {}, "black_cd_m2: contradicts that of the units"),
        ({}, {"black_cd_m2": None}, "units: black_cd_m2 is missing of P2"),
        ({}, {"uplift": "a.png"}, "shift, mask and uplift: are of a perspective lens"),
        (
            {"units": [], "even_black": "frames"},
            {},
            "even_black: needs black_cd_m2 of each of units",
        ),
    ],
)
def test_what_contradicts_is_refused(projector, units, message):
    content = scene_content(**projector)
    for key, value in units.items():
        unit = content["projector"]["units"][2]
        unit.pop(key, None)
        unit |= {} if value is None else {key: value}
    with pytest.raises(InputError, match=message):
        load_scene(content)


def test_stored_light_stays_where_black_changes():
    one, other = scene_content(), scene_content(even_black="projectors")
    for unit in other["projector"]["units"]:
        unit |= {"black_cd_m2": 0.5, "blends_black": True}
    assert DomeFile.model_validate(other).digest == DomeFile.model_validate(one).digest


def test_a_measured_black_keeps_the_projectors_shares():
    """A survey measures the mean; units keep how they share it."""
    content = scene_content()
    task = SimpleNamespace(scene=load_dome(content), content=content, absolute=False)
    black = 1.5 * task.scene.projector.black / 8
    section = projector_section(task, 8.0, np.ones(3), np.full(3, black))
    measured = load_dome({**content, "projector": section})
    assert measured.projector.black == pytest.approx(8 * black)
    blacks = [lens.black for lens in measured.theatre.lenses]
    assert blacks == pytest.approx([1.5 * each for each in BLACKS])


def test_live_refuses_black_that_has_places():
    scene = load_dome(scene_content())
    with pytest.raises(InputError, match="whose black is the same all over"):
        constants_of(scene, 64, 64)


@pytest.mark.long
def test_check_tells_of_black_by_place(tmp_path, run):
    path = tmp_path / "cove.toml"
    path.write_text(as_toml(scene_content()))
    assert "Overlaps in black: their edges are seen." in run("scene", "check", path).out
    told = run("scene", "check", path, "--json").figures()
    assert told["black_most_cd_m2"] > 2 * told["black_least_cd_m2"] > 0
