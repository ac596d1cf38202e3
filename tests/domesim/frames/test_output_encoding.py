"""Results in another encoding than the master's: what a lab is sent.

Expected values are worked out here from the standards alone: SMPTE RP 431-2 (P3), ST 428-1
(X'Y'Z': code 4095 (L / 52.37)^(1/2.6), white 48 cd/m²).
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run
from image_files import store

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.frames.encodings import encoding_named

# x, y of red, green, blue and white: SMPTE RP 431-2 with a white of D65.
P3_D65 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.3127, 0.3290))
SIDE = 40


def to_xyz(primaries: tuple[tuple[float, float], ...]) -> np.ndarray:
    """(XYZ, RGB): white has Y = 1 (SMPTE RP 177)."""
    *rgb, white = [np.array([x, y, 1 - x - y]) / y for x, y in primaries]
    columns = np.stack(rgb, axis=1)
    return columns * np.linalg.solve(columns, white)


def codes_of(path: Path) -> np.ndarray:
    samples = oiio.ImageInput.open(str(path)).read_image("unknown")
    return np.asarray(samples).astype(int)


def patches() -> np.ndarray:
    """(row, col, 3) 10-bit codes of a domemaster: greys and colours in stripes."""
    codes = np.zeros((SIDE, SIDE, 3), int)
    colours = [(1023, 1023, 1023), (512, 512, 512), (1023, 0, 0), (0, 900, 0), (64, 128, 700)]
    for k, colour in enumerate(colours):
        codes[:, 8 * k : 8 * k + 8] = colour
    return codes


def dpx(path: Path, codes: np.ndarray) -> Path:
    widened = codes << 6 | codes >> 4
    return store(path, widened.astype(np.uint16), **{"oiio:BitsPerSample": 10})


def wide(folder: Path) -> Path:
    """A theatre whose projector has the master's primaries."""
    text = resources.files("scenes").joinpath("dome_hemisphere.toml").read_text()
    path = folder / "wide.toml"
    path.write_text(text.replace('primaries = "BT.709"', 'primaries = "P3-D65"'))
    return path


def compensated(run: Run, path: Path, out: Path, *options: object) -> Any:
    scene = ("--scene", wide(out.parent), "--method", "none", "--out", out)
    return run("compensate", path, *scene, "--dither", "none", *options)


def test_p3_dpx_in_dcdm_out(tmp_path: Path, out: Path, run: Run) -> None:
    path = dpx(tmp_path / "in.dpx", patches())
    result = compensated(
        run, path, out, "--encoding", "p3-d65", "--output-encoding", "dcdm", "--format", "tif"
    )
    assert result.code == 0, result
    codes = codes_of(out / "in.tif")
    assert codes.dtype == int
    assert not (codes & 15).any()  # DCI DCSS, 3.2.2: 12 bits in 16
    light = (patches() / 1023) ** 2.6 @ to_xyz(P3_D65).T
    expected = 4095 * (np.maximum(light, 0) * 48 / 52.37) ** (1 / 2.6)
    assert np.abs((codes >> 4) - expected).max() <= 0.51
    # Read back by what it is, it is the same light.
    read = read_frame(out / "in.tif", colour=encoding_named("dcdm"))
    assert read.bits == 12
    assert "DCDM XYZ, which the file cannot say" in result.out


def test_what_lies_outside_the_circle_is_encoded_alike(tmp_path: Path, out: Path, run: Run) -> None:
    grey = np.full((SIDE, SIDE, 3), 512)
    how = ("--encoding", "gamma2.4", "--output-encoding", "gamma2.6", "--format", "png")
    compensated(run, dpx(tmp_path / "in.dpx", grey), out, *how)
    codes = codes_of(out / "in.png") / 65535
    np.testing.assert_allclose(codes, (512 / 1023) ** (2.4 / 2.6), atol=1e-4)


def test_what_is_out_of_the_gamut_is_told(tmp_path: Path, out: Path, run: Run) -> None:
    path = dpx(tmp_path / "in.dpx", patches())
    how = ("--encoding", "p3-d65", "--output-encoding", "srgb", "--format", "png")
    result = compensated(run, path, out, *how)
    assert "out of the file's colour range, and clipped" in result.out
    result = compensated(run, path, out / "wide", "--encoding", "p3-d65")
    assert "out of the file's colour range" not in result.out


def test_a_bright_exr_becomes_an_integer_file_clipped_and_told(
    tmp_path: Path, out: Path, run: Run
) -> None:
    samples = np.full((SIDE, SIDE, 3), 2.0, np.float16)
    source = store(tmp_path / "in.exr", samples)
    for suffix in ("png", "tif", "dpx", "jpg"):
        bits = ("--bits", "16") if suffix == "tif" else ()
        result = compensated(run, source, out, "--format", suffix, *bits)
        assert result.code == 0, result
        assert "out of the projector's range: 100%" in result.out
        assert codes_of(out / f"in.{suffix}").max() in (255, 65535)


# A DCDM that does not say what it is.


def test_a_dcdm_that_nobody_names_is_asked_about(tmp_path: Path, out: Path, run: Run) -> None:
    codes = (np.random.default_rng(1).integers(0, 4096, (SIDE, SIDE, 3)) << 4).astype(np.uint16)
    path = store(tmp_path / "in.tif", codes)
    compensated(run, path, out).is_refused("12 bits in 16", "--encoding dcdm", "--encoding srgb")
    for name in ("dcdm", "srgb"):
        assert compensated(run, path, out, "--encoding", name).code == 0


@pytest.mark.parametrize(
    "codes",
    [
        np.zeros((SIDE, SIDE, 3)),
        np.full((SIDE, SIDE, 3), 128 << 8),  # 8 bits in 16
        np.random.default_rng(1).integers(0, 65536, (SIDE, SIDE, 3)),
        np.random.default_rng(1).integers(0, 256, (SIDE, SIDE, 3)) * 257,
        np.random.default_rng(1).integers(0, 256, (SIDE, SIDE, 3)) << 8,
    ],
)
def test_others_are_not(tmp_path: Path, codes: np.ndarray) -> None:
    assert read_frame(store(tmp_path / "in.tif", codes.astype(np.uint16))).bits == 16


def test_a_profile_is_a_word_of_it(tmp_path: Path) -> None:
    from icc_profiles import icc_profile  # noqa: PLC0415

    codes = (np.random.default_rng(1).integers(0, 4096, (SIDE, SIDE, 3)) << 4).astype(np.uint16)
    profile = icc_profile("sRGB")
    said = {"ICCProfile": (f"uint8[{profile.size}]", profile)}
    assert read_frame(store(tmp_path / "in.tif", codes, **said)).colour.transfer == "srgb"
    with pytest.raises(InputError, match="12 bits in 16"):
        read_frame(store(tmp_path / "in.tif", codes))
