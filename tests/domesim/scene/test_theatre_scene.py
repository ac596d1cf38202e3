"""Whole theatres as scene files: what becomes of each section, and what is refused."""

from __future__ import annotations

import re
import textwrap
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from domesim.errors import InputError
from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import ClosedFormDome
from domesim.observation.transport import Transport
from domesim.room.dome import Dome
from domesim.room.furniture import EYE_HEIGHT, box
from domesim.room.lenses import lens_gains, seen_gain
from domesim.room.theatre import Cavity, Floor, Lamp, Lobe, Theatre, Wall
from domesim.scene import DomeFile, Scene, load_scene, scene_names
from domesim.scene.loading import scene_content
from domesim.scene.writing import as_toml

BARE = """
name = "bare"
[dome]
radius_m = 8.0
[screen]
albedo = [0.4, 0.5, 0.6]
[projector]
white_cd_m2 = 10.0
[viewing]
adaptation_cd_m2 = 1.0
"""

FULL = """
name = "full"
description = "All that a scene can have."
[dome]
radius_m = 8.0
half_angle_deg = 100.0
tilt_deg = 12.0
height_ratio = 0.9
truncated_below_m = -0.5
[screen]
albedo = [0.4, 0.5, 0.6]
perforation = 0.2
[screen.lobe]
share = 0.25
roughness = 0.3
[screen.cavity]
depth_m = 0.7
albedo = 0.1
back_albedo = [0.2, 0.3, 0.4]
[floor]
height_m = -3.0
albedo = [0.1, 0.2, 0.3]
[wall]
albedo = 0.15
top_m = -0.6
[seating]
rows = 3
seats_per_row = 5
first_row_m = 1.5
rise_m = 0.2
albedo = 0.05
occupied = 0.4
audience_albedo = [0.3, 0.2, 0.1]
seed = 4
[[boxes]]
name = "booth"
low_m = [-1.0, -6.0, -3.0]
high_m = [1.0, -5.0, -1.0]
albedo = 0.12
[[meshes]]
name = "star ball"
file = "things/ball.stl"
albedo = 0.3
[[lamps]]
name = "exit"
position_m = [-7.0, -2.0, -1.0]
normal = [2.0, 0.5, -0.1]
width_m = 0.4
height_m = 0.1
luminance_cd_m2 = [0.0, 20.0, 4.0]
[viewpoints.booth]
position_m = [0.0, -4.5, -1.5]
look_at_m = [0.0, 4.0, 3.0]
field_deg = 80.0
[projector]
primaries = "P3-D65"
lumens = 9000.0
black_cd_m2 = 0.002
[projector.lens]
corrected = false
[[projector.units]]
name = "left"
position_m = [-3.0, 0.0, -0.4]
look_at_m = [1.0, 0.0, 7.0]
field_deg = 340.0
blend_deg = 20.0
[[projector.units]]
name = "right"
position_m = [3.0, 0.5, -0.4]
look_at_m = [-1.0, 0.0, 6.0]
kind = "perspective"
field_deg = 120.0
aspect = 1.5
roll_deg = 5.0
blend_deg = 6.0
[ambient]
luminance_cd_m2 = 0.01
[viewing]
adaptation_cd_m2 = 1.0
"""


def load(folder: Path, text: str) -> Scene:
    (folder / "things").mkdir(exist_ok=True)
    trimesh.creation.icosphere(subdivisions=1, radius=0.5).export(folder / "things" / "ball.stl")
    (folder / "mine.toml").write_text(text)
    return load_scene(folder / "mine.toml")


def changed(text: str, *changes: tuple[str, str]) -> str:
    for before, after in changes:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    return text


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return load(tmp_path_factory.mktemp("full"), FULL)


# What becomes of it


def test_the_screen_is_as_described(full: Scene) -> None:
    assert full.dome == Dome(8.0, np.radians(100), np.radians(12), 0.9, -0.5)
    theatre = full.theatre
    assert theatre.albedo == (0.4, 0.5, 0.6)
    assert theatre.perforation == 0.2
    assert full.albedo == theatre.screen_albedo == pytest.approx((0.32, 0.4, 0.48))
    assert theatre.lobe == Lobe(0.25, 0.3)
    assert theatre.cavity == Cavity(0.7, (0.1, 0.1, 0.1), (0.2, 0.3, 0.4))
    assert not theatre.lambertian
    assert not theatre.corrected


