"""A pair's eyes, looked at before its first frame is done."""

from __future__ import annotations

from importlib.util import find_spec

from compensate.vision.binocular.exchanged import Votes, votes_of
from domesim.errors import InputError
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.scene import Scene
from domesim.scene.screening import decoded
from domesim.shows.show import Show

FRAMES = 10
"""Frames of a show that are looked at."""
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
    small = light_means(light, max(1, light.shape[2] // _COLS))
    left, right = scene.projector.luminance(small) / scene.projector.white
    return votes_of(left, right) if left.shape[1] >= _NARROWEST else Votes(0, 0)


def told(counted: Votes) -> str | None:
    """Says that eyes look exchanged, in a line; None if they do not."""
    if not counted.exchanged:
        return None
    return (
        f"left and right may be exchanged: of {counted.count} strips that one eye alone sees, "
        f"{counted.behind / counted.count:.0%} look like what is behind, usual are 57 to 81%. Look "
        f"at a frame; exchange --left and --right if they are"
    )


def exchanged(show: Show, scene: Scene, *, repair: bool) -> str | None:
    """Looks at frames of a show, spread over it.

    Parameters
    ----------
    show, scene
        Of pairs; of anything else nothing is said.
    repair
        As for `Show.read`.

    Returns
    -------
    told
        A line if left and right look exchanged, else None; None also without OpenCV.
    """
    if scene.views != 2 or show.allow_identical or find_spec("cv2") is None:
        return None
    count, found = len(show.moments), Votes(0, 0)
    for place in sorted({k * (count - 1) // max(FRAMES - 1, 1) for k in range(FRAMES)}):
        try:
            master = show.read(show.moments[place], repair=repair)
            found += votes(decoded(master, scene), scene)
        except InputError:  # the job will say it
            continue
    return told(found)
