"""The nearest light within bounds, in opponent channels, against SciPy's BVLS, pixel by pixel."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from compensate.fourier import Fourier
from compensate.solver.blocks import Spectra
from compensate.solver.boxes import Nearest
from compensate.solver.dome_hessian import DomeHessian
from compensate.solver.hessian import adapted_metric
from compensate.solver.level import by_rows
from compensate.solver.opponent_level import OpponentLevel
from compensate.weighting import linear_ycbcr

ROWS, COLS, PADDED = 6, 7, (8, 12)
WEIGHTS = [0.1, 0.7, 1.0]
MU = 0.03


def level(*, uneven: bool = False, offset: bool = False, seed: int = 0) -> OpponentLevel:
    random = np.random.default_rng(seed)
    fourier = Fourier(*PADDED)
    spread, collect = random.random((2, 1, *PADDED))
    core = np.einsum("pq,jk->pqjk", np.diag([0.1, 0.2, 0.3]), np.ones((1, 1)))
    squares = [random.random((PADDED[0], PADDED[1] // 2 + 1)) for _ in range(3)]
    hessian = DomeHessian(spread, collect, core, np.eye(3), squares, fourier)
    opponent = linear_ycbcr(np.array([0.2126, 0.7152, 0.0722]))
    light = random.random((2, 3, ROWS, COLS))
    # Some light is pinned, and some may only become brighter
    lower = -light[0] * (random.random((3, ROWS, COLS)) < 0.6)
    width = light[1] * (random.random((3, ROWS, COLS)) < 0.8)
    damping = MU * (1 + random.random(PADDED)) if uneven else MU
    spectra: Spectra = []
    return OpponentLevel(
        hessian,
        spectra,
        list(lower),
        list(width),
        damping,
        float(np.min(damping)) / np.linalg.norm(opponent, 2) ** 2,
        list(random.normal(size=(3, ROWS, COLS))) if offset else None,
        opponent=opponent,
    )


def wanted(posed: OpponentLevel, s: list, row: int, col: int) -> np.ndarray:
    """Of the least squares of T d - s and d - o, weighted."""
    m = posed.damping if isinstance(posed.damping, float) else posed.damping[row, col]
    o = np.zeros(3)
    if posed.offset is not None:
        o = np.array([plane[row, col] for plane in posed.offset])
    matrix = np.vstack([np.sqrt(WEIGHTS)[:, None] * posed.opponent, np.sqrt(m) * np.eye(3)])
    right = np.concatenate([np.sqrt(WEIGHTS) * [plane[row, col] for plane in s], np.sqrt(m) * o])
    lower = np.array([plane[row, col] for plane in posed.lower])
    upper = lower + [plane[row, col] for plane in posed.width]
    free = upper > lower
    result = lower.copy()
    if free.any():
        right = right - matrix[:, ~free] @ lower[~free]
        bounds = lower[free], upper[free]
        result[free] = lsq_linear(matrix[:, free], right, bounds, method="bvls", tol=1e-14).x
    return result


def compiled(monkeypatch, *modules):
    """The compiled loops in `modules` of the solver."""
    pytest.importorskip("numba")
    found = importlib.import_module("compensate.solver.compiled")
    for module in modules:
        monkeypatch.setattr(f"compensate.solver.{module}.loops", lambda *planes: found)


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("offset", [False, True])
@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("large", [False, True])
def test_it_is_the_best_light_of_each_pixel(uneven, offset, fast, large, monkeypatch):
    monkeypatch.setattr("compensate.solver.opponent_level.is_large", lambda plane: large)
    if fast:
        compiled(monkeypatch, "opponent_level")
    for seed in range(3):
        posed = level(uneven=uneven, offset=offset, seed=seed)
        s = list(np.random.default_rng(seed).normal(size=(3, *PADDED)))
        assert Nearest(posed, WEIGHTS).compiled == (not offset)
        found = posed.answer(s, WEIGHTS)
        for row, col in np.ndindex(ROWS, COLS):
            light = [plane[row, col] for plane in found]
            assert light == pytest.approx(wanted(posed, s, row, col), abs=1e-9)
        # What the x-step goes to has it as well: weight (2 T z - s), 0 for z on the padding
        towards = list(posed.towards(s, WEIGHTS))
        z = np.zeros((3, *PADDED))
        z[:, :ROWS, :COLS] = np.einsum("cp,prk->crk", posed.opponent, found)
        for plane, asked, channel, weight in zip(s, towards, z, WEIGHTS, strict=True):
            assert asked == pytest.approx(weight * (2 * channel - plane), abs=1e-9)
        # ... and the step from there
        w = list(np.random.default_rng(seed + 9).normal(size=(3, *PADDED)))
        after = [1.7 * (x - channel) for x, channel in zip(w, z, strict=True)]
        moved = [plane + step for plane, step in zip(s, after, strict=True)]
        if seed == 2:  # which it takes along
            list(posed.lower_bound(s, w, WEIGHTS))
        posed.move(s, w, WEIGHTS, 1.7)
        assert np.stack(w) == pytest.approx(np.stack(after), abs=1e-9)
        assert np.stack(s) == pytest.approx(np.stack(moved), abs=1e-9)


@pytest.mark.parametrize("primary", range(3))
def test_one_primary_out_of_bounds_takes_no_sweep(primary, monkeypatch):
    """Nor do pixels that the bounds leave nothing to choose."""
    monkeypatch.setattr(Nearest, "_sweep", lambda *_: pytest.fail("swept"))
    bounds = np.full((3, ROWS, COLS), -9.0), np.full((3, ROWS, COLS), 18.0)
    bounds[0][primary], bounds[1][primary] = -0.1, 0.2
    for bound in bounds:
        bound[:, :, 0] = 0
    posed = replace(level(), lower=list(bounds[0]), width=list(bounds[1]))
    s = list(np.random.default_rng(0).normal(size=(3, *PADDED)))
    found = posed.answer(s, WEIGHTS)
    for row, col in np.ndindex(ROWS, COLS):
        light = [plane[row, col] for plane in found]
        assert light == pytest.approx(wanted(posed, s, row, col), abs=1e-9)
    assert 0.2 < np.mean(np.isclose(np.abs(found[primary][:, 1:]), 0.1)) < 1


def test_another_penalty_scales_the_dual_alone():
    posed = level()
    s = list(np.random.default_rng(4).normal(size=(3, *PADDED)))
    before = np.stack(s)
    light, dual = posed.state(s, WEIGHTS)
    posed.reweigh(s, WEIGHTS, 2.0)
    assert np.stack(s) == pytest.approx(before + np.stack(dual), abs=1e-12)
    # Light and dual together are s again
    again = posed.of_state([by_rows(plane) for plane in light], dual)
    assert np.stack(again) == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("uneven", [False, True])
def test_compiled_lower_bounds_are_the_same(uneven, monkeypatch):
    random = np.random.default_rng(2)
    s, w = random.normal(size=(2, 3, *PADDED))
    found = []
    for _ in range(2):
        posed = level(uneven=uneven, seed=5)
        parts = list(posed.lower_bound(list(s.copy()), list(w.copy()), WEIGHTS))
        found.append((sum(known for known, _ in parts), np.stack([free for _, free in parts])))
        compiled(monkeypatch, "opponent_level")
    (known, free), (same, planes) = found
    assert same == pytest.approx(known, rel=1e-12)
    assert planes == pytest.approx(free, abs=1e-12)
    inside = free[:, :ROWS, :COLS]
    assert 0.05 < np.mean(inside != 0) < 0.95  # at bounds and not


def test_compiled_enlarging_is_the_same(monkeypatch):
    coarse, fine = level(seed=1), level(seed=2)
    random = np.random.default_rng(3)
    rows, cols = (side // 2 for side in PADDED)
    light = list(random.normal(size=(3, ROWS // 2, COLS // 2 + 1)))
    dual = random.normal(size=(3, rows, cols))
    sets = random.integers(0, 8, light[0].shape).astype(np.uint8)
    weights = [2 * WEIGHTS[0], 3 * WEIGHTS[1], 0.5 * WEIGHTS[2]]
    wanted = fine.of_coarser(light, list(dual), WEIGHTS, weights)
    compiled(monkeypatch, "opponent_level")
    monkeypatch.setattr(coarse, "_active", sets)
    fine.follow(coarse)
    found = fine.of_coarser(light, list(dual), WEIGHTS, weights)
    assert np.stack(found) == pytest.approx(np.stack(wanted), abs=1e-12)
    assert np.array_equal(fine.active, np.kron(sets, np.ones((2, 2), np.uint8))[:ROWS, :COLS])


@pytest.mark.parametrize(("fast", "modes"), [(False, 2), (False, 1), (True, 1)])
def test_the_hessian_of_channels_is_the_primaries(fast, modes, monkeypatch):
    """Solving in opponent channels what differs from primary to primary."""
    if fast:
        compiled(monkeypatch, "dome_hessian")
    random = np.random.default_rng(1)
    fourier, opponent = Fourier(*PADDED), linear_ycbcr(np.array([0.2, 0.7, 0.1]))
    spread, collect = random.random((2, modes, *PADDED))
    cores = 0.02 * random.random((3, modes, modes))
    squares = [random.random((PADDED[0], PADDED[1] // 2 + 1)) for _ in range(3)]
    primary = np.einsum("pq,pjk->pqjk", np.eye(3), cores)
    channel = np.einsum("cp,pjk,pd->cdjk", opponent, cores, np.linalg.inv(opponent))
    of_light = DomeHessian(spread, collect, primary, opponent, squares, fourier)
    of_channels = DomeHessian(spread, collect, channel, np.eye(3), squares, fourier)
    light = random.normal(size=(3, *PADDED))
    spectra = [fourier.forward(plane) for plane in light]
    planes = [fourier.forward(plane) for plane in np.einsum("cp,prk->crk", opponent, light)]
    assert of_channels.energy(planes) == pytest.approx(of_light.energy(spectra), rel=1e-12)
    # What is seen of light, its energy, and the gradient that it makes
    seen = [fourier.forward(plane) for plane in light]
    (one, primaries), (other, channels) = (
        hessian.seen([plane.copy() for plane in residual])
        for hessian, residual in ((of_light, seen), (of_channels, planes))
    )
    assert other == pytest.approx(one, rel=1e-12)
    turned = np.einsum("cp,crk->prk", opponent, np.stack(channels))
    assert turned == pytest.approx(np.stack(primaries), abs=1e-10)
    # (H + sigma)^-1 undoes H + sigma
    sigma = [0.1, 0.5, 2.0]
    asked = [plane.copy() for plane in planes]
    of_channels.multiply(asked)
    asked = [image + s * plane for image, s, plane in zip(asked, sigma, planes, strict=True)]
    of_channels.solve(asked, sigma)
    assert np.stack(asked) == pytest.approx(np.stack(planes), abs=1e-10)
    # T' H_channels T
    of_light.multiply(spectra)
    images = [plane.copy() for plane in planes]
    of_channels.multiply(images)
    turned = np.einsum("cp,crk->prk", opponent, np.stack(images))
    assert turned == pytest.approx(np.stack(spectra), abs=1e-10)


def test_the_penalty_is_as_large_as_what_is_seen():
    """The root of the lowest frequency's, but what the median and the limits say."""
    even, flat = np.full((16, 16), 0.5), np.ones((16, 16))
    unseen = np.full((16, 16), 1e-4)
    dark = even.copy()
    dark[0, 0] = 0.04
    assert adapted_metric([even, flat, dark]) == pytest.approx((0.5**0.5, 1.0, 0.2))
    even[0, 0] = 0.0
    unseen[0, 0] = 1.0
    assert adapted_metric([even, unseen]) == pytest.approx((0.1, 0.02))
    barely = np.full((16, 16), 0.01)
    barely[0, 0] = 1.0
    assert adapted_metric([barely]) == pytest.approx((0.05,))


def test_active_sets_of_another_step_lead_to_the_same_light(monkeypatch):
    """Steep weights: pinning and letting go by turns would go round in circles."""
    random = np.random.default_rng(0)
    for weights in ([0.03, 1.0, 0.002], [0.001, 0.3, 0.8]):
        shape = (200, 300)
        posed = replace(
            level(),
            lower=list(-random.random((3, *shape)) * (random.random((3, *shape)) < 0.7)),
            width=list(random.random((3, *shape)) * (random.random((3, *shape)) < 0.8)),
            damping=1e-4,
        )
        first, then = random.normal(size=(2, 3, *shape))
        by_sweeps = posed.answer(list(then), weights)
        with monkeypatch.context() as patch:
            compiled(patch, "opponent_level")
            posed.answer(list(first), weights)
            by_sets = posed.answer(list(then), weights)
        assert np.stack(by_sets) == pytest.approx(np.stack(by_sweeps), abs=1e-6)
