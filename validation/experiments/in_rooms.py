"""What simple measurements say of rooms with furniture is worth compensating with, and is checked.

Rationale
    A lux meter, a luminance meter and a camera that takes the room for floor and wall describe a
    bare dome. Rooms have seats, people and consoles. Here such rooms are tabulated by path tracing;
    meters read in that light, with noise, and a camera takes traced photographs. A night is
    compensated with what they found, and judged in the room as it is. Shifted checkerboards,
    photographed in the same rooms, tell direct from reflected light without any model (Nayar 2006):
    that map is what a user can check a model with. And a cove of five projectors shows its black,
    traced projector by projector.
Expected
    Meters' white is within 10 % of the truth, and the mean reflected light of their bare dome
    within 15 % of the room's. Frames for it lose at most 0.1 JOD more than frames for the truth,
    and never more than untouched ones. A camera whose description lacks the furniture owns up, or
    its frames lose at most 0.1 JOD more. The map agrees with tabulation within 3 % in the mean
    (quick: 5 %), and in one room the closed form does not. Modelled black is within 2 % of the
    traced sum in the mean, and within 4 % (rms) by place.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.figures import Appraisal
from compensate.pose import Stage
from compensate.solve import solved
from domesim.measure.dome.camera import Camera
from domesim.measure.dome.meter_table import read_meter_task
from domesim.measure.dome.meters import metered
from domesim.measure.dome.model import surfaces_of
from domesim.measure.dome.responses import responses_of, screen_alone
from domesim.measure.dome.run import survey_of
from domesim.measure.dome.separated import modelled, separated
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import SHIFTED, dome_patterns
from domesim.measure.patterns.listing import PatternList
from domesim.measure.patterns.sheets import DOME, Sheet
from domesim.observation.radiosity import radiosity
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.lenses import field_weight
from domesim.room.theatre import Theatre
from domesim.scene import DomeScene, load_dome
from domesim.scene.fields import three
from testing.laboratory import ORDINARY, patterns_for, photographed
from testing.masters import night_in
from testing.meters import SIZE as READ
from testing.meters import Faults, Room, fill
from testing.surveys import STATED, scene_of, small_theatre
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    at_most,
    between,
    require_tracer,
)

Floats = NDArray[np.float64]

SMALL = "a small theatre"
ROOMS = (SMALL, "dome_planetarium")
METERS = ("lux", "luminance")
CAMERA = "camera"
JOD = 0.1
WHITE, BLACK = 9.0, 0.004
PIXELS = 256
"""Of the night, a side."""


@final
@dataclass(frozen=True)
class Effort:
    """Pixels a side of photographs, walks a pixel, and the error of tabulation."""

    photograph: int
    walks: int
    error: float


QUICK, FULL = Effort(64, 8, 6e-3), Effort(96, 24, 2e-3)


@final
@dataclass(frozen=True)
class Said:
    """What one instrument said of one room.

    Attributes
    ----------
    albedo, white
        Of green; and direct white over the truth (NaN of a camera, which has no unit).
    reflected
        Mean reflected light of a white picture over that of the room.
    by_place
        Relative rms difference of reflected light over the screen.
    lost, known, untouched
        Quality that a night loses: compensated with it, with the truth, and untouched, JOD.
    told
        Whether it was said that the numbers do not fit the description.
    """

    albedo: float
    white: float | None
    reflected: float
    by_place: float
    lost: float
    known: float
    untouched: float
    told: bool


@final
@dataclass(frozen=True)
class Map:
    """Reflected light by shifted boards: over tabulation and over the closed form, less 1.

    Attributes
    ----------
    tabulated, closed
        Relative difference of a model's mean from the map's.
    by_place, error
        Relative rms difference of tabulation by place, and the map's own error.
    """

    tabulated: float
    closed: float
    by_place: float
    error: float


@final
@dataclass(frozen=True)
class Black:
    """A cove's black by the model over the traced sum: mean less 1, and rms by place."""

    mean: float
    by_place: float
    range: float


