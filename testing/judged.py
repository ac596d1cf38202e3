"""Ten pictures for the ruler: five masters, each as it is seen untouched and once subtracted."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from compensate.bundled import bundled_night
from domesim.light import Light
from domesim.scene import Scene, load_scene
from domesim.scene.screening import decoded
from testing.masters import night
from testing.pairs import averaged

JUDGED: dict[str, tuple[float, float]] = {
    "night": (0.1510, 0.2104),
    "bundled": (1.2751, 1.4398),
    "stars": (0.8424, 0.8226),
    "lamps": (0.2938, 0.3708),
    "bars": (0.2607, 0.0497),
}
"""Master -> JOD lost untouched, and subtracted (cvvdp 0.5.7, torch 2.13.0)."""


def stars() -> Light:
    """Points of 0.01 to 1 on a dark sky, beside a bright disc."""
    rows, cols = np.mgrid[:384, :384]
    light = np.full((384, 384), 0.0005)
    light[np.hypot(rows - 150, cols - 200) < 40] = 0.7
    for k, level in enumerate(np.geomspace(0.01, 1, 10)):
        light[250, 100 + 18 * k] = level
    return light.astype(np.float32)[None, ..., None] * np.array([1, 0.95, 0.8], np.float32)


def lamps() -> Light:
    """Coloured lamps on black, of other depths: each has a sharp ghost."""
    rows, cols = (np.mgrid[:270, :480] + 0.5) / 480
    views = []
    for eye in (-0.5, 0.5):
        picture = np.full((270, 480, 3), 0.001)
        for k, (across, down, colour) in enumerate(
            [(0.3, 0.2, (1, 0.9, 0.7)), (0.55, 0.3, (0.9, 0.9, 1)), (0.75, 0.15, (1, 0.5, 0.3))]
        ):
            far = np.hypot(cols - across - 0.02 * (k + 1) * eye, rows - down)
            shape = (far < 0.012) + 0.02 * np.exp(-far / 0.01)
            picture += shape[..., None] * np.array(colour)
        views.append(np.minimum(picture, 1))
    return np.stack(views).astype(np.float32)


def bars() -> Light:
    """Grey bars before a dark ground."""
    rows, cols = (np.mgrid[:270, :480] + 0.5) / 480
    views = []
    for eye in (-0.5, 0.5):
        across = cols + 0.03 * eye
        lit = (np.mod(30 * across, 1) < 0.3) & (np.abs(rows - 0.28) < 0.08)
        views.append(0.01 + 0.6 * (lit & (across > 0.2) & (across < 0.8)))
    return np.stack(views).astype(np.float32)[..., None].repeat(3, axis=-1)


def pictures() -> Iterator[tuple[str, Scene, Light, tuple[Light, Light]]]:
    """Name, scene, master, and what is seen untouched and subtracted."""
    masters: dict[str, tuple[str, Callable[[Scene], Light]]] = {
        "night": ("dome_planetarium", lambda _: night(192)),
        "bundled": ("dome_imax", lambda scene: averaged(decoded(bundled_night(), scene), 2)),
        "stars": ("dome_planetarium", lambda _: stars()),
        "lamps": ("stereo_polarised_paper", lambda _: lamps()),
        "bars": ("stereo_shutter", lambda _: bars()),
    }
    for name, (place, master) in masters.items():
        scene = load_scene(place)
        light = master(scene)
        observe = scene.observation(*light.shape[1:3]).observe
        untouched = observe(light)
        subtracted = observe(np.maximum(2 * light - untouched, 0).astype(np.float32))
        yield name, scene, light, (untouched, subtracted)
