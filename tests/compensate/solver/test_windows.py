"""Rectangles alone: what is outside stays, inside is what pinning the rest would give."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pairs import COLOURED, share
from theatres import BT709

from compensate.fourier import padded_size
from compensate.pose import Posed, Stage
from compensate.problem import Problem
from compensate.solve import solved
from compensate.solver.admm import ADMM
from compensate.solver.baselines import clipped_subtraction
from compensate.solver.result import Result, Status
from compensate.solver.windows import Windows, joined
from compensate.visible import OnlyVisible
from compensate.weighting import PerceptualWeighting
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.spherical import ClosedFormDome
from domesim.room.dome import Dome
from domesim.room.viewing import Viewing
from domesim.scene import load_dome, load_stereo

ROWS, COLS = 120, 200
DENSITY = 20.0
BOX = (slice(40, 72), slice(60, 110))
SOLVER = ADMM(tolerance=1e-6, stop_when_invisible=False)
OBSERVATIONS = {
    "flat": lambda: Crosstalk(ROWS, COLS, leak_matrices(0.05), black=0.002),
    "3x3": lambda: Crosstalk(ROWS, COLS, COLOURED),
    "map": lambda: Crosstalk(ROWS, COLS, leak_matrices(0.05), share=share(ROWS, COLS)),
    "dome": lambda: ClosedFormDome(
        Dome(3.0, np.pi / 2), ROWS, ROWS, albedo=(0.3, 0.25, 0.2), ambient=(0.01, 0.0, 0.02)
    ),
}


def viewing() -> Viewing:
    return Viewing(extent=COLS / DENSITY, image_area=60.0, distance=3.0, adaptation=5.0)


def posed(case: str) -> tuple[Problem, np.ndarray]:
    """A dark picture with lights in the box: what they pollute, there, cannot all be subtracted."""
    observation = OBSERVATIONS[case]()
    views, rows, cols, _ = observation.shape
    random = np.random.default_rng(3)
    desired = np.full(observation.shape, 0.02) + 0.002 * random.random(observation.shape)
    row, col = np.mgrid[:rows, :cols]
    for view, at in enumerate((75, 95)[:views]):
        lamp = np.exp(-((row - 56) ** 2 + (col - at) ** 2) / 40)
        desired[view] += 0.9 * lamp[..., None] * (1, 0.9, 0.7)
    desired[:, 48:60, 66:104] *= 0.2
    screen = np.ones((rows, cols), bool)
    if case == "dome":
        screen = observation.screen
        desired[:, 20:100] *= 0.4
        desired[:, 5:20, 40:80] = 0.8  # far from the box, which it pollutes
    one = PerceptualWeighting()(viewing(), BT709, screen)
    weighting = one.with_importance(np.ones(views))
    on = screen[None, :, :, None]
    bounds = (np.where(on, 0, desired), np.where(on, 1, desired))
    plain = Problem(observation, weighting, observation.direct(desired), bounds)
    start, _ = clipped_subtraction(plain)
    problem = Problem(
        observation,
        weighting,
        plain.desired,
        bounds,
        anchor=start,
        regularisation=1e-4,
    )
    return problem, start


def pinned(problem: Problem, start: np.ndarray) -> Problem:
    """The whole problem, all but the box pinned."""
    inside = np.zeros(start.shape[1:3], bool)
    inside[BOX] = True
    free = inside[None, :, :, None]
    bounds = (np.where(free, problem.lower, start), np.where(free, problem.upper, start))
    return Problem(
        problem.observation,
        problem.weighting,
        problem.desired,
        bounds,
        anchor=problem.anchor,
        regularisation=problem.regularisation,
    )


@pytest.mark.parametrize("case", OBSERVATIONS)
def test_a_window_is_the_problem_with_the_rest_pinned(case: str) -> None:
    problem, start = posed(case)
    before, wanted = problem.cost(start), SOLVER(pinned(problem, start), start)
    found = Windows((BOX,), 10, SOLVER, overhead=0)(problem, start)
    gained = before - wanted.cost
    assert gained > 0.02 * before
    assert found.status is Status.WINDOWS
    # Half a degree around is enough; a dome's window does not see what it adds to other places
    cost = problem.cost(found.light)
    assert wanted.cost - 1e-6 * before <= cost < wanted.cost + 0.01 * gained
    outside = np.ones(start.shape[1:3], bool)
    outside[BOX] = False
    np.testing.assert_array_equal(found.light[:, outside], start[:, outside])
    assert np.all(found.light >= problem.lower)
    assert np.all(found.light <= problem.upper)


@pytest.mark.parametrize("top", [0, 3, 10, 40, ROWS - 42, ROWS - 32])
@pytest.mark.parametrize("left", [0, 7, 60, COLS - 50])
def test_a_window_has_no_more_padding_than_its_box_needs(top: int, left: int) -> None:
    """Transforms have no ends: across a plane's, too, nothing may be within reach of the box."""
    problem, start = posed("flat")
    box, reach, planes = (slice(top, top + 32), slice(left, left + 50)), 10, []

    def solver(part: Problem, start: np.ndarray) -> Result:
        planes.append((start.shape[1:3], part.weighting.padded))
        return ADMM()(part, start)

    Windows((box,), reach, solver, overhead=0)(problem, start)
    (around, padded), *rest = planes
    assert not rest
    for side, count, size, length in zip(box, (ROWS, COLS), around, padded, strict=True):
        before, after = min(side.start, reach), min(count - side.stop, reach)
        assert size == side.stop - side.start + before + after
        assert length - size + min(before, after) >= reach
        assert length == padded_size(side.stop - side.start + reach + max(before, after), 0)


