"""The aim of several seats of a pair: what the mean seat is shown.

Crosstalk differs from seat to seat, and one picture serves all. What the mean seat would see is
aimed at, as exact subtraction is of that seat too.
"""

from __future__ import annotations

from domesim.observation.base import Observation
from domesim.scene import Scene, StereoScene


def seat_of(scene: Scene, rows: int, cols: int) -> Observation:
    """What is seen at the seat that an aim and subtraction are made for.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    rows, cols
        Of a view, pixels.

    Returns
    -------
    observation
        Of the one seat, or of the mean of several.
    """
    if isinstance(scene, StereoScene) and scene.several_seats:
        return scene.mean_seat(rows, cols)
    return scene.solvable(rows, cols)
