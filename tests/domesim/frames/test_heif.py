"""HEIC and AVIF: all their bits, colours by ICC profile or code points, upright."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from icc_profiles import icc_profile
from PIL import Image
from videos import Kind, write_video

from domesim.errors import InputError
from domesim.frames import Frame, read_frame

SIDE = 64
COLOURS = np.array([[[0.2, 0.5, 0.7], [1, 1, 1]], [[0.6, 0.1, 0.3], [0, 0, 0]]])
LUMA = {1: (0.2126, 0.0722), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}


def picture() -> np.ndarray:
    """(row, col, 3) of four fields, 0..1."""
    return np.repeat(np.repeat(COLOURS, SIDE // 2, 0), SIDE // 2, 1)


def middles(frame: Frame) -> np.ndarray:
    """(2, 2, 3) the fields' colours."""
    quarter = SIDE // 4
    return np.asarray(frame.pixels[quarter :: SIDE // 2, quarter :: SIDE // 2])


def avif(path: Path, bits: int, primaries: int, transfer: int, matrix: int, *, full: bool) -> Path:
    """By FFmpeg, of Y'CbCr by hand (ITU-T H.273, 8.3)."""
    red, blue = LUMA[matrix if matrix in LUMA else 6]
    rgb = picture()
    luma = rgb @ [red, 1 - red - blue, blue]
    differences = [
        (rgb[..., 2] - luma) / (2 * (1 - blue)),
        (rgb[..., 0] - luma) / (2 * (1 - red)),
    ]
    scale, most = 2 ** (bits - 8), 2**bits - 1
    planes = [luma * most if full else (16 + 219 * luma) * scale]
    planes += [
        128 * scale + (most if full else 224 * scale) * each[::2, ::2] for each in differences
    ]
    pixels = "yuv420p" if bits == 8 else f"yuv420p{bits}le"
    options = {"crf": "1", "svtav1-params": "lp=1"}
    kind = Kind(".avif", "libsvtav1", pixels, options, primaries, transfer, matrix, full)
    return write_video(path, kind, [[np.clip(np.rint(plane), 0, most) for plane in planes]])


@pytest.mark.parametrize(
    ("bits", "points", "full", "expected"),
    [
        (8, (1, 13, 6), True, ("srgb", "BT.709")),
        (8, (1, 13, 1), False, ("srgb", "BT.709")),
        (10, (9, 16, 9), True, ("st2084", "BT.2020")),
        (10, (9, 18, 9), False, ("hlg1000", "BT.2020")),
        (10, (12, 13, 6), True, ("srgb", "P3-D65")),
    ],
)
def test_an_avif_is_read_by_its_code_points(
    tmp_path: Path, bits: int, points: tuple[int, int, int], full: bool, expected: tuple[str, str]
) -> None:
    frame = read_frame(avif(tmp_path / "x.avif", bits, *points, full=full))
    assert (frame.colour.transfer, frame.colour.primaries) == expected
    assert not frame.colour.assumed
    np.testing.assert_allclose(middles(frame), COLOURS, atol=3 / 255 if bits == 8 else 2 / 255)


def test_an_avif_that_says_nothing_is_srgb_of_bt601(tmp_path: Path) -> None:
    """MIAF, ISO/IEC 23000-22."""
    frame = read_frame(avif(tmp_path / "x.avif", 8, 2, 2, 2, full=True))
    assert frame.colour.source == "assumed for HEIF"
    assert (frame.colour.transfer, frame.colour.primaries) == ("srgb", "BT.709")
    np.testing.assert_allclose(middles(frame), COLOURS, atol=3 / 255)


def save_by_pillow(path: Path, **options: Any) -> Path:
    codes = np.rint(picture() * 255).astype(np.uint8)
    Image.fromarray(codes).save(path, quality=100, subsampling="4:4:4", **options)
    return path


def test_a_profile_goes_before_code_points(tmp_path: Path) -> None:
    profile = icc_profile("Display P3", "P3-D65").tobytes()
    frame = read_frame(save_by_pillow(tmp_path / "x.avif", icc_profile=profile))
    assert (frame.colour.transfer, frame.colour.primaries) == ("srgb", "P3-D65")
    np.testing.assert_allclose(middles(frame), COLOURS, atol=2 / 255)


@pytest.mark.parametrize("orientation", [3, 6, 2])
def test_an_avif_is_turned_upright(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x112] = orientation
    frame = read_frame(save_by_pillow(tmp_path / "x.avif", exif=exif))
    turned = {3: COLOURS[::-1, ::-1], 6: np.rot90(COLOURS, -1), 2: COLOURS[:, ::-1]}
    np.testing.assert_allclose(middles(frame), turned[orientation], atol=2 / 255)


def test_alpha_movement_and_damage_are_told(tmp_path: Path) -> None:
    codes = np.rint(np.dstack([picture(), np.full((SIDE, SIDE), 0.5)]) * 255).astype(np.uint8)
    Image.fromarray(codes, "RGBA").save(tmp_path / "alpha.avif")
    with pytest.raises(InputError, match="wanted an AVIF without alpha"):
        read_frame(tmp_path / "alpha.avif")
    whole = Image.fromarray(codes[..., :3])
    whole.save(tmp_path / "moves.avif", save_all=True, append_images=[whole.rotate(90)])
    with pytest.raises(InputError, match="got an animation"):
        read_frame(tmp_path / "moves.avif")
    content = save_by_pillow(tmp_path / "x.avif").read_bytes()
    for end in (40, len(content) // 2, len(content) - 20):
        (tmp_path / "cut.avif").write_bytes(content[:end])
        with pytest.raises(InputError, match="wanted a complete HEIF"):
            read_frame(tmp_path / "cut.avif")


def test_a_result_is_another_format(tmp_path: Path, run: Run) -> None:
    path = avif(tmp_path / "x.avif", 10, 12, 13, 6, full=True)
    out = tmp_path / "out"
    command = ("compensate", path, "--scene", "dome_hemisphere", "--method", "none", "--out", out)
    run(*command).is_refused("--format")
    assert run(*command, "--format", "png").code == 0
    result = read_frame(out / "x.png")
    np.testing.assert_allclose(result.pixels, read_frame(path).pixels, atol=1e-6)
    assert (result.colour.transfer, result.colour.primaries) == ("srgb", "P3-D65")


# HEIC.


def heic(path: Path, bits: int = 8, alpha: float | None = None, **options: Any) -> Path:
    library = pytest.importorskip("pillow_heif")
    samples = picture() if alpha is None else np.dstack([picture(), np.full((SIDE, SIDE), alpha)])
    mode = "RGB" if alpha is None else "RGBA"
    most, dtype = (255, np.uint8) if bits == 8 else (65535, np.uint16)
    data = np.rint(samples * most).astype(dtype).tobytes()
    made = library.from_bytes(mode if bits == 8 else f"{mode};16", (SIDE, SIDE), data)
    made.save(path, quality=-1, chroma=444, **options)
    return path


@pytest.mark.parametrize(
    ("bits", "points", "expected"),
    [
        (8, (1, 13, 6), ("srgb", "BT.709")),
        (8, (12, 13, 6), ("srgb", "P3-D65")),
        (10, (9, 16, 9), ("st2084", "BT.2020")),
    ],
)
def test_a_heic_is_read_by_its_code_points(
    tmp_path: Path, bits: int, points: tuple[int, int, int], expected: tuple[str, str]
) -> None:
    names = ("color_primaries", "transfer_characteristics", "matrix_coefficients")
    said = dict(zip(names, points, strict=True), full_range_flag=1)
    frame = read_frame(heic(tmp_path / "x.heic", bits, **said))
    assert (frame.colour.transfer, frame.colour.primaries) == expected
    # White of 10 bits comes as 65472 of 65535
    np.testing.assert_allclose(middles(frame), COLOURS, atol=(2 if bits == 8 else 0.6) / 255)
    assert middles(frame)[0, 1].min() == 1


def test_a_heic_has_profiles_and_straight_alpha(tmp_path: Path) -> None:
    profile = icc_profile("Display P3", "P3-D65").tobytes()
    frame = read_frame(heic(tmp_path / "x.heic", icc_profile=profile))
    assert (frame.colour.transfer, frame.colour.primaries) == ("srgb", "P3-D65")
    frame = read_frame(heic(tmp_path / "a.heic", alpha=128 / 255))
    assert "its colours taken as straight" in frame.described()
    light = 128 / 255 * np.where(COLOURS > 0.04045, ((COLOURS + 0.055) / 1.055) ** 2.4, 0)
    codes = np.where(light > 0.0031308, 1.055 * light ** (1 / 2.4) - 0.055, 12.92 * light)
    np.testing.assert_allclose(middles(frame), codes, atol=2 / 255)


def test_a_heic_of_several_or_damaged_is_told(tmp_path: Path) -> None:
    library = pytest.importorskip("pillow_heif")
    content = heic(tmp_path / "x.heic").read_bytes()
    both = library.open_heif(tmp_path / "x.heic")
    both.add_from_heif(both[0])
    both.save(tmp_path / "two.heic")
    with pytest.raises(InputError, match="wanted one image, got a file of 2"):
        read_frame(tmp_path / "two.heic")
    for end in (40, len(content) // 2, len(content) - 20):
        (tmp_path / "cut.heic").write_bytes(content[:end])
        with pytest.raises(InputError, match="wanted a complete HEIF"):
            read_frame(tmp_path / "cut.heic")


def test_the_extra_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    (tmp_path / "x.heic").write_bytes(b"\0\0\0\x18ftypheic" + bytes(200))
    with pytest.raises(InputError, match=r"pip install 'domesim\[heif\]'"):
        read_frame(tmp_path / "x.heic")
