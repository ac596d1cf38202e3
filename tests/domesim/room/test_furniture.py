"""What stands in a theatre: where it is meant to be, few triangles, and nobody's view blocked."""

from __future__ import annotations

import json
import os
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.furniture import EYE_HEIGHT, box, from_file, manikin, seating
from domesim.room.theatre import Solid

GREY = (0.1, 0.2, 0.3)
PLAN: dict[str, Any] = {
    "floor_height": -2.3,
    "rows": 3,
    "seats_per_row": 5,
    "first_row": 1.5,
    "row_spacing": 1.1,
    "seat_spacing": 0.7,
    "rise": 0.25,
    "within": 6.0,
    "albedo": GREY,
    "occupied": 0.4,
    "audience_albedo": (0.3, 0.2, 0.1),
    "seed": 3,
    "look_at": (0.0, 5.0, 4.0),
}


def planned(**changes: Any) -> Any:
    solids, viewpoints = seating(**(PLAN | changes))
    return {solid.name: solid for solid in solids}, viewpoints


def bodies(solid: Solid) -> int:
    """Number of closed parts."""
    return len(mesh(solid).split())


def mesh(solid: Solid) -> Any:
    return trimesh.Trimesh(solid.vertices, solid.faces)


def first_hit(solids: list[Solid], start: Any, toward: NDArray[np.float64]) -> float:
    """Distance to the first triangle (Moeller-Trumbore), inf if there is none."""
    nearest = np.inf
    for solid in solids:
        a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
        across = np.cross(toward, c - a)
        scale = np.sum((b - a) * across, -1)
        facing = np.abs(scale) > 1e-9
        a, b, c, across, scale = (part[facing] for part in (a, b, c, across, scale))
        u = np.sum((start - a) * across, -1) / scale
        q = np.cross(start - a, b - a)
        v = q @ toward / scale
        t = np.sum((c - a) * q, -1) / scale
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        nearest = min(nearest, float(t[met].min(initial=np.inf)))
    return nearest


def test_every_row_is_behind_and_above_the_one_in_front():
    _, views = planned()
    assert views["row1-seat1"].position == pytest.approx((-1.4, 1.5, -1.1))
    assert views["row3-seat5"].position == pytest.approx((1.4, 1.5 - 2.2, -1.1 + 0.5))
    assert len([name for name in views if "-seat" in name]) == 15
    assert all(view.look_at == (0.0, 5.0, 4.0) for view in views.values())


def test_solids_are_closed_meshes_of_few_triangles_on_the_floor():
    solids, _ = planned()
    assert set(solids) == {"seats", "risers", "audience"}
    for solid in solids.values():
        assert solid.vertices.dtype == np.float64
        assert solid.faces.dtype == np.int64
        assert solid.vertices[:, 2].min() >= -2.3 - 1e-12
    assert mesh(solids["seats"]).is_volume
    assert mesh(solids["audience"]).is_volume
    assert len(solids["seats"].faces) <= 15 * 60
    assert len(solids["audience"].faces) <= 6 * 60
    assert solids["seats"].albedo == GREY
    assert solids["audience"].albedo == (0.3, 0.2, 0.1)


def test_the_audience_is_the_occupied_share_and_the_seed_places_it():
    a, b, c = (planned(seed=seed)[0]["audience"] for seed in (3, 3, 4))
    assert bodies(a) == 6 * 4  # head, torso, thighs, shins
    np.testing.assert_array_equal(a.vertices, b.vertices)
    assert not np.array_equal(a.vertices, c.vertices)
    assert bodies(planned(occupied=1.0)[0]["audience"]) == 15 * 4
    assert "audience" not in planned(occupied=0.0)[0]


def test_the_audience_sits_on_its_seats():
    solids, views = planned(occupied=1.0)
    heads = solids["audience"].vertices[:, 2].max()
    assert heads == pytest.approx(views["back"].position[2] + 0.08, abs=0.03)
    assert EYE_HEIGHT == 1.2


