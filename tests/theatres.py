"""Small theatres and problems that can fail a test: unequal areas, odd sizes, uneven albedos."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from compensate.problem import Problem
from compensate.solver.baselines import clipped_subtraction
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import CsfWeighting, PerceptualWeighting, csf_gains, linear_ycbcr
from domesim.observation.spherical import ClosedFormDome
from domesim.room.dome import Dome
from domesim.room.viewing import Viewing
from domesim.stereo.system import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre

DATA = Path(os.environ.get("DOMESIM_DATA", Path(__file__).parents[2] / "shared" / "data"))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no test data at {DATA}")

ALBEDOS = (0.7, 0.3, 0.55, 0.1)
BT709 = np.array([0.2126, 0.7152, 0.0722])


def dome(half_angle_deg: float = 105.0) -> Dome:
    return Dome(3.0, np.radians(half_angle_deg))


def closed_form(size: int, primaries: int = 3, *, falloff: bool = True) -> ClosedFormDome:
    cap = dome()
    return ClosedFormDome(
        cap,
        size,
        size,
        albedo=ALBEDOS[:primaries],
        lens_gain=cap.lens_gain(size, size, (0.6, -0.4, 0.9)) if falloff else None,
        ambient=np.arange(1, primaries + 1) / 100,
        primaries=primaries,
    )


def cinema(
    screen: SilverScreen,
    leaks: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    lenses: tuple[tuple[float, float, float], ...] = ((-0.4, -24, 2), (0.3, -23, 1.5)),
) -> StereoTheatre:
    """Nothing is in the middle, and nothing left like its right."""
    hands = ("left", "right", "right", "left")
    filters = [CircularFilter(hand, leak) for hand, leak in zip(hands, leaks, strict=True)]
    return StereoTheatre(
        screen,
        (PolarisedProjector(lenses[0], filters[0]), PolarisedProjector(lenses[1], filters[1])),
        (filters[2], filters[3]),
        {
            "sweet spot": (0, -15, -1),
            "right": (6, -15, -1),
            "low": (0, -12, -4),
            "aisle": (4, -15, -1),
            "corner": (6, -8, -2),
        },
    )


def viewing() -> Viewing:
    """Small pictures seen so large that they hold frequencies on both sides of the CSF's peak."""
    return Viewing(extent=2.0, image_area=4.0, distance=3.0, adaptation=1.4)


def weighting(support: np.ndarray, primaries: int = 3, gain: float = 0.1) -> CsfWeighting:
    """Channels with unequal gains, for any number of primaries."""
    if primaries == 3:
        return PerceptualWeighting(LowFrequencyFloor(gain), padding=5)(viewing(), BT709, support)
    padded = (support.shape[0] + 5, support.shape[1] + 4)
    omega, peak = csf_gains(viewing(), support.shape, padded, LowFrequencyFloor(gain))
    scales = np.linspace(1.0, 0.4, primaries)
    opponent = np.eye(primaries) + 0.2 * np.tri(primaries)
    return CsfWeighting(scales[:, None, None] * omega, opponent, support, padded, peak)


def unequal_weighting(support: np.ndarray, gain: float = 0.1) -> CsfWeighting:
    """Opponent channels with a sensitivity each: the general case of the Fourier step."""
    padded = (support.shape[0] + 6, support.shape[1] + 6)
    omega, peak = csf_gains(viewing(), support.shape, padded, LowFrequencyFloor(gain))
    gains = np.stack([omega, 0.6 * omega**2, 0.3 * np.sqrt(omega)])
    return CsfWeighting(gains, linear_ycbcr(BT709), support, padded, peak)


def picture(size: int, primaries: int = 3, seed: int = 0, dtype: type = np.float64) -> np.ndarray:
    """A dark picture with bright patches, so that subtraction clips."""
    random = np.random.default_rng(seed)
    light = 0.04 * random.random((1, size, size, primaries))
    bright = random.random((1, size, size, 1)) > 0.8
    return (light + bright * random.random((1, size, size, primaries))).clip(0, 1).astype(dtype)


def problem(
    size: int = 15,
    primaries: int = 3,
    *,
    seed: int = 0,
    gain: float = 0.1,
    mu: float = 1e-3,
    falloff: bool = True,
    dtype: type = np.float64,
) -> tuple[Problem, np.ndarray]:
    """A regularised dome problem and its exact subtraction."""
    observation = closed_form(size, primaries, falloff=falloff)
    screen = observation.screen
    master = picture(size, primaries, seed, dtype)
    on = screen[None, :, :, None]
    bounds = (np.where(on, 0, master), np.where(on, 1, master))
    seen = observation.direct(master)
    lambda_ = weighting(screen, primaries, gain)
    start, _ = clipped_subtraction(Problem(observation, lambda_, seen, bounds))
    posed = Problem(observation, lambda_, seen, bounds, anchor=start, regularisation=mu)
    return posed, start
