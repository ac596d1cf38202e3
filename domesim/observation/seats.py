"""Several seats that look at one screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Light, namespace
from domesim.observation.stereo import StereoObservation


@final
class SeveralSeats(StereoObservation):
    """The observations of all seats, one after the other: seen views are left, right, left, ...

    Parameters
    ----------
    seats
        Each seat's observation, all of one shape.

    Raises
    ------
    InputError
        If there is no seat, or their shapes disagree.
    """

    def __init__(self, seats: Sequence[StereoObservation]) -> None:
        shapes = {seat.shape for seat in seats}
        if len(shapes) != 1:
            raise InputError(f"SeveralSeats takes seats of one shape, got {sorted(shapes)}")
        self.seats = tuple(seats)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(2, row, col, primary)."""
        return self.seats[0].shape

    @property
    def seen_shape(self) -> tuple[int, int, int, int]:
        """(2 seats, row, col, primary)."""
        return (2 * len(self.seats), *self.shape[1:])

    @property
    def central(self) -> NDArray[Any]:
        """(seen view, primary, view, primary): the matrices of all seats."""
        return np.concatenate([seat.central for seat in self.seats])

    def of_seat(self, seen: Light, number: int) -> Light:
        """What one seat sees.

        Parameters
        ----------
        seen
            (2 * seats, row, col, primary) what all see, as `observe` returns it.
        number
            The seat, from 0.

        Returns
        -------
        seen
            (2, row, col, primary).
        """
        return seen[2 * number : 2 * number + 2, ...]

    def _observe(self, light: Light) -> Light:
        return namespace(light).concat([seat.observe(light) for seat in self.seats])

    def _direct(self, light: Light) -> Light:
        return namespace(light).concat([light] * len(self.seats))

    def _linear(self, light: Light) -> Light:
        return namespace(light).concat([seat.linear(light) for seat in self.seats])

    def _adjoint(self, light: Light) -> Light:
        result = self.seats[0].adjoint(self.of_seat(light, 0))
        for number, seat in enumerate(self.seats[1:], 1):
            result = result + seat.adjoint(self.of_seat(light, number))
        return result

    def _direct_adjoint(self, light: Light) -> Light:
        result = self.of_seat(light, 0)
        for number in range(1, len(self.seats)):
            result = result + self.of_seat(light, number)
        return result
