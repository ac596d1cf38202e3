"""Ellipsoidal and truncated domes against analytic areas, sampling, and laws of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from domesim.errors import InputError
from domesim.observation.basis import ScreenBasis, disc_quadrature
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

SHAPES = {
    "small cap": Dome(3.0, np.radians(15)),
    "sphere": Dome(3.0, np.pi),
    "flat": Dome(3.0, np.radians(80), height_ratio=0.6),
    "tall, leaning": Dome(3.0, np.radians(100), 0.3, height_ratio=1.7),
    "cut level": Dome(3.0, np.radians(120), truncated_below=-0.5),
    "cut, leaning": Dome(3.0, np.radians(90), 0.35, truncated_below=0.2),
    "cut, leaning back": Dome(3.0, np.radians(110), -0.5, truncated_below=0.4),
    "cut, upright": Dome(2.0, np.radians(70), 1.4, truncated_below=-0.3),
    "flat, cut, leaning": Dome(3.0, np.radians(130), 0.2, 0.7, -0.4),
}
every_shape = pytest.mark.parametrize("dome", SHAPES.values(), ids=SHAPES)
CUT = {name: dome for name, dome in SHAPES.items() if dome.truncated_below is not None}
every_cut = pytest.mark.parametrize("dome", CUT.values(), ids=CUT)


def unit(theta: Any, azimuth: Any) -> Floats:
    ring = np.sin(theta)
    parts = ring * np.cos(azimuth), ring * np.sin(azimuth), np.cos(theta)
    return np.stack(np.broadcast_arrays(*parts), -1)


def in_room(points: Floats, tilt: float) -> Floats:
    """The zenith leans to the front (y) by the tilt, by the definition; x stays."""
    x, y, z = np.moveaxis(points, -1, 0)
    c, s = np.cos(tilt), np.sin(tilt)
    return np.stack([x, c * y + s * z, c * z - s * y], -1)


def sampled(dome: Dome, steps: int = 900) -> tuple[Floats, Floats]:
    """Points of the screen in the room, and the area of each, by the ellipsoid's own angles.

    x = r sin(tau), z = r h cos(tau): the surface of revolution has area 2 pi x ds.
    """
    high = dome.radius * dome.height_ratio
    last = np.arctan2(np.sin(dome.half_angle) * high, np.cos(dome.half_angle) * dome.radius)
    tau = (np.arange(steps) + 0.5) / steps * last
    phi = (np.arange(steps) + 0.5) / steps * 2 * np.pi
    speed = np.hypot(dome.radius * np.cos(tau), high * np.sin(tau))
    area = dome.radius * np.sin(tau) * speed * (last / steps) * (2 * np.pi / steps)
    x = dome.radius * np.sin(tau)[:, None] * np.cos(phi)
    y = dome.radius * np.sin(tau)[:, None] * np.sin(phi)
    z = np.broadcast_to(high * np.cos(tau)[:, None], x.shape)
    points = in_room(np.stack([x, y, z], -1), dome.tilt).reshape(-1, 3)
    areas = np.repeat(area, steps)
    kept = points[:, 2] >= (-np.inf if dome.truncated_below is None else dome.truncated_below)
    return points[kept], areas[kept]


@pytest.mark.parametrize("ratio", [0.3, 0.8, 1.25, 4.0])
def test_a_whole_spheroid_has_its_textbook_area(ratio: float) -> None:
    """Oblate: 2 pi r² (1 + (1 - e²)/e artanh e); prolate: 2 pi r² (1 + h/e arcsin e)."""
    eccentric = np.sqrt(1 - min(ratio, 1 / ratio) ** 2)
    if ratio < 1:
        share = 1 + (1 - eccentric**2) / eccentric * np.arctanh(eccentric)
    else:
        share = 1 + ratio / eccentric * np.arcsin(eccentric)
    dome = Dome(3.0, np.pi, height_ratio=ratio)
    assert dome.screen_area == pytest.approx(2 * np.pi * 9 * share, rel=1e-9)


@pytest.mark.parametrize("half_angle", [20, 75, 90, 130])
@pytest.mark.parametrize("ratio", [0.5, 1.8])
def test_a_spheroids_cap_has_the_area_of_its_meridian_turned(
    half_angle: float, ratio: float
) -> None:
    dome = Dome(2.0, np.radians(half_angle), 0.4, ratio)
    high = 2.0 * ratio
    last = np.arctan2(np.sin(dome.half_angle) * high, np.cos(dome.half_angle) * 2.0)

    def ring(tau: float) -> float:
        return 2 * np.pi * 2.0 * np.sin(tau) * np.hypot(2.0 * np.cos(tau), high * np.sin(tau))

    assert dome.screen_area == pytest.approx(quad(ring, 0, last, epsrel=1e-10)[0], rel=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 1e-6, 0.3, -0.5])
@pytest.mark.parametrize("cut", [-1.2, 0.0, 0.7, 2.5])
def test_a_zone_has_archimedes_area_however_the_dome_leans(cut: float, tilt: float) -> None:
    """2 pi r h, as long as the cap's own rim is below the cut all round."""
    dome = Dome(3.0, np.radians(160), tilt, truncated_below=cut)
    assert dome.screen_area == pytest.approx(2 * np.pi * 3.0 * (3.0 - cut), rel=1e-7)
    assert dome.solid_angle == pytest.approx(2 * np.pi * (1 - cut / 3.0), rel=1e-7)


