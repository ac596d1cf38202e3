"""What stands in a theatre, as triangles: rows of seats and who sits in them, a booth, any mesh.

A seat's place (x, y) is where the eyes of its sitter are. The seat leans back from there, so that
the eye of a viewpoint lies just in front of the sitter's face and sees past it. Rows are straight
and face the front; row 1 is the front row, and seat 1 is the leftmost that would stand there if
the room were wide enough. A seat that does not fit is left out and keeps its number.

Parts are few: 36 triangles make a seat, 56 a person. Light that meets them is diffuse, and hundreds
of them must not slow a path tracer down.
"""

from __future__ import annotations

import io
import json
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.frames.messages import one_line
from domesim.host.files import read_plain
from domesim.room import polygons
from domesim.room.theatre import Albedo, Point, Solid, Viewpoint

EYE_HEIGHT = 1.2
"""Height of the eyes of a seated person above their feet, m."""
MANIKIN_HEIGHT = 1.75
"""Height of a standing person, m."""

_AISLE = 0.6  # of a riser beyond the outermost seats, m
_BEHIND = 0.5  # from a seat's place to the end of its riser, m


def seating(  # noqa: PLR0913 - as scene files have them
    *,
    floor_height: float,
    rows: int,
    seats_per_row: int,
    first_row: float,
    row_spacing: float,
    seat_spacing: float,
    rise: float,
    within: float,
    albedo: Albedo,
    occupied: float,
    audience_albedo: Albedo,
    seed: int,
    look_at: Point,
) -> tuple[tuple[Solid, ...], dict[str, Viewpoint]]:
    """Rows of seats, the audience in some of them, and how the dome looks from each.

    Parameters
    ----------
    floor_height
        z of the floor under the front row, m.
    rows, seats_per_row
        How many, at most: a seat outside `within` is left out.
    first_row
        y of the front row, m; the others stand behind it.
    row_spacing, seat_spacing
        Distance from row to row, and from seat to seat in a row, m.
    rise
        How much higher each row stands than the one in front, m.
    within
        Radius about the z axis that every part of a seat stays inside, m.
    albedo
        Albedo of the seats and the risers.
    occupied
        Share of the seats in which somebody sits, 0..1.
    audience_albedo
        Albedo of the people.
    seed
        Seed that decides which seats are occupied.
    look_at
        The point that all viewpoints look at, m.

    Returns
    -------
    tuple of Solid
        "seats", "risers" if the rows rise, and "audience" if there is any.
    dict of Viewpoint
        "row3-seat5" for every seat there is, and "front", "centre" and "back" for the seats nearest
        to the middle of the first, the middle and the last row.

    Raises
    ------
    InputError
        If a number is out of range, or no seat fits.
    """
    for name, count in (("rows", rows), ("seats_per_row", seats_per_row)):
        if count < 1:
            raise InputError(f"seating wants {name} of at least 1, got {count}. Leave seating out.")
    for name, metres in (
        ("row_spacing", row_spacing),
        ("seat_spacing", seat_spacing),
        ("within", within),
    ):
        if not (np.isfinite(metres) and metres > 0):
            raise InputError(f"seating wants {name} above 0 m, got {metres:g} m. Correct it.")
    for name, metres in (("floor_height", floor_height), ("first_row", first_row)):
        if not np.isfinite(metres):
            raise InputError(f"seating wants a finite {name}, got {metres:g} m. Correct it.")
    if not (np.isfinite(rise) and rise >= 0):
        raise InputError(f"seating wants a rise of 0 m or more, got {rise:g} m. Correct it.")
    if not 0 <= occupied <= 1:
        raise InputError(
            f"seating wants an occupied share of 0 to 1, got {occupied:g}. Correct it."
        )
    seat = _seat(min(0.56, 0.92 * seat_spacing))
    places = [
        _Seat(row, number, (x, first_row - row * row_spacing, floor_height + row * rise))
        for row in range(rows)
        for number, x in enumerate(
            float(step * seat_spacing)
            for step in np.arange(seats_per_row) - (seats_per_row - 1) / 2
        )
    ]
    seats = [each for each in places if _reach(seat, each.foot) <= within]
    if not seats:
        nearest = min(_reach(seat, each.foot) for each in places)
        raise InputError(
            f"seating wants room for a seat within {within:g} m of the middle, "
            f"but the nearest reaches out to {nearest:.2f} m. "
            f"Enlarge within, or bring first_row ({first_row:g} m) nearer to 0."
        )
    solids = [_solid("seats", [_moved(seat, each.foot) for each in seats], albedo)]
    if rise > 0:
        risers = _risers(seats, row_spacing, floor_height, within)
        solids += [_solid("risers", risers, albedo)] if risers else []
    taken = np.random.default_rng(seed).permutation(len(seats))[: round(occupied * len(seats))]
    if taken.size:
        person = _sitter()
        people = [_moved(person, seats[index].foot) for index in np.sort(taken)]
        solids.append(_solid("audience", people, audience_albedo))
    return tuple(solids), _viewpoints(seats, look_at)


