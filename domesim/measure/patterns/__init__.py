"""Test patterns: what to project before a camera or a meter, as code values.

A pattern lights one region of the screen in one colour, for each view, on black. A pixel is lit
wholly or not at all, for then what is lit does not depend on the response that is to be measured.
`patterns_dome` and `patterns_stereo` have the sets, `patterns_list` the list that goes with the
files, `patterns_page` the page that says what to do with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames import Pixels

Mask: TypeAlias = NDArray[np.bool_]
Colour: TypeAlias = tuple[float, float, float]
Kind = Literal[
    "black",
    "white",
    "primary",
    "ramp",
    "grey to grey",
    "half",
    "sector",
    "ring",
    "checkerboard",
    "shifted",
    "patch",
    "registration",
]

BLACK: Colour = (0.0, 0.0, 0.0)
CHANNELS: Mapping[str, Colour] = {"W": (1, 1, 1), "R": (1, 0, 0), "G": (0, 1, 0), "B": (0, 0, 1)}
"""Channel of the readings -> its full colour."""
WORDS = {"W": "white", "R": "red", "G": "green", "B": "blue"}

MOST_LEVELS = 64
_DISPLAY_GAMMA = 2.2


@final
@dataclass(frozen=True)
class Pattern:
    """One picture to project.

    Parameters
    ----------
    name
        Short, of letters, digits, points and hyphens: it becomes a file's.
    kind
        What it is for.
    lit
        What is lit, in words.
    colours
        (view,) R, G, B code values of what is lit.
    mask
        (rows, cols) of the picture -> (view, row, col), or (1, row, col) for all views: what is.
    parameters
        Where and how, for programs: plain JSON.
    """

    name: str
    kind: Kind
    lit: str
    colours: tuple[Colour, ...]
    mask: Callable[[int, int], Mask]
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def codes(self, rows: int, cols: int) -> Pixels:
        """(view, row, col, primary) code values, 0..1."""
        return self.painted(self.mask(rows, cols))

    def painted(self, mask: Mask) -> Pixels:
        """`codes` of a mask that is at hand already."""
        colours = np.asarray(self.colours, np.float32)
        return np.where(mask[..., None], colours[:, None, None], np.float32(0))

    def lit_share(self, mask: Mask, areas: NDArray[np.floating]) -> list[float]:
        """For each view the share of the screen's area that is lit.

        Parameters
        ----------
        mask
            This pattern's.
        areas
            (row, col) of the screen, 0 off it.
        """
        total = float(areas.sum())
        masks = np.broadcast_to(mask, (len(self.colours), *areas.shape))
        return [
            float(areas[on].sum()) / total if any(colour) else 0.0
            for on, colour in zip(masks, self.colours, strict=True)
        ]


@final
@dataclass(frozen=True)
class Codes:
    """Which code values a file of patterns can hold.

    Parameters
    ----------
    bits
        Bits of a sample.
    floating
        Whether it is a float.
    transfer
        Name of the transfer function.
    """

    bits: int
    floating: bool
    transfer: str

    def nearest(self, value: float) -> float:
        """The code value that is stored for `value`, in 0..1."""
        if self.floating:
            return float(np.float16(value) if self.bits == 16 else np.float32(value))
        largest = 2**self.bits - 1
        return float(round(value * largest) / largest)

    def ramp(self, count: int) -> tuple[float, ...]:
        """Rising levels between black and full, `count` equal steps.

        The steps of linear light are those of a display of gamma 2.2, or most were near white.

        Raises
        ------
        InputError
            If there are fewer than 4 steps, more than 64, or more than codes.
        """
        if not 4 <= count <= MOST_LEVELS:
            raise InputError(f"--levels must lie in 4..{MOST_LEVELS}, got {count}")
        exponent = _DISPLAY_GAMMA if self.transfer == "linear" else 1.0
        return tuple(self.nearest((k / count) ** exponent) for k in range(1, count))

    def level_in_words(self, level: float) -> str:
        """``code 128 of 255``, or ``light 0.218`` of linear files."""
        if self.floating:
            return f"{'light' if self.transfer == 'linear' else 'code'} {level:.4g}"
        largest = 2**self.bits - 1
        return f"code {round(level * largest)} of {largest}"


def scaled(channel: str, level: float) -> Colour:
    """R, G, B of a channel at a level."""
    r, g, b = CHANNELS[channel]
    return r * level, g * level, b * level


# Letters that look like no rotation or reflection of themselves.
_LETTERS = {
    "F": ("#####", "#....", "#....", "####.", "#....", "#....", "#...."),
    "L": ("#....", "#....", "#....", "#....", "#....", "#....", "#####"),
    "R": ("####.", "#...#", "#...#", "####.", "#.#..", "#..#.", "#...#"),
}


def letter(name: str, x: NDArray[np.floating], y: NDArray[np.floating], height: float) -> Mask:
    """Whether points lie on a letter: F, L or R.

    Parameters
    ----------
    name
        The letter.
    x, y
        To the right and down from its centre, any shape.
    height
        Its own, in their unit; it is 5/7 as wide.
    """
    dots = np.array([[dot == "#" for dot in line] for line in _LETTERS[name]])
    rows, cols = dots.shape
    i = np.floor(y / height * rows + rows / 2).astype(np.int64)
    j = np.floor(x / height * rows + cols / 2).astype(np.int64)
    on = (i >= 0) & (i < rows) & (j >= 0) & (j < cols)
    return np.asarray(on & dots[np.clip(i, 0, rows - 1), np.clip(j, 0, cols - 1)])
