"""A picture of the theatre itself, cut open by the plane x = 0 and seen from its right.

For whoever wrote a scene file: is that my room? The right half of all shells (screen, cavity, wall)
is taken away and the cut is blue, as in an architect's section; what stands in the room stays
whole. The screen shows a domemaster, or a graticule, as if it glowed: neither falloff nor
cross-reflection is in it. A person of 1.75 m and a bar of 5 m on the ground give the scale.

Reflectances are not the theatre's own: a room whose walls are black would be a black picture. They
keep their order and their hue, on a scale that starts at a dark grey; seats are tinted red and
people blue to tell them apart.

Only diffuse surfaces, meshes and area lights are used, so that any variant of Mitsuba will do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, write_frame
from domesim.light import transfer
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.solids import Triangles, ball, box, join, moved, prism, quad, tube
from domesim.room.beams import lit_edge
from domesim.room.dome import Dome
from domesim.room.furniture import manikin
from domesim.room.lenses import lens_frame
from domesim.room.theatre import Floor, Lamp, Lens, Theatre

Floats = NDArray[np.float64]

_TOWARDS = (12.0, 18.0)  # to the camera: degrees from the right to the front, and upwards
_FIELD = 24.0  # of the camera, vertically, degrees: a long lens, so that verticals stay vertical
_AT_ONCE = 6_000_000  # paths: more do not fit into memory as one wavefront
_BOUNCES = 4
_STEP = np.radians(1.5)  # between the vertices of a shell

_PAPER = (0.80, 0.80, 0.79)
_INK = (0.015, 0.015, 0.018)
_CUT = (0.02, 0.09, 0.32)
_STEEL = (0.10, 0.11, 0.12)
_FIGURE = (0.16, 0.20, 0.27)
_TINTS = {
    "seats": np.array([0.30, 0.05, 0.05]),
    "risers": np.array([0.62, 0.56, 0.48]),
    "audience": np.array([0.20, 0.30, 0.45]),
}
_BEAM = (1.0, 0.62, 0.10)
_FRONT = (0.95, 0.30, 0.03)


def cutaway(
    theatre: Theatre,
    picture: NDArray[np.floating[Any]] | None = None,
    *,
    width: int = 1200,
    height: int = 800,
    samples: int = 64,
    seed: int = 0,
) -> NDArray[np.float32]:
    """Draw `theatre`, cut open.

    Parameters
    ----------
    theatre
        The theatre.
    picture
        What its screen shows: a domemaster (row, col, rgb), linear BT.709, 1.0 = projector white.
        None: a graticule, a line each 30 degrees of azimuth and 15 degrees from the zenith, with
        the front in red.
    width, height
        Size of the result, pixels.
    samples
        Paths to the pixel; rounded up to a number that spreads evenly.
    seed
        Same seed, same picture.

    Returns
    -------
    ndarray
        (row, col, rgb) linear BT.709 for a display, 0..1. The front of the audience is on the
        right.

    Raises
    ------
    InputError
        If a size is below 1 or `picture` is not a domemaster.
    """
    for name, value in (("width", width), ("height", height), ("samples", samples)):
        if value < 1:
            raise InputError(f"cutaway wants {name} of at least 1, got {value}. Enlarge it.")
    if picture is not None:
        picture = np.asarray(picture, np.float32)
        if picture.ndim != 3 or picture.shape[0] != picture.shape[1] or picture.shape[2] != 3:
            raise InputError(
                f"cutaway wants a domemaster (row, col, 3) with as many rows as columns, "
                f"got {picture.shape}. Crop or pad it to a square around the dome's circle."
            )
        if not np.all(np.isfinite(picture)) or picture.min() < 0:
            raise InputError(
                f"cutaway wants light that is finite and not negative, "
                f"got {picture.min():g} to {picture.max():g}. Repair the picture."
            )
    return _display(_render(load_mitsuba(), theatre, picture, (width, height), samples, seed))


def to_png(picture: NDArray[np.floating[Any]], path: str | Path) -> None:
    """Write `picture` (row, col, rgb), display-linear 0..1, as an sRGB PNG, whole or not at all.

    Raises
    ------
    InputError
        If `path` does not end in ``.png`` or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(
            f"{path}: wanted a name that ends in .png, got '{path.suffix}'. Rename it."
        )
    codes = transfer.SRGB().encode(np.clip(np.asarray(picture, np.float32), 0, 1))
    tag = ColourTag("srgb", "BT.709", "made by domesim")
    write_frame(Frame(codes, path, tag, bits=8, floating=False), path)


