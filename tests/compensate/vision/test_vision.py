"""Daly's CSF against its published formula, and what the weighting makes of it."""

from __future__ import annotations

from math import cos, exp, pi, sqrt

import numpy as np
import pytest
from theatres import BT709

from compensate.vision.csf import LowFrequencyFloor, daly
from compensate.weighting import PerceptualWeighting, csf_gains, linear_ycbcr
from domesim.errors import InputError
from domesim.room.viewing import of_flat_screen

PAPER = {"adaptation": 5.0, "distance": 3.0, "image_area": 1282.28}


def published(rho, theta, l, d, i2, e):  # noqa: E741
    """Daly 1992, eqs. 14.1-14.9, term by term in plain floats."""

    def s1(frequency):
        a = 0.801 * (1 + 0.7 / l) ** -0.2
        b = 0.3 * (1 + 100 / l) ** 0.15
        size = ((3.23 * (frequency**2 * i2) ** -0.3) ** 5 + 1) ** (-1 / 5)
        x = b * 0.9 * frequency
        return size * a * 0.9 * frequency * exp(-x) * sqrt(1 + 0.06 * exp(x))

    bandwidth = 0.856 * d**0.14 * (1 / (1 + 0.24 * e)) * (0.11 * cos(4 * theta) + 0.89)
    return 250 * min(s1(rho / bandwidth), s1(rho))


def test_the_published_points():
    """Values computed elsewhere from the published formula (design.md section 4)."""
    found = daly([1.0, 4.0, 13.404], 0.0, **PAPER)
    assert found == pytest.approx([119.6, 147.1, 33.9], abs=0.05)


@pytest.mark.parametrize("rho", [0.01, 0.3, 1.0, 2.7, 8.0, 30.0])
@pytest.mark.parametrize("theta", [0.0, 0.3, pi / 4, 2.0])
@pytest.mark.parametrize("l", [0.01, 1.4, 5.0, 100.0])
def test_the_formula(rho, theta, l):  # noqa: E741
    for d, i2, e in [(3.0, 1282.28, 0.0), (11.58, 20626.0, 0.0), (1.0, 5.0, 7.0)]:
        found = daly(rho, theta, adaptation=l, image_area=i2, distance=d, eccentricity=e)
        assert found == pytest.approx(published(rho, theta, l, d, i2, e), rel=1e-6)


def test_no_sensitivity_at_zero_and_none_at_infinity():
    assert daly(0.0, 0.0, **PAPER) == 0
    assert daly(1e4, 0.0, **PAPER) == 0
    assert np.isfinite(daly(np.geomspace(1e-12, 1e12, 99), 0.5, **PAPER)).all()


def test_oblique_gratings_are_harder_to_see():
    assert daly(8.0, pi / 4, **PAPER) < 0.8 * daly(8.0, 0.0, **PAPER)
    assert daly(8.0, pi / 2, **PAPER) == pytest.approx(daly(8.0, 0.0, **PAPER))


@pytest.mark.parametrize(
    ("name", "value"), [("adaptation", 0.0), ("distance", -1.0), ("image_area", np.nan)]
)
def test_impossible_conditions_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        daly(1.0, 0.0, **{**PAPER, name: value})
    with pytest.raises(InputError, match="frequencies"):
        daly([-1.0], 0.0, **PAPER)


@pytest.mark.parametrize("gain", [-0.1, 1.1, np.nan])
def test_an_impossible_floor_is_refused(gain):
    with pytest.raises(InputError, match="low-frequency gain"):
        LowFrequencyFloor(gain)


@pytest.mark.parametrize("gain", [0.0, 0.1, 1.0])
def test_the_floor_holds_below_the_peak_only(gain):
    viewing = of_flat_screen(2.5, 1.4, 3.0, 5.0)
    pure, peak = csf_gains(viewing, (90, 160), (100, 170), LowFrequencyFloor(0.0))
    omega, _ = csf_gains(viewing, (90, 160), (100, 170), LowFrequencyFloor(gain))
    assert omega[0, 0] == gain
    assert omega.max() <= 1
    assert peak == pytest.approx(
        max(daly(f, 0.0, **PAPER) for f in np.linspace(2, 4, 400)), rel=2e-2
    )
    raised = omega > pure
    assert (omega[raised] == gain).all()
    if gain:
        assert raised.any()
        assert omega[-1, 1] == max(gain, pure[-1, 1])


@pytest.mark.parametrize("padded", [(100, 170), (99, 171), (640, 648)])
def test_every_frequency_has_its_own_sensitivity(padded):
    """Half of the rows are computed and mirrored; each is as if it were computed by itself."""
    viewing = of_flat_screen(2.5, 1.4, 3.0, 5.0)
    size = (90, 160)
    omega, peak = csf_gains(viewing, size, padded, LowFrequencyFloor(0.0))
    density = viewing.pixels_per_degree(*size)
    rows = np.fft.fftfreq(padded[0], 1 / density)[:, None]
    cols = np.fft.rfftfreq(padded[1], 1 / density)[None, :]
    expected = daly(
        np.hypot(rows, cols),
        np.arctan2(rows, cols),
        adaptation=viewing.adaptation,
        distance=viewing.distance,
        image_area=viewing.image_area,
    )
    np.testing.assert_allclose(omega, expected / peak, rtol=1e-6, atol=1e-12)


def test_a_grating_is_weighted_by_its_sensitivity():
    """In the middle of a large support, lambda multiplies a grating by Omega at its frequency."""
    viewing = of_flat_screen(1.0, 1.0, 3.0, 5.0)
    size = 256
    support = np.ones((size, size), bool)
    lambda_ = PerceptualWeighting(LowFrequencyFloor(0.0))(viewing, BT709, support)
    cycles = 40  # in 256 pixels
    grating = np.cos(2 * pi * cycles * np.arange(size) / size)
    light = np.broadcast_to(grating[None, None, :, None], (1, size, size, 3))
    seen = lambda_.apply(light)[0, 0, :size, :size][96:160, 96:160]
    frequency = cycles / viewing.extent
    conditions = {"adaptation": 5.0, "distance": 3.0, "image_area": viewing.image_area}
    expected = daly(frequency, 0.0, **conditions) / lambda_.peak
    assert np.ptp(seen) / 2 == pytest.approx(expected, rel=0.01)


def test_grey_has_no_chroma():
    opponent = linear_ycbcr(BT709)
    assert opponent @ np.ones(3) == pytest.approx([1, 0, 0], abs=1e-12)
    # ITU-R BT.709-6, item 3.3: C_B = (B - Y) / 1.8556, C_R = (R - Y) / 1.5748
    assert opponent @ [0, 0, 1] == pytest.approx([0.0722, 0.5, -0.0722 / 1.5748])
    assert opponent @ [1, 0, 0] == pytest.approx([0.2126, -0.2126 / 1.8556, 0.5])


def test_nothing_wraps_around_the_picture():
    """An error at one edge must not be felt at the other: against a grid ten times as large."""
    viewing = of_flat_screen(2.5, 2.5, 3.0, 5.0)
    support = np.ones((64, 64), bool)
    edge = np.zeros((1, 64, 64, 3))
    edge[:, :, -2:] = 1
    edge[:, :, :2] = -1
    padded, wide, wrapped = (
        PerceptualWeighting(padding=padding)(viewing, BT709, support).energy(edge)
        for padding in (64, 576, 0)
    )
    assert padded == pytest.approx(wide, rel=2e-3)
    assert abs(wrapped / wide - 1) > 0.01
