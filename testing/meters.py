"""Virtual meters in a dome and before a 3D screen: what they say, with their faults.

A dome is `ClosedFormDome`, observed: no code is shared with what is tested but that of patterns.
Its projector's light is uneven: random spherical harmonics up to degree 3, which is more than the
fit has. Lux is summed over the pictures that are seen.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np
import scipy.special
from numpy.typing import ArrayLike, NDArray

from domesim.measure.dome.meter_table import SIDES, patterns_of
from domesim.observation.spherical import ClosedFormDome
from domesim.readings.meter import EYES
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

SIZE = 128
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""XYZ of BT.709's primaries, of white's luminance."""
_BLACK = np.array([0.95, 1.0, 1.09])
_DEGREE = 3


@final
@dataclass(frozen=True)
class Faults:
    """How a meter and a projector are not what they should be.

    Parameters
    ----------
    noise, floor
        Standard deviation of a reading: share of it, and cd/m² or lux.
    uneven
        Rms of the projector's light over the screen.
    cosine
        Standard deviation of what a lux meter overrates light from the side by.
    digits
        Decimals that it shows.
    """

    noise: float = 0.01
    floor: float = 5e-4
    uneven: float = 0.05
    cosine: float = 0.03
    digits: int = 3


NONE = Faults(0.0, 0.0, 0.0, 0.0, 12)


@final
@dataclass(frozen=True, eq=False)
class Room:
    """A bare dome with a meter in it.

    Parameters
    ----------
    dome
        Its screen.
    albedo
        (primary,).
    white, black
        Direct light of a white picture, and light of a black one, cd/m².
    faults
        Of projector and meter.
    seed
        Of what is random.
    room
        Direct light (1, row, col, primary) -> what is seen of it; a bare dome's if None.
    """

    dome: Dome
    albedo: tuple[float, float, float]
    white: float
    black: float
    faults: Faults = NONE
    seed: int = 0
    room: Callable[[Floats], ArrayLike] | None = None

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    @cached_property
    def _sideways(self) -> float:
        """What this lux meter overrates light from the side by."""
        return float(self.faults.cosine * self._rng.standard_normal())

    @cached_property
    def _light(self) -> Floats:
        """(row, col) of the projector, 1 in the mean."""
        return 1 + self.faults.uneven * self._bumps()

    def says(self, pattern: str, place: str, *, lux: bool) -> Floats:
        """(XYZ,) of a reading, cd/m²; or of Y alone, lux."""
        true, black = self._in_the_middle(pattern) if lux and place == "middle" else (
            self._at_the_screen(pattern, place, lux=lux)
        )  # fmt: skip
        spread = np.hypot(self.faults.noise * (true + black), self.faults.floor)
        said = true + black + spread * self._rng.standard_normal(true.shape)
        return np.asarray(np.round(np.maximum(said, 0), self.faults.digits))

    def _in_the_middle(self, pattern: str) -> tuple[Floats, Floats]:
        arriving = self._seen(pattern) @ XYZ[1] * self._cosine
        return np.array([arriving.sum()]), np.array([self.black * self._cosine.sum()])

    def _at_the_screen(self, pattern: str, place: str, *, lux: bool) -> tuple[Floats, Floats]:
        azimuth, lean = np.radians(SIDES[place]), self.dome.half_angle / 2
        level = np.sin(lean)
        towards = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(lean)])
        at = self.dome.pixel_of(towards, SIZE)
        here = self._seen(pattern)[at]
        if not lux:
            return np.asarray(XYZ @ here), self.black * _BLACK
        share = np.pi / np.array(self.albedo)
        aside = self._sideways * self._picture(pattern)[at]
        black = self.black * np.pi / np.mean(self.albedo)
        return np.array([XYZ[1] @ ((here + aside) * share)]), np.array([black])

    def _picture(self, pattern: str) -> Floats:
        """(row, col, primary) direct light, cd/m²."""
        codes = patterns_of(self.dome)[pattern].codes(SIZE, SIZE)[0]
        return np.asarray(self.white * codes * self._light[..., None])

    def _seen(self, pattern: str) -> Floats:
        picture = self._picture(pattern)[None]
        room = self.room or ClosedFormDome(self.dome, SIZE, SIZE, albedo=self.albedo).observe
        seen: Floats = np.asarray(room(picture), np.float64)
        return np.asarray(seen[0])

    @cached_property
    def _cosine(self) -> Floats:
        """(row, col) what a lux meter in the middle weighs light by, sr."""
        cosine = np.maximum(self.dome.directions(SIZE, SIZE)[..., 2], 0)
        angles = self.dome.screen_areas(SIZE, SIZE) / self.dome.radius**2
        aside = 1 + self._sideways * (1 - cosine**2)
        return np.asarray(angles * cosine * aside)

    def _bumps(self) -> Floats:
        """(row, col) of mean 0 and about rms 1 over the screen."""
        x, y, z = np.moveaxis(self.dome.directions(SIZE, SIZE), -1, 0)
        polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
        weight = self.dome.screen_areas(SIZE, SIZE)
        found = np.zeros((SIZE, SIZE))
        for degree in range(1, _DEGREE + 1):
            for order in range(-degree, degree + 1):
                wave = scipy.special.sph_harm_y(degree, abs(order), polar, azimuth)
                real = wave.imag if order < 0 else wave.real
                found += self._rng.standard_normal() * real * (np.sqrt(2) if order else 1.0)
        found -= np.average(found, weights=weight)
        return np.asarray(found / np.sqrt(np.average(found**2, weights=weight)))


