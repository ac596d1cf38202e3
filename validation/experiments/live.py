"""Live pictures are the library's: the same codes, the same quality, at a player's rate.

Rationale
    `domesim live` and `domesim shader` compute what `compensate` does, in passes of their own. That
    they do is seen by codes, for a dome by the closed form, one with stored transport, and a pair
    with a map of crosstalk; and by the share of the default's gain that live pictures of 16 bits
    keep, over the better of nothing and subtraction, on inputs that no setting was chosen on (by
    ColorVideoVDP; in a quick run by the library's own model of differences, on the two inputs
    that it has). Frames of a moving picture are timed one after the other in one process, by the
    clock and of all cores, as multiples of copying a frame, too. A process that is fed by a pipe
    tells latency and whether its memory grows.
Expected
    Codes of 8 bits differ by one at most. Live keeps at least 85 % of the gain. Its process grows
    by at most 16 MB, and a frame is written two frames after it was read at the latest, where
    frames are as long as the median.
    Told, not checked, for they are of seconds: frames a second of this machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, final

import numpy as np
import psutil
from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.devices import CPU
from compensate.live.coding import PIXEL_FORMATS, Coding
from compensate.live.engines import Engine, engine_of, has_gpu
from compensate.live.process import copying
from compensate.pose import pose
from compensate.ruler import Ruler
from compensate.solve import solved
from domesim.frames.encodings import encoding_named
from domesim.light import Light
from domesim.observation.radiosity import radiosity
from domesim.scene import DomeScene, Scene, load_scene
from testing.masters import night
from testing.pairs import generated
from validation import judges
from validation.experiment import (
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
)
from validation.inputs import CHOOSING, USUAL_LUMINANCE, Input, wanted

DOME, PAIR = "dome_imax", "stereo_cinema_silver"
SHARE, GROWTH, LATE = 0.85, 16e6, 2.0
"""Least share of the default's gain; most growth in bytes; most latency in frames."""
FEW = 0.02
"""JOD: of a smaller gain no share is told."""
_SRGB = encoding_named("srgb")


@final
@dataclass(frozen=True)
class Apart:
    """Codes of 8 bits that live and the library differ by: the most, and of how many samples."""

    most: int
    share: float


@final
@dataclass(frozen=True)
class Gain:
    """How good a picture is, JOD: of nothing, of subtraction, of the default, and of it live."""

    nothing: float
    subtraction: float
    default: float
    live: float

    @property
    def of_default(self) -> float:
        """Over the better of nothing and subtraction."""
        return self.default - max(self.nothing, self.subtraction)

    @property
    def of_live(self) -> float:
        """The same, live."""
        return self.live - max(self.nothing, self.subtraction)


@final
@dataclass(frozen=True)
class Rate:
    """Seconds of a frame: by the clock, of all cores, of copying it; and the machine's load."""

    frame: float
    cores: float
    copy: float
    load: float


@final
@dataclass(frozen=True)
class Process:
    """What a process took: frames, bytes that it grew by, and latency in ms and in frames."""

    frames: int
    growth: float
    latency_ms: float
    latency: float


def run(work: Work) -> Finding:
    """Codes, gains, rates, a process, and counts."""
    size = 128 if work.quick else 512
    with _compiled(work) as by:
        apart = work.each(_scenes(), Apart, lambda scene: _apart(scene, size))
        gains, left_out = _gains(work)
        rates = work.each(_sizes(work), Rate, lambda each: _rate(*each))
        process = work.step("process", Process, lambda: _process(60 if work.quick else 10_000))
    share = _share(gains)
    fastest = "; ".join(f"{name} {1 / rate.frame:.0f}" for name, rate in rates.items())
    checks = [
        *(at_most(f"{name}: codes apart", found.most, 1) for name, found in apart.items()),
        at_most("growth of a process", process.growth / 1e6, GROWTH / 1e6, "MB"),
        at_most("latency, in frames", process.latency, LATE),
        *([] if share is None else [at_least("share of the default's gain", share, SHARE)]),
    ]
    told = "" if share is None else f" Live keeps {share:.1%} of the default's gain."
    return Finding(
        result=(
            f"Live codes are the library's to {max(a.most for a in apart.values())} of 255 "
            f"({max(a.share for a in apart.values()):.2%} of samples differ).{told} Frames a "
            f"second here, by {by}: {fastest}."
        ),
        checks=tuple(checks),
        tables=tuple(_tables(rates, gains)),
        figures={
            "share": share,
            **{f"fps, {name}": 1 / rate.frame for name, rate in rates.items()},
        },
        left_out=tuple(left_out),
    )


