"""What sees what among screen, floor and wall: elements, form factors, and light's exchange.

These are the pieces of `radiosity`, whose docstring has the formulas. Lengths are in units of the
dome's radius.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import NamedTuple, final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.spherical import bare_gain
from domesim.room.lenses import field_weight, lens_gains
from domesim.room.rays import quadric
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_GRADING = 2.0
"""Patches shrink towards the ends of their panel like (1 - s)^3."""
_RIM = 2e-3
"""Share of the screen that may be hidden without a word: what its rim amounts to."""
_PICTURE = 256
"""Pixels a side of the picture on which the projectors' shares are measured."""
_CLOSE = 1e-9
_CHUNK = 256


class Mix(NamedTuple):
    """Albedos of one primary.

    Attributes
    ----------
    albedos
        Of screen, floor and wall: those that there are.
    paint
        Which of the `Enclosure.painted` multiplies the screen's.
    """

    albedos: tuple[float, ...]
    paint: int

    @property
    def screen(self) -> float:
        """Albedo of the screen, without what multiplies it."""
        return self.albedos[0]


@final
class Enclosure:
    """Screen points, then floor patches, then wall patches; form factors between them."""

    def __init__(self, theatre: Theatre, resolution: int) -> None:
        dome = theatre.dome
        self.theatre, self._unit, self._resolution = theatre, dome.radius, resolution
        self._lean = dome.to_room
        self._shape = self._lean @ np.diag([1, 1, dome.height_ratio**-2.0]) @ self._lean.T
        self._axis, self._cap = self._lean[:, 2], float(np.cos(dome.half_angle))
        cut = dome.truncated_below
        self._lowest = -np.inf if cut is None else cut / self._unit
        self._sheets = self._floor(resolution) + self._wall(resolution)
        self.points, self.weights = self._screen(2 * resolution, 4 * resolution)
        # The quadrature is nearly exact; the closed form wants it so to rounding.
        self.weights *= self.screen_area / self.weights.sum()
        self.areas = np.concatenate([self.weights] + [sheet.areas for sheet in self._sheets])

    @property
    def screen_area(self) -> float:
        """Area of the screen, in units of the radius squared."""
        return self.theatre.dome.screen_area / self._unit**2

    @cached_property
    def mixes(self) -> list[Mix]:
        """Albedos of screen, floor and wall (those that there are), one mix a primary."""
        t = self.theatre
        others = [surface.albedo for surface in (t.floor, t.wall) if surface is not None]
        each = enumerate(zip(t.screen_albedo, *others, strict=True))
        return [Mix(albedos, p % len(self.painted)) for p, albedos in each]

    @cached_property
    def painted(self) -> Floats:
        """(paint, screen point): what multiplies the screen's albedo, a mean around the point."""
        paint, dome = self.theatre.paint, self.theatre.dome
        if paint is None:
            return np.ones((1, len(self.points)))
        size = max(_PICTURE, len(paint.factors))
        factors, areas = paint.on(size, size), dome.screen_areas(size, size)
        count, on = len(self.points), np.nonzero(areas)
        nearest = scipy.spatial.KDTree(self.points).query(dome.points(size, size)[on] / self._unit)
        own = dome.pixel_of(dome.toward(self.points * self._unit), size)
        # A point that is nearest to no pixel has the one that it lies in
        owner = np.concatenate([nearest[1], np.arange(count)])
        weights = np.concatenate([areas[on], np.full(count, 1e-9 * areas.max())])
        planes = np.concatenate([factors[on], factors[own]]).T
        sums = [np.bincount(owner, weights * plane, count) for plane in planes]
        return np.asarray(sums / np.bincount(owner, weights, count))

    @cached_property
    def share(self) -> Floats:
        """(screen point,) of the screen's area."""
        return np.asarray(self.weights / self.weights.sum())

    @property
    def counts(self) -> dict[str, int]:
        """Number of elements of each kind."""
        counts = {"screen": len(self.points)}
        return counts | {sheet.name: len(sheet.areas) for sheet in self._sheets}

    @property
    def places(self) -> tuple[Floats, Floats]:
        """(u, v) of the screen's points in the domemaster."""
        x, y, z = (self.points @ self._lean).T
        ring = np.hypot(x, y)
        scale = np.arctan2(ring, z) / self.theatre.dome.half_angle / np.maximum(ring, 1e-30)
        return x * scale, y * scale

    @cached_property
    def stopped(self) -> float:
        """Share of the screen's area that floor or wall keep a projector's light from."""
        lenses, unit, places = self.theatre.lenses, self._unit, self._lens_places
        hidden = np.zeros((len(places), len(self.points)), bool)
        for _, meets in self._occluders[1:]:  # the first is the screen
            hidden |= meets(places[:, None], self.points)
        for number, lens in enumerate(lenses):
            hidden[number] &= field_weight(lens, self.points * unit) > 0
        return float((hidden * self.share).sum(1).max())

    def thrown(self) -> tuple[Floats, Floats]:
        """Light of the projectors on the elements, by points nine times as dense as the screen's.

        Returns
        -------
        lit, landed
            (screen point,) the share of its light that nothing stops, and (patch, screen point) the
            irradiance of floor and wall by the rest, 1 = that of the screen point if it were lit.

        Raises
        ------
        InputError
            If projectors leave a part of the screen dark.
        """
        dome, unit = self.theatre.dome, self._unit
        finer, weights = self._screen(6 * self._resolution, 12 * self._resolution)
        points = np.concatenate([finer, self.points])
        weights = np.concatenate([weights, 1e-9 * self.weights])  # none is without a point
        gains = lens_gains(self.theatre, _PICTURE, _PICTURE)
        row, col = dome.pixel_of(dome.toward(points * unit), _PICTURE)
        shares = gains[:, row, col] / gains[:, row, col].sum(0)
        owner = np.asarray(scipy.spatial.KDTree(self.points).query(points)[1])
        whole = np.bincount(owner, weights)
        lit, landed = np.zeros(len(whole)), np.zeros((len(self.areas) - len(whole), len(whole)))
        for lens, share in zip(self._lens_places, shares, strict=True):
            patch, stopped = self._first_patch(lens, points)
            power = share * weights / whole[owner]
            lit += np.bincount(owner, np.where(stopped, 0, power), len(whole))
            here = patch >= 0
            np.add.at(landed, (patch[here], owner[here]), (power * self.weights[owner])[here])
        return lit, landed / self.areas[len(whole) :, None]

    @property
    def _lens_places(self) -> Floats:
        """(lens, xyz)."""
        places = [lens.position for lens in self.theatre.lenses] or [(0.0, 0.0, 0.0)]
        return np.array(places) / self._unit

    def _first_patch(self, lens: Floats, points: Floats) -> tuple[NDArray[np.int64], Flags]:
        """(point,) the patch that its light meets first, -1 for none, and whether it is stopped."""
        patch, first = np.full(len(points), -1), np.full(len(points), np.inf)
        before = 0
        for sheet in self._sheets:
            along = (self._floor_at if sheet.name == "floor" else self._wall_at)(lens, points)
            here = along < first
            first[here], patch[here] = along[here], -1
            if sheet.faces(lens[None])[0]:  # backs absorb
                place = lens + along[here, None] * (points[here] - lens)
                patch[here] = before + sheet.patch_of(place)
            before += len(sheet.areas)
        return patch, np.isfinite(first)

    @property
    def lit(self) -> bool:
        """Whether projectors light the screen and nothing before it."""
        return self.stopped <= _RIM

    def require_lit(self, way_out: str) -> None:
        """Refuse projectors that light something before the screen.

        Raises
        ------
        InputError
            If floor or wall stop light on its way; it ends in the `way_out`.
        """
        if not self.lit:
            raise InputError(
                f"wanted a theatre whose projectors light the screen alone, got floor or wall "
                f"before {self.stopped:.1%} of it, which are lit instead; {way_out}"
            )

    @cached_property
    def sees(self) -> Floats:
        """(screen point,) sums of form factors."""
        return np.concatenate(
            [self.seen_from(self.points[some]).sum(1) for some in chunks(len(self.points))]
        )

    def albedos(self, mix: Mix) -> Floats:
        """(element,) of one primary's `mixes`."""
        counts = [len(self.points)] + [len(sheet.areas) for sheet in self._sheets]
        result = np.repeat(mix.albedos, counts)
        result[: len(self.points)] *= self.painted[mix.paint]
        return result

    def closed_form(self, mix: Mix) -> float:
        """Indirect light, of direct light 1, if the screen were a bare spherical cap."""
        mean = float(self.share @ self.painted[mix.paint])
        return bare_gain(mix.screen, self.theatre.dome, paint=mean)

    def screen_at(self, u: Floats, v: Floats) -> Floats:
        """Points of the screen.

        Parameters
        ----------
        u, v
            (point,) places of the domemaster, to the right and down, -1..1.

        Returns
        -------
        points
            (point, xyz), in the enclosure's unit.
        """
        theta = np.hypot(u, v) * self.theatre.dome.half_angle
        points = self.theatre.dome.surface(theta, np.arctan2(v, u)) / self._unit
        return np.asarray(points @ self._lean.T)

    def seen_from_sheet(self, name: str, points: Floats) -> Floats:
        """Form factors from points of floor or wall to all elements.

        Parameters
        ----------
        name
            The sheet: floor or wall.
        points
            (point, xyz) on it, in the enclosure's unit.

        Returns
        -------
        factors
            (point, element).
        """
        normals = self._sheet(name).normals(points)
        apart = self.points - points[:, None]
        square = np.sum(apart * apart, -1)
        behind = -self.points @ self._shape
        behind /= np.linalg.norm(behind, axis=-1, keepdims=True)
        leaving = np.maximum(np.einsum("pei,pi->pe", apart, normals), 0)
        arriving = np.maximum(-np.einsum("pei,ei->pe", apart, behind), 0)
        screen = leaving * arriving / (np.pi * np.maximum(square, _CLOSE) ** 2) * self.weights
        hidden = self._hidden(points, self.points)
        if hidden is not None:
            screen[hidden] = 0
        columns = [screen]
        for sheet in self._sheets:
            factors = self._patches_from(points, normals, sheet, self._own(name, sheet, points))
            columns.append(factors)
        return np.concatenate(columns, 1)

    def _sheet(self, name: str) -> Sheet:
        return next(sheet for sheet in self._sheets if sheet.name == name)

    def _own(self, name: str, sheet: Sheet, points: Floats) -> NDArray[np.int64] | None:
        return sheet.patch_of(points) if sheet.name == name else None

    def exchange(self) -> Floats:
        """(element, element) S_ij = F_ij sqrt(A_i / A_j), symmetric."""
        count = len(self.points)
        result = np.zeros((len(self.areas), len(self.areas)))
        root = np.sqrt(self.areas)
        for some in chunks(count):
            # w_i F_if = A_f F_fi: the patch's own view of a point need not be computed.
            factors = self.seen_from(self.points[some])
            result[some] = factors * root[:count][some, None] / root
        result[count:, :count] = result[:count, count:].T
        patches = self._between_patches() * root[count:, None] / root[count:]
        result[count:, count:] = (patches + patches.T) / 2
        return result

    def seen_from(self, points: Floats) -> Floats:
        """(point, element) form factors from points of the screen to all elements."""
        normals = -points @ self._shape
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        screen = self._screen_kernel(points) * self.weights
        hidden = self._hidden(points, self.points)
        if hidden is not None:
            screen[hidden] = 0
        return np.concatenate(
            [screen] + [self._patches_from(points, normals, sheet) for sheet in self._sheets], 1
        )

    def _screen_kernel(self, points: Floats) -> Floats:
        """(point, screen point) cos cos / (pi d²)."""
        if self.theatre.dome.height_ratio == 1:
            return np.full((len(points), len(self.points)), 1 / (4 * np.pi))
        shaped, others = points @ self._shape, self.points @ self._shape
        apart = points[:, None] - self.points
        square = np.sum(apart * apart, -1)
        bent = 1 - shaped @ self.points.T  # (x-y)'M(x-y) / 2 for points of x'Mx = 1
        steep = np.linalg.norm(shaped, axis=-1)[:, None] * np.linalg.norm(others, axis=-1)
        near = square < _CLOSE
        kernel = bent**2 / (np.pi * np.where(near, 1, square) ** 2 * steep)
        if near.any():
            # A point and itself: the mean over the directions of approach, with a and b the
            # eigenvalues of M in the tangent plane.
            row, col = np.nonzero(near)
            normal = shaped[row] / np.linalg.norm(shaped[row], axis=-1, keepdims=True)
            shape = self._shape
            trace = np.trace(shape) - np.einsum("ni,ij,nj->n", normal, shape, normal)
            product = np.linalg.det(shape) * np.einsum(
                "ni,ij,nj->n", normal, np.linalg.inv(shape), normal
            )
            mean = (3 * trace**2 - 4 * product) / 8
            kernel[row, col] = mean / (4 * np.pi * steep[row, col])
        return np.asarray(kernel)

    def _between_patches(self) -> Floats:
        """(patch, patch) form factors: means over points of the patch that looks."""
        rows = []
        for sheet in self._sheets:
            points, normals, areas = sheet.inner(3)
            share = areas / areas.sum(1, keepdims=True)
            columns = []
            for other in self._sheets:
                seen = np.zeros((len(points), len(other.areas)))
                for some in chunks(len(points)):
                    flat = points[some].reshape(-1, 3), normals[some].reshape(-1, 3)
                    own = np.repeat(np.arange(len(points))[some], points.shape[1])
                    factors = self._patches_from(*flat, other, own if sheet is other else None)
                    seen[some] = np.einsum(
                        "is,isf->if", share[some], factors.reshape(*share[some].shape, -1)
                    )
                columns.append(seen)
            rows.append(np.concatenate(columns, 1))
        return np.concatenate(rows) if rows else np.zeros((0, 0))

    def _patches_from(
        self, points: Floats, normals: Floats, sheet: Sheet, own: NDArray[np.int64] | None = None
    ) -> Floats:
        """(point, patch) form factors; `own` are the patches that the points lie on, if they do."""
        factors = sheet.contour(points, normals)
        if own is not None and not sheet.flat:
            # The edge runs round the point's horizon: what is behind it counts as -1.
            factors[np.arange(len(points)), own] += 1
        corners = sheet.corners.reshape(-1, 3)
        height = normals @ corners.T - np.sum(normals * points, -1)[:, None]
        some_up, all_up = sheet.of_corners(height > -_CLOSE)
        front = sheet.faces(points)[:, None]
        nothing, unsure = ~some_up, ~all_up
        hidden = self._hidden(points, corners)
        if hidden is not None:
            some_hidden, all_hidden = sheet.of_corners(hidden)
            nothing, unsure = nothing | all_hidden, unsure | some_hidden
        nothing, unsure = (nothing | ~front, unsure) if sheet.flat else (nothing, unsure | ~front)
        factors[nothing] = 0
        row, col = np.nonzero(unsure & ~nothing)
        for start in range(0, len(row), 40_000):
            r, c = row[start : start + 40_000], col[start : start + 40_000]
            total, seen = self._sampled(points[r], normals[r], sheet, c)
            whole = all_up[r, c] & front[r, 0]
            share = seen / np.maximum(total, 1e-300)
            factors[r, c] = np.where(whole, factors[r, c] * share, seen)
        return factors

    def _sampled(
        self, points: Floats, normals: Floats, sheet: Sheet, patches: NDArray[np.int64]
    ) -> tuple[Floats, Floats]:
        """Form factors from points to a patch each, by points on it: unhindered, and as hidden."""
        there, behind, areas = (part[patches] for part in sheet.samples)
        apart = there - points[:, None]
        square = np.sum(apart * apart, -1)
        leaving = np.maximum(np.sum(apart * normals[:, None], -1), 0)
        arriving = np.maximum(-np.sum(apart * behind, -1), 0)
        kernel = leaving * arriving / (np.pi * square**2) * areas
        open_ = np.ones(kernel.shape, bool)
        for _, meets in self._occluders:
            open_ &= ~meets(points[:, None], there)
        return kernel.sum(1), (kernel * open_).sum(1)

    def _hidden(self, points: Floats, others: Floats) -> Flags | None:
        """(point, other) whether something is between; None if that is impossible.

        Each surface lies on the boundary of something convex: half-space, cylinder, ellipsoid. So
        it is only between two points if one of them is outside.
        """
        result = None
        for outside, meets in self._occluders:
            rows, cols = outside(points), outside(others)
            if rows.any() or cols.any():
                result = np.zeros((len(points), len(others)), bool) if result is None else result
                result[rows] |= meets(points[rows][:, None], others)
                result[:, cols] |= meets(points[:, None], others[cols])
        return result

    @cached_property
    def _occluders(self) -> list[tuple[Callable[[Floats], Flags], Callable[..., Flags]]]:
        occluders: list[tuple[Callable[[Floats], Flags], Callable[..., Flags]]] = [
            (self._outside_screen, self._meets_screen)
        ]
        if self.theatre.floor is not None:
            occluders.append((self._under_floor, self._meets_floor))
        if self.theatre.wall is not None:
            occluders.append((self._outside_wall, self._meets_wall))
        return occluders

    def _outside_screen(self, points: Floats) -> Flags:
        return np.asarray(np.sum(points @ self._shape * points, -1) > 1 + _CLOSE)

    def _meets_screen(self, points: Floats, others: Floats) -> Flags:
        apart = others - points
        turned = apart @ self._shape
        start = np.sum(points @ self._shape * points, -1) - 1
        roots = _roots(np.sum(turned * apart, -1), np.sum(turned * points, -1), start)
        result = np.zeros(apart.shape[:-1], bool)
        for at in roots:
            between = (at > 1e-7) & (at < 1 - 1e-7)
            met = points + np.where(between, at, 0)[..., None] * apart
            rim = self._cap * np.linalg.norm(met, axis=-1)
            result |= between & (met @ self._axis > rim + _CLOSE) & (met[..., 2] > self._lowest)
        return result

    def _under_floor(self, points: Floats) -> Flags:
        assert self.theatre.floor is not None
        return np.asarray(points[..., 2] < self.theatre.floor.height / self._unit - _CLOSE)

    def _meets_floor(self, points: Floats, others: Floats) -> Flags:
        return np.isfinite(self._floor_at(points, others))

    def _floor_at(self, points: Floats, others: Floats) -> Floats:
        """(...): share of the way from points to others at which the floor is; infinite if not."""
        floor = self.theatre.floor
        assert floor is not None
        start = points[..., 2] - floor.height / self._unit
        end = others[..., 2] - floor.height / self._unit
        crosses = (start * end < 0) & (np.minimum(np.abs(start), np.abs(end)) > _CLOSE)
        at = np.where(crosses, start / np.where(crosses, start - end, 1), 0)[..., None]
        met = points[..., :2] + at * (others[..., :2] - points[..., :2])
        inside = crosses & (np.sum(met**2, -1) < (floor.radius / self._unit) ** 2)
        return np.where(inside, at[..., 0], np.inf)

    def _outside_wall(self, points: Floats) -> Flags:
        assert self.theatre.wall is not None
        away = np.hypot(points[..., 0], points[..., 1])
        return np.asarray(away > self.theatre.wall.radius / self._unit + _CLOSE)

    def _meets_wall(self, points: Floats, others: Floats) -> Flags:
        return np.isfinite(self._wall_at(points, others))

    def _wall_at(self, points: Floats, others: Floats) -> Floats:
        """(...): share of the way from points to others at which the wall is first."""
        wall = self.theatre.wall
        assert wall is not None
        apart = others - points
        flat, across = points[..., :2], apart[..., :2]
        start = np.sum(flat**2, -1) - (wall.radius / self._unit) ** 2
        roots = _roots(np.sum(across**2, -1), np.sum(flat * across, -1), start)
        result = np.full(apart.shape[:-1], np.inf)
        for at in roots[::-1]:
            between = (at > 1e-7) & (at < 1 - 1e-7)
            height = points[..., 2] + np.where(between, at, 0) * apart[..., 2]
            within = (height > wall.bottom / self._unit) & (height < wall.top / self._unit)
            result = np.where(between & within, at, result)
        return result

    def _floor(self, resolution: int) -> list[Sheet]:
        floor, dome = self.theatre.floor, self.theatre.dome
        if floor is None:
            return []
        height, reach = floor.height / self._unit, floor.radius / self._unit
        square = 1 - (height / dome.height_ratio) ** 2
        touches = dome.lowest / self._unit < height + 0.05 and square > 0
        contact = float(np.sqrt(square)) if touches else reach
        edges = _graded(0, min(contact, reach), resolution, low=False)
        if contact < reach * (1 - 1e-6):
            beyond = _graded(contact, reach, max(4, resolution // 2))
            edges = np.concatenate([edges, beyond[1:]])
        return [Sheet("floor", edges, np.full_like(edges, height), 2 * resolution)]

    def _wall(self, resolution: int) -> list[Sheet]:
        wall = self.theatre.wall
        if wall is None:
            return []
        radius, bottom, top = (z / self._unit for z in (wall.radius, wall.bottom, wall.top))
        ends = [bottom, top]
        if self.theatre.floor is not None:
            ends.append(self.theatre.floor.height / self._unit)
        if radius < 1.1:  # Where the sphere goes through it, or comes close
            touch = float(np.sqrt(max(0.0, 1 - radius**2)))
            ends += [touch, -touch]
        ends = sorted({min(max(end, bottom), top) for end in ends})
        ends = [ends[0]] + [b for a, b in itertools.pairwise(ends) if b - a > 1e-6]
        edges = np.array(ends[:1])
        for a, b in itertools.pairwise(ends):
            count = max(4, round(resolution * (b - a) / (top - bottom)))
            edges = np.concatenate([edges, _graded(a, b, count)[1:]])
        return [Sheet("wall", np.full_like(edges, radius), edges, 2 * resolution)]

    def _screen(self, along: int, around: int) -> tuple[Floats, Floats]:
        """Points of the screen and their areas: meridians from a pole to the rim.

        The pole is the room's zenith if the screen goes all round it, so that circles where floor
        or truncation meet the screen are circles of latitude, else the dome's.
        """
        dome = self.theatre.dome
        half, tilt = dome.half_angle, abs(dome.tilt)
        level = tilt < half - 0.05 and (half + tilt <= np.pi or half >= np.pi * (1 - 1e-9))
        frame = np.eye(3) if level else self._lean
        azimuth = (np.arange(around) + 0.5) * (2 * np.pi / around)

        def at(theta: Floats) -> Floats:
            ring, phi = np.sin(theta), np.broadcast_to(azimuth, theta.shape)
            local = np.stack([ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)], -1)
            return local @ frame.T

        def onto(directions: Floats) -> Floats:
            length = np.sqrt(np.sum(directions @ self._shape * directions, -1))
            return np.asarray(directions / length[..., None])

        def on_screen(theta: Floats) -> Flags:
            directions = at(theta)
            return (directions @ self._axis >= self._cap) & (
                onto(directions)[..., 2] >= self._lowest
            )

        def above_floor(theta: Floats) -> Flags:
            floor = self.theatre.floor
            level = -np.inf if floor is None else floor.height / self._unit
            return np.asarray(onto(at(theta))[..., 2] >= level)

        end = _last(on_screen, around)
        contact = np.minimum(_last(above_floor, around), end)
        node, weight = np.polynomial.legendre.leggauss(along)
        points, weights = [], []
        # What is above the floor, then what is below
        for start, stop, low in ((0 * end, contact, False), (contact, end, True)):
            place, slope = _grading((node[:, None] + 1) / 2, low=low, power=2.0)
            theta = start + (stop - start) * place
            directions = at(theta)
            position = onto(directions)
            stretched = position @ self._shape
            cosine = np.sum(stretched * directions, -1) / np.linalg.norm(stretched, axis=-1)
            density = np.sum(position**2, -1) / cosine * np.sin(theta)
            area = density * (stop - start) * slope * weight[:, None] / 2 * (2 * np.pi / around)
            points.append(position[area > 1e-14])
            weights.append(area[area > 1e-14])
        return np.concatenate(points), np.concatenate(weights)


def _roots(square: Floats, half: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Roots of square t² + 2 half t + start = 0; infinite if there are none."""
    start = np.where(np.abs(start) < _CLOSE, 0, start)
    with np.errstate(invalid="ignore", divide="ignore"):
        return quadric(np, square, half, start, on=False)


def _last(holds: Callable[[Floats], Flags], around: int) -> Floats:
    """(meridian,) the angle from the pole, up to pi, at which a condition first fails."""
    scan = np.linspace(0, np.pi, 1441)
    held = holds(np.broadcast_to(scan[:, None], (len(scan), around)))
    # A limit on an angle of the scan may be found before or after it: the halves end there anyway
    first = np.argmin(held, axis=0)
    high = np.where(held.all(0), np.pi, scan[first])
    low = np.where(held.all(0), np.pi, scan[np.maximum(first - 1, 0)])
    for _ in range(50):
        middle = (low + high) / 2
        up = holds(middle[None])[0]
        low, high = np.where(up, middle, low), np.where(up, high, middle)
    return low


def _grading(s: Floats, *, low: bool, power: float) -> tuple[Floats, Floats]:
    """t(s), crowded towards 1 (and 0, if low), and its slope."""
    if not low:
        return 1 - (1 - s) ** power, power * (1 - s) ** (power - 1)
    a, b = s**power, (1 - s) ** power
    return a / (a + b), power * (s * (1 - s)) ** (power - 1) / (a + b) ** 2


def _graded(start: float, stop: float, count: int, *, low: bool = True) -> Floats:
    """(count + 1,) edges that crowd towards the ends (or `stop` only)."""
    place, _ = _grading(np.linspace(0, 1, count + 1), low=low, power=_GRADING)
    return np.asarray(start + (stop - start) * place)


@final
class Sheet:
    """A surface of revolution round the z axis in rings of patches: floor or wall.

    Parameters
    ----------
    name
        What it is.
    radii, heights
        Radii and heights of the circles between the rings, which go outwards and up, seen from the
        inside.
    sectors
        Patches in a ring.
    """

    def __init__(self, name: str, radii: Floats, heights: Floats, sectors: int) -> None:
        self.name, self._radii, self._heights, self._sectors = name, radii, heights, sectors
        self.flat = bool(heights[0] == heights[-1])
        self._bounds = np.arange(sectors + 1) * (2 * np.pi / sectors)
        self.samples = self.inner(4)
        self.areas = self.samples[2].sum(1)

    def patch_of(self, points: Floats) -> NDArray[np.int64]:
        """(point,) the patch that holds a point of the surface.

        Callers' points are within patches: rounding moves none to the next.
        """
        along = np.hypot(points[:, 0], points[:, 1]) if self.flat else points[:, 2]
        edges = self._radii if self.flat else self._heights
        ring = np.clip(np.searchsorted(edges, along, "right") - 1, 0, len(edges) - 2)
        turn = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
        sector = np.minimum((turn * self._sectors / (2 * np.pi)).astype(int), self._sectors - 1)
        return np.asarray(ring * self._sectors + sector)

    def normals(self, points: Floats) -> Floats:
        """Unit normals (point, xyz) at points of the sheet."""
        result = np.zeros_like(points)
        if self.flat:
            result[:, 2] = 1
        else:
            result[:, :2] = -points[:, :2] / np.hypot(points[:, 0], points[:, 1])[:, None]
        return result

    @cached_property
    def corners(self) -> Floats:
        """Corners of the patches: (circle, sector, xyz)."""
        radii, phi = self._radii[:, None], self._bounds[None, :-1]
        heights = np.broadcast_to(self._heights[:, None], (len(self._radii), self._sectors))
        return np.stack([radii * np.cos(phi), radii * np.sin(phi), heights], -1)

    def of_corners(self, flags: Flags) -> tuple[Flags, Flags]:
        """Returns (point, patch) whether some corner of it is flagged, and whether all are."""
        grid = flags.reshape(len(flags), -1, self._sectors)
        after = np.roll(grid, -1, axis=2)
        some, every = grid | after, grid & after
        return (
            (some[:, 1:] | some[:, :-1]).reshape(len(flags), -1),
            (every[:, 1:] & every[:, :-1]).reshape(len(flags), -1),
        )

    def inner(self, count: int) -> tuple[Floats, Floats, Floats]:
        """Gauss-Legendre points in the patches and normals (patch, point, xyz), and areas."""
        node, weight = np.polynomial.legendre.leggauss(count)
        node, weight = (node + 1) / 2, weight / 2
        long, tall = np.diff(self._radii), np.diff(self._heights)
        radii = self._radii[:-1, None] + long[:, None] * node
        heights = self._heights[:-1, None] + tall[:, None] * node
        step = 2 * np.pi / self._sectors
        phi = self._bounds[:-1, None] + step * node
        # (ring, sector, along, around)
        shape = len(long), self._sectors, count, count
        ring = radii[:, None, :, None]
        c, s = np.cos(phi)[None, :, None, :], np.sin(phi)[None, :, None, :]
        areas = ring * (np.hypot(long, tall)[:, None] * weight)[:, None, :, None] * weight * step
        towards = (0 * c, 0 * s, 1.0) if self.flat else (-c, -s, 0.0)

        def flat(*parts: Floats | float) -> Floats:
            return np.stack(
                [np.broadcast_to(part, shape).reshape(patches, -1) for part in parts], -1
            )

        patches = len(long) * self._sectors
        points = flat(ring * c, ring * s, heights[:, None, :, None])
        return points, flat(*towards), flat(areas)[..., 0]

    def faces(self, points: Floats) -> Flags:
        """Whether points (point,) are in front of the sheet."""
        if self.flat:
            return np.asarray(points[:, 2] > self._heights[0] + 1e-12)
        return np.asarray(np.hypot(points[:, 0], points[:, 1]) < self._radii[0] + _CLOSE)

    def contour(self, points: Floats, normals: Floats) -> Floats:
        """Form factors of patches above the horizon and in front, unhindered.

        Parameters
        ----------
        points
            (point, xyz), in the enclosure's unit.
        normals
            (point, xyz) unit vectors.

        Returns
        -------
        factors
            (point, patch).
        """
        arcs, edges = self._arcs(points, normals), self._edges(points, normals)
        round_ = arcs[:, :-1] - arcs[:, 1:]
        straight = np.roll(edges, -1, axis=2) - edges
        return np.asarray((round_ + straight).reshape(len(points), -1) / (2 * np.pi))

    def _arcs(self, points: Floats, normals: Floats) -> Floats:
        """(point, circle, sector) integrals of n . (s x ds) / s² along the circles' arcs.

        With psi from the point's own azimuth, s² = a - b cos psi; and with d = sqrt(a² - b²),
        k = b / (a + d) and A = atan2(k sin psi, 1 - k cos psi), the integral of 1 / s² is
        (psi + 2 A) / d, that of cos psi / s² is (k psi + 2 a A / b) / d.
        """
        x, y, z = points.T
        away, phi = np.hypot(x, y), np.arctan2(y, x)
        out = normals[:, 0] * np.cos(phi) + normals[:, 1] * np.sin(phi)
        aside = normals[:, 1] * np.cos(phi) - normals[:, 0] * np.sin(phi)
        up, away, out, aside = (part[:, None] for part in (normals[:, 2], away, out, aside))
        radius, rise = self._radii[None, :], self._heights[None, :] - z[:, None]
        a = radius**2 + away**2 + rise**2
        b = np.maximum(2 * radius * away, 1e-150)
        gap = np.maximum((radius - away) ** 2 + rise**2, 1e-30)  # a - b
        d = np.sqrt(gap * (a + b))
        k = b / (a + d)
        psi = (self._bounds - phi[:, None])[:, None, :]
        half = 2 * np.sin(psi / 2) ** 2  # 1 - cos psi
        less = ((gap + d) / (a + d))[..., None] + k[..., None] * half  # 1 - k cos psi
        angle = np.arctan2(k[..., None] * np.sin(psi), less)
        plain = (psi + 2 * angle) / d[..., None]
        cosine = (k[..., None] * psi + (2 * a / b)[..., None] * angle) / d[..., None]
        ratio = (b / a)[..., None]
        size = np.where(
            ratio < 0.5,
            np.log1p(-np.minimum(ratio, 0.5) * (1 - half)),
            np.log((gap / a)[..., None] + ratio * half),
        )
        sine = size / b[..., None]
        total = (up * radius**2)[..., None] * plain
        total -= (radius * (rise * out + up * away))[..., None] * cosine
        total -= (radius * rise * aside)[..., None] * sine
        return np.diff(total, axis=2)

    def _edges(self, points: Floats, normals: Floats) -> Floats:
        """(point, ring, sector) integrals of `_arcs` along the straight edges between sectors."""
        corner = self.corners - points[:, None, None]
        start, stop = corner[:, :-1], corner[:, 1:]
        turn = np.cross(start, stop - start)
        size = np.linalg.norm(turn, axis=-1)
        angle = np.arctan2(size, np.sum(start * stop, -1))
        along = np.einsum("prsi,pi->prs", turn, normals)
        return np.asarray(along * angle / np.maximum(size, 1e-300))


@final
class Solver:
    """b = (1 - R² S)^-1 e by Cholesky, with R = sqrt(albedo) and b = B sqrt(A)."""

    def __init__(self, symmetric: Floats, albedos: Floats) -> None:
        self._gray = np.flatnonzero(albedos > 0)
        self._root = np.sqrt(albedos[self._gray])[:, None]
        self._links = symmetric[self._gray]
        system = -self._root * self._links[:, self._gray] * self._root.T
        system[np.diag_indices_from(system)] += 1
        self._factor = scipy.linalg.cho_factor(system, lower=True, overwrite_a=True)

    def solve(self, emission: Floats) -> Floats:
        """(element, picture) b of the emission e."""
        # Of the light after the first bounce, so that dark surfaces lose no digits
        first = self._root * (self._links @ emission)
        result = emission.copy()
        result[self._gray] += self._root * scipy.linalg.cho_solve(self._factor, first)
        return result


def chunks(count: int) -> Iterator[slice]:
    """Slices of `count` things, each so few that their pairs fit into memory."""
    return (slice(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK))
