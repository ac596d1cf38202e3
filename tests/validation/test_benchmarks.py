"""The benchmark counts what is done, and the product's solver needs the fewest FFTs.

Counts, not seconds: gates with room for another machine's rounding.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from compensate.fourier import Fourier, transforms
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.solver.result import Status
from domesim.errors import InputError
from validation.benchmarks import copying, files, measuring, recording
from validation.benchmarks.commands import Job
from validation.benchmarks.measuring import (
    Settings,
    least_cost,
    measure,
    traced,
)
from validation.benchmarks.problems import PROBLEMS, Case, night_dome
from validation.benchmarks.recording import Seen
from validation.benchmarks.solvers import OURS, SOLVERS
from validation.cli import bench
from validation.experiment import Missing

EVALUATORS = ("gpcg", "frozen", "accelerated", "lbfgsb")


@pytest.fixture(scope="module")
def synthetic() -> tuple[Case, float]:
    case = PROBLEMS["synthetic"][1](256)
    return case, least_cost(case, 1e-6)[0]


@pytest.fixture(scope="module")
def found(synthetic) -> dict[str, tuple[Seen, ...]]:
    case, least = synthetic
    return {name: traced(case, name, least, 1e-4, budget=250) for name in (OURS, *EVALUATORS)}


def to(seen: tuple[Seen, ...], gap: float) -> float:
    return next((one.ffts for one in seen if one.gap <= gap), math.inf)


@pytest.mark.parametrize("name", [OURS, *EVALUATORS])
def test_what_is_counted_is_what_is_done(name, monkeypatch):
    """Against a count of the transforms' calls; those of the truth are left out."""
    case = PROBLEMS["synthetic"][1](64)
    least = least_cost(case, 1e-4)[0]
    task = case.double if SOLVERS[name].double else case.single
    fourier, library = task.problem.weighting.fourier, transforms()
    done, truth = 0.0, measuring.Truth.gap

    def counting(transform):
        def counted(planes, *arguments, **options):
            nonlocal done
            rows, cols = planes.shape[-2:]
            size = options.get("s", (rows, options.get("n", cols)))
            planes_worth = math.prod(size) / (fourier.rows * fourier.cols)
            done += math.prod(planes.shape[:-2]) * planes_worth
            return transform(planes, *arguments, **options)

        return counted

    def unseen(self, light):
        nonlocal done
        before = done
        gap = truth(self, light)
        assert done == before + task.planes
        done = before
        return gap

    for transform in ("rfft2", "irfft2", "irfft"):  # the last after a complex one, for a plane
        monkeypatch.setattr(library, transform, counting(getattr(library, transform)))
    monkeypatch.setattr(measuring.Truth, "gap", unseen)
    seen = traced(case, name, least, 1e-3)
    assert seen[-1].ffts == math.ceil(done) > 0
    assert [one.ffts for one in seen] == sorted(one.ffts for one in seen)


def test_ours_needs_the_fewest_ffts(found):
    ours = found[OURS]
    assert to(ours, 1e-3) <= 64
    assert to(ours, 1e-4) <= 100
    assert to(found["gpcg"], 1e-3) >= 2.8 * to(ours, 1e-3)
    assert to(found["accelerated"], 1e-3) >= 2.4 * to(ours, 1e-3)
    assert to(found["lbfgsb"], 1e-3) >= 1.2 * to(ours, 1e-3)


# FFTs to a certified 1e-3 and 1e-4, 256 pixels wide, and a twentieth more
STOPS = {
    "dome": (43, 43),
    "dome-rgb": (125, 161),
    "synthetic": (57, 82),
    "synthetic-rgb": (246, 321),
}


@pytest.mark.parametrize("name", STOPS)
def test_ours_stops_as_soon_as_it_can_be_certified(name):
    task = PROBLEMS[name][1](256).single
    for tolerance, most in zip((1e-3, 1e-4), STOPS[name], strict=True):
        solver = ADMM(tolerance=tolerance, stop_when_invisible=False)
        found = solver(task.problem, task.start)
        assert found.status is Status.CONVERGED
        assert found.ffts <= most


def test_nobody_finds_less_than_the_least(found):
    assert min(one.gap for seen in found.values() for one in seen) > -1e-6


def test_a_solver_is_stopped_at_the_goal(synthetic):
    case, least = synthetic
    for name in (OURS, "gpcg"):
        seen = traced(case, name, least, 1e-2)
        assert seen[-1].gap <= 1e-2
        assert all(one.gap > 1e-2 for one in seen[:-1])


def test_a_solver_is_stopped_when_its_budget_is_used_up(synthetic):
    case, least = synthetic
    seen = traced(case, "accelerated", least, 0.0, budget=20)
    assert seen[-1].ffts == 20 * 2


