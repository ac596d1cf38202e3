"""Colour tags <-> what files say of their colour.

A file says it by a Color Interop identifier, ITU-T H.273 code points (cICP), an ICC profile
(``icc.py``), chromaticities, or fields of its own format (``formats``); or nothing, and then what
is usual for its format counts. Every tag says which of these it is from.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from domesim.errors import InputError
from domesim.frames import icc
from domesim.frames.messages import one_line
from domesim.light import ocio


@dataclass(frozen=True)
class ColourTag:
    """What code values mean, and where that is known from.

    Attributes
    ----------
    transfer
        "srgb", "linear", "gamma2.2", "gamma2.4", "gamma2.6", "bt1886", "st2084", "dcdm" or
        "hlg1000", of a display of that peak in cd/m²; or a space of OpenColorIO, whose light is
        in ACES AP0 (`domesim.light.ocio`); or a table's name (`domesim.light.transfer.Table`).
    primaries
        One of `CHROMATICITIES`, or of colour-science's RGB colour spaces; or eight numbers in
        words: x, y of red, green, blue and white.
    source
        For a person: "file: chromaticities", "assumed for JPEG", "--encoding dcdm", ...
    """

    transfer: str
    primaries: str
    source: str

    def means_the_same_as(self, other: ColourTag) -> bool:
        """Whether transfer and primaries agree, wherever they are known from."""
        return (self.transfer, self.primaries) == (other.transfer, other.primaries)

    @property
    def assumed(self) -> bool:
        """Whether some of the encoding is assumed, for want of a statement."""
        return "assumed" in self.source

    @property
    def managed(self) -> bool:
        """Whether this is a space of OpenColorIO."""
        return self.transfer.startswith(ocio.PREFIX)

    @property
    def of_display(self) -> bool:
        """Whether codes are a display's levels, and neither light nor luminance."""
        return self.transfer.startswith(_OF_DISPLAYS)

    @property
    def named(self) -> str:
        """The tag as a person reads it, without the source: ``sRGB``, ``linear P3-D65``."""
        if self.managed:
            return ocio.spoken(self.transfer)
        if self.transfer.startswith("hlg"):
            return f"HLG of a display of {self.transfer.removeprefix('hlg')} cd/m²"
        transfer = transfer_in_words(self.transfer)
        if self.primaries == "BT.709":
            return transfer
        return f"{transfer} {self.primaries}"


@dataclass(frozen=True)
class ProjectorResponse:
    """A projector's curve, which decides what a display's levels become, whatever files say.

    Attributes
    ----------
    transfer
        "srgb", "bt1886", "gamma2.2" (any exponent) or a table's name.
    """

    transfer: str

    def instead_of(self, stated: ColourTag) -> ColourTag:
        """What codes mean on this projector; as stated where they are no display's levels."""
        if not stated.of_display:
            return stated
        source = "the scene's projector.response"
        if not stated.assumed and stated.transfer != self.transfer:
            source += f", and not {transfer_in_words(stated.transfer)} ({stated.source})"
        return ColourTag(self.transfer, stated.primaries, source)


Asked: TypeAlias = ColourTag | ProjectorResponse
"""What is said of code values before their file is read."""


def meaning_of(
    asked: Asked | None, state: Callable[[], ColourTag]
) -> tuple[ColourTag, ColourTag | None]:
    """What code values mean; and what their file states of that, None if it is not supported.

    Parameters
    ----------
    asked
        What is said of them before: an encoding counts, a response for a display's levels.
    state
        Tells what the file states.

    Raises
    ------
    InputError
        As `state` does, unless an encoding is asked for.
    """
    try:
        stated = state()
    except InputError:
        if not isinstance(asked, ColourTag):
            raise
        return asked, None
    if isinstance(asked, ProjectorResponse):
        return asked.instead_of(stated), stated
    return asked or stated, stated


def transfer_in_words(transfer: str) -> str:
    """Name of a transfer function for a person, but of no HLG and no space of OpenColorIO."""
    if transfer.startswith("table"):
        return f"a table of {len(transfer.split()) // 2} levels"
    return TRANSFER_NAMES.get(transfer, transfer.replace("gamma", "gamma "))


