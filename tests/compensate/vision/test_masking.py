"""Masking: the filters divide the picture up without loss, and a texture hides what is like it."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from compensate.fourier import Fourier
from compensate.vision.csf import daly
from compensate.vision.masking import (
    Cortex,
    dom,
    fan,
    masked_difference,
    mesa,
    sensitivity,
    transducer,
)
from domesim.errors import InputError
from domesim.room.viewing import Viewing

ROWS, COLS, PER_DEGREE = 96, 128, 16.0
SEAT = Viewing(extent=COLS / PER_DEGREE, image_area=48.0, distance=3.0, adaptation=5.0)
MEAN = 5.0
INSIDE = (0, slice(24, -24), slice(32, -32))


def grating(frequency, contrast, degrees=0.0, phase=0.3):
    """A cosine that varies along `degrees` from the rows' direction, on the mean luminance."""
    down, across = np.mgrid[:ROWS, :COLS] / PER_DEGREE
    along = across * np.cos(np.radians(degrees)) + down * np.sin(np.radians(degrees))
    return MEAN * contrast * np.cos(2 * pi * frequency * along + phase)[None]


PLAIN = np.full((1, ROWS, COLS), MEAN)


def difference(reference, test, viewing=SEAT, cortex=None):
    return masked_difference(reference, test, PLAIN, viewing, cortex=cortex)


def test_the_published_transducer():
    # term by term in 30-digit decimals; at S C = 1, 3.291 (2^(1/3) - 1) / (0.2599 4.433^0.8)
    signals = [0.0, 0.1, 0.5, 1.0, 10.0, 100.0]
    responses = [0, 0.001537236648, 0.1695341711576, 1.000011214419, 14.268767678, 30.649941265]
    assert transducer(signals) == pytest.approx(responses, rel=1e-6)


def test_the_transducer_is_odd_and_rises():
    signals = np.linspace(-200, 200, 4001)
    responses = transducer(signals)
    assert (responses == -transducer(-signals)).all()
    assert (np.diff(responses) > 0).all()
    # pedestals above the threshold make the slope smaller and smaller: that is masking
    assert (np.diff(responses[signals > 3], 2) < 0).all()


def test_weak_signals_do_not_cancel_in_single_precision():
    signals = np.geomspace(1e-6, 1e3, 200)
    found = transducer(signals.astype(np.float32))
    assert found.dtype == np.float32
    assert found == pytest.approx(transducer(signals), rel=1e-5)
    assert transducer(1e-6) == pytest.approx(3.291e-18 / 3 / (0.2599 * 3.433**0.8), rel=1e-5)


def test_a_mesa_is_flat_and_falls_to_nothing():
    assert mesa(np.array([0.0, 1.0, 2.0]), 2.0).tolist() == [1, 1, 1]
    assert mesa(np.array([3.0, 4.0, 50.0]), 2.0) == pytest.approx([0.5, 0, 0], abs=1e-15)


def test_a_dom_is_an_octave_around_its_peak():
    found = dom(np.array([0.0, 2.0, 3.0, 4.0, 6.0, 8.0, 99.0]), 4.0)
    assert found == pytest.approx([0, 0, 0.5, 1, 0.5, 0, 0], abs=1e-15)


@pytest.mark.parametrize("orientations", [2, 3, 6])
def test_a_fan_is_one_at_its_orientation_and_zero_at_its_neighbours(orientations):
    places = np.arange(orientations) * pi / orientations
    found = np.array([fan(places, index, orientations) for index in range(orientations)])
    assert found == pytest.approx(np.eye(orientations), abs=1e-12)
    assert fan(np.array(pi), 0, orientations) == pytest.approx(1)


