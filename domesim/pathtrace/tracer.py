"""Pictures of indirect light, converging to the accuracy that was asked for.

`Tracer` sends walks from every pixel of a domemaster, or of a view from a seat, pass after pass and
tile after tile, so that memory is bounded by the tile. The standard error of every pixel is known
from the walks themselves; passes go on until the whole picture's is as small as wanted, the samples
run out, or someone presses Ctrl-C, and what there is then is returned.

[1] T. F. Chan, G. H. Golub, R. J. LeVeque, "Updating formulae and a pairwise algorithm for
computing sample variances", Stanford STAN-CS-79-773 (1979), eq. 2.1.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import Enum
from functools import partial
from types import FrameType
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from domesim.errors import InputError
from domesim.light.blocks import light_means
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.loop import Source, Start, Tally, Walks, bounce_limit, eye_directions
from domesim.pathtrace.machine import DrJit
from domesim.pathtrace.sources import GainLobe, Lamps, Picture, Throw
from domesim.room.dome import strips
from domesim.room.lenses import axes_towards, lens_gains, seen_gain
from domesim.room.rays import NOTHING, SCREEN, Hit, Lanes, Vector, dot, scaled
from domesim.room.theatre import Point, Theatre, Viewpoint

Image = NDArray[np.float32]

CENTRE = (0.0, 0.0, 0.0)
LARGEST_SOURCE = 2048
"""Pixels a side of a picture as a source; finer detail does not show in reflected light."""
_SHADOW_SIZE = 512
"""Least size a side at which shadows on the screen are looked for."""
WALKS_A_PASS = 1 << 24
"""Most walks of the first pass over a small picture, after which the accuracy is looked at."""
_LEAST_A_LANE = 16
"""Walks of a lane that keep it busy while others of its vector end theirs."""
_MOST_A_LANE = 1 << 10
"""Walks of a lane in a pass: more would round too much in sums of single precision."""

Progress = Callable[[float, str], None]
"""Called with the share that is done (0..1) and a line for a person."""


class Status(Enum):
    """How a computation ended; the value says what to do about it."""

    CONVERGED = "The requested standard error was reached."
    EXHAUSTED = "The most samples allowed were taken. Allow more, or a larger error."
    INTERRUPTED = "Interrupted: this is what there was. Run it again for more."


@final
@dataclass(frozen=True)
class Settings:
    """How accurate, and how reproducible.

    Parameters
    ----------
    error
        Standard error to reach: rms over the picture's pixels, relative to the mean indirect light.
    least, most
        Fewest and most walks a pixel.
    tolerance
        Share of the indirect light that may be lost after the last bounce.
    seed
        Seed of the random numbers.
    tile
        Most pixels at a time: bounds the memory.
    per_bounce
        Keep pictures of each bounce.
    bounces
        Follow just so many bounces instead of what `tolerance` asks for.
    aim
        Let walks aim at bright pixels, and not only find them: the same mean with less noise.
    """

    error: float = 0.05
    least: int = 32
    most: int = 1 << 16
    tolerance: float = 1e-5
    seed: int = 0
    tile: int = 1 << 20
    per_bounce: bool = False
    bounces: int | None = None
    aim: bool = True

    def __post_init__(self) -> None:
        if not (np.isfinite(self.error) and self.error > 0):
            raise InputError(f"standard error must be above 0, got {self.error:g}")
        if not 2 <= self.least <= self.most:
            raise InputError(
                f"samples must be at least 2, for an error to be known, and at most {self.most}, "
                f"got {self.least}"
            )
        if not 0 < self.tolerance < 1:
            raise InputError(f"bounce tolerance must lie in 0..1, got {self.tolerance:g}")
        for name, least in (("seed", 0), ("tile", 1), ("bounces", 1)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise InputError(f"{name} must be at least {least}, got {value}")


@final
@dataclass(frozen=True)
class Traced:
    """A picture of path-traced light, 1.0 = projector white's direct light.

    Attributes
    ----------
    mean
        (row, col, primary) the estimate.
    standard_error
        (row, col, primary) of each pixel's mean.
    bounces
        (bounce, row, col, primary) its parts if asked for; bounce 0 is direct.
    samples, seed, limit
        Walks a pixel, seed, and bounces after which walks ended.
    steps
        Segments that were traced.
    status
        How it ended.
    seconds
        CPU time of the process, s.
    """

    mean: Image
    standard_error: Image
    bounces: Image | None
    samples: int
    seed: int
    limit: int
    steps: int
    status: Status
    seconds: float

    def pooled_error(self, weights: NDArray[Any]) -> tuple[float, float]:
        """Mean over the picture and primaries with (row, col) weights, and its standard error."""
        share = weights / weights.sum()
        mean = float(np.einsum("ij,ijp->", share, self.mean.astype(np.float64)) / 3)
        # A walk carries all primaries at once: their errors are one.
        error = np.max(self.standard_error.astype(np.float64), axis=-1)
        return mean, float(np.sqrt(np.sum((share * error) ** 2)))


@final
class Tracer:
    """A theatre to trace paths in.

    Parameters
    ----------
    theatre
        The theatre.
    """

    def __init__(self, theatre: Theatre) -> None:
        self.theatre = theatre
        self.machine = DrJit(load_mitsuba())
        self.room = self.machine.room(theatre)
        self.lobe = None
        if theatre.lobe is not None and theatre.lobe.share > 0:
            self.lobe = GainLobe(self.machine, theatre.lobe)

    def gains(self, rows: int, cols: int) -> NDArray[np.float64]:
        """What each projector gives the screen, with the room's shadows.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.

        Returns
        -------
        gains
            (lens, row, col).
        """
        return self._thrown(rows, cols)[1]

    def seen_gain(self, rows: int, cols: int, eye: Point) -> NDArray[Any]:
        """Direct light as an eye sees it, with the room's shadows and the screen's paint.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.
        eye
            Where it is seen from, m.

        Returns
        -------
        gain
            (row, col, primary), 1 off the screen; one primary stands for all.
        """
        gain = seen_gain(self.theatre, self.gains(rows, cols), eye)[..., None]
        if self.theatre.paint is None:
            return gain
        on = self.theatre.dome.inside(rows, cols)[..., None]
        return np.where(on, gain * self.theatre.paint.on(rows, cols), 1.0)

    def picture(self, light: NDArray[Any]) -> Picture:
        """The light of a domemaster (row, col, primary) as a source.

        A pixel that the rim cuts and whose centre is off the screen shows its neighbour's light.
        """
        light = _coarse(light, self.theatre.dome.inside(*light.shape[:2]))
        rows, cols = light.shape[:2]
        thrown, reaching = self._thrown(rows, cols)
        off = ~self.theatre.dome.inside(rows, cols)
        row, col = distance_transform_edt(off, return_distances=False, return_indices=True)
        values = (light * thrown.sum(0)[..., None])[row, col]
        if self.theatre.paint is not None:
            values = values * self.theatre.paint.on(rows, cols)
        return Picture(self.room, values, thrown[:, row, col], reaching[:, row, col], self.lobe)

    def throw(self, size: int, *, unhindered: bool = False) -> Throw:
        """How the projectors' light gets from a domemaster to the eye.

        Parameters
        ----------
        size
            Pixels a side of the domemaster.
        unhindered
            Let nothing stop light on its way to the screen.

        Returns
        -------
        throw
            Of all projectors.
        """
        thrown, reaching = self._thrown(size, size)
        return Throw(self.room, thrown, thrown if unhindered else reaching, self.lobe)

    def _thrown(self, rows: int, cols: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(lens, row, col): what projectors send towards the screen, and what of it gets there."""
        thrown = lens_gains(self.theatre, rows, cols)
        if not self.room.shadows:
            return thrown, thrown
        lit = np.stack([self._lit(position, rows, cols) for position in self._lens_places()])
        return thrown, thrown * lit

    def lamps(self) -> Lamps:
        """The theatre's lamps as a source."""
        return Lamps(self.room, self.lobe)

    def screen(
        self,
        source: Source,
        rows: int,
        cols: int,
        settings: Settings,
        *,
        eye: tuple[float, float, float] = CENTRE,
        direct: bool = False,
        reference: float | None = None,
        progress: Progress | None = None,
    ) -> Traced:
        """Light that reaches the eye from each pixel of a domemaster.

        Parameters
        ----------
        source
            The light.
        rows, cols
            Size of the domemaster.
        settings
            How accurate.
        eye
            Where it is seen from, m.
        direct
            Count what comes without any bounce as well.
        reference
            Light that the wanted error is relative to, instead of the mean of what is traced.
        progress
            Told how it gets on.

        Returns
        -------
        traced
            (row, col, primary), 0 off the screen, with its errors.
        """
        inside = np.flatnonzero(self.theatre.dome.inside(rows, cols))

        def start_of(pixels: NDArray[np.int64]) -> Start:
            row, col = (self.machine.lanes(part) for part in np.divmod(pixels, cols))
            return self._pixel_start(row, col, rows, eye)

        return self._passes(
            inside, start_of, source, (rows, cols), settings, not direct, reference, progress
        )

    def view(
        self,
        source: Source,
        viewpoint: Viewpoint,
        width: int,
        height: int,
        settings: Settings,
        *,
        reference: float | None = None,
        progress: Progress | None = None,
    ) -> Traced:
        """A perspective picture (height, width) from a place in the theatre.

        Parameters
        ----------
        source
            The light.
        viewpoint
            Where from.
        width, height
            Size of the picture.
        settings
            How accurate.
        reference
            Light that the wanted error is relative to, instead of the mean of what is traced.
        progress
            Told how it gets on.

        Returns
        -------
        traced
            (row, col, primary), with its errors.
        """

        def start_of(pixels: NDArray[np.int64]) -> Start:
            row, col = (self.machine.lanes(part) for part in np.divmod(pixels, width))
            return self._camera_start(row, col, width, height, viewpoint)

        pixels = np.arange(width * height)
        shape = (height, width)
        return self._passes(pixels, start_of, source, shape, settings, False, reference, progress)

    def along(
        self,
        source: Source,
        eye: Point,
        rays: NDArray[np.float64],
        settings: Settings,
        *,
        reference: float | None = None,
    ) -> Traced:
        """A picture by one ray a pixel, as of any camera.

        Parameters
        ----------
        source
            The light.
        eye
            Where it is seen from, m.
        rays
            (row, col, xyz) unit vectors in the room's frame.
        settings
            How accurate.
        reference
            Light that the wanted error is relative to, instead of the mean of what is traced.

        Returns
        -------
        traced
            (row, col, primary), with its errors.
        """
        shape = rays.shape[:2]
        flat = rays.reshape(-1, 3)
        place = over(eye, self.theatre.dome.radius)

        def start_of(pixels: NDArray[np.int64]) -> Start:
            return self._ray_start(self._vector(flat[pixels]), place)

        pixels = np.arange(len(flat))
        return self._passes(
            pixels, start_of, source, (shape[0], shape[1]), settings, False, reference, None
        )

    def visible_lamps(
        self, viewpoint: Viewpoint, width: int, height: int, finer: int = 4
    ) -> NDArray[np.float64]:
        """The lamps themselves in a `view`, but for what stands before them.

        It is analytic; light that lamps throw on the room is traced.

        Parameters
        ----------
        viewpoint
            Where from.
        width, height
            Size of the picture, pixels.
        finer
            Rays along a side of a pixel.

        Returns
        -------
        image
            (row, col, primary), 1.0 = projector white.
        """
        eye = np.asarray(viewpoint.position)
        ray = view_rays(viewpoint, width, height)
        image = np.zeros((height, width, 3))
        across = (np.arange(width * finer) + 0.5) / finer
        for strip in strips(height, width * finer**2):
            down = (np.arange(strip.start * finer, strip.stop * finer) + 0.5) / finer
            rays = np.stack(ray(down[:, None], across[None, :]), -1)
            rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
            for lamp in self.theatre.lamps:
                sides = np.asarray(lamp.across), np.asarray(lamp.up)
                normal = np.cross(*sides)
                facing = rays @ normal
                with np.errstate(divide="ignore", invalid="ignore"):
                    distance = (np.subtract(lamp.centre, eye) @ normal) / facing
                    place = eye + distance[..., None] * rays - lamp.centre
                    shown = (facing < 0) & (distance > 0)
                    for side in sides:
                        shown &= np.abs(place @ side) <= side @ side
                # A sign that hangs on a wall is not behind it.
                before = eye + (distance[shown] - 0.02)[:, None] * rays[shown]
                shown[shown] = ~self._hidden(viewpoint.position, before)
                cells = shown.reshape(-1, finer, width, finer).mean((1, 3))
                image[strip] += cells[..., None] * np.asarray(lamp.luminance)
        return image

    def _hidden(self, eye: Point, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(point,): whether something stands between an eye and points (xyz), m."""
        m, unit = self.machine, self.theatre.dome.radius
        count = len(points)
        if count == 0:
            return np.zeros(0, bool)
        x, y, z = (m.full(part, count) for part in over(eye, unit))
        in_air = m.whole(NOTHING, count)
        hidden = self.room.shadowed(
            (x, y, z), self._vector(points / unit), in_air, in_air == NOTHING
        )
        return np.asarray(m.array(m.where(hidden, 1.0, 0.0)) > 0)

    def _passes(
        self,
        pixels: NDArray[np.int64],
        start_of: Callable[[NDArray[np.int64]], Start],
        source: Source,
        shape: tuple[int, int],
        settings: Settings,
        indirect_only: bool,
        reference: float | None,
        progress: Progress | None,
    ) -> Traced:
        limit = settings.bounces or bounce_limit(self.room, settings.tolerance)
        tiles = np.array_split(pixels, -(-len(pixels) // settings.tile))
        kept = limit if settings.per_bounce else None
        parts = [_Tile(self.machine, tile, kept) for tile in tiles]
        sums = _Sums(self.machine, parts, kept, reference)
        # Later passes at most double what there is, so that no tile is far ahead of another.
        at_first = max(2, WALKS_A_PASS // len(pixels))
        most = _MOST_A_LANE * max(1, self.machine.width // len(tiles[0]))
        begin = partial(
            Walks,
            self.room,
            source=source,
            bounces=limit,
            first=1 if indirect_only else 0,
            scatter=self.lobe,
            aim=source if settings.aim and isinstance(source, Picture) and source.can_aim else None,
            per_bounce=settings.per_bounce,
        )
        started = time.process_time()
        status = Status.EXHAUSTED
        done = 0
        with interruptible() as interrupted:
            while done < settings.most:
                count = min(
                    sums.walks_for(settings, done),
                    settings.most - done,
                    max(at_first, done),
                    most,
                )
                for number, tile in enumerate(sums.tiles):
                    seed = launch_seed(settings.seed, done, number)
                    for taken in self._tile(tile, begin, start_of, count, seed, interrupted):
                        if progress is not None:
                            share = (number + taken / count) / len(tiles)
                            progress(
                                sums.progress(settings, done + count * share),
                                f"{done + count} walks a pixel, {sums.steps:,.0f} segments",
                            )
                    # Every pixel gets its first walks, whoever waits.
                    if interrupted() and done > 0:
                        break
                if all(tile.count == done + count for tile in sums.tiles):
                    done += count
                    if done >= settings.least and sums.relative_error() <= settings.error:
                        status = Status.CONVERGED
                        break
                if interrupted():
                    status = Status.INTERRUPTED
                    break
        return sums.traced(shape, settings.seed, limit, status, time.process_time() - started)

    def _tile(
        self,
        tile: _Tile,
        begin: Callable[..., Walks],
        start_of: Callable[[NDArray[np.int64]], Start],
        count: int,
        seed: int,
        stop: Callable[[], bool],
    ) -> Iterator[int]:
        """Add `count` walks from each pixel of a tile; tells after each launch how many there are.

        If told to stop, there are no more launches than one.
        """
        each = max(1, min(self.machine.width // len(tile.pixels), count // _LEAST_A_LANE))
        # The first lanes of a pixel take what does not divide.
        shares = count // each + (np.arange(each) < count % each)
        lanes = each * len(tile.pixels)
        walks = begin(
            start=start_of(np.repeat(tile.pixels, each)),
            count=np.tile(shares, len(tile.pixels)),
            lanes=lanes,
            seed=seed,
        )
        launch = max(2, self.machine.launch // lanes)
        for followed in range(launch, int(shares[0]) + launch, launch):
            walks.follow(followed)
            taken = int(np.minimum(shares, followed).sum())
            ends = taken == count or stop()
            if ends:
                tile.add(walks.tally, taken, each)
            yield taken
            if ends:
                return

    def _pixel_start(
        self, row: Lanes, col: Lanes, size: int, eye: tuple[float, float, float]
    ) -> Start:
        room, m = self.room, self.machine
        place = over(eye, self.theatre.dome.radius)

        def start(rng: Any) -> tuple[Hit, Vector]:
            u = (col + m.uniform(rng)) * (2 / size) - 1
            v = (row + m.uniform(rng)) * (2 / size) - 1
            # Where the pixel reaches over the screen's edge, its centre stands in.
            on = (u * u + v * v < 1) & room.on_screen(room.screen_at(u, v)[0])
            u = m.where(on, u, (col + 0.5) * (2 / size) - 1)
            v = m.where(on, v, (row + 0.5) * (2 / size) - 1)
            position, normal = room.screen_at(u, v)
            surface = m.where(u < 9, SCREEN, NOTHING)
            return Hit(surface, position, normal), eye_directions(room, position, place)

        return start

    def _camera_start(
        self, row: Lanes, col: Lanes, width: int, height: int, viewpoint: Viewpoint
    ) -> Start:
        m = self.machine
        ray_at = view_rays(viewpoint, width, height)
        eye = over(viewpoint.position, self.theatre.dome.radius)

        def start(rng: Any) -> tuple[Hit, Vector]:
            across, down = col + m.uniform(rng), row + m.uniform(rng)
            ray = ray_at(down, across)
            return self._met(scaled(ray, 1 / m.sqrt(dot(ray, ray))), eye)

        return start

    def _ray_start(self, ray: Vector, eye: Point) -> Start:
        return lambda rng: self._met(ray, eye)

    def _met(self, ray: Vector, eye: Point) -> tuple[Hit, Vector]:
        """What rays from an eye (in units of the radius) meet, and the directions back."""
        zero = ray[0] * 0
        origin = (zero + eye[0], zero + eye[1], zero + eye[2])
        active = zero < 1
        leaving = self.machine.where(active, NOTHING, NOTHING)
        return self.room.hit(origin, ray, leaving, active), scaled(ray, -1)

    def _lens_places(self) -> list[tuple[float, float, float]]:
        return [lens.position for lens in self.theatre.lenses] or [CENTRE]

    def _lit(self, place: tuple[float, float, float], rows: int, cols: int) -> NDArray[np.float64]:
        """(row, col): share of a pixel that a projector's light reaches past seats and booth."""
        m, dome = self.machine, self.theatre.dome
        x, y, z = over(place, dome.radius)
        finer = max(1, -(-_SHADOW_SIZE // max(rows, cols)))
        inside = dome.inside(rows * finer, cols * finer)
        lit = np.ones((rows, cols))
        for strip in strips(rows, cols * finer**2):
            inner = slice(strip.start * finer, strip.stop * finer)
            points = dome.points(rows * finer, cols * finer, inner)
            target = self._vector(points.reshape(-1, 3) / dome.radius)
            zero = target[0] * 0
            # From the screen to the lens: a projector's own body may hold the lens.
            active = zero < 1
            lens = (zero + x, zero + y, zero + z)
            leaving = m.where(active, SCREEN, NOTHING)
            hidden = self.room.shadowed(target, lens, leaving, active)
            open_ = 1 - m.array(m.where(hidden, zero + 1.0, zero)).reshape(points.shape[:2])
            on = inside[strip.start * finer : strip.stop * finer]
            cells = (strip.stop - strip.start, finer, cols, finer)
            count = on.reshape(cells).sum((1, 3))
            seen = (open_ * on).reshape(cells).sum((1, 3))
            lit[strip] = np.where(count > 0, seen / np.maximum(count, 1), 1.0)
        return lit

    def _vector(self, points: NDArray[np.float64]) -> Vector:
        x, y, z = (self.machine.lanes(np.ascontiguousarray(points[:, k])) for k in range(3))
        return x, y, z


@final
class _Tile:
    """Means and spreads over the walks of some pixels of a picture, kept where they are computed.

    They are float32, and no more a pixel.
    """

    def __init__(self, machine: DrJit, pixels: NDArray[np.int64], bounces: int | None) -> None:
        self.pixels, self.count, self.steps = pixels, 0, 0
        self.light, self.noise = 0.0, 0.0
        self._machine, m, size = machine, machine, len(pixels)
        self._mean = [m.full(0.0, size) for _ in range(3)]
        self._spread = [m.full(0.0, size) for _ in range(3)]
        self._bounces: list[Lanes] | None = None
        if bounces is not None:
            self._bounces = [m.full(0.0, (bounces + 1) * size) for _ in range(3)]

    def add(self, tally: Tally, count: int, each: int) -> None:
        """Merge the sums of `count` walks from each pixel, which `each` lanes have followed [1]."""
        m = self._machine
        n, before = m.parameter(float(count)), m.parameter(float(self.count))
        self.count += count
        for p in range(3):
            total = m.pooled(tally.total[p], each)
            own = m.pooled(tally.square[p], each) - total * total / n
            step = total / n - self._mean[p]
            self._mean[p] = m.single(self._mean[p] + step * (n / (before + n)))
            own = m.maximum(own, 0.0) + step * step * (before * n / (before + n))
            self._spread[p] = m.single(self._spread[p] + own)
            if self._bounces is not None and tally.bounces is not None:
                self._bounces[p] = self._bounces[p] + m.single(m.pooled(tally.bounces[p], each))
        m.computed((self._mean, self._spread, self._bounces))
        self.light = sum(m.sum(mean) for mean in self._mean)
        self.noise = sum(m.sum(spread) for spread in self._spread)
        self.steps += int(m.sum(tally.steps))

    @property
    def variance(self) -> float:
        """Variance of a pixel's mean over the pixel's spread."""
        n = max(self.count, 2)
        return 1 / (n * (n - 1))

    def write(self, mean: NDArray[Any], error: NDArray[Any], bounces: NDArray[Any] | None) -> None:
        """Put them into pictures (primary, pixel) and (bounce, primary, pixel)."""
        m = self._machine
        for p in range(3):
            mean[p, self.pixels] = m.array(self._mean[p])
            error[p, self.pixels] = np.sqrt(m.array(self._spread[p]) * self.variance)
            if bounces is not None and self._bounces is not None:
                table = m.array(self._bounces[p]).reshape(len(bounces), -1)
                bounces[:, p, self.pixels] = table / max(self.count, 1)


@final
class _Sums:
    """Means and spreads over the walks of all tiles of a picture."""

    def __init__(
        self,
        machine: DrJit,
        tiles: list[_Tile],
        bounces: int | None,
        reference: float | None,
    ) -> None:
        self._machine = machine
        self.tiles, self._bounces, self._reference = tiles, bounces, reference
        self._pixels = sum(len(tile.pixels) for tile in tiles)

    @property
    def steps(self) -> int:
        """Segments that were traced."""
        return sum(tile.steps for tile in self.tiles)

    def relative_error(self) -> float:
        """Rms standard error over the picture, relative to its mean (or the reference)."""
        if max(tile.count for tile in self.tiles) < 2:
            return np.inf
        seen = 3 * sum(len(tile.pixels) for tile in self.tiles if tile.count > 0)
        square = sum(tile.noise * tile.variance for tile in self.tiles) / seen
        mean = self._reference or sum(tile.light for tile in self.tiles) / seen
        return float(np.sqrt(square) / mean) if mean > 0 else 0.0

    def _needed(self, settings: Settings) -> float:
        """Walks a pixel that the wanted error takes, by what is known of the noise."""
        known = sum(tile.count * len(tile.pixels) for tile in self.tiles) / self._pixels
        return known * (self.relative_error() / settings.error) ** 2

    def walks_for(self, settings: Settings, done: int) -> int:
        """How many more walks a pixel the wanted error will take."""
        if done < 2:
            return settings.least
        wanted = min(np.ceil(1.02 * self._needed(settings)), settings.most)
        return max(1, int(max(settings.least, wanted)) - done)

    def progress(self, settings: Settings, done: float) -> float:
        """Share of the work that is done, by what is known of the noise so far."""
        if self.steps == 0:
            return 0.0
        return min(1.0, done / max(settings.least, min(settings.most, self._needed(settings))))

    def traced(
        self, shape: tuple[int, int], seed: int, limit: int, status: Status, seconds: float
    ) -> Traced:
        """The pictures; the sums are gone afterwards."""
        size, steps = shape[0] * shape[1], self.steps
        samples = max(tile.count for tile in self.tiles)
        mean, error = np.zeros((3, size), np.float32), np.zeros((3, size), np.float32)
        bounces = None
        if self._bounces is not None:
            bounces = np.zeros((self._bounces + 1, 3, size), np.float32)
        while self.tiles:
            self.tiles.pop().write(mean, error, bounces)
            self._machine.release()

        def image(values: NDArray[Any]) -> Image:
            planes = values.reshape(*values.shape[:-2], 3, *shape)
            return np.moveaxis(planes, -3, -1)

        return Traced(
            mean=image(mean),
            standard_error=image(error),
            bounces=None if bounces is None else image(bounces),
            samples=samples,
            seed=seed,
            limit=limit,
            steps=steps,
            status=status,
            seconds=seconds,
        )


def _coarse(light: NDArray[Any], inside: NDArray[np.bool_]) -> NDArray[Any]:
    """Means of blocks of a picture's screen pixels, so that a source of light stays small."""
    size = light.shape[0]
    factors = [f for f in range(1, 9) if size % f == 0 and size // f <= LARGEST_SOURCE]
    if not factors or factors[0] == 1:
        return light
    return np.asarray(light_means(light[None], factors[0], inside)[0])


def launch_seed(*parts: int) -> int:
    """One 63-bit seed from several numbers."""
    return int(np.random.SeedSequence(list(parts)).generate_state(1, np.uint64)[0] >> 1)


def view_rays(
    viewpoint: Viewpoint, width: int, height: int
) -> Callable[[Any, Any], tuple[Any, Any, Any]]:
    """Rays through the pixels of a view.

    Parameters
    ----------
    viewpoint
        Where from.
    width, height
        Size of the picture, pixels.

    Returns
    -------
    ray
        Takes (row, col) in pixels from the upper left corner; returns (x, y, z), of any length.
    """
    axes = axes_towards(viewpoint.position, viewpoint.look_at, "a viewpoint")
    frame = [[float(part) for part in axis] for axis in axes]
    reach = float(np.tan(viewpoint.field / 2))

    def ray(row: Any, col: Any) -> tuple[Any, Any, Any]:
        across = (col * (2 / width) - 1) * reach
        above = (height / width - row * (2 / width)) * reach
        x, y, z = (f + across * r + above * t for r, t, f in zip(*frame, strict=True))
        return x, y, z

    return ray


_ALL_OR_NOTHING = ContextVar("all or nothing", default=False)


@contextmanager
def all_or_nothing() -> Iterator[None]:
    """Lets Ctrl-C end a computation without a result."""
    token = _ALL_OR_NOTHING.set(True)
    try:
        yield
    finally:
        _ALL_OR_NOTHING.reset(token)


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Ctrl-C sets a flag instead of tearing down a launch; a second one ends everything."""
    if _ALL_OR_NOTHING.get():
        yield lambda: False
        return
    pressed = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = True

    try:
        before = signal.signal(signal.SIGINT, note)
    except ValueError:  # not the main thread: Ctrl-C goes elsewhere
        yield lambda: False
        return
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)


def over(place: tuple[float, float, float], radius: float) -> tuple[float, float, float]:
    """A place in units of the dome's radius.

    Parameters
    ----------
    place
        (x, y, z), m.
    radius
        The dome's, m.

    Returns
    -------
    place
        (x, y, z).
    """
    return place[0] / radius, place[1] / radius, place[2] / radius