def graticule(dome: Dome, size: int = 1024) -> NDArray[np.float32]:
    """A domemaster (row, col, rgb) of a line each 30 degrees of azimuth and 15 from the zenith.

    The meridian to the front is red, with an arc of 60 degrees at its end on the rim.
    """
    centres = (np.arange(size) + 0.5) * (2 / size) - 1
    u, v = centres[None, :], centres[:, None]
    pixel = 2 * dome.half_angle / size
    theta, azimuth = np.hypot(u, v) * dome.half_angle, np.arctan2(v, u)
    ring = np.maximum(np.sin(np.minimum(theta, np.pi)), 1e-6)

    def line(distance: Floats, half_width: float) -> Floats:
        return np.clip((half_width - np.abs(distance)) / pixel + 0.5, 0.0, 1.0)

    def to_nearest(angle: Floats, step: float) -> Floats:
        return (angle + step / 2) % step - step / 2

    parallels = line(to_nearest(theta, np.radians(15)), np.radians(0.28))
    meridians = line(to_nearest(azimuth, np.radians(30)) * ring, np.radians(0.28))
    square = line(to_nearest(azimuth, np.radians(90)) * ring, np.radians(0.28))
    meridians = np.where(theta < np.radians(15), square, meridians)
    from_front = np.abs(to_nearest(azimuth - np.pi / 2, 2 * np.pi))
    front = np.where(from_front < 1, line(from_front * ring, np.radians(0.6)), 0.0)
    arc = line(dome.half_angle - np.radians(3) - theta, np.radians(2))
    front = np.maximum(front, np.where(from_front < np.radians(30), arc, 0.0))
    lines = np.maximum(parallels, meridians)[..., None]
    ground, ink = np.array([0.42, 0.48, 0.55]), np.array([0.02, 0.04, 0.09])
    drawn = ground + lines * (ink - ground)
    return np.asarray(drawn + front[..., None] * (np.array(_FRONT) - drawn), np.float32)


def _display(light: NDArray[np.float32], knee: float = 0.8) -> NDArray[np.float32]:
    """Bend light above `knee` so that it approaches 1.0 instead of being cut off there."""
    room = 1 - knee
    over = np.maximum(light - knee, 0.0)
    return np.asarray(np.minimum(light, knee) + room * (1 - np.exp(-over / room)), np.float32)


# The scene.


@dataclass(frozen=True)
class _Part:
    """Triangles of one material.

    `normals` and `uv` belong to the corners (triangle, corner, ...); `light` is what it radiates:
    a colour, or a picture (row, col, rgb) over uv = 0..1.
    """

    triangles: Triangles
    reflectance: Sequence[float] | Floats
    normals: Floats | None = None
    uv: Floats | None = None
    light: ArrayLike | None = None
    weight: float = 0.1


