"""What OpenEXR's bindings do unasked, and no picture shows: each of it, by other readers."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO as oiio  # noqa: N813
import pytest

from domesim.errors import InputError
from domesim.frames import (
    ColourTag,
    Frame,
    read_frame,
    read_master,
    write_frame,
    write_master,
)
from domesim.frames.formats.exr import corners, written

ROWS, COLS = 21, 34
LINEAR = ColourTag("linear", "BT.709", "made so")
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def texture(*shape: int, dtype: str = "float32") -> np.ndarray:
    """Halves, for they are the same in all types."""
    return np.random.default_rng(7).random(shape).astype(np.float16).astype(dtype)


def made(path: Path, *parts: tuple[dict[str, Any], dict[str, np.ndarray]]) -> Path:
    OpenEXR.File([OpenEXR.Part(HEADER | header, dict(each)) for header, each in parts]).write(
        str(path)
    )
    return path


def by_openimageio(path: Path) -> dict[str, np.ndarray]:
    """Channels of the first part, in their own types."""
    reader = oiio.ImageInput.open(str(path))
    spec = reader.spec()
    kinds = [str(each) for each in spec.channelformats] or [str(spec.format)] * spec.nchannels
    planes = {
        name: reader.read_image(0, 0, k, k + 1, kinds[k])[..., 0]
        for k, name in enumerate(spec.channelnames)
    }
    reader.close()
    return planes


VIEWS = {
    "cut": lambda a: a[..., :3],
    "every second": lambda a: a[::2, ::3, :3],
    "turned": lambda a: np.moveaxis(a, 0, 1)[..., 1:],
    "upside down": lambda a: a[::-1, :, :3],
    "columns first": lambda a: np.asfortranarray(a[..., :3]),
    "broadcast": lambda a: np.broadcast_to(a[:1, :, :3], (ROWS, COLS, 3)),
}


@pytest.mark.parametrize("dtype", ["float16", "float32"])
@pytest.mark.parametrize("view", VIEWS)
def test_pixels_of_any_order_are_written_as_they_are(tmp_path: Path, view: str, dtype: str) -> None:
    """Rationale: of a view the bindings write what follows its first number in memory."""
    pixels = VIEWS[view](texture(ROWS, COLS, 4, dtype=dtype))
    planes = {name: pixels[..., k] for k, name in enumerate("RGB")}
    (tmp_path / "x.exr").write_bytes(written(tmp_path / "x.exr", [({}, planes)]))
    for name, plane in by_openimageio(tmp_path / "x.exr").items():
        np.testing.assert_array_equal(plane, planes[name])
        assert plane.dtype == dtype
    frame = Frame(pixels, Path("x"), LINEAR, 8 * pixels.dtype.itemsize, floating=True)
    write_frame(frame, tmp_path / "y.exr")
    np.testing.assert_array_equal(read_frame(tmp_path / "y.exr").pixels, pixels)


@pytest.mark.parametrize("names", ["BGR.R,BGR.G,BGR.B", "RGB.R,RGB.G,RGB.B,RGB.A", "R,G,B,A,RGB"])
def test_names_that_the_bindings_group_are_names(tmp_path: Path, names: str) -> None:
    planes = dict(zip(names.split(","), texture(5, ROWS, COLS), strict=False))
    path = made(tmp_path / "in.exr", ({}, planes))
    write_frame(read_frame(path), tmp_path / "out.exr")
    found = by_openimageio(tmp_path / "out.exr")
    assert {*found} == {*planes}
    for name, plane in planes.items():
        np.testing.assert_array_equal(found[name], plane)


def test_types_that_the_bindings_do_not_group_come_back(tmp_path: Path) -> None:
    """Half colours, a float alpha, and numbers of which a float has not all digits."""
    planes = dict(zip("RGB", texture(3, ROWS, COLS, dtype="float16"), strict=True))
    planes |= {"A": np.ones((ROWS, COLS), np.float32)}
    planes |= {"id": (2**32 - 1 - np.arange(ROWS * COLS, dtype=np.uint32)).reshape(ROWS, COLS)}
    write_frame(read_frame(made(tmp_path / "in.exr", ({}, planes))), tmp_path / "out.exr")
    with OpenEXR.File(str(tmp_path / "out.exr"), separate_channels=True) as file:
        for name, channel in file.channels().items():
            np.testing.assert_array_equal(channel.pixels, planes[name])
            assert channel.pixels.dtype == planes[name].dtype


# Parts.


def sides(path: Path, *names: str, **more: Any) -> tuple[Path, dict[str, np.ndarray]]:
    each = {name: texture(ROWS, COLS, 3) / (k + 1) for k, name in enumerate(names)}
    parts = [
        (
            {"name": name, "view": name, **more},
            dict(zip("RGB", np.moveaxis(p, -1, 0).copy(), strict=True)),
        )
        for name, p in each.items()
    ]
    return made(path, *parts), each


def test_a_damaged_part_does_not_become_the_next_one(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Rationale: the bindings drop it, and the right eye moves up to where left was."""
    path, _ = sides(tmp_path / "in.exr", "left", "right")
    content = bytearray(path.read_bytes())
    first = content.index(struct.pack("<2i", 0, 0), content.rindex(b"screenWindowWidth") + 40)
    content[first + 40 : first + 60] = bytes(20)
    path.write_bytes(content)
    with pytest.raises(InputError, match="does not decode"):
        read_master([path])
    assert capfd.readouterr().err == ""


