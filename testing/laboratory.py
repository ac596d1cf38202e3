"""A virtual laboratory: path-traced photographs of a theatre, with a real camera's faults.

What is fitted to them computes light without random numbers (`domesim.measure.dome.model`); here
walks are traced, so the two share no code for reflected light.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.pose import pose
from domesim.measure.dome.camera import Camera, places_in
from domesim.measure.dome.photographs import Photographs
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import dome_patterns
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from domesim.scene import DomeScene, Scene
from domesim.scene.fields import three
from testing.masters import night
from testing.statistics import rms_difference

Floats = NDArray[np.float64]
Picture: TypeAlias = NDArray[np.float32]

LEVELS = 4
"""Steps of ramps, of which no photographs are taken."""


@final
@dataclass(frozen=True)
class Faults:
    """What is wrong with a photograph, and what a camera makes of light.

    Parameters
    ----------
    noise
        Standard deviation of a pixel, relative to its light.
    read_out
        Standard deviation of a pixel in the dark, relative to the value of white.
    gain
        (primary,) value of projector white.
    vignetting
        Light that is lost at the rim of the view.
    camera_m, turn_deg
        Where the camera is beside what is stated: m, and degrees about the room's axes.
    bits
        Bits of the camera; twice the brightest white saturates.
    """

    noise: float = 0.01
    read_out: float = 1e-4
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    vignetting: float = 0.0
    camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bits: int = 16


NOISE = 0.01
"""Noise of a pixel of an ordinary camera, as in `Faults`."""
ORDINARY = Faults(NOISE, vignetting=0.02, camera_m=(0.02, -0.01, 0.02), turn_deg=(0.2, 0.3, -0.2))
"""Faults of a camera that was placed with some care."""


def patterns_for(dome: Dome, size: int) -> Floats:
    """(pattern, row, col, primary): black, white, half domes, a zenith cap, a rim, two sectors."""
    x, y, z = np.moveaxis(dome.directions(size, size), -1, 0)
    polar = np.arccos(np.clip(z, -1, 1)) / dome.half_angle
    shapes = (
        np.zeros_like(z),
        np.ones_like(z),
        y > 0,
        x > 0,
        polar < 0.4,
        polar > 0.75,
        (x > 0) == (y > 0),
    )
    lit = np.stack([np.asarray(shape, np.float64) for shape in shapes])
    return np.repeat((lit * dome.inside(size, size))[..., None], 3, -1)


def sectors_for(dome: Dome, size: int) -> Floats:
    """(pattern, row, col, primary): black, white, halves, rings, sectors and boards of 4 x 2.

    They are those of `domesim measure patterns`.
    """
    wanted = re.compile(r"black|white|half-.*|ring-.*|sector-.*|checkerboard-4x2-.*")
    found = dome_patterns(dome, Codes(16, floating=False, transfer="linear"), LEVELS)
    return np.stack(
        [
            np.asarray(pattern.codes(size, size)[0], np.float64)
            for pattern in found
            if wanted.fullmatch(pattern.name)
        ]
    )


def photographed(
    theatre: Theatre,
    camera: Camera,
    patterns: Floats,
    faults: Faults,
    *,
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0),
    size: int = 96,
    walks: int = 32,
    seed: int = 0,
) -> Photographs:
    """Photographs of patterns, one each.

    Parameters
    ----------
    theatre
        The theatre as it is, not as it is described.
    camera
        The camera as it is described.
    patterns
        (pattern, row, col, primary) light of projected domemasters.
    faults
        Faults of camera and photographs.
    ambient
        Light of a black picture on the screen, 1 = projector white; projectors' black, so that it
        is reflected as any picture is, and falls off to the rim.
    size
        Pixels a side of the photographs.
    walks
        Walks traced a pixel: they are noise as well.
    seed
        Seed of the random numbers.
    """
    tracer = Tracer(theatre)
    moved = replace(
        camera,
        position=three(np.add(camera.position, faults.camera_m)),
        look_at=three(np.add(camera.look_at, faults.camera_m)),
        turn=three(np.radians(faults.turn_deg)),
    )
    u, v = places_in(size)
    rays = moved.rays(u, v)
    settings = Settings(error=1e-9, least=walks, most=walks)
    inside = theatre.dome.inside(*patterns.shape[1:3])
    falling = 1 - 0.3 * np.arccos(theatre.dome.directions(*patterns.shape[1:3])[..., 2])
    black = np.maximum(falling, 0.1)[..., None] * np.asarray(ambient) * inside[..., None]
    rng = np.random.default_rng(seed)
    result = np.zeros((len(patterns), size, size, 3))
    for number, pattern in enumerate(patterns):
        lit = pattern + black
        if lit.max() > 0:
            traced = tracer.along(
                tracer.picture(lit),
                moved.position,
                rays,
                replace(settings, seed=int(rng.integers(1 << 30))),
            )
            result[number] = traced.mean
    result *= np.asarray(faults.gain)
    result *= (1 - faults.vignetting * (u**2 + v**2))[..., None]
    spread = np.hypot(faults.noise * result, faults.read_out * max(faults.gain))
    result += spread * rng.standard_normal(result.shape)
    step = 2 * max(faults.gain) / (1 << faults.bits)
    result = np.clip(np.round(result / step), 0, (1 << faults.bits) - 1) * step
    result[:, np.hypot(u, v) > 1] = 0
    return Photographs(camera, result, np.arange(len(patterns)), np.ones(len(patterns)))


def night_and_day(scene: DomeScene, size: int, seed: int) -> tuple[Picture, Picture]:
    """(1, row, col, primary): a night, part of which clips, and a day, where nothing does."""
    inside = scene.screen(size, size)[..., None]
    dark = night(size, seed) * inside
    bright = (0.35 + 0.6 * dark) * inside
    return dark.astype(np.float32), bright.astype(np.float32)


def left_over(
    tracer: Tracer,
    desired: Picture,
    models: Mapping[str, Scene],
    walks: int,
    seed: int,
) -> dict[str, float]:
    """Light that is seen besides what should be: rms over the screen, white = 1.

    It is given after exact subtraction by each of `models`, and "untouched".

    Parameters
    ----------
    tracer
        Tracer of the theatre.
    desired
        (1, row, col, primary) light whose direct light alone should be seen.
    models
        Name -> what is taken for the theatre.
    walks
        Walks traced a pixel, twice: what is only noise of one is left out.
    seed
        Seed of the random numbers.
    """
    rows, cols = desired.shape[1:3]
    share = tracer.theatre.dome.screen_areas(rows, cols)

    def theatre(repeat: int) -> PathTracedDome:
        settings = Settings(least=walks, most=walks, seed=1000 * seed + repeat)
        return PathTracedDome(tracer.theatre, rows, cols, settings, tracer=tracer)

    lights = {"untouched": desired} | {
        name: pose(desired, scene).subtractive for name, scene in models.items()
    }
    wanted = np.asarray(theatre(0).direct(desired)[0], np.float64)
    return {
        name: rms_difference(
            wanted,
            np.asarray(theatre(1).observe(light)[0], np.float64),
            np.asarray(theatre(2).observe(light)[0], np.float64),
            share / share.sum(),
        )
        for name, light in lights.items()
    }


LEFT = (
    "Light that should not be there (rms over the screen, % of white), seen in the path-traced "
    "theatre after exact subtraction by each model."
)
"""Caption of a table of `left_over`."""
