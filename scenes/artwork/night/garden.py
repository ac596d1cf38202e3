"""The garden and the land round it: trees, hedges, grass, hills, village and paths."""

from __future__ import annotations

import numpy as np

from domesim.pathtrace.solids import Triangles, box, extruded, join, moved, tube, turned
from scenes.artwork.night.noise import Floats, fractal_noise

_UP = np.array([0.0, 0.0, 1.0])


def broadleaf(rng: np.random.Generator, height: float, leaves: int) -> tuple[Triangles, Triangles]:
    """Wood and foliage of a broad tree that stands at the origin."""
    wood: list[Triangles] = []
    tips: list[Floats] = []

    def grow(start: Floats, heading: Floats, length: float, radius: float, order: int) -> None:
        bent = heading + 0.12 * rng.standard_normal(3)
        end = start + length * bent / np.linalg.norm(bent)
        wood.append(tube(start, end, (radius, 0.72 * radius), sides=7 if order < 2 else 4))
        if order >= 2:
            tips.extend([end, (start + end) / 2])
        if order == 5:
            return
        for _ in range(3 if order < 4 else 2):
            sideways = rng.standard_normal(3)
            sideways -= (sideways @ heading) * heading
            sideways /= np.linalg.norm(sideways)
            turn = rng.uniform(0.5, 0.95)
            child = np.cos(turn) * heading + np.sin(turn) * sideways + 0.14 * _UP
            child /= np.linalg.norm(child)
            grow(end, child, length * rng.uniform(0.62, 0.84), 0.62 * radius, order + 1)

    grow(np.zeros(3), _UP, 0.26 * height, 0.026 * height, 0)
    at = np.array(tips)[rng.integers(len(tips), size=leaves)]
    at = at + rng.normal(0.0, 0.032 * height, (leaves, 3))
    return join(wood), leaf_cloud(rng, at, 0.11)


def cypress(rng: np.random.Generator, height: float, leaves: int) -> Triangles:
    """Foliage of a narrow, dense tree that stands at the origin."""
    along = rng.beta(1.3, 1.6, leaves)
    width = 0.105 * height * np.sqrt(along * 4.0 + 0.15) * (1 - along) ** 0.62
    azimuth = rng.uniform(0.0, 2 * np.pi, leaves)
    lobes = 1.0 + 0.14 * np.sin(5 * azimuth + 9 * along) + 0.1 * np.sin(31 * along)
    radius = width * lobes * np.sqrt(rng.uniform(0.45, 1.0, leaves))
    at = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), along * height])
    return leaf_cloud(rng, at, 0.11)


def hedge(rng: np.random.Generator, low: Floats, high: Floats, density: float) -> Triangles:
    """A clipped hedge between two opposite corners; `density` in leaves per m³ of it."""
    count = int(density * np.prod(high - low))
    at = rng.uniform(low, high, (count, 3))
    face = rng.integers(3, size=count)
    near = np.where(rng.random(count) < 0.5, low[face], high[face])
    at[np.arange(count), face] = near
    return leaf_cloud(rng, at + rng.normal(0.0, 0.03, (count, 3)), 0.09)


def leaf_cloud(rng: np.random.Generator, at: Floats, size: float) -> Triangles:
    """One triangle of about `size` at every point, turned at random."""
    along = rng.standard_normal((len(at), 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, rng.standard_normal((len(at), 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    scale = size * rng.uniform(0.6, 1.4, (len(at), 1))
    return np.stack(
        [
            at + scale * along,
            at - 0.6 * scale * (along - 0.7 * across),
            at - 0.6 * scale * (along + 0.7 * across),
        ],
        axis=1,
    )


def grass(
    rng: np.random.Generator, areas: list[tuple[float, float, float, float]], density: float
) -> Triangles:
    """Blades on the `areas` (x0, x1, y0, y1), `density` to the square metre."""
    blades = []
    for x0, x1, y0, y1 in areas:
        count = int(density * (x1 - x0) * (y1 - y0))
        root = np.column_stack(
            [rng.uniform(x0, x1, count), rng.uniform(y0, y1, count), np.zeros(count)]
        )
        clump = fractal_noise(root * 0.8, 3, 5)[:, None]
        azimuth = rng.uniform(0.0, 2 * np.pi, count)
        side = 0.018 * np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)])
        tip = root + rng.normal(0.0, 0.035, (count, 3))
        tip[:, 2:] = (0.03 + 0.16 * clump**2) * rng.uniform(0.5, 1.3, (count, 1))
        blades.append(np.stack([root - side, root + side, tip], axis=1))
    return join(blades)


def hills(seed: int) -> tuple[Triangles, Triangles]:
    """The land beyond the lake, a ring between 170 m and 2.4 km away: woods, and snow on top."""
    azimuth = np.linspace(0.0, 2 * np.pi, 721)
    distance = np.geomspace(170.0, 2400.0, 90)
    x = distance[:, None] * np.sin(azimuth)
    y = distance[:, None] * np.cos(azimuth)
    flat = np.stack([x, y, 0 * x], axis=-1)
    inland = np.clip((distance[:, None] - 185.0) / 1400.0, 0.0, 1.0)
    rough = fractal_noise(flat / 420.0, 6, seed + 31)
    ridges = 1.0 - np.abs(2.0 * fractal_noise(flat / 900.0, 5, seed + 32) - 1.0)
    z = -1.5 + 2.5 * (distance[:, None] > 180) + inland**0.8 * (60 + 420 * ridges**2 * rough)
    wooded = fractal_noise(np.stack([x, y, z], axis=-1) / 9.0, 2, seed + 33)
    points = np.stack([x, y, z + 7.0 * wooded * (inland > 0.004)], axis=-1)
    p, q, r, s = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    faces = np.stack([np.stack([p, r, q], axis=-2), np.stack([p, s, r], axis=-2)])
    faces = faces.reshape(-1, 3, 3)
    middle = faces.mean(axis=1)
    snow_line = 95.0 + 130.0 * (fractal_noise(middle / 60.0, 4, seed + 34) - 0.5)
    snow = middle[:, 2] > snow_line
    return faces[~snow], faces[snow]


def village(rng: np.random.Generator) -> tuple[Triangles, Triangles]:
    """Houses on the far shore, to the left, and their lit windows."""
    walls: list[Triangles] = []
    windows: list[Triangles] = []
    for azimuth in np.sort(rng.uniform(-104.0, -34.0, 64)):
        width, depth, height = rng.uniform(7, 13), rng.uniform(7, 10), rng.uniform(4.5, 9.0)
        gable = [(-width / 2, 0), (width / 2, 0), (width / 2, height), (0, height + 3.4),
                 (-width / 2, height)]  # fmt: skip
        place = np.array([0.0, rng.uniform(182.0, 235.0), rng.uniform(0.5, 2.5)])
        place[2] += 0.16 * (place[1] - 182.0)
        walls.append(turned(moved(extruded(gable, 0.0, depth), place), azimuth))
        for level in range(int(height // 2.6)):
            for column in range(int(width // 3.0)):
                if rng.random() < 0.5:
                    corner = [-width / 2 + 1.0 + 2.8 * column, -0.3, 1.0 + 2.6 * level]
                    pane = box(corner, np.add(corner, [1.1, 0.2, 1.3]))
                    windows.append(turned(moved(pane, place), azimuth))
    return join(walls), join(windows)
