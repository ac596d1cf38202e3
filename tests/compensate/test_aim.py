"""The aim: what it must keep, what it may lift, and how it behaves in films."""

from __future__ import annotations

from dataclasses import replace

import array_api_strict
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from compensate.aim import Aim, Sight, lifted, veiled
from compensate.figures import Appraisal
from compensate.master import compensate
from compensate.pose import pose
from compensate.solve import solved
from compensate.solver.result import Status
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import load_scene
from validation.inputs import dome_at, stereo_at
from validation.masters import night
from validation.pairs import generated

SIZE = 96
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def dome(albedo: float = 0.5, white: float = 15.0):
    return dome_at(albedo, white)


def seen(light: Light, scene, aim: Aim | None = None) -> Light:
    posed = pose(light, scene, aim or Aim())
    return posed.seen(solved(posed, "perceptual").light)


def dark_sky(brightness: float = 0.9) -> Light:
    """A textured sky, far darker than what a lamp adds to it; (1, SIZE, SIZE, 3)."""
    texture = gaussian_filter(np.random.default_rng(1).standard_normal((SIZE, SIZE)), 0.6)
    sky = 0.004 * np.exp(1.2 * texture)[..., None] * np.array([0.7, 0.9, 1.6])
    rows, cols = np.mgrid[:SIZE, :SIZE]
    sky[np.hypot(rows - 70, cols - 48) < 10] = brightness
    return np.clip(sky, 0, 1)[None].astype(np.float32)


def test_contrast_and_hue_are_the_masters_where_the_base_is_lifted():
    scene, master = dome(), dark_sky()
    found = seen(master, scene)
    screen = scene.screen(SIZE, SIZE).copy()
    rows, cols = np.mgrid[:SIZE, :SIZE]
    screen &= np.hypot(rows - 70, cols - 48) > 25  # away from the lamp
    wanted, shown = (light[0][screen] @ WEIGHTS for light in (master, found))
    assert np.median(shown / wanted) > 2  # it is lifted
    subtracted = seen(master, scene, Aim(lift=0.0))[0][screen] @ WEIGHTS
    contrast, left = (
        np.std(np.log(light)) / np.std(np.log(wanted)) for light in (shown, subtracted)
    )
    assert contrast > 0.55
    assert left < 0.3
    blue, wanted_blue = (
        light[0][screen] / light[0][screen].sum(-1, keepdims=True) for light in (found, master)
    )
    assert np.abs(blue - wanted_blue).max(axis=-1).mean() < 0.05


def test_without_lift_it_is_subtraction():
    for scene, light in ((dome(), dark_sky()), (stereo_at(0.05, 15.0), generated(96))):
        posed = pose(light, scene, Aim(lift=0.0, hue=0.0))
        np.testing.assert_allclose(solved(posed, "perceptual").light, posed.subtractive, atol=1e-6)


def test_both_eyes_of_a_3d_dome_are_lifted_by_the_same_light():
    """Else the eyes would see two blacks, where one view is lit more than the other."""
    scene = load_scene("dome_stereo_spectral")
    screen = scene.screen(96, 96)
    light = np.full((2, 96, 96, 3), 0.01, np.float32)
    light[0, 40:56, 20:76] = 0.9  # one view is lit much more than the other
    light[1, 40:44, 20:30] = 0.9
    light *= screen[None, :, :, None]
    posed = pose(light, scene)
    seen = posed.seen(solved(posed, "perceptual").light)
    dark = screen & (light.max(axis=(0, 3)) < 0.02)
    dark[30:66, 10:86] = False
    black = [np.median(view[dark] @ scene.projector.luminance_weights) for view in seen]
    untouched = posed.seen(posed.subtractive)
    left, right = (np.median(view[dark] @ scene.projector.luminance_weights) for view in untouched)
    assert left > 2 * right
    assert black[1] == pytest.approx(black[0], rel=0.05)


def test_what_is_exact_is_shown_exactly():
    """Where nothing is missing the aim is the master."""
    bright = (0.3 + 0.5 * night(SIZE)).astype(np.float32)
    result = compensate(bright, dome())
    assert result.status is Status.EXACT
    on = dome().screen(SIZE, SIZE)
    shown = dome().observation(SIZE, SIZE).observe(result.light)
    np.testing.assert_allclose(shown[:, on], bright[:, on], atol=1e-6)


