"""Screens of unequal albedo: in closed form, by radiosity, as paths and as Mitsuba find them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from compensate import compensate
from domesim import load_scene, observe, render, tabulate
from domesim.errors import InputError
from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import bare_transport
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tracer import Settings
from domesim.room.masks import written_mask
from domesim.room.theatre import Paint
from domesim.scene.loading import scene_content

SIZE = 48
MAP = 64


def patches():
    """(row, col, primary): a darker right half, dirt below, and waves of each primary's own."""
    v, u = (np.mgrid[:MAP, :MAP] + 0.5) * (2 / MAP) - 1
    shared = np.where(u < 0, 1.0, 0.5) * np.where(v > 0.5, 0.8, 1.0)
    waves = [1 - 0.4 * np.sin(4 * (k + 1) * v) ** 2 for k in range(3)]
    found = shared[..., None] * np.stack(waves, -1)
    found[np.hypot(u, v) > 1] = 0  # off the screen it does not count
    return found


MAPS = {"grey": patches()[..., 0], "coloured": patches()}
BARE = {
    "name": "painted",
    "dome": {"radius_m": 6.0, "half_angle_deg": 100.0},
    "screen": {"albedo": [0.6, 0.5, 0.7]},
    "projector": {"white_cd_m2": 15.0, "black_cd_m2": 0.0},
    "viewing": {"adaptation_cd_m2": 1.5},
}
ROOM = {
    **BARE,
    "dome": {"radius_m": 6.0, "half_angle_deg": 90.0},
    "floor": {"height_m": -1.8, "albedo": [0.3, 0.2, 0.1]},
    "wall": {"albedo": 0.2},
}
LAMPS = [
    {
        "name": "sign",
        "position_m": [0, -3, 0],
        "normal": [0, 1, 1],
        "width_m": 0.5,
        "height_m": 0.3,
        "luminance_cd_m2": 30.0,
    }
]


def painted(map_, content=BARE, **changes):
    return load_scene(content, screen={"albedo_map": map_}, **changes)


def painted_room(kind):
    changes = ROOMS[kind]
    screen = changes.get("screen", {}) | {"albedo_map": MAPS["coloured"]}
    return load_scene(ROOM, **changes | {"screen": screen})


def window():
    light = np.full((1, SIZE, SIZE, 3), 0.01)
    light[:, 10:18, 28:38] = (0.9, 0.6, 0.3)
    return light


def added(scene, seen):
    """(pixel, primary) what is seen of the window besides its direct light."""
    direct = scene.observation(SIZE, SIZE).direct(window())
    return (seen - direct)[0][scene.screen(SIZE, SIZE)]


def dense(scene, size=28):
    """Form factors between all pixels' middles, and all bounces at once: seen of the window."""
    on = scene.screen(size, size)
    places, radius = scene.dome.points(size, size)[on], scene.dome.radius
    areas = scene.dome.screen_areas(size, size)[on]
    away = places[:, None] - places
    square = np.sum(away**2, -1) + np.eye(len(places))
    cosines = -np.einsum("ijk,ik->ij", away, -places / radius) / np.sqrt(square)
    factors = cosines * cosines.T / (np.pi * square)
    np.fill_diagonal(factors, 1 / (4 * np.pi * radius**2))  # their limit
    light = np.full((1, size, size, 3), 0.01)
    light[:, 6:11, 16:22] = (0.9, 0.6, 0.3)
    seen = np.empty((len(places), 3))
    for p, white in enumerate(scene.albedo):
        paint = scene.theatre.paint.on(size, size)[..., p % scene.theatre.paint.factors.shape[2]]
        sent = paint[on] * light[0, on, p]
        kept = (white * paint[on])[:, None] * factors * areas
        seen[:, p] = np.linalg.solve(np.eye(len(places)) - kept, sent)
    return on, light, seen


@pytest.mark.parametrize("kind", MAPS)
def test_every_bounce_of_a_bare_dome_is_counted(kind):
    scene = painted(MAPS[kind])
    on, light, seen = dense(scene)
    np.testing.assert_allclose(observe(light, scene)[0][on], seen, rtol=1e-4)
    assert scene.approximation is None
    assert "albedo map of" in scene.facts()["Theatre"]


