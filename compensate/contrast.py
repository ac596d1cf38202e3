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
Of a pair, what is aimed at is not the master alone but its ghosts with soft edges (`softening`),
and the light stays near subtraction's (`leeway`). Errors may count less in the master's own
`Texture`; by default they don't. That this, and these numbers, do better than others is measured
by ``validate --only quality``; see ``validation/notes/0007``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.averaging import Averaging, Planes
from compensate.fourier import padded_size
from compensate.leeway import Leeway
from compensate.softening import Softener, Softening
from compensate.vision.castle import DETAIL, DKL_FROM_XYZ, MECHANISMS, Mechanism, castle
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import REGULARISATION, CsfWeighting, PerceptualWeighting, gains_of
from domesim.errors import InputError, require_not_negative, require_positive
from domesim.light import Light
from domesim.projector import Projector
from domesim.strips import in_strips
from domesim.viewing import Viewing

PAIR_GAIN, DOME_GAIN = 0.1, 0.05
"""Low-frequency gains of luminance."""

PAIR_CHROMA, DOME_CHROMA = 1.0, 2.0
"""How many times more than castleCSF has it chromatic errors count."""

PAIR_FLOOR, DOME_FLOOR = 0.1, 0.02
"""Luminances c, cd/m²."""

REACH = 0.08
"""Standard deviation of the Gaussian that L is averaged by, degrees."""

PAIR_DAMPING, DOME_DAMPING = 0.014, REGULARISATION
"""Least weights of changes: of a pair, so that veils end soon; of a dome, to keep what is not seen
from filling with noise."""

_K1, _K2 = 6 ** (-7 / 3), 6 ** (10 / 3)