def test_what_is_bright_keeps_its_light_and_has_no_halo():
    scene, master = dome(), dark_sky()
    found = seen(master, scene)
    rows, cols = np.mgrid[:SIZE, :SIZE]
    far = np.hypot(rows - 70, cols - 48)
    inside = far < 9
    assert found[0][inside] == pytest.approx(master[0][inside], rel=0.1)
    luminance = found[0] @ WEIGHTS
    beside, around = (
        luminance[(far > 11) & (far < 14)].mean(),
        luminance[(far > 20) & (far < 30)].mean(),
    )
    assert beside > 0.75 * around  # a plain mean as base: 0.27


def test_a_moon_has_no_dark_rim():
    rows, cols = np.mgrid[:80, :80]
    far = np.hypot(rows - 40, cols - 40)
    master = np.where(far < 10, 0.9, 0.003)[None, ..., None] * np.ones(3)
    sight = Sight(np.ones((80, 80), bool), WEIGHTS, 15.0, 4.0)
    aimed = lifted(Aim(), sight, master, np.full_like(master, 0.01), np.ones_like(master))[
        0, ..., 1
    ]
    beside, around = aimed[(far > 11) & (far < 13)], aimed[far > 30]
    assert around.min() > 2 * 0.003
    assert beside.min() > 0.98 * around.min()  # a plain guided filter as base: 0.51
    assert aimed[far < 8] == pytest.approx(0.9, rel=0.05)


def test_more_lift_is_more_contrast_and_less_black():
    scene, master = dome(), dark_sky()
    screen = scene.screen(SIZE, SIZE)
    blacks, kept = [], []
    for lift in (0.0, 1.0, 2.5, 4.0):
        luminance = seen(master, scene, Aim(lift=lift))[0][screen] @ WEIGHTS
        dark = luminance[luminance < np.median(luminance) * 3]
        blacks.append(np.quantile(luminance, 0.1))
        kept.append(np.std(np.log(dark)))
    assert blacks == sorted(blacks)
    assert kept == sorted(kept)


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
    assert slopes[1] < 0.8 * slopes[0]


def test_on_black_a_veil_is_fainter_than_on_grey():
    left = np.zeros((2, 40, 40, 3))
    left[:, 15:25, 15:25] = 0.02
    sight = Sight(np.ones((40, 40), bool), WEIGHTS, 15.0, 10.0)
    veils = [
        veiled(Aim(), sight, np.full_like(left, grey), left)[0, 20, 27, 1] - grey
        for grey in (0.0, 0.05)
    ]
    assert 0 < veils[0] < 0.6 * veils[1]


def test_a_veil_has_the_hue_of_what_is_brighter_and_its_own_on_black():
    left = np.zeros((2, 40, 40, 3))
    left[:, 15:25, 15:25] = 0.02, 0.02, 0.01
    sight = Sight(np.ones((40, 40), bool), WEIGHTS, 15.0, 10.0)
    beside = 0, 20, 27
    colour = np.array([0.3, 0.1, 0.05])
    lit = veiled(Aim(), sight, np.broadcast_to(colour, left.shape).copy(), left)[beside]
    assert lit @ WEIGHTS > 1.02 * (colour @ WEIGHTS)
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


@pytest.mark.parametrize(
    "settings",
    [
        {"lift": -1},
        {"hue": 1.1},
        {"darkest": 0},
        {"darkest": 2},
        {"reach": np.inf},
        {"dark": 0},
    ],
)
def test_settings_that_mean_nothing(settings):
    with pytest.raises(InputError, match=f"aim's? .*{next(iter(settings))}|{next(iter(settings))}"):
        Aim(**settings)


def test_what_the_eye_hardly_sees_lifts_little_and_nothing_lifts_more_than_it_lacks():
    """Else a dark picture in a dim theatre looks worse than plain subtraction."""
    aim = Aim()
    missing = np.geomspace(1e-6, 1, 200)  # cd/m²
    raised = np.array([aim.raised(float(each), aim.dark) for each in missing])
    slopes = np.diff(raised) / np.diff(missing)
    assert np.all((slopes > 0) & (slopes < aim.lift))  # so that no flash pumps more
    share = raised / (aim.lift * missing)
    assert share[0] < 1e-3
    assert share[-1] > 0.98
    assert aim.raised(0.0, aim.dark) == 0.0


def test_tabulated_theatres_and_tables_have_an_aim():
    shutter = load_scene("stereo_shutter")
    light = generated(96)
    before, after = (
        Appraisal(pose(light, shutter)).loss(x) for x in (light, compensate(light, shutter).light)
    )
    assert after < before


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
    """Far from the flash, what is seen rises by no more than `lift` times the untouched rise."""
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
    assert 0 < rise[0] < Aim().lift * rise[1]