@every_shape
def test_the_area_is_that_of_many_small_pieces(dome: Dome) -> None:
    _, areas = sampled(dome)
    assert dome.screen_area == pytest.approx(areas.sum(), rel=1e-3)


@every_cut
def test_what_is_kept_of_a_ring_is_above_the_cut(dome: Dome) -> None:
    theta = np.linspace(0, dome.half_angle, 97)
    start, extent = dome.kept_azimuth(theta)
    assert ((extent >= 0) & (extent <= 2 * np.pi)).all()
    assert extent.max() > 1

    def height(share: float) -> Any:
        points = in_room(dome.surface(theta, start + share * extent), dome.tilt)
        return points[:, 2] - dome.truncated_below

    partly = (extent > 1e-3) & (extent < 2 * np.pi - 1e-3)
    for share in (0.001, 0.3, 0.5, 0.999):
        assert (height(share)[extent > 0] > -1e-9).all()
    if dome.tilt:
        assert partly.any()
    for share in (-0.01, 1.01):
        assert (height(share)[partly] < 0).all()
    nothing = height(0.5)[extent == 0]  # the highest point of a ring that is cut off
    assert (nothing <= 1e-9).all()


@every_shape
@pytest.mark.parametrize("size", [6, 7, 16, 33])
def test_pixels_share_out_the_whole_area(dome: Dome, size: int) -> None:
    areas = dome.pixel_areas(size, size)
    assert areas.sum() == pytest.approx(dome.screen_area, rel=1e-12)
    assert areas.min() >= 0
    held, inside = dome.screen_areas(size, size), dome.inside(size, size)
    assert held.sum() == pytest.approx(dome.screen_area, rel=1e-12)
    assert (held[~inside] == 0).all()
    assert (held[inside] > 0).all()


