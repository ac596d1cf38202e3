"""Formats through the command line: nothing is lost where nothing is computed, and what is said."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run
from image_files import store
from plain_files import DPX_SAMPLE, read_dpx, read_tiff, write_dpx, write_tiff

from domesim.frames import read_frame

DOME, PAIR = "dome_hemisphere", "stereo_polarised_paper"
SIDE = 40
CHROMATICITIES = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)


def picture(kind: str, channels: int = 3, seed: int = 0) -> np.ndarray:
    """(row, col, channel), its least and largest code among them."""
    rng = np.random.default_rng(seed)
    if np.issubdtype(kind, np.integer):
        top = np.iinfo(kind).max
        samples = rng.integers(0, top, (SIDE, SIDE, channels), kind, endpoint=True)
        samples[0, 0], samples[SIDE // 2, SIDE // 2] = 0, top
        return samples
    samples = rng.random((SIDE, SIDE, channels)).astype(kind)
    samples[SIDE // 2, :3] = [[np.finfo(kind).smallest_subnormal], [np.finfo(kind).tiny], [3.5]]
    return samples


def contents(path: Path) -> tuple[list[object], dict[str, str]]:
    """Channels with their samples as stored, and attributes."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(str(path), config)
    spec = reader.spec()
    window = (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    planes: list[object] = [window, spec.alpha_channel]
    for k, name in enumerate(spec.channelnames):
        plane = reader.read_image(0, 0, k, k + 1, "unknown")
        planes.append((name, str(plane.dtype), plane.tobytes()))
    return planes, {each.name: str(each.value) for each in spec.extra_attribs}


# Suffix, type, channels, depth, attributes.
COMMON = {"Artist": "me", "ImageDescription": "a dome", "DateTime": "2020:01:02 03:04:05"}
LOSSLESS = {
    "half EXR": ("exr", "float16", "", {}),
    "float EXR": ("exr", "float32", "", {"chromaticities": ("float[8]", CHROMATICITIES)}),
    "EXR of many channels": ("exr", "float16", "B,G,R,A,Z,diffuse.R", {"compression": "zips"}),
    "EXR with time code": ("exr", "float16", "", {"smpte:TimeCode": ("timecode", (0x01020304, 5))}),
    "PNG 8": ("png", "uint8", "", {}),
    "PNG 16": ("png", "uint16", "", {"studio:shot": "sh010", "XResolution": 72.0}),
    "PNG 16 with alpha": ("png", "uint16", "R,G,B,A", {}),
    "TIFF 8": ("tif", "uint8", "", {"compression": "lzw", "ExposureTime": 0.25}),
    "TIFF 10": ("tif", "uint16", "", {"oiio:BitsPerSample": 10}),
    "TIFF 12": ("tif", "uint16", "", {"oiio:BitsPerSample": 12}),
    "TIFF 16": ("tif", "uint16", "", {"Copyright": "us"}),
    "TIFF 16 with alpha": ("tif", "uint16", "R,G,B,A", {}),
    "TIFF half": ("tif", "float16", "", {"tiff:half": 1}),
    "TIFF float": ("tif", "float32", "", {"compression": "none"}),
    "DPX 8": ("dpx", "uint8", "", {}),
    "DPX 10": ("dpx", "uint16", "", {"oiio:BitsPerSample": 10, "dpx:Transfer": "SMPTE 274M"}),
    "DPX 12": ("dpx", "uint16", "", {"oiio:BitsPerSample": 12}),
    "DPX 16": ("dpx", "uint16", "", {"smpte:TimeCode": ("timecode", (0x01020304, 0))}),
    "JPEG 2000 8": ("jp2", "uint8", "", {}),
    "JPEG 2000 10": ("j2k", "uint16", "", {"oiio:BitsPerSample": 10}),
    "JPEG 2000 12": ("j2k", "uint16", "", {"oiio:BitsPerSample": 12}),
    "JPEG 2000 12 in boxes": ("jp2", "uint16", "", {"oiio:BitsPerSample": 12}),
    "JPEG 2000 16 with alpha": ("jp2", "uint16", "R,G,B,A", {}),
}
# What OpenImageIO says of how a file is laid out, and the compression that is not kept
STORAGE = ("oiio:ColorSpace", "tiff:RowsPerStrip", "compression")


def none(run: Run, out: Path, *arguments: object) -> dict[str, object]:
    """`compensate --method none`: its figures for the one frame."""
    told = run("compensate", *arguments, "--method", "none", "--out", out, "--json").figures()
    (frame,) = told["frames"]
    return frame


@pytest.mark.parametrize("case", LOSSLESS)
def test_a_lossless_file_comes_out_as_it_was(
    run: Run, tmp_path: Path, out: Path, case: str
) -> None:
    suffix, kind, channels, attributes = LOSSLESS[case]
    samples = picture(kind, channels.count(",") + 1 if channels else 3)
    named = {name.replace(":", "__"): value for name, value in attributes.items()}
    source = store(tmp_path / f"in.{suffix}", samples, channels, **COMMON, **named)
    none(run, out, source, "--scene", DOME)
    before, after = contents(source), contents(out / source.name)
    assert before[0] == after[0]
    kept = {name: value for name, value in before[1].items() if name not in STORAGE}
    assert {name: value for name, value in after[1].items() if name not in STORAGE} == kept
    if suffix not in ("jp2", "j2k"):
        assert kept.items() >= {("Artist", "me")} or suffix == "dpx"
    # And again: what we wrote comes out byte by byte.
    none(run, out / "again", out / source.name, "--scene", DOME)
    assert (out / "again" / source.name).read_bytes() == (out / source.name).read_bytes()


@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_a_multi_view_exr_comes_out_as_it_was(
    run: Run, tmp_path: Path, out: Path, kind: str
) -> None:
    channels = "R,G,B,right.R,right.G,right.B"
    views = ("string[2]", ("left", "right"))
    source = store(tmp_path / "in.exr", picture(kind, 6), channels, multiView=views, **COMMON)
    none(run, out, source, "--scene", PAIR)
    assert contents(out / "in.exr") == contents(source)


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_dpx_by_the_letter_of_its_standard(
    run: Run, tmp_path: Path, out: Path, bits: int, order: str
) -> None:
    """Written and read without a library: Rationale: one library's errors cancel out."""
    codes = np.random.default_rng(bits).integers(0, 2**bits, (SIDE, SIDE, 3))
    codes[0, :2] = [[0], [2**bits - 1]]
    source = write_dpx(tmp_path / "in.dpx", codes, bits, order, transfer=6)
    before = read_dpx(source)
    np.testing.assert_array_equal(before.codes, codes)
    figures = none(run, out, source, "--scene", DOME)
    assert figures["read"] == f"40 x 40 DPX, {bits} bit, BT.1886 (file: transfer 'ITU-R 709-4')"
    after = read_dpx(out / "in.dpx")
    np.testing.assert_array_equal(after.codes, codes)
    assert after.fields == before.fields
    assert {name: after.fields[name] for name in DPX_SAMPLE} == DPX_SAMPLE
    assert (out / "in.dpx").read_bytes()[:4] == source.read_bytes()[:4]
    # A share of a code is what a picture of all codes may miss of OpenImageIO's own reading.
    np.testing.assert_array_equal(np.rint(read_frame(source).pixels * (2**bits - 1)), codes)


@pytest.mark.parametrize("order", [">", "<"])
def test_xyz_by_the_letter_of_its_standard(run: Run, tmp_path: Path, out: Path, order: str) -> None:
    """A DCDM: 12 bits of X'Y'Z' above four zeros, in a TIFF of 16 that says nothing of it."""
    codes = np.random.default_rng(1).integers(0, 4096, (SIDE, SIDE, 3))
    source = write_tiff(tmp_path / "in.tif", codes << 4, order)
    np.testing.assert_array_equal(read_tiff(source)[0], codes << 4)
    figures = none(run, out, source, "--scene", DOME, "--encoding", "dcdm")
    assert figures["read"] == "40 x 40 TIFF, 12 bit, DCDM XYZ (--encoding dcdm)"
    assert figures["unsaid"] == "DCDM XYZ, which the file cannot say: it reads as sRGB"
    samples, artist = read_tiff(out / "in.tif")
    np.testing.assert_array_equal(samples, codes << 4)
    assert artist == b"the artist"


def test_xyz_is_compensated_as_the_light_that_it_is(run: Run, tmp_path: Path, out: Path) -> None:
    """One picture as linear EXR and as X'Y'Z' gives the same light to project."""
    from domesim.light.transfer import DCDM  # noqa: PLC0415
    from domesim.observation.projector import conversion  # noqa: PLC0415

    row, col = np.mgrid[:SIDE, :SIDE] / SIDE
    light = np.stack([0.6 * row, 0.5 * col, 0.3 + 0.2 * row * col], -1) ** 2
    linear = store(tmp_path / "a.exr", light.astype(np.float32))
    codes = DCDM().encode(light @ conversion("BT.709", "XYZ").T)
    xyz = write_tiff(tmp_path / "b.tif", np.rint(codes * 4095).astype(int) << 4, "<")
    common = ("--scene", DOME, "--method", "subtractive", "--dither", "none", "--out", out)
    assert run("compensate", linear, *common).code == 0
    assert run("compensate", xyz, *common, "--encoding", "dcdm").code == 0
    stored = read_tiff(out / "b.tif")[0]
    assert not (stored & 15).any()
    result = DCDM().decode((stored >> 4) / 4095) @ np.linalg.inv(conversion("BT.709", "XYZ")).T
    wanted = read_frame(out / "a.exr").pixels
    # In the dark a code of 12 bits is little light, near white a thousandth.
    np.testing.assert_allclose(result, wanted, atol=2e-3)


# What is said.


def test_what_was_read_is_said_once_and_where_it_changes(
    run: Run, tmp_path: Path, out: Path
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for number in (1, 2, 3):
        kind = "float16" if number < 3 else "float32"
        store(folder / f"show.{number}.exr", picture(kind))
    arguments = (folder / "show.#.exr", "--scene", DOME, "--method", "none", "--out", out)
    arguments += ("--workers", "0")
    told = [line for line in run("compensate", *arguments).out.splitlines() if " x " in line]
    assert told == [
        "show.1.exr: 40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "show.3.exr: 40 x 40 EXR, 32 bit float, linear (assumed for EXR)",
    ]
    figures = json.loads(run("compensate", *arguments, "--json").out)["frames"]
    assert [frame["read"] for frame in figures] == [
        "40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "40 x 40 EXR, 32 bit float, linear (assumed for EXR)",
    ]
    expected = {"transfer": "linear", "primaries": "BT.709", "source": "assumed for EXR"}
    assert all(frame["encoding"] == expected for frame in figures)


@pytest.mark.parametrize("command", ["compensate", "compare", "predict", "observe"])
def test_each_command_takes_an_encoding_and_says_it(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    source = store(tmp_path / "in.png", picture("uint16"))
    target = out / "page.html" if command == "compare" else out
    arguments = (command, source, "--scene", DOME, "--out", target)
    said = "in.png: 40 x 40 PNG, 16 bit, gamma 2.6 P3-D65 (--encoding p3-d65)"
    assert said in run(*arguments, "--encoding", "P3-D65").out.splitlines()
    figures = json.loads(run(*arguments, "--encoding", "p3-d65", "--json").out)
    frame = figures if command == "compare" else figures["frames"][0]
    assert f"in.png: {frame['read']}" == said
    expected = {"transfer": "gamma2.6", "primaries": "P3-D65", "source": "--encoding p3-d65"}
    assert frame["encoding"] == expected


def test_a_named_encoding_is_written_and_another_light_computed(
    run: Run, tmp_path: Path, out: Path
) -> None:
    source = store(tmp_path / "in.png", picture("uint16") // 2)
    for name in ("srgb", "st2084:p3-d65"):
        arguments = ("--scene", DOME, "--method", "subtractive", "--encoding", name)
        assert run("compensate", source, *arguments, "--out", out / name[:4]).code == 0
    first, second = (read_frame(out / name / "in.png") for name in ("srgb", "st20"))
    assert asdict(first.colour) == {**asdict(first.colour), "source": "file: sRGB"}
    assert (second.colour.transfer, second.colour.primaries) == ("st2084", "P3-D65")
    assert np.abs(first.pixels - second.pixels).max() > 0.01


# What was computed.


def test_colours_outside_a_files_gamut_are_clipped_and_counted(
    run: Run, tmp_path: Path, out: Path
) -> None:
    """What float EXRs could hold as negative light, our own reader would refuse as damage."""
    samples = np.zeros((SIDE, 2 * SIDE, 3), np.float32)
    samples[:, :, 0] = 0.02
    samples[8:20, 10:50, 2] = 0.9
    eyes = [store(tmp_path / f"{eye}.exr", samples[:: 1 - 2 * k]) for k, eye in enumerate("lr")]
    pair = ("--left", eyes[0], "--right", eyes[1], "--scene", "stereo_spectral", "--out", out)
    outcome = run("compensate", *pair, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    (frame,) = json.loads(outcome.out)["frames"]
    assert frame["file_clipped"] > 0.05
    for eye in "lr":
        assert read_frame(out / f"{eye}.exr").pixels.min() == 0


def gradient(path: Path) -> Path:
    """Float EXR of a few codes of 8 bits over its width; light that subtraction reaches."""
    row, col = np.mgrid[:256, :256] / 256
    return store(path, np.stack([0.4 + 0.02 * col + 0.001 * row] * 3, -1).astype(np.float32))


def error_of_bands(result: Path, wanted: Path) -> float:
    """Largest mean error over 16 x 16 px within the dome, in codes."""
    codes = read_frame(result).pixels[..., 1].astype(float) * 255
    exact = read_frame(wanted).pixels[..., 1].astype(float) * 255
    error = (codes - exact)[64:192, 64:192].reshape(8, 16, 8, 16).mean(axis=(1, 3))
    return float(np.abs(error).max())


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_what_was_computed_has_no_bands(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    source = gradient(tmp_path / "show.0042.exr")
    common = (command, source, "--scene", DOME)
    common += ("--method", "subtractive")[: 2 if command == "compensate" else 0]
    to_png = ("--format", "png", "--bits", "8")
    assert run(*common, "--out", out / "float").code == 0
    for name, how in (
        ("tpdf", ()),
        ("again", ("--dither", "tpdf")),
        ("none", ("--dither", "none")),
    ):
        assert run(*common, *to_png, *how, "--out", out / name).code == 0
    exact = out / "float" / "show.0042.exr"
    errors = {
        name: error_of_bands(out / name / "show.0042.png", exact) for name in ("tpdf", "none")
    }
    assert errors["none"] > 0.3
    assert errors["tpdf"] < 5 * 0.5 / 16
    same = [(out / name / "show.0042.png").read_bytes() for name in ("tpdf", "again")]
    assert same[0] == same[1]
    # Off the screen nothing was computed.
    for name in ("tpdf", "none"):
        corner = read_frame(out / name / "show.0042.png").pixels[:20, :20, 1] * 255
        wanted = read_frame(source).pixels[:20, :20, 1] * 255
        assert np.abs(corner - wanted).max() <= (0.51 if name == "none" else 1.51)


def test_pixels_off_the_screen_stay_as_they_were(run: Run, tmp_path: Path, out: Path) -> None:
    source = store(tmp_path / "in.png", picture("uint8"))
    arguments = ("--scene", DOME, "--method", "subtractive", "--out", out)
    assert run("compensate", source, *arguments).code == 0
    row, col = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    beyond = np.hypot(row, col) > SIDE / 2 + 1
    before, after = (read_frame(path).pixels for path in (source, out / "in.png"))
    np.testing.assert_array_equal(after[beyond], before[beyond])
    assert (after[~beyond] != before[~beyond]).any()
