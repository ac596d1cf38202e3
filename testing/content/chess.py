"""A domemaster of chessmen on their board in a dark room, between a warm and a cold lamp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from testing.content.dome import Dome
from testing.content.texture import Floats, noise, smoothstep, tinted

_LEAN = 0.75
"""How far the camera's axis leans to the front from the zenith, radians; it sees the floor."""

_EYE = np.array([0.0, 0.0, 1.25])
"""The camera, in squares of the board: right, ahead, up."""

_LAMPS = (
    (np.array([-5.0, 4.0, 5.5]), np.array([1.0, 0.62, 0.3]) * 34.0),
    (np.array([6.0, 9.0, 6.5]), np.array([0.3, 0.5, 1.0]) * 40.0),
)
"""Where the lamps are, and their light at a distance of one square."""

_PAWN = ((0.0, 0.36), (0.1, 0.36), (0.16, 0.28), (0.3, 0.17), (0.62, 0.11), (0.66, 0.2),
         (0.72, 0.12), (0.76, 0.16), (0.86, 0.21), (0.98, 0.17), (1.06, 0.0))  # fmt: skip
_BISHOP = ((0.0, 0.4), (0.12, 0.4), (0.2, 0.28), (0.4, 0.17), (0.95, 0.12), (1.0, 0.24),
           (1.06, 0.14), (1.12, 0.15), (1.28, 0.2), (1.42, 0.13), (1.52, 0.04), (1.56, 0.07),
           (1.62, 0.0))  # fmt: skip
_ROOK = ((0.0, 0.4), (0.12, 0.4), (0.2, 0.3), (0.4, 0.22), (0.9, 0.2), (0.95, 0.3), (1.22, 0.32),
         (1.23, 0.0))  # fmt: skip
_KING = ((0.0, 0.44), (0.14, 0.44), (0.22, 0.32), (0.45, 0.2), (1.25, 0.14), (1.3, 0.28),
         (1.38, 0.15), (1.75, 0.27), (1.82, 0.2), (1.86, 0.06), (2.0, 0.05), (2.01, 0.11),
         (2.07, 0.11), (2.08, 0.0))  # fmt: skip

_MEN = (
    (_PAWN, (-1.5, 2.5), True), (_PAWN, (0.5, 1.9), False), (_KING, (1.5, 3.5), True),
    (_BISHOP, (-0.5, 3.5), False), (_PAWN, (2.5, 2.5), False), (_ROOK, (-2.5, 4.5), True),
    (_PAWN, (0.5, 5.5), True), (_KING, (-1.5, 6.5), False), (_BISHOP, (3.5, 5.5), True),
    (_ROOK, (2.5, 7.5), False), (_PAWN, (-3.5, 2.5), False), (_BISHOP, (-4.5, 6.5), False),
    (_PAWN, (4.5, 3.5), True), (_PAWN, (-0.5, 8.5), False), (_ROOK, (1.5, 9.5), False),
)  # fmt: skip
"""Profile (height, radius), place (right, ahead), and whether it is white."""


def chess(size: int) -> Light:
    """Lit chessmen on their board, in a dark room."""
    dome = Dome(size)
    rays = _rays(dome).reshape(-1, 3)
    light = _room(rays)
    depth = np.full(len(rays), np.inf, np.float32)
    floor = np.flatnonzero(rays[:, 2] < -0.01)
    depth[floor] = -_EYE[2] / rays[floor, 2]
    light[floor] = _board(_EYE + rays[floor] * depth[floor, None], depth[floor])
    for profile, place, white in _MEN:
        met, distance = _traced(rays, np.array(profile), np.array(place))
        nearer = distance < depth[met]
        met, distance = met[nearer], distance[nearer]
        depth[met] = distance
        light[met] = _man(rays[met], distance, np.array(profile), np.array(place), white)
    return dome.light(light.reshape(*dome.x.shape, 3))


def _rays(dome: Dome) -> Floats:
    """Directions in the room: right, ahead, up."""
    sine = np.sin(dome.angle)
    right, front, up = sine * np.sin(dome.azimuth), sine * np.cos(dome.azimuth), np.cos(dome.angle)
    cos, sin = np.cos(_LEAN), np.sin(_LEAN)
    ahead, above = cos * front + sin * up, cos * up - sin * front
    return np.stack([right, ahead, above], axis=-1).astype(np.float32)


def _room(rays: Floats) -> Floats:
    """A dark ceiling and walls, which the lamps graze."""
    grain = 1 + 0.12 * noise(70, rays[:, 0] + 0.3 * rays[:, 2], rays[:, 1], 1.3)
    light = tinted(0.0012 * grain, (1.0, 0.8, 0.7))
    for lamp, colour in _LAMPS:
        off = rays @ (lamp / np.linalg.norm(lamp)).astype(np.float32)
        light += tinted(0.0022 * grain * np.exp((off - 1) / 0.12), colour / colour.max())
    return light