@contextmanager
def _compiled(work: Work) -> Iterator[str]:
    """Loops are compiled, whatever the environment says; a quick run has no minute for that."""
    before = os.environ.get("DOMESIM_FAST")
    os.environ["DOMESIM_FAST"] = "0" if work.quick else "1"
    try:
        yield _engine(load_scene(DOME), 16, 16)[0]
    finally:
        if before is None:
            del os.environ["DOMESIM_FAST"]
        else:
            os.environ["DOMESIM_FAST"] = before


def _scenes() -> dict[str, Scene]:
    dome = load_scene(DOME)
    assert isinstance(dome, DomeScene)
    assert dome.theatre.floor is not None
    floor = replace(dome.theatre.floor, albedo=(0.6, 0.5, 0.4))
    theatre = replace(dome.theatre, floor=floor, solids=(), lamps=())
    stored = replace(dome, theatre=theatre, transport=radiosity(theatre, resolution=6))
    return {"closed form": dome, "stored transport": stored, "pair with a map": load_scene(PAIR)}


def _engine(
    scene: Scene, rows: int, cols: int, pixels: str = "rgb24", device: str = CPU
) -> tuple[str, Engine]:
    return engine_of(
        scene,
        rows,
        cols,
        Coding(scene.projector, _SRGB),
        PIXEL_FORMATS[pixels],
        beside=False,
        dithers=False,
        device=device,
    )


def _codes(scene: Scene, light: Light, pixels: str) -> NDArray[Any]:
    """(row, col, RGB) of a master, both views one above the other."""
    layout = PIXEL_FORMATS[pixels]
    codes = Coding(scene.projector, _SRGB).encoded(np.asarray(light, np.float32))
    return np.asarray(np.rint(np.concatenate(list(codes)) * layout.largest), layout.dtype)


def _light(scene: Scene, codes: NDArray[Any]) -> Light:
    """Within range, as live has it."""
    views = np.stack(np.split(codes, scene.views))
    light = np.clip(Coding(scene.projector, _SRGB).decoded(views), 0, 1)
    return np.asarray(light * scene.screen(*views.shape[1:3])[None, :, :, None], np.float32)


def _apart(scene: Scene, size: int) -> Apart:
    codes = _codes(scene, night(size) if scene.views == 1 else generated(size, 1), "rgb24")
    light = _light(scene, codes)
    rows, cols = light.shape[1:3]
    _, engine = _engine(scene, rows, cols)
    shown = solved(pose(light, scene), "perceptual").light
    there = np.concatenate([scene.screen(*light.shape[1:3])] * scene.views)
    off = np.abs(engine(codes, 0, Aim().lift).astype(int) - _codes(scene, shown, "rgb24"))[there]
    return Apart(int(off.max()), float(np.mean(off > 0)))


def _gains(work: Work) -> tuple[dict[str, Gain], list[str]]:
    """Gains on each input that nothing was chosen on, where it is usually shown."""
    inputs, left_out = wanted(work)
    reported = {name: one for name, one in inputs.items() if work.quick or name not in CHOOSING}
    try:
        found = work.each(reported, Gain, lambda one: _gain(one, by_judge=not work.quick))
    except Missing as error:
        return {}, [*left_out, f"Shares of gains: {error}"]
    return found, left_out


def _gain(one: Input, *, by_judge: bool) -> Gain:
    scene = one.scene(one.usual, USUAL_LUMINANCE)
    codes = _codes(scene, one.read(), "rgb48le")
    posed = pose(_light(scene, codes), scene, Aim())
    rows, cols = posed.desired.shape[1:3]
    _, engine = _engine(scene, rows, cols, "rgb48le")
    lights = {
        "nothing": posed.desired,
        "subtraction": posed.subtractive,
        "default": solved(posed, "perceptual").light,
        "live": _light(scene, engine(codes, 0, Aim().lift)),
    }

    def good(light: Light) -> float:
        if by_judge:
            return judges.colorvideovdp(posed.wanted, posed.seen(light), scene)
        return -Ruler(posed.wanted, scene, posed.screen).lost(posed.seen(light))

    return Gain(**{name: good(light) for name, light in lights.items()})


