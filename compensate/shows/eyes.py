"""A pair's eyes, looked at before its first frame is done."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

import numpy as np

from compensate.vision.binocular.exchanged import Votes, votes_of
from domesim.errors import InputError
from domesim.frames import Master
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.scene import Scene, StereoScene
from domesim.scene.screening import decoded
from domesim.shows.first_look import shown

BRIGHTER = 1.2
"""Ratio of two eyes' mean light beyond which one looks brighter than the other."""
_COLS = 512  # to which pictures are averaged
_NARROWEST = 64


def votes(light: Light, scene: Scene) -> Votes:
    """Lets the strips of a master pair vote, in small.

    Parameters
    ----------
    light
        (2, row, col, primary).
    scene
        Where it is shown.

    Returns
    -------
    votes
        None of pictures that are too narrow.
    """
    left, right = _small(light, scene)
    return votes_of(left, right) if left.shape[1] >= _NARROWEST else Votes(0, 0)


def told(counted: Votes) -> str | None:
    """Says that eyes look exchanged, in a clause; None if they do not."""
    if not counted.exchanged:
        return None
    return (
        f"left and right look exchanged: of {counted.count} strips that one eye alone sees, "
        f"{counted.behind / counted.count:.0%} look like what is behind"
    )


def doubt(masters: Iterable[Master], scene: Scene) -> str | None:
    """Asks about a show of pairs, by some of its frames.

    Parameters
    ----------
    masters
        The frames.
    scene
        Where they are shown; only a scene of pairs asks anything.

    Returns
    -------
    question
        As of `Recipe.doubt`. Which eye is which is asked on flat screens only, and with OpenCV.

    Raises
    ------
    HopelessError
        If they are no pairs.
    """
    counted, light = Votes(0, 0), np.zeros(2)
    flat = isinstance(scene, StereoScene) and find_spec("cv2") is not None
    first = ""
    for master in shown(masters, scene):
        try:
            pair = decoded(master, scene)
        except InputError:  # too bright, which the job will say
            continue
        first = first or " and ".join(map(str, master.paths))
        light += [float(view.mean()) for view in _small(pair, scene)]
        if flat:
            found = votes(pair, scene)
            counted += found if found.enough else Votes(0, 0)
    if line := told(counted):
        return f"{first}: {line}. Exchange them, or add --as-given if they are right."
    if line := _exposure(*light):
        return (
            f"{first}: wanted left and right of one exposure, got {line}. Correct one of them, or "
            f"add --as-given if they are meant to be so."
        )
    return None


def _exposure(left: float, right: float) -> str | None:
    """Says that one eye is brighter; None if both are alike, or as dark as black."""
    dark, bright = sorted((left, right))
    if bright <= BRIGHTER * dark:
        return None
    ratio = f"{bright / dark:.2f} times as bright as" if dark > 0 else "bright, and black"
    one, other = ("left", "right") if left > right else ("right", "left")
    return f"{one} {ratio} {other}"


def _small(light: Light, scene: Scene) -> Light:
    """(view, row, col) luminance in small, white = 1."""
    small = light_means(light, max(1, light.shape[2] // _COLS))
    return np.asarray(scene.projector.luminance(small) / scene.projector.white)
