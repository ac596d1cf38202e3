"""Noise of a meter: how far one reading may be from the mean of many.

    sigma² = (relative x)² + absolute²

for each of X, Y, Z on its own. Repeats of a reading tell both terms, by maximum likelihood: a
sample variance s² of n repeats has -2 log L = (n - 1) (log sigma² + s²/sigma²). Few repeats tell
too little, and then a stated figure stands in. An error that all readings share (the meter's
calibration) is not in it, and cancels in ratios such as crosstalk.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.light.ties import ascending
from domesim.readings.tables import Mistakes, Row, Table

Floats = NDArray[np.float64]

MIN_FREEDOM = 20
"""Degrees of freedom of repeats (X, Y and Z count each) below which the stated figure is used."""
_ODD = 8.0
"""Standard deviations of a reading from which one does not repeat the others: 8 % of light, if
nothing else is known."""
_SURE = 1e-4
"""Where two searches end in the same minimum, their ends differ by less."""


@final
@dataclass(frozen=True)
class Noise:
    """Standard deviation of one reading.

    Parameters
    ----------
    relative
        Part that grows with the light, as a share of it.
    absolute
        Part that does not, cd/m².
    origin
        Where the figures come from, in words.

    Raises
    ------
    InputError
        If the relative one is below 0, or the absolute one not above.
    """

    relative: float = 0.01
    absolute: float = 0.001
    origin: str = "stated, not measured"

    def __post_init__(self) -> None:
        if not (0 <= self.relative < np.inf and 0 < self.absolute < np.inf):
            raise InputError(
                f"noise of a reading must have a relative part of at least 0 and an absolute one "
                f"above 0 cd/m², got {self.relative:g} and {self.absolute:g}"
            )

    def variance(self, xyz: Floats, repeats: int = 1) -> Floats:
        """(..., 3) variance of the mean of `repeats` readings around `xyz`, (cd/m²)²."""
        return np.asarray(((self.relative * xyz) ** 2 + self.absolute**2) / repeats)


def estimated_noise(repeats: Iterable[Floats], stated: Noise) -> Noise:
    """Estimates noise from repeats; takes the `stated` one where they are too few.

    Parameters
    ----------
    repeats
        (repeat, channel) of each thing that was read more than once: XYZ or luminance, cd/m².
    stated
        What stands in below `MIN_FREEDOM`.
    """
    groups = [group for group in repeats if len(group) > 1]
    if not groups:
        return stated
    freedom = np.concatenate([np.full(group.shape[1], len(group) - 1) for group in groups])
    mean = np.concatenate([group.mean(axis=0) for group in groups])
    spread = np.concatenate([group.var(axis=0, ddof=1) for group in groups])
    # Readings that repeat to the last digit tell the digit, not the noise.
    if freedom.sum() < MIN_FREEDOM or not spread.any():
        return stated

    def unlikelihood(logs: Floats) -> float:
        variance = (np.exp(logs[0]) * mean) ** 2 + np.exp(2 * logs[1])
        return float(np.sum(freedom * (np.log(variance) + spread / variance)))

    scale = float(np.sqrt(np.sum(spread * freedom) / np.sum(mean**2 * freedom)))
    dark = float(np.sqrt(np.median(spread))) + 1e-12
    starts = [[np.log(scale), np.log(dark)], [np.log(scale), np.log(dark) - 5]]
    tries = [
        minimize(unlikelihood, start, method="Nelder-Mead", options={"fatol": _SURE})
        for start in starts
    ]
    best = tries[ascending([float(trial.fun) for trial in tries], _SURE)[0]].x
    relative, absolute = (max(float(value), 1e-12) for value in np.exp(best))
    count = int(freedom.sum())
    return Noise(relative, absolute, f"from repeated readings, {count} degrees of freedom")


def note_odd_repeats(
    repeats: Iterable[tuple[str, Sequence[tuple[int, Floats]]]], noise: Noise, mistakes: Mistakes
) -> None:
    """Notes repeats that are no repeats: too far from the median of all of them.

    Parameters
    ----------
    repeats
        Of each thing that was read: what it is, and line and values (channel,) of each time.
    noise
        Noise of one reading.
    mistakes
        Where they are noted, with their lines.
    """
    for what, group in repeats:
        values = np.array([value for _, value in group])
        middle = np.median(values, axis=0)
        apart = np.abs(values - middle) / np.sqrt(noise.variance(middle))
        for (line, _), value, off in zip(group, values, apart, strict=True):
            if off.max() > _ODD:
                channel = int(off.argmax())
                mistakes.add(
                    line,
                    f"{what} must repeat what was read of it, about "
                    f"{decimal(float(middle[channel]))}, got {decimal(float(value[channel]))}; "
                    f"read it again, or delete the wrong row",
                )


def with_digits(noise: Noise, table: Table, rows: Sequence[Row], columns: Sequence[str]) -> Noise:
    """Noise, and the half digit that a meter's display leaves out.

    Parameters
    ----------
    noise
        Noise of one reading.
    table, rows
        Where readings are written.
    columns
        The columns of light; the last digit of each column is its finest.
    """
    steps = [min(_step(row.cells[name]) for row in rows if name in row.cells) for name in columns]
    return replace(noise, absolute=float(np.hypot(noise.absolute, max(steps) / np.sqrt(12))))


def _step(written: object) -> float:
    """Step of the last digit of a number."""
    digits, _, decimals = str(written).strip().lower().partition(".")
    return 0.0 if "e" in digits + decimals else float(10.0 ** -len(decimals))
