"""PyTorch from end to end: light comes back in it, equals NumPy's, and has slopes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from compensate import compensate
from compensate.own import own_problem
from compensate.plain import PlainRuler
from compensate.problem import Problem
from compensate.ruler import Ruler
from compensate.solver.gpcg import GPCG
from domesim import load_scene, observe
from domesim.errors import InputError
from domesim.observation.linear import LinearObservation

torch = pytest.importorskip("torch")

SIZE = 48
RNG = np.random.default_rng(5)
LIGHT = np.full((1, SIZE, SIZE, 3), 0.02) + 0.02 * RNG.random((1, SIZE, SIZE, 3))
LIGHT[:, 12:20, 14:22] = 0.7, 0.8, 0.6
PAIR = np.concatenate([LIGHT, np.roll(LIGHT, 3, axis=2)])
SCENES = {
    "dome_planetarium": LIGHT,
    "dome_stereo_polarised": PAIR,
    "stereo_shutter": PAIR[:, :27],
    "cinema_2d": LIGHT[:, :27],
}
WITHIN = {"float32": 1e-6, "float64": 1e-12}
"""Of white."""


def of_torch(light, precision):
    return torch.asarray(light, dtype=getattr(torch, precision))


@pytest.mark.parametrize("precision", WITHIN)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("function", [observe, lambda light, scene: compensate(light, scene).light])
def test_what_comes_in_as_torch_goes_out_as_torch(function, name, precision):
    light = SCENES[name].astype(precision)
    there = of_torch(light, precision)
    found, expected = function(there, name), function(light, name)
    assert found.dtype == there.dtype
    assert found.device == there.device
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=WITHIN[precision])


@pytest.mark.parametrize("precision", WITHIN)
@pytest.mark.parametrize("seat", [None, "front"])
def test_rulers_take_torch(precision, seat):
    scene = load_scene("dome_planetarium").asked(None, seat)
    screen, seen = scene.screen(SIZE, SIZE), LIGHT + 0.05
    there = of_torch(LIGHT, precision), of_torch(seen, precision)
    ruler = Ruler(there[0], scene, screen)
    loss = ruler.loss(there[1])
    assert loss.dtype == there[1].dtype
    expected = Ruler(LIGHT, scene, screen).lost(seen)
    assert expected > 0.1
    assert float(loss) == pytest.approx(expected, abs=1e-5)
    assert ruler.lost(there[1]) == float(loss)
    np.testing.assert_allclose(
        ruler.lost_map(there[1]), Ruler(LIGHT, scene, screen).lost_map(seen), atol=1e-4
    )
    light, more = LIGHT.astype(precision), seen.astype(precision)
    plain = PlainRuler(light, scene, screen).figures(more, 0.1)
    assert PlainRuler(there[0], scene, screen).figures(there[1], 0.1) == plain
    with pytest.raises(InputError):
        ruler.loss(there[1][:, 1:])


@pytest.mark.parametrize("name", [*SCENES, "seat"])
def test_slopes_are_those_of_differences(name):
    """Of what is seen, weighted by noise, and of the ruler, along noise."""
    scene = load_scene("dome_planetarium" if name == "seat" else name)
    if name == "seat":
        scene = scene.asked(None, "front")
    light = SCENES.get(name, LIGHT)
    screen = scene.screen(*light.shape[1:3])
    ruler = Ruler(light, scene, screen)
    weights, way = (of_torch(RNG.standard_normal(light.shape), "float64") for _ in range(2))
    for figure in (
        lambda x: torch.sum(weights * observe(x, scene)),
        lambda x: ruler.loss(observe(x, scene)),
    ):
        at = of_torch(light, "float64").requires_grad_()
        figure(at).backward()
        slope = float(torch.sum(at.grad * way))
        step = 1e-8
        ahead, behind = (float(figure(at.detach() + sign * step * way)) for sign in (1, -1))
        assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-6, abs=1e-7)
        assert slope != 0
    exact = of_torch(light, "float64").requires_grad_()
    ruler.loss(exact).backward()  # where nothing differs it has no kink that is not a number
    assert bool(torch.isfinite(exact.grad).all())
    assert ruler.lost(exact) == pytest.approx(0, abs=1e-12)


def test_own_maps_and_gpcg_take_torch():
    scene, shape = load_scene("dome_hemisphere"), (1, 12, 12, 3)
    light = LIGHT[:, 10:22, 10:22]
    matrix = np.eye(432) + np.full((432, 432), 3e-4)
    own = LinearObservation.of_matrix(shape, matrix)
    sparse = LinearObservation.of_matrix(shape, scipy.sparse.csr_array(matrix))
    there = of_torch(light, "float64")
    for observation in (own, sparse):
        np.testing.assert_allclose(observation.observe(there).numpy(), own.observe(light))
        np.testing.assert_allclose(observation.adjoint(there).numpy(), own.adjoint(light))
    problem = own_problem(light, scene, own)
    weighting = problem.weighting
    same = Problem(
        own,
        weighting,
        of_torch(problem.desired, "float64"),
        tuple(of_torch(bound, "float64") for bound in (problem.lower, problem.upper)),
        anchor=of_torch(problem.anchor, "float64"),
        regularisation=problem.regularisation,
    )
    found = GPCG(tolerance=1e-6)(same, of_torch(light, "float64"))
    expected = GPCG(tolerance=1e-6)(problem, light)
    np.testing.assert_allclose(found.light.numpy(), expected.light, atol=1e-6)
    assert np.abs(expected.light - light).max() > 1e-3
