"""Shaders in the Interactive Shader Format show what the library shows, in a host as its text says.

The host is ``tests/isf_host.js``, on WebGL 2 in Chromium.
"""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_pictures import SRGB, expected, frame_of, tabulated
from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.live.isf import isf_of
from domesim.errors import InputError
from domesim.frames.encodings import encoding_named
from domesim.scene import Scene, load_scene
from domesim.scene.choice import SceneChoice

HOST = Path(__file__).parents[2] / "isf_host.js"
DRAW = """([text, width, height, frames]) => {
  const draw = isfHost(text, width, height);
  const bytes = (data) => Uint8Array.from(atob(data), (each) => each.charCodeAt(0));
  return frames.map(([data, values]) => draw(bytes(data), values));
}"""
Drawn = tuple[NDArray[Any], dict[str, Any]]
"""Codes (row, col, RGBA), and the inputs' values."""


def size_of(scene: Scene, frame: NDArray[Any], *, beside: bool = True) -> tuple[int, int]:
    rows, cols = frame.shape[:2]
    if scene.views == 1:
        return rows, cols
    return (rows, cols // 2) if beside else (rows // 2, cols)


@pytest.fixture
def draw(browser: Any) -> Any:
    """Codes of 255, not rounded, of frames that follow each other."""
    page = browser.new_page()
    page.add_script_tag(path=HOST)

    def drawn(text: str, frames: list[Drawn]) -> NDArray[np.float64]:
        rows, cols = frames[0][0].shape[:2]
        sent = [(base64.b64encode(codes.tobytes()).decode(), given) for codes, given in frames]
        found = page.evaluate(DRAW, [text, cols, rows, sent])
        return np.array(found).reshape(len(frames), rows, cols, 4)

    yield drawn
    page.close()


def wanted(scene: Scene, frame: NDArray[Any], lift: float, *, beside: bool = True) -> Any:
    deep = np.ascontiguousarray(frame[..., :3]).astype(np.uint16) * np.uint16(257)
    return expected(scene, deep, "rgb48le", beside=beside, aim=Aim(lift=lift)) / 257


@pytest.mark.parametrize("name", ["dome_planetarium", "stereo_cinema_silver"])
def test_moving_pictures_with_lifts_of_their_own(draw: Any, name: str) -> None:
    """Each is what it is alone, by its own lift: no pass is a frame late."""
    scene = load_scene(name)
    frame = frame_of(scene, 96, "rgba")
    frame[..., 3] = np.arange(frame.shape[1])
    other = np.ascontiguousarray(frame[:, ::-1])
    film: list[Drawn] = [(frame, {"lift": 1.0}), (other, {"lift": 2.5}), (frame, {"lift": 0.0})]
    off: Drawn = (frame, {"compensating": False})
    found = draw(isf_of(scene, *size_of(scene, frame), SRGB), [*film, off])
    for picture, (codes, given) in zip(found, film, strict=False):
        there = wanted(scene, codes, given["lift"])
        assert np.abs(picture[..., :3] - there).max() < 0.5
        assert np.abs(picture[..., :3] - there).mean() < 0.02
        np.testing.assert_allclose(picture[..., 3], codes[..., 3], atol=0.01)
    assert np.abs(found[0] - found[2]).max() > 1
    np.testing.assert_allclose(found[3], frame, atol=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "size", "beside"),
    [
        ("dome_led", 192, True),  # the most feedback
        ("dome_imax", 500, True),  # blocks of several pixels, and the last cut off
        ("stereo_spectral", 321, False),  # matrices that mix primaries, and odd sides
        ("stereo_cinema_silver", 320, True),
    ],
)
def test_it_shows_what_the_library_shows(draw: Any, name: str, size: int, beside: bool) -> None:
    scene = load_scene(name)
    frame = frame_of(scene, size, "rgba", beside=beside)
    text = isf_of(scene, *size_of(scene, frame, beside=beside), SRGB, beside=beside)
    (found,) = draw(text, [(frame, {"lift": 2.5})])
    apart = np.abs(found[..., :3] - wanted(scene, frame, 2.5, beside=beside))
    assert apart.max() < 1
    assert np.quantile(apart, 0.999) < 0.3


COMPILE = """(texts) => {
  const gl = document.createElement("canvas").getContext("webgl2");
  return texts.map((text) => {
    const shader = gl.createShader(gl.FRAGMENT_SHADER);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    return gl.getShaderInfoLog(shader) ?? "";
  });
}"""
TOUCH = """#version 300 es
precision highp float;
#define TD_NUM_2D_INPUTS {inputs}
uniform sampler2D sTD2DInputs[{inputs}];
uniform struct {{ vec4 res; }} uTDOutputInfo;
in vec3 vUV;
vec4 TDOutputSwizzle(vec4 colour) {{ return colour; }}
"""
"""What TouchDesigner puts before a GLSL TOP's text, as its manual has it."""


@pytest.mark.parametrize(("name", "passes"), [("dome_imax", 8), ("stereo_cinema_silver", 4)])
def test_touchdesigners_text_compiles_for_each_top(browser: Any, name: str, passes: int) -> None:
    text = isf_of(load_scene(name), 64, 64, SRGB, aim=Aim(lift=2), touch=True)
    assert f"For {passes} GLSL TOPs" in text
    assert "lift (2.0 is usual)" in text
    page = browser.new_page()
    tops = [TOUCH.format(inputs=inputs) + text for inputs in range(1, passes + 1)]
    assert page.evaluate(COMPILE, [*tops, tops[0] + "?"])[:-1] == [""] * passes
    assert "ERROR" in page.evaluate(COMPILE, [tops[0] + "?"])[0]
    page.close()


def test_another_size_gets_a_red_frame(draw: Any) -> None:
    grey = np.full((48, 48, 4), 90, np.uint8)
    text = isf_of(load_scene("dome_imax"), 64, 64, SRGB)
    red, without = draw(text, [(grey, {}), (grey, {"compensating": False})])
    np.testing.assert_allclose(red[0, 0], [255, 0, 0, 255])
    np.testing.assert_allclose(red[20:28, 20:28], 90, atol=0.01)
    np.testing.assert_allclose(without, 90, atol=0.01)


@pytest.mark.parametrize("name", ["dome_imax", "stereo_spectral"])
def test_the_header_is_one(name: str) -> None:
    """Of eight passes at most; a name does not end it."""
    scene = replace(load_scene(name), name="a\n*/ b")
    text = isf_of(scene, 64, 64, encoding_named("bt709"), aim=Aim(lift=2))
    header = json.loads(text[2 : text.index("*/")])
    assert len(header["PASSES"]) <= 8
    assert all(each.get("FLOAT") for each in header["PASSES"][:-1])
    assert header["INPUTS"][-1]["DEFAULT"] == 2


def test_scenes_that_it_does_not_show() -> None:
    with pytest.raises(InputError, match=r"the same all over the screen; use --for mpv"):
        isf_of(tabulated(), 64, 64, SRGB)
    with pytest.raises(InputError, match="--seat"):
        isf_of(SceneChoice("stereo_cinema_silver", None, "all").load(), 32, 32, SRGB)
    with pytest.raises(InputError, match="no shader knows this curve"):
        isf_of(load_scene("dome_imax"), 64, 64, encoding_named("hlg"))
