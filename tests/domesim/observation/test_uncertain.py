"""Changes of what is seen are those of other observations, and their products are means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pairs import COLOURED, pair, share

from domesim.observation.crosstalk import Crosstalk, over_pixels
from domesim.observation.radiosity import radiosity
from domesim.observation.seats import SeveralSeats
from domesim.observation.transport import Transport
from domesim.observation.uncertain import Step, UncertainDome, UncertainMap, UncertainPair
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre

ROWS, COLS, CELLS = 54, 75, (9, 15)


def cells() -> np.ndarray:
    """(view, row, col) a coarse map."""
    return share(*CELLS)


def uneven() -> np.ndarray:
    """(change, view, row, col) two smooth changes of it, one for each view."""
    row, col = np.mgrid[-1 : 1 : CELLS[0] * 1j, -1 : 1 : CELLS[1] * 1j]
    return np.stack([[0.03 * row, 0 * row], [0 * row, 0.02 * (col - row**2)]])


def matrices() -> np.ndarray:
    """(change, view, primary, primary)."""
    return 0.01 * np.random.default_rng(1).standard_normal((3, 2, 3, 3))


def crosstalk(leak: np.ndarray = COLOURED, coarse: np.ndarray | None = None) -> Crosstalk:
    coarse = cells() if coarse is None else coarse
    return Crosstalk(ROWS, COLS, leak, share=over_pixels(coarse, ROWS, COLS), black=0.01)


def uncertain() -> UncertainPair:
    return UncertainPair(crosstalk(), [crosstalk()], matrices(), [UncertainMap(cells(), uneven())])


def fields(changes, count: int) -> np.ndarray:
    return np.stack([changes.seen(z) for z in np.eye(count)]).astype(np.float64)


def assert_means(changes, count: int, residual: np.ndarray, weights: np.ndarray, rel: float):
    """`products` are means by (row, col) weights that add up to 1."""
    shown = fields(changes, count)
    mean = weights[None, :, :, None] / (residual.shape[0] * residual.shape[3])
    square, crossed, own = changes.products(residual)
    assert square == pytest.approx(np.sum(mean * residual**2), rel=1e-5)
    scale = np.sqrt(np.diag(own))
    wanted = np.einsum("kvrcp,lvrcp,vrcp->kl", shown, shown, np.broadcast_to(mean, residual.shape))
    assert np.abs((own - wanted) / np.outer(scale, scale)).max() < rel
    wanted = np.einsum("kvrcp,vrcp->k", shown, mean * residual)
    assert np.abs((crossed - wanted) / scale).max() < rel * np.sqrt(square)


def test_changes_of_a_pair_are_those_of_other_crosstalk():
    light, z = pair(ROWS, COLS), np.array([0.5, -1.0, 0.3, 0.0, 0.0])
    found = uncertain().changes(light).seen(z)
    other = crosstalk(COLOURED + np.tensordot(z[:3], matrices(), 1))
    assert np.allclose(found, other.observe(light) - crosstalk().observe(light), atol=1e-12)
    z = np.array([0.0, 0.0, 0.0, 0.7, -0.4])
    found = uncertain().changes(light).seen(z)
    other = crosstalk(coarse=cells() + np.tensordot(z[3:], uneven(), 1))
    assert np.allclose(found, other.observe(light) - crosstalk().observe(light), atol=1e-12)


def test_products_of_a_pair_are_means():
    light = pair(ROWS, COLS)
    weights = np.full((ROWS, COLS), 1 / (ROWS * COLS))
    residual = pair(ROWS, COLS, seed=5) - 0.1
    assert_means(uncertain().changes(light), 5, residual, weights, 0.03)


def test_several_seats_share_the_matrices_errors():
    light = pair(ROWS, COLS)
    weights = np.full((ROWS, COLS), 1 / (ROWS * COLS))
    even = UncertainMap(np.ones((2, 1, 1)), np.zeros((0, 2, 1, 1)))
    flat = Crosstalk(ROWS, COLS, 0.5 * COLOURED)
    seats = [crosstalk(), flat]
    both = UncertainPair(
        SeveralSeats(seats), seats, matrices(), [UncertainMap(cells(), uneven()), even]
    )
    shown = fields(both.changes(light), 5)
    alone = UncertainPair(flat, [flat], matrices(), [even])
    assert np.allclose(shown[:3, 2:], fields(alone.changes(light), 3))
    assert np.all(shown[3:, 2:] == 0)
    residual = np.concatenate([pair(ROWS, COLS, seed=5), pair(ROWS, COLS, seed=6)]) - 0.1
    assert_means(both.changes(light), 5, residual, weights, 0.03)


THEATRE = Theatre(
    Dome(4.0, np.radians(85), tilt=0.1), (0.6, 0.45, 0.3), floor=Floor(-1.2, 4.0, (0.2, 0.15, 0.08))
)
SIZE = 40


def brighter(size: float) -> tuple[Theatre, Theatre]:
    """With albedos of the screen, and of the floor, that are larger."""
    assert THEATRE.floor is not None
    screen = replace(THEATRE, albedo=tuple(a + size for a in THEATRE.albedo))
    floor = replace(THEATRE.floor, albedo=tuple(a + size for a in THEATRE.floor.albedo))
    return screen, replace(THEATRE, floor=floor)


@pytest.fixture(scope="module")
def base() -> Transport:
    return radiosity(THEATRE, resolution=6)


@pytest.fixture(scope="module")
def dome(base) -> UncertainDome:
    """Screen and floor albedos are off together in R, alone in G, and not in B."""
    steps = [Step(base, radiosity(each, resolution=6), np.full(3, 0.01)) for each in brighter(0.01)]
    factor = np.zeros((2, 3, 2))
    factor[:, 0, 0] = 0.02, -0.03
    factor[0, 1, 1] = 0.01
    exact = replace(base, core_error=np.zeros_like(base.core))
    return UncertainDome(exact.observation(SIZE, SIZE), steps, factor)


def test_changes_of_a_dome_are_those_of_other_albedos(dome):
    light = pair(SIZE, SIZE, dtype=np.float32)[:1] * THEATRE.dome.inside(SIZE, SIZE)[..., None]
    step = 0.004
    screen, floor = (
        radiosity(each, resolution=9).observation(SIZE, SIZE) for each in brighter(step)
    )
    plain = radiosity(THEATRE, resolution=9).observation(SIZE, SIZE)
    slopes = [(each.observe(light) - plain.observe(light)) / step for each in (screen, floor)]
    found = dome.changes(light).seen(np.array([1.0, 2.0]))
    wanted = np.zeros_like(found)
    wanted[..., 0] = 0.02 * slopes[0][..., 0] - 0.03 * slopes[1][..., 0]
    wanted[..., 1] = 2 * 0.01 * slopes[0][..., 1]
    assert np.abs(found - wanted).max() < 0.02 * np.abs(wanted).max()
    assert np.all(found[..., 2] == 0)


def test_products_of_a_dome_are_means(dome):
    light = pair(SIZE, SIZE, dtype=np.float32)[:1]
    areas = THEATRE.dome.screen_areas(SIZE, SIZE) * THEATRE.dome.inside(SIZE, SIZE)
    residual = pair(SIZE, SIZE, seed=4, dtype=np.float32)[:1] - 0.1
    residual *= THEATRE.dome.inside(SIZE, SIZE)[..., None]
    assert_means(dome.changes(light), 2, residual, areas / areas.sum(), 0.02)


def test_errors_of_a_transport_spread_as_they_do_when_drawn(base):
    light = pair(SIZE, SIZE)[:1]
    small = replace(base.reduced(highest=4), core_error=np.abs(base.reduced(highest=4).core) / 20)
    plain = small.observation(SIZE, SIZE)
    known = UncertainDome(plain, [], np.zeros((0, 3, 0)))
    _, _, own = known.changes(light).products(np.zeros_like(light))
    rng = np.random.default_rng(0)
    squares = []
    for _ in range(300):
        core = small.core + small.core_error * rng.standard_normal(small.core.shape)
        other = replace(small, core=core).observation(SIZE, SIZE)
        off = other.observe(light) - plain.observe(light)
        squares.append(plain.means(off**2).sum() / 3)
    error = np.std(squares) / np.sqrt(len(squares))
    assert abs(np.mean(squares) - np.trace(own)) < 4 * error + 0.02 * np.trace(own)
