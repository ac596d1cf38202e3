"""What projectors put on the screen, against photometry and geometry by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.room.dome import Dome
from domesim.room.lenses import field_weight, lens_frame, lens_gains
from domesim.room.theatre import Lens, Theatre

GREY = (0.5, 0.5, 0.5)
LEANING = Dome(4.0, np.radians(85), 0.4)
FRONT, BACK = (0.5, 2.0, -0.5), (-0.4, -2.2, -0.3)


def theatre(dome: Dome, *lenses: Lens, corrected: bool = False) -> Theatre:
    return Theatre(dome, GREY, lenses=lenses, corrected=corrected)


def fisheye(name: str, position: Any, look_at: Any = (0.0, 0.0, 9.0), **settings: Any) -> Lens:
    return Lens(name, position, look_at, field=settings.pop("field", 2 * np.pi), **settings)


def beamer(**settings: Any) -> Lens:
    """Looks to the front (y) from (1, 2, 3): right is x, up is z."""
    return Lens("p", (1.0, 2.0, 3.0), (1.0, 7.0, 3.0), kind="perspective", **settings)


def screen_point(dome: Dome, row: int, col: int, size: int) -> tuple[Any, Any]:
    """Place in the room of a pixel's centre on a sphere, and its inward normal."""
    u, v = (2 * (index + 0.5) / size - 1 for index in (col, row))
    theta, azimuth = np.hypot(u, v) * dome.half_angle, np.arctan2(v, u)
    x = np.sin(theta) * np.cos(azimuth)
    y = np.sin(theta) * np.sin(azimuth)
    z = np.cos(theta)
    c, s = np.cos(dome.tilt), np.sin(dome.tilt)
    outward = np.array([x, c * y + s * z, c * z - s * y])
    return dome.radius * outward, -outward


def test_without_a_lens_there_is_the_ideal_one() -> None:
    assert lens_gains(theatre(LEANING), 7, 7) == pytest.approx(np.ones((1, 7, 7)))


@pytest.mark.parametrize("field", [np.pi, 2 * np.pi])
def test_a_fisheye_in_the_centre_lights_evenly(field: float) -> None:
    zenith = tuple(LEANING.to_room[:, 2])
    lens = fisheye("centre", (0.0, 0.0, 0.0), zenith, field=field)
    gains = lens_gains(theatre(LEANING, lens), 17, 17)
    assert gains.shape == (1, 17, 17)
    assert gains == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("position", [(0.5, 2.0, -0.5), (-1.0, 0.3, 1.1)])
@pytest.mark.parametrize("pixel", [(10, 10), (2, 9), (17, 14), (11, 19)])
def test_off_the_centre_light_goes_as_cosine_over_square(position: Any, pixel: Any) -> None:
    """Of a leaning dome: the lens is in the room's frame, the picture in the dome's."""
    gain = lens_gains(theatre(LEANING, fisheye("off", position)), 21, 21)[0]
    point, normal = screen_point(LEANING, *pixel, 21)
    ray = point - np.array(position)
    expected = 4.0**2 * (-ray @ normal) / (ray @ ray) ** 1.5
    assert gain[pixel] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("size", [1040, 1041])
