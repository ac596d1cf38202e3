"""What headers say: believed as far as their writers are known to mean it, and written back."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from icc_profiles import SRGB_CURVE, gamma, icc_profile, linear, parametric, sampled
from image_files import store
from test_frames import refusal, stored

from domesim.frames import ColourTag, read_frame, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.formats.png import chunk

ROWS, COLS = 34, 40


def ramp(dtype: str = "uint8", channels: int = 3) -> np.ndarray:
    row, col = np.mgrid[:ROWS, :COLS]
    values = np.stack([(row + k * col + 1) / (ROWS + k * COLS) for k in range(channels)], -1)
    if np.issubdtype(dtype, np.integer):
        return np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return values.astype(dtype)


# ICC profiles.


def gamma22(x: np.ndarray) -> np.ndarray:
    return x**2.2


CURVES = {
    "linear": (linear(), "linear"),
    "linear of two points": (sampled(lambda x: x, 2), "linear"),
    "linear of gamma 1": (gamma(1.0), "linear"),
    "sRGB": (SRGB_CURVE, "srgb"),
    "sRGB as Adobe has it": (
        sampled(lambda x: np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)),
        "srgb",
    ),
    "2.2": (gamma(2.2), "gamma2.2"),
    "2.2 as a table": (sampled(gamma22, 256), "gamma2.2"),
    "2.4": (gamma(2.4), "gamma2.4"),
    "2.6": (gamma(2.6), "gamma2.6"),
}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("suffix", ["png", "tif", "jpg", "jp2"])
def test_a_profile_means_what_its_curve_does_not_what_its_name_says(
    tmp_path: Path, suffix: str, curve: str
) -> None:
    content, transfer = CURVES[curve]
    profile = icc_profile("GIMP built-in Linear sRGB", "BT.709", content)
    path = store(tmp_path / f"x.{suffix}", ramp(), ICCProfile=(f"uint8[{profile.size}]", profile))
    if "ICCProfile" not in stored(path)[1]:
        pytest.skip("OpenImageIO writes no profile there")
    colour = read_frame(path).colour
    assert (colour.transfer, colour.primaries) == (transfer, "BT.709")
    assert colour.source == "file: ICC profile 'GIMP built-in Linear sRGB'"


@pytest.mark.parametrize("primaries", ["BT.709", "P3-D65", "P3-DCI", "BT.2020", "ACES AP1"])
def test_a_profile_names_the_primaries(tmp_path: Path, primaries: str) -> None:
    profile = icc_profile("linear Rec2020 RGB", primaries, linear())
    said = {"ICCProfile": (f"uint8[{profile.size}]", profile)}
    for suffix, dtype in (("tif", "float32"), ("png", "uint16")):
        colour = read_frame(store(tmp_path / f"x.{suffix}", ramp(dtype), **said)).colour
        assert (colour.transfer, colour.primaries) == ("linear", primaries)


@pytest.mark.parametrize(
    ("profile", "got"),
    [
        (icc_profile("sRGB IEC61966-2.1", "BT.709", gamma(1.8)), "with another tone curve"),
        (
            icc_profile(
                "camera", "BT.709", parametric(1 / 0.45, 1 / 1.099, 0.099 / 1.099, 1 / 4.5, 0.081)
            ),
            "with another tone curve",
        ),
        (icc_profile("sRGB IEC61966-2.1")[:200], "does not read"),
    ],
)
def test_a_profile_of_another_kind_is_refused_unless_a_person_says_what_it_is(
    tmp_path: Path, profile: np.ndarray, got: str
) -> None:
    path = store(tmp_path / "x.tif", ramp("uint16"), ICCProfile=(f"uint8[{profile.size}]", profile))
    assert got in refusal(path)
    assert "--encoding" in refusal(path)
    assert read_frame(path, colour=encoding_named("p3-d65")).colour.primaries == "P3-D65"


# DPX.


def dpx(path: Path, bits: int = 10, **said: object) -> Path:
    return store(
        path, ramp("uint8" if bits == 8 else "uint16"), **{"oiio:BitsPerSample": bits, **said}
    )


def set_field(path: Path, place: int, form: str, *values: float) -> None:
    content = bytearray(path.read_bytes())
    struct.pack_into((">" if content[:4] == b"SDPX" else "<") + form, content, place, *values)
    path.write_bytes(content)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_a_dpx_by_ffmpeg_is_not_believed_to_be_linear(tmp_path: Path, bits: int) -> None:
    said = {"Software": "Lavc59.37.100", "dpx:Transfer": "Linear"}
    path = dpx(tmp_path / "x.dpx", bits, **said)
    read = read_frame(path)
    assert (read.colour.transfer, read.colour.assumed) == ("srgb", True)
    assert "FFmpeg" in read.described()
    assert read_frame(path, colour=encoding_named("linear")).colour.transfer == "linear"
    honest = dpx(tmp_path / "y.dpx", bits, **{**said, "Software": "renderer"})
    assert read_frame(honest).colour.transfer == "linear"


@pytest.mark.parametrize("order", ["big", "little"])
def test_fields_behind_the_pixels_beginning_are_no_fields(tmp_path: Path, order: str) -> None:
    """FFmpeg's headers end at byte 1664: what follows is the first pixels."""
    path = dpx(tmp_path / "x.dpx", oiio__Endian=order)
    content = bytearray(path.read_bytes())
    (offset,) = struct.unpack_from({"big": ">I", "little": "<I"}[order], content, 4)
    pixels = content[offset:]
    path.write_bytes(content[:1664] + pixels)
    for place in (4, 24, 808):  # of the image; of the generic headers; of the element
        set_field(path, place, "I", 1664)
    set_field(path, 16, "I", 1664 + len(pixels))
    read = read_frame(path)
    np.testing.assert_array_equal(np.rint(read.pixels * 1023), ramp("uint16") >> 6)
    write_frame(read, tmp_path / "out.dpx")
    found = stored(tmp_path / "out.dpx")[1]
    assert not {"smpte:TimeCode", "dpx:TimeCode", "dpx:UserBits", "dpx:FrameRate"} & found.keys()
    assert "dpx:TemporalFrameRate" not in found


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_a_dpx_of_legal_range_is_light_from_64_to_940(tmp_path: Path, bits: int) -> None:
    scale = 2**bits // 256
    codes = np.full((ROWS, COLS, 3), 128 * scale)
    codes[0], codes[1], codes[2], codes[3] = 16 * scale, 235 * scale, 4 * scale, 250 * scale
    kind = "uint8" if bits == 8 else "uint16"
    widened = codes if bits in (8, 16) else codes << (16 - bits) | codes >> (2 * bits - 16)
    path = store(tmp_path / "x.dpx", widened.astype(kind), oiio__BitsPerSample=bits)
    for place, value in ((784, 16 * scale), (792, 235 * scale)):
        set_field(path, place, "I", value)
    read = read_frame(path)
    assert "legal range" in read.described()
    np.testing.assert_allclose(read.pixels[:4, 0, 0], [0, 1, 0, 1], atol=1e-6)
    np.testing.assert_allclose(read.pixels[4:], (128 - 16) / (235 - 16), rtol=1e-5)
    write_frame(read, tmp_path / "out.dpx")
    result = oiio.ImageInput.open(str(tmp_path / "out.dpx")).read_image("unknown")
    np.testing.assert_array_equal(result[4:], widened[4:])
    assert stored(tmp_path / "out.dpx")[1]["dpx:LowData"] == 16 * scale
    write_frame(read, tmp_path / "x.png")
    half = 0.5 / (255 if bits == 8 else 65535)
    np.testing.assert_allclose(read_frame(tmp_path / "x.png").pixels, read.pixels, atol=half)


