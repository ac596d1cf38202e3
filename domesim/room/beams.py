"""Where the light of projectors lands: rays from the edges of their fields, met with the screen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from domesim.room.dome import Dome
from domesim.room.lenses import field_edges, lens_frame
from domesim.room.rays import quadric
from domesim.room.theatre import Floor, Lens, Theatre

Floats = NDArray[np.float64]


def field_rays(lens: Lens) -> Floats:
    """(step, ray, xyz): unit vectors from the edge of a projector's field inwards to its axis.

    Rays go round the edge; a rectangular field's begin at its upper left corner, and each of its
    sides has a quarter of them.
    """
    right, up, forth = lens_frame(lens)
    inwards = np.linspace(0.998, 0, 300)[:, None, None]  # just inside: the edge must land
    if lens.kind == "equidistant":
        around = np.arange(144)[:, None] * (2 * np.pi / 144)
        angle = inwards * lens.field / 2
        radial = np.cos(around) * right + np.sin(around) * up
        return np.asarray(np.cos(angle) * forth + np.sin(angle) * radial)
    along = np.linspace(-1, 1, 24, endpoint=False)[:, None]
    one = np.ones_like(along)
    sides = [(along, one), (one, -along), (-along, -one), (-one, along)]
    low, high = field_edges(lens)
    corners = np.concatenate([np.hstack(side) for side in sides])
    edge = (low + high) / 2 + corners * (high - low) / 2
    rays = forth + inwards * (edge[:, :1] * right + edge[:, 1:] * up)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def lands(dome: Dome, start: Floats, rays: Floats, floor: Floor | None = None) -> Floats:
    """(..., xyz): where rays from inside meet the ellipsoid of the screen, or first the floor.

    Parameters
    ----------
    dome
        The screen.
    start
        (xyz) where the rays begin, m; inside the ellipsoid.
    rays
        (..., xyz) vectors of the room, of any length.
    floor
        A floor that goes on beyond its edge.
    """
    squash = np.array([1, 1, 1 / dome.height_ratio]) / dome.radius
    p, d = (start @ dome.to_room) * squash, (rays @ dome.to_room) * squash
    _, reach = quadric(np, np.sum(d * d, -1), np.sum(p * d, -1), p @ p - 1, on=False)
    if floor is not None:
        drop = np.minimum(rays[..., 2], -1e-9)
        reach = np.minimum(reach, np.maximum(0.0, (floor.height - start[2]) / drop))
    return np.asarray(start + reach[..., None] * rays)


def lit_edge(theatre: Theatre, lens: Lens) -> tuple[Floats, NDArray[np.bool_]]:
    """(ray, xyz) the edge of what a projector lights of the screen, and whether it lights any.

    Where the edge of its field misses the screen, the last ray inwards that meets it counts.
    """
    ends = lands(theatre.dome, np.asarray(lens.position), field_rays(lens), theatre.floor)
    met = on_screen(theatre.dome, ends)
    return ends[met.argmax(axis=0), np.arange(ends.shape[1])], np.asarray(met.any(axis=0))


def on_screen(dome: Dome, points: Floats) -> NDArray[np.bool_]:
    """(...): whether points of the room (..., xyz) are on the screen."""
    local = points @ dome.to_room
    distance = np.linalg.norm(local, axis=-1)
    directions = local / np.maximum(distance, 1e-12)[..., None]
    on = np.abs(distance - dome.distance(directions)) < 1e-6 * dome.radius
    on &= np.arccos(np.clip(directions[..., 2], -1, 1)) <= dome.half_angle + 1e-9
    if dome.truncated_below is not None:
        on &= points[..., 2] >= dome.truncated_below
    return np.asarray(on)
