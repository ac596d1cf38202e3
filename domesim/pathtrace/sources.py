"""The light that walks collect, from the picture and from lamps; and the screen's gain lobe."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.loop import Aim, Colour, Scatter, Source, difference, painted, pixel_of
from domesim.pathtrace.machine import DrJit
from domesim.room.rays import (
    BACK,
    NOTHING,
    SCREEN,
    SHELL,
    Hit,
    Lanes,
    Room,
    Vector,
    along,
    dot,
    scaled,
)
from domesim.room.theatre import Albedo, Lobe

_TRUST = 8.0
"""Number of draws that aimed ones count as. With 1, 4, 8, 16 the noise of one walk is 0.40, 0.26,
0.21, 0.19 of the mean (night, dome_imax)."""


@final
@dataclass(frozen=True)
class _Beam:
    """One projector's light.

    Attributes
    ----------
    lens
        Where it comes from, in units of the dome's radius.
    share
        (pixel,) what is sent towards the screen, of all projectors' sum.
    stopped
        Whether something stands in it.
    """

    lens: tuple[float, float, float]
    share: Lanes
    stopped: bool

    def at(self, room: Room, position: Vector, pixel: Lanes, active: Lanes) -> Lanes:
        """Share that arrives at points of the screen, which lie behind pixels.

        Each point is looked at, not its pixel: of a pixel that a floor crosses, the part above is
        lit, and seen from above.
        """
        m = room.machine
        share = m.gather(self.share, pixel, active)
        if not self.stopped:
            return share
        # From the screen to the lens: a projector's own body may hold the lens.
        leaving = m.where(active, SCREEN, SCREEN)
        return m.where(room.shadowed(position, self.lens, leaving, active), 0.0, share)


@final
class Throw:
    """How the projectors' light gets to the eye: from the screen, from what stands before it.

    Light on its way to a point of the screen may meet floor, wall or solids first, and lights them
    instead; of what reaches a perforated screen a part goes on to the shell behind.

    Parameters
    ----------
    room
        The theatre.
    thrown
        (lens, row, col) what each lens sends towards the screen, of a square domemaster.
    reaching
        (lens, row, col) the part of `thrown` that nothing stops.
    lobe
        The screen's lobe, or None.

    Raises
    ------
    InputError
        If the screen is black, whose white is the unit of all light, and other things are lit.
    """

    def __init__(
        self,
        room: Room,
        thrown: NDArray[Any],
        reaching: NDArray[Any],
        lobe: GainLobe | None,
    ) -> None:
        m, theatre = room.machine, room.theatre
        positions = [lens.position for lens in theatre.lenses] or [(0.0, 0.0, 0.0)]
        lenses = [
            (p[0] / theatre.dome.radius, p[1] / theatre.dome.radius, p[2] / theatre.dome.radius)
            for p in positions
        ]
        self._lobe = lobe
        self._size, self._paint = thrown.shape[-1], None
        if theatre.paint is not None:
            self._paint = m.paint(theatre.paint.on(self._size, self._size))
        total = thrown.sum(0)
        sent, shares = (
            np.divide(part, total, out=np.zeros_like(thrown), where=total > 0)
            for part in (thrown, reaching)
        )
        stopped = [bool(np.any(part < whole)) for part, whole in zip(shares, sent, strict=True)]
        self.lit: NDArray[Any] | None = shares.sum(0) if any(stopped) else None
        self._beams = [
            _Beam(lens, m.lanes(share.ravel()), some)
            for lens, share, some in zip(lenses, sent, stopped, strict=True)
        ]
        self._before = _over_white(room)
        self._stopped = [beam for beam in self._beams if beam.stopped and self._before]
        self._through = (1.0, 1.0, 1.0)
        if room.has_cavity and theatre.cavity is not None:
            _require_white(room)
            x, y, z = (
                theatre.perforation * shell / screen
                for shell, screen in zip(theatre.cavity.albedo, theatre.screen_albedo, strict=True)
            )
            self._through = (x, y, z)
        if self._stopped:
            _require_white(room)

    def arrivals(
        self, room: Room, hit: Hit, to_eye: Vector, active: Lanes
    ) -> Iterator[tuple[Vector, Lanes, Colour]]:
        """Yields places on the screen whose light shows at `hit`, their lanes, and how much.

        How much is relative to what those places show of the picture, if nothing stops its light.
        """
        m = room.machine
        on_screen = active & (hit.surface == SCREEN)
        gain: Any = hit.position[0] * 0 + 1
        if self._lobe is not None:
            pixel = pixel_of(room, hit.position, self._size)
            gain = gain - 1
            for beam in self._beams:
                to_lens = _towards(m, hit.position, beam.lens)
                pattern = self._lobe.gain(hit.normal, to_eye, to_lens, on_screen)
                gain = gain + beam.at(room, hit.position, pixel, on_screen) * pattern
        elif self.lit is not None:
            gain = self.lit_at(room, hit.position, on_screen)
        yield hit.position, on_screen, (gain, gain, gain)
        for beam in self._stopped:
            yield self._on_things(room, hit, beam, active)
        if room.has_cavity:
            for beam in self._beams:
                yield self._on_shell(room, hit, beam, active & (hit.surface == SHELL))

    def lit_at(self, room: Room, position: Vector, active: Lanes) -> Lanes:
        """Share of the projectors' light that reaches points of the screen."""
        if self.lit is None:
            return position[0] * 0 + 1
        pixel = pixel_of(room, position, self._size)
        first, *others = (beam.at(room, position, pixel, active) for beam in self._beams)
        return sum(others, start=first)

    def _on_things(
        self, room: Room, hit: Hit, beam: _Beam, active: Lanes
    ) -> tuple[Vector, Lanes, Colour]:
        """Light from a lens that lands on floor, wall or solids on its way to the screen."""
        m = room.machine
        known: Any = False
        factors: list[Any] = [hit.position[0] * 0] * 3
        for surface, over_white in self._before.items():
            here = hit.surface == surface
            known = known | here
            factors = [
                m.where(here, part, factor)
                for part, factor in zip(over_white, factors, strict=True)
            ]
        origin, direction, distance = _from_lens(m, hit.position, beam.lens)
        meant = room.screen_along(origin, direction, m.where(active, NOTHING, NOTHING))
        gap = difference(meant.position, origin)
        far = dot(gap, gap)
        arriving = m.maximum(-dot(hit.normal, direction), 0.0)
        lands = active & known & (meant.surface == SCREEN)
        lands = lands & (arriving > 0) & (distance * distance < far)
        start = along(hit.position, hit.normal, 1e-5)
        hidden = room.shadowed(start, beam.lens, hit.surface, lands, screen_hides=False)
        lands = lands & ~hidden
        leaving = m.maximum(-dot(meant.normal, direction), 1e-3)
        spread = far / (distance * distance) * arriving / leaving
        pixel = pixel_of(room, meant.position, self._size)
        spread = spread * m.gather(beam.share, pixel, lands)
        x, y, z = self._unpainted(room, pixel, lands, spread)
        return meant.position, lands, (x * factors[0], y * factors[1], z * factors[2])

    def _on_shell(
        self, room: Room, hit: Hit, beam: _Beam, active: Lanes
    ) -> tuple[Vector, Lanes, Colour]:
        """Light from a lens that came through a hole; it falls with the square of the distance."""
        m = room.machine
        origin, direction, distance = _from_lens(m, hit.position, beam.lens)
        hole = room.screen_along(origin, direction, m.where(active, NOTHING, NOTHING))
        passed = active & (hole.surface == SCREEN)
        gap = difference(hole.position, origin)
        near = dot(gap, gap)
        arriving = m.maximum(-dot(hit.normal, direction), 0.0)
        leaving = m.maximum(-dot(hole.normal, direction), 1e-3)
        spread = near / (distance * distance) * arriving / leaving
        pixel = pixel_of(room, hole.position, self._size)
        spread = spread * beam.at(room, hole.position, pixel, passed)
        x, y, z = self._unpainted(room, pixel, passed, spread)
        through = self._through
        return hole.position, passed, (x * through[0], y * through[1], z * through[2])

    def _unpainted(self, room: Room, pixel: Lanes, active: Lanes, value: Lanes) -> Colour:
        """A value over what multiplies the albedo of the screen's pixels."""
        if self._paint is None:
            return value, value, value
        m = room.machine
        x, y, z = (
            value / m.where(active, factor, 1.0)
            for factor in m.colour_at(self._paint, pixel, active)[0]
        )
        return x, y, z


