"""Image files: what goes in comes out, and what is broken is refused in one line."""

from __future__ import annotations

import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from icc_profiles import icc_profile
from image_files import save, store
from plain_files import DPX_SAMPLE, read_dpx, read_tiff, write_dpx, write_tiff

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.formats.png import chunk
from domesim.frames.reading import unsaid

DATA = Path(os.environ.get("DOMESIM_DATA", Path(__file__).parents[4] / "shared" / "data"))
SRGB = ColourTag("srgb", "BT.709", "a test")
ROWS, COLS = 23, 31

LOSSLESS = [
    ("png", 8),
    ("png", 16),
    ("tif", 8),
    ("tif", 10),
    ("tif", 12),
    ("tif", 16),
    ("dpx", 8),
    ("dpx", 10),
    ("dpx", 12),
    ("dpx", 16),
]


def stored(path: Path) -> tuple[np.ndarray, dict[str, object], oiio.ImageSpec]:
    """Samples as they are in the file, attributes and header, by OpenImageIO alone."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(str(path), config)
    spec = reader.spec()
    samples = reader.read_image(0, 0, 0, spec.nchannels, "unknown")
    attributes = {attribute.name: attribute.value for attribute in spec.extra_attribs}
    reader.close()
    return samples, attributes, spec


def texture(dtype: str = "uint8", channels: int = 3) -> np.ndarray:
    """(row, col, channel): neither smooth nor pure noise, no two channels alike."""
    rng = np.random.default_rng(5)
    row, col = np.mgrid[:ROWS, :COLS]
    ramps = [(row + k * col) / (ROWS + k * COLS) for k in range(channels)]
    values = 0.7 * np.stack(ramps, -1) + 0.3 * rng.random((ROWS, COLS, channels))
    if np.issubdtype(dtype, np.integer):
        return np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return values.astype(dtype)


def frame(pixels: np.ndarray, bits: int = 16, *, floating: bool = False) -> Frame:
    return Frame(np.asarray(pixels, np.float32), Path("made.up"), SRGB, bits, floating)


def all_codes(bits: int) -> np.ndarray:
    """(row, 64, 3) holding each code once in each channel, in three orders."""
    codes = np.arange(2**bits).reshape(-1, 64)
    return np.stack([codes, codes[::-1], codes ^ 5], -1)


def refusal(path: Path, **options: bool) -> str:
    with pytest.raises(InputError) as caught:
        read_frame(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    assert "wanted" in message
    assert "got" in message or "there is none" in message
    return message


def assert_nothing_else(folder: Path, *names: str) -> None:
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(names)


# Code values.


@pytest.mark.parametrize(("suffix", "bits"), LOSSLESS)
def test_every_code_value_survives_reading_and_writing(
    tmp_path: Path, suffix: str, bits: int
) -> None:
    codes = all_codes(bits)
    first, second = tmp_path / f"first.{suffix}", tmp_path / f"second.{suffix}"
    write_frame(frame(codes / (2**bits - 1), bits), first, bits=bits)
    read = read_frame(first)
    assert (read.bits, read.floating, read.pixels.dtype) == (bits, False, np.float32)
    assert read.pixels.max() == 1.0
    np.testing.assert_array_equal(np.rint(read.pixels * (2**bits - 1)), codes)
    write_frame(read, second)
    np.testing.assert_array_equal(stored(second)[0], stored(first)[0])
    assert read_frame(second).bits == bits
    # OpenImageIO alone agrees on what the file holds.
    widened = stored(first)[0].astype(int)
    np.testing.assert_array_equal(widened >> (0 if bits == 8 else 16 - bits), codes)


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_dpx_by_the_letter_of_its_standard(tmp_path: Path, bits: int, order: str) -> None:
    """Written and read without a library: Rationale: one library's errors cancel out."""
    codes = np.random.default_rng(bits).integers(0, 2**bits, (40, 40, 3))
    codes[0, :2] = [[0], [2**bits - 1]]
    source = write_dpx(tmp_path / "in.dpx", codes, bits, order, transfer=6)
    before = read_dpx(source)
    np.testing.assert_array_equal(before.codes, codes)
    read = read_frame(source)
    told = f"40 x 40 DPX, {bits} bit, BT.1886 (file: transfer 'ITU-R 709-4')"
    assert read.described() == told
    np.testing.assert_array_equal(np.rint(read.pixels * (2**bits - 1)), codes)
    write_frame(read, tmp_path / "out.dpx")
    after = read_dpx(tmp_path / "out.dpx")
    np.testing.assert_array_equal(after.codes, codes)
    assert after.fields == before.fields
    assert {name: after.fields[name] for name in DPX_SAMPLE} == DPX_SAMPLE
    content = (tmp_path / "out.dpx").read_bytes()
    assert content[:4] == source.read_bytes()[:4]
    assert content[36:136].rstrip(b"\0") == b"out.dpx"


