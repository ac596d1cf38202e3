"""Flat cinemas: every composition is affine with its adjoint and inverse, and gains no light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from array_libraries import PRECISE
from flat_cinemas import (
    COMPOSITIONS,
    ROOM,
    SCATTERS,
    WAY,
    lens_alone,
    polarised,
    room_and_flat_crosstalk,
)
from laws.test_linear_maps import assert_affine

from domesim.errors import InputError
from domesim.observation import flat_room
from domesim.observation.flat_room import form_factors, room_modes, room_observation
from domesim.observation.glare import Glare, Scatter
from domesim.room.flat_room import FlatRoom

SURFACES = ("floor", "ceiling", "walls", "back", "front", "audience")
SIZES = [(5, 7), (11, 6)]


@pytest.mark.parametrize(("dtype", "convert"), PRECISE)
@pytest.mark.parametrize("name", COMPOSITIONS)
def test_compositions(name, dtype, convert):
    size = SIZES[dtype == np.float64]
    observation = COMPOSITIONS[name](*size)
    random = np.random.default_rng(size[0])
    x, z, y = (convert(random.standard_normal(observation.shape).astype(dtype)) for _ in range(3))
    tolerance = 1e-6 if dtype == np.float32 else 1e-13
    assert_affine(observation, x, z, y, tolerance)
    here = np.asarray(observation.local(x), np.float64) * np.asarray(y)
    there = np.asarray(observation.local_adjoint(y), np.float64) * np.asarray(x)
    assert here.sum() == pytest.approx(there.sum(), abs=30 * tolerance)


@pytest.mark.parametrize("size", SIZES)
def test_scattered_light_is_only_moved(size):
    glare = lens_alone(*size).first
    cells = np.eye(size[0] * size[1]).reshape(-1, *size)
    for cell in cells[:: len(cells) // 9]:
        seen = glare.observe(cell[None, :, :, None] * np.ones(3))
        assert seen.min() >= -1e-15
        assert 1 - glare.share < seen[..., 0].sum() < 1


@pytest.mark.parametrize("pixels", [(20, 48), (64, 61), (5, 150)])
@pytest.mark.parametrize(
    ("size", "throw", "scatter"),
    [
        ((20.0, 8.4), 15.0, Scatter(0.005, 4.0, 0.0017)),  # narrower than a pixel
        ((20.0, 8.4), 15.0, Scatter(0.1, 2.0, 0.02)),
        ((12.0, 5.02), 2.0, Scatter(0.1, 0.5, 0.02)),  # a short throw: sines beyond 1
    ],
)
def test_no_more_is_scattered_than_the_share(pixels, size, throw, scatter):
    glare = Glare((1, *pixels, 1), size, throw, [scatter])
    point = np.zeros(glare.shape)
    point[0, pixels[0] // 2, pixels[1] // 2] = 1
    found = glare.veil(point).sum()
    # What falls on the screen, by a quarter of it
    edges = np.array(size) / 2 / throw
    whole = 4 * float(scatter.in_corners(edges[1:], edges[:1])[0])
    assert found <= scatter.share * (1 + 1e-9)
    assert found == pytest.approx(whole, rel=0.04)  # the pixel is not in the very middle


def test_all_that_is_scattered_is_found_on_a_huge_screen():
    # Sines up to 1: a disc of the throw's radius
    scatter = Scatter(0.05, 2.0, 0.1)
    rows = np.linspace(-1, 1, 801)
    sines = np.hypot(rows[:, None], rows)
    whole = scatter.density(sines)[sines <= 1].sum() * (rows[1] - rows[0]) ** 2
    assert whole == pytest.approx(0.05, rel=2e-3)


def test_glare_is_the_convolution_that_it_says():
    rows, cols, size, throw = 45, 90, (10.0, 5.0), 18.0
    glare = Glare((1, rows, cols, 1), size, throw, list(SCATTERS.values()))
    picture = np.zeros((1, rows, cols, 1))
    picture[0, 10:14, 20:60] = picture[0, 30, 5] = 1
    z, x = np.meshgrid(np.arange(rows) * 5 / rows, np.arange(cols) * 10 / cols, indexing="ij")
    veil = np.zeros((rows, cols))
    for row, col in zip(*np.nonzero(picture[0, ..., 0]), strict=True):
        away = np.hypot(z - z[row, col], x - x[row, col]) / throw
        density = sum(each.density(away) for each in SCATTERS.values())
        veil += density * (size[0] / cols * size[1] / rows) / throw**2
    assert np.abs(glare.veil(picture)[0, ..., 0] - veil).max() < 0.03 * veil.max()
    assert glare.veil(picture).sum() == pytest.approx(veil.sum(), rel=5e-3)


def test_a_point_of_the_screen_sees_the_room_and_nothing_else():
    corners = np.concatenate([flat_room._patches(face, 3.0)[0] for face in ROOM.faces()])
    points = np.array([[0.0, 0, 0], [4.5, 0, -2], [-3, 0, 2.4]])
    found = form_factors(points, np.array([[0.0, 1, 0]] * 3), corners).sum(axis=1)
    assert found == pytest.approx(1, abs=1e-12)


@pytest.mark.long
def test_a_white_room_gives_all_light_back():
    # What the screen does not absorb comes back until it does: (1 - g)(x + phi) = x
    white = (1.0, 1.0, 1.0)
    gain = 0.5
    room = replace(ROOM, gain=gain, **dict.fromkeys(SURFACES, white))
    light = np.ones((1, 40, 80, 3))
    returned = room_observation(room, 40, 80, 0.0).linear(light) - light
    assert returned.mean() == pytest.approx(gain / (1 - gain), rel=0.02)


def test_light_of_the_room_is_mixed_by_polarised_systems_only():
    left = np.zeros((2, 8, 9, 3))
    left[0] = 1
    for way, shares in ((WAY, (1, 0)), (replace(WAY, mixed=True), (0.5, 0.5))):
        pair = way.only("room").two_views(polarised(8, 9).then.then)
        reflected = pair.first.linear(left) - left
        alone = way.only("room").one_view(8, 9, 0.0).linear(left[:1]) - left[:1]
        for view, share in enumerate(shares):
            assert reflected[view] == pytest.approx(share * alone[0], abs=1e-9)


def test_black_of_a_pair_is_seen_as_it_is():
    black = [[0.001, 0.002, 0.003], [0.002, 0.0, 0.001]]
    dark = room_and_flat_crosstalk(5, 7).observe(np.zeros((2, 5, 7, 3)))
    assert dark == pytest.approx(np.broadcast_to(np.reshape(black, (2, 1, 1, 3)), (2, 5, 7, 3)))


@pytest.mark.long
def test_a_room_is_brightest_near_what_is_bright_and_reflects_by_its_albedo():
    light = replace(ROOM, walls=(0.6, 0.4, 0.8))
    picture = np.zeros((1, 20, 40, 3))
    picture[:, :, :10] = 1
    found = [
        room_observation(room, 20, 40, 0.0).linear(picture) - picture for room in (ROOM, light)
    ]
    assert found[1].mean() > 1.1 * found[0].mean()
    assert found[0][0, :, 0].mean() > found[0][0, :, -1].mean()
    assert len(room_modes(ROOM).modes) <= 16


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"screen": (15.0, 5.0)}, "must fit the room's front"),
        ({"audience_from": 30.0}, "within the room's 20 m"),
        ({"gain": 3.0}, "matt screen would reflect 300% .*half_gain_deg"),
        ({"gain": 1.0} | dict.fromkeys(SURFACES, (0.5, 1.0, 0.5)), "must absorb at least 2%"),
    ],
)
def test_impossible_rooms_are_refused(changed, message):
    with pytest.raises(InputError, match=message):
        FlatRoom(**{**vars(ROOM), **changed})


@pytest.mark.parametrize(
    ("share", "slope", "shoulder"), [(0.6, 2, 0.1), (0.1, 0.1, 0.1), (0.1, 2, 0)]
)
def test_impossible_scatter_is_refused(share, slope, shoulder):
    with pytest.raises(InputError, match="scatter"):
        Scatter(share, slope, shoulder)
