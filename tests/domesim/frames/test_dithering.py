"""Dithered rounding: right in the mean, noise of one strength, no bands, the same everywhere."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_frames import all_codes, store, stored, texture

from domesim.frames import ColourTag, Frame, Master, read_frame, write_frame, write_master
from domesim.frames.dithering import _SAMPLES, dither, seed_of

SRGB = ColourTag("srgb", "BT.709", "a test")
COUNT = 400_000
FIVE_SIGMA = 5.0


def frame(pixels: np.ndarray, name: str = "show.0042.exr") -> Frame:
    return Frame(np.asarray(pixels, np.float32), Path(name), SRGB, 32, True)


def dithered(values: np.ndarray, largest: int = 255, seed: tuple[int, ...] = (0, 42)) -> np.ndarray:
    codes = np.array(values, np.float32)
    dither(codes, largest, seed)
    return codes.astype(np.float64)


# The law of triangular noise.


@pytest.mark.parametrize("largest", [255, 1023, 4095, 65535])
@pytest.mark.parametrize("value", [0.02, 0.25, 0.49, 0.51, 0.75, 1.02, 7.1, 7.25, 7.5, 7.9])
@pytest.mark.parametrize("from_white", [False, True])
def test_the_mean_is_the_value(largest: int, value: float, from_white: bool) -> None:
    """Also half a code from black and white, where noise must not lead beyond them."""
    value = np.float32(largest - value if from_white else value)
    result = dithered(np.full(COUNT, value), largest)
    bias = result.mean() - float(value)
    taken_for_a_code = largest * 2.0**-21
    assert abs(bias) < FIVE_SIGMA * 0.5 / np.sqrt(COUNT) + taken_for_a_code
    assert result.min() >= 0
    assert result.max() <= largest
    assert np.abs(result - value).max() <= 1.5


@pytest.mark.parametrize("value", [1.05, 7.1, 7.25, 7.5, 7.75, 100.01, 253.9])
def test_the_error_is_a_quarter_square_code_whatever_the_value(value: float) -> None:
    """Lipshitz et al., 1992: triangular noise of +-1 code makes the error's variance constant."""
    error = dithered(np.full(COUNT, value)) - np.float32(value)
    # Of the error's square, with outcomes of at most 1.5: its standard deviation is below 0.4.
    assert np.mean(error**2) == pytest.approx(0.25, abs=FIVE_SIGMA * 0.4 / np.sqrt(COUNT))


def test_errors_of_neighbours_and_channels_are_independent() -> None:
    values = np.full((300, 400, 3), 7.3)
    error = dithered(values) - np.float32(7.3)
    channels = np.corrcoef(error.reshape(-1, 3).T)
    plane = error[..., 0]
    pairs = [(plane[:, 1:], plane[:, :-1]), (plane[1:], plane[:-1]), (error[1:], error[:-1])]
    found = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in pairs]
    found += [channels[0, 1], channels[0, 2], channels[1, 2]]
    assert np.abs(found).max() < FIVE_SIGMA / np.sqrt(300 * 399)


def test_a_smooth_ramp_has_no_bands(tmp_path: Path) -> None:
    """Rationale: an 8 bit sky of five codes over 1024 px. Expected: the error has the spectrum of
    noise, where rounding's has lines at the bands' frequency; and means over areas are right."""
    rows, cols, codes = 256, 1024, 5
    ramp = np.broadcast_to(100 + codes * (np.arange(cols) + 0.5) / cols, (rows, cols))
    pixels = np.repeat(ramp[..., None] / 255, 3, -1)
    errors = {}
    for name, on in (("rounded", False), ("dithered", True)):
        write_frame(frame(pixels), tmp_path / f"{name}.png", bits=8, dither=on)
        errors[name] = stored(tmp_path / f"{name}.png")[0][..., 1] - ramp
    # Power of the error's mean over rows, in units of what noise of 1/4 code² has.
    power = {
        name: np.abs(np.fft.rfft(error.mean(axis=0))) ** 2 / (cols / 4 / rows)
        for name, error in errors.items()
    }
    bands = codes * np.arange(1, 6)
    assert power["rounded"][bands].min() > 100
    # Noise: each is exponentially distributed about 1.
    assert power["dithered"][1:].max() < 12
    assert power["dithered"][bands].mean() < 4
    areas = {
        name: np.abs(error.reshape(8, 32, 32, 32).mean(axis=(1, 3)))
        for name, error in errors.items()
    }
    assert areas["rounded"].max() > 0.4
    assert areas["dithered"].max() < FIVE_SIGMA * 0.5 / 32


# What must not change.


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_codes_stay_codes(tmp_path: Path, bits: int) -> None:
    codes = all_codes(bits)
    for suffix in ("tif", "dpx"):
        path = tmp_path / f"x.{suffix}"
        write_frame(frame(codes / (2**bits - 1)), path, bits=bits, dither=True)
        np.testing.assert_array_equal(np.rint(read_frame(path).pixels * (2**bits - 1)), codes)


