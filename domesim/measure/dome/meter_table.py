"""A meter's table of a dome: what it said of a place, under a pattern.

Columns of the file (CSV, see `domesim.readings.tables`):

    pattern     half-front, ...         as ``domesim measure patterns --dome`` names it
    place       middle                  a lux meter in the middle, facing the dome's zenith
                front, right, ...       of the screen, half way up; a lux meter lies on it
    lux, Ev     lux                     what arrives; or
    Lv, Y       cd/m²                   luminance; or
    fL                                  the same in foot-lamberts
    x, y                                chromaticity, beside luminance
    X, Y, Z     cd/m²
    note                                anything

Rows of the same pattern and place are repeats. Rows without light were not read.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.measure.patterns import Codes, Pattern
from domesim.measure.patterns.dome import dome_patterns
from domesim.readings.meter import light_of
from domesim.readings.noise import Noise, estimated_noise, note_odd_repeats, with_digits
from domesim.readings.tables import Row, Table, read_table
from domesim.room.dome import Dome
from domesim.scene import DomeScene

Floats = NDArray[np.float64]

MIDDLE = "middle"
SIDES = {"right": 0.0, "front": 90.0, "left": 180.0, "back": 270.0}
"""Place on the screen -> its azimuth, degrees."""
PLACES = (MIDDLE, *SIDES)

_FULL = Codes(8, floating=False, transfer="srgb")
_FEWEST = 4  # levels of ramps, which no meter's table has


@final
@dataclass(frozen=True, eq=False)
class Reading:
    """One row: what a meter said.

    Parameters
    ----------
    pattern, place
        What was projected, and one of `PLACES`.
    lux
        Whether what arrives was read, in lux.
    value
        (channel,) XYZ, or the luminance or illuminance alone; cd/m² or lux.
    line
        Its line in the file.
    """

    pattern: str
    place: str
    lux: bool
    value: Floats
    line: int


@final
@dataclass(frozen=True, eq=False)
class MeterTask:
    """A table of readings with the theatre that they are of.

    Attributes
    ----------
    source
        The table, for messages.
    scene, content
        The theatre, and its file as it is written.
    readings
        What was read; all of one kind of meter.
    noise
        Noise of one reading, half a digit included.
    unread
        How many rows were not filled in.
    digests
        File -> SHA-256.
    """

    source: Path
    scene: DomeScene
    content: Mapping[str, Any]
    readings: tuple[Reading, ...]
    noise: Noise
    unread: int
    digests: Mapping[str, str]

    absolute = True
    """Readings are in cd/m² or lux."""


def read_meter_task(path: Path, scene: DomeScene, content: Mapping[str, Any]) -> MeterTask:
    """Reads a table of a meter's readings in a dome (see ``domesim measure patterns --with``).

    Parameters
    ----------
    path
        A ``.csv`` file with columns pattern, place and lux or Ev; or pattern, place and Lv, Y or
        fL, with x and y or without; or pattern, place, X, Y and Z.
    scene, content
        The theatre, and its file as it is written.

    Raises
    ------
    InputError
        With all mistakes of the table, each with its line.
    """
    table = read_table(path)
    light = _light_columns(table)
    table.require(("pattern", "place", *light, "note"), ("pattern", "place", *light))
    table.mistakes.raise_any()
    known = patterns_of(scene.dome)
    filled = table.filled(light)
    readings = [one for row in filled if (one := _reading(table, row, light, known))]
    table.mistakes.raise_any()
    read = [name for name in light if name not in ("x", "y")]
    repeats = _repeats(readings)
    alone = [np.array([value for _, value in each]) for each in repeats.values()]
    noise = with_digits(estimated_noise(alone, Noise()), table, filled, read)
    note_odd_repeats(repeats.items(), noise, table.mistakes)
    table.mistakes.raise_any()
    return MeterTask(
        path,
        scene,
        content,
        tuple(readings),
        noise,
        len(table.rows) - len(filled),
        {path.name: hashlib.sha256(path.read_bytes()).hexdigest()},
    )


@lru_cache(maxsize=1)
def patterns_of(dome: Dome) -> Mapping[str, Pattern]:
    """Name -> pattern of full light, of a dome's."""
    made = dome_patterns(dome, _FULL, _FEWEST)
    return {each.name: each for each in made if each.kind not in ("ramp", "registration")}


def _light_columns(table: Table) -> tuple[str, ...]:
    """Columns of a reading's light."""
    single = next((name for name in ("lux", "Ev", "Lv", "fL") if name in table.columns), None)
    if single in ("lux", "Ev"):
        return (single,)
    if {"x", "y"} <= table.columns:
        return single or "Y", "x", "y"
    return ("X", "Y", "Z") if {"X", "Z"} & table.columns else (single or "Y",)


def _reading(
    table: Table, row: Row, light: Sequence[str], known: Mapping[str, Pattern]
) -> Reading | None:
    place = table.word(row, "place", PLACES)
    name = str(row.cells.get("pattern", "")).strip()
    lux = light[0] in ("lux", "Ev")
    value = light_of(table, row, light)
    if name not in known:
        near = difflib.get_close_matches(name, known, 1) or ["half-front"]
        table.mistakes.add(
            row.line, f"pattern must be one of full light, such as {near[0]}, got {name!r}"
        )
        return None
    if place == MIDDLE and not lux:
        table.mistakes.add(
            row.line,
            f"place must be on the screen ({', '.join(SIDES)}) where luminance is read, got middle",
        )
        return None
    return None if place is None or value is None else Reading(name, place, lux, value, row.line)


def _repeats(readings: Sequence[Reading]) -> Mapping[str, Sequence[tuple[int, Floats]]]:
    """What was read -> lines and values of each time."""
    groups: dict[str, list[tuple[int, Floats]]] = {}
    for one in readings:
        groups.setdefault(f"{one.pattern} at {one.place}", []).append((one.line, one.value))
    return groups
