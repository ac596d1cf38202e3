"""Masters of one or two views: each packing comes back as it was, and what is no pair is refused.

What a file holds is judged by OpenImageIO alone and, where names and attributes of an EXR count, by
its bytes.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from image_files import save, say
from theatres import DATA, needs_data

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, Master, read_frame, read_master, write_master
from domesim.shows.sequences import find_pairs, output_pairs

ROWS, COLS = 22, 32
SRGB = ColourTag("srgb", "BT.709", "a test")
P3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)


@dataclass(frozen=True)
class Stored:
    """A part as OpenImageIO alone reads it."""

    planes: Mapping[str, np.ndarray]
    attributes: Mapping[str, object]
    windows: tuple[int, ...]


def spec_of(
    channels: str,
    kinds: str | Sequence[str] = "half",
    size: tuple[int, int] = (COLS, ROWS),
    **attributes: object,
) -> oiio.ImageSpec:
    names = channels.split(",")
    spec = oiio.ImageSpec(*size, len(names), kinds if isinstance(kinds, str) else "float")
    spec.channelnames = tuple(names)
    spec.alpha_channel = spec.channelindex("A")
    if not isinstance(kinds, str):
        spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in kinds)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    say(spec, **attributes)
    return spec


def texture(channels: int, dtype: str = "float16", seed: int = 5) -> np.ndarray:
    """(row, col, channel): no two channels, rows or columns alike; beyond 1 if floating."""
    values = np.random.default_rng(seed).random((ROWS, COLS, channels))
    if np.issubdtype(dtype, np.integer):
        return np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return (3 * values).astype(dtype)


def stored(path: Path) -> list[Stored]:
    """All parts, by OpenImageIO alone."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(str(path), config)
    parts = []
    while reader.seek_subimage(len(parts), 0):
        spec = reader.spec()
        kinds = spec.channelformats or (spec.format,) * spec.nchannels
        planes = {
            name: reader.read_image(len(parts), 0, k, k + 1, str(kinds[k]))[..., 0]
            for k, name in enumerate(spec.channelnames)
        }
        attributes = {each.name: str(each.value) for each in spec.extra_attribs}
        windows = (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        parts.append(Stored(planes, attributes, windows))
    reader.geterror()
    reader.close()
    return parts


def exr_headers(path: Path) -> list[dict[str, bytes]]:
    """Each part's attributes as they stand in the file (*OpenEXR File Layout*, openexr.com)."""
    content, position, headers = path.read_bytes(), 8, [{}]
    several = struct.unpack_from("<I", content, 4)[0] & 0x1000
    while True:
        if content[position] == 0:
            position += 1
            if not several or content[position] == 0:
                return headers
            headers.append({})
        name, kind, rest = content[position:].split(b"\0", 2)
        (size,) = struct.unpack_from("<i", rest)
        position += len(name) + len(kind) + 6 + size
        headers[-1][name.decode()] = rest[4 : 4 + size]


def exr_channels(header: Mapping[str, bytes]) -> dict[str, str]:
    """Name -> type."""
    content, found = header["channels"], {}
    while content[0]:
        name, content = content.split(b"\0", 1)
        found[name.decode()] = ("uint", "half", "float")[content[0]]
        content = content[16:]
    return found


def exr_strings(content: bytes) -> list[str]:
    found = []
    while content:
        (size,) = struct.unpack_from("<i", content)
        found.append(content[4 : 4 + size].decode())
        content = content[4 + size :]
    return found


STORAGE = ("compression", "oiio:RowsPerChunk", "openexr:chunkCount", "jpeg:subsampling")


def assert_same_files(first: Path, second: Path) -> None:
    """All parts, channels, types, samples, windows and metadata."""
    before, after = stored(first), stored(second)
    assert len(after) == len(before)
    for old, new in zip(before, after, strict=True):
        assert list(new.planes) == list(old.planes)
        for name, plane in old.planes.items():
            assert new.planes[name].dtype == plane.dtype
            np.testing.assert_array_equal(new.planes[name], plane, err_msg=name)
        assert new.windows == old.windows
        assert {name: new.attributes.get(name) for name in old.attributes} == {
            name: new.attributes.get(name) if name in STORAGE else value
            for name, value in old.attributes.items()
        }
        assert set(new.attributes) <= set(old.attributes)
    if first.suffix != ".exr":
        return
    for old, new in zip(exr_headers(first), exr_headers(second), strict=True):
        assert exr_channels(new) == exr_channels(old)
        # Optional in a file of one part; added by OpenImageIO to a resolution.
        assert set(new) ^ set(old) <= {"type", "ResolutionUnit"}
        for name in {*new} & {*old}:
            assert new[name] == old[name] or name in ("compression", "chunkCount")


def refusal(*paths: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        read_master(paths, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(paths[0]))
    assert "wanted" in message
    assert "got" in message
    return message


def plain(path: Path, seed: int = 5, dtype: str = "float16", **attributes: object) -> Path:
    kind = {"float16": "half", "float32": "float"}.get(dtype, dtype)
    return save(path, (spec_of("R,G,B", kind, **attributes), texture(3, dtype, seed)))


def multi_view(
    path: Path,
    channels: str = "R,G,B,right.R,right.G,right.B",
    views: Sequence[str] = ("left", "right"),
    **attributes: object,
) -> Path:
    stated = (f"string[{len(views)}]", tuple(views))
    spec = spec_of(channels, multiView=stated, **attributes)
    return save(path, (spec, texture(spec.nchannels)))


def part(name: str, view: str, channels: str, kinds: str | Sequence[str] = "half", **more: object):
    stated = {"view": view} if view else {}
    spec = spec_of(channels, kinds, oiio__subimagename=name, **stated, **more)
    dtype = "float16" if kinds == "half" else "float32"
    samples = texture(spec.nchannels, dtype, seed=len(name))[: spec.height, : spec.width]
    return spec, samples


def multi_part(path: Path, **attributes: object) -> Path:
    """As the beachball of OpenEXR's test images: right before left, depth between, and more."""
    return save(
        path,
        part("rgba.right", "right", "R,G,B,A", **attributes),
        part("depth.left", "left", "Z", "float", **attributes),
        part("rgba.left", "left", "R,G,B,A", **attributes),
        part("disparity.right", "right", "x,y,id", ("float", "half", "half"), **attributes),
        part("other", "", "mask", **attributes),
    )


# Comes back as it was.


def test_one_file_is_an_ordinary_frame(tmp_path: Path) -> None:
    source = plain(tmp_path / "in.exr", Artist="me")
    master = read_master([source])
    assert (master.packing, len(master.frames), master.paths) == ("single", 1, (source,))
    assert master.described() == read_frame(source).described()
    assert master.pixels.shape == (1, ROWS, COLS, 3)
    np.testing.assert_array_equal(master.pixels[0], texture(3))
    write_master(master, [tmp_path / "out.exr"])
    assert_same_files(source, tmp_path / "out.exr")


@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [("exr", "float16"), ("exr", "float32"), ("png", "uint16"), ("dpx", "uint16")],
)
def test_two_files_come_back(tmp_path: Path, suffix: str, dtype: str) -> None:
    sources = [plain(tmp_path / f"{side}.{suffix}", seed, dtype) for seed, side in enumerate("LR")]
    master = read_master(sources)
    assert (master.packing, master.path, master.paths) == ("files", sources[0], tuple(sources))
    assert master.described().endswith(", left and right in two files")
    assert master.described().startswith("2 x 32 x 22 ")
    for view, source in enumerate(sources):
        np.testing.assert_array_equal(master.pixels[view], read_frame(source).pixels)
    (tmp_path / "out").mkdir()
    results = [tmp_path / "out" / source.name for source in sources]
    write_master(master, results)
    for source, result in zip(sources, results, strict=True):
        assert_same_files(source, result)


@pytest.mark.parametrize("packing", ["side-by-side", "top-bottom"])
@pytest.mark.parametrize(
    ("suffix", "dtype", "channels"),
    [
        ("exr", "float16", "R,G,B,A,Z"),
        ("exr", "float16", "Y"),
        ("png", "uint8", "R,G,B"),
        ("tif", "uint16", "R,G,B"),
        ("dpx", "uint16", "R,G,B"),
    ],
)
def test_two_views_in_one_image_come_back(
    tmp_path: Path, packing: str, suffix: str, dtype: str, channels: str
) -> None:
    samples = texture(channels.count(",") + 1, dtype)
    kind = "half" if dtype == "float16" else dtype
    spec = spec_of(channels, kind, Artist="me")
    spec.full_x = spec.x = 7 if suffix == "exr" else 0
    source = save(tmp_path / f"in.{suffix}", (spec, samples))
    master = read_master([source], packing=packing)
    halves = np.split(samples, 2, {"side-by-side": 1, "top-bottom": 0}[packing])
    scale = np.float32(np.iinfo(dtype).max if suffix != "exr" else 1)
    for frame, half in zip(master.frames, halves, strict=True):
        np.testing.assert_array_equal(frame.pixels - half[..., :3].astype(np.float32) / scale, 0)
    assert master.paths == (source,)
    write_master(master, [tmp_path / f"out.{suffix}"])
    assert_same_files(source, tmp_path / f"out.{suffix}")


MULTI_VIEW = {
    "plain": ("R,G,B,right.R,right.G,right.B", ("left", "right")),
    "right first": ("R,G,B,left.R,left.G,left.B", ("right", "left")),
    "both named": ("left.R,left.G,left.B,right.R,right.G,right.B", ("left", "right")),
    "capitals": ("R,G,B,Right.R,Right.G,Right.B", ("Left", "Right")),
    "grey": ("Y,right.Y", ("left", "right")),
    "much": (
        "R,G,B,A,Z,diffuse.left.R,disparity.x,right.R,right.G,right.B,right.A,diffuse.right.R",
        ("left", "right"),
    ),
}


@pytest.mark.parametrize("name", MULTI_VIEW)
def test_a_multi_view_file_comes_back(tmp_path: Path, name: str) -> None:
    channels, views = MULTI_VIEW[name]
    source = multi_view(
        tmp_path / "in.exr",
        channels,
        views,
        chromaticities=("float[8]", P3),
        smpte__TimeCode=("timecode", (0x01020304, 5)),
        Artist="me",
    )
    master = read_master([source])
    assert (master.packing, master.floating, master.bits) == ("multi-view", True, 16)
    assert master.colour.primaries == "P3-D65"
    (before,) = stored(source)
    for side, frame in zip(("left", "right"), master.frames, strict=True):
        prefix = f"{side}." if f"{side}.R" in before.planes else ""
        prefix = "Right." if side == "right" and name == "capitals" else prefix
        for k, channel in enumerate("RGB"):
            stated = ("right.Y" if side == "right" else "Y") if name == "grey" else prefix + channel
            np.testing.assert_array_equal(frame.pixels[..., k], before.planes[stated])
    write_master(master, [tmp_path / "out.exr"])
    assert_same_files(source, tmp_path / "out.exr")
    (header,) = exr_headers(tmp_path / "out.exr")
    assert exr_strings(header["multiView"]) == list(views)
    assert set(exr_channels(header)) == set(channels.split(","))
    assert "view" not in header


@pytest.mark.parametrize("compression", ["zip", "zips", "piz"])
def test_a_multi_part_file_comes_back_with_all_parts(tmp_path: Path, compression: str) -> None:
    source = multi_part(
        tmp_path / "in.exr", chromaticities=("float[8]", P3), Artist="me", compression=compression
    )
    master = read_master([source])
    assert master.packing == "multi-part"
    assert master.colour.primaries == "P3-D65"
    before = stored(source)
    for frame, k in zip(master.frames, (2, 0), strict=True):
        planes = [before[k].planes[channel] for channel in "RGB"]
        np.testing.assert_array_equal(frame.pixels, np.stack(planes, -1))
    write_master(master, [tmp_path / "out.exr"])
    assert_same_files(source, tmp_path / "out.exr")
    headers = exr_headers(tmp_path / "out.exr")
    assert [header["name"].decode() for header in headers] == [
        "rgba.right",
        "depth.left",
        "rgba.left",
        "disparity.right",
        "other",
    ]
    views = [header.get("view", b"").decode() for header in headers]
    assert views == ["right", "left", "left", "right", ""]
    wanted = 2 if compression == "zips" else 3  # ZIPS, ZIP
    assert {header["compression"][0] for header in headers} == {wanted}


@pytest.mark.parametrize("tile", [0, 16])
def test_other_parts_may_have_windows_of_their_own_and_tiles(tmp_path: Path, tile: int) -> None:
    parts = [part("depth", "left", "Z", "float"), part("a", "left", "Y"), part("bb", "right", "Y")]
    spec = parts[0][0]
    spec.x, spec.y, spec.full_width, spec.full_height = -3, 5, COLS, ROWS
    for spec, _ in parts:
        spec.tile_width = spec.tile_height = tile
    source = save(tmp_path / "in.exr", *parts)
    master = read_master([source])
    write_master(master, [tmp_path / "out.exr"])
    before, after = stored(source), stored(tmp_path / "out.exr")
    assert [each.windows for each in after] == [each.windows for each in before]
    for old, new in zip(before, after, strict=True):
        for name, plane in old.planes.items():
            np.testing.assert_array_equal(new.planes[name], plane)
    assert [list(exr_channels(each)) for each in exr_headers(tmp_path / "out.exr")] == [
        ["Z"],
        ["Y"],
        ["Y"],
    ]
    assert not any("tiles" in header for header in exr_headers(tmp_path / "out.exr"))


def test_new_pixels_go_to_their_view_and_nowhere_else(tmp_path: Path) -> None:
    """Rationale: left and right exchanged would be seen by everyone but a round trip."""
    cases = {
        "multi-view": multi_view(tmp_path / "view.exr", *MULTI_VIEW["right first"]),
        "multi-part": multi_part(tmp_path / "part.exr"),
        "side-by-side": plain(tmp_path / "side.exr"),
        "top-bottom": plain(tmp_path / "top.exr"),
    }
    for packing, source in cases.items():
        master = read_master([source], packing=packing)
        left = np.full_like(master.frames[0].pixels, 0.25)
        changed = master.with_pixels(np.stack([left, master.frames[1].pixels]))
        write_master(changed, [tmp_path / "out.exr"])
        before, after = stored(source), stored(tmp_path / "out.exr")
        if packing == "multi-view":
            for name, plane in after[0].planes.items():
                is_left = name.startswith("left.")
                np.testing.assert_array_equal(plane, 0.25 if is_left else before[0].planes[name])
        elif packing == "multi-part":
            for k, (old, new) in enumerate(zip(before, after, strict=True)):
                for name, plane in new.planes.items():
                    is_left = k == 2 and name in "RGB"
                    np.testing.assert_array_equal(plane, 0.25 if is_left else old.planes[name])
        else:
            halves = [
                np.split(each[0].planes["G"], 2, {"side-by-side": 1, "top-bottom": 0}[packing])
                for each in (before, after)
            ]
            np.testing.assert_array_equal(halves[1][0], 0.25)
            np.testing.assert_array_equal(halves[1][1], halves[0][1])


def test_grey_is_written_as_luminance(tmp_path: Path) -> None:
    source = multi_view(tmp_path / "in.exr", "Y,right.Y")
    master = read_master([source])
    pixels = texture(6, "float32").reshape(ROWS, COLS, 2, 3).transpose(2, 0, 1, 3)
    write_master(master.with_pixels(pixels), [tmp_path / "out.exr"])
    (after,) = stored(tmp_path / "out.exr")
    assert list(after.planes) == ["Y", "right.Y"]
    for view, plane in zip(pixels, after.planes.values(), strict=True):
        wanted = 0.2126 * view[..., 0] + 0.7152 * view[..., 1] + 0.0722 * view[..., 2]
        assert plane.dtype == np.float16
        np.testing.assert_allclose(plane, wanted, rtol=2**-11)


def test_grey_in_float_comes_back_to_the_bit(tmp_path: Path) -> None:
    spec = spec_of("Y,right.Y", "float", multiView=("string[2]", ("left", "right")))
    source = save(tmp_path / "in.exr", (spec, texture(2, "float32")))
    write_master(read_master([source]), [tmp_path / "out.exr"])
    assert_same_files(source, tmp_path / "out.exr")


def test_grey_becomes_rgb_elsewhere(tmp_path: Path) -> None:
    source = multi_view(tmp_path / "in.exr", "Y,right.Y")
    master = replace(read_master([source]), packing="files")
    master = master.with_pixels(master.pixels / 4)
    write_master(master, [tmp_path / "L.tif", tmp_path / "R.tif"])
    for name, frame in zip(("L.tif", "R.tif"), master.frames, strict=True):
        (result,) = stored(tmp_path / name)
        assert list(result.planes) == ["R", "G", "B"]
        np.testing.assert_array_equal(np.stack([*result.planes.values()], -1), frame.pixels)


def test_views_of_one_exr_can_be_written_as_two_files_or_one_image(tmp_path: Path) -> None:
    source = multi_view(tmp_path / "in.exr", *MULTI_VIEW["right first"], Artist="me")
    master = read_master([source])
    names = [tmp_path / "L.exr", tmp_path / "R.exr"]
    write_master(replace(master, packing="files"), names)
    for name, view in zip(names, ("left", "right"), strict=True):
        (header,) = exr_headers(name)
        assert list(exr_channels(header)) == ["B", "G", "R"]
        assert header["view"].decode() == view
        assert "multiView" not in header
    np.testing.assert_array_equal(read_master(names).pixels, master.pixels)
    write_master(replace(master, packing="side-by-side"), [tmp_path / "both.exr"])
    (header,) = exr_headers(tmp_path / "both.exr")
    assert not {"view", "multiView"} & set(header)
    again = read_master([tmp_path / "both.exr"], packing="side-by-side")
    np.testing.assert_array_equal(again.pixels, master.pixels)


def test_depth_can_be_chosen(tmp_path: Path) -> None:
    for packing, source in {
        "multi-view": multi_view(tmp_path / "view.exr"),
        "multi-part": multi_part(tmp_path / "part.exr"),
    }.items():
        master = read_master([source])
        write_master(master, [tmp_path / "out.exr"], bits=32)
        again = read_master([tmp_path / "out.exr"])
        assert (again.packing, again.bits) == (packing, 32)
        np.testing.assert_array_equal(again.pixels, master.pixels)


def test_another_encoding_is_stated_for_all_parts(tmp_path: Path) -> None:
    """OpenEXR refuses a file whose parts differ in chromaticities."""
    for source in (
        multi_view(tmp_path / "view.exr", chromaticities=("float[8]", P3)),
        multi_part(tmp_path / "part.exr", chromaticities=("float[8]", P3)),
        multi_part(tmp_path / "none.exr"),
    ):
        master = read_master([source])
        colour = ColourTag("linear", "BT.2020", "here")
        frames = tuple(replace(frame, colour=colour) for frame in master.frames)
        write_master(replace(master, frames=frames), [tmp_path / "out.exr"])
        headers = exr_headers(tmp_path / "out.exr")
        assert len({header["chromaticities"] for header in headers}) == 1
        assert read_master([tmp_path / "out.exr"]).colour.primaries == "BT.2020"


def test_impossible_samples_are_told_by_view_and_repaired(tmp_path: Path) -> None:
    samples = texture(6)
    samples[3, 4, 4] = -0.5
    samples[5, 6, 5] = np.nan
    spec = spec_of("R,G,B,right.R,right.G,right.B", multiView=("string[2]", ("left", "right")))
    source = save(tmp_path / "in.exr", (spec, samples))
    message = refusal(source)
    assert "got 1 NaN, 1 negative, the first at row 3, col 4, channel G of view right" in message
    master = read_master([source], repair=True)
    assert [frame.repaired for frame in master.frames] == [0, 2]
    assert master.repaired == 2
    assert master.pixels[1, 3, 4, 1] == 0

    grey = spec_of("Y,right.Y", multiView=("string[2]", ("left", "right")))
    source = save(tmp_path / "grey.exr", (grey, samples[..., :5:4]))
    assert "got 1 negative, the first at row 3, col 4, channel Y of view right" in refusal(source)
    assert read_master([source], repair=True).repaired == 1


# Whole or not at all.


def test_a_pair_is_never_half_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = [plain(tmp_path / f"{side}.exr", seed) for seed, side in enumerate("LR")]
    (tmp_path / "out").mkdir()
    results = [tmp_path / "out" / source.name for source in sources]
    master = read_master(sources)
    write_master(master, results)
    old = [result.read_bytes() for result in results]
    darker = master.with_pixels(master.pixels / 2)
    fsync, calls = os.fsync, []

    def interrupted(number: int) -> None:
        calls.append(number)
        if len(calls) == 2:
            assert [result.read_bytes() for result in results] == old
            raise KeyboardInterrupt
        fsync(number)

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_master(darker, results)
    assert [result.read_bytes() for result in results] == old
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["L.exr", "R.exr"]

    monkeypatch.undo()
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(InputError, match=r"folder\.exr: wanted to write it, got 'is a directory'"):
        write_master(darker, [results[0], tmp_path / "folder.exr"])
    with pytest.raises(ValueError, match="takes pixels in"):
        write_master(master.with_pixels(master.pixels * np.float32(np.inf)), results)
    assert [result.read_bytes() for result in results] == old
    write_master(darker, results)
    assert not any(result.read_bytes() in old for result in results)


@pytest.mark.parametrize(("name", "what"), [(b"studio", "attributes"), (b"extra", "channels")])
def test_names_that_could_not_be_written_again_are_refused(
    tmp_path: Path, name: bytes, what: str
) -> None:
    source = multi_view(tmp_path / "x.exr", "R,G,B,extra,right.R,right.G,right.B", studio="sh010")
    content = source.read_bytes()
    assert content.count(name) == 1
    source.write_bytes(content.replace(name, name[:-1] + b"\xe9"))
    assert f"wanted {what} with printable names" in refusal(source)


# Mistakes.


def test_sizes_that_differ_are_refused(tmp_path: Path) -> None:
    left = plain(tmp_path / "L.exr")
    right = save(tmp_path / "R.exr", (spec_of("R,G,B", size=(COLS, 10)), texture(3)[:10]))
    message = refusal(left, right)
    assert message.startswith(f"{left} and {right}: wanted left and right of one size")
    assert "got 32 x 22 and 32 x 10 px" in message


def test_encodings_that_differ_are_refused(tmp_path: Path) -> None:
    left = plain(tmp_path / "L.exr", 0)
    right = plain(tmp_path / "R.exr", 1, chromaticities=("float[8]", P3))
    message = refusal(left, right)
    assert "got linear BT.709 (assumed for EXR) and linear P3-D65 (file: chromaticities)" in message
    assert "Convert one of them where it was made" in message
    message = refusal(left, plain(tmp_path / "R.png", 1, "uint8"))
    assert "got linear BT.709 (assumed for EXR) and sRGB BT.709 (file: sRGB)" in message


@pytest.mark.parametrize(
    ("said", "apart"),
    [
        (
            {"smpte:TimeCode": ("timecode", (0x01000003, 0))},
            "time codes 01:00:00:01 and 01:00:00:03",
        ),
        ({"FramesPerSecond": ("rational", (25, 1))}, "24 and 25 frames a second"),
    ],
)
def test_frames_of_two_moments_are_refused(
    tmp_path: Path, said: dict[str, object], apart: str
) -> None:
    one = {
        "smpte:TimeCode": ("timecode", (0x01000001, 0)),
        "FramesPerSecond": ("rational", (24, 1)),
    }
    left = plain(tmp_path / "L.exr", 0, **one)
    assert len(read_master([left, plain(tmp_path / "same.exr", 1, **one)]).frames) == 2
    assert len(read_master([left, plain(tmp_path / "silent.exr", 1)]).frames) == 2
    other = plain(tmp_path / "R.exr", 1, **one | said)
    assert f"wanted left and right of one moment, got {apart}" in refusal(left, other)


def test_ranges_that_differ_are_refused(tmp_path: Path) -> None:
    said = {"dpx:LowData": ("uint", 16 << 8), "dpx:HighData": ("uint", 235 << 8)}
    left = plain(tmp_path / "L.dpx", 0, "uint16", **said)
    assert len(read_master([left, plain(tmp_path / "same.dpx", 1, "uint16", **said)]).frames) == 2
    other = plain(tmp_path / "R.dpx", 1, "uint16")
    assert "wanted one range of left and right, got legal and full" in refusal(left, other)


def test_the_same_file_twice_is_refused(tmp_path: Path) -> None:
    left = plain(tmp_path / "L.exr")
    (tmp_path / "soft.exr").symlink_to(left)
    (tmp_path / "hard.exr").hardlink_to(left)
    for name in ("L.exr", "soft.exr", "hard.exr"):
        right = tmp_path / name
        message = refusal(left, right)
        assert "got the same file twice" in message
        assert "--as-given" in message
        assert read_master([left, right], allow_identical=True).packing == "files"


def test_the_same_image_twice_is_refused(tmp_path: Path) -> None:
    left = plain(tmp_path / "L.exr")
    right = plain(tmp_path / "R.exr", Artist="another file")
    message = refusal(left, right)
    assert message.startswith(f"{left} and {right}: wanted left and right that differ")
    assert "got the same image twice" in message
    assert "mono" in message
    assert "--as-given" in message
    assert len(read_master([left, right], allow_identical=True).frames) == 2

    twice = np.concatenate((texture(3), texture(3)), -1)
    spec = spec_of("R,G,B,right.R,right.G,right.B", multiView=("string[2]", ("left", "right")))
    assert "same image twice" in refusal(save(tmp_path / "view.exr", (spec, twice)))
    twice = np.concatenate((texture(3), texture(3)), 1)
    wide = save(tmp_path / "wide.exr", (spec_of("R,G,B", size=(2 * COLS, ROWS)), twice))
    assert "same image twice" in refusal(wide, packing="side-by-side")
    assert read_master([wide]).packing == "single"

    letterbox = texture(3)
    letterbox[:2] = 0
    pair = [save(tmp_path / f"{side}.box.exr", (spec_of("R,G,B"), letterbox)) for side in "LR"]
    assert "same image twice" in refusal(*pair)

    one = texture(3)
    one[5, 5, 0] *= 2
    other = save(tmp_path / "other.exr", (spec_of("R,G,B"), one))
    assert len(read_master([left, other]).frames) == 2


def test_black_may_be_the_same_on_both_sides(tmp_path: Path) -> None:
    """A show fades in and out."""
    sources = [save(tmp_path / f"{side}.exr", (spec_of("R,G,B"), 0 * texture(3))) for side in "LR"]
    assert not read_master(sources).pixels.any()


def test_sides_that_were_exchanged_are_refused(tmp_path: Path) -> None:
    left, right = (
        plain(tmp_path / f"{view}.exr", seed, view=view)
        for seed, view in enumerate(("left", "right"))
    )
    assert len(read_master([left, right]).frames) == 2
    with pytest.raises(InputError, match=r"right\.exr: wanted the left view, .* says it is right"):
        read_master([right, left])


def test_other_views_are_refused_by_name(tmp_path: Path) -> None:
    channels = "R,G,B,left.R,left.G,left.B,right.R,right.G,right.B"
    source = multi_view(tmp_path / "3.exr", channels, ("center", "left", "right"))
    assert "wanted views left and right, got center, left, right" in refusal(source)
    source = multi_view(tmp_path / "other.exr", "R,G,B,b.R,b.G,b.B", ("a", "b"))
    assert "got a, b" in refusal(source)
    source = multi_view(tmp_path / "empty.exr", "R,G,B")
    assert "the views that multiView lists, got none of right. Write both" in refusal(source)
    source = multi_view(tmp_path / "layer.exr", "R,G,B,diffuse.right.R,right.A,right.Z")
    assert "or Y alone, in view right, got" in refusal(source)
    source = save(tmp_path / "parts.exr", part("a", "left", "R,G,B"), part("b", "", "R,G,B"))
    assert "wanted views left and right, got left" in refusal(source)


def test_parts_that_are_not_to_be_told_apart_are_refused(tmp_path: Path) -> None:
    source = save(
        tmp_path / "two.exr",
        part("a", "left", "R,G,B"),
        part("b", "left", "R,G,B"),
        part("c", "right", "R,G,B"),
    )
    assert "one part of view left" in refusal(source)
    assert "got a with R, G, B; b with R, G, B" in refusal(source)
    source = save(tmp_path / "none.exr", part("a", "left", "R,G,B"), part("b", "right", "Z"))
    assert "got b with Z" in refusal(source)
    source = save(tmp_path / "parts.exr", part("a", "", "R,G,B"), part("b", "", "R,G,B"))
    assert "several parts" in refusal(source)


def test_a_file_of_views_is_no_side_of_a_pair(tmp_path: Path) -> None:
    left = plain(tmp_path / "L.exr")
    right = multi_view(tmp_path / "both.exr")
    with pytest.raises(InputError, match=r"both\.exr: wanted the right view, .*Give this file al"):
        read_master([left, right])
    with pytest.raises(InputError, match="several parts"):
        read_master([left, multi_part(tmp_path / "parts.exr")])


def test_odd_sides_cannot_be_halved(tmp_path: Path) -> None:
    source = save(tmp_path / "x.exr", (spec_of("R,G,B", size=(31, 21)), texture(3)[:21, :31]))
    message = refusal(source, packing="side-by-side")
    assert "wanted an even width for two views packed as side-by-side, got 31 x 21 px" in message
    assert "wanted an even height" in refusal(source, packing="top-bottom")


def test_packings_that_are_not_so_are_refused(tmp_path: Path) -> None:
    mono, view = plain(tmp_path / "x.exr"), multi_view(tmp_path / "v.exr")
    assert "wanted a master packed as multi-view, got single" in refusal(mono, packing="multi-view")
    assert "wanted a master packed as single, got multi-view" in refusal(view, packing="single")
    assert "packed as side-by-side, got multi-view" in refusal(view, packing="side-by-side")
    pair = (mono, plain(tmp_path / "y.exr", 6))
    assert "packed as top-bottom, got files" in refusal(*pair, packing="top-bottom")
    assert read_master(pair, packing="files").packing == "files"
    with pytest.raises(ValueError, match=r"takes packing single, files, .* got 'anaglyph'"):
        read_master([mono], packing="anaglyph")
    with pytest.raises(ValueError, match="one or two paths, got 3"):
        read_master([mono, mono, mono])


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    views = read_master([multi_view(tmp_path / "in.exr")])
    with pytest.raises(InputError, match=r"x\.png: wanted \.exr .*multi-view file.*two files"):
        write_master(views, [tmp_path / "x.png"])
    pair = replace(views, packing="files")
    with pytest.raises(InputError, match="got one twice"):
        write_master(pair, [tmp_path / "x.exr", tmp_path / "." / "x.exr"])
    with pytest.raises(ValueError, match="takes 2 for 'files', got 1"):
        write_master(pair, [tmp_path / "x.exr"])
    with pytest.raises(ValueError, match="takes 1 for 'multi-view', got 2"):
        write_master(views, [tmp_path / "x.exr", tmp_path / "y.exr"])
    with pytest.raises(ValueError, match="as read from such a file"):
        write_master(replace(views, file=None), [tmp_path / "x.exr"])
    other = replace(views.frames[1], colour=SRGB)
    with pytest.raises(ValueError, match="takes one encoding"):
        write_master(replace(views, frames=(views.frames[0], other)), [tmp_path / "x.exr"])
    alpha = read_frame(save(tmp_path / "a.exr", (spec_of("R,G,B,A"), texture(4))))
    for packing in ("side-by-side", "multi-view"):
        mixed = replace(views, packing=packing, frames=(views.frames[0], alpha))
        with pytest.raises(ValueError, match="channels"):
            write_master(mixed, [tmp_path / "x.exr"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "in.exr"]


def test_masters_have_as_many_frames_as_their_packing() -> None:
    one = Frame(texture(3, "float32"), Path("made.up"), SRGB, 16, False)
    with pytest.raises(ValueError, match="Master of 'files' takes 2, got 1"):
        Master((one,), "files")
    with pytest.raises(ValueError, match="Master of 'single' takes 1, got 2"):
        Master((one, one))
    with pytest.raises(ValueError, match=r"takes \(2, 22, 32, 3\), got \(22, 32, 3\)"):
        Master((one, one), "files").with_pixels(one.pixels)


# Real files.


@needs_data
def test_the_fog_of_openexr_is_read_and_written_back_in_grey(tmp_path: Path) -> None:
    source = DATA / "stereo" / "fog_multiview.exr"
    master = read_master([source])
    assert master.described() == (
        "2 x 1000 x 672 EXR, 16 bit float, linear (assumed for EXR), "
        "left and right as views of one part"
    )
    (before,) = stored(source)
    for frame, name in zip(master.frames, ("Y", "right.Y"), strict=True):
        assert all(np.array_equal(frame.pixels[..., k], before.planes[name]) for k in range(3))
    write_master(master, [tmp_path / "out.exr"])
    assert_same_files(source, tmp_path / "out.exr")


@needs_data
def test_real_pairs_are_read_and_written_back(tmp_path: Path) -> None:
    pairs = find_pairs(
        DATA / "sequence" / "beachball_####_L.exr", DATA / "sequence" / "beachball_####_R.exr"
    )
    assert len(pairs) == 4
    names = [DATA / "stereo" / f"trunks_1080p_{side}.exr" for side in "LR"]
    for pair in (pairs[0], find_pairs(*names)[0]):
        master = read_master(pair)
        (results,) = output_pairs([pair], tmp_path)
        write_master(master, results)
        for source, result in zip(pair, results, strict=True):
            assert_same_files(source, result)
    assert "got 2048 x 1556 and 1920 x 1080 px" in refusal(pairs[0][0], names[1])


# Sequences.


def fill(folder: Path, *names: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def mismatch(left: Path, right: Path, frames: str | None = None) -> str:
    with pytest.raises(InputError) as caught:
        find_pairs(left, right, frames)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_pairs_are_found_by_number(tmp_path: Path) -> None:
    fill(tmp_path, "L.9.exr", "L.10.exr", "R.0009.exr", "R.0010.exr")
    pairs = find_pairs(tmp_path / "L.#.exr", tmp_path / "R.####.exr")
    assert [[path.name for path in pair] for pair in pairs] == [
        ["L.9.exr", "R.0009.exr"],
        ["L.10.exr", "R.0010.exr"],
    ]
    pairs = find_pairs(str(tmp_path / "L.#.exr"), str(tmp_path / "R.#.exr"), "10")
    assert [pair[1].name for pair in pairs] == ["R.0010.exr"]
    single = tmp_path / "L.9.exr", tmp_path / "R.0009.exr"
    assert find_pairs(*single) == (single,)


def test_frames_that_one_side_lacks_are_named(tmp_path: Path) -> None:
    fill(tmp_path, *(f"L.{k}.exr" for k in range(1, 9)), *(f"R.{k}.exr" for k in range(3, 12)))
    left, right = tmp_path / "L.#.exr", tmp_path / "R.#.exr"
    message = mismatch(left, right)
    assert message.startswith(f"{left} and {right}: wanted the same frames on both sides, missing ")
    assert "missing 9-11 on the left and 1-2 on the right." in message
    assert message.endswith("--frames 3-8")
    assert len(find_pairs(left, right, "3-8")) == 6
    assert f"{right}: wanted frames 1-3, missing 1-2" in mismatch(left, right, "1-3")
    (tmp_path / "R.5.exr").unlink()
    assert f"{right}: wanted frames 3-11, missing 5" in mismatch(left, right)
    fill(tmp_path, "far.99.exr", "far.100.exr")
    assert mismatch(left, tmp_path / "far.#.exr").endswith("or check the patterns.")


def test_a_file_and_a_pattern_are_no_pair(tmp_path: Path) -> None:
    fill(tmp_path, "L.1.exr", "R.1.exr")
    for left, right in (("L.#.exr", "R.1.exr"), ("L.1.exr", "R.#.exr")):
        message = mismatch(tmp_path / left, tmp_path / right)
        assert "wanted two files or two numbered patterns, got one of each" in message
    assert "there is no such file" in mismatch(tmp_path / "L.1.exr", tmp_path / "R.2.exr")


def test_results_of_pairs_keep_their_names(tmp_path: Path) -> None:
    fill(tmp_path, "L.1.exr", "R.1.exr")
    pairs = find_pairs(tmp_path / "L.#.exr", tmp_path / "R.#.exr")
    out = tmp_path / "out"
    assert output_pairs(pairs, out) == ((out / "L.1.exr", out / "R.1.exr"),)
    assert output_pairs(pairs, out, ".png") == ((out / "L.1.png", out / "R.1.png"),)
    with pytest.raises(InputError, match="got the input itself"):
        output_pairs(pairs, tmp_path)


def test_results_of_one_name_go_into_two_folders(tmp_path: Path) -> None:
    for name in ("a", "b"):
        fill(tmp_path / name, "1.exr", "2.exr")
    pairs = find_pairs(tmp_path / "a" / "#.exr", tmp_path / "b" / "#.exr")
    out = tmp_path / "out"
    assert output_pairs(pairs, out) == tuple(
        (out / "left" / f"{k}.exr", out / "right" / f"{k}.exr") for k in (1, 2)
    )
    fill(tmp_path / "left", "1.exr")
    fill(tmp_path / "right", "1.exr")
    pairs = find_pairs(tmp_path / "left" / "1.exr", tmp_path / "right" / "1.exr")
    with pytest.raises(InputError, match="got the input itself"):
        output_pairs(pairs, tmp_path)


def test_results_of_one_name_from_one_folder_are_refused(tmp_path: Path) -> None:
    fill(tmp_path, "a.exr", "a.dpx")
    pairs = [(tmp_path / "a.exr", tmp_path / "a.dpx")]
    out = tmp_path / "out"
    assert output_pairs(pairs, out) == ((out / "a.exr", out / "a.dpx"),)
    with pytest.raises(InputError, match=r"wanted two names for two results, got a\.png for both"):
        output_pairs(pairs, out, ".png")


def test_two_frames_of_other_moments_are_no_pair(tmp_path: Path) -> None:
    names = [tmp_path / name for name in ("a_L.0001.exr", "a_R.0002.exr", "a_R.0001.exr")]
    for name in names:
        name.touch()
    with pytest.raises(InputError, match=r"of one moment, got frames 1 and 2"):
        find_pairs(names[0], names[1])
    assert find_pairs(names[0], names[2]) == ((names[0], names[2]),)