Plane: TypeAlias = NDArray[np.floating[Any]]
"""(row, col)."""


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

    def factor(self, master: Planes, density: float) -> Planes:
        """1 / T of the master over the local luminance, at so many pixels per degree."""
        sigma = self.reach * density

        def of_view(master: Plane) -> Plane:
            mean = gaussian_filter(master, sigma, mode="nearest")
            square = gaussian_filter(master**2, sigma, mode="nearest")
            contrast = np.sqrt(np.maximum(square - mean**2, 0))
            return (1 + (_K1 * (_K2 * contrast) ** self.slope) ** 4) ** -0.25

        return np.stack([of_view(plane) for plane in master])


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
        c, cd/m². None: `PAIR_FLOOR` or `DOME_FLOOR`.
    damping
        How much a change from subtraction (from that of the aim) counts by itself, of any
        frequency, over an error at the peak: the regulariser's mu (of a pair's primaries, the
        mean; around ghosts that stand out it is multiplied, see `Softening.firmness`). None:
        `PAIR_DAMPING` or `DOME_DAMPING`.
    most
        In a dome, L counts up to this many times the adaptation luminance. Without a limit, errors
        in bright places cost next to nothing; and as every light pollutes the dark, the least cost
        would be to take the blue and the red out of whatever is bright.
    softening
        How soft the edges of a pair's ghosts are aimed at; None: the master is.
    texture
        How much less errors count in the master's own texture; None: no less.
    leeway
        Of a pair, how far the light may be from what subtraction projects; None: as far as the
        projector goes.
    padding
        As for `PerceptualWeighting`.

    Raises
    ------
    InputError
        If the reach is negative, the chroma, the floor, the damping or `most` not above 0, or one
        but `most` not finite.
    """

    low_frequency: LowFrequencyFloor | None = None
    chroma_low_frequency: LowFrequencyFloor = field(default_factory=lambda: LowFrequencyFloor(1.0))
    chroma: float | None = None
    reach: float = REACH
    floor: float | None = None
    damping: float | None = None
    most: float = 0.3
    softening: Softening | None = field(default_factory=Softening)
    texture: Texture | None = None
    leeway: Leeway | None = field(default_factory=Leeway)
    padding: int = 64

    def __post_init__(self) -> None:
        maybe = {name: getattr(self, name) for name in ("chroma", "floor", "damping")}
        given = {name: value for name, value in maybe.items() if value is not None}
        require_positive("local contrast", **given)
        require_not_negative("local contrast", reach=self.reach)
        if not self.most > 0:
            raise InputError(f"the most of local contrast must be above 0, got {self.most:g}")

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

    def regularisation(self, projector: Projector, views: int) -> float | list[float]:
        """Mu of the problem of `views` pictures; of a pair (primary,), so that grey stays grey.

        The least of sum mu_p d_p² for a change of luminance sum w_p d_p is grey if mu_p goes with
        the weight w_p of the primary; were they all alike, veils would be green.
        """
        if views == 1:
            return self.damping or DOME_DAMPING
        weights = projector.luminance_weights
        return list(map(float, (self.damping or PAIR_DAMPING) * weights * len(weights)))

    def contrast(
        self, viewing: Viewing, projector: Projector, screen: NDArray[np.bool_], views: int
    ) -> LocalContrast:
        """K of `views` pictures on a screen (row, col), of what is seen there."""
        dome = views == 1
        density = viewing.pixels_per_degree(*screen.shape)
        level = viewing.adaptation / projector.white
        floor = (self.floor or (DOME_FLOOR if dome else PAIR_FLOOR)) / projector.white
        softener = None
        if self.softening and not dome:
            softener = Softener(self.softening, screen, density, floor, projector.white)
        return LocalContrast(
            Averaging(screen, density * self.reach),
            projector.luminance_weights,
            level,
            floor,
            self.most * level if dome else np.inf,
            density,
            softener,
            self.texture,
        )


@final
@dataclass(frozen=True)
class Terms:
    """What a `Problem` takes of pictures; None as there.

    Parameters
    ----------
    contrast
        K, (view, row, col, 1); 1 off the screen.
    aim
        (view, row, col, primary): what is wanted, or more where ghosts are softened.
    stiffness
        m, (1, row, col, 1), what damping is multiplied by: above 1 around ghosts that stand out.
    """

    contrast: Light | None = None
    aim: Light | None = None
    stiffness: Light | None = None


@final
@dataclass(frozen=True)
class LocalContrast:
    """What is minimised of pictures on a screen: K = l / (L + c), the aim, and the damping's m.

    Parameters
    ----------
    averaging
        What L is averaged by.
    weights
        (primary,) of luminance.
    level, floor, most
        l, c and the limit to L, 1 = projector white.
    density
        Pixels per degree.
    softener
        Of a pair's ghosts; None: they stay as subtraction leaves them.
    texture
        That masks errors.
    """

    averaging: Averaging
    weights: NDArray[np.floating[Any]]
    level: float
    floor: float
    most: float
    density: float
    softener: Softener | None = None
    texture: Texture | None = None

    def __call__(self, seen: Light, desired: Light) -> Terms:
        """The terms of pictures.

        Parameters
        ----------
        seen, desired
            What the best subtraction shows, and what it should: (view, row, col, primary).
        """
        luminance = self._luminance(seen)
        local = np.minimum(np.maximum(self.averaging(luminance), 0), self.most)
        contrast = self.level / (local + self.floor)
        if self.texture:
            master = self._luminance(desired) / (local + self.floor)
            contrast *= self.texture.factor(master, self.density)
        if not self.softener:
            return Terms(self._on_screen(contrast, seen))
        around = np.maximum(self.averaging(self._luminance(desired)), 0)
        left = np.maximum(seen - desired, 0)
        ghosts = self.softener.ghosts(left, self._luminance(left), around)
        contrast *= ghosts.factor(local)
        aim = desired + ghosts.rims()
        return Terms(self._on_screen(contrast, seen), aim, ghosts.stiffness())

    def _on_screen(self, contrast: Planes, like: Light) -> Light:
        result: Light = np.where(self.averaging.screen, contrast, 1)[..., None]
        return result.astype(like.dtype, copy=False)

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
