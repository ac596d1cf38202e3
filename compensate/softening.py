"""Soft edges for the ghosts of a stereo pair that subtraction cannot take away.

The paper's reason to compensate is that a ghost's edges, which are none of the picture's, hinder
fusion (section 1). The least visible error leaves two thirds of them. So a pair's residual is not
taken from the master alone, but from the master with soft ghosts:

    aim = wanted + max(h G_s left - b G_w left - left, 0) / (1 + r / v),   r = g / (L_w + d)

left is what subtraction shows too much, by primary, and G_s its Gaussian mean: just outside a ghost
there may be a rim of its light that falls off smoothly. A wider mean G_w ends the rim soon, and
fills no gap between many ghosts. The more the ghost stands out from what is around it, the fainter
the rim, for on black the eye sees a veil as well as the edge it hides: g is the luminance of the
brightest ghost nearby (`brightest_nearby`), L_w the local luminance of what is wanted, and d one
below which the eye hardly sees.

Other changes of the light, which spread further than rims, are held back there as well: the
regulariser's mu counts

    m = 1 + f r² / (r² + u²)

times, with the lesser L_w of both eyes (`compensate.problem`).

Inside a ghost nothing changes: it cannot be darker. At its other edges it ends because the picture
is bright enough to subtract it from. There local contrast makes errors cheap, so that the error
jumped where the picture does. So near the edges of ghosts what is brighter than these counts as no
brighter, and K is multiplied by

    ((L + c) / (min(L, g) + c))^n,    n = min(1, (1 + (w_e / sigma)²)^1/2 G_e q),
    q = a / (a + t (g + c)),          a = sigma sqrt(2 pi) |grad G_sigma Y(left)|

with a the height of a step in the luminance of what is left, sigma as of the ghost edge energy
(`compensate.ghosts`), and w_e how far "near" is: a line keeps its height, and falls off smoothly.

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
from domesim.errors import require_not_negative, require_positive
from domesim.light import Light
from domesim.strips import in_strips


@final
@dataclass(frozen=True)
class Softening:
    """How soft the edges of ghosts are aimed at.

    Parameters
    ----------
    height
        h: at a straight edge a rim has half of this times the ghost's light, less b / 2.
    reach
        s, the standard deviation of what a ghost is smoothed by, degrees.
    crowding
        b: share of the wider mean that rims lack, or 0.
    crowd
        w, the standard deviation of that, degrees.
    contrast
        v: how many times brighter than what is around it a ghost is whose rim is half as bright.
    dark
        d, cd/m².
    near
        w_e, degrees from an edge.
    step
        t: share of the brightest ghost that a step of half the effect has.
    nearby
        How far away the brightest ghost may be, degrees.
    firmness
        f: how many times mu is added to itself, at most, around ghosts that stand out; or 0.
    firm
        u: how many times brighter than what is around it a ghost is where half of that is.

    Raises
    ------
    InputError
        If crowding or firmness is below 0, another not above 0, or one not finite.
    """

    height: float = 1.6
    reach: float = 0.2
    crowding: float = 0.3
    crowd: float = 0.32
    contrast: float = 15.0
    dark: float = 0.017
    near: float = 0.2
    step: float = 0.2
    nearby: float = 0.7
    firmness: float = 10.0
    firm: float = 6.5

    def __post_init__(self) -> None:
        others = dict(vars(self))
        maybe = {name: others.pop(name) for name in ("crowding", "firmness")}
        require_not_negative("softening", **maybe)
        require_positive("softening", **others)


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
    white
        Luminance of that, cd/m².

    Attributes
    ----------
    settings, density, floor
        As given.
    dark
        d, 1 = projector white.
    soft, crowded, near
        G_s, G_w and G_e.
    """

    def __init__(
        self,
        settings: Softening,
        screen: NDArray[np.bool_],
        density: float,
        floor: float,
        white: float,
    ) -> None:
        self.settings, self.density, self.floor = settings, density, floor
        self.dark = settings.dark / white
        self.soft, self.crowded, self.near = (
            Averaging(screen, reach * density)
            for reach in (settings.reach, settings.crowd, settings.near)
        )

    def ghosts(self, left: Light, luminance: Planes, around: Planes) -> SoftGhosts:
        """The ghosts of one picture.

        Parameters
        ----------
        left
            What subtraction shows too much, at least 0, (view, row, col, primary).
        luminance
            Its luminance, (view, row, col).
        around
            L_w, (view, row, col).
        """
        return SoftGhosts(self, left, luminance, around)


@final
class SoftGhosts:
    """What is left of one picture's ghosts: parameters as of `Softener.ghosts`.

    Attributes
    ----------
    brightest
        g, (row, col): of either view.
    """

    def __init__(self, by: Softener, left: Light, luminance: Planes, around: Planes) -> None:
        self._by, self._left, self._luminance, self._around = by, left, luminance, around
        reach = by.settings.nearby * by.density
        self.brightest: Planes = brightest_nearby(luminance[..., None], reach)[..., 0]

    def rims(self) -> Light:
        """The rims to aim at, (view, row, col, primary)."""
        share = 1 / (1 + self._standing_out(self._around) / self._by.settings.contrast)
        rims = np.empty_like(self._left)
        for p in range(rims.shape[3]):
            self._draw(np.ascontiguousarray(self._left[..., p]), share, rims[..., p])
        return rims

    def stiffness(self) -> Light | None:
        """What damping is multiplied by, m, (1, row, col, 1); None for 1."""
        settings = self._by.settings
        if not settings.firmness:
            return None
        square = self._standing_out(self._around.min(axis=0)) ** 2
        stiffness = 1 + settings.firmness * square / (square + settings.firm**2)
        result: Light = stiffness[None, :, :, None].astype(self._left.dtype, copy=False)
        return result

    def factor(self, local: Planes) -> Planes:
        """How many times more errors count, (view, row, col), at least 1.

        Parameters
        ----------
        local
            L, of what subtraction shows.
        """
        floor, edges = self._by.floor, self._edges()
        factor = np.empty_like(local)

        def fill(view: int, rows: slice) -> None:
            part = local[view, rows]
            brighter = (part + floor) / (np.minimum(part, self.brightest[rows]) + floor)
            factor[view, rows] = brighter ** edges[view, rows]

        in_strips(fill, local.shape)
        return factor

    def _draw(self, left: Planes, share: Planes, rims: Planes) -> None:
        """Set the rims of one primary, of what is left of it."""
        by, settings = self._by, self._by.settings
        weighted_means = [(settings.height, by.soft(left))]
        if settings.crowding:
            weighted_means.append((-settings.crowding, by.crowded(left)))

        def draw(view: int, rows: slice) -> None:
            outside = -left[view, rows]
            for weight, mean in weighted_means:
                outside += weight * mean[view, rows]
            np.maximum(outside, 0, out=outside)
            np.multiply(outside, share[view, rows], out=rims[view, rows])

        in_strips(draw, left.shape)

    def _standing_out(self, around: Planes) -> Planes:
        """How much ghosts stand out, r."""
        ratio: Planes = self.brightest / (around + self._by.dark)
        return ratio

    def _edges(self) -> Planes:
        """How near an edge of a ghost is, n: 0..1."""
        by = self._by
        sigma = edge_sigma(by.density)
        steps = slope_magnitudes(self._luminance, sigma)
        steps *= sigma * np.sqrt(2 * np.pi)
        near = by.near(steps / (steps + by.settings.step * (self.brightest + by.floor)))
        near *= np.hypot(1, by.settings.near * by.density / sigma)
        return np.clip(near, 0, 1, out=near)
