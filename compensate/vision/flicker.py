"""How many visible steps an even light moves: flicker of a wide field without edges.

Kelly [1] let observers find the least flicker that is seen of an even field of 68° whose edge is
blurred. Its amplitude m is relative to the mean. He measured 1 / m at five levels of retinal
illuminance, 0.65 to 9300 trolands, from 1.6 to 19.8 Hz; the figures are those that [2] read off his
curves. What a dome reflects into its black is such a light.

A change from L to L' within tau counts as half a wave of 1 / (2 tau) Hz:

    steps = S(1 / (2 tau), trolands) |L' - L| / (L' + L)

One step is just seen. Slower changes than half a wave of 1.6 Hz (0.31 s) were not measured, and
count by what they change in 0.31 s. Below 0.65 trolands S falls with the root of light (de Vries
and Rose); above 9300 it stays. Trolands are L times the area of a pupil that is adapted to L,
4.9 - 3 tanh(0.4 log10 L) mm across (Moon and Spencer, in [3]).

[1] D. H. Kelly, "Visual responses to time-dependent stimuli. I. Amplitude sensitivity
measurements", J. Opt. Soc. Am. 51, 422 (1961). [2] Y. Cai et al., "elaTCSF: a temporal contrast
sensitivity function for flicker detection and modeling variable refresh rate flicker", SIGGRAPH
Asia 2024, flicker_detection_datasets.csv (MIT licence, copyright 2024 Graphics and Displays group,
University of Cambridge). [3] A. B. Watson, J. I. Yellott, "A unified formula for light-adapted
pupil size", J. Vision 12(10), 12 (2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.floating[Any]]

SOURCE = "Kelly 1961"
"""Whose step it is, for a report."""

_HERTZ = (1.6, 2.7, 4.0, 5.1, 6.8, 8.8, 10.7, 12.7, 16.2, 19.8)
_TROLANDS = (0.65, 7.1, 77.0, 850.0, 9300.0)
_SENSITIVITY = (
    (15.2, 17.3, 22.7, 22.2, 22.0, 16.5, 11.2, 7.1, 2.92, 1.24),
    (17.3, 19.8, 35.7, 40.0, 55.5, 50.5, 52.3, 41.1, 24.7, 14.9),
    (17.8, 17.9, 32.9, 45.3, 50.3, 72.5, 96.7, 101.5, 91.3, 78.8),
    (15.4, 18.4, 33.2, 54.1, 81.6, 114.5, 120.8, 132.2, 132.5, 119.3),
    (13.3, 19.3, 26.7, 33.8, 54.9, 81.3, 86.8, 104.0, 122.5, 114.0),
)
LONGEST = 1 / (2 * _HERTZ[0])
"""Seconds: within so long a change is looked for."""
_DARKEST = 1e-6  # cd/m²


def trolands(luminance: ArrayLike) -> Floats:
    """Returns the retinal illuminance of an eye adapted to luminances in cd/m², of any shape."""
    L = np.maximum(np.asarray(luminance, np.float64), _DARKEST)
    pupil = 4.9 - 3 * np.tanh(0.4 * np.log10(L))
    return np.asarray(L * np.pi * pupil**2 / 4)


def sensitivity(frequency: float, retinal: ArrayLike) -> Floats:
    """Computes 1 / m, m the least relative amplitude of flicker that is seen.

    Parameters
    ----------
    frequency
        Hz; held at 1.6 and 19.8.
    retinal
        Trolands, any shape.
    """
    logs = np.log10(_SENSITIVITY)
    at = [np.interp(np.log10(frequency), np.log10(_HERTZ), level) for level in logs]
    light = np.asarray(retinal, np.float64)
    held = 10 ** np.interp(np.log10(light), np.log10(_TROLANDS), at)
    return np.asarray(held * np.sqrt(np.minimum(light / _TROLANDS[0], 1)))


def steps(seconds: Sequence[float], luminance: Sequence[float]) -> list[float]:
    """Counts the visible steps that an even light has moved until each moment.

    Parameters
    ----------
    seconds
        Times of the moments, rising.
    luminance
        At each of them, cd/m².

    Returns
    -------
    steps
        The most that it has moved since any moment up to `LONGEST` before; 0 where there is none.
    """
    moved = []
    for last, (now, light) in enumerate(zip(seconds, luminance, strict=True)):
        most = 0.0
        for first in range(last - 1, -1, -1):
            apart, other = now - seconds[first], luminance[first]
            if apart > LONGEST * (1 + 1e-6):
                break
            if light != other:
                contrast = abs(light - other) / (light + other)
                seen = sensitivity(1 / (2 * apart), trolands((light + other) / 2))
                most = max(most, contrast * float(seen))
        moved.append(most)
    return moved