def _render(
    mi: Any,
    theatre: Theatre,
    picture: NDArray[np.float32] | None,
    size: tuple[int, int],
    samples: int,
    seed: int,
) -> NDArray[np.float32]:
    """(row, col, rgb): light that comes to the camera."""
    parts = [*_model(theatre, picture)]
    corners = np.concatenate([part.triangles.reshape(-1, 3) for part in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    reach = float(np.linalg.norm(high - low)) / 2
    sheet = 60 * reach
    square = quad([-sheet, -sheet, 0], [sheet, -sheet, 0], [sheet, sheet, 0], [-sheet, sheet, 0])
    ground = _Part(moved(square, [0, 0, low[2] - 1e-3 * reach]), _PAPER)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": _BOUNCES, "hide_emitters": False},
        "air": {"type": "constant", "radiance": _rgb((0.84, 0.86, 0.89))},
    }
    middle = (low + high) / 2
    place = middle + reach * np.array([4.2, 2.2, 5.0])
    scene["window"] = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().look_at(place.tolist(), middle.tolist(), [0, 0, 1])
        @ mi.ScalarTransform4f().scale(1.6 * reach),
        "emitter": {"type": "area", "radiance": _rgb((4.2, 4.0, 3.8))},
    }
    for number, part in enumerate([*parts, ground]):
        scene[f"part{number}"] = _mesh(mi, part)
    loaded = mi.load_dict(scene)
    across = int(np.sqrt(samples))
    samples = across * -(-samples // across)  # as many as the sampler can spread evenly
    rows = max(1, _AT_ONCE // (size[0] * samples))
    strips = [(first, min(rows, size[1] - first)) for first in range(0, size[1], rows)]
    framed = _framed(corners, size)
    sensors = [_sensor(mi, framed, size, strip, samples) for strip in strips]
    seeds = np.random.SeedSequence(seed).generate_state(len(strips)).tolist()
    return np.concatenate(
        [
            np.array(mi.render(loaded, sensor=sensor, seed=strip_seed), np.float32)
            for sensor, strip_seed in zip(sensors, seeds, strict=True)
        ]
    )


def _model(theatre: Theatre, picture: NDArray[np.float32] | None) -> Iterator[_Part]:
    """All that is drawn but the ground."""
    dome = theatre.dome
    thick = 0.012 * dome.radius
    cavity = theatre.cavity
    screen = thick if cavity is None else np.clip(0.4 * cavity.depth, 0.05 * thick, thick)
    shown, veil = (graticule(dome), 0.12) if picture is None else (picture, 0.05)
    inner, outer, uv = _cap(dome, 0.0), _cap(dome, screen), _domemaster(dome)
    yield from _shell(inner, outer, uv, dome.truncated_below, (veil,) * 3, shown)
    if cavity is not None:
        inner, outer = _cap(dome, cavity.depth), _cap(dome, cavity.depth + thick)
        grey = _model_grey(cavity.albedo)
        yield from _shell(inner, outer, uv, dome.truncated_below, grey)
    base = dome.lowest
    if theatre.wall is not None:
        wall = theatre.wall
        inner, outer = (
            _cylinder(radius, wall.bottom, wall.top)
            for radius in (wall.radius, wall.radius + thick)
        )
        yield from _shell(inner, outer, None, None, _model_grey(wall.albedo))
        base = min(base, wall.bottom)
    if theatre.floor is not None:
        yield _Part(_slab(theatre.floor, thick), _model_grey(theatre.floor.albedo))
        base = min(base, theatre.floor.height)
    for solid in theatre.solids:
        tint = _TINTS.get(solid.name)
        grey = _model_grey(solid.albedo)
        yield _Part(solid.vertices[solid.faces], grey if tint is None else (grey + tint) / 2)
        base = min(base, float(solid.vertices[:, 2].min()))
    for lamp in theatre.lamps:
        yield _lamp(lamp)
    yield from _projectors(theatre)
    yield from _measures(theatre, base)


def _model_grey(albedo: Sequence[float]) -> Floats:
    """Grey of a surface in the model, from its albedo."""
    return 0.18 + 0.62 * np.clip(np.asarray(albedo, np.float64), 0, 1)


# Shells: the left half of a thick surface, and its cut.


def _half_round() -> Floats:
    """Azimuths of the half that stays, from the front by the left to the rear, radians."""
    return np.linspace(np.pi / 2, 3 * np.pi / 2, round(np.pi / _STEP) + 1)


def _thetas(dome: Dome) -> Floats:
    return np.linspace(0, dome.half_angle, int(np.ceil(dome.half_angle / _STEP)) + 1)


def _cap(dome: Dome, offset: float) -> Floats:
    """(theta, azimuth, xyz): the screen, moved outwards by `offset`, in the room's frame, m."""
    theta, azimuth = np.meshgrid(_thetas(dome), _half_round(), indexing="ij")
    points = dome.surface(theta, azimuth)
    directions = points / np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray((points + offset * dome.normals(directions)) @ dome.to_room.T)


def _domemaster(dome: Dome) -> Floats:
    """(theta, azimuth, uv): where the points of `_cap` are in the domemaster, 0..1."""
    radius, azimuth = np.meshgrid(_thetas(dome) / dome.half_angle, _half_round(), indexing="ij")
    across = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    return np.asarray((radius[..., None] * across + 1) / 2)


def _cylinder(radius: float, bottom: float, top: float) -> Floats:
    """(z, azimuth, xyz), m."""
    z, azimuth = np.meshgrid(np.linspace(bottom, top, 9), _half_round(), indexing="ij")
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], -1)


