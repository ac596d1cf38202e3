"""What to project for each instrument, and the file to fill in: just what `measure` takes.

A sheet is for one instrument and one kind of screen. It has the patterns that this instrument
needs, and the files that are filled in: tables (CSV) of a meter, a survey (TOML) of a camera.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, final

from domesim.measure.patterns.listing import Listed, PatternList
from domesim.readings.meter import EYES

METERS = ("lux", "luminance", "colorimeter", "spectroradiometer")
INSTRUMENTS = (*METERS, "dslr", "eye")
WORDS = {
    "lux": "a lux meter",
    "luminance": "a luminance meter",
    "colorimeter": "a colorimeter",
    "spectroradiometer": "a spectroradiometer",
    "dslr": "a camera that saves raw files",
    "eye": "the eye",
}

READINGS, GREYS = "readings.csv", "grey-to-grey.csv"
"""Tables of a display: of its channels, and of pairs of greys."""
DOME = "dome.csv"
"""Table of a dome: of places in it, under patterns."""
SURVEY, PHOTOGRAPHS = "survey.toml", "photographs.toml"
"""Lists of photographs: of a dome, and of a 3D screen."""

_COLOURED = ("colorimeter", "spectroradiometer")
_REPEATED = 3
"""How often black and white are read."""
_SIDES = (("front", "back"), ("right", "left"), ("left", "right"))
"""Place that is read -> the half that leaves it dark."""
_PRIMARIES = ("red", "green", "blue")
_IN_THE_MIDDLE = ("ring-1", "ring-2", "ring-3")
_PHOTOGRAPHED = (
    "half-front", "half-right", "ring-1", "ring-3", "sector-060-120"
)  # fmt: skip
"""Besides black, white and the primaries, of a dome that is described."""
_COLOURS = ("X", "Y", "Z")
_CHANNEL = ("channel", "level", *_COLOURS, "note")


@final
@dataclass(frozen=True)
class Sheet:
    """What one instrument asks for.

    Parameters
    ----------
    instrument
        One of `INSTRUMENTS`; None for a colorimeter and a camera, and all patterns.
    dome
        Whether the screen is a dome.
    theatre
        The dome's scene, as seen from the folder of the patterns; None if it was not named.
    furnished
        Whether the dome holds more than screen, floor and wall.
    """

    instrument: str | None
    dome: bool
    theatre: str | None = None
    furnished: bool = False

    def wants(self, name: str, kind: str) -> bool:
        """Whether a pattern is to be shown."""
        if self.instrument is None or kind in ("registration", "black"):
            return True
        if self.instrument == "eye":
            return False
        if not self.dome:
            return self._wants_of_a_pair(name, kind)
        if self.instrument == "dslr":
            wide = kind in ("half", "ring", "sector") or name.startswith("checkerboard-4x2")
            parts = wide if self.furnished else name in _PHOTOGRAPHED
            return parts or kind in ("white", "primary", "shifted")
        coloured = self.instrument in _COLOURED
        rings = self.instrument == "lux" and name in _IN_THE_MIDDLE
        colours = coloured and kind in ("primary", "ramp")
        return kind in ("white", "half") or rings or colours

    def files(self, listed: PatternList) -> Mapping[str, str]:
        """Name -> content of the files to fill in.

        Parameters
        ----------
        listed
            The patterns that are shown.
        """
        return {name: make(listed) for name, make in self._makers().items()}

    @property
    def names(self) -> list[str]:
        """Names of the files to fill in."""
        return [*self._makers()]

    def _makers(self) -> dict[str, Callable[[PatternList], str]]:
        coloured = self.instrument in _COLOURED
        found: dict[str, Callable[[PatternList], str]] = {}
        if self.dome:
            if self.instrument == "dslr":
                found[SURVEY] = partial(_survey, theatre=self.theatre or "theatre.toml")
            if self.instrument in ("lux", "luminance") or coloured:
                found[DOME] = self._places
            if coloured or self.instrument is None:
                found[READINGS] = _channels
            return found
        if self.instrument == "dslr":
            found[PHOTOGRAPHS] = _photographs
        elif self.instrument == "luminance":
            found[READINGS] = _luminances_of_a_pair
        elif self.instrument != "eye":
            found[READINGS] = _channels_of_a_pair
        if self.instrument not in ("dslr", "eye"):
            found[GREYS] = _greys
        return found

    def command(self, folder: str, theatre: str) -> str:
        """What turns the filled-in files into a scene.

        Parameters
        ----------
        folder
            Where they are, with a slash.
        theatre
            The dome's scene, seen from where the command is typed.
        """
        out = "--out measured.toml"
        if self.instrument == "eye":
            return f"domesim measure by-eye --scene {theatre} --out by-eye"
        if self.instrument == "dslr":
            if not self.dome:
                return f"domesim measure crosstalk {folder}{PHOTOGRAPHS} {out}"
            alone = " --without-geometry" if self.furnished else ""
            return f"domesim measure dome {folder}{SURVEY}{alone} {out}"
        if not self.dome:
            return f"domesim measure crosstalk {folder}{READINGS} {out}"
        if self.instrument is None:
            return f"domesim measure response {folder}{READINGS}"
        return f"domesim measure dome {folder}{DOME} --scene {theatre} {out}"

    def _wants_of_a_pair(self, name: str, kind: str) -> bool:
        if self.instrument == "dslr":
            return kind in ("white", "primary") and name != "white-both"
        coloured = self.instrument in _COLOURED
        return kind in ("white", "grey to grey") or (coloured and kind in ("primary", "ramp"))

    def _places(self, _: PatternList) -> str:
        """The dome's table."""
        light = {"lux": ("lux",), "luminance": ("Lv",)}.get(self.instrument or "", _COLOURS)
        rows = []
        if self.instrument == "lux":
            rows += [("black", "middle"), ("white", "middle")] * _REPEATED
            rows += [(name, "middle") for name in _IN_THE_MIDDLE]
            rows += [(name, "front") for name in ("black", "white", "half-front", "half-back")]
        else:
            for side, other in _SIDES:
                rows += [(name, side) for name in ("black", "white", f"half-{side}")]
                rows.append((f"half-{other}", side))
            if len(light) > 1:
                rows += [(name, "front") for name in _PRIMARIES]
        places = [{"pattern": name, "place": place} for name, place in rows]
        return _csv(("pattern", "place", *light, "note"), places)


