"""Eq. 7: errors count by how visible pollution is there, from the command line and from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from image_files import store

from compensate.pose import pose
from compensate.prediction import predict
from compensate.solve import solved
from compensate.solver.accelerated import Accelerated
from compensate.visible import PAPERS, SpatiallyWeighted
from compensate.weighting import Masked, PerceptualWeighting
from domesim.scene import load_scene


def pair() -> np.ndarray:
    """A bar that each eye sees elsewhere: one ghost on black, one on grey."""
    light = np.full((2, 36, 64, 3), 0.002, np.float32)
    light[:, :, 32:] = 0.3
    light[0, 8:28, 8:14] = 0.9
    light[1, 8:28, 18:24] = 0.9
    return light


def test_it_is_the_optimum_of_the_masked_problem() -> None:
    scene = load_scene("stereo_polarised_paper")
    posed = pose(pair(), scene, PerceptualWeighting())
    maps = predict(posed, settings=PAPERS).prediction
    assert 0 <= maps.min() < 0.1 < maps.max() <= 1
    found = SpatiallyWeighted(posed, Accelerated(1e-4))(posed.problem, posed.subtractive)
    masked = posed.problem.weighted_by(Masked(maps, posed.problem.weighting))
    _, gradient = masked.quadratic(found.light)
    _, before = masked.quadratic(posed.subtractive)
    assert masked.kkt_residual(found.light, gradient) <= 1e-3 * masked.kkt_residual(
        posed.subtractive, before
    )
    plain = solved(posed, "perceptual").light
    assert masked.cost(found.light) < 0.999 * masked.cost(plain)
    assert posed.problem.cost(found.light) > posed.problem.cost(plain)


def test_each_eye_has_its_own_map() -> None:
    scene = load_scene("stereo_polarised_paper")
    posed = pose(pair(), scene, PerceptualWeighting())
    weighting = posed.problem.weighting
    maps = np.zeros((2, 36, 64))
    maps[1] = 1
    residual = np.ones((2, 36, 64, 3), np.float32)
    weighted = Masked(maps, weighting).apply(residual)
    assert np.abs(weighted[0, :, :36, :64]).max() == 0
    np.testing.assert_array_equal(weighted[1], weighting.apply(residual)[1])


@pytest.mark.parametrize("method", ["perceptual", pytest.param("paper", marks=pytest.mark.long)])
def test_the_command_line_reaches_it(run, tmp_path: Path, method: str) -> None:
    for eye, light in zip("lr", pair()[:, ::2, ::2], strict=True):
        store(tmp_path / f"{eye}.exr", light)
    given = ["compensate", "--left", str(tmp_path / "l.exr"), "--right", str(tmp_path / "r.exr")]
    given += ["--scene", "stereo_polarised_paper", "--weighting", "paper", "--method", method]
    results = []
    for extra in ([], ["--spatial-weights"]):
        out = tmp_path / f"out{len(extra)}"
        code, _, err = run(*given, *extra, "--out", str(out))
        assert code == 0, err
        results.append((out / "l.exr").read_bytes())
    assert results[0] != results[1]
