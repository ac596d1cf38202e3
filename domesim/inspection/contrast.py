"""System contrast of a flat cinema, as engineers state it, and its causes.

*Sequential*: a full white frame over a full black one, on the screen. *ANSI*: the mean of the 8
white fields of a checkerboard of 4 x 4 over the mean of its 8 black ones, read in their middles, of
the board and its complement (IT7.228; SMPTE RP 431-2 calls it intra-frame contrast). Both are of
the whole system in its room. Both eyes of a pair get the same picture.

A part's light is what black fields get more of where it alone pollutes. Parts add up, but for what
is scattered and then reflected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal, ratio
from domesim.scene import FlatScene
from domesim.scene.flat import LightsWay

Floats = NDArray[np.floating]

FIELDS = 4
"""The board has so many fields either way."""
PROJECTOR = "projector's black"
"""Name of the part that is there without a picture, stray light included."""
_FIELD = 25  # pixels a side of a field
_MIDDLE = 0.2  # of a field, that is read


@final
@dataclass(frozen=True)
class Contrast:
    """Luminances read off a screen, cd/m².

    Attributes
    ----------
    white, black
        Full frames, mean over the screen.
    lit, dark
        White and black fields of the checkerboard.
    parts
        Name -> light of it in the black fields.
    """

    white: float
    black: float
    lit: float
    dark: float
    parts: Mapping[str, float]

    @property
    def sequential(self) -> float | None:
        """White over black; None if black has no light."""
        return self.white / self.black if self.black > 0 else None

    @property
    def ansi(self) -> float | None:
        """Lit over dark; None if dark fields have no light."""
        return self.lit / self.dark if self.dark > 0 else None

    def share(self, name: str) -> float:
        """Share of a part in the light of black fields; 0 if these have none."""
        return self.parts[name] / self.dark if self.dark > 0 else 0.0

    def figures(self) -> dict[str, float | dict[str, float] | None]:
        """Returns the figures by name, for programs."""
        return {
            "white_cd_m2": self.white,
            "black_cd_m2": self.black,
            "sequential_contrast": self.sequential,
            "ansi_white_cd_m2": self.lit,
            "ansi_black_cd_m2": self.dark,
            "ansi_contrast": self.ansi,
            "ansi_black_parts_cd_m2": dict(self.parts),
        }

    def lines(self) -> list[str]:
        """Returns the lines that commands say."""
        parts = ", ".join(
            f"{name} {decimal(light)} ({self.share(name):.0%})"
            for name, light in self.parts.items()
        )
        return [
            f"Sequential contrast: {ratio(self.sequential)} (white {decimal(self.white)}, black "
            f"{decimal(self.black)} cd/m²)",
            f"ANSI contrast: {ratio(self.ansi)} (white fields {decimal(self.lit)}, black fields "
            f"{decimal(self.dark)} cd/m²)",
            *([f"Light in black fields, cd/m²: {parts}"] if self.dark > 0 else []),
        ]


def contrast(scene: FlatScene) -> Contrast:
    """System contrast of a flat cinema.

    Raises
    ------
    InputError
        If its scene file describes neither lens nor room.
    """
    way = _way(scene)
    both = _boards()
    black, white, *seen = _seen(scene, np.stack([0 * both[0], 0 * both[0] + 1, *both]))
    lit, dark = means(both, np.stack(seen))
    parts = {PROJECTOR: float(black.mean())}
    for name in way.parts:
        alone = replace(scene, way=way.only(name))
        parts[name] = means(*boards(alone))[1] - parts[PROJECTOR]
    return Contrast(float(white.mean()), float(black.mean()), lit, dark, parts)


def boards(scene: FlatScene) -> tuple[Floats, Floats]:
    """Returns the checkerboard and its complement, and what is seen of them, cd/m²."""
    both = _boards()
    return both, _seen(scene, both)


def means(boards_: Floats, seen: Floats) -> tuple[float, float]:
    """(lit, dark): means in the middles of the fields of (board, row, col) `boards`."""
    inside = np.ones(boards_.shape[1:], bool)
    for axis in range(2):
        count: int = inside.shape[axis]
        place = (np.arange(count) + 0.5) / count * FIELDS % 1
        middle = np.abs(place - 0.5) < _MIDDLE / 2
        inside &= middle[:, None] if axis == 0 else middle
    lit, dark = (float(seen[(boards_ == level) & inside].mean()) for level in (1, 0))
    return lit, dark


def _way(scene: FlatScene) -> LightsWay:
    if scene.way is None:
        raise InputError(
            f"{scene.name}: system contrast needs to know what pollutes it, got neither [lens] "
            f"nor [room]; describe them in the scene file"
        )
    return scene.way


def _boards() -> Floats:
    """(board, row, col): the checkerboard and its complement."""
    fields = np.add.outer(np.arange(FIELDS), np.arange(FIELDS)) % 2
    board = np.kron(fields, np.ones((_FIELD, _FIELD)))
    return np.stack([board, 1 - board])


def _seen(scene: FlatScene, pictures: Floats) -> Floats:
    """(picture, row, col) luminance of grey pictures, mean over the eyes, cd/m²."""
    observation, weights = scene.observation(*pictures.shape[1:]), scene.projector.luminance_weights
    luminances = []
    for picture in pictures:
        light = np.broadcast_to(picture[None, :, :, None], observation.shape).copy()
        luminances.append(
            (observation.observe(light) @ weights).mean(axis=0) * scene.projector.white
        )
    return np.stack(luminances)