def test_floor_and_wall_meet(full: Scene) -> None:
    theatre = full.theatre
    reach = theatre.dome.widest
    assert theatre.floor == Floor(-3.0, reach, (0.1, 0.2, 0.3))
    assert theatre.wall == Wall(reach, -3.0, -0.6, (0.15, 0.15, 0.15))


@pytest.mark.parametrize(
    ("sections", "floor", "wall"),
    [
        ("[floor]\nheight_m = -2.0", (-2.0, 8.0), None),
        ("[floor]\nheight_m = -2.0\nradius_m = 3.0", (-2.0, 3.0), None),
        ("[floor]\nheight_m = -2.0\n[wall]\nalbedo = 0.1", (-2.0, 8.0), (8.0, -2.0, 0.0)),
        (
            "[floor]\nheight_m = -2.0\n[wall]\nalbedo = 0.1\nradius_m = 9.0\ntop_m = 1.0",
            (-2.0, 9.0),
            (9.0, -2.0, 1.0),
        ),
        (
            "[floor]\nheight_m = -2.0\nradius_m = 5.0\n[wall]\nalbedo = 0.1\nradius_m = 9.0",
            (-2.0, 5.0),
            (9.0, -2.0, 0.0),
        ),
        ("[floor]\nheight_m = 0.5\n[wall]\nalbedo = 0.1", (0.5, 8.0), None),  # no room for it
    ],
)
def test_walls_stand_on_the_floor_and_reach_the_screen(
    sections: str, floor: Any, wall: Any, tmp_path: Path
) -> None:
    text = changed(sections, ("[floor]", "[floor]\nalbedo = 0.2"))
    theatre = load(tmp_path, BARE + text).theatre
    assert theatre.floor is not None
    assert (theatre.floor.height, theatre.floor.radius) == pytest.approx(floor)
    if wall is None:
        assert theatre.wall is None
    else:
        assert theatre.wall is not None
        found = theatre.wall.radius, theatre.wall.bottom, theatre.wall.top
        assert found == pytest.approx(wall, abs=1e-12)


def test_a_leaning_domes_wall_ends_at_its_lowest_point(tmp_path: Path) -> None:
    text = changed(BARE, ("radius_m = 8.0", "radius_m = 8.0\ntilt_deg = 20.0"))
    text += "[floor]\nheight_m = -4.0\nalbedo = 0.1\n[wall]\nalbedo = 0.1\n"
    wall = load(tmp_path, text).theatre.wall
    assert wall is not None
    assert wall.top == pytest.approx(-8 * np.sin(np.radians(20)), rel=1e-6)


def test_things_stand_where_they_should(full: Scene) -> None:
    solids = {solid.name: solid for solid in full.theatre.solids}
    assert list(solids) == ["seats", "risers", "audience", "booth", "star ball"]
    assert solids["seats"].albedo == (0.05, 0.05, 0.05)
    assert solids["audience"].albedo == (0.3, 0.2, 0.1)
    assert solids["seats"].vertices[:, 2].min() == pytest.approx(-3.0)
    booth = box("booth", (-1.0, -6.0, -3.0), (1.0, -5.0, -1.0), (0.12, 0.12, 0.12))
    np.testing.assert_array_equal(solids["booth"].vertices, booth.vertices)
    assert solids["booth"].albedo == booth.albedo
    ball = solids["star ball"]
    assert np.linalg.norm(ball.vertices, axis=-1) == pytest.approx(0.5, rel=1e-6)
    assert len(ball.faces) == 80
    assert np.hypot(*solids["seats"].vertices[:, :2].T).max() < full.theatre.floor.radius  # type: ignore[union-attr]


def test_viewpoints_are_the_seats_and_those_that_are_named(full: Scene) -> None:
    views = full.theatre.viewpoints
    booth = views["booth"]
    assert booth.position == (0.0, -4.5, -1.5)
    assert booth.look_at == (0.0, 4.0, 3.0)
    assert booth.field == pytest.approx(np.radians(80))
    assert views["row1-seat3"].position == pytest.approx((0.0, 1.5, -3.0 + EYE_HEIGHT))
    assert views["front"] == views["row1-seat3"]
    # Seats look at the middle of the screen's front half, on the ellipsoid.
    x, y, z = views["front"].look_at
    back = full.dome.to_room.T @ [x, y, z]
    assert np.hypot(back[0] / 8, back[1] / 8) ** 2 + (back[2] / 7.2) ** 2 == pytest.approx(1)
    assert x == pytest.approx(0, abs=1e-12)
    assert np.degrees(np.arctan2(back[1], back[2])) == pytest.approx(50)


