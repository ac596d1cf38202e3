"""Halves that stay half: the same picture, in half the memory."""

from pathlib import Path

import numpy as np
import pytest

from domesim.frames import (
    ColourTag,
    Frame,
    read_frame,
    read_master,
    write_frame,
    write_master,
)
from domesim.frames.halves import are_sound, as_floats, as_halves
from domesim.frames.views import made_for
from domesim.scene import load_scene
from domesim.scene.screening import decoded, encoded

LINEAR = ColourTag("linear", "BT.709", "made so")
PIXELS = np.random.default_rng(3).uniform(0, 2, (24, 24, 3)).astype(np.float16)


def stored(path: Path, pixels: np.ndarray, bits: int = 16) -> Path:
    write_frame(Frame(pixels.astype(np.float32), path, LINEAR, bits, floating=True), path)
    return path


@pytest.mark.parametrize(("bits", "kept"), [(16, np.float16), (32, np.float32)])
def test_only_halves_stay_half_and_only_where_asked(
    tmp_path: Path, bits: int, kept: type[np.floating]
) -> None:
    path = stored(tmp_path / "a.exr", PIXELS, bits)
    assert read_frame(path).pixels.dtype == np.float32
    assert read_master([path]).frames[0].pixels.dtype == np.float32
    (frame,) = read_master([path], halves=True).frames
    assert frame.pixels.dtype == kept
    np.testing.assert_array_equal(frame.pixels, PIXELS)
    assert read_master([path], halves=True).pixels.dtype == np.float32


@pytest.mark.parametrize("bad", [-0.5, np.nan, np.inf, -np.inf, -0.0])
def test_impossible_halves_are_found_by_their_bits(bad: float) -> None:
    halves = PIXELS.copy()
    assert are_sound(halves)
    halves[5, 7, 1] = bad
    assert not are_sound(halves)


ALL = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
SOUND = ALL[: int(np.float16(np.inf).view(np.uint16))]


@pytest.mark.parametrize("halves", [ALL, SOUND, SOUND[::3], SOUND[:0], SOUND[:6].reshape(2, 3)])
def test_all_halves_become_the_floats_that_they_stand_for(halves: np.ndarray) -> None:
    found = as_floats(halves)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, halves.astype(np.float32))
    if halves is not ALL:
        np.testing.assert_array_equal(as_floats(halves, sound=True), found)


def test_floats_become_the_nearest_halves() -> None:
    """Halves themselves, their middles, which go to the even one, and floats beside these."""
    halves = SOUND.astype(np.float32)
    middles = (halves[1:] + halves[:-1]) / 2
    beside = [np.nextafter(middles, np.float32(end)) for end in (0, 1e9)]
    floats = np.concatenate([halves, middles, *beside])[None]
    np.testing.assert_array_equal(
        as_halves(floats).view(np.uint16), floats.astype(np.float16).view(np.uint16)
    )


def test_codes_become_floats() -> None:
    np.testing.assert_array_equal(as_floats(np.array([0, 255], np.uint8)), [0, 255])


@pytest.mark.parametrize(
    ("name", "colour"),
    [("x.exr", None), ("x.png", ColourTag("srgb", "BT.709", "made so"))],
    ids=["half", "PNG"],
)
def test_a_screen_is_encoded_of_halves_as_of_floats(
    tmp_path: Path, name: str, colour: ColourTag | None
) -> None:
    """Off the screen, too, where a master may be brighter than the format that it becomes."""
    path, out = stored(tmp_path / "a.exr", PIXELS), tmp_path / name
    scene = load_scene("dome_imax")
    screen = scene.screen(*PIXELS.shape[:2])
    found = []
    for halves in (False, True):
        master = made_for(read_master([path], halves=halves), [out], None, colour)
        result, _ = encoded(master, decoded(master, scene) / 4, scene, screen)
        write_master(result, [out])
        found.append(out.read_bytes())
        if colour is None:
            np.testing.assert_array_equal(result.frames[0].pixels[~screen], PIXELS[~screen])
        light = decoded(master, scene) / 4
        spent, _ = encoded(master, light, scene, screen, spent=True)
        np.testing.assert_array_equal(spent.frames[0].pixels, result.frames[0].pixels)
        assert np.shares_memory(spent.frames[0].pixels, light)
    assert found[0] == found[1]