def run(work: Work) -> Finding:
    """Measure rooms with furniture, and look at a cove's black."""
    require_tracer()
    effort, names = (QUICK, ROOMS[:1]) if work.quick else (FULL, ROOMS)
    said: dict[tuple[str, str], Said] = {}
    maps: dict[str, Map] = {}
    for name in names:
        kept = _Kept(name, effort, work.seed)
        for instrument in (*METERS, CAMERA):
            said[name, instrument] = work.step(
                f"{name}, {instrument}", Said, partial(_said, kept, instrument)
            )
        maps[name] = work.step(f"{name}, map", Map, partial(_map, kept))
    black = work.step("cove", Black, partial(_cove, work.seed))
    more = {key: one.lost - one.known for key, one in said.items()}
    meters = {key: one for key, one in said.items() if key[1] != CAMERA}
    checks: list[Check] = [
        *(
            between(f"{' '.join(key)}: white over the truth", float(one.white or 0), 0.9, 1.1)
            for key, one in meters.items()
        ),
        *(
            between(f"{' '.join(key)}: reflected light over the room's", one.reflected, 0.85, 1.15)
            for key, one in meters.items()
        ),
        *(
            at_most(f"{' '.join(key)}: quality lost for it", more[key], JOD, "JOD")
            for key in meters
        ),
        *(
            at_most(f"{' '.join(key)}: quality lost, over that of untouched frames",
                    one.lost / one.untouched, 1.0)
            for key, one in said.items()
        ),
        *(
            at_least(f"{name}, {CAMERA}: owns up, or costs little",
                     float(said[name, CAMERA].told or more[name, CAMERA] < JOD), 1.0)
            for name in names
        ),
        *(
            between(f"{name}: tabulation over the map", 1 + one.tabulated,
                    *((0.95, 1.05) if work.quick else (0.97, 1.03)))
            for name, one in maps.items()
        ),
        at_least("largest difference of the closed form from a map",
                 max(abs(one.closed) for one in maps.values()), 0.03),
        between("cove: modelled black over traced", 1 + black.mean, 0.98, 1.02),
        at_most("cove: rms difference by place", black.by_place, 0.04),
    ]  # fmt: skip
    return Finding(
        result=(
            f"Frames made for what a lux or luminance meter found lose at most "
            f"{max(more[key] for key in meters):.3f} JOD more than with the truth; a camera's, "
            f"whose description lacks the furniture, "
            f"{max(more[name, CAMERA] for name in names):.3f}"
            f" ({sum(said[name, CAMERA].told for name in names)} of {len(names)} surveys say that "
            f"it does not fit). Maps of reflected light agree with tabulation within "
            f"{max(abs(one.tabulated) for one in maps.values()):.1%} in the mean. A cove's black "
            f"is {black.mean:+.1%} off in the mean."
        ),
        advice="Meters do in rooms with seats. A camera needs a description that has them, or "
        "`--without-geometry`.",
        checks=tuple(checks),
        tables=(_table(said), _table_of_maps(maps, black)),
        figures={
            f"{what}.{_word(name)}.{instrument}": value
            for (name, instrument), one in said.items()
            for what, value in (
                ("reflected", one.reflected), ("extra_jod", one.lost - one.known),
                ("told", float(one.told)),
            )
        }
        | {f"map.{_word(name)}": one.tabulated for name, one in maps.items()}
        | {f"map_closed.{_word(name)}": one.closed for name, one in maps.items()}
        | {"cove.mean": black.mean, "cove.by_place": black.by_place},
    )  # fmt: skip


def _word(name: str) -> str:
    return name.replace("a small theatre", "small").removeprefix("dome_")


def _table(said: dict[tuple[str, str], Said]) -> Table:
    return Table(
        "Rooms with furniture by instruments that take them for bare ones; a night's quality.",
        (
            Column("room"),
            Column("instrument"),
            Column("albedo of green"),
            Column("white over the truth"),
            Column("reflected light over the room's"),
            Column("rms difference by place", "%", ".1f"),
            Column("lost with it", "JOD"),
            Column("with the truth", "JOD"),
            Column("untouched", "JOD"),
            Column("said not to fit"),
        ),
        tuple(
            (name, instrument, one.albedo, one.white, one.reflected, 100 * one.by_place, one.lost,
             one.known, one.untouched, one.told)
            for (name, instrument), one in said.items()
        ),
    )  # fmt: skip


