"""Photographs of patterns -> what small areas of the theatre show, and how sure that is.

Pixels are averaged over cells of the screen, the floor and the wall. A pixel near an edge, of the
pattern or of what is seen, counts for no cell: there, a camera that is a little elsewhere than
stated would see something else. The noise of pixels is read off the photographs: differences of
neighbours in a cell have twice its variance, and over all cells of a photograph the variance is

    variance = a + b light + c light²        (read-out, photons, and noise that scales with light)

so that a cell of few pixels is not trusted by chance. That is the noise of what a cell is said to
show: taken at its measured light, a cell that is bright by chance would have less weight than one
that is dark by chance, and all figures would be too low.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.optimize import nnls

from domesim.errors import InputError
from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.model import Places, surfaces_of
from domesim.measure.rounding import shared_rounding
from domesim.room.lenses import lens_gains
from domesim.room.rays import NOTHING
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]

MARGIN = np.radians(3.0)
"""Pixels so near to an edge are left out, radians of the camera's view."""
RINGS = {"screen": 6, "floor": 4, "wall": 2}
"""Cells from the middle of screen and floor to their edges, and from the wall's foot to its top."""
_LEAST = 6
"""Pixels of a cell; smaller ones are left out."""
_POINTS = 64
"""Number of points at which a cell's reflected light is computed. With 8, cells of the floor are
off by 0.2 %, which a fit takes for a camera that is elsewhere and turned."""
_OF_A_STEP = 1e-3
_SMOOTH = 0.02
"""Share of a pattern's brightest light by which it may change within the margin."""


