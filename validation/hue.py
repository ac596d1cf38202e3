"""The hue of what is seen: an angle in CIE 1976 u'v', around the projector's white."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from domesim.scene import Scene

DARKEST = 1e-4
"""Luminance, white = 1, below which nobody sees a hue."""


def shift_in_the_dark(desired: Light, seen: Light, scene: Scene) -> float | None:
    """Mean shift of hue of the darker half of a picture, degrees; None if all of it is black.

    Parameters
    ----------
    desired, seen
        (view, row, col, primary) what should be seen, and what is. The darker half of each view is
        below its median luminance, and above `DARKEST`.
    scene
        Where.
    """
    screen = scene.screen(*desired.shape[1:3])
    to_xyz = scene.projector.to_xyz
    white = np.ones(3) @ to_xyz.T
    shifts = []
    colours = (light[:, screen] @ to_xyz.T for light in (desired, seen))
    for wanted, shown in zip(*colours, strict=True):
        luminance = wanted[:, 1]
        dark = (luminance > DARKEST) & (luminance < np.median(luminance))
        turn = _hue(shown[dark], white) * np.conj(_hue(wanted[dark], white))
        shifts.append(np.abs(np.angle(turn, deg=True)))
    found = np.concatenate(shifts)
    return float(found.mean()) if found.size else None


def chromaticity(xyz: NDArray[Any]) -> NDArray[np.complex128]:
    """Complex u' + i v' (CIE 15:2004, section 8.2.1) of colours (..., XYZ) that are not black."""
    x, y, z = np.moveaxis(xyz, -1, 0)
    return np.asarray((4 * x + 9j * y) / (x + 15 * y + 3 * z))


def _hue(xyz: NDArray[Any], white: NDArray[Any]) -> NDArray[Any]:
    """Complex chromaticity from `white`."""
    return np.asarray(chromaticity(xyz) - chromaticity(white))
