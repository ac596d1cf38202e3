"""Crosstalk by Mueller calculus: limits that are known by hand, symmetries, published screens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from theatres import cinema

from domesim.errors import InputError
from domesim.lenses import lobe_gain
from domesim.polarisation import ALUMINIUM, crosstalk_estimate, screen_gain, seen_luminance
from domesim.stereo import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre
from domesim.theatre import Lobe

LEFT, RIGHT = CircularFilter("left"), CircularFilter("right")
SCREEN = SilverScreen(10.0, 5.3, depolarising_share=0.05, roughness=0.305)
CENTRE = np.zeros(3)
CINEMA = cinema(SCREEN)


def on_axis(screen, leak_of_lens=0.0, leak_of_glass=0.0):
    """Luminance of the screen's centre through the eye's own filter, and through the other one."""
    lens = PolarisedProjector((0, -9, 0), CircularFilter("left", leak_of_lens))
    return [
        seen_luminance(screen, lens, CircularFilter(hand, leak_of_glass), (0, -7, 0), CENTRE)
        for hand in ("right", "left")
    ]


def test_ideal_filters_and_facets_leave_nothing():
    own, other = on_axis(replace(SCREEN, depolarising_share=0.0))
    assert own > 1e-3
    assert abs(other) < 1e-15


def test_oblique_facets_leave_next_to_nothing():
    """Aluminium makes circular light a little elliptical, the more the larger the angle."""
    share = crosstalk_estimate(cinema(replace(SCREEN, depolarising_share=0.0)), "right", 5, 7)
    assert 1e-7 < share.min() < share.max() < 1e-3


def test_a_screen_that_forgets_polarisation_shows_both_alike():
    screen = replace(SCREEN, depolarising_share=1.0)
    one_place = ((0.2, -24, 2), (0.2, -24, 2))
    leaks = (0.01, 0.02, 0.03, 0.04)
    share = crosstalk_estimate(cinema(screen, leaks, one_place), "right", 5, 7)
    np.testing.assert_allclose(share, 1, rtol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(0.0, 0.004), (0.01, 0.002), (0.3, 0.2)])
def test_filters_alone_leak_as_crossed_polarisers(first, second):
    """Of the hands (1, a) that are sent, (1, b) pass: crossed (a + b) to (1 + a b) together."""
    own, other = on_axis(replace(SCREEN, depolarising_share=0.0), first, second)
    np.testing.assert_allclose(other / own, (first + second) / (1 + first * second), rtol=1e-12)


def test_half_of_the_depolarised_light_goes_astray():
    """On the axis, where GGX's lobe is 1 / (4 alpha²) times a Lambertian screen."""
    share, alpha, albedo = 0.07, 0.2, 0.8
    screen = SilverScreen(3.0, 2.0, share, alpha, albedo)
    mirror = abs((ALUMINIUM - 1) / (ALUMINIUM + 1)) ** 2
    gain = albedo * (share + (1 - share) * mirror / (4 * alpha**2))
    np.testing.assert_allclose(screen_gain(screen, 0.0), gain, rtol=1e-12)
    own, other = on_axis(screen)
    astray = share * albedo / 2
    np.testing.assert_allclose(other / own, astray / (gain - astray), rtol=1e-12)


def test_the_lobe_is_the_domes():
    """Written for another screen, with facets that lose nothing."""
    angles = np.radians(np.linspace(0, 35, 8))
    ours = screen_gain(replace(SCREEN, depolarising_share=0.0), 0.2, angles)
    to_lamp = np.array([-np.sin(0.2), -np.cos(0.2), 0])
    to_eye = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], -1)
    facing = np.broadcast_to([0.0, -1, 0], to_eye.shape)
    theirs = lobe_gain(Lobe(1.0, SCREEN.roughness), facing, to_eye, to_lamp)
    mirror = abs((ALUMINIUM - 1) / (ALUMINIUM + 1)) ** 2
    np.testing.assert_allclose(ours, mirror * theirs, rtol=1e-3)


def test_light_may_go_either_way():
    np.testing.assert_allclose(
        screen_gain(SCREEN, 0.3, 0.7), screen_gain(SCREEN, 0.7, 0.3), rtol=1e-12
    )


def test_a_published_silver_screen():
    """Gain 2.4, half of it 26 degrees off (RealD, 2007): one roughness gives both."""
    assert screen_gain(SCREEN, 0.0) == pytest.approx(2.4, rel=0.01)
    assert screen_gain(SCREEN, 0.0, np.radians(26.0)) == pytest.approx(1.2, rel=0.03)