def test_other_reference_codes_are_left_alone(tmp_path: Path) -> None:
    path = dpx(tmp_path / "x.dpx")
    for low, high in ((0, 1023), (95, 685), (0, 0)):
        set_field(path, 784, "I", low)
        set_field(path, 792, "I", high)
        assert read_frame(path).pixels.max() == 1


# HDR.


def hdr(path: Path, *lines: str) -> Path:
    store(path, ramp("float32"))
    content = path.read_bytes()
    first, rest = content.split(b"\n", 1)
    path.write_bytes(b"\n".join([first, *(line.encode() for line in lines), rest]))
    return path


def test_exposures_of_an_hdr_are_taken_back(tmp_path: Path) -> None:
    plain = read_frame(hdr(tmp_path / "plain.hdr"))
    once = read_frame(hdr(tmp_path / "once.hdr", "EXPOSURE=2.0"))
    several = read_frame(
        hdr(
            tmp_path / "several.hdr",
            "EXPOSURE=2.0",
            "VIEW= -vtv",
            "EXPOSURE= 4",
            "COLORCORR=1 2 .5",
        )
    )
    np.testing.assert_allclose(once.pixels, plain.pixels / 2, rtol=1e-6)
    expected = plain.pixels / (8 * np.array([1, 2, 0.5]))
    np.testing.assert_allclose(several.pixels, expected, rtol=1e-6)