def box(name: str, low: Point, high: Point, albedo: Albedo) -> Solid:
    """The box between two opposite corners, m: a projection booth, a console.

    Raises
    ------
    InputError
        If `low` is not below `high` in every coordinate.
    """
    if not (np.all(np.isfinite([low, high])) and np.all(np.less(low, high))):
        raise InputError(
            f"{name}: wanted a low corner below the high one in x, y and z, "
            f"got {_shown(low)} and {_shown(high)} m. Exchange what is the wrong way round."
        )
    return _solid(name, [_box(low, high)], albedo)


def from_file(path: str | Path, name: str, albedo: Albedo) -> Solid:
    """The triangles of a mesh file: STL, PLY, OBJ, OFF or GLB.

    Its coordinates are taken for metres in the room's frame; GLB has y up and looks along z, and is
    turned (glTF 2.0, 3.4).

    Raises
    ------
    InputError
        If there is no such file, it cannot be read as a mesh, or there is no triangle in it.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: wanted the mesh of {name}, got no such file. Correct the path.")
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _COUNTS:
        raise InputError(
            f"{path}: wanted the mesh of {name}, got a file '.{kind}'. Export it as STL, PLY or "
            f"OBJ."
        )
    try:
        content = read_plain(path, _LARGEST)
        if wrong := _wrong(kind, content):
            raise InputError(
                f"{path}: wanted the mesh of {name}, got {wrong}. Export it as STL, PLY or OBJ."
            )
        vertices, faces = _triangles(kind, content)
        if kind == "glb":
            vertices = vertices[:, [0, 2, 1]] * (1, -1, 1)
    except InputError:
        raise
    except polygons.PolygonError as error:
        raise InputError(
            f"{path}: wanted the mesh of {name}, got {error}. Triangulate it where it was made "
            "(Blender: Triangulate Faces)."
        ) from error
    except Exception as error:  # trimesh's readers raise whatever their parsing runs into
        raise InputError(
            f"{path}: wanted the mesh of {name}, got a file that does not read as {kind.upper()}. "
            f"It is damaged, or something else: export it again, as STL, PLY or OBJ."
        ) from error
    if not len(faces):
        raise InputError(
            f"{path}: wanted the mesh of {name}, got no triangles. Export it as STL, PLY or OBJ."
        )
    if not np.all(np.isfinite(vertices)):
        raise InputError(
            f"{path}: wanted the mesh of {name}, got coordinates that are not finite. "
            f"Export it again."
        )
    return Solid(name, vertices, faces, albedo)


_FAR, _HALL = 5.0, 30.0
"""How far a thing reaches at most: of the theatre's radius, or of a hall around it, m."""


def require_near(solid: Solid, radius: float) -> None:
    """Refuse a thing that reaches far out of a theatre, as one in millimetres does.

    Parameters
    ----------
    solid
        The thing.
    radius
        The theatre's, m.

    Raises
    ------
    InputError
        If it does.
    """
    axis = int(np.abs(solid.vertices).max(axis=0).argmax())
    low, high = solid.vertices[:, axis].min(), solid.vertices[:, axis].max()
    if max(-low, high) > max(_FAR * radius, _HALL):
        raise InputError(
            f"{solid.name} reaches from {low:.4g} to {high:.4g} m ({'xyz'[axis]}), far out of the "
            f"theatre (radius {radius:.4g} m): is it in millimetres? Export it in metres."
        )


