"""Laws of rooms: what must not depend on how a theatre is described."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from rooms import BEFORE

from domesim.observation.radiosity import radiosity
from domesim.pathtrace import tabulate as tabulate_module
from domesim.pathtrace.loop import bounce_limit
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Status, Tracer
from domesim.room.dome import Dome
from domesim.room.lenses import lens_gains
from domesim.room.theatre import Cavity, Floor, Lamp, Solid, Theatre, Viewpoint

GREY = (0.5, 0.5, 0.5)
BLACK = (0.0, 0.0, 0.0)
SPECK = Solid(
    "speck",
    np.array([[0.0, 2.9, 0.1], [1e-3, 2.9, 0.1], [0.0, 2.9, 0.101]]),
    np.array([[0, 1, 2]]),
    BLACK,
)
LAMP = Lamp("exit sign", (0.0, 0.0, -0.5), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (1.0, 2.0, 3.0))
SETTINGS = Settings(error=0.02, seed=1)


def test_a_floor_casts_shadows_like_anything_else():
    """A black disc below the centre of a deep dome; a speck must not change what it hides."""
    deep = Theatre(Dome(3.0, np.radians(150)), GREY, floor=Floor(-0.6, 1.2, BLACK))
    plain = Tracer(deep).gains(64, 64)
    areas = deep.dome.screen_areas(64, 64)
    # The cone that the disc subtends, cut out of the cap
    lit = (1 - np.cos(np.pi - np.arctan(2))) / (1 - np.cos(deep.dome.half_angle))
    assert np.sum(areas * plain[0]) / areas.sum() == pytest.approx(lit, rel=0.01)
    np.testing.assert_array_equal(plain, Tracer(replace(deep, solids=(SPECK,))).gains(64, 64))


def test_a_black_cavity_is_no_cavity():
    """For the picture's light and for lamps'."""
    bare = Theatre(Dome(3.0, np.radians(120)), GREY, perforation=0.4, lamps=(LAMP,))
    hollow = replace(bare, cavity=Cavity(0.5, BLACK, BLACK))
    areas = bare.dome.screen_areas(24, 24)
    found = []
    for theatre in (bare, hollow):
        tracer = Tracer(theatre)
        white = tracer.picture(np.ones((24, 24, 3), np.float32))
        traced = tracer.screen(white, 24, 24, SETTINGS)
        lit = tracer.screen(tracer.lamps(), 24, 24, SETTINGS, direct=True)
        found.append((traced.pooled_error(areas), lit.pooled_error(areas)))
    for (first, error), (second, other) in zip(*found, strict=True):
        assert abs(first - second) < 4 * np.hypot(error, other)
        assert error < 5e-3 * first


def test_a_thin_grey_cavity_is_a_brighter_screen():
    """Closed sphere with a shell close behind: albedo by summing what passes between them."""
    rho, holes, shell, back = 0.4, 0.3, 0.6, 0.2
    sphere = Dome(3.0, np.pi)
    cavity = Cavity(0.003, (shell,) * 3, (back,) * 3)
    tracer = Tracer(Theatre(sphere, (rho,) * 3, perforation=holes, cavity=cavity))
    returned = shell / (1 - shell * (1 - holes) * back)  # of what got through, at the shell
    albedo = (1 - holes) * rho + holes**2 * returned
    white = tracer.picture(np.ones((16, 16, 3), np.float32))
    traced = tracer.screen(white, 16, 16, Settings(error=0.01, tolerance=1e-6))
    mean, error = traced.pooled_error(sphere.screen_areas(16, 16))
    # White is what the screen alone shows; the direct picture's share by the cavity is indirect.
    lit = albedo / ((1 - holes) * rho)
    assert mean == pytest.approx(lit / (1 - albedo) - 1, abs=4 * error + 5e-3)


def test_a_cavitys_paths_are_followed_far_enough():
    cavity = Cavity(0.5, (0.05,) * 3, BLACK)
    theatre = Theatre(Dome(3.0, np.pi), (0.05,) * 3, perforation=0.5, cavity=cavity)
    tracer = Tracer(theatre)
    white = tracer.picture(np.ones((16, 16, 3), np.float32))
    limit = bounce_limit(tracer.room, 1e-5)
    settings = Settings(least=20000, most=20000, bounces=3 * limit, per_bounce=True)
    traced = tracer.screen(white, 16, 16, settings)
    light = traced.bounces[..., 0].sum((1, 2))
    assert light[limit + 1 :].sum() < 3e-5 * light[1:].sum()


@pytest.fixture
def _few_nodes(monkeypatch):
    """Explicit nodes where what matters is that there are some."""
    monkeypatch.setattr(tabulate_module, "radiosity", partial(radiosity, resolution=6))


@pytest.mark.usefixtures("_few_nodes")
@pytest.mark.parametrize("name", ["booth", pytest.param("lamp housing", marks=pytest.mark.long)])
def test_no_solid_is_left_out_for_its_name(name):
    box = Solid(name, SPECK.vertices * [500, 1, 500] + [-1.0, -2.0, 0.5], SPECK.faces, BLACK)
    theatre = Theatre(Dome(3.0, np.pi / 2), GREY, floor=Floor(0.0, 3.0, GREY), solids=(box,))
    assert tabulate(theatre, error=0.05, degree=1).walks > 0


@pytest.mark.usefixtures("_few_nodes")
def test_nothing_converges_that_has_not():
    theatre = Theatre(Dome(3.0, np.pi / 2), GREY, floor=Floor(0.0, 3.0, GREY))
    found = tabulate(theatre, error=1e-7, degree=1)
    assert found.status is Status.EXHAUSTED
    assert found.transport.relative_error() > 1e-7


@pytest.mark.parametrize(("screened", "backwards"), [(False, False), (True, False), (False, True)])
def test_lamps_are_seen(screened, backwards):
    """A square of half-edge 0.3 m, 2 m ahead, face on; behind a board; from behind."""
    edge = (-0.3, 0.0, 0.0) if backwards else (0.3, 0.0, 0.0)
    lamp = Lamp("sign", (0.0, 2.0, 0.5), edge, (0.0, 0.0, 0.3), (1.0, 2.0, 3.0))
    corners = np.array([[-1, 1, -0.5], [1, 1, -0.5], [1, 1, 1.5], [-1, 1, 1.5]])
    board = Solid("board", corners, np.array([[0, 1, 2], [0, 2, 3]]), BLACK)
    theatre = Theatre(
        Dome(3.0, np.pi / 2), GREY, lamps=(lamp,), solids=(board,) if screened else (SPECK,)
    )
    viewpoint = Viewpoint((0.0, 0.0, 0.5), (0.0, 2.0, 0.5), np.radians(90))
    seen = Tracer(theatre).visible_lamps(viewpoint, 160, 90)
    if screened or backwards:
        assert not seen.any()
        return
    # The picture is 4 m wide there.
    np.testing.assert_allclose(
        seen.sum((0, 1)) * (4 / 160) ** 2, 0.36 * np.array([1, 2, 3]), rtol=0.02
    )
    row, col = np.nonzero(seen[..., 0])
    assert abs(row.mean() - 44.5) < 0.3
    assert abs(col.mean() - 79.5) < 0.3


def test_white_is_as_bright_in_pictures_of_any_size():
    """A floor crosses pixels of the screen: what of them is lit is seen from above."""
    tracer, found = Tracer(BEFORE["floor in the beam"]), []
    for size, error in ((16, 0.02), (48, 0.06)):
        white = tracer.picture(np.ones((size, size, 3), np.float32))
        traced = tracer.screen(white, size, size, Settings(error=error, seed=size))
        found.append(traced.pooled_error(tracer.theatre.dome.screen_areas(size, size)))
    (small, first), (large, second) = found
    assert np.hypot(first, second) < 2e-3
    assert abs(small - large) < 3.5 * np.hypot(first, second)


def test_a_box_in_the_beam_is_lit_as_an_independent_tracer_found() -> None:
    """Light that the box reflects is 4.2 % of what the screen does; once it was lost: 0.32005."""
    tracer, size = Tracer(BEFORE["box in the beam"]), 64
    white = tracer.picture(np.ones((size, size, 3), np.float32))
    seen = tracer.screen(white, size, size, Settings(error=1e-9, least=64, most=64))
    found, error = seen.pooled_error(tracer.theatre.dome.screen_areas(size, size))
    assert error < 6e-4
    assert abs(found - 0.33413) < 3.5 * np.hypot(error, 0.00034)


@pytest.mark.usefixtures("_few_nodes")
@pytest.mark.parametrize(
    ("name", "explicit"),
    [
        ("box in the beam", False),
        pytest.param("floor in the beam", True, marks=pytest.mark.long),
        *(
            pytest.param(name, False, marks=pytest.mark.long)
            for name in sorted(BEFORE.keys() - {"box in the beam"})
        ),
    ],
)
def test_a_tabulated_theatre_keeps_light_that_is_stopped_before_the_screen(
    name, explicit, monkeypatch
):
    """Against walks from the screen's pixels, which the laws of energy test."""
    monkeypatch.setattr(tabulate_module, "LANES", 1 << 13)  # or more walks than are asked for
    theatre = BEFORE[name]
    tracer = Tracer(theatre)
    size = 64
    white = tracer.picture(np.ones((size, size, 3), np.float32))
    seen = tracer.screen(white, size, size, Settings(error=0.05, least=64))
    areas = theatre.dome.screen_areas(size, size)
    wanted, error = seen.pooled_error(areas)
    tabulated = tabulate(theatre, error=8e-3, explicit=explicit, degree=3, tracer=tracer)
    gains = lens_gains(theatre, size, size).sum(0)
    observation = tabulated.transport.observation(size, size, lens_gain=gains)
    light = np.ones((1, size, size, 3))
    found = (observation.observe(light) - observation.direct(light))[0]
    mean = np.einsum("ij,ijp->", areas, found) / areas.sum() / 3
    spread = np.hypot(error, tabulated.transport.relative_error() * wanted)
    assert abs(mean - wanted) < 3.5 * spread + 2e-3 * wanted
    assert spread < 0.02 * wanted