def test_a_named_viewpoint_replaces_a_seats(tmp_path: Path) -> None:
    view = "[viewpoints.front]\nposition_m = [1.0, 1.0, 0.0]\nlook_at_m = [0.0, 9.0, 0.0]\n"
    views = load(tmp_path, FULL + view).theatre.viewpoints
    assert views["front"].position == (1.0, 1.0, 0.0)
    assert views["back"].position != views["front"].position


def test_a_lamp_shines_along_its_normal_in_units_of_white(full: Scene) -> None:
    (lamp,) = full.theatre.lamps
    normal = np.cross(lamp.across, lamp.up)
    assert normal / np.linalg.norm(normal) == pytest.approx(
        np.array([2.0, 0.5, -0.1]) / np.linalg.norm([2.0, 0.5, -0.1])
    )
    assert 2 * np.linalg.norm(lamp.across) == pytest.approx(0.4)
    assert 2 * np.linalg.norm(lamp.up) == pytest.approx(0.1)
    assert lamp.across[2] == pytest.approx(0, abs=1e-12)  # upright
    assert lamp.up[2] > 0
    assert lamp.centre == (-7.0, -2.0, -1.0)
    white = full.projector.white
    assert lamp.luminance == pytest.approx((0.0, 20.0 / white, 4.0 / white))


def test_a_lamp_may_shine_straight_down(tmp_path: Path) -> None:
    text = changed(FULL, ("normal = [2.0, 0.5, -0.1]", "normal = [0.0, 0.0, -3.0]"))
    (lamp,) = load(tmp_path, text).theatre.lamps
    assert np.cross(lamp.across, lamp.up) / (0.2 * 0.05) == pytest.approx([0, 0, -1])


def test_lumens_spread_over_the_screen(full: Scene, tmp_path: Path) -> None:
    """A patch of white light E shows L = rho (1 - t) E / pi, weighted by primaries' luminances."""
    # Rec. P3-D65's luminances
    weights = np.array([0.2289746, 0.6917385, 0.0792869])
    irradiance = full.projector.white * np.pi / (weights @ [0.32, 0.4, 0.48])
    assert not full.theatre.corrected
    gain = lens_gains(full.theatre, 200, 200).sum(0)
    lumens = np.sum(full.dome.screen_areas(200, 200) * gain * irradiance)
    assert lumens == pytest.approx(9000, rel=5e-3)
    assert load(tmp_path, BARE).projector.white == 10


def test_projectors_are_aimed_as_described(full: Scene) -> None:
    left, right = full.theatre.lenses
    assert (left.name, left.kind, left.position) == ("left", "equidistant", (-3.0, 0.0, -0.4))
    assert (left.field, left.blend) == pytest.approx(np.radians((340, 20)))
    assert (right.kind, right.look_at, right.aspect) == ("perspective", (-1.0, 0.0, 6.0), 1.5)
    assert (right.field, right.roll, right.blend) == pytest.approx(np.radians((120, 5, 6)))
    gain = lens_gains(full.theatre, 9, 9).sum(0)
    seen = full.observation(9, 9)
    white = np.ones((1, 9, 9, 3))
    slant = seen_gain(full.theatre, lens_gains(full.theatre, 9, 9))
    assert seen.direct(white)[0, ..., 1] == pytest.approx(slant)
    assert np.ptp(gain[full.dome.inside(9, 9)]) > 0.1
    black = np.zeros((1, 9, 9, 3))
    expected = (0.002 + 0.01) / full.projector.white
    dark = seen.observe(black)[0, 4, 4]
    assert dark[0] == pytest.approx(expected)  # the lamp has no red
    assert dark[1] > 1.02 * dark[0]


def test_a_single_lens_leans_with_the_dome(tmp_path: Path) -> None:
    lens = "[projector.lens]\nposition_m = [0.5, 1.0, -0.3]\ncorrected = false\n"
    text = changed(BARE, ("radius_m = 8.0", "radius_m = 8.0\ntilt_deg = 30.0"))
    scene = load(tmp_path, text + lens)
    (found,) = scene.theatre.lenses
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    assert found.position == pytest.approx((0.5, c * 1.0 + s * -0.3, c * -0.3 - s * 1.0))
    expected = scene.dome.lens_gain(9, 9, (0.5, 1.0, -0.3))
    on = scene.dome.inside(9, 9)
    assert scene.observation(9, 9).factors.direct_gain[on] == pytest.approx(expected[on])


