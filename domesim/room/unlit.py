"""Light on a dome's screen without a picture: the projectors' black, and lamps.

A projector's black fills its whole field. What dims the picture in software where fields overlap
cannot dim it, so that a place has the sum of the blacks of all that reach it,

    B(x) = sum_u b_u [u reaches x],

and overlaps are as many times as bright. Only blends of glass or metal in the beam dim black, too.

What lies outside overlaps may be lifted, so that the eye does not find their edges. The least lift
that does it is found so: of all lights that are at least B and change by no more than the share c
within a degree, one is the least everywhere,

    V(x) = max_y B(y) exp(-c θ(x, y)),

θ in degrees from the dome's centre. c is the contrast at which a large area is seen by Blackwell's
observers [1, eq. 34 for A without end]; within a degree, for in such darkness the eye sees half
cycles of about a degree best [2]. What is projected is V - B.

[1] A. Crumey, "Human contrast threshold and astronomical visibility", MNRAS 442, 2600 (2014).
[2] S. Daly, "The visible differences predictor" (1993).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.light.blocks import enlarged
from domesim.room.dome import Dome, strips
from domesim.room.lenses import field_weight
from domesim.room.theatre import Lens, Theatre

Floats = NDArray[np.float64]

_COARSE = 256
"""Pixels a side of the domemaster for V, and at least for light of lamps: both are smooth."""
_LEVELS = 24
"""Most levels of B that are told apart: overlaps make a few."""
_PARTS = 4
"""Parts a side of a lamp, each of which shines as a point."""
_SAME = 1e-6  # relative


def projectors_black(theatre: Theatre, rows: int, cols: int) -> Floats:
    """(row, col): direct light of a black picture by the projectors, over white; 0 off the screen.

    It is that of places whose paint is 1. Overlaps are hidden if `Theatre.black_contrast` says so.

    Parameters
    ----------
    theatre
        The theatre.
    rows, cols
        Size of the domemaster.
    """
    black = np.zeros((rows, cols))
    for strip in strips(rows, cols):
        points = theatre.dome.points(rows, cols, strip)
        black[strip] = _black_of(theatre.lenses, points) + uplift(theatre, points)
    return np.where(theatre.dome.inside(rows, cols), black, 0.0)


def uplift(theatre: Theatre, points: Floats) -> Floats:
    """(...): the least light that hides overlaps in black, over white, at points of the screen.

    Parameters
    ----------
    theatre
        The theatre; without `Theatre.black_contrast` it lifts nothing.
    points
        (..., xyz) of the room, m.
    """
    if theatre.black_contrast is None:
        return np.zeros(points.shape[:-1])
    lifted = np.exp(_between(_hiding(theatre), theatre.dome, points))
    return np.maximum(lifted - _black_of(theatre.lenses, points), 0.0)


def lamp_light(theatre: Theatre, rows: int, cols: int) -> Floats:
    """(row, col, primary): direct light of the lamps, over white; 0 off the screen.

    It is that of places whose paint is 1. What stands before a lamp is left out.

    Parameters
    ----------
    theatre
        The theatre.
    rows, cols
        Size of the domemaster.
    """
    # It is smooth, and takes a microsecond a pixel: blocks' middles, and linear between them
    block = next((b for b in range(rows // _COARSE, 1, -1) if rows % b == 0 == cols % b), 1)
    coarse = np.moveaxis(_by_lamps(theatre, rows // block, cols // block), -1, 0)
    light = np.moveaxis(enlarged(coarse, block, slice(0, rows), cols), 0, -1)
    on = theatre.dome.inside(rows, cols)[..., None]
    return np.asarray(light * on * np.asarray(theatre.screen_albedo) / np.pi)


def _by_lamps(theatre: Theatre, rows: int, cols: int) -> Floats:
    """(row, col, primary) irradiance by the lamps, over white, beyond the screen, too."""
    dome, light = theatre.dome, np.zeros((rows, cols, 3))
    parts = (np.arange(_PARTS) + 0.5) * 2 / _PARTS - 1
    for strip in strips(rows, cols):
        points = dome.points(rows, cols, strip)
        inward = -dome.normals(dome.directions(rows, cols, strip)) @ dome.to_room.T
        for lamp in theatre.lamps:
            across, up = np.asarray(lamp.across), np.asarray(lamp.up)
            shines = np.cross(across, up) * 4 / _PARTS**2  # a part's area, along its normal
            for a in parts:
                for b in parts:
                    way = points - (np.asarray(lamp.centre) + a * across + b * up)
                    square = np.sum(way**2, -1)
                    leaves, arrives = way @ shines, -np.sum(way * inward, -1)
                    cosines = np.maximum(leaves, 0) * np.maximum(arrives, 0)
                    received = cosines / np.maximum(square, np.linalg.norm(shines)) ** 2
                    light[strip] += received[..., None] * np.asarray(lamp.luminance)
    return light


def _black_of(lenses: tuple[Lens, ...], points: Floats) -> Floats:
    """(...): B, with what projectors add to it, at points (..., xyz)."""
    black = np.zeros(points.shape[:-1])
    for lens in lenses:
        whole = replace(lens, blend=0.0, mask=None)
        if lens.black:
            black += lens.black * field_weight(lens if lens.blends_black else whole, points)
        if lens.uplift is not None:
            black += field_weight(replace(whole, mask=lens.uplift), points)
    return black


@lru_cache(maxsize=4)
def _hiding(theatre: Theatre) -> Floats:
    """(row, col): log V of a coarse domemaster, beyond the screen, too."""
    dome, contrast = theatre.dome, theatre.black_contrast
    assert contrast is not None
    toward = dome.directions(_COARSE, _COARSE)
    points = dome.points(_COARSE, _COARSE)
    black = np.where(dome.inside(_COARSE, _COARSE), _black_of(theatre.lenses, points), 0.0)
    hiding = np.full(black.shape, -np.inf)
    for level in _levels(black[black > 0]):
        tree = scipy.spatial.cKDTree(toward[black >= level * (1 - _SAME)])
        chord, _ = tree.query(toward)
        angle = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))
        np.maximum(hiding, np.log(level) - contrast * angle, out=hiding)
    return hiding


def _levels(black: Floats) -> Floats:
    """What B is told apart by."""
    found = np.unique(black)
    if len(found) < 2:
        return found
    found = found[np.concatenate([np.diff(found) > _SAME * found[1:], [True]])]
    return found if len(found) <= _LEVELS else np.geomspace(found[0], found[-1], _LEVELS)


def _between(coarse: Floats, dome: Dome, points: Floats) -> Floats:
    """(...): a coarse domemaster at points (..., xyz) of the room, linear between pixels."""
    toward = dome.toward(points)
    theta = np.arccos(np.clip(toward[..., 2], -1, 1))
    across = np.hypot(toward[..., 0], toward[..., 1])
    scale = theta / dome.half_angle / np.maximum(across, 1e-300)
    size = len(coarse)
    place = [(toward[..., k] * scale + 1) * (size / 2) - 0.5 for k in (1, 0)]
    found = scipy.ndimage.map_coordinates(
        coarse, [each.ravel() for each in place], order=1, mode="nearest"
    )
    return np.asarray(found.reshape(theta.shape))
