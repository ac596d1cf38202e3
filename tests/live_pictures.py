"""Raw frames for live pictures, and what the library itself makes of them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.live.coding import PIXEL_FORMATS, Coding
from compensate.live.engines import Engine, engine_of
from domesim.frames.encodings import encoding_named
from domesim.observation.radiosity import radiosity
from domesim.scene import DomeScene, Scene, load_scene
from testing.masters import night
from testing.pairs import generated

SRGB = encoding_named("srgb")
STRONG = Aim(lift=2.5)
"""Every line of the aim's formulas counts: some of them only bound what a strong one does."""
DEVICE = ["-init_hw_device", "vulkan=v:llvmpipe", "-filter_hw_device", "v"]


@cache
def tabulated() -> DomeScene:
    """A theatre whose reflections have several modes."""
    scene = load_scene("dome_imax")
    assert isinstance(scene, DomeScene)
    assert scene.theatre.floor is not None
    floor = replace(scene.theatre.floor, albedo=(0.6, 0.5, 0.4))
    theatre = replace(scene.theatre, floor=floor, solids=(), lamps=())
    return replace(scene, theatre=theatre, transport=radiosity(theatre, resolution=6))


def frame_of(
    scene: Scene, size: int, pixels: str = "rgb24", *, beside: bool = True
) -> NDArray[Any]:
    """(row, col, channel) codes of a night, or of a pair as wide as `size` a view."""
    coding, layout = Coding(scene.projector, SRGB), PIXEL_FORMATS[pixels]
    light = np.array(night(size) if scene.views == 1 else generated(size, 1))
    light[:, :, : light.shape[2] // 2] *= np.array([0.1, 0.4, 1.0])  # hues that black would shift
    codes = coding.encoded(light.astype(np.float32))
    if layout.floating:
        kept = codes.astype("<f2")
    else:
        kept = np.rint(codes * layout.largest).astype(layout.dtype)
    if layout.channels == 4:
        kept = np.concatenate([kept, np.ones_like(kept[..., :1])], axis=-1)
    return np.ascontiguousarray(
        kept[0] if scene.views == 1 else np.concatenate(list(kept), int(beside))
    )


def expected(
    scene: Scene,
    frame: NDArray[Any],
    pixels: str = "rgb24",
    *,
    beside: bool = True,
    aim: Aim | None = None,
) -> NDArray[Any]:
    """What the library makes of a frame, in NumPy."""
    return made(scene, frame, pixels, beside=beside, by="numpy", aim=aim)


def made(
    scene: Scene,
    frame: NDArray[Any],
    pixels: str = "rgb24",
    *,
    beside: bool = True,
    by: str,
    device: str = "cpu",
    colour: str = "srgb",
    aim: Aim | None = None,
) -> NDArray[Any]:
    """What `device` makes of a frame, which has to be called `by`."""
    rows, cols = frame.shape[:2]
    if scene.views == 2:
        rows, cols = (rows, cols // 2) if beside else (rows // 2, cols)
    name, engine = engine_for(
        scene, rows, cols, pixels, beside=beside, by=by, device=device, colour=colour
    )
    assert name == by
    return np.array(engine(frame, 0, (aim or Aim()).lift))


def engine_for(
    scene: Scene,
    rows: int,
    cols: int,
    pixels: str = "rgb24",
    *,
    beside: bool = True,
    by: str,
    device: str | None = "cpu",
    colour: str = "srgb",
    dithers: bool = False,
) -> tuple[str, Engine]:
    """What computes frames, and its name; tests have no compiled loops else."""
    coding = Coding(scene.projector, encoding_named(colour))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DOMESIM_FAST", "0" if by == "numpy" else "1")
        return engine_of(
            scene, rows, cols, coding, PIXEL_FORMATS[pixels],
            beside=beside, dithers=dithers, device=device,
        )  # fmt: skip


@contextmanager
def uncompiled() -> Iterator[None]:
    """Loops are run by Python itself: the same formulas, with no minute to compile them."""
    config = pytest.importorskip("numba").config
    names = [f"compensate.live.{name}" for name in ("dome", "pair", "dome_loops", "pair_loops")]
    names.append("compensate.live.tile_loops")
    kept = {name: sys.modules.pop(name) for name in names if name in sys.modules}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config, "DISABLE_JIT", True)
        try:
            yield
        finally:
            for name in names:
                sys.modules.pop(name, None)
            sys.modules.update(kept)


def require_vulkan() -> None:
    """Skip where FFmpeg cannot run shaders; fail where it has to."""
    reason = _no_vulkan()
    if reason is None:
        return
    if os.environ.get("DOMESIM_REQUIRE_VULKAN") == "1":
        pytest.fail(f"{reason}, and DOMESIM_REQUIRE_VULKAN=1")
    pytest.skip(reason)


@cache
def _no_vulkan() -> str | None:
    if shutil.which("ffmpeg") is None:
        return "no ffmpeg on the PATH"
    source = ["-f", "lavfi", "-i", "color=size=8x8,format=rgba"]
    chain = ["-vf", "hwupload,libplacebo=format=rgba,hwdownload,format=rgba", "-frames:v", "1"]
    done = subprocess.run(
        ["ffmpeg", "-v", "error", *DEVICE, *source, *chain, "-f", "null", "-"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return (
        None if done.returncode == 0 else f"ffmpeg has no libplacebo on Vulkan: {done.stderr[:200]}"
    )


def shaded(shader: str, folder: Path, data: bytes, size: str, pixels: str, between: str) -> bytes:
    """Raw video that went through a shader in FFmpeg."""
    path = folder / "show.glsl"
    path.write_text(shader)
    # Of small video FFmpeg takes the matrix to be BT.601
    told = "" if between == "rgba" else "setparams=colorspace=bt709:range=tv,"
    chain = (
        f"format={between},{told}hwupload,libplacebo=custom_shader_path={path}:format={between}:"
        f"dithering=-1,hwdownload,format={between}"
    )
    raw = ["-f", "rawvideo", "-pix_fmt", pixels]
    tagged = ["-color_range", "pc" if between == "rgba" else "tv"]
    done = subprocess.run(
        [
            "ffmpeg",
            "-v",
            "error",
            *DEVICE,
            *raw,
            "-s",
            size,
            *tagged,
            "-i",
            "-",
            "-vf",
            chain,
            *raw,
            "-",
        ],
        input=data,
        capture_output=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()[:2000]
    return done.stdout
