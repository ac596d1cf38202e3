"""A rig of two projectors and eyewear, whose readings tests make up; and refusals of commands."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from domesim.frames import ColourTag, Frame, write_frame
from domesim.readings.noise import Noise

ROWS, COLS = 5, 7
CRT = Path(__file__).parents[2] / "shared/data/measured/ptb3_crt_pr650_30levels.csv"
real = pytest.mark.skipif(not CRT.exists(), reason="the measured table is not here")
# Unequal on purpose: two lamps of other hue, filters that tint, leaks that differ by direction.
LEFT = np.array([[21.0, 17.5, 9.2], [11.2, 36.0, 3.7], [1.1, 5.9, 47.0]])
RIGHT = np.array([[17.0, 15.1, 8.9], [8.8, 31.0, 3.9], [0.8, 4.1, 43.0]])
TO_LEFT = np.array([[0.020, 0.002, 0.001], [0.003, 0.013, 0.002], [0.001, 0.004, 0.031]])
TO_RIGHT = np.array([[0.011, 0.001, 0.002], [0.002, 0.017, 0.001], [0.003, 0.002, 0.009]])
RAMP = np.array([0.1, 0.2, 0.35, 0.5, 0.7, 0.85])
QUIET = Noise(1e-7, 1e-9)
BLACK = {"left": np.array([0.061, 0.063, 0.09]), "right": np.array([0.052, 0.055, 0.06])}


@dataclass(frozen=True)
class Rig:
    """Two projectors and eyewear; `noise` is that of one reading."""

    gamma: float = 2.2
    noise: Noise = QUIET
    repeats: int = 1
    ramps: bool = True
    to_left: tuple = tuple(map(tuple, TO_LEFT))
    white: float | None = 1.0

    def primaries(self, projector, through):
        own = {"left": LEFT, "right": RIGHT}[through]
        leak = {"left": np.array(self.to_left), "right": TO_RIGHT}[through]
        return own if projector == through else own @ leak

    def rows(self, seed=0):
        rng = np.random.default_rng(seed)
        for through, projector in product(("left", "right"), repeat=2):
            primaries = self.primaries(projector, through)
            shown = [("K", 0.0, np.zeros(3))]
            if self.white is not None:
                shown.append(("W", 1.0, np.full(3, self.white)))
            levels = [*RAMP, 1.0] if self.ramps and projector == through else [1.0]
            for (i, channel), level in product(enumerate("RGB"), levels):
                shown.append((channel, level, np.eye(3)[i] * level**self.gamma))
            for channel, level, light in shown:
                xyz = primaries @ light + BLACK[through]
                for _ in range(self.repeats):
                    sigma = np.sqrt(self.noise.variance(xyz))
                    read = xyz + sigma * rng.standard_normal(3)
                    yield projector, through, channel, level, *read

    def csv(self, seed=0):
        lines = ["projector,filter,channel,level,X,Y,Z"]
        lines += [
            ",".join(f"{c:.10g}" if isinstance(c, float) else c for c in row)
            for row in self.rows(seed)
        ]
        return "\n".join(lines)


NOISE = Noise(0.003, 0.005)


ROWS, COLS = 5, 7


def refused(outcome, *words):
    """One line, or a line for each mistake of a file."""
    code, out, err = outcome
    assert (code, out) == (2, "")
    assert err.startswith("domesim: ")
    lines = err.splitlines()
    assert all(line.startswith("  ") for line in lines[1:])
    for word in words:
        assert word in err, err
    return lines


def store(path, pixels):
    colour = ColourTag("linear", "BT.709", "a test")
    write_frame(Frame(pixels.astype(np.float32), path, colour, 32, floating=True), path)
    return path


def masters(folder):
    """Two views that leave room to subtract, in other colours than any projector's primaries."""
    rng = np.random.default_rng(2)
    views = 0.15 + 0.5 * rng.random((2, ROWS, COLS, 3))
    return [store(folder / f"{eye}.exr", v) for eye, v in zip("lr", views, strict=True)]
