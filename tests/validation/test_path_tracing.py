"""The path tracer's claims that quick experiments do not show, at accuracies that take seconds."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from domesim.pathtrace.loop import bounce_limit
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from testing.statistics import assert_unbiased
from validation import reflection
from validation.rooms import chosen
from validation.ways import CLOSED, MITSUBA, Effort, light_of


def sweep(half_angles, albedos, picture="white"):
    return [
        reflection.measure(half_angle, albedo, error=1e-3, picture=picture, seed=100 * number)
        for number, (half_angle, albedo) in enumerate(product(half_angles, albedos))
    ]


CELLS = (90, 150), (0.5, 0.8)
"""Half angles and albedos that suffice to see a bias."""


def test_bare_caps_follow_the_closed_form():
    cells = sweep(*CELLS, picture="patch")
    assert_unbiased(
        [one.found for one in cells], [one.error for one in cells], [one.truth for one in cells]
    )
    assert max(one.error / one.truth for one in cells) < 2e-3


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


CASES = {case.name: case for case in chosen()}


def test_mitsubas_integrator_finds_the_same():
    found = light_of(CASES["tilted, lens aside"], Effort(2.0, 8, 64, 0), 0)["coloured"].by
    assert abs(found[MITSUBA].off_by) < 2.5e-3 + 3.5 * found[MITSUBA].error
    assert found[MITSUBA].error < 4e-3
    assert abs(found[CLOSED].off_by) < 4 * found[CLOSED].error


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
