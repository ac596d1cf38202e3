"""Intervals of what is left hold what is left in rooms that may be the true one."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from foreseeing import held, left, night, posed_in

from compensate.figures import Appraisal
from domesim.observation.radiosity import radiosity
from domesim.room.theatre import Floor
from domesim.scene import DomeScene, load_scene
from domesim.scene.dome_file import MeasuredSection

SIZE = 32


def measured(errors: dict[str, float], correlation: float) -> MeasuredSection:
    """Relative standard errors of albedos of 0.5, of the screen, and 0.2."""
    names = tuple(errors)
    values = {name: 0.5 if name == "screen" else 0.2 for name in names}
    figures = 3 * len(names)
    correlations = np.full((figures, figures), correlation) + (1 - correlation) * np.eye(figures)
    return MeasuredSection(
        date="2026-11-22",
        survey="survey.toml",
        unit="camera",
        parameters=names,
        chi2=1.0,
        degrees_of_freedom=1,
        model_error=0.0,
        values={name: (values[name],) * 3 for name in names},
        standard_errors={name: (errors[name] * values[name],) * 3 for name in names},
        correlations={
            f"{primary} {name}": row
            for (primary, name), row in zip(
                product("RGB", names), map(tuple, correlations.tolist()), strict=True
            )
        },
        sha256={},
    )


def bare(albedo: tuple[float, float, float], error: float, correlation: float) -> DomeScene:
    scene = load_scene("dome_hemisphere")
    assert isinstance(scene, DomeScene)
    theatre = replace(scene.theatre, albedo=albedo, floor=None, wall=None)
    return replace(scene, theatre=theatre, measured=measured({"screen": error}, correlation))


@pytest.mark.parametrize(("lift", "correlation"), [(0.0, 0.95), (0.3, 0.0)])
def test_domes_by_their_albedos(lift, correlation):
    """Truths are drawn about what was found; the closed form has them exactly."""
    scene = bare((0.5, 0.5, 0.5), 0.02, correlation)
    posed = posed_in(scene, night(scene, SIZE, SIZE, lift=lift))
    found = Appraisal(posed).foreseen(posed.subtractive)
    rng = np.random.default_rng(1)
    assert scene.measured is not None
    covariance = scene.measured.covariance(["screen"])[0, :, 0]
    truths = rng.multivariate_normal(scene.albedo, covariance, 400)
    seen = [
        left(
            posed,
            posed.subtractive,
            bare(tuple(albedo), 0.02, 0).observation(SIZE, SIZE),
        )
        for albedo in truths
    ]
    light, error = ([one[k] for one in seen] for k in range(2))
    assert 0.92 < held([found.light] * len(light), light) < 0.98
    assert 0.92 < held([found.weighted] * len(error), error) < 0.98
    assert found.light.likely == pytest.approx(np.median(light), rel=0.1)
    assert found.weighted.likely == pytest.approx(np.median(error), rel=0.1)


def test_a_room_is_judged_by_all_of_it():
    """By the closed form a floor's light is left; that is foreseen, and it is most of what is."""
    scene = bare((0.5, 0.5, 0.5), 0.001, 0.5)
    theatre = replace(scene.theatre, floor=Floor(-1.5, scene.dome.radius, (0.2, 0.2, 0.2)))
    found = measured({"screen": 0.001, "floor": 0.004}, 0.5)
    scene = replace(scene, theatre=theatre, measured=found)
    posed = posed_in(scene, night(scene, SIZE, SIZE, lift=0.3))
    foreseen = Appraisal(posed).foreseen(posed.subtractive)
    room = replace(scene, transport=radiosity(theatre, resolution=6)).observation(SIZE, SIZE)
    light, error = left(posed, posed.subtractive, room)
    assert foreseen.light.likely == pytest.approx(light, rel=0.03)
    assert foreseen.weighted.likely == pytest.approx(error, rel=0.03)
    assert Appraisal(posed).visible_error(posed.subtractive) < 0.1 * error


def test_what_was_not_measured_is_not_foreseen():
    for name in ("dome_hemisphere", "stereo_cinema_silver"):
        scene = load_scene(name)
        assert scene.uncertain(SIZE, SIZE) is None


def test_domes_by_a_measured_transport():
    scene = bare((0.5, 0.4, 0.3), 0.01, 0.0)
    stored = radiosity(replace(scene.theatre, albedo=(0.5, 0.4, 0.3)), resolution=6)
    core_error = 0.03 * np.abs(stored.core[:, :1, :1]) * np.ones_like(stored.core)
    stored = replace(stored, core_error=core_error, provenance={"measured": "survey.toml"})
    scene = replace(scene, measured=None, transport=stored)
    posed = posed_in(scene, night(scene, SIZE, SIZE, lift=0.3))
    found = Appraisal(posed).foreseen(posed.subtractive)
    rng = np.random.default_rng(2)
    seen = []
    for _ in range(300):
        core = stored.core + core_error * rng.standard_normal(stored.core.shape)
        room = replace(stored, core=core).observation(
            SIZE, SIZE, ambient=scene.ambient / scene.projector.white
        )
        seen.append(left(posed, posed.subtractive, room))
    light, error = ([one[k] for one in seen] for k in range(2))
    assert 0.92 < held([found.light] * len(light), light) < 0.98
    assert 0.90 < held([found.weighted] * len(error), error) < 0.98