@final
class Picture(Aim):
    """A domemaster on the screen.

    Walks find a small bright window late by chance; aimed at, it costs no luck. A table of pixels,
    each as often as its share of the light, is drawn from; the density of such draws over the
    screen's area is known, so that found and aimed light are weighed by the balance heuristic
    [Veach 1997, section 9.2.2], and nothing is counted twice. Aimed draws count as if there were
    `_TRUST` of them: on a sphere, where all points see each other alike, they alone have no noise,
    but near a corner only found light is safe.

    Parameters
    ----------
    room, thrown, reaching, lobe
        As of `Throw`.
    values
        (row, col, primary) light that projectors send to the screen: picture times total gain.
    """

    def __init__(
        self,
        room: Room,
        values: NDArray[Any],
        thrown: NDArray[Any],
        reaching: NDArray[Any],
        lobe: GainLobe | None,
    ) -> None:
        m, dome = room.machine, room.theatre.dome
        self._size = values.shape[0]
        self._throw = Throw(room, thrown, reaching, lobe)
        lit = values if self._throw.lit is None else values * self._throw.lit[..., None]
        self.can_aim = lobe is None and dome.height_ratio == 1 and bool(np.any(lit > 0))
        draws = np.zeros(self._size**2, np.int64)
        if self.can_aim:
            draws = _draws(lit, dome.pixel_areas(self._size, self._size))
            self._drawn = m.lanes(np.repeat(np.arange(len(draws)), draws))
        self._count = int(draws.sum())
        # Draws a unit of the disc's (u, v)
        density = draws / max(1, self._count) * (self._size / 2) ** 2
        self._table = m.colours(np.column_stack([values.reshape(-1, 3), density]))

    def value(self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, rng: Any) -> Colour:
        """Direct value of points in the direction `to_eye`."""
        return self.weighed(room, hit, to_eye, active, None)

    def weighed(
        self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, found: Lanes | None
    ) -> Colour:
        """Direct value of points that walks have found.

        With `found`, the density over the screen's area (unit radius) with which they were found,
        less what aiming at them has brought already; 0 where nothing was aimed.
        """
        sums: list[Any] = [0.0, 0.0, 0.0]
        for number, (position, arrived, factor) in enumerate(
            self._throw.arrivals(room, hit, to_eye, active)
        ):
            pixel = pixel_of(room, position, self._size)
            colour, density = room.machine.colour_at(self._table, pixel, arrived)
            weight: Any = 1.0
            if found is not None and number == 0:
                aimed = _TRUST * density / self._stretch(room, *room.disc(position))
                weight = room.machine.where(found > 0, found / (found + aimed), 1.0)
            for p in range(3):
                part = colour[p] * factor[p] * weight
                # Where nothing arrived, the factor may be no number.
                sums[p] = sums[p] + room.machine.where(arrived, part, 0.0)
        return sums[0], sums[1], sums[2]

    def aim(self, room: Room, here: Hit, active: Lanes, rng: Any) -> Colour:
        """One aimed estimate of the mean value that Lambertian points see, less what walks find."""
        m = room.machine
        drawn = m.index(m.minimum(m.uniform(rng) * self._count, self._count - 1.0))
        pixel = m.number_at(self._drawn, drawn)
        row, col = pixel // self._size, pixel % self._size
        u = (m.number(col) + m.uniform(rng)) * (2 / self._size) - 1
        v = (m.number(row) + m.uniform(rng)) * (2 / self._size) - 1
        position, normal = room.screen_at(u, v)
        away = difference(position, here.position)
        square = m.maximum(dot(away, away), 1e-12)
        direction = scaled(away, 1 / m.sqrt(square))
        cosines = m.maximum(dot(direction, here.normal), 0.0)
        cosines = cosines * m.maximum(-dot(direction, normal), 0.0)
        by_chance = cosines / (np.pi * square)  # the density of finding it by chance
        lit = active & (by_chance > 0) & (u * u + v * v <= 1) & room.on_screen(position)
        lit = lit & ~room.shadowed(here.position, position, here.surface, lit, screen_hides=False)
        colour, density = m.colour_at(self._table, pixel, lit)
        aimed = _TRUST * density / self._stretch(room, u, v)
        reaching = self._throw.lit_at(room, position, lit)
        share = m.where(lit, reaching * _TRUST * by_chance / (by_chance + aimed), 0.0)
        return colour[0] * share, colour[1] * share, colour[2] * share

    def _stretch(self, room: Room, u: Lanes, v: Lanes) -> Lanes:
        """Area of the unit sphere's screen to a unit of the disc's (u, v)."""
        m = room.machine
        half_angle = room.theatre.dome.half_angle
        distance = m.sqrt(m.maximum(u * u + v * v, 1e-12))
        return half_angle * m.sin(m.minimum(distance, 1.0) * half_angle) / distance


