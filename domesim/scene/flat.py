"""Light's way in a flat cinema: lens and port glass, then the room; and a 2-D cinema of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import ReflectedViews, dome_pair
from domesim.observation.flat_room import room_observation
from domesim.observation.followed import Followed
from domesim.observation.glare import Glare, Scatter
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.projector import Projector
from domesim.observation.uncertain import Uncertain
from domesim.room import viewing
from domesim.room.flat_room import FlatRoom
from domesim.room.viewing import Viewing
from domesim.scene.base import Scene
from domesim.scene.fields import response_of
from domesim.scene.flat_file import CinemaFile, OnItsWay
from domesim.scene.grade import SCREENS, Grade

LENS, PORT_GLASS, ROOM = "lens", "port glass", "room"
"""Names of the parts of light's way."""

_NEAR = 0.1
"""Least distance of walls, in heights of the screen, at which reflected light is smooth over it."""


@final
@dataclass(frozen=True)
class LightsWay:
    """Holds what happens to light between the projector and the eyes, but for crosstalk.

    Parameters
    ----------
    size
        (width, height) of the screen, m.
    throw
        Distance from the lens to the screen, m.
    scatters
        What scatters, by `LENS` and `PORT_GLASS`.
    room
        The auditorium; None for one that reflects nothing.
    mixed
        Whether the room's light reaches both eyes in halves, as in polarised systems.
    """

    size: tuple[float, float]
    throw: float = 1.0
    scatters: Mapping[str, Scatter] = field(default_factory=dict)
    room: FlatRoom | None = None
    mixed: bool = False

    @property
    def lenses(self) -> list[tuple[float, ...]]:
        """(xyz), m from the middle of the screen, of the lens that scatters; none if none does."""
        return [(0.0, -self.throw, 0.0)] if self.scatters else []

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of what pollutes."""
        return (*self.scatters, *(() if self.room is None else (ROOM,)))

    @property
    def approximation(self) -> str | None:
        """Says in one line what is approximate; None if nothing is."""
        if self.room is None or self.room.gap >= _NEAR * self.size[1]:
            return None
        return (
            f"approximate: the screen comes to {self.room.gap:.2g} m of another surface; at that "
            f"edge reflected light is off by up to a third, by 2 % in the mean"
        )

    def only(self, *names: str) -> Self:
        """The same way with some of its parts."""
        scatters = {name: each for name, each in self.scatters.items() if name in names}
        return replace(self, scatters=scatters, room=self.room if ROOM in names else None)

    def one_view(self, rows: int, cols: int, black: float) -> AdjointObservation:
        """Psi = (I + Phi) H x + black of a 2-D picture."""
        return self._scattered(1, self._reflected(rows, cols, black))

    def two_views(self, crosstalk: Crosstalk) -> AdjointObservation:
        """Psi = C (I + Phi) H x + black of a pair: crosstalk with its black comes last."""
        _, rows, cols, _ = crosstalk.shape
        summed = self._reflected(rows, cols, 0.0)
        differing = summed
        if self.mixed:
            factors = replace(summed.factors, core=0 * summed.factors.core)
            differing = LowRankObservation(factors, summed.screen)
        if crosstalk.share.shape[1:] == (1, 1):  # as solvers know it
            return self._scattered(2, dome_pair(summed, differing, crosstalk))
        return self._scattered(2, Followed(ReflectedViews(summed, differing), crosstalk))

    def facts(self, weights: NDArray[np.float64]) -> dict[str, str]:
        """What a reader should know of it: heading -> text; by weights of luminance."""
        facts = {}
        if self.scatters:
            shares = ", ".join(f"{name} {each.share:.2%}" for name, each in self.scatters.items())
            facts["Scattered light"] = (
                f"{shares} of all light, at a throw of {self.throw:g} m (ABg)"
            )
        if self.room is not None:
            view = self._reflected(9, 16, 0.0)
            white = np.ones(view.shape)
            back = float(np.mean((view.linear(white) - white) @ weights))
            width, height, length = self.room.size
            facts["Room"] = (
                f"{width:g} x {height:g} x {length:g} m, sends {back:.2%} of a white frame's light "
                f"back to the screen, whose gain is {self.room.gain:g}"
            )
        return facts

    def _reflected(self, rows: int, cols: int, black: float) -> LowRankObservation:
        return room_observation(self.room, rows, cols, black)

    def _scattered(self, views: int, then: AdjointObservation) -> AdjointObservation:
        if not self.scatters:
            return then
        shape = (views, *then.shape[1:])
        scatters = list(self.scatters.values())
        return Followed(Glare(shape, self.size, self.throw, scatters), then)


def way_of(file: OnItsWay, *, polarised: bool = False) -> LightsWay | None:
    """Light's way as a file describes it; None if it does not."""
    if file.lens is None and file.room is None:
        return None
    screen, sections = file.screen, {LENS: file.lens, PORT_GLASS: file.port_glass}
    return LightsWay(
        (screen.width_m, screen.height_m),
        1.0 if file.lens is None else file.lens.throw_m,
        {name: each.scatter for name, each in sections.items() if each is not None},
        None if file.room is None else file.room.box(screen),
        polarised or (file.room is not None and bool(file.room.polarised)),
    )


