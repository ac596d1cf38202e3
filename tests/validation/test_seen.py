"""Plain figures of made-up pictures whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from domesim.scene import load_scene
from validation import seen

DOME = load_scene("dome_imax")
PAIR = load_scene("stereo_cinema_silver")
SIZE = 180  # a pixel a degree
SCREEN = DOME.screen(SIZE, SIZE)
RANDOM = np.random.default_rng(5)


def grey(*planes):
    return np.repeat(np.stack(planes)[..., None], 3, axis=-1).astype(np.float64)


def texture(sigma=1.0, shape=(SIZE, SIZE)):
    """Positive, mean about 0.01, of that size in pixels."""
    noise = gaussian_filter(RANDOM.standard_normal(shape), sigma)
    return 0.01 * (1 + 0.5 * noise / np.abs(noise).max())


def coloured(shape=(2, 40, 60)):
    return RANDOM.uniform(0.02, 0.9, (*shape, 3))


def test_light_kept_is_the_ratio_where_it_is_asked_for():
    master = coloured()
    left, right = np.zeros((2, 40, 60), bool), np.zeros((2, 40, 60), bool)
    left[0, :, :50], right[1] = True, True
    kept = master * np.array([0.5, 3.0])[:, None, None, None]
    kept[0, :, 50:] = 7  # not asked for
    for where, ratio in ((left, 0.5), (right, 3.0)):
        found = seen.light_kept(master, kept, where, PAIR)
        assert (found.median, found.fifth) == pytest.approx((ratio, ratio))


def test_light_kept_has_a_median_and_a_fifth_percentile():
    master, ratio = np.full((2, 40, 60, 3), 0.2), np.linspace(0, 1, 2400).reshape(1, 40, 60, 1)
    found = seen.light_kept(master, master * ratio, np.ones((40, 60), bool), PAIR)
    assert (found.median, found.fifth) == pytest.approx((0.5, 0.05), abs=1e-3)


def test_black_keeps_no_light_and_the_corners_do_not_count():
    master = grey(np.where(SCREEN, 0.1, 0.3))
    veiled = grey(np.where(SCREEN, 0.2, 0.3))
    everywhere = np.ones((SIZE, SIZE), bool)
    assert seen.light_kept(master, veiled, everywhere, DOME).median == pytest.approx(2)
    assert seen.light_kept(0 * master, veiled, everywhere, DOME) is None
    assert seen.light_kept(master, veiled, ~SCREEN, DOME) is None


@pytest.mark.parametrize(("distance", "expected"), [(0.009, 0.0), (0.011, 0.25)])
def test_chroma_shift_is_a_share_of_the_pixels_asked_for(distance, expected):
    """A quarter is shifted by that distance in u', the rest not at all."""
    to_xyz = PAIR.projector.to_xyz
    u, v = 0.2 + np.zeros((2, 40, 60)), np.full((2, 40, 60), 0.47)

    def light(u):
        xyz = np.stack([9 * u / (4 * v), np.ones_like(u), (12 - 3 * u - 20 * v) / (4 * v)], -1)
        return 0.1 * xyz @ np.linalg.inv(to_xyz).T

    shifted = u.copy()
    shifted[0, :10] += distance
    where = np.zeros((2, 40, 60), bool)
    where[0] = True
    assert seen.chroma_shift(light(u), 2 * light(shifted), where, PAIR) == expected
    moved = seen.chromaticity(light(shifted) @ to_xyz.T) - seen.chromaticity(light(u) @ to_xyz.T)
    assert np.abs(moved).max() == pytest.approx(distance)
    assert seen.chroma_shift(0 * light(u), light(u), where, PAIR) is None


@pytest.mark.parametrize("band", seen.BANDS)
def test_structure_seen_is_its_share_whatever_the_veil(band):
    master = texture(3.0)
    found = seen.structure_seen(grey(master), grey(0.4 * master + 0.02), DOME, *band)
    assert found == pytest.approx(0.4, rel=1e-6)
    assert seen.structure_seen(grey(master), grey(0.03 - master), DOME, *band) < 0


def test_structure_is_told_by_its_size():
    """Blur of 4 degrees takes texture of 1 degree and leaves that of 12."""
    fine, coarse = (grey(texture(size)) for size in (1, 12))
    blurred = [gaussian_filter(one, (0, 4, 4, 0)) for one in (fine, coarse)]
    assert seen.structure_seen(fine, blurred[0], DOME, 0.25, 1) < 0.1
    assert seen.structure_seen(coarse, blurred[1], DOME, 10, 30) > 0.85


def test_structure_is_looked_for_in_the_darker_part_only():
    master = texture(3.0)
    master[60:90, 60:90] = RANDOM.uniform(0.5, 1, (30, 30))
    shown = np.where(master > 0.1, 0, 0.7 * master)
    found = seen.structure_seen(grey(master), grey(shown), DOME, 2, 10)
    assert found == pytest.approx(0.7, rel=1e-6)


