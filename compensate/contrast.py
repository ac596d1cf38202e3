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
That this, and these numbers, do better than others is measured by ``validate --only quality``; see
``validation/notes/0007``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.fourier import padded_size
from compensate.vision.castle import DETAIL, DKL_FROM_XYZ, MECHANISMS, Mechanism, castle
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import CsfWeighting, PerceptualWeighting, gains_of
from domesim.errors import InputError
from domesim.light import Light
from domesim.projector import Projector
from domesim.viewing import Viewing

PAIR_GAIN, DOME_GAIN = 0.15, 0.05
"""Low-frequency gains of luminance."""

PAIR_CHROMA, DOME_CHROMA = 1.5, 2.0
"""How many times more than castleCSF has it chromatic errors count."""


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
        self,
        seen: Light,
        viewing: Viewing,
        projector: Projector,
        screen: NDArray[np.bool_],
    ) -> NDArray[np.floating[Any]]:
        """K, (view, row, col, 1) like `seen` (view, row, col, primary); 1 off the screen."""
        density = viewing.pixels_per_degree(*screen.shape)
        weights = projector.luminance_weights.astype(seen.dtype)
        level = viewing.adaptation / projector.white
        on = screen.astype(seen.dtype)
        around = np.maximum(gaussian_filter(on, self.reach * density, mode="constant"), 1e-3)
        result = np.ones((*seen.shape[:3], 1), seen.dtype)
        for view, light in enumerate(seen):
            luminance = np.maximum(light @ weights, 0) * on
            local = gaussian_filter(luminance, self.reach * density, mode="constant") / around
            if len(seen) == 1:
                local = np.minimum(local, self.most * level)
            result[view, screen, 0] = level / (local[screen] + self.floor / projector.white)
        return result


def _at_any_orientation(
    mechanism: Mechanism, adaptation: float, frequency: Any, _: Any
) -> NDArray[np.floating[Any]]:
    return castle(frequency, adaptation, mechanism, area=DETAIL)


Eye: TypeAlias = PerceptualWeighting | ContrastWeighting
"""Settings of a vision model: the paper's, or that of local contrast."""