@pytest.mark.parametrize("lens", ["", "[projector.lens]\nposition_m = [0.5, 1.0, -0.3]\n"])
def test_a_corrected_lens_lights_evenly(lens: str, tmp_path: Path) -> None:
    scene = load(tmp_path, BARE + lens)
    assert scene.observation(9, 9).factors.direct_gain == pytest.approx(1)


@pytest.mark.parametrize("name", [name for name in scene_names() if name.startswith("dome")])
def test_bundled_theatres_can_be_built(name: str) -> None:
    scene = load_scene(name)
    theatre = scene.theatre
    assert scene.observation(32, 32).shape == (scene.views, 32, 32, 3)
    assert lens_gains(theatre, 32, 32).sum(0)[scene.dome.inside(32, 32)].min() > 0
    bare = name in ("dome_hemisphere", "dome_stereo_polarised", "dome_stereo_spectral")
    assert (scene.approximation is None) == bare
    assert bool(theatre.departures()) != bare
    if theatre.floor is not None:
        for solid in theatre.solids:
            assert solid.vertices[:, 2].min() >= theatre.floor.height - 1e-9
            assert np.hypot(*solid.vertices[:, :2].T).max() <= theatre.floor.radius
        assert {"front", "centre", "back"} <= set(theatre.viewpoints)
    for view in theatre.viewpoints.values():
        assert np.linalg.norm(view.position) < theatre.dome.radius


# What is refused


SECTIONS = {
    "unit": """
        [[projector.units]]
        name = "one"
        position_m = [0.0, 0.0, 0.0]
        look_at_m = [0.0, 0.0, 5.0]
        field_deg = 200.0
    """,
    "floor": """
        [floor]
        height_m = -2.0
        albedo = 0.1
    """,
    "wall": """
        [wall]
        albedo = 0.1
    """,
    "seating": """
        [seating]
        rows = 2
        seats_per_row = 4
        first_row_m = 1.0
        albedo = 0.1
    """,
    "box": """
        [[boxes]]
        name = "booth"
        low_m = [-1.0, -6.0, -3.0]
        high_m = [1.0, -5.0, -1.0]
        albedo = 0.1
    """,
    "mesh": """
        [[meshes]]
        name = "star ball"
        file = "things/ball.stl"
        albedo = 0.3
    """,
    "lamp": """
        [[lamps]]
        name = "exit"
        position_m = [-7.0, -2.0, -1.0]
        normal = [1.0, 0.0, 0.0]
        width_m = 0.4
        height_m = 0.1
        luminance_cd_m2 = 3.0
    """,
    "view": """
        [viewpoints."the booth"]
        position_m = [0.0, -4.5, -1.5]
        look_at_m = [0.0, 4.0, 3.0]
    """,
    "screen": """
        [screen.lobe]
        share = 0.2
        roughness = 0.3
        [screen.cavity]
        depth_m = 0.5
        albedo = 0.1
    """,
}


def with_sections(*names: str) -> str:
    return BARE + "".join(textwrap.dedent(SECTIONS[name]) for name in names)


