"""White and gamut: against published figures, and geometry by chance."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.frames.colour import CHROMATICITIES
from domesim.inspection.gamuts import colours_of, gamut_drawing
from domesim.light.transfer import ST2084
from domesim.observation.projector import Projector
from domesim.readings.colorimetry import Colours, difference
from domesim.readings.response import uv

D65 = np.array([0.3127 / 0.3290, 1.0, 0.3583 / 0.3290])


def of_white(x: float, y: float) -> Colours:
    """Any primaries of that white."""
    white = np.array([x / y, 1, (1 - x - y) / y])
    return Colours(100 * np.stack([0.2 * white, 0.5 * white, 0.3 * white], -1))


@pytest.mark.parametrize(
    ("xy", "kelvin", "away"),
    [
        ((0.44758, 0.40745), 2856, 0.0),  # CIE standard illuminant A
        ((0.3127, 0.3290), 6504, 0.0032),  # D65
        ((0.3457, 0.3585), 5001, 0.0032),  # D50
        ((0.3140, 0.3510), 6303, 0.0134),  # DCI
        ((1 / 3, 1 / 3), 5455, -0.0044),  # equal energy
    ],
)
def test_white_has_its_published_temperature(
    xy: tuple[float, float], kelvin: float, away: float
) -> None:
    found = of_white(*xy).temperature
    assert found is not None
    assert found[0] == pytest.approx(kelvin, abs=2)
    assert found[1] == pytest.approx(away, abs=2e-4)


@pytest.mark.parametrize("xy", [(0.64, 0.33), (0.15, 0.06), (0.30, 0.60)])
def test_a_colour_has_no_temperature(xy: tuple[float, float]) -> None:
    found = of_white(*xy)
    assert found.temperature is None
    assert found.lines()[0].startswith("white: no colour temperature")
    assert found.figures()["white_cct_k"] is None


def test_differences_of_greys_are_those_of_their_formulas() -> None:
    """CIE 142-2001 of lightness alone; ITU-R BT.2124 of intensity alone."""
    lightness = 116 * np.cbrt(0.5) - 16
    mean = (100 + lightness) / 2 - 50
    weight = 1 + 0.015 * mean**2 / np.sqrt(20 + mean**2)
    two_thousand, itp = difference(100 * D65, 50 * D65)
    assert two_thousand == pytest.approx((100 - lightness) / weight, rel=1e-3)
    bright, dim = ST2084(10_000.0).encode(np.array([0.01, 0.005]))
    assert itp == pytest.approx(720 * (bright - dim), rel=1e-3)
    assert difference(D65, D65) == (0, 0)


def test_delta_e_itp_knows_how_bright_it_is() -> None:
    other = D65 * [1.02, 1, 0.95]
    dim, bright = (difference(light * D65, light * other) for light in (0.1, 100.0))
    assert dim[0] == pytest.approx(bright[0])
    assert dim[1] < 0.7 * bright[1]


def test_light_beyond_bt2020_is_no_full_white() -> None:
    """The PQ encoder would make that of light below 0."""
    green = np.array([0.0633, 0.71, 0.0782])  # 520 nm, CIE 1931
    assert difference(50 * green, 50 * green) == (0, 0)
    _, itp = difference(50 * green, 50.5 * green)
    assert 0 < itp < 3


def test_coverage_is_the_share_of_colours_that_are_shown() -> None:
    shown = colours_of(Projector("P3-D65", 48.0))
    corners = [uv(np.array([x, y, 1 - x - y])) for x, y in
               np.reshape(CHROMATICITIES["BT.2020"][:6], (3, 2))]  # fmt: skip
    share = np.random.default_rng(2).dirichlet((1, 1, 1), 20_000)
    u, v = (share @ np.array(corners)).T
    xyz = np.stack([9 * u, 4 * v, 12 - 3 * u - 20 * v])
    inside = (np.linalg.solve(shown.primaries, xyz) >= 0).all(axis=0).mean()
    assert shown.coverage["BT.2020"] == pytest.approx(inside, abs=0.01)
    assert shown.coverage["P3-D65"] == pytest.approx(1)
    assert shown.coverage["BT.709"] == pytest.approx(1, abs=2e-3)
    assert colours_of(Projector("BT.709", 48.0)).coverage["P3-D65"] < 0.85
    wide = colours_of(Projector("BT.2020", 48.0)).coverage
    assert list(wide.values()) == pytest.approx([1, 1, 1], abs=2e-3)


def test_a_projector_may_be_called_by_any_space_of_colour_science() -> None:
    found = colours_of(Projector("Adobe RGB (1998)", 48.0))
    assert found.temperature == pytest.approx((6504, 0.0032), abs=1)
    assert found.coverage["BT.709"] == pytest.approx(1, abs=2e-3)
    assert found.white[1] == pytest.approx(48)


def test_the_drawing_has_what_is_in_it() -> None:
    drawing = gamut_drawing(colours_of(Projector("P3-DCI", 48.0)))
    assert drawing.count("<polygon") == 4
    assert all(f">{name}<" in drawing for name in ("R", "G", "B", "BT.709", "P3-D65", "BT.2020"))
    assert 'points="' in drawing
    assert "nan" not in drawing
