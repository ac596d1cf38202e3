"""Veiling glare: light that lens and port glass scatter over the whole screen.

A surface that is nearly smooth scatters a share of light by the distance between the directions'
sines only, with the ABg model (R. N. Pfisterer, "Approximated Scatter Models for Stray Light
Analysis", Photon Engineering):

    BSDF = A / (B + |sin - sin_0|^g)

B^(1/g) is the sine of the shoulder within which it is flat, g the slope beyond. A follows from the
share s that is scattered at all: the integral of the BSDF over the unit disc of sines. On a flat
screen at the distance T of the throw, sines are places over T, as long as the field is narrow, and
what is seen is a convolution:

    psi(x) = (1 - s) x + K * x,    K = BSDF (area of a pixel) / T²

Direct light is D x = (1 - s) x. What is scattered beyond the screen is lost on its masking, so
that nothing gains light. Scattering twice is left out: it is s² of light.

K is smooth at the size of its shoulder. So light is gathered in cells of a quarter of that, but of
a pixel at least. The cells are convolved by Fourier transforms with zeros around, and the veil is
linear between them. What spreads light from cells to pixels also gathers it, so that A' = A. Near
its middle, K is integrated over cells, as its shoulder may be narrower than they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy
from numpy.polynomial import legendre
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Array, Light, kind, namespace
from domesim.light.strips import threads
from domesim.observation.base import AdjointObservation

Floats = NDArray[np.float64]

_FINE = 4.0  # cells to the narrowest shoulder
_NEAR = 8  # of a cell's longer side: so near the middle the kernel is integrated over each cell
_MOST = 0.5  # of light may be scattered: beyond, it is no veil


@final
@dataclass(frozen=True)
class Scatter:
    """What one surface, or several of a kind, scatter by the ABg model.

    Parameters
    ----------
    share
        s: share of light that is scattered, into the half space.
    slope
        g.
    shoulder
        Sine of the angle within which the BSDF is flat: B^(1/g).

    Raises
    ------
    InputError
        If a figure is impossible.
    """

    share: float
    slope: float
    shoulder: float

    def __post_init__(self) -> None:
        if not 0 <= self.share < _MOST:
            raise InputError(f"a scattered share lies in 0..{_MOST:g}, got {self.share:g}")
        if not (0.5 <= self.slope <= 4 and 1e-4 <= self.shoulder <= 1):
            raise InputError(
                f"scatter takes a slope in 0.5..4 and a shoulder in 1e-4..1, got {self.slope:g} "
                f"and {self.shoulder:g}"
            )

    def density(self, sine: Floats) -> Floats:
        """Share of light per unit of sines squared, at a distance of sines; any shape."""
        _, inside = self._discs
        return np.asarray(np.where(sine <= 1, self.share / inside[-1] * self._shape(sine), 0))

    def in_corners(self, down: Floats, across: Floats) -> Floats:
        """Share of light in rectangles whose corner is the middle.

        Parameters
        ----------
        down, across
            Their sides, in sines; they broadcast.
        """
        radii, inside = self._discs
        nodes, weights = legendre.leggauss(32)
        shares = np.zeros(np.broadcast_shapes(down.shape, across.shape))
        # Sectors, on either side of the diagonal
        for side, other in ((across, down), (down, across)):
            widest = np.arctan2(other, side)[..., None]
            edge = side[..., None] / np.cos(widest * (nodes + 1) / 2)
            shares += np.sum(weights * widest / 2 * np.interp(edge, radii, inside), axis=-1)
        return np.asarray(self.share / inside[-1] * shares / (2 * np.pi))

    @property
    def _discs(self) -> tuple[Floats, Floats]:
        """Radii in sines up to 1, and the integrals of the shape over their discs."""
        radii = np.concatenate([[0.0], np.geomspace(1e-3 * self.shoulder, 1, 4096)])
        rings = 2 * np.pi * radii * self._shape(radii)
        return radii, scipy.integrate.cumulative_trapezoid(rings, radii, initial=0)

    def _shape(self, sine: Floats) -> Floats:
        return np.asarray(1 / (self.shoulder**self.slope + sine**self.slope))


@final
class Glare(AdjointObservation):
    """psi(x) = (1 - s) x + K * x on a flat screen, the same in all views and primaries.

    Parameters
    ----------
    shape
        (view, row, col, primary) of the light.
    size
        (width, height) of the screen, m.
    throw
        Distance from the lens to the screen, m.
    scatters
        What scatters on the way: their shares add up.

    Raises
    ------
    InputError
        If all together scatter half of the light or more.
    """

    def __init__(
        self,
        shape: tuple[int, int, int, int],
        size: tuple[float, float],
        throw: float,
        scatters: Sequence[Scatter],
    ) -> None:
        self._shape = shape
        self.share = sum(scatter.share for scatter in scatters)
        if self.share >= _MOST:
            raise InputError(f"lens and port glass scatter {self.share:.0%} of light: no veil")
        cell = throw * min((each.shoulder for each in scatters), default=1.0) / _FINE
        pixels, sides = shape[1:3], (size[1], size[0])
        cells = [
            min(count, math.ceil(side / cell)) for count, side in zip(pixels, sides, strict=True)
        ]
        self._spread = [_linear(*each) for each in zip(pixels, cells, strict=True)]
        self._padded = [int(scipy.fft.next_fast_len(2 * count - 1)) for count in cells]
        steps = [side / count / throw for side, count in zip(sides, cells, strict=True)]
        kernel = sum(
            (_by_cells(each, steps, cells, self._padded) for each in scatters),
            np.zeros(self._padded),
        )
        # Pixels of a cell add up when they are gathered
        self._kernel = np.fft.rfft2(kernel * math.prod(cells) / math.prod(pixels)).real
        self._converted: dict[tuple[str, ...], tuple[Array, Array, Array]] = {}

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return self._shape

    def veil(self, light: Light) -> Light:
        """K * x: the scattered light on the screen, (view, row, col, primary)."""
        self._guarded(light, "veils")
        rows, cols, kernel = self._like(light)
        xp = namespace(light)
        planes = xp.permute_dims(light, (0, 3, 1, 2))
        coarse = xp.matmul(xp.matrix_transpose(rows), xp.matmul(planes, cols))
        size = coarse.shape[2:]
        if isinstance(light, np.ndarray):
            spectrum = scipy.fft.rfft2(coarse, self._padded, workers=threads())
            found = scipy.fft.irfft2(spectrum * kernel, self._padded, workers=threads())
        else:
            spectrum = xp.fft.rfftn(coarse, s=tuple(self._padded), axes=(-2, -1))
            found = xp.fft.irfftn(spectrum * kernel, s=tuple(self._padded), axes=(-2, -1))
        found = found[:, :, : size[0], : size[1]]
        fine = xp.matmul(xp.matmul(rows, found), xp.matrix_transpose(cols))
        return xp.permute_dims(fine, (0, 2, 3, 1))

    def _observe(self, light: Light) -> Light:
        return self._linear(light)

    def _linear(self, light: Light) -> Light:
        return self._direct(light) + self.veil(light)

    def _adjoint(self, light: Light) -> Light:
        return self._linear(light)

    def _direct(self, light: Light) -> Light:
        return (1 - self.share) * light

    def _direct_adjoint(self, light: Light) -> Light:
        return self._direct(light)

    def _like(self, light: Light) -> tuple[Array, Array, Array]:
        """What spreads rows and columns, and the kernel's spectrum, as arrays like `light`."""
        key = kind(light)
        if key not in self._converted:
            xp = namespace(light)
            rows, cols, kernel = (
                xp.asarray(array, dtype=light.dtype, device=light.device)
                for array in (*self._spread, self._kernel)
            )
            # Real spectra times complex ones: not all libraries mix them
            complex_ = xp.complex64 if light.dtype == xp.float32 else xp.complex128
            self._converted[key] = rows, cols, xp.astype(kernel, complex_)
        return self._converted[key]