def test_large_pictures_come_in_strips(size: int) -> None:
    """Of a million pixels: the last rows are in another strip than the first."""
    position = (0.5, 2.0, -0.5)
    gain = lens_gains(theatre(LEANING, fisheye("off", position)), size, size)[0]
    for pixel in [(5, size // 2), (size // 2, 70), (size - 12, size // 2 + 3)]:
        point, normal = screen_point(LEANING, *pixel, size)
        ray = point - np.array(position)
        expected = 4.0**2 * (-ray @ normal) / (ray @ ray) ** 1.5
        assert gain[pixel] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("pixel", [(20, 10), (18, 8), (17, 13)])
def test_a_perspective_lens_would_light_a_flat_screen_evenly(pixel: Any) -> None:
    """On a plane square to its axis E = I cos³/D², so that I goes as 1 / cos³."""
    dome = Dome(4.0, np.pi / 2)
    lens = Lens("p", (0.2, -1.0, 0.1), (0.0, 4.0, 1.0), 0.3, "perspective", 2.4, 1.0)
    others = fisheye("rest", (0.0, 0.0, 0.0))
    gains = lens_gains(theatre(dome, lens, others), 21, 21)
    point, normal = screen_point(dome, *pixel, 21)
    ray = point - np.array(lens.position)
    axis = np.subtract(lens.look_at, lens.position)
    cosine = ray @ axis / np.linalg.norm(ray) / np.linalg.norm(axis)
    expected = 4.0**2 * (-ray @ normal) / (ray @ ray) ** 1.5 / cosine**3
    assert gains[0][pixel] == pytest.approx(expected / 2, rel=1e-12)  # shared half and half
    assert gains[1][pixel] == pytest.approx(1 / 2, rel=1e-12)


def test_all_light_of_blended_lenses_lands_in_a_closed_sphere() -> None:
    dome = Dome(3.0, np.pi, 0.4)
    pair = theatre(dome, fisheye("a", (1.0, 0.5, -0.3)), fisheye("b", (0.0, -1.4, 0.9)))
    areas, gains = dome.pixel_areas(256, 256), lens_gains(pair, 256, 256)
    for gain in gains:
        assert (areas * gain).sum() / 9 == pytest.approx(2 * np.pi, rel=1e-3)


def test_blended_projectors_share_the_screen() -> None:
    dome = Dome(4.0, np.radians(85), 0.2, truncated_below=0.3)
    lenses = (
        fisheye("front", FRONT, (0.0, -3.0, 3.0), field=2.6, blend=0.5),
        fisheye("back", BACK, (0.0, 3.0, 3.0), field=2.6, blend=0.5),
    )
    gains = lens_gains(theatre(dome, *lenses, corrected=True), 31, 31)
    on = dome.inside(31, 31)
    assert gains.sum(0) == pytest.approx(1, rel=1e-12)
    assert gains.min() >= 0
    assert (gains[1][~on] == 0).all()
    blended = (gains[0] > 0.01) & (gains[0] < 0.99) & on
    assert blended.any()
    assert (gains[0][on] == 1).any()
    assert (gains[1][on] == 1).any()
    # Each has the side that it is aimed at: the front is at the bottom of the picture.
    assert gains[0][5].sum() > gains[1][5].sum()
    assert gains[1][25][on[25]].sum() > gains[0][25][on[25]].sum()


def test_blended_projectors_keep_their_falloff_if_nobody_evens_it_out() -> None:
    lenses = fisheye("front", FRONT, blend=0.3, field=4.5), fisheye("back", BACK)
    even, uneven = (
        lens_gains(theatre(LEANING, *lenses, corrected=corrected), 21, 21)
        for corrected in (True, False)
    )
    on = LEANING.inside(21, 21)
    for index, lens in enumerate(lenses):
        alone = lens_gains(theatre(LEANING, replace(lens, field=2 * np.pi)), 21, 21)[0]
        assert uneven[index][on] == pytest.approx((even[index] * alone)[on], rel=1e-12)


@pytest.mark.parametrize("aspect", [1.0, 2.0])
@pytest.mark.parametrize(("roll", "swapped"), [(0.0, False), (np.pi / 2, True)])
def test_a_perspective_field_is_a_rectangle(aspect: float, roll: float, swapped: bool) -> None:
    """`field` across, and as high as the aspect says on a flat screen."""
    lens = beamer(field=1.2, aspect=aspect, roll=roll)
    ends = np.tan(0.6), np.tan(0.6) / aspect
    across, high = ends[::-1] if swapped else ends

    def lit(x: float, z: float, y: float = 1.0) -> bool:
        return bool(field_weight(lens, np.array([1.0 + x, 2.0 + y, 3.0 + z])) > 0)

    for sign in (-1, 1):
        assert lit(sign * 0.999 * across, 0.0)
        assert not lit(sign * 1.001 * across, 0.0)
        assert lit(0.0, sign * 0.999 * high)
        assert not lit(0.0, sign * 1.001 * high)
        assert lit(0.99 * across, sign * 0.99 * high)  # up to its corners
        assert not lit(0.1, sign * 0.1, -1.0)  # not behind it


def test_a_fisheye_field_is_a_circle() -> None:
    lens = Lens("f", (1.0, 2.0, 3.0), (1.0, 7.0, 3.0), field=np.radians(220))
    for turn in np.linspace(0, 6, 7):
        for angle, lit in ((0.0, 1), (80.0, 1), (109.9, 1), (110.1, 0), (180.0, 0)):
            ahead, aside = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            ray = np.array([aside * np.cos(turn), ahead, aside * np.sin(turn)])
            assert field_weight(lens, np.array(lens.position) + 2.7 * ray) == lit


@pytest.mark.parametrize("kind", ["equidistant", "perspective"])
def test_the_soft_edge_is_as_wide_as_it_says(kind: Any) -> None:
    """From 0 at the edge, by 1/2 half-way and 3 t² - 2 t³ between, to 1."""
    lens = Lens("s", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), kind=kind, field=2.0, aspect=1.0, blend=0.4)

    def weight(inside: float) -> float:
        angle = 1.0 - inside
        return float(field_weight(lens, np.array([np.sin(angle), np.cos(angle), 0.0])))

    assert weight(-0.001) == 0
    assert weight(0.2) == pytest.approx(0.5)
    assert weight(0.1) == pytest.approx(3 / 16 - 2 / 64)
    assert weight(0.401) == 1
    steps = [weight(inside) for inside in np.linspace(0, 0.4, 30)]
    assert (np.diff(steps) > 0).all()


def test_frames_are_right_handed_and_upright() -> None:
    for look_at in [(1.0, 7.0, 3.0), (4.0, 1.0, -2.0), (1.0, 2.0, 9.0), (1.0, 2.0, -9.0)]:
        for roll in (0.0, 0.4):
            lens = Lens("l", (1.0, 2.0, 3.0), look_at, roll)
            right, up, forward = frame = lens_frame(lens)
            assert np.stack(frame) @ np.stack(frame).T == pytest.approx(np.eye(3), abs=1e-12)
            assert np.cross(right, up) == pytest.approx(-forward, abs=1e-12)
            assert forward @ np.subtract(look_at, lens.position) > 0
    right, up, _ = lens_frame(beamer())
    assert right == pytest.approx([1, 0, 0])
    assert up == pytest.approx([0, 0, 1])
    right, up, _ = lens_frame(beamer(roll=np.pi / 2))
    assert right == pytest.approx([0, 0, 1], abs=1e-12)
    right, up, _ = lens_frame(fisheye("zenith", (0.0, 0.0, 0.0)))
    assert right == pytest.approx([1, 0, 0])
    assert up == pytest.approx([0, -1, 0])  # the front is at the bottom of a domemaster


def test_a_dark_part_of_the_screen_is_refused_with_its_share() -> None:
    dome = Dome(4.0, np.pi / 2)
    half = fisheye("half", (0.0, 0.0, 0.0), field=np.radians(120))
    # Equidistant: two thirds of the radius, 4/9 of the disc
    with pytest.raises(InputError, match=r"leave 55\.\d% of the screen dark; widen their fields"):
        lens_gains(theatre(dome, half), 101, 101)
    behind = fisheye("back", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), field=np.pi)
    with pytest.raises(InputError, match=r"100\.0% of the screen dark"):
        lens_gains(theatre(dome, behind), 20, 20)


def test_a_few_dark_pixels_at_the_rim_are_shared() -> None:
    dome = Dome(4.0, np.pi / 2)
    lenses = [fisheye(name, (0.0, 0.0, 0.0), field=np.radians(179.98)) for name in "ab"]
    gains = lens_gains(theatre(dome, *lenses), 200, 200)
    on = dome.inside(200, 200)
    missed = np.stack([field_weight(lens, dome.directions(200, 200) * 4) for lens in lenses]) == 0
    assert 0 < (missed.all(0) & on).sum() < 1e-3 * on.sum()
    assert gains[:, on] == pytest.approx(0.5, rel=1e-12)


def test_a_projector_aimed_at_itself_is_refused() -> None:
    with pytest.raises(InputError, match="'own' is aimed at its own position; move look_at"):
        lens_frame(fisheye("own", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))
    outside = fisheye("outside", (5.0, 0.0, 0.0))
    with pytest.raises(InputError, match="inside the sphere of radius 4 m, got 5 m"):
        lens_gains(theatre(LEANING, outside), 8, 8)
