"""The aim: the laws that it must keep, what it may lift, and how it behaves in films."""

from __future__ import annotations

from dataclasses import replace

import array_api_strict
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.ndimage import gaussian_filter

from compensate.aim import Aim, Sight
from compensate.aim.dome import gain_of, lifted
from compensate.aim.pair import SHARE, veiled
from compensate.figures import Appraisal
from compensate.master import compensate
from compensate.pose import pose
from compensate.ruler import NO_DIFFERENCE
from compensate.solve import solved
from compensate.solver.result import Status
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import load_scene
from testing.masters import night
from testing.pairs import generated
from testing.places import dome_at, stereo_at

SIZE = 96
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
SIGHT = Sight(np.ones((SIZE, SIZE), bool), WEIGHTS, 15.0, 4.0)
ROWS, COLS = np.mgrid[:SIZE, :SIZE]


def dome(albedo: float = 0.5, white: float = 15.0):
    return dome_at(albedo, white)


def seen(light: Light, scene, aim: Aim | None = None) -> Light:
    posed = pose(light, scene, aim or Aim())
    return posed.seen(solved(posed, "perceptual").light)


def dark_sky(brightness: float = 0.9) -> Light:
    """A textured sky, far darker than what a lamp adds to it; (1, SIZE, SIZE, 3)."""
    texture = gaussian_filter(np.random.default_rng(1).standard_normal((SIZE, SIZE)), 0.6)
    sky = 0.004 * np.exp(1.2 * texture)[..., None] * np.array([0.7, 0.9, 1.6])
    sky[np.hypot(ROWS - 70, COLS - 48) < 10] = brightness
    return np.clip(sky, 0, 1)[None].astype(np.float32)


def random_picture(seed: int) -> Light:
    """Blobs, points and noise over many orders of light, and colours of all kinds."""
    random = np.random.default_rng(seed)
    plane = np.zeros((SIZE, SIZE))
    for _ in range(random.integers(1, 8)):
        row, col = random.integers(0, SIZE, 2)
        far = np.hypot(ROWS - row, COLS - col)
        plane += 10 ** random.uniform(-3, 0) * (far < random.uniform(1, 30))
    plane += 10 ** random.uniform(-5, -2) * (1 + random.random() * random.random((SIZE, SIZE)))
    colour = random.random((3,)) ** random.uniform(0, 2)
    return np.clip(plane[..., None] * colour, 0, 1)[None].astype(np.float32)


def grey_aim(plane: np.ndarray, floor: float, lift: float = 1.0) -> np.ndarray:
    """(row, col) aim of a grey dome over an even floor."""
    master = np.repeat(plane[None, ..., None], 3, axis=-1)
    aimed = lifted(Aim(lift), SIGHT, master, np.full_like(master, floor), np.ones_like(master))
    return aimed[0, ..., 1]


# Laws of a dome


@settings(max_examples=40, deadline=None)
@given(seed=some.integers(0, 2**32 - 1), albedo=some.sampled_from([0.3, 0.5, 0.7]))
def test_nothing_is_seen_brighter_than_untouched(seed, albedo):
    scene, master = dome(albedo), random_picture(seed)
    observation, screen = scene.observation(SIZE, SIZE), scene.screen(SIZE, SIZE)
    master = master * screen[None, :, :, None]
    untouched = observation.observe(master)[0] @ WEIGHTS
    now = observation.observe(compensate(master, scene).light)[0] @ WEIGHTS
    assert (now - untouched)[screen].max() <= 0.02 * untouched[screen].max() / 15


@settings(max_examples=40, deadline=None)
@given(
    seed=some.integers(0, 2**32 - 1),
    lift=some.floats(0, 4),
    floor=some.floats(1e-4, 0.1),
)
def test_nothing_is_darkened_or_lifted_by_more_than_the_floor(seed, lift, floor):
    plane = random_picture(seed)[0] @ WEIGHTS
    aimed = grey_aim(plane, floor, lift)
    assert np.all(aimed >= plane - 1e-7)
    assert np.all(aimed <= plane + floor + 1e-6)
    assert aimed.max() <= 1 + 1e-6


@given(
    base=some.floats(1e-6, 1),
    lights=some.lists(some.floats(1e-6, 1), min_size=2, max_size=2),
    v=some.floats(0, 1),
)
def test_light_rises_with_light_and_gains_no_more_than_twice_its_base(base, lights, v):
    m = np.sort(np.array(lights))
    lifted_to = m * gain_of(m, np.full_like(m, base), v)
    assert lifted_to[1] >= lifted_to[0] * (1 - 1e-12)
    gained, of_base = lifted_to - m, np.hypot(base, v) - base
    assert np.all((gained >= 0) & (gained <= 2 * of_base * (1 + 1e-9) + 1e-12))


