"""Encodings that the user names: read so whatever files say, written so where they can say it."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from icc_profiles import icc_profile
from test_frames import (
    CHROMATICITIES,
    gamma,
    png_with,
    refusal,
    store,
    stored,
    texture,
)

from domesim.errors import InputError
from domesim.frames import Frame, read_frame, read_master, write_frame, write_master
from domesim.frames.encodings import ENCODINGS, encoding_named
from domesim.frames.reading import unsaid
from domesim.light.transfer import named
from domesim.observation.projector import PRIMARIES, Projector, conversion, require_primaries

KINDS = {"exr": "float32", "png": "uint16", "tif": "uint16", "dpx": "uint16", "jpg": "uint8"}


@pytest.mark.parametrize("name", ENCODINGS)
def test_each_name_can_be_decoded(name: str) -> None:
    colour = encoding_named(name.upper())
    assert colour.source == f"--encoding {name}"
    require_primaries(colour.primaries)
    assert not named(colour.transfer, white=48).decode(np.zeros(3)).any()


@pytest.mark.parametrize(
    ("name", "transfer", "primaries"),
    [
        ("st2084:p3-d65", "st2084", "P3-D65"),
        ("GAMMA2.4:bt2020", "gamma2.4", "BT.2020"),
        ("linear:xyz", "linear", "XYZ"),
        ("bt1886:p3-dci", "bt1886", "P3-DCI"),
        ("HLG", "hlg1000", "BT.2020"),
        ("hlg48", "hlg48", "BT.2020"),
    ],
)
def test_transfer_and_primaries_can_be_named_apart(
    name: str, transfer: str, primaries: str
) -> None:
    assert (encoding_named(name).transfer, encoding_named(name).primaries) == (transfer, primaries)
    assert primaries in PRIMARIES


@pytest.mark.parametrize(
    "name", ["", "rec709", "srgb:", ":bt709", "srgb:bt601", "p3-d65:bt709", "hlg:bt709"]
)
def test_a_name_that_there_is_not_lists_those_that_there_are(name: str) -> None:
    with pytest.raises(InputError) as caught:
        encoding_named(name)
    message = str(caught.value)
    assert "\n" not in message
    assert all(known in message for known in (repr(name), *ENCODINGS, "st2084:p3-d65", "ap1"))


@pytest.mark.parametrize("suffix", KINDS)
@pytest.mark.parametrize(
    "name",
    [
        *("dcdm", "st2084", "hlg", "acescg", "bt709", "srgb", "gamma2.2"),
        *("srgb:p3-d65", "gamma2.4:p3-d65", "gamma2.6:p3-d65", "gamma2.6:p3-dci"),
    ],
)
def test_what_is_written_says_so_where_it_can(tmp_path: Path, suffix: str, name: str) -> None:
    """Of a file that says otherwise, or nothing; an EXR or PNG of no file, too."""
    profile = icc_profile("Display P3", "P3-D65")
    said = {
        "exr": {"chromaticities": ("float[8]", CHROMATICITIES)},
        "png": {"ICCProfile": (f"uint8[{profile.size}]", profile)},
        "dpx": {"dpx__Transfer": "SMPTE 274M"},
    }
    path = store(tmp_path / f"in.{suffix}", texture(KINDS[suffix]), **said.get(suffix, {}))
    colour = encoding_named(name)
    read = read_frame(path, colour=colour)
    assert read.colour == colour
    np.testing.assert_array_equal(read.pixels, read_frame(path).pixels)
    write_frame(read, tmp_path / f"out.{suffix}")
    result = read_frame(tmp_path / f"out.{suffix}").colour
    if suffix in ("exr", "png"):
        write_frame(Frame(read.pixels, path, colour, 16, False), tmp_path / f"new.{suffix}")
        assert read_frame(tmp_path / f"new.{suffix}").colour.means_the_same_as(colour)
    can = suffix in ("exr", "png") or (suffix, name) == ("dpx", "bt709") or name == "srgb"
    assert result.means_the_same_as(colour) == can
    # A DPX cannot say sRGB, nor primaries beside what transfer it has.
    halves = {("dpx", "acescg"): "file: transfer 'Linear'"}
    says_nothing = result.source.startswith("assumed") or result.source == halves.get(
        (suffix, name)
    )
    assert says_nothing == (not can or (suffix, name) == ("dpx", "srgb"))
    if suffix == "dpx" and name != "bt709":  # which it said before
        colorimetric = stored(tmp_path / "out.dpx")[1]["dpx:Colorimetric"]
        assert (colorimetric == "ITU-R 709-4") == (colour.primaries == "BT.709")
    assert (unsaid(read_frame(tmp_path / f"out.{suffix}", colour=colour)) == "") == can


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_no_file_can_say_another_peak_of_hlg(tmp_path: Path, suffix: str) -> None:
    colour = encoding_named("hlg400")
    path = store(tmp_path / f"in.{suffix}", texture(KINDS[suffix]))
    write_frame(read_frame(path, colour=colour), tmp_path / f"out.{suffix}")
    told = unsaid(read_frame(tmp_path / f"out.{suffix}", colour=colour))
    assert told.startswith("HLG of a display of 400 cd/m², which the file cannot say: it reads as ")


def test_what_the_file_says_already_stays_as_it_is(tmp_path: Path) -> None:
    """No other bytes for a name that says the same."""
    path = png_with(tmp_path / "in.png", gamma(2.4))
    write_frame(read_frame(path), tmp_path / "a.png")
    write_frame(read_frame(path, colour=encoding_named("gamma2.4")), tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_what_is_not_supported_can_be_named(tmp_path: Path) -> None:
    path = png_with(tmp_path / "in.png", gamma(1.8))
    assert "--encoding" in refusal(path)
    assert read_frame(path, colour=encoding_named("gamma2.2")).header.colour is None
    density = store(tmp_path / "in.dpx", texture("uint16"), dpx__Transfer="Printing density")
    write_frame(read_frame(density, colour=encoding_named("linear")), tmp_path / "out.dpx")
    assert stored(tmp_path / "out.dpx")[1]["dpx:Transfer"] == "Linear"


def test_a_pair_of_several_encodings_is_one_if_it_is_named(tmp_path: Path) -> None:
    left = store(tmp_path / "l.exr", texture("float16"))
    right = store(
        tmp_path / "r.exr", texture("float16")[::-1], chromaticities=("float[8]", CHROMATICITIES)
    )
    with pytest.raises(InputError, match="--encoding"):
        read_master([left, right])
    master = read_master([left, right], colour=encoding_named("acescg"))
    assert {frame.colour.primaries for frame in master.frames} == {"ACES AP1"}
    paths = [tmp_path / "out-l.exr", tmp_path / "out-r.exr"]
    write_master(master, paths)
    assert read_master(paths).colour.primaries == "ACES AP1"


@pytest.mark.parametrize("parts", [1, 2])
def test_views_of_one_exr_are_read_so(tmp_path: Path, parts: int) -> None:
    from test_views import multi_part, multi_view  # noqa: PLC0415

    path = (multi_view if parts == 1 else multi_part)(tmp_path / "in.exr")
    master = read_master([path], colour=encoding_named("st2084"))
    assert {frame.colour.transfer for frame in master.frames} == {"st2084"}
    write_master(master, [tmp_path / "out.exr"])
    assert read_master([tmp_path / "out.exr"]).colour.means_the_same_as(encoding_named("st2084"))


# X'Y'Z' (SMPTE ST 428-1).


def dcdm_tiff(path: Path, codes: np.ndarray) -> Path:
    """12 bits above four zeros."""
    return store(path, (codes << 4).astype(np.uint16))


@pytest.mark.parametrize(
    ("codes", "light"),
    [
        ((3794, 3960, 3890), (1, 1, 1)),
        ((2901, 2171, 100), (1, 0, 0)),
        ((2417, 3493, 1222), (0, 1, 0)),
        ((2014, 1416, 3816), (0, 0, 1)),
    ],
    ids=["white", "red", "green", "blue"],
)
def test_the_dcdm_of_48_candelas_is_the_reference_projectors(
    tmp_path: Path, codes: tuple[int, ...], light: tuple[int, ...]
) -> None:
    """SMPTE ST 428-1: L = 52.37 (code / 4095)^2.6 cd/m²; RP 431-2, table A.1, has the codes."""
    path = dcdm_tiff(tmp_path / "x.tif", np.broadcast_to(np.array([[codes]]), (2, 2, 3)))
    read = read_frame(path, colour=encoding_named("dcdm"))
    assert read.bits == 12
    assert read.described().endswith(", 12 bit, DCDM XYZ (--encoding dcdm)")
    projector = Projector("P3-DCI", 48.0)
    found = projector.decode(read.pixels[None], named("dcdm", white=48.0), "XYZ")
    # Rounding codes moves white by 2.6 / 3794 / 2, and primaries by up to twice that
    np.testing.assert_allclose(found[0, 0, 0], light, atol=1e-3 if all(light) else 2e-3)


def test_a_dcdm_tiff_keeps_its_four_zeros(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 4096, (20, 30, 3))
    codes[0, 0] = 4095
    path = dcdm_tiff(tmp_path / "in.tif", codes)
    read = read_frame(path, colour=encoding_named("dcdm"))
    assert read.pixels.max() == 1
    np.testing.assert_array_equal(np.rint(read.pixels * 4095), codes)
    write_frame(read, tmp_path / "out.tif")
    samples, attributes, _ = stored(tmp_path / "out.tif")
    np.testing.assert_array_equal(samples, codes << 4)
    assert attributes.get("oiio:BitsPerSample", 16) == 16
    # Of 16 bits, if one sample needs them; and of nothing else.
    store(path, (codes << 4 | (codes == 4095)).astype(np.uint16))
    assert read_frame(path, colour=encoding_named("dcdm")).bits == 16
    assert read_frame(dcdm_tiff(path, codes), colour=encoding_named("srgb")).bits == 16


def test_xyz_is_colorimetric() -> None:
    """White of P3-D65 is D65 in X'Y'Z', not adapted to another."""
    x, y, z = conversion("P3-D65", "XYZ") @ np.ones(3)
    assert (x / (x + y + z), y / (x + y + z)) == pytest.approx((0.3127, 0.3290), abs=1e-4)


@pytest.mark.parametrize("name", ["ARRI Wide Gamut 3", "ProPhoto RGB", "Adobe RGB (1998)"])
def test_any_rgb_space_of_colour_science_can_be_named(name: str) -> None:
    """Its matrix is colour-science's own, white adapted by Bradford's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour  # noqa: PLC0415
    tag = encoding_named(f"linear:{name}")
    assert (tag.transfer, tag.primaries) == ("linear", name)
    light = np.array([0.5, 0.25, 0.125])
    spaces = [colour.RGB_COLOURSPACES[each].copy() for each in (name, "ITU-R BT.709")]
    for space in spaces:
        space.use_derived_transformation_matrices(True)
    expected = colour.matrix_RGB_to_RGB(*spaces, "Bradford") @ light
    found = Projector("BT.709", 100.0).decode(
        light[None, None, None], named("linear", white=100.0), tag.primaries
    )
    np.testing.assert_allclose(found[0, 0, 0], expected, atol=1e-6)
    with pytest.raises(InputError, match="is not known"):
        encoding_named("linear:Arri Wide Gamut 33")