# (sections, before, after, path, what is said)
MISTAKES = [
    ((), "radius_m = 8.0", "radius_m = 8.0\ntruncated_below_m = 8", "dome", "no screen is left"),
    ((), "radius_m = 8.0", "radius_m = 0.001", "dome.radius_m", "at least 0.01, got 0.001"),
    (("floor",), "height_m = -2.0", "height_m = nan", "floor.height_m", "finite number, got nan"),
    (("floor",), "albedo = 0.1", "albedo = [0.1, 0.2]", "floor.albedo[2]", "is missing"),
    (("wall",), "[wall]", "[wall]", "wall", "needs a [floor] to stand on, got none"),
    (("seating",), "[seating]", "[seating]", "seating", "needs a [floor] to stand on, got none"),
    (
        ("floor", "wall"),
        "[wall]",
        "[wall]\ntop_m = -2.5",
        "wall.top_m",
        "must be above the floor (-2 m), got -2.5",
    ),
    (("box",), "high_m = [1.0", "high_m = [-1.0", "boxes[0].high_m", "above low_m in x, y and z"),
    (("box", "box"), None, "", "boxes[1].name", "is missing"),
    (
        ("lamp",),
        "normal = [1.0, 0.0, 0.0]",
        "normal = [0, 0, 0]",
        "lamps[0].normal",
        "have a length",
    ),
    (
        ("view",),
        "look_at_m = [0.0, 4.0, 3.0]",
        "look_at_m = [0.0, -4.5, -1.5]",
        'viewpoints."the booth".look_at_m',
        "must be another place than position_m",
    ),
    (("view",), "look_at_m", "lookat_m", 'viewpoints."the booth".lookat_m', "mean 'look_at_m'"),
    (
        ("unit",),
        "look_at_m = [0.0, 0.0, 5.0]",
        "look_at_m = [0.0, 0.0, 0.0]",
        "projector.units[0].look_at_m",
        "must be another place than position_m",
    ),
    (
        ("unit",),
        "position_m = [0.0, 0.0, 0.0]",
        "position_m = [0.0, 0.0, -9.0]",
        "projector.units[0].position_m",
        "must be inside the sphere of radius 8 m, got 9 m",
    ),
    (("unit",), "200.0", "200\nkind = 'flat'", "projector.units[0].kind", "or 'perspective', got"),
    (
        ("unit",),
        "200.0",
        "200\nkind = 'perspective'",
        "projector.units[0]",
        "field_deg: a perspective lens sees less than 175 degrees, got 200",
    ),
    ((), "white_cd_m2 = 10.0", "white_cd_m2 = 1\nlumens = 9", "projector.lumens", "contradicts"),
    ((), "white_cd_m2 = 10.0", "", "projector.lumens", "is missing, and so is white_cd_m2"),
    (
        (),
        "white_cd_m2 = 10.0",
        "white_cd_m2 = 1\nlens.position_m = [0, 8, 0]",
        "projector.lens.position_m",
        "must be inside the sphere of radius 8 m, got 8 m",
    ),
]


@pytest.mark.parametrize(
    ("sections", "before", "after", "path", "said"),
    MISTAKES,
    ids=[f"{m[3]}: {m[4]}" for m in MISTAKES],
)
def test_each_mistake_is_refused_with_its_path(
    sections: tuple[str, ...], before: str | None, after: str, path: str, said: str, tmp_path: Path
) -> None:
    text = with_sections(*sections)
    if before is None:  # the last of two
        text = "".join(text.rsplit('name = "booth"\n', 1))
    else:
        text = text.replace(before, after, 1) if before in BARE else changed(text, (before, after))
    with pytest.raises(InputError) as error:
        load(tmp_path, text)
    lines = [line.strip() for line in str(error.value).splitlines()]
    if len(lines) == 1:
        lines = [lines[0].removeprefix(f"{tmp_path / 'mine.toml'}: ")]
    assert any(line.startswith(f"{path}: ") and said in line for line in lines), lines


def test_the_same_sections_without_mistakes_are_a_theatre(tmp_path: Path) -> None:
    theatre = load(tmp_path, with_sections(*SECTIONS)).theatre
    assert {solid.name for solid in theatre.solids} == {"seats", "booth", "star ball"}
    assert "the booth" in theatre.viewpoints
    assert theatre.wall is not None


def test_all_mistakes_are_listed_in_one_go(tmp_path: Path) -> None:
    """Those between sections, too."""
    text = changed(
        with_sections("unit", "unit", "wall", "seating", "box", "lamp", "view", "screen"),
        ("share = 0.2", "share = 2"),
        ("rows = 2", "rows = 0"),
        ("high_m = [1.0", "high_m = [-2.0"),
        ("normal = [1.0, 0.0, 0.0]", "normal = [0, 0, 0]"),
        ("look_at_m = [0.0, 4.0, 3.0]", "look_at_m = [0.0, -4.5, -1.5]"),
        ("adaptation_cd_m2 = 1.0", "adaptation_cd_m2 = 'bright'"),
    )
    text = text.replace("position_m = [0.0, 0.0, 0.0]", "position_m = [0.0, 0.0, 9.0]")
    with pytest.raises(InputError) as error:
        load(tmp_path, text)
    head, *lines = str(error.value).splitlines()
    assert head == f"{tmp_path / 'mine.toml'} has {len(lines)} mistakes:"
    assert sorted(line.split(": ")[0].strip() for line in lines) == sorted(
        [
            "screen.lobe.share",
            "projector.units[0].position_m",
            "projector.units[1].position_m",
            "wall",
            "seating.rows",
            "boxes[0].high_m",
            "lamps[0].normal",
            'viewpoints."the booth".look_at_m',
            "viewing.adaptation_cd_m2",
        ]
    )


