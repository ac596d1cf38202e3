"""The path tracer as an observation: what the audience sees in a theatre, with its uncertainty.

It has no adjoint (it is noisy); `domesim.pathtrace.tabulate` brings it to the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Light, require_light
from domesim.observation.base import Observation
from domesim.pathtrace.tracer import CENTRE, Progress, Settings, Status, Traced, Tracer
from domesim.room.theatre import Theatre


@final
@dataclass(frozen=True)
class Observed:
    """Parts of what is seen, each (1, row, col, primary); 1.0 = projector white.

    Attributes
    ----------
    direct
        Direct light; it is computed, not traced, and exact.
    indirect
        Light that has bounced, with standard errors.
    ambient
        Light that is there without a picture, with standard errors; None if there is none.
    """

    direct: Light
    indirect: Traced
    ambient: Traced | None

    @property
    def mean(self) -> Light:
        """Everything together, but for the projectors' black."""
        total = self.direct + self.indirect.mean[None]
        if self.ambient is not None:
            total = total + self.ambient.mean[None]
        return total

    @property
    def standard_error(self) -> Light:
        """Standard error of `mean`, in the same shape."""
        square = self.indirect.standard_error[None] ** 2
        if self.ambient is not None:
            square = square + self.ambient.standard_error[None] ** 2
        return np.sqrt(square)


@final
class PathTracedDome(Observation):
    """What an eye in a theatre sees of a domemaster, by path tracing.

    Direct light is computed analytically (lenses, blending, falloff, shadows, the screen's lobe);
    indirect light is traced.

    Parameters
    ----------
    theatre
        The theatre.
    rows, cols
        Size of the domemaster.
    settings
        How accurate, and from which seed.
    black
        What is seen of a black picture of the projectors themselves, 1.0 = projector white: of all
        of the screen, or (row, col, primary).
    eye
        Where the eye is, m in the room's frame; a Lambertian screen looks the same from everywhere.
    tracer
        Tracer of the same theatre, to share.
    progress
        Called to tell how the work gets on.

    Raises
    ------
    InputError
        If the picture is not square, or the theatre impossible.
    """

    def __init__(
        self,
        theatre: Theatre,
        rows: int,
        cols: int,
        settings: Settings | None = None,
        *,
        black: float | NDArray[np.floating] = 0.0,
        eye: tuple[float, float, float] = CENTRE,
        tracer: Tracer | None = None,
        progress: Progress | None = None,
    ) -> None:
        self._screen = theatre.dome.inside(rows, cols)
        self._settings = Settings() if settings is None else settings
        self._tracer = Tracer(theatre) if tracer is None else tracer
        self._eye, self._black, self._progress = eye, black, progress
        self._ambient: Traced | None = None
        x, y, z = np.asarray(eye) @ theatre.dome.to_room
        if not theatre.dome.encloses((float(x), float(y), float(z))):
            raise InputError(f"the eye must be inside the dome, got {eye} m from its centre")

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(1, row, col, primary)."""
        rows, cols = self._screen.shape
        return 1, rows, cols, 3

    @property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col) bool: pixels whose centre is on the screen."""
        return self._screen

    @property
    def tracer(self) -> Tracer:
        """The tracer that is used."""
        return self._tracer

    def trace(self, light: Light) -> Observed:
        """The parts of what is seen of `light` (1, row, col, primary), with standard errors.

        Raises
        ------
        ValueError
            If `light` has not this observation's shape.
        """
        require_light(light, self.shape, who=f"{type(self).__name__} observes")
        rows, cols = self._screen.shape
        picture = np.where(self._screen[..., None], np.asarray(light)[0], 0)
        source = self._tracer.picture(picture)
        lit = bool(self._tracer.theatre.lamps) and self._ambient is None
        parts = 2 if lit else 1
        indirect = self._tracer.screen(
            source,
            rows,
            cols,
            self._settings,
            eye=self._eye,
            progress=part_of(self._progress, 0, parts),
        )
        ambient = self._ambient
        if lit:
            # As sure as the picture's light, which is what it will be added to
            ambient = self._tracer.screen(
                self._tracer.lamps(),
                rows,
                cols,
                in_haste(self._settings, indirect),
                eye=self._eye,
                direct=True,
                reference=float(indirect.mean[self._screen].mean()),
                progress=part_of(self._progress, 1, parts),
            )
            if Status.INTERRUPTED not in (indirect.status, ambient.status):
                self._ambient = ambient
        return Observed(self._direct(light), indirect, ambient)

    def _observe(self, light: Light) -> Light:
        observed = self.trace(light)
        return np.asarray(observed.mean + self._dark, light.dtype)

    def _direct(self, light: Light) -> Light:
        return np.asarray(light) * self._seen_gain.astype(light.dtype)[None]

    @cached_property
    def _dark(self) -> NDArray[Any]:
        """(1, row, col, primary): the projectors' black."""
        return np.asarray(self._black * self._screen[None, :, :, None])

    @cached_property
    def _seen_gain(self) -> NDArray[Any]:
        rows, cols = self._screen.shape
        return self._tracer.seen_gain(rows, cols, self._eye)


def part_of(progress: Progress | None, number: int, parts: int) -> Progress | None:
    """Progress of one of several equal parts of a work.

    Parameters
    ----------
    progress
        That of the whole, if anybody listens.
    number, parts
        The part, from 0, and their number.

    Returns
    -------
    progress
        The share that it reports never shrinks.
    """
    if progress is None:
        return None
    largest = 0.0

    def part(done: float, how: str) -> None:
        # What is left is an estimate, which may grow.
        nonlocal largest
        largest = max(largest, done)
        progress((number + largest) / parts, how)

    return part


def in_haste(settings: Settings, before: Traced) -> Settings:
    """Settings of a picture that follows another.

    Parameters
    ----------
    settings
        Those of both.
    before
        What was traced first.

    Returns
    -------
    settings
        With the fewest samples if `before` was interrupted; else the same.
    """
    if before.status is not Status.INTERRUPTED:
        return settings
    return replace(settings, most=settings.least)
