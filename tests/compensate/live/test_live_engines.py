"""Compiled loops and arrays show what the library shows, within rounding; nothing pumps."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from typing import Any

import array_api_strict
import numpy as np
import pytest
from live_pictures import (
    SRGB,
    STRONG,
    engine_for,
    expected,
    frame_of,
    made,
    tabulated,
    uncompiled,
)
from numpy.typing import NDArray

from compensate.live import arrays, engines
from compensate.live.coding import PIXEL_FORMATS, Coding
from compensate.live.constants import DomeConstants, constants_of, turns_of
from compensate.live.shader import shader_of
from domesim.errors import InputError
from domesim.frames.encodings import encoding_named
from domesim.scene import CinemaScene, load_scene
from domesim.scene.flat import ROOM
from testing.places import stereo_at

SMALL = [load_scene("dome_led"), stereo_at(0.1, 15.0)]
"""Scenes whose formulas a few pixels show."""


def test_cells_hold_what_varies_over_the_screen():
    scene = tabulated()
    k = constants_of(scene, 200, 200)
    f = scene.solvable(200, 200).factors
    assert k.spread.shape == (len(f.spread), *k.gain.shape)
    rows = np.arange(0, 200 - k.cell, k.cell) + k.cell // 2
    there = f.spread[:, rows[:, None], rows[None, :]]
    on = scene.screen(200, 200)[rows[:, None], rows[None, :]]
    near = k.spread[:, : len(rows), : len(rows)]
    # But at the rim, where the floor's light falls off within a cell
    assert np.quantile(np.abs(near - there)[:, on], 0.95) < 0.01 * np.abs(there).max()
    counted = np.array([(light * scene.screen(200, 200)).sum() for light in f.collect])
    assert counted == pytest.approx(
        [(c * _pixels(scene, k)).sum() for c in k.collect], rel=1e-6, abs=1e-9
    )


def _pixels(scene, k) -> NDArray[np.float64]:
    """Of each cell, how many lie on the screen."""
    size = k.gain.shape[0] * k.cell
    on = np.zeros((size, size))
    on[:200, :200] = scene.screen(200, 200)
    return on.reshape(-1, k.cell, k.gain.shape[1], k.cell).sum(axis=(1, 3))


@pytest.mark.parametrize("crosstalk", [0.0, 0.01, 0.1, 0.5])
def test_turns_of_both_eyes_are_enough(crosstalk):
    """Each gains the crosstalk; one more than is needed, and no more than two."""
    k = constants_of(stereo_at(crosstalk, 15.0), 8, 8)
    assert crosstalk ** turns_of(k) <= 1e-5
    assert crosstalk == 0 or crosstalk ** (turns_of(k) - 3) > 1e-5


def cinema() -> CinemaScene:
    """A 2-D cinema with a room alone."""
    scene = load_scene("cinema_2d")
    assert isinstance(scene, CinemaScene)
    return replace(scene, way=scene.way.only(ROOM))


def test_a_2d_cinema_with_a_room_alone_is_live():
    k = constants_of(cinema(), 27, 64)
    assert isinstance(k, DomeConstants)
    assert "cinema_2d" in shader_of(cinema(), 27, 64, SRGB)
    frame = frame_of(cinema(), 64, "rgb48le")[:27]
    assert (expected(cinema(), frame, "rgb48le") != frame).mean() > 0.1
    for other in (load_scene("cinema_2d"), load_scene("stereo_room")):
        with pytest.raises(InputError, match=r"scattered light .* 3D screens with a \[room\]"):
            constants_of(other, 27, 64)


def test_half_precision_by_its_bits():
    coding = Coding(load_scene("dome_imax").projector, encoding_named("linear"))
    table = coding.table(PIXEL_FORMATS["rgbaf16"])
    values = np.array([0.0, 0.25, 1.0, -0.5], "<f2")
    np.testing.assert_allclose(table[values.view("<u2")], [0, 0.25, 1, -0.5])
    assert np.isnan(table[np.array([np.nan, np.inf], "<f2").view("<u2")]).all()


def test_hlg_has_no_curve_of_each_primary():
    """Its OOTF goes by luminance: neither tables nor shaders have it."""
    scene = load_scene("dome_imax")
    coding = Coding(scene.projector, encoding_named("hlg"))
    with pytest.raises(InputError, match="--encoding hlg: wanted a curve of each primary"):
        coding.table(PIXEL_FORMATS["rgb48le"])
    with pytest.raises(InputError, match="no shader knows this curve"):
        shader_of(scene, 64, 64, encoding_named("hlg"))


def test_plain_frames_are_what_the_master_path_makes():
    """The library's own engine keeps what is off the screen, and alpha."""
    scene = load_scene("dome_imax")
    frame = frame_of(scene, 48, "rgba")
    frame[..., 3] = np.arange(48)
    found = expected(scene, frame, "rgba")
    assert (found[..., 3] == frame[..., 3]).all()
    off = ~scene.screen(48, 48)
    assert (found[off] == frame[off]).all()
    assert (found != frame).any()


@pytest.mark.parametrize("scene", SMALL, ids=lambda scene: scene.name)
def test_formulas_of_the_loops_are_the_librarys(scene):
    """Run by Python itself, after another frame: nothing of that is left."""
    frame = frame_of(scene, 36, "rgb48le")
    wanted = expected(scene, frame, "rgb48le", aim=STRONG).astype(int)
    with uncompiled():
        rows, cols = frame.shape[0], frame.shape[1] // scene.views
        by, engine = engine_for(scene, rows, cols, "rgb48le", by="numba")
        engine(frame[::-1].copy(), 0, 0.0)
        found = engine(frame, 1, STRONG.lift).astype(int)
    assert by == "numba"
    assert np.abs(found - wanted).max() <= 5
    assert np.mean(frame != wanted) > 0.1