def _shell(
    inner: Floats,
    outer: Floats,
    uv: Floats | None,
    lowest: float | None,
    reflectance: Sequence[float] | Floats,
    light: NDArray[np.float32] | None = None,
) -> Iterator[_Part]:
    """The inside, the outside, the cut at x = 0 and the other edges of a shell.

    Parameters
    ----------
    inner, outer
        (i, j, xyz): both its sides on one grid, m.
    uv
        (i, j, uv): places in `light`.
    lowest
        z below which there is nothing, m.
    reflectance
        Reflectance of its inside.
    light
        (row, col, rgb): what its inside shows.
    """
    uv = np.zeros((*inner.shape[:2], 2)) if uv is None else uv
    normals = _grid_normals(inner, outer)
    cells = _cells(np.concatenate([inner, outer, normals, uv], -1))
    if lowest is not None:
        cells = _clipped(cells, lowest - cells[..., 2])
    if not len(cells):
        return
    inside, outside, out, places = np.split(cells, [3, 6, 9], axis=-1)
    turned = np.sum(
        np.cross(inside[:, 1] - inside[:, 0], inside[:, 2] - inside[:, 0]) * out[:, 0], -1
    )
    flip = np.where((turned > 0)[:, None], [[0, 2, 1]], [[0, 1, 2]])[..., None]

    def inwards(corners: Floats) -> Floats:
        return np.take_along_axis(corners, flip, axis=1)

    yield _Part(inwards(inside), reflectance, -inwards(out), inwards(places), light)
    yield _Part(outside, _PAPER, out)
    start, end = _rim(cells)
    band = np.stack([start[:, :3], end[:, :3], end[:, 3:6], start[:, 3:6]], axis=1)
    band = band[:, [[0, 1, 2], [0, 2, 3]]]
    scale = float(np.abs(inner).max())
    cut = np.all(np.abs(band[..., 0]) < 1e-6 * scale, axis=(1, 2))
    for edges, colour in ((band[cut], _CUT), (band[~cut], _PAPER)):
        if len(edges):
            yield _Part(edges.reshape(-1, 3, 3), colour)


def _grid_normals(inner: Floats, outer: Floats) -> Floats:
    across = outer - inner
    return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def _cells(grid: Floats) -> Floats:
    """(triangle, corner, value): a grid's cells, without those that have no area."""
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    cells = np.stack([np.stack([a, b, c], -2), np.stack([a, c, d], -2)])
    cells = cells.reshape(-1, 3, grid.shape[-1])
    p, q, r = (cells[:, corner, :3] for corner in range(3))
    area = np.linalg.norm(np.cross(q - p, r - p), axis=-1)
    return np.asarray(cells[area > 1e-9 * area.max()])


