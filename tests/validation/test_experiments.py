"""The experiments' claims, at sizes that take seconds."""

from __future__ import annotations

import json

import pytest

from domesim.errors import InputError
from validation.benchmarks.solvers import GAPS, costs
from validation.cli import bench
from validation.experiments import channels_alone, chroma_floor, frozen_pollution, gamma_coded


def test_frozen_pollution_stays_above_the_minimum():
    found = frozen_pollution.measure(96, "dome_hemisphere")
    assert found["excess_frozen"] > 1e-4
    assert abs(found["excess_exact"]) < 1e-5
    assert found["excess_subtractive"] > found["excess_frozen"]


def test_channels_alone_leave_the_gamut():
    found = channels_alone.measure(96)
    assert found["out_of_gamut"] > 1e-3
    assert found["excess_clipped"] > 1e-3


def test_gamma_coded_values_do_not_add_up():
    found = gamma_coded.measure(96)
    assert found["error_linear"] < found["error_subtractive"] < found["error_nothing"]
    assert found["error_gamma_coded"] > 2 * found["error_subtractive"]


def test_a_floor_for_chroma_keeps_the_hue():
    found = chroma_floor.measure(step=4)
    assert found["chroma_floor_1"] < 0.5 * found["one_policy"]
    assert found["chroma_floor_1"] < 0.5 * found["subtractive"]


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


def test_bench_writes_its_figures(tmp_path, capsys):
    bench(out=tmp_path / "b", scene="dome_imax", sizes="24", quiet=False, json=True)
    printed = json.loads(capsys.readouterr().out)["costs"]
    assert printed == json.loads((tmp_path / "b" / "bench.json").read_text())
    assert {cost["size"] for cost in printed} == {24}
    assert len(printed) == 4


def test_bench_speaks_to_people_too(tmp_path, capsys):
    bench(out=tmp_path, scene="dome_imax", sizes="16", quiet=False, json=False)
    assert "GPCG, frozen pollution (the paper's)" in capsys.readouterr().out


@pytest.mark.parametrize("sizes", ["0", "-5", "3", "64,x", ""])
def test_bench_refuses_impossible_sizes(tmp_path, sizes):
    with pytest.raises(InputError, match="--sizes"):
        bench(out=tmp_path, scene="dome_imax", sizes=sizes, quiet=False, json=False)