def test_a_changed_scene_finds_its_meshes_from_anywhere(tmp_path: Path) -> None:
    wanted = load(tmp_path, with_sections("mesh"))
    content = scene_content(tmp_path / "mine.toml")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "ours.toml").write_text(as_toml(content))
    found = load_scene(tmp_path / "elsewhere" / "ours.toml")
    assert len(found.theatre.solids) == len(wanted.theatre.solids) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            with_sections("mesh").replace("ball.stl", "cube.stl"),
            "cube.stl: wanted the mesh of",
        ),
        (with_sections("floor", "seating").replace("= 1.0\nalb", "= 90.0\nalb"), "room for a seat"),
        (
            BARE.replace("[0.4, 0.5, 0.6]", "0").replace("white_cd_m2", "lumens"),
            "white must",
        ),
        (
            BARE.replace("[0.4, 0.5, 0.6]", "[0.4, 1.0, 0.6]").replace(
                "[screen]", "half_angle_deg = 180\n[screen]"
            ),
            "a closed sphere of albedo 1 never loses light",
        ),
    ],
    ids=["no mesh", "no seat fits", "no light", "no loss"],
)
def test_what_can_not_be_built_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as error:
        load(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'mine.toml'}: ")
    assert "\n" not in str(error.value)


def test_a_lens_must_be_inside_the_ellipsoid_itself(tmp_path: Path) -> None:
    """A flat dome leaves less room below its zenith than the sphere, a tall one more."""
    text = BARE + "[projector.lens]\nposition_m = [0.0, 0.0, 5.0]\ncorrected = false\n"
    flat = changed(text, ("radius_m = 8.0", "radius_m = 8.0\nheight_ratio = 0.5"))
    with pytest.raises(InputError, match=r"lens\.position_m: must be inside the ellipsoid"):
        load(tmp_path, flat)
    tall = changed(text, ("5.0]", "9.0]"), ("radius_m = 8.0", "radius_m = 8.0\nheight_ratio = 1.5"))
    assert load(tmp_path, tall).theatre.lenses[0].position == pytest.approx((0, 0, 9))


def test_projectors_that_leave_the_screen_dark_are_refused(tmp_path: Path) -> None:
    scene = load(tmp_path, with_sections("unit").replace("200.0", "90.0"))
    with pytest.raises(InputError, match=r"projectors leave 7\d\.\d% of the screen dark"):
        scene.observation(32, 32)


# How far the closed form holds


HEMISPHERE = Theatre(Dome(8.0, np.pi / 2), (0.5, 0.5, 0.5))
SOME, NONE = (0.0, 0.1, 0.0), (0.0, 0.0, 0.0)
CHAIR = box("a chair", (-1.0, -1.0, -3.0), (1.0, 1.0, -2.0), SOME)


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        ({}, []),
        ({"dome": Dome(8.0, 1.9, 0.2, truncated_below=-0.3)}, []),  # still a part of a sphere
        (
            {"dome": Dome(8.0, 1.5, height_ratio=0.8)},
            ["ellipsoid of height ratio 0.8, not a"],
        ),
        ({"lobe": Lobe(0.15, 0.3)}, ["15% of the screen's light is in a gain lobe"]),
        ({"perforation": 0.2}, []),  # black behind
        ({"perforation": 0.2, "cavity": Cavity(0.5, SOME, NONE)}, ["comes back from the cavity"]),
        ({"floor": Floor(-1.0, 8.0, SOME)}, [r"the floor reflects \(albedo 0.1\)"]),
        ({"floor": Floor(0.5, 8.0, NONE)}, ["the floor hides a part of the screen"]),
        ({"wall": Wall(8.0, -1.0, 0.0, SOME)}, [r"the wall reflects \(albedo 0.1\)"]),
        ({"wall": Wall(7.5, -1.0, 2.0, NONE)}, ["the wall hides a part of the screen"]),
        ({"solids": (CHAIR, CHAIR)}, [r"things stand in the room \(a chair\)"]),
        (
            {
                "lamps": (Lamp("exit", (0, 0, 0), (1, 0, 0), (0, 1, 0), SOME),),
                "solids": (CHAIR,),
            },
            [r"things stand in the room", r"things stand in the light of lamps \(exit\)"],
        ),
        ({"lamps": (Lamp("exit", (0, 0, 0), (1, 0, 0), (0, 1, 0), SOME),)}, []),
        (
            {"lobe": Lobe(1.0, 0.3), "solids": (CHAIR,), "floor": Floor(1.0, 3.0, SOME)},
            ["gain lobe", "the floor reflects", "the floor hides", "things stand in the room"],
        ),
    ],
)
def test_each_breach_of_the_closed_form_has_its_reason(
    changes: dict[str, Any], reasons: list[str]
) -> None:
    found = replace(HEMISPHERE, **changes).departures()
    assert len(found) == len(reasons), found
    for reason, pattern in zip(found, reasons, strict=True):
        assert re.search(pattern, reason)


