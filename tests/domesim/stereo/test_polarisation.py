"""Crosstalk by Mueller calculus: limits that are known by hand, symmetries, published screens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from theatres import cinema

from domesim.errors import InputError
from domesim.scene import load_stereo
from domesim.stereo.polarisation import ALUMINIUM, crosstalk_estimate, screen_gain, seen_luminance
from domesim.stereo.system import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre

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


def jones(glass):
    """Fields (right, up), before an eye, of what a filter passes whole: of its state, and crossed.

    Light's field is the real part of E exp(-i omega t). What a lens sends is its conjugate.
    """
    for turn in (0, 90):
        axis, fast = np.radians(glass.axis + turn), np.radians(glass.axis + FAST[glass.hand])
        along = np.array([np.cos(fast), np.sin(fast)])
        across = np.array([-np.sin(fast), np.cos(fast)])
        linear = np.array([np.cos(axis), np.sin(axis)])
        slow = np.exp(1j * np.radians(90 + glass.retardance_error))
        yield along * (along @ linear) + across * (across @ linear) / slow


FAST = {"right": -45, "left": 45}


def fields_of(screen, lens, glass, eye, point):
    """Luminance by fields in space, mode by mode of what leaks: no Stokes vector, no rotation."""
    up = np.array([0.0, 0, 1])
    ways = []
    for place in (lens.position, eye):
        way = np.asarray(place, float) - point
        distance = np.linalg.norm(way)
        way = way / distance
        right = np.cross(-way, up) / np.linalg.norm(np.cross(-way, up))
        ways.append((way, distance, np.stack([right, np.cross(right, -way)])))
    (to_lamp, distance, sending), (to_eye, _, seeing) = ways
    half = (to_lamp + to_eye) / np.linalg.norm(to_lamp + to_eye)
    across = np.cross(to_lamp, to_eye)
    across /= np.linalg.norm(across)
    before, after = np.cross(across, -to_lamp), np.cross(across, to_eye)
    cosine = half @ to_eye
    inner = np.sqrt(1 - (1 - cosine**2) / ALUMINIUM**2)
    s = (cosine - ALUMINIUM * inner) / (cosine + ALUMINIUM * inner)
    p = (ALUMINIUM * cosine - inner) / (ALUMINIUM * cosine + inner)
    total = 0.0
    for sent, much in zip(jones(lens.filter), (1, lens.filter.leak), strict=True):
        field = sent.conj() @ sending
        mirrored = s * (across @ field) * across + p * (before @ field) * after
        for seen, passed in zip(jones(glass), (1, glass.leak), strict=True):
            total += much * passed * abs(seen.conj() @ seeing @ mirrored) ** 2
    total /= 1 + lens.filter.leak
    plain = screen_gain_of_facets(screen, to_lamp, to_eye, half)
    return -to_lamp[1] / distance**2 * plain * total / (1 + glass.leak)


def screen_gain_of_facets(screen, to_lamp, to_eye, half):
    """GGX's density and shadowing: what `_by_facets` is multiplied by."""
    square = screen.roughness**2
    density = square / (np.pi * (half[1] ** 2 * (square - 1) + 1) ** 2)
    hidden = [2 / (1 + np.sqrt(1 + square * (way[1] ** -2 - 1))) for way in (to_lamp, to_eye)]
    return density * hidden[0] * hidden[1] / (4 * to_lamp[1] * to_eye[1]) * screen.albedo


@pytest.mark.parametrize("seed", range(6))
def test_filters_and_oblique_facets_by_fields_in_space(seed):
    random = np.random.default_rng(seed)
    screen = replace(SCREEN, depolarising_share=0.0, roughness=0.6)
    lens, glass = (
        CircularFilter(
            random.choice(["left", "right"]),
            random.uniform(0, 0.3),
            random.uniform(-60, 60),
            random.uniform(-90, 90),
        )
        for _ in range(2)
    )
    place, eye = (
        random.uniform(-9, -2, 3) * [random.choice([-1, 1]), 1, random.choice([-1, 1])]
        for _ in range(2)
    )
    lens = PolarisedProjector(tuple(place), lens)
    point = np.array([random.uniform(-4, 4), 0, random.uniform(-2, 2)])
    expected = fields_of(screen, lens, glass, eye, point)
    found = seen_luminance(screen, lens, glass, eye, point)
    # both pass half of unpolarised light, and of their own state all but the leak
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("sent", "passed", "axis", "leak"),
    [
        (5, 5, 0, np.sin(np.radians(5)) ** 2),  # 0.76 %
        (5, -5, 0, 0.0),
        (5, 5, 90, 0.0),
        (5, -5, 90, np.sin(np.radians(5)) ** 2),
        (8, 0, 0, np.sin(np.radians(4)) ** 2),
        (8, 0, 33, np.sin(np.radians(4)) ** 2),
    ],
)
def test_errors_of_retardance_add_up_or_cancel(sent, passed, axis, leak):
    """On the axis, where the mirror leaves a rotation and crossed polarisers alone."""
    screen = replace(SCREEN, depolarising_share=0.0)
    ideal, _ = on_axis(screen)
    lens = PolarisedProjector((0, -9, 0), CircularFilter("left", 0, sent))
    glass = CircularFilter("left", 0, passed, axis)
    other = seen_luminance(screen, lens, glass, (0, -7, 0), CENTRE)
    assert other / ideal == pytest.approx(leak, abs=1e-12)


