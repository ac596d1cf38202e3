"""Radiosity against what is known exactly, and against walks of light that know no form factors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from rooms import BEFORE, HEMISPHERE, ROOMS, SCREEN

from domesim.errors import InputError
from domesim.observation.basis import disc_quadrature
from domesim.observation.enclosure import Enclosure, Sheet
from domesim.observation.radiosity import _Solution, radiosity
from domesim.observation.spherical import closed_form_gain
from domesim.observation.transport import Transport, sample_nodes
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.furniture import box
from domesim.room.lenses import lens_gains
from domesim.room.theatre import Cavity, Floor, Lamp, Lens, Lobe, Theatre, Wall

Floats = NDArray[np.float64]


OPEN = [name for name in ROOMS if name not in ("hiding", "very flat")]


@cache
def solved(name: str, resolution: int = 8, nodes: int = 33) -> Transport:
    return radiosity(ROOMS[name], resolution=resolution, nodes=nodes, all_lit=True)


def closed_form(theatre: Theatre) -> list[float]:
    dome = theatre.dome
    return [
        closed_form_gain(rho, dome.radius, dome.screen_area) * dome.screen_area
        for rho in theatre.screen_albedo
    ]


def moments(transport: Transport) -> Floats:
    """(primary, i, j) means over the screen of p_i phi(p_j); p is white, front and right bright."""
    u, v, areas = disc_quadrature(transport.dome, 24)
    pictures = np.stack([np.ones_like(u), 1 + v, 1 + u])
    carried = sample_nodes(transport.modes, u, v) * (areas / areas.sum()) @ pictures.T
    return np.asarray(carried.T @ transport.core @ carried)


# What is known exactly


@pytest.mark.parametrize(
    "dome",
    [
        Dome(3.0, np.radians(20)),
        Dome(3.0, np.radians(90), 0.4),
        Dome(3.0, np.radians(150)),
        Dome(3.0, np.pi),
        Dome(3.0, np.radians(130), 0.3, truncated_below=-0.4),
    ],
    ids=["20", "90, leaning", "150", "whole sphere", "truncated"],
)
def test_a_bare_cap_is_the_closed_form(dome: Dome) -> None:
    theatre = Theatre(dome, (0.8, 0.3, 0.5), perforation=0.25)
    found = radiosity(theatre, resolution=6, nodes=11)
    assert found.mean_gain() == pytest.approx(closed_form(theatre), rel=1e-9)
    assert found.core[:, 0, 0] == pytest.approx(closed_form(theatre), rel=1e-9)
    assert np.abs(found.core).sum() == pytest.approx(found.core[:, 0, 0].sum(), rel=1e-9)
    assert found.provenance["discretisation_error"] < 1e-9
    share = dome.screen_area / (4 * np.pi * 9)
    assert found.provenance["sees"] == pytest.approx([share, share], rel=1e-9)


@pytest.mark.parametrize("name", ["at the spring line", "below it"])
def test_a_zone_on_its_floor_exchanges_light_like_two_points(name: str) -> None:
    """All of the screen sees the same share F of itself, and the floor sees nothing but screen.

    With means B_s = E + rho_s (F B_s + (1 - F) B_f) and B_f = rho_f B_s, whatever the picture is.
    """
    theatre, found = ROOMS[name], solved(name)
    assert theatre.floor is not None
    dome, floor = theatre.dome, theatre.floor.albedo
    share = dome.screen_area / (4 * np.pi * 9)
    for p in range(3):
        rates = np.array([[SCREEN[p] * share, SCREEN[p] * (1 - share)], [floor[p], 0.0]])
        light = np.linalg.solve(np.eye(2) - rates, [1.0, 0.0])
        assert found.mean_gain()[p] == pytest.approx(light[0] - 1, rel=1e-3)
    if name == "at the spring line":
        assert found.mean_gain()[0] == pytest.approx(3 / 7, rel=1e-3)
    # The means of slanted pictures: of white's pollution, and by reciprocity of their own.
    found_means = moments(found)
    assert found_means[:, 0] == pytest.approx(found_means[:, :, 0], rel=1e-9)
    _, v, areas = disc_quadrature(dome, 24)
    slanted = 1 + areas @ v / areas.sum()
    assert found_means[:, 0, 1] / found_means[:, 0, 0] == pytest.approx(slanted, rel=2e-3)
    assert found.provenance["closure_error"] < 1e-6
    assert found.provenance["sees"] == pytest.approx([1, 1], abs=1e-6)


def test_over_a_floor_at_the_spring_line_white_stays_even() -> None:
    """Each point of the hemisphere sees half of itself and half of an evenly lit floor."""
    size = 21
    observation = solved("at the spring line").observation(size, size)
    white = np.ones((1, size, size, 3))
    pollution = (observation.linear(white) - white)[0][observation.screen]
    assert pollution[:, 0] == pytest.approx(3 / 7, rel=0.015)  # the nodes blur the rim
    assert np.sqrt(np.mean((pollution[:, 0] * 7 / 3 - 1) ** 2)) < 3e-3


@pytest.mark.parametrize("name", ["recessed", "at the spring line"])
def test_energy_is_conserved(name: str) -> None:
    """White floor and walls of a closed room give all light back: rho / (1 - rho) for any shape.

    Black ones none: the closed form.
    """
    found, theatre = solved(name), ROOMS[name]
    assert found.provenance["closure_error"] < 1e-6
    gain, closed = found.mean_gain(), closed_form(theatre)
    rho = theatre.screen_albedo
    assert gain[1] == pytest.approx(rho[1] / (1 - rho[1]), rel=1e-6 if name == "recessed" else 1e-3)
    assert gain[2] == pytest.approx(closed[2], rel=1e-9)
    assert closed[0] < gain[0] < rho[0] / (1 - rho[0])


@pytest.mark.parametrize("name", OPEN)
def test_form_factors_never_exceed_one(name: str) -> None:
    least, largest = solved(name).provenance["sees"]
    assert largest < 1 + 1e-3
    if name in ("leaning", "flat"):
        assert least < 0.99
        assert solved(name).provenance["closure_error"] is None
    else:
        assert least > 1 - 1e-6


@pytest.mark.parametrize("name", OPEN)
def test_transport_is_reciprocal_and_positive(name: str) -> None:
    found = solved(name)
    assert found.core == pytest.approx(found.core.transpose(0, 2, 1), abs=1e-12)
    for core in found.core:
        assert np.linalg.eigvalsh(core).max() < core[0, 0] * 1.2
    assert found.modes[0] == pytest.approx(1)
    assert (moments(found) > 0).all()


def test_a_whole_ellipsoid_is_closed() -> None:
    """All of it is screen: the mean is rho / (1 - rho), and nearer with more points."""
    theatre = Theatre(Dome(3.0, np.pi, height_ratio=0.8), SCREEN)
    errors, exact = [], np.array(SCREEN) / (1 - np.array(SCREEN))
    for resolution in (6, 9):
        found = radiosity(theatre, resolution=resolution, nodes=49)
        least, largest = found.provenance["sees"]
        assert 1 - 0.06 / resolution < least < largest < 1 + 1e-4
        error = np.abs(found.mean_gain() / exact - 1).max()
        # A little more where light bounces more often than a tenth of it survives
        assert error < 3 * found.provenance["discretisation_error"]
        errors.append(error)
    assert errors[1] < 0.7 * errors[0] < 0.03


def test_a_black_screen_sends_nothing_back() -> None:
    theatre = replace(ROOMS["recessed"], albedo=(0.0, 0.0, 0.5))
    found = radiosity(theatre, resolution=6, nodes=11)
    assert found.mean_gain()[:2] == pytest.approx(0, abs=1e-12)
    assert found.mean_gain()[2] > 0
    assert found.provenance["discretisation_error"] < 0.01
    dark = radiosity(replace(theatre, albedo=(0.0, 0.0, 0.0)), resolution=6, nodes=11)
    assert dark.mean_gain() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["floor", "wall"])
def test_form_factors_of_patches_are_their_integrals(name: str) -> None:
    """Contour integrals against many points on each patch, of normals in any direction."""
    radii, heights = ([0.0, 0.3, 0.8], [-0.5, -0.5, -0.5])
    if name == "wall":
        radii, heights = ([0.9, 0.9, 0.9], [-0.6, -0.3, 0.1])
    sheet = Sheet(name, np.array(radii), np.array(heights), 7)
    points = np.array([[0.2, 0.1, 0.3], [-0.5, 0.4, 0.2], [0.1, -0.7, 0.05]])
    normals = np.array([[0.3, -0.2, -0.9], [0.4, -0.8, -0.5], [-0.7, 0.6, -0.2]])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    there, behind, areas = sheet.inner(24)
    apart = there - points[:, None, None]
    square = np.sum(apart**2, -1)
    leaving = np.sum(apart * normals[:, None, None], -1)
    arriving = -np.sum(apart * behind, -1)
    whole = (leaving > 0).all(-1)  # above the point's horizon
    assert whole.sum() > 12
    expected = (leaving * arriving / (np.pi * square**2) * areas).sum(-1)
    assert sheet.contour(points, normals)[whole] == pytest.approx(expected[whole], rel=1e-6)


# Settings


def test_more_rings_are_nearer() -> None:
    coarse, middle, fine = (solved("recessed", n) for n in (6, 8, 10))
    errors = [np.abs(moments(each) / moments(fine) - 1).max() for each in (coarse, middle)]
    assert errors[1] < 0.6 * errors[0] < 1e-3
    said = [each.provenance["discretisation_error"] for each in (coarse, middle, fine)]
    assert said[0] > said[1] > said[2]
    assert errors[0] < said[0]
    assert errors[1] < said[1]


@pytest.mark.parametrize("name", OPEN)
def test_the_error_it_says_is_in_its_core(name: str) -> None:
    found = solved(name)
    said = found.provenance["discretisation_error"]
    assert 1e-5 < said < 0.03
    assert found.core_error == pytest.approx(np.abs(found.core) * said)
    assert 0.5 * said < found.relative_error() < 2 * said
    assert found.provenance["sampling_error"] < 0.01
    assert found.provenance["elements"]["screen"] == 8 * 8**2


def test_modes_that_fit_their_own_points_only_are_reported() -> None:
    """Few points on a very flat dome: light at the points is right, but not between them."""
    found = solved("very flat", 6)
    off = np.abs(moments(found) / moments(solved("very flat", 12)) - 1).max()
    assert off > 0.1
    assert found.provenance["sampling_error"] > 0.5 * off


def test_fewer_modes_within_a_wider_tolerance() -> None:
    few, many = (
        radiosity(ROOMS["recessed"], resolution=6, nodes=17, tolerance=tolerance)
        for tolerance in (1e-2, 1e-4)
    )
    assert 1 < few.rank < many.rank
    assert few.mean_gain() == pytest.approx(many.mean_gain(), rel=1e-4)
    assert few.provenance["sampling_error"] < 0.02


BEYOND = {
    "a screen with a gain lobe": {"lobe": Lobe(0.2, 0.3)},
    "a cavity behind the screen": {"perforation": 0.2, "cavity": Cavity(0.5, SCREEN, SCREEN)},
    "solids (booth)": {"solids": (box("booth", (0, 0, -1), (1, 1, -0.5), SCREEN),)},
    "lamps (exit sign)": {
        "lamps": (Lamp("exit sign", (0, 0, -0.5), (0.1, 0, 0), (0, 0.1, 0), SCREEN),)
    },
}


@pytest.mark.parametrize("what", BEYOND)
def test_what_it_does_not_know_is_refused_by_name(what: str) -> None:
    with pytest.raises(InputError) as error:
        radiosity(replace(ROOMS["recessed"], **BEYOND[what]), resolution=6)
    assert f"got {what}; use 'domesim tabulate'" in str(error.value)


# Light that is stopped before the screen


@pytest.mark.parametrize("name", ["floor in the beam", "two beams"])
def test_as_much_light_is_stopped_as_rays_from_the_lens_find(name: str) -> None:
    """A floor behind all of the screen stops nothing."""
    theatre = BEFORE[name].enclosure
    tracer = Tracer(theatre)
    areas, thrown = theatre.dome.screen_areas(64, 64), lens_gains(theatre, 64, 64)
    hidden = tracer.gains(64, 64) < thrown / 2
    most = max(np.average(each, weights=areas) for each in hidden)
    assert Enclosure(theatre, 8).stopped == pytest.approx(most, abs=0.02)
    behind = replace(theatre, floor=Floor(theatre.dome.lowest - 0.1, 3.0, SCREEN), wall=None)
    assert Enclosure(behind, 8).lit


@pytest.mark.parametrize("name", ["floor in the beam", "two beams"])
def test_light_that_is_stopped_lands_somewhere(name: str) -> None:
    """Where a back stops it, or what is beyond the patches, it is lost; here is no such thing."""
    room = Enclosure(BEFORE[name].enclosure, 6)
    lit, landed = room.thrown()
    patches = room.areas[len(lit) :]
    assert room.weights * lit + patches @ landed == pytest.approx(room.weights, rel=1e-9)
    assert 0.1 < (patches @ landed).sum() / room.weights.sum() < 0.3


def test_energy_balances_where_light_is_stopped() -> None:
    """All that is emitted is absorbed in a closed room: arriving light is B / albedo."""
    theatre = BEFORE["floor in the beam"].enclosure
    room = Enclosure(theatre, 8)
    solution = _Solution(room, stopped=True)
    for mix in set(room.mixes):
        albedos = room.albedos(mix)
        shown = solution.radiosity(mix, np.ones((len(room.points), 1)))[:, 0]
        absorbed = room.areas * shown * (1 - albedos) / albedos
        assert absorbed.sum() == pytest.approx(room.screen_area / mix.screen, rel=2e-3)


# Walks end in rooms of less than white; a lens stands above its stage.
WALKED = BEFORE | {
    "recessed": replace(
        ROOMS["recessed"],
        floor=Floor(-1.0, 3.0, (0.2, 0.9, 0.0)),
        wall=Wall(3.0, -1.0, 0.0, (0.3, 0.9, 0.0)),
    ),
    "leaning": ROOMS["leaning"],
    "flat": ROOMS["flat"],
    "hiding": replace(
        ROOMS["hiding"], lenses=(Lens("lens", (0.0, 0.0, 0.6), (0.0, 0.0, 5.0), field=2 * np.pi),)
    ),
}


@pytest.mark.parametrize(
    ("name", "resolution"),
    [
        *((name, 8) for name in ("recessed", "leaning", "flat", "hiding", "floor in the beam")),
        pytest.param("two beams", 12, marks=pytest.mark.long),
    ],
)
def test_light_is_reflected_as_walks_find(name: str, resolution: int) -> None:
    """Without what a floor in the beam stops, that room's white is 6 to 27 % too dark."""
    theatre, size = WALKED[name].enclosure, 64
    tracer = Tracer(theatre)
    areas = theatre.dome.screen_areas(size, size)
    gains = lens_gains(theatre, size, size).sum(0)
    observation = radiosity(theatre, resolution=resolution, nodes=33).observation(
        size, size, lens_gain=gains
    )
    half = np.arange(size) < size / 2
    for picture in (np.ones((size, size)), half[:, None] + 0.0 * half):
        light = np.repeat(picture[..., None], 3, -1) * theatre.dome.inside(size, size)[..., None]
        traced = tracer.screen(
            tracer.picture(light.astype(np.float32)),
            size,
            size,
            Settings(error=6e-3, least=32, most=64),
        )
        found = (observation.observe(light[None]) - observation.direct(light[None]))[0]
        wanted, found = (np.einsum("ij,ijp->p", areas, part) for part in (traced.mean, found))
        assert found == pytest.approx(wanted, rel=0.01)


