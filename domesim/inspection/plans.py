"""Plan and section of a theatre to scale, as SVG.

One unit of a drawing is a pixel of its view box, `WIDTH` of them across; colours and letters are
the page's (classes in ``show.css``). The plan is seen from above, the front of the audience at the
top. The section is the plane x = 0 seen from the theatre's right, the front on the right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from domesim.room.beams import lit_edge
from domesim.room.dome import Dome
from domesim.room.furniture import EYE_HEIGHT
from domesim.room.theatre import Theatre, Viewpoint
from domesim.scene import DomeScene, FlatScene

Floats = NDArray[np.float64]

WIDTH = 640
_SEAT = 0.46  # m, of its square
_FURNITURE = ("seats", "risers", "audience")


@final
class _Drawing:
    """Elements in metres -> SVG.

    Parameters
    ----------
    low, high
        (across, up) corners of what is drawn, m.
    label
        What it is, for who cannot see it.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float], label: str) -> None:
        self._low, self._high = np.asarray(low, float), np.asarray(high, float)
        self.scale = WIDTH / float(self._high[0] - self._low[0])
        self._height = self.scale * float(self._high[1] - self._low[1])
        self._label, self._parts = label, [""]

    def _at(self, points: Any) -> Floats:
        """(..., 2) pixels of points (..., 2) in metres."""
        moved = np.asarray(points, float) - self._low
        return np.stack([moved[..., 0], -moved[..., 1]], -1) * self.scale + [0, self._height]

    def line(self, points: Any, style: str, *, closed: bool = False) -> None:
        """A polyline or polygon (point, 2)."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._at(points))
        self._parts.append(
            f'<{"polygon" if closed else "polyline"} class="{style}" points="{text}"/>'
        )

    def circle(self, middle: Any, radius: float, style: str, title: str = "") -> None:
        """Draws a circle; `radius` is in metres."""
        x, y = self._at(middle)
        inner = f"<title>{escape(title)}</title>" if title else ""
        self._parts.append(
            f'<circle class="{style}" cx="{x:.1f}" cy="{y:.1f}" r="{radius * self.scale:.1f}">'
            f"{inner}</circle>"
        )

    def text(
        self, place: Any, words: str, style: str = "", anchor: str = "middle", down: float = 0.0
    ) -> None:
        """Words at a place, some letters' heights below it."""
        x, y = self._at(place)
        self._parts.append(
            f'<text class="{style}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" '
            f'dy="{down:g}em">{escape(words)}</text>'
        )

    def dimension(self, start: Any, end: Any, words: str, *, left: bool = False) -> None:
        """A line with marks at its ends and a length beside its middle, to the right or left."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0]]) * 6 / self.scale
        self.line([start, end], "measure")
        for tip in (start, end):
            self.line([tip - across, tip + across], "measure")
        level = abs(along[0]) > abs(along[1])
        shift = np.zeros(2) if level else np.array([(-8 if left else 8) / self.scale, 0])
        anchor = "middle" if level else "end" if left else "start"
        self.text((start + end) / 2 + shift, words, "size", anchor, -0.4 if level else 0.35)

    def svg(self) -> str:
        """The whole drawing."""
        return (
            f'<svg viewBox="0 0 {WIDTH} {self._height:.0f}" role="img" '
            f'aria-label="{escape(self._label)}">{"".join(self._parts)}</svg>'
        )


# A dome.


def dome_plan(scene: DomeScene, marked: Mapping[str, Viewpoint]) -> str:
    """A dome theatre from above; `marked` places are numbered in their order."""
    theatre, dome = scene.theatre, scene.dome
    reach = max(dome.widest, *(part.radius for part in (theatre.floor, theatre.wall) if part), 0.0)
    edge = 1.16 * reach
    draw = _Drawing((-edge, -1.26 * reach), (edge, 1.26 * reach), f"Plan of {scene.name}")
    if theatre.floor is not None:
        draw.circle((0, 0), theatre.floor.radius, "floor")
    if theatre.wall is not None:
        draw.circle((0, 0), theatre.wall.radius, "wall")
    _beams(draw, theatre, slice(0, 2))
    draw.line(_outline(dome), "screen", closed=True)
    _footprints(draw, theatre, slice(0, 2))
    for view in theatre.seats.values():
        _square(draw, (view.position[0], view.position[1] - 0.2))
    _projectors(draw, theatre, slice(0, 2), reach)
    _marks(draw, [(view.position[0], view.position[1]) for view in marked.values()], reach)
    draw.text((0, 1.1 * reach), "front", "place")
    width = 2 * dome.widest
    draw.dimension((-dome.widest, -1.13 * reach), (dome.widest, -1.13 * reach), f"{width:.4g} m")
    return draw.svg()


def dome_section(scene: DomeScene, marked: Mapping[str, Viewpoint]) -> str:
    """A dome theatre cut open by the plane x = 0; `marked` as of `dome_plan`."""
    theatre, dome, floor = scene.theatre, scene.dome, scene.theatre.floor
    profile = _profile(dome)
    reach = max(dome.widest, *(part.radius for part in (floor, theatre.wall) if part), 0.0)
    base = float(profile[:, 1].min()) if floor is None else min(floor.height, profile[:, 1].min())
    top = float(profile[:, 1].max())
    aside = 1.98 if floor is not None and theatre.seats else 1.16
    draw = _Drawing(
        (-aside * reach, base - 0.3 * reach),
        (1.68 * reach, top + 0.14 * reach),
        f"Section of {scene.name}",
    )
    _beams(draw, theatre, slice(1, 3))
    if floor is not None:
        for y, z in sorted({(v.position[1], v.position[2]) for v in theatre.seats.values()}):
            _row(draw, y, z - EYE_HEIGHT, floor.height)
        draw.line([(-floor.radius, floor.height), (floor.radius, floor.height)], "cut")
    if theatre.wall is not None:
        wall = theatre.wall
        for side in (-wall.radius, wall.radius):
            draw.line([(side, wall.bottom), (side, wall.top)], "cut")
    _footprints(draw, theatre, slice(1, 3))
    draw.line([(-1.02 * reach, 0), (1.02 * reach, 0)], "level")
    zenith = dome.to_room[:, 2] * dome.radius * dome.height_ratio
    draw.line([(0, 0), zenith[1:]], "level")
    draw.line(profile, "screen")
    _projectors(draw, theatre, slice(1, 3), reach)
    _marks(draw, [view.position[1:] for view in marked.values()], reach)
    if dome.tilt:
        draw.text(0.55 * zenith[1:], f" {np.degrees(dome.tilt):g}°", "size", "start")
    right = 1.12 * reach
    draw.dimension((right, 0), (right, top), f"{top:.3g} m")
    if base < 0:
        draw.dimension((right, base), (right, 0), f"{-base:.3g} m")
    eyes = sorted(view.position[2] for view in theatre.seats.values())
    if floor is not None and eyes:
        for eye, left in zip(dict.fromkeys((eyes[0], eyes[-1])), (1.06, 1.46), strict=False):
            tall = f"{eye - floor.height:.3g} m"
            ends = (-left * reach, floor.height), (-left * reach, eye)
            draw.dimension(*ends, tall, left=True)
    draw.text((reach, base), "front", "place", "end", 1.5)
    draw.text((-reach, base), "back", "place", "start", 1.5)
    return draw.svg()


def _outline(dome: Dome) -> Floats:
    """(point, 2): the screen's edge seen from above."""
    theta, azimuth = np.meshgrid(
        np.linspace(0, dome.half_angle, 91), np.linspace(0, 2 * np.pi, 181)
    )
    points = (dome.surface(theta, azimuth) @ dome.to_room.T).reshape(-1, 3)
    if dome.truncated_below is not None:
        points = points[points[:, 2] >= dome.truncated_below]
    return points[ConvexHull(points[:, :2]).vertices, :2]


