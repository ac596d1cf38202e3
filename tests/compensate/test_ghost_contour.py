"""The ghost contour of pictures whose edges are known."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.ghosts import ghost_contour


def ghost() -> np.ndarray:
    """The left eye's: a bar in the left half, a fainter one in the right half."""
    planes = np.zeros((2, 24, 40))
    planes[0, 6:18, 8:12] = 1.0
    planes[0, 6:18, 28:32] = 0.5
    return planes


EVERYWHERE = np.ones((2, 24, 40), bool)


@pytest.mark.parametrize(("share", "contour"), [(1.0, 1.0), (0.25, 0.25), (0.0, 0.0), (-0.5, 0.5)])
def test_contour_of_a_share_of_the_ghost(share, contour):
    found = ghost_contour(share * ghost() + 0.3, ghost(), EVERYWHERE, 10.0)
    assert found == pytest.approx(contour, abs=1e-12)


def test_contour_is_of_the_pixels_asked_for():
    right = EVERYWHERE.copy()
    right[:, :, :20] = False
    error = ghost()
    error[:, :, 20:] *= 0.3  # what is elsewhere does not count
    assert ghost_contour(error, ghost(), right, 10.0) == pytest.approx(0.3)


def test_edges_along_the_ghosts_do_not_count():
    """A ramp along the bar's long edges, away from its ends."""
    middle = np.zeros_like(EVERYWHERE)
    middle[0, 10:14, 4:16] = True
    ramp = np.broadcast_to(0.1 * np.arange(24.0)[:, None], (2, 24, 40))
    plain, steeper = (
        ghost_contour(0.5 * ghost() + error, ghost(), middle, 10.0) for error in (0 * ramp, ramp)
    )
    assert plain == pytest.approx(0.5)
    assert steeper == pytest.approx(0.5, rel=1e-3)


def test_faint_edges_do_not_count():
    """Texture far below the ghost's edges, which doubles: the ghost's tenth that is left out."""
    texture = 1e-3 * np.random.default_rng(0).standard_normal((2, 24, 40))
    error = ghost() + 10 * texture
    assert ghost_contour(error, ghost() + texture, EVERYWHERE, 10.0) == pytest.approx(1, abs=0.02)


def test_without_a_ghost_there_is_no_contour():
    assert ghost_contour(ghost(), 0 * ghost() + 0.2, EVERYWHERE, 10.0) is None
    assert ghost_contour(ghost(), ghost(), ~EVERYWHERE, 10.0) is None