def test_an_even_picture_has_no_structure_and_bands_have_an_order():
    black = np.zeros((1, SIZE, SIZE, 3))
    assert seen.structure_seen(black, black, DOME, 2, 10) is None
    with pytest.raises(ValueError, match="got 10 and 2"):
        seen.structure_seen(black, black, DOME, 10, 2)


def turned(light, degrees, saturation):
    """The same luminance, its (R - Y, B - Y) turned and scaled; G follows from them."""
    weights = PAIR.projector.luminance_weights
    y = light @ weights
    opponent = (light[..., 0] - y + 1j * (light[..., 2] - y)) * saturation
    opponent = opponent * np.exp(1j * np.deg2rad(degrees))
    red, blue = y + opponent.real, y + opponent.imag
    green = (y - weights[0] * red - weights[2] * blue) / weights[1]
    return np.stack([red, green, blue], axis=-1)


@pytest.mark.parametrize(("degrees", "saturation"), [(0, 1), (25, 0.6), (-170, 1.5)])
def test_hue_and_saturation_are_those_that_were_made(degrees, saturation):
    master = coloured()
    found = seen.saturation_and_hue(master, turned(master, degrees, saturation), PAIR)
    assert found.hue_shift == pytest.approx(abs(degrees), abs=1e-6)
    assert found.saturation == pytest.approx(saturation)


def test_only_the_darker_half_has_its_hue_judged():
    master = coloured()
    y = master @ PAIR.projector.luminance_weights
    bright = y >= np.median(y, axis=(1, 2), keepdims=True)
    shown = np.where(bright[..., None], turned(master, 120, 3), turned(master, 10, 0.9))
    found = seen.saturation_and_hue(master, shown, PAIR)
    assert found.hue_shift == pytest.approx(10)
    assert found.saturation == pytest.approx(0.9)


def test_grey_has_no_hue():
    plane = RANDOM.uniform(0.1, 1, (2, 40, 60))
    assert seen.saturation_and_hue(grey(*plane).astype(np.float32), coloured(), PAIR) is None


def lamp(dark, ring=None):
    """A lamp of 6 degrees in the dark; a ring around it if one is given, in cd/m²."""
    rows, cols = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    distance = np.hypot(rows, cols + 20)
    plane = np.where(distance < 6, 10.0, dark)
    if ring is not None:
        plane = np.where((distance >= 7) & (distance < 9), ring, plane)
    return grey(plane / DOME.projector.white)


def test_a_ring_that_outshines_its_lamp_is_a_halo():
    """Area between 7 and 9 pixels from the lamp; its share of the hemisphere by solid angle."""
    assert seen.halos(lamp(0.1), lamp(0.1), DOME) == 0
    found = seen.halos(lamp(0.1), lamp(0.1, 20.0), DOME)
    ring = np.pi * (9**2 - 7**2) * (np.pi / 180) ** 2 / (2 * np.pi)
    assert 0.5 * ring < found < 2 * ring


def test_no_halo_without_a_bright_thing_beside_it(monkeypatch):
    """The same ring around a lamp that is only 4.8 times as bright as the dark."""
    dim = lamp(0.1)
    dim[dim > 0.1 / DOME.projector.white] = 0.48 / DOME.projector.white
    assert seen.halos(dim, lamp(0.1, 20.0), DOME) == 0
    monkeypatch.setattr(seen, "HALO_BRIGHTER", 1.5)
    assert seen.halos(dim, lamp(0.1, 20.0), DOME) > 0


def test_what_lies_below_the_black_of_halos_has_no_contrast():
    assert seen.halos(lamp(0.1) * 1e-4, lamp(0.1, 20.0), DOME) == 0


def test_the_highest_within_a_disc_is_found():
    plane = RANDOM.uniform(0, 1, (23, 31))
    rows, cols = np.mgrid[:23, :31]
    expected = [
        [plane[np.hypot(rows - row, cols - col) <= 4.3].max() for col in range(31)]
        for row in range(23)
    ]
    assert np.array_equal(seen._highest_within(plane, 4.3), expected)


def test_black_level_is_the_first_percentile_on_the_screen():
    plane = np.zeros((SIZE, SIZE))
    plane[SCREEN] = RANDOM.permutation(np.linspace(0.1, 1.1, SCREEN.sum()))
    found = seen.black_level(grey(plane), DOME)
    assert found == pytest.approx(0.11 * DOME.projector.white, rel=1e-3)


@pytest.mark.parametrize("figure", [seen.halos, seen.saturation_and_hue])
def test_pictures_of_two_shapes_are_refused(figure):
    with pytest.raises(ValueError, match="takes"):
        figure(coloured(), coloured()[:, 1:], PAIR)
