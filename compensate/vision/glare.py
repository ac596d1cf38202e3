"""Stray light of the eye: what its own optics add to a dark place beside a bright one.

A small source that gives an illuminance E at the eye adds a veil to all that lies an angle theta
away from it (degrees, 0.1 to 100), as if that were brighter by

    L/E = 10/theta³ + (5/theta² + 0.1 p/theta) (1 + (age/62.5)⁴) + 0.0025 p        cd/m² per lx

p is the pigmentation of the iris: 0 very dark, 0.5 brown, 1 green, 1.2 light blue. This is the *CIE
General Disability Glare* equation of CIE 146:2002, "CIE equations for disability glare" (summed up
in J. J. Vos, "On the cause of disability glare and its dependence on glare angle, age and ocular
pigmentation", Clinical and Experimental Optometry 86(6), 2003, 363-370). The report is sold, not
public; the coefficients are those of three public transcriptions (HDR-VDP's authors' ``hdrvdp``
code among them), which agree. A test compares it with the whole point spread of CIE 135/1 (Vos and
van den Berg 1999), whose constants are those of ``hdrvdp_otf_cie99.m``. From 1 to 30 degrees the
CIE also has the older *age-adjusted Stiles-Holladay* equation, 10 (1 + (age/70)⁴)/theta². Both
agree within a factor of two: they are means of people who differ as much.

Light is only moved. What is seen of a picture is

    y = (1 - s) x + sum over the pixels beyond half a degree of (L/E) x (solid angle of the pixel)

and s is the integral of L/E over all of the half space beyond half a degree, so that a plain field
that fills it stays as it is: thresholds and contrast sensitivity are measured on plain fields.
Nearer light is left to them, because the eye's blur is a part of contrast sensitivity.

The picture is taken as a plane of equal pixels per degree, so that a transform does the sum. A
pixel at an angle theta from the gaze has the solid angle that it has in an equidistant picture
around the gaze, sin(theta)/theta of what it has in the middle. For a flat screen that is small this
is exact. A domemaster is equidistant around its own middle only, and stretched by 1.57 at the rim
of a hemisphere. There the veil is 3 to 5 % too small in the mean of the screen, and up to 40 % in
single places near the rim (``tests/compensate/vision/test_glare.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compensate.fourier import Fourier, padded_size
from compensate.vision.adaptation import FOVEA
from domesim.errors import InputError
from domesim.light.blocks import block_sums, enlarged

Floats = NDArray[np.floating[Any]]
Planes = NDArray[np.float32]

NEAREST = FOVEA / 2
"""Angle from which on light counts as stray light, degrees: the rim of the disc that
`adaptation_luminance` averages over."""

WIDEST = 90.0
"""Angle up to which light enters the eye, degrees."""

BROWN = 0.5
"""Pigmentation of a brown eye."""

YOUNGEST, OLDEST = 20, 80
"""Ages that the equation is used for, years: those of the people who were measured."""

COARSEST = 4.0
"""Pixels per degree that the sum has at least, of pictures as fine: the veil is smooth."""

_PARTS = 16  # of a pixel, either way, that the veil of near ones is averaged over
_NEAR = 8  # pixels


def disability_glare(angle: ArrayLike, age: float, pigmentation: float = BROWN) -> Floats:
    """Returns the veil of a small source, cd/m² per lx at the eye: the CIE's equation above.

    Parameters
    ----------
    angle
        From the source, degrees, above 0; any shape.
    age
        Years.
    pigmentation
        p, of the iris.
    """
    theta = np.asarray(angle, np.float64)
    old = 1 + (age / 62.5) ** 4
    veil = 10 / theta**3 + (5 / theta**2 + 0.1 * pigmentation / theta) * old
    return np.asarray(veil + 0.0025 * pigmentation)


@final
@dataclass(frozen=True)
class StrayLight:
    """The stray light of one person's eyes.

    Parameters
    ----------
    age
        Years.
    pigmentation
        p, of the iris.

    Raises
    ------
    InputError
        If the age lies outside `YOUNGEST` to `OLDEST`, or the pigmentation outside 0 to 1.2.
    """

    age: float
    pigmentation: float = BROWN

    def __post_init__(self) -> None:
        if not YOUNGEST <= self.age <= OLDEST:
            raise InputError(
                f"stray light of the eye is known for ages of {YOUNGEST} to {OLDEST} years, "
                f"got {self.age:g}"
            )
        if not 0 <= self.pigmentation <= 1.2:
            raise InputError(f"pigmentation must lie in 0..1.2, got {self.pigmentation:g}")

    @cached_property
    def share(self) -> float:
        """s: the share of a source's light that is scattered further than `NEAREST`."""
        theta = np.geomspace(NEAREST, WIDEST, 4096)
        ring = 2 * np.pi * np.sin(np.radians(theta)) * np.radians(1.0)
        veil = disability_glare(theta, self.age, self.pigmentation)
        return float(np.trapezoid(veil * ring, theta))

    def seen(self, light: Floats, pixels_per_degree: float) -> Planes:
        """Planes of light as they reach the retina: y of the module's docstring.

        Parameters
        ----------
        light
            (..., row, col), any unit, 0 off the screen.
        pixels_per_degree
            Resolution of the picture.

        Returns
        -------
        y, of the same shape, float32; also off the screen.

        Raises
        ------
        InputError
            If the resolution is not above 0, or `light` has no rows and columns.
        """
        planes = np.asarray(light)
        if planes.ndim < 2 or 0 in planes.shape:
            raise InputError(f"stray light takes planes (..., row, col), got {planes.shape}")
        veil = self.veil(planes, pixels_per_degree)
        return np.asarray((1 - self.share) * planes + veil, np.float32)

    def veil(self, light: Floats, pixels_per_degree: float) -> Planes:
        """The scattered part of `seen` alone; parameters and errors as there."""
        if not (np.isfinite(pixels_per_degree) and pixels_per_degree > 0):
            raise InputError(
                f"stray light takes pixels per degree above 0, got {pixels_per_degree:g}"
            )
        planes = np.asarray(light, np.float32)
        step = max(1, int(pixels_per_degree / COARSEST))
        rows, cols = planes.shape[-2:]
        coarse = block_sums(planes.reshape(-1, rows, cols), step) / np.float32(step**2)
        veil = self._scattered(coarse, pixels_per_degree / step)
        return np.asarray(enlarged(veil, step, slice(0, rows), cols).reshape(planes.shape))

    def _scattered(self, planes: Planes, per_degree: float) -> Planes:
        """Sums of L/E x (solid angle) over all other pixels of (plane, row, col)."""
        rows, cols = planes.shape[1:]
        reach = [min(int(WIDEST * per_degree) + 1, side - 1) for side in (rows, cols)]
        fourier = Fourier(padded_size(rows, reach[0]), padded_size(cols, reach[1]))
        down, across = (np.arange(-r, r + 1) for r in reach)
        kernel = np.zeros((fourier.rows, fourier.cols), np.float32)
        kernel[down[:, None], across] = self._kernel(down, across, per_degree)
        wide = np.zeros((len(planes), fourier.rows, fourier.cols), np.float32)
        wide[:, :rows, :cols] = planes
        found = fourier.inverse(fourier.forward(wide) * fourier.forward(kernel), spent=True)
        # rounding in the transforms can leave black a little below 0
        return np.asarray(np.maximum(found[:, :rows, :cols], 0))

    def _kernel(self, down: Floats, across: Floats, per_degree: float) -> Floats:
        """L/E x (solid angle) of pixels that lie so many rows down and cols across."""
        kernel = self._weight(down[:, None] / per_degree, across / per_degree)
        parts = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
        near = [np.flatnonzero(np.abs(axis) <= _NEAR) for axis in (down, across)]
        fine = [
            ((axis[at, None] + parts) / per_degree).ravel()
            for axis, at in zip((down, across), near, strict=True)
        ]
        means = self._weight(fine[0][:, None], fine[1])
        means = means.reshape(len(near[0]), _PARTS, len(near[1]), _PARTS).mean(axis=(1, 3))
        kernel[np.ix_(*near)] = means
        return np.asarray(kernel * np.radians(1 / per_degree) ** 2)

    def _weight(self, down: Floats, across: Floats) -> Floats:
        """L/E times the solid angle there over that in the middle, by degrees."""
        theta = np.hypot(down, across)
        counts = (theta >= NEAREST) & (theta <= WIDEST)
        angle = np.where(counts, theta, NEAREST)
        veil = disability_glare(angle, self.age, self.pigmentation)
        return np.asarray(np.where(counts, veil * np.sinc(angle / 180), 0))
