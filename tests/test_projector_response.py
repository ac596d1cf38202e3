"""A scene's ``[projector] response``: a frame gives the same light by whatever way it comes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from icc_profiles import icc_profile
from image_files import store
from live_pictures import require_vulkan, shaded
from numpy.typing import NDArray
from PIL import Image
from videos import KINDS, UNSAID, Kind, write_video, x264

from compensate.live.y4m import header_of
from domesim import load_master
from domesim.errors import InputError
from domesim.frames import Frame, read_frame, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.reading import unsaid
from domesim.frames.yuv import limited_codes
from domesim.light.transfer import Table, named
from domesim.scene import Scene, load_scene

SIDE = 64
PROFILE = icc_profile("sRGB")
LEVELS = [[0, 0], [0.1, 0.004], [0.5, 0.21], [0.9, 0.78], [1, 1]]
CURVES = {'"bt1886"': "bt1886", '"2.2"': "gamma2.2", '"srgb"': "srgb", json.dumps(LEVELS): ""}
"""What a scene says, and the curve's name."""


def scene_file(folder: Path, response: str, scene: str = "dome_planetarium") -> Path:
    """A bundled scene whose projector has a response; "" for none."""
    text = (resources.files("scenes") / f"{scene}.toml").read_text()
    key = f"response = {response}\n" if response else ""
    path = folder / "theatre.toml"
    path.write_text(text.replace("[projector]\n", f"[projector]\n{key}", 1))
    return path


def frame() -> NDArray[np.uint8]:
    """(row, col, RGB) codes: a dark blue sky, a bright glow, and greys from black to white."""
    rows, cols = np.mgrid[:SIDE, :SIDE] / (SIDE - 1)
    glow = np.exp(-((rows - 0.35) ** 2 + (cols - 0.5) ** 2) / 0.05)[..., None]
    sky = np.array([0, 0, 27]) + glow * np.array([150, 130, 120])
    greys = 127.5 - 127.5 * np.cos(2 * np.pi * cols[..., None])
    lower = 1 / (1 + np.exp(-(rows[..., None] - 0.7) * 25))
    return np.rint(sky + lower * (greys - sky)).astype(np.uint8)


def saved(path: Path) -> Path:
    """The frame as a picture that says nothing of its colour."""
    Image.fromarray(frame()).save(path)
    return path


def film(path: Path, kind: Kind, **said: int) -> Path:
    """The frame as a video of 10 bits, 4:4:4."""
    planes = [np.rint(each) for each in limited_codes(frame() / np.float32(255), 1, 10)]
    return write_video(path.with_suffix(kind.suffix), replace(kind, **said), [planes] * 2)


H264 = Kind(".mp4", "libx264", "yuv444p10le", x264("qp=0"))
PRORES = replace(KINDS["ProRes 4444"], options={"profile": "4444", "qscale": "1"})
SILENT = {"primaries": UNSAID, "transfer": UNSAID, "matrix": UNSAID}
WAYS: dict[str, Callable[[Path], Path]] = {
    "PNG": lambda at: saved(at.with_suffix(".png")),
    "PNG, sRGB": lambda at: store(
        at.with_suffix(".png"), frame(), oiio__ColorSpace="srgb_rec709_scene"
    ),
    "PNG, gamma 2.2": lambda at: store(
        at.with_suffix(".png"), frame(), oiio__ColorSpace="g22_rec709_scene"
    ),
    "TIFF": lambda at: saved(at.with_suffix(".tif")),
    "TIFF of 16 bits, sRGB profile": lambda at: store(
        at.with_suffix(".tif"),
        frame().astype(np.uint16) * 257,
        ICCProfile=(f"uint8[{PROFILE.size}]", PROFILE),
    ),
    "H.264": lambda at: film(at, H264, **SILENT),
    "H.264, BT.709": lambda at: film(at, H264),
    "H.264, sRGB": lambda at: film(at, H264, transfer=13),
    "ProRes": lambda at: film(at, PRORES, **SILENT),
    "ProRes, BT.709": lambda at: film(at, PRORES),
}


def first(path: Path) -> Path:
    """Its first frame, if it is a film."""
    return path if path.suffix in (".png", ".tif") else path / f"{path.stem}.0001{path.suffix}"