SCENE = """
name = "coloured"
[screen]
width_m = 10.0
height_m = 5.3
[projector]
white_cd_m2 = 15.0
[crosstalk.polarisation]
lenses_m = [[-0.2, -30.0, 2.5], [0.2, -30.0, 2.5]]
depolarising_share = 0.04
roughness = 0.3
glasses_axis_deg = AXIS
wavelengths_nm = [615.0, 545.0, 465.0]
projector_retardance_error_deg = [2.0, -1.0]
[[seats]]
name = "middle"
position_m = [0.0, -20.0, -1.0]
[viewing]
distance_m = 20.0
adaptation_cd_m2 = 5.0
"""


def test_a_quarter_wave_is_one_for_one_wavelength(tmp_path):
    found = {}
    for axis in (0, 90):
        file = tmp_path / f"coloured {axis}.toml"
        file.write_text(SCENE.replace("AXIS", str(axis)))
        scene = load_stereo(file)
        seat, weights = scene.seats["middle"], scene.projector.luminance_weights
        found[axis] = (
            np.diagonal(seat.matrices, axis1=1, axis2=2)
            * seat.share.mean(axis=(1, 2), keepdims=True)[..., 0]
        )
        # primaries share one map, whose luminance is that of each computed alone
        each = [crosstalk_estimate(one, "middle", 9, 15) for one in scene.theatre.by_primary()]
        np.testing.assert_allclose(seat.share, np.tensordot(weights, each, axes=1))
        np.testing.assert_allclose(found[axis].T, np.mean(each, axis=(2, 3)), rtol=1e-12)
    # two films of 90° at 550 nm and an error: what they leak of R, G and B by hand
    films = 550 / np.array([615, 545, 465]) * 90
    for view, error in ((0, -1.0), (1, 2.0)):  # what an eye gets is the other's light
        total = films * (2 + error / 90) - 180
        rise = found[0][view] - found[90][view]
        crossed = films * error / 90
        by_hand = np.sin(np.radians(total / 2)) ** 2 - np.sin(np.radians(crossed / 2)) ** 2
        np.testing.assert_allclose(rise, by_hand, rtol=0.2, atol=1e-4)
    assert found[0][0][2] > 0.08
    assert found[90][0][2] < 0.03


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


def test_a_published_silver_screen():
    """Gain 2.4, half of it 26 degrees off (RealD, 2007): one roughness gives both."""
    assert screen_gain(SCREEN, 0.0) == pytest.approx(2.4, rel=0.01)
    assert screen_gain(SCREEN, 0.0, np.radians(26.0)) == pytest.approx(1.2, rel=0.03)


def test_the_bundled_screen_has_a_published_extinction():
    """200:1 with linear filters of 3000:1, circular ones of a tenth of that (Lipton 2010)."""
    theatre = load_stereo("stereo_cinema_silver").theatre
    assert theatre is not None

    def middle(more: float) -> float:
        found = replace(
            theatre,
            projectors=tuple(
                replace(lamp, filter=replace(lamp.filter, leak=more * lamp.filter.leak))
                for lamp in theatre.projectors
            ),
            eyewear=tuple(replace(glass, leak=more * glass.leak) for glass in theatre.eyewear),
        )
        return float(crosstalk_estimate(found, "sweet spot", 5, 9)[:, 2, 4].mean())

    leaks = [lamp.filter.leak for lamp in theatre.projectors]
    leaks += [glass.leak for glass in theatre.eyewear]
    assert leaks == pytest.approx([1 / 300] * 4, rel=2e-3)
    assert middle(0.1) == pytest.approx(1 / 200, rel=5e-3)
    assert middle(1.0) == pytest.approx(0.011, rel=2e-3)
    corners = crosstalk_estimate(theatre, "sweet spot", 9, 16).max()
    assert (corners, crosstalk_estimate(theatre, "left", 9, 16).max()) == pytest.approx(
        (0.0159, 0.0266), abs=2e-4
    )


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
        (lambda: CircularFilter("up"), "hand must be left or right, got 'up'"),
        (lambda: CircularFilter("left", 0.0, 90.0), "between -90 and 90 degrees, got 90"),
        (lambda: CircularFilter("left", 1.0), "leak must be at least 0 and below 1, got 1"),
        (lambda: PolarisedProjector((0, 9, 0), LEFT), "projector must be before the screen"),
        (lambda: replace(CINEMA, seats={"A1": (0, 0, 0)}), "seat 'A1' must be before the screen"),
        (lambda: replace(CINEMA, eyewear=(LEFT, RIGHT)), "swap the glasses"),
        (lambda: replace(CINEMA, projectors=CINEMA.projectors[:1] * 2), "both projectors send"),
    ],
)
def test_what_cannot_be_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        wrong()
