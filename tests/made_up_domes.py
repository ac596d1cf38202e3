"""Photographs of a dome whose reflected light is a stored transport: computed, not traced."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from image_files import store

from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.photographs import Photographs
from domesim.measure.dome.responses import screen_alone
from domesim.observation.radiosity import radiosity
from domesim.observation.transport import Transport
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre
from testing.laboratory import sectors_for

THEATRE = Theatre(
    Dome(4.0, np.radians(85), tilt=0.2), (0.6, 0.45, 0.3), floor=Floor(-1.0, 4.0, (0.7, 0.5, 0.3))
)
CAMERA = Camera((0.2, -0.4, 0.1), (0.1, 0.5, 1.6), np.radians(190))
GAIN = (3.0, 4.0, 5.0)


@cache
def patterns(size: int = 96) -> np.ndarray:
    return sectors_for(THEATRE.dome, size)


@cache
def truth() -> Transport:
    """By radiosity, which shares no code with what is tested."""
    return radiosity(THEATRE, resolution=6)


def seen(
    transport: Transport,
    lit: np.ndarray,
    *,
    theatre: Theatre = THEATRE,
    camera: Camera = CAMERA,
    size: int = 64,
    noise: float = 0.01,
    read_out: float = 3e-4,
    ambient: float = 0.003,
    vignetting: float = 0.03,
    seed: int = 0,
) -> Photographs:
    """A photograph of each pattern; exposures 1."""
    rows, cols = lit.shape[1:3]
    room = transport.observation(rows, cols, ambient=ambient)
    shown = np.concatenate([room.observe(one[None]) for one in lit])
    u, v = places_in(size)
    surface, points = looked_at(screen_alone(theatre), camera, u, v)
    on = surface == SURFACES["screen"]
    row, col = theatre.dome.pixel_of(theatre.dome.toward(points[on]), rows)
    light = np.zeros((len(lit), size, size, 3))
    light[:, on] = shown[:, row, col] * GAIN
    light *= (1 - vignetting * (u**2 + v**2))[..., None]
    spread = np.hypot(noise * light, read_out * np.array(GAIN))
    light += spread * np.random.default_rng(seed).standard_normal(light.shape)
    return Photographs(camera, light, np.arange(len(lit)), np.ones(len(lit)))


def store_survey(
    folder: Path, theatre: str, kept: Sequence[int] = range(17), size: int = 48
) -> None:
    """A survey's files: theatre.toml, survey.toml, patterns and photographs of some of them."""
    (folder / "patterns").mkdir()
    (folder / "theatre.toml").write_text(theatre)
    survey = f"""\
theatre = "theatre.toml"

[camera]
position_m = {list(CAMERA.position)}
look_at_m = {list(CAMERA.look_at)}
field_deg = {float(np.degrees(CAMERA.field))}
"""
    lit = patterns()[list(kept)]
    for number, (pattern, light) in enumerate(
        zip(lit, seen(truth(), lit, size=size).light, strict=True)
    ):
        store(folder / f"patterns/{number}.png", np.round(255 * pattern).astype(np.uint8))
        store(folder / f"{number}.exr", light.astype(np.float32))
        survey += f'\n[[photographs]]\nfile = "{number}.exr"\npattern = "patterns/{number}.png"\n'
    (folder / "survey.toml").write_text(survey)
