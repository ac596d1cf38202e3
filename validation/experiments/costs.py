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
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from domesim.pathtrace.tracer import Settings, Tracer
from domesim.scene import load_dome
from testing.masters import night, write_exr
from testing.pairs import generated
from validation.benchmarks.commands import Job, run_command
from validation.experiment import Column, Finding, Missing, Table, Work, at_least, at_most, equal

_PAIRS = "stereo_polarised_paper"


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


def demo() -> Job:
    """``domesim demo``."""
    with tempfile.TemporaryDirectory() as folder:
        return run_command("demo", "--out", folder, "--json")


def render(size: int) -> Job:
    """``domesim render`` of a domemaster of `size`² pixels, two walks each."""
    with tempfile.TemporaryDirectory() as folder:
        return run_command(
            "render", "dome_hemisphere", "--quiet", "--out", f"{folder}/seen.exr",
            "--size", str(size), "--samples", "2", "--error", "9",
        )  # fmt: skip


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
    }
    left_out = []
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
    return Finding(
        result=(
            f"On this machine the demo takes {show.seconds:.0f} s, a generated {size}² frame "
            f"{job.seconds:.0f} s and {job.gib:.1f} GiB, and a colour pair {width} wide "
            f"{pair.seconds:.0f} s and {pair.gib:.1f} GiB, with {frame['ffts'] + both['ffts']} "
            f"FFTs. With other work "
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
        ),
        figures=figures,
        left_out=tuple(left_out),
    )