BT709_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""(RGB,) shares in luminance as ITU-R BT.709-6, 3.2 rounds them; they sum to 1."""


def colour_of_code_points(path: Path, primaries: int, transfer: int, where: str) -> ColourTag:
    """Returns the colour that a file's code points of ITU-T H.273 stand for.

    Raises
    ------
    InputError
        If the transfer is not supported.
    """
    if transfer not in _CICP_TRANSFERS:
        raise unsupported_encoding(path, f"transfer {transfer} of ITU-T H.273")
    if _CICP_TRANSFERS[transfer] == REFERENCE_HLG and primaries != 9:
        raise unsupported_encoding(path, f"HLG of primaries {primaries} of ITU-T H.273")
    if primaries not in _CICP_PRIMARIES:
        source = f"file: {where}; primaries assumed, {primaries} is not known"
        return ColourTag(_CICP_TRANSFERS[transfer], "BT.709", source)
    return ColourTag(_CICP_TRANSFERS[transfer], _CICP_PRIMARIES[primaries], f"file: {where}")


def code_points_of(colour: ColourTag) -> tuple[int, int]:
    """Primaries and transfer in ITU-T H.273's code points; 2, "unspecified", for what has none."""
    transfers = {name: code for code, name in reversed(_CICP_TRANSFERS.items())}
    primaries = {name: code for code, name in _CICP_PRIMARIES.items()}
    return (
        primaries.get(colour.primaries, _UNSPECIFIED),
        transfers.get(colour.transfer, _UNSPECIFIED),
    )


def is_sayable(colour: ColourTag) -> bool:
    """Whether code points of ITU-T H.273 can express this encoding."""
    return _UNSPECIFIED not in code_points_of(colour)


# What there is to know of colour.

TRANSFER_NAMES = {
    "srgb": "sRGB",
    "gamma2.2": "gamma 2.2",
    "gamma2.4": "gamma 2.4",
    "gamma2.6": "gamma 2.6",
    "bt1886": "BT.1886",
    "st2084": "ST 2084",
    "dcdm": "DCDM",
}

_OF_DISPLAYS = ("srgb", "bt1886", "gamma", "table")

REFERENCE_HLG = "hlg1000"
"""Of the display that ITU-R BT.2100 refers to: files tell no other."""

# x, y of red, green, blue and white: ITU-R BT.709-6 and BT.2020-2, SMPTE RP 431-2 (DCI white and
# D65), SMPTE ST 2065-1 (AP0), ACES TB-2014-004 via AMPAS S-2014-004 (AP1), Adobe RGB (1998), 4.3.1;
# XYZ with white E.
CHROMATICITIES = {
    "BT.709": (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290),
    "P3-D65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "P3-DCI": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3140, 0.3510),
    "BT.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "XYZ": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3),
    "ACES AP0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767),
    "ACES AP1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "Adobe RGB": (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, 0.3127, 0.3290),
}

_DARK = 1e-6  # y of a light that has no luminance
_FAR = 2.0  # of x and y: no primaries of a camera's space lie there
_FLAT = 1e-3  # twice the area of a triangle of x, y that is no gamut; BT.709's is 0.22

# Identifiers of the Color Interop Forum, which OpenImageIO and EXR's colorInteropID use:
# transfer_primaries_state, such as "g24_rec709_display".
_INTEROP = re.compile(r"(lin|srgbe?|g\d\d|pq|hlg)_(\w+)_(scene|display)")
_INTEROP_TRANSFERS = {
    "lin": "linear",
    "srgb": "srgb",
    "g22": "gamma2.2",
    "g24": "gamma2.4",
    "g26": "gamma2.6",
    "pq": "st2084",
    "hlg": REFERENCE_HLG,
}
_INTEROP_PRIMARIES = {
    "rec709": "BT.709",
    "p3d65": "P3-D65",
    "rec2020": "BT.2020",
    "ciexyzd65": "XYZ",
    "xyzd65": "XYZ",
    "ap0": "ACES AP0",
    "ap1": "ACES AP1",
    "adobergb": "Adobe RGB",
}

# ITU-T H.273 code points. 1, 6, 14 and 15 are one camera curve, which displays decode by BT.1886.
_CICP_TRANSFERS = {
    1: "bt1886",
    4: "gamma2.2",
    6: "bt1886",
    8: "linear",
    13: "srgb",
    14: "bt1886",
    15: "bt1886",
    16: "st2084",
    17: "dcdm",
    18: REFERENCE_HLG,
}
_UNSPECIFIED = 2
_CICP_PRIMARIES = {1: "BT.709", 9: "BT.2020", 10: "XYZ", 11: "P3-DCI", 12: "P3-D65"}

# From a file.


def colour_of_cicp(path: Path, spec: Any) -> ColourTag | None:
    """Returns the encoding of a file's code points (ITU-T H.273); None if it has none."""
    code_points = spec.getattribute("CICP")
    if code_points is None:
        return None
    primaries, transfer, _, full_range = code_points
    colour = colour_of_code_points(path, primaries, transfer, "cICP")
    if not full_range:
        raise unsupported_encoding(path, "narrow-range video codes")
    return colour