def _triangles(kind: str, content: bytes) -> _Mesh:
    """Vertices and triangles of a mesh file, what has more corners cut into them."""
    held = None
    if kind == "obj" and re.search(rb"(?m)^[ \t]*f(?:[ \t]+[^\s#]+){4}", content):
        held = polygons.read_obj(content.decode("utf-8", "replace"))
    if kind == "off":
        held = polygons.read_off(content.decode("utf-8", "replace"))
    if held is None:
        # Without a path, no other files are looked for: materials and pictures
        mesh = import_module("trimesh").load_mesh(io.BytesIO(content), file_type=kind)
        held = polygons.read_ply(mesh.metadata["_ply_raw"]) if kind == "ply" else None
    if held is not None:
        return held[0], polygons.triangles(*held)
    vertices = np.array(mesh.vertices, np.float64).reshape(-1, 3)
    return vertices, np.array(mesh.faces, np.int64).reshape(-1, 3)


# Its readers go on with what they lack (pictures, say), but log it on standard error.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def _wrong(kind: str, content: bytes) -> str:
    """Says what a mesh file is, if it must not be read; "" if it may be."""
    start = content[:_HEAD].lstrip(b"\xef\xbb\xbf \t\r\n")
    for mark, other in _OTHERS.items():
        if start.startswith(mark):
            return other
    counts = re.findall(_COUNTS[kind], content[:_HEAD]) if _COUNTS[kind] else []
    if max(map(int, counts), default=0) > len(content):
        return f"counts of more things than its {len(content)} bytes can hold"
    return _wrong_glb(content) if kind == "glb" else ""


def _wrong_glb(content: bytes) -> str:
    """`_wrong` of a GLB, by its chunk of JSON (glTF 2.0, 4.4): parts may be named many times."""
    header = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    for extension in header.get("extensionsRequired", []):
        if extension.endswith("_compression"):
            return f"geometry that is compressed ({one_line(extension)})"
    if any(not each.get("uri", "data:").startswith("data:") for each in header.get("buffers", [])):
        return "geometry that lies in another file"
    held = [each["count"] for each in header.get("accessors", [])]
    sizes = [
        sum(held[part["attributes"]["POSITION"]] for part in mesh["primitives"])
        for mesh in header.get("meshes", [])
    ]
    shown = [sizes[node["mesh"]] for node in header.get("nodes", []) if "mesh" in node]
    if (vertices := max(sum(sizes), sum(shown))) > _VERTICES:
        return f"{vertices} vertices, of at most {_VERTICES}"
    return ""


_OTHERS = {b"PK\3\4": "a ZIP archive", b"\x1f\x8b": "a gzip archive", b"<?xml": "XML"}
_VERTICES = 20_000_000
_LARGEST = 1 << 30  # bytes
_HEAD = 1 << 20  # bytes, in which a file tells its counts
_COUNTS = {
    "stl": rb"",
    "obj": rb"",
    "ply": rb"(?m)^element \S+ ([0-9]+)",
    "off": rb"(?m)^(?:OFF)?\s*([0-9]{7,})",
    "glb": rb'"(?:count|byteLength)"\s*:\s*([0-9]+)',
}
"""Where kinds of meshes tell how many things they hold; trimesh makes room for them at once."""