def test_a_black_screen_has_no_unit_for_light_that_is_stopped() -> None:
    theatre = replace(BEFORE["floor in the beam"].enclosure, albedo=(0.5, 0.0, 0.5))
    with pytest.raises(InputError, match="give the screen an albedo above 0"):
        radiosity(theatre, resolution=6)


@pytest.mark.parametrize("resolution", [5, 0, -3])
def test_too_few_rings_are_refused(resolution: int) -> None:
    with pytest.raises(InputError, match=f"resolution must be at least 6, got {resolution}"):
        radiosity(ROOMS["recessed"], resolution=resolution)


@pytest.mark.parametrize("name", ["floor", "wall"])
def test_points_of_floor_and_wall_see_a_closed_room(name):
    theatre = Theatre(
        Dome(5.0, np.pi / 2),
        (0.5, 0.5, 0.5),
        floor=Floor(-1.5, 5.0, (0.2, 0.2, 0.2)),
        wall=Wall(5.0, -1.5, 0.0, (0.1, 0.1, 0.1)),
    )
    room = Enclosure(theatre, 8)
    points = {
        "floor": np.array([[0.1, 0.2, -0.3], [0.5, -0.4, -0.3]]),
        "wall": np.array([[0.6, 0.8, -0.1], [0.0, -1.0, -0.25]]),
    }[name]
    assert np.allclose(room.seen_from_sheet(name, points).sum(1), 1, atol=5e-3)


