"""When frames are shown: rate and timecode, as videos, EXRs and DPXs say them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError
from domesim.frames.frame import Frame
from domesim.frames.reading import attributes_of, opened
from domesim.frames.video import rate_and_timecode, video_of

USUAL_RATE = Fraction(24)
"""Frames a second where neither the master nor anybody says so."""
RATES = (1, 1000)
"""Frames a second that are plausible."""

_DROPPING = (Fraction(30000, 1001), Fraction(60000, 1001))


@final
@dataclass(frozen=True)
class Timing:
    """When a film's frames are shown.

    Parameters
    ----------
    rate
        Frames a second.
    timecode
        Timecode of the first frame, ``01:00:00:00``; "" for none.
    """

    rate: Fraction
    timecode: str = ""


def timing_of(path: Path, usual: Fraction = USUAL_RATE) -> Timing:
    """What a frame's file says; the `usual` rate where it says none."""
    if video_of(path) is not None:
        return Timing(*rate_and_timecode(path))
    with suppress(InputError):
        with opened(path) as (reader, form):
            stated = attributes_of(path, reader.spec(), form)
        rate, timecode = _told(stated, usual)
        return Timing(rate or usual, timecode)
    return Timing(usual)


def differing(left: Frame, right: Frame) -> str:
    """When two frames are shown, in words, if both say it and it differs; else ""."""
    told = []
    for frame in (left, right):
        if video_of(frame.path) is None:
            told.append(_told(frame.header.attributes))
        else:
            told.append(rate_and_timecode(frame.path))
    (rate, timecode), (other, later) = told
    if rate and other and rate != other:
        return f"{float(rate):g} and {float(other):g} frames a second"
    if timecode and later and timecode != later:
        return f"time codes {timecode} and {later}"
    return ""


def _told(
    stated: Iterable[tuple[str, str, Any]], usual: Fraction = USUAL_RATE
) -> tuple[Fraction | None, str]:
    attributes = {name: value for name, _, value in stated}
    rate = _rate(attributes)
    return rate, _timecode(attributes.get("smpte:TimeCode"), rate or usual)


def exact_rate(rate: float) -> Fraction:
    """The rate that is meant: 23.976 is 24000/1001."""
    whole = round(rate)
    slowed = Fraction(1000 * round(rate * 1.001), 1001)
    if rate != whole and abs(rate - slowed) < 0.01:
        return slowed
    return Fraction(rate).limit_denominator(1001)


def _rate(attributes: Mapping[str, Any]) -> Fraction | None:
    """An EXR's rate, or a DPX's: that of film goes before that of television."""
    stated = attributes.get("FramesPerSecond")
    if isinstance(stated, tuple) and min(stated) > 0:
        return Fraction(*stated)
    for name in ("dpx:FrameRate", "dpx:TemporalFrameRate"):
        rate = attributes.get(name, 0.0)
        if isfinite(rate) and RATES[0] <= rate <= RATES[1]:
            return exact_rate(rate)
    return None


def _timecode(stated: Any, rate: Fraction) -> str:
    """``01:02:03:04`` of SMPTE ST 12-1's digits, which lie between flags; "" if it is none."""
    if not isinstance(stated, tuple):
        return ""
    word = int(stated[0])
    masks = (0x3F, 0x7F, 0x7F, 0x3F)
    digits = [word >> shift & mask for shift, mask in zip((24, 16, 8, 0), masks, strict=True)]
    hours, minutes, seconds, frames = (10 * (each >> 4) + (each & 15) for each in digits)
    if hours > 23 or minutes > 59 or seconds > 59 or frames >= rate:
        return ""
    drops = bool(word & 0x40) and rate in _DROPPING
    return f"{hours:02}:{minutes:02}:{seconds:02}{';' if drops else ':'}{frames:02}"
