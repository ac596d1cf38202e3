"""Transfer functions (EOTFs): code values <-> linear light.

A code value is a float in 0..1 (integer code / (2^bits - 1)); linear light is 1.0 at projector
white. ``encode`` is the exact inverse of ``decode``: a round trip returns every integer code value
at 8, 10, 12 and 16 bit. Curves are evaluated in float64, because ST 2084 has too little slope near
white for float32 at 16 bit, and returned in the type that came.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import ocio

Floats = NDArray[np.floating]


class Transfer(ABC):
    """An EOTF and its inverse, on arrays of any shape."""

    elementwise: ClassVar[bool] = True
    """Whether all samples have one curve."""

    @abstractmethod
    def _decode(self, code: Floats) -> Floats: ...

    @abstractmethod
    def _encode(self, light: Floats) -> Floats: ...

    def decode(self, code: Floats) -> Floats:
        """Linear light (1.0 = white) of code values, in the type of `code`.

        Float formats may hold code values outside 0..1. Below 0 curves are odd. Above 1 power
        curves go on, so that nothing is clamped behind the caller's back; ST 2084 and measured
        tables end there, at 10 000 cd/m² and at what was measured.
        """
        if self.elementwise:
            code = np.asarray(code)
            places = _places(code)
            if places is not None:
                return np.take(_decoded_codes(self), places)
        return _odd(self._decode, code)

    def encode(self, light: Floats) -> Floats:
        """Code values of linear light (1.0 = white), in the type of `light`."""
        return _odd(self._encode, light)


_LARGEST = (1 << 16) - 1


def _places(code: Floats) -> NDArray[np.intp] | None:
    """Codes of 16 bits, or of 8; None if some are none, or there are few: then no table pays."""
    if code.dtype != np.float32 or code.size < _LARGEST or not 0 <= code.min() <= code.max() <= 1:
        return None
    codes = np.rint(code * np.float32(_LARGEST))
    return codes.astype(np.intp) if np.array_equal(codes / np.float32(_LARGEST), code) else None


@lru_cache(maxsize=8)
def _decoded_codes(transfer: Transfer) -> Floats:
    """Light of all codes of 16 bits."""
    return _odd(transfer._decode, np.arange(_LARGEST + 1, dtype=np.float32) / np.float32(_LARGEST))


def _odd(curve: Callable[[Floats], Floats], values: Floats) -> Floats:
    values = np.asarray(values)
    if values.size and values.min() < 0:
        magnitude = np.abs(values).astype(np.float64, copy=False)
        return np.asarray(np.copysign(curve(magnitude), values), values.dtype)
    return np.asarray(curve(values.astype(np.float64, copy=False)), values.dtype)


@final
@dataclass(frozen=True)
class Linear(Transfer):
    """Code values that are linear light already (EXR, float TIFF)."""

    def decode(self, code: Floats) -> Floats:
        """The code values themselves."""
        return code

    def encode(self, light: Floats) -> Floats:
        """The light itself."""
        return light

    def _decode(self, code: Floats) -> Floats:
        return code

    def _encode(self, light: Floats) -> Floats:
        return light


@final
@dataclass(frozen=True)
class Gamma(Transfer):
    """A pure power: light = code^exponent (2.4: BT.1886 with zero black; 2.6: DCI-P3)."""

    exponent: float

    def _decode(self, code: Floats) -> Floats:
        return np.power(code, self.exponent)

    def _encode(self, light: Floats) -> Floats:
        return np.power(light, 1 / self.exponent)


@final
@dataclass(frozen=True)
class SRGB(Transfer):
    """The sRGB curve, IEC 61966-2-1:1999."""

    def _decode(self, code: Floats) -> Floats:
        return np.where(code <= 0.04045, code / 12.92, np.power((code + 0.055) / 1.055, 2.4))

    def _encode(self, light: Floats) -> Floats:
        # The standard's rounded constants leave a gap of 1e-8 at the joint; branching on the
        # code value of the joint keeps encode the inverse of decode.
        return np.where(
            light <= 0.04045 / 12.92, light * 12.92, 1.055 * np.power(light, 1 / 2.4) - 0.055
        )


@final
@dataclass(frozen=True)
class ST2084(Transfer):
    """SMPTE ST 2084:2014 (PQ), an absolute curve: code 1.0 is 10 000 cd/m².

    Parameters
    ----------
    white
        Luminance of projector white, cd/m²: what linear light 1.0 means here.
    """

    white: float

    def _decode(self, code: Floats) -> Floats:
        m1, m2, c1, c2, c3 = _ST2084
        root = np.power(np.minimum(code, 1), 1 / m2)
        return np.power(np.maximum(root - c1, 0) / (c2 - c3 * root), 1 / m1) * (10_000 / self.white)

    def _encode(self, light: Floats) -> Floats:
        m1, m2, c1, c2, c3 = _ST2084
        power = np.power(light * (self.white / 10_000), m1)
        code = np.power((c1 + c2 * power) / (1 + c3 * power), m2)
        # Zero light has the code c1^m2 = 7e-7, which the lowest codes of 16 bit fall below.
        return np.asarray(np.where(light > 0, code, 0.0))


_ST2084 = (2610 / 16384, 2523 / 4096 * 128, 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32)


@final
@dataclass(frozen=True)
class HLG(Transfer):
    """Hybrid Log-Gamma, ITU-R BT.2100-3, table 5: code values (..., RGB) of BT.2020's primaries.

    Light 1.0 is the peak of the display that the picture was made on: L = Y_S^(gamma - 1) E, with
    Y_S the luminance of the scene's light E that the curve gives.

    Parameters
    ----------
    peak
        Luminance of that display's white, cd/m². Note 5f's gamma follows from it.
    """

    peak: float

    elementwise = False

    @property
    def gamma(self) -> float:
        """Of the system: 1.2 for 1000 cd/m²."""
        if 400 <= self.peak <= 2000:
            return float(1.2 + 0.42 * np.log10(self.peak / 1000))
        return float(1.2 * 1.111 ** np.log2(self.peak / 1000))

    def decode(self, code: Floats) -> Floats:
        """Linear light (..., RGB) of that display."""
        code = np.asarray(code)
        scene = _odd(self._decode, code.astype(np.float64, copy=False))
        return np.asarray(scene * self._system(scene, self.gamma - 1), code.dtype)

    def encode(self, light: Floats) -> Floats:
        """Code values (..., RGB) of that light."""
        light = np.asarray(light)
        shown = light.astype(np.float64, copy=False)
        scene = shown * self._system(shown, 1 / self.gamma - 1)
        return np.asarray(_odd(self._encode, scene), light.dtype)

    def _decode(self, code: Floats) -> Floats:
        a, b, c = _HLG
        return np.where(code <= 0.5, code**2 / 3, (np.exp((code - c) / a) + b) / 12)

    def _encode(self, light: Floats) -> Floats:
        a, b, c = _HLG
        logarithm = a * np.log(np.maximum(12 * light, 1) - b) + c
        return np.where(light <= 1 / 12, np.sqrt(3 * light), logarithm)

    @staticmethod
    def _system(light: Floats, exponent: float) -> Floats:
        """(..., 1) the luminance of light to a power; 1 where there is none."""
        luminance = np.maximum(light, 0) @ _BT2020_LUMINANCE
        power = np.ones_like(luminance)
        np.power(luminance, exponent, out=power, where=luminance > 0)
        return np.asarray(power[..., None])


_HLG = (0.17883277, 0.28466892, 0.55991073)
_BT2020_LUMINANCE = np.array([0.2627, 0.6780, 0.0593])


@final
@dataclass(frozen=True)
class DCDM(Transfer):
    """The Digital Cinema Distribution Master's X'Y'Z' curve: L = 52.37 cd/m² x code^2.6.

    SMPTE ST 428-1. Its reference white is 48 cd/m², so light 1.0 lies at code 0.967.
    """

    peak: float = 52.37
    white: float = 48.0

    def _decode(self, code: Floats) -> Floats:
        return np.asarray(np.power(code, 2.6) * (self.peak / self.white))

    def _encode(self, light: Floats) -> Floats:
        return np.asarray(np.power(light * (self.white / self.peak), 1 / 2.6))


@final
@dataclass(frozen=True)
class Table(Transfer):
    """A measured response, one curve for all primaries.

    Between the measured levels the 1/2.2 power of the light is interpolated linearly: it is nearly
    a straight line for real displays, and its inverse is exact.

    Parameters
    ----------
    levels
        Code value and light of each level, black subtracted: both rise strictly from 0 to 1.

    Raises
    ------
    InputError
        If they do not.
    """

    levels: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if len(self.levels) < 2:
            raise InputError(f"measured response takes two levels or more, got {len(self.levels)}")
        for name, curve in zip(("codes", "light"), np.array(self.levels).T, strict=True):
            _require_rising(name, curve)

    @property
    def name(self) -> str:
        """What `named` calls it: all its numbers."""
        return " ".join([_TABLE, *(repr(float(value)) for level in self.levels for value in level)])

    def _decode(self, code: Floats) -> Floats:
        codes, light = np.array(self.levels).T
        return np.asarray(np.interp(code, codes, np.power(light, 1 / 2.2)) ** 2.2)

    def _encode(self, light: Floats) -> Floats:
        codes, shown = np.array(self.levels).T
        return np.asarray(np.interp(np.power(light, 1 / 2.2), np.power(shown, 1 / 2.2), codes))


_TABLE = "table"


def _require_rising(name: str, curve: Floats) -> None:
    """Refuses what does not rise strictly from 0 to 1."""
    if not (np.isfinite(curve).all() and (np.diff(curve) > 0).all()):
        # Differences of two numbers are the same on all processors
        level = int(np.argmin(np.nan_to_num(np.diff(curve), nan=-np.inf)))
        raise InputError(
            f"measured response: {name} must increase strictly, got {curve[level]:g} then "
            f"{curve[level + 1]:g} at level {level + 1}; measure again, or drop that level"
        )
    if abs(curve[0]) > 1e-9 or abs(curve[-1] - 1) > 1e-9:
        raise InputError(
            f"measured response: {name} must run from 0 to 1, got {curve[0]:g} to "
            f"{curve[-1]:g}; subtract black and divide by white first"
        )


@final
@dataclass(frozen=True, eq=False)
class MeasuredTable(Transfer):
    """A measured response, one `Table` a primary.

    Parameters
    ----------
    codes
        (level,) code values, strictly increasing from 0 to 1.
    light
        (level, primary) linear light with black subtracted: 0 at code 0, 1.0 at code 1, strictly
        increasing.

    Raises
    ------
    InputError
        If a curve is not strictly increasing, or does not span 0 to 1.
    """

    elementwise = False

    codes: Floats
    light: Floats

    def __post_init__(self) -> None:
        codes = np.asarray(self.codes, np.float64)
        light = np.asarray(self.light, np.float64)
        if codes.ndim != 1 or light.ndim != 2 or len(codes) != len(light) or len(codes) < 2:
            raise InputError(
                f"measured response takes codes (level,) and light (level, primary), "
                f"got {codes.shape} and {light.shape}"
            )
        for name, curve in [
            ("codes", codes),
            *((f"primary {p}", c) for p, c in enumerate(light.T)),
        ]:
            _require_rising(name, curve)
        object.__setattr__(self, "codes", codes)
        object.__setattr__(self, "light", light)

    @property
    def of_each(self) -> tuple[Table, ...]:
        """The curve of each primary."""
        codes = self.codes.tolist()
        return tuple(Table(tuple(zip(codes, each.tolist(), strict=True))) for each in self.light.T)

    def _decode(self, code: Floats) -> Floats:
        curves = self.of_each
        return np.stack([each._decode(code[..., p]) for p, each in enumerate(curves)], -1)

    def _encode(self, light: Floats) -> Floats:
        curves = self.of_each
        return np.stack([each._encode(light[..., p]) for p, each in enumerate(curves)], -1)


@final
@dataclass(frozen=True)
class Managed(Transfer):
    """Code values (..., RGB) of a space of OpenColorIO, whose light is in ACES AP0.

    Parameters
    ----------
    name
        As `domesim.light.ocio.called` has it.
    """

    elementwise = False

    name: str

    def decode(self, code: Floats) -> Floats:
        """Linear light (..., RGB), 1.0 where the configuration's reference has it."""
        return self._decode(np.asarray(code))

    def encode(self, light: Floats) -> Floats:
        """Code values (..., RGB)."""
        return self._encode(np.asarray(light))

    def _decode(self, code: Floats) -> Floats:
        return ocio.space_called(self.name).light(code)

    def _encode(self, light: Floats) -> Floats:
        return ocio.space_called(self.name).codes(light)


