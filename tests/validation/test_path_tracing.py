"""The path tracer's claims, at accuracies that take seconds; experiments reach further."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from domesim.pathtrace.loop import bounce_limit
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from testing.statistics import assert_unbiased
from validation import reflection
from validation.experiments import corrected_models, second_opinion


def sweep(half_angles, albedos, picture="white"):
    return [
        reflection.measure(half_angle, albedo, error=1e-3, picture=picture, seed=100 * number)
        for number, (half_angle, albedo) in enumerate(product(half_angles, albedos))
    ]


CELLS = (90, 150), (0.5, 0.8)
"""Half angles and albedos that suffice to see a bias."""
MANY = (30, 90, 150, 180), (0.1, 0.5, 0.9)


@pytest.mark.parametrize(
    ("cells", "picture"),
    [
        (CELLS, "patch"),
        pytest.param(MANY, "patch", marks=pytest.mark.long),
        pytest.param(MANY, "white", marks=pytest.mark.long),
    ],
)
def test_bare_caps_follow_the_closed_form(cells, picture):
    cells = sweep(*cells, picture=picture)
    assert_unbiased(
        [one.found for one in cells], [one.error for one in cells], [one.truth for one in cells]
    )
    assert max(one.error / one.truth for one in cells) < 2e-3


@pytest.mark.long
def test_each_bounce_keeps_the_same_share():
    cells = sweep((45, 105, 180), (0.2, 0.8))
    scores = np.array([one.ratio_z for one in cells])
    assert scores.shape == (6, reflection.BOUNCES)
    assert_unbiased(scores, 1.0, 0.0)


@pytest.mark.long
def test_a_biased_tracer_would_be_noticed(monkeypatch):
    """Albedos that are 0.5 % too high: the sweep's accuracy suffices to see it."""
    honest = Theatre.screen_albedo.fget
    monkeypatch.setattr(
        Theatre,
        "screen_albedo",
        property(lambda theatre: tuple(1.005 * x for x in honest(theatre))),
    )
    cells = sweep(*CELLS)
    with pytest.raises(AssertionError, match="biased"):
        assert_unbiased(
            [one.found for one in cells], [one.error for one in cells], [one.truth for one in cells]
        )


@pytest.mark.parametrize(
    ("theatre", "pictures", "error", "allowed"),
    [
        pytest.param("recessed floor", ("white", "patch"), 5e-4, 1e-3, marks=pytest.mark.long),
        pytest.param(
            "floor at the spring line", ("white", "patch"), 1e-3, 5e-3, marks=pytest.mark.long
        ),
        pytest.param("gain lobe of share 0.3", ("white",), 3e-3, 5e-3, marks=pytest.mark.long),
    ],
)
def test_tabulated_transport_is_what_brute_force_finds(theatre, pictures, error, allowed):
    found = corrected_models.measure(theatre, errors=(error,), brute_force=0.01, pictures=pictures)
    tabulated = [one for one in found if one.model.startswith(corrected_models.TABULATED)]
    assert [one.picture for one in tabulated] == list(pictures)
    for one in tabulated:
        assert one.claimed <= error
        assert one.noise < 2.5e-3
        assert one.rms < np.hypot(allowed, one.noise)


def test_form_factors_of_discs():
    """Howell's catalogue, C-41: equal discs one radius apart; one near a huge one."""
    between = corrected_models._between_discs
    assert between(1, 1, 1) == pytest.approx((3 - np.sqrt(5)) / 2)
    assert between(1, 1e4, 1) == pytest.approx(1, abs=1e-7)
    assert between(2, 3, 1.5) * 4 == pytest.approx(between(3, 2, 1.5) * 9)


def test_one_node_a_surface_loses_no_light():
    theatre = corrected_models.THEATRES["recessed floor"]
    factors, _, areas = corrected_models._nodes(theatre)
    np.testing.assert_allclose(factors.sum(1), 1)
    np.testing.assert_allclose(areas[:, None] * factors, (areas[:, None] * factors).T)
    bare = replace(theatre, floor=None, wall=None)
    assert corrected_models.one_node_a_surface(bare) == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    "theatre", ["bare", pytest.param("seats and lobe", marks=pytest.mark.long)]
)
def test_mitsubas_integrator_finds_the_same(theatre):
    found = second_opinion.measure(
        second_opinion.theatres()[theatre], size=32, samples=256, error=0.04
    )
    assert np.all(np.abs(found.off_by) < 6e-4 + 3.5 * np.array(found.error))
    assert max(found.error) < 2e-3
    if theatre == "bare":
        assert found.known is not None
        assert np.all(np.abs(found.known[0]) < 4 * np.array(found.error))


def test_light_is_not_made():
    """What all surfaces and the opening absorb is what the projector gave: a closed white room."""
    dome = Dome(3.0, np.pi)
    tracer = Tracer(Theatre(dome, (0.9, 0.5, 0.1)))
    source = tracer.picture(np.ones((32, 32, 3), np.float32))
    traced = tracer.screen(source, 32, 32, Settings(error=0.01, tolerance=1e-7))
    areas = dome.screen_areas(32, 32)
    seen = 1 + np.einsum("ij,ijp->p", areas, traced.mean.astype(np.float64)) / areas.sum()
    absorbed = seen / np.array([0.9, 0.5, 0.1]) * (1 - np.array([0.9, 0.5, 0.1]))
    given = 1 / np.array([0.9, 0.5, 0.1])
    np.testing.assert_allclose(absorbed, given, rtol=2e-3)
    assert bounce_limit(tracer.room, 1e-7) > 100


def test_the_closed_form_is_told_beside_what_many_walks_find(capsys):
    reflection.main(2e5)
    backend_line, head, *lines = capsys.readouterr().out.splitlines()
    assert "Path tracing with" in backend_line
    assert head.split()[:3] == ["half-angle", "albedo", "walks"]
    assert len(lines) == len(reflection.CAPS)
    for line, (half_angle, albedo) in zip(lines, reflection.CAPS, strict=True):
        angle, rho, walks, found, truth, error, z, _ = line.split()
        assert (angle, float(rho)) == (f"{half_angle:g}°", albedo)
        assert float(walks) == pytest.approx(2e5, rel=0.02)
        # Of a white cap q of the light comes back, bounce after bounce.
        q = albedo * (1 - np.cos(np.radians(half_angle))) / 2
        assert float(truth) == pytest.approx(q / (1 - q), abs=1e-6)
        assert 0 < float(error) < 5e-3 * float(truth)
        assert float(z) == pytest.approx((float(found) - float(truth)) / float(error), abs=0.1)
        assert abs(float(z)) < 4