def apart(light: NDArray[Any], scene: Scene) -> NDArray[Any]:
    """By how many codes of 8 bits light misses what the scene's projector makes of the frame."""
    assert scene.projector.response is not None
    curve = named(scene.projector.response.transfer, white=1.0)
    codes = curve.encode(np.asarray(light, np.float64))
    return np.asarray(np.abs(codes[0] * 255 - frame()))


@pytest.mark.parametrize(
    ("way", "response"),
    [*((way, '"bt1886"') for way in WAYS), *(("TIFF", response) for response in CURVES)],
)
def test_files_give_the_same_light(tmp_path: Path, way: str, response: str) -> None:
    scene = load_scene(scene_file(tmp_path, response))
    light, master = load_master(first(WAYS[way](tmp_path / "in")), scene)
    found = apart(light, scene)
    assert np.quantile(found, 0.999) <= 1
    assert found.max() <= (1.25 if "ProRes" in way else 1)  # which always loses something
    assert "projector.response" in master.described()


def test_the_line_tells_what_the_file_says_else(tmp_path: Path) -> None:
    path = WAYS["PNG, sRGB"](tmp_path / "in")
    said = [
        load_master(path, load_scene(scene_file(tmp_path, each)))[1].colour.source
        for each in ('"bt1886"', '"srgb"')
    ]
    assert said[0] == "the scene's projector.response, and not sRGB (file: sRGB)"
    assert said[1] == "the scene's projector.response"


def test_without_a_response_each_way_has_a_curve_of_its_own(tmp_path: Path) -> None:
    scene = load_scene(scene_file(tmp_path, ""))
    assert scene.projector.response is None
    found = {way: load_master(first(WAYS[way](tmp_path / "in")), scene) for way in ("PNG", "H.264")}
    light = {way: each[0, 2, 2, 2] for way, (each, _) in found.items()}
    assert light["PNG"] > 2 * light["H.264"]  # of the blue sky
    assert "sRGB (assumed for PNG)" in found["PNG"][1].described()
    assert "BT.1886 (assumed for video" in found["H.264"][1].described()


# Through pipes and the shader: codes that go to the projector are those of a file's.


