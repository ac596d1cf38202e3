"""Graph-based visual saliency (GBVS): where a viewer looks first.

A picture is split into feature maps on a coarse grid. On each map M a walker moves between all
places, the likelier the more the places differ and the closer they are. The walker's equilibrium is
large where the map differs from its surroundings. It is the *activation* A:

    w_ij = |M_i - M_j| K_ij,    K_ij = exp(-d_ij² / 2 sigma²),    A_i ∝ sum_j w_ij

The equilibrium has this closed form. A walk that leaves i for j with probability
P_ij = w_ij / sum_k w_ik keeps every A that balances each pair of places, that is, for which
A_i P_ij is symmetric; A_i = sum_k w_ik gives A_i P_ij = w_ij. The form also holds where a power
iteration never settles: on a map of two values the walk alternates for ever. The sum of A^1.5 over
all maps is the saliency.

Harel, J., Koch, C., Perona, P. (2007), "Graph-based visual saliency", NIPS 19, 545-552. What the
paper leaves open, and all constants, are those of the authors' MATLAB program by default (gbvs.m,
makeGBVSParams.m, initGBVS.m, rgb2dkl.m), as stored in github.com/sergeyk/vislab:

- The dissimilarity is |M_i - M_j|. The paper's |log(M_i / M_j)| has no meaning for opponent
  colours, which have a sign, and none at 0.
- A^1.5 stands for the paper's concentration (a second walk, drawn to places of large A), which the
  program keeps as "no longer recommended".
- Intensity is the largest of the three code values, and orientation is sought in it. Here light, in
  shares of its peak, is encoded as sRGB for both. The opponent colours are of light: the program
  decodes its code values by the curve of a monitor first.
- The borders of orientation maps and of the sum are faded out.

What differs from the program:

- The opponent colours are `castle`'s for BT.709 primaries, where it has those of one monitor.
- Scales are tied to the grid and not to the pixels, so that a picture's saliency hardly depends on
  its resolution. Only orientation is sought in each; colour and intensity, averaged onto the grid,
  are (nearly) the same in all, and counted as often.
- A map without differences prefers no place, and is left out. The picture's border is mirrored,
  where the program repeats its last row.

On six pictures that nothing was chosen on, the maps correlate with the program's by 0.971 to 0.991
(validation/notes/0013).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compensate.fourier import Fourier, padded_size
from compensate.vision.castle import DKL_FROM_XYZ
from domesim.errors import InputError
from domesim.light.blocks import light_means
from domesim.light.guarded import guarded
from domesim.light.transfer import SRGB

Floats = NDArray[np.floating[Any]]

GRID = 32
"""Longest side of the grid, places (salmapmaxsize)."""

SCALES = (4, 2, 1)
"""Sides of the pictures in which orientation is sought, in grids."""

FINEST = 4 * SCALES[0] * GRID
"""Pixels along a picture's longest side, at least, in which features are sought: blocks of finer
ones are averaged first."""

ACTIVATION_SPREAD = 0.15
"""sigma of the activation, of the grid's mean side (sigma_frac_act)."""

SHARPENING = 1.5
"""Power of an activation (graphsalapply.m, algtype 4)."""

ORIENTATION_FADE, FADE = 13, 4
"""Width of the faded border in pixels of an orientation map and in places of the sum."""

FINAL_BLUR = 0.02
"""sigma of the last blur, of the grid's longest side (blurfrac)."""

GABOR_ANGLES = (0, 45, 90, 135)
"""Angles of the Gabor filters, degrees (gaborangles)."""

GABOR_SIGMA, GABOR_ELONGATION, GABOR_PERIOD = 2.0, 2.0, np.pi
"""Gabor filters: width in pixels, length over width, and period in pixels (initGBVS.m)."""

