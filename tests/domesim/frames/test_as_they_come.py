"""Pictures as cameras and programs write them: what their headers say in passing is heard.

Values are those of Pillow, or of the bytes that a test lays out itself.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from icc_profiles import gamma, icc_profile
from image_files import store
from PIL import ExifTags, Image
from plain_files import write_dpx
from test_frames import refusal

from domesim.errors import InputError
from domesim.frames import read_frame, read_master, write_frame
from domesim.frames.colour import chromaticities_of
from domesim.frames.encodings import encoding_named
from domesim.light import transfer
from domesim.observation.projector import Projector

ORANGE = (152, 30, 15)


def flat(rows: int = 16, cols: int = 16) -> np.ndarray:
    return np.full((rows, cols, 3), ORANGE, np.uint8)


def codes(path: Path) -> list[int]:
    """Codes of the middle, of 8 bits."""
    pixels = read_frame(path).pixels
    middle = pixels[pixels.shape[0] // 2, pixels.shape[1] // 2]
    return [round(float(each) * 255) for each in middle]


# JPEG: several pictures in a file.

GAIN_XMP = (
    b"http://ns.adobe.com/xap/1.0/\0<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:RDF "
    b"xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'><rdf:Description "
    b'xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" '
    b'hdrgm:GainMapMax="2.0" hdrgm:HDRCapacityMax="2.0"/></rdf:RDF></x:xmpmeta>'
)
GAIN_ISO = b"urn:iso:std:iso:ts:21496:-1\0" + bytes(4)


def jpeg(image: np.ndarray, *segments: tuple[int, bytes], **options: object) -> bytes:
    memory = io.BytesIO()
    Image.fromarray(image).save(memory, "JPEG", quality=100, subsampling=0, **options)
    whole = b"".join(
        struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body for marker, body in segments
    )
    return memory.getvalue()[:2] + whole + memory.getvalue()[2:]


def index_of(first: bytes, second: bytes) -> bytes:
    """The body of an MPO's index, of two pictures that are nothing in particular."""
    entries = struct.pack(">IIIHH", 0x030000, len(first), 0, 0, 0)
    entries += struct.pack(">IIIHH", 0, len(second), max(len(first) - 10, 0), 0, 0)
    table = struct.pack(">HHHI4s", 3, 0xB000, 7, 4, b"0100") + struct.pack(">HHII", 0xB001, 4, 1, 2)
    table += struct.pack(">HHII", 0xB002, 7, len(entries), 50) + bytes(4)
    return b"MPF\0MM\0*" + struct.pack(">I", 8) + table + entries


@pytest.mark.parametrize("says", ["XMP", "ISO", "both"])
@pytest.mark.parametrize("indexed", [True, False])
def test_a_gain_map_is_left_out(tmp_path: Path, says: str, indexed: bool) -> None:
    marks = {"XMP": [(0xE1, GAIN_XMP)], "ISO": [(0xE2, GAIN_ISO)]}
    marks["both"] = marks["XMP"] + marks["ISO"]
    second = jpeg(np.full((8, 8, 3), 200, np.uint8), *marks[says])
    first = jpeg(flat(), (0xFE, b"a comment"), *marks[says])
    if indexed:
        room = 4 + len(index_of(b"", b""))
        mark = (0xE2, index_of(first + bytes(room), second))
        first = jpeg(flat(), mark, (0xFE, b"a comment"), *marks[says])
    path = tmp_path / "phone.jpg"
    path.write_bytes(first + second)
    read = read_frame(path)
    assert (read.bits, read.floating, read.colour.transfer) == (8, False, "srgb")
    assert read.header.notes == ("its gain map is left out",)
    shown = np.asarray(Image.open(io.BytesIO(first)).convert("RGB"))
    np.testing.assert_array_equal(np.rint(read.pixels * 255).astype(int), shown)
    write_frame(read, tmp_path / "out.jpg")
    written = (tmp_path / "out.jpg").read_bytes()
    assert b"a comment" in written
    assert b"gain-map" not in written
    assert b"21496" not in written
    assert b"MPF" not in written


