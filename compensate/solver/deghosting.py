"""Methods for two views without vision models, or with one that looks at single pixels.

The audience sees psi(x)_v = x_v + phi(x)_v + black_v, where phi mixes views and primaries, but no
pixels. The other eye's light can be subtracted where a picture has enough light. Where it has not,
subtraction (`compensate.subtract`) leaves a ghost, and other methods do something about it:

*The player's shader*, Bino's "ghostbust" [1] for one, shows (1 - c) x + c (1 - x_u), which never
leaves [0, 1] and so never clips. Here it works on linear light. The audience then sees

    c + c² + (1 - c - c²) x - c² x_u

which to first order has no ghost, but black raised to c and contrast 1 - c everywhere.

*Perceptual subtraction* [2] shows, where subtraction clips, the colour that *looks* nearest: that
minimises the CIE 1976 Delta E*ab between what is seen and what is desired. If a ghost clips only
one primary, subtraction changes the hue; the nearest colour trades hue for lightness.

*A locally raised black* is what `RaisedBlack` does to the whole picture and what retouchers do by
hand: a veil b(row, col) >= 0 of smooth bumps that ask for b + (1 - b) desired only around places
where subtraction clips.

[1] M. Lambers, Bino, https://bino3d.org; ``ghostbust`` in its colour shader.
[2] F. A. Smit, R. van Liere, B. Froehlich, "Three extensions to subtractive crosstalk reduction",
    Eurographics Symposium on Virtual Environments, 2007.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.baselines import clipped_subtraction, computed, share_of, unclipped
from compensate.solver.result import Result, Status
from domesim.light import Light, namespace
from domesim.light.rounding import ROUNDING
from domesim.observation.projector import conversion
from domesim.observation.stereo import StereoObservation

Floats = NDArray[np.float64]

PIXELS_AT_ONCE = 65536
"""Pixels that perceptual subtraction does at a time: it needs about 1 kB for each."""

NEGLIGIBLE_DELTA_E = 1e-3
"""Least change of Delta E that counts: a thousandth of a just-noticeable difference, and about
float32's rounding."""