@pytest.mark.parametrize("order", [">", "<"])
def test_xyz_by_the_letter_of_its_standard(tmp_path: Path, order: str) -> None:
    """A DCDM: 12 bits of X'Y'Z' above four zeros, in a TIFF of 16 that says nothing of it."""
    codes = np.random.default_rng(1).integers(0, 4096, (40, 40, 3))
    source = write_tiff(tmp_path / "in.tif", codes << 4, order)
    np.testing.assert_array_equal(read_tiff(source)[0], codes << 4)
    read = read_frame(source, colour=encoding_named("dcdm"))
    assert read.described() == "40 x 40 TIFF, 12 bit, DCDM XYZ (--encoding dcdm)"
    assert unsaid(read) == "DCDM XYZ, which the file cannot say: it reads as sRGB"
    write_frame(read, tmp_path / "out.tif")
    samples, artist = read_tiff(tmp_path / "out.tif")
    np.testing.assert_array_equal(samples, codes << 4)
    assert artist == b"the artist"


def test_codes_are_rounded_to_the_nearest_ties_to_even(tmp_path: Path) -> None:
    values = np.array([0.49, 0.5, 0.51, 1.5, 2.5, 254.4999, 254.6]) / 255
    pixels = np.broadcast_to(values[None, :, None], (1, 7, 3))
    write_frame(frame(pixels), tmp_path / "x.png", bits=8)
    assert stored(tmp_path / "x.png")[0][0, :, 1].tolist() == [0, 0, 1, 2, 2, 254, 255]


@pytest.mark.parametrize("dtype", ["float16", "float32"])
@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_floats_survive_bit_by_bit(tmp_path: Path, suffix: str, dtype: str) -> None:
    samples = texture(dtype)
    limits = np.finfo(dtype)
    samples.flat[:4] = [limits.smallest_subnormal, limits.tiny, limits.max, 0]
    source = store(tmp_path / f"in.{suffix}", samples, tiff__half=1)
    read = read_frame(source)
    assert (read.bits, read.floating) == (8 * samples.itemsize, True)
    np.testing.assert_array_equal(read.pixels, samples.astype(np.float32))
    write_frame(read, tmp_path / f"out.{suffix}")
    result = stored(tmp_path / f"out.{suffix}")[0]
    assert result.dtype == samples.dtype
    np.testing.assert_array_equal(result, samples)


def test_jpeg_keeps_unchanged_parts(tmp_path: Path) -> None:
    """Rationale: only what was compensated should differ. Expected: <= 4 codes, most <= 1."""
    samples = texture().repeat(8, 0).repeat(8, 1)
    source = store(tmp_path / "in.jpg", samples, Compression="jpeg:90", jpeg__subsampling="4:2:0")
    write_frame(read_frame(source), tmp_path / "out.jpg")
    before, after = (stored(tmp_path / f"{name}.jpg") for name in ("in", "out"))
    change = np.abs(before[0].astype(int) - after[0])
    assert after[1]["jpeg:subsampling"] == "4:4:4"
    assert change.max() <= 4
    assert (change <= 1).mean() > 0.95


def test_writing_refuses_what_a_format_cannot_hold(tmp_path: Path) -> None:
    pixels = texture("float32")
    for bad in (-0.001, 1.001, np.nan, np.inf):
        wrong = pixels.copy()
        wrong[3, 4, 1] = bad
        for suffix in ("png", "tif", "dpx", "jpg"):
            with pytest.raises(ValueError, match=r"takes pixels in 0\.\.1"):
                write_frame(frame(wrong), tmp_path / f"x.{suffix}")
    pixels[0, 0, 0] = 70000
    with pytest.raises(ValueError, match=r"-65504\.\.65504"):
        write_frame(frame(pixels), tmp_path / "x.exr", bits=16)
    pixels[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="nan"):
        write_frame(frame(pixels), tmp_path / "x.exr", bits=32)
    assert_nothing_else(tmp_path)


def test_new_pixels_must_have_the_old_shape() -> None:
    made = frame(texture("float32"))
    with pytest.raises(ValueError, match=r"takes \(23, 31, 3\), got \(31, 23, 3\)"):
        made.with_pixels(np.zeros((31, 23, 3)))
    assert made.with_pixels(np.zeros((23, 31, 3))).pixels.dtype == np.float32


# What else a file holds.

