"""What the main jobs cost: seconds and memory here, and work counts that hold on any machine.

Rationale
    A producer asks how long a frame takes and whether the machine is large enough. Seconds differ
    from machine to machine, so only memory and counts are checked; seconds are told. The default
    is exact subtraction of an aim, so no frame needs a Fourier transform.
Expected
    A 2048² frame is compensated within 3 GiB (quick: 1024², 1.5 GiB), a colour pair of 2048 x 1080
    within 4 GiB (quick: half as wide, 1.5 GiB), both without a single FFT. An 8192² domemaster of a
    theatre with one projector is path-traced within 8 GiB (full run only). Walks that are aimed at
    the picture's bright pixels give the same error as plain ones, with fewer of them.
    Told, not checked, for they are of seconds: of a sequence of colour pairs, what a further frame
    takes over reading and writing its files, one after the other.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from domesim.frames import read_master, write_master
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.scene import load_dome
from testing.masters import night, write_exr
from testing.pairs import generated
from validation.benchmarks.commands import Job, run_command
from validation.benchmarks.tracing import Rate, application, rates, render
from validation.experiment import Column, Finding, Missing, Table, Work, at_least, at_most, equal

FRAMES = 4
"""The first of a sequence."""
MORE = 12
"""Frames of the whole sequence: what they take more than `FRAMES` is the cost of further frames,
without the start."""

_PAIRS = "stereo_polarised_paper"


@final
@dataclass(frozen=True)
class Sequence:
    """What a sequence of pairs took, s.

    Attributes
    ----------
    seconds
        Seconds of its first `FRAMES`, from the first file to the last, with some seconds of the
        start.
    longer
        Seconds of all `MORE` frames, likewise.
    files
        Seconds of reading the masters and writing the results of `FRAMES`, one after the other.
    """

    seconds: float
    longer: float
    files: float

    @property
    def further(self) -> float:
        """Seconds of each further frame, without the start."""
        return (self.longer - self.seconds) / (MORE - FRAMES)

    @property
    def over_files(self) -> float:
        """The time of a further frame over that of reading and writing one."""
        return self.further * FRAMES / self.files


def compensation(size: int, seed: int) -> Job:
    """``domesim compensate`` of one generated frame of `size`² pixels."""
    with tempfile.TemporaryDirectory() as folder:
        master = Path(folder) / "night.exr"
        write_exr(master, night(size, seed)[0])
        return run_command(
            "compensate", str(master), "--scene", "dome_imax", "--out", f"{folder}/out", "--json"
        )


def deghosting(width: int, seed: int) -> Job:
    """``domesim compensate`` of one generated colour pair of width x 1080/2048 width pixels."""
    with tempfile.TemporaryDirectory() as folder:
        names = [f"{folder}/{eye}.exr" for eye in "LR"]
        for name, picture in zip(names, generated(width, seed), strict=True):
            write_exr(Path(name), picture[: width * 1080 // 2048])
        scene = ("--scene", _PAIRS, "--out", f"{folder}/out", "--json")
        return run_command("compensate", "--left", names[0], "--right", names[1], *scene)


def sequence(width: int, seed: int) -> Sequence:
    """Times a generated pair that moves and darkens."""
    light = generated(width, seed)[:, : width * 1080 // 2048]
    frames = [
        np.roll(light, k * width // 16, axis=2) * np.float32(1 - 0.1 * (k % FRAMES))
        for k in range(MORE)
    ]
    with tempfile.TemporaryDirectory() as folder:
        masters = [
            [Path(folder) / f"{eye}.{number:04}.exr" for eye in "LR"]
            for number in range(1, MORE + 1)
        ]
        for paths, pair in zip(masters, frames, strict=True):
            for path, picture in zip(paths, pair, strict=True):
                write_exr(path, picture)
        named = ("--left", f"{folder}/L.####.exr", "--right", f"{folder}/R.####.exr")
        out = Path(folder) / "out"

        def seconds(count: int) -> float:
            alone = ("--frames", f"1-{count}", "--workers", "0", "--pages", "0", "--anew", "--json")
            where = ("--scene", _PAIRS, "--out", str(out))
            total = run_command("compensate", *named, *where, *alone).figures["seconds_total"]
            return float(total)

        few, many = seconds(FRAMES), seconds(MORE)
        files = 0.0
        for paths in masters[:FRAMES]:
            results = [out / path.name for path in paths]
            result = read_master(results)
            began = time.perf_counter()
            read_master(paths)
            write_master(result, results)
            files += time.perf_counter() - began
    return Sequence(few, many, files)


def demo() -> Job:
    """``domesim demo``."""
    with tempfile.TemporaryDirectory() as folder:
        return run_command("demo", "--out", folder, "--json")


def aimed_gain(seed: int) -> float:
    """Walks that plain tracing needs over what aimed walks need; a night in dome_imax."""
    tracer = Tracer(load_dome("dome_imax").theatre)
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
    job = work.step(f"compensate {size}²", Job, lambda: compensation(size, work.seed))
    width = 1024 if work.quick else 2048
    pair = work.step(f"deghost {width}", Job, lambda: deghosting(width, work.seed))
    wide = 512 if work.quick else 2048
    film = work.step(f"sequence {wide}", Sequence, lambda: sequence(wide, work.seed))
    show = work.step("demo", Job, demo)
    frame, both = job.figures["frames"][0], pair.figures["frames"][0]
    checks = [
        at_most(f"compensate {size}²: peak memory", job.gib, 1.5 if work.quick else 3.0, "GiB"),
        equal(f"compensate {size}²: FFTs of planes", frame["ffts"], 0),
        at_most(f"a pair {width} wide: peak memory", pair.gib, 1.5 if work.quick else 4.0, "GiB"),
        equal(f"a pair {width} wide: FFTs of planes", both["ffts"], 0),
    ]
    rows: list[tuple[str | float | int | None, ...]] = [
        ("domesim demo", show.seconds, show.gib, None),
        (f"domesim compensate, {size}² EXR", job.seconds, job.gib, frame["ffts"]),
        (
            f"domesim compensate, a colour pair of {width} x {width * 1080 // 2048}",
            pair.seconds,
            pair.gib,
            both["ffts"],
        ),
    ]
    figures: dict[str, float] = {
        "costs.demo.seconds": show.seconds,
        "costs.compensate.seconds": job.seconds,
        "costs.compensate.gib": job.gib,
        "costs.compensate.ffts": frame["ffts"],
        "costs.deghost.seconds": pair.seconds,
        "costs.deghost.gib": pair.gib,
        "costs.deghost.ffts": both["ffts"],
        "costs.sequence.seconds": film.seconds,
        "costs.sequence.over_files": film.over_files,
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
        large = work.step("render 8192²", Job, lambda: render(8192))
        checks.append(at_most("render of 8192²: peak memory", large.gib, 8.0, "GiB"))
        rows.append(
            ("domesim render, 8192² domemaster, one projector", large.seconds, large.gib, None)
        )
        figures |= {"costs.render_8192.gib": large.gib, "costs.render_8192.cpu_s": large.cpu_s}
        found = work.step("paths a second", tuple[Rate, ...], lambda: tuple(rates()))
        apply = work.step("apply a transport", tuple[float, float, float], application)
        checks.append(at_most("adjoint of a tabulated transport, 4096²", apply[2], 1e-6))
        tables += [_rates(found), _application(apply)]
        figures |= {
            f"costs.{rate.theatre}.{'aimed' if rate.aimed else 'plain'}": rate.paths
            for rate in found
        }
    return Finding(
        result=(
            f"On this machine the demo takes {show.seconds:.0f} s, a generated {size}² frame "
            f"{job.seconds:.0f} s and {job.gib:.1f} GiB, and a colour pair {width} wide "
            f"{pair.seconds:.0f} s and {pair.gib:.1f} GiB, with {frame['ffts'] + both['ffts']} "
            f"FFTs. Of {MORE} pairs {wide} wide in a row, a further one takes "
            f"{film.over_files:.1f} times as long as reading and writing it. With other work "
            f"running at the same time, seconds are longer."
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
            _sequence(wide, film),
            *tables,
        ),
        figures=figures,
        left_out=tuple(left_out),
    )


def _sequence(width: int, film: Sequence) -> Table:
    return Table(
        caption=f"{FRAMES} colour pairs {width} wide, file to file, and {MORE}; and, one frame "
        f"after the other, reading and writing {FRAMES} alone.",
        columns=(
            Column(name=f"{FRAMES}", unit="s", digits=".2f"),
            Column(name=f"{MORE}", unit="s", digits=".2f"),
            Column(name="files alone", unit="s", digits=".2f"),
            Column(name="a further one over its files", digits=".1f"),
        ),
        rows=((film.seconds, film.longer, film.files, film.over_files),),
    )


def _application(apply: tuple[float, float, float]) -> Table:
    return Table(
        caption="A tabulated transport applied to a picture of 4096² pixels, float32.",
        columns=(Column(name=""), Column(name="time", unit="s", digits=".2f")),
        rows=(("observe", apply[0]), ("its adjoint", apply[1])),
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