def _share(gains: dict[str, Gain]) -> float | None:
    """Live's gains over the default's, of those inputs that the default gains something on."""
    some = [gain for gain in gains.values() if gain.of_default > FEW]
    if not some:
        return None
    return sum(gain.of_live for gain in some) / sum(gain.of_default for gain in some)


def _sizes(work: Work) -> dict[str, tuple[str, int, int, str]]:
    """Scene, rows and columns of each view, and the device."""
    if work.quick:
        return {"dome of 128²": (DOME, 128, 128, CPU), "pair of 128 x 72": (PAIR, 72, 128, CPU)}
    sizes = {
        "dome of 1024²": (DOME, 1024, 1024),
        "dome of 2048²": (DOME, 2048, 2048),
        "pair of 1920 x 1080": (PAIR, 1080, 1920),
    }
    found = {name: (*size, CPU) for name, size in sizes.items()}
    if has_gpu():
        sizes["dome of 4096²"] = (DOME, 4096, 4096)
        found |= {f"{name}, GPU": (*size, "cuda") for name, size in sizes.items()}
    return found


def _rate(name: str, rows: int, cols: int, device: str, frames: int = 30) -> Rate:
    """Frames of a picture that moves by some pixels a frame."""
    scene = load_scene(name)
    _, engine = _engine(scene, rows, cols, device=device)
    light = night(rows) if scene.views == 1 else generated(cols, 1)[:, :rows]
    codes = _codes(scene, light, "rgb24")
    film = [np.roll(codes, 3 * k, axis=1) for k in range(6)]
    engine(film[0], 0, Aim().lift)
    times = [_seconds(partial(engine, film[k % 6], k, Aim().lift)) for k in range(frames)]
    frame, cores = np.median(times, axis=0)
    return Rate(float(frame), float(cores), copying(codes.nbytes), psutil.getloadavg()[0])


def _seconds(work: Callable[[], Any]) -> tuple[float, float]:
    """By the clock, and of all cores."""
    begin, busy = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - begin, time.process_time() - busy


def _process(frames: int, size: int = 64) -> Process:
    """`domesim live`, fed as fast as it takes frames."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "domesim", "live", "--scene", DOME, "--json"),
                *("--device", "cpu", "--size", f"{size}x{size}"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        codes = _codes(load_scene(DOME), night(size), "rgb24")
        film = [np.roll(codes, 3 * k, axis=1).tobytes() for k in range(6)]
        watched = psutil.Process(process.pid)
        before = after = 0
        for number in range(frames):
            process.stdin.write(film[number % 6])
            process.stdin.flush()
            if number:  # one frame ahead
                process.stdout.read(len(film[0]))
            if number == frames // 4:
                before = watched.memory_info().rss
        after = watched.memory_info().rss
        process.stdin.close()
        process.stdout.read()
        process.wait()
        said.seek(0)
        told = json.loads("{" + said.read().decode().split("{", 1)[1])
    latency = told["latency_ms"]["median"]
    return Process(told["frames"], float(after - before), latency, latency / 1e3 * told["fps"])


def _tables(rates: dict[str, Rate], gains: dict[str, Gain]) -> Iterator[Table]:
    yield Table(
        caption="Frames a second here, and what is left of copying a frame",
        columns=(
            Column(name="frames"),
            Column(name="a second"),
            Column(name="ms", digits=".1f"),
            Column(name="core-ms", digits=".1f"),
            Column(name="copies of the frame"),
            Column(name="load of the machine"),
        ),
        rows=tuple(
            (name, 1 / r.frame, r.frame * 1e3, r.cores * 1e3, r.cores / r.copy, r.load)
            for name, r in rates.items()
        ),
    )
    if gains:
        yield Table(
            caption="What live keeps of the default's gain",
            columns=(
                Column(name="input"),
                Column(name="default", unit="JOD", digits=".3f"),
                Column(name="live", unit="JOD", digits=".3f"),
            ),
            rows=tuple((name, g.of_default, g.of_live) for name, g in gains.items()),
        )