def test_two_unmarked_pictures_are_a_pair_if_a_person_says_so(tmp_path: Path) -> None:
    left, right = (Image.fromarray(np.roll(flat() + k, k, 1)) for k in range(2))
    path = tmp_path / "pair.mpo"
    left.save(path, save_all=True, append_images=[right], quality=100)
    read = read_frame(path)
    assert "one of 2 pictures in its file" in read.described()
    assert "--packing mpo" in read.described()
    master = read_master([path], packing="mpo")
    assert master.packing == "mpo"
    for frame, number in zip(master.frames, (0, 1), strict=True):
        with Image.open(path) as opened:
            opened.seek(number)
            np.testing.assert_allclose(frame.pixels * 255, np.asarray(opened), atol=0.01)


def test_what_follows_a_jpeg_is_told(tmp_path: Path) -> None:
    path = tmp_path / "two.jpg"
    path.write_bytes(jpeg(flat()) + jpeg(flat()))
    assert "the other pictures in its file are left out" in read_frame(path).described()


def test_a_progressive_jpeg_with_a_thumbnail_is_one_picture(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (40, 40, 3), np.uint8)
    thumb = b"Exif\0\0II*\0\x08\0\0\0\0\0\0\0\0\0" + jpeg(flat(8, 8))
    path = tmp_path / "x.jpg"
    path.write_bytes(jpeg(noise, (0xE1, thumb), progressive=True))
    assert read_frame(path).header.notes == ()


def test_a_jpeg_of_12_bits_is_told_from_a_damaged_one(tmp_path: Path) -> None:
    content = bytearray(jpeg(flat()))
    content[content.index(b"\xff\xc0") + 4] = 12
    path = tmp_path / "x.jpg"
    path.write_bytes(content)
    assert "got one of 12. It is not damaged" in refusal(path)


# TIFF: a camera's.


def tiff(*directories: dict[int, tuple[int, int]], sub: dict[int, tuple[int, int]] | None) -> bytes:
    """Pictures of 8 bits R, G, B, side by 10; and one that hangs on the first."""
    made = bytearray(b"II*\0" + bytes(4))

    def add(tags: dict[int, tuple[int, int]], after: int | None) -> tuple[int, int]:
        side = tags[256][1]
        tags = {**tags, 257: (3, 10), 262: tags.get(262, (3, 2)), 277: (3, 3), 278: (3, 10)}
        tags |= {259: (3, 1), 279: (4, side * 30), 273: (4, len(made))}
        made.extend(bytes(range(120)) * 100)
        depths = len(made)
        made.extend(struct.pack("<3H", 8, 8, 8))
        if after is not None:
            tags[330] = (4, after)
        begin = len(made)
        made.extend(struct.pack("<H", len(tags) + 1))
        made.extend(struct.pack("<HHII", 258, 3, 3, depths))
        for tag in sorted(tags):
            kind, value = tags[tag]
            made.extend(struct.pack("<HHII", tag, kind, 1, value))
        made.extend(bytes(4))
        return begin, len(made) - 4

    inner = None if sub is None else add(sub, None)[0]
    link = 4
    for k, tags in enumerate(directories):
        begin, follow = add(tags, inner if k == 0 else None)
        struct.pack_into("<I", made, link, begin)
        link = follow
    return bytes(made)


RAWS = {
    "DNG": tiff({254: (4, 1), 256: (3, 20), 50706: (4, 1)}, sub={256: (3, 40), 262: (3, 32803)}),
    "NEF": tiff({254: (4, 1), 256: (3, 20)}, sub={256: (3, 40), 262: (3, 32803)}),
    "unmarked preview": tiff({256: (3, 20)}, sub={256: (3, 40)}),
    "linear": tiff({256: (3, 20), 262: (3, 34892)}, sub=None),
    "thumbnail alone": tiff({254: (4, 1), 256: (3, 20)}, sub=None),
    "filter behind": tiff({256: (3, 20)}, {256: (3, 20), 262: (3, 32803)}, sub=None),
}