CHROMATICITIES = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
COMMON = {
    "PixelAspectRatio": 1.005,
    "ImageDescription": "a dome",
    "DateTime": "2020:01:02 03:04:05",
}
METADATA = {
    "exr": {
        "chromaticities": ("float[8]", CHROMATICITIES),
        "smpte:TimeCode": ("timecode", (0x01020304, 5)),
        "smpte:KeyCode": ("keycode", (1, 2, 3, 4, 5, 6, 7)),
        "FramesPerSecond": ("rational", (24000, 1001)),
        "worldToCamera": ("matrix", tuple(k / 3 for k in range(16))),
        "studio/shot": "sh010",
        "studio:take": 7,
        "studio:size": ("int[2]", (1080, 2048)),
        "studio:box": ("box2i", (1, 2, 3, 4)),
        "multiView": ("string[2]", ("left", "right")),
        "XResolution": 72.0,
        "oiio:subimagename": "beauty",
    },
    "png": {"studio:shot": "sh010", "Artist": "me", "XResolution": 72.0},
    "tif": {"Artist": "me", "ExposureTime": 0.25, "Copyright": "us"},
    "jpg": {"Artist": "me", "ExposureTime": 0.25, "IPTC:City": "Zürich"},
    "dpx": {
        "smpte:TimeCode": ("timecode", (0x01020304, 0)),
        "smpte:KeyCode": ("keycode", (1, 2, 3, 4, 5, 6, 7)),
        "dpx:FrameRate": 24.0,
        "dpx:Transfer": "SMPTE 274M",
        "dpx:Packing": "Filled, method B",
        "dpx:SlateInfo": "slate",
        "dpx:UserData": ("uint8[6]", np.arange(6, dtype=np.uint8)),
        "Software": "renderer 1",
    },
}


@pytest.mark.parametrize("suffix", METADATA)
def test_metadata_survives(tmp_path: Path, suffix: str) -> None:
    asked = {**COMMON, **METADATA[suffix]}
    dtype = {"exr": "float16", "dpx": "uint16"}.get(suffix, "uint8")
    depth = {"oiio:BitsPerSample": 10} if suffix == "dpx" else {}
    source = store(tmp_path / f"in.{suffix}", texture(dtype), **{**asked, **depth})
    read = read_frame(source)
    write_frame(read.with_pixels(read.pixels * np.float32(0.5)), tmp_path / f"out.{suffix}")
    before, after = stored(source)[1], stored(tmp_path / f"out.{suffix}")[1]
    present = [name for name in asked if name in before]
    assert len(present) >= len(asked) - 1, set(asked) - set(before)
    assert {name: str(after.get(name)) for name in before if not storage(name)} == {
        name: str(before[name]) for name in before if not storage(name)
    }


def storage(name: str) -> bool:
    return name in ("jpeg:subsampling", "oiio:ColorSpace", "tiff:RowsPerStrip")


@pytest.mark.parametrize("suffix", ["png", "tif", "jpg"])
@pytest.mark.parametrize("primaries", ["BT.709", "P3-D65"])
def test_icc_profile_survives(tmp_path: Path, suffix: str, primaries: str) -> None:
    profile = icc_profile("One of ours", primaries)
    value = (f"uint8[{profile.size}]", profile)
    path = store(tmp_path / f"in.{suffix}", texture(), ICCProfile=value)
    read = read_frame(path)
    assert read.colour == ColourTag("srgb", primaries, "file: ICC profile 'One of ours'")
    write_frame(read, tmp_path / f"out.{suffix}")
    assert bytes(stored(tmp_path / f"out.{suffix}")[1]["ICCProfile"]) == profile.tobytes()
    # Under another encoding the profile would lie.
    write_frame(
        replace(read, colour=ColourTag("linear", "BT.2020", "here")), tmp_path / f"new.{suffix}"
    )
    assert "ICCProfile" not in stored(tmp_path / f"new.{suffix}")[1]


@pytest.mark.parametrize(
    ("suffix", "dtype", "channels"),
    [
        ("exr", "float16", "R,G,B,A"),
        ("exr", "float32", "R,G,B,A,Z,diffuse.R,diffuse.G,diffuse.B"),
        ("exr", "float16", "r,g,b"),
        ("dpx", "uint16", "R,G,B,A"),
    ],
)
def test_other_channels_survive_bit_by_bit(
    tmp_path: Path, suffix: str, dtype: str, channels: str
) -> None:
    samples = texture(dtype, len(channels.split(",")))
    samples[:4, :, 3:] = 0  # dividing would lose the colour here
    if suffix == "exr":
        samples[5, 5, 3:] = -np.inf
    source = store(tmp_path / f"in.{suffix}", samples, channels)
    read = read_frame(source)
    np.testing.assert_array_equal(
        read.pixels,
        samples[..., :3].astype(np.float32)
        / np.float32(np.iinfo(dtype).max if "int" in dtype else 1),
    )
    changed = read.with_pixels(read.pixels[::-1])
    write_frame(changed, tmp_path / f"out.{suffix}")
    before, after = stored(source), stored(tmp_path / f"out.{suffix}")
    assert after[2].channelnames == before[2].channelnames
    assert after[2].alpha_channel == before[2].alpha_channel
    np.testing.assert_array_equal(after[0][..., 3:], samples[..., 3:])
    np.testing.assert_array_equal(after[0][..., :3], samples[::-1, :, :3])


