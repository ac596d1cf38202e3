"""Tables of ArgyllCMS (``.ti3``), as its ``dispread`` writes them, as tables of readings.

CGATS.17 text: keywords with quoted values, the columns' names between BEGIN_DATA_FORMAT and
END_DATA_FORMAT, rows between BEGIN_DATA and END_DATA; of several tables the first one is meant.
RGB_R, RGB_G, RGB_B are code values in percent. XYZ_X, XYZ_Y, XYZ_Z are normalised so that white has
Y = 100, unless NORMALIZED_TO_Y_100 says NO; the second number of LUMINANCE_XYZ_CDM2 is white's
luminance in cd/m² (ArgyllCMS documentation, *File formats: .ti3*, and its profile/colprof.c).

Black (K), greys (W) and single primaries (R, G, B) become readings. Mixed colours have no place
among these: they are left out and counted.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping, Sequence

import numpy as np

from domesim.errors import InputError
from domesim.readings.tables import Mistakes, Row, Table, refuse_decimal_comma

AGREEMENT = 0.05
"""Share by which a reading of white may miss what the header says of it: drift."""

_RGB, _XYZ = ("RGB_R", "RGB_G", "RGB_B"), ("XYZ_X", "XYZ_Y", "XYZ_Z")
_TOKENS = re.compile(r'"[^"]*"|\S+')
_Line = tuple[int, list[str]]


def ti3_table(text: str, mistakes: Mistakes) -> Table:
    """The table of a ``.ti3`` file, with columns channel, level, X, Y and Z (cd/m²).

    Parameters
    ----------
    text
        The file's.
    mistakes
        Takes what is wrong with single rows.

    Raises
    ------
    InputError
        If it is another kind of file, is cut off, lacks columns, or does not tell cd/m².
    """
    source = mistakes.source
    lines = [
        (number, _TOKENS.findall(line))
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    kind = lines[0][1][0] if lines else "nothing"
    if kind != "CTI3":
        raise InputError(
            f"{source}: a .ti3 table begins with CTI3, got {reprlib.repr(kind)}; name the file "
            f"that dispread wrote"
        )
    header, columns, rows = _parts(source, lines)
    device = header.get("DEVICE_CLASS", "DISPLAY")
    if device != "DISPLAY":
        raise InputError(f"{source}: wanted readings of a DISPLAY, got those of a {device}")
    names = [name for _, tokens in columns for name in tokens]
    missing = [name for name in (*_RGB, *_XYZ) if name not in names]
    if missing:
        raise InputError(
            f"{source}: columns {', '.join(missing)} are missing; got {', '.join(names)}"
        )
    stated = header.get("NUMBER_OF_SETS", "")
    if stated.isdecimal() and int(stated) != len(rows):
        raise InputError(
            f"{source}: NUMBER_OF_SETS says {stated} rows, got {len(rows)}; copy the file again"
        )
    for line, tokens in rows:
        refuse_decimal_comma(source, line, tokens)
    scale = _scale(source, header)
    readings, left_out, brightest = [], 0, 0.0
    for line, tokens in rows:
        if len(tokens) != len(names):
            mistakes.add(line, f"must have {len(names)} cells, got {len(tokens)}")
            continue
        cells = dict(zip(names, tokens, strict=True))
        row = Row(line, cells)
        levels = _levels(cells, line, mistakes)
        if levels is None:
            continue
        brightest = max(brightest, *levels)
        channel = _channel(levels)
        if channel is None:
            left_out += 1
            continue
        xyz = {name[-1]: _scaled(cells[name], scale) for name in _XYZ}
        _note_white(row, channel, levels, header, scale, mistakes)
        readings.append(Row(line, {"channel": channel, "level": max(levels), **xyz}))
    if rows and brightest <= 0.01:
        mistakes.add(0, f"RGB must be in percent, got at most {100 * brightest:g}; multiply by 100")
    given = frozenset(("channel", "level", *"XYZ"))
    return Table(tuple(readings), given, columns[0][0], {}, mistakes, left_out)


def _levels(cells: Mapping[str, str], line: int, mistakes: Mistakes) -> list[float] | None:
    """R, G and B of a row, 0..1; None if one of them is none."""
    levels = []
    for name in _RGB:
        value = _number(cells[name])
        if value is not None and 0 <= value <= 100:
            levels.append(value / 100)
        else:
            mistakes.add(line, f"{name} must be 0 to 100 (percent), got {cells[name]}")
    return levels if len(levels) == len(_RGB) else None


def _parts(source: str, lines: Sequence[_Line]) -> tuple[dict[str, str], list[_Line], list[_Line]]:
    """Keywords, the lines of column names, and the rows of the first table."""
    header: dict[str, str] = {}
    inside: dict[str, list[_Line]] = {"DATA_FORMAT": [], "DATA": []}
    part = None
    for number, tokens in lines[1:]:
        first = tokens[0]
        if first in ("BEGIN_DATA_FORMAT", "BEGIN_DATA"):
            part = first.removeprefix("BEGIN_")
        elif first == f"END_{part}":
            if part == "DATA":
                return header, inside["DATA_FORMAT"], inside["DATA"]
            part = None
        elif part is not None:
            inside[part].append((number, tokens))
        elif len(tokens) > 1:
            header[first] = tokens[1].strip('"')
    wanted = "BEGIN_DATA" if part is None else f"END_{part}"
    raise InputError(
        f"{source}: line {lines[-1][0]}: the file ends before {wanted}; copy it again, or let "
        f"dispread finish"
    )


def _scale(source: str, header: dict[str, str]) -> float:
    """cd/m² of one unit of the table."""
    if header.get("NORMALIZED_TO_Y_100") == "NO":
        return 1.0
    stated = header.get("LUMINANCE_XYZ_CDM2")
    if stated is None:
        raise InputError(
            f"{source}: XYZ are relative to white, and no LUMINANCE_XYZ_CDM2 tells its cd/m²; read "
            f'white once more, and add the line LUMINANCE_XYZ_CDM2 "X Y Z"'
        )
    xyz = [_number(part) for part in stated.split()]
    y = xyz[1] if len(xyz) == 3 else None
    if y is None or not y > 0:
        raise InputError(
            f"{source}: LUMINANCE_XYZ_CDM2 must be three numbers above 0 in cd/m², got {stated!r}"
        )
    return y / 100


def _channel(levels: Sequence[float]) -> str | None:
    lit = [channel for channel, level in zip("RGB", levels, strict=True) if level > 0]
    if not lit:
        return "K"
    if len(lit) == 1:
        return lit[0]
    return "W" if min(levels) == max(levels) else None


def _note_white(
    row: Row,
    channel: str,
    levels: Sequence[float],
    header: dict[str, str],
    scale: float,
    mistakes: Mistakes,
) -> None:
    """The reading of white must have the luminance that the header says."""
    luminance = header.get("LUMINANCE_XYZ_CDM2", "").split()
    wanted = _number(luminance[1]) if len(luminance) == 3 else None
    got = _number(row.cells["XYZ_Y"])
    if channel != "W" or max(levels) < 1 or wanted is None or got is None:
        return
    if not abs(got * scale - wanted) <= AGREEMENT * wanted:
        mistakes.add(
            row.line,
            f"XYZ_Y of white must be {wanted / scale:g}, as the header says (white {wanted:g} "
            f"cd/m²), got {got:g}; are units mixed?",
        )


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _scaled(text: str, scale: float) -> float | str:
    """In cd/m²; what is no number stays as it is, for the one who reads the row."""
    value = _number(text)
    return text if value is None else value * scale