@pytest.mark.parametrize("scene", SMALL, ids=lambda scene: scene.name)
def test_arrays_of_any_library(scene, monkeypatch):
    """By the standard alone, which has no device; after another frame, too."""
    frame = frame_of(scene, 48, "rgba64le")
    wanted = expected(scene, frame, "rgba64le", aim=STRONG).astype(int)
    rows, cols = frame.shape[0], frame.shape[1] // scene.views
    monkeypatch.setattr(arrays, "sender_to", lambda device: _strict)
    _, engine = engine_for(scene, rows, cols, "rgba64le", by="cuda", device="cuda")
    engine(frame[::-1].copy(), 0, 0.0)
    assert np.abs(engine(frame, 1, STRONG.lift).astype(int) - wanted).max() <= 5


def _strict(array: NDArray[Any]) -> Any:
    return array_api_strict.asarray(np.ascontiguousarray(array))


@pytest.mark.long
def test_compiled_loops_show_what_the_library_shows():
    """Codes of 16 bits, to a fifth of a code of 8; compiling takes most of the time."""
    pytest.importorskip("numba")
    cases = [
        (load_scene("dome_imax"), 300, True),
        (load_scene("dome_led"), 600, True),
        (tabulated(), 250, True),
        (cinema(), 300, True),
        (load_scene("stereo_cinema_silver"), 401, True),
        (load_scene("stereo_spectral"), 640, False),
        (stereo_at(0.1, 15.0), 96, True),
    ]
    for scene, size, beside in cases:
        frame = frame_of(scene, size, "rgb48le", beside=beside)
        found = made(scene, frame, "rgb48le", beside=beside, by="numba").astype(int)
        wanted = expected(scene, frame, "rgb48le", beside=beside).astype(int)
        apart = np.abs(found - wanted)
        assert apart.max() <= 300, (scene.name, size)
        assert np.mean(apart > 50) < 0.002, (scene.name, size)
        assert np.mean(frame != wanted) > 0.1
    scene = load_scene("dome_imax")
    half = frame_of(scene, 128, "rgbaf16")
    found, wanted = made(scene, half, "rgbaf16", by="numba"), expected(scene, half, "rgbaf16")
    np.testing.assert_allclose(found.astype(float), wanted.astype(float), atol=2e-3)
    assert (found[..., 3] == half[..., 3]).all()


def test_compiled_loops_go_before_a_gpu(monkeypatch):
    pytest.importorskip("numba")
    if engines.has_gpu():
        pytest.skip("there is a GPU")
    scene, called = load_scene("dome_imax"), {"by": "numba", "device": None}
    monkeypatch.setattr(engines, "has_gpu", lambda: True)
    assert engine_for(scene, 8, 8, **called)[0] == "numba"
    with pytest.raises(InputError, match="--device cuda"):  # none is here
        engine_for(scene, 8, 8, **{**called, "by": "numpy"})


@pytest.mark.long
def test_each_frame_is_made_alone():
    """After whatever film, a frame is what it is alone: nothing pumps, and nothing lags behind."""
    pytest.importorskip("numba")
    scene = load_scene("dome_imax")
    frame, size = frame_of(scene, 200, "rgb48le"), 200
    _, engine = engine_for(scene, size, size, "rgb48le", by="numba")
    alone = np.array(engine(frame, 0, 1.0)).astype(int)
    for before in (np.zeros_like(frame), np.full_like(frame, 65535), frame[::-1].copy(), frame):
        kept = engine(before, 1, 1.0)
        copy = np.array(kept)
        again = np.array(engine(frame, 0, 1.0)).astype(int)
        assert (kept == copy).all()
        assert np.abs(again - alone).max() <= 100
        assert np.mean(np.abs(again - alone) > 20) < 1e-3


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="needs PyTorch")
@pytest.mark.parametrize("pixels", ["rgb24", "rgba64le", "rgbaf16"])
@pytest.mark.parametrize("name", ["dome_imax", "tabulated", "stereo_spectral"])
def test_arrays_on_a_device(name, pixels):
    """PyTorch's, here on the processor, are the library's; domes begin where they last ended."""
    scene = tabulated() if name == "tabulated" else load_scene(name)
    frame = frame_of(scene, 160, pixels)
    wanted = expected(scene, frame, pixels).astype(float)
    rows, cols = frame.shape[0], frame.shape[1] // scene.views
    _, engine = engine_for(scene, rows, cols, pixels, by="torch", device="torch")
    for before in (frame[::-1].copy(), frame):
        engine(before, 0, 1.0)
        apart = np.abs(engine(frame, 0, 1.0).astype(float) - wanted)
        assert apart.max() <= {"rgb24": 1, "rgba64le": 300, "rgbaf16": 2e-3}[pixels]


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="needs PyTorch")
@pytest.mark.parametrize("name", ["dome_imax", "stereo_spectral"])
def test_noise_on_a_device_is_that_of_compiled_loops(name):
    scene = load_scene(name)
    frame = frame_of(scene, 160)
    size = frame.shape[0], frame.shape[1] // scene.views
    found = []
    for by, device in (("numba", "cpu"), ("torch", "torch")):
        _, engine = engine_for(scene, *size, by=by, device=device, dithers=True)
        found.append(engine(frame, 7, 1.0).astype(int))
    assert np.abs(found[0] - found[1]).max() <= 1
    assert np.mean(found[0] != found[1]) < 0.02