def _channels(listed: PatternList) -> str:
    return _csv(_CHANNEL, map(_reading, _read(listed)))


def _channels_of_a_pair(listed: PatternList) -> str:
    rows = [
        {**_reading(each), "projector": projector, "filter": eye}
        for eye in EYES
        for projector in EYES
        for each in _read(listed)
        if each.parameters.get("projector", projector) == projector
        and (each.kind != "ramp" or projector == eye)
    ]
    return _csv(("projector", "filter", *_CHANNEL), rows)


def _luminances_of_a_pair(_: PatternList) -> str:
    rows = [
        {"projector": projector, "filter": eye, "channel": channel, "note": name}
        for eye in EYES
        for projector, channel, name in (
            (eye, "K", "black"),
            *((each, "W", f"{each}-white") for each in EYES),
        )
        for _ in range(_REPEATED)
    ]
    return _csv(("projector", "filter", "channel", "Lv", "note"), rows)


def _greys(listed: PatternList) -> str:
    black = next(each for each in listed.patterns if each.kind == "black")
    both = {"left_level": 0.0, "right_level": 0.0}
    first = Listed(**{**vars(black), "parameters": both})
    pairs = [first, *(each for each in listed.patterns if each.kind == "grey to grey")]
    rows = [
        {
            "filter": eye,
            "own_level": each.parameters[f"{eye}_level"],
            "other_level": each.parameters[f"{other}_level"],
            "note": each.name,
        }
        for eye, other in zip(EYES, reversed(EYES), strict=True)
        for each in pairs
    ]
    return _csv(("filter", "own_level", "other_level", "Y", "note"), rows)


def _read(listed: PatternList) -> list[Listed]:
    """Patterns that a table of readings has rows for."""
    return [each for each in listed.patterns if "channel" in each.parameters]


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


def _survey(listed: PatternList, theatre: str) -> str:
    asked = [each for each in listed.patterns if each.kind not in ("registration", "primary")]
    shots = "".join(_shot(each) for each in asked if each.kind != "shifted")
    boards = "".join(_shot(each) for each in asked if each.kind == "shifted")
    later = "".join(f"# {line}\n" if line else "\n" for line in boards.splitlines())
    return f"""\
# Photographs of this folder, named as the patterns are; what a camera calls them after the point
# (.dng, .cr2, .nef, .arw, ...) is found. exposure: the time, s.
theatre = {_text(theatre)}
unit = "camera"

[camera]
mapping = "fisheye"           # or "perspective": an ordinary lens
# position_m = [0.0, 0.0, 0.0]  # of the lens, from the middle of the sphere: right, front, up
# look_at_m = [0.0, 1.0, 1.0]   # a point in the middle of the picture
# field_deg = 180.0             # across the circle; of an ordinary lens across the width
# circle_px = [1500, 1000, 980] # col, row, radius of the circle, if it touches no edge
registration = "registration"
patterns = "."

[colours]
black = {{ file = "black", exposure = 1.0 }}
red = {{ file = "red", exposure = 1.0 }}
green = {{ file = "green", exposure = 1.0 }}
blue = {{ file = "blue", exposure = 1.0 }}
{shots}
# For domesim measure reflected, which checks the scene in the room itself (measure dome leaves them
# out): take the # off if you photographed the shifted boards.
{later}"""


def _shot(each: Listed) -> str:
    return (
        f'\n[[photographs]]\nfile = "{each.name}"\npattern = {_text(each.files[0])}\n'
        "exposure = 1.0\n"
    )


def _photographs(_: PatternList) -> str:
    glasses = "".join(
        f"""
[photographs.{eye}]               # through the {eye} glass
black = "{eye}-glass-black"
left = "{eye}-glass-left-white"   # or {{ W = "...", R = "...", G = "...", B = "..." }}
right = "{eye}-glass-right-white"  # or a list of photographs
"""
        for eye in EYES
    )
    return f"""\
# Photographs of this folder; what a camera calls them after the point (.dng, .cr2, .nef, .arw, ...)
# is found.
[photographs]
# corners = [[102, 80], [1801, 92], [1795, 1010], [98, 1003]]
#   of the picture on the screen: col, row; from the top left, clockwise. Without them a photograph
#   shows nothing but the screen
encoding = "linear"
{glasses}
[projector]
# white_cd_m2 = 15.4          # through the glasses: a camera cannot know; assumed if not said
# black_cd_m2 = 0.01
# primaries = "P3-D65"
"""


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
