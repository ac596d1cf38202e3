"""The pictures of a study: each master by each method, and once spoilt.

For a *room* they are what the theatre is sent: the room itself adds the stray light. For a
*display* at home they are what is seen in the theatre, stray light and all. Both are in the
display's own light, BT.709 primaries and 1.0 = white. What is seen may be brighter than the
projector's white; then all pictures of the study are divided by one factor, and the display's white
must be that much brighter.

The *spoilt* picture is for trials with a right answer. Each view has half of the light of both eyes
and a veil of `VEIL` of white, and is dimmed by as much as that adds: whoever looks sees it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from compensate.pose import Posed, Stage
from compensate.solve import solved
from domesim.frames import ColourTag, Frame, Master, write_frame
from domesim.light import Light
from domesim.light.transfer import named
from domesim.scene import Scene
from domesim.scene.screening import encoded
from validation.audience.design import SPOILT

VEIL = 0.15
"""Light that spoils a picture, of white."""


@final
@dataclass(frozen=True)
class Picture:
    """A master by one condition.

    Attributes
    ----------
    condition
        Its method, or `SPOILT`.
    shown
        (view, row, col, RGB) linear, BT.709, 1.0 = projector white; 0 off the screen.
    frame
        The frame for the theatre's server, in the master's encoding; None for a display.
    """

    condition: str
    shown: Light
    frame: Master | None


def pictures(
    master: Master, scene: Scene, methods: Sequence[str], *, room: bool
) -> Iterator[Picture]:
    """A master by all methods, and spoilt.

    Parameters
    ----------
    master, scene
        What is shown, and where.
    methods
        Names of methods of `compensate.methods`.
    room
        Whether the theatre adds the stray light, or the pictures must have it.

    Raises
    ------
    InputError
        If the scene has no such method, or the frame is no master for it.
    """
    posed, _ = Stage(scene).pose_frame(master)
    for method in methods:
        light = solved(posed, method).light
        if method == methods[0]:
            yield _picture(master, posed, SPOILT, spoilt(light, posed), room=room)
        yield _picture(master, posed, method, light, room=room)


def spoilt(light: Light, posed: Posed) -> Light:
    """Light (view, row, col, primary) that everybody sees is worse."""
    both = (light + light[::-1]) / 2
    on = posed.screen[None, :, :, None]
    return np.asarray(np.where(on, (both + VEIL) / (1 + VEIL), light), light.dtype)


def _picture(master: Master, posed: Posed, condition: str, light: Light, *, room: bool) -> Picture:
    screen = posed.screen[None, :, :, None]
    shown = light if room else posed.seen(light)
    display = np.maximum(posed.scene.projector.to_display(shown), 0) * screen
    frame = encoded(master, light, posed.scene, posed.screen)[0] if room else None
    return Picture(condition, np.asarray(display, np.float32), frame)


def write_picture(shown: Light, stem: Path, *, white: float) -> None:
    """Write a picture for a browser, 8 bit sRGB and dithered; a file for each view.

    Parameters
    ----------
    shown
        As of `Picture`.
    stem
        Its path without the suffix.
    white
        Light that becomes the display's white.
    """
    curve = named("srgb", white=1.0)
    colour = ColourTag("srgb", "BT.709", "a study's picture")
    ends = ("",) if len(shown) == 1 else ("_L", "_R")
    for number, (view, end) in enumerate(zip(shown, ends, strict=True)):
        codes = np.asarray(np.clip(curve.encode(np.clip(view / white, 0, 1)), 0, 1), np.float32)
        # Whose numbers the noise depends on: two eyes have noise of their own
        source = stem.with_name(f"{stem.name}-{number}.png")
        frame = Frame(codes, source, colour, 8, floating=False)
        path = stem.with_name(f"{stem.name}{end}.png")
        write_frame(frame, path, bits=8, dither=True)


def brightest(shown: Mapping[str, Light]) -> float:
    """Light that white must be, so that no picture is clipped: at least 1."""
    return max(1.0, *(float(light.max()) for light in shown.values()))


Progress = Callable[[str], None]
