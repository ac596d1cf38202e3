"""Ferwerda's thresholds against their published formulas, and who sees more in mesopic light."""

from __future__ import annotations

from math import log10

import numpy as np
import pytest

from compensate.vision.tvi import MesopicBlend, cone_threshold, rod_threshold, threshold

LUMINANCES = [0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 1000.0]


CONES = [
    *(0.1905460718, 0.1905460718, 0.1905460718, 0.2316425554),
    *(0.3913015271, 1.0719024789, 5.5590425727, 55.5904257270),
]


RODS = [
    *(0.0013803842646, 0.0013803842646, 0.0018400338361, 0.0402717034325),
    *(0.4027170343255, 4.0271703432546, 40.2717034325459, 402.7170343254591),
]


def test_the_published_points():
    assert cone_threshold(LUMINANCES) == pytest.approx(CONES, rel=1e-6)
    assert rod_threshold(LUMINANCES) == pytest.approx(RODS, rel=1e-6)


# log10 T by the published pieces, in 30-digit decimals (Python's decimal: ln and exp only):
# 10 cd/m²: cones (0.249 + 0.65)^2.7 - 0.72 = 0.030155..., rods 1 - 0.395


@pytest.mark.parametrize("log", np.linspace(-5, 3, 33))
def test_the_formulas(log):
    if log <= -2.6:
        cones = -0.72
    elif log >= 1.9:
        cones = log - 1.255
    else:
        cones = (0.249 * log + 0.65) ** 2.7 - 0.72
    if log <= -3.94:
        rods = -2.86
    elif log >= -1.44:
        rods = log - 0.395
    else:
        rods = (0.405 * log + 1.6) ** 2.18 - 2.86
    assert cone_threshold(10.0**log) == pytest.approx(10**cones, rel=1e-6)
    assert rod_threshold(10.0**log) == pytest.approx(10**rods, rel=1e-6)


@pytest.mark.parametrize(
    ("system", "log", "step"),
    [
        (cone_threshold, -2.6, 1.0),
        # (0.249 * 1.9 + 0.65)^2.7 - 0.72 = 0.64814 meets 1.9 - 1.255 = 0.645
        (cone_threshold, 1.9, 10 ** (0.645 - 0.64814)),
        (rod_threshold, -3.94, 1.0),
        # (0.405 * -1.44 + 1.6)^2.18 - 2.86 = -1.82301 meets -1.44 - 0.395 = -1.835
        (rod_threshold, -1.44, 10 ** (-1.835 + 1.82301)),
    ],
)
def test_the_pieces_meet_as_well_as_published(system, log, step):
    below, above = system(10 ** np.array([log - 1e-6, log + 1e-6]))
    assert above / below == pytest.approx(step, rel=2e-5)


@pytest.mark.parametrize("system", [cone_threshold, rod_threshold, threshold])
def test_black_has_the_floors_threshold_and_nothing_is_lower(system):
    light = np.geomspace(1e-12, 1e6, 2000)
    found = system(light)
    assert system(0.0) == found[0]
    assert found.min() == found[0]
    assert np.isfinite(found).all()
    # Weber's law in bright light: the same share of any luminance
    assert system(2e5) == pytest.approx(2 * system(1e5))


def test_the_more_sensitive_system_sees():
    light = np.geomspace(1e-5, 1e4, 500)
    both = threshold(light)
    assert (both == np.minimum(cone_threshold(light), rod_threshold(light))).all()
    assert threshold(light, MesopicBlend.MORE_SENSITIVE) == pytest.approx(both)
    # Ward Larson et al. 1997: the rods' piece ends at log10 L_a = -0.0184
    crossing = 10**-0.0184
    assert both[light < 0.99 * crossing] == pytest.approx(rod_threshold(light[light < 0.95]))
    assert (both < rod_threshold(light))[light > 1.01 * crossing].all()


def test_the_cie_blend():
    # m = 0.7670 + 0.3334 * -1 = 0.4336 at 0.1 cd/m²: 0.4336 * 0.23164 + 0.5664 * 0.040272
    assert threshold(0.1, MesopicBlend.CIE_191) == pytest.approx(0.123250104860, rel=1e-6)
    dark, bright = [0.0, 1e-4, 0.00499], [5.01, 80.0, 1e4]
    assert threshold(dark, MesopicBlend.CIE_191) == pytest.approx(rod_threshold(dark))
    assert threshold(bright, MesopicBlend.CIE_191) == pytest.approx(cone_threshold(bright))


def test_the_cie_blend_rises_and_lies_between_the_systems():
    light = np.geomspace(1e-5, 50, 3000)
    cones, rods = cone_threshold(light), rod_threshold(light)
    blended = threshold(light, MesopicBlend.CIE_191)
    assert (np.diff(blended)[light[:-1] < 10**-1.5] >= 0).all()
    assert (blended >= np.minimum(cones, rods) * (1 - 1e-12)).all()
    assert (blended <= np.maximum(cones, rods) * (1 + 1e-12)).all()


def test_the_rods_threshold_is_the_lower_in_the_dark_and_the_higher_in_light():
    assert log10(cone_threshold(0.0) / rod_threshold(0.0)) == pytest.approx(2.86 - 0.72)
    assert rod_threshold(100.0) > 7 * cone_threshold(100.0)