def test_a_floor_that_gives_nothing_back_changes_nothing() -> None:
    dark = (0.0, 0.0, 0.0)
    for dome in (HEMISPHERE, Dome(3.0, 1.2, 0.3)):
        theatre = Theatre(
            dome, SCREEN, floor=Floor(-1.2, 3.0, dark), wall=Wall(3.0, -1.2, -1, dark)
        )
        found = radiosity(theatre, resolution=6, nodes=11)
        assert found.mean_gain() == pytest.approx(closed_form(theatre), rel=1e-9)


def test_a_deeper_floor_gives_back_less() -> None:
    """Down to nothing: far below it is a point."""
    gains = []
    for depth in (0.5, 2.0, 6.0, 300.0):
        theatre = Theatre(HEMISPHERE, SCREEN, floor=Floor(-depth, 3.0, (0.9, 0.9, 0.9)))
        gains.append(radiosity(theatre, resolution=6, nodes=11).mean_gain())
    assert (np.diff(gains, axis=0) < 0).all()
    closed = closed_form(theatre)
    assert gains[-1] == pytest.approx(closed, rel=1e-4)
    # Far away both are small: white light goes down as through a hole, and a share comes back.
    sixth = gains[2][0] - closed[0]
    assert sixth == pytest.approx(twice_through(6.0) * (1 + closed[0]) ** 2 * SCREEN[0], rel=0.05)


def twice_through(depth: float) -> float:
    """Share of an evenly lit hemisphere's light that a distant floor of albedo 0.9 sends back.

    Form factors between equal coaxial discs (the dome's mouth, the floor), there and back.
    """
    ratio = 3.0 / depth
    x = 2 + 1 / ratio**2
    there = (x - np.sqrt(x**2 - 4)) / 2
    # Half of what leaves the screen passes its mouth; the same half returns to each of its points.
    return 0.5 * 0.9 * there**2