@pytest.mark.parametrize(
    ("name", "channels"),
    [
        ("grey.png", "Y"),
        ("grey.jpg", "Y"),
        ("grey.png", "Y,A"),
        ("stereo.exr", "Y,right.Y"),
        ("layers.exr", "left.R,left.G,left.B,x.R,x.G,x.B"),
        ("two.exr", "R,G,B,r"),
    ],
)
def test_without_one_each_of_r_g_b_a_file_is_refused(
    tmp_path: Path, name: str, channels: str
) -> None:
    dtype = "float16" if name.endswith("exr") else "uint8"
    path = store(tmp_path / name, texture(dtype, channels.count(",") + 1), channels)
    message = refusal(path)
    assert all(channel in message for channel in channels.split(","))
    assert ("oiiotool" in message) == (name != "two.exr")
    assert ("R=Y,G=Y,B=Y" in message) == ("Y" in channels.split(","))


def test_only_the_display_window_of_an_exr_is_read(tmp_path: Path) -> None:
    samples = texture("float16", 4)
    spec = oiio.ImageSpec(COLS, ROWS, 4, "half")
    spec.x, spec.y = 12, 23
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 10, 20, 40, 30
    save(tmp_path / "in.exr", (spec, samples))
    read = read_frame(tmp_path / "in.exr")
    expected = np.zeros((30, 40, 4), np.float32)
    expected[3 : 3 + ROWS, 2 : 2 + COLS] = samples
    np.testing.assert_array_equal(read.pixels, expected[..., :3])
    write_frame(read, tmp_path / "out.exr")
    result, _, header = stored(tmp_path / "out.exr")
    np.testing.assert_array_equal(result, expected)
    assert (header.x, header.y, header.full_x, header.full_y) == (10, 20, 10, 20)
    assert (header.full_width, header.full_height) == (40, 30)

    spec.full_width = COLS
    save(tmp_path / "overscan.exr", (spec, samples))
    assert "overscan 31x23+12+23. Crop it" in refusal(tmp_path / "overscan.exr")


def test_another_format_gets_what_it_can_hold(tmp_path: Path) -> None:
    samples = texture("float16", 5)
    samples[..., 3] = 1
    source = store(tmp_path / "in.exr", samples, "R,G,B,A,Z", ImageDescription="a dome")
    read = read_frame(source)
    expected = {
        "png": ("uint16", ("R", "G", "B", "A")),
        "tif": ("float", ("R", "G", "B", "A")),
        "dpx": ("uint16", ("R", "G", "B")),
        "jpg": ("uint8", ("R", "G", "B")),
    }
    for suffix, (kind, channels) in expected.items():
        write_frame(read, tmp_path / f"x.{suffix}")
        result, attributes, spec = stored(tmp_path / f"x.{suffix}")
        assert (str(spec.format), spec.channelnames) == (kind, channels)
        assert attributes["ImageDescription"] == "a dome"
        if kind == "uint16":
            scaled = samples[..., : len(channels)].astype(float) * 65535
            assert np.abs(result - scaled).max() < 0.51  # the product is rounded in float32
    assert read_frame(tmp_path / "x.png").colour.transfer == "linear"
    assert read_frame(tmp_path / "x.dpx").colour.transfer == "linear"


def test_exr_of_an_integer_file_keeps_its_codes_and_encoding(tmp_path: Path) -> None:
    for bits, kind in ((8, "half"), (10, "half"), (12, "float"), (16, "float")):
        write_frame(frame(all_codes(bits) / (2**bits - 1), bits), tmp_path / "in.dpx", bits=bits)
        write_frame(read_frame(tmp_path / "in.dpx"), tmp_path / "x.exr")
        read = read_frame(tmp_path / "x.exr")
        assert str(stored(tmp_path / "x.exr")[2].format) == kind
        np.testing.assert_array_equal(np.rint(read.pixels * (2**bits - 1)), all_codes(bits))
        assert read.colour.transfer == "srgb"
        assert "dpx:Transfer" not in stored(tmp_path / "x.exr")[1]


@pytest.mark.parametrize(
    ("kept", "given"), [("zip", "zip"), ("zips", "zips"), ("zip", "piz"), ("zip", "none")]
)
def test_exr_is_compressed_so_that_damage_shows(tmp_path: Path, kept: str, given: str) -> None:
    source = store(tmp_path / "in.exr", texture("float16"), compression=given)
    write_frame(read_frame(source), tmp_path / "out.exr")
    assert stored(tmp_path / "out.exr")[1]["compression"] == kept


def test_depth_and_suffix_are_refused_with_the_choices(tmp_path: Path) -> None:
    made = frame(texture("float32"))
    with pytest.raises(InputError, match=r"wanted 8, 16 bits for PNG, got 10"):
        write_frame(made, tmp_path / "x.png", bits=10)
    with pytest.raises(InputError, match=r"\.exr, \.png, .*got '\.gif'"):
        write_frame(made, tmp_path / "x.gif")
    assert_nothing_else(tmp_path)