def stored_for(dome: Dome, **provenance: Any) -> Transport:
    """Two modes, so that it shows that it is not the closed form."""
    nodes = 15
    modes = np.stack([np.ones((nodes, nodes)), np.linspace(-1, 1, nodes)[:, None].repeat(nodes, 1)])
    core = np.array([[[0.6, 0.1], [0.2, 0.3]]] * 3)
    ambient = np.full((3, nodes, nodes), 0.02)
    return Transport(dome, modes, core, 0 * core, ambient, provenance)


MATT = changed(FULL, ("[screen.lobe]\nshare = 0.25\nroughness = 0.3\n", ""))


@pytest.mark.parametrize("text", [FULL, MATT], ids=["glossy", "matt"])
def test_a_transport_makes_it_nearly_exact(text: str, tmp_path: Path) -> None:
    scene = load(tmp_path, text)
    assert scene.approximation is not None
    stored = stored_for(scene.dome, scene="full", digest=scene.digest)
    exact = scene.with_transport(stored)
    assert "a ghost of the picture shines back" in str(exact.approximation)
    assert "domesim tabulate" not in str(exact.approximation)
    assert scene.approximation is not None  # that one is as it was
    seen = exact.observation(9, 9)
    gains = lens_gains(scene.theatre, 9, 9)
    slant = gains.sum(0) if text is MATT else seen_gain(scene.theatre, gains)
    black = scene.ambient / scene.projector.white
    expected = stored.observation(9, 9, lens_gain=gains.sum(0), seen_gain=slant, ambient=black)
    x = np.random.default_rng(0).random((1, 9, 9, 3))
    assert seen.observe(x) == pytest.approx(expected.observe(x), abs=2e-3)
    by_radiosity = scene.observation(9, 9)
    assert np.abs(seen.observe(x) - by_radiosity.observe(x)).max() > 0.02


def test_a_dome_that_is_no_sphere_is_asked_by_radiosity(tmp_path: Path) -> None:
    """Its reflected light is near the finest solution's, and far from the closed form's."""
    flat = changed(BARE, ("radius_m = 8.0", "radius_m = 8.0\nheight_ratio = 0.8"))
    scene = load(tmp_path, flat)
    assert scene.approximation is None
    assert "radiosity" in scene.facts()["Model"]
    assert scene.known is load(tmp_path, flat).known  # computed once
    white = np.ones((1, 32, 32, 3))
    fine = radiosity(scene.theatre, resolution=10).observation(32, 32).observe(white) - white
    found = scene.observation(32, 32).observe(white) - white
    on = scene.screen(32, 32)
    np.testing.assert_allclose(found[0, on], fine[0, on], rtol=0.02)
    closed = ClosedFormDome(scene.dome, 32, 32, albedo=scene.albedo).observe(white) - white
    assert np.abs(closed[0, on] / found[0, on] - 1).max() > 0.1
    seated = load(tmp_path, flat + "[[boxes]]\nname = 'desk'\nlow_m = [0, 0, 0]\n"
                  "high_m = [1, 1, 1]\nalbedo = 0.3\n")  # fmt: skip
    assert "radiosity knows screen, floor and wall only" in str(seated.approximation)
    assert seated.facts()["Left out"] == "solids (desk)"
    assert load(tmp_path, BARE).known is None