@final
@dataclass(frozen=True, eq=False)
class PlayerShader:
    """(1 - c) x + c (1 - x_u): no ghosts to first order, for c of black and 1 - c of contrast.

    c is one number for each eye and primary, as in the players: how much of a white picture leaks,
    the row sums of the crosstalk's central matrix.

    Parameters
    ----------
    kept
        (view, primary) light without a picture that is part of what is desired: players know none.
    """

    kept: Floats | float = 0.0

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The shader's light; the start is not used.

        Raises
        ------
        ValueError
            If the observation is not an affine one of two views.
        """
        observation, desired = _affine(problem), problem.desired
        xp = namespace(desired)
        kept = np.asarray(self.kept)[:, None, None, :] if np.ndim(self.kept) else self.kept
        desired = desired - xp.asarray(kept, dtype=desired.dtype, device=desired.device)
        leak = np.stack([observation.central[v, :, 1 - v].sum(axis=1) for v in range(2)])
        c = xp.asarray(leak.clip(0, 1)[:, None, None], dtype=desired.dtype, device=desired.device)
        light = (1 - c) * desired + c * (1 - xp.flip(desired, axis=0))
        return computed(problem, problem.project(light), 1)


@final
@dataclass(frozen=True, eq=False)
class PerceptualSubtraction:
    """Where subtraction clips, the colours that look nearest to the desired ones (CIE 1976).

    Smit et al. subtract in CIELab and, where that leaves the gamut, look for the nearest colour
    within. Our reading: each eye shows the colour of the box that minimises *its* Delta E*ab, given
    what the other shows; the eyes take turns until neither changes. No eye gives way to the other:
    bright pixels are not dimmed to hide the ghosts that they make. Where an eye would look
    worse than with subtraction (both eyes clip, and the other's change lights this one),
    subtraction stays, as where it is exact; so Delta E never is above subtraction's. Each turn is a
    step of Levenberg-Marquardt within the box, from subtraction: a descent to a local minimum. It
    needs three primaries, and computes in NumPy.

    Parameters
    ----------
    rgb_to_xyz
        (3, 3) matrix from light in the projector's primaries to XYZ. Lab is relative to the
        projector's white (1, 1, 1).
    max_rounds
        Turns of both eyes.
    tolerance
        It stops where steps would change no light by more than this, in units of white.
    """

    rgb_to_xyz: Floats = field(default_factory=lambda: conversion("BT.709", "XYZ"))
    max_rounds: int = 100
    tolerance: float = 1e-7

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The displayed colours; the start is not used.

        Raises
        ------
        ValueError
            If the observation is not an affine one of two views and three primaries.
        """
        observation = _affine(problem)
        if problem.desired.shape[-1] != 3:
            raise ValueError(
                f"PerceptualSubtraction takes 3 primaries, got {problem.desired.shape[-1]}"
            )
        light, rounds = clipped_subtraction(problem)
        ghosts = np.any(uncorrectable(problem, light), axis=(0, 3), keepdims=True)[0, :, :, 0]
        if not ghosts.any():
            return computed(problem, light, rounds, Status.EXACT)
        pixels = _Pixels(problem, observation, ghosts, self.rgb_to_xyz)
        result = np.array(light)
        x, steps = pixels.nearest(_picked(result, ghosts), self.max_rounds, self.tolerance)
        result[:, ghosts] = x.transpose(1, 0, 2)
        status = Status.CLOSED_FORM if steps < self.max_rounds else Status.EXHAUSTED
        shown = namespace(light).asarray(result, dtype=light.dtype, device=light.device)
        return computed(problem, shown, rounds + steps, status)


@final
@dataclass(frozen=True)
class LocallyRaisedBlack:
    """Raise black only around places where subtraction clips, as smoothly as `degrees` says.

    The veil b is a sum (in the 64-norm) of Gaussian bumps, one over each pixel that needs it and as
    high as that: at least the highest bump everywhere, equal to it far from others, and up to about
    a tenth more amid many. It ends at three sigmas. Each eye has its own, white, so that a veil
    changes no hue towards the ghost's complement. A veil lights the other eye too, whose veil must
    then rise a little; this repeats, and gains about the crosstalk a round.

    Parameters
    ----------
    pixels_per_degree
        Resolution of the picture as the audience sees it.
    degrees
        Standard deviation of the bumps.
    max_rounds
        Rounds after which it gives up; the status then is `EXHAUSTED`, and black still clips.
    """

    pixels_per_degree: float
    degrees: float = 1.0
    max_rounds: int = 50

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Light that shows b + (1 - b) desired; the start is not used.

        It does so exactly, but for light above white that a matrix with negative entries may ask
        for (at most as much as those).

        Raises
        ------
        ValueError
            If the observation is not an affine one of two views.
        """
        observation, desired = _affine(problem), problem.desired
        xp = namespace(desired)
        sigma = self.degrees * self.pixels_per_degree
        needed = np.zeros((2, *desired.shape[1:3]))
        black = np.zeros_like(needed)
        status = Status.EXHAUSTED
        rounds = 0
        while rounds < self.max_rounds:
            rounds += 1
            veil = xp.asarray(black[..., None], dtype=desired.dtype, device=desired.device)
            light, _ = unclipped(observation, desired + veil * (1 - desired))
            lacking = np.asarray(xp.max(share_of(problem.lower - light, 1 - desired), axis=-1))
            if lacking.max() <= ROUNDING:
                exact = not black.any() and float(xp.max(light - problem.upper)) <= ROUNDING
                status = Status.EXACT if exact else Status.CLOSED_FORM
                break
            # a hair more, so that the last rounds end
            needed = np.where(lacking > 0, np.minimum(black + 1.001 * lacking, 1), needed)
            black = np.minimum(np.stack([bumps(plane, sigma) for plane in needed]), 1)
        return computed(problem, problem.project(light), rounds, status)


def uncorrectable(problem: Problem, light: Light) -> NDArray[np.bool_]:
    """Finds where clipped subtraction, `light`, cannot show what is desired.

    That is where more, or less, light is seen than desired, by more than rounding.
    """
    error = np.asarray(problem.observation.observe(light) - problem.desired)
    return np.asarray(np.abs(error) > ROUNDING)


def bumps(needed: Floats, sigma: float) -> Floats:
    """Makes a smooth veil, at least `needed` everywhere and 0 beyond 3 `sigma` of it.

    (sum_q (needed_q g(p - q))^64)^(1/64) with a Gaussian g of height 1: a convolution, for g^64
    is a Gaussian too. Outside the picture nothing is needed.
    """
    top = needed.max()
    if top <= 0:
        return np.zeros_like(needed)
    power = 64
    reach = np.arange(-int(np.ceil(3 * sigma)), int(np.ceil(3 * sigma)) + 1)
    kernel = np.exp(-power * reach**2 / (2 * sigma**2))
    result = (needed / top) ** power
    for axis in range(2):
        result = scipy.ndimage.correlate1d(result, kernel, axis=axis, mode="constant")
    # The root of a tiny number that underflowed to 0 is what is needed there.
    veil: Floats = np.maximum(top * result ** (1 / power), needed)
    return veil


def _affine(problem: Problem) -> StereoObservation:
    observation = problem.observation
    shape = (2, *observation.shape[1:])
    if isinstance(observation, StereoObservation) and (
        observation.shape == shape == observation.seen_shape
    ):
        return observation
    raise ValueError(
        f"deghosting takes an affine observation of two views by one seat, got "
        f"{type(observation).__name__} {observation.seen_shape}; of a table, use its linearised()"
    )


class _Pixels:
    """Uncorrectable pixels: lights are (pixel, view, primary)."""

    def __init__(
        self,
        problem: Problem,
        observation: StereoObservation,
        where: NDArray[np.bool_],
        rgb_to_xyz: Floats,
    ) -> None:
        self._to_xyz = np.asarray(rgb_to_xyz) / np.sum(rgb_to_xyz, axis=1)[:, None]
        self._wanted = _lab(_picked(problem.desired, where) @ self._to_xyz.T)[0]
        self._lower, self._upper = (
            _picked(np.broadcast_to(np.asarray(bound), problem.desired.shape), where)
            for bound in (problem.lower, problem.upper)
        )
        dark = problem.desired * 0
        self._black = _picked(observation.observe(dark), where)
        xp = namespace(dark)
        self._matrices = np.empty((*self._black.shape, 2, 3))
        for view, p in np.ndindex(2, 3):
            unit = np.zeros((2, 1, 1, 3))
            unit[view, :, :, p] = 1
            lit = dark + xp.asarray(unit, dtype=dark.dtype, device=dark.device)
            self._matrices[..., view, p] = _picked(observation.linear(lit), where)

    def nearest(self, light: Floats, max_rounds: int, tolerance: float) -> tuple[Floats, int]:
        """Lights within the box that look nearest to the desired ones, and rounds taken."""
        parts = np.array_split(np.arange(len(light)), -(-len(light) // PIXELS_AT_ONCE))
        solved = [self._nearest(light, part, max_rounds, tolerance) for part in parts]
        return np.concatenate([x for x, _ in solved]), max(rounds for _, rounds in solved)

    def _nearest(
        self, light: Floats, part: NDArray[np.intp], max_rounds: int, tolerance: float
    ) -> tuple[Floats, int]:
        """Levenberg-Marquardt of the pixels `part`, each with its own damping."""
        x = light[part]
        going, damping = np.arange(len(x)), np.full((len(x), 2), 1e-3)
        rounds = 0
        while len(going) and rounds < max_rounds:
            rounds += 1
            now, at = x[going], part[going]
            changes = np.zeros(len(now))
            for view in range(2):
                error, slopes = self._errors(now, view, at)
                moved = self._moved(now[:, view], view, error, slopes, damping[:, view], at)
                trial = now.copy()
                trial[:, view] = moved
                new_error, _ = self._errors(trial, view, at)
                better = np.sum(new_error**2, axis=1) < np.sum(error**2, axis=1)
                changes = np.maximum(changes, np.abs(moved - now[:, view]).max(axis=1))
                now[better, view] = moved[better]
                damping[:, view] *= np.where(better, 0.2, 8)
            x[going] = now
            going, damping = going[changes > tolerance], damping[changes > tolerance]
        worse = np.zeros(len(x), bool)
        for view in range(2):
            before, after = (
                np.linalg.norm(self._errors(some, view, part)[0], axis=1)
                for some in (light[part], x)
            )
            worse |= after > before + NEGLIGIBLE_DELTA_E
        x[worse] = light[part][worse]
        return x, rounds

    def _moved(
        self,
        x: Floats,
        view: int,
        error: Floats,
        slopes: Floats,
        damping: Floats,
        at: NDArray[np.intp],
    ) -> Floats:
        """A damped Gauss-Newton step on the lights that the bounds do not hold back."""
        lower, upper = self._lower[at, view], self._upper[at, view]
        gradient = np.einsum("nij,ni->nj", slopes, error)
        free = ~(((x <= lower) & (gradient >= 0)) | ((x >= upper) & (gradient <= 0)))
        normal = np.einsum("nij,nik->njk", slopes, slopes)
        scale = np.einsum("njj->n", normal) / 3
        normal = normal * (free[:, :, None] & free[:, None, :])
        normal += np.eye(3) * (damping * scale)[:, None, None]
        step = np.linalg.solve(normal, np.where(free, gradient, 0)[..., None])[..., 0]
        return np.clip(x - step, lower, upper)

    def _errors(self, x: Floats, view: int, at: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Lab errors (pixel, 3) of an eye, and their slopes (pixel, 3, 3) over its own light."""
        matrices = self._matrices[at, view]
        seen = np.einsum("nivj,nvj->ni", matrices, x) + self._black[at, view]
        lab, over_xyz = _lab(seen @ self._to_xyz.T)
        return lab - self._wanted[at, view], over_xyz @ (self._to_xyz @ matrices[:, :, view])


def _picked(light: Light, where: NDArray[np.bool_]) -> Floats:
    """(pixel, view, primary) lights at the pixels (row, col) `where`."""
    picked = np.asarray(light, np.float64)[:, where]
    return np.ascontiguousarray(picked.transpose(1, 0, 2))


def _lab(xyz: Floats) -> tuple[Floats, Floats]:
    """CIE 1976 L*, a*, b* of XYZ relative to white (..., 3), and their slopes (..., 3, 3)."""
    delta = 6 / 29
    bright = xyz > delta**3
    root = np.cbrt(np.where(bright, xyz, 1))
    f = np.where(bright, root, xyz / (3 * delta**2) + 4 / 29)
    slope = np.where(bright, 1 / (3 * root**2), 1 / (3 * delta**2))
    mix = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]], float)
    return f @ mix.T - np.array([16, 0, 0]), mix * slope[..., None, :]
