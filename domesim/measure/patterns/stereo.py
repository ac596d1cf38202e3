"""Test patterns for a 3D screen: each eye's picture alone, and pairs of levels for both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from domesim.measure.patterns import (
    BLACK,
    CHANNELS,
    WORDS,
    Codes,
    Colour,
    Kind,
    Mask,
    Pattern,
    letter,
    scaled,
)
from domesim.readings.meter import EYES

Region: TypeAlias = Callable[[int, int], Mask]
"""(rows, cols) -> (row, col)"""

GREYS = 5
"""Levels of each eye, 0 and 1 among them, of which all pairs are shown."""
BOARDS = ((4, 2), (16, 8))
"""Columns and rows of the checkerboards, even."""
PATCH, MARKER = 0.08, 0.012
"""Radius over the picture's height."""
PLACES = {
    f"{row}-{col}": (x, y)
    for row, y in (("top", 0.15), ("middle", 0.5), ("bottom", 0.85))
    for col, x in (("left", 0.1), ("centre", 0.5), ("right", 0.9))
}
"""Shares of the picture's width and height."""
_LETTER_HEIGHT = 0.14


def stereo_patterns(codes: Codes, levels: int) -> tuple[Pattern, ...]:
    """All patterns, in the order in which they are projected.

    Parameters
    ----------
    codes
        What the files can hold.
    levels
        Steps of each ramp, from black to full.

    Raises
    ------
    InputError
        As for `Codes.ramp`.
    """
    ramp = codes.ramp(levels)
    both = (CHANNELS["W"],) * 2
    patterns = [
        Pattern("black", "black", "nothing", (BLACK, BLACK), _all, {"channel": "K", "level": 0.0}),
        Pattern("white-both", "white", "both eyes' pictures, white", both, _all),
    ]
    for eye in EYES:
        patterns += _alone(eye, codes, ramp)
    for one, other in _pairs(GREYS):
        left, right = (codes.nearest(each / (GREYS - 1)) for each in (one, other))
        patterns.append(
            Pattern(
                f"grey-{one}-{other}",
                "grey to grey",
                f"grey, left at {codes.level_in_words(left)}, "
                f"right at {codes.level_in_words(right)}",
                (scaled("W", left), scaled("W", right)),
                _all,
                {"left_level": left, "right_level": right},
            )
        )
    for eye in EYES:
        patterns += _parts(eye)
    return (_registration(), *patterns)


def _pairs(count: int) -> Iterator[tuple[int, int]]:
    """All but both black, which is there already."""
    return ((a, b) for a in range(count) for b in range(count) if (a, b) != (0, 0))


def _alone(eye: str, codes: Codes, ramp: tuple[float, ...]) -> list[Pattern]:
    def lights(name: str, kind: Kind, told: str, channel: str, level: float) -> Pattern:
        parameters = {"projector": eye, "channel": channel, "level": level}
        return Pattern(
            f"{eye}-{name}",
            kind,
            f"the {eye} eye's picture, {told}",
            _only(eye, scaled(channel, level)),
            _all,
            parameters,
        )

    full = [
        lights(word, "white" if channel == "W" else "primary", word, channel, 1.0)
        for channel, word in WORDS.items()
    ]
    steps = [
        lights(
            f"ramp-{word}-{number:02d}",
            "ramp",
            f"{word} at {codes.level_in_words(level)}",
            channel,
            level,
        )
        for channel, word in WORDS.items()
        for number, level in enumerate(ramp, 1)
    ]
    return full + steps


def _parts(eye: str) -> list[Pattern]:
    """Boards and patches."""

    def white(name: str, kind: Kind, told: str, region: Region, **parameters: Any) -> Pattern:
        colours = _only(eye, CHANNELS["W"])
        lit = f"the {eye} eye's picture: {told}"
        reading = {"projector": eye, **parameters}
        return Pattern(f"{eye}-{name}", kind, lit, colours, _as_mask(region), reading)

    boards = [
        white(
            f"checkerboard-{cols}x{rows}-{one}",
            "checkerboard",
            f"every second of {cols} x {rows} fields{', the others' if odd else ''}",
            _board(cols, rows, odd),
            columns=cols,
            rows=rows,
            complement=f"{eye}-checkerboard-{cols}x{rows}-{other}",
        )
        for cols, rows in BOARDS
        for odd, (one, other) in enumerate((("a", "b"), ("b", "a")))
    ]
    patches = [
        white(
            f"patch-{place}",
            "patch",
            f"a disc, {place.replace('-', ' ')}",
            _disc(x, y, PATCH),
            x=x,
            y=y,
            radius_of_height=PATCH,
        )
        for place, (x, y) in PLACES.items()
    ]
    return boards + patches


def _registration() -> Pattern:
    larger = {(0, 0): 2.0, (8, 0): 1.5}
    markers = [
        {
            "x": 0.05 + 0.9 * i / 8,
            "y": 0.08 + 0.84 * j / 4,
            "radius_of_height": MARKER * larger.get((i, j), 1.0),
        }
        for j in range(5)
        for i in range(9)
    ]
    discs = [_disc(m["x"], m["y"], m["radius_of_height"]) for m in markers]

    def lit(rows: int, cols: int) -> Mask:
        lit_pixels = np.zeros((rows, cols), np.bool_)
        for disc in discs:
            lit_pixels |= disc(rows, cols)
        x, y = _points(rows, cols)
        # Between two columns of markers, off the middle
        letters = [
            letter(name, x - cols / rows * 0.4437, y - 0.605, _LETTER_HEIGHT) for name in "LR"
        ]
        return np.stack([lit_pixels | each for each in letters])

    return Pattern(
        "registration",
        "registration",
        f"{len(markers)} markers, larger at the top left and the top right; each eye's letter",
        (CHANNELS["W"],) * 2,
        lit,
        {"markers": markers, "letters": ["L", "R"]},
    )


def _only(eye: str, colour: Colour) -> tuple[Colour, Colour]:
    return (colour, BLACK) if eye == "left" else (BLACK, colour)


def _all(rows: int, cols: int) -> Mask:
    return np.ones((1, rows, cols), np.bool_)


def _as_mask(region: Region) -> Callable[[int, int], Mask]:
    return lambda rows, cols: region(rows, cols)[None]


def _points(rows: int, cols: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Broadcastable x and y of the pixels' centres from the top left, in picture heights."""
    return (np.arange(cols) + 0.5)[None, :] / rows, (np.arange(rows) + 0.5)[:, None] / rows


def _disc(x: float, y: float, radius: float) -> Region:
    def lit(rows: int, cols: int) -> Mask:
        across, down = _points(rows, cols)
        return np.asarray((across - x * cols / rows) ** 2 + (down - y) ** 2 <= radius**2)

    return lit


def _board(cols: int, rows: int, odd: int) -> Region:
    def lit(high: int, wide: int) -> Mask:
        return np.asarray((_fields(wide, cols) + _fields(high, rows)[:, None]) % 2 == odd)

    return lit


def _fields(pixels: int, count: int) -> NDArray[np.int64]:
    """(pixel,) whether its field has an even number, and so light; a reflection exchanges them."""
    place = np.arange(pixels)
    folded = np.minimum(place, pixels - 1 - place)
    return np.asarray((2 * folded + 1) * count // (2 * pixels) + (2 * place >= pixels))
