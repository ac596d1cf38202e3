"""Test patterns for a dome: regions of directions from the centre of its sphere.

A sector about the dome's axis has its share of the screen's true area, whatever the dome's
half-angle. No pixel's centre is on a border of a sector: borders lie on the axes (an even size has
no pixel there) or at multiples of 30 degrees, whose tangents are irrational. So a reflection turns
a board into its complement exactly, and both light the same area.

Azimuth runs from the audience's right (0°) over the front (90°) to their left (180°).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product
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
from domesim.room.dome import Dome, strips

Directions: TypeAlias = NDArray[np.float64]
Region: TypeAlias = Callable[[Directions], Mask]

HALVES = {"right": -90, "front": 0, "left": 90, "back": 180}
"""Side of the audience -> azimuth where its half begins, degrees."""
SECTORS, RINGS = 6, 3
BOARDS = ((4, 2), (12, 4))
"""Sectors and rings of the checkerboards; a quarter of the sectors is odd (see above)."""
SHIFTED, SHIFTS = "shifted-12x4-", 8
"""Beginning of the names of the largest board's shifts, by halves of a field, and their number."""
PATCH, MARKER = 1 / 15, 1 / 60
"""Radius over the dome's half-angle: 6 and 1.5 degrees of a hemisphere."""
LARGER = {90: 2.0, 0: 1.5}
"""Azimuth -> how much larger the markers are: those at the front, those on the right."""
_LETTER_AT, _LETTER_HEIGHT = 0.75, 0.16


def dome_patterns(dome: Dome, codes: Codes, levels: int) -> tuple[Pattern, ...]:
    """All patterns, in the order in which they are projected.

    Parameters
    ----------
    dome
        Its screen.
    codes
        What the files can hold.
    levels
        Steps of each ramp, from black to full.

    Raises
    ------
    InputError
        As for `Codes.ramp`.
    """

    def lights(
        name: str, kind: Kind, lit: str, region: Region, colour: Colour, **parameters: Any
    ) -> Pattern:
        return Pattern(name, kind, lit, (colour,), _on(dome, region), parameters)

    def white(name: str, kind: Kind, lit: str, region: Region, **parameters: Any) -> Pattern:
        return lights(name, kind, lit, region, CHANNELS["W"], **parameters)

    ramp = codes.ramp(levels)
    patterns = [lights("black", "black", "nothing", _all, BLACK, channel="K", level=0.0)]
    for channel, word in WORDS.items():
        kind: Kind = "white" if channel == "W" else "primary"
        patterns.append(
            lights(
                word,
                kind,
                f"all, {word}",
                _all,
                CHANNELS[channel],
                channel=channel,
                level=1.0,
            )
        )
    for channel, word in WORDS.items():
        patterns += [
            lights(
                f"ramp-{word}-{number:02d}",
                "ramp",
                f"all, {word} at {codes.level_in_words(level)}",
                _all,
                scaled(channel, level),
                channel=channel,
                level=level,
            )
            for number, level in enumerate(ramp, 1)
        ]
    patterns += [
        white(f"half-{side}", "half", f"the {side} half", _sector(start, 180), **_range(start, 180))
        for side, start in HALVES.items()
    ]
    wide = 360 // SECTORS
    patterns += [
        white(
            f"sector-{start:03d}-{start + wide:03d}",
            "sector",
            f"azimuth {start}° to {start + wide}°",
            _sector(start, wide),
            **_range(start, wide),
        )
        for start in range(0, 360, wide)
    ]
    edges = np.linspace(0, np.degrees(dome.half_angle), RINGS + 1)
    patterns += [
        white(
            f"ring-{number}",
            "ring",
            f"{inner:.3g}° to {outer:.3g}° from the zenith of the dome",
            _ring(np.radians(inner), np.radians(outer)),
            from_angle_deg=float(inner),
            to_angle_deg=float(outer),
        )
        for number, (inner, outer) in enumerate(pairwise(edges), 1)
    ]
    for sectors, rings in BOARDS:
        name = f"checkerboard-{sectors}x{rings}"
        patterns += [
            white(
                f"{name}-{one}",
                "checkerboard",
                f"every second of {sectors} x {rings} fields{', the others' if odd else ''}",
                _board(dome, sectors, rings, odd),
                sectors=sectors,
                rings=rings,
                complement=f"{name}-{other}",
            )
            for odd, (one, other) in enumerate((("a", "b"), ("b", "a")))
        ]
    sectors, rings = BOARDS[-1]
    patterns += [
        white(
            f"{SHIFTED}{number}",
            "shifted",
            f"every second of {sectors} x {rings} fields, shifted by {turn:g} and {out:g} of one",
            _board(dome, sectors, rings, 0, turn, out),
            sectors=sectors,
            rings=rings,
            shift=[turn, out],
        )
        for number, (out, turn) in enumerate(product((0, 0.5), (0, 0.5, 1, 1.5)), 1)
    ]
    radius = np.degrees(PATCH * dome.half_angle)
    for name, azimuth, angle in _patches(dome):
        patterns.append(
            white(
                f"patch-{name}",
                "patch",
                f"a disc of {radius:.3g}° around {_place(azimuth, angle)}",
                _disc(_towards(azimuth, angle), np.radians(radius)),
                azimuth_deg=azimuth,
                angle_deg=angle,
                radius_deg=float(radius),
            )
        )
    return (_registration(dome), *patterns)


