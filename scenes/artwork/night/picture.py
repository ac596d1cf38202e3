"""From the scene to the domemaster.

Rays start in the middle of the theatre, one from every pixel and pass: the domemaster is an
equidistant fisheye, which Mitsuba has no sensor for. Where a ray meets something the path tracer
says how bright it is; where it meets nothing the sky shows, computed pixel by pixel with its stars
as small round dots, so that they neither flicker nor need samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.llvm import load_mitsuba
from domesim.room.dome import Dome
from scenes.artwork.night import sky
from scenes.artwork.night.noise import Floats
from scenes.artwork.night.scene import build

EYE = (0.0, 0.0, 3.6)
"""Where the audience is, m: on a terrace above the garden."""


@dataclass(frozen=True)
class Night:
    """Settings of the picture.

    Attributes
    ----------
    size
        Rows and columns.
    samples
        Paths to the pixel: a power of four, for an even spread.
    seed
        Seed of everything random: same seed, same picture.
    tilt
        Degrees by which the theatre is tilted towards the front: so far the picture reaches below
        the horizon there.
    bounces
        Longest path.
    shadow_rays
        To the lights, from what each path meets first: there are many lights, and few reach far.
    brightest
        Reflected light on a path counts as no brighter than this: the rare paths by way of the
        water or a near wall to a lamp would otherwise leave white dots.
    detail
        Share of the leaves and blades of grass that grow.
    """

    size: int = 1024
    samples: int = 256
    seed: int = 7
    tilt: float = 22.0
    bounces: int = 3
    shadow_rays: int = 2
    brightest: float = 12.0
    detail: float = 1.0

    def __post_init__(self) -> None:
        for name in ("size", "samples", "bounces"):
            if getattr(self, name) < 1:
                raise InputError(f"Night.{name} must be 1 or more, got {getattr(self, name)}")
        if self.samples & (self.samples - 1) or self.samples.bit_length() % 2 == 0:
            raise InputError(f"Night.samples must be a power of four, got {self.samples}")


def render(night: Night) -> NDArray[np.float32]:
    """The domemaster (row, col, rgb), linear BT.709, 0..1, black outside the circle.

    Raises
    ------
    InputError
        If there is no usable libLLVM: ray batches need Mitsuba's LLVM variant.
    """
    rows, cols = np.nonzero(Dome(radius=1.0, half_angle=np.pi / 2).inside(night.size, night.size))
    light, coverage = _trace(night, rows, cols)
    seen = light + (1.0 - coverage[:, None]) * _sky(night, rows, cols)
    picture = np.zeros((night.size, night.size, 3), dtype=np.float32)
    picture[rows, cols] = shoulder(seen)
    return picture


def shoulder(light: Floats, knee: float = 0.6) -> Floats:
    """Bend light above `knee` so that it approaches 1.0 instead of being cut off there."""
    room = 1.0 - knee
    return np.where(light < knee, light, knee + room * (1.0 - np.exp(-(light - knee) / room)))


def directions(across: Floats, down: Floats, tilt: float) -> Floats:
    """Where a point of the domemaster is seen: (..., xyz), y to the front, z up.

    Parameters
    ----------
    across, down
        Position on the picture, -1..1 from left to right and from top to bottom.
    tilt
        Tilt of the theatre towards the front, degrees.
    """
    polar = np.hypot(across, down) * (np.pi / 2)
    scale = np.sinc(polar / np.pi) * (np.pi / 2)
    right, front, above = across * scale, down * scale, np.cos(polar)
    t = np.radians(tilt)
    return np.stack(
        [right, front * np.cos(t) + above * np.sin(t), above * np.cos(t) - front * np.sin(t)],
        axis=-1,
    )


def _trace(night: Night, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Light (pixel, rgb) that comes from the scene, and the share of each pixel that it covers."""
    mi, dr = load_mitsuba(), import_module("drjit")
    scene = build(mi, night.seed, night.detail)
    direct = mi.load_dict({"type": "direct", "emitter_samples": night.shadow_rays})
    later = mi.load_dict({"type": "path", "max_depth": night.bounces - 1, "hide_emitters": True})

    def rays(sampler: Any, chosen: NDArray[np.intp]) -> Any:
        # A tent filter, two pixels wide, by its density: every path counts the same.
        right, below = (_tent(np.array(part)) for part in sampler.next_2d())
        across = (cols[chosen] + 0.5 + right) / night.size * 2.0 - 1.0
        down = (rows[chosen] + 0.5 + below) / night.size * 2.0 - 1.0
        toward = directions(across, down, night.tilt).astype(np.float32)
        return mi.RayDifferential3f(o=mi.Point3f(*EYE), d=mi.Vector3f(*toward.T))

    every, met = np.arange(len(rows)), np.zeros(len(rows), dtype=bool)
    for sampler in _passes(mi, 16, night.seed, len(every)):
        met |= np.array(scene.ray_test(rays(sampler, every)))
    solid = np.nonzero(met)[0]

    light, coverage = np.zeros((len(rows), 3)), np.zeros(len(rows))
    for sampler in _passes(mi, night.samples, night.seed, len(solid)):
        ray = rays(sampler, solid)
        surface = scene.ray_intersect(ray)
        met = surface.is_valid()
        radiance, _, _ = direct.sample(scene, sampler, ray, active=met)
        # What the direct light leaves out: light that was reflected before it came to this surface.
        onward, throughput = surface.bsdf(ray).sample(
            mi.BSDFContext(), surface, sampler.next_1d(), sampler.next_2d(), met
        )
        next_ray = surface.spawn_ray(surface.to_world(onward.wo))
        arriving, _, _ = later.sample(scene, sampler, mi.RayDifferential3f(next_ray), active=met)
        reflected = mi.Color3f(throughput * arriving)
        reflected /= mi.Float(dr.maximum(1.0, dr.max(reflected) / night.brightest))
        seen = dr.select(met, radiance + reflected, 0.0)
        light[solid] += np.array(seen).T
        coverage[solid] += np.array(met)
    return light / night.samples, coverage / night.samples


