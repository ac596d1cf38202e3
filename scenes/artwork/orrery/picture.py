"""From the scene to a picture of it.

Every pixel has its own paths, which are added up in a fixed order: the same settings give the same
picture to the last bit, which a film that all threads write to does not. Highlights are bent below
projector white path by path, so that bright edges stay smooth. Where a path meets nothing there is
the sky, which is drawn at the picture's own sharpness.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.plugins import register
from scenes.artwork.night.noise import Floats
from scenes.artwork.night.picture import shoulder
from scenes.artwork.orrery import sky
from scenes.artwork.orrery.cameras import View
from scenes.artwork.orrery.orrery import Orrery
from scenes.artwork.orrery.stage import Stage

Picture = NDArray[np.float32]
"""(row, col, rgb), linear BT.709, 0..1, 1.0 = projector white."""

_BOUNCES = 3
_BRIGHTEST = 0.25
"""Light that was reflected twice counts as no brighter on a path: the rare ones by way of polished
metal to the sun would leave white dots."""
_KNEE = 0.55
_LANES = 2**21
"""Paths at once, which bounds memory: a domemaster of 4096 pixels takes 3.6 GB in all."""


@final
@dataclass(frozen=True)
class Settings:
    """How the pictures are made.

    Attributes
    ----------
    size
        Columns.
    samples
        Paths to the pixel; powers of four spread most evenly.
    orrery
        What they show.
    """

    size: int = 1024
    samples: int = 64
    orrery: Orrery = field(default_factory=Orrery)

    def __post_init__(self) -> None:
        for name, largest in (("size", 16384), ("samples", 65536)):
            if not 1 <= getattr(self, name) <= largest:
                raise InputError(f"--{name} must be 1 to {largest}, got {getattr(self, name)}")


@final
class Studio:
    """Renders `views` of an orrery at any time.

    Parameters
    ----------
    settings
        How.
    views
        The pictures of one frame, by name.

    Raises
    ------
    InputError
        If there is neither a usable libLLVM nor a CUDA device.
    """

    def __init__(self, settings: Settings, views: Mapping[str, View]) -> None:
        self._mi, self._settings = load_mitsuba(), settings
        register(self._mi)
        self._stage = Stage(self._mi, settings.orrery)
        self._views = dict(views)
        self._skies = {name: _sky(view, settings) for name, view in views.items()}

    def frame(self, time: float) -> dict[str, Picture]:
        """What each view shows at `time` (s)."""
        scene, glowing = self._stage.at(time)
        return {name: self._picture(scene, glowing, name) for name in self._views}

    def _picture(self, scene: Any, glowing: dict[str, Any], name: str) -> Picture:
        view, size, seed = self._views[name], self._settings.size, self._settings.orrery.seed
        picture = np.zeros((*view.shape(size), 3), np.float32)
        rows, cols = np.nonzero(view.inside(size))
        for start in range(0, len(rows), _LANES):
            chosen = rows[start : start + _LANES], cols[start : start + _LANES]
            light, coverage = self._trace(scene, glowing, view, *chosen, seed + start)
            seen = light + (1.0 - coverage[:, None]) * self._skies[name][chosen]
            picture[chosen] = np.minimum(seen, 1.0)
        return picture

    def _trace(
        self,
        scene: Any,
        glowing: dict[str, Any],
        view: View,
        rows: NDArray[np.intp],
        cols: NDArray[np.intp],
        seed: int,
    ) -> tuple[Floats, Floats]:
        """Light (pixel, rgb) of the scene, and the share of each pixel that it covers."""
        mi, dr = self._mi, import_module("drjit")
        settings = self._settings
        sensor = view.sensor(mi, settings.size)
        direct = mi.load_dict({"type": "direct"})
        later = mi.load_dict({"type": "path", "max_depth": _BOUNCES - 1})
        shape = view.shape(settings.size)
        place = mi.Point2f(cols.astype(np.float32), rows.astype(np.float32)) + 0.5
        light, coverage = dr.zeros(mi.Color3f, len(rows)), dr.zeros(mi.Float, len(rows))
        for sampler in _passes(mi, settings.samples, seed, len(rows)):
            aim = (place + _tent(dr, sampler.next_2d())) / mi.Vector2f(shape[1], shape[0])
            # Rays a little outside a dome's circle weigh nothing, but belong to the pixel.
            ray, _ = sensor.sample_ray_differential(0.0, 0.5, aim, mi.Point2f(0.5))
            surface = scene.ray_intersect(ray)
            met = surface.is_valid()
            radiance, _, _ = direct.sample(scene, sampler, ray, active=met)
            onward, throughput = surface.bsdf(ray).sample(
                mi.BSDFContext(), surface, sampler.next_1d(), sampler.next_2d(), met
            )
            next_ray = mi.RayDifferential3f(surface.spawn_ray(surface.to_world(onward.wo)))
            # What comes straight from the sun is in `radiance` already.
            indirect = met & (
                scene.ray_intersect(next_ray, met).shape != mi.ShapePtr(glowing["sun"])
            )
            arriving, _, _ = later.sample(scene, sampler, next_ray, active=indirect)
            radiance += dr.minimum(throughput * arriving, _BRIGHTEST)
            light += dr.select(met, self._shown(dr, radiance, surface, glowing), 0.0)
            coverage += dr.select(met, 1.0, 0.0)
            dr.eval(light, coverage)
        return np.array(light).T / settings.samples, np.array(coverage) / settings.samples

    def _shown(self, dr: Any, radiance: Any, surface: Any, glowing: dict[str, Any]) -> Any:
        """Radiance as the projector can show it."""
        mi = self._mi
        room = 1.0 - _KNEE
        bent = _KNEE + room * (1.0 - dr.exp(-(radiance - _KNEE) / room))
        shown = dr.select(radiance < _KNEE, radiance, bent)
        limb = 0.45 + 0.55 * dr.sqrt(dr.abs(surface.wi.z))
        for name, shape in glowing.items():
            face = self._stage.faces[name].eval(surface) * limb
            shown = dr.select(surface.shape == mi.ShapePtr(shape), face, shown)
        return shown


def _passes(mi: Any, samples: int, seed: int, pixels: int) -> Iterator[Any]:
    """A sampler that moves on to every pixel's next sample `samples` times."""
    evenly = 4
    while evenly < samples:
        evenly *= 4
    sampler = mi.load_dict({"type": "ldsampler", "sample_count": evenly})
    sampler.seed(seed, pixels)
    for _ in range(samples):
        yield sampler
        sampler.advance()
        sampler.schedule_state()


