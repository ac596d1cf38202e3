"""A flat room greys a film's blacks as its radiosity says, and the aim takes a part of that away.

Rationale
    In a flat cinema the lens and its port glass scatter light, and the room sends light back. The
    room is a box whose radiosity is tabulated as a few modes over the screen
    (`domesim.observation.flat_room`). Here Mitsuba traces paths from the screen to the room and
    back, of a full white picture and of the 16 fields of a checkerboard, in the bundled cinema and
    before a screen with gain. Then system contrast is compared with what is published. SMPTE RP
    431-2 asks of a theatre for 1200:1 of full frames and 100:1 within a frame. A home cinema was
    measured with white cloths before its dark surfaces (homecinemaguru.com, "ANSI Contrast And Your
    Room In Front Projection"): 235:1 of the projector alone, 150:1 in the dark room, 83:1 with a
    light ceiling, 44:1 with light side walls, too. The sizes and paints of that room are not told,
    so that a small and a large one, each with plausible albedos, are taken to bracket it. Last, two
    films' frames are shown in the bundled cinema and in one with light walls, as they are,
    subtracted, and aimed at by the default. Black is the light of a frame's darker half over that
    of the untouched frame, which the judge of quality cannot see.
Expected
    Traced light is the tabulated one's within 0.5 % in the mean of the screen. The bundled cinema
    keeps SMPTE's limits. Each published contrast lies between those of the small and the large
    room. In either cinema the aim loses less quality than leaving the film as it is, in the mean of
    the frames; it harms none by a difference that counts (0.02 JOD), and no frame's black is
    brighter than untouched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from compensate.plain import PlainRuler
from compensate.pose import pose
from compensate.report_card import EYES_AGE, to_the_eye
from compensate.ruler import NO_DIFFERENCE, Ruler
from compensate.solve import solved
from domesim.inspection.contrast import FIELDS, Contrast, contrast
from domesim.light import Light
from domesim.observation.flat_room import room_observation
from domesim.pathtrace.flat_room import Returning, returning
from domesim.room.flat_room import FlatRoom
from domesim.scene import CinemaScene, FlatScene, load_scene, load_stereo
from domesim.scene.flat import ROOM
from testing.pairs import generated
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
from validation.inputs import orrery

CINEMA, GAIN = "cinema_2d", "stereo_room"
PICTURES = ("white", "checkerboard")
_SIZE = (40, 96)  # pixels of a traced picture
LIGHT = 0.4
"""Albedo of light walls and ceiling."""
WIDTH = 1024
"""Pixels across a frame."""
NOTHING, SUBTRACTED, AIMED = "untouched", "subtracted", "aimed at"
WAYS = {NOTHING: "none", SUBTRACTED: "subtractive", AIMED: "perceptual"}
PROJECTOR_ALONE = 235.0
MEASURED: Mapping[str, float] = {
    "all dark": 150.0,
    "light ceiling": 83.0,
    "light ceiling and side walls": 44.0,
}
"""ANSI contrast of the home cinema."""
_HOME = {"large, darker": (5.5, 2.7, 7.5, 0.04, 0.5), "small, lighter": (3.4, 2.3, 4.5, 0.12, 0.8)}
_HOME_SCREEN = (2.4, 1.35)


@final
@dataclass(frozen=True)
class Back:
    """Light that comes back to places of the screen, in units of white.

    Attributes
    ----------
    traced, error, tabulated
        Mean over places and primaries, and the standard error of the first.
    rms
        Root mean square difference of single places, over the mean.
    """

    traced: float
    error: float
    tabulated: float
    rms: float

    @property
    def off(self) -> float:
        """How far the tabulated mean is from the traced one, relative."""
        return self.tabulated / self.traced - 1


@final
@dataclass(frozen=True)
class Shown:
    """A frame in a cinema.

    Attributes
    ----------
    lost, light, black
        Quality lost, JOD; mean light that is seen over the master's; light of the darker half over
        the untouched one's. By way.
    """

    lost: dict[str, float]
    light: dict[str, float]
    black: dict[str, float]


def board(rows: int, cols: int) -> NDArray[np.float64]:
    """(row, col) the checkerboard."""
    fields = [np.arange(size) * FIELDS // size for size in (rows, cols)]
    return np.asarray(np.add.outer(*fields) % 2, np.float64)


def came_back(room: FlatRoom, picture: str, *, apart: int, samples: int, seed: int) -> Back:
    """Traces a picture, seen at places so many pixels apart."""
    rows, cols = _SIZE
    shown = np.ones(_SIZE) if picture == PICTURES[0] else board(rows, cols)
    at = np.meshgrid(np.arange(2, rows, apart), np.arange(2, cols, apart), indexing="ij")
    row, col = (each.ravel() for each in at)
    found, reflected = both_ways(room, shown, row, col, samples=samples, seed=seed)
    error = np.sqrt(np.mean(found.error**2) / found.error.size)
    rms = np.sqrt(np.mean((found.light - reflected) ** 2)) / reflected.mean()
    return Back(float(found.light.mean()), float(error), float(reflected.mean()), float(rms))


def both_ways(
    room: FlatRoom,
    shown: NDArray[np.float64],
    row: NDArray[np.intp],
    col: NDArray[np.intp],
    *,
    samples: int,
    seed: int,
) -> tuple[Returning, Light]:
    """(place, primary) what comes back of a picture to some of its pixels: traced, and computed."""
    rows, cols = shown.shape
    width, height = room.screen
    across, up = ((col + 0.5) / cols - 0.5) * width, (0.5 - (row + 0.5) / rows) * height
    found = returning(room, shown, np.stack([across, up], 1), samples=samples, seed=seed)
    light = np.repeat(shown[None, :, :, None], 3, axis=3)
    return found, (room_observation(room, rows, cols, 0.0).linear(light) - light)[0, row, col]


def home_contrast(which: str, surfaces: str) -> float:
    """ANSI contrast of the home cinema, as a small or a large room."""
    width, height, length, dark, cloth = _HOME[which]
    albedos = dict.fromkeys(("floor", "ceiling", "walls", "back", "front", "audience"), (dark,) * 3)
    for name in ("ceiling", "walls"):
        if name in surfaces:
            albedos[name] = (cloth,) * 3
    room = FlatRoom(
        screen=_HOME_SCREEN,
        gain=0.95,
        half_gain=None,
        size=(width, height, length),
        bottom=(height - _HOME_SCREEN[1]) / 2,
        audience_from=length / 2,
        **albedos,
    )
    rows, cols = _SIZE
    lit = board(rows, cols)
    light = np.repeat(lit[None, :, :, None], 3, axis=3)
    seen = room_observation(room, rows, cols, 0.0).observe(light)[0, ..., 0] + 1 / PROJECTOR_ALONE
    return float(seen[lit == 1].mean() / seen[lit == 0].mean())


def light_walls(scene: CinemaScene) -> CinemaScene:
    """The same cinema with light walls and ceiling."""
    assert scene.way.room is not None
    light = (LIGHT,) * 3
    room = replace(scene.way.room, walls=light, ceiling=light, back=light)
    return replace(scene, name="light walls", way=replace(scene.way, room=room))


def masters(width: int, *, quick: bool) -> dict[str, Callable[[], Light]]:
    """Frames of films, by name: a generated night, and the orrery."""
    found: dict[str, Callable[[], Light]] = {
        "generated night": lambda: np.asarray(generated(width, 1)[:1], np.float32)
    }

    def left() -> Light:
        return np.asarray(orrery("stereo", width)[:1], np.float32)

    return found if quick else {**found, "orrery": cache(left)}


def judged(read: Callable[[], Light], scene: CinemaScene) -> Shown:
    """A frame in a cinema, by all ways."""
    posed = pose(read(), scene)
    wanted = posed.wanted
    seen = {way: posed.seen(solved(posed, method).light) for way, method in WAYS.items()}
    screen = scene.screen(*wanted.shape[1:3])
    ruler, plain = Ruler(wanted, scene, screen), PlainRuler(wanted, scene, screen)
    black = {way: plain.black(each) for way, each in seen.items()}
    return Shown(
        {way: ruler.lost(each) for way, each in seen.items()},
        {way: float(each.mean() / wanted.mean()) for way, each in seen.items()},
        {way: each / black[NOTHING] for way, each in black.items()},
    )


def run(work: Work) -> Finding:
    """Trace, compare, and show films."""
    require_tracer()
    cinema, pair = load_scene(CINEMA), load_stereo(GAIN)
    assert isinstance(cinema, CinemaScene)
    rooms = {}
    for scene in (cinema, pair):
        assert scene.way is not None
        assert scene.way.room is not None
        rooms[scene.name] = scene.way.room
    apart, samples = (10, 1 << 16) if work.quick else (5, 1 << 18)
    traced = work.each(
        {
            f"{picture} in {name}": (room, picture)
            for name, room in rooms.items()
            for picture in (PICTURES[1:] if work.quick else PICTURES)
        },
        Back,
        lambda given: came_back(*given, apart=apart, samples=samples, seed=work.seed),
    )
    homes = work.each(
        {
            f"{which} room, {surfaces}": (which, surfaces)
            for which in _HOME
            for surfaces in MEASURED
        },
        float,
        lambda given: home_contrast(*given),
    )
    cinemas = {CINEMA: cinema, "light walls": light_walls(cinema)}
    systems: dict[str, FlatScene] = {**cinemas, GAIN: pair}
    contrasts = {
        name: work.step(f"contrast of {name}", Contrast, partial(contrast, scene))
        for name, scene in systems.items()
    }
    eyes = work.each(systems, tuple[float, float], to_the_eye)
    films = masters(320 if work.quick else WIDTH, quick=work.quick)
    shown = work.each(
        {
            f"{film} in {name}": (read, one)
            for film, read in films.items()
            for name, one in cinemas.items()
        },
        Shown,
        lambda given: judged(*given),
    )
    off = max(abs(one.off) for one in traced.values())
    gains = {
        name: [
            one.lost[NOTHING] - one.lost[AIMED] for key, one in shown.items() if key.endswith(name)
        ]
        for name in cinemas
    }
    return Finding(
        result=(
            f"Light that the room sends back is tabulated within {off:.2%} of what is traced, in "
            f"the mean of the screen. {_told(contrasts, eyes)}\n\nOf the frames, the room and the "
            f"projector's black cost "
            + "; ".join(
                f"{key}, {one.lost[NOTHING]:.3f} JOD (subtracted {one.lost[SUBTRACTED]:.3f}, "
                f"aimed at {one.lost[AIMED]:.3f}, black {one.black[AIMED]:.2f} of untouched)"
                for key, one in shown.items()
            )
            + "."
        ),
        checks=(
            *_checks(traced, homes, contrasts),
            *_harmless(gains, shown, quick=work.quick),
        ),
        tables=tuple(_tables(traced, homes, contrasts, eyes, shown)),
        figures={
            "flat_cinema.off": off,
            "flat_cinema.ansi": contrasts[CINEMA].ansi,
            **{
                f"flat_cinema.{name.replace(' ', '_')}": float(np.mean(g))
                for name, g in gains.items()
            },
        },
        left_out=("White, traced, and the orrery: with a full run",) if work.quick else (),
    )


def _told(contrasts: Mapping[str, Contrast], eyes: Mapping[str, tuple[float, float]]) -> str:
    told = []
    for name, one in contrasts.items():
        lit, dark = eyes[name]
        told.append(
            f"{name} has {one.sequential:.0f}:1 of full frames and {one.ansi:.0f}:1 within the "
            f"checkerboard, of whose black {one.parts[ROOM] / one.dark:.0%} is the room's; to an "
            f"eye of {EYES_AGE:g} years it is {lit / dark:.0f}:1"
        )
    return ". ".join(told) + "."


def _checks(
    traced: Mapping[str, Back],
    homes: Mapping[str, float],
    contrasts: Mapping[str, Contrast],
) -> Iterator[Check]:
    for name, one in traced.items():
        yield at_most(f"{name}: tabulated over traced light, error", abs(one.off), 5e-3)
    cinema = contrasts[CINEMA]
    yield at_least("sequential contrast of the cinema (RP 431-2)", cinema.sequential or 0, 1200)
    yield at_least("ANSI contrast of the cinema (RP 431-2)", cinema.ansi or 0, 100)
    for surfaces, measured in MEASURED.items():
        ends = [homes[f"{which} room, {surfaces}"] for which in _HOME]
        yield between(
            f"home cinema, {surfaces}: what was measured, between both rooms",
            measured,
            min(ends),
            max(ends),
        )


def _harmless(
    gains: Mapping[str, list[float]], shown: Mapping[str, Shown], *, quick: bool
) -> Iterator[Check]:
    black = max(one.black[AIMED] for one in shown.values())
    yield at_most("black of the aim over untouched, most of all", black, 1.0)
    if quick:  # so small a picture has no details to lose
        return
    for name, gained in gains.items():
        gain = float(np.mean(gained))
        yield at_least(f"{name}: quality that the aim gains, mean of the frames", gain, 0.0, "JOD")
        least = min(gained)
        yield at_least(f"{name}: quality that it gains, least", least, -NO_DIFFERENCE, "JOD")


def _tables(
    traced: Mapping[str, Back],
    homes: Mapping[str, float],
    contrasts: Mapping[str, Contrast],
    eyes: Mapping[str, tuple[float, float]],
    shown: Mapping[str, Shown],
) -> Iterator[Table]:
    yield Table(
        caption="Light that comes back, % of white: traced, with its standard error, and "
        "tabulated; how far the latter is off, and places (with noise of tracing), % of it.",
        columns=(
            Column(name="picture"),
            *(Column(name=name, digits=".4f") for name in ("traced", "±", "tabulated")),
            Column(name="off", unit="%", digits="+.2f"),
            Column(name="places, rms", unit="%", digits=".2f"),
        ),
        rows=tuple(
            (name, 100 * o.traced, 100 * o.error, 100 * o.tabulated, 100 * o.off, 100 * o.rms)
            for name, o in traced.items()
        ),
    )
    parts = tuple(dict.fromkeys(part for one in contrasts.values() for part in one.parts))
    yield Table(
        caption="System contrast; what black fields of the checkerboard are made of, cd/m²; and "
        "the same contrast to an eye, with its own stray light.",
        columns=(
            Column(name="cinema"),
            Column(name="sequential", digits=".0f"),
            Column(name="ANSI", digits=".0f"),
            *(Column(name=part, digits=".4f") for part in parts),
            Column(name="ANSI to the eye", digits=".0f"),
        ),
        rows=tuple(
            (
                name,
                one.sequential,
                one.ansi,
                *(one.parts.get(part) for part in parts),
                eyes[name][0] / eyes[name][1],
            )
            for name, one in contrasts.items()
        ),
    )
    yield Table(
        caption="ANSI contrast of a home cinema whose projector has 235:1 alone: as measured, and "
        "of rooms that bracket it.",
        columns=(
            Column(name="surfaces"),
            Column(name="measured", digits=".0f"),
            *(Column(name=which, digits=".0f") for which in _HOME),
        ),
        rows=tuple(
            (surfaces, measured, *(homes[f"{which} room, {surfaces}"] for which in _HOME))
            for surfaces, measured in MEASURED.items()
        ),
    )
    yield Table(
        caption="Quality lost (JOD, by ColorVideoVDP), light that is seen over the master's, and "
        "light of the darker half over that of the untouched frame.",
        columns=(
            Column(name="frame"),
            *(Column(name=f"lost, {what}", digits=".3f") for what in WAYS),
            *(Column(name=f"light, {what}", digits=".3f") for what in WAYS),
            *(Column(name=f"black, {what}", digits=".3f") for what in WAYS),
        ),
        rows=tuple(
            (name, *(part[way] for part in (one.lost, one.light, one.black) for way in WAYS))
            for name, one in shown.items()
        ),
    )