@pytest.mark.parametrize(("orientations", "lowest"), [(6, 0.5), (4, 1.0), (3, 0.3)])
def test_all_filters_together_give_the_picture_back(orientations, lowest):
    rows, cols = 60, 84
    fourier = Fourier(rows, cols)
    picture = np.random.default_rng(1).standard_normal((rows, cols))
    down, across = fourier.frequencies(PER_DEGREE)
    rho, angle = np.hypot(down, across), np.arctan2(down, across) % pi
    peaks = Cortex(orientations, lowest).peaks(PER_DEGREE)
    filters = [
        dom(rho, peak) * fan(angle, index, orientations)
        for peak in peaks
        for index in range(orientations)
    ]
    assert min(f.min() for f in filters) >= -1e-12
    rests = [mesa(rho, lowest / 2), 1 - mesa(rho, peaks[-1])]
    assert sum(filters) + sum(rests) == pytest.approx(np.ones_like(rho), abs=1e-12)
    spectrum = fourier.forward(picture)
    bands = [fourier.inverse(spectrum * f) for f in (*filters, *rests)]
    assert sum(bands) == pytest.approx(picture, abs=1e-10)
    # neither rest is needed where all mechanisms look
    middle = (rho >= lowest) & (rho <= peaks[-1])
    assert sum(filters)[middle] == pytest.approx(1, abs=1e-12)


def test_octaves_up_to_nyquist():
    assert Cortex().peaks(42.9) == [0.5, 1, 2, 4, 8, 16]
    assert Cortex().peaks(16.0) == [0.5, 1, 2, 4, 8]
    assert Cortex().peaks(15.9) == [0.5, 1, 2, 4]
    assert Cortex(lowest=3.0).peaks(5.9) == []


def test_the_csf_in_one_dimension_is_the_mean_over_orientations():
    seat = {"adaptation": 5.0, "image_area": 48.0, "distance": 3.0}
    angles = np.linspace(0, 2 * pi, 400, endpoint=False)
    for frequency in (0.5, 2.0, 8.0, 16.0):
        mean = daly(frequency, angles, **seat).mean()
        assert sensitivity(frequency, SEAT) == pytest.approx(mean, rel=1e-3)
    assert sensitivity([[0.0], [4.0]], SEAT).shape == (2, 1)


@pytest.mark.parametrize("frequency", [2.0, 4.0])
@pytest.mark.parametrize("degrees", [0, 30, 60, 90, 150])
@pytest.mark.parametrize("signal", [1.0, 8.0])
def test_a_mechanism_sees_its_grating(frequency, degrees, signal):
    """Rationale: at a band's peak, along a fan's axis, all others are blind.

    Expected: v = R(S C(x))², with the contrast that the grating has at each pixel.
    """
    strength = sensitivity(frequency, SEAT)
    added = grating(frequency, signal / strength, degrees)
    found = difference(PLAIN, PLAIN + added)
    expected = transducer(strength * added / MEAN) ** 2
    assert found[INSIDE] == pytest.approx(expected[INSIDE], abs=0.04 * expected.max())


@pytest.mark.parametrize(("frequency", "step"), [(1.0, 2), (0.5, 4)])
def test_coarse_bands_are_the_same_on_a_reduced_grid(frequency, step):
    strength = sensitivity(frequency, SEAT)
    added = grating(frequency, 4 / strength, phase=0.0)  # the mirrored edges then go on smoothly
    found = difference(PLAIN, PLAIN + added)
    expected = transducer(strength * added / MEAN) ** 2
    sampled = (0, slice(24, -24, step), slice(32, -32, step))
    assert found[sampled] == pytest.approx(expected[sampled], abs=0.05 * expected.max())
    assert found[INSIDE].mean() == pytest.approx(expected[INSIDE].mean(), rel=0.1)