@pytest.mark.parametrize("kind", RAWS)
def test_a_raw_photograph_is_not_its_preview(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "photo.dng"
    path.write_bytes(RAWS[kind])
    assert "got a camera's raw file. Develop it" in refusal(path)


@pytest.mark.parametrize(
    "start", [b"IIRO\x08\0\0\0", b"IIU\0\x18\0\0\0", b"FUJIFILMCCD-RAW ", b"\0\0\0\x18ftypcrx \0\0"]
)
def test_raw_files_that_are_no_tiffs_are_told(tmp_path: Path, start: bytes) -> None:
    path = tmp_path / "photo.raw"
    path.write_bytes(start + bytes(1000))
    assert "a camera's raw file" in refusal(path)


def test_a_smaller_copy_behind_a_picture_makes_no_raw_of_it(tmp_path: Path) -> None:
    path = tmp_path / "x.tif"
    path.write_bytes(tiff({256: (3, 40)}, sub={254: (4, 1), 256: (3, 20)}))
    assert read_frame(path).pixels.shape == (10, 40, 3)


# Alpha.


@pytest.mark.parametrize("suffix", ["png", "tif", "tga"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_an_alpha_of_0_everywhere_wipes_no_picture_out(
    tmp_path: Path, suffix: str, dtype: str
) -> None:
    if suffix == "tga":
        dtype = "uint8"
    scale = np.iinfo(dtype).max // 255
    capture = np.dstack([flat(), np.zeros((16, 16), np.uint8)]).astype(dtype) * dtype_one(scale)
    path = store(tmp_path / f"x.{suffix}", capture, "R,G,B,A")
    assert "got 0 everywhere over a picture" in refusal(path)
    capture[0, 0, 3] = 255
    assert codes(store(tmp_path / f"y.{suffix}", capture, "R,G,B,A")) == [0, 0, 0]
    capture[...] = 0
    assert codes(store(tmp_path / f"z.{suffix}", capture, "R,G,B,A")) == [0, 0, 0]


def dtype_one(scale: int) -> np.uint16 | np.uint8:
    return np.uint16(scale) if scale > 1 else np.uint8(scale)


def bmp(order: str, masks: tuple[int, ...], compression: int, size: int, alpha: int = 255) -> bytes:
    """32 bits a pixel, top down; `order` of bytes, x for one of no meaning."""
    said = {**dict(zip("rgb", ORANGE, strict=True)), "a": alpha, "x": 37}
    header = struct.pack("<IiiHHIIiiII", size, 16, -16, 1, 32, compression, 1024, 1, 1, 0, 0)
    header = (header + struct.pack("<4I", *masks)).ljust(size, b"\0")
    header = header if compression or size > 40 else header[:40]
    start = 14 + len(header)
    body = bytes(said[each] for each in order) * 256
    return b"BM" + struct.pack("<IHHI", start + len(body), 0, 0, start) + header + body


BGR = (0xFF0000, 0xFF00, 0xFF)


@pytest.mark.parametrize(
    ("content", "alpha"),
    [
        (bmp("bgrx", (*BGR, 0), 0, 40), False),
        (bmp("bgrx", (*BGR, 0), 3, 56), False),
        (bmp("bgrx", (0, 0, 0, 0), 0, 124), False),
        (bmp("bgra", (*BGR, 0xFF000000), 3, 108), True),
        (bmp("rgba", (0xFF, 0xFF00, 0xFF0000, 0xFF000000), 3, 124), True),
        (bmp("xbgr", (0xFF000000, 0xFF0000, 0xFF00, 0), 3, 56), False),
    ],
)
def test_the_fourth_byte_of_a_bmp_is_alpha_by_a_mask_alone(
    tmp_path: Path, content: bytes, alpha: bool
) -> None:
    path = tmp_path / "x.bmp"
    path.write_bytes(content)
    assert codes(path) == [*ORANGE]
    assert ("A" in read_frame(path).header.channels) == alpha
    assert [*Image.open(path).convert("RGB").getpixel((8, 8))] == [*ORANGE]
    path.write_bytes(content[:-20])
    assert "wanted a complete BMP" in refusal(path)


def test_the_alpha_of_a_bmp_is_straight(tmp_path: Path) -> None:
    path = tmp_path / "x.bmp"
    path.write_bytes(bmp("bgra", (*BGR, 0xFF000000), 3, 108, alpha=128))
    half = np.dstack([flat(), np.full((16, 16), 128, np.uint8)])
    same = read_frame(store(tmp_path / "x.png", half, "R,G,B,A"))
    np.testing.assert_array_equal(read_frame(path).pixels, same.pixels)
    assert same.pixels.max() < 0.5


# JPEG XL.


def jxl_header(*, animated: bool = False, alpha: bool | None = None) -> bytes:
    """As far as the header goes: 16 x 16, 8 bits."""
    bits = [(1, 1), (1, 5), (1, 3)]  # small, (1 + 1) 8 rows, square
    bits += [(0, 1), (1, 1) if animated else (0, 1)]
    bits += [(0, 3), (0, 1), (0, 1), (1, 1)] if animated else []
    bits += [(0, 1), (0, 2), (1, 1)]  # of 8 bits, modular
    if alpha is None:
        bits += [(0, 2)]
    else:  # one more channel: alpha of 8 bits, no shift, no name
        bits += [(1, 2), (0, 1), (0, 2), (0, 1), (0, 2), (0, 2), (0, 2), (int(alpha), 1)]
    value = place = 0
    for number, count in bits:
        value |= number << place
        place += count
    return b"\xff\x0a" + value.to_bytes(-(-place // 8) + 64, "little")


def in_boxes(codestream: bytes) -> bytes:
    def box(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body) + 8) + kind + body

    return (
        box(b"JXL ", b"\r\n\x87\n")
        + box(b"ftyp", b"jxl \0\0\0\0jxl ")
        + box(b"Exif", bytes(30))
        + box(b"jxlp", bytes(4) + codestream[:9])
        + box(b"jxlp", b"\x80\0\0\1" + codestream[9:])
    )


def test_jpeg_xl_is_straight_unless_it_says_otherwise(tmp_path: Path) -> None:
    from domesim.frames.formats import FORMATS  # noqa: PLC0415

    for alpha in (False, True):
        path = tmp_path / "x.jxl"
        path.write_bytes(jxl_header(alpha=alpha))
        with path.open("rb") as file:
            assert FORMATS["jpegxl"].examined(path, file).unassociated == (not alpha)
    half = np.random.default_rng(2).integers(0, 256, (16, 16, 4), np.uint8)
    kept = {suffix: store(tmp_path / f"y.{suffix}", half, "R,G,B,A") for suffix in ("jxl", "png")}
    np.testing.assert_allclose(*(read_frame(path).pixels for path in kept.values()), atol=0.02)


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_animated_jpeg_xl_is_refused(tmp_path: Path, wrapped: bool) -> None:
    path = tmp_path / "x.jxl"
    header = jxl_header(animated=True)
    path.write_bytes(in_boxes(header) if wrapped else header)
    assert "got an animation" in refusal(path)


def test_other_animations_are_refused(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (3, 16, 16, 3), np.uint8)
    frames = [Image.fromarray(each) for each in noise]
    for name in ("x.png", "x.webp"):
        frames[0].save(tmp_path / name, save_all=True, append_images=frames[1:])
        assert "got a" in refusal(tmp_path / name)
    each = b"P6\n16 16\n255\n" + flat().tobytes()
    (tmp_path / "x.ppm").write_bytes(each)
    assert codes(tmp_path / "x.ppm") == [*ORANGE]
    (tmp_path / "x.ppm").write_bytes(each * 3)
    assert "got a file of several parts" in refusal(tmp_path / "x.ppm")


# DPX.


@pytest.mark.parametrize("descriptor", [7, 100, 101, 102, 103])
def test_a_dpx_of_luma_and_chroma_is_refused(tmp_path: Path, descriptor: int) -> None:
    path = write_dpx(tmp_path / "x.dpx", flat(), 8, ">")
    content = bytearray(path.read_bytes())
    content[800] = descriptor
    path.write_bytes(content)
    assert f"got Y'CbCr (descriptor {descriptor})" in refusal(path)


# What XMP says of the projection.


def gpano(projection: str, *, element: bool) -> bytes:
    said = (
        f"<GPano:ProjectionType>{projection}</GPano:ProjectionType>"
        if element
        else f'<rdf:Description GPano:ProjectionType="{projection}"/>'
    )
    return f"<x:xmpmeta xmlns:x='adobe:ns:meta/'>{said}</x:xmpmeta>".encode()


@pytest.mark.parametrize("element", [True, False])
def test_a_png_may_say_it_in_compressed_text(tmp_path: Path, element: bool) -> None:
    """As iTXt, and as ImageMagick writes XMP; damage is damage."""
    xmp = gpano("equirectangular", element=element)
    digits = b"\nxmp\n%8d\n" % len(xmp) + xmp.hex().encode()
    path = store(tmp_path / "x.png", flat())
    content = path.read_bytes()
    place = content.index(b"IDAT") - 4
    for kind, start, text in (
        (b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0", xmp),
        (b"zTXt", b"Raw profile type xmp\0\0", digits),
    ):
        told = kind + start + zlib.compress(text)
        chunk = struct.pack(">I", len(told) - 4) + told + struct.pack(">I", zlib.crc32(told))
        path.write_bytes(content[:place] + chunk + content[place:])
        with pytest.raises(InputError, match="says it is equirectangular"):
            read_frame(path)
        path.write_bytes(content[:place] + chunk.replace(told[-9:], bytes(9)) + content[place:])
        with pytest.raises(InputError, match="wrong checksum"):
            read_frame(path)


@pytest.mark.parametrize("element", [True, False])
def test_a_picture_that_says_it_is_a_panorama_is_refused(tmp_path: Path, element: bool) -> None:
    for projection in ("equirectangular", "cylindrical", "fisheye"):
        xmp = gpano(projection, element=element)
        photo = tmp_path / "x.jpg"
        photo.write_bytes(jpeg(flat(), (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + xmp)))
        text = b"XML:com.adobe.xmp\0\0\0\0\0" + xmp
        chunk = struct.pack(">I", len(text)) + b"iTXt" + text
        chunk += struct.pack(">I", zlib.crc32(b"iTXt" + text))
        store(tmp_path / "x.png", flat())
        render = (tmp_path / "x.png").read_bytes()
        (tmp_path / "x.png").write_bytes(render[:33] + chunk + render[33:])
        Image.fromarray(flat()).save(tmp_path / "x.webp", xmp=xmp, lossless=True)
        Image.fromarray(flat()).save(tmp_path / "x.tif", tiffinfo={700: xmp})
        for name in ("x.jpg", "x.png", "x.webp", "x.tif"):
            if projection == "fisheye":
                assert codes(tmp_path / name) == [*ORANGE]
            else:
                assert f"one that says it is {projection}" in refusal(tmp_path / name)


# Primaries.

ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.329)
RADIANCE = (0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.3333, 0.3333)
PROPHOTO = (0.7347, 0.2653, 0.1596, 0.8404, 0.0366, 0.0001, 0.3457, 0.3585)


def to_bt709(xy: tuple[float, ...]) -> np.ndarray:
    """By colour-science, white adapted by Bradford's matrix."""
    import colour  # noqa: PLC0415

    def space(name: str, xy: tuple[float, ...]) -> colour.RGB_Colourspace:
        return colour.RGB_Colourspace(name, np.reshape(xy[:6], (3, 2)), xy[6:])

    bt709 = space("wanted", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329))
    return np.asarray(colour.matrix_RGB_to_RGB(space("got", xy), bt709, "Bradford"))


@pytest.mark.parametrize("xy", [ADOBE, RADIANCE, PROPHOTO])
def test_any_primaries_that_a_file_states_are_used(tmp_path: Path, xy: tuple[float, ...]) -> None:
    light = np.full((16, 16, 3), (0.5, 0.25, 0.125), np.float32)
    frame = read_frame(store(tmp_path / "x.exr", light, chromaticities=("float[8]", xy)))
    assert not frame.colour.assumed
    shown = Projector("BT.709", 100.0).decode(
        frame.pixels[None], transfer.named("linear", white=100.0), frame.colour.primaries
    )
    np.testing.assert_allclose(shown[0, 8, 8], to_bt709(xy) @ light[0, 0], atol=2e-5)
    write_frame(frame, tmp_path / "y.exr")
    again = read_frame(tmp_path / "y.exr")
    assert again.colour.means_the_same_as(frame.colour)


def test_a_profile_of_any_primaries_is_used(tmp_path: Path) -> None:
    profile = icc_profile("Adobe RGB (1998)", "Adobe", gamma(2.2))
    said = {"ICCProfile": (f"uint8[{profile.size}]", profile)}
    assert read_frame(store(tmp_path / "x.tif", flat(), **said)).colour.primaries == "Adobe RGB"


@pytest.mark.parametrize(("space", "index"), [(65535, "R03"), (2, None), (2, "R98")])
def test_exif_says_adobe_rgb(tmp_path: Path, space: int, index: str | None) -> None:
    exif = Image.Exif()
    inner = exif.get_ifd(ExifTags.IFD.Exif)
    inner[ExifTags.Base.ColorSpace] = space
    if index is not None:
        inner[ExifTags.IFD.Interop] = {1: index}
    for name in ("x.jpg", "x.webp", "x.png"):
        Image.fromarray(flat()).save(tmp_path / name, exif=exif.tobytes())
        colour = read_frame(tmp_path / name).colour
        assert (colour.transfer, colour.primaries) == ("gamma2.2", "Adobe RGB"), name


def rationals(values: tuple[float, ...]) -> tuple[int, ...]:
    return tuple(part for value in values for part in (round(value * 10_000), 10_000))


@pytest.mark.parametrize("xy", [ADOBE, PROPHOTO, RADIANCE])
def test_a_tiff_states_its_primaries_by_tags(tmp_path: Path, xy: tuple[float, ...]) -> None:
    """TIFF 6.0, section 20: WhitePoint and PrimaryChromaticities."""
    said = [(318, 5, 2, rationals(xy[6:]), True), (319, 5, 6, rationals(xy[:6]), True)]
    for dtype, curve in ((np.uint8, "srgb"), (np.float32, "linear")):
        samples = flat().astype(dtype) / (255 if dtype == np.float32 else 1)
        path = tmp_path / "x.tif"
        tifffile.imwrite(path, samples.astype(dtype), photometric="rgb", extratags=said)
        colour = read_frame(path).colour
        assert colour.transfer == curve
        found = chromaticities_of(colour.primaries)
        assert found is not None
        np.testing.assert_allclose(found, xy, atol=2e-4)
        assert colour.source.startswith("file: PrimaryChromaticities; curve assumed")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("exponent", "curve"), [(1.0, "linear"), (2.2, "gamma2.2"), (1.5, None)])
def test_a_tiff_states_its_curve_by_a_tag(
    tmp_path: Path, dtype: type[np.unsignedinteger], exponent: float, curve: str | None
) -> None:
    """TIFF 6.0, section 20: TransferFunction."""
    count = np.iinfo(dtype).max + 1
    table = np.rint((np.arange(count) / (count - 1)) ** exponent * 65535).astype(int)
    said = [(301, 3, count, tuple(table.tolist()), True)]
    path = tmp_path / "x.tif"
    tifffile.imwrite(path, flat().astype(dtype), photometric="rgb", extratags=said)
    if curve is None:
        with pytest.raises(InputError, match="got another TransferFunction"):
            read_frame(path)
        assert read_frame(path, colour=encoding_named("srgb")).header.colour is None
        return
    colour = read_frame(path).colour
    assert (colour.transfer, colour.source) == (curve, "file: TransferFunction")


@pytest.mark.parametrize(
    ("identifier", "primaries"),
    [
        ("lin_rec2020_scene", "BT.2020"),
        ("lin_adobergb_scene", "Adobe RGB"),
        ("lin_ap1_scene", "ACES AP1"),
        ("unknown", "BT.709"),
    ],
)
def test_an_identifier_goes_before_chromaticities(
    tmp_path: Path, identifier: str, primaries: str
) -> None:
    bt709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    light = flat().astype(np.float16)
    path = store(
        tmp_path / "x.exr", light, colorInteropID=identifier, chromaticities=("float[8]", bt709)
    )
    colour = read_frame(path).colour
    assert (colour.transfer, colour.primaries) == ("linear", primaries)
    assert ("its chromaticities say BT.709" in colour.source) == (primaries != "BT.709")


def test_numbers_that_are_no_picture_are_refused(tmp_path: Path) -> None:
    path = store(tmp_path / "x.exr", flat().astype(np.float16), colorInteropID="data")
    assert "colorInteropID 'data'" in refusal(path)


# EXR: channels of several sizes.


@pytest.mark.parametrize(
    ("channels", "got"),
    [(("Y", "RY", "BY"), "luminance and chroma"), (("R", "G", "B", "Zs"), "got Zs")],
)
def test_an_exr_of_subsampled_channels_is_not_called_damaged(
    tmp_path: Path, channels: tuple[str, ...], got: str
) -> None:
    import OpenEXR  # noqa: PLC0415

    small = ("RY", "BY", "Zs")
    planes = {
        name: OpenEXR.Channel(
            np.zeros((16, 16), np.float16), *((2, 2) if name in small else (1, 1))
        )
        for name in channels
    }
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    path = tmp_path / "x.exr"
    OpenEXR.File(header, planes).write(str(path))
    assert got in refusal(path)
    assert "not damaged" in refusal(path)


# EXR: layers, and light in X, Y, Z.

LIGHT = (np.random.default_rng(7).random((16, 16, 3)) / 2).astype(np.float16)


@pytest.mark.parametrize(
    ("before", "channels"),
    [
        ("beauty", "beauty.R,beauty.G,beauty.B,beauty.A"),
        ("ViewLayer.Combined", "ViewLayer.Combined.{},ViewLayer.DiffCol.{},Depth.Z"),
        ("RenderLayer.Combined", "RenderLayer.Combined.{},RenderLayer.Mist.Z"),
    ],
)
def test_the_only_layer_that_can_be_meant_is_taken(
    tmp_path: Path, before: str, channels: str
) -> None:
    names: list[str] = []
    for each in channels.split(","):
        names += [each.format(end) for end in "RGB"] if "{}" in each else [each]
    planes = np.random.default_rng(8).random((16, 16, len(names))).astype(np.float16)
    planes[..., [names.index(f"{before}.{end}") for end in "RGB"]] = LIGHT
    path = store(tmp_path / "x.exr", planes, ",".join(names))
    read = read_frame(path)
    assert f"layer {before}" in read.described()
    np.testing.assert_array_equal(read.pixels, LIGHT.astype(np.float32))
    write_frame(read, tmp_path / "z.png")
    flat = read_frame(tmp_path / "z.png")
    assert flat.header.channels == (*"RGB", "A") if before == "beauty" else (*"RGB",)
    np.testing.assert_allclose(flat.pixels, read.pixels, atol=1e-4)


def test_light_in_x_y_z_is_read_as_such(tmp_path: Path) -> None:
    """Of pure XYZ, Y is luminance; D65 of 0.5 is white of half the light."""
    white = np.array([0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290]) / 2
    path = store(tmp_path / "x.exr", np.tile(white, (8, 8, 1)).astype(np.float32), "X,Y,Z")
    read = read_frame(path)
    assert read.colour.primaries == "XYZ"
    shown = Projector("BT.709", 100.0).decode(
        read.pixels[None], transfer.named("linear", white=100.0), "XYZ"
    )
    np.testing.assert_allclose(shown, 0.5, atol=1e-4)
    write_frame(read, tmp_path / "y.exr")
    again = read_frame(tmp_path / "y.exr")
    assert set(again.header.channels) == {*"XYZ"}
    np.testing.assert_array_equal(again.pixels, read.pixels)