def test_crosstalk_rises_off_axis():
    """At the same place on the screen, from seats further and further to the side."""
    bearing = np.radians([0, 10, 20, 30, 40])
    lens = PolarisedProjector((0, -24, 0), LEFT)
    own, other = (
        np.array(
            [
                seen_luminance(SCREEN, lens, glass, 15 * direction, CENTRE)
                for direction in np.stack([np.sin(bearing), -np.cos(bearing), 0 * bearing], -1)
            ]
        )
        for glass in (RIGHT, LEFT)
    )
    rise = other / own
    assert np.all(np.diff(rise) > 0)
    assert rise[0] == pytest.approx(0.0106, rel=0.01)
    assert rise[3] / rise[0] == pytest.approx(2.4, rel=0.05)  # just past the half-gain angle


def test_crosstalk_rises_where_the_mirrored_projector_is_far():
    """Row 0 is the top, col 0 the audience's left."""
    right = crosstalk_estimate(CINEMA, "right", 5, 7)
    assert np.all(np.diff(right[:, 2, :4], axis=-1) < 0)
    assert np.all(right[..., 0] > 2 * right[..., -1])
    low = crosstalk_estimate(cinema(SCREEN, lenses=((0, -24, -4), (0, -24, -4))), "low", 5, 7)
    assert np.all(low[:, 0] > 1.5 * low[:, -1])


def test_a_mirrored_theatre_has_a_mirrored_map():
    leaks = (0.001, 0.002, 0.003, 0.004)
    here = cinema(SCREEN, leaks)
    lens = [((-x, y, z), projector.filter.leak) for projector in here.projectors
            for x, y, z in [projector.position]]  # fmt: skip
    mirrored = StereoTheatre(
        here.screen,
        (
            PolarisedProjector(lens[1][0], CircularFilter("left", lens[1][1])),
            PolarisedProjector(lens[0][0], CircularFilter("right", lens[0][1])),
        ),
        (CircularFilter("right", leaks[3]), CircularFilter("left", leaks[2])),
        {"left": (-6, -15, -1)},
    )
    there = crosstalk_estimate(mirrored, "left", 5, 7)
    expected = crosstalk_estimate(here, "right", 5, 7)
    np.testing.assert_allclose(there, expected[::-1, :, ::-1], rtol=1e-12)
    assert np.abs(expected[0] / expected[1] - 1).max() > 0.05


def test_a_cell_is_the_mean_of_its_light():
    theatre = cinema(SCREEN, (0.001, 0.002, 0.003, 0.004))
    x, z = np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(200) + 0.5) / 200)
    points = np.stack([(x - 0.5) * 10.0, 0 * x, (0.5 - z) * 5.3], -1)
    own, other = (
        seen_luminance(SCREEN, lens, theatre.eyewear[0], theatre.seats["low"], points)
        .reshape(2, 100, 3, 100)
        .mean(axis=(1, 3))
        for lens in theatre.projectors
    )
    found = crosstalk_estimate(theatre, "low", 2, 3)[0]
    np.testing.assert_allclose(found, other / own, rtol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: SilverScreen(0.0, 5.0, 0.1, 0.3), "width must be above 0 m, got 0 m"),
        (lambda: SilverScreen(9.0, np.nan, 0.1, 0.3), "height must be above 0 m"),
        (lambda: SilverScreen(9.0, 5.0, 1.1, 0.3), r"depolarising share must be 0\.\.1, got 1.1"),
        (lambda: SilverScreen(9.0, 5.0, 0.1, 0.0), "roughness must be above 0 and at most 1"),
        (lambda: SilverScreen(9.0, 5.0, 0.1, 0.3, 1.5), "albedo must be above 0 and at most 1"),
        (lambda: CircularFilter("up"), "hand must be left or right, got 'up'"),
        (lambda: CircularFilter("left", 1.0), "leak must be at least 0 and below 1, got 1"),
        (lambda: PolarisedProjector((0, 9, 0), LEFT), "projector must be before the screen"),
        (lambda: PolarisedProjector((0, -9), LEFT), r"three numbers \(x, y, z\)"),
        (lambda: replace(CINEMA, seats={}), "no seats"),
        (lambda: replace(CINEMA, seats={"A1": (0, 0, 0)}), "seat 'A1' must be before the screen"),
        (lambda: replace(CINEMA, eyewear=(LEFT, RIGHT)), "swap the glasses"),
        (lambda: replace(CINEMA, projectors=CINEMA.projectors[:1] * 2), "both projectors send"),
        (lambda: crosstalk_estimate(CINEMA, "Z9", 2, 2), "no seat 'Z9'; there are sweet spot"),
        (lambda: crosstalk_estimate(CINEMA, "low", 0, 2), "at least 1, got 0 x 2"),
    ],
)
def test_what_cannot_be_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        wrong()