def test_a_bare_screen_is_exact(tmp_path: Path) -> None:
    scene = load(tmp_path, BARE)
    assert scene.theatre.departures() == ()
    assert scene.approximation is None
    assert scene.transport is None
    # A transport of unknown origin may be used if the dome is the same.
    stored = scene.with_transport(stored_for(scene.dome))
    assert stored.transport is not None
    assert stored.approximation is None
    shadowed = scene.with_transport(stored_for(scene.dome, shadowed=0.03))
    assert "3.0% of the screen lies in shadows" in str(shadowed.approximation)


@pytest.mark.parametrize(
    "change",
    [
        ("radius_m = 8.0", "radius_m = 8.1"),
        ("truncated_below_m = -0.5", ""),
    ],
)
def test_another_domes_transport_is_refused(
    change: tuple[str, str], full: Scene, tmp_path: Path
) -> None:
    other = load(tmp_path, changed(FULL, change))
    for provenance in ({}, {"scene": "full", "digest": other.digest}):
        again = f"run domesim tabulate {re.escape(other.file)} again"
        with pytest.raises(InputError, match=again):
            other.with_transport(stored_for(full.dome, **provenance))


def test_a_transport_from_before_a_change_is_refused(full: Scene, tmp_path: Path) -> None:
    stored = stored_for(full.dome, scene="full", digest=full.digest)
    other = load(tmp_path, changed(FULL, ("rows = 3", "rows = 4")))
    with pytest.raises(InputError, match="of 'full', or of 'full' before it was changed"):
        other.with_transport(stored)


SAME = [
    ('name = "full"\n', 'name = "renamed"\n'),
    ("[dome]", "# a comment\n[dome]"),
    ("radius_m = 8.0", "radius_m = 8"),
    ("half_angle_deg = 100.0\ntilt_deg = 12.0", "tilt_deg = 12.0\nhalf_angle_deg = 100.0"),
    ('description = "All that a scene can have."', ""),
    ("black_cd_m2 = 0.002", "black_cd_m2 = 0.003"),
    ("luminance_cd_m2 = 0.01", "luminance_cd_m2 = 0.02"),
    ("adaptation_cd_m2 = 1.0", "adaptation_cd_m2 = 2.0"),
    ("field_deg = 80.0", "field_deg = 70.0"),
    ("adaptation_cd_m2 = 1.0\n", 'adaptation_cd_m2 = 1.0\n[sources]\n"all" = "chosen"\n'),
]


@pytest.mark.parametrize("change", SAME)
def test_what_light_does_not_depend_on_leaves_the_digest(
    change: tuple[str, str], full: Scene, tmp_path: Path
) -> None:
    assert load(tmp_path, changed(FULL, change)).digest == full.digest


def test_every_figure_of_the_theatre_is_in_the_digest() -> None:
    """Each number of the file, changed a little, but for those that light does not depend on."""
    digest = DomeFile.model_validate(tomllib.loads(FULL)).digest
    spared = {"viewing", "viewpoints", "ambient"}
    lines = FULL.splitlines()
    section, tried = "", 0
    for index, line in enumerate(lines):
        section = line.strip("[]").split(".")[0] if line.startswith("[") else section
        number = re.search(r"(?<== )-?[\d.]+|(?<=\[)-?[\d.]+", line)
        if number is None or line.startswith(("[", "black_cd_m2")) or section in spared:
            continue
        value = number.group()
        other = str(int(value) + 1) if value.isdigit() else f"{float(value) * 0.97 - 1e-3:g}"
        if value == "0.0":  # of the lamp's red, which must not be below 0
            other = "0.5"
        text = "\n".join([*lines[:index], line.replace(value, other, 1), *lines[index + 1 :]])
        assert DomeFile.model_validate(tomllib.loads(text)).digest != digest, line
        tried += 1
    assert tried > 40


def test_the_digest_knows_a_meshs_content(full: Scene, tmp_path: Path) -> None:
    assert load(tmp_path, FULL).digest == full.digest  # in another folder
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "things" / "ball.stl")
    assert load_scene(tmp_path / "mine.toml").digest != full.digest


def test_white_is_in_the_digest_if_lamps_are_measured_by_it(tmp_path: Path) -> None:
    """A stored transport has the lamps' light in units of white."""
    dark, lit = with_sections("floor"), with_sections("floor", "lamp")
    brighter = "white_cd_m2 = 10.0", "white_cd_m2 = 20.0"
    assert load(tmp_path, dark).digest == load(tmp_path, changed(dark, brighter)).digest
    assert load(tmp_path, lit).digest != load(tmp_path, changed(lit, brighter)).digest