def test_primaries_of_an_hdr(tmp_path: Path) -> None:
    wide = "PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"
    read = read_frame(hdr(tmp_path / "x.hdr", wide))
    assert read.colour == ColourTag("linear", "BT.2020", "file: PRIMARIES")
    write_frame(read, tmp_path / "x.exr")
    assert read_frame(tmp_path / "x.exr").colour.primaries == "BT.2020"
    none = hdr(tmp_path / "own.hdr", "PRIMARIES=0.3 0.3 0.3 0.3 0.3 0.3 0.3 0.3")
    assert "got 0.3 0.3" in refusal(none)
    assert read_frame(none, colour=encoding_named("acescg")).colour.primaries == "ACES AP1"


@pytest.mark.parametrize(
    "line", ["EXPOSURE=0", "EXPOSURE=bright", "EXPOSURE=nan", "COLORCORR=1 2", "PRIMARIES=1"]
)
def test_an_hdr_that_says_nonsense_is_refused(tmp_path: Path, line: str) -> None:
    assert "got" in refusal(hdr(tmp_path / "x.hdr", line))


def test_an_hdr_of_xyz_is_refused(tmp_path: Path) -> None:
    path = hdr(tmp_path / "x.hdr")
    path.write_bytes(path.read_bytes().replace(b"rle_rgbe", b"rle_xyze"))
    assert "xyze" in refusal(path)


# Pixels that are not square.


def test_pixels_of_an_hdr_that_are_not_square_are_refused(tmp_path: Path) -> None:
    assert "got ones of 2 : 1" in refusal(hdr(tmp_path / "x.hdr", "PIXASPECT=0.5"))


def test_densities_of_print_are_only_told(tmp_path: Path) -> None:
    said = {"XResolution": 144.0, "YResolution": 72.0, "ResolutionUnit": "in"}
    for suffix in ("tif", "png", "jpg"):
        path = store(tmp_path / f"x.{suffix}", ramp(), PixelAspectRatio=0.5, **said)
        assert "taken as square" in read_frame(path).described(), suffix


# PNG.


def png(path: Path, *chunks: bytes) -> Path:
    from PIL import Image  # noqa: PLC0415 - OpenImageIO's says more than its pixels

    Image.fromarray(ramp()).save(path)
    content = path.read_bytes()
    path.write_bytes(content[:33] + b"".join(chunks) + content[33:])
    return path


def kinds_in(path: Path) -> list[bytes]:
    content, place, found = path.read_bytes(), 8, []
    while place < len(content):
        found.append(content[place + 4 : place + 8])
        place += 12 + int.from_bytes(content[place : place + 4])
    return found


def test_a_gamma_of_nothing_says_nothing(tmp_path: Path) -> None:
    colour = read_frame(png(tmp_path / "x.png", chunk(b"gAMA", bytes(4)))).colour
    assert (colour.transfer, colour.source) == ("srgb", "assumed for PNG")


CARRIED = {
    "UTF-8": chunk(b"iTXt", b"Title\0\0\0de\0\0" + "ä Ω".encode()),
    "Latin-1": chunk(b"tEXt", b"Author\0Z\xfcrich"),
    "compressed": chunk(b"zTXt", b"Comment\0\0x\x9c\x03\x00\x00\x00\x00\x01"),
    "of ours": chunk(b"tEXt", b"studio:shot\0sh010"),
    "density": chunk(b"pHYs", struct.pack(">IIB", 2000, 2000, 1)),
    "place": chunk(b"oFFs", struct.pack(">iiB", 3, -4, 0)),
    "time": chunk(b"tIME", struct.pack(">H5B", 2020, 1, 2, 3, 4, 5)),
    "Exif": chunk(b"eXIf", b"MM\0*\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\1\0\0\0\0\0\0"),
}


@pytest.mark.parametrize("names", [list(CARRIED), *([name] for name in CARRIED)])
def test_what_a_png_tells_of_its_picture_comes_back_to_the_byte(
    tmp_path: Path, names: list[str]
) -> None:
    told = [CARRIED[name] for name in names]
    read = read_frame(png(tmp_path / "in.png", *told))
    write_frame(read.with_pixels(read.pixels / 2), tmp_path / "out.png")
    content = (tmp_path / "out.png").read_bytes()
    assert all(each in content for each in told)
    assert sorted(kinds_in(tmp_path / "out.png")) == sorted(
        [*kinds_in(png(tmp_path / "plain.png")), *(each[4:8] for each in told)]
    )
    assert read_frame(tmp_path / "out.png").pixels.shape == read.pixels.shape


