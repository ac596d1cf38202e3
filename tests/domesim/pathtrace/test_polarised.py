"""Polarised light traced by Mitsuba, against Mueller calculus by hand and its own symmetries."""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
from theatres import cinema

from domesim.errors import InputError
from domesim.pathtrace import polarised
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.polarised import crosstalk_map, luminance_map
from domesim.stereo.polarisation import crosstalk_estimate
from domesim.stereo.system import SilverScreen
from testing.statistics import assert_unbiased, calibration

SCREEN = SilverScreen(10.0, 5.3, depolarising_share=0.05, roughness=0.305, albedo=0.9)
LEAKS = (0.001, 0.002, 0.003, 0.004)
CINEMA = cinema(SCREEN, LEAKS)


def turned(errors, axis):
    """Lenses and glasses with errors of retardance, degrees; the glasses are turned."""
    lenses = [
        replace(lens, filter=replace(lens.filter, retardance_error=error))
        for lens, error in zip(CINEMA.projectors, errors[:2], strict=True)
    ]
    glasses = [
        replace(glass, retardance_error=error, axis=axis)
        for glass, error in zip(CINEMA.eyewear, errors[2:], strict=True)
    ]
    return replace(CINEMA, projectors=tuple(lenses), eyewear=tuple(glasses))


@pytest.mark.parametrize(
    ("theatre", "seat"),
    [
        (CINEMA, "sweet spot"),
        (CINEMA, "corner"),
        (cinema(replace(SCREEN, roughness=0.15, depolarising_share=0.3), LEAKS), "aisle"),
        (cinema(SCREEN, (0.0, 0.2, 0.1, 0.0)), "aisle"),
        # Retarders that are off, and glasses that are turned
        (turned((4.0, -7.0, 5.0, 6.0), 0.0), "aisle"),
        (turned((30.0, -20.0, 25.0, -35.0), 35.0), "corner"),
        # What oblique aluminium does to circular light, and nothing else
        (cinema(replace(SCREEN, depolarising_share=0.0), (0.0, 0.0, 0.0, 0.0)), "corner"),
    ],
)
def test_simulation_agrees_with_mueller_calculus(theatre, seat):
    found = crosstalk_map(theatre, seat, 5, 7, samples=1024, seed=1)
    estimate = crosstalk_estimate(theatre, seat, 5, 7)
    assert found.share.shape == found.standard_error.shape == (2, 5, 7)
    assert_unbiased(found.share, found.standard_error, estimate)


def test_it_would_notice_a_bias_of_a_hundredth():
    found = crosstalk_map(CINEMA, "corner", 5, 7, samples=1024, seed=1)
    estimate = crosstalk_estimate(CINEMA, "corner", 5, 7)
    with pytest.raises(AssertionError, match="biased"):
        assert_unbiased(found.share, found.standard_error, 1.01 * estimate)


def test_its_standard_errors_are_honest():
    found = crosstalk_map(CINEMA, "aisle", 12, 20, samples=256, seed=2)
    z = (found.share - crosstalk_estimate(CINEMA, "aisle", 12, 20)) / found.standard_error
    assert calibration(z) > 1e-3


def test_nothing_goes_astray_between_ideal_filters():
    """At normal incidence on facets; float32 in the light."""
    screen = SilverScreen(0.05, 0.03, depolarising_share=0.0, roughness=0.305)
    axis = ((0, -24, 0), (0, -24, 0))
    theatre = replace(cinema(screen, (0.0,) * 4, axis), seats={"axis": (0, -15, 0)})
    found = crosstalk_map(theatre, "axis", 2, 3, samples=64)
    np.testing.assert_allclose(found.share, 0, atol=1e-6)


def test_launches_are_added_up(monkeypatch):
    monkeypatch.setattr(polarised, "_LAUNCH", 6 * 40)
    told = []
    found = crosstalk_map(CINEMA, "aisle", 2, 3, samples=100, seed=7, progress=told.append)
    assert told == [0.4, 0.8, 1.0]
    assert found.samples == 100
    assert_unbiased(found.share, found.standard_error, crosstalk_estimate(CINEMA, "aisle", 2, 3))


def test_a_quotient_s_error_is_that_of_its_parts():
    """Merged in unequal pieces, against the textbook's sum of residuals."""
    random = np.random.default_rng(8)
    own = random.uniform(1, 2, (4, 50))
    other = 0.1 * own + random.uniform(0, 0.1, (4, 50))
    sums = polarised._Sums(4)
    for part in (slice(0, 7), slice(7, 8), slice(8, 50)):
        sums.add(own[:, part], other[:, part])
    share, error = sums.quotient()
    expected = other.mean(1) / own.mean(1)
    residual = other - expected[:, None] * own
    np.testing.assert_allclose(share, expected)
    np.testing.assert_allclose(error, residual.std(1, ddof=1) / np.sqrt(50) / own.mean(1))


def test_the_luminance_of_three_colours():
    theatre, weights = replace(CINEMA, wavelengths=(615, 545, 465)), np.array([0.2, 0.7, 0.1])
    told = []
    found = luminance_map(theatre, weights, "aisle", 2, 3, seed=3, progress=told.append)
    assert told == pytest.approx([1 / 3, 2 / 3, 1])
    estimate = [crosstalk_estimate(one, "aisle", 2, 3) for one in theatre.by_primary()]
    assert_unbiased(found.share, found.standard_error, np.tensordot(weights, estimate, axes=1))
    plain = luminance_map(CINEMA, weights, "aisle", 2, 3, seed=3)
    np.testing.assert_array_equal(plain.share, crosstalk_map(CINEMA, "aisle", 2, 3, seed=3).share)


def test_ctrl_c_waits_for_the_launch_and_leaves_no_map(monkeypatch):
    monkeypatch.setattr(polarised, "_LAUNCH", 60)
    mi = load_mitsuba()
    before, told = mi.variant(), []

    def press(share):
        told.append(share)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        crosstalk_map(CINEMA, "aisle", 2, 3, samples=100, progress=press)
    assert told == [0.1]
    assert mi.variant() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("Z9", 2, 3, 8), "no seat 'Z9'"),
        (("aisle", 0, 3, 8), "at least 1, got 0 x 3"),
        (("aisle", 2, 3, 1), "at least 2 samples"),
    ],
)
def test_what_cannot_be_is_refused(arguments, words):
    *place, samples = arguments
    with pytest.raises(InputError, match=words):
        crosstalk_map(CINEMA, *place, samples=samples)


def test_everything_does_on_a_screen_that_forgets_polarisation():
    one_place = ((0.2, -24, 2), (0.2, -24, 2))
    theatre = cinema(replace(SCREEN, depolarising_share=1.0), LEAKS, one_place)
    found = crosstalk_map(theatre, "corner", 2, 3, samples=64)
    np.testing.assert_allclose(found.share, 1, atol=2e-6)