def _registration(dome: Dome) -> Pattern:
    markers = _markers(dome)
    regions = [
        _disc(
            _towards(marker["azimuth_deg"], marker["angle_deg"]), np.radians(marker["radius_deg"])
        )
        for marker in markers
    ]

    def lit(directions: Directions) -> Mask:
        x, y = _plane(dome, directions)
        points = letter("F", x, y - _LETTER_AT, _LETTER_HEIGHT)
        for region in regions:
            points |= region(directions)
        return points

    return Pattern(
        "registration",
        "registration",
        f"{len(markers)} markers, larger at the front and on the right; F upright at the front",
        (CHANNELS["W"],),
        _on(dome, lit),
        {"markers": markers, "letter": "F"},
    )


def _markers(dome: Dome) -> list[dict[str, float]]:
    """Markers on the screen: places of their middles, and their radii."""
    half, size = np.degrees(dome.half_angle), MARKER * np.degrees(dome.half_angle)
    rings = [(azimuth, share * half) for share in (0.3, 0.6, 0.9) for azimuth in range(0, 360, 30)]
    markers = [(azimuth, angle, size * LARGER.get(azimuth, 1.0)) for azimuth, angle in rings]
    return [
        {"azimuth_deg": float(azimuth), "angle_deg": float(angle), "radius_deg": float(radius)}
        for azimuth, angle, radius in [(0, 0.0, size), *markers]
        if _on_screen(dome, _towards(azimuth, angle))
    ]


def _patches(dome: Dome) -> list[tuple[str, float, float]]:
    """Name, azimuth and angle from the zenith, degrees."""
    half = float(np.degrees(dome.half_angle))
    patches = [("zenith", 0.0, 0.0)]
    for ring, share in (("upper", 0.4), ("lower", 0.8)):
        patches += [
            (f"{ring}-{azimuth:03d}", azimuth, share * half) for azimuth in range(30, 360, 60)
        ]
    return [each for each in patches if _on_screen(dome, _towards(*each[1:]))]


def _on_screen(dome: Dome, direction: Directions) -> bool:
    size = 512
    row, col = dome.pixel_of(direction, size)
    return bool(dome.inside(size, size)[row, col])


def _on(dome: Dome, region: Region) -> Callable[[int, int], Mask]:
    def mask(rows: int, cols: int) -> Mask:
        inside = dome.inside(rows, cols)[None]
        if region is _all:
            return inside
        for strip in strips(rows, cols):
            inside[0, strip] &= region(dome.directions(rows, cols, strip))
        return inside

    return mask


def _all(directions: Directions) -> Mask:
    return np.ones(directions.shape[:-1], np.bool_)


def _azimuth(directions: Directions) -> NDArray[np.float64]:
    """Degrees, 0 to 360."""
    return np.degrees(np.arctan2(directions[..., 1], directions[..., 0])) % 360


def _angle(directions: Directions) -> NDArray[np.float64]:
    """Angles from the zenith, radians."""
    return np.asarray(np.arccos(np.clip(directions[..., 2], -1, 1)))


def _sector(start: float, wide: float) -> Region:
    return lambda directions: (_azimuth(directions) - start) % 360 < wide


def _range(start: float, wide: float) -> dict[str, float]:
    return {"from_azimuth_deg": start % 360, "to_azimuth_deg": (start + wide) % 360 or 360}


def _ring(inner: float, outer: float) -> Region:
    return lambda directions: (_angle(directions) >= inner) & (_angle(directions) < outer)


def _board(
    dome: Dome, sectors: int, rings: int, odd: int, turn: float = 0.0, out: float = 0.0
) -> Region:
    def lit(directions: Directions) -> Mask:
        sector = np.floor(_azimuth(directions) * (sectors / 360) + turn)
        ring = np.floor(_angle(directions) * (rings / dome.half_angle) + out)
        return np.asarray((sector + ring) % 2 == odd)

    return lit


def _towards(azimuth: float, angle: float) -> Directions:
    """(xyz,) unit vector; both in degrees."""
    a, t = np.radians(azimuth), np.radians(angle)
    return np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])


def _disc(middle: Directions, radius: float) -> Region:
    return lambda directions: directions @ middle >= np.cos(radius)


def _plane(dome: Dome, directions: Directions) -> tuple[NDArray[Any], NDArray[Any]]:
    """To the right and down in the domemaster, 1 on its circle."""
    x, y = directions[..., 0], directions[..., 1]
    away = _angle(directions) / dome.half_angle / np.maximum(np.hypot(x, y), 1e-300)
    return x * away, y * away


def _place(azimuth: float, angle: float) -> str:
    if angle == 0:
        return "the zenith of the dome"
    return f"azimuth {azimuth:.3g}°, {angle:.3g}° from the zenith of the dome"
