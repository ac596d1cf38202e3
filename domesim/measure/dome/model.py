"""What places in a theatre show of projected patterns, as a function of the albedos.

By radiosity (`domesim.observation.enclosure`): with emission E of the screen's elements, albedos
R = diag(rho) and form factors F,

    B = (1 - R F)^-1 E        dB / d rho_i = (1 - R F)^-1 1_i F B

where 1_i is 1 on the elements of surface i (screen, floor, wall). A place of surface i shows
D + rho_i G B: D is direct light, and G the form factors from the place to all elements. All light
is in units of what projector white shows on the screen directly, so that a change of the screen's
albedo alone changes only what has bounced. Where a lux meter stood, what arrives is read instead:
pi (D / rho_i + G B), in lux if white is in cd/m².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from domesim.errors import InputError
from domesim.observation.enclosure import Enclosure, Solver
from domesim.room.lenses import lens_gains
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]

RESOLUTION = 14
"""Rings of the floor. With 10, floor albedos come out 0.13 % too large; with 14, at four times the
cost, 0.08 %. The screen's are within 0.03 % with either."""
_DARKEST = 1e-12
LARGEST = 256
"""Pixels a side of patterns, of which finer detail does not show in reflected light."""


@final
@dataclass(frozen=True, eq=False)
class Places:
    """Small areas that are photographed, or where a meter was pointed.

    Parameters
    ----------
    surface
        (place,) index into `surfaces_of`: 0 is the screen.
    points
        (place, point, xyz) spread over each, m in the room's frame.
    direct
        (pattern, place, primary) direct light there.
    lux
        (place,) whether what arrives was read and not what is sent on; None for nowhere.
    """

    surface: NDArray[np.int64]
    points: Floats
    direct: Floats
    lux: NDArray[np.bool_] | None = None


def surfaces_of(theatre: Theatre) -> tuple[str, ...]:
    """Screen, floor and wall: those that there are."""
    others = ("floor", theatre.floor), ("wall", theatre.wall)
    return ("screen", *(name for name, surface in others if surface is not None))


def nominal_albedos(theatre: Theatre) -> Floats:
    """(surface, primary) albedos that the scene states, of `surfaces_of`."""
    others = [surface.albedo for surface in (theatre.floor, theatre.wall) if surface is not None]
    return np.array([theatre.screen_albedo, *others])


def require_plain(theatre: Theatre) -> None:
    """Refuse a theatre that radiosity of few surfaces of one albedo each does not know.

    Raises
    ------
    InputError
        If there is more in it than Lambertian screen, floor and wall, or the screen has a map.
    """
    more = theatre.beyond_enclosure
    if theatre.paint is not None:
        more = (*more, "a screen with an albedo map")
    if more:
        raise InputError(
            f"wanted a theatre of Lambertian screen, floor and wall, got "
            f"{', '.join(more)}; use 'domesim measure dome "
            f"--without-geometry', or describe it without them ('domesim scene new --plain')"
        )


@final
class Interreflection:
    """A theatre's shape, in which light of patterns is reflected by any albedos.

    Parameters
    ----------
    theatre
        The theatre; its albedos do not matter.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    resolution
        Resolution of radiosity.

    Raises
    ------
    InputError
        If there is more in the theatre than Lambertian screen, floor and wall, or these stop
        projectors' light on its way to the screen.
    """

    def __init__(self, theatre: Theatre, patterns: Floats, resolution: int = RESOLUTION) -> None:
        require_plain(theatre)
        self.resolution = resolution
        self._room = Enclosure(theatre, resolution)
        self._room.require_lit("use 'domesim measure dome --without-geometry'")
        self._surfaces = surfaces_of(theatre)
        self._symmetric = self._room.exchange()
        self._root = np.sqrt(self._room.areas)[:, None]
        counts = list(self._room.counts.values())
        self._owner = np.repeat(np.arange(len(counts)), counts)
        self._emission = self._emitted(theatre, patterns)

    def seen_from(self, places: Places) -> Floats:
        """(place, element) G: form factors, means over each place's points."""
        unit = self._room.theatre.dome.radius
        count = places.points.shape[1]
        result = np.zeros((len(places.surface), len(self._root)))
        for number, name in enumerate(self._surfaces):
            mine = places.surface == number
            points = places.points[mine].reshape(-1, 3) / unit
            if not len(points):
                continue
            if name == "screen":
                seen = self._room.seen_from(points)
            else:
                seen = self._room.seen_from_sheet(name, points)
            result[mine] = seen.reshape(-1, count, len(self._root)).mean(1)
        return result

    def shown(
        self, primary: int, albedos: Floats, places: Places, seen: Floats
    ) -> tuple[Floats, Floats]:
        """Light that places show of the patterns, and its derivatives.

        Parameters
        ----------
        primary
            Which.
        albedos
            (surface,) in that primary, of `surfaces_of`.
        places, seen
            The places, and `seen_from` of them.

        Returns
        -------
        light, slopes
            (pattern, place) and (surface, pattern, place).
        """
        solver = Solver(self._symmetric, albedos[self._owner])
        light = solver.solve(self._emission[primary] * self._root)
        arriving = self._symmetric @ light
        own = albedos[places.surface][:, None]
        received = seen @ (light / self._root)
        slopes = np.empty((len(albedos), *received.shape))
        for surface in range(len(albedos)):
            source = np.where((self._owner == surface)[:, None], arriving, 0)
            bounced = seen @ (solver.solve(source) / self._root)
            here = (places.surface == surface)[:, None]
            slopes[surface] = own * bounced + np.where(here, received, 0)
        shown = places.direct[..., primary].T + own * received
        if places.lux is not None:
            arrives = np.where(places.lux, np.pi / np.maximum(own[:, 0], _DARKEST), 1.0)[:, None]
            here = places.lux & (places.surface == np.arange(len(albedos))[:, None])
            slopes -= here[..., None] * shown / np.maximum(own, _DARKEST)
            shown, slopes = shown * arrives, slopes * arrives
        return shown.T, slopes.transpose(0, 2, 1)

    def _emitted(self, theatre: Theatre, patterns: Floats) -> Floats:
        """(primary, element, pattern) E: each pixel's light goes to the nearest element."""
        size = patterns.shape[1]
        step = next((f for f in range(1, size + 1) if size % f == 0 and size // f <= LARGEST), 1)
        dome, points = theatre.dome, self._room.points
        areas = dome.screen_areas(size, size)
        gains = lens_gains(theatre, size, size).sum(0)
        flux = (patterns * (areas * gains)[..., None]).reshape(
            len(patterns), size // step, step, size // step, step, 3
        )
        lit = dome.points(size // step, size // step).reshape(-1, 3) / dome.radius
        nearest = cKDTree(points).query(lit)[1]
        power = flux.sum((2, 4)).reshape(len(patterns), -1, 3)
        result = np.zeros((3, len(self._root), len(patterns)))
        weights = self._room.weights * dome.radius**2
        for primary, pattern in np.ndindex(3, len(patterns)):
            sent = np.bincount(nearest, power[pattern, :, primary], len(points))
            result[primary, : len(points), pattern] = sent / weights
        return result
