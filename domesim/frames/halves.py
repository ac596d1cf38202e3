"""Samples of half precision by their bits: NumPy converts and compares halves one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_LARGEST = int(np.finfo(np.float16).max.view(np.uint16))
_FRACTION = 23 - 10  # more bits of a float's fraction
_EXPONENT = np.float32(2.0 ** (127 - 15))  # exponents count from there
_REBASED = np.uint32(2**32 - ((127 - 15) << 23) + (1 << (_FRACTION - 1)) - 1)  # and half a step
_NORMAL = np.float32(2.0**-14)  # below, halves have steps of 2**-24, as floats from 0.5 on
_HALF = np.float32(0.5)


def are_sound(halves: NDArray[np.float16]) -> bool:
    """Says whether none is NaN, infinite or negative, nor a zero with a sign."""
    return int(halves.view(np.uint16).max()) <= _LARGEST


def as_floats(samples: NDArray[Any], *, sound: bool | None = None) -> NDArray[np.float32]:
    """Converts samples to float32, in an array of their own.

    Sound halves are shifted to where a float has its bits, and multiplied by what sets their
    exponents right. That is exact, and takes a fifth of NumPy's time.

    Parameters
    ----------
    samples
        Of any type and shape.
    sound
        Whether they are halves that `are_sound`, if that is known.
    """
    if sound is None:
        sound = samples.dtype == np.float16 and samples.size > 0 and are_sound(samples)
    if not sound:
        return samples.astype(np.float32)
    bits = samples.view(np.uint16).astype(np.uint32)
    bits <<= np.uint32(_FRACTION)
    floats = bits.view(np.float32)
    floats *= _EXPONENT
    return floats


def as_halves(floats: NDArray[np.float32]) -> NDArray[np.float16]:
    """Rounds floats from 0 to the largest half to the nearest half, ties to even.

    It takes two fifths of NumPy's time.

    Parameters
    ----------
    floats
        Of any shape, not below 0 nor above the largest half; not NaN.
    """
    bits = floats.view(np.uint32)
    codes = bits >> np.uint32(_FRACTION)
    codes &= np.uint32(1)  # ties to even
    codes += bits
    codes += _REBASED
    codes >>= np.uint32(_FRACTION)
    halves = codes.astype(np.uint16)
    small = floats < _NORMAL
    if small.any():
        steps = (floats + _HALF).view(np.uint32) - _HALF.view(np.uint32)
        np.copyto(halves, steps.astype(np.uint16), where=small)
    return halves.view(np.float16)
