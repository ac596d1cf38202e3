"""A scene: a display, its projectors and its audience, as all commands see it."""

from __future__ import annotations

import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from domesim.host.values import ByValue
from domesim.observation.base import Observation
from domesim.observation.projector import Projector
from domesim.observation.uncertain import Uncertain
from domesim.room.viewing import Viewing
from domesim.scene.grade import Grade


class Scene(ByValue, ABC):
    """What is projected, where it falls, and who looks.

    Scenes of the same content are equal, and may be keys.

    Attributes
    ----------
    name, description
        What it is called and is.
    projector
        Its projector; of a stereo system, what an eye sees of its own projector.
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    file
        What commands call it.
    content
        SHA-256 of what its file says, and of files that are named there; "" without a file.
    chosen
        The seats that are looked from, where each sees something else.
    grade
        What of light without a picture, and of colours beyond the projector, masters keep.
    """

    name: str
    description: str
    projector: Projector
    viewing: Viewing
    sources: Mapping[str, str]
    file: str
    content: str
    chosen: tuple[str, ...]
    grade: Grade

    @property
    def argument(self) -> str:
        """Name or path of the scene, quoted for a shell."""
        return shlex.quote(self.file or self.name)

    @property
    @abstractmethod
    def views(self) -> int:
        """Views of its masters: 1, 2 (left, right), or more."""

    @property
    @abstractmethod
    def pollution(self) -> str:
        """The light that pollutes its pictures, in words."""

    @property
    @abstractmethod
    def masters(self) -> str:
        """Kind of its masters, in words."""

    @property
    def several_seats(self) -> bool:
        """Whether it is looked at from several seats at once."""
        return len(self.chosen) > 1

    @abstractmethod
    def asked(self, transport: Path | None, seat: str | None) -> Scene:
        """The same scene as options of a command ask for it.

        Parameters
        ----------
        transport
            A file of what was stored of it: light transport, or crosstalk maps.
        seat
            The seat that it is looked at from, or "all" of them.

        Raises
        ------
        InputError
            If it has no such thing.
        """

    @property
    @abstractmethod
    def unlit(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(view, primary) of the projector's black, and of other light without a picture, cd/m²."""

    @property
    def kept(self) -> NDArray[np.float64]:
        """(view, primary) light without a picture that belongs to the grade, 1 = white."""
        return np.asarray(self.grade.kept(*self.unlit) / self.projector.white, np.float64)

    @property
    def graded(self) -> str:
        """Says in one sentence what becomes of light without a picture."""
        weights = self.projector.luminance_weights
        return self.grade.told(*(float(np.mean(each @ weights)) for each in self.unlit))

    def with_grade(
        self, black: str | None = None, ambient: str | None = None, gamut: str | None = None
    ) -> Self:
        """The same scene with another choice of what belongs to the grade.

        Parameters
        ----------
        black, ambient, gamut
            As of `Grade`; None for what the scene says.

        Returns
        -------
        scene
            With that choice.

        Raises
        ------
        InputError
            If there is no such choice.
        """
        grade = self.grade.but(black, ambient, gamut)
        return self if grade == self.grade else replace(self, grade=grade)  # type: ignore[type-var]

    @property
    @abstractmethod
    def approximation(self) -> str | None:
        """Says in one line that `observation` is an approximation; None if it is exact."""

    @abstractmethod
    def observation(self, rows: int, cols: int) -> Observation:
        """What the audience sees of frames of one size.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        observation
            It takes light (view, row, col, primary).

        Raises
        ------
        InputError
            If frames of that size cannot be shown.
        """

    def solvable(self, rows: int, cols: int) -> Observation:
        """`observation` in the form that solvers need.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        observation
            Of the same light.
        """
        return self.observation(rows, cols)

    @abstractmethod
    def uncertain(self, rows: int, cols: int) -> Uncertain | None:
        """What the audience sees of frames of one size, and how sure that is.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        uncertain
            None if nothing was measured.
        """

    @abstractmethod
    def screen(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """Pixels that lie on the screen; the others neither count nor change.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        screen
            (row, col) bool.
        """

    @abstractmethod
    def pixel_areas(self, rows: int, cols: int) -> NDArray[np.floating]:
        """Areas of pixels on the screen.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        areas
            (row, col), m².
        """

    @abstractmethod
    def facts(self) -> dict[str, str]:
        """Facts for readers of results: heading -> text."""
