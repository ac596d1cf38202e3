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
from validation import radiance
from validation.experiments import public_cases, random_theatres

needs_radiance = pytest.mark.skipif(not radiance.installed(), reason=radiance.MISSING)
BARE = Theatre(Dome(4.0, np.radians(100), 0.3), (0.6, 0.4, 0.2))


@pytest.mark.parametrize(
    ("factors", "published"),
    [
        (public_cases.reflected_factors, public_cases.REFLECTED),
        (public_cases.obstructed_factors, public_cases.OBSTRUCTED),
    ],
)
def test_published_figures_are_form_factors(factors, published):
    """To their last digit, so that they were copied right and the case understood."""
    np.testing.assert_allclose(100 * np.array(factors()[2]), published, atol=6e-3)


def test_the_published_cube_is_the_sum_of_all_bounces():
    flux = public_cases.FLUX / (6 * public_cases.SIDE**2)
    for albedo, lux in public_cases.BOUNCED.items():
        assert lux == pytest.approx(flux * albedo / (1 - albedo), rel=3e-3)


@needs_radiance
def test_radiance_finds_the_closed_form():
    mean, error = radiance.reflected(BARE, rays=20_000, seed=3)
    wanted = np.array([bare_gain(rho, BARE.dome) for rho in BARE.albedo])
    assert np.all(error < 0.02 * wanted)
    assert np.all(np.abs(mean - wanted) < 4 * error)


@needs_radiance
def test_a_box_in_the_beam_takes_light_from_the_screen_in_radiance():
    """Painted black it takes what it hides, and more."""
    theatre = BEFORE["box in the beam"]
    dark = replace(theatre, solids=tuple(replace(s, albedo=(0.0,) * 3) for s in theatre.solids))
    lit, black = (radiance.reflected(each, rays=20_000, seed=1)[0][0] for each in (theatre, dark))
    assert black < 0.96 * lit


@pytest.mark.parametrize("name", ["two beams", "flat"])
def test_what_radiance_is_not_told_is_refused(name):
    with pytest.raises(InputError, match="cannot have"):
        radiance.scene((BEFORE | ROOMS)[name])


def test_without_radiance_cases_are_left_out_and_it_is_said(monkeypatch):
    monkeypatch.setattr(radiance, "installed", lambda: False)
    finding = random_theatres.finding({"one": OPINION}, quick=True)
    assert finding.left_out == (f"Radiance. {radiance.MISSING}.",)


OPINION = random_theatres.Opinions(0.1, 1e-3, 1e-3, 0.3, 1e-3, 0.301, 1e-3, None, None)


def test_differences_beyond_their_errors_are_not_as_expected():
    off = replace(OPINION, tabulated=0.31)
    assert not random_theatres.finding({"one": off}, quick=True).passed
    assert random_theatres.finding({"one": OPINION}, quick=True).passed


@pytest.mark.parametrize("number", range(8))
def test_drawn_theatres_hold_no_lens_in_a_box(number):
    theatre = random_theatres.drawn(number, 7)
    for place in [lens.position for lens in theatre.lenses] or [(0, 0, 0)]:
        for solid in theatre.solids:
            low, high = solid.vertices.min(0), solid.vertices.max(0)
            assert not np.all((low < place) & (place < high))
    assert theatre.solids or theatre.floor