def _board(points: Floats, depth: Floats) -> Floats:
    """The board: squares of wood with the men's shadows, dimmer with the distance."""
    x, y = points[:, 0], points[:, 1]
    inside = (np.abs(x) < 6) & (y > -2) & (y < 12)
    white = np.mod(np.floor(x) + np.floor(y), 2) < 1
    grain = 1 + 0.22 * noise(71, 0.25 * x, 0.03 * y + 0.37 * np.floor(x), 1.1)
    dark_wood = tinted(grain, (0.07, 0.035, 0.022))
    wood = np.where(white[:, None], tinted(grain, (0.62, 0.5, 0.36)), dark_wood)
    wood = np.where(inside[:, None], wood, tinted(grain, (0.03, 0.022, 0.018)))
    seam = np.minimum(np.abs(x - np.round(x)), np.abs(y - np.round(y)))
    wood *= np.where(inside, smoothstep(0.003, 0.02, seam), 1)[:, None]
    total = np.full_like(wood, 0.003)
    up = np.array([0.0, 0.0, 1.0])
    for lamp, colour in _LAMPS:
        facing = _irradiance(points, up, lamp) * _shadow(x, y, lamp)
        total += tinted(facing, colour)
    for profile, (left, ahead), _ in _MEN:
        near = np.hypot(x - left, y - ahead) / profile[0][1]
        total *= (0.35 + 0.65 * smoothstep(0.8, 1.8, near))[:, None]
    return wood * total * np.exp(-depth / 30)[:, None]


def _man(
    rays: Floats,
    distance: Floats,
    profile: Floats,
    place: Floats,
    white: bool,
) -> Floats:
    """A polished man under the lamps."""
    points = _EYE + rays * distance[:, None]
    x, y, height = points[:, 0] - place[0], points[:, 1] - place[1], points[:, 2]
    slope = _radius(profile, height + 0.01) - _radius(profile, height - 0.01)
    away = np.maximum(np.hypot(x, y), 1e-6)
    normal = np.stack([x / away, y / away, np.clip(-slope / 0.02, -4, 4)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    grain = 1 + 0.15 * noise(72, np.arctan2(y, x) / 6, 0.1 * height + 0.1 * place[0], 1.1)
    wood = tinted(grain, (0.66, 0.52, 0.36) if white else (0.075, 0.05, 0.045))
    light = wood * (0.004 + 0.02 * smoothstep(0.5, 0.0, height)[:, None])
    mirrored = rays - 2 * (rays * normal).sum(-1, keepdims=True) * normal
    for lamp, colour in _LAMPS:
        towards = lamp - points
        far = np.linalg.norm(towards, axis=-1, keepdims=True)
        gloss = np.clip((mirrored * towards / far).sum(-1), 0, 1) ** 60
        light += wood * tinted(_irradiance(points, normal, lamp), colour)
        light += tinted(0.9 * gloss / far[:, 0] ** 2, colour)
    return np.asarray(light, np.float32)


def _irradiance(points: Floats, normal: Floats, lamp: Floats) -> Floats:
    """Cosine of the incidence over the squared distance."""
    towards = lamp - points
    squared = (towards**2).sum(-1)
    facing = (towards * normal).sum(-1) / np.sqrt(squared)
    return np.asarray(np.clip(facing, 0, None) / squared, np.float32)


def _shadow(x: Floats, y: Floats, lamp: Floats) -> Floats:
    """Share of a lamp that the men leave to points of the floor."""
    result = np.ones(x.shape, np.float32)
    for profile, (left, ahead), _ in _MEN:
        tip = profile[-1][0]
        along = np.stack([lamp[0] - x, lamp[1] - y])
        squared = (along**2).sum(0)
        part = ((left - x) * along[0] + (ahead - y) * along[1]) / squared
        height = np.clip(part, 0, 1) * lamp[2]
        away = np.hypot(x + part * along[0] - left, y + part * along[1] - ahead)
        wide = _radius(np.array(profile), height)
        soft = 0.02 + 0.05 * height
        result *= np.where(
            (part > 0) & (height < tip), smoothstep(wide - soft, wide + soft, away), 1
        )
    return result


def _traced(rays: Floats, profile: Floats, place: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Indices of the rays that meet a man, and how far they go."""
    tip, wide = profile[-1, 0], profile[:, 1].max()
    middle = np.array([*place, tip / 2]) - _EYE
    reach = np.hypot(tip / 2, wide)
    ahead = rays @ middle.astype(np.float32)
    near = np.flatnonzero((ahead > 0) & (middle @ middle - ahead**2 < reach**2))
    start = np.maximum(ahead[near] - reach, 0).astype(np.float64)
    end = start + 2 * reach
    base = np.array([*place, 0.0])
    for _ in range(45):
        points = _EYE + rays[near] * start[:, None] - base
        outside = np.hypot(points[:, 0], points[:, 1]) - _radius(profile, points[:, 2])
        start += np.clip(0.5 * outside, 0.0006, 0.2)
        start = np.where(outside < 0.0005, start - 0.0006, start)
        kept = start < end
        near, start, end = near[kept], start[kept], end[kept]
    points = _EYE + rays[near] * start[:, None] - base
    outside = np.hypot(points[:, 0], points[:, 1]) - _radius(profile, points[:, 2])
    met = outside < 0.01
    return near[met], start[met].astype(np.float32)


def _radius(profile: Floats, height: Floats) -> Floats:
    """The man's radius at a height; negative above and below him."""
    beyond = np.maximum(height - profile[-1, 0], 0) + np.maximum(-height, 0)
    return np.asarray(np.interp(height, profile[:, 0], profile[:, 1]) - 3 * beyond)