@pytest.mark.parametrize(
    ("mask", "hides"),
    [
        ((4.0, 0.5, 0), True),
        ((4.0, 0.5, 90), False),  # another orientation
        ((1.0, 0.5, 0), False),  # another band
    ],
)
def test_a_texture_hides_what_is_like_it(mask, hides):
    texture = PLAIN + grating(*mask)
    added = grating(4.0, 0.03, 0, phase=1.0)
    plain = difference(PLAIN, PLAIN + added)[INSIDE].sum()
    masked = difference(texture, texture + added)[INSIDE].sum()
    if hides:
        assert masked < 0.3 * plain
    else:
        assert masked == pytest.approx(plain, rel=0.1)


def test_slow_veils_are_left_to_the_threshold():
    assert difference(PLAIN, PLAIN + 0.5).max() < 1e-6
    assert difference(PLAIN, PLAIN + grating(2.0, 0.1)).max() > 1


def scene():
    rng = np.random.default_rng(3)
    reference = rng.uniform(0.5, 9, (2, 60, 128))
    test = reference.copy()
    test[0, 20:40, 30:60] += 1.5
    test[1, 5:15, 80:90] += 4
    return reference, test, rng.uniform(2, 6, (2, 60, 128))


def test_which_picture_is_the_reference_does_not_matter():
    reference, test, adaptation = scene()
    forth = masked_difference(reference, test, adaptation, SEAT)
    back = masked_difference(test, reference, adaptation, SEAT)
    assert forth.dtype == np.float32
    assert forth == pytest.approx(back, rel=1e-5, abs=1e-6)
    assert forth.min() >= 0


def test_only_contrast_matters():
    planes = scene()
    brighter = [4 * plane for plane in planes]
    expected = masked_difference(*planes, SEAT)
    assert masked_difference(*brighter, SEAT) == pytest.approx(expected, rel=1e-3, abs=1e-4)


def test_contrast_is_local():
    added = grating(4.0, 0.02)
    dim = PLAIN.copy()
    dim[..., COLS // 2 :] /= 2
    found = masked_difference(PLAIN, PLAIN + added, dim, SEAT)[0, 24:-24]
    assert found[:, 96:120].sum() > 2 * found[:, 8:32].sum()


def test_black_is_finite():
    black = np.zeros((1, ROWS, COLS))
    found = masked_difference(black, black + 1e-4, black, SEAT)
    assert np.isfinite(found).all()


def test_bands_beyond_the_eye_are_left_out():
    added = grating(8.0, 0.9, phase=0.0)
    lights = np.geomspace(1, 1e-4, 400)
    seats = [Viewing(SEAT.extent, SEAT.image_area, SEAT.distance, light) for light in lights]
    blind = next(index for index, seat in enumerate(seats) if sensitivity(8.0, seat) < 1)
    assert difference(PLAIN, PLAIN + added, viewing=seats[blind - 1])[INSIDE].max() > 0.4
    assert difference(PLAIN, PLAIN + added, viewing=seats[blind])[INSIDE].max() < 1e-4


def test_what_cannot_be_is_refused():
    wide = Viewing(extent=180.0, image_area=48.0, distance=3.0, adaptation=5.0)
    with pytest.raises(InputError, match=r"1 pixels per degree or more, got 0.711; use a larger"):
        difference(PLAIN, PLAIN, viewing=wide)
    with pytest.raises(InputError, match="a cortex takes"):
        Cortex(orientations=1)


def test_views_do_not_mix():
    reference, test, adaptation = scene()
    both = masked_difference(reference, test, adaptation, SEAT)
    for view in range(2):
        one = slice(view, view + 1)
        alone = masked_difference(reference[one], test[one], adaptation[one], SEAT)
        assert both[one] == pytest.approx(alone, rel=1e-3, abs=1e-4)


def test_rows_are_treated_as_columns_are():
    planes = scene()
    turned = [np.ascontiguousarray(plane.swapaxes(1, 2)) for plane in planes]
    found = masked_difference(*planes, SEAT)
    assert masked_difference(*turned, SEAT) == pytest.approx(
        found.swapaxes(1, 2), rel=1e-2, abs=float(1e-2 * found.max())
    )