def _tent(dr: Any, uniform: Any) -> Any:
    """Map 0..1 to -1..1 with the density of a tent: a filter two pixels wide."""
    low = dr.minimum(uniform, 1.0 - uniform)
    return (1.0 - dr.sqrt(2.0 * low)) * dr.sign(uniform - 0.5)


def _sky(view: View, settings: Settings) -> Picture:
    """What is infinitely far, for the whole picture."""
    size, seed = settings.size, settings.orrery.seed
    picture = np.zeros((*view.shape(size), 3), np.float32)
    inside = view.inside(size)
    picture[inside] = sky.nebulae(view.directions(size)[inside], seed)
    bent = shoulder(np.asarray(picture + _stars(view, settings), np.float64))
    return bent.astype(np.float32)


def _stars(view: View, settings: Settings) -> Picture:
    """Stars as round dots; in a small picture, where their dots are large, they are dimmer."""
    rows, cols = view.shape(settings.size)
    stars = sky.stars(settings.orrery.seed)
    row, col = view.places(stars.directions, settings.size)
    seen = (row > 0) & (row < rows) & (col > 0) & (col < cols)  # not NaN
    row, col, flux = row[seen] - 0.5, col[seen] - 0.5, stars.flux[seen]
    flux = flux * min(1.0, settings.size / 1000)
    width = max(0.58, settings.size / 3000) * (0.85 + 0.45 * flux.max(axis=1))
    reach = int(np.ceil(3 * width.max(initial=0.58)))
    light = np.zeros((rows + 2 * reach + 2, cols + 2 * reach + 2, 3), np.float32)
    top, left = np.floor(row).astype(int), np.floor(col).astype(int)
    for i, j in np.ndindex(2 * reach + 2, 2 * reach + 2):
        at_row, at_col = top - reach + i, left - reach + j
        distance = ((at_row - row) ** 2 + (at_col - col) ** 2) / width**2
        dot = flux * np.exp(-0.5 * distance)[:, None]
        np.add.at(light, (at_row + reach, at_col + reach), dot)
    return light[reach : reach + rows, reach : reach + cols]