def test_looking_for_gaps_takes_no_time(synthetic, monkeypatch):
    """Of clocks that tick once a transform, also of the truth's, the solver's alone."""
    case, least = synthetic
    tasks = (case.single, case.double)
    counts = [task.problem.weighting.fourier for task in tasks]
    monkeypatch.setattr(recording.time, "perf_counter", lambda: sum(one.count for one in counts))
    for name in (OURS, "gpcg", "accelerated"):
        seen = traced(case, name, least, 1e-2)
        assert [math.ceil(one.seconds) for one in seen] == [one.ffts for one in seen]


def test_gpcg_is_watched_without_being_changed():
    case = night_dome(48)
    least = least_cost(case)[0]
    seen = traced(case, "gpcg", least, 1e-3)
    task = case.single
    whole = GPCG(tolerance=1e-12, max_iterations=seen[-1].iterations)(task.problem, task.start)
    assert seen[-1].ffts <= whole.ffts
    assert whole.cost <= (1 + seen[-1].gap + 1e-5) * least


def test_ours_runs_to_its_own_stop_with_a_true_certificate(synthetic):
    case, least = synthetic
    cost = measure(case, OURS, least, Settings(repeats=1))
    assert [stop.tolerance for stop in cost.stops] == [1e-3, 1e-4]
    for stop in cost.stops:
        assert stop.gap - 1e-6 <= stop.certified <= stop.tolerance
        assert stop.certified <= 20 * stop.gap
        assert stop.ffts > next(n for n in cost.ffts if n is not None)
    assert cost.clipped > 0.01


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_are_what_they_say(name):
    try:
        case = PROBLEMS[name][1](64)
    except Missing as missing:
        pytest.skip(str(missing))
    single, double = case.single, case.double
    assert single.start.dtype == single.problem.desired.dtype == np.float32
    assert double.start.dtype == double.problem.desired.dtype == np.float64
    rows = 64 if name in ("dome-rgb", "dome-3d-rgb") else 34
    assert single.start.shape[1:3] == (rows, 64)
    views = 1 if name in ("dome", "dome-rgb") else 2
    assert single.planes == views * (3 if "rgb" in name else 1)
    assert 0.005 < single.clipped < 0.9
    assert np.array_equal(double.problem.project(double.start), double.start)
    assert single.problem.cost(single.start) == pytest.approx(
        double.problem.cost(double.start), rel=1e-3
    )
    assert isinstance(single.problem.weighting.fourier, Fourier)


def test_bench_writes_its_figures(tmp_path, capsys):
    out = tmp_path / "b"
    bench(
        out=out, problems="dome,synthetic", sizes="32,48", solvers="admm,accelerated",
        quick=True, quiet=False, json=True,
    )  # fmt: skip
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "bench.json").read_text())
    assert len(printed["costs"]) == 8
    assert {cost["failure"] for cost in printed["costs"]} == {""}


@pytest.mark.parametrize(
    ("option", "given"),
    [
        ("sizes", "3"),
        ("sizes", "64,x"),
        ("problems", "domes"),
        ("solvers", "simplex"),
    ],
)
def test_bench_refuses_what_it_does_not_know(tmp_path, option, given):
    options = {"problems": "dome", "sizes": "16", "solvers": "gpcg", option: given}
    with pytest.raises(InputError, match=f"--{option}"):
        bench(out=tmp_path, **options, quick=True, quiet=False, json=False)


def test_a_further_frame_is_what_a_longer_sequence_takes_more(tmp_path, monkeypatch):
    slower = iter((1, 1, 3, 3, 2, 2))  # of three rounds, of which the middle one counts

    def ran(_files, _folder, *options):
        count, times = int(options[options.index("--frames") + 1].split("-")[1]), next(slower)
        return Job(
            seconds=2 + 0.25 * count * times, cpu_s=3 + 0.375 * count * times, gib=1.5, figures={}
        )

    monkeypatch.setattr(files, "_command", ran)
    monkeypatch.setattr(files, "cores", lambda: 2)
    copies = iter((0.25, 0.25, 0.25, 0.5, 1.0, 1.0, 1.0))
    monkeypatch.setattr(files, "copied", lambda files, at_once, folder: (0.0, next(copies)))
    further = files._further("dome", [tmp_path / "dome.0001.exr"], tmp_path, 3)
    assert further.seconds == pytest.approx(0.5)
    assert further.cpu_s == pytest.approx(0.75)
    assert further.busy == pytest.approx(0.75)
    assert further.copies == pytest.approx(1.5)


def test_copies_want_workers_and_oiiotool(tmp_path, monkeypatch):
    how = {"out": tmp_path, "files": True, "quick": True, "quiet": True, "json": False}
    with pytest.raises(InputError, match="--workers"):
        bench(workers="two", **how)
    monkeypatch.setattr(copying, "OIIOTOOL", tmp_path / "oiiotool")
    with pytest.raises(InputError, match="oiiotool"):
        bench(workers="1", **how)