def _profile(dome: Dome) -> Floats:
    """(point, 2): y and z of the screen in the plane x = 0, from the back to the front."""
    theta = np.linspace(-dome.half_angle, dome.half_angle, 361)
    points = dome.surface(np.abs(theta), np.where(theta < 0, -np.pi / 2, np.pi / 2))
    points = points @ dome.to_room.T
    if dome.truncated_below is not None:
        points = points[points[:, 2] >= dome.truncated_below]
    return np.asarray(points[:, 1:])


def _footprints(draw: _Drawing, theatre: Theatre, axes: slice) -> None:
    """What else stands in the room: its outline."""
    for solid in theatre.solids:
        if solid.name in _FURNITURE:
            continue
        points = solid.vertices[:, axes]
        try:
            draw.line(points[ConvexHull(points).vertices], "thing", closed=True)
        except QhullError:  # flat, seen from its edge
            draw.line(points, "thing")
    for lamp in theatre.lamps:
        draw.circle(lamp.centre[axes], 0.12, "lamp", lamp.name)


def _beams(draw: _Drawing, theatre: Theatre, axes: slice) -> None:
    """What each projector lights of the screen; nothing of one that lights all around it."""
    for lens in theatre.lenses:
        if lens.field < 2 * np.pi:
            draw.line(lit_edge(theatre, lens)[0][:, axes], "beam", closed=True)


