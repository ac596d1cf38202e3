"""Frozen pollution converges to a light that is not the minimiser.

Rationale
    The paper (section 3.4, eq. 9) keeps the pollution constant during an iteration of its solver
    and updates it afterwards. The gradient then lacks the pollution's part. Two numbers suffice to
    show it: an eye that should see 0.005 and one that should see 0.4, with crosstalk of 0.1, where
    the minimiser is known by hand (``validation/notes/0005``). Then domes, and stereo pairs with
    crosstalk of 1, 5 and 10 %, generated ones and, if there is time and it is there, a photograph.
Expected
    Of two numbers, the fixed point is (0, 0.4) and the minimiser (0, 0.396535): by hand, by SciPy
    and by the same solver with exact pollution. Its fixed point costs more than the minimum of the
    same objective, by more than 1e-4 of it in every theatre, and in pairs by more than 1e-5, the
    more the more crosstalk. Exact pollution reaches any accuracy. It is still better than the
    start.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from compensate.figures import Appraisal
from compensate.pose import Posed, pose
from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.weighting import CsfWeighting, PerceptualWeighting
from domesim.light import Light
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.scene import load_dome, load_stereo
from domesim.scene.stereo import SWEET_SPOT, Seat
from testing.masters import night
from testing.pairs import averaged, generated
from validation.data import from_data
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
    between,
)

THEATRES = ("dome_imax", "dome_planetarium", "dome_hemisphere")
STEREO = "stereo_polarised_paper"
CROSSTALK = (0.01, 0.05, 0.1)
PHOTOGRAPH = "motorcycle"
TRIAL = (1e-4, 2e-3, 8e-3)
"""Excess at these, in the trial that the design reports."""
EXAMPLE = (0.1, (0.005, 0.4))
"""Crosstalk, and what the two eyes should see."""


def measure(size: int = 256, scene: str = "dome_imax", seed: int = 0) -> dict[str, float]:
    """Relative excess cost of GPCG with frozen and exact pollution over the certified minimum."""
    posed = pose(night(size, seed).astype(np.float64), load_dome(scene), PerceptualWeighting())
    return {**_excesses(posed), "pollution_cd_m2": Appraisal(posed).pollution}


def measure_pair(pair: Light, crosstalk: float) -> dict[str, float]:
    """The same of a pair, seen with that much crosstalk and otherwise as in the paper's rig."""
    scene = load_stereo(STEREO)
    seats = {SWEET_SPOT: Seat(leak_matrices(crosstalk))}
    scene = replace(scene, seats=seats, chosen=(SWEET_SPOT,))
    return _excesses(pose(pair.astype(np.float64), scene, PerceptualWeighting()))


def two_numbers() -> dict[str, tuple[float, float]]:
    """What is projected of `EXAMPLE`: by hand, by SciPy's BVLS, and by GPCG, exact and frozen."""
    crosstalk, desired = EXAMPLE
    # The dark eye is clipped; the other one's least squares over x_R alone
    hand = (crosstalk * desired[0] + desired[1]) / (1 + crosstalk**2)
    matrix = np.array([[1, crosstalk], [crosstalk, 1]])
    bvls = lsq_linear(matrix, desired, (0, 1), method="bvls", tol=1e-14).x
    seen = np.array(desired).reshape(2, 1, 1, 1)
    weighting = CsfWeighting(
        np.ones((1, 2, 2)), np.eye(1), np.ones((1, 1), np.bool_), (2, 2), views=2
    )
    problem = Problem(Crosstalk(1, 1, leak_matrices(crosstalk, 1)), weighting, seen)
    exact, frozen = (
        GPCG(frozen=frozen, tolerance=1e-12)(problem, seen).light for frozen in (False, True)
    )
    return {
        "by hand": (0.0, hand),
        "SciPy's BVLS": (float(bvls[0]), float(bvls[1])),
        "GPCG, exact": (float(exact[0, 0, 0, 0]), float(exact[1, 0, 0, 0])),
        "GPCG, frozen (the paper's)": (float(frozen[0, 0, 0, 0]), float(frozen[1, 0, 0, 0])),
    }