@final
@dataclass(frozen=True)
class Pair:
    """A 3D screen, and a luminance meter before it.

    Parameters
    ----------
    shares
        (eye,) what the left and the right eye see of the other's white, over their own.
    white, black
        Through a glass, cd/m².
    faults
        Of the meter.
    """

    shares: tuple[float, float]
    white: float
    black: float
    faults: Faults = NONE


def fill_pair(table: Path, pair: Pair, target: Path, seed: int = 0) -> None:
    """Writes what a luminance meter says into a 3D screen's table.

    Parameters
    ----------
    table, target
        As ``domesim measure patterns --stereo --with luminance`` wrote it, and filled in.
    pair
        The screen.
    seed
        Of the noise.
    """
    random, faults = np.random.default_rng(seed), pair.faults
    shares = dict(zip(EYES, pair.shares, strict=True))
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        own = row["projector"] == row["filter"]
        level = 0.0 if row["channel"] == "K" else 1.0 if own else shares[row["filter"]]
        true = pair.white * level + pair.black
        said = true + np.hypot(faults.noise * true, faults.floor) * random.standard_normal()
        row["Lv"] = f"{max(said, 0):.{faults.digits}f}"
    _write(target, rows)


def misread(table: Path, columns: Sequence[str], seed: int) -> None:
    """Makes one number of a filled-in table wrong: a lapse of whoever wrote it down.

    A decimal point that slipped, two digits exchanged, or another number of 1.1 to 3 times.

    Parameters
    ----------
    table
        The table; it is changed.
    columns
        The columns of light.
    seed
        Of what is random.
    """
    random = np.random.default_rng(seed)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    cells = [(row, name) for row in rows for name in columns if row.get(name)]
    row, name = cells[int(random.integers(len(cells)))]
    said, kind = row[name], int(random.integers(3))
    digits = [at for at, mark in enumerate(said[:-1]) if mark.isdigit() and said[at + 1].isdigit()]
    unlike = [at for at in digits if said[at] != said[at + 1]]
    if kind == 0:
        row[name] = f"{float(said) * random.choice((0.1, 10.0)):.6g}"
    elif kind == 1 and unlike:
        at = unlike[0]
        row[name] = said[:at] + said[at + 1] + said[at] + said[at + 2 :]
    else:
        times = float(np.exp(random.choice((-1, 1)) * random.uniform(np.log(1.1), np.log(3))))
        row[name] = f"{float(said) * times:.4f}"
    _write(table, rows)


def fill(table: Path, room: Room, target: Path, *, empty: Sequence[str] = ()) -> None:
    """Writes what a meter says into a dome's table.

    Parameters
    ----------
    table, target
        As ``domesim measure patterns`` wrote it, and filled in.
    room
        The dome.
    empty
        Places that were not read.
    """
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        if row["place"] in empty:
            continue
        lux = bool({"lux", "Ev"} & set(row))
        said = room.says(row["pattern"], row["place"], lux=lux)
        if lux:
            values = dict.fromkeys(("lux", "Ev"), float(said[0]))
        else:
            total = max(float(said.sum()), 1e-9)
            values = dict(zip("XYZ", said.tolist(), strict=True))
            values |= {"Lv": values["Y"], "fL": values["Y"] / 3.4262591}
            values |= {"x": values["X"] / total, "y": values["Y"] / total}
        row.update({name: f"{value:.{room.faults.digits}f}" for name, value in values.items()
                    if name in row})  # fmt: skip
    _write(target, rows)


def _write(target: Path, rows: Sequence[dict[str, str]]) -> None:
    with target.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
