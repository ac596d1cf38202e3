"""Overlays of a show: what a server composites over frames, by pictures or timed text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np

from compensate.overlay import Overlay
from compensate.shows.timed_text import Place, Reel, read_reel, reel_in
from domesim.errors import InputError
from domesim.frames import Master, read_frame
from domesim.frames.alpha import opacity as opacity_of
from domesim.light import Light
from domesim.scene import Scene
from domesim.scene.screening import decoded
from domesim.shows.checksums import sum_of
from domesim.shows.sequences import files_by_number, number_of
from domesim.shows.show import Show

Numbered: TypeAlias = tuple[tuple[int | None, Path], ...]
"""Pictures by frame number; None is that of all frames."""


@final
@dataclass(frozen=True)
class Titles:
    """Overlays of a show.

    Parameters
    ----------
    sources
        For both eyes, or of each.
    names
        What they were named as.
    """

    sources: tuple[Numbered | Reel, ...]
    names: tuple[str, ...] = ()

    def of(self, master: Master, scene: Scene) -> Overlay | None:
        """Reads the overlay of a master; None where none is shown.

        Parameters
        ----------
        master
            The frame; or, in small, what it is the mean of.
        scene
            Where it is shown.

        Raises
        ------
        InputError
            If it cannot be read, has no alpha, or fills frames of another size than the master.
        """
        number = number_of(master.path)
        shape = master.frames[0].pixels.shape[:2]
        read: dict[Path, tuple[Light, Any]] = {}
        light = np.zeros((scene.views, *shape, 3), np.float32)
        clear = np.ones((*light.shape[:3], 1), np.float32)
        shown = False
        for view in range(scene.views):
            source = self.sources[min(view, len(self.sources) - 1)]
            for path, opacity, place in _layers(source, number):
                if path not in read:
                    read[path] = _read(path, scene)
                shown = True
                _draw(path, read[path], opacity, place, view, light[view], clear[view])
        return Overlay(np.clip(light, 0, 1), clear) if shown else None

    def settings(self) -> list[dict[str, str]]:
        """What results depend on: for each eye, SHA-256 by frame number, or of a reel's files."""
        return [
            each.sums() if isinstance(each, Reel) else {str(k): sum_of(path) for k, path in each}
            for each in self.sources
        ]


def titles_of(patterns: Sequence[str], scene: Scene, show: Show) -> Titles | None:
    """Finds the files of overlays.

    Parameters
    ----------
    patterns
        One for both eyes, or left and right: a picture for all frames, or a numbered pattern, of
        which frames without a file have no overlay; or the XML of timed text, or its folder.
    scene
        Where they are shown.
    show
        All frames that they are shown over.

    Returns
    -------
    titles
        None for no pattern.

    Raises
    ------
    InputError
        If there are no such files, the scene is not a pair on a flat screen, or as for `read_reel`.
    """
    if not patterns:
        return None
    if scene.views != 2 or scene.several_seats or not scene.screen(1, 1).all():
        raise InputError(
            f"--overlay is for pairs on flat screens, seen from one seat, got {scene.name}; leave "
            f"it out"
        )
    if len(patterns) > 2:
        raise InputError(
            f"--overlay is given once for both eyes, or twice for left and right, got it "
            f"{len(patterns)} times"
        )
    sources = tuple(_source(Path(pattern).absolute(), show) for pattern in patterns)
    return Titles(sources, tuple(patterns))


def _source(path: Path, show: Show) -> Numbered | Reel:
    if (xml := reel_in(path)) is not None:
        first = show.moments[0][0]
        return read_reel(xml, first, number_of(first) or 0)
    return files_by_number(path)


def _layers(
    source: Numbered | Reel, number: int | None
) -> Iterator[tuple[Path, float, Place | None]]:
    """Yields pictures that lie on a frame, how opaque they are, and where; None fills it."""
    if isinstance(source, Reel):
        for subtitle, opacity in source.at(source.start if number is None else number):
            yield subtitle.picture, opacity, subtitle.place
        return
    for at, path in source:
        if at in (None, number):
            yield path, 1.0, None
            return


def _read(path: Path, scene: Scene) -> tuple[Light, Any]:
    """Light over black (row, col, primary), and alpha (row, col), 0..1."""
    frame = read_frame(path, colour=scene.projector.response)
    if frame.header.alpha is None:
        raise InputError(
            f"{path}: wanted an overlay with alpha, which says where the frames are seen, got "
            f"none. Export it with alpha (PNG, EXR or TIFF)."
        )
    light = decoded(Master((frame, frame), "files"), scene)[0]
    return light, opacity_of(frame.header.extra[frame.header.alpha])


def _draw(
    path: Path,
    picture: tuple[Light, Any],
    opacity: float,
    place: Place | None,
    view: int,
    light: Light,
    clear: Any,
) -> None:
    """Composites a picture over what lies on a view already."""
    colour, alpha = picture
    (rows, cols), (height, width) = light.shape[:2], alpha.shape
    if place is None and (height, width) != (rows, cols):
        raise InputError(
            f"{path}: wanted an overlay of the frames' size, {cols} x {rows} px, got {width} x "
            f"{height}. Render it alike."
        )
    top, left = (0, 0) if place is None else place.corner(view, (rows, cols), (height, width))
    down, across = (
        slice(max(at, 0), max(at + side, 0)) for at, side in ((top, height), (left, width))
    )
    under, let = light[down, across], clear[down, across]
    inside = (
        slice(down.start - top, down.start - top + under.shape[0]),
        slice(across.start - left, across.start - left + under.shape[1]),
    )
    through = (1 - opacity * alpha[inside])[..., None]
    under[:] = opacity * colour[inside] + through * under
    let[:] *= through
