"""How any room reflects can be measured from photographs of patterns, without its geometry.

Rationale
    `domesim measure dome` fits albedos to a described dome, floor and wall. Rooms have seats,
    booths and gain screens, which no description of that kind holds. With `--without-geometry`
    photographs of patterns tell a few smooth modes and how they excite each other: a stored
    transport, as the path tracer tabulates it of a room that is known. Here rooms with seats are
    path-traced and photographed, with noise of 1 % a pixel, vignetting and a camera that is not
    quite where it is said to be; the measurement knows the screen's shape and the patterns, nothing
    else. What it foretells of patterns that were left out should be right for other pictures, too;
    its intervals should hold the truth; and masters that are compensated with it should look, in
    the room as it is, as those that are compensated with the tabulated truth.
Expected
    Compensated with the measured transport, the residual of a night is within 10 % of what the
    tabulated truth leaves. Of a day, where nothing clips, at most 2 % of the reflected light
    remain, and more with the closed form. Reflected light of both is within 1 % (quick: 2 %). At
    least 90 % of the 95 % intervals of the rooms' cores hold the truth (quick: 80 %). Black and
    white alone are refused; few patterns are told to be too few or refused. None of this is claimed
    of a glossy, bright screen (dome_led): there cross-validation must own up to the error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.measure.dome.camera import Camera
from domesim.measure.dome.photographs import Photographs
from domesim.measure.dome.responses import responses_of
from domesim.measure.dome.without_geometry import DEGREE, Found, found_in
from domesim.observation.basis import disc_quadrature
from domesim.observation.transport import Transport, sample_nodes
from domesim.observation.uncertain import SIGMAS
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Tracer
from domesim.scene import DomeScene, load_dome
from domesim.scene.loading import scene_of_text
from domesim.scene.writing import as_toml
from testing.laboratory import (
    LEFT,
    NOISE,
    ORDINARY,
    left_over,
    night_and_day,
    photographed,
    sectors_for,
)
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    equal,
    require_tracer,
)

Floats = NDArray[np.float64]

PATTERN, FIELD = 128, np.radians(200.0)
SMALL = "a small theatre"
GLOSSY = "dome_led"
"""A gain screen with much light: its reflected light is not smooth, which must be noticed."""
ROOMS = (SMALL, "dome_planetarium", "dome_imax", GLOSSY)
AMBIENT = (0.002, 0.003, 0.004)

_SMALL: Mapping[str, Any] = {
    "name": "small",
    "dome": {"radius_m": 4.0, "tilt_deg": 5.0},
    "screen": {"albedo": [0.6, 0.55, 0.5]},
    "floor": {"height_m": -1.5, "albedo": [0.25, 0.2, 0.15]},
    "wall": {"albedo": 0.1},
    "seating": {
        "rows": 4,
        "seats_per_row": 8,
        "first_row_m": 2.0,
        "albedo": [0.1, 0.05, 0.05],
        "occupied": 0.5,
    },
    "boxes": [
        {
            "name": "console",
            "low_m": [-1.0, -3.2, -1.5],
            "high_m": [1.0, -2.6, -0.6],
            "albedo": 0.5,
        }
    ],
    "projector": {"white_cd_m2": 8.0},
    "viewing": {"adaptation_cd_m2": 0.8},
}


@final
@dataclass(frozen=True)
class Effort:
    """Effort spent on photographs and on what they are compared with.

    Parameters
    ----------
    photograph, walks
        Pixels a side, and walks a pixel.
    degree
        Degree of functions on the screen.
    error, most
        Error to reach in tabulation, and most walks.
    size, walks_seen
        Pixels a side of masters, and walks a pixel when they are looked at.
    """

    photograph: int
    walks: int
    degree: int
    error: float
    most: float
    size: int
    walks_seen: int


QUICK = Effort(photograph=48, walks=16, degree=4, error=3e-3, most=2.5e5, size=32, walks_seen=24)
FULL = Effort(
    photograph=72, walks=48, degree=DEGREE, error=1.5e-3, most=1e9, size=64, walks_seen=48
)


@final
@dataclass(frozen=True)
class Room:
    """One room: what was measured of it, and what that is worth.

    Attributes
    ----------
    rank
        Modes that were taken.
    by_rank
        Error of the reflected light of patterns left out, from rank 1, relative.
    exhausted
        Whether more patterns were asked for.
    reflected
        Mean reflected light of white in the second primary: measured, its standard error,
        tabulated.
    off, closed_off
        Relative rms errors of the reflected light of a night and a day: measured; closed form.
    held
        Share of the core's 95 % intervals that hold the tabulated truth.
    night, day
        Compensated with -> rms residual over the screen, of white.
    """

    rank: int
    by_rank: tuple[float, ...]
    exhausted: bool
    reflected: tuple[float, float, float]
    off: tuple[float, float]
    closed_off: tuple[float, float]
    held: float
    night: dict[str, float]
    day: dict[str, float]


def scene_of(name: str) -> DomeScene:
    """A room without its lamps: they are no part of its transport."""
    scene = load_dome(name) if name != SMALL else scene_of_text(as_toml(_SMALL), name, Path())
    assert isinstance(scene, DomeScene)
    return replace(scene, theatre=replace(scene.theatre, lamps=()))


@cache
def photographs_of(name: str, effort: Effort, seed: int) -> tuple[Floats, Photographs]:
    """Patterns, and photographs of them from near the middle."""
    scene = scene_of(name)
    patterns = sectors_for(scene.dome, PATTERN)
    radius = scene.dome.radius
    place = (0.02 * radius, -0.05 * radius, 0.0)
    return patterns, photographed(
        scene.theatre,
        Camera(place, (place[0], place[1] + 1.0, place[2] + 1.5), FIELD),
        patterns,
        ORDINARY,
        ambient=AMBIENT,
        size=effort.photograph,
        walks=effort.walks,
        seed=seed,
    )


def measured(name: str, effort: Effort, seed: int, chosen: Sequence[int] | None = None) -> Found:
    """What photographs of a room tell, of all patterns or of a few."""
    theatre = scene_of(name).theatre
    patterns, shots = photographs_of(name, effort, seed)
    if chosen is not None:
        kept = list(chosen)
        patterns = patterns[kept]
        shots = Photographs(
            shots.camera, shots.light[kept], np.arange(len(kept)), shots.exposure[kept]
        )
    return found_in(responses_of(theatre, patterns, shots, effort.degree), theatre)


def room(name: str, effort: Effort, seed: int) -> Room:
    """Measure a room, and compensate for it."""
    scene = scene_of(name)
    found = measured(name, effort, seed)
    tracer = Tracer(scene.theatre)
    truth = tabulate(
        scene.theatre,
        error=effort.error,
        most=effort.most,
        degree=effort.degree,
        seed=seed,
        tracer=tracer,
    ).transport
    # Light is measured in units of what a white picture shows directly, in which a lobe has a part.
    size = effort.size
    gains = tracer.seen_gain(size, size, (0.0, 0.0, 0.0))[scene.screen(size, size)]
    bright = float(np.median(gains))
    truth = replace(truth, core=truth.core / bright, core_error=truth.core_error / bright)
    bare = replace(scene, theatre=replace(scene.theatre, lobe=None))
    models = {
        "truth": bare.with_transport(replace(truth, provenance={})),
        "measured": bare.with_transport(
            replace(found.transport, ambient=np.zeros_like(found.transport.ambient))
        ),
        "closed": bare,
    }
    inside = scene.screen(size, size)[..., None]
    off, residuals = [], []
    for picture in night_and_day(scene, size, seed):
        reflected = {
            what: model.observation(size, size).observe(picture) - picture * inside
            for what, model in models.items()
        }
        off.append({what: _rms(each - reflected["truth"]) / _rms(reflected["truth"])
                    for what, each in reflected.items()})  # fmt: skip
        residuals.append(left_over(tracer, picture, models, effort.walks_seen, seed))
    return Room(
        rank=found.ranks.rank,
        by_rank=tuple(found.ranks.error.tolist()),
        exhausted=found.ranks.exhausted,
        reflected=(
            float(found.white[1]),
            float(found.white_error[1]),
            float(truth.mean_gain()[1]),
        ),
        off=(off[0]["measured"], off[1]["measured"]),
        closed_off=(off[0]["closed"], off[1]["closed"]),
        held=_held(found.transport, truth),
        night=residuals[0],
        day=residuals[1],
    )


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(values, np.float64)))))


def _held(found: Transport, truth: Transport) -> float:
    """Share of the 95 % intervals of a core that hold the truth in its modes."""
    u, v, area = disc_quadrature(found.dome, 48)
    ours, theirs = (sample_nodes(each.modes, u, v) for each in (found, truth))
    overlap = (ours * area) @ theirs.T / area.sum()
    core = overlap @ truth.core @ overlap.T
    error = np.hypot(found.core_error, np.sqrt((overlap**2) @ truth.core_error**2 @ overlap.T**2))
    return float(np.mean(np.abs(found.core - core) < SIGMAS * error))


CASES: Mapping[str, Sequence[int]] = {
    "black and white": (0, 1),
    "black and both halves": (0, 2, 4),
    "black, white and two halves": (0, 1, 2, 3),
}
"""Name -> which of `sectors_for`."""


def said(name: str, effort: Effort, seed: int) -> str:
    """What is said of a few patterns only; nothing if they are taken to be enough."""
    try:
        found = measured(SMALL, effort, seed, CASES[name])
    except InputError as error:
        return f"refused: {error}"
    return "told: too few patterns" if found.ranks.exhausted else ""


def run(work: Work) -> Finding:
    """Measure rooms."""
    require_tracer()
    effort, names = (QUICK, ROOMS[:1]) if work.quick else (FULL, ROOMS)
    rooms = work.each(
        {name: name for name in names}, Room, lambda name: room(name, effort, work.seed)
    )
    few = work.each({name: name for name in CASES}, str, lambda name: said(name, QUICK, work.seed))
    claimed = {name: each for name, each in rooms.items() if name != GLOSSY}
    worst = max(each.night["measured"] / each.night["truth"] for each in claimed.values())
    off = max(max(each.off) for each in claimed.values())
    closed = max(max(each.closed_off) for each in claimed.values())
    return Finding(
        result=(
            f"Reflected light of {'a room' if len(claimed) == 1 else f'{len(claimed)} rooms'} with "
            f"seats, measured from 17 photographs with noise of {NOISE:.0%} a pixel, was off by at "
            f"most {off:.2%} (rms; closed form {closed:.0%}"
            f"). A night, compensated with it and seen in the room as it is, is left with at most "
            f"{worst:.3f} times the residual that the tabulated truth leaves."
        ),
        advice="With seats, booths or a gain screen: photograph black, white, halves, rings, "
        "sectors and 4 x 2 checkerboards, and use `measure dome --without-geometry`.",
        checks=_checks(rooms, few, quick=work.quick),
        tables=(_rooms_table(rooms), _residual_table(rooms), _few_table(few)),
        plots=(_ranks(rooms),),
        figures={
            "reflected_off": off,
            "residual_over_truth": worst,
            "intervals_that_hold": float(np.mean([each.held for each in claimed.values()])),
        },
    )


def _checks(rooms: Mapping[str, Room], few: Mapping[str, str], *, quick: bool) -> tuple[Check, ...]:
    checks = []
    claimed = {name: each for name, each in rooms.items() if name != GLOSSY}
    for name, each in claimed.items():
        night, day = each.night, each.day
        checks += [
            at_most(f"{name}: reflected light, error", max(each.off), 0.02 if quick else 0.01),
            at_most(f"{name}: night, measured over truth", night["measured"] / night["truth"], 1.1),
            at_most(f"{name}: day, reflected light left", day["measured"] / day["untouched"], 0.02),
            at_least(
                f"{name}: day, left by the closed form", day["closed"] / day["untouched"], 0.02
            ),
            equal(f"{name}: more patterns asked for", int(each.exhausted), 0),
        ]
    # Of all rooms together: parts of one room's core share its geometry.
    held = float(np.mean([each.held for each in claimed.values()]))
    checks.append(at_least("intervals that hold the truth", held, 0.8 if quick else 0.9))
    if GLOSSY in rooms:
        each = rooms[GLOSSY]
        owned = each.by_rank[each.rank - 1] / max(each.off)
        checks.append(at_least(f"{GLOSSY}: error of patterns left out, over its own", owned, 1.0))
    unsaid = sum(not what for what in few.values())
    checks.append(equal("few patterns that were taken to be enough", unsaid, 0))
    return tuple(checks)


def _rooms_table(rooms: Mapping[str, Room]) -> Table:
    return Table(
        caption="Rooms measured without geometry, against their transport as tabulated.",
        columns=(
            Column(name="room"),
            Column(name="modes"),
            Column(name="white's reflected light, measured", unit="%"),
            Column(name="its standard error", unit="%"),
            Column(name="tabulated", unit="%"),
            Column(name="patterns left out: error", unit="%"),
            Column(name="night: error", unit="%"),
            Column(name="day: error", unit="%"),
            Column(name="day: error of the closed form", unit="%"),
            Column(name="intervals that hold the truth", unit="%"),
        ),
        rows=tuple(
            (
                name,
                each.rank,
                *(100 * part for part in each.reflected),
                100 * each.by_rank[each.rank - 1],
                100 * each.off[0],
                100 * each.off[1],
                100 * each.closed_off[1],
                100 * each.held,
            )
            for name, each in rooms.items()
        ),
    )


def _residual_table(rooms: Mapping[str, Room]) -> Table:
    told = {
        "untouched": "none",
        "truth": "tabulated truth",
        "measured": "measured",
        "closed": "closed form",
    }
    return Table(
        caption=LEFT,
        columns=(
            Column(name="room"),
            Column(name="compensated with"),
            Column(name="night", unit="%"),
            Column(name="day", unit="%"),
        ),
        rows=tuple(
            (name, words, 100 * each.night[what], 100 * each.day[what])
            for name, each in rooms.items()
            for what, words in told.items()
        ),
    )


def _few_table(few: Mapping[str, str]) -> Table:
    return Table(
        caption="What is said of too few patterns.",
        columns=(Column(name="photographs of"), Column(name="answer")),
        rows=tuple((name, what or "taken to be enough") for name, what in few.items()),
    )


def _ranks(rooms: Mapping[str, Room]) -> Plot:
    def draw(axes: Any) -> None:
        for name, each in rooms.items():
            ranks = np.arange(1, len(each.by_rank) + 1)
            (line,) = axes.semilogy(ranks, 100 * np.maximum(each.by_rank, 1e-4), ".-", label=name)
            axes.plot(
                each.rank,
                100 * max(each.by_rank[each.rank - 1], 1e-4),
                "o",
                color=line.get_color(),
                ms=10,
            )
        axes.set(xlabel="modes", ylabel="error of patterns left out, %")
        axes.legend(fontsize=8)

    return plot(
        "Error of the reflected light of patterns that were left out, by the number of modes; the "
        "large dots are what was taken. 0.01 % stands for errors that noise hides.",
        "Curves that fall and level off.",
        draw,
    )