def test_the_same_frame_gives_the_same_bytes(tmp_path: Path) -> None:
    """No time of writing anywhere."""
    for suffix in METADATA:
        made = frame(texture("float32"))
        write_frame(made, tmp_path / f"a.{suffix}")
        write_frame(made, tmp_path / f"b.{suffix}")
        assert "DateTime" not in stored(tmp_path / f"a.{suffix}")[1]
        first, second = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in "ab")
        assert first.replace(b"a.dpx", b"b.dpx") == second
        assert b"/proc" not in first


# Colour.


def png_chunks(path: Path) -> list[tuple[bytes, bytes]]:
    content, position, found = path.read_bytes(), 8, []
    while position < len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        found.append((kind, content[position + 8 : position + 8 + length]))
        position += 12 + length
    return found


def png_with(path: Path, *colour: bytes) -> Path:
    """A PNG that says of its colour what `colour` says, and nothing else."""
    store(path, texture())
    body = [chunk(*each) for each in png_chunks(path) if each[0] in (b"IHDR", b"IDAT", b"IEND")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body[0] + b"".join(colour) + b"".join(body[1:]))
    return path


def chrm(*xy: float) -> bytes:
    white_first = (*xy[6:], *xy[:6])
    return chunk(b"cHRM", struct.pack(">8I", *(round(100000 * value) for value in white_first)))


def gamma(value: float) -> bytes:
    return chunk(b"gAMA", struct.pack(">I", round(100000 / value)))


@pytest.mark.parametrize(
    ("colour", "transfer", "primaries", "source"),
    [
        ([], "srgb", "BT.709", "assumed for PNG"),
        ([chunk(b"sRGB", b"\1")], "srgb", "BT.709", "file: sRGB"),
        ([gamma(1.0)], "linear", "BT.709", "file: gAMA"),
        ([gamma(2.2)], "gamma2.2", "BT.709", "file: gAMA"),
        ([gamma(2.4)], "gamma2.4", "BT.709", "file: gAMA"),
        ([gamma(2.6), chrm(*CHROMATICITIES)], "gamma2.6", "P3-D65", "file: gAMA, cHRM"),
        ([chrm(*CHROMATICITIES)], "srgb", "P3-D65", "file: cHRM"),
        (
            [chrm(0.6, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3)],
            "srgb",
            "0.6 0.3 0.2 0.7 0.1 0.1 0.3 0.3",
            "file: cHRM",
        ),
        ([chunk(b"cICP", bytes([9, 16, 0, 1]))], "st2084", "BT.2020", "file: cICP"),
        ([chunk(b"cICP", bytes([11, 17, 0, 1]))], "dcdm", "P3-DCI", "file: cICP"),
        ([chunk(b"cICP", bytes([1, 1, 0, 1]))], "bt1886", "BT.709", "file: cICP"),
    ],
)
def test_png_colour_is_read_and_written_back(
    tmp_path: Path, colour: list[bytes], transfer: str, primaries: str, source: str
) -> None:
    read = read_frame(png_with(tmp_path / "in.png", *colour))
    assert read.colour == ColourTag(transfer, primaries, source)
    write_frame(read, tmp_path / "out.png")
    kinds = (b"sRGB", b"gAMA", b"cHRM", b"cICP", b"iCCP")
    assert [chunk(*each) for each in png_chunks(tmp_path / "out.png") if each[0] in kinds] == colour
    assert read_frame(tmp_path / "out.png").colour == read.colour


@pytest.mark.parametrize(
    "bad", [chunk(b"cICP", bytes([9, 11, 0, 1])), chunk(b"cICP", bytes([1, 1, 0, 0])), gamma(1.8)]
)
def test_png_encodings_that_are_not_supported_are_refused(tmp_path: Path, bad: bytes) -> None:
    assert "Convert it first" in refusal(png_with(tmp_path / "in.png", bad))


@pytest.mark.parametrize(
    ("name", "transfer"),
    [
        ("Linear", "linear"),
        ("SMPTE 274M", "bt1886"),
        ("ITU-R 709-4", "bt1886"),
        ("Unspecified video", "srgb"),
        ("User defined", "srgb"),
        ("Undefined", "srgb"),
    ],
)
def test_dpx_transfer_is_read_and_written_back(tmp_path: Path, name: str, transfer: str) -> None:
    source = store(
        tmp_path / "in.dpx", texture("uint16"), dpx__Transfer=name, oiio__BitsPerSample=10
    )
    read = read_frame(source)
    assert read.colour.transfer == transfer
    assert name in read.colour.source
    assert read.colour.source.startswith("assumed") == (transfer == "srgb")
    write_frame(read, tmp_path / "out.dpx")
    assert stored(tmp_path / "out.dpx")[1]["dpx:Transfer"] == name