def _excesses(posed: Posed) -> dict[str, float]:
    problem, start = posed.problem, posed.subtractive
    certified = ADMM(tolerance=1e-7, max_iterations=1500, stop_when_invisible=False)
    least = problem.cost(certified(problem, start).light)
    frozen = GPCG(frozen=True, tolerance=1e-5, max_iterations=60)(problem, start)
    exact = GPCG(tolerance=1e-5, max_iterations=120)(problem, start)
    return {
        "clipped": Appraisal(posed).clipped,
        "excess_frozen": problem.cost(frozen.light) / least - 1,
        "excess_exact": problem.cost(exact.light) / least - 1,
        "excess_subtractive": problem.cost(start) / least - 1,
    }


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    size, width = (96, 96) if work.quick else (256, 256)
    found = work.each(
        {f"{scene} {size}": scene for scene in THEATRES},
        dict[str, float],
        lambda scene: measure(size, scene, work.seed),
    )
    by_theatre = dict(zip(THEATRES, found.values(), strict=True))
    numbers = work.step("two numbers", dict[str, tuple[float, float]], two_numbers)
    pairs = {f"generated, {width} wide": generated(width, work.seed)}
    left_out: tuple[str, ...] = ()
    if work.quick:
        left_out = ("A photographed pair: it takes minutes.",)
    else:
        try:
            pairs[f"{PHOTOGRAPH}, halved"] = averaged(
                from_data(PHOTOGRAPH, load_stereo(STEREO))[0], 2
            )
        except Missing as missing:
            left_out = (f"A photographed pair: {missing}.",)
    by_pair = {
        name: work.each(
            {f"{name}, {crosstalk:.0%}": crosstalk for crosstalk in CROSSTALK},
            dict[str, float],
            lambda crosstalk, pair=pair: measure_pair(pair, crosstalk),  # type: ignore[misc]
        )
        for name, pair in pairs.items()
    }
    excesses = [one["excess_frozen"] for one in by_theatre.values()]
    stereo = [one["excess_frozen"] for one in next(iter(by_pair.values())).values()]
    frozen = numbers["GPCG, frozen (the paper's)"]
    return Finding(
        result=(
            f"The paper updates the pollution after each iteration of GPCG, and continues "
            f'"until convergence". It converges, but not to the minimum: it stays '
            f"{min(excesses):.1e} to {max(excesses):.1e} of the cost above in domes. With exact "
            f"pollution the same solver reaches the minimum.\n\n"
            f"Pairs, the paper's own application, lose less: {_listed(stereo)} at crosstalk of "
            f"{', '.join(f'{c:.0%}' for c in CROSSTALK)} (the design's trial, of other pictures: "
            f"{_listed(TRIAL)}). At the 1.1 % of a cinema's sweet spot the paper's "
            f"shortcut does no harm that anybody could see; exact pollution costs no more.\n\n"
            f"Two numbers show why. One eye should see {EXAMPLE[1][0]:g} and the other "
            f"{EXAMPLE[1][1]:g}, with crosstalk of {EXAMPLE[0]:g}: the dark eye's projector is at "
            f"0 and still too bright. Less light for the other eye would help it, to "
            f"{numbers['by hand'][1]:.6f}; with frozen pollution that help is not in the "
            f"gradient, and {frozen[1]:.6f} stays."
        ),
        checks=(
            *_checks(by_theatre),
            *_number_checks(numbers),
            *(check for name, one in by_pair.items() for check in _pair_checks(name, one)),
        ),
        tables=(_domes(by_theatre, size), _numbers(numbers), _pairs(by_pair)),
        figures={
            **{
                f"frozen_pollution.{name}.{kind}": one[f"excess_{kind}"]
                for name, one in by_theatre.items()
                for kind in ("frozen", "exact")
            },
            **{
                f"frozen_pollution.pair.{crosstalk:g}": excess
                for crosstalk, excess in zip(CROSSTALK, stereo, strict=True)
            },
        },
        left_out=left_out,
    )


def _listed(excesses: Iterable[float]) -> str:
    return ", ".join(f"{excess:.0e}" for excess in excesses)


