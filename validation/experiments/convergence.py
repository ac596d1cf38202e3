"""The product's solver finds the minimum, with the fewest FFTs to a gap of 1e-2 to 1e-4.

Rationale
    A solver can agree with itself and be wrong. At a size where the whole operator fits in a matrix
    that is written column by column, from what is seen and how it is weighted alone, two of SciPy's
    bounded least squares (BVLS, an active-set method, and a reflective trust region) know neither
    our adjoint nor our gradient. Pixels have unequal areas there, the lens an uneven gain, the
    primaries unequal albedos, so that a factor that is missing shows. The gradient is compared with
    central differences, and adjoints with <A x, y> = <x, A' y>, of the closed form and of a room
    by radiosity. At picture size five solvers start at exact subtraction of a generated night in
    the giant dome: ours, GPCG with exact pollution and with the paper's frozen one, and SciPy's
    L-BFGS-B and TNC (Nash's truncated Newton, in C, which adds one bound at a time). One FFT is one
    real transform of one plane.
Expected
    ADMM's light is the dense methods' within 1e-6 of white, GPCG's (which has no certificate to
    stop by) within 1e-4, both at the same cost within 1e-6 of it. Central differences agree
    within 1e-6, adjoints within 1e-12. Nobody finds less than the certified minimum; GPCG and
    L-BFGS-B come within 1e-3 of it; ours does so with the fewest FFTs, within 1e-4 in the end, and
    its certificate is true.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import clipped_subtraction
from compensate.solver.gpcg import GPCG
from compensate.weighting import PerceptualWeighting
from domesim.frames.colour import BT709_LUMINANCE
from domesim.light import Light, dot
from domesim.observation.base import AdjointObservation
from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import ClosedFormDome
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre
from domesim.room.viewing import Viewing
from testing.dense import dense
from validation.benchmarks.measuring import GAPS, Cost, Settings, least_cost, measure
from validation.benchmarks.problems import night_dome
from validation.benchmarks.solvers import OURS, SOLVERS
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    between,
)

Floats = NDArray[np.float64]

SCENE = "dome_imax"
OTHERS = ("gpcg", "frozen", "lbfgsb", "tnc")
SETTINGS = Settings(goal=1e-6, repeats=1)
ALBEDO = (0.7, 0.3, 0.55)
LENS = (0.6, -0.4, 0.9)
"""Where the projector of the small dome is, m."""


@dataclass(frozen=True)
class Truth:
    """Small problems against the dense truth.

    Attributes
    ----------
    values
        How many are free.
    clipped
        Share of them that are at a bound.
    spread
        Largest difference between the light of the two dense methods.
    light
        By solver: largest difference of its light from BVLS's.
    cost
        By solver: relative difference of its cost from BVLS's, as the matrix has it.
    gradient
        Largest difference of the gradient from central differences, over the largest gradient.
    """

    values: int
    clipped: float
    spread: float
    light: dict[str, float]
    cost: dict[str, float]
    gradient: float


def truth(size: int, seed: int) -> Truth:
    """A small dome's problem, by our solvers and by SciPy's dense ones."""
    problem, start = _small(size, seed)
    matrix, offset, free = dense(problem)
    lower, upper = (np.broadcast_to(b, free.shape)[free] for b in (problem.lower, problem.upper))
    q, r = np.linalg.qr(matrix)  # fewer rows, the same minimiser
    wanted, second = (
        lsq_linear(r, q.T @ offset, (lower, upper), method=method, tol=1e-14, max_iter=2000).x
        for method in ("bvls", "trf")
    )

    def cost(values: Floats) -> float:
        return float(0.5 * np.sum((matrix @ values - offset) ** 2))

    found = {
        "admm": ADMM(tolerance=1e-12, max_iterations=4000)(problem, start).light[free],
        "gpcg": GPCG(tolerance=1e-6, max_iterations=1000, max_cg_steps=60)(problem, start).light[
            free
        ],
    }
    return Truth(
        len(wanted),
        float(np.mean((wanted <= lower + 1e-12) | (wanted >= upper - 1e-12))),
        float(np.abs(second - wanted).max()),
        {name: float(np.abs(light - wanted).max()) for name, light in found.items()},
        {name: cost(light) / cost(wanted) - 1 for name, light in found.items()},
        _gradient_error(problem, seed),
    )


def _small(size: int, seed: int) -> tuple[Problem, Light]:
    """A dome that has everything unequal, and its exact subtraction."""
    random = np.random.default_rng(seed)
    observation = _closed_form(size)
    dark = 0.04 * random.random(observation.shape)
    bright = random.random((1, size, size, 1)) > 0.8
    master = (dark + bright * random.random(observation.shape)).clip(0, 1)
    on = observation.screen[None, :, :, None]
    bounds = (np.where(on, 0, master), np.where(on, 1, master))
    # So large that it holds frequencies on both sides of the most visible one
    viewing = Viewing(extent=2.0, image_area=4.0, distance=3.0, adaptation=1.4)
    weighting = PerceptualWeighting(padding=5)(viewing, BT709_LUMINANCE, observation.screen)
    seen = observation.direct(master)
    start, _ = clipped_subtraction(Problem(observation, weighting, seen, bounds))
    posed = Problem(observation, weighting, seen, bounds, anchor=start, regularisation=1e-3)
    return posed, start


def _closed_form(size: int) -> ClosedFormDome:
    dome = Dome(3.0, np.radians(105))
    return ClosedFormDome(
        dome,
        size,
        size,
        albedo=ALBEDO,
        lens_gain=dome.lens_gain(size, size, LENS),
        ambient=(0.01, 0.02, 0.03),
    )


def _gradient_error(problem: Problem, seed: int) -> float:
    """Largest relative error of the gradient; central differences of a quadratic are exact."""
    light = np.random.default_rng(seed).random(problem.desired.shape)
    differences = np.zeros_like(light)
    for index in np.ndindex(light.shape):
        above, below = light.copy(), light.copy()
        above[index] += 0.01
        below[index] -= 0.01
        differences[index] = (problem.cost(above) - problem.cost(below)) / 0.02
    gradient = problem.gradient(light)
    return float(np.abs(gradient - differences).max() / np.abs(differences).max())


def adjoints(size: int, seed: int) -> dict[str, float]:
    """|<A x, y> / <x, A' y> - 1| of each kind of observation."""
    dome = Dome(3.0, np.pi / 2)
    room = Theatre(dome, ALBEDO, floor=Floor(-0.4, 3.0, (0.2, 0.1, 0.3)))
    transport = radiosity(room, resolution=6)
    # A room's core is symmetric, which would hide a transposition that is missing
    skew = 1 + 0.3 * np.tri(transport.rank)
    tabulated = replace(transport, core=transport.core * skew).observation(
        size, size, lens_gain=dome.lens_gain(size, size, LENS), ambient=0.02
    )
    observations: Mapping[str, AdjointObservation] = {
        "closed form": _closed_form(size),
        "room by radiosity": tabulated,
        "the same with few modes": tabulated.low_rank(),
    }
    random = np.random.default_rng(seed)
    errors = {}
    for name, observation in observations.items():
        # Above 0, so that nothing cancels
        x, y = random.random((2, *observation.shape))
        across, back = dot(observation.linear(x), y), dot(x, observation.adjoint(y))
        errors[name] = abs(across / back - 1)
    return errors


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    sizes = (96,) if work.quick else (128, 256, 512)
    side = 7 if work.quick else 15
    small = work.step(f"dense {side}", Truth, lambda: truth(side, work.seed))
    errors = work.step("adjoints", dict[str, float], lambda: adjoints(15, work.seed))
    found = {size: _costs(work, size) for size in sizes}
    largest = max(sizes)
    clipped = {n: work.step(f"{n} clipped", float, _clipped(work, n)) for n in sizes}
    return Finding(
        result=_result(small, largest, found),
        checks=(
            *_small_checks(small, errors),
            *(check for size, costs in found.items() for check in _checks(size, costs)),
        ),
        tables=(_small_table(small), _table(found, clipped)),
        plots=tuple(_plot(size, costs) for size, costs in found.items()),
        figures={
            f"convergence.{size}.{name}.ffts_{label}": math.inf if ffts is None else ffts
            for size, costs in found.items()
            for name, cost in costs.items()
            for label, ffts in zip(("1e-2", "1e-3", "1e-4"), cost.ffts, strict=True)
        },
    )