def test_text_of_another_format_that_is_not_latin_1_becomes_utf_8(tmp_path: Path) -> None:
    source = store(tmp_path / "in.exr", ramp("float16"), ImageDescription="ä Ω", Artist="me")
    write_frame(read_frame(source), tmp_path / "x.png")
    assert stored(tmp_path / "x.png")[1]["ImageDescription"] == "ä Ω"
    assert kinds_in(tmp_path / "x.png").count(b"iTXt") == 1
    from PIL import Image  # noqa: PLC0415

    with Image.open(tmp_path / "x.png") as opened:
        assert opened.text["Description"] == "ä Ω"
        assert opened.text["Author"] == "me"


# JPEG.


def test_what_a_jpeg_tells_of_its_picture_comes_back_to_the_byte(tmp_path: Path) -> None:
    from PIL import Image  # noqa: PLC0415

    exif = Image.Exif()
    exif[0x0112], exif[0x0213], exif[0x010E] = 6, 1, "a dome"
    exif.get_ifd(0x8769)[0x9286] = b"ASCII\0\0\0a comment"
    picture = Image.fromarray(ramp())
    picture.save(tmp_path / "in.jpg", exif=exif, comment=b"Z\xfcrich", quality=95)
    write_frame(read_frame(tmp_path / "in.jpg"), tmp_path / "out.jpg")
    with Image.open(tmp_path / "in.jpg") as old, Image.open(tmp_path / "out.jpg") as new:
        assert new.info["exif"] == old.info["exif"]
        assert new.info["comment"] == b"Z\xfcrich"
        assert new.getexif()[0x0112] == 6


# EXR.


def exr_attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value


