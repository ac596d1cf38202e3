"""Garden, observatory and sky as a Mitsuba scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from domesim.pathtrace.solids import Triangles, box, join, moved, quad, turned
from scenes.artwork.night import garden, sky
from scenes.artwork.night.noise import Floats, fractal_noise, value_noise
from scenes.artwork.night.observatory import (
    LAMP_HEIGHT,
    LAMPS,
    floodlights,
    furniture,
    observatory,
)

MOONLIGHT = 0.22
"""Irradiance from the moon: that of its disc if the screen could show it 20 times brighter."""
SKYLIGHT = 3.0
"""How much brighter the sky is for the garden than on the screen."""

_WARM = np.array([1.0, 0.62, 0.30])
_LAMP = np.array([1.0, 0.70, 0.38])
_COOL = np.array([0.55, 0.78, 1.0])
_MOON = np.array([0.78, 0.88, 1.0])


def build(mi: Any, seed: int, detail: float = 1.0) -> Any:
    """The scene without a sensor.

    Parameters
    ----------
    mi
        Mitsuba with an LLVM variant set.
    seed
        Same seed, same scene.
    detail
        Share of the leaves and blades that grow.

    Notes
    -----
    The sampling weights of all lights are whole numbers with the sum 64: of every 64 evenly spread
    paths each light then gets its exact share, and the choice among lights adds no noise.
    """
    rng = np.random.default_rng(seed)
    bsdfs, lights = _bsdfs(mi, seed), _lights()
    scene: dict[str, Any] = {"type": "scene", **_small_lights(mi)}
    weights = [part["sampling_weight"] for part in [*lights.values(), *list(scene.values())[1:]]]
    scene["sky"] = _sky_light(mi, seed, weight=64.0 - sum(weights))
    solids = observatory(rng)
    for material, triangles in furniture().items():
        solids[material] = join([solids[material], triangles]) if material in solids else triangles
    solids |= _grounds(rng, detail) | _trees(rng, detail)
    solids["hill"], solids["snow"] = garden.hills(seed)
    solids["house"], solids["far window"] = garden.village(rng)
    for material, triangles in solids.items():
        light = lights.get(material)
        bsdf = bsdfs["lamp body"] if light else bsdfs[material]
        scene[material] = _shape(mi, triangles, bsdf, light)
    return mi.load_dict(scene)


def _grounds(rng: np.random.Generator, detail: float) -> dict[str, Triangles]:
    def flat(x0: float, x1: float, y0: float, y1: float, z: float = 0.0) -> Triangles:
        return quad([x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z])

    lawns = [(9.0, 38.0, 1.0, 20.0), (-26.0, -9.0, 1.0, 18.5)]
    hedges = [(8.7, 9.5, 7.0, 20.0, 0.62), (-9.5, -8.7, 7.0, 20.0, 0.62),
              (9.0, 31.0, 24.3, 25.2, 0.72), (-31.0, -9.0, 24.3, 25.2, 0.72)]  # fmt: skip
    clipped = [
        garden.hedge(rng, np.array([x0, y0, 0.0]), np.array([x1, y1, top]), 1500.0 * detail)
        for x0, x1, y0, y1, top in hedges
    ]
    return {
        "lawn": flat(-33.0, 175.0, -175.0, 175.0),
        "paving": join(
            [
                flat(-8.6, 8.6, -6.0, 30.0, 0.012),
                flat(-33.0, 34.0, 19.2, 24.2, 0.008),
                flat(-33.0, -27.0, -40.0, 60.0, 0.016),
                flat(14.5, 16.5, 2.0, 20.0, 0.01),
            ]
        ),
        "basin": flat(-3.0, 3.0, 9.1, 18.5, 0.20),
        "lake": flat(-240.0, -33.0, -240.0, 240.0, -1.2),
        "grass": garden.grass(rng, lawns, 260.0 * detail),
        "hedge": join(clipped),
        "bench": join([_bench(9.9, 12.9), _bench(-10.6, 12.9), _bench(9.9, 17.6)]),
    }


def _bench(x: float, y: float) -> Triangles:
    seat = [box([x, y + 0.16 * i, 0.42], [x + 0.5, y + 0.12 + 0.16 * i, 0.46]) for i in range(11)]
    legs = [box([x, y + a, 0.0], [x + 0.5, y + a + 0.1, 0.42]) for a in (0.1, 1.5)]
    return join(seat + legs)


def _trees(rng: np.random.Generator, detail: float) -> dict[str, Triangles]:
    """Wood and foliage of all trees: every one is one of a few, turned and scaled."""
    kinds: dict[str, dict[str, Triangles]] = {}
    for number in range(3):
        wood, leaves = garden.broadleaf(rng, 10.0, int(32000 * detail))
        kinds[f"broadleaf {number}"] = {"bark": wood, "leaf": leaves}
    kinds["cypress"] = {"needle": garden.cypress(rng, 10.0, int(30000 * detail))}
    parts: dict[str, list[Triangles]] = {"bark": [], "leaf": [], "needle": []}
    for kind, x, y, height in _planting(rng):
        azimuth = float(rng.uniform(0.0, 360.0))
        for material, solid in kinds[kind].items():
            tree = turned(solid * (height / 10.0), azimuth)
            parts[material].append(moved(tree, [x, y, 0.0]))
    return {material: join(solids) for material, solids in parts.items()}


def _planting(rng: np.random.Generator) -> list[tuple[str, float, float, float]]:
    """Kind, x, y and height of every tree."""
    plan = [("cypress", side * x, y, h) for side in (-1, 1)
            for x, y, h in [(23.6, 24.0, 11.5), (34.0, 25.0, 13.0), (8.9, 21.6, 5.2)]]  # fmt: skip

    def broad(x: float, y: float, height: float) -> None:
        plan.append((f"broadleaf {rng.integers(3)}", x, y, height))

    for azimuth in np.arange(56.0, 128.0, 8.0):  # the grove, to the right
        for distance in (19.0, 27.0, 38.0):
            a, r = np.radians(azimuth + rng.uniform(-3, 3)), distance * rng.uniform(0.9, 1.1)
            broad(r * np.sin(a), r * np.cos(a), rng.uniform(7.5, 11.5))
    for azimuth in np.arange(122.0, 246.0, 15.5):  # behind the audience
        a, r = np.radians(azimuth + rng.uniform(-4, 4)), rng.uniform(12.0, 17.0)
        broad(r * np.sin(a), r * np.cos(a), rng.uniform(9.5, 15.5))
    for x, y, height in [(-25.0, -3.0, 9.0), (-21.5, 12.5, 6.5), (-29.5, 44.0, 11.0)]:  # the shore
        broad(x, y, height)
    for x in np.arange(-46.0, 60.0, 7.0):  # behind the house
        broad(x + rng.uniform(-2, 2), 52.0 + rng.uniform(0, 12), rng.uniform(12.0, 17.0))
    return plan


def _bsdfs(mi: Any, seed: int) -> dict[str, Any]:
    def matt(red: float, green: float, blue: float) -> dict[str, Any]:
        return _both_sides({"type": "diffuse", "reflectance": _rgb([red, green, blue])})

    def textured(texels: Floats, metres: float) -> dict[str, Any]:
        return _both_sides({"type": "diffuse", "reflectance": _texture(mi, texels, metres)})

    def water(ripples: Floats, metres: float, height: float) -> dict[str, Any]:
        still = {
            "type": "roughplastic",
            "int_ior": 1.45,
            "alpha": 0.03,
            "diffuse_reflectance": _rgb([0.004, 0.010, 0.013]),
        }
        relief = _texture(mi, ripples[..., None], metres)
        bump = {"type": "bumpmap", "relief": relief, "scale": height, "water": still}
        return _both_sides(bump)

    glossy = {"type": "roughplastic", "diffuse_reflectance": _rgb([0.02, 0.022, 0.026])}
    dome = {
        "type": "roughplastic",
        "alpha": 0.28,
        "diffuse_reflectance": _rgb([0.50, 0.55, 0.56]),
    }
    bsdfs = {
        "stone": textured(_ashlar(seed), 4.0),
        "trim": textured(
            0.72 * (0.85 + 0.3 * _speckle(seed, 6))[..., None] * [1.0, 0.95, 0.86], 3.0
        ),
        "paving": textured(_slabs(seed), 4.8),
        "lawn": textured(
            (0.3 + 1.4 * _speckle(seed + 1, 20))[..., None] * [0.045, 0.075, 0.025], 9.0
        ),
        "dome": _both_sides(dome),
        "iron": matt(0.030, 0.032, 0.035),
        "dark glass": _both_sides(glossy),
        "basin": water(_ripples(seed), 5.0, 0.012),
        "lake": water(_ripples(seed + 1), 14.0, 0.12),
        "hill": matt(0.100, 0.115, 0.095),
        "snow": matt(0.800, 0.830, 0.860),
        "house": matt(0.30, 0.28, 0.25),
        "grass": matt(0.075, 0.130, 0.040),
        "hedge": matt(0.045, 0.090, 0.035),
        "leaf": matt(0.075, 0.125, 0.040),
        "needle": matt(0.040, 0.080, 0.038),
        "bark": matt(0.110, 0.085, 0.065),
        "bench": matt(0.260, 0.170, 0.100),
        "lamp body": matt(0.1, 0.1, 0.1),
    }
    return {name: mi.load_dict(bsdf) for name, bsdf in bsdfs.items()}


def _lights() -> dict[str, dict[str, Any]]:
    """Glowing surfaces by material; 1.0 is projector white. The weight steers paths, not light."""

    def area(radiance: Floats, weight: float) -> dict[str, Any]:
        return {"type": "area", "radiance": _rgb(radiance), "sampling_weight": weight}

    return {
        "globe": area(4.0 * _LAMP, 1.0),
        "bright glass": area(1.7 * _WARM, 2.0),
        "dim glass": area(0.50 * np.array([1.0, 0.52, 0.20]), 1.0),
        "lit inside": area(0.75 * np.array([1.0, 0.36, 0.14]), 1.0),
        "far window": area(0.95 * _WARM, 1.0),
    }


def _small_lights(mi: Any) -> dict[str, Any]:
    """Lights without extent: a path that chose one has nothing left to chance but the shadow."""
    lights: dict[str, Any] = {
        "moon": {
            "type": "directional",
            "direction": [float(-part) for part in sky.MOON],
            "irradiance": _rgb(MOONLIGHT * _MOON),
            "sampling_weight": 8.0,
        }
    }
    for number, (x, y) in enumerate(LAMPS):
        lights[f"lamp {number}"] = {
            "type": "point",
            "position": [x, y, LAMP_HEIGHT],
            "intensity": _rgb(27.0 * _LAMP),
            "sampling_weight": 1.0,
        }
    intensity = {"wall": 78.0 * _WARM, "dome": 620.0 * _COOL, "cupola": 200.0 * _COOL}
    for number, light in enumerate(floodlights()):
        lights[f"floodlight {number}"] = {
            "type": "spot",
            "to_world": mi.ScalarTransform4f().look_at(light.place, light.aim, [0, 0.1, 1]),
            "intensity": _rgb(light.share * intensity[light.kind]),
            "cutoff_angle": 38.0 if light.kind == "dome" else 62.0,
            "beam_width": 26.0 if light.kind == "dome" else 18.0,
            "sampling_weight": 1.0,
        }
    return lights


def _sky_light(mi: Any, seed: int, weight: float) -> dict[str, Any]:
    rows, cols = 128, 256
    polar = (np.arange(rows)[:, None] + 0.5) / rows * np.pi
    azimuth = (np.arange(cols)[None, :] + 0.5) / cols * 2 * np.pi
    toward = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)
        ),
        axis=-1,
    )
    # Mitsuba's map has y up; a quarter turn about x brings z up.
    to_world = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    world = np.stack([toward[..., 0], -toward[..., 2], toward[..., 1]], axis=-1)
    disc, covered = sky.moon(world, seed)
    air = sky.background(world, seed) * (1.0 - covered[..., None])
    light = SKYLIGHT * air + disc
    bitmap = mi.Bitmap(light.astype(np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": to_world, "sampling_weight": weight}


def _shape(mi: Any, triangles: Triangles, bsdf: Any, light: dict[str, Any] | None = None) -> Any:
    """A mesh whose texture coordinates are metres along its faces."""
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    if light:
        properties["light"] = mi.load_dict(light)
    corners = triangles.reshape(-1, 3)
    mesh = mi.Mesh(
        "solid",
        vertex_count=len(corners),
        face_count=len(triangles),
        has_vertex_texcoords=True,
        props=properties,
    )
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = corners.astype(np.float32).ravel()
    buffers["vertex_texcoords"] = _metres_along(triangles).astype(np.float32).ravel()
    buffers["faces"] = np.arange(len(corners), dtype=np.uint32)
    buffers.update()
    return mesh


def _metres_along(triangles: Triangles) -> Floats:
    """Box projection: for every corner the two coordinates its face is least turned away from."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    kept = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(normal).argmax(axis=1)]
    return np.take_along_axis(triangles, kept[:, None, :], axis=2).reshape(-1, 2)


