"""Soft edges for the ghosts of a stereo pair that subtraction cannot take away.

The paper's reason to compensate is that a ghost's edges, which are none of the picture's, hinder
fusion (section 1). The least visible error leaves two thirds of them. So a pair's residual is not
taken from the master alone, but from the master with soft ghosts:

    aim = wanted + max(h G_s left - left, 0) / (1 + (g / (L_w + c) / v)²)

left is what subtraction shows too much, by primary, and G_s its Gaussian mean: just outside a ghost
there may be a rim of its light, h / 2 of it at a straight edge, that falls off smoothly. The more
the ghost stands out from what is around it, the fainter the rim, for on black the eye sees a veil
as well as the edge it hides: g is the luminance of the brightest ghost nearby (`brightest_nearby`),
L_w the local luminance of what is wanted, and c that below which the eye loses contrast.

Inside a ghost nothing changes: it cannot be darker. At its other edges it ends because the picture
is bright enough to subtract it from. There local contrast makes errors cheap, so that the error
jumped where the picture does. So near the edges of ghosts what is brighter than these counts as no
brighter, and K is multiplied by

    ((L + c) / (min(L, g) + c))^m,    m = min(1, (1 + (w / sigma)²)^1/2 G_w q),
    q = a / (a + t (g + c)),          a = sigma sqrt(2 pi) |grad G_sigma Y(left)|

with a the height of a step in the luminance of what is left, sigma as of the ghost edge energy
(`compensate.ghosts`), and w how far "near" is: a line keeps its height, and falls off smoothly.

The numbers are chosen by ``validate --only quality``; see ``validation/notes/0007``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from compensate.averaging import Averaging, Planes
from compensate.ghosts import edge_sigma, slope_magnitudes
from compensate.leeway import brightest_nearby
from domesim.errors import require_positive
from domesim.light import Light

_EDGE = 0.1  # t: share of the brightest ghost that a step of half the effect has


@final
@dataclass(frozen=True)
class Softening:
    """How soft the edges of ghosts are aimed at.

    Parameters
    ----------
    height
        h: twice the light of a rim at a straight edge, over the ghost's.
    reach
        s, the standard deviation of what a ghost is smoothed by, degrees.
    contrast
        v: how many times brighter than what is around it a ghost is whose rim is half as bright.
    near
        w, degrees from an edge.
    nearby
        How far away the brightest ghost may be, degrees.

    Raises
    ------
    InputError
        If one is not above 0 or not finite.
    """

    height: float = 1.25
    reach: float = 0.2
    contrast: float = 2.75
    near: float = 0.2
    nearby: float = 1.3

    def __post_init__(self) -> None:
        require_positive("softening", **vars(self))


@final
class Softener:
    """`Softening` on a screen.

    Parameters
    ----------
    settings
        How soft.
    screen
        (row, col) bool.
    density
        Pixels per degree.
    floor
        c, 1 = projector white.
    """

    def __init__(
        self, settings: Softening, screen: NDArray[np.bool_], density: float, floor: float
    ) -> None:
        self._settings, self._density, self._floor = settings, density, floor
        self._smooth = Averaging(screen, settings.reach * density)
        self._near = Averaging(screen, settings.near * density)

    def rims(self, left: Light, luminance: Planes, local: Planes) -> Light:
        """The rims to aim at, (view, row, col, primary).

        Parameters
        ----------
        left
            What subtraction shows too much, at least 0, (view, row, col, primary).
        luminance
            Its luminance.
        local
            The local luminance of what is wanted, (view, row, col).
        """
        ghost = self._brightest(luminance)
        standing_out = ghost / ((local + self._floor) * self._settings.contrast)
        share = 1 / (1 + standing_out**2)
        rims = np.empty_like(left)
        for p in range(left.shape[3]):
            outside = self._smooth(np.ascontiguousarray(left[..., p]))
            outside *= self._settings.height
            outside -= left[..., p]
            rims[..., p] = np.maximum(outside, 0, out=outside) * share
        return rims

    def factor(self, left: Planes, local: Planes) -> Planes:
        """How many times more errors count, (view, row, col), at least 1.

        Parameters
        ----------
        left
            Luminance that subtraction shows too much, at least 0.
        local
            L, of what it shows.
        """
        ghost = self._brightest(left)
        brighter = (local + self._floor) / (np.minimum(local, ghost) + self._floor)
        factor: Planes = brighter ** self._edges(left, ghost)
        return factor

    def _edges(self, left: Planes, ghost: Planes) -> Planes:
        """M."""
        sigma = edge_sigma(self._density)
        steps = slope_magnitudes(left, sigma)
        steps *= sigma * np.sqrt(2 * np.pi)
        near = self._near(steps / (steps + _EDGE * (ghost + self._floor)))
        near *= np.hypot(1, self._settings.near * self._density / sigma)
        return np.clip(near, 0, 1, out=near)

    def _brightest(self, left: Planes) -> Planes:
        """(row, col) of the brightest ghost nearby, in either view."""
        reach = self._settings.nearby * self._density
        ghost: Planes = brightest_nearby(left[..., None], reach)[..., 0]
        return ghost