def live(scene: Path, data: bytes, *arguments: str) -> tuple[bytes, str]:
    command = [sys.executable, "-m", "domesim", "live", "--scene", str(scene), "--dither", "none"]
    done = subprocess.run(
        [*command, *arguments], input=data, capture_output=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout, done.stderr.decode()


@pytest.fixture
def made(tmp_path: Path, run: Run) -> Callable[[Path], NDArray[Any]]:
    """(row, col, RGB) codes of 8 bits that compensate makes of the frame as a PNG."""

    def make(scene: Path) -> NDArray[Any]:
        master = WAYS["PNG, sRGB"](tmp_path / "master")
        outcome = run(
            *("compensate", master, "--scene", scene, "--out", tmp_path / "out"),
            *("--output-bits", "16", "--dither", "none"),
        )
        assert outcome.code == 0, outcome
        return read_frame(tmp_path / "out" / "master.png").pixels * 255

    return make


@pytest.mark.parametrize(
    "response",
    [
        pytest.param(each, marks=pytest.mark.long if each in ('"2.2"', '"srgb"') else ())
        for each in CURVES
    ],
)
def test_pipes_and_the_shader_give_what_a_file_gives(
    tmp_path: Path, made: Callable[[Path], NDArray[Any]], run: Run, response: str
) -> None:
    scene = scene_file(tmp_path, response)
    wanted = made(scene)
    assert np.abs(wanted - frame()).max() > 5  # it does something
    curve = named(load_scene(scene).projector.response.transfer, white=1.0)
    codes = np.clip(np.maximum(frame(), wanted), 1, 255)
    step = curve.decode(codes / 255) - curve.decode((codes - 1) / 255)
    step = np.maximum(step, 3e-4)  # shaders have half precision beside black: docs/live.md
    inner = load_scene(scene).screen(SIDE, SIDE)
    inner[1:-1, 1:-1] &= inner[2:, 1:-1] & inner[:-2, 1:-1] & inner[1:-1, 2:] & inner[1:-1, :-2]

    def off(codes: NDArray[Any]) -> NDArray[Any]:
        """Differences of light, in codes."""
        light = [curve.decode(np.asarray(each, float) / 255) for each in (codes, wanted)]
        return np.asarray(np.abs(light[0] - light[1]) / step)[inner]

    size = ("--size", f"{SIDE}x{SIDE}")
    raw, told = live(scene, frame().tobytes(), *size)
    assert off(np.frombuffer(raw, np.uint8).reshape(SIDE, SIDE, 3)).max() <= 1
    assert "projector.response" in told

    deep = np.concatenate([frame() * np.uint16(257), np.full((SIDE, SIDE, 1), 65535)], -1)
    raw, _ = live(scene, deep.astype("<u2").tobytes(), *size, "--pixel-format", "rgba64le")
    found = np.frombuffer(raw, "<u2").reshape(SIDE, SIDE, 4)[..., :3]
    assert off(found / 257).max() <= 1

    head = f"YUV4MPEG2 W{SIDE} H{SIDE} F24:1 Ip A1:1 C444p16\n".encode()
    planes = np.rint(limited_codes(frame() / np.float32(255), 1, 16)).astype("<u2")
    stream, _ = live(scene, head + b"FRAME\n" + planes.tobytes())
    back = header_of(head.strip()).decoded(bytearray(stream[len(head) + 6 :]))
    assert off(back / 257).max() <= 1

    require_vulkan()
    outcome = run("shader", "--scene", scene, *size, "--out", tmp_path / "show.glsl")
    assert outcome.code == 0
    assert "projector.response" in outcome.out
    text = (tmp_path / "show.glsl").read_text()
    data = shaded(text, tmp_path, frame().tobytes(), f"{SIDE}x{SIDE}", "rgb24", "rgba")
    found = off(np.frombuffer(data, np.uint8).reshape(SIDE, SIDE, 3))
    assert np.quantile(found, 0.95) <= 1
    assert found.max() <= 2  # where red and green are out, blue takes up all that is rounded


# What wins.


def test_an_encoding_that_is_asked_for_wins(tmp_path: Path) -> None:
    scene = load_scene(scene_file(tmp_path, '"bt1886"'))
    path = WAYS["PNG"](tmp_path / "in")
    light, master = load_master(path, scene, "srgb")
    wanted = named("srgb", white=1.0).decode(frame() / np.float32(255))
    np.testing.assert_allclose(light[0], wanted, atol=1e-6)
    assert "sRGB (encoding srgb)" in master.described()


@pytest.mark.parametrize("encoding", ["linear", "st2084", "dcdm"])
def test_what_is_light_or_luminance_stays_so(tmp_path: Path, encoding: str) -> None:
    """A file that says it, and not an option."""
    suffix = ".exr" if encoding == "linear" else ".png"
    path = tmp_path / f"in{suffix}"
    pixels = frame() / np.float32(255)
    bits, floating = (32, True) if encoding == "linear" else (16, False)
    write_frame(Frame(pixels, path, encoding_named(encoding), bits, floating), path)
    light = [
        load_master(path, load_scene(scene_file(tmp_path, response)))[0]
        for response in ("", '"bt1886"')
    ]
    np.testing.assert_array_equal(*light)


def test_half_precision_stays_light(tmp_path: Path) -> None:
    light = np.concatenate([frame() / 255, np.ones((SIDE, SIDE, 1))], -1).astype("<f2")
    of_halves = ("--size", f"{SIDE}x{SIDE}", "--pixel-format", "rgbaf16")
    found = [
        live(scene_file(tmp_path, response), light.tobytes(), *of_halves)[0]
        for response in ("", '"bt1886"')
    ]
    assert found[0] == found[1]


def test_alpha_counts_in_light(tmp_path: Path) -> None:
    """Half of a straight colour is half of its light, by the projector's curve."""
    codes = np.full((SIDE, SIDE, 4), 128, np.uint8)
    path = store(tmp_path / "in.png", codes, oiio__UnassociatedAlpha=1)
    scene = load_scene(scene_file(tmp_path, '"bt1886"'))
    light, _ = load_master(path, scene)
    np.testing.assert_allclose(light, (128 / 255) ** 2.4 * 128 / 255, rtol=1e-5)


# What results are.


def test_results_say_the_curve_where_they_can(tmp_path: Path, run: Run) -> None:
    master = WAYS["PNG, sRGB"](tmp_path / "in")
    for response, curve in (('"bt1886"', "bt1886"), ('"2.2"', "gamma2.2")):
        out = tmp_path / curve
        scene = scene_file(tmp_path, response)
        assert run("observe", master, "--scene", scene, "--out", out).code == 0
        assert read_frame(out / "in.png").colour.transfer == curve
    table = load_scene(scene_file(tmp_path, json.dumps(LEVELS)))
    _, read = load_master(master, table)
    assert "a table of 5 levels" in unsaid(read.frames[0])


@pytest.mark.parametrize("response", [*CURVES, ""])
def test_light_becomes_the_projectors_levels(tmp_path: Path, run: Run, response: str) -> None:
    light = store(tmp_path / "in.exr", (frame() / 300).astype(np.float32))
    scene, out = scene_file(tmp_path, response), tmp_path / "out"
    how = ("--format", "png", "--output-encoding", "response", "--dither", "none")
    outcome = run("observe", light, "--scene", scene, "--out", out, *how)
    if not response:
        outcome.is_refused("--output-encoding response", "states no response")
        return
    assert outcome.code == 0
    assert run("observe", light, "--scene", scene, "--out", tmp_path / "light").code == 0
    wanted, _ = load_master(tmp_path / "light" / "in.exr", scene)
    found, _ = load_master(out / "in.png", scene)
    np.testing.assert_allclose(found, np.clip(wanted, 0, 1), atol=1e-3)


# What a scene may say.


@pytest.mark.parametrize("scene", ["dome_planetarium", "stereo_cinema_silver", "cinema_2d"])
@pytest.mark.parametrize("response", CURVES)
def test_each_kind_of_scene_has_it(tmp_path: Path, scene: str, response: str) -> None:
    found = load_scene(scene_file(tmp_path, response, scene)).projector.response
    assert found is not None
    wanted = CURVES[response] or Table(tuple((c, x) for c, x in LEVELS)).name
    assert found.transfer == wanted


def test_light_transport_is_the_same(tmp_path: Path) -> None:
    """A table that was stored before the response was known is good."""
    scenes = [load_scene(scene_file(tmp_path, each)) for each in ("", '"bt1886"')]
    assert scenes[0].digest == scenes[1].digest
    assert scenes[0] != scenes[1]


@pytest.mark.parametrize(
    ("response", "word"),
    [
        ('"rec709"', "is not known"),
        ('"0.5"', "is not known"),
        ("7", "is not known"),
        ("true", "number"),
        ("[[0, 0], [1, 0.9]]", "must run from 0 to 1"),
        ("[[0, 0], [0.5, 0.6], [0.6, 0.5], [1, 1]]", "must increase strictly"),
        ("[[0, 0]]", "two levels or more"),
        ("[[0, 0, 0], [1, 1, 1]]", "response"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, response: str, word: str) -> None:
    with pytest.raises(InputError, match=word) as caught:
        load_scene(scene_file(tmp_path, response))
    assert "projector.response" in str(caught.value)


# How it is measured.


@pytest.mark.parametrize("linear", [0, 0.05])
def test_measured_readings_tell_the_key(tmp_path: Path, run: Run, linear: float) -> None:
    """An exponent where one fits, and else a table."""
    primaries = np.array([[41.2, 35.8, 18.0], [21.3, 71.5, 7.2], [1.9, 11.9, 95.0]])
    lines = ["channel,level,X,Y,Z", "K,0,0.01,0.01,0.01"]
    for level in np.linspace(0.1, 1, 10):
        light = linear * level + (1 - linear) * level**2.3
        for channel, xyz in zip("RGB", primaries.T, strict=True):
            lines.append(f"{channel},{level:g},{','.join(f'{0.01 + light * v:.7g}' for v in xyz)}")
    (tmp_path / "readings.csv").write_text("\n".join(lines))
    outcome = run("measure", "response", tmp_path / "readings.csv", "--json")
    (display,) = json.loads(outcome.out)["displays"].values()
    assert display["scene_key"].startswith("[" if linear else '"2.3')
    found = load_scene(scene_file(tmp_path, display["scene_key"])).projector.response
    assert found is not None
    at = np.linspace(0.1, 1, 10)
    shown = named(found.transfer, white=1.0).decode(at)
    np.testing.assert_allclose(shown, linear * at + (1 - linear) * at**2.3, rtol=1e-3)