@pytest.mark.parametrize("kind", MAPS)
def test_the_dark_places_are_compensated(kind):
    """Where all can be shown it is; where black cannot, less is seen than of the master itself."""
    scene = painted(MAPS[kind])
    observation, on = scene.observation(SIZE, SIZE), scene.screen(SIZE, SIZE)
    light = np.full((1, SIZE, SIZE, 3), 0.5)
    light[:, 10:18, 28:38] = 0.7
    wanted = observation.direct(light)
    exact = compensate(light, scene, method="subtractive").light
    np.testing.assert_allclose(observation.observe(exact)[0][on], wanted[0][on], atol=1e-6)
    dark = np.where(window() > 0.01, 1.0, 0.001)
    result = compensate(dark, scene)
    assert result.status.name == "AIMED"
    away = observation.observe(result.light)[0][on].mean() - observation.direct(dark)[0][on].mean()
    untouched = (observation.observe(dark) - observation.direct(dark))[0][on].mean()
    assert 0 < away < 0.95 * untouched


@pytest.mark.parametrize("kind", MAPS)
def test_the_transpose_is_the_adjoint(kind):
    rng, scene = np.random.default_rng(2), painted(MAPS[kind])
    observation = scene.solvable(SIZE, SIZE)
    x, y = rng.random((2, 1, SIZE, SIZE, 3))
    there, back = np.vdot(observation.linear(x), y), np.vdot(x, observation.adjoint(y))
    assert there == pytest.approx(back, rel=1e-12)


def test_paths_find_the_same_in_a_bare_dome():
    scene = painted(MAPS["coloured"])
    known, traced = added(scene, observe(window(), scene)), render(window(), scene, error=0.02)
    found, left = added(scene, traced), scene.screen(SIZE, SIZE).nonzero()[1] < SIZE / 2
    for half in (left, ~left):
        np.testing.assert_allclose(known[half].mean(0), found[half].mean(0), rtol=0.01)
    assert np.all(known[left].mean(0) > 1.8 * known[~left].mean(0))


LONG = pytest.mark.long
ROOMS = {
    "recessed floor": {},
    "ellipsoid": {"dome": {"height_ratio": 0.7}},
    "floor in the beam": {
        "dome": {"half_angle_deg": 120.0},
        "floor": {"height_m": -1.2},
        "wall": None,
    },
    "lit by lamps": {"lamps": LAMPS},
    "glossy": {"screen": {"lobe": {"share": 0.3, "roughness": 0.3}}},
}
BY_RADIOSITY = ["recessed floor", *(pytest.param(each, marks=LONG) for each in list(ROOMS)[1:3])]


def as_paths(scene, stored, error):
    """Compares reflected and ambient light of the screen's halves with what paths bring there."""
    observation = scene.with_transport(stored).observation(SIZE, SIZE)
    traced = PathTracedDome(scene.theatre, SIZE, SIZE, Settings(error=error)).trace(window())
    theirs = (traced.mean - traced.direct)[0]
    ours = (observation.observe(window()) - observation.direct(window()))[0]
    on = scene.screen(SIZE, SIZE)
    left = on & (np.arange(SIZE) < SIZE / 2)
    for half in (left, on & ~left):
        np.testing.assert_allclose(ours[half].mean(0), theirs[half].mean(0), rtol=0.02)


@pytest.mark.parametrize("kind", BY_RADIOSITY)
def test_radiosity_of_painted_rooms_is_what_paths_find(kind):
    scene = painted_room(kind)
    as_paths(scene, radiosity(scene.theatre, resolution=8), error=0.02)


@LONG
@pytest.mark.parametrize("kind", list(ROOMS)[3:])
def test_tabulated_rooms_are_what_paths_find(kind):
    scene = painted_room(kind)
    as_paths(scene, tabulate(scene, error=1e-2), error=0.04)


