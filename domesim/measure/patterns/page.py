"""What goes with test patterns for people: a page to print, and tables to fill in."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from domesim.frames import ColourTag, Frame, Pixels
from domesim.frames.writing import encoded
from domesim.measure.patterns import Pattern
from domesim.measure.patterns.listing import Listed, PatternList
from domesim.readings.meter import EYES

READINGS, GREYS = "readings.csv", "grey-to-grey.csv"
"""Names of tables."""

THUMBNAIL = 160
"""Width, pixels."""

_COLUMNS = ("channel", "level", "X", "Y", "Z", "note")
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
    "patch": "Patches",
    "registration": "Registration",
}


class _Row(NamedTuple):
    entry: Listed
    thumbnails: list[str]


def page(patterns: Sequence[Pattern], listed: PatternList) -> str:
    """The page: self-contained HTML.

    Parameters
    ----------
    patterns
        What to draw small, in the order of the list.
    listed
        What the files are.
    """
    import jinja2  # noqa: PLC0415 - slow to import

    folder = files("domesim.measure.patterns")
    source = folder.joinpath("patterns.html.j2").read_text()
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    cols, rows = listed.size
    small = (max(round(THUMBNAIL * rows / cols), 2), THUMBNAIL)
    drawn = (
        _Row(entry, [_thumbnail(view) for view in pattern.codes(*small)])
        for pattern, entry in zip(patterns, listed.patterns, strict=True)
    )
    groups = [
        {"heading": heading, "rows": list(group)}
        for heading, group in groupby(drawn, lambda row: _HEADINGS[row.entry.kind])
    ]
    return environment.from_string(source).render(listed=listed, groups=groups, small=small)


def tables(listed: PatternList) -> Mapping[str, str]:
    """Files' names -> CSV tables for a meter's readings, without the readings."""
    if listed.display == "dome":
        return {READINGS: _csv(_COLUMNS, map(_reading, _read(listed)))}
    through = [
        {**_reading(each), "projector": projector, "filter": eye}
        for eye in EYES
        for projector in EYES
        for each in _read(listed)
        if each.parameters.get("projector", projector) == projector
        and (each.kind != "ramp" or projector == eye)
    ]
    greys = [
        {
            "filter": eye,
            "own_level": each.parameters[f"{eye}_level"],
            "other_level": each.parameters[f"{other}_level"],
            "note": each.name,
        }
        for eye, other in zip(EYES, reversed(EYES), strict=True)
        for each in _greys(listed)
    ]
    return {
        READINGS: _csv(("projector", "filter", *_COLUMNS), through),
        GREYS: _csv(("filter", "own_level", "other_level", "Y", "note"), greys),
    }


def _read(listed: PatternList) -> list[Listed]:
    """Patterns that a table of readings has rows for."""
    return [each for each in listed.patterns if "channel" in each.parameters]


def _greys(listed: PatternList) -> list[Listed]:
    black = next(each for each in listed.patterns if each.kind == "black")
    both = {"left_level": 0.0, "right_level": 0.0}
    first = Listed(**{**vars(black), "parameters": both})
    return [first, *(each for each in listed.patterns if each.kind == "grey to grey")]


def _reading(each: Listed) -> dict[str, Any]:
    return {
        "channel": each.parameters["channel"],
        "level": each.parameters["level"],
        "note": each.name,
    }


def _csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _thumbnail(view: Pixels) -> str:
    """A data URL."""
    colour = ColourTag("srgb", "BT.709", "a thumbnail")
    path = Path("thumbnail.png")
    frame = Frame(np.clip(view, 0, 1), path, colour, 8, floating=False)
    return f"data:image/png;base64,{base64.b64encode(encoded(frame, path, 8)).decode('ascii')}"
