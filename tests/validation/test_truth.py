"""Published figures are form factors; Radiance is told of the theatre that ours traces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rooms import BEFORE, ROOMS

from domesim.errors import InputError
from domesim.observation.spherical import bare_gain
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from validation import cie, radiance
from validation.experiments import truth
from validation.rooms import Case, chosen, drawn
from validation.ways import CLOSED, EIGHT, ENERGY, MITSUBA, TABULATED, Light, Opinion

needs_radiance = pytest.mark.skipif(not radiance.installed(), reason=radiance.MISSING)
BARE = Theatre(Dome(4.0, np.radians(100), 0.3), (0.6, 0.4, 0.2))


@pytest.mark.parametrize(
    ("factors", "published"),
    [
        (cie.reflected_factors, cie.REFLECTED),
        (cie.obstructed_factors, cie.OBSTRUCTED),
    ],
)
def test_published_figures_are_form_factors(factors, published):
    """To their last digit, so that they were copied right and the case understood."""
    np.testing.assert_allclose(100 * np.array(factors()[2]), published, atol=6e-3)


def test_the_published_cube_is_the_sum_of_all_bounces():
    flux = cie.FLUX / (6 * cie.SIDE**2)
    for albedo, lux in cie.BOUNCED.items():
        assert lux == pytest.approx(flux * albedo / (1 - albedo), rel=3e-3)


@needs_radiance
def test_radiance_finds_the_closed_form():
    mean, error = radiance.reflected(BARE, rays=20_000, seed=3)
    wanted = np.array([bare_gain(rho, BARE.dome) for rho in BARE.albedo])
    assert np.all(error < 0.02 * wanted)
    assert np.all(np.abs(mean - wanted) < 4 * error)


@needs_radiance
def test_a_box_in_the_beam_takes_light_from_the_screen_in_radiance():
    """Painted black it takes what it hides, and more: 5.6 %, of which one per cent is noise."""
    theatre = BEFORE["box in the beam"]
    dark = replace(theatre, solids=tuple(replace(s, albedo=(0.0,) * 3) for s in theatre.solids))
    lit, black = (radiance.reflected(each, rays=40_000, seed=1)[0][0] for each in (theatre, dark))
    assert black < 0.98 * lit


@pytest.mark.parametrize("name", ["two beams", "flat"])
def test_what_radiance_is_not_told_is_refused(name):
    with pytest.raises(InputError, match="cannot have"):
        radiance.scene((BEFORE | ROOMS)[name])


def said(case: Case) -> dict[str, Light]:
    """What ways would say of a theatre if all was well."""
    closed = sum(case.closed) / 2
    closed = {truth.SPRING: -0.12, truth.BELOW: -0.07}.get(case.name, closed)
    by = {CLOSED: Opinion(closed, 1e-3, 0.1)}
    if case.tabulated:
        by[TABULATED] = by[EIGHT] = Opinion(1e-3, 1e-3, 1e-4)
    if MITSUBA in case.others:
        by[MITSUBA] = Opinion(1e-4, 1e-4, 1e-4)
    if ENERGY in case.others:
        by[ENERGY] = Opinion(1e-3, 1e-3)
    return {picture: Light(0.3, 1e-3, 0.0, 1e-3, by) for picture in case.pictures}


WANTED = [case for case in chosen() if case.name in truth.QUICK] + [drawn(0, 7), drawn(1, 7)]
FOUND = {case.name: said(case) for case in WANTED}
PUBLISHED = {"5.8 all bounces": [cie.Found(lux, lux, lux, 1e-3) for lux in cie.BOUNCED.values()]}


def test_without_radiance_cases_are_left_out_and_it_is_said(monkeypatch):
    monkeypatch.setattr(radiance, "installed", lambda: False)
    finding = truth.finding(WANTED, FOUND, PUBLISHED, quick=True)
    assert finding.left_out == (f"Radiance. {radiance.MISSING}.",)


@pytest.mark.parametrize(
    ("name", "picture", "way", "wrong"),
    [
        ("bare hemisphere", "white", CLOSED, Opinion(0.01, 1e-3, 0.01)),
        (truth.SPRING, "white", CLOSED, Opinion(-0.02, 1e-3, 0.1)),
        (truth.RECESSED, "white", TABULATED, Opinion(0.0, 1e-3, 3e-3)),
        (truth.RECESSED, "patch", EIGHT, Opinion(0.0, 1e-3, 0.06)),
        (truth.FURNISHED, "coloured", MITSUBA, Opinion(4e-3, 1e-4, 1e-4)),
        ("drawn 0", "white", TABULATED, Opinion(6e-3, 1e-3, 1e-4)),
        ("drawn 1", "white", ENERGY, Opinion(-6e-3, 1e-3)),
    ],
)
def test_a_way_that_is_off_is_not_as_expected(name, picture, way, wrong):
    assert truth.finding(WANTED, FOUND, PUBLISHED, quick=True).passed
    light = FOUND[name][picture]
    off = replace(light, by={**light.by, way: wrong})
    found = {**FOUND, name: {**FOUND[name], picture: off}}
    assert not truth.finding(WANTED, found, PUBLISHED, quick=True).passed


def test_a_published_figure_that_is_missed_is_not_as_expected():
    off = [replace(PUBLISHED["5.8 all bounces"][0], ours=6.0), *PUBLISHED["5.8 all bounces"][1:]]
    assert not truth.finding(WANTED, FOUND, {"5.8 all bounces": off}, quick=True).passed


@pytest.mark.parametrize("number", range(8))
def test_drawn_theatres_hold_no_lens_in_a_box(number):
    theatre = drawn(number, 7).theatre
    for place in [lens.position for lens in theatre.lenses] or [(0, 0, 0)]:
        for solid in theatre.solids:
            low, high = solid.vertices.min(0), solid.vertices.max(0)
            assert not np.all((low < place) & (place < high))
    assert theatre.solids or theatre.floor