def _by_cells(
    scatter: Scatter, steps: Sequence[float], cells: Sequence[int], padded: Sequence[int]
) -> Floats:
    """(row, col) share of light that goes from one cell to another, by how far it is off.

    Parameters
    ----------
    scatter
        What scatters.
    steps
        Height and width of a cell, in sines.
    cells, padded
        Rows and columns of cells, and of the result: distances below 0 are at its end.
    """
    down, across = (
        np.fft.fftfreq(wide, 1 / wide) * step for wide, step in zip(padded, steps, strict=True)
    )
    shares = scatter.density(np.hypot(down[:, None], across)) * math.prod(steps)
    reach = [math.ceil(_NEAR * max(steps) / step) for step in steps]
    near = [np.arange(min(each, count - 1) + 1) for each, count in zip(reach, cells, strict=True)]
    sides = [
        np.asarray((each + 0.5) * step, np.float64) for each, step in zip(near, steps, strict=True)
    ]
    exact = scatter.in_corners(sides[0][:, None], sides[1])
    for axis in range(2):
        exact = np.diff(exact, axis=axis, prepend=0)
    exact[0] *= 2  # the other half of the cells on the axes
    exact[:, 0] *= 2
    for rows, cols in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        shares[np.ix_(rows * near[0], cols * near[1])] = np.maximum(exact, 0)
    # Cells on the rim of the disc of sines count wholly or not at all
    return np.asarray(shares * min(1.0, scatter.share / max(shares.sum(), 1e-300)))


def _linear(pixels: int, cells: int) -> Floats:
    """(pixel, cell) weights that interpolate between the middles of cells, flat beyond the last.

    They are means over pixels, so that every cell gathers the same.
    """
    if cells == pixels:
        return np.eye(pixels)
    edges = np.arange(pixels + 1) / pixels * cells - 0.5
    at = np.clip(edges[:, None] - np.arange(-1, cells + 1), -1, 1)
    area = np.where(at < 0, (1 + at) ** 2, 2 - (1 - at) ** 2) / 2
    weights = np.diff(area, axis=0) * pixels / cells
    weights[:, 1] += weights[:, 0]
    weights[:, -2] += weights[:, -1]
    return np.asarray(weights[:, 1:-1])