def test_a_window_costs_what_its_area_does() -> None:
    problem, start = posed("flat")
    whole, fourier = SOLVER(problem, start), problem.weighting.fourier
    before = fourier.count
    found = Windows((BOX,), 10, SOLVER, overhead=0)(problem, start)
    area = (32 + 20 + 8) * (50 + 20 + 8) / (fourier.rows * fourier.cols)
    assert 0.5 * area * whole.ffts <= found.ffts <= 1.5 * area * whole.ffts
    assert found.ffts < 0.3 * whole.ffts
    # Shares of the whole picture's transforms
    assert found.ffts == math.ceil(fourier.count - before)
    assert found.cost is None  # which would take transforms of the whole


def test_what_is_no_less_work_is_solved_as_a_whole() -> None:
    problem, start = posed("flat")
    nearly_all = (slice(2, ROWS), slice(0, COLS - 3))
    found = Windows((nearly_all,), 10, ADMM(), overhead=0)(problem, start)
    whole = ADMM()(problem, start)
    np.testing.assert_array_equal(found.light, whole.light)
    assert found.gap == whole.gap


@pytest.mark.parametrize(("overhead", "status"), [(0, Status.WINDOWS), (10_000, Status.CONVERGED)])
def test_many_small_rectangles_are_solved_as_a_whole(overhead: int, status: Status) -> None:
    """Each window costs time whatever its size."""
    problem, start = posed("flat")
    boxes = tuple((slice(r, r + 4), slice(c, c + 4)) for r in (20, 90) for c in (20, 90, 160))
    found = Windows(boxes, 4, ADMM(), overhead=overhead)(problem, start)
    assert found.status is status


def test_without_rectangles_subtraction_stays() -> None:
    problem, start = posed("flat")
    found = Windows((), 10, ADMM())(problem, start)
    np.testing.assert_array_equal(found.light, start)
    assert found.ffts == 0


sides = st.tuples(st.integers(0, 60), st.integers(1, 30)).map(lambda s: slice(s[0], sum(s)))


@settings(deadline=None)
@given(st.lists(st.tuples(sides, sides), max_size=12), st.integers(0, 9), st.integers(0, 3000))
def test_joined_rectangles_hold_the_same_apart(
    boxes: list[tuple[slice, slice]], reach: int, overhead: int
) -> None:
    """And no two of them are less work as one."""
    before, after = np.zeros((90, 90), int), np.zeros((90, 90), int)
    for box in boxes:
        before[box] = 1
    together = joined(boxes, reach, overhead)
    for box in together:
        after[box] += 1
    assert after.max(initial=0) <= 1
    assert np.all(after >= before)

    def work(*boxes: tuple[slice, slice]) -> int:
        sides = [
            max(b[k].stop for b in boxes) - min(b[k].start for b in boxes) + 2 * reach
            for k in range(2)
        ]
        return math.prod(sides) + overhead

    for one, other in itertools.combinations(together, 2):
        assert work(one, other) > work(one) + work(other)


def frame(scene: str, density: float = DENSITY, *, rows: int = ROWS, cols: int = COLS) -> Posed:
    theatre = load_dome(scene) if scene.startswith("dome") else load_stereo(scene)
    theatre = replace(theatre, viewing=replace(theatre.viewing, extent=cols / density))
    views = theatre.views
    desired = np.full((views, rows if views == 2 else cols, cols, 3), 0.002, np.float32)
    for view, at in enumerate((60, 140)[:views]):
        desired[view, 50:60, at : at + 10] = 1
    return Stage(theatre).pose(desired)


def test_only_what_is_seen_is_solved() -> None:
    shown = frame("stereo_polarised_paper", rows=2 * ROWS, cols=2 * COLS)
    found = solved(shown, "perceptual", OnlyVisible(shown, ADMM()))
    assert found.status is Status.WINDOWS
    changed = np.any(found.light != shown.subtractive, axis=(0, 3))
    # Both eyes' lamps, what the eye averages around them, and a degree more
    far = np.ones((2 * ROWS, 2 * COLS), bool)
    far[50 - 32 : 60 + 32, 60 - 32 : 150 + 32] = False
    assert changed.any()
    assert not changed[far].any()
    whole = solved(shown, "perceptual", ADMM())
    before = shown.problem.cost(shown.subtractive)
    cost = shown.problem.cost(found.light)
    assert before - cost > 0.8 * (before - whole.cost)
    assert found.ffts < whole.ffts
