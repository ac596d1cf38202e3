"""Dithered quantisation: rounding to codes whose error is noise, and no bands.

To a value between two codes, triangular noise of +-1 code (the sum of two uniform ones of +-1/2) is
added before it is rounded. The mean of what results is the value itself, and the error's variance
is 1/4 code² whatever the value: neither bands nor noise that comes and goes with them (Lipshitz,
Wannamaker and Vanderkooy, *Quantization and dither: a theoretical survey*, J. Audio Eng. Soc. 40,
1992). Two exceptions:

- a value that is a code already, to the rounding of float32, stays that code: what was not computed
  comes back bit by bit;
- less than half a code from black or white the noise is one uniform one. Triangular noise would
  lead out of range there, and clipping it would raise black; the mean is right with either.

The noise is a function of a seed alone: the same on any machine, in any order, of any number of
threads.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Seed: TypeAlias = tuple[int, ...]
"""View, and the numbers in a file's name: ``(0, 42)`` of left or only ``show.0042.png``."""

_SAMPLES = 1 << 18
"""Done at once: what a core's cache holds. The result does not depend on it."""


def seed_of(path: Path, view: int = 0) -> Seed:
    """Seed of the frame that came from `path`, by its name alone, wherever it lies.

    Thus a frame has the same noise alone and in its sequence, wherever in a name its number is.
    """
    return (view, *map(int, re.findall(r"[0-9]+", path.stem)))


def dither(codes: NDArray[np.float32], largest: int, seed: Seed, before: int = 0) -> None:
    """Round `codes`, 0..`largest`, in place, to integers within 0..`largest`.

    Parameters
    ----------
    codes
        Contiguous, of any shape.
    largest
        The largest code.
    seed
        As of `seed_of`.
    before
        Number of the picture's samples that lie before these.
    """
    # NumPy promises the bits of a generator for all versions, not those of its distributions.
    bits = np.random.PCG64(np.random.SeedSequence(seed))
    bits.advance(before // 2)
    flat = codes.reshape(-1)
    ends = [*range(_SAMPLES - before % _SAMPLES, len(flat), _SAMPLES), len(flat)]
    for begin, end in pairwise([0, *ends]):
        part = flat[begin:end]
        # Two uniform numbers of 16 bits a sample: two samples of each draw.
        second = (before + begin) % 2
        drawn = bits.random_raw((len(part) + second + 1) // 2).astype("<u8", copy=False)
        uniform = drawn.view("<i2")[2 * second :][: 2 * len(part)].astype(np.float32)
        uniform += np.float32(0.5)
        uniform *= np.float32(1 / 65536)
        first, second = uniform[::2], uniform[1::2]
        nearest = np.rint(part)
        second[(part < 0.5) | (part > largest - 0.5)] = 0
        # Near 65535 float32 rounds the sum to halves of a code, which may lie beyond it.
        noisy = np.clip(np.rint(part + (first + second)), 0, largest)
        # Of 24 significant bits, for values that were divided, decoded and encoded again.
        exact = np.abs(part - nearest) <= np.float32(largest * 2.0**-21)
        np.copyto(part, np.where(exact, nearest, noisy))
