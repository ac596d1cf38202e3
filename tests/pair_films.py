"""Films of pairs in several shots, as DPX files: for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from domesim.frames import ColourTag, Frame, write_frame
from testing.content.landscapes import daylight

SCENE = "stereo_cinema_silver"
P3 = ColourTag("gamma2.6", "P3-D65", "test")
CODING = ("--encoding", "gamma2.6:p3-d65")
EYES = "lr"


def film(folder: Path, frames: Sequence[np.ndarray]) -> tuple[object, ...]:
    """DPX pairs of light; the arguments that name them."""
    folder.mkdir()
    for number, pair in enumerate(frames, 1):
        for view, eye in zip(pair, EYES, strict=True):
            path = folder / f"{eye}.{number:04d}.dpx"
            pixels = np.clip(view, 0, 1).astype(np.float32) ** np.float32(1 / 2.6)
            write_frame(Frame(pixels, path, P3, 10, floating=False), path)
    left, right = (folder / f"{eye}.####.dpx" for eye in EYES)
    return "--left", left, "--right", right, *CODING


def three_shots(width: int, middle: np.ndarray, each: int) -> list[np.ndarray]:
    """Daylight that moves, another picture, and daylight upside down that fades to 5 %."""
    day = daylight(width)
    fading = 0.05 + 0.95 * (1 - np.linspace(0, 1, each)) ** 2
    return [
        *(np.roll(day, -2 * k, axis=2) for k in range(each)),
        *(np.roll(middle, 2 * k, axis=2) for k in range(each)),
        *(fade * np.roll(day[:, ::-1], k, axis=2) for k, fade in enumerate(fading)),
    ]