def test_only_what_lies_between_codes_is_changed(tmp_path: Path) -> None:
    """As off the screen, beside what was computed."""
    codes = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(float)
    within = np.mgrid[:64, :64].sum(0) % 7 < 3
    computed = np.where(within[..., None], np.clip(codes + 0.37, 0, 255), codes)
    write_frame(frame(computed / 255), tmp_path / "x.png", bits=8, dither=True)
    result = stored(tmp_path / "x.png")[0]
    np.testing.assert_array_equal(result[~within], codes[~within])
    assert (result[within] != np.rint(computed[within])).mean() > 0.2


def test_floats_are_written_as_they_are(tmp_path: Path) -> None:
    for name, on in (("a", False), ("b", True)):
        write_frame(frame(texture("float32")), tmp_path / f"{name}.exr", bits=16, dither=on)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_alpha_is_not_dithered(tmp_path: Path) -> None:
    source = store(tmp_path / "in.exr", texture("float16", 4), "R,G,B,A")
    for name, on in (("a", False), ("b", True)):
        write_frame(read_frame(source), tmp_path / f"{name}.png", bits=8, dither=on)
    first, second = (stored(tmp_path / f"{name}.png")[0] for name in "ab")
    np.testing.assert_array_equal(first[..., 3], second[..., 3])
    assert (first[..., :3] != second[..., :3]).any()


# Its seed.


def test_the_seed_is_of_the_name_alone() -> None:
    assert seed_of(Path("a/show.0042.png")) == seed_of(Path("b/c/SHOW.42.exr")) == (0, 42)
    assert seed_of(Path("take2_0042_v3.png"), 1) == (1, 2, 42, 3)
    assert seed_of(Path("still.png")) == (0,)


def written(path: Path, made: Frame) -> bytes:
    write_frame(made, path, bits=8, dither=True)
    return path.read_bytes()


def test_the_same_frame_has_the_same_noise_and_others_have_another(tmp_path: Path) -> None:
    pixels = np.full((40, 50, 3), 100.4 / 255)
    first = written(tmp_path / "a.png", frame(pixels))
    assert written(tmp_path / "b.png", frame(pixels)) == first
    assert written(tmp_path / "c.png", frame(pixels, "elsewhere/film.42.tif")) == first
    assert written(tmp_path / "d.png", frame(pixels, "show.0043.exr")) != first
    results = [stored(tmp_path / name)[0].astype(float) for name in ("a.png", "d.png")]
    both = np.corrcoef([result.ravel() for result in results])[0, 1]
    assert abs(both) < FIVE_SIGMA / np.sqrt(pixels.size)


def test_left_and_right_have_noise_of_their_own(tmp_path: Path) -> None:
    """Equal noise in both eyes would lie on the screen's plane as dirt does."""
    one = frame(np.full((40, 50, 3), 100.4 / 255))
    paths = [tmp_path / "l.png", tmp_path / "r.png"]
    write_master(Master((one, one), "files"), paths, bits=8, dither=True)
    left, right = (stored(path)[0].astype(float).ravel() for path in paths)
    assert abs(np.corrcoef(left, right)[0, 1]) < FIVE_SIGMA / np.sqrt(left.size)
    write_master(Master((one, one), "side-by-side"), paths[:1], bits=8, dither=True)
    halves = np.split(stored(paths[0])[0].astype(float), 2, 1)
    assert abs(np.corrcoef(*(half.ravel() for half in halves))[0, 1]) < 5 / np.sqrt(left.size)


def test_the_noise_is_known() -> None:
    """The bytes of a film must not change with NumPy, the machine or the number of threads."""
    known = dithered(np.full(2 * _SAMPLES + 7, 100.4), seed=(0, 1001))
    script = (
        "import numpy as np; from domesim.frames.dithering import dither;"
        f"codes = np.full({2 * _SAMPLES + 7}, 100.4, np.float32); dither(codes, 255, (0, 1001));"
        "print(*codes[::4096].astype(int))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "7"},
    )
    np.testing.assert_array_equal(known[::4096], np.array(done.stdout.split(), int))
    first = "".join(str(int(code) - 99) for code in known[:24])
    assert first == "122112212112122111111211"


def test_parts_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.full(10_001, 100.4)
    whole = dithered(values)
    monkeypatch.setattr("domesim.frames.dithering._SAMPLES", 1000)
    np.testing.assert_array_equal(dithered(values), whole)


def test_pixels_that_lie_otherwise_in_memory(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).random((20, 30, 3), np.float32)
    turned = np.ascontiguousarray(pixels.transpose(2, 1, 0)).transpose(2, 1, 0)
    made = frame(pixels)
    first = written(tmp_path / "a.png", made)
    assert written(tmp_path / "b.png", replace(made, pixels=turned)) == first
