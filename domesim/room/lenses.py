"""Light of a theatre's projectors on its screen.

Fields that overlap are blended: each projector is dimmed towards the edge of its field by a smooth
step, and all are divided by their sum. Falloff is that of a lens of equal intensity in all
directions (equidistant), or of one that lights a flat screen evenly (perspective, intensity
proportional to 1 / cos³ of the angle to its axis). A screen with a gain lobe shows more of it in
the mirror direction: microfacets with the GGX distribution [1].

[1] B. Walter, S. Marschner, H. Li, K. Torrance, "Microfacet models for refraction through rough
surfaces", Eurographics Symposium on Rendering (2007), eqs. 20, 33 and 34.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.dome import strips
from domesim.room.theatre import Lens, Lobe, Point, Theatre

Floats = NDArray[np.float64]

DARK = 1e-3
"""Share of the dome's picture that may stay dark before it is a mistake (rim pixels)."""


def lens_gains(theatre: Theatre, rows: int, cols: int, *, holes: bool = False) -> Floats:
    """(lens, row, col): irradiance of the screen by each projector, for a white picture.

    1 is that of the one ideal projector in the sphere's centre. Where the projection system evens
    out falloff they sum to 1; off the screen they are 0, or 1 for the first.

    With `holes`, what the projectors leave dark is shared by them all, and no mistake.

    Raises
    ------
    InputError
        If the projectors leave a part of the screen dark.
    """
    dome = theatre.dome
    screen = dome.inside(rows, cols)
    if not theatre.lenses:
        return np.ones((1, rows, cols))
    lenses = theatre.lenses
    weights = np.empty((len(lenses), rows, cols))
    for strip in strips(rows, cols):
        points = dome.points(rows, cols, strip)
        for weight, lens in zip(weights, lenses, strict=True):
            weight[strip] = field_weight(lens, points)
    total = weights.sum(0)
    dark = screen & (total <= 0)
    if not holes and dark.sum() > DARK * screen.sum():
        raise InputError(
            f"projectors leave {dark.sum() / screen.sum():.1%} of the screen dark; widen their "
            f"fields, aim them elsewhere or add projectors"
        )
    weights[:, dark] = 1 / len(weights)
    weights /= np.where(dark, 1, np.where(total > 0, total, 1))
    if not theatre.corrected:
        for strip in strips(rows, cols):
            points = dome.points(rows, cols, strip)
            for weight, lens in zip(weights, lenses, strict=True):
                weight[strip] *= _falloff(theatre, lens, points, rows, cols, strip)
    weights[:, ~screen] = 0
    weights[0, ~screen] = 1
    return weights


def seen_gain(theatre: Theatre, gains: Floats, eye: Point = (0.0, 0.0, 0.0)) -> Floats:
    """(row, col): direct light of a white picture as an eye sees it; 1 off the screen.

    Paint does not count.

    Parameters
    ----------
    theatre
        The theatre.
    gains
        (lens, row, col) irradiance, of `lens_gains`.
    eye
        Where the eye is, m; a Lambertian screen looks the same from everywhere.
    """
    _, rows, cols = gains.shape
    total = gains.sum(0)
    if theatre.lobe is not None and theatre.lobe.share > 0:
        dome, total = theatre.dome, np.zeros((rows, cols))
        places = [lens.position for lens in theatre.lenses] or [(0.0, 0.0, 0.0)]
        for strip in strips(rows, cols):
            points = dome.points(rows, cols, strip)
            normals = -dome.normals(dome.directions(rows, cols, strip)) @ dome.to_room.T
            to_eye = _unit(np.asarray(eye) - points)
            for gain, place in zip(gains, places, strict=True):
                to_lens = _unit(np.asarray(place) - points)
                total[strip] += gain[strip] * lobe_gain(theatre.lobe, normals, to_eye, to_lens)
    return np.where(theatre.dome.inside(rows, cols), total, 1.0)