def _table_of_maps(maps: dict[str, Map], black: Black) -> Table:
    return Table(
        "Models over maps of reflected light by shifted boards; and over a cove's traced black.",
        (
            Column("room"),
            Column("tabulated, mean", "%", ".2f"),
            Column("closed form, mean", "%", ".2f"),
            Column("tabulated, rms by place", "%", ".1f"),
            Column("the map's own error", "%", ".1f"),
        ),
        (
            *(
                (name, 100 * one.tabulated, 100 * one.closed, 100 * one.by_place, 100 * one.error)
                for name, one in maps.items()
            ),
            ("a cove's black", None, 100 * black.mean, 100 * black.by_place, None),
        ),
    )


class _Kept:
    """A room, traced when it is first asked for."""

    def __init__(self, name: str, effort: Effort, seed: int) -> None:
        scene = small_theatre() if name == SMALL else load_dome(name)
        self.scene = replace(scene, theatre=replace(scene.theatre, lamps=()), transport=None)
        self.effort, self.seed = effort, seed
        self._true: DomeScene | None = None

    @property
    def true(self) -> DomeScene:
        """The scene with the room's light."""
        if self._true is None:
            stored = tabulate(self.scene.theatre, error=self.effort.error, seed=self.seed)
            self._true = self.scene.with_transport(replace(stored.transport, provenance={}))
        return self._true

    def photographs(self, patterns: Floats) -> Any:
        """Traced photographs, from near the middle."""
        x, y = 0.02 * self.scene.dome.radius, -0.05 * self.scene.dome.radius
        camera = Camera((x, y, -0.3), (x, y + 0.8, 0.6), np.radians(220.0))
        return photographed(
            self.scene.theatre,
            camera,
            patterns,
            ORDINARY,
            ambient=(0.002, 0.002, 0.002),
            size=self.effort.photograph,
            walks=self.effort.walks,
            seed=self.seed,
        )


def _said(kept: _Kept, instrument: str) -> Said:
    albedo, white, found, told = (
        _by_camera(kept) if instrument == CAMERA else _by_meter(kept, instrument)
    )
    light = night_in(kept.true, PIXELS)
    posed = Stage(kept.true).pose(light)
    seen = Appraisal(posed)
    reflected, wanted = (_reflected(scene) for scene in (found, kept.true))
    on = kept.scene.screen(READ, READ)
    off = (reflected / np.where(on[..., None], wanted, 1) - 1)[on]
    return Said(
        albedo,
        white,
        float(reflected[on].mean() / wanted[on].mean()),
        float(np.sqrt(np.mean(off**2))),
        seen.loss(solved(Stage(found).pose(light), "perceptual").light),
        seen.loss(solved(posed, "perceptual").light),
        seen.loss_before,
        told,
    )


def _reflected(scene: DomeScene) -> Floats:
    """(row, col, primary) reflected light of a white picture."""
    room = scene.one_view(READ, READ)
    white = np.where(scene.screen(READ, READ)[None, :, :, None], 1.0, np.zeros((1, 1, 1, 3)))
    reflected: Floats = np.asarray(room.linear(white) - room.direct(white), np.float64)
    return np.asarray(reflected[0])


def _by_meter(kept: _Kept, instrument: str) -> tuple[float, float, DomeScene, bool]:
    """Albedo, white over the truth, the scene that was found, and whether misfit was told."""
    scene, light = kept.scene, kept.true.one_view(READ, READ)
    paint = three(scene.theatre.screen_albedo)
    room = Room(scene.dome, paint, WHITE, BLACK, Faults(), kept.seed, light.linear)
    with tempfile.TemporaryDirectory() as folder:
        blank, filled = Path(folder) / "blank.csv", Path(folder) / "filled.csv"
        blank.write_text(
            Sheet(instrument, True).files(PatternList("dome", (0, 0), {}, None, ()))[DOME]
        )
        fill(blank, room, filled)
        found = metered(read_meter_task(filled, scene, {}))
    bare = replace(screen_alone(scene.theatre), albedo=three(found.albedo))
    told = found.model_error > 0 or found.assumed is not None
    return float(found.albedo[1]), found.white / WHITE, replace(scene, theatre=bare), told


