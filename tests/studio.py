"""A camera before the rig, and photographs through the eyewear that tests make up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from image_files import store
from rigs import LEFT, RIGHT, TO_LEFT, TO_RIGHT

from testing.raws import store_raw

SIZE = (45, 77)
EYES = ("left", "right")
CAMERA = np.array([[0.6, 0.3, 0.05], [-0.1, 0.9, 0.1], [0.02, 0.08, 0.7]]) / 120
"""(camera channel, XYZ): not that of any projector."""


@dataclass(frozen=True)
class Studio:
    """A camera before a rig: `noise` is (read, shot): variance = read² + shot x signal."""

    maps: np.ndarray
    noise: tuple[float, float] = (0.0, 0.0)
    vignetting: float = 0.4
    matrices: tuple = (TO_LEFT, TO_RIGHT)
    dark: tuple = (0.004, 0.005, 0.006)

    def light(self, projector, through, colour):
        """(row, col, camera channel) without black and noise."""
        v = EYES.index(through)
        own = (LEFT, RIGHT)[v]
        shown = np.asarray(colour, float)
        seen = CAMERA @ own @ (shown if projector == through else self.matrices[v] @ shown)
        share = np.ones(self.maps.shape[1:]) if projector == through else self.maps[v]
        return (self.falloff * share)[..., None] * seen

    @property
    def falloff(self):
        rows, cols = self.maps.shape[1:]
        y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, cols), indexing="ij")
        return 1 - self.vignetting * (x**2 + 0.5 * y**2) / 1.5 - 0.1 * x

    def photograph(self, rng, projector=None, through=None, colour=(1, 1, 1)):
        shape = (*self.maps.shape[1:], 3)
        light = self.dark * np.ones(shape)
        if projector is not None:
            light = light + self.light(projector, through, colour)
        read, shot = self.noise
        spread = np.sqrt(read**2 + shot * light)
        return (light + spread * rng.standard_normal(shape)).astype(np.float32)


def store_all(
    folder, studio, *, seed=0, primaries=False, kind="exr", extra="", projector=True, bits=14
):
    """All photographs of a studio, and the file that lists them."""
    rng = np.random.default_rng(seed)
    colours = (
        {"W": (1, 1, 1), **dict(zip("RGB", np.eye(3), strict=True))}
        if primaries
        else {"W": (1, 1, 1)}
    )
    lines = ["[photographs]", extra]
    for through in EYES:
        lines += [f"[photographs.{through}]", f'black = "{through}-black.{kind}"']
        save(folder / f"{through}-black.{kind}", studio.photograph(rng), bits)
        for shown in EYES:
            files = {}
            for name, colour in colours.items():
                files[name] = f"{through}-{shown}-{name}.{kind}"
                save(folder / files[name], studio.photograph(rng, shown, through, colour), bits)
            told = ", ".join(f'{name} = "{file}"' for name, file in files.items())
            lines.append(f"{shown} = {{ {told} }}" if primaries else f'{shown} = "{files["W"]}"')
    lines += ["[projector]", "white_cd_m2 = 15.4"] if projector else []
    path = folder / "photographs.toml"
    path.write_text("\n".join(lines))
    return path


def save(path, samples, bits=14):
    if path.suffix == ".dng":
        store_raw(path, samples, bits=bits)
        return
    if path.suffix == ".tif":
        store(path, np.round(np.clip(samples, 0, 1) * 65535).astype(np.uint16))
        return
    store(path, samples, oiio__ColorSpace="lin_rec709")


def random_maps(rng, size=SIZE):
    """(view, row, col) smooth, about 1, of the paper's range (1.1 % to 2.0 %)."""
    y, x = np.meshgrid(*((np.arange(n) + 0.5) / n - 0.5 for n in size), indexing="ij")
    found = []
    for _ in range(2):
        a = rng.normal(0, [0.2, 0.2, 0.6, 0.6, 0.3])
        found.append(np.exp(a[0] * x + a[1] * y + a[2] * x**2 + a[3] * y**2 + a[4] * x * y))
    return np.stack(found)


NOISE = (5e-4, 6e-5)
"""1 % of a white pixel; 8 % of one that sees 2 % of it."""
