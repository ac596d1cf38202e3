"""Weighting local contrast: the same error matters more in the dark.

Weber's law: what the eye sees of a difference of light goes with the light around it. So a residual
is divided by the local luminance of what is seen *before* the contrast sensitivity, and not the
same everywhere by one adaptation luminance,

    lambda(r) = A_l T K r,     K = l / (L + c)

with l the adaptation luminance, L the luminance that the best subtraction shows, averaged over a
few minutes of arc, and c a luminance below which the eye loses contrast. Without c, black would
have to be exact. In a dome, L counts up to m l only (see `ContrastWeighting.most`).

T takes light to the three mechanisms of castleCSF (`compensate.vision.castle`), achromatic,
red-green and yellow-violet, each with its own sensitivity, in place of Daly's for all three; the
chromatic ones count somewhat more, so that a lifted black keeps the master's hue.

L is of what is *seen*, not of the master: where a ghost lies on black, it is the ghost's own light.
K may have factors: `Contours` of ghosts, where errors count more, and the master's `Texture`, where
they count less. By default it has none. That this, and these numbers, do better than others is
measured by ``validate --only quality``; see ``validation/notes/0007``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude

from compensate.fourier import Fourier, padded_size
from compensate.ghosts import BEST_FREQUENCY, FINEST_SIGMA
from compensate.leeway import Leeway
from compensate.vision.castle import DETAIL, DKL_FROM_XYZ, MECHANISMS, Mechanism, castle
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import CsfWeighting, PerceptualWeighting, gains_of
from domesim.errors import InputError, require_positive
from domesim.light import Light
from domesim.projector import Projector
from domesim.strips import in_strips
from domesim.viewing import Viewing

PAIR_GAIN, DOME_GAIN = 0.15, 0.05
"""Low-frequency gains of luminance."""

PAIR_CHROMA, DOME_CHROMA = 1.5, 2.0
"""How many times more than castleCSF has it chromatic errors count."""

_FAINT = 0.02  # contrast of a step that is about to be seen: chosen (validation/notes/0007)
_K1, _K2 = 6 ** (-7 / 3), 6 ** (10 / 3)
_TAILS = 4  # standard deviations at which a Gaussian is cut off, as SciPy does

Plane: TypeAlias = NDArray[np.floating[Any]]
"""(row, col)."""

Planes: TypeAlias = NDArray[np.floating[Any]]
"""(view, row, col)."""

Factor: TypeAlias = Callable[[Planes, Planes], Planes]
"""How much more an error counts, of the master and what subtraction leaves of pollution in it."""


@final
@dataclass(frozen=True)
class Contours:
    """Errors count more at the edges of ghosts that subtraction leaves.

    The paper's reason to compensate is that such edges hinder fusion; the eye's weights alone leave
    as much of them as of other errors. K is multiplied by 1 + strength e, with e -> 1 where an edge
    of contrast is within reach (half of it at `_FAINT`):

        q = a / (a + `_FAINT`),   a = sigma sqrt(2 pi) |grad G_sigma r|
        e = min(1, (1 + (w / sigma)²)^1/2 G_w q)

    where r is what subtraction leaves over the local luminance, a the height of a step in it, sigma
    as of the ghost edge energy (`compensate.ghosts`), and w the reach: a line keeps its height, and
    falls off smoothly, for a veil has the shape that K has.

    Parameters
    ----------
    strength
        How much more they count at most.
    reach
        w, degrees.

    Raises
    ------
    InputError
        If one is not above 0 or not finite.
    """

    strength: float = 1.0
    reach: float = 0.4

    def __post_init__(self) -> None:
        require_positive("contours", strength=self.strength, reach=self.reach)

    def at(self, density: float) -> Factor:
        """The factor at so many pixels per degree."""
        sigma = max(FINEST_SIGMA, density / (2 * np.pi * BEST_FREQUENCY))
        reach = self.reach * density
        height = np.hypot(1, reach / sigma)

        def of_view(left: Plane) -> Plane:
            steps = gaussian_gradient_magnitude(left, sigma, mode="nearest")
            steps *= sigma * np.sqrt(2 * np.pi)
            near: Plane = gaussian_filter(steps / (steps + _FAINT), reach, mode="nearest")
            near *= height
            return 1 + self.strength * np.minimum(near, 1, out=near)

        return lambda _, left: np.stack([of_view(plane) for plane in left])


@final
@dataclass(frozen=True)
class Texture:
    """Errors count less in the master's own texture, which masks them.

    Daly's threshold elevation (S. Daly, "The Visible Differences Predictor", in *Digital Images and
    Human Vision*, MIT Press 1993, pp. 179-206), of one band for all, at the eye's most sensitive:

        K / T,   T = (1 + (k_1 (k_2 m)^s)^b)^(1/b),   k_1 = 6^(-7/3), k_2 = 6^(10/3), b = 4

    m is the root-mean-square of the master over the local luminance, less its mean, within reach.

    Parameters
    ----------
    slope
        s: 0.7 of textures that the eye knows, 1 of noise.
    reach
        Standard deviation of the means, degrees.

    Raises
    ------
    InputError
        If one is not above 0 or not finite.
    """

    slope: float = 0.7
    reach: float = 0.25

    def __post_init__(self) -> None:
        require_positive("texture", slope=self.slope, reach=self.reach)

    def at(self, density: float) -> Factor:
        """The factor at so many pixels per degree."""
        sigma = self.reach * density

        def of_view(master: Plane) -> Plane:
            mean = gaussian_filter(master, sigma, mode="nearest")
            square = gaussian_filter(master**2, sigma, mode="nearest")
            contrast = np.sqrt(np.maximum(square - mean**2, 0))
            return (1 + (_K1 * (_K2 * contrast) ** self.slope) ** 4) ** -0.25

        return lambda master, _: np.stack([of_view(plane) for plane in master])


@final
@dataclass(frozen=True)
class ContrastWeighting:
    """The settings of the weighting of local contrast.

    What a pair and what a dome gets by default differs: a ghost lies beside what is dark, a dome's
    pollution lies over all of it, and takes its hue away.

    Parameters
    ----------
    low_frequency
        The low-frequency policy of the achromatic mechanism. None: a floor of `PAIR_GAIN` or
        `DOME_GAIN`.
    chroma_low_frequency
        That of the chromatic ones.
    chroma
        How many times more than castleCSF has it chromatic errors count. None: `PAIR_CHROMA` or
        `DOME_CHROMA`.
    reach
        Standard deviation of the Gaussian that L is averaged by, degrees.
    floor
        c, cd/m².
    most
        In a dome, L counts up to this many times the adaptation luminance. Without a limit, errors
        in bright places cost next to nothing; and as every light pollutes the dark, the least cost
        would be to take the blue and the red out of whatever is bright.
    contours
        How much more errors count at the edges of what subtraction leaves; None: no more.
    texture
        How much less they count in the master's own texture; None: no less.
    leeway
        Of a pair, how far the light may be from what subtraction projects; None: as far as the
        projector goes.
    padding
        As for `PerceptualWeighting`.

    Raises
    ------
    InputError
        If the reach is negative, the chroma, the floor or `most` not above 0, or one is not finite.
    """

    low_frequency: LowFrequencyFloor | None = None
    chroma_low_frequency: LowFrequencyFloor = field(default_factory=lambda: LowFrequencyFloor(1.0))
    chroma: float | None = None
    reach: float = 0.08
    floor: float = 0.1
    most: float = 0.3
    contours: Contours | None = None
    texture: Texture | None = None
    leeway: Leeway | None = field(default_factory=Leeway)
    padding: int = 64

    def __post_init__(self) -> None:
        if self.chroma is not None and not 0 < self.chroma < np.inf:
            raise InputError(f"contrast's chroma must be above 0, got {self.chroma:g}")
        if not 0 <= self.reach < np.inf:
            raise InputError(f"contrast reach must be at least 0 degrees, got {self.reach:g}")
        if not 0 < self.floor < np.inf:
            raise InputError(f"contrast floor must be above 0 cd/m², got {self.floor:g}")
        if not self.most > 0:
            raise InputError(f"contrast's most must be above 0, got {self.most:g}")

    def of(
        self, viewing: Viewing, projector: Projector, support: NDArray[np.bool_], views: int
    ) -> CsfWeighting:
        """A_l T for `views` pictures with that `support` (row, col) seen that way.

        Scaled so that the brightest primary's weight at the peaks is 1. One view is a dome's.
        """
        dome = views == 1
        low_frequency = self.low_frequency or LowFrequencyFloor(DOME_GAIN if dome else PAIR_GAIN)
        chroma = self.chroma or (DOME_CHROMA if dome else PAIR_CHROMA)
        rows, cols = support.shape
        padded = (padded_size(rows, self.padding), padded_size(cols, self.padding))
        gains: list[NDArray[np.floating[Any]]] = []
        peaks: list[float] = []
        for mechanism in MECHANISMS:
            policy = self.chroma_low_frequency if gains else low_frequency
            sensitivity = partial(_at_any_orientation, mechanism, viewing.adaptation)
            omega, peak = gains_of(sensitivity, viewing, (rows, cols), padded, policy)
            gains.append(omega)
            peaks.append(peak)
        opponent = DKL_FROM_XYZ @ projector.to_xyz
        # Contrast is relative to the achromatic mechanism's response to white, and then to the
        # threshold at each mechanism's peak
        counting = np.array(peaks) * (1, chroma, chroma)
        opponent = counting[:, None] * opponent / opponent[0].sum()
        brightest = float(np.sqrt(np.sum(opponent**2, axis=0).max()))
        opponent /= brightest
        return CsfWeighting(np.stack(gains), opponent, support, padded, brightest, views)

    def contrast(
        self, viewing: Viewing, projector: Projector, screen: NDArray[np.bool_], views: int
    ) -> LocalContrast:
        """K of `views` pictures on a screen (row, col), of what is seen there."""
        density = viewing.pixels_per_degree(*screen.shape)
        factors = [each.at(density) for each in (self.contours, self.texture) if each]
        level = viewing.adaptation / projector.white
        most = self.most * level if views == 1 else np.inf
        floor = self.floor / projector.white
        blur = Averaging(screen, self.reach * density)
        weights = projector.luminance_weights
        return LocalContrast(blur, weights, level, floor, most, factors)


@final
class Averaging:
    """Gaussian means over the pixels of a screen, by FFT.

    Parameters
    ----------
    screen
        (row, col) bool.
    reach
        Standard deviation, pixels.
    """

    def __init__(self, screen: NDArray[np.bool_], reach: float) -> None:
        self.screen = screen
        radius = int(_TAILS * reach + 0.5)
        rows, cols = (padded_size(side, radius) for side in screen.shape)
        self._fourier = Fourier(rows, cols)
        # Of the sampled Gaussian: the other's transform, cut off at Nyquist's frequency, rings
        steps = np.arange(1, radius + 1)
        weights = np.exp(-0.5 * (steps / max(reach, 1e-9)) ** 2)
        along, across = (
            (1 + 2 * np.cos(2 * np.pi * frequency[..., None] * steps) @ weights)
            / (1 + 2 * weights.sum())
            for frequency in self._fourier.frequencies(1.0)
        )
        self._blur = along.astype(np.float32), across.astype(np.float32)
        self._around = np.float32(1)
        self._around = np.maximum(self(screen[None].astype(np.float32))[0], 1e-3)

    def __call__(self, planes: Planes) -> Planes:
        """(view, row, col) means; what is off the screen does not count."""
        rows, cols = self.screen.shape
        padded = np.zeros((len(planes), self._fourier.rows, self._fourier.cols), planes.dtype)
        np.multiply(planes, self.screen, out=padded[:, :rows, :cols])
        spectrum = self._fourier.forward(padded)
        for factor in self._blur:
            spectrum *= factor
        averaged: Planes = self._fourier.inverse(spectrum)[:, :rows, :cols]
        averaged /= self._around
        return averaged


@final
@dataclass(frozen=True)
class LocalContrast:
    """K = l / (L + c) of the pictures on a screen, and factors; call it with what is seen.

    Parameters
    ----------
    averaging
        What L is averaged by.
    weights
        (primary,) of luminance.
    level, floor, most
        l, c and the limit to L, 1 = projector white.
    factors
        Of the master and what is seen too much, (view, row, col) luminance over L + c.
    """

    averaging: Averaging
    weights: NDArray[np.floating[Any]]
    level: float
    floor: float
    most: float
    factors: Sequence[Factor] = ()

    def __call__(self, seen: Light, desired: Light) -> Light:
        """K, (view, row, col, 1) like `seen` (view, row, col, primary); 1 off the screen.

        Parameters
        ----------
        seen, desired
            What the best subtraction shows, and what it should.
        """
        luminance = self._luminance(seen)
        local = np.maximum(self.averaging(luminance), 0)
        below = np.minimum(local, self.most) + self.floor
        contrast = self.level / below
        if self.factors:
            master = self._luminance(desired)
            left = (luminance - master) / below
            master /= below
            for factor in self.factors:
                contrast *= factor(master, left)
        result: Light = np.where(self.averaging.screen, contrast, 1)[..., None]
        return result.astype(seen.dtype, copy=False)

    def _luminance(self, light: Light) -> Planes:
        planes = np.empty(light.shape[:3], light.dtype)
        weights = self.weights.astype(light.dtype)

        def fill(view: int, rows: slice) -> None:
            planes[view, rows] = np.maximum(light[view, rows] @ weights, 0)

        in_strips(fill, light.shape)
        return planes


def _at_any_orientation(
    mechanism: Mechanism, adaptation: float, frequency: Any, _: Any
) -> NDArray[np.floating[Any]]:
    return castle(frequency, adaptation, mechanism, area=DETAIL)


Eye: TypeAlias = PerceptualWeighting | ContrastWeighting
"""Settings of a vision model: the paper's, or that of local contrast."""
