"""Photographs of a made-up 3D screen, for docs/measuring.md."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
from image_files import store
from scipy.ndimage import gaussian_filter

from domesim.measure.photographs import Corners, on_screen

SIZE = (160, 300)
LEAKS = {"left": 0.011, "right": 0.013}
READ, SHOT = 3e-4, 2e-5
BLUR = 0.7
"""Pixels."""


def made_up(folder: Path, toml: str) -> None:
    """The photographs that a file lists, and a list in which a glass was exchanged."""
    told = tomllib.loads(toml)["photographs"]
    corners = np.array(told["corners"])
    rng = np.random.default_rng(8)
    y, x = np.meshgrid(*(np.arange(n) + 0.5 for n in SIZE), indexing="ij")
    middle, reach = corners.mean(axis=0), np.ptp(corners, axis=0) / 2
    u, v = (x - middle[0]) / reach[0], (y - middle[1]) / reach[1]
    on = on_screen(Corners(corners, np.zeros((8, 8)), "as they are").places(x, y))
    falloff = gaussian_filter(0.6 * on * (1 - 0.3 * (u**2 + 0.4 * v**2)), BLUR)
    for glass in ("left", "right"):
        for name in ("black", "left", "right"):
            light = np.full(SIZE, 0.002)
            if name == glass:
                light = light + falloff
            elif name != "black":
                light = light + falloff * LEAKS[glass] * (1 + 0.6 * u**2 + 0.2 * v**2)
            spread = np.sqrt(READ**2 + SHOT * light)[..., None]
            samples = light[..., None] + spread * rng.standard_normal((*SIZE, 3))
            store(folder / told[glass][name], samples.astype(np.float32))
    (folder / "photographs.toml").write_text(toml)
    swapped = re.sub(
        r'"left-(left|right)-W', lambda m: f'"left-{"right" if m[1] == "left" else "left"}-W', toml
    )
    (folder / "swapped.toml").write_text(swapped)