@pytest.mark.parametrize("name", ["Printing density", "Logarithmic"])
def test_dpx_densities_are_refused(tmp_path: Path, name: str) -> None:
    source = store(tmp_path / "in.dpx", texture("uint16"), dpx__Transfer=name)
    assert f"got {name}. Convert it first" in refusal(source)


@pytest.mark.parametrize(
    ("primaries", "xy"),
    [
        ("BT.709", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)),
        ("P3-D65", CHROMATICITIES),
        ("P3-DCI", (*CHROMATICITIES[:6], 0.314, 0.351)),
        ("BT.2020", (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)),
        ("ACES AP0", (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)),
        ("ACES AP1", (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)),
        ("XYZ", (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)),
    ],
)
def test_exr_chromaticities_name_the_primaries(
    tmp_path: Path, primaries: str, xy: tuple[float, ...]
) -> None:
    source = store(tmp_path / "in.exr", texture("float16"), chromaticities=("float[8]", xy))
    assert read_frame(source).colour == ColourTag("linear", primaries, "file: chromaticities")


def test_exr_of_chromaticities_that_are_no_colours_says_so(tmp_path: Path) -> None:
    for xy in ((0.0,) * 8, (0.3, 0.3) * 4, (0.6, 0.3, 0.2, 0.7, 0.1, 0.1, 0.7, 0.7)):
        source = store(tmp_path / "in.exr", texture("float16"), chromaticities=("float[8]", xy))
        colour = read_frame(source).colour
        assert (colour.transfer, colour.primaries) == ("linear", "BT.709")
        assert "are no colours" in colour.source


def test_frames_describe_themselves(tmp_path: Path) -> None:
    read = read_frame(store(tmp_path / "x.jpg", texture()))
    assert read.described() == "31 x 23 JPEG, 8 bit, sRGB (assumed for JPEG)"
    read = read_frame(
        store(tmp_path / "x.exr", texture("float16"), chromaticities=("float[8]", CHROMATICITIES))
    )
    expected = "31 x 23 EXR, 16 bit float, linear P3-D65 (file: chromaticities)"
    assert read.described() == expected
    assert read_frame(store(tmp_path / "f.tif", texture("float32"))).colour.transfer == "linear"
    assert read_frame(store(tmp_path / "i.tif", texture("uint16"))).colour.transfer == "srgb"


# Damage.

TRUNCATED = {
    "half.exr": ("float16", {"compression": "zip"}),
    "float.exr": ("float32", {"compression": "none"}),
    "piz.exr": ("float16", {"compression": "piz"}),
    "8.png": ("uint8", {"ImageDescription": "a dome"}),
    "16.png": ("uint16", {}),
    "8.tif": ("uint8", {"compression": "none", "Artist": "me", "ExposureTime": 0.25}),
    "16.tif": ("uint16", {"compression": "lzw"}),
    "float.tif": ("float32", {"compression": "zip"}),
    "8.jpg": ("uint8", {"Artist": "me"}),
    "8.dpx": ("uint8", {}),
    "10.dpx": ("uint16", {"oiio:BitsPerSample": 10}),
    "16.dpx": ("uint16", {}),
}


def test_truncation_is_noticed_where_only_metadata_is_lost(tmp_path: Path) -> None:
    """A TIFF and a JPEG as others write them: tags behind the pixels; a progressive scan."""
    path = store(tmp_path / "x.tif", texture(), compression="none")
    pixels = texture().tobytes()
    entries = [(256, 4, 1, COLS), (257, 4, 1, ROWS), (258, 3, 3, 0), (259, 3, 1, 1)]
    entries += [(262, 3, 1, 2), (273, 4, 1, 8), (277, 3, 1, 3), (278, 4, 1, ROWS)]
    entries += [(279, 4, 1, len(pixels)), (315, 2, 40, 0)]
    directory = 8 + len(pixels) + len(pixels) % 2
    behind = directory + 2 + 12 * len(entries) + 4
    table = b"".join(
        struct.pack("<HHII", tag, kind, count, {258: behind, 315: behind + 6}.get(tag, value))
        for tag, kind, count, value in entries
    )
    content = b"II*\0" + struct.pack("<I", directory) + pixels + b"\0" * (len(pixels) % 2)
    content += struct.pack("<H", len(entries)) + table + b"\0\0\0\0"
    content += struct.pack("<3H", 8, 8, 8) + b"artist".ljust(40, b"\0")
    path.write_bytes(content)
    np.testing.assert_array_equal(stored(path)[0], texture())
    assert read_frame(path).bits == 8
    for missing in range(1, 60):
        path.write_bytes(content[:-missing])
        assert "ends early" in refusal(path)


def test_truncation_is_noticed_behind_the_pixels_of_a_dpx(tmp_path: Path) -> None:
    path = store(tmp_path / "x.dpx", texture())
    content = bytearray(path.read_bytes() + b"\0" * 100)
    order = "<" if content[:4] == b"XPDS" else ">"
    struct.pack_into(order + "I", content, 16, len(content))
    path.write_bytes(content)
    assert read_frame(path).bits == 8
    path.write_bytes(content[:-1])
    assert f"ends early, at {len(content) - 1} of {len(content)} bytes" in refusal(path)
    struct.pack_into(order + "I", content, 16, 0xFFFFFFFF)
    path.write_bytes(content[:-1])
    assert read_frame(path).bits == 8


