"""Cameras' raw files: light as the sensor saw it, and nothing done to it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from image_files import store
from studio import NOISE, Studio, random_maps, store_all

from domesim.errors import InputError
from domesim.measure.crosstalk_photographs import crosstalk_maps
from domesim.measure.photographs import read_photographs
from domesim.measure.raws import (
    clipped,
    photograph_named,
    read_photograph,
    refuse_slipped,
    written_exposure,
)
from testing.raws import BGGR, GBRG, GRBG, RGGB, store_linear_raw, store_raw
from testing.screens import SMALL, raw_screen
from testing.surveys import Sensor, surveyed

BLACKS = (500, 520, 540, 580)
ROWS, COLS = 24, 37


@pytest.fixture
def light():
    """Below black, too, as noise makes it; nowhere full."""
    return np.random.default_rng(1).uniform(-0.005, 0.97, (ROWS, COLS, 3))


@pytest.mark.parametrize("bits", [12, 14, 16])
@pytest.mark.parametrize("pattern", [RGGB, BGGR, GRBG, GBRG])
def test_light_is_what_the_sensor_counted_over_its_black(tmp_path, light, bits, pattern):
    store_raw(tmp_path / "a.dng", light, bits=bits, black=BLACKS, pattern=pattern)
    found = read_photograph(tmp_path / "a.dng")
    assert (found.bits, found.floating, found.colour.transfer) == (bits, False, "linear")
    assert np.abs(found.pixels - light).max() < 0.51 / (2**bits - 1 - max(BLACKS))


def test_no_pixel_changes_another(tmp_path, light):
    """LibRaw's own development scales each photograph by its brightest pixel."""
    brighter = light.copy()
    brighter[3, 4] = 0.99
    for name, one in (("a", 0.2 * light), ("b", np.where(brighter == 0.99, 0.99, 0.2 * light))):
        store_raw(tmp_path / f"{name}.dng", one)
    found, other = (read_photograph(tmp_path / f"{name}.dng").pixels for name in "ab")
    found[3, 4] = other[3, 4]
    assert np.array_equal(found, other)