@final
@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs from one place, all of one size.

    Parameters
    ----------
    camera
        Where from.
    light
        (photograph, row, col, primary) raw linear values, in the projector's primaries.
    pattern
        (photograph,) index of the pattern that each shows.
    exposure
        (photograph,) relative to each other, or to cd/m² if that is what values mean.
    step
        (primary,) of the codes that values come from; 0 if they were not rounded.
    """

    camera: Camera
    light: Floats
    pattern: NDArray[np.int64]
    exposure: Floats
    step: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        count, rows, cols, primaries = self.light.shape
        square = self.camera.mapping == "fisheye"
        if primaries != 3 or (square and rows != cols):
            raise InputError(
                f"photographs must be {'square, ' * square}of three primaries, got {cols} x {rows} "
                f"x {primaries}"
            )
        if self.pattern.shape != (count,) or self.exposure.shape != (count,):
            raise InputError(f"{count} photographs need a pattern and an exposure each")
        if not np.all((self.exposure > 0) & np.isfinite(self.exposure)):
            raise InputError(f"exposures must be above 0, got {self.exposure.min():g}")

    def only(self, kept: NDArray[np.bool_]) -> Photographs:
        """Some of them, chosen by (photograph,) bool.

        Raises
        ------
        InputError
            If none is left.
        """
        if not kept.any():
            raise InputError("wanted photographs of white, halves and others, got none")
        return replace(
            self,
            light=self.light[kept],
            pattern=self.pattern[kept],
            exposure=self.exposure[kept],
        )

    @property
    def steps(self) -> Floats:
        """(photograph, primary) of codes, at unit exposure."""
        return np.asarray(self.step) / self.exposure[:, None]


@final
@dataclass(frozen=True, eq=False)
class PixelNoise:
    """Variance of a pixel: a + b light + c light², and at least so much.

    Parameters
    ----------
    terms
        a, b, c.
    least
        The least variance.
    step
        Of the codes that light was rounded to.
    sensor
        a, b, c of all photographs together, in steps; None if there are no codes.
    """

    terms: Floats
    least: float
    step: float = 0.0
    sensor: Floats | None = None

    def of_means(
        self, light: Floats, pixels: NDArray[np.int64] | int, *, shared: bool = False
    ) -> Floats:
        """(place,) variance of means over pixels of a place, rounding that is not blurred included.

        Parameters
        ----------
        light
            (place,) what they show.
        pixels
            How many pixels a place has.
        shared
            Whether rounding counts as the same at all places: as independent errors that are so
            much larger that they leave their mean as unsure.
        """
        noise = np.maximum(_noise_terms(light) @ self.terms, self.least) / pixels
        if self.sensor is None:
            return np.asarray(noise)
        rounding = shared_rounding(_noise_terms(light / self.step) @ self.sensor)
        return np.asarray(noise + (len(light) if shared else 1) * self.step**2 * rounding)


@final
@dataclass(frozen=True, eq=False)
class Cells:
    """What was seen of each cell.

    Attributes
    ----------
    places
        The cells, for the model.
    u, v
        (cell, point) of `places.points` in the photographs, -1..1.
    area
        (cell,) share of the screen, of the cells that are on it; else 0.
    value, variance
        (photograph, cell, primary) mean light at unit exposure, and the noise of that.
    pixels
        (cell,) how many were averaged.
    label
        (row, col) which cell a pixel counts for; -1 for none.
    noise
        Noise of a pixel in each photograph and primary.
    """

    places: Places
    u: Floats
    v: Floats
    area: Floats
    value: Floats
    variance: Floats
    pixels: NDArray[np.int64]
    label: NDArray[np.int64]
    noise: Sequence[Sequence[PixelNoise]]

    def variance_at(self, light: Floats) -> Floats:
        """(photograph, cell, primary) noise of cells that show that much light."""
        result = np.empty_like(light)
        for one, primary in np.ndindex(len(light), light.shape[-1]):
            own = light[one, :, primary]
            result[one, :, primary] = self.noise[one][primary].of_means(
                own, self.pixels, shared=True
            )
        return result


def direct_light(theatre: Theatre, patterns: Floats) -> Floats:
    """(pattern, row, col, primary) light that projected domemasters put on the screen."""
    _, rows, cols, _ = patterns.shape
    gains = lens_gains(theatre, rows, cols).sum(0)
    return np.asarray(patterns * gains[..., None] * theatre.dome.inside(rows, cols)[..., None])


def cells_of(
    theatre: Theatre, patterns: Floats, photographs: Photographs, *, margin: float = MARGIN
) -> Cells:
    """Average photographs over cells.

    Parameters
    ----------
    theatre
        As it is described.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    photographs
        What was seen of them.
    margin
        Distance that is kept from edges, radians of the camera's view.

    Raises
    ------
    InputError
        If no cell of the screen is left.
    """
    camera, size = photographs.camera, photographs.light.shape[1:3]
    u, v = places_in(*size)
    surface, points = looked_at(theatre, camera, u, v)
    lit = direct_light(theatre, patterns)
    direct = np.zeros((len(patterns), *size, 3))
    on_screen = surface == SURFACES["screen"]
    if not on_screen.any():
        raise InputError(
            f"the camera at {camera.position} m sees nothing of the screen; is it below the floor, "
            f"or does it look elsewhere?"
        )
    row, col = theatre.dome.pixel_of(theatre.dome.toward(points[on_screen]), lit.shape[1])
    direct[:, on_screen] = lit[:, row, col]
    shown = direct[np.unique(photographs.pattern)]
    clear = away_from_edges(surface, shown, camera.pixels_in(margin, size[1]))
    label = _labels(theatre, surface, points)
    label[~clear] = -1
    label = _of_some_size(label)
    if not np.any(on_screen & (label >= 0)):
        raise InputError(
            "no area of the screen is away from edges in all photographs; use patterns of few, "
            "large, even parts"
        )
    return _averaged(theatre, photographs, label, surface, direct, (u, v))


def away_from_edges(surface: NDArray[np.int64], direct: Floats, reach: float) -> NDArray[np.bool_]:
    """(row, col): pixels that see one surface, in light that changes little round about.

    Parameters
    ----------
    surface
        (row, col) what is seen.
    direct
        (pattern, row, col, primary) direct light that is seen.
    reach
        Reach of the surroundings, pixels.
    """
    window = 2 * max(1, int(np.ceil(reach))) + 1
    # Nobody knows what is beyond the picture's own edge.
    highest, least = (
        extreme(surface, window, mode="constant", cval=NOTHING)
        for extreme in (maximum_filter, minimum_filter)
    )
    clear = highest == least
    for one in direct:
        brightest = one.max()
        for primary in range(3):
            plane = one[..., primary]
            change = maximum_filter(plane, window) - minimum_filter(plane, window)
            clear &= change <= _SMOOTH * brightest
    return np.asarray(clear & (surface != NOTHING))


def _labels(theatre: Theatre, surface: NDArray[np.int64], points: Floats) -> NDArray[np.int64]:
    """(row, col): number of the cell that a pixel sees a part of; -1 for none."""
    label = np.full(surface.shape, -1)
    first = 0
    for name in surfaces_of(theatre):
        mine = surface == SURFACES[name]
        x, y, z = points[mine].T
        rings = RINGS[name]
        turn = np.arctan2(y, x) / (2 * np.pi) + 0.5
        if name == "screen":
            local = points[mine] @ theatre.dome.to_room
            turn = np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) + 0.5
            out = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
            out = out / theatre.dome.half_angle
        elif name == "floor":
            assert theatre.floor is not None
            out = np.hypot(x, y) / theatre.floor.radius
        else:
            assert theatre.wall is not None
            out = (z - theatre.wall.bottom) / (theatre.wall.top - theatre.wall.bottom)
        ring = np.clip((out * rings).astype(int), 0, rings - 1)
        if name == "wall":
            sectors = np.full(rings, 16)
        else:
            sectors = np.round(2 * np.pi * (np.arange(rings) + 0.5)).astype(int)
        starts = np.concatenate([[0], np.cumsum(sectors)])
        sector = np.minimum((turn * sectors[ring]).astype(int), sectors[ring] - 1)
        label[mine] = first + starts[ring] + sector
        first += int(starts[-1])
    return label


def _of_some_size(label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Labels without cells of few pixels, numbered from 0."""
    kept, index, count = np.unique(label, return_inverse=True, return_counts=True)
    large = (kept >= 0) & (count >= _LEAST)
    number = np.where(large, np.cumsum(large) - 1, -1)
    return np.asarray(number[index.reshape(label.shape)])