def _clipped(cells: Floats, below: Floats) -> Floats:
    """The part of triangles (triangle, corner, value) where `below` (triangle, corner) is <= 0."""
    kept = below <= 0
    count = kept.sum(axis=1)
    result = [cells[count == 3]]
    for alone in (True, False):  # one corner is kept, or one is lost
        chosen = count == (1 if alone else 2)
        first = np.argmax(kept[chosen] == alone, axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        p, q, r = np.moveaxis(np.take_along_axis(cells[chosen], order[..., None], axis=1), 1, 0)
        at_p, at_q, at_r = np.moveaxis(np.take_along_axis(below[chosen], order, axis=1), 1, 0)
        pq = p + (at_p / (at_p - at_q))[:, None] * (q - p)
        pr = p + (at_p / (at_p - at_r))[:, None] * (r - p)
        corners = [(p, pq, pr)] if alone else [(pq, q, r), (pq, r, pr)]
        result += [np.stack(triangle, axis=1) for triangle in corners]
    return np.concatenate(result)


def _rim(cells: Floats) -> tuple[Floats, Floats]:
    """(edge, value) twice: both ends of the edges that belong to one triangle only."""
    scale = np.abs(cells[..., :3]).max()
    keys = np.round(cells[..., :3] / scale * 1e7).astype(np.int64).reshape(-1, 3)
    _, vertex = np.unique(keys, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    ends = np.stack([vertex, np.roll(vertex, -1, axis=1)], -1).reshape(-1, 2)
    values = np.stack([cells, np.roll(cells, -1, axis=1)], -2).reshape(-1, 2, cells.shape[-1])
    _, which, count = np.unique(
        np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    once = (count[which.ravel()] == 1) & (ends[:, 0] != ends[:, 1])
    return values[once, 0], values[once, 1]


# What stands in the room.


def _disc(radius: float, sides: int = 180) -> Floats:
    around = np.arange(sides) * (2 * np.pi / sides)
    return radius * np.stack([np.cos(around), np.sin(around)], -1)


def _slab(floor: Floor, thick: float) -> Triangles:
    return prism(_disc(floor.radius), floor.height - thick, floor.height)


def _lamp(lamp: Lamp) -> _Part:
    centre, across, up = (np.asarray(part) for part in (lamp.centre, lamp.across, lamp.up))
    face = quad(
        centre - across - up, centre + across - up, centre + across + up, centre - across + up
    )
    colour = np.asarray(lamp.luminance, np.float64)
    return _Part(face, _INK, light=2.0 * colour / max(float(colour.max()), 1e-9))


def _projectors(theatre: Theatre) -> Iterator[_Part]:
    """Each projector: its body, a post if it stands free, and what its field lights."""
    dome = theatre.dome
    zenith = dome.to_room @ np.array([0, 0, dome.radius * dome.height_ratio])
    middle = Lens("projector", (0, 0, 0), (0, zenith[1], zenith[2]), field=2 * dome.half_angle)
    size = float(np.clip(0.03 * dome.radius, 0.1, 0.3))
    bodies, beams = [], []
    for lens in theatre.lenses or (middle,):
        at = np.asarray(lens.position, np.float64)
        snout = at + 1.5 * size * lens_frame(lens)[2]
        bodies += [ball(at, size, 16), tube(at, snout, (0.6 * size, 0.6 * size), 16)]
        below = dome.lowest if theatre.floor is None else theatre.floor.height
        if np.hypot(at[0], at[1]) < 0.5 * dome.radius and at[2] - below > size:
            foot = np.array([at[0], at[1], below])
            bodies.append(tube(foot, at, (0.35 * size, 0.35 * size), 12))
        beams += _beams(theatre, lens)
    yield _Part(join(bodies), _STEEL)
    if beams:
        yield _Part(join(beams), _INK, light=_BEAM)


def _beams(theatre: Theatre, lens: Lens) -> list[Triangles]:
    """Thin tubes to the edge of what a projector lights of the left half of the screen, and there.

    Where the edge of its field misses the screen, the last ray inwards that meets it counts.
    """
    dome = theatre.dome
    at, thin = np.asarray(lens.position, np.float64), 0.002 * dome.radius
    if np.linalg.norm((at @ dome.to_room) / [1, 1, dome.height_ratio]) >= dome.radius:
        return []
    edge, met = lit_edge(theatre, lens)
    lit = np.asarray(met & (edge[:, 0] <= 1e-6 * dome.radius))
    spokes = np.arange(0, len(edge), len(edge) // (12 if lens.kind == "equidistant" else 4))
    beams = [tube(at, edge[spoke], (thin, thin), 6) for spoke in spokes if lit[spoke]]
    for here, there, both in zip(
        edge, np.roll(edge, -1, axis=0), lit & np.roll(lit, -1), strict=True
    ):
        if both and 0 < np.linalg.norm(there - here) < 0.3 * dome.radius:
            beams.append(tube(0.995 * here, 0.995 * there, (thin, thin), 6))
    return beams


def _measures(theatre: Theatre, base: float) -> Iterator[_Part]:
    """A person in front of the theatre, and a scale bar with its length, on the ground."""
    thick = 0.012 * theatre.dome.radius
    depth = 0.0 if theatre.cavity is None else theatre.cavity.depth + thick
    shell = theatre.dome.widest + depth
    wall = theatre.wall.radius if theatre.wall else 0.0
    floor = theatre.floor.radius if theatre.floor else 0.0
    around = max(shell, wall, floor) + thick
    ground = base - thick
    person = manikin("person", (0.0, around + 1.0, ground), _FIGURE)
    yield _Part(person.vertices[person.faces], _FIGURE)
    metres = 5 if theatre.dome.radius >= 3 else 1
    side = 0.05 * metres
    x = 0.35 * theatre.dome.radius if theatre.floor is None else floor + 3 * side
    start = np.array([x, around - metres, ground])
    step = metres / 5
    for number in range(5):
        bar = box([0, number * step, 0], [side, (number + 1) * step, side / 2])
        yield _Part(moved(bar, start), _INK if number % 2 == 0 else (0.95, 0.95, 0.95))
    edge = side / 3
    under = box([-edge, -edge, 0], [side + edge, metres + edge, side / 4])
    yield _Part(moved(under, start), _INK)
    yield _Part(moved(_label(metres, 2.4 * side), start + np.array([4 * side, 0, 0])), _INK)


def _label(metres: int, height: float) -> Triangles:
    """Write "5 m" or "1 m" in flat strokes on the ground, to be read from the theatre's right.

    It is twice as tall as it should be: the camera sees it foreshortened.
    """
    five = [(0, 1, 0.6, 1), (0, 0.5, 0, 1), (0, 0.5, 0.6, 0.5), (0.6, 0, 0.6, 0.5), (0, 0, 0.6, 0)]
    one = [(0.3, 0, 0.3, 1)]
    m = [(1.1, 0, 1.1, 0.6), (1.1, 0.6, 1.9, 0.6), (1.5, 0, 1.5, 0.6), (1.9, 0, 1.9, 0.6)]
    thick = 0.06
    strokes = []
    for u0, v0, u1, v1 in (five if metres == 5 else one) + m:
        low = np.array([-2 * (v1 if v1 > v0 else v0) - 2 * thick, u0 - thick, 0])
        high = np.array([-2 * min(v0, v1) + 2 * thick, u1 + thick, 0.02])
        strokes.append(box(height * low, height * high))
    return moved(join(strokes), [2 * height, 0, 0])


# Mitsuba.


def _framed(corners: Floats, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Where the camera is and what it looks at, to just see all of `corners` (corner, xyz)."""
    turn, lift = np.radians(_TOWARDS)
    towards = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(towards, right), towards])
    slopes = 0.93 * np.tan(np.radians(_FIELD) / 2) * np.array([size[0] / size[1], 1.0])
    corners = corners[ConvexHull(corners).vertices]
    target = corners.mean(axis=0)
    for _ in range(12):
        seen = (corners - target) @ frame.T
        distance = float((seen[:, 2] + np.max(np.abs(seen[:, :2]) / slopes, axis=-1)).max())
        angles = seen[:, :2] / (distance - seen[:, 2:])
        target = target + (angles.max(axis=0) + angles.min(axis=0)) / 2 * distance @ frame[:2]
    return target + distance * towards, target


def _sensor(
    mi: Any,
    framed: tuple[Floats, Floats],
    size: tuple[int, int],
    strip: tuple[int, int],
    samples: int,
) -> Any:
    """The camera for some rows of the picture: (first, number)."""
    eye, target = framed
    distance = float(np.linalg.norm(eye - target))
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": _FIELD,
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(eye.tolist(), target.tolist(), [0, 0, 1]),
            "near_clip": 1e-3 * distance,
            "far_clip": 1e3 * distance,
            "film": {
                "type": "hdrfilm",
                "width": size[0],
                "height": size[1],
                "crop_offset_y": strip[0],
                "crop_height": strip[1],
                "crop_offset_x": 0,
                "crop_width": size[0],
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},  # strips then share no pixels
            },
            "sampler": {"type": "multijitter", "sample_count": samples},
        }
    )


def _mesh(mi: Any, part: _Part) -> Any:
    properties = mi.Properties()
    reflectance = _rgb(part.reflectance)
    properties["bsdf"] = mi.load_dict(
        {"type": "twosided", "inner": {"type": "diffuse", "reflectance": reflectance}}
    )
    if part.light is not None:
        properties["light"] = mi.load_dict(
            {"type": "area", "radiance": _radiance(mi, part.light), "sampling_weight": part.weight}
        )
    count = len(part.triangles)
    mesh = mi.Mesh(
        "part",
        vertex_count=3 * count,
        face_count=count,
        has_vertex_normals=part.normals is not None,
        has_vertex_texcoords=part.uv is not None,
        props=properties,
    )
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = _flat(part.triangles)
    buffers["faces"] = np.arange(3 * count, dtype=np.uint32)
    if part.normals is not None:
        buffers["vertex_normals"] = _flat(part.normals)
    if part.uv is not None:
        buffers["vertex_texcoords"] = _flat(part.uv)
    buffers.update()
    return mesh


def _radiance(mi: Any, light: ArrayLike) -> dict[str, Any]:
    values = np.asarray(light, np.float32)
    if values.ndim == 1:
        return _rgb(values)
    bitmap = mi.Bitmap(np.ascontiguousarray(values))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}


def _rgb(value: ArrayLike) -> dict[str, Any]:
    return {"type": "rgb", "value": np.asarray(value, np.float64).tolist()}


def _flat(values: Floats) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32).ravel()