def in_mitsuba(scene, light, towards, samples=1 << 16):
    """(direction, primary): reflected light of a domemaster, as Mitsuba's path integrator finds.

    The dome is a mesh over directions from the middle, and both its albedo and its light are
    bitmaps in domemaster coordinates: raw, so that no curve is applied to them.
    """
    mi = load_mitsuba()
    dome, floor = scene.dome, scene.theatre.floor
    steps = 400
    down, around = np.meshgrid(
        np.linspace(0, dome.half_angle, steps), np.linspace(0, 2 * np.pi, steps)
    )
    far = dome.radius / np.hypot(np.sin(down), np.cos(down) / dome.height_ratio)
    across, ahead = np.sin(down) * np.cos(around), np.sin(down) * np.sin(around)
    corner = np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)
    inwards = [corner, corner + steps + 1, corner + 1, corner, corner + steps, corner + steps + 1]

    def texture(values):
        picture = mi.TensorXf(np.asarray(values, np.float32))
        return {"type": "bitmap", "data": picture, "raw": True, "filter_type": "nearest"}

    size = light.shape[1]
    albedo = scene.theatre.paint.on(size, size) * np.asarray(scene.albedo)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": texture(albedo)})
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": texture(albedo * light[0])})
    mesh = mi.Mesh(
        "dome", steps**2, 2 * (steps - 1) ** 2, props=properties, has_vertex_texcoords=True
    )
    values = mi.traverse(mesh)
    places = far * (across, ahead, np.cos(down))
    turned = 0.5 + down / (2 * dome.half_angle) * (np.cos(around), np.sin(around))
    for name, each in (("vertex_positions", places), ("vertex_texcoords", turned)):
        values[name] = each.reshape(len(each), -1).T.ravel().astype(np.float32)
    values["faces"] = np.stack(inwards, -1).ravel().astype(np.uint32)
    values.update()
    parts = {"type": "scene", "integrator": {"type": "path", "max_depth": 40}, "dome": mesh}
    if floor is not None:
        at = mi.ScalarTransform4f().translate([0, 0, floor.height]).scale(floor.radius)
        grey = {"type": "rgb", "value": list(floor.albedo)}
        paint = {"type": "diffuse", "reflectance": grey}
        parts["floor"] = {"type": "disk", "to_world": at, "bsdf": paint}
    found = []
    for to in towards:
        parts["sensor"] = {
            "type": "radiancemeter",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], list(to), [1, 0, 0]),
            "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": samples},
        }
        found.append(np.array(mi.render(mi.load_dict(parts)))[0, 0, :3])
    return np.array(found) / scene.albedo


@pytest.mark.parametrize("kind", ["bare", "floor", pytest.param("ellipsoid", marks=LONG)])
def test_mitsuba_finds_the_same_light(kind):
    """Places that the picture leaves dark show what Mitsuba's paths bring there."""
    scene = {
        "bare": painted(MAPS["coloured"], BARE),
        "floor": painted(MAPS["coloured"], ROOM, wall=None),
        "ellipsoid": painted(MAPS["coloured"], BARE, dome={
            "height_ratio": 0.7, "half_angle_deg": 90.0}),
    }[kind]  # fmt: skip
    if kind == "floor":
        scene = scene.with_transport(radiosity(scene.theatre, resolution=8))
    size = 64
    light = np.zeros((1, size, size, 3))
    light[:, 12:24, 36:50] = (0.9, 0.6, 0.3)
    rows, cols = np.array([40, 44, 30, 56]), np.array([20, 44, 12, 34])
    towards = scene.dome.directions(size, size)[rows, cols]
    seen, traced = observe(light, scene)[0, rows, cols], in_mitsuba(scene, light, towards)
    np.testing.assert_allclose(seen, traced, rtol=0.02)


def test_maps_of_all_kinds_of_files_are_the_array(tmp_path):
    map_ = patches()
    (tmp_path / "grey.png").write_bytes(written_mask(map_[..., 0]))
    for p in range(3):
        (tmp_path / f"{p}.png").write_bytes(written_mask(map_[..., p]))
    stored(tmp_path / "grey.exr", map_[..., :1])
    stored(tmp_path / "coloured.exr", map_)
    for given, wanted in (
        ("grey.png", "grey"),
        ("grey.exr", "grey"),
        ("coloured.exr", "coloured"),
        (["0.png", "1.png", "2.png"], "coloured"),
    ):
        text = json.dumps(given)
        (tmp_path / "mine.toml").write_text(
            'name = "mine"\n[dome]\nradius_m = 6\nhalf_angle_deg = 100\n[screen]\n'
            f"albedo = [0.6, 0.5, 0.7]\nalbedo_map = {text}\n"
            "[projector]\nwhite_cd_m2 = 15\n[viewing]\nadaptation_cd_m2 = 1.5\n"
        )
        scene, array = load_scene(tmp_path / "mine.toml"), painted(MAPS[wanted])
        assert scene.theatre.paint.coloured == (wanted == "coloured")
        on = array.screen(MAP, MAP)
        found, right = (each.theatre.paint.on(MAP, MAP)[on] for each in (scene, array))
        np.testing.assert_allclose(found, right, atol=1e-4)
        again = load_scene(scene_content(tmp_path / "mine.toml"))
        assert again.theatre == scene.theatre
    coded = np.round(255 * map_).astype(np.uint8)
    stored(tmp_path / "coded.png", coded)
    found = painted(str(tmp_path / "coded.png")).theatre.paint.on(MAP, MAP)[on]
    np.testing.assert_allclose(found, coded[on] / 255, rtol=1e-12)  # no sRGB curve


