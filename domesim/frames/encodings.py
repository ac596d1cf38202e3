"""Encodings by the names that producers say: what ``--encoding`` takes."""

from __future__ import annotations

from domesim.errors import InputError
from domesim.frames.colour import REFERENCE_HLG, TRANSFER_NAMES, ColourTag, chromaticities_of
from domesim.light import ocio, transfer

ENCODINGS = {
    "srgb": ("srgb", "BT.709"),
    "display-p3": ("srgb", "P3-D65"),
    "bt709": ("bt1886", "BT.709"),
    "bt1886": ("bt1886", "BT.709"),
    "bt2020": ("bt1886", "BT.2020"),
    "gamma2.2": ("gamma2.2", "BT.709"),
    "gamma2.4": ("gamma2.4", "BT.709"),
    "gamma2.6": ("gamma2.6", "BT.709"),
    "p3-d65": ("gamma2.6", "P3-D65"),
    "p3-dci": ("gamma2.6", "P3-DCI"),
    "dcdm": ("dcdm", "XYZ"),
    "st2084": ("st2084", "BT.2020"),
    "hlg": (REFERENCE_HLG, "BT.2020"),
    "linear": ("linear", "BT.709"),
    "aces2065-1": ("linear", "ACES AP0"),
    "acescg": ("linear", "ACES AP1"),
}
"""Name -> transfer and primaries: as they are delivered (P3 with gamma 2.6 to cinemas, SMPTE
RP 431-2; ST 2084 and HLG in BT.2020, ITU-R BT.2100; X'Y'Z', SMPTE ST 428-1)."""

_PRIMARIES = {
    "bt709": "BT.709",
    "bt2020": "BT.2020",
    "p3-d65": "P3-D65",
    "p3-dci": "P3-DCI",
    "xyz": "XYZ",
    "ap0": "ACES AP0",
    "ap1": "ACES AP1",
}


def encoding_named(name: str, option: str = "--encoding") -> ColourTag:
    """The encoding called `name`, from an option.

    Parameters
    ----------
    name
        One of `ENCODINGS`; or ``hlg400``, of a display of that peak, cd/m²; or a transfer and
        primaries, ``st2084:p3-d65``, the transfer one of srgb, linear, gamma2.2, gamma2.4,
        gamma2.6, bt1886, st2084 and dcdm, the primaries also those of any RGB colour space of
        colour-science, ``linear:ARRI Wide Gamut 3``; or ``ocio:SPACE``, of OpenColorIO's
        configuration (`domesim.light.ocio`). In any case.
    option
        Name of the option, for messages.

    Returns
    -------
    colour
        Transfer function and primaries.

    Raises
    ------
    InputError
        If there is none; or as for `domesim.light.ocio.called`.
    """
    asked = name.lower()
    if asked.startswith(ocio.PREFIX):
        space = name[len(ocio.PREFIX) :].strip()
        return ColourTag(ocio.called(space, option), "ACES AP0", f"{option} {name}")
    source = f"{option} {asked}"
    if asked in ENCODINGS:
        return ColourTag(*ENCODINGS[asked], source)
    if asked.startswith("hlg") and ":" not in asked:
        transfer.named(asked, white=1.0)  # only BT.2020 has it
        return ColourTag(asked, "BT.2020", source)
    curve, _, gamut = asked.partition(":")
    if curve in ("linear", *TRANSFER_NAMES) and gamut in _PRIMARIES:
        return ColourTag(curve, _PRIMARIES[gamut], source)
    named = name.partition(":")[2].strip()
    if curve in ("linear", *TRANSFER_NAMES) and named and chromaticities_of(named) is not None:
        return ColourTag(curve, named, source)
    raise InputError(
        f"{option} {name!r} is not known; use one of {', '.join(ENCODINGS)}, or name transfer "
        f"and primaries, such as st2084:p3-d65 (primaries: {', '.join(_PRIMARIES)}, or an RGB "
        "colour space of colour-science), or a space of OpenColorIO's configuration in $OCIO, such "
        "as ocio:ACEScct"
    )
