"""Masters for experiments and benchmarks: generated, and the one that comes with the program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.bundled import bundled_night
from domesim.frames.formats.base import writer_of
from domesim.light import Light
from domesim.scene import DomeScene
from domesim.scene.screening import decoded, within_range
from testing.pairs import averaged


def night(size: int, seed: int = 0) -> Light:
    """A generated night: dim texture, bright warm discs; (1, size, size, 3) in 0..1, float32."""
    random = np.random.default_rng(seed)
    texture = gaussian_filter(random.standard_normal((size, size)), size / 120)
    light = 0.02 * (1 + texture / np.abs(texture).max())
    rows, cols = np.mgrid[:size, :size] / size
    centres, radii = random.uniform(0.15, 0.85, (12, 2)), random.uniform(0.01, 0.06, 12)
    for (row, col), radius in zip(centres, radii, strict=True):
        light[np.hypot(rows - row, cols - col) < radius] = random.uniform(0.3, 1.0)
    return (light[None, :, :, None] * np.array([1.0, 0.9, 0.75])).astype(np.float32)


def write_exr(path: Path, pixels: NDArray[Any]) -> None:
    """Write (row, col, primary) as a half-float EXR, as renderers do."""
    rows, cols, primaries = pixels.shape
    spec = oiio.ImageSpec(cols, rows, primaries, "half")
    with writer_of(str(path)) as output:
        if not (output.open(str(path), spec) and output.write_image(pixels) and output.close()):
            raise OSError(output.geterror())


def night_in(scene: DomeScene, size: int) -> Light:
    """The bundled night as a dome shows it.

    Parameters
    ----------
    scene
        The dome.
    size
        Pixels a side.
    """
    night = decoded(bundled_night(), scene)
    night = averaged(night, night.shape[1] // size)
    return within_range(night, scene.screen(*night.shape[1:3]))[0]