def stored(path, pixels):
    kind = "uint8" if pixels.dtype == np.uint8 else "float"
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if pixels.shape[2] == 1:
        spec.channelnames = ("Y",)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_image(np.ascontiguousarray(pixels, np.uint8 if kind == "uint8" else "f4"))
    assert file.close()


def test_pixels_have_the_means_of_a_finer_map():
    paint = Paint(np.arange(1.0, 37.0).reshape(6, 6, 1) / 36)
    coarse = paint.factors.reshape(3, 2, 3, 2).mean((1, 3))
    np.testing.assert_allclose(paint.on(3, 3)[..., 0], coarse)
    np.testing.assert_allclose(paint.on(12, 12), paint.factors.repeat(2, 0).repeat(2, 1))
    straddling = paint.on(4, 4)[0, 1, 0] * 36  # columns 1.5 to 3 of rows 0 to 1.5
    assert straddling == pytest.approx(((2 * 0.5 + 3) + 0.5 * (8 * 0.5 + 9)) / 1.5**2)
    large = np.random.default_rng(0).uniform(0.2, 1, (2048, 2048))
    assert painted(large).theatre.paint.factors.shape == (1024, 1024, 1)


def test_scenes_are_told_apart_by_their_maps():
    grey, coloured = painted(MAPS["grey"]), painted(MAPS["coloured"])
    assert grey == painted(MAPS["grey"].copy())
    assert grey != coloured
    assert len({each.digest for each in (grey, coloured, load_scene(BARE))}) == 3
    provenance = {"digest": grey.digest}
    transport = replace(bare_transport(grey.theatre), provenance=provenance)
    assert grey.with_transport(transport).transport is transport
    with pytest.raises(InputError, match="before it was changed"):
        coloured.with_transport(transport)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (np.zeros((8, 8)), r"shares above 0 and at most 1 on the screen, got 0 to 0"),
        (np.full((8, 8), np.nan), r"got nan to nan"),
        (np.ones((8, 9)), r"square domemaster of one or three primaries, got .8, 9, 1."),
        (np.ones((8, 8), bool), r"screen.albedo_map: must be a file, three files, or an array"),
        ("none.png", r"none\.png: wanted an albedo map"),
        (["one.png"], r"albedo_map.1.: is missing"),
    ],
)
def test_what_is_no_map_is_refused(wrong, told):
    with pytest.raises(InputError, match=told):
        painted(wrong)


def test_what_cannot_be_beside_a_map_is_refused():
    stereo = {"system": "spectral", "share": 0.01}
    with pytest.raises(InputError, match=r"albedo_map must be grey in a scene with \[stereo\]"):
        painted(MAPS["coloured"], stereo=stereo)
    with pytest.raises(InputError, match="one paint for all primaries"):
        painted(MAPS["coloured"]).observation(SIZE, SIZE).low_rank()


@pytest.mark.parametrize("kept", [0, 0.5, 1])
def test_a_pair_on_grey_paint_is_two_domes(kept):
    """Alike views are seen as one of them; what differs is reflected `kept` at each bounce."""
    stereo = {"system": "polarised", "share": 0.0, "kept_by_reflection": kept}
    scene, alone = painted(MAPS["grey"], stereo=stereo), painted(MAPS["grey"])
    x = window()
    both = observe(np.concatenate([x, x]), scene)
    np.testing.assert_allclose(both[:1], observe(x, alone), rtol=1e-6)
    fewer = load_scene(BARE, screen={
        "albedo": [kept * each for each in BARE["screen"]["albedo"]], "albedo_map": MAPS["grey"]
    })  # fmt: skip
    apart = observe(np.concatenate([x, 0 * x]), scene)
    difference = apart[0] - apart[1]
    np.testing.assert_allclose(difference[None], observe(x, fewer), rtol=1e-5, atol=1e-7)
