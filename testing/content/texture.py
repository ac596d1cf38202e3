"""Noise, stars, text and outlines that do not depend on the size of a picture.

Noise is a periodic tile that is made once and looked up at any coordinates. Stars, text and
outlines have their places and sizes in shares of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, map_coordinates

Floats: TypeAlias = NDArray[Any]
"""float32 or float64; what is a share may be bool, too."""

Colour: TypeAlias = tuple[float, float, float]
Points: TypeAlias = Sequence[tuple[float, float]]

TWICE = 2
"""Samples a pixel and axis, which are averaged."""

_TILE = 512  # lattice points a side


def noise(seed: int, x: ArrayLike, y: ArrayLike, slope: float = 1.6) -> Floats:
    """Values of fractal noise, with mean 0 and standard deviation 1.

    Parameters
    ----------
    seed
        Picks the tile.
    x, y
        Coordinates; the noise repeats after 1. The largest octave has a period of 1, too.
    slope
        Fall of the amplitude with the frequency. 1 is rough, 2 is cloudy, 3 has hardly any detail.
    """
    x, y = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    at = np.stack([y, x]) * np.float32(_TILE)
    return map_coordinates(_tile(seed, slope), at, order=1, mode="grid-wrap", output=np.float32)


def ridges(seed: int, x: ArrayLike, y: ArrayLike, slope: float = 1.6, width: float = 0.3) -> Floats:
    """Thin bright lines, 0..1, where noise crosses 0."""
    return np.exp(-np.abs(noise(seed, x, y, slope)) / np.float32(width))


def smoothstep(low: ArrayLike, high: ArrayLike, x: ArrayLike) -> Floats:
    """A smooth rise from 0 at `low` to 1 at `high`; falls if `high` is less."""
    t = np.clip((np.asarray(x) - low) / (np.asarray(high) - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)


def tinted(grey: Floats, colour: ArrayLike) -> Floats:
    """Grey as light of a colour, which may differ from place to place."""
    return np.asarray(grey[..., None] * np.asarray(colour, np.float32), np.float32)


def mixed(below: Floats, above: ArrayLike, share: Floats) -> Floats:
    """`above` over `below`, as opaque as `share` says."""
    return np.asarray(below + (above - below) * share[..., None], np.float32)


def star_colours(kelvin: Floats) -> Floats:
    """Colours of black bodies with their largest primary at 1 (Planck at three wavelengths)."""
    metres = np.array([600e-9, 540e-9, 450e-9])
    bodies = 1 / np.expm1(0.014388 / (metres * kelvin[:, None])) / metres**5
    bodies *= np.expm1(0.014388 / (metres * 6500.0)) * metres**5  # 6500 K is white
    return np.asarray(bodies / bodies.max(axis=1, keepdims=True), np.float32)


def stars(shape: tuple[int, int], places: Floats, light: Floats, spread: float) -> Floats:
    """Light of blurred points.

    Parameters
    ----------
    shape
        Rows and columns of samples.
    places
        (star, 2): x and y in widths of the picture.
    light
        (star, primary): light in the middle of a star; may be more than 1.
    spread
        Standard deviation of the blur in widths.
    """
    rows, cols = shape
    sigma = spread * cols
    total = 2 * np.pi * sigma**2 * light
    x, y = (places * cols - 0.5).T
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    result = np.zeros((rows * cols, light.shape[1]), np.float32)
    for right in (0, 1):
        for down in (0, 1):
            col, row = left + right, top + down
            part = np.abs(1 - right - (x - left)) * np.abs(1 - down - (y - top))
            here = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
            np.add.at(result, (row * cols + col)[here], (part[:, None] * total)[here])
    return np.asarray(
        gaussian_filter(result.reshape(rows, cols, -1), (sigma, sigma, 0)), np.float32
    )


def magnitudes(random: np.random.Generator, count: int, faintest: float = 0.004) -> Floats:
    """Peaks of stars: 10^0.5 times as many for each magnitude, which is 2.5 times fainter."""
    return np.asarray(faintest * random.uniform(0, 1, count) ** (-1 / 1.25), np.float32)


def text_tile(lines: Sequence[tuple[str, float, float, float]], rows: int, cols: int) -> Floats:
    """Coverage of text, 0..1.

    Parameters
    ----------
    lines
        Text, its height, and the (x, y) of its middle; in widths of the tile.
    rows, cols
        Size of the tile.
    """
    fine = -(-1024 // cols)  # small letters are drawn large, as hinting would change them
    image = Image.new("L", (cols * fine, rows * fine))
    draw = ImageDraw.Draw(image)
    for words, height, x, y in lines:
        font = ImageFont.load_default(height * cols * fine)
        draw.text((x * cols * fine, y * cols * fine), words, 255, font, anchor="mm")
    cells = np.asarray(image, np.float32).reshape(rows, fine, cols, fine)
    return np.asarray(cells.mean(axis=(1, 3)) / 255, np.float32)


def shape_tile(outlines: Sequence[Points], rows: int, cols: int, smooth: bool = True) -> Floats:
    """Coverage of closed outlines, 0 or 1, through points in widths of the tile."""
    image = Image.new("L", (cols, rows))
    draw = ImageDraw.Draw(image)
    for outline in outlines:
        corners = closed(outline) if smooth else np.array(outline)
        draw.polygon([(float(x), float(y)) for x, y in corners * cols], fill=255)
    return np.asarray(image, np.float32) / 255


def closed(points: Points) -> Floats:
    """A smooth closed curve through points, as 200 points."""
    corners = np.array([*points, points[0]])
    along = np.r_[0, np.cumsum(np.sqrt(np.linalg.norm(np.diff(corners, axis=0), axis=1)))]
    spline = CubicSpline(along, corners, bc_type="periodic")
    return np.asarray(spline(np.linspace(0, along[-1], 200)), np.float64)


def looked_up(tile: Floats, x: ArrayLike, y: ArrayLike) -> Floats:
    """A tile at (x, y) in its widths; 0 outside."""
    x, y = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    at = np.stack([y, x]) * np.float32(tile.shape[1]) - np.float32(0.5)
    return map_coordinates(tile, at, order=1, cval=0.0, output=np.float32)


@lru_cache(maxsize=32)
def _tile(seed: int, slope: float) -> Floats:
    """A periodic tile of noise: white noise, shaped so that its amplitude falls as 1/f^slope."""
    white = np.random.default_rng(seed).standard_normal((_TILE, _TILE))
    down, right = np.fft.fftfreq(_TILE, 1 / _TILE), np.fft.rfftfreq(_TILE, 1 / _TILE)
    frequency = np.hypot(down[:, None], right)
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(np.fft.rfft2(white) / frequency**slope, s=white.shape)
    return np.asarray(tile / tile.std(), np.float32)
