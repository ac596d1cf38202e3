"""The path tracer's claims, at accuracies that take seconds; experiments reach further."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.pathtrace.llvm import backend
from domesim.pathtrace.loop import bounce_limit
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.theatre import Theatre
from validation.experiments import closed_form, operator, second_opinion
from validation.statistics import assert_unbiased

pytestmark = pytest.mark.skipif(not backend().vectorised, reason=backend().summary)


@pytest.mark.parametrize("uneven", [False, True])
def test_bare_caps_follow_the_closed_form(uneven):
    cells = list(closed_form.sweep((30, 90, 150, 180), (0.1, 0.5, 0.9), error=1e-3, uneven=uneven))
    assert_unbiased(
        [one.found for one in cells], [one.error for one in cells], [one.truth for one in cells]
    )
    assert max(one.error / one.truth for one in cells) < 2e-3


def test_each_bounce_keeps_the_same_share():
    cells = list(closed_form.sweep((45, 105, 180), (0.2, 0.8), error=1e-3))
    scores = np.array([one.ratio_z for one in cells])
    assert scores.shape == (6, closed_form.BOUNCES)
    assert_unbiased(scores, 1.0, 0.0)


def test_a_biased_tracer_would_be_noticed(monkeypatch):
    """Albedos that are 0.5 % too high: the sweep's accuracy suffices to see it."""
    honest = Theatre.screen_albedo.fget
    monkeypatch.setattr(
        Theatre,
        "screen_albedo",
        property(lambda theatre: tuple(1.005 * x for x in honest(theatre))),
    )
    cells = list(closed_form.sweep((90, 150), (0.5, 0.8), error=1e-3))
    with pytest.raises(AssertionError, match="biased"):
        assert_unbiased(
            [one.found for one in cells], [one.error for one in cells], [one.truth for one in cells]
        )


@pytest.mark.parametrize(
    ("theatre", "pictures", "error", "allowed"),
    [
        ("recessed floor", ("white", "patch"), 5e-4, 1e-3),
        ("floor at the spring line", ("white", "patch"), 1e-3, 5e-3),
        ("gain lobe of share 0.3", ("white",), 3e-3, 5e-3),
    ],
)
def test_the_operator_is_what_brute_force_finds(theatre, pictures, error, allowed):
    outcome = operator.measure(theatre, error=error, brute_force=0.01, size=64, pictures=pictures)
    assert outcome.claimed <= error
    for one in outcome.comparisons:
        assert one.noise < 2.5e-3
        assert one.rms < np.hypot(allowed, one.noise)


@pytest.mark.parametrize("theatre", ["bare", "seats and lobe"])
def test_mitsubas_integrator_finds_the_same(theatre):
    found = second_opinion.measure(
        second_opinion.theatres()[theatre], size=32, samples=256, error=0.04
    )
    assert np.all(np.abs(found.off_by) < 6e-4 + 3.5 * found.error)
    assert np.all(found.error < 2e-3)
    if theatre == "bare":
        assert found.known is not None
        assert np.all(np.abs(found.known[0]) < 4 * found.error)


def test_light_is_not_made():
    """What all surfaces and the opening absorb is what the projector gave: a closed white room."""
    dome = closed_form.Dome(3.0, np.pi)
    tracer = Tracer(Theatre(dome, (0.9, 0.5, 0.1)))
    source = tracer.picture(np.ones((32, 32, 3), np.float32))
    traced = tracer.screen(source, 32, 32, Settings(error=0.01, tolerance=1e-7))
    areas = dome.screen_areas(32, 32)
    seen = 1 + np.einsum("ij,ijp->p", areas, traced.mean.astype(np.float64)) / areas.sum()
    absorbed = seen / np.array([0.9, 0.5, 0.1]) * (1 - np.array([0.9, 0.5, 0.1]))
    given = 1 / np.array([0.9, 0.5, 0.1])
    np.testing.assert_allclose(absorbed, given, rtol=2e-3)
    assert bounce_limit(tracer.room, 1e-7) > 100