def lobe_gain(lobe: Lobe, normal: Floats, to_eye: Floats, to_light: Floats) -> Floats:
    """(...): brightness of a screen with a lobe over that of a Lambertian one; 0 from behind.

    Parameters
    ----------
    lobe
        Share and roughness.
    normal, to_eye, to_light
        (..., xyz) unit vectors.
    """
    seen = np.sum(normal * to_eye, -1)
    lit = np.sum(normal * to_light, -1)
    half = np.sum(normal * _unit(to_eye + to_light), -1)
    square = lobe.roughness**2
    facets = square / (np.pi * (half**2 * (square - 1) + 1) ** 2)
    front = (seen > 0) & (lit > 0)
    a, b = np.where(front, seen, 1.0), np.where(front, lit, 1.0)
    shadowing = (
        4 / (1 + np.sqrt(1 + square * (a**-2 - 1))) / (1 + np.sqrt(1 + square * (b**-2 - 1)))
    )
    mirror = np.pi * facets * shadowing / (4 * a * b)
    return np.where(front, 1 - lobe.share + lobe.share * mirror, 0.0)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def field_weight(lens: Lens, points: Floats) -> Floats:
    """(...): how much of its light a projector sends to points (..., xyz) of the room, 0..1."""
    right, up, forward = lens_frame(lens)
    ray = points - np.asarray(lens.position)
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    ahead = ray @ forward
    if lens.kind == "equidistant":
        angle = np.arccos(np.clip(ahead, -1, 1))
        if lens.field >= 2 * np.pi:
            return np.ones_like(angle)
        return _smooth_step(lens.field / 2 - angle, lens.blend)
    beyond = np.where(ahead > 0, ahead, 1.0)
    place = np.stack([ray @ right / beyond, ray @ up / beyond], -1)
    low, high = field_edges(lens)
    inside = np.minimum(np.arctan(high) - np.arctan(place), np.arctan(place) - np.arctan(low))
    edges = _smooth_step(inside[..., 0], lens.blend) * _smooth_step(inside[..., 1], lens.blend)
    if lens.mask is not None:
        edges = edges * _sampled(lens.mask.weights, (place - low) / (high - low))
    return np.asarray(np.where(ahead > 0, edges, 0.0))


def field_edges(lens: Lens) -> tuple[Floats, Floats]:
    """Left and lower, and right and upper edge of a rectangular field, 1 m ahead of the lens."""
    half = np.tan(lens.field / 2) * np.array([1, 1 / lens.aspect])
    shift = np.asarray(lens.shift)
    return half * (shift - 1), half * (shift + 1)


def _sampled(weights: Floats, place: Floats) -> Floats:
    """(...): weights (row, col) at places (..., (right, up)), 0..1, linear between pixels."""
    rows, cols = weights.shape
    row, col = (1 - place[..., 1]) * rows - 0.5, place[..., 0] * cols - 0.5
    sampled = scipy.ndimage.map_coordinates(
        weights, [row.ravel(), col.ravel()], order=1, mode="nearest"
    )
    return np.asarray(sampled.reshape(row.shape))


def lens_frame(lens: Lens) -> tuple[Floats, Floats, Floats]:
    """Unit vectors to the right, up and forward of a projector, in the room's frame."""
    right, up, forward = axes_towards(lens.position, lens.look_at, f"projector {lens.name!r}")
    c, s = np.cos(lens.roll), np.sin(lens.roll)
    return c * right + s * up, c * up - s * right, forward


def axes_towards(position: Point, look_at: Point, name: str) -> tuple[Floats, Floats, Floats]:
    """Unit vectors to the right, up and forward of what looks from a place at another.

    Raises
    ------
    InputError
        If the places are one; it calls what looks by its `name`.
    """
    forward = np.subtract(look_at, position)
    length = np.linalg.norm(forward)
    if not length > 0:
        raise InputError(f"{name} is aimed at its own position; move look_at")
    forward = forward / length
    reference = np.array([0.0, 0, 1]) if abs(forward[2]) < 0.999 else np.array([0.0, -1, 0])
    right = np.cross(forward, reference)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def _smooth_step(inside: Floats, width: float) -> Floats:
    """0 outside a field, 1 further than `width` inside it, 3 t² - 2 t³ between."""
    if width <= 0:
        return np.asarray((inside >= 0).astype(np.float64))
    t = np.clip(inside / width, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _falloff(
    theatre: Theatre, lens: Lens, points: Floats, rows: int, cols: int, strip: slice
) -> Floats:
    x, y, z = np.asarray(lens.position) @ theatre.dome.to_room
    gain = theatre.dome.lens_gain(rows, cols, (float(x), float(y), float(z)), strip)
    if lens.kind == "perspective":
        ray = points - np.asarray(lens.position)
        ahead = (ray @ lens_frame(lens)[2]) / np.linalg.norm(ray, axis=-1)
        gain = gain / np.maximum(ahead, 0.05) ** 3
    return gain