@every_shape
def test_each_pixel_has_what_falls_into_it(dome: Dome) -> None:
    """Many small pieces, each put where its direction is in the equidistant mapping."""
    size = 24
    points, areas = sampled(dome, 1200)
    local = in_room(points, -dome.tilt)
    ring = np.hypot(local[:, 0], local[:, 1])
    theta = np.arctan2(ring, local[:, 2])
    place = (local[:, :2] / ring[:, None]) * (theta / dome.half_angle)[:, None]
    col, row = np.clip((place + 1) * size // 2, 0, size - 1).astype(int).T
    expected = np.zeros((size, size))
    np.add.at(expected, (row, col), areas)
    found = dome.pixel_areas(size, size)
    # To second order in the pixel's size within, by shares of a sixty-fourth where it is cut
    assert found == pytest.approx(expected, abs=0.05 * expected.max())
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.006 * expected.max()


@every_cut
def test_pixels_are_inside_if_their_centre_is_above_the_cut(dome: Dome) -> None:
    size = 21
    directions = dome.directions(size, size)
    points = in_room(directions * dome.distance(directions)[..., None], dome.tilt)
    centres = (np.arange(size) + 0.5) * 2 / size - 1
    circle = centres[:, None] ** 2 + centres**2 <= 1
    inside = dome.inside(size, size)
    assert (inside == circle & (points[..., 2] >= dome.truncated_below)).all()
    assert 0 < inside.sum() < circle.sum()


@every_shape
def test_the_surface_is_on_the_ellipsoid_in_its_direction(dome: Dome) -> None:
    theta = np.linspace(0, dome.half_angle, 23)[:, None]
    azimuth = np.linspace(-3, 3, 17)
    points = dome.surface(*np.broadcast_arrays(theta, azimuth))
    x, y, z = np.moveaxis(points / dome.radius, -1, 0)
    assert x**2 + y**2 + (z / dome.height_ratio) ** 2 == pytest.approx(1, rel=1e-12)
    assert np.arctan2(np.hypot(x, y), z) == pytest.approx(theta + 0 * azimuth, abs=1e-12)
    assert np.arctan2(y, x)[1:] == pytest.approx((azimuth + 0 * theta)[1:], abs=1e-12)


@every_shape
def test_normals_are_square_to_the_surface(dome: Dome) -> None:
    theta = np.linspace(0.05, dome.half_angle, 23)[:, None]
    azimuth = np.linspace(-3, 3, 17)
    step = 1e-6
    normals = dome.normals(unit(theta, azimuth))
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1, rel=1e-12)
    for along in ((step, 0.0), (0.0, step)):
        ends = [
            dome.surface(*np.broadcast_arrays(theta + sign * along[0], azimuth + sign * along[1]))
            for sign in (-1, 1)
        ]
        tangent = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0], axis=-1)[..., None]
        assert np.abs(np.sum(tangent * normals, -1)).max() < 1e-8
    assert (np.sum(normals * unit(theta, azimuth), -1) > 0).all()  # outwards


@pytest.mark.parametrize("size", [2, 5, 8, 33])
@pytest.mark.parametrize("half_angle", [20, 90, 150, 180])
def test_pixel_of_inverts_directions(half_angle: float, size: int) -> None:
    dome = Dome(3.0, np.radians(half_angle), 0.3, 0.8)
    row, col = dome.pixel_of(dome.directions(size, size), size)
    screen = dome.inside(size, size)
    wanted_row, wanted_col = np.indices((size, size))
    assert (row == wanted_row)[screen].all()
    assert (col == wanted_col)[screen].all()
    beyond = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -0.6, -0.8]])
    for index in dome.pixel_of(beyond, size):
        assert ((index >= 0) & (index < size)).all()
    row, col = dome.pixel_of(beyond, size)
    assert col[0] == size - 1  # straight down is at the edge, not in the middle
    below = np.degrees(np.arccos(-0.8))
    assert row[2] == max(0, int((1 - below / half_angle) * size / 2))


def test_towards_a_point_of_the_screen_is_its_direction() -> None:
    dome = Dome(3.0, np.radians(80), 0.3, 0.8)
    theta, azimuth = np.meshgrid([0.0, 0.4, 1.3], [0.1, 2.0, -1.0])
    points = dome.surface(theta, azimuth) @ dome.to_room.T
    assert dome.toward(points) == pytest.approx(unit(theta, azimuth), abs=1e-14)
    # The zenith leans to the front
    zenith = np.array([0.0, np.sin(0.3), np.cos(0.3)])
    assert dome.toward(5 * zenith) == pytest.approx(np.array([0.0, 0.0, 1.0]), abs=1e-14)
    assert np.isfinite(dome.toward(np.zeros(3))).all()


def test_the_zenith_leans_to_the_front() -> None:
    turn = Dome(1.0, 1.0, 0.3).to_room
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)
    assert turn @ [0, 0, 1] == pytest.approx([0, np.sin(0.3), np.cos(0.3)])
    assert turn @ [1, 0, 0] == pytest.approx([1, 0, 0])
    around = np.linspace(0, 2 * np.pi, 361)
    rim = Dome(1.0, 1.2, 0.3).surface(np.full_like(around, 1.2), around) @ turn.T
    assert around[np.argmin(rim[:, 2])] == pytest.approx(np.pi / 2)  # the rim dips in front