def _draws(values: NDArray[Any], areas: NDArray[Any], wanted: int = 1 << 20) -> NDArray[np.int64]:
    """(pixel,) how often each is drawn: its share of the light of about `wanted` draws."""
    flux = np.ravel(np.maximum(values, 0).sum(-1) * areas)
    ends = np.floor(np.cumsum(flux) / flux.sum() * wanted + 0.5)
    return np.asarray(np.diff(ends, prepend=0.0), np.int64)


@final
class Lamps(Source):
    """The lamps of the theatre: a point of each is looked for from everywhere.

    Parameters
    ----------
    room
        The theatre.
    lobe
        The screen's lobe, or None.
    """

    def __init__(self, room: Room, lobe: GainLobe | None) -> None:
        unit = room.theatre.dome.radius
        self._lobe = lobe
        self._lamps = []
        for lamp in room.theatre.lamps:
            across, up = np.asarray(lamp.across) / unit, np.asarray(lamp.up) / unit
            normal = np.cross(across, up)
            area = 4 * float(np.linalg.norm(normal))
            if area <= 0:
                raise InputError(f"lamp {lamp.name!r} has no area; give it a size above 0")
            normal = normal / np.linalg.norm(normal)
            self._lamps.append(
                (np.asarray(lamp.centre) / unit, across, up, normal, area, lamp.luminance)
            )

    def value(self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, rng: Any) -> Colour:
        """Direct value of points in the direction `to_eye`."""
        m = room.machine
        # What a screen shows on average, holes and all; a hole lets lamps' light out.
        albedos = room.albedos | {SCREEN: room.theatre.screen_albedo}
        paint = painted(room, hit.position, hit.surface == SCREEN)
        sums: list[Any] = [hit.position[0] * 0] * 3
        for centre, across, up, normal, area, luminance in self._lamps:
            s, t = 2 * m.uniform(rng) - 1, 2 * m.uniform(rng) - 1
            x, y, z = (float(c) + s * float(a) + t * float(b)
                       for c, a, b in zip(centre, across, up, strict=True))  # fmt: skip
            to_lamp = (x - hit.position[0], y - hit.position[1], z - hit.position[2])
            square = m.maximum(dot(to_lamp, to_lamp), 1e-8)
            to_lamp = scaled(to_lamp, 1 / m.sqrt(square))
            emitted = m.maximum(
                -(to_lamp[0] * float(normal[0]) + to_lamp[1] * float(normal[1])
                  + to_lamp[2] * float(normal[2])), 0.0
            )  # fmt: skip
            arriving = m.maximum(dot(to_lamp, hit.normal), 0.0)
            lit = active & (emitted > 0) & (arriving > 0)
            start = along(hit.position, hit.normal, 1e-5)
            shadow = room.shadowed(start, (x, y, z), hit.surface, lit)
            light = m.where(lit & ~shadow, emitted * arriving * area / (np.pi * square), 0.0)
            if self._lobe is not None:
                pattern = self._lobe.gain(hit.normal, to_eye, to_lamp, lit)
                light = light * m.where(hit.surface == SCREEN, pattern, 1.0)
            for p in range(3):
                rho: Any = 0.0
                for surface, albedo in albedos.items():
                    rho = m.where(hit.surface == surface, albedo[p], rho)
                rho = rho * paint[p]
                sums[p] = sums[p] + light * rho * luminance[p]
        return sums[0], sums[1], sums[2]