def manikin(name: str, foot: Point, albedo: Albedo, height: float = MANIKIN_HEIGHT) -> Solid:
    """A person who stands at `foot`: the measure of a room in a picture of it.

    Parameters
    ----------
    name
        What to call it.
    foot
        Where it stands, m.
    albedo
        Its albedo.
    height
        Its height, m.
    """
    head = import_module("trimesh").creation.icosphere(subdivisions=2, radius=1.0)
    head.apply_scale([0.085, 0.1, 0.125])
    head.apply_translation([0.0, 0.0, 1.625])
    # (half-axis across x, across y, z) of a person of 1.75 m
    leg = _turned([(0.06, 0.11, 0.0), (0.05, 0.05, 0.12), (0.075, 0.08, 0.8)], 8)
    arm = _turned([(0.04, 0.05, 0.7), (0.05, 0.06, 1.2), (0.04, 0.04, 1.4)], 8)
    trunk = [(0.16, 0.11, 0.78), (0.17, 0.12, 0.9), (0.15, 0.1, 1.1), (0.19, 0.12, 1.35),
             (0.15, 0.09, 1.43), (0.06, 0.06, 1.47), (0.05, 0.05, 1.6)]  # fmt: skip
    body = _joined(
        [
            *(_moved(leg, (side * 0.09, 0.0, 0.0)) for side in (-1, 1)),
            *(_moved(arm, (side * 0.22, 0.0, 0.0)) for side in (-1, 1)),
            _turned(trunk, 16),
            (np.array(head.vertices), np.array(head.faces, np.int64)),
        ]
    )
    vertices = body[0] * (height / MANIKIN_HEIGHT) + np.asarray(foot)
    return Solid(name, vertices, body[1], albedo)


# Meshes: vertices (vertex, xyz) and faces (face, 3).

_Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


@dataclass(frozen=True)
class _Seat:
    row: int
    number: int
    foot: Point


def _seat(width: float) -> _Mesh:
    """A pedestal, a cushion and a back that reclines by 30 degrees."""
    half = width / 2
    back = _leaning(half, (0.0, 0.42), (-0.38, 1.08), 0.09)
    return _joined(
        [
            _box((-0.6 * half, 0.05, 0.0), (0.6 * half, 0.35, 0.36)),
            _box((-half, 0.0, 0.36), (half, 0.5, 0.46)),
            back,
        ]
    )


def _sitter() -> _Mesh:
    """Head, torso, thighs and shins; the face is just behind the eye at (0, 0, EYE_HEIGHT)."""
    return _joined(
        [
            _moved(_icosahedron(0.115), (0.0, -0.14, EYE_HEIGHT - 0.02)),
            _leaning(0.2, (0.21, 0.47), (-0.11, 1.03), 0.2),
            _box((-0.17, 0.1, 0.46), (0.17, 0.58, 0.6)),
            _box((-0.15, 0.48, 0.0), (0.15, 0.6, 0.46)),
        ]
    )


def _risers(
    seats: Sequence[_Seat], row_spacing: float, floor_height: float, within: float
) -> list[_Mesh]:
    """A step for every row above the floor, as wide as the widest row and an aisle on each side."""
    width = max(abs(seat.foot[0]) for seat in seats) + _AISLE
    risers = []
    for _, y, z in sorted({(seat.row, *seat.foot[1:]) for seat in seats}):
        if z <= floor_height:
            continue
        along = np.clip(y - _BEHIND + np.linspace(0, row_spacing, 9), -within, within)
        half = np.minimum(width, np.sqrt(np.maximum(within**2 - along**2, 0.0)))
        outline = np.concatenate(
            [np.stack([half, along], -1), np.stack([-half[::-1], along[::-1]], -1)]
        )
        levels = [np.column_stack([outline, np.full(len(outline), h)]) for h in (floor_height, z)]
        risers.append(_rings(levels))
    return risers