@every_shape
def test_the_lowest_and_the_widest_are_those_of_many_points(dome: Dome) -> None:
    points, _ = sampled(dome, 1200)
    near = 2e-3 * dome.radius
    assert points[:, 2].min() - near < dome.lowest <= points[:, 2].min()
    widest = np.hypot(points[:, 0], points[:, 1]).max()
    assert dome.widest == pytest.approx(widest, abs=near)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_a_dome_encloses_what_its_axes_say(ratio: float) -> None:
    dome = Dome(3.0, 1.0, 0.7, ratio)
    for axis, reach in (((1, 0, 0), 3.0), ((0, -1, 0), 3.0), ((0, 0, 1), 3.0 * ratio)):
        for sign in (-1, 1):
            x, y, z = (sign * reach * part for part in axis)
            assert dome.encloses((0.999 * x, 0.999 * y, 0.999 * z))
            assert not dome.encloses((1.001 * x, 1.001 * y, 1.001 * z))


@pytest.mark.parametrize(
    ("ratio", "lens"),
    [(0.6, (0.5, -1.0, 0.8)), (1.0, (1.0, 0.5, -0.3)), (1.5, (0.3, 0.2, 3.4))],
)
def test_all_light_of_a_lens_lands_in_a_closed_ellipsoid(
    ratio: float, lens: tuple[float, float, float]
) -> None:
    """Gauss's law again; in a tall dome a lens may be further up than the radius."""
    dome = Dome(3.0, np.pi, height_ratio=ratio)
    flux = (dome.pixel_areas(256, 256) * dome.lens_gain(256, 256, lens)).sum()
    assert flux / dome.radius**2 == pytest.approx(4 * np.pi, rel=2e-3)


@every_shape
def test_the_quadrature_stands_for_the_screen(dome: Dome) -> None:
    u, v, areas = disc_quadrature(dome, 40)
    assert areas.sum() == pytest.approx(dome.screen_area, rel=1e-9)
    points = in_room(dome.surface(np.hypot(u, v) * dome.half_angle, np.arctan2(v, u)), dome.tilt)
    if dome.truncated_below is not None:
        assert points[:, 2].min() >= dome.truncated_below - 1e-9
    there, pieces = sampled(dome)
    for moment in ([0, 0, 1], [0, 1, 0], [0, 1, 1]):
        expected = (pieces @ (there**moment).prod(-1)) / pieces.sum()
        found = (areas @ (points**moment).prod(-1)) / areas.sum()
        assert found == pytest.approx(expected, abs=2e-3 * dome.radius**2)


@every_shape
def test_basis_functions_are_orthonormal_on_the_screen(dome: Dome) -> None:
    """By pixels of a large picture, which know nothing of the quadrature."""
    basis = ScreenBasis(dome, 3)
    size = 201
    centres = (np.arange(size) + 0.5) * 2 / size - 1
    u, v = np.meshgrid(centres, centres)
    areas, inside = dome.screen_areas(size, size), dome.inside(size, size)
    functions = basis.at(u[inside], v[inside])
    gram = (functions * areas[inside]) @ functions.T / dome.screen_area
    assert gram == pytest.approx(np.eye(len(basis)), abs=0.03)
    assert functions[0] == pytest.approx(1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Dome(3.0, 1.0, height_ratio=0.0), "height ratio must be above 0, got 0"),
        (lambda: Dome(3.0, 1.0, truncated_below=3.0), "below 3 m: no screen is left"),
        (lambda: Dome(3.0, 1.0, height_ratio=0.5, truncated_below=1.6), "no screen is left"),
        (
            lambda: Dome(3.0, 1.0, truncated_below=2.9999).pixel_areas(4, 4),
            "no pixel of 4 x 4 is on the screen",
        ),
        (
            lambda: Dome(3.0, 1.0, height_ratio=0.5).lens_gain(4, 4, (0.0, 0.0, 2.0)),
            "inside the ellipsoid of radius 3 m and height ratio 0.5, got 2 m",
        ),
    ],
)
def test_impossible_shapes_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