def _clipped(work: Work, size: int) -> Callable[[], float]:
    return lambda: night_dome(size, SCENE, work.seed).single.clipped


def _costs(work: Work, size: int) -> dict[str, Cost]:
    case = night_dome(size, SCENE, work.seed)
    least = work.step(f"{size} least", float, lambda: least_cost(case)[0])
    return {
        name: work.step(
            f"{size} {name}", Cost, functools.partial(measure, case, name, least, SETTINGS)
        )
        for name in (OURS, *OTHERS)
    }


def _result(small: Truth, size: int, found: Mapping[int, Mapping[str, Cost]]) -> str:
    costs = found[size]
    levels = ", ".join(f"{one['frozen'].final_gap:.0e} ({n}²)" for n, one in found.items())

    def to(name: str) -> str:
        ffts = costs[name].ffts[GAPS.index(1e-3)]
        return "never" if ffts is None else f"{ffts}"

    return (
        f"Of {small.values} values, {small.clipped:.0%} of them at a bound, ADMM's differ from "
        f"those of SciPy's BVLS on the dense matrix by at most {small.light['admm']:.0e} of white, "
        f"GPCG's by {small.light['gpcg']:.0e}.\n\n"
        f"At {size}² ours needs {to('admm')} FFTs to a relative gap of 1e-3, GPCG with exact "
        f"pollution {to('gpcg')}, with the paper's frozen pollution {to('frozen')}, L-BFGS-B "
        f"{to('lbfgsb')}, TNC {to('tnc')}.\n\n"
        f'The paper: "performance and convergence is slow". It held for its solver, which needs '
        f"about {_ffts(costs['gpcg'], 1e-3) / _ffts(costs['admm'], 1e-3):.0f} times as many FFTs "
        f"as ours with exact pollution. Frozen pollution levels off above the minimum, "
        f"by {levels}; other sizes hold other pictures (Table 1). It need not be so."
    )


