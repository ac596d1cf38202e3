"""Scenes of many views: what their files say is what is seen, and what cannot be is refused."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.scene import load_scene

ANY = {
    "name": "any",
    "screen": {"width_m": 1.0, "height_m": 0.5},
    "projector": {"primaries": "BT.709", "white_cd_m2": 50.0, "black_cd_m2": 0.5},
    "viewing": {"distance_m": 2.0, "adaptation_cd_m2": 10.0},
}


def scene(**views):
    return load_scene({**ANY, "crosstalk": {"views": views}})


def leaks(**views) -> np.ndarray:
    """(primary, view, view)"""
    found = scene(**views).observation(2, 3).leaks
    assert not found[:, [0, 1, 2], :, [1, 2, 0]].any()  # views leak each primary into itself
    return np.stack([found[:, p, :, p] for p in range(3)])


def test_neighbours_leak_to_both_sides():
    found = leaks(count=4, neighbours=[0.2, [0.01, 0.02, 0.03]])
    far = 0.02
    assert found[1] == pytest.approx(
        np.array([[0, 0.2, far, 0], [0.2, 0, 0.2, far], [far, 0.2, 0, 0.2], [0, far, 0.2, 0]])
    )
    assert found[2, 0, 2] == pytest.approx(0.03)


def test_lenses_repeat_the_views():
    found = leaks(count=5, neighbours=[0.2, 0.1], repeats=True)[0]
    assert found[0] == pytest.approx([0, 0.2, 0.1, 0.1, 0.2])
    assert found[4] == pytest.approx([0.2, 0.1, 0.1, 0.2, 0])


def test_a_matrix_says_who_sees_whom():
    found = leaks(count=3, matrix=[[1, 0.1, 0.2], [0.3, 1, [0.1, 0.2, 0.3]], [0, 0.05, 1]])
    assert found[1] == pytest.approx(np.array([[0, 0.1, 0.2], [0.3, 0, 0.2], [0, 0.05, 0]]))
    assert found[2, 1, 2] == pytest.approx(0.3)


def test_black_and_places_count_for_each_view():
    seats = [{"name": "here", "map": [[1.0, 2.0]]}]
    content = {**ANY, "seats": seats, "crosstalk": {"views": {"count": 3, "neighbours": [0.1]}}}
    observation = load_scene(content).observation(1, 2)
    seen = observation.observe(np.ones((3, 1, 2, 3)))
    assert seen[:, 0, :, 1] == pytest.approx(0.01 + np.array([[1.1, 1.2], [1.2, 1.4], [1.1, 1.2]]))


@pytest.mark.parametrize("name", ["autostereo_7", "autostereo_8"])
def test_the_bundled_ones_follow_from_their_layout(name):
    """A subpixel's width, convolved with what the slant moves it by; in the mean over a zone."""
    width, slant = {"autostereo_7": (2, 1), "autostereo_8": (1, 1)}[name]
    step = 1 / 400
    at = np.arange(-4, 4, step) + step / 2
    box = [(np.abs(at) < side / 2).astype(float) for side in (width, slant)]
    light = np.convolve(box[0], box[1], "same") * step
    own, near, after = (light[np.abs(at - k) < 0.5].mean() for k in (0, 1, 2))
    observation = load_scene(name).observation(1, 1)
    assert observation.leaks[0, 0, 1, 0] == pytest.approx(near / own, abs=2e-3)
    assert observation.leaks[0, 0, 2, 0] == pytest.approx(after / own, abs=2e-3)
    assert observation.leaks[0, 0, -1, 0] == observation.leaks[0, 0, 1, 0]


@pytest.mark.parametrize(
    ("views", "message"),
    [
        ({"count": 4}, "needs neighbours, or a matrix"),
        ({"count": 2, "neighbours": [0.1], "matrix": [[0, 0], [0, 0]]}, "needs neighbours, or"),
        ({"count": 3, "matrix": [[0, 0.1], [0.1, 0]]}, "must be 3 rows of 3 shares"),
        ({"count": 4, "neighbours": [0.1] * 4}, "4 views have 3 to a side at most, got 4"),
        ({"count": 9, "neighbours": [0.6]}, "cannot be undone"),
    ],
)
def test_what_cannot_be_is_refused(views, message):
    with pytest.raises(InputError, match=message):
        scene(**views)


def test_what_many_views_have_not_is_refused():
    views = {"views": {"count": 3, "neighbours": [0.1]}}
    seats = [{"name": "here", "map_left": [[1.0]], "map_right": [[1.0]]}]
    with pytest.raises(InputError, match="many views have one map"):
        load_scene({**ANY, "crosstalk": views, "seats": seats})
    with pytest.raises(InputError, match="told in one way"):
        load_scene({**ANY, "crosstalk": {**views, "share": 0.1}})
    with pytest.raises(InputError, match=r"neither \[lens\] nor \[room\]"):
        load_scene({**ANY, "crosstalk": views, "lens": {"throw_m": 3.0, "scattered": 0.01}})
