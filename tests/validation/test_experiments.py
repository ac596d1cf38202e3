"""The experiments' claims, at sizes that take seconds."""

from __future__ import annotations

import json

import pytest

from compensate.solver.gpcg import GPCG
from domesim.errors import InputError
from validation.benchmarks.solvers import GAPS, Case, costs
from validation.cli import bench
from validation.experiment import Work, load_experiment


@pytest.mark.parametrize(
    "name",
    [
        "fig4_one_dimension",
        "fig9_dome",
        "table1",
        "gamma_coded",
        "channels_alone",
        "frozen_pollution",
        "chroma_floor",
    ],
)
def test_experiments_are_as_expected(name):
    """`convergence` and others are in test_mutations.py."""
    finding = load_experiment(name).run(Work(quick=True))
    assert [check for check in finding.checks if not check.passed] == []


@pytest.fixture(scope="module")
def cost_table():
    return {cost.solver: cost for cost in costs((96,), "dome_imax")}


def test_the_products_solver_needs_the_fewest_ffts(cost_table):
    """Counts, not seconds: regression gates with room for another machine's rounding."""
    admm = cost_table["ADMM (the product's)"]
    assert admm.ffts[GAPS.index(1e-3)] <= 140
    assert admm.final_gap < 1e-5
    assert admm.certified_gap >= admm.final_gap - 1e-6
    for name, cost in cost_table.items():
        if name.startswith("GPCG"):
            ffts = cost.ffts[GAPS.index(1e-3)]
            assert ffts is None or ffts > 2 * admm.ffts[GAPS.index(1e-3)]


def test_frozen_pollution_ends_above_the_minimum(cost_table):
    """Of the true cost, not of that with the frozen pollution."""
    frozen = cost_table["GPCG, frozen pollution (the paper's)"]
    assert frozen.final_gap > 1e-3
    assert cost_table["GPCG, exact pollution"].final_gap < 1e-5


def test_gpcg_is_counted_as_if_run_in_one_piece():
    case = Case(48, "dome_imax")
    trace = case.cost("gpcg", case.least())
    for seen in trace.seen[:3]:
        whole = GPCG(tolerance=1e-12, max_iterations=seen.iterations)(
            case.single.problem, case.single.subtractive
        )
        assert whole.ffts == seen.ffts + 6  # it ends with a gradient of three planes


@pytest.mark.parametrize("solver", ["admm", "gpcg", "frozen"])
def test_a_solver_stops_at_the_goal(solver):
    case = Case(48, "dome_imax")
    trace = case.cost(solver, case.least(), goal=1e-2)
    assert trace.final_gap <= 1e-2
    assert all(seen.gap > 1e-2 for seen in trace.seen[:-1])


def test_bench_writes_its_figures(tmp_path, capsys):
    bench(out=tmp_path / "b", scene="dome_imax", sizes="24", quiet=False, json=True)
    printed = json.loads(capsys.readouterr().out)["costs"]
    assert printed == json.loads((tmp_path / "b" / "bench.json").read_text())
    assert {cost["size"] for cost in printed} == {24}
    assert len(printed) == 5


def test_bench_speaks_to_people_too(tmp_path, capsys):
    bench(out=tmp_path, scene="dome_imax", sizes="16", quiet=False, json=False)
    assert "GPCG, frozen pollution (the paper's)" in capsys.readouterr().out


@pytest.mark.parametrize("sizes", ["0", "-5", "3", "64,x", ""])
def test_bench_refuses_impossible_sizes(tmp_path, sizes):
    with pytest.raises(InputError, match="--sizes"):
        bench(out=tmp_path, scene="dome_imax", sizes=sizes, quiet=False, json=False)
