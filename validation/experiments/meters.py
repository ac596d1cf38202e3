"""A meter alone tells a dome's white and albedo, or a 3D screen's crosstalk, and knows how surely.

Rationale
    `domesim measure dome` and `measure crosstalk` take the table of one meter's sheet. Made-up
    domes have an albedo of 0.2 to 0.7, a white of 4 to 30 cd/m², a contrast of 500 to 5000 : 1, and
    meters with noise of 1 % and three decimals. Their projectors are uneven by 5 % (rms), up to
    spherical harmonics of degree 3; a lux meter's cosine is off by 3 %. How uneven light is taken
    to be was chosen on other seeds than these. 3D screens leak 0.4 to 5 % and are read by a
    luminance meter. A person lapses, too: one number has its point in another place, two digits
    exchanged, or is 1.1 to 3 times what the meter said.
Expected
    Of 400 domes and 3D screens (quick: fewer) 93 to 97 % of the 95 % intervals of white, of green's
    albedo, and of crosstalk hold the truth, less what so few leave open: 92 to 98 %. Of tables with
    a lapse 90 % or more are refused with its line, or the answer is said not to fit, or is within 3
    standard errors (quick: 50 %).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import final

import numpy as np

from domesim.errors import InputError
from domesim.measure.dome.meter_table import read_meter_task
from domesim.measure.dome.meters import metered
from domesim.measure.patterns.listing import Listed, PatternList
from domesim.measure.patterns.sheets import DOME, READINGS, Sheet
from domesim.observation.uncertain import SIGMAS
from domesim.readings.luminance import luminance_alone, measured_shares
from domesim.scene import load_dome
from testing.meters import Faults, Pair, Room, fill, fill_pair, misread
from validation.experiment import Check, Column, Finding, Table, Work, at_least, between

SEEDS = 4000
"""Seeds from here on are reported; those before it were for choosing."""
QUICK, FULL = 6, 400
"""Domes and screens of each kind."""
LAPSES = (6, 60)
"""Tables with a lapse, of each kind: quick, full."""
DOMES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "lux": ("lux", ()),
    "lux in the middle": ("lux", ("front",)),
    "luminance": ("luminance", ()),
    "colorimeter": ("colorimeter", ()),
}
"""Whose sheet is filled in for a dome, and which places are left empty."""
PAIR = "luminance, 3D screen"
SCENE = "dome_hemisphere"
_GREEN = 1
_LIGHT = ("lux", "Lv", "X", "Y", "Z")


@final
@dataclass(frozen=True)
class Found:
    """What was found of one dome: white and green's albedo; of a 3D screen: both eyes' crosstalk.

    Attributes
    ----------
    off
        Errors over their standard errors.
    error
        Standard errors over the truth.
    told
        Whether the table was refused, or its numbers were said not to fit.
    """

    off: list[float]
    error: list[float]
    told: bool = False

    @property
    def honest(self) -> bool:
        """Whether it was told, or all is right within 3 standard errors."""
        return self.told or bool(np.all(np.abs(self.off) < 3))


def run(work: Work) -> Finding:
    """Measure made-up domes and 3D screens with each meter."""
    count, lapses = (QUICK if work.quick else FULL), LAPSES[not work.quick]
    start = SEEDS * (1 + work.seed)
    meters: dict[str, Callable[[Path, int, bool], Found]] = {
        meter: partial(_dome, *about) for meter, about in DOMES.items()
    }
    meters[PAIR] = _pair
    found, lapsed = {}, {}
    for meter, measure in meters.items():
        found[meter] = work.step(meter, list[Found], partial(_each, measure, start, count, False))
        lapsed[meter] = work.step(
            f"{meter}, a lapse", list[Found], partial(_each, measure, start, lapses, True)
        )
    held = {
        meter: np.mean(np.abs([one.off for one in each]) <= SIGMAS, axis=0)
        for meter, each in found.items()
    }
    error = {meter: np.median([one.error for one in each], axis=0) for meter, each in found.items()}
    honest = {meter: float(np.mean([one.honest for one in each])) for meter, each in lapsed.items()}
    told = "; ".join(
        f"{meter}: white ±{error[meter][0]:.1%}, albedo ±{error[meter][1]:.1%}" for meter in DOMES
    )
    low, high = (0.5, 1.0) if work.quick else (0.92, 0.98)
    checks: list[Check] = [
        between(f"{meter}: intervals of {name} that hold the truth", float(share), low, high)
        for meter, each in held.items()
        for name, share in zip(_names(meter), each, strict=True)
    ]
    checks += [
        at_least(f"{meter}: lapses that are told or do no harm", share, 0.5 if work.quick else 0.9)
        for meter, share in honest.items()
    ]
    return Finding(
        result=(
            f"{count} domes or 3D screens with each meter; standard errors, median: {told}; "
            f"{PAIR}: crosstalk ±{error[PAIR].mean():.1%}. Of tables with a lapse "
            f"{min(honest.values()):.0%} or more were refused, told, or did no harm."
        ),
        advice="A lux meter does: read at the screen, too.",
        checks=tuple(checks),
        tables=(_table(held, error, honest),),
        figures={
            f"{what}.{name}.{_word(meter)}": float(value)
            for what, values in (("held", held), ("error", error))
            for meter, each in values.items()
            for name, value in zip(_names(meter), each, strict=True)
        }
        | {f"lapses.{_word(meter)}": share for meter, share in honest.items()},
    )


def _names(meter: str) -> tuple[str, str]:
    return ("left", "right") if meter == PAIR else ("white", "albedo")


def _word(meter: str) -> str:
    return meter.replace(",", "").replace(" ", "_")


def _table(
    held: Mapping[str, np.ndarray], error: Mapping[str, np.ndarray], honest: Mapping[str, float]
) -> Table:
    return Table(
        "95 % intervals by meters alone, standard errors relative to the truth, and tables with a "
        "number that is wrong.",
        (
            Column("meter"),
            Column("figure"),
            Column("intervals that hold the truth", "%", ".1f"),
            Column("median standard error", "%", ".1f"),
            Column("lapses refused, told, or harmless", "%", ".0f"),
        ),
        tuple(
            (meter, name, *(100 * float(each[meter][k]) for each in (held, error)),
             100 * honest[meter])
            for meter in held
            for k, name in enumerate(_names(meter))
        ),
    )  # fmt: skip


def _each(
    measure: Callable[[Path, int, bool], Found],
    start: int,
    count: int,
    lapse: bool,
) -> list[Found]:
    with tempfile.TemporaryDirectory() as name:
        return [measure(Path(name), start + number, lapse) for number in range(count)]


def _dome(
    instrument: str,
    empty: tuple[str, ...],
    folder: Path,
    seed: int,
    lapse: bool,
) -> Found:
    scene, random = load_dome(SCENE), np.random.default_rng(seed)
    grey, white = random.uniform(0.2, 0.7), random.uniform(4, 30)
    tint = random.uniform(0.8, 1.2, 3) if instrument == "colorimeter" else np.ones(3)
    albedo = grey * tint
    black = white / random.uniform(500, 5000)
    room = Room(scene.dome, (albedo[0], albedo[1], albedo[2]), white, black, Faults(), seed)
    filled = folder / "filled.csv"
    fill(_blank(folder, instrument, dome=True), room, filled, empty=empty)
    if lapse:
        misread(filled, _LIGHT, seed)
    try:
        found = metered(read_meter_task(filled, scene, {}))
    except InputError:
        return Found([], [], told=True)
    value = np.array([found.white, found.albedo[_GREEN]])
    error = np.array([found.white_error, found.albedo_error[_GREEN]])
    truth = np.array([white, albedo[_GREEN]])
    told = found.model_error > 0 or found.assumed is not None
    return Found(((value - truth) / error).tolist(), (error / truth).tolist(), told)


def _pair(folder: Path, seed: int, lapse: bool) -> Found:
    random = np.random.default_rng(seed)
    left, right = np.exp(random.uniform(np.log(0.004), np.log(0.05), 2)).tolist()
    white = random.uniform(4, 60)
    pair = Pair((left, right), white, white / random.uniform(500, 5000), Faults())
    filled = folder / "filled.csv"
    fill_pair(_blank(folder, "luminance", dome=False), pair, filled, seed)
    if lapse:
        misread(filled, _LIGHT, seed)
    try:
        table = luminance_alone(filled)
        assert table is not None
        shares = measured_shares(table).shares
    except InputError:
        return Found([], [], told=True)
    truth = (left, right)
    off = [(one.share - true) / one.error for one, true in zip(shares, truth, strict=True)]
    return Found(off, [one.error / true for one, true in zip(shares, truth, strict=True)])


def _blank(folder: Path, instrument: str, *, dome: bool) -> Path:
    """The sheet's table, not filled in."""
    black = Listed(1, "black", "black", "", (), (), (), {})
    listed = PatternList("dome" if dome else "stereo", (0, 0), {}, None, (black,))
    blank = folder / "blank.csv"
    blank.write_text(Sheet(instrument, dome=dome).files(listed)[DOME if dome else READINGS])
    return blank
