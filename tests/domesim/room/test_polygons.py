"""Mesh files whose polygons have notches, whose axes and units are other programs'."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.room.furniture import box, from_file, require_near
from domesim.room.theatre import Solid

GREY = (0.1, 0.1, 0.1)
L = np.array([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)], float)
DART = np.array([(0, 0), (4, 4), (0, 1.5), (-4, 4)], float)
COMB = np.array(
    [*((0, 0), (9, 0), (9, 5), (7, 5), (7, 1), (5, 1)),
     *((5, 5), (4, 5), (4, 1), (2, 1), (2, 5), (0, 5))], float,
)  # fmt: skip
STAIRS = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 2), (1, 2), (1, 1), (0, 1)], float)
PLANES = (
    ((1, 0, 0), (0, 1, 0)),
    ((0, 0.6, 0.8), (1, 0, 0)),
    ((0.6, 0, 0.8), (0, -1, 0)),
)
OUTLINES = {"L": (L, 7), "dart": (DART, 6), "comb": (COMB, 29), "stairs": (STAIRS, 6)}


def area(flat: np.ndarray) -> float:
    x, y = flat.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def in_space(flat: np.ndarray, turn: int) -> np.ndarray:
    """(corner, xyz) of an outline in a plane that is aslant."""
    first, second = np.array(PLANES[turn])
    return flat[:, :1] * first + flat[:, 1:] * second + (1, 2, 3)


def text(kind: str, corners: np.ndarray, order: list[int]) -> bytes:
    places = "\n".join(" ".join(f"{value:g}" for value in corner) for corner in corners)
    count = len(order)
    if kind == "obj":
        places = "\n".join(f"v {line}" for line in places.splitlines())
        return f"{places}\nvt 0 0\nf {' '.join(f'{k + 1}/1' for k in order)}\n".encode()
    if kind == "obj of negative numbers":
        places = "\n".join(f"v {line}" for line in places.splitlines())
        return f"{places}\nf {' '.join(str(k - count) for k in order)}  # all\n".encode()
    if kind == "off":
        return f"OFF\n# made\n{count} 1 0\n{places}\n{count} {' '.join(map(str, order))}\n".encode()
    binary = kind == "binary ply"
    form = "binary_little_endian" if binary else "ascii"
    head = f"ply\nformat {form} 1.0\nelement vertex {count}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if binary:
        body = corners.astype("<f4").tobytes() + struct.pack(f"<B{count}i", count, *order)
        return head.encode() + body
    return f"{head}{places}\n{count} {' '.join(map(str, order))}\n".encode()


def sizes(solid: Solid) -> np.ndarray:
    """Areas of its triangles, as vectors: (triangle, xyz)."""
    a, b, c = (np.asarray(solid.vertices)[np.asarray(solid.faces)[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


@pytest.mark.parametrize("kind", ["obj", "obj of negative numbers", "off", "ply", "binary ply"])
@pytest.mark.parametrize("name", OUTLINES)
def test_a_notch_stays_open(tmp_path: Path, kind: str, name: str) -> None:
    flat, expected = OUTLINES[name]
    assert area(flat) == pytest.approx(expected)
    path = tmp_path / f"floor.{kind.split(maxsplit=1)[0] if 'ply' not in kind else 'ply'}"
    for turn in range(3):
        for begin in range(len(flat)):
            for backwards in (False, True):
                order = [*np.roll(np.arange(len(flat)), begin)]
                order = order[::-1] if backwards else order
                path.write_bytes(text(kind, in_space(flat, turn), order))
                parts = sizes(from_file(path, "floor", GREY))
                assert len(parts) == len(flat) - 2
                assert np.linalg.norm(parts, axis=-1).sum() == pytest.approx(expected, rel=1e-5)
                assert np.linalg.norm(parts.sum(axis=0)) == pytest.approx(expected, rel=1e-5)


def test_a_hole_with_a_bridge_and_points_in_sides_are_kept(tmp_path: Path) -> None:
    ring = [(0, 0), (4, 0), (4, 2), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
    flat = np.array(ring, float)
    path = tmp_path / "ring.off"
    path.write_bytes(text("off", in_space(flat, 1), [*range(len(flat))]))
    parts = sizes(from_file(path, "ring", GREY))
    assert np.linalg.norm(parts, axis=-1).sum() == pytest.approx(12)


def test_a_polygon_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    star = np.array([(np.cos(k * 0.8 * np.pi), np.sin(k * 0.8 * np.pi)) for k in range(5)])
    for flat in (star, np.array([(0, 0), (2, 2), (2, 0), (0, 2.5)])):
        path = tmp_path / "star.obj"
        path.write_bytes(text("obj", in_space(flat, 0), [*range(len(flat))]))
        with pytest.raises(InputError, match=r"a polygon that crosses itself\. Triangulate"):
            from_file(path, "star", GREY)


def test_many_corners_take_no_memory(tmp_path: Path) -> None:
    """A saw of 20 000 teeth; smaller ones are cut."""
    for teeth in (300, 5000, 20_000):
        x = np.arange(2 * teeth + 1)
        saw = np.column_stack([x, x % 2 + 1.0])
        flat = np.concatenate([[(2 * teeth, 0), (0, 0)], saw])[::-1]
        path = tmp_path / "saw.off"
        path.write_bytes(text("off", in_space(flat, 0), [*range(len(flat))]))
        if teeth <= 5000:
            parts = sizes(from_file(path, "saw", GREY))
            assert np.linalg.norm(parts, axis=-1).sum() == pytest.approx(area(flat))
        else:
            with pytest.raises(InputError, match="a polygon of 40003 corners"):
                from_file(path, "saw", GREY)


def test_quads_and_triangles_of_one_file(tmp_path: Path) -> None:
    mixed = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\nf 2//1 5//1 3//1\n"
    (tmp_path / "x.obj").write_bytes(mixed)
    parts = sizes(from_file(tmp_path / "x.obj", "x", GREY))
    np.testing.assert_allclose(np.linalg.norm(parts, axis=-1).sum(), 2.0)


@pytest.mark.parametrize(("unit", "near"), [(1.0, True), (1000.0, False), (100.0, False)])
@pytest.mark.parametrize("radius", [4.0, 7.62, 15.0])
def test_a_thing_in_millimetres_is_refused(unit: float, near: bool, radius: float) -> None:
    """Of a person, a console or a booth, in the room or under it."""
    for low, high in (
        ((-0.3, 1, -3), (0.3, 1.4, -1.2)),
        ((0.1, 0.1, 0.1), (0.6, 0.5, 1.1)),
        ((-2, -9, -5), (2, -6, -2)),
    ):
        placed = box("it", low, high, GREY)
        thing = Solid("it", np.asarray(placed.vertices) * unit, placed.faces, GREY)
        if near or np.abs(thing.vertices).max() < max(5 * radius, 30):
            require_near(thing, radius)
        else:
            with pytest.raises(InputError, match=r"it reaches from .* is it in millimetres\?"):
                require_near(thing, radius)