def colour_of_profile(path: Path, spec: Any) -> ColourTag | None:
    """Returns the encoding of a file's ICC profile; None if it has none."""
    profile = spec.getattribute("ICCProfile")
    if not isinstance(profile, np.ndarray):  # an EXR may have any text of that name
        return None
    try:
        transfer, told = icc.meaning_of(bytes(profile), CHROMATICITIES)
        primaries = told if isinstance(told, str) else primaries_of(told)
        if primaries is None:
            raise ValueError("an ICC profile of primaries that are no colours")
    except ValueError as error:
        raise unsupported_encoding(path, str(error)) from error
    named = one_line(spec.get_string_attribute("ICCProfile:profile_description"))
    return ColourTag(transfer, primaries, f"file: ICC profile '{named}'")


def interop_named(path: Path, identifier: str) -> tuple[str, str] | None:
    """(transfer, primaries) of a Color Interop identifier; None if it is none."""
    match = _INTEROP.fullmatch(identifier)
    if match is None:
        return None
    curve, gamut, state = match.groups()
    primaries = _INTEROP_PRIMARIES.get(gamut)
    if curve not in _INTEROP_TRANSFERS or primaries is None:
        raise unsupported_encoding(path, identifier)
    if (curve, primaries) == ("g26", "XYZ"):
        return "dcdm", primaries
    if (curve, state) == ("g24", "display"):
        return "bt1886", primaries
    return _INTEROP_TRANSFERS[curve], primaries


def primaries_of(chromaticities: Sequence[float]) -> str | None:
    """Primaries of x, y of red, green, blue and white: a name within 0.001, or these numbers.

    None if no light has them, or they are one colour.
    """
    for name, known in CHROMATICITIES.items():
        if np.allclose(chromaticities, known, rtol=0, atol=1e-3):
            return name
    xy = np.array(chromaticities, np.float64).reshape(4, 2)
    if np.array_equal(xy[:3].ravel(), CHROMATICITIES["XYZ"][:6]):  # whatever its white
        return "XYZ"
    if not (np.isfinite(xy).all() and np.abs(xy).max() < _FAR and np.abs(xy[:, 1]).min() > _DARK):
        return None
    shape = np.column_stack([xy[:3], np.ones(3)])
    if abs(np.linalg.det(shape)) < _FLAT or np.linalg.solve(shape.T, [*xy[3], 1]).min() <= 0:
        return None
    return " ".join(f"{value:.6g}" for value in xy.ravel())


@cache
def chromaticities_of(primaries: str) -> tuple[float, ...] | None:
    """x, y of red, green, blue and white of a `ColourTag`'s primaries.

    Names that are not of `CHROMATICITIES` are looked up among the RGB colour spaces of
    colour-science, which is imported for such alone: it takes two seconds. None if that has none,
    or no light has such chromaticities (Y = 0).
    """
    if primaries in CHROMATICITIES:
        return CHROMATICITIES[primaries]
    with suppress(ValueError):
        numbers = tuple(map(float, primaries.split()))
        return numbers if len(numbers) == 8 and primaries_of(numbers) else None
    with warnings.catch_warnings(action="ignore"):  # of its parts that are not installed
        spaces = import_module("colour").RGB_COLOURSPACES
    if primaries not in spaces:
        return None
    x, y = np.concatenate([spaces[primaries].primaries, [spaces[primaries].whitepoint]]).T
    return tuple(np.column_stack([x, y]).ravel().tolist()) if np.all(y != 0) else None


def unsupported_encoding(path: Path, got: str) -> InputError:
    """Returns the error for an encoding that is not supported."""
    wanted = ", ".join([*TRANSFER_NAMES.values(), "HLG of BT.2020"])
    return InputError(
        f"{path}: wanted code values that are linear, {wanted}, got {got}. "
        "Convert it first where it was made, or say what it is (--encoding)."
    )


# To a file.


def is_srgb(colour: ColourTag) -> bool:
    """Whether this is sRGB, which all programs take for granted."""
    return (colour.transfer, colour.primaries) == ("srgb", "BT.709")


def interop_identifier(colour: ColourTag) -> str:
    """The Color Interop identifier that comes nearest; of other curves that of gamma 2.2."""
    family = "hlg" if colour.transfer.startswith("hlg") else colour.transfer
    curve = {"bt1886": "g24", "dcdm": "g26", "hlg": "hlg"}.get(family)
    curves = {transfer: name for name, transfer in _INTEROP_TRANSFERS.items()}
    gamuts = {primaries: name for name, primaries in _INTEROP_PRIMARIES.items()}
    # P3-DCI has no identifier; the chromaticities name its white.
    gamut = gamuts.get(colour.primaries, "p3d65")
    shown = family in ("bt1886", "dcdm", "st2084", "hlg")
    return (
        f"{curve or curves.get(colour.transfer, 'g22')}_{gamut}_{'display' if shown else 'scene'}"
    )
