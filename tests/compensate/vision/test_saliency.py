"""GBVS: the equilibria against the walks themselves, and scenes whose salient place is known."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.vision.saliency import (
    _activation,
    _faded,
    _features,
    _kernel,
    gbvs,
)
from domesim.light.transfer import SRGB

RNG = np.random.default_rng(7)
GRID = (5, 7)


def walked(weights: np.ndarray) -> np.ndarray:
    """Where a lazy walk ends: it stays with probability 1/2, so that it never alternates."""
    chain = weights / weights.sum(axis=1, keepdims=True)
    chain = (chain + np.eye(len(chain))) / 2
    for _ in range(60):  # 2^60 steps
        chain = chain @ chain
        chain /= chain.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(chain, np.broadcast_to(chain[0], chain.shape), atol=1e-13)
    return chain[0]


def distances(grid: tuple[int, int]) -> np.ndarray:
    """exp(-d² / 2 sigma²) by loops, sigma = 0.3 x the mean side."""
    sigma = 0.3 * (grid[0] + grid[1]) / 2
    places = [(i, j) for i in range(grid[0]) for j in range(grid[1])]
    squares = [[(i - p) ** 2 + (j - q) ** 2 for p, q in places] for i, j in places]
    return np.exp(-np.array(squares) / (2 * sigma**2))


MAPS = {
    "any": RNG.random(35),
    "signed": RNG.normal(size=35),
    "two values": (RNG.random(35) < 0.4).astype(float),
    "one place": np.eye(35)[12],
}


@pytest.mark.parametrize("name", MAPS)
def test_activation_is_the_equilibrium_of_the_walk(name):
    feature = MAPS[name]
    expected = walked(np.abs(np.subtract.outer(feature, feature)) * distances(GRID))
    ours = _activation(feature, _kernel(GRID, 0.3))
    np.testing.assert_allclose(ours, expected, atol=1e-12)


def scene(*, shape=(108, 204), colour=(0.2, 0.2, 0.2)):
    return np.broadcast_to(np.array(colour), (*shape, 3)).copy()


def centres():
    return [(row, col) for row in (18, 54, 90) for col in (17, 51, 85, 119, 153, 187)]


def discs(odd):
    """Green discs of radius 7, the odd one red, all of the grey background's luminance, 0.249."""
    picture = scene(colour=(0.2489, 0.2489, 0.2489))
    row, col = np.indices(picture.shape[:2])
    for number, (r, c) in enumerate(centres()):
        disc = (row - r) ** 2 + (col - c) ** 2 <= 49
        picture[disc] = (0.8, 0.1, 0.1) if number == odd else (0.1, 0.3081, 0.1)
    return picture


def bars(odd):
    """Upright bars, 3 x 17, the odd one at 45 degrees."""
    picture = scene()
    row, col = np.indices(picture.shape[:2])
    for number, (r, c) in enumerate(centres()):
        y, x = row - r, col - c
        across, along = (x, y) if number != odd else ((x + y) / np.sqrt(2), (x - y) / np.sqrt(2))
        picture[(np.abs(across) <= 1.5) & (np.abs(along) <= 8.5)] = 0.8
    return picture


@pytest.mark.parametrize(
    ("picture", "odd"),
    [(discs, odd) for odd in (1, 9, 14)] + [(bars, odd) for odd in (7, 10)],
)
def test_the_odd_one_out_is_salient(picture, odd):
    """Bars near the border are left out: orientation is faded there, as in the authors' program."""
    saliency = gbvs(picture(odd))
    at = [saliency[r - 7 : r + 8, c - 7 : c + 8].mean() for r, c in centres()]
    assert int(np.argmax(at)) == odd


def test_orientation_counts_less_near_the_border():
    """Not faded, the odd bar would be as salient as even ones in the middle."""
    saliency = gbvs(bars(4))
    at = [saliency[r - 7 : r + 8, c - 7 : c + 8].mean() for r, c in centres()]
    assert 0.6 < at[4] / max(at) < 0.88


def busy(shape=(90, 160)):
    """A picture with features of all kinds and no symmetry."""
    rng = np.random.default_rng(3)
    picture = scene(shape=shape)
    for _ in range(25):
        r, c = rng.integers(0, shape[0] - 8), rng.integers(0, shape[1] - 12)
        picture[r : r + rng.integers(2, 30), c : c + rng.integers(2, 40)] = rng.random(3)
    return picture