def _both_sides(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "twosided", "inner": bsdf}


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(part) for part in value]}


def _texture(mi: Any, texels: Floats, metres: float) -> dict[str, Any]:
    """A repeating texture, `metres` wide."""
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(texels, dtype=np.float32)),
        "raw": True,
        "to_uv": mi.ScalarTransform4f().scale([1 / metres, 1 / metres, 1.0]),
    }


def _torus(size: int, turns: float) -> Floats:
    """Points (row, col, xyz...) for noise that repeats at the texture's edges."""
    a = np.arange(size) / size * 2 * np.pi
    u, v = np.meshgrid(a, a)
    radius = turns / (2 * np.pi)
    x, y = (2.0 + np.cos(u)) * np.cos(v), (2.0 + np.cos(u)) * np.sin(v)
    return radius * np.stack([x, y, np.sin(u)], axis=-1)


def _speckle(seed: int, turns: float) -> Floats:
    return fractal_noise(_torus(256, turns), 5, seed + 41)


def _ashlar(seed: int) -> Floats:
    """Courses of dressed stone, 4 m by 4 m."""
    return _masonry(seed, courses=8, blocks=4, joint=0.022, colour=(0.60, 0.54, 0.44))


def _slabs(seed: int) -> Floats:
    """Paving slabs, 4.8 m by 4.8 m."""
    return _masonry(seed + 3, courses=8, blocks=6, joint=0.03, colour=(0.30, 0.28, 0.25))