def _small_checks(small: Truth, errors: Mapping[str, float]) -> Iterator[Check]:
    yield between("share of values at a bound", small.clipped, 0.05, 0.95)
    yield at_most("light of the two dense methods, largest difference", small.spread, 1e-5)
    for name, bound in (("admm", 1e-6), ("gpcg", 1e-4)):
        title = SOLVERS[name].title
        yield at_most(f"{title}: light, from BVLS", small.light[name], bound)
        yield between(f"{title}: cost, from BVLS", small.cost[name], -1e-6, 1e-6)
    yield at_most("gradient, from central differences", small.gradient, 1e-6)
    for name, error in errors.items():
        yield at_most(f"adjoint of {name}", error, 1e-12)


def _checks(size: int, costs: Mapping[str, Cost]) -> Iterator[Check]:
    ours = costs["admm"]
    lowest = min(seen.gap for cost in costs.values() for seen in cost.seen)
    yield at_least(f"{size}²: lowest true gap of all solvers", lowest, -1e-5)
    yield at_most(f"{size}², {ours.solver}: true gap", ours.final_gap, 1e-4)
    for stop in ours.stops:
        assert stop.certified is not None
        assert stop.gap is not None
        yield at_least(
            f"{size}², {ours.solver}, to {stop.tolerance:.0e}: certified gap less the true one",
            stop.certified - stop.gap,
            -1e-6,
        )
    for name in ("gpcg", "lbfgsb"):
        yield at_most(f"{size}², {costs[name].solver}: true gap", costs[name].final_gap, 1e-3)
    for gap, bound in zip(GAPS, (1, 1.2, 1), strict=True):
        best = min(_ffts(costs[name], gap) for name in OTHERS)
        yield at_least(
            f"{size}²: FFTs to {gap:.0e}, the best other's over ours",
            best / _ffts(ours, gap),
            bound,
        )


def _ffts(cost: Cost, gap: float) -> float:
    ffts = cost.ffts[GAPS.index(gap)]
    return math.inf if ffts is None else ffts


def _small_table(small: Truth) -> Table:
    return Table(
        caption=f"Against BVLS on the dense matrix, {small.values} values.",
        columns=(
            Column(name="solver"),
            Column(name="light, largest difference", unit="white", digits=".1e"),
            Column(name="cost, relative difference", digits=".1e"),
        ),
        rows=tuple(
            (SOLVERS[name].title, small.light[name], small.cost[name]) for name in small.light
        ),
    )


def _table(found: Mapping[int, Mapping[str, Cost]], clipped: Mapping[int, float]) -> Table:
    rows = [
        (
            f"{size} × {size}",
            cost.solver,
            *cost.ffts,
            None if reached is None else reached.seconds,
            cost.final_gap,
            cost.stops[-1].certified if cost.stops else None,
        )
        for size, costs in found.items()
        for cost in costs.values()
        for reached in (cost.to(1e-3),)
    ]
    return Table(
        caption=(
            f"FFTs of a plane to a relative gap. Exact subtraction clips only "
            f"{', '.join(f'{share:.1%} (at {size}²)' for size, share in clipped.items())} of the "
            f"picture (of the bundled night about three quarters): easy problems. Seconds are of "
            f"this machine, and of SciPy's solvers in float64, with the work of its wrappers: only "
            f"counts compare."
        ),
        columns=(
            Column(name="resolution"),
            Column(name="solver"),
            *(Column(name=f"FFTs to {gap:.0e}") for gap in GAPS),
            Column(name="time to 1e-03", unit="s", digits=".2g"),
            Column(name="gap in the end", digits=".1e"),
            Column(name="certified when asked for 1e-04", digits=".1e"),
        ),
        rows=tuple(rows),
    )


def _plot(size: int, costs: Mapping[str, Cost]) -> Plot:
    floor = 1e-6

    def draw(axes: Any) -> None:
        for cost, marker in zip(costs.values(), "os^vD", strict=True):
            gaps = np.minimum.accumulate([seen.gap for seen in cost.seen])
            ffts = [seen.ffts for seen in cost.seen]
            axes.loglog(
                ffts,
                np.maximum(gaps, floor),
                marker=marker,
                markevery=max(1, len(ffts) // 10),
                label=cost.solver,
            )
        axes.axhline(1e-3, color="black", linewidth=0.8, linestyle=":")
        axes.set(xlabel="FFTs of a plane", ylabel="relative gap", ylim=(floor / 2, None))
        axes.legend(fontsize=8)

    return plot(
        f"True gap of the best light so far, {size}² ({floor:.0e} stands for all below).",
        f"Relative gap against FFTs of five solvers at {size}²: the product's falls first.",
        draw,
        (6.0, 4.2),
    )