def test_the_map_turns_with_the_picture():
    picture = busy()
    saliency = gbvs(picture)
    assert saliency.shape == (90, 160)
    assert saliency.min() == 0
    assert saliency.max() == 1
    np.testing.assert_allclose(gbvs(picture[:, ::-1]), saliency[:, ::-1], atol=1e-9)
    np.testing.assert_allclose(gbvs(picture[::-1]), saliency[::-1], atol=1e-9)
    np.testing.assert_allclose(gbvs(picture.transpose(1, 0, 2)), saliency.T, atol=1e-9)
    # the checks above mean nothing for a map that is symmetric by itself
    assert np.abs(saliency - saliency[:, ::-1]).max() > 0.1


def test_neither_the_unit_nor_the_resolution_matters():
    picture = busy()
    saliency = gbvs(picture)
    np.testing.assert_allclose(gbvs(400 * picture), saliency, atol=1e-9)
    double = gbvs(picture.repeat(2, axis=0).repeat(2, axis=1))
    np.testing.assert_allclose(double[::2, ::2], saliency, atol=0.05)
    np.testing.assert_allclose(gbvs(picture.astype(np.float32)), saliency, atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (41, 67)])
@pytest.mark.parametrize("colour", [(0, 0, 0), (0.1, 0.7, 1 / 3), (1e-30,) * 3])
def test_a_picture_of_one_colour_prefers_no_place(shape, colour):
    picture = scene(shape=shape, colour=colour).astype(np.float32)
    np.testing.assert_array_equal(gbvs(picture), 1)


@pytest.mark.parametrize("shape", [(1, 2), (40, 1), (2, 3), (3, 500)])
def test_tiny_and_narrow_pictures(shape):
    saliency = gbvs(np.random.default_rng(1).random((*shape, 3)))
    assert saliency.shape == shape
    assert np.isfinite(saliency).all()
    assert saliency.min() >= 0
    assert saliency.max() == 1


@pytest.mark.parametrize("seed", range(8))
def test_places_that_are_alike_are_equally_salient(seed):
    """A pair, and the four fields of a chessboard: rounding must not decide between them."""
    one, other = np.random.default_rng(seed).random((2, 3))
    np.testing.assert_array_equal(gbvs([[one, other]]), 1)
    np.testing.assert_array_equal(gbvs([[one, other], [other, one]]), 1)


def test_light_is_seen_encoded():
    """An equal step of light is a larger one in the dark."""
    picture = scene(colour=(0.3, 0.3, 0.3))
    picture[46:62, 40:60] = 0.05
    picture[46:62, 144:164] = 0.55
    saliency = gbvs(picture)
    assert saliency[54, 50] > 1.1 * saliency[54, 153]


def test_colours_are_of_light_and_intensity_of_the_largest_code_value():
    """The author's program is given code values; it decodes them for the opponent colours alone."""
    np.testing.assert_allclose(  # IEC 61966-2-1
        SRGB().encode(np.array([0.0, 0.002, 0.2140411, 1.0])), [0, 0.02584, 0.5, 1], atol=1e-6
    )
    picture = np.kron([[0.2140411, 1.0]], np.ones((40, 20)))[..., None] * [1.0, 0.0, 0.0]
    *colours, intensity = [feature for feature, _ in _features(picture, (4, 4))[:4]]
    for colour in colours:
        assert colour[0, 0] / colour[0, 3] == pytest.approx(0.2140411)
    assert intensity[0, [0, 3]] == pytest.approx([0.5, 1.0])  # not a third of it


def test_borders_are_faded():
    """Ramps of k / (border + 1); where two borders meet, halfway."""
    np.testing.assert_allclose(
        _faded(np.ones((1, 9)), 4), [[0.2, 0.4, 0.6, 0.8, 1, 0.8, 0.6, 0.4, 0.2]]
    )
    np.testing.assert_allclose(_faded(np.ones((4, 1)), 9).T, np.array([[1, 2, 2, 1]]) / 3)
    picture = scene()
    for col in (4, 96):  # no intensity, and so no orientation
        picture[46:62, col : col + 12] = (0.2, 0.1, 0.2)
    saliency = gbvs(picture)
    assert saliency[54, 10] < 0.8 * saliency[54, 102]
