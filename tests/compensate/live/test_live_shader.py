"""Shaders run for real, by FFmpeg's libplacebo and by mpv, and show what the library shows."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_pictures import (
    SRGB,
    STRONG,
    expected,
    frame_of,
    made,
    require_vulkan,
    shaded,
    tabulated,
)
from numpy.typing import NDArray
from PIL import Image

from compensate.aim import Aim
from compensate.live.shader import shader_of
from compensate.live.y4m import header_of
from compensate.shows.cue_list import read_cue_list
from domesim.errors import InputError
from domesim.frames.encodings import encoding_named
from domesim.scene import Scene, load_scene
from domesim.scene.choice import SceneChoice

RIM = 2
"""Codes that a pixel at a screen's rim may be off by."""


def off(found: NDArray[Any], wanted: NDArray[Any], scene: Scene) -> None:
    """Within a code, two at the rim; and what is off the screen is not touched."""
    apart = np.abs(found.astype(int) - wanted.astype(int)).max(axis=-1)
    if scene.views == 1:
        screen = scene.screen(*apart.shape)
        inner = screen.copy()
        inner[1:-1, 1:-1] &= (
            screen[2:, 1:-1] & screen[:-2, 1:-1] & screen[1:-1, 2:] & screen[1:-1, :-2]
        )
        assert apart.max() <= RIM
        assert apart[~screen].max() == 0
        apart = apart[inner]
    assert apart.max() <= 1
    assert np.mean(apart > 0) < 0.5