def _masonry(
    seed: int, *, courses: int, blocks: int, joint: float, colour: tuple[float, float, float]
) -> Floats:
    size = 512
    v, u = np.mgrid[0:size, 0:size] / size
    course = np.floor(v * courses)
    along = u * blocks + 0.5 * (course % 2)
    block = np.floor(along) % blocks
    tint = value_noise(np.stack([block * 3.0, course * 3.0, 0 * block], axis=-1), seed + 51)
    edge = np.minimum(
        np.minimum(along % 1.0, 1 - along % 1.0) / blocks,
        np.minimum((v * courses) % 1.0, 1 - (v * courses) % 1.0) / courses,
    )
    grain = fractal_noise(_torus(size, 30.0), 4, seed + 52)
    shade = (0.72 + 0.42 * tint) * (0.75 + 0.5 * grain)
    jointed = shade * np.where(edge < joint / 4, 0.45, 1.0)
    texels: Floats = jointed[..., None] * np.array(colour)
    return texels


def _ripples(seed: int) -> Floats:
    """Height of small waves, -1..1, repeating."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:512, 0:512] / 512 * 2 * np.pi
    height: Floats = np.zeros((512, 512))
    for _ in range(48):
        wave = rng.integers(-14, 15, 2)
        length = max(1.0, float(np.hypot(*wave)))
        phase = rng.uniform(0, 2 * np.pi)
        height += np.sin(wave[0] * u + wave[1] * v + phase) / length**1.3
    height /= np.abs(height).max()
    return height