@pytest.mark.parametrize(("orientation", "quarters"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_it_is_turned_as_the_camera_was_held(tmp_path, light, orientation, quarters):
    """Exif 2.32: 6 is shown turned by 90 degrees clockwise, 8 counter-clockwise."""
    store_raw(tmp_path / "a.dng", light, orientation=orientation)
    found = read_photograph(tmp_path / "a.dng").pixels
    assert found == pytest.approx(np.rot90(light, quarters), abs=1e-4)


@pytest.mark.parametrize("number", range(4))
def test_one_full_pixel_of_four_is_told(tmp_path, light, number):
    """A mean of both greens would hide it."""
    codes = store_raw(tmp_path / "a.dng", np.minimum(light, 0.5))
    assert not clipped(read_photograph(tmp_path / "a.dng"))[1].any()
    row, col = 2 * 5 + number // 2, 2 * 7 + number % 2
    written = (tmp_path / "a.dng").read_bytes()
    at = written.index(codes.tobytes()) + 2 * (row * codes.shape[1] + col)
    (tmp_path / "a.dng").write_bytes(
        written[:at] + np.uint16(2**14 - 1).tobytes() + written[at + 2 :]
    )
    _, full = clipped(read_photograph(tmp_path / "a.dng"))
    assert np.argwhere(full).tolist() == [[5, 7]]


@pytest.mark.parametrize(("kind", "bits"), [("exr", 14), ("tif", 14), ("tif", 12)])
def test_crosstalk_is_that_of_linear_files(tmp_path, kind, bits):
    """And that of the rig; a TIFF as developed has 16 bits, and its black is 0."""
    drawn = random_maps(np.random.default_rng(3))
    studio = Studio(drawn, NOISE)
    maps = {}
    for each in (kind, "dng"):
        folder = tmp_path / each
        folder.mkdir()
        listed = store_all(folder, studio, kind=each, bits=bits, extra='encoding = "linear"')
        maps[each] = crosstalk_maps(read_photographs(listed), (5, 7), 77 / 45)
    for linear, raw in zip(maps[kind], maps["dng"], strict=True):
        assert raw.system == pytest.approx(linear.system, abs=linear.system_error)
        seen, wanted = raw.system * raw.share, linear.system * linear.share
        assert np.all(np.abs(seen - wanted) < linear.system * linear.share_error)


@pytest.mark.parametrize("bits", [12, 14])
def test_clipped_photographs_are_refused(tmp_path, bits):
    studio = Studio(random_maps(np.random.default_rng(3)))
    path = store_all(tmp_path, studio, kind="dng", bits=bits)
    white = np.full((45, 77, 3), 0.6)
    white[:2] = 1
    store_raw(tmp_path / "left-left-W.dng", white, bits=bits)
    with pytest.raises(InputError, match=r"left-left-W.dng: \d.\d% of the screen.* saturated"):
        read_photographs(path)


def test_an_exposure_that_slipped_is_refused():
    """By a third of a stop; unless nobody wrote it down."""
    found = raw_screen(1, SMALL, slip=1.26)
    assert re.search(
        r"\.dng: by what the camera wrote .* exposed 1\.26 times as much", found.refused
    )
    assert not raw_screen(1, SMALL, slip=1.1).refused
    assert not raw_screen(1, SMALL, slip=1.26, said=False).refused


@pytest.mark.parametrize("slipped", [0, 3, 8])
def test_a_survey_whose_exposures_are_not_as_it_says_is_refused(slipped):
    found = surveyed(0, sensor=Sensor(14, 1.0, slip=0.5, slipped=slipped), resolution=4)
    assert re.search(r"\.dng: .* exposed 0\.5 times as much.*write its exposure", found.refused)


def test_exposures_are_compared_with_what_is_said():
    path = Path("a.dng")
    shots = [(path, 1 / 60, 1.0), (path, 1 / 64, 1.0), (path, 1 / 15, 4.0), (path, None, 9.0)]
    refuse_slipped(shots, way_out="")
    with pytest.raises(InputError, match=r"b.dng: .* 4 times as much as is said"):
        refuse_slipped([*shots, (Path("b.dng"), 1 / 15, 1.0)], way_out="")


def test_the_camera_writes_time_and_aperture(tmp_path, light):
    store_raw(tmp_path / "a.dng", light, seconds=0.125)
    store_raw(tmp_path / "b.dng", light)
    assert written_exposure(read_photograph(tmp_path / "a.dng")) == pytest.approx(0.125)
    assert written_exposure(read_photograph(tmp_path / "b.dng")) is None


def test_what_is_no_bayer_filters_is_refused(tmp_path, light):
    """LibRaw takes too much black from such files."""
    store_linear_raw(tmp_path / "a.dng", np.clip(light, 0, 1))
    with pytest.raises(InputError, match=r"wanted a raw file with a Bayer filter.* got another"):
        read_photograph(tmp_path / "a.dng")


def test_a_damaged_one_is_refused(tmp_path, light):
    store_raw(tmp_path / "a.dng", light)
    (tmp_path / "b.dng").write_bytes((tmp_path / "a.dng").read_bytes()[:700])
    with pytest.raises(InputError, match=r"b.dng: "):
        read_photograph(tmp_path / "b.dng")


def test_a_photograph_is_found_by_its_patterns_name(tmp_path, light):
    """Whatever the camera calls it after the point; the JPEG that it stored, too, is not meant."""
    store_raw(tmp_path / "ring-1.dng", light)
    store(tmp_path / "ring-1.jpg", np.full((8, 8, 3), 99, np.uint8))
    (tmp_path / "ring-1.xmp").write_text("beside it")
    (tmp_path / "0010_ring-1.png").write_bytes(b"the pattern")
    assert photograph_named(tmp_path / "ring-1") == tmp_path / "ring-1.dng"
    assert photograph_named(tmp_path / "ring-1.jpg") == tmp_path / "ring-1.jpg"
    assert photograph_named(tmp_path / "ring-2") == tmp_path / "ring-2"
    (tmp_path / "ring-1.dng").rename(tmp_path / "other.dng")
    assert photograph_named(tmp_path / "ring-1") == tmp_path / "ring-1.jpg"
    for name in ("both.nef", "both.tif"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"both: wanted one .* got both.nef, both.tif; say which"):
        photograph_named(tmp_path / "both")


def test_lists_name_photographs_as_patterns_are_named(tmp_path):
    path = store_all(tmp_path, Studio(random_maps(np.random.default_rng(3))), kind="dng")
    whole = read_photographs(path)
    path.write_text(path.read_text().replace(".dng", ""))
    found = read_photographs(path)
    assert np.array_equal(found.glasses[0].net["left"]["W"], whole.glasses[0].net["left"]["W"])


def test_a_jpeg_is_refused(tmp_path):
    store(tmp_path / "a.jpg", np.full((8, 8, 3), 99, np.uint8))
    with pytest.raises(InputError, match=r"10 bits or more, got 8; use the camera's raw file"):
        read_photograph(tmp_path / "a.jpg")


def test_without_the_extra_the_way_out_is_told(tmp_path, light, monkeypatch):
    store_raw(tmp_path / "a.dng", light)
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(InputError, match=r"pip install 'domesim\[raw\]'"):
        read_photograph(tmp_path / "a.dng")