def test_a_full_house_does_not_block_the_view():
    solids, views = planned(occupied=1.0)
    for view in views.values():
        eye = np.array(view.position)
        for field in (-0.6, 0.0, 0.6):
            toward = np.array(view.look_at) - eye
            turn = np.array([[np.cos(field), -np.sin(field)], [np.sin(field), np.cos(field)]])
            toward[:2] = turn @ toward[:2]
            assert first_hit(list(solids.values()), eye, toward) > 1
        back = np.array([0.0, -1.0, -0.2])
        assert first_hit([solids["audience"]], eye, back) < 0.1  # the face is right behind it


def test_seats_stay_within_the_radius_and_keep_their_numbers():
    solids, views = planned(within=1.8, rows=2, rise=0.0)
    assert np.hypot(*solids["seats"].vertices[:, :2].T).max() <= 1.8
    assert "row1-seat1" not in views
    assert "row2-seat2" in views
    assert views["row2-seat2"].position[0] == pytest.approx(-0.7)
    assert "risers" not in solids


def test_risers_end_at_the_radius_and_carry_the_seats():
    solids, _ = planned(within=2.4, rows=5)
    risers = solids["risers"]
    assert np.hypot(*risers.vertices[:, :2].T).max() <= 2.4 + 1e-9
    down = np.array([0.0, 0.0, -1.0])
    assert first_hit([risers], np.array([0.01, -0.7, 0.0]), down) == pytest.approx(2.3 - 0.5)
    assert first_hit([risers], np.array([0.01, 0.4, 0.0]), down) == pytest.approx(2.3 - 0.25)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"within": 0.5}, "room for a seat within 0.5 m of the middle"),
        ({"rows": 0}, "rows of at least 1, got 0"),
        ({"seat_spacing": 0.0}, "seat_spacing above 0 m, got 0 m"),
        ({"rise": -0.1}, "rise of 0 m or more, got -0.1 m"),
        ({"occupied": 1.2}, "occupied share of 0 to 1, got 1.2"),
    ],
)
def test_seating_says_what_is_wrong(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        planned(**changes)
    assert "\n" not in str(caught.value)


def test_a_box_is_closed_and_faces_outwards():
    booth = box("booth", (-1.0, -4.0, -2.0), (1.0, -3.0, 0.5), GREY)
    assert booth.name == "booth"
    assert mesh(booth).volume == pytest.approx(2 * 1 * 2.5)
    with pytest.raises(InputError, match=r"booth: .* got \(0, 0, 0\) and \(1, 0, 1\) m"):
        box("booth", (0.0, 0.0, 0.0), (1.0, 0.0, 1.0), GREY)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off", "glb"])
def test_a_mesh_file_is_read_as_it_was_written(tmp_path: Path, suffix: str):
    path = tmp_path / f"console.{suffix}"
    booth = box("booth", (-1.0, -4.0, -2.0), (1.0, -3.0, 0.5), GREY)
    written = mesh(booth)
    if suffix == "glb":  # y is up
        written.vertices = written.vertices[:, [0, 2, 1]] * (1, 1, -1)
    written.export(path)
    read = from_file(path, "console", GREY)
    assert (read.name, read.albedo) == ("console", GREY)
    assert mesh(read).volume == pytest.approx(5.0)
    np.testing.assert_allclose(mesh(read).bounds, mesh(booth).bounds)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.obj", b"# nothing\n"),
        ("cut.ply", b"ply\nformat ascii 1.0\nelement vertex 5\n"),
        ("cut.glb", b"glTFxxxxxxxx"),
        ("seats.xyz9", b"x"),
    ],
)
def test_a_file_without_a_mesh_is_one_line(tmp_path: Path, name: str, content: bytes):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: wanted the mesh of seats, got .*STL") as caught:
        from_file(tmp_path / name, "seats", GREY)
    assert "\n" not in str(caught.value)