@settings(max_examples=40, deadline=None)
@given(
    base=some.floats(1e-4, 0.02),
    steps=some.lists(some.integers(0, 400), min_size=6, max_size=6, unique=True),
    lift=some.floats(0.25, 4),
)
def test_points_of_an_even_sky_keep_their_order(base, steps, lift):
    """To the share that `validation.laws.order` allows: points have a part in their own base."""
    light = 10 ** (np.array(steps) / 100 - 4)
    plane = np.full((SIZE, SIZE), base)
    places = [(16 + 32 * row, 16 + 32 * col) for row in range(2) for col in range(3)]
    for place, value in zip(places, sorted(light), strict=True):
        plane[place] = value
    aimed = grey_aim(plane, 0.03, lift)
    found = np.array([aimed[place] for place in places])
    assert np.all(np.diff(found) >= -0.05 * found[:-1])
    surroundings = np.median(np.maximum(aimed, 0.03)[plane == base]) - base  # as they are seen
    assert np.all(found - np.sort(light) <= 2.1 * surroundings)


@pytest.mark.parametrize("lift", [1.0, 2.0])
def test_around_a_limb_light_falls_as_the_masters(lift):
    far = np.hypot(ROWS - 47.5, COLS - 47.5)
    height = np.sqrt(np.clip(1 - (far / 25) ** 2, 0, None))
    aimed = grey_aim(np.where(far < 25, 0.4 * height**0.4, 0.0) + 0.0003, 0.012, lift)
    along = np.maximum(aimed, 0.012)[48, 48:]  # as it is seen
    assert np.all(np.diff(along) <= 1e-5)


def test_what_is_exact_is_shown_exactly():
    """Where nothing is missing the aim is the master."""
    bright = (0.3 + 0.5 * night(SIZE)).astype(np.float32)
    result = compensate(bright, dome())
    assert result.status is Status.EXACT
    on = dome().screen(SIZE, SIZE)
    shown = dome().observation(SIZE, SIZE).observe(result.light)
    np.testing.assert_allclose(shown[:, on], bright[:, on], atol=1e-6)


def test_without_lift_it_is_subtraction():
    for scene, light in ((dome(), dark_sky()), (stereo_at(0.05, 15.0), generated(96))):
        posed = pose(light, scene, Aim(lift=0.0))
        np.testing.assert_allclose(solved(posed, "perceptual").light, posed.subtractive, atol=1e-6)


# What a dome gains


def test_contrast_in_the_dark_is_nearer_to_the_masters_than_subtracted():
    scene, master = dome(), dark_sky()
    screen = scene.screen(SIZE, SIZE) & (np.hypot(ROWS - 70, COLS - 48) > 25)  # far from the lamp
    wanted = np.std(np.log(master[0][screen] @ WEIGHTS))
    kept = [
        np.std(np.log(seen(master, scene, Aim(lift))[0][screen] @ WEIGHTS)) / wanted
        for lift in (0.0, 1.0)
    ]
    assert kept[1] > 1.5 * kept[0]


def test_a_blue_sky_is_not_shown_as_purple():
    """A warm floor has more red than the sky: blue alone must not be lifted beside it."""
    sky = np.full((1, SIZE, SIZE, 3), [0.0007, 0.0013, 0.0033])
    floor = np.full_like(sky, [0.012, 0.009, 0.008])
    aimed = lifted(Aim(), SIGHT, sky, floor, np.ones_like(sky))
    _, green, blue = np.maximum(aimed, floor)[0, 40, 40]
    gain = aimed[0, 40, 40] @ WEIGHTS / (sky[0, 40, 40] @ WEIGHTS)
    assert gain * sky[0, 40, 40, 2] > 1.5 * green  # without mixing
    assert blue - green < 0.1 * green


def test_more_lift_is_more_contrast_and_less_black():
    scene, master = dome(), dark_sky()
    screen = scene.screen(SIZE, SIZE)
    blacks = []
    for lift in (0.0, 0.5, 1.0, 2.0):
        luminance = seen(master, scene, Aim(lift=lift))[0][screen] @ WEIGHTS
        blacks.append(np.quantile(luminance, 0.1))
    assert blacks == sorted(blacks)


def test_both_eyes_of_a_3d_dome_are_lifted_by_the_same_light():
    """Else the eyes would see two blacks, where one view is lit more than the other."""
    scene = load_scene("dome_stereo_spectral")
    screen = scene.screen(96, 96)
    light = np.full((2, 96, 96, 3), 0.01, np.float32)
    light[0, 40:56, 20:76] = 0.9  # one view is lit much more than the other
    light[1, 40:44, 20:30] = 0.9
    light *= screen[None, :, :, None]
    posed = pose(light, scene)
    now = posed.seen(solved(posed, "perceptual").light)
    dark = screen & (light.max(axis=(0, 3)) < 0.02)
    dark[30:66, 10:86] = False
    black = [np.median(view[dark] @ scene.projector.luminance_weights) for view in now]
    subtracted = posed.seen(posed.subtractive)
    left, right = (np.median(view[dark] @ scene.projector.luminance_weights) for view in subtracted)
    assert left > 2 * right
    assert black[0] / black[1] < 0.75 * left / right


# Pairs


