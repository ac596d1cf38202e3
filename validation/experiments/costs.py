"""What the main jobs cost on this machine: seconds, memory, and counts that are any machine's.

Rationale
    A producer asks how long a frame takes and whether the machine is large enough. Seconds differ
    from machine to machine, so only memory and counts are checked; seconds are told.
Expected
    A 2048² frame is compensated within 3 GiB (quick: 1024², 1.5 GiB) and 200 FFTs of planes. An
    8192² domemaster of a theatre with one projector is path-traced within 8 GiB (full run only).
    Aimed walks give the same error as plain ones for fewer.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)

from domesim.pathtrace.tracer import Settings, Tracer
from domesim.scene import load_scene
from validation.benchmarks.tracing import Rate, application, memory, rates
from validation.experiment import Column, Finding, Missing, Table, Work, at_least, at_most
from validation.masters import night


@final
@dataclass(frozen=True)
class Job:
    """One command in a process of its own.

    Attributes
    ----------
    seconds
        Wall-clock time, s.
    gib
        Peak memory, GiB.
    figures
        What it printed with --json.
    """

    seconds: float
    gib: float
    figures: dict[str, Any]


def compensation(size: int) -> Job:
    """``domesim compensate`` of one generated frame of `size`² pixels."""
    with tempfile.TemporaryDirectory() as folder:
        master = Path(folder) / "night.exr"
        _write(master, night(size)[0])
        return _measured(
            "compensate", str(master), "--scene", "dome_imax", "--out", folder + "/out"
        )


def demo() -> Job:
    """``domesim demo``."""
    with tempfile.TemporaryDirectory() as folder:
        return _measured("demo", "--out", folder)


def aimed_gain(seed: int) -> float:
    """Walks that plain tracing needs over what aimed walks need; a night in dome_imax."""
    tracer = Tracer(load_scene("dome_imax").theatre)
    source = tracer.picture(night(128)[0])
    areas = tracer.theatre.dome.screen_areas(64, 64)
    errors = []
    for aim in (False, True):
        settings = Settings(least=64, most=64, aim=aim, seed=seed)
        errors.append(tracer.screen(source, 64, 64, settings).pooled_error(areas)[1])
    return (errors[0] / errors[1]) ** 2


def run(work: Work) -> Finding:
    """Run the jobs."""
    size = 1024 if work.quick else 2048
    job = work.step(f"compensate {size}²", Job, lambda: compensation(size))
    show = work.step("demo", Job, demo)
    frame = job.figures["frames"][0]
    checks = [
        at_most(f"compensate {size}²: peak memory", job.gib, 1.5 if work.quick else 3.0, "GiB"),
        at_most(f"compensate {size}²: FFTs of planes", frame["ffts"], 200),
    ]
    rows: list[tuple[str | float | int | None, ...]] = [
        ("domesim demo", show.seconds, show.gib, None),
        (f"domesim compensate, {size}² EXR", job.seconds, job.gib, frame["ffts"]),
    ]
    figures: dict[str, float] = {
        "costs.demo.seconds": show.seconds,
        "costs.compensate.seconds": job.seconds,
        "costs.compensate.gib": job.gib,
        "costs.compensate.ffts": frame["ffts"],
    }
    left_out, tables = [], []
    try:
        gain = work.step("aimed walks", float, lambda: aimed_gain(work.seed))
    except Missing as missing:
        left_out.append(str(missing))
    else:
        checks.append(at_least("plain over aimed walks for the same error", gain, 2))
        figures["costs.aimed_gain"] = gain
    if not work.quick and not left_out:
        peak, cpu_s = work.step("render 8192²", tuple[float, float], lambda: memory(8192))
        checks.append(at_most("render of 8192²: peak memory", peak, 8.0, "GiB"))
        rows.append(("domesim render, 8192² domemaster, one projector", cpu_s, peak, None))
        figures |= {"costs.render_8192.gib": peak, "costs.render_8192.cpu_s": cpu_s}
        found = work.step("paths a second", tuple[Rate, ...], lambda: tuple(rates()))
        apply = work.step("apply a transport", tuple[float, float, float], application)
        checks.append(at_most("adjoint of a tabulated transport, 4096²", apply[2], 1e-6))
        rows += [
            ("apply a tabulated transport, 4096²", apply[0], None, None),
            ("its adjoint", apply[1], None, None),
        ]
        tables.append(_rates(found))
        figures |= {
            f"costs.{rate.theatre}.{'aimed' if rate.aimed else 'plain'}": rate.paths
            for rate in found
        }
    return Finding(
        result=(
            f"On this machine the demo takes {show.seconds:.0f} s, and a {size}² frame "
            f"{job.seconds:.0f} s and {job.gib:.1f} GiB, most of it {frame['ffts']} FFTs of "
            f"planes. With other work running at the same time, seconds are longer."
        ),
        checks=tuple(checks),
        tables=(
            Table(
                caption="Whole commands, start to end.",
                columns=(
                    Column(name="job"),
                    Column(name="time", unit="s", digits=".1f"),
                    Column(name="peak memory", unit="GiB", digits=".1f"),
                    Column(name="FFTs of planes"),
                ),
                rows=tuple(rows),
            ),
            *tables,
        ),
        figures=figures,
        left_out=tuple(left_out),
    )


def _rates(found: tuple[Rate, ...]) -> Table:
    return Table(
        caption="Path tracing: walks a CPU-second. Aimed walks look for the picture's bright "
        "pixels: fewer, and each is worth more.",
        columns=(
            Column(name="theatre"),
            Column(name="walks"),
            Column(name="millions of paths a CPU-second", digits=".2f"),
        ),
        rows=tuple(
            (rate.theatre, "aimed" if rate.aimed else "plain", rate.paths) for rate in found
        ),
    )


def _measured(*arguments: str) -> Job:
    """Run a command; its peak memory is read from its own process, by a wrapper."""
    wrapper = (
        "import resource, subprocess, sys; "
        "done = subprocess.run([sys.executable, '-m', 'domesim', *sys.argv[1:]]); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(done.returncode)"
    )
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", wrapper, *arguments, "--json"],
        check=True,
        capture_output=True,
        text=True,
    )
    seconds = time.perf_counter() - started
    figures, _, peak = done.stdout.rstrip().rpartition("\n")
    return Job(seconds, int(peak) / 2**20, json.loads(figures))


def _write(path: Path, pixels: np.ndarray[Any, Any]) -> None:
    """A half-float EXR, as renderers write."""
    rows, cols, primaries = pixels.shape
    spec = oiio.ImageSpec(cols, rows, primaries, "half")
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(pixels)):
        raise OSError(oiio.geterror())
    output.close()