def _projectors(draw: _Drawing, theatre: Theatre, axes: slice, reach: float) -> None:
    """Projectors and rays to the corners of their fields; one in the centre if there is none."""
    for lens in theatre.lenses:
        place = np.asarray(lens.position)
        # Of a rectangle the corners, of a circle four places
        edge = lit_edge(theatre, lens)[0] if lens.field < 2 * np.pi else np.zeros((0, 3))
        for corner in edge[:: max(1, len(edge) // 4)]:
            draw.line([place[axes], corner[axes]], "ray")
        draw.circle(place[axes], 0.02 * reach, "lens", lens.name)
    if not theatre.lenses:
        draw.circle((0.0, 0.0), 0.02 * reach, "lens", "projector")


def _square(draw: _Drawing, middle: tuple[float, float]) -> None:
    x, y = middle
    half = _SEAT / 2
    corners = [
        (x - half, y - half),
        (x + half, y - half),
        (x + half, y + half),
        (x - half, y + half),
    ]
    draw.line(corners, "seat", closed=True)


def _row(draw: _Drawing, y: float, foot: float, floor: float) -> None:
    """A step, a seat from the side, and the eye of who sits in it."""
    if foot > floor + 1e-6:
        step = [(y - 0.6, floor), (y - 0.6, foot), (y + 0.45, foot), (y + 0.45, floor)]
        draw.line(step, "step", closed=True)
    draw.line([(y - 0.38, foot + 1.08), (y, foot + 0.42), (y + 0.5, foot + 0.42)], "chair")
    draw.line([(y + 0.2, foot), (y + 0.2, foot + 0.42)], "chair")
    draw.circle((y, foot + EYE_HEIGHT), 0.09, "eye", f"eye, {foot + EYE_HEIGHT:.2f} m")


def _marks(draw: _Drawing, places: Sequence[Sequence[float]], reach: float) -> None:
    """Numbers at places; one for several that fall together."""
    together: dict[tuple[float, float], list[int]] = {}
    for number, (x, y) in enumerate(places, 1):
        together.setdefault((round(x, 2), round(y, 2)), []).append(number)
    for place, numbers in together.items():
        draw.circle(place, 0.012 * reach, "marked")
        words = f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]}–{numbers[-1]}"
        draw.text(place, words, "mark", "middle", -0.5)


# A flat screen.


def flat_plan(scene: FlatScene) -> str:
    """A flat screen from above, the screen on the right."""
    return _flat(scene, 0, f"Plan of {scene.name}")


def flat_section(scene: FlatScene) -> str:
    """A flat screen from its side, the screen on the right."""
    return _flat(scene, 2, f"Section of {scene.name}")


def _room(scene: FlatScene, axis: int) -> Floats:
    """Corners (corner, 2) of its room, from above or from the side; none if none is described."""
    room = None if scene.way is None else scene.way.room
    if room is None:
        return np.zeros((0, 2))
    width, height, length = room.size
    floor = -room.screen[1] / 2 - room.bottom
    low, high = (-width / 2, width / 2) if axis == 0 else (floor, floor + height)
    return np.array([(0, low), (-length, low), (-length, high), (0, high)])


def _flat(scene: FlatScene, axis: int, label: str) -> str:
    """The screen on the right, lenses and seats: depth across; x downwards (plan), or z upwards."""
    seats, lenses = scene.places, scene.lenses
    places = np.array([*seats.values(), *lenses], float)
    room = _room(scene, axis)
    far = float(-min(*places[:, 1], *room[:, 0], 0.0))
    size = scene.size[0] if axis == 0 else scene.size[1]

    def flat(point: Any) -> tuple[float, float]:
        return float(point[1]), -float(point[0]) if axis == 0 else float(point[2])

    across = np.array([*(flat(place)[1] for place in places), -size / 2, size / 2, *room[:, 1]])
    draw = _Drawing(
        (-1.12 * far, across.min() - 0.16 * far), (0.34 * far, across.max() + 0.1 * far), label
    )
    if len(room):
        draw.line(room, "wall", closed=True)
    ends = np.zeros((2, 3))
    ends[:, axis] = -size / 2, size / 2
    for lens in lenses:
        draw.line([flat(ends[0]), flat(lens), flat(ends[1])], "beam", closed=True)
    for place in seats.values():
        draw.line([flat(ends[0]), flat(place), flat(ends[1])], "ray")
    draw.line([flat(end) for end in ends], "screen")
    for lens in lenses:
        draw.circle(flat(lens), 0.009 * far, "lens", "projector")
    _marks(draw, [flat(place) for place in seats.values()], far)
    edge = 0.05 * far
    draw.dimension((edge, -size / 2), (edge, size / 2), f"{size:.4g} m")
    away = -next(iter(seats.values()))[1]
    below = across.min() - 0.1 * far
    draw.dimension((-away, below), (0, below), f"{away:.3g} m")
    return draw.svg()
