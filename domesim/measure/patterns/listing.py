"""The list that goes with the files of test patterns: which file shows what, for programs.

``patterns.json`` holds

    format      "domesim patterns 1"
    display     dome or stereo
    size        [cols, rows] of each picture
    encoding    transfer, primaries, bits, floating: what the code values are
    dome        half_angle_deg and tilt_deg, of a dome
    patterns    a list; each has number, name, kind, files (one for each view), lit (in words),
                colours (for each view R, G, B code values of what is lit, 0..1), lit_area_share
                (for each view), and parameters

Parameters of a pattern: channel, level (code value, 0..1) and projector, as in a table of readings
(`domesim.readings.meter`), left_level and right_level, and places on the screen. On a dome
azimuth_deg runs from the audience's right over the front, angle_deg from the dome's zenith; markers
have their row and col, too. On a flat screen x and y are shares of the picture's width and height.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.files import read_plain

FORMAT = "domesim patterns 1"
NAME = "patterns.json"


@final
@dataclass(frozen=True)
class Listed:
    """One pattern of a list; see the module's docstring.

    Parameters
    ----------
    number
        From 1, in the order of projection.
    name, kind, lit
        As `domesim.measure.patterns.Pattern` has them.
    files
        One for each view, seen from the list's folder.
    colours
        (view,) R, G, B code values.
    lit_area_share
        (view,) share of the screen's area.
    parameters
        Plain JSON.
    """

    number: int
    name: str
    kind: str
    lit: str
    files: tuple[str, ...]
    colours: tuple[tuple[float, float, float], ...]
    lit_area_share: tuple[float, ...]
    parameters: Mapping[str, Any]


@final
@dataclass(frozen=True)
class PatternList:
    """All patterns of a folder; see the module's docstring."""

    display: str
    size: tuple[int, int]
    encoding: Mapping[str, Any]
    dome: Mapping[str, float] | None
    patterns: tuple[Listed, ...]

    def write(self, folder: Path) -> Path:
        """Write the list into `folder`, whole or not at all.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        content = {
            "format": FORMAT,
            "display": self.display,
            "size": self.size,
            "encoding": self.encoding,
            "dome": self.dome,
            "patterns": [vars(each) for each in self.patterns],
        }
        path = folder / NAME
        write_whole(path, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())
        return path


def read_patterns(folder: Path) -> PatternList:
    """The list of a folder of patterns.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    path = folder / NAME
    try:
        content = json.loads(read_plain(path))
        if content["format"] != FORMAT:
            raise ValueError(content["format"])
        patterns = tuple(
            Listed(
                **{
                    **each,
                    "files": tuple(each["files"]),
                    "colours": tuple(tuple(colour) for colour in each["colours"]),
                    "lit_area_share": tuple(each["lit_area_share"]),
                }
            )
            for each in content["patterns"]
        )
        cols, rows = content["size"]
        return PatternList(
            content["display"], (cols, rows), content["encoding"], content["dome"], patterns
        )
    except OSError as error:
        raise InputError(
            f"{path}: wanted the list of 'domesim measure patterns', got '{error.strerror}'. Name "
            f"the folder that it wrote."
        ) from error
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: wanted the list of 'domesim measure patterns', this is damaged or another "
            f"file. Write the patterns again."
        ) from error
