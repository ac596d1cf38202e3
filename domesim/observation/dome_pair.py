"""A 3D dome: both views are reflected by the dome, and leak into the other eye.

Light of a view is reflected as any light is, R = D + phi. What differs between systems is which eye
sees it then. Shutters and spectral filters keep the eyes apart however often light was reflected,
for it still comes at its own time, or is of its own colours. Polarisation does not survive: a
matt reflection mixes it, a metallic one turns its hand. So look at the sum and the difference of
the views,

    s = (x_L + x_R) / 2,    d = (x_L - x_R) / 2

All light counts in the sum, R_s = R. Of the difference each reflection keeps the share k, so that
in the closed form the albedo is k rho (`domesim.observation.spherical.closed_form_gain`):

    shutter, spectral               k = 1, R_d = R
    polarised, all mixed then       k = 0, R_d = D: half of it reaches either eye
    polarised, an ideal metal       k = -1: light reflected twice is seen by the other eye only

What the first reflection keeps is in direct light, and so in C; k is of the later ones, which are
less close to the normal. Crosstalk C of direct light (eq. 8) follows, as it does on a flat screen:

    psi(x) = C R x,    R x = (R_s s + R_d d, R_s s - R_d d)

On paint that is Lambertian and keeps the share k of circular polarisation, direct light has the
crosstalk (1 - |k|) / (1 + |k|) (``validation/notes/0014-domes-in-3d.md`` derives both).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Array, Light, namespace
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.followed import Followed
from domesim.observation.lowrank import LowRankObservation

Floats: TypeAlias = NDArray[np.floating[Any]]


@final
class ReflectedViews(AdjointObservation):
    """Two views on one dome: R, without what leaks at the eyes.

    Parameters
    ----------
    summed, differing
        R_s and R_d: how the sum of the views is seen, and how their difference is.

    Raises
    ------
    ValueError
        If they disagree in shape, direct gain or screen.
    """

    def __init__(self, summed: LowRankObservation, differing: LowRankObservation) -> None:
        self.summed, self.differing = summed, differing
        same = differing is summed or (
            summed.shape == differing.shape
            and np.array_equal(summed.screen, differing.screen)
            and np.array_equal(summed.factors.direct_gain, differing.factors.direct_gain)
        )
        if not same:
            raise ValueError("ReflectedViews takes two observations of one dome and lens")

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(2, row, col, primary)."""
        return (2, *self.summed.shape[1:])

    @property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col) bool: pixels whose centre is on the screen."""
        return self.summed.screen

    @property
    def direct_gain(self) -> Array:
        """(row, col) D."""
        return self.summed.factors.direct_gain

    def modes(self) -> tuple[Floats, Floats, Floats]:
        """Reflected light as ``spread core collect'`` of both views.

        Returns
        -------
        spread, collect
            (rank, row, col) modes, the same for all views and primaries.
        core
            (view, primary, rank, view, primary, rank).
        """
        s, d = self.summed.factors, self.differing.factors
        spread, collect = s.spread, s.collect
        first, second = s.core, d.core
        alike = np.array_equal(s.spread, d.spread) and np.array_equal(s.collect, d.collect)
        if not alike:
            spread, collect = (
                np.concatenate([a, b]) for a, b in ((s.spread, d.spread), (s.collect, d.collect))
            )
            more, fewer = len(d.spread), len(s.spread)
            first = np.pad(first, ((0, 0), (0, more), (0, more)))
            second = np.pad(second, ((0, 0), (fewer, 0), (fewer, 0)))
        primaries, rank = first.shape[:2]
        core = np.zeros((2, primaries, rank, 2, primaries, rank))
        for v, u, p in np.ndindex(2, 2, primaries):
            core[v, p, :, u, p] = (first[p] + (second[p] if v == u else -second[p])) / 2
        return spread, collect, core

    def ambient(self, like: Light) -> Light | None:
        """Light without a picture, as an array like `like`; None if there is none."""
        if not (np.any(self.summed.factors.ambient) or np.any(self.differing.factors.ambient)):
            return None
        return self.observe(0 * like)

    def _observe(self, light: Light) -> Light:
        sums, differences = _apart(light)
        return _together(self.summed.observe(sums), self.differing.observe(differences))

    def _linear(self, light: Light) -> Light:
        sums, differences = _apart(light)
        return _together(self.summed.linear(sums), self.differing.linear(differences))

    def _adjoint(self, light: Light) -> Light:
        sums, differences = _apart(light)
        return _together(self.summed.adjoint(sums), self.differing.adjoint(differences))

    def _direct(self, light: Light) -> Light:
        xp = namespace(light)
        return xp.concat([self.summed.direct(light[v : v + 1, ...]) for v in range(2)])

    def _direct_adjoint(self, light: Light) -> Light:
        return self._direct(light)


def dome_pair(
    summed: LowRankObservation, differing: LowRankObservation, crosstalk: Crosstalk
) -> Followed:
    """Returns psi = C R of a 3D dome, or of a pair in a room.

    Ambient light of `summed` is as either eye sees it, through the glasses; black of `crosstalk`
    adds to that. Both become ambient light of R.

    Parameters
    ----------
    summed
        R_s.
    differing
        R_d. It may be `summed` itself; its ambient light does not count.
    crosstalk
        C, the same all over the screen.

    Raises
    ------
    InputError
        If crosstalk has a map, or its black a place.
    """
    if crosstalk.share.shape[1:] != (1, 1) or crosstalk.black.ndim > 2:
        raise InputError(
            "crosstalk of a 3D dome must be one share for all of the screen, got a map"
        )
    s, d = summed.factors, differing.factors
    black = crosstalk.black
    if np.any(s.ambient) or black.any():
        # What is seen is C of it; ambient light is the same for both eyes
        primaries = len(s.ambient)
        inverse = np.linalg.inv(crosstalk.central.reshape(2 * primaries, -1))
        left, right = inverse.reshape(2, primaries, 2, primaries).sum(axis=2)
        dark = (inverse @ black.ravel()).reshape(2, primaries, 1, 1)
        # Black alone is one number a primary
        planes = s.ambient if np.any(s.ambient) else np.zeros((primaries, 1, 1), s.ambient.dtype)
        sums, differences = (
            _mixed((left + sign * right) / 2, np.asarray(planes)) for sign in (1, -1)
        )
        if black.any():
            sums, differences = sums + dark.mean(axis=0), differences + (dark[0] - dark[1]) / 2
            crosstalk = Crosstalk(*crosstalk.shape[1:3], crosstalk.share * crosstalk.matrices)
        sums, differences = (np.broadcast_to(each, s.ambient.shape) for each in (sums, differences))
        summed = LowRankObservation(replace(s, ambient=sums), summed.screen)
        differing = LowRankObservation(replace(d, ambient=differences), differing.screen)
    return Followed(ReflectedViews(summed, differing), crosstalk)


def _mixed(matrix: Floats, planes: Floats) -> Floats:
    """Planes of (primary, row, col) mixed by a matrix; those that are alike stay one in memory."""
    factors = matrix.sum(axis=1)
    if planes.strides[0] == 0 and np.ptp(factors) < 1e-12:
        return np.broadcast_to(planes[0] * factors[0].astype(planes.dtype), planes.shape)
    return np.tensordot(matrix, planes, axes=1).astype(planes.dtype)


def direct_crosstalk(measured: Floats, summed: Floats, differing: Floats) -> Floats:
    """Crosstalk of direct light, from readings of pictures that fill the dome.

    A whole picture is seen with its own reflected light. Per unit of direct light the own eye sees
    own = 1 + a + M b of it, and the other one other = b + M (1 + a), where a and b are the half sum
    and half difference of the reflected light of sum and difference. A meter gives own^-1 other.

    Parameters
    ----------
    measured
        (view, primary, primary) light of the other view's picture over that of the own one.
    summed, differing
        (primary,) reflected light over direct light of a white picture, of sum and difference.

    Returns
    -------
    ndarray
        (view, primary, primary) M.
    """
    a, b = np.diag((summed + differing) / 2), np.diag((summed - differing) / 2)
    own = np.eye(len(summed)) + a
    return np.stack([(own @ each - b) @ np.linalg.inv(own - b @ each) for each in measured])


def _apart(light: Light) -> tuple[Light, Light]:
    """Half the sum and half the difference of the views, each (1, row, col, primary)."""
    left, right = light[:1, ...], light[1:, ...]
    return (left + right) / 2, (left - right) / 2


def _together(sums: Light, differences: Light) -> Light:
    return namespace(sums).concat([sums + differences, sums - differences])