@pytest.mark.parametrize("name", ["half.exr", "8.png", "16.png"])
def test_flipped_bytes_are_noticed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    """ZIP EXR and PNG have checksums; a change that is not noticed must change no pixel."""
    dtype, attributes = TRUNCATED[name]
    path = store(tmp_path / name, texture(dtype), **attributes)
    content = path.read_bytes()
    expected = read_frame(path).pixels
    rng = np.random.default_rng(11)
    noticed = 0
    for position in rng.integers(len(content), size=150):
        damaged = bytearray(content)
        damaged[position] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            result = read_frame(path).pixels
        except InputError as error:
            noticed += 1
            assert "\n" not in str(error)  # noqa: PT017 (both outcomes are right)
        else:
            if result.shape == expected.shape:
                assert np.mean(result != expected) < 0.05
    assert noticed > 75
    assert capfd.readouterr() == ("", "")


def test_implausible_sizes_are_refused_before_memory_is_asked_for(tmp_path: Path) -> None:
    path = store(tmp_path / "x.exr", texture("float16"))
    content = path.read_bytes()
    for side in (100_000, 30_000):
        window = struct.pack("<4i", 0, 0, side - 1, side - 1)
        old = struct.pack("<4i", 0, 0, COLS - 1, ROWS - 1)
        assert content.count(old) == 2
        path.write_bytes(content.replace(old, window))
        refusal(path)

    path = png_with(tmp_path / "x.png")
    body = dict(png_chunks(path))
    for side in (100_000, 30_000):
        header = struct.pack(">2I", side, side) + body[b"IHDR"][8:]
        whole = [chunk(b"IHDR", header), chunk(b"IDAT", body[b"IDAT"]), chunk(b"IEND", b"")]
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(whole))
        refusal(path)

    path = store(tmp_path / "x.jpg", texture())
    content = bytearray(path.read_bytes())
    struct.pack_into(">2H", content, content.index(b"\xff\xc0") + 5, 12_000, 12_000)
    path.write_bytes(content)
    assert "bytes for 12000 x 12000 px of 3 channels" in refusal(path)

    path = store(tmp_path / "x.dpx", texture())
    content = bytearray(path.read_bytes())
    order = "<" if content[:4] == b"XPDS" else ">"
    struct.pack_into(order + "2I", content, 772, 30_000, 30_000)
    path.write_bytes(content)
    refusal(path)


def test_plain_black_is_not_implausible(tmp_path: Path) -> None:
    """Compressed a thousandfold."""
    black = frame(np.zeros((1500, 1500, 3)))
    for name, bits in (("x.exr", 32), ("x.png", 16), ("x.tif", 32), ("x.jpg", 8)):
        write_frame(black, tmp_path / name, bits=bits)
        assert not read_frame(tmp_path / name).pixels.any()


def test_what_is_no_image_file_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert "there is none" in refusal(tmp_path / "missing.png")
    assert "got a folder" in refusal(tmp_path)
    assert "device or pipe" in refusal(Path("/dev/zero"))
    (tmp_path / "empty.png").touch()
    assert "empty file" in refusal(tmp_path / "empty.png")
    for name in ("x.exr", "x.png", "x.tif", "x.jpg", "x.dpx", "x.txt", "x.null"):
        (tmp_path / name).write_text("this is not an image\n" * 200)
        refusal(tmp_path / name)
    below_a_file = tmp_path / "x.txt" / "x.png"
    refusal(below_a_file)
    assert capfd.readouterr() == ("", "")


def test_formats_that_were_not_tried_are_refused(tmp_path: Path) -> None:
    assert "JPEG 2000, BMP" in refusal(store(tmp_path / "x.gif", texture()))


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_cmyk_is_refused(tmp_path: Path, suffix: str) -> None:
    """OpenImageIO would make an RGB of its own of it."""
    image = pytest.importorskip("PIL.Image")  # OpenImageIO writes no CMYK
    image.fromarray(texture()).convert("CMYK").save(tmp_path / f"x.{suffix}")
    assert "got CMYK" in refusal(tmp_path / f"x.{suffix}")


# Impossible samples.


