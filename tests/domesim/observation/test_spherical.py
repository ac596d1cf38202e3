"""The closed form against radiosity solved as the linear system that it is."""

from __future__ import annotations

import numpy as np
import pytest
from theatres import ALBEDOS, closed_form, picture

from domesim.errors import InputError
from domesim.observation.spherical import ClosedFormDome, closed_form_gain
from domesim.room.dome import Dome


@pytest.mark.parametrize("rho", [0.01, 0.3, 0.5, 0.8, 0.999])
def test_the_ratio_of_a_white_hemisphere(rho):
    radius = 11.58
    area = 2 * np.pi * radius**2
    ratio = closed_form_gain(rho, radius, area) * area
    assert ratio == pytest.approx((rho / 2) / (1 - rho / 2), rel=1e-12)


def test_the_gain_itself():
    for rho, radius, area in [(0.5, 2.0, 10.0), (0.9, 7.0, 300.0)]:
        expected = rho / (4 * np.pi * radius**2 - rho * area)
        assert closed_form_gain(rho, radius, area) == pytest.approx(expected, rel=1e-12)


def test_all_bounces_of_patches_between_which_light_is_exchanged():
    """B = E + rho F B with F_ij = a_j cos cos / (pi d²), solved densely, channel by channel."""
    size = 9
    observation = closed_form(size)
    dome = Dome(3.0, np.radians(105))
    areas = dome.screen_areas(size, size).ravel()
    light = picture(size, seed=4)
    direct = observation.direct(light)[0].reshape(-1, 3)
    normal = dome.directions(size, size).reshape(-1, 3)
    apart = dome.radius * (normal[:, None] - normal[None, :])
    distance = np.linalg.norm(apart, axis=-1)
    np.fill_diagonal(distance, 1.0)
    there = np.sum(apart * normal[:, None], -1) / distance
    back = -np.sum(apart * normal[None, :], -1) / distance
    kernel = there * back / (np.pi * distance**2)
    # A patch lights itself, too: it is hollow. The limit is its neighbours' value.
    np.fill_diagonal(kernel, kernel[0, 1])
    form_factors = kernel * areas[None, :]
    for p, rho in enumerate(ALBEDOS[:3]):
        radiosity = np.linalg.solve(np.eye(len(areas)) - rho * form_factors, direct[:, p])
        seen = observation.observe(light)[0, :, :, p].ravel() - (p + 1) / 100
        on = observation.screen.ravel()
        assert seen[on] == pytest.approx(radiosity[on], rel=1e-12)


def test_bounces_are_a_geometric_series_and_energy_is_conserved():
    """What the projector sends is absorbed by the screen or leaves through the opening."""
    dome = Dome(5.0, np.radians(120))
    rho = 0.6
    observation = ClosedFormDome(dome, 32, 32, albedo=rho)
    light = picture(32, seed=1)
    areas = dome.screen_areas(32, 32)[..., None]
    flux = (areas * light[0]).sum((0, 1))
    indirect = (observation.observe(light) - light)[0][16, 16]
    incident = flux + indirect * dome.screen_area
    sphere = 4 * np.pi * dome.radius**2
    absorbed = (1 - rho) * incident
    lost = rho * incident * (1 - dome.screen_area / sphere)
    assert absorbed + lost == pytest.approx(flux, rel=1e-12)
    ratio = rho * dome.screen_area / sphere
    bounces = flux * rho / sphere * np.sum(ratio ** np.arange(200))
    assert indirect == pytest.approx(bounces, rel=1e-12)


def test_the_whole_screen_reflects_also_where_it_is_dark():
    dome = Dome(5.0, np.pi / 2)
    observation = ClosedFormDome(dome, 64, 64, albedo=0.5)
    half = np.zeros((1, 64, 64, 3))
    half[:, :32] = 1
    pollution = (observation.observe(half) - half)[0, 40, 40, 0]
    assert pollution == pytest.approx(0.5 / 3, rel=1e-12)  # half of a full white's third


def test_nothing_happens_off_the_screen():
    observation = closed_form(16)
    light = picture(16)
    off = ~observation.screen
    assert (observation.observe(light)[0][off] == light[0][off]).all()
    beyond = light.copy()
    beyond[0, off] = 1e6
    assert (observation.observe(beyond)[0][~off] == observation.observe(light)[0][~off]).all()


def test_ambient_light_is_on_the_screen_only():
    observation = closed_form(16)
    black = observation.observe(np.zeros((1, 16, 16, 3)))[0]
    assert black[8, 8] == pytest.approx([0.01, 0.02, 0.03])
    assert (black[0, 0] == 0).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.2, 1.0, 1.0), "albedo must lie in 0..1, got 1.2"),
        ((-0.1, 1.0, 1.0), "albedo"),
        ((np.nan, 1.0, 1.0), "albedo"),
        ((0.5, 0.0, 1.0), "radius must be above 0"),
        ((0.5, 1.0, 20.0), "at most the sphere's"),
        ((0.5, 1.0, 0.0), "area must be above 0"),
        ((1.0, 1.0, 4 * np.pi), "never loses light"),
    ],
)
def test_impossible_theatres_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        closed_form_gain(*arguments)


def printed_eq15(rho, r, omega, projected):
    """Eq. 15 as printed: rho pi r² / (4 - Omega rho pi r²) (a . x)."""
    return rho * np.pi * r**2 / (4 - omega * rho * np.pi * r**2) * projected


@pytest.mark.parametrize(
    ("radius", "areas", "angles"), [(1.0, -1.682, -1.682), (10.0, -1.0, -1.004)]
)
def test_note_0001_eq15_as_printed(radius, areas, angles):
    """A white hemisphere, rho 0.5: the readings of note 0001 and their figures."""
    area = 2 * np.pi * radius**2
    found = printed_eq15(0.5, radius, area, area)
    assert found == pytest.approx(areas, abs=1e-3)
    found = printed_eq15(0.5, radius, area / radius**2, area / radius**2)
    assert found == pytest.approx(angles, abs=1e-3)
    scaled = area / (np.pi * radius**2) ** 2
    assert printed_eq15(0.5, radius, scaled, scaled) == pytest.approx(1 / 3, rel=1e-12)
    meant = 0.5 / (np.pi * radius**2)
    assert meant / (4 - area * meant) * area == pytest.approx(1 / 3, rel=1e-12)


def test_note_0001_the_images_area_is_not_the_screens():
    area = 2 * np.pi
    wrong = closed_form_gain(0.5, 1.0, area / 2) * area / 2
    right = closed_form_gain(0.5, 1.0, area) * area / 2
    assert (wrong, right) == pytest.approx((0.1429, 0.1667), abs=1e-4)