def _domes(by_theatre: dict[str, dict[str, float]], size: int) -> Table:
    clipped = [one["clipped"] for one in by_theatre.values()]
    return Table(
        caption=(
            f"Domes: excess over the certified least cost; a generated night, {size}². Exact "
            f"subtraction clips only {min(clipped):.1%} to {max(clipped):.1%} of this "
            f"picture (of the bundled night in dome_imax about three quarters): an easy "
            f"problem."
        ),
        columns=(
            Column(name="theatre"),
            Column(name="pollution", unit="cd/m²"),
            Column(name="frozen (the paper's)", digits=".1e"),
            Column(name="exact", digits=".1e"),
            Column(name="subtraction, the start", digits=".1e"),
        ),
        rows=tuple(
            (
                name,
                one["pollution_cd_m2"],
                one["excess_frozen"],
                _excess(one["excess_exact"]),
                one["excess_subtractive"],
            )
            for name, one in by_theatre.items()
        ),
    )


def _numbers(numbers: Mapping[str, tuple[float, float]]) -> Table:
    crosstalk, desired = EXAMPLE
    return Table(
        caption=f"Two numbers: eyes that should see {desired[0]:g} and {desired[1]:g}, crosstalk "
        f"{crosstalk:g}. What is projected for each.",
        columns=(
            Column(name="by"),
            Column(name="left", digits=".6f"),
            Column(name="right", digits=".6f"),
            Column(name="sum of squared errors", digits=".7f"),
        ),
        rows=tuple(
            (
                name,
                left,
                right,
                (left + crosstalk * right - desired[0]) ** 2
                + (right + crosstalk * left - desired[1]) ** 2,
            )
            for name, (left, right) in numbers.items()
        ),
    )


def _pairs(by_pair: Mapping[str, Mapping[str, dict[str, float]]]) -> Table:
    return Table(
        caption="Stereo pairs in the paper's rig, with even crosstalk: excess over the certified "
        "least cost.",
        columns=(
            Column(name="pair, crosstalk"),
            Column(name="clipped by subtraction", unit="%", digits=".1f"),
            Column(name="frozen (the paper's)", digits=".1e"),
            Column(name="exact", digits=".1e"),
            Column(name="subtraction, the start", digits=".1e"),
        ),
        rows=tuple(
            (
                name,
                100 * one["clipped"],
                one["excess_frozen"],
                _excess(one["excess_exact"]),
                one["excess_subtractive"],
            )
            for found in by_pair.values()
            for name, one in found.items()
        ),
    )


def _excess(found: float) -> float | str:
    """The least cost is certified to 1e-7."""
    return found if abs(found) > 1e-7 else "0 (within 1e-7)"


def _checks(by_theatre: dict[str, dict[str, float]]) -> Iterator[Check]:
    for name, one in by_theatre.items():
        yield at_least(f"{name}: excess cost, frozen", one["excess_frozen"], 1e-4)
        yield between(f"{name}: excess cost, exact", one["excess_exact"], -1e-5, 1e-5)
        yield at_least(
            f"{name}: excess cost of the start over that of frozen",
            one["excess_subtractive"] / one["excess_frozen"],
            1,
        )


def _number_checks(numbers: Mapping[str, tuple[float, float]]) -> Iterator[Check]:
    hand = numbers["by hand"]
    for name in ("SciPy's BVLS", "GPCG, exact"):
        yield at_most(
            f"two numbers, {name}: distance from the minimiser by hand",
            float(np.abs(np.subtract(numbers[name], hand)).max()),
            1e-9,
        )
    yield at_most(
        "two numbers, frozen: distance from (0, 0.4)",
        float(np.abs(np.subtract(numbers["GPCG, frozen (the paper's)"], (0, EXAMPLE[1][1]))).max()),
        1e-9,
    )


def _pair_checks(name: str, found: Mapping[str, dict[str, float]]) -> Iterator[Check]:
    for what, one in found.items():
        yield at_least(f"{what}: excess cost, frozen", one["excess_frozen"], 1e-5)
        yield between(f"{what}: excess cost, exact", one["excess_exact"], -1e-5, 1e-5)
        yield at_least(
            f"{what}: excess cost of the start over that of frozen",
            one["excess_subtractive"] / one["excess_frozen"],
            1,
        )
    excesses = [one["excess_frozen"] for one in found.values()]
    yield at_least(
        f"{name}: excess over that with less crosstalk, the least",
        min(np.divide(excesses[1:], excesses[:-1])),
        1,
    )
