"""What goes with test patterns for people: a page to print."""

from __future__ import annotations

import base64
import csv
from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from domesim.frames import ColourTag, Frame, Pixels
from domesim.frames.writing import encoded
from domesim.measure.patterns import Pattern
from domesim.measure.patterns.listing import Listed, PatternList
from domesim.measure.patterns.sheets import DOME, METERS, READINGS, WORDS, Sheet

THUMBNAIL = 160
"""Width, pixels."""

_HEADINGS = {
    "black": "Black",
    "white": "White and primaries",
    "primary": "White and primaries",
    "ramp": "Ramps",
    "grey to grey": "Pairs of greys",
    "half": "Halves",
    "sector": "Sectors and rings",
    "ring": "Sectors and rings",
    "checkerboard": "Checkerboards",
    "shifted": "Shifted checkerboards",
    "patch": "Patches",
    "registration": "Registration",
}


_NOT_LIGHT = ("pattern", "place", "note")


class _Row(NamedTuple):
    entry: Listed
    thumbnails: list[str]


def page(
    patterns: Sequence[Pattern],
    listed: PatternList,
    sheet: Sheet,
    blanks: Mapping[str, str],
    *,
    folder: str,
    theatre: str,
) -> str:
    """The page: self-contained HTML.

    Parameters
    ----------
    patterns
        What to draw small, in the order of the list.
    listed
        What the files are.
    sheet, blanks
        For which instrument, and what is to be filled in.
    folder, theatre
        As for `Sheet.command`, which is what is typed when that is done.
    """
    import jinja2  # noqa: PLC0415 - slow to import

    source = files("domesim.measure.patterns").joinpath("patterns.html.j2").read_text()
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    cols, rows = listed.size
    small = (max(round(THUMBNAIL * rows / cols), 2), THUMBNAIL)
    drawn = [
        _Row(entry, [_thumbnail(view) for view in pattern.codes(*small)])
        for pattern, entry in zip(patterns, listed.patterns, strict=True)
    ]
    by_name = {row.entry.name: row for row in drawn}
    places = list(csv.DictReader(blanks.get(DOME, "").splitlines()))
    light = [name for name in (places[0] if places else ()) if name not in _NOT_LIGHT]
    read = [(by_name[each["pattern"]], each["place"]) for each in places]
    groups = [
        {"heading": heading, "rows": list(group)}
        for heading, group in groupby(drawn, lambda row: _HEADINGS[row.entry.kind])
    ]
    return environment.from_string(source).render(
        listed=listed, groups=groups, small=small, sheet=sheet, words=WORDS, files=[*blanks],
        read=read, light=light, columns=_columns(sheet),
        command=sheet.command(folder, theatre), folder=folder,
    )  # fmt: skip


def _columns(sheet: Sheet) -> tuple[str, ...]:
    """What is written down by hand beside each pattern."""
    if sheet.instrument == "eye" or (DOME in sheet.names and READINGS not in sheet.names):
        return ()
    time = () if sheet.instrument in METERS else ("Time, s",)
    if sheet.instrument == "dslr":
        return time
    return (*time, *("XYZ" if sheet.dome else ("Y, left glass", "Y, right glass")))


def _thumbnail(view: Pixels) -> str:
    """A data URL."""
    colour = ColourTag("srgb", "BT.709", "a thumbnail")
    path = Path("thumbnail.png")
    frame = Frame(np.clip(view, 0, 1), path, colour, 8, floating=False)
    return f"data:image/png;base64,{base64.b64encode(encoded(frame, path, 8)).decode('ascii')}"