def _by_camera(kept: _Kept) -> tuple[float, None, DomeScene, bool]:
    """The same by a survey with floor and wall as they are, and without anything else."""
    scene = kept.scene
    patterns = patterns_for(scene.dome, 128)
    plain: Theatre = scene.theatre.enclosure
    _, found = survey_of(plain, patterns, kept.photographs(patterns), {}, STATED, profile=False)
    rows = dict(zip(surfaces_of(plain), found.value[1:], strict=True))
    painted = replace(plain, albedo=three(rows["screen"] / (1 - plain.perforation)))
    if painted.floor is not None and "floor" in rows:
        painted = replace(painted, floor=replace(painted.floor, albedo=three(rows["floor"])))
    if painted.wall is not None and "wall" in rows:
        painted = replace(painted, wall=replace(painted.wall, albedo=three(rows["wall"])))
    told = not (found.complete and found.plausible)
    model = replace(scene, theatre=painted).with_transport(radiosity(painted, resolution=8))
    return float(rows["screen"][1]), None, model, told


def _map(kept: _Kept) -> Map:
    linear = Codes(16, floating=False, transfer="linear")
    wanted = [
        each
        for each in dome_patterns(kept.scene.dome, linear, 4)
        if each.name == "black" or each.name.startswith(SHIFTED)
    ]
    patterns = np.stack([np.asarray(each.codes(192, 192)[0], np.float64) for each in wanted])
    boards = np.array([each.name != "black" for each in wanted])
    responses = responses_of(kept.scene.theatre, patterns, kept.photographs(patterns), 0)
    found = separated(responses, boards, ~boards, 0.0)
    tabulated, closed = (modelled(one, found.places) for one in (kept.true, kept.scene))
    off = tabulated / found.ratio - 1

    def of(model: Floats) -> float:
        return float((model.mean(0) / found.mean - 1).mean())

    return Map(
        of(tabulated),
        of(closed),
        float(np.sqrt(np.mean(off**2))),
        float(np.sqrt(np.mean((found.error / found.ratio) ** 2))),
    )


def _cove(seed: int) -> Black:
    """Five fisheyes under the rim that throw across, each with a black of its own."""
    size, units = 96, []
    for k, black in enumerate((0.008, 0.016, 0.032, 0.012, 0.024)):
        angle = 2 * np.pi * k / 5
        x, y = 4.0 * float(np.sin(angle)), 4.0 * float(np.cos(angle))
        units.append(
            {
                "name": f"P{k}",
                "position_m": [x, y, -0.5],
                "look_at_m": [-x, -y, 3.5],
                "field_deg": 109.0,
                "blend_deg": 17.0,
                "black_cd_m2": black,
            }
        )
    content: dict[str, Any] = {
        "name": "cove",
        "dome": {"radius_m": 5.0, "tilt_deg": 17.0},
        "screen": {"albedo": [0.5, 0.4, 0.3]},
        "projector": {"white_cd_m2": 8.0, "units": units},
        "viewing": {"adaptation_cd_m2": 1.0},
    }
    scene = scene_of(content)
    on, points = scene.screen(size, size), scene.dome.points(size, size)
    tracer = Tracer(scene.theatre)
    traced = np.zeros((size, size, 3))
    for k, lens in enumerate(scene.theatre.lenses):
        part = lens.black * field_weight(replace(lens, blend=0.0), points) * on
        settings = Settings(error=0.01, seed=seed + k + 1)
        room = PathTracedDome(scene.theatre, size, size, settings, tracer=tracer)
        traced += room.trace(np.repeat(part[None, :, :, None], 3, axis=3)).mean[0]
    seen = scene.observation(size, size).observe(np.zeros((1, size, size, 3), np.float32))[0]
    weights = scene.projector.luminance_weights
    model, truth = (np.asarray(each)[on] @ weights for each in (seen, traced))
    return Black(
        float(model.mean() / truth.mean() - 1),
        float(np.sqrt(np.mean((model / truth - 1) ** 2))),
        float(truth.max() / truth.min()),
    )
