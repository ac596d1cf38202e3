"""What tracing and applying cost: paths to a CPU-second, seconds to a picture, memory.

``python -m validation.benchmarks.tracing [SIZE]`` on an idle machine; with a size it also renders
a domemaster of SIZE² pixels in a process of its own and prints its peak memory.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.theatre import Theatre
from domesim.scene import load_dome
from validation.benchmarks.commands import Job, run_command
from validation.rooms import RECESSED


@dataclass(frozen=True)
class Rate:
    """Walks in one theatre.

    Attributes
    ----------
    theatre
        Its name.
    aimed
        Whether walks aimed at the picture's bright pixels.
    paths, segments
        Millions to a CPU-second.
    """

    theatre: str
    aimed: bool
    paths: float
    segments: float


def rates(walks: int = 256, size: int = 128) -> Iterator[Rate]:
    """Throughput of the bounce loop for a white picture, from the bare cap to a furnished room."""
    theatres: dict[str, Theatre] = {
        "bare hemisphere": load_dome("dome_hemisphere").theatre,
        "floor and wall": RECESSED,
        "planetarium (meshes)": load_dome("dome_planetarium").theatre,
    }
    for name, theatre in theatres.items():
        tracer = Tracer(theatre)
        source = tracer.picture(np.ones((size, size, 3), np.float32))
        paths = walks * int(theatre.dome.inside(size, size).sum())
        for aimed in (False, True):
            for seed in (0, 1):  # the first run compiles
                settings = Settings(least=walks, most=walks, aim=aimed, seed=seed)
                traced = tracer.screen(source, size, size, settings)
            yield Rate(
                name, aimed, paths / traced.seconds / 1e6, traced.steps / traced.seconds / 1e6
            )


def application(size: int = 4096) -> tuple[float, float, float]:
    """Seconds to apply a tabulated transport and its adjoint, and how far <Ax, y> is off <x, A'y>.

    Wall-clock time of the second application, float32 pictures of `size`² pixels.
    """
    theatre = RECESSED
    transport = tabulate(theatre, error=1e-3).transport
    observation = transport.observation(size, size)
    random = np.random.default_rng(0)
    x, y = (random.random((1, size, size, 3), np.float32) for _ in range(2))
    observation.linear(x), observation.adjoint(y)
    started = time.perf_counter()
    seen = observation.linear(x)
    forward = time.perf_counter() - started
    started = time.perf_counter()
    back = observation.adjoint(y)
    backward = time.perf_counter() - started
    left = np.vdot(seen.astype(np.float64), y.astype(np.float64))
    right = np.vdot(x.astype(np.float64), back.astype(np.float64))
    return forward, backward, abs(left / right - 1)


def render(size: int, scene: str = "dome_hemisphere") -> Job:
    """Render a domemaster of `size`² pixels, two walks each."""
    with tempfile.TemporaryDirectory() as folder:
        return run_command(
            "render", scene, "--quiet", "--out", f"{folder}/seen.exr",
            "--size", str(size), "--samples", "2", "--error", "9",
        )  # fmt: skip


if __name__ == "__main__":
    for rate in rates():
        print(
            f"{rate.theatre:<22}{'aimed' if rate.aimed else 'plain':<6} {rate.paths:6.2f} M paths, "
            f"{rate.segments:6.2f} M segments a CPU-second",
            flush=True,
        )
    forward, backward, off = application()
    print(f"4096², tabulated: apply {forward:.2f} s, adjoint {backward:.2f} s, law to {off:.0e}")
    for argument in sys.argv[1:]:
        job = render(int(argument))
        print(f"render --size {argument} --samples 2: {job.gib:.1f} GiB, {job.cpu_s:.0f} CPU-s")
