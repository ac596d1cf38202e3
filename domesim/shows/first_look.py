"""A look at a few frames of a show before any is done: what is wrong with all is said once.

What a look has found fit is written down in the job's folder, so that a job that goes on does not
look again.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from inspect import GEN_CREATED, getgeneratorstate
from pathlib import Path
from typing import Any

from domesim.errors import HopelessError, InputError, PairError
from domesim.frames import Master
from domesim.frames.video import file_of
from domesim.scene import Scene
from domesim.scene.screening import decoder
from domesim.shows.job import FOLDER
from domesim.shows.sealed import read_sealed, write_sealed
from domesim.shows.show import Show
from domesim.shows.work import Recipe

FRAMES = 10
"""Frames that are looked at, spread over the show."""
_LOOKED = "looked.json"
"""The outcome's file, in a job's folder."""


def look(show: Show, recipe: Recipe, folder: Path, *, repair: bool) -> dict[str, Any] | None:
    """Looks at a show as its recipe asks for, unless a job has done it.

    Parameters
    ----------
    show
        The masters; of a single one nothing is asked, for its only frame will tell.
    recipe
        What is to be done to them.
    folder
        Where results go.
    repair
        As for `Show.read`.

    Returns
    -------
    outcome
        For `keep`; None where no frame was looked at.

    Raises
    ------
    InputError
        If its frames are no pairs, or the recipe doubts them and `Show.as_given` does not say that
        they are right.
    """
    if not show.numbered:
        return None
    count = len(show.moments)
    places = sorted({k * (count - 1) // (FRAMES - 1) for k in range(FRAMES)})
    few = show.some(places)
    outcome = _outcome(few)
    with suppress(OSError, ValueError):
        if read_sealed(folder / FOLDER / _LOOKED) == outcome:
            return None
    masters = _read(few, repair=repair)
    doubt = recipe.doubt(masters)
    if doubt and not show.as_given:
        raise InputError(doubt)
    return None if getgeneratorstate(masters) == GEN_CREATED else outcome


def keep(outcome: dict[str, Any] | None, job: Path) -> None:
    """Writes down in a job's folder what `look` returned."""
    if outcome is not None:
        write_sealed(job / _LOOKED, outcome)


def shown(masters: Iterable[Master], scene: Scene) -> Iterator[Master]:
    """Yields masters that a scene of pairs can show; nothing of another scene's.

    Raises
    ------
    HopelessError
        If they have other views than the scene.
    """
    if scene.views != 2:
        return
    for master in masters:
        try:
            decoder(master, scene)
        except HopelessError:
            raise
        except InputError:  # its own, which the job will say
            continue
        yield master


def _read(show: Show, *, repair: bool) -> Generator[Master]:
    """Reads the masters that can be read."""
    for moment in show.moments:
        try:
            yield show.read(moment, repair=repair)
        except (HopelessError, PairError):
            raise
        except InputError:
            continue


def _outcome(show: Show) -> dict[str, Any]:
    """What the outcome depends on: names, sizes and times of the files, and how they are read."""
    files = {}
    for path in {path for moment in show.moments for path in moment}:
        with suppress(OSError):  # whoever reads it will say so
            status = file_of(path).stat()
            files[str(path.absolute())] = [status.st_size, status.st_mtime_ns]
    read_as = [show.packing, show.layer, str(show.colour), show.as_given]
    return {"files": files, "read as": read_as}