def _viewpoints(seats: Sequence[_Seat], look_at: Point) -> dict[str, Viewpoint]:
    def view(seat: _Seat) -> Viewpoint:
        x, y, z = seat.foot
        return Viewpoint((x, y, z + EYE_HEIGHT), look_at)

    rows = sorted({seat.row for seat in seats})
    named = {"front": rows[0], "centre": rows[len(rows) // 2], "back": rows[-1]}
    views = {}
    # Two seats beside the middle are equally far to the last bit, and the left one counts
    for name, row in named.items():
        views[name] = view(
            min((seat for seat in seats if seat.row == row), key=lambda seat: abs(seat.foot[0]))
        )
    return views | {f"row{seat.row + 1}-seat{seat.number + 1}": view(seat) for seat in seats}


def _reach(mesh: _Mesh, foot: Point) -> float:
    """Largest distance from the z axis, m."""
    return float(np.hypot(*(mesh[0][:, :2] + foot[:2]).T).max())


def _box(low: ArrayLike, high: ArrayLike) -> _Mesh:
    (left, near, bottom), (right, far, top) = np.asarray(low, float), np.asarray(high, float)
    outline = np.array([(left, near), (right, near), (right, far), (left, far)])
    return _rings([np.column_stack([outline, np.full(4, z)]) for z in (bottom, top)])


def _icosahedron(radius: float) -> _Mesh:
    """Two tops, and two rings of five between them."""
    around = np.arange(5) * (2 * np.pi / 5)
    rings = [
        np.column_stack([2 * np.cos(a), 2 * np.sin(a), np.full(5, z)])
        for a, z in ((around, -1), (around + np.pi / 5, 1))
    ]
    vertices = np.concatenate([*rings, [[0, 0, -np.sqrt(5)], [0, 0, np.sqrt(5)]]])
    here = np.arange(5)
    there = (here + 1) % 5
    bottom, top = np.full(5, 10), np.full(5, 11)
    faces = [
        np.stack(corners, -1)
        for corners in (
            (here, there, here + 5),
            (there, there + 5, here + 5),
            (there, here, bottom),
            (here + 5, there + 5, top),
        )
    ]
    return vertices * (radius / np.sqrt(5)), np.concatenate(faces)


def _leaning(
    half_width: float, low: tuple[float, float], high: tuple[float, float], thickness: float
) -> _Mesh:
    """A slab whose front face runs from (y, z) `low` to `high`."""
    length = float(np.hypot(high[0] - low[0], high[1] - low[1]))
    vertices, faces = _box((-half_width, -thickness, 0.0), (half_width, 0.0, length))
    up = np.array([0.0, high[0] - low[0], high[1] - low[1]]) / length
    forth = np.array([0.0, up[2], -up[1]])
    turned = vertices[:, :1] * [1, 0, 0] + vertices[:, 1:2] * forth + vertices[:, 2:] * up
    return turned + np.array([0.0, *low]), faces


def _turned(outline: Sequence[tuple[float, float, float]], sides: int) -> _Mesh:
    """Elliptic rings (half-axes across x and y, z), joined and closed at both ends."""
    around = np.arange(sides) * (2 * np.pi / sides)
    return _rings(
        [
            np.stack([a * np.cos(around), b * np.sin(around), np.full(sides, z)], -1)
            for a, b, z in outline
        ]
    )


def _rings(rings: Sequence[NDArray[np.float64]]) -> _Mesh:
    """Convex rings of (corner, xyz), anticlockwise from above, joined upwards and closed."""
    sides = len(rings[0])
    here = np.arange(sides)
    there = (here + 1) % sides
    first = np.stack([here, there, there + sides], -1)
    second = np.stack([here, there + sides, here + sides], -1)
    strip = np.concatenate([first, second])
    faces = [strip + level * sides for level in range(len(rings) - 1)]
    cap = np.stack([np.zeros(sides - 2, np.int64), here[2:], here[1:-1]], -1)
    top = cap[:, ::-1] + (len(rings) - 1) * sides
    return np.concatenate(rings), np.concatenate([*faces, cap, top])


def _moved(mesh: _Mesh, offset: Point) -> _Mesh:
    return mesh[0] + np.asarray(offset), mesh[1]


def _joined(meshes: Sequence[_Mesh]) -> _Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    faces = [faces + start for (_, faces), start in zip(meshes, starts[:-1], strict=True)]
    return vertices, np.concatenate(faces)


def _solid(name: str, meshes: Sequence[_Mesh], albedo: Albedo) -> Solid:
    vertices, faces = _joined(meshes)
    return Solid(name, vertices, faces, albedo)


def _shown(point: Any) -> str:
    return "(" + ", ".join(f"{part:g}" for part in point) + ")"