def named(name: str, *, white: float) -> Transfer:
    """The transfer function called `name`.

    Parameters
    ----------
    name
        ``linear``, ``srgb``, ``bt1886``, ``gamma2.2`` (any exponent), ``st2084``, ``dcdm`` or
        ``hlg1000`` (any peak of a display, cd/m²); or a space of OpenColorIO
        (`domesim.light.ocio.called`); or a `Table`'s name.
    white
        Luminance of projector white, cd/m² (absolute curves need it).

    Returns
    -------
    transfer
        The curve, code values to light and back.

    Raises
    ------
    InputError
        If there is no such curve.
    """
    if name.startswith(ocio.PREFIX):
        return Managed(name)
    if name.startswith(_TABLE):
        numbers = iter(map(float, name.split()[1:]))
        return Table(tuple(zip(numbers, numbers, strict=True)))
    for family, least, most in ((Gamma, 1, 4), (HLG, 4, 10_000)):
        with suppress(ValueError):
            number = float(name.removeprefix(family.__name__.lower()))
            if name.startswith(family.__name__.lower()) and least <= number <= most:
                return family(number)
    curves: dict[str, Transfer] = {
        "linear": Linear(),
        "srgb": SRGB(),
        "bt1886": Gamma(2.4),
        "st2084": ST2084(white),
        "dcdm": DCDM(),
    }
    if name not in curves:
        raise InputError(
            f"transfer {name!r} is not known; use one of {', '.join(curves)}, or gamma2.2 "
            f"(any exponent from 1 to 4), or hlg1000 (any peak from 4 to 10000 cd/m²)"
        )
    return curves[name]