MATERIAL = b"mtllib seats.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def test_no_other_files_are_opened(tmp_path: Path) -> None:
    (tmp_path / "seats.obj").write_bytes(MATERIAL)
    os.mkfifo(tmp_path / "seats.mtl")  # to open it would wait for ever
    assert len(from_file(tmp_path / "seats.obj", "seats", GREY).faces) == 1


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("many.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 900000000000\n"
                     b"property float x\nend_header\n"),
        ("many.off", b"OFF\n90000000000 1 0\n0 0 0\n"),
        ("many.glb", b'glTF\2\0\0\0{"accessors":[{"count": 90000000000}]}'),
    ],
)  # fmt: skip
def test_counts_that_no_file_could_hold_are_refused(
    tmp_path: Path, name: str, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trimesh.load_mesh", None)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"counts of more things than its .* bytes can hold"):
        from_file(tmp_path / name, "seats", GREY)


@pytest.mark.parametrize(
    ("name", "content", "wrong"),
    [
        ("seats.stl", b"PK\3\4" + bytes(400), "a ZIP archive"),
        ("seats.obj", b"\x1f\x8b\x08" + bytes(400), "a gzip archive"),
        ("seats.stl", bytes(80) + b"\0\xff\xff\xff" + bytes(50), "(not read as STL|no triangles)"),
        ("seats.glb", b"glTF" + bytes(8) + b"\2\0\0\0JSON[]", "does not read as GLB"),
    ],
)
def test_what_is_wrong_is_named_and_no_word_of_a_library(
    tmp_path: Path, name: str, content: bytes, wrong: str
) -> None:
    """The second STL is decoded as text, by a module that need not be there."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"got .*{wrong}") as caught:
        from_file(tmp_path / name, "seats", GREY)
    assert not re.search("module|index|NoneType|unpack", str(caught.value))


def glb(parts: int = 1, **told: Any) -> bytes:
    """A triangle, drawn in as many parts of three vertices as are wanted."""
    part = {"attributes": {"POSITION": 0}, "indices": 1}
    content = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 48}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [part] * parts}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        **told,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    points = np.float32([0, 0, 0, 1, 0, 0, 0, 1, 0]).tobytes() + np.uint32([0, 1, 2]).tobytes()
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(points), b"BIN\0") + points
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


@pytest.mark.parametrize(
    ("content", "wrong"),
    [
        (glb(parts=100), "300 vertices, of at most 200"),
        (glb(nodes=[{"mesh": 0}] * 100), "300 vertices, of at most 200"),
        (glb(extensionsRequired=["KHR_draco_mesh_compression"]), "compressed .KHR_draco"),
        (glb(buffers=[{"byteLength": 48, "uri": "../seats.bin"}]), "lies in another file"),
    ],
)
def test_a_glb_that_must_not_be_read(
    tmp_path: Path, content: bytes, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Few bytes may name a part many times: a million vertices in a thousand places."""
    monkeypatch.setattr("domesim.room.furniture._VERTICES", 200)
    (tmp_path / "seats.glb").write_bytes(glb(parts=60))
    assert len(from_file(tmp_path / "seats.glb", "seats", GREY).faces) == 60
    monkeypatch.setattr("trimesh.load_mesh", None)
    (tmp_path / "seats.glb").write_bytes(content)
    with pytest.raises(InputError, match=wrong):
        from_file(tmp_path / "seats.glb", "seats", GREY)


def test_a_manikin_stands_where_it_should():
    person = manikin("person", (1.0, 2.0, -3.0), GREY)
    assert mesh(person).is_volume
    assert person.vertices[:, 2].min() == pytest.approx(-3.0)
    assert person.vertices[:, 2].max() == pytest.approx(-1.25)
    assert person.vertices[:, :2].mean(axis=0) == pytest.approx([1.0, 2.0], abs=0.05)
