"""Files of overlays: pictures with alpha that a server composites over frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from compensate.overlay import Overlay
from domesim.errors import InputError
from domesim.frames import Frame, Master, read_frame
from domesim.frames.alpha import opacity
from domesim.scene import Scene
from domesim.scene.screening import decoded
from domesim.shows.checksums import sum_of
from domesim.shows.sequences import files_by_number, number_of


@final
@dataclass(frozen=True)
class Titles:
    """Overlays of a show.

    Parameters
    ----------
    files
        For both eyes, or of each: frame numbers and files; None is that of all frames.
    """

    files: tuple[tuple[tuple[int | None, Path], ...], ...]

    def of(self, master: Master, scene: Scene) -> Overlay | None:
        """Reads the overlay of a master; None where none is shown.

        Raises
        ------
        InputError
            If it cannot be read, has no alpha, or another size than the master.
        """
        number = number_of(master.path)
        paths = [
            next((path for at, path in each if at in (None, number)), None) for each in self.files
        ]
        if not any(paths):
            return None
        read = {path: read_frame(path) for path in paths if path is not None}
        frames = [None if path is None else read[path] for path in paths]
        frames = frames if len(frames) == scene.views else frames * scene.views
        there = next(frame for frame in frames if frame is not None)
        none = there.with_pixels(0 * there.pixels)
        light = decoded(Master(tuple(frame or none for frame in frames), "files"), scene)
        clear = np.ones((*light.shape[:3], 1), np.float32)
        for view, frame in enumerate(frames):
            if frame is not None:
                clear[view, ..., 0] -= _opacity(frame, master)
        return Overlay(np.clip(light, 0, 1), clear)

    def settings(self) -> list[dict[str, str]]:
        """What results depend on: for each eye, SHA-256 by frame number."""
        return [{str(number): sum_of(path) for number, path in each} for each in self.files]


def titles_of(patterns: Sequence[str], scene: Scene) -> Titles | None:
    """Finds the files of overlays.

    Parameters
    ----------
    patterns
        One for both eyes, or left and right: a file for all frames, or a numbered pattern. Frames
        that have no file have no overlay.
    scene
        Where they are shown.

    Returns
    -------
    titles
        None for no pattern.

    Raises
    ------
    InputError
        If there are no such files, or the scene is not a pair on a flat screen.
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
    return Titles(tuple(files_by_number(Path(pattern).absolute()) for pattern in patterns))


def _opacity(frame: Frame, master: Master) -> Any:
    """(row, col) alpha of an overlay, 0..1."""
    rows, cols = master.frames[0].pixels.shape[:2]
    if frame.pixels.shape[:2] != (rows, cols):
        height, width = frame.pixels.shape[:2]
        raise InputError(
            f"{frame.path}: wanted an overlay of the frames' size, {cols} x {rows} px, got {width} "
            f"x {height}. Render it alike."
        )
    if frame.header.alpha is None:
        raise InputError(
            f"{frame.path}: wanted an overlay with alpha, which says where the frames are seen, "
            f"got none. Export it with alpha (PNG, EXR or TIFF)."
        )
    return opacity(frame.header.extra[frame.header.alpha])