@final
@dataclass(frozen=True, eq=False)
class CinemaScene(Scene):
    """A 2-D cinema: its projector, its screen and room, its audience.

    Parameters
    ----------
    name, description
        What it is called and is.
    projector
        Its projector.
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    way
        What happens to light on its way.
    ambient
        Luminance of the unlit screen (projector black and stray light), cd/m².
    grade
        What belongs to the grade of masters.
    file
        What commands call it: its file's path, or the name of a bundled one.
    content
        SHA-256 of what its file says, and of files that are named there; "" without a file.
    chosen
        None: all seats see the same.
    """

    name: str
    description: str
    projector: Projector
    viewing: Viewing
    sources: Mapping[str, str]
    way: LightsWay
    ambient: float
    grade: Grade = SCREENS
    file: str = field(default="", compare=False)
    content: str = field(default="", compare=False)
    chosen: tuple[str, ...] = field(default=(), init=False)

    @property
    def views(self) -> int:
        """One."""
        return 1

    @property
    def size(self) -> tuple[float, float]:
        """(width, height) of the screen, m."""
        return self.way.size

    @property
    def pollution(self) -> str:
        """See `Scene`."""
        return "scattered and reflected"

    @property
    def masters(self) -> str:
        """See `Scene`."""
        return "one picture"

    @property
    def places(self) -> dict[str, NDArray[np.float64]]:
        """Where it is looked from: name -> (xyz), m from the middle of the screen."""
        return {"viewing distance": np.array([0.0, -self.viewing.distance, 0.0])}

    @property
    def lenses(self) -> list[tuple[float, ...]]:
        """Places of its projectors, if they are described: (xyz), m."""
        return self.way.lenses

    def asked(self, transport: Path | None, seat: str | None) -> CinemaScene:
        """See `Scene`; there is nothing to ask for."""
        for option, value in (("--transport", transport), ("--seat", seat)):
            if value is not None:
                raise InputError(
                    f"{option} {value}: {self.name} is a 2-D cinema, whose room its scene "
                    f"file describes, the same for all seats; leave it out"
                )
        return self

    @property
    def approximation(self) -> str | None:
        """See `Scene`."""
        return self.way.approximation

    @property
    def unlit(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Scene`."""
        black = self.projector.black
        return np.full((1, 3), black), np.full((1, 3), self.ambient - black)

    def observation(self, rows: int, cols: int) -> AdjointObservation:
        """See `Scene`."""
        return self.way.one_view(rows, cols, self.ambient / self.projector.white)

    def uncertain(self, rows: int, cols: int) -> Uncertain | None:
        """Returns None, as nothing is known of how sure its figures are."""
        return None

    def screen(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """See `Scene`: all of the picture."""
        return np.ones((rows, cols), np.bool_)

    def pixel_areas(self, rows: int, cols: int) -> NDArray[np.floating]:
        """See `Scene`."""
        return np.broadcast_to(self.size[0] * self.size[1] / (rows * cols), (rows, cols))

    def facts(self) -> dict[str, str]:
        """What a reader of results should know of it: heading -> text."""
        return {
            "Cinema": f"{self.name}, screen {self.size[0]:g} x {self.size[1]:g} m, seen from "
            f"{self.viewing.distance:g} m",
            "Projector": f"white {self.projector.white:g} cd/m², black "
            f"{self.projector.black:g} cd/m², {self.projector.primaries} primaries",
            "Light without a picture": self.graded,
            **self.way.facts(self.projector.luminance_weights),
        }


def cinema(file: CinemaFile) -> CinemaScene:
    """The 2-D cinema that a file describes."""
    lit, way = file.projector, way_of(file)
    assert way is not None
    return CinemaScene(
        name=file.name,
        description=file.description,
        projector=Projector(
            lit.primaries, lit.white_cd_m2, lit.black_cd_m2, response=response_of(lit)
        ),
        viewing=viewing.of_flat_screen(
            *way.size, file.viewing.distance_m, file.viewing.adaptation_cd_m2
        ),
        sources=file.sources,
        way=way,
        ambient=lit.black_cd_m2 + file.ambient.luminance_cd_m2,
        grade=file.grade.over(SCREENS),
    )
