"""Photographs and a meter's readings together: data of the model itself, in coloured rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from survey_rooms import (
    CAMERA,
    GAIN,
    PATTERNS,
    THEATRE,
    cells,
    evidence,
    model,
    on_screen,
    only,
)

from domesim.errors import InputError
from domesim.measure.dome.fit import Known, Survey, survey
from domesim.measure.dome.model import nominal_albedos
from domesim.measure.dome.photographs import Photographs, cells_of
from domesim.measure.dome.run import survey_of_spots
from domesim.measure.dome.spots import Metered, Reading, evidence_of, with_readings
from testing.statistics import assert_unbiased

WEIGHTS = np.array([0.2, 0.7, 0.1])
BLACK, WHITE, FRONT = 0, 1, 2
LUMINANCE = 8.0
ALBEDOS = nominal_albedos(THEATRE)
START = np.array([[0.4] * 3, [0.3] * 3])
SURFACES = ("screen", "floor")


SPOTS = (
    (on_screen(40, 80), "cd/m2"),
    (on_screen(50, 250), "cd/m2"),
    (on_screen(50, 250), "lux"),
    ((0.5, 0.5, -1.2), "cd/m2"),
)
ALL = [(pattern, *spot) for pattern in (BLACK, WHITE, FRONT) for spot in SPOTS]


def read(
    wanted: list = ALL,
    white: tuple[float, ...] | np.ndarray = (LUMINANCE,) * 3,
    noise: float = 0.01,
    seed: int | None = None,
) -> list[Reading]:
    """What a meter shows, primary by primary, with some stray light."""
    readings = []
    rng = np.random.default_rng(seed)
    for pattern, place, unit in wanted:
        one = Reading(pattern, place, unit, 0.0, 1.0)
        places = evidence_of(THEATRE, PATTERNS, [one]).places
        form = model().seen_from(places)
        value = 0.02
        for p in range(3):
            light, _ = model().shown(p, ALBEDOS[:, p], places, form)
            value += WEIGHTS[p] * white[p] * light[pattern, 0]
        error = noise * value
        value += 0 if seed is None else error * rng.standard_normal()
        readings.append(replace(one, value=float(value), error=float(error)))
    return readings


def both(photographed, readings, known=None, *, white: bool = True) -> Survey:
    metered = Metered(readings, WEIGHTS, white)
    seen = with_readings(photographed, THEATRE, PATTERNS, metered)
    return survey(model(), seen, START, SURFACES, known, profile=False)


def test_light_without_noise_is_explained_exactly():
    found = both(evidence(), read())
    assert np.allclose(found.value, [[LUMINANCE] * 3, *ALBEDOS], rtol=1e-6)
    alone = survey(model(), evidence(), START, SURFACES, profile=False)
    assert np.allclose(found.ambient, alone.ambient, rtol=1e-5)
    # White is one figure more, and so is what is common to each place's readings.
    assert found.degrees == alone.degrees + len(ALL) - len(SPOTS) - 1
    assert np.allclose(np.diag(found.correlations, len(found.names))[0], 1)
    held = both(evidence(), read(), {"gain": Known((LUMINANCE,) * 3)})
    assert held.degrees == found.degrees + 1


def test_standard_errors_are_the_spread():
    truth = np.array([[LUMINANCE] * 3, *ALBEDOS])
    runs = [both(evidence(seed=seed), read(seed=seed + 100)) for seed in range(12)]
    assert all(run.plausible for run in runs)
    value, error = (np.array([getattr(run, name) for run in runs]) for name in ("value", "error"))
    assert_unbiased(value[:, 1:], error[:, 1:], truth[1:])
    assert_unbiased(value[:, 0, 0], error[:, 0, 0], LUMINANCE)
    z = (value - truth) / error
    assert 0.75 < np.sqrt(np.mean(z[:, 1:] ** 2)) < 1.25
    assert 0.6 < np.sqrt(np.mean(z[:, 0, 0] ** 2)) < 1.5
    # The camera has gains of its own; a reading's error is 1 %.
    assert np.all(error[:, 0] < 0.01 * LUMINANCE)
    assert np.all(error[:, 0] > 0.01 * LUMINANCE / np.sqrt(len(ALL)))


@pytest.mark.long
def test_both_are_surer_than_either():
    poor = evidence(noise=0.05)
    sure = read(noise=0.003)
    found = both(poor, sure)
    photographs = survey(model(), poor, START, SURFACES, profile=False)
    assert np.all(found.error[1:] <= photographs.error[1:] * (1 + 1e-6))
    assert found.error[1, 1] < 0.8 * photographs.error[1, 1]
    meter = survey_of_spots(THEATRE, PATTERNS, sure, {}, WEIGHTS, profile=False)
    for at in (1, 2):
        spread = np.sqrt(WEIGHTS @ found.covariance[:, at, :, at] @ WEIGHTS)
        assert spread < meter.error[at, 0]
    assert found.error[0, 0] < meter.error[0, 0]


def test_calibrated_photographs_share_their_gain_with_the_meter():
    poor = evidence(noise=0.05)
    found = both(poor, read(white=GAIN), white=False)
    assert np.allclose(found.value, [GAIN, *ALBEDOS], rtol=1e-6)
    alone = survey(model(), poor, START, SURFACES, profile=False)
    assert np.all(found.error <= alone.error * (1 + 1e-6))
    assert found.degrees == alone.degrees + len(ALL) - len(SPOTS)

    def white_error(one: Survey) -> float:
        change = WEIGHTS * one.value[0]
        return float(np.sqrt(change @ one.covariance[:, 0, :, 0] @ change))

    assert white_error(found) < 0.9 * white_error(alone)


def test_a_meter_that_disagrees_with_calibrated_photographs_is_noticed():
    seen = evidence(seed=1)
    assert both(seen, read(white=GAIN, seed=2), white=False).plausible
    assert not both(seen, read(white=1.2 * GAIN, seed=2), white=False).plausible
    assert both(seen, read(white=1.2 * GAIN, seed=2)).plausible


def test_lux_and_luminance_tell_what_white_and_black_do_not():
    seen = only(evidence(), [BLACK, WHITE], surface=0)
    floor = {"floor": Known(THEATRE.floor.albedo)}
    alone = survey(model(), seen, START, SURFACES, floor, profile=False)
    found = both(seen, read(noise=0.001), floor)

    def luminous(one: Survey) -> float:
        return float(np.sqrt(WEIGHTS @ one.covariance[:, 1, :, 1] @ WEIGHTS))

    assert luminous(found) < 0.005 < luminous(alone)
    # The camera's gains, which stay open, are none of the meter's.
    assert np.allclose(found.value[0], LUMINANCE, rtol=1e-4)
    assert np.all(found.error[0] < 0.005 * LUMINANCE)


def test_white_from_elsewhere_is_weighed_with_the_meter():
    found = both(evidence(), read())
    spread = float(found.error[0, 0])
    known = {"gain": Known((LUMINANCE,) * 3, (spread,) * 3)}
    told = both(evidence(), read(), known)
    assert told.error[0] == pytest.approx(spread / np.sqrt(2), rel=1e-3)
    assert np.allclose(told.error[1:], found.error[1:], rtol=0.01)


def test_readings_in_lux_alone_tell_white():
    lux = [one for one in ALL if one[2] == "lux"]
    assert np.allclose(both(evidence(), read(lux)).value[0], LUMINANCE, rtol=1e-6)


def test_readings_of_one_pattern():
    one = [each for each in ALL if each[0] == WHITE]
    with pytest.raises(InputError, match="no place was read lit and unlit; add readings"):
        both(evidence(), read(one))


def test_readings_are_no_photographs_of_another_pattern():
    with pytest.raises(InputError, match="primary R: no place on the screen was photographed lit"):
        both(only(evidence(), [WHITE]), read())


def test_nuisances_of_photographs_do_not_change_readings():
    seen = evidence(noise=1e-4)
    effects = np.ones((1, len(PATTERNS), *seen.value.shape[1:]))
    found = both(replace(seen, names=("a shutter",), effects=0.5 * effects), read())
    plain = both(seen, read())
    assert found.nuisances["a shutter"][1] == pytest.approx(1, rel=1e-3)
    assert np.allclose(found.error[0], plain.error[0], rtol=1e-3)


def test_patterns_that_are_only_read_leave_no_edges_in_photographs():
    fine = np.zeros((1, *PATTERNS.shape[1:]))
    fine[:, ::2] = 1
    patterns = np.concatenate([PATTERNS, fine])
    blank = np.ones((len(PATTERNS), 64, 64, 3))
    shots = Photographs(CAMERA, blank, np.arange(len(PATTERNS)), np.ones(len(PATTERNS)))
    assert np.array_equal(cells_of(THEATRE, patterns, shots).label, cells().label)