XYZ_FROM_RGB: Floats = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""BT.709 primaries (IEC 61966-2-1)."""

NOISE = 1e-6
"""Differences below this share of the peak are rounding, not features."""


@guarded
def gbvs(image: ArrayLike) -> Floats:
    """Computes the saliency of every pixel: 0 at the least salient, 1 at the most.

    A picture without features (one colour, black, a single pixel) prefers no place: 1 everywhere,
    so that a mask made of it hides nothing.

    Parameters
    ----------
    image
        (row, col, rgb), linear light in any unit; only ratios count.

    Returns
    -------
    Floats
        (row, col), 0..1.

    Raises
    ------
    InputError
        If the image is not (row, col, 3) or empty, or a value is negative or not finite.
    """
    light = np.asarray(image)
    if light.ndim != 3 or light.shape[-1] != 3 or not light.size:
        raise InputError(f"saliency takes an image (row, col, rgb), got {light.shape}")
    if not np.isfinite(light).all():
        raise InputError("saliency takes finite light, got NaN or infinity")
    if light.min() < 0:
        raise InputError(f"saliency takes light of at least 0, got {light.min():g}")
    rows, cols = light.shape[:2]
    light = light_means(light[None], max(1, max(rows, cols) // FINEST))[0]
    grid = _shape((rows, cols), GRID)
    near = _kernel(grid, ACTIVATION_SPREAD)
    total = np.zeros(grid[0] * grid[1])
    for feature, weight in _features(light, grid):
        if np.ptp(feature) > NOISE:
            total += weight * _activation(feature.ravel(), near) ** SHARPENING
    blurred = _blur(_faded(total.reshape(grid), FADE), FINAL_BLUR * max(grid))
    saliency = _interpolation(rows, grid[0]) @ blurred @ _interpolation(cols, grid[1]).T
    low, high = saliency.min(), saliency.max()
    if high - low <= NOISE * high:
        return np.ones((rows, cols))
    return np.asarray((saliency - low) / (high - low))


def _activation(feature: Floats, kernel: Floats) -> Floats:
    """Equilibrium, sum 1, of the walk between places that differ; `feature` is not constant."""
    degree = (np.abs(feature[:, np.newaxis] - feature) * kernel).sum(axis=1)
    return np.asarray(degree / degree.sum())


def _kernel(grid: tuple[int, int], spread: float) -> Floats:
    """K between all places of the grid, sigma = spread x the mean side (graphsalapply.m)."""
    row, col = (axis.ravel() for axis in np.indices(grid))
    d2 = (row[:, np.newaxis] - row) ** 2 + (col[:, np.newaxis] - col) ** 2
    sigma = spread * (grid[0] + grid[1]) / 2
    return np.asarray(np.exp(-d2 / (2 * sigma**2)))


def _features(light: NDArray[Any], grid: tuple[int, int]) -> list[tuple[Floats, float]]:
    """Feature maps on the grid, from linear light, each with its weight.

    Three opponent colours, intensity, four orientations in three scales: the code's channels "DIO".
    """
    shape = light.shape[0], light.shape[1]
    peak = _average(light, _shape(shape, SCALES[0] * GRID)).max()
    if peak == 0:
        return []
    opponent = _average(light / peak, grid) @ (DKL_FROM_XYZ @ XYZ_FROM_RGB).T
    intensities = [SRGB().encode(light / peak).max(axis=-1)]  # finer peaks exceed 1
    for scale in SCALES:
        intensities.append(_average(intensities[-1], _shape(shape, scale * GRID)))
    same = float(len(SCALES))
    maps: list[tuple[Floats, float]] = [(opponent[..., k], same) for k in range(3)]
    maps.append((_average(intensities[-1], grid), same))
    for intensity in intensities[1:]:
        energies = _energies(intensity)
        maps += [(_average(_faded(each, ORIENTATION_FADE), grid), 1.0) for each in energies]
    return maps


def _energies(intensity: Floats) -> Floats:
    """|even| + |odd| response to waves along each of `GABOR_ANGLES` (O_orientation.m)."""
    reach = int(np.ceil(GABOR_SIGMA * GABOR_ELONGATION * np.sqrt(10)))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    theta = np.radians(GABOR_ANGLES)[:, None, None]
    across, along = y * np.cos(theta) - x * np.sin(theta), y * np.sin(theta) + x * np.cos(theta)
    window = np.exp(-((across**2) + (along / GABOR_ELONGATION) ** 2) / (2 * GABOR_SIGMA**2))
    wave = 2 * np.pi / GABOR_PERIOD * across
    gabors = window * np.stack([np.cos(wave), np.sin(wave)])
    gabors -= gabors.mean(axis=(-2, -1), keepdims=True)
    gabors /= np.linalg.norm(gabors, axis=(-2, -1), keepdims=True)

    rows, cols = intensity.shape
    fourier = Fourier(padded_size(rows, 2 * reach), padded_size(cols, 2 * reach))
    planes = np.zeros((1 + 2 * len(GABOR_ANGLES), fourier.rows, fourier.cols))
    planes[0, : rows + 2 * reach, : cols + 2 * reach] = np.pad(intensity, reach, mode="symmetric")
    planes[1:, : 2 * reach + 1, : 2 * reach + 1] = gabors.reshape(-1, *y.shape)
    picture, *waves = fourier.forward(planes)
    responses = fourier.inverse(picture * np.stack(waves))[:, 2 * reach :, 2 * reach :]
    responses = np.abs(responses[:, :rows, :cols]).reshape(2, -1, rows, cols)
    return np.asarray(responses.sum(axis=0))


def _faded(plane: Floats, border: int) -> Floats:
    """`plane` times a ramp from 1 / (border + 1) at its edges to 1 (attenuateBordersGBVS.m)."""
    for axis, side in enumerate(plane.shape):
        place = np.arange(side)
        ramp = (np.minimum(place, side - 1 - place) + 1) / (min(border, side // 2) + 1)
        plane = plane * np.expand_dims(np.minimum(ramp, 1), 1 - axis)
    return plane


def _blur(grid: Floats, sigma: float) -> Floats:
    """Gaussian blur whose weights sum to 1 at every place, also at the border."""
    for axis in (0, 1):
        place = np.arange(grid.shape[axis])
        weight = np.exp(-((place[:, np.newaxis] - place) ** 2) / (2 * sigma**2))
        grid = np.moveaxis(
            np.tensordot(weight / weight.sum(axis=1, keepdims=True), grid, (1, axis)), 0, axis
        )
    return grid


def _shape(shape: tuple[int, int], longest: int) -> tuple[int, int]:
    """`shape` scaled so that its longest side is `longest`; never enlarged, never empty."""
    factor = min(1.0, longest / max(shape))
    rows, cols = (max(1, round(side * factor)) for side in shape)
    return rows, cols


def _average(picture: NDArray[Any], shape: tuple[int, int]) -> Floats:
    """Means over the areas of a coarser grid."""
    rows, cols = picture.shape[:2]
    tall = np.tensordot(_areas(shape[0], rows), picture, (1, 0))
    return np.asarray(np.moveaxis(np.tensordot(_areas(shape[1], cols), tall, (1, 1)), 0, 1))


def _areas(coarse: int, fine: int) -> Floats:
    """Share of every fine cell in the mean over a coarse one, (coarse, fine)."""
    edges = np.linspace(0, fine, coarse + 1)
    cell = np.arange(fine)
    overlap = [np.minimum(b, cell + 1) - np.maximum(a, cell) for a, b in pairwise(edges)]
    return np.asarray(np.maximum(overlap, 0) * (coarse / fine))


def _interpolation(fine: int, coarse: int) -> Floats:
    """Linear interpolation between the centres of coarse cells, level outside them."""
    centre = (np.arange(fine) + 0.5) * coarse / fine - 0.5
    hat = 1 - np.abs(np.clip(centre, 0, coarse - 1)[:, np.newaxis] - np.arange(coarse))
    return np.asarray(np.maximum(hat, 0))