def run(
    scene: Scene,
    frame: NDArray[Any],
    folder: Path,
    *,
    beside: bool = True,
    aim: Aim | None = None,
) -> NDArray[Any]:
    require_vulkan()
    height, width = frame.shape[:2]
    rows, cols = height, width
    if scene.views == 2:
        rows, cols = (height, width // 2) if beside else (height // 2, width)
    text = shader_of(scene, rows, cols, SRGB, beside=beside, aim=aim)
    data = shaded(text, folder, frame.tobytes(), f"{width}x{height}", "rgb24", "rgba")
    return np.frombuffer(data, "u1").reshape(frame.shape)


def test_a_dome_in_libplacebo(tmp_path):
    scene = load_scene("dome_led")  # the most feedback
    frame = frame_of(scene, 192)  # blocks of one pixel
    found = run(scene, frame, tmp_path, aim=STRONG)
    off(found, expected(scene, frame, aim=STRONG), scene)
    assert np.abs(found.astype(int) - frame).mean() > 3  # it did something


def test_a_pair_with_a_map_in_libplacebo(tmp_path):
    scene = load_scene("stereo_cinema_silver")
    frame = frame_of(scene, 160)
    found = run(scene, frame, tmp_path, aim=STRONG)
    off(found, expected(scene, frame, aim=STRONG), scene)
    assert np.mean(found != expected(scene, frame, aim=STRONG)) < 0.03  # veils are small
    assert np.abs(found.astype(int) - frame).mean() > 0.3


@pytest.mark.long
@pytest.mark.parametrize("size", [512, 1000])
def test_blocks_of_several_pixels_and_the_last_cut_off(tmp_path, size):
    scene = load_scene("dome_imax")
    frame = frame_of(scene, size)
    off(run(scene, frame, tmp_path), expected(scene, frame), scene)


@pytest.mark.long
def test_a_tabulated_dome(tmp_path):
    scene = tabulated()
    assert scene.solvable(32, 32).factors.spread.shape[0] > 1
    frame = frame_of(scene, 300)
    off(run(scene, frame, tmp_path), expected(scene, frame), scene)


@pytest.mark.long
@pytest.mark.parametrize("beside", [True, False])
def test_a_pair_of_odd_sides(tmp_path, beside):
    scene = load_scene("stereo_spectral")  # matrices that mix primaries
    frame = frame_of(scene, 641, beside=beside)
    found = run(scene, frame, tmp_path, beside=beside)
    off(found, expected(scene, frame, beside=beside), scene)


@pytest.mark.long
def test_ten_bit_video(tmp_path):
    """Planes of 10 bits in limited range: within a code of 8 bits, and mostly of 10."""
    require_vulkan()
    scene, size = load_scene("dome_imax"), 128
    header = header_of(f"YUV4MPEG2 W{size} H{size} F25:1 Ip C444p10".encode())
    master = header.encoded(frame_of(scene, size, "rgb48le"))
    text = shader_of(scene, size, size, encoding_named("bt709"))
    data = shaded(text, tmp_path, master, f"{size}x{size}", "yuv444p10le", "yuv444p10le")
    codes = header.decoded(bytearray(master))
    wanted = made(scene, codes, "rgb48le", by="numpy", colour="bt709")
    found = header.decoded(bytearray(data))
    on = scene.screen(size, size)
    apart = np.abs(found.astype(int) - wanted)[on] / 65535
    dark = wanted[on] / 65535 < 0.04
    assert apart[~dark].max() < 4.5 / 1023
    assert np.median(apart[~dark]) < 1 / 1023
    # Players hold what they made of planes in half precision: of light that is as much everywhere,
    # and beside black a curve of gamma makes many codes of it
    light = [(codes[on][dark] / 65535) ** 2.4 for codes in (found, wanted)]
    assert np.abs(light[0] - light[1]).max() < 3e-4


def test_another_size_gets_a_red_frame(tmp_path):
    require_vulkan()
    scene = load_scene("dome_imax")
    text = shader_of(scene, 96, 96, SRGB)
    grey = np.full((64, 64, 3), 90, np.uint8)
    data = shaded(text, tmp_path, grey.tobytes(), "64x64", "rgb24", "rgba")
    found = np.frombuffer(data, "u1").reshape(grey.shape)
    assert found[0, 0].tolist() == [255, 0, 0]
    assert (found[20:40, 20:40] == 90).all()


def test_the_file_says_what_it_is_for():
    scene = load_scene("dome_imax")
    text = shader_of(scene, 96, 96, SRGB)
    assert text.startswith("// dome_imax")
    assert "96 x 96" in text
    assert "cd/m2" in text
    assert "degree" in text
    digest = text.split("constants: ")[1][:16]
    assert digest in shader_of(scene, 96, 96, SRGB)
    assert digest not in shader_of(load_scene("dome_planetarium"), 96, 96, SRGB)


@pytest.mark.parametrize("end", ["\n", "\n  ", "\r", "\x85", "\u2028", "\x0b"])
def test_a_scenes_name_writes_no_lines_for_the_player(end):
    scene = load_scene("dome_imax")
    named = replace(scene, name=f"dome{end}//!HOOK MAIN{end}//!BIND HOOKED")
    lines = shader_of(named, 96, 96, SRGB).splitlines()
    assert len(lines) == len(shader_of(scene, 96, 96, SRGB).splitlines())
    assert sum(line.startswith("//!HOOK") for line in lines) == sum(
        line.startswith("//!HOOK") for line in shader_of(scene, 96, 96, SRGB).splitlines()
    )


@pytest.mark.parametrize("colour", ["bt709", "dcdm", "st2084", "gamma2.2", "linear"])
def test_curves_that_shaders_know(colour):
    assert "//!HOOK" in shader_of(load_scene("dome_imax"), 32, 32, encoding_named(colour))


@pytest.mark.parametrize("name", ["dome_imax", "stereo_cinema_silver"])
def test_every_pass_is_computed(name):
    """Drivers take long to draw; only the red frame is drawn."""
    text = shader_of(load_scene(name), 96, 96, encoding_named("srgb"))
    assert text.count("//!COMPUTE") == text.count("//!HOOK MAIN") - 1


def test_scenes_that_no_shader_shows():
    with pytest.raises(InputError, match="linear"):
        shader_of(load_scene("stereo_shutter"), 32, 32, SRGB)
    with pytest.raises(InputError, match="--seat"):
        shader_of(SceneChoice("stereo_cinema_silver", None, "all").load(), 32, 32, SRGB)


@pytest.mark.long
def test_mpv_under_a_virtual_screen(tmp_path):
    require_vulkan()
    if shutil.which("mpv") is None or shutil.which("xvfb-run") is None:
        if os.environ.get("DOMESIM_REQUIRE_VULKAN") == "1":
            pytest.fail("no mpv or xvfb-run on the PATH, and DOMESIM_REQUIRE_VULKAN=1")
        pytest.skip("no mpv or xvfb-run on the PATH")
    scene, size = load_scene("dome_imax"), 160
    frame = frame_of(scene, size)
    Image.fromarray(frame).save(tmp_path / "frame.png")
    (tmp_path / "show.glsl").write_text(shader_of(scene, size, size, SRGB))
    shots, ear = (tmp_path / "on.png", tmp_path / "off.png"), tmp_path / "mpv"
    options = [
        *("--no-config", "--vo=gpu", "--gpu-api=opengl", "--gpu-sw=yes", "--no-osc"),
        *("--osd-level=0", "--dither-depth=no", "--video-unscaled=yes", "--no-border", "--pause"),
        *(f"--geometry={size}x{size}", "--image-display-duration=inf"),
        *(f"--glsl-shader={tmp_path / 'show.glsl'}", f"--input-ipc-server={ear}"),
    ]
    player = subprocess.Popen(
        ["xvfb-run", "-a", "-s", "-screen 0 800x600x24", "mpv", *options, tmp_path / "frame.png"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        _take(shots, ear, tmp_path / "show.glsl")
        player.wait(30)
    finally:
        player.kill()
    found, without = (np.asarray(Image.open(shot).convert("RGB")) for shot in shots)
    off(found, expected(scene, frame), scene)
    np.testing.assert_array_equal(without, frame)


def _take(shots: tuple[Path, Path], ear: Path, shader: Path) -> None:
    """Asks a player for what it shows with a shader, and with the shader turned off; ends it."""
    for _ in range(200):
        if ear.exists():
            break
        time.sleep(0.1)
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(30)
        line.connect(str(ear))
        said = line.makefile("rw")

        def ask(*words: str) -> Any:
            said.write(json.dumps({"command": words}) + "\n")
            said.flush()
            while "error" not in (answer := json.loads(said.readline())):
                pass
            return answer

        for shot, turned_on in zip(shots, (True, False), strict=True):
            for _ in range(100):
                drawn = ask("get_property", "vo-passes")
                passes = len(drawn["data"]["fresh"]) if drawn["error"] == "success" else 0
                if passes and (passes > 10) == turned_on:
                    break
                time.sleep(0.2)
            time.sleep(0.5)
            assert ask("screenshot-to-file", str(shot), "window")["error"] == "success"
            switched = ask("change-list", "glsl-shaders", "toggle", str(shader))
            assert switched["error"] == "success"
        ask("quit")


def test_the_command_writes_a_file(run, tmp_path):
    path = tmp_path / "show.glsl"
    done = run("shader", "--scene", "dome_imax", "--size", "64x64", "--out", path)
    assert done.code == 0
    assert str(path) in done.out
    assert path.read_text() == shader_of(load_scene("dome_imax"), 64, 64, encoding_named("bt709"))
    assert [each.name for each in tmp_path.glob("[!.]*")] == ["show.glsl"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--size", "64"], ["--size", "WIDTHxHEIGHT"]),
        (["--size", "64x64", "--packing", "top-bottom"], ["one view"]),
    ],
)
def test_mistakes_of_the_command(run, tmp_path, options, words):
    out = tmp_path / "show.glsl"
    run("shader", "--scene", "dome_imax", *options, "--out", out).is_refused(*words)
    assert not out.exists()


@pytest.mark.parametrize(("name", "passes"), [("dome_led", 12), ("stereo_cinema_silver", 4)])
def test_passes_are_few_whatever_the_feedback(name, passes):
    """But for the red frame's."""
    text = shader_of(load_scene(name), 96, 96, SRGB)
    assert text.count("//!HOOK MAIN") - 1 == passes


@pytest.mark.parametrize("name", ["dome_led", "stereo_spectral"])
def test_uniforms_are_the_lift_and_the_switch(run, tmp_path, name):
    """What players without them read has none; else the text is the same but for the lift."""
    scene, path = load_scene(name), tmp_path / "show.glsl"
    how = ("--scene", name, "--size", "64x64", "--lift", 2.5, "--out", path)
    done = run("shader", *how, "--for", "gpu-next")
    assert done.code == 0
    assert "--vo=gpu-next" in done.out
    assert path.read_text().count("//!PARAM") == 2
    assert "//!MAXIMUM 4.0\n2.5\n" in path.read_text()
    plain = shader_of(scene, 64, 64 // scene.views, encoding_named("bt709"), aim=STRONG)
    assert "//!PARAM" not in plain
    run("shader", *how, "--for", "resolume").is_refused("--for 'resolume'", "isf")


def test_a_cue_list_sets_the_uniforms_frame_by_frame(run, tmp_path):
    """The script is run by mpv's Lua, which is told the numbers of frames."""
    if shutil.which("mpv") is None:
        pytest.skip("no mpv on the PATH")
    cues, out = tmp_path / "cues.csv", tmp_path / "show.glsl"
    cues.write_text(
        "first,last,method,lift,ramp\n3,6,,2.5,2\n7,9,,,4\n12,12,none,,\n13,13,subtractive,3,\n"
    )
    how = ("--scene", "dome_imax", "--size", "64x64", "--lift", 0.5, "--cues", cues, "--out", out)
    run("shader", *how).is_refused("--cues belongs to --for gpu-next")
    done = run("shader", *how, "--for", "gpu-next")
    assert done.code == 0
    assert f"--script={out.with_suffix('.lua')}" in done.out
    (tmp_path / "told.lua").write_text(
        f"""local real, passed, shown, told = mp, 0, nil, io.open("{tmp_path}/told", "w")
        mp = {{
          observe_property = function(_, _, show) shown = show end,
          get_property_number = function() return passed end,
          set_property = function(_, value) told:write(value, "\\n") end,
        }}
        dofile("{out.with_suffix(".lua")}")
        for frame = 0, 13 do passed = frame; shown() end
        told:close()
        real.commandv("quit")"""
    )
    quiet = ("--no-config", "--vo=null", "--ao=null", "--idle=once", "--really-quiet")
    subprocess.run(["mpv", *quiet, f"--script={tmp_path / 'told.lua'}"], check=True, timeout=60)
    known = read_cue_list(cues)
    for number, line in enumerate((tmp_path / "told").read_text().splitlines(), 1):
        lift, compensating = (float(each.split("=")[1]) for each in line.split(","))
        method = known.method(number, "perceptual")
        assert compensating == (method != "none")
        assert method != "subtractive" or lift == 0
        assert method != "perceptual" or lift == pytest.approx(known.lift(number, 0.5), abs=1e-5)
    assert number == 14