def _passes(mi: Any, samples: int, seed: int, pixels: int) -> Iterator[Any]:
    """A sampler that moves on to every pixel's next sample `samples` times."""
    sampler = mi.load_dict({"type": "ldsampler", "sample_count": max(4, samples)})
    sampler.seed(seed, pixels)
    for _ in range(samples):
        yield sampler
        sampler.advance()
        sampler.schedule_state()


def _tent(uniform: Floats) -> Floats:
    """Map 0..1 to -1..1 with the density of a tent."""
    low = np.minimum(uniform, 1.0 - uniform)
    return (1.0 - np.sqrt(2.0 * low)) * np.sign(uniform - 0.5)


def _sky(night: Night, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> Floats:
    def seen_at(right: float, below: float, chosen: Any = slice(None)) -> Floats:
        across = (cols[chosen] + right) / night.size * 2.0 - 1.0
        down = (rows[chosen] + below) / night.size * 2.0 - 1.0
        return directions(across, down, night.tilt)

    centres = seen_at(0.5, 0.5)
    light = sky.background(centres, night.seed) + _star_light(night)[rows, cols]
    near = np.nonzero(centres @ sky.MOON > np.cos(sky.MOON_RADIUS + 4.0 / night.size))[0]
    for right in (np.arange(4) + 0.5) / 4:
        for below in (np.arange(4) + 0.5) / 4:
            disc, covered = sky.moon(seen_at(right, below, near), night.seed)
            light[near] += (disc - covered[:, None] * light[near]) / 16
    return light


def _star_light(night: Night) -> Floats:
    """Stars as round dots of a fixed width, brighter ones a little wider: (row, col, rgb)."""
    stars = sky.star_catalogue(night.seed)
    t = np.radians(night.tilt)
    right, front, above = stars.directions.T
    front, above = front * np.cos(t) - above * np.sin(t), front * np.sin(t) + above * np.cos(t)
    radius = np.arccos(np.clip(above, -1, 1)) / (np.pi / 2)
    scale = radius / np.maximum(np.hypot(right, front), 1e-12)
    col, row = (np.stack([right, front]) * scale + 1.0) / 2.0 * night.size - 0.5
    inside = (radius < 1.0) & (stars.flux.max(axis=1) > 0.0)
    row, col, flux = row[inside], col[inside], stars.flux[inside]

    strength = flux.max(axis=1)
    width = 0.62 + 0.16 * np.log10(1.0 + 12.0 * strength)
    # A point's light spreads over its pixel: four times as bright in one of half the width.
    peak = 5.0 * (night.size / 1024) ** 2 * flux**0.88 / width[:, None] ** 2
    light = np.zeros((night.size + 8, night.size + 8, 3))
    top, left = np.floor(row).astype(int), np.floor(col).astype(int)
    for i, j in np.ndindex(8, 8):
        at_row, at_col = top - 3 + i, left - 3 + j
        distance = ((at_row - row) ** 2 + (at_col - col) ** 2) / width**2
        np.add.at(light, (at_row + 4, at_col + 4), peak * np.exp(-0.5 * distance)[:, None])
    return light[4:-4, 4:-4]
