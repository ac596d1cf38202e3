"""The same theatre for Mitsuba's own ``path`` integrator: a second opinion on the bounce loop.

Nothing of the loop's is used but the lobe's BSDF: Mitsuba's sphere, disk, cylinder and meshes, its
BSDFs with an opacity mask where the sphere is no screen, its integrator with emitter sampling, a
projector and a domemaster camera from `domesim.pathtrace.plugins`. Only where the projector's
directions meet the screen is found by the room's own geometry, for the picture that it throws.
Slow, and meant for validation. Lengths are in units of the dome's radius.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.plugins import register
from domesim.pathtrace.sources import lobe_bsdf
from domesim.room.dome import Dome
from domesim.room.lenses import field_weight
from domesim.room.rays import NOTHING, SCREEN, Room
from domesim.room.theatre import Albedo, Lobe, Paint, Theatre

_MASK_ROWS = 3600
"""Steps of the opacity mask from pole to pole: half-angles are kept to 0.05 degrees."""
_PAINT_ROWS = 1024
"""Steps of an albedo map from pole to pole."""


@guarded(light="size size 3")
def path_traced(
    theatre: Theatre,
    light: NDArray[Any],
    size: int,
    *,
    samples: int,
    seed: int = 0,
    depth: int = 24,
    detail: int = 1024,
) -> NDArray[np.float64]:
    """(row, col, primary) what is seen from the dome's centre, 1.0 = projector white.

    Parameters
    ----------
    theatre
        One uncorrected lens, no cavity, no truncation and no lamps.
    light
        (row, col, primary) the domemaster.
    size
        Pixels a side of the result.
    samples, seed, depth
        Settings of Mitsuba's integrator.
    detail
        Pixels a side of the picture that the projector throws.

    Returns
    -------
    light
        (row, col, primary), 1.0 = projector white.

    Raises
    ------
    InputError
        If the theatre has more than this reference can build.
    """
    dome, light = theatre.dome, np.asarray(light)
    beyond = {
        "a cavity": theatre.cavity is not None and theatre.perforation > 0,
        "lamps": bool(theatre.lamps),
        "a truncated dome": dome.truncated_below is not None,
        "an ellipsoid": dome.height_ratio != 1,
        "several projectors": len(theatre.lenses) != 1,
        "corrected falloff": theatre.corrected,
        "an albedo map of a glossy screen": theatre.paint is not None and not theatre.lambertian,
    }
    beyond_it = [name for name, is_there in beyond.items() if is_there]
    if beyond_it:
        raise InputError(f"the reference renderer cannot have {', '.join(beyond_it)}")
    mi = load_mitsuba()
    register(mi)
    zenith, front = dome.to_room[:, 2], dome.to_room[:, 1]
    place = np.asarray(theatre.lenses[0].position) / dome.radius
    looks = mi.ScalarTransform4f().look_at(
        origin=place.tolist(), target=(place + zenith).tolist(), up=front.tolist()
    )
    camera = mi.ScalarTransform4f().look_at(
        origin=[0.0, 0.0, 0.0], target=zenith.tolist(), up=front.tolist()
    )
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth, "rr_depth": 1000},
        "sensor": {
            "type": "domemaster",
            "half_angle": dome.half_angle,
            "to_world": camera,
            "film": {
                "type": "hdrfilm",
                "width": size,
                "height": size,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "projector": {
            "type": "fisheye_projector",
            "half_angle": np.pi,
            "bitmap": mi.Bitmap(_thrown(theatre, light, place, detail)),
            "filter_type": "nearest",
            "to_world": looks,
        },
        "screen": {
            "type": "sphere",
            "flip_normals": True,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=[0.0, 0.0, 0.0], target=zenith.tolist(), up=front.tolist()
            ),
            "bsdf": {
                "type": "mask",
                "opacity": {
                    "type": "bitmap",
                    "raw": True,
                    "filter_type": "nearest",
                    "wrap_mode": "clamp",
                    "bitmap": mi.Bitmap(_opacity(dome)),
                },
                "nested": _surface(theatre.screen_albedo, theatre.lobe)
                if theatre.paint is None
                else {"type": "diffuse", "reflectance": _painted(mi, theatre, theatre.paint)},
            },
        },
    }
    parts |= _room(mi, theatre)
    image = np.asarray(mi.render(mi.load_dict(parts), spp=samples, seed=seed), np.float64)
    # A white picture's direct radiance in the centre of projection: rho / pi, of 1 W/sr
    return np.asarray(image[..., :3] * np.pi / np.asarray(theatre.screen_albedo))


def _room(mi: Any, theatre: Theatre) -> dict[str, Any]:
    unit = theatre.dome.radius
    parts: dict[str, Any] = {}
    if theatre.floor is not None:
        floor = theatre.floor
        parts["floor"] = {
            "type": "disk",
            "to_world": mi.ScalarTransform4f()
            .translate([0, 0, floor.height / unit])
            .scale(floor.radius / unit),
            "bsdf": _surface(floor.albedo),
        }
    if theatre.wall is not None:
        wall = theatre.wall
        parts["wall"] = {
            "type": "cylinder",
            "flip_normals": True,
            "p0": [0, 0, wall.bottom / unit],
            "p1": [0, 0, wall.top / unit],
            "radius": wall.radius / unit,
            "bsdf": _surface(wall.albedo),
        }
    for number, solid in enumerate(theatre.solids):
        bsdf = mi.load_dict({"type": "twosided", "nested": _surface(solid.albedo)})
        properties = mi.Properties()
        properties["bsdf"] = bsdf
        mesh = mi.Mesh(solid.name, len(solid.vertices), len(solid.faces), props=properties)
        values = mi.traverse(mesh)
        values["vertex_positions"] = mi.Float((solid.vertices / unit).ravel())
        values["faces"] = mi.UInt32(solid.faces.ravel())
        values.update()
        parts[f"solid{number}"] = mesh
    return parts


def _surface(albedo: Albedo, lobe: Lobe | None = None) -> dict[str, Any]:
    if lobe is not None and lobe.share > 0:
        return lobe_bsdf(lobe, albedo)
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}}


def _painted(mi: Any, theatre: Theatre, paint: Paint) -> dict[str, Any]:
    """Albedo as a texture of (theta, azimuth), linear: raw, so that no curve is applied."""
    theta = (np.arange(_PAINT_ROWS) + 0.5)[:, None] * (np.pi / _PAINT_ROWS)
    azimuth = (np.arange(2 * _PAINT_ROWS) + 0.5) * (np.pi / _PAINT_ROWS)
    ring, up = np.sin(theta), np.broadcast_to(np.cos(theta), (_PAINT_ROWS, 2 * _PAINT_ROWS))
    towards = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), up], -1)
    row, col = theatre.dome.pixel_of(towards, len(paint.factors))
    albedo = paint.factors[row, col] * np.asarray(theatre.screen_albedo)
    return {
        "type": "bitmap",
        "raw": True,
        "filter_type": "nearest",
        "bitmap": mi.Bitmap(albedo.astype(np.float32)),
    }


def _opacity(dome: Dome) -> NDArray[np.float32]:
    """(theta, 1, 1): 1 on the screen. Mitsuba's v runs along theta, from the sphere's pole."""
    theta = (np.arange(_MASK_ROWS) + 0.5) * np.pi / _MASK_ROWS
    return np.where(theta <= dome.half_angle, 1, 0).astype(np.float32)[:, None, None]


def _thrown(
    theatre: Theatre, light: NDArray[Any], place: NDArray[Any], detail: int
) -> NDArray[np.float32]:
    """(row, col, primary) what the projector throws so that the domemaster lands where it should.

    What stands before the screen is lit as the screen would be.
    """
    dome = theatre.dome
    directions = Dome(1.0, np.pi).directions(detail, detail).reshape(-1, 3) @ dome.to_room.T
    origin = np.broadcast_to(place, directions.shape)
    leaving = np.full(len(directions), NOTHING)
    with np.errstate(all="ignore"):
        hit = Room(theatre).screen_along(tuple(origin.T), tuple(directions.T), leaving)
    on = np.asarray(hit.surface == SCREEN)
    points = np.where(on[:, None], np.stack(hit.position, -1), dome.to_room[:, 2])
    row, col = dome.pixel_of(dome.toward(points), light.shape[0])
    weight = field_weight(theatre.lenses[0], points * dome.radius) * on
    return np.asarray(light[row, col] * weight[:, None], np.float32).reshape(detail, detail, 3)