@final
class GainLobe(Scatter):
    """A blend of Lambertian and GGX reflection: Mitsuba's own BSDFs.

    Parameters
    ----------
    machine
        What to compute with.
    lobe
        Share and roughness.
    """

    def __init__(self, machine: DrJit, lobe: Lobe) -> None:
        self._mi, self._dr = machine.mi, machine.dr
        self._bsdf = machine.mi.load_dict(lobe_bsdf(lobe))

    def sample(
        self, normal: Vector, to_eye: Vector, rng: Any, active: Lanes
    ) -> tuple[Vector, Lanes]:
        """A direction to continue in, and the weight of the walk without the albedo."""
        mi = self._mi
        si = self._interaction(normal, to_eye)
        choice, first, second = rng.next_float32(), rng.next_float32(), rng.next_float32()
        sample, weight = self._bsdf.sample(
            mi.BSDFContext(), si, choice, mi.Point2f(first, second), active
        )
        # Some samples fail, with weight 0 and a direction that is no number.
        good = active & (sample.pdf > 0) & (weight.x > 0)
        out = self._dr.select(good, si.to_world(sample.wo), mi.Vector3f(*normal))
        return (out.x, out.y, out.z), self._dr.select(good, weight.x, 0)

    def gain(self, normal: Vector, to_eye: Vector, to_light: Vector, active: Lanes) -> Lanes:
        """Brightness towards the eye of light from a direction, over a Lambertian screen's."""
        mi, dr = self._mi, self._dr
        si = self._interaction(normal, to_eye)
        wo = si.to_local(mi.Vector3f(*to_light))
        value = self._bsdf.eval(mi.BSDFContext(), si, wo, active).x
        return dr.select(active & (wo.z > 0), value * dr.pi / dr.maximum(wo.z, 1e-4), 0)

    def _interaction(self, normal: Vector, to_eye: Vector) -> Any:
        mi = self._mi
        si = self._dr.zeros(mi.SurfaceInteraction3f)
        si.n = mi.Normal3f(*normal)
        si.sh_frame = mi.Frame3f(si.n)
        si.wi = si.to_local(mi.Vector3f(*to_eye))
        si.t = 1.0
        return si