def exr_with(path: Path, *told: bytes, **said: object) -> Path:
    """An EXR with attributes that OpenImageIO does not write, by moving all its chunks."""
    content = store(path, ramp("float16"), **said).read_bytes()
    block = b"".join(told)
    end = content.index(b"\0\0", content.index(b"screenWindowWidth") + 18 + 6 + 4 + 4 - 2)
    place = 8
    while content[place]:
        place = content.index(b"\0", content.index(b"\0", place) + 1) + 1
        place += 4 + struct.unpack_from("<I", content, place)[0]
    end = place
    (first,) = struct.unpack_from("<Q", content, end + 1)
    offsets = np.frombuffer(content, "<u8", (first - end - 1) // 8, end + 1) + len(block)
    head = content[:end] + block + b"\0" + offsets.astype("<u8").tobytes()
    path.write_bytes(head + content[first:])
    return path


TOLD = [
    exr_attribute("v2d", "v2d", struct.pack("<2d", 0.1, 0.2)),
    exr_attribute("v3d", "v3d", struct.pack("<3d", 0.1, 0.2, 0.3)),
    exr_attribute("m33d", "m33d", struct.pack("<9d", *(k / 3 for k in range(9)))),
    exr_attribute("m44d", "m44d", struct.pack("<16d", *(k / 3 for k in range(16)))),
    exr_attribute("precise", "double", struct.pack("<d", 0.1)),
    exr_attribute("studio", "opaque thing", b"\1\2\3"),
    exr_attribute("bytes", "bytes", struct.pack("<I", 4) + b"hint\0\1\2"),
    exr_attribute("city", "string", b"Z\xfcrich"),
    exr_attribute("framesPerSecond", "rational", struct.pack("<iI", 30000, 1001)),
    exr_attribute("timeCode", "timecode", struct.pack("<2I", 0x01020304, 5)),
    exr_attribute("keyCode", "keycode", struct.pack("<7i", 1, 2, 3, 4, 5, 6, 7)),
    exr_attribute("whole", "floatvector", struct.pack("<3f", 1, 2, 3)),
    exr_attribute("rate", "rational", struct.pack("<iI", 24, 1)),
    exr_attribute("unset", "rational", struct.pack("<iI", 0, 0)),
    exr_attribute("least", "int", struct.pack("<i", -(2**31))),
    exr_attribute("large", "double", struct.pack("<d", 1e300)),
    exr_attribute("one", "float", struct.pack("<f", 1)),
    exr_attribute("pixels", "v2i", struct.pack("<2i", 1, 2)),
    exr_attribute("a name of more than thirty-one letters", "int", struct.pack("<i", 7)),
    exr_attribute("Orientation", "int", struct.pack("<i", 1)),
]


def test_what_an_exr_tells_of_its_picture_comes_back_to_the_byte(tmp_path: Path) -> None:
    preview = exr_attribute("preview", "preview", struct.pack("<2I4B", 1, 1, 9, 8, 7, 6))
    path = exr_with(tmp_path / "in.exr", *TOLD, preview)
    read = read_frame(path)
    write_frame(read.with_pixels(read.pixels / 2), tmp_path / "out.exr")
    content = (tmp_path / "out.exr").read_bytes()
    told = [each.replace(b"\6\0\0\0Z\xfc", b"\7\0\0\0Z\xc3\xbc") for each in TOLD]  # in UTF-8
    assert [each for each in told if each not in content] == []
    assert b"preview" not in content  # of the old picture
    result = read_frame(tmp_path / "out.exr")
    np.testing.assert_array_equal(result.pixels, read.pixels / 2)
    OpenEXR = pytest.importorskip("OpenEXR")
    header = OpenEXR.File(str(exr_with(tmp_path / "in.exr", *TOLD[:5]))).header()
    write_frame(read_frame(tmp_path / "in.exr"), tmp_path / "out.exr")
    opened = OpenEXR.File(str(tmp_path / "out.exr"))
    for name in ("v2d", "v3d", "m33d", "m44d", "precise"):
        np.testing.assert_array_equal(opened.header()[name], header[name])
    assert opened.channels()["RGB"].pixels.shape == (ROWS, COLS, 3)


ORDERS = {
    "Plain Texture": exr_attribute("textureformat", "string", b"Plain Texture"),
    "levels": exr_attribute("openexr:levelmode", "int", struct.pack("<i", 1)),
    "rounding": exr_attribute("openexr:roundingmode", "int", struct.pack("<i", 1)),
    "compression": exr_attribute("openexr:dwaCompressionLevel", "float", struct.pack("<f", 9.0)),
    "alpha": exr_attribute("oiio:UnassociatedAlpha", "int", struct.pack("<i", 1)),
    "depth": exr_attribute("oiio:BitsPerSample", "int", struct.pack("<i", 10)),
    "raw": exr_attribute("oiio:RawColor", "int", struct.pack("<i", 1)),
    "planes": exr_attribute("planarconfig", "string", b"separate"),
    "order": exr_attribute("openexr:lineOrder", "string", b"decreasingY"),
    "profile": exr_attribute("ICCProfile", "string", b"sRGB"),
}


@pytest.mark.parametrize("target", ["exr", "png", "tif", "dpx", "jpg", "jp2"])
@pytest.mark.parametrize("order", ORDERS)
def test_no_attribute_steers_the_encoder(tmp_path: Path, order: str, target: str) -> None:
    path = exr_with(tmp_path / "in.exr", ORDERS[order])
    read = read_frame(path)
    write_frame(read, tmp_path / f"out.{target}")
    result = read_frame(tmp_path / f"out.{target}", colour=read.colour)
    np.testing.assert_allclose(result.pixels, read.pixels, atol=0.05 if target == "jpg" else 1e-4)


AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767)


@pytest.mark.parametrize("compression", ["zip", "none"])
def test_an_aces_container_stays_one(tmp_path: Path, compression: str) -> None:
    """SMPTE ST 2065-4: half, AP0, not compressed."""
    flag = exr_attribute("acesImageContainerFlag", "int", struct.pack("<i", 1))
    said = {"chromaticities": ("float[8]", AP0), "compression": compression}
    path = exr_with(tmp_path / "in.exr", flag, **said)
    read = read_frame(path)
    assert read.colour.primaries == "ACES AP0"
    write_frame(read, tmp_path / "out.exr")
    assert flag in (tmp_path / "out.exr").read_bytes()
    assert stored(tmp_path / "out.exr")[1]["compression"] == "none"
    np.testing.assert_array_equal(read_frame(tmp_path / "out.exr").pixels, read.pixels)
    # What is none of that any more does not say so.
    write_frame(read, tmp_path / "32.exr", bits=32)
    assert flag not in (tmp_path / "32.exr").read_bytes()
    for suffix in ("png", "tif", "dpx"):
        write_frame(read, tmp_path / f"x.{suffix}")


def test_ffmpeg_and_openimageio_read_what_is_written(tmp_path: Path) -> None:
    pytest.importorskip("av")
    import av  # noqa: PLC0415

    read = read_frame(exr_with(tmp_path / "in.exr", *TOLD))
    write_frame(read, tmp_path / "out.exr")
    with av.open(str(tmp_path / "out.exr")) as container:
        (frame,) = container.decode(video=0)
    assert (frame.width, frame.height) == (COLS, ROWS)
