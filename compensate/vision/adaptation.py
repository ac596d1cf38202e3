"""Local adaptation: the mean luminance of what the fovea sees around each pixel.

Ramasubramanian, M., Pattanaik, S. and Greenberg, D. (1999), "A perceptually based physical error
metric for realistic image synthesis", SIGGRAPH 99, 73-82, take the mean over one degree of visual
angle; the paper (section 5) follows them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compensate.fourier import Fourier, padded_size
from domesim.errors import InputError
from domesim.light.blocks import block_sums, enlarged
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips

Planes = NDArray[np.float32]

FOVEA = 1.0
"""Diameter of the disc, degrees (Ramasubramanian 1999)."""

ACROSS = 8
"""Samples across the disc, at least, where pixels are finer: the grid is reduced to fewer."""


@guarded
def adaptation_luminance(
    luminance: NDArray[np.floating[Any]],
    pixels_per_degree: float,
    screen: ArrayLike | None = None,
    *,
    diameter: float = FOVEA,
) -> Planes:
    """Averages luminance over a disc around each pixel, of the screen's pixels only.

    Where the disc is 16 pixels or more across, blocks of pixels are averaged first and the means
    interpolated after; at the rim of the screen this shifts by up to half a block what is counted.

    Parameters
    ----------
    luminance
        (view, row, col), cd/m²; off the screen it is not looked at.
    pixels_per_degree
        Resolution of the picture.
    screen
        (row, col), true where there is screen. Default: everywhere.
    diameter
        Diameter of the disc, degrees.

    Returns
    -------
    (view, row, col), cd/m², float32: at least 0, and 0 off the screen.

    Raises
    ------
    InputError
        If the shapes do not fit, a luminance on the screen is negative or not finite, or a size is
        not above 0.
    """
    planes = np.asarray(luminance)
    if planes.ndim != 3 or 0 in planes.shape:
        raise InputError(f"adaptation takes luminances (view, row, col), got {planes.shape}")
    for name, value in {"pixels per degree": pixels_per_degree, "diameter": diameter}.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"adaptation takes {name} above 0, got {value:g}")
    size = planes.shape[1:]
    inside = np.ones(size, bool) if screen is None else np.asarray(screen, bool)
    if inside.shape != size:
        raise InputError(f"adaptation takes a screen of {size} pixels, got {inside.shape}")
    lit = np.where(inside, planes, 0).astype(np.float32, copy=False)
    if not (lit.min() >= 0 and lit.max() < np.inf):
        raise InputError(
            "adaptation takes luminances of at least 0 cd/m², finite, "
            f"got {lit.min():g} to {lit.max():g}"
        )
    return _disc_means(lit, inside, diameter * pixels_per_degree)


def _disc_means(lit: Planes, inside: NDArray[np.bool_], across: float) -> Planes:
    """Sums of light and of screen over the disc (`across` pixels), divided: Knutsson's normalised
    convolution.
    """
    block = max(1, int(across / ACROSS))
    sums = block_sums(np.stack([*lit, inside.astype(np.float32)]), block)
    sums = _convolved(sums, across / block / 2)
    result = np.empty_like(lit)

    def divide(view: int, rows: slice) -> None:
        light, screen = (enlarged(sums[part], block, rows, lit.shape[2]) for part in (view, -1))
        on = inside[rows]
        # rounding in the transforms can leave black a little below 0
        mean = np.maximum(light, 0) / np.where(on, screen, 1)
        result[view, rows] = np.where(on, mean, 0)

    in_strips(divide, lit.shape)
    return result


def _convolved(planes: Planes, radius: float) -> Planes:
    """Planes summed over a disc with a one-pixel soft rim."""
    rows, cols = planes.shape[1:]
    reach = int(np.ceil(radius + 0.5))
    fourier = Fourier(padded_size(rows, reach), padded_size(cols, reach))
    near = np.arange(-reach, reach + 1)
    distance = np.hypot(near[:, None], near[None, :])
    disc = np.zeros((fourier.rows, fourier.cols), np.float32)
    disc[near[:, None], near[None, :]] = np.clip(radius + 0.5 - distance, 0, 1)
    wide = np.zeros((len(planes), fourier.rows, fourier.cols), np.float32)
    wide[:, :rows, :cols] = planes
    summed = fourier.inverse(fourier.forward(wide) * fourier.forward(disc[None]))
    return np.asarray(summed[:, :rows, :cols])