def test_left_and_right_may_be_files_of_several_parts_each(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    depth = rng.random((2, ROWS, COLS), np.float32)
    pixels = texture(2, ROWS, COLS, 3)
    for k, side in enumerate(("left", "right")):
        planes = dict(zip("RGB", np.moveaxis(pixels[k], -1, 0).copy(), strict=True))
        view = {"view": side} if k else {}  # a file need not say it
        shot = {"shot": f"{side}'s"}
        made(
            tmp_path / f"{side}.exr",
            ({"name": "z", **view, **shot}, {"Z": depth[k]}),
            ({"name": "rgba", **view, **shot}, planes),
        )
    files = [tmp_path / f"{side}.exr" for side in ("left", "right")]
    master = read_master(files)
    assert master.packing == "files"
    np.testing.assert_array_equal(master.pixels, pixels)
    assert "part rgba of 2" in master.described()
    (tmp_path / "to").mkdir()
    results = [tmp_path / "to" / file.name for file in files]
    write_master(master.with_pixels(pixels / 2), results)
    for k, (side, result) in enumerate(zip(("left", "right"), results, strict=True)):
        with OpenEXR.File(str(result), separate_channels=True) as file:
            first, second = file.parts
            assert [part.name() for part in file.parts] == ["z", "rgba"]
            assert {part.header["shot"] for part in file.parts} == {f"{side}'s"}
            assert [part.header.get("view") for part in file.parts] == [side if k else None] * 2
            np.testing.assert_array_equal(first.channels["Z"].pixels, depth[k])
            for channel, name in enumerate("RGB"):
                plane = second.channels[name].pixels
                np.testing.assert_array_equal(plane, pixels[k, ..., channel] / 2)
    with pytest.raises(InputError, match=r"right\.exr: wanted the left view"):
        read_master(files[::-1])
    with pytest.raises(InputError, match="wanted one part or layer 'beauty'"):
        read_master(files, layer="beauty")
    assert read_master(files, layer="rgba").pixels.shape == (2, ROWS, COLS, 3)


# Attributes.


def test_a_file_of_levels_comes_back_as_one_of_lines(tmp_path: Path) -> None:
    """Rationale: what the bindings write again promises all levels, and they read no part of it."""
    spec = oiio.ImageSpec(64, 64, 3, "half")
    spec.tile_width = spec.tile_height = 16
    spec.attribute("textureformat", "Plain Texture")
    pixels = texture(64, 64, 3)
    writer = oiio.ImageOutput.create("openexr")
    path = tmp_path / "in.exr"
    for level in range(7):
        spec.width = spec.height = spec.full_width = spec.full_height = 64 >> level
        mode = "AppendMIPLevel" if level else "Create"
        assert writer.open(str(path), spec, mode), writer.geterror()
        assert writer.write_image(np.ascontiguousarray(pixels[:: 1 << level, :: 1 << level]))
    assert writer.close()
    assert b"tiledesc" in path.read_bytes()
    write_frame(read_frame(path), tmp_path / "out.exr")
    with OpenEXR.File(str(tmp_path / "out.exr")) as file:
        assert file.parts[0].type() == OpenEXR.scanlineimage
        assert "tiles" not in file.header()
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, pixels)


def test_what_is_beyond_openexr_is_said(tmp_path: Path) -> None:
    """Text of the name of a part that is no UTF-8: OpenImageIO reads it."""
    planes = dict(zip("RGB", texture(3, ROWS, COLS), strict=True))
    path = made(tmp_path / "in.exr", ({"name": "Zurich", "shot": "a"}, planes))
    path.write_bytes(path.read_bytes().replace(b"Zurich", b"Z\xfcrich"))
    frame = read_frame(path)
    assert "its attributes are left out, which OpenEXR does not read" in frame.described()
    np.testing.assert_array_equal(frame.pixels[..., 0], planes["R"])
    write_frame(frame, tmp_path / "out.exr")
    assert by_openimageio(tmp_path / "out.exr").keys() == planes.keys()


def test_the_windows_are_those_of_the_pixels(tmp_path: Path) -> None:
    """Rationale: a header that is used again has the window of the pixels before."""
    windows = {"dataWindow": corners((3, 4, COLS, ROWS)), "displayWindow": corners((1, 2, 60, 50))}
    planes = dict(zip("RGB", texture(3, ROWS, COLS), strict=True))
    frame = read_frame(made(tmp_path / "in.exr", (windows, planes)))
    assert frame.pixels.shape == (50, 60, 3)
    for name in ("a", "b"):
        write_frame(frame, tmp_path / f"{name}.exr")
        half = replace(frame, pixels=frame.pixels[:25])
        write_frame(half, tmp_path / f"{name}.half.exr")
        for place, rows in ((f"{name}.exr", 50), (f"{name}.half.exr", 25)):
            spec = oiio.ImageInput.open(str(tmp_path / place)).spec()
            assert (spec.x, spec.y, spec.width, spec.height) == (1, 2, 60, rows)
            assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (
                1,
                2,
                60,
                rows,
            )


def test_parts_that_openexr_does_not_join_are_refused(tmp_path: Path) -> None:
    planes = {"Z": texture(ROWS, COLS)}
    parts = [
        ({"name": "a", "displayWindow": corners((0, 0, side, 50))}, planes) for side in (60, 70)
    ]
    parts[1][0]["name"] = "b"
    with pytest.raises(InputError, match=r"x\.exr: wanted to encode an EXR, got '.*displayWindow"):
        written(tmp_path / "x.exr", parts)
