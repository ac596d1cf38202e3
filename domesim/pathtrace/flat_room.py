"""Light that a flat screen sends into a room and gets back, path traced with Mitsuba.

Rays leave places of the screen; where they meet a surface, a random point of the screen lights it,
and a bounce goes on in a random direction. Nothing is taken to be smooth, and no form factor is
computed: this is what `domesim.observation.flat_room` is checked against. As there, projector and
audience are along the screen's normal, and what the screen reflects again is diffuse.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from domesim.pathtrace.llvm import load_mitsuba
from domesim.room.flat_room import Face, FlatRoom

Floats = NDArray[np.float64]

_BOUNCES = 12
_LANES = 1 << 20
_LIFTED = 1e-4  # m, that a path starts off its surface


class Returning(NamedTuple):
    """Light that comes back.

    Attributes
    ----------
    light, error
        (place, primary) what is seen of it along the normal, in units of white, and the standard
        errors.
    """

    light: Floats
    error: Floats


def returning(
    room: FlatRoom, picture: Floats, places: Floats, *, samples: int, seed: int = 0
) -> Returning:
    """Trace what comes back of a picture.

    Parameters
    ----------
    room
        The box and its screen.
    picture
        (row, col) luminance along the normal, 1 = white; the first row is at the top.
    places
        (place, 2) across and up from the middle of the screen, m.
    samples
        Paths to the place, about.
    seed
        Seed of the random numbers.
    """
    mi = load_mitsuba()
    dr = import_module("drjit")
    screen = Face(
        "screen",
        np.array([-room.screen[0] / 2, 0, -room.screen[1] / 2]),
        np.array([room.screen[0], 0, 0]),
        np.array([0, 0, room.screen[1]]),
        np.array([0.0, 1, 0]),
        (room.screen_albedo,) * 3,
    )
    content = {
        f"face{number}": _rectangle(mi, face) for number, face in enumerate([screen, *room.faces()])
    }
    scene = mi.load_dict({"type": "scene", **content})
    shown = mi.TensorXf(picture.astype(np.float32)).array
    lanes = max(1, min(samples, _LANES // len(places))) * len(places)
    rounds = max(2, round(samples * len(places) / lanes))
    rows = []
    for number in range(rounds):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed * rounds + number, lanes)
        place = dr.arange(mi.UInt32, lanes) % len(places)
        light = _paths(mi, dr, room, scene, (shown, picture.shape), sampler, places, place)
        sums = np.asarray(light).reshape(3, -1, len(places))
        rows.append(sums.mean(axis=1).T)
    each = np.stack(rows).astype(np.float64)
    return Returning(each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(rounds))


def _paths(
    mi: Any,
    dr: Any,
    room: FlatRoom,
    scene: Any,
    shown: tuple[Any, tuple[int, ...]],
    sampler: Any,
    places: Floats,
    place: Any,
) -> Any:
    """One path a lane, (lane,) colours."""
    width, height = room.screen
    pixels, (rows, cols) = shown
    across, up = (mi.Float(places[:, k].astype(np.float32)) for k in range(2))
    at = [dr.gather(mi.Float, each, place) for each in (across, up)]

    def gained(cosine: Any) -> Any:
        if room.half_gain is None:
            return mi.Float(1.0)
        return dr.exp2(-dr.square(dr.safe_acos(cosine) / room.half_gain))

    away = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    way = mi.Vector3f(away.x, away.z, away.y)
    ray = mi.Ray3f(mi.Point3f(at[0], _LIFTED, at[1]), way)
    # Cosine-weighted: the mean over directions of light times gain
    share = mi.Color3f(room.gain * gained(away.z))
    light = mi.Color3f(0.0)
    for _ in range(_BOUNCES):
        hit = scene.ray_intersect(ray)
        alive = hit.is_valid()
        share *= dr.select(alive, hit.bsdf().eval_diffuse_reflectance(hit), 0.0)
        normal = dr.select(dr.dot(hit.n, ray.d) > 0, -hit.n, hit.n)
        start = hit.p + _LIFTED * normal
        u = sampler.next_2d()
        lamp = mi.Point3f((u.x - 0.5) * width, _LIFTED, (u.y - 0.5) * height)
        toward = lamp - start
        square = dr.squared_norm(toward)
        toward /= dr.sqrt(square)
        sent, arrives = -toward.y, dr.maximum(dr.dot(toward, normal), 0.0)
        lit = alive & (sent > 0) & (arrives > 0)
        between = mi.Ray3f(start, toward, maxt=dr.sqrt(square) * (1 - 1e-3), time=0, wavelengths=[])
        lit &= ~scene.ray_test(between, lit)
        row = dr.minimum(mi.UInt32((1 - u.y) * rows), rows - 1)
        col = dr.minimum(mi.UInt32(u.x * cols), cols - 1)
        luminance = dr.gather(mi.Float, pixels, row * cols + col) * gained(sent)
        # Lambertian: the radiance is albedo / pi times the irradiance
        arrived = luminance * sent * arrives / square * (width * height / dr.pi)
        light += dr.select(lit, share * arrived, 0.0)
        frame = mi.Frame3f(normal)
        onward = frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        ray = mi.Ray3f(start, onward)
        dr.eval(ray, share, light)
    return light


def _rectangle(mi: Any, face: Face) -> dict[str, Any]:
    middle = face.corner + (face.first + face.second) / 2
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = face.first / 2, face.second / 2
    matrix[:3, 2], matrix[:3, 3] = face.normal, middle
    reflects = {"type": "rgb", "value": list(face.albedo)}
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflects}},
    }