def lobe_bsdf(lobe: Lobe, albedo: Sequence[float] = (1.0, 1.0, 1.0)) -> dict[str, Any]:
    """Mitsuba's description of a screen with a lobe: microfacets that lose nothing by colour."""
    return {
        "type": "blendbsdf",
        "weight": lobe.share,
        "lambertian": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}},
        "lobe": {
            "type": "roughconductor",
            "material": "none",
            "distribution": "ggx",
            "alpha": lobe.roughness,
            "specular_reflectance": {"type": "rgb", "value": list(albedo)},
        },
    }


def _towards(m: DrJit, position: Vector, place: tuple[float, float, float]) -> Vector:
    away = (place[0] - position[0], place[1] - position[1], place[2] - position[2])
    return scaled(away, 1 / m.sqrt(m.maximum(dot(away, away), 1e-12)))


def _from_lens(
    m: DrJit, position: Vector, lens: tuple[float, float, float]
) -> tuple[Vector, Vector, Lanes]:
    """Rays from a lens to points: origins, unit directions and lengths."""
    away = (position[0] - lens[0], position[1] - lens[1], position[2] - lens[2])
    distance = m.sqrt(m.maximum(dot(away, away), 1e-12))
    zero = position[0] * 0
    origin = (zero + lens[0], zero + lens[1], zero + lens[2])
    return origin, scaled(away, 1 / distance), distance


def _over_white(room: Room) -> dict[int, Albedo]:
    """Albedo of what stands before the screen over the screen's, by surface: white is the unit."""
    screen = room.theatre.screen_albedo
    over_white = {}
    for surface, albedo in room.albedos.items():
        if surface not in (SCREEN, BACK, SHELL) and max(albedo) > 0:
            x, y, z = (a / s if s > 0 else 0.0 for a, s in zip(albedo, screen, strict=True))
            over_white[surface] = (x, y, z)
    return over_white


def _require_white(room: Room) -> None:
    if min(room.theatre.screen_albedo) <= 0:
        raise InputError(
            "a screen that shares the projectors' light with other things, behind its holes or "
            "before it, needs an albedo above 0 (its white is the unit of all light)"
        )
