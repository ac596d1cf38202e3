"""Crosstalk from luminance alone: one share for all primaries.

Through the glass of one eye, with black subtracted, white of the other projector over that of the
own one is Woods' system crosstalk (`domesim.readings.crosstalk`). How it differs between primaries,
luminance of white does not tell.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.readings.crosstalk import BRIGHTEST_LEAK
from domesim.readings.meter import CHANNELS, EYES, light_of
from domesim.readings.noise import Noise, estimated_noise, note_odd_repeats, with_digits
from domesim.readings.response import SIGMAS
from domesim.readings.tables import Table, read_table

Floats = NDArray[np.float64]

LUMINANCES = ("Lv", "fL", "Y")


@final
@dataclass(frozen=True)
class Share:
    """What one eye sees of the other's white.

    Parameters
    ----------
    eye
        The eye that sees: left or right.
    share, error
        Of its own white, and its standard error.
    white, black
        What it sees of its own white, without black, and of black, cd/m².
    """

    eye: str
    share: float
    error: float
    white: float
    black: float

    def report(self) -> str:
        """A line for a person."""
        return (
            f"crosstalk to the {self.eye} eye: system {self.share:.2%} ± {self.error:.2%}; own "
            f"white {decimal(self.white, 4)} cd/m², black {decimal(self.black)} cd/m²"
        )


@final
@dataclass(frozen=True)
class LuminanceReadings:
    """Both eyes' shares, the noise of a reading, and how many rows were not filled in."""

    shares: tuple[Share, Share]
    noise: Noise
    unread: int


def luminance_alone(path: Path) -> Table | None:
    """Returns a table of readings if luminance is all that stands in it; else None.

    A table for X, Y and Z of which only Y was filled in is one, too.
    """
    if path.suffix.lower() != ".csv":
        return None
    table = read_table(path)
    light = {"X", "Z", "x", "y", *LUMINANCES}
    written = {name for row in table.rows for name in row.cells}
    told = light & written or light & table.columns
    if not told or not told <= set(LUMINANCES) or "own_level" in table.columns:
        return None
    return table


def measured_shares(table: Table) -> LuminanceReadings:
    """Crosstalk to both eyes.

    Parameters
    ----------
    table
        Columns projector, filter, channel (K and W count) and Lv, fL or Y.

    Raises
    ------
    InputError
        With all that is missing or wrong.
    """
    light = next(
        (name for name in LUMINANCES if any(name in row.cells for row in table.rows)), "Lv"
    )
    wanted = ("projector", "filter", "channel", light)
    table.require((*wanted, "level", "note", "X", "Y", "Z"), wanted)
    table.mistakes.raise_any()
    rows = table.filled((light,))
    read: dict[tuple[str, str], list[tuple[int, Floats]]] = defaultdict(list)
    for row in rows:
        projector = table.word(row, "projector", EYES)
        eye = table.word(row, "filter", EYES)
        channel = table.word(row, "channel", CHANNELS)
        value = light_of(table, row, (light,))
        full = str(row.cells.get("level", "1.0")) in ("1", "1.0", "0", "0.0")
        if projector and eye and value is not None and channel in ("K", "W") and full:
            read[eye, "K" if channel == "K" else projector].append((row.line, value))
    for eye in EYES:
        for shown in ("K", *EYES):
            if (eye, shown) not in read:
                table.mistakes.add(0, f"no reading of {_told(eye, shown)}; read it")
    table.mistakes.raise_any()
    values = {of: np.array([value for _, value in each]) for of, each in read.items()}
    noise = with_digits(estimated_noise(values.values(), Noise()), table, rows, (light,))
    note_odd_repeats(((_told(*of), each) for of, each in read.items()), noise, table.mistakes)
    table.mistakes.raise_any()
    left, right = (_share(table, eye, values, noise) for eye in EYES)
    return LuminanceReadings((left, right), noise, len(table.rows) - len(rows))


def _told(eye: str, shown: str) -> str:
    what = "black (K)" if shown == "K" else f"white (W) of the {shown} projector"
    return f"{what} through the {eye} filter"


def _share(table: Table, eye: str, read: Mapping[tuple[str, str], Floats], noise: Noise) -> Share:
    other = EYES[1 - EYES.index(eye)]
    (own, own_variance), (leak, leak_variance), (black, black_variance) = (
        _mean(read[eye, shown], noise) for shown in (eye, other, "K")
    )
    white = own - black
    where = f"{table.mistakes.source}: crosstalk to the {eye} eye"
    if not white > 0:
        raise InputError(f"{where}: own white must be brighter than black, got {decimal(own)}")
    share = (leak - black) / white
    if share > BRIGHTEST_LEAK:
        raise InputError(
            f"{where}: the other projector must be much dimmer than the own one through this "
            f"filter, got {share:.0%} of it; were the filters or the projectors exchanged?"
        )
    variance = leak_variance + share**2 * own_variance + (1 - share) ** 2 * black_variance
    error = float(np.sqrt(variance)) / white
    if share < -SIGMAS * error:
        raise InputError(
            f"{where}: the other projector's white must be brighter than black, got "
            f"{share:.2%} of the own white; was black read under other light?"
        )
    return Share(eye, max(share, 0.0), error, white, black)


def _mean(values: Floats, noise: Noise) -> tuple[float, float]:
    mean = np.mean(values)
    return float(mean), float(noise.variance(np.array(mean), len(values)))