def _averaged(
    theatre: Theatre,
    photographs: Photographs,
    label: NDArray[np.int64],
    surface: NDArray[np.int64],
    direct: Floats,
    place: tuple[Floats, Floats],
) -> Cells:
    used = label >= 0
    own, cells = label[used], int(label.max()) + 1
    pixels = np.bincount(own, minlength=cells)

    def mean(values: Floats) -> Floats:
        flat = values[used]
        return np.bincount(own, flat, cells) / pixels

    def each(planes: Floats) -> Floats:
        result = np.empty((len(planes), cells, 3))
        for one, primary in np.ndindex(len(planes), 3):
            result[one, :, primary] = mean(planes[one, ..., primary])
        return result

    light = photographs.light / photographs.exposure[:, None, None, None]
    value = each(light)
    # Some pixels of each cell, evenly spread over its rows
    order = np.argsort(own, kind="stable")
    starts = np.concatenate([[0], np.cumsum(pixels)[:-1]])
    pick = (np.arange(_POINTS) + 0.5) / _POINTS
    chosen = order[(starts[:, None] + pixels[:, None] * pick).astype(int)]
    u, v = _like_their_cells(np.stack(place, -1)[used], own, chosen)
    _, seen = looked_at(theatre, photographs.camera, u, v)
    numbers = {SURFACES[name]: n for n, name in enumerate(surfaces_of(theatre))}
    kinds = np.array([numbers[int(kind)] for kind in surface[used][chosen[:, 0]]])
    places = Places(kinds, seen, each(direct))
    # Pixels of a fisheye are about equal in solid angle, and on the screen in area; a pinhole's are
    # not, by which only the mean of black is a little off.
    area = np.where(kinds == 0, pixels, 0) / max(1, int(pixels[kinds == 0].sum()))
    noise = _noise(light, label, value, pixels, photographs.steps)
    averaged = Cells(places, u, v, area, value, value, pixels, label, noise)
    return replace(averaged, variance=averaged.variance_at(value))


