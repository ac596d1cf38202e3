"""Thresholds of stars: their published values, and that more light never shows a fainter star."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from domesim.errors import InputError
from domesim.inspection.magnitudes import (
    D65,
    LAMP,
    TYPICAL,
    Faintest,
    faintest_star,
    limiting_magnitude,
    projected_star,
    schaefer,
    sky_brightness,
    video_star,
)
from domesim.scene import DomeScene, load_scene
from domesim.scene.loading import scene_content

SKIES = [1e-5, 1e-4, 1e-3, 0.01, 0.0216, 0.1, 0.2, 1.0]
luminances = st.floats(-6, 2).map(lambda log: 10.0**log)
areas = st.sampled_from([0.0, 5.7e-7, 8.5e-6, 1e-4])


def test_the_printed_digits() -> None:
    """Crumey's for forced choice, and Schaefer's, by other programs of the same formulas."""
    assert [f"{m:.3f}" for m in limiting_magnitude(SKIES)] == (
        ["8.355", "7.252", "6.292", "5.667", "5.612", "5.469", "5.097", "4.045"]
    )
    assert [f"{m:.3f}" for m in schaefer(SKIES)] == (
        ["7.536", "6.871", "5.553", "4.173", "4.113", "3.911", "3.767", "3.246"]
    )
    assert sky_brightness(1.0) == 12.58
    assert sky_brightness(1e-4) == pytest.approx(22.58)
    assert sky_brightness(0.0) == np.inf


@given(luminances, luminances, areas, st.sampled_from([LAMP, D65, 0.5]))
@example(0.0216, 0.047, 0.0, LAMP)
@example(0.01, 0.1, 0.0, 0.5)
@example(0.19299, 0.19301, 8.5e-6, LAMP)
def test_a_brighter_sky_never_shows_a_fainter_star(
    one: float, other: float, area: float, scotopic: float
) -> None:
    skies = sorted([one, other])
    for dark, bright in (
        limiting_magnitude(skies, area=area, scotopic=scotopic),
        schaefer(skies, area=area),
    ):
        assert bright <= dark + 1e-9


def test_it_ends_in_the_dark() -> None:
    darkest = limiting_magnitude(1e-5)
    assert limiting_magnitude([0.0, 1e-9]) == pytest.approx(np.full(2, darkest))
    assert np.isfinite(schaefer(0.0))


def test_typical_observers_see_less_than_those_of_a_laboratory() -> None:
    gap = limiting_magnitude(SKIES) - limiting_magnitude(SKIES, field_factor=TYPICAL)
    assert gap == pytest.approx(2.5 * np.log10(2))


def test_the_rods_see_more_of_bluer_light() -> None:
    """In the dark by the scotopic ratios, of sky and star, and in daylight not at all.

    Half way (m = 0.5) CIE 191 has 0.767 + 0.3334 log10 L = 0.5, of the mesopic luminance L.
    """
    more = D65 / LAMP
    dark = float(limiting_magnitude(1e-4, scotopic=D65))
    assert dark == pytest.approx(limiting_magnitude(more * 1e-4) + 2.5 * np.log10(more), abs=1e-5)
    rods = 683 / 1699
    mesopic, lamps = ((1 + ratio * rods) / (1 + rods) for ratio in (D65, LAMP))
    sky, more = 10 ** ((0.5 - 0.767) / 0.3334) / mesopic, mesopic / lamps
    seen = float(limiting_magnitude(sky, scotopic=D65))
    assert seen == pytest.approx(limiting_magnitude(more * sky) + 2.5 * np.log10(more), abs=1e-5)
    assert limiting_magnitude(20.0, scotopic=D65) == pytest.approx(limiting_magnitude(20.0))


@pytest.mark.parametrize("sky", SKIES)
def test_a_star_that_is_spread_needs_more_light(sky: float) -> None:
    """An arc minute is a point, nearly; a degree is seen as a disc, by its contrast alone."""
    point, minute, ten, degree = (
        limiting_magnitude(sky, area=np.radians(side / 60) ** 2) for side in (0.0, 1, 10, 600)
    )
    assert point > minute > point - 0.1
    assert minute > ten > degree
    tenfold = limiting_magnitude(sky, area=10 * np.radians(10) ** 2)
    assert degree - tenfold == pytest.approx(2.5, abs=0.3)  # light by area
    lost = schaefer(sky) - schaefer(sky, area=np.radians(1 / 6) ** 2)
    assert lost == pytest.approx(point - ten, abs=0.06)  # but where Crumey's fit is mended


def test_both_thresholds_are_a_span() -> None:
    found = faintest_star(0.01, 0.0)
    assert found == (
        schaefer(0.01),
        limiting_magnitude(0.01, field_factor=TYPICAL, scotopic=D65),
    )
    assert Faintest(4.13, 4.96).told == "4.1 to 5.0"
    assert Faintest(5.02, 4.13).fainter(0.2).told == "4.3 to 5.2"
    assert Faintest(4.13, 4.12).told == "4.1"


def dome(**sky: object) -> DomeScene:
    scene = load_scene({**scene_content("dome_planetarium"), "sky": sky})
    assert isinstance(scene, DomeScene)
    return scene


def test_a_show_says_which_light_is_which_magnitude() -> None:
    """White over a square arcminute brings 7 x 8.46e-8 lux to the eye: magnitude 1.58."""
    own = faintest_star(0.02, 1e-6)
    assert video_star(dome(), 0.02, 1e-6) == own
    natural = -2.5 * np.log10(7 * np.radians(1 / 60) ** 2 / 2.54e-6)
    assert natural == pytest.approx(1.58, abs=0.01)
    assert video_star(dome(zero_point=natural), 0.02, 1e-6) == pytest.approx(own)
    found = video_star(dome(zero_point=natural - 2), 0.02, 1e-6)
    assert found == pytest.approx([each - 2 for each in own])


def test_a_star_projector_keeps_its_light() -> None:
    assert projected_star(dome(zero_point=1.0), 0.02) is None
    own = projected_star(dome(star_projector={}), 0.02)
    assert own == faintest_star(0.02, np.pi / 4 * np.radians(1 / 60) ** 2)
    brighter = projected_star(dome(star_projector={"zero_point_lux": 2.54e-5}), 0.02)
    assert own is not None
    assert brighter == pytest.approx([each + 2.5 for each in own])
    wide = projected_star(dome(star_projector={"image_arcmin": 10.0}), 0.02)
    assert wide is not None
    assert wide.crumey < own.crumey - 0.3
    dark = projected_star(dome(star_projector={}), 0.001)
    assert dark is not None
    assert dark.crumey > own.crumey


def test_light_transport_does_not_depend_on_the_sky() -> None:
    assert dome(zero_point=1.0, star_projector={}).digest == dome().digest


@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf])
def test_what_has_no_threshold_is_refused(wrong: float) -> None:
    with pytest.raises(InputError, match="luminances of at least 0"):
        limiting_magnitude([0.1, wrong])
    with pytest.raises(InputError, match="solid angle of at least 0 sr"):
        schaefer(0.1, area=wrong)
    with pytest.raises(InputError, match="field factor above 0"):
        limiting_magnitude(0.1, field_factor=wrong)