def test_a_veil_softens_a_ghosts_edge_and_is_no_brighter_than_the_ghost():
    scene, light = stereo_at(0.05, 15.0), generated(256)
    posed = pose(light, scene)
    plain, ours = (
        posed.seen(x) - light for x in (posed.subtractive, solved(posed, "perceptual").light)
    )
    assert ours.min() > -1e-5  # nothing is darkened
    assert ours.max() <= 1.001 * plain.max()
    at = plain[0].max(-1) > 0.3 * plain.max()
    slopes = [np.abs(np.gradient(left[0].sum(-1), axis=1))[at].mean() for left in (plain, ours)]
    assert slopes[1] < 0.96 * slopes[0]


def test_a_veil_on_black_is_darker_than_its_ghost_and_spreads_no_more_light():
    ghosts = np.zeros((2, SIZE, SIZE, 3))
    ghosts[:, 40:56, 40:56] = 0.02, 0.02, 0.01
    rim = veiled(Aim(), SIGHT, np.zeros_like(ghosts), ghosts)
    assert rim.max() < 0.5 * SHARE * ghosts.max()
    assert 0 < rim.sum() < SHARE * ghosts.sum()
    assert np.all(rim[:, 44:52, 44:52] == 0)  # inside it is the ghost itself


def test_a_veil_has_the_hue_of_what_is_brighter_and_its_own_on_black():
    left = np.zeros((2, 40, 40, 3))
    left[:, 15:25, 15:25] = 0.02, 0.02, 0.01
    sight = Sight(np.ones((40, 40), bool), WEIGHTS, 15.0, 10.0)
    beside = 0, 20, 27
    colour = np.array([0.3, 0.1, 0.05])
    lit = veiled(Aim(), sight, np.broadcast_to(colour, left.shape).copy(), left)[beside]
    assert lit @ WEIGHTS > 1.005 * (colour @ WEIGHTS)
    np.testing.assert_allclose(lit / colour, np.full(3, (lit / colour)[0]), rtol=0.02)
    dark = veiled(Aim(), sight, np.zeros_like(left), left)[beside]
    np.testing.assert_allclose(dark / dark[0], [1, 1, 0.5], rtol=0.02)


@pytest.mark.parametrize("kind", ["dome", "pair"])
def test_any_array_library(kind):
    """The formulas; NumPy in double precision against the strict reference library."""
    xp = array_api_strict
    random = np.random.default_rng(2)
    master = random.random((1 if kind == "dome" else 2, 20, 24, 3)) * 0.1
    sight = Sight(np.ones((20, 24), bool), WEIGHTS, 15.0, 4.0)
    there = replace(sight, screen=xp.asarray(sight.screen))
    floor = np.full_like(master, 0.05)
    if kind == "dome":
        arguments = (master, floor, np.ones_like(master))
        expected = lifted(Aim(), sight, *arguments)
        found = lifted(Aim(), there, *map(xp.asarray, arguments))
    else:
        expected = veiled(Aim(), sight, master, floor * (master > 0.05))
        found = veiled(Aim(), there, *map(xp.asarray, (master, floor * (master > 0.05))))
    np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-10)


@pytest.mark.parametrize("lift", [-1, 4.5, np.inf, np.nan])
def test_a_lift_that_means_nothing_is_refused(lift):
    with pytest.raises(InputError, match="lift"):
        Aim(lift)


def test_tabulated_theatres_and_tables_have_an_aim():
    shutter = load_scene("stereo_shutter")
    light = generated(96)
    before, after = (
        Appraisal(pose(light, shutter)).loss(x) for x in (light, compensate(light, shutter).light)
    )
    assert after < before + NO_DIFFERENCE


def test_a_still_master_stands_still_and_a_slow_fade_has_no_jump():
    """The aim knows one frame only; nothing in it may switch."""
    scene, master = dome(), dark_sky()
    first, again = (seen(master, scene) for _ in range(2))
    assert (first == again).all()
    screen = scene.screen(SIZE, SIZE)
    levels = [
        seen((fade * master).astype(np.float32), scene)[0][screen].mean()
        for fade in np.linspace(0.02, 1, 40)
    ]
    steps = np.diff(levels)
    bends = np.abs(np.diff(steps)) / np.mean(np.abs(steps))
    assert bends.max() < 0.5


def test_a_flash_pumps_by_its_pollution_and_the_lift():
    """Far from the flash, what is seen rises as it does untouched, no more."""
    scene = dome()
    rows, cols = np.mgrid[:SIZE, :SIZE]
    far = scene.screen(SIZE, SIZE) & (np.hypot(rows - 70, cols - 48) > 30)
    calm, flash = dark_sky(0.2), dark_sky(1.0)
    rise = [
        (luminance(flash) - luminance(calm)).mean()
        for luminance in (
            lambda light: (seen(light, scene)[0] @ WEIGHTS)[far],
            lambda light: (pose(light, scene).seen(light)[0] @ WEIGHTS)[far],
        )
    ]
    assert 0 < rise[0] < 1.05 * rise[1]