def _like_their_cells(places: Floats, cell: NDArray[np.int64], chosen: NDArray[np.int64]) -> Floats:
    """(2, cell, point): some places, moved so that means and covariances are those of their cells.

    Light that varies by a polynomial of degree 2 within a cell then has the cell's mean.

    Parameters
    ----------
    places, cell
        (pixel, 2) of all, and (pixel,) which cell each is of.
    chosen
        (cell, point) which are chosen.
    """
    count = np.bincount(cell)

    def means(values: Floats) -> Floats:
        return np.stack([np.bincount(cell, part) / count for part in values.T], -1)

    middle, some = means(places), places[chosen]
    away = places - middle[cell]
    products = means((away[:, :, None] * away[:, None]).reshape(-1, 4)).reshape(-1, 2, 2)
    spread = some - some.mean(1, keepdims=True)
    own = spread.transpose(0, 2, 1) @ spread / spread.shape[1]
    tiny = 1e-9 * np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(2)
    wanted, actual = np.linalg.cholesky(products + tiny), np.linalg.cholesky(own + tiny)
    turned = wanted @ np.linalg.inv(actual)
    return np.moveaxis(middle[:, None] + spread @ turned.transpose(0, 2, 1), -1, 0)


def _noise(
    light: Floats,
    label: NDArray[np.int64],
    value: Floats,
    pixels: NDArray[np.int64],
    steps: Floats,
) -> list[list[PixelNoise]]:
    """Noise by photograph and primary, from differences of neighbouring pixels."""
    pairs = (label[:, 1:] == label[:, :-1]) & (label[:, 1:] >= 0)
    own = label[:, 1:][pairs]
    count = np.bincount(own, minlength=len(pixels))
    local = np.empty_like(value)
    for one, primary in np.ndindex(len(light), 3):
        plane = light[one, ..., primary]
        half = (plane[:, 1:] - plane[:, :-1])[pairs] ** 2 / 2
        local[one, :, primary] = np.bincount(own, half, len(pixels)) / np.maximum(count, 1)
    return noise_of(value, local, np.broadcast_to(count, value.shape[:2]), steps)


def noise_of(
    level: Floats, local: Floats, count: NDArray[np.int64], steps: Floats
) -> list[list[PixelNoise]]:
    """Noise of a pixel by photograph and primary.

    Parameters
    ----------
    level, local
        (photograph, area, primary) mean light, and half of the neighbours' mean squared difference.
    count
        (photograph, area) neighbours; areas of less than three do not count.
    steps
        (photograph, primary) of the codes that light was rounded to; 0 if there are none.
    """
    # Where all pixels have one code, nothing is seen of the noise
    seen = np.maximum(local, (_OF_A_STEP * steps[:, None]) ** 2)
    each = [
        [pixel_noise(level[one, :, p], seen[one, :, p], count[one]) for p in range(3)]
        for one in range(len(level))
    ]
    if not steps.all():
        return each
    codes, squared = level / steps[:, None], seen / steps[:, None] ** 2
    sensor = pixel_noise(codes.ravel(), squared.ravel(), np.repeat(count.ravel(), 3)).terms
    return [
        [replace(noise, step=float(steps[one, p]), sensor=sensor) for p, noise in enumerate(row)]
        for one, row in enumerate(each)
    ]


def pixel_noise(level: Floats, local: Floats, count: NDArray[np.int64]) -> PixelNoise:
    """Variance of a pixel, fitted to what areas show; infinite if no area counts.

    Parameters
    ----------
    level, local, count
        (area,) as for `noise_of`.
    """
    usable = count >= 3
    if not usable.any():
        return PixelNoise(np.zeros(3), np.inf)
    noise, weight = np.zeros(3), np.sqrt(count[usable])
    terms, target = _noise_terms(level[usable]), np.maximum(local[usable], 1e-300)
    scale = np.maximum(_noise_terms(level).max(0), 1e-300)
    guess = np.full(len(target), float(np.mean(target)))
    for _ in range(4):
        # Areas differ in light, if only by noise, so that no two terms are the same
        whitened = terms / scale * (weight / guess)[:, None]
        noise = nnls(whitened, target * weight / guess)[0] / scale
        guess = np.maximum(terms @ noise, 1e-3 * guess)
    return PixelNoise(noise, 1e-3 * float(guess.min()))


def _noise_terms(level: Floats) -> Floats:
    size = np.abs(level)
    return np.stack([np.ones_like(size), size, size**2], -1)
