"""Direct and reflected light of a dome apart, by shifted boards and without a model of the room.

A board of fine fields lights half of the screen [1]. A place that it lights shows its direct light
L_d and half of the light that a white picture reflects to it, L_g; a place that it leaves dark
shows half of L_g alone. With the projectors' black b, as a share of white,

    lit = L_d + (1 + b) L_g / 2        dark = b L_d + (1 + b) L_g / 2
    L_d = (lit - dark) / (1 - b)       L_g = 2 (dark - b lit) / (1 - b²)

Of eight shifts every place is a quarter of a field or more inside lit fields, and inside dark ones,
at least once. Where [1] takes the brightest and the darkest of the photographs, means of those that
are clear of fields' edges are taken here: extremes are pulled apart by noise. With a photograph of
a black picture, which is subtracted, b is 0.

Fields are not infinitely fine. What boards differ by where they are dark is told as an error.

[1] S. K. Nayar, G. Krishnan, M. D. Grossberg, R. Raskar, "Fast separation of direct and global
components of a scene using high frequency illumination", ACM Trans. Graph. 25(3), 935 (2006),
eqs. 6 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.measure.dome.file import Task
from domesim.measure.dome.responses import Responses, responses_of
from domesim.measure.patterns.dome import SHIFTED, SHIFTS
from domesim.room.dome import Dome
from domesim.scene import DomeScene

Floats = NDArray[np.float64]

_SIZE = 256
"""Pixels a side of the domemaster by which a model tells reflected light: it is smooth."""
_FULL = 1 - 1e-6


@final
@dataclass(frozen=True, eq=False)
class Separated:
    """Reflected light over direct light of a white picture, at places of the screen.

    Attributes
    ----------
    places
        (2, place) to the right and down in the domemaster, -1..1.
    direct, reflected
        (place, primary) L_d and L_g, in the photographs' unit.
    ratio, error
        (place, primary) L_g over L_d, and its standard error.
    """

    places: Floats
    direct: Floats
    reflected: Floats
    ratio: Floats
    error: Floats

    @property
    def mean(self) -> Floats:
        """(primary,) mean over the places."""
        return np.asarray(self.ratio.mean(0))

    @property
    def mean_error(self) -> Floats:
        """(primary,) standard error of that: what boards differ by is taken to be common."""
        return np.asarray(self.error.mean(0))


def separated_in(task: Task) -> Separated:
    """Takes apart the light of a survey's photographs of the shifted boards.

    Parameters
    ----------
    task
        The survey. Photographs of other patterns do not count, but for black.

    Raises
    ------
    InputError
        If it lacks photographs of the boards.
    """
    if task.photographs is None:
        raise InputError("wanted photographs of the shifted boards, got readings alone")
    boards = boards_in(task)
    shown = len({*task.photographs.pattern[boards].tolist()})
    if shown < SHIFTS:
        raise InputError(
            f"wanted photographs of all {SHIFTS} patterns {SHIFTED}1 to {SHIFTED}{SHIFTS}, got "
            f"{shown}; domesim measure patterns --dome writes them"
        )
    responses = responses_of(task.scene.theatre, task.patterns, task.photographs, 0)
    dark = np.asarray(~responses.excitation.any((1, 2)))
    black = task.scene.ambient / task.scene.projector.white
    return separated(responses, boards, dark, black)


def boards_in(task: Task) -> NDArray[np.bool_]:
    """(photograph,) which are of the shifted boards."""
    assert task.photographs is not None
    names = np.array([SHIFTED in name for name in task.file.pattern_names])
    return np.asarray(names[task.photographs.pattern])


def separated(
    responses: Responses, boards: NDArray[np.bool_], dark: NDArray[np.bool_], black: float
) -> Separated:
    """Takes direct and reflected light apart.

    Parameters
    ----------
    responses
        What places show.
    boards, dark
        (photograph,) which are of boards, and which of a black picture.
    black
        Black over white, which counts without a photograph of it.

    Raises
    ------
    InputError
        If no place is clear of edges in lit fields and in dark ones.
    """
    value, variance = responses.value[boards], responses.variance[boards]
    most = responses.direct[boards].max(0)
    clear = np.isfinite(variance) & (most > 0)
    lit = clear & (responses.direct[boards] >= _FULL * most)
    unlit = clear & (responses.direct[boards] == 0)
    kept = (lit.any(0) & unlit.any(0)).all(-1)
    if not kept.any():
        raise InputError("no place of the screen is clear of edges in lit fields and in dark ones")
    if dark.any():
        value, black = value - responses.value[dark].mean(0), 0.0
    (bright, bright_error), (shade, shade_error) = (
        _means(value[:, kept], variance[:, kept], chosen[:, kept]) for chosen in (lit, unlit)
    )
    direct = (bright - shade) / (1 - black)
    reflected = 2 * (shade - black * bright) / (1 - black**2)
    ratio = reflected / direct
    # To first order, of black 0: d ratio = 2 d shade / direct - ratio (d bright - d shade) / direct
    error = np.hypot((2 + ratio) * shade_error, ratio * bright_error) / direct
    return Separated(responses.places[:, kept], direct, reflected, ratio, error)


def _means(value: Floats, variance: Floats, chosen: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """(place, primary) means over chosen photographs, and their errors by noise and by boards."""
    count = chosen.sum(0)
    mean = np.where(chosen, value, 0).sum(0) / count
    noise = np.where(chosen, variance, 0).sum(0) / count**2
    square = np.where(chosen, (value - mean) ** 2, 0).sum(0)
    free = np.maximum(count - 1, 0).sum(0)
    # Boards differ by as much at all places: where few are clear, too little is seen of that
    spread = square.sum(0) / np.maximum(free, 1) if free.any() else np.zeros(len(free))
    return mean, np.sqrt(np.maximum(noise, spread / count))


def modelled(scene: DomeScene, places: Floats) -> Floats:
    """(place, primary): reflected light over direct light of a white picture, as a scene has it.

    Parameters
    ----------
    scene
        The theatre, with or without a stored transport.
    places
        (2, place) of its domemaster, -1..1.
    """
    observation = scene.one_view(_SIZE, _SIZE)
    white = np.where(scene.screen(_SIZE, _SIZE)[None, :, :, None], 1.0, np.zeros((1, 1, 1, 3)))
    direct = observation.direct(white)
    reflected = observation.linear(white) - direct
    col, row = np.clip(((places + 1) * (_SIZE / 2)).astype(np.intp), 0, _SIZE - 1)
    return np.asarray(reflected[0, row, col] / direct[0, row, col])


def table(dome: Dome, found: Separated, model: Floats) -> str:
    """The map as CSV: a row a place, in directions from the centre of the dome's sphere.

    Parameters
    ----------
    dome
        The screen.
    found
        What was measured.
    model
        (place, primary) as of `modelled`.
    """
    u, v = found.places
    angle = np.degrees(np.hypot(u, v) * dome.half_angle)
    azimuth = np.degrees(np.arctan2(v, u)) % 360
    names = [f"{what}_{p}" for what in ("ratio", "error", "model") for p in "RGB"]
    rows = np.column_stack([azimuth, angle, found.ratio, found.error, model])
    lines = [",".join(f"{value:.6g}" for value in row) for row in rows]
    return "\n".join([",".join(["azimuth_deg", "angle_deg", *names]), *lines]) + "\n"