def test_impossible_samples_are_counted_and_located(tmp_path: Path) -> None:
    samples = texture("float32")
    samples[4, 7, 1] = np.nan
    samples[4, 7, 2] = np.inf
    samples[9, 0, 0] = -0.25
    samples[9, 1, 0] = -np.inf
    path = store(tmp_path / "x.exr", samples)
    message = refusal(path)
    assert "got 1 NaN, 1 Inf, 2 negative, the first at row 4, col 7, channel G" in message
    assert "--repair" in message

    read = read_frame(path, repair=True)
    assert read.repaired == 4
    largest = np.where(np.isfinite(samples[..., 2]), samples[..., 2], 0).max()
    assert read.pixels[4, 7].tolist() == [samples[4, 7, 0], 0, largest]
    assert read.pixels[9, :2, 0].tolist() == [0, 0]
    untouched = np.isfinite(samples) & (samples >= 0)
    np.testing.assert_array_equal(read.pixels[untouched], samples[untouched])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1e-8])
@pytest.mark.parametrize("place", [(0, 0, 0), (ROWS - 1, COLS - 1, 2)])
def test_one_impossible_sample_is_enough(
    tmp_path: Path, value: float, place: tuple[int, int, int]
) -> None:
    samples = texture("float32")
    samples[place] = value
    path = store(tmp_path / "x.tif", samples)
    row, col, channel = place
    assert f"at row {row}, col {col}, channel {'RGB'[channel]}" in refusal(path)
    assert read_frame(path, repair=True).repaired == 1


def test_a_channel_of_nothing_finite_is_repaired_to_black(tmp_path: Path) -> None:
    samples = texture("float16")
    samples[..., 1] = np.inf
    read = read_frame(store(tmp_path / "x.exr", samples), repair=True)
    assert read.repaired == ROWS * COLS
    assert not read.pixels[..., 1].any()


def test_a_clean_file_is_not_repaired(tmp_path: Path) -> None:
    samples = texture("float16")
    samples[0, 0, 0] = -0.0
    assert read_frame(store(tmp_path / "x.exr", samples)).repaired == 0


# Whole or not at all.


@pytest.mark.parametrize("suffix", ["exr", "png", "tif", "jpg", "dpx"])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(small_disk: Path, suffix: str) -> None:
    """Rationale: OpenImageIO's JPEG writer ends the process here, its PNG writer succeeds."""
    path = small_disk / f"x.{suffix}"
    write_frame(frame(texture("float32")), path)
    before = path.read_bytes()
    noise = np.random.default_rng(0).random((400, 300, 3))
    with pytest.raises(InputError, match=r"x\.\w+: wanted to write it, got 'no space left.*Free"):
        write_frame(frame(noise), path)
    assert path.read_bytes() == before
    assert_nothing_else(small_disk, path.name)
    read_frame(path)


@pytest.mark.parametrize("suffix", ["exr", "png", "tif", "jpg", "dpx"])
def test_unwritable_places_are_refused(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / f"folder.{suffix}").mkdir()
    made = frame(texture("float32"))
    for folder in (tmp_path / "file", tmp_path / "missing", Path("/proc")):
        with pytest.raises(InputError, match="wanted to write it, got") as caught:
            write_frame(made, folder / f"x.{suffix}")
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="is a directory"):
        write_frame(made, tmp_path / f"folder.{suffix}")
    assert_nothing_else(tmp_path, "file", f"folder.{suffix}")


def test_large_sides_are_refused(tmp_path: Path) -> None:
    made = frame(np.zeros((1, 40_000, 3)))
    with pytest.raises(ValueError, match="32768"):
        write_frame(made, tmp_path / "x.jpg")
    store(tmp_path / "x.png", np.zeros((1, 40_000, 3), np.uint8))
    assert "wanted 1 to 32768 px a side, got 40000 x 1" in refusal(tmp_path / "x.png")


# Real files.


def images() -> list[Path]:
    return sorted(
        path
        for path in DATA.rglob("*")
        if path.suffix in (".exr", ".png", ".jpg") and path.exists()
    )


@pytest.mark.skipif(not DATA.exists(), reason="no example data here")
def test_real_files_are_read_and_written_back(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for path in images():
        if path.name == "fog_multiview.exr":
            assert "got Y, right.Y. Convert it to RGB first" in refusal(path)
            continue
        if path.name == "dm3d_pillars_hdr_512.exr":
            assert "got 12 Inf" in refusal(path)
        read = read_frame(path, repair=True)
        assert read.repaired == (12 if path.name == "dm3d_pillars_hdr_512.exr" else 0)
        copy = tmp_path / path.name
        write_frame(read, copy)
        again = read_frame(copy)
        if path.suffix != ".jpg":
            np.testing.assert_array_equal(again.pixels, read.pixels)
        before, after = stored(path), stored(copy)
        assert after[2].channelnames == before[2].channelnames
        np.testing.assert_array_equal(after[0][..., 3:], before[0][..., 3:])
        # OpenImageIO writes no XMP but what it knows.
        lost = ("compression", "stRef:instanceID", "stRef:documentID")
        kept = {name for name in before[1] if not storage(name) and name not in lost}
        assert {name: str(after[1].get(name)) for name in kept} == {
            name: str(before[1][name]) for name in kept
        }
        copy.unlink()
    assert capfd.readouterr() == ("", "")
