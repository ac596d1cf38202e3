"""Indirect light by radiosity: screen, floor and wall exchange light, without random numbers.

A second opinion on the closed form and on the path tracer. All surfaces are Lambertian, so with
radiosities B_i (in units of projector white), emission E_i (the picture; 0 off the screen) and
albedos rho_i

    B_i = E_i + rho_i sum_j F_ij B_j,       A_i F_ij = A_j F_ji

and phi = (B - E) / f on the screen, with f what multiplies its albedo there (1 on even paint).
rho_screen is the albedo where f is 1; a point's f is the mean around it. Light that floor or wall
stop on its way to the screen is none of E there; where it lands they emit rho_i / (rho_screen f) of
it. Three kinds of element i take part:

- **Screen: points of a quadrature.** Between two points of a sphere of radius r the form factor is
  dA / (4 pi r²), a constant; between points x, y of the ellipsoid x'Mx = 1 it is
  ((x-y)'M(x-y))² dA / (4 pi |x-y|⁴ |Mx| |My|). Meridians run from the zenith to the rim, and their
  points crowd there: where a floor touches the screen, light changes quickly.
- **Floor and wall: rings of patches**, graded likewise. What a point sees of a patch is a line
  integral along the patch's edge s [1]

      F = 1/(2 pi) integral of n . (s x ds) / s²

  and edges are straight or arcs round the z axis, for both of which it is elementary. Circles stay
  circles: a closed room is closed to rounding.
- Where a patch crosses a point's horizon or is partly behind something, points on the patch stand
  in for it. What is between two points is found by meeting their segment with floor, wall and
  screen as the quadrics that they are; backs absorb.

The dense solution is compressed: random probes find the range of E -> phi [2], and its singular
vectors are evaluated on the nodes of a `Transport` by the equation above (Nyström). Where light is
stopped it does not go both ways alike, and pictures need modes that what is seen does not have:
polynomials are added, those of `tabulate`.

[1] E. M. Sparrow, "A new and simpler formulation for radiative angle factors", J. Heat Transfer
85, 81 (1963). [2] N. Halko, P. G. Martinsson, J. A. Tropp, "Finding structure with randomness",
SIAM Review 53, 217 (2011).
"""

from __future__ import annotations

from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.basis import ScreenBasis, disc_quadrature
from domesim.observation.enclosure import Enclosure, Mix, Solver, chunks
from domesim.observation.transport import NODES, Transport, node_places, sample_nodes
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RESOLUTION = 16
"""Rings of the floor; there are twice as many sectors, and 8 n² points on the screen."""

_PROBES = 240
_FINEST = 0.1
"""Finest scale of the pictures that modes are made for, in the domemaster's radius: a wavelength
over 2 pi."""
_CLOSE = 1e-9
_DEGREE = 6
"""Degree of the polynomials where light is stopped."""


def radiosity(
    theatre: Theatre,
    *,
    resolution: int = RESOLUTION,
    nodes: int = NODES,
    tolerance: float = 1e-4,
    all_lit: bool = False,
) -> Transport:
    """Solves the indirect light of a theatre of Lambertian screen, floor and wall.

    Parameters
    ----------
    theatre
        The theatre; its lenses' gain does not matter (`Transport.observation` takes it).
    resolution
        Rings of the floor. Time grows with its fourth to sixth power.
    nodes
        Nodes a side of the grid that holds the modes.
    tolerance
        Root of the share of the operator's squared singular values that may be dropped.
    all_lit
        Take all of the screen to be lit, whatever stands before it (`tabulate` goes on from there).

    Returns
    -------
    Transport
        Mode 0 is 1 everywhere and carries the closed form; the others carry what floor, wall and
        the screen's shape change. `core_error` is |core| times ``discretisation_error``, which
        `provenance` has: the difference to a solution of 2/3 of the resolution, as rms relative to
        the mean, the largest for a white picture and two slanted ones. There, too:
        ``sampling_error``, what modes and nodes cost, likewise; ``sees``, the least and largest sum
        of form factors from a point of the screen; ``closure_error``, the largest |1 - sum| if the
        room is closed, else None; ``elements``, how many there are of each kind.

    Raises
    ------
    InputError
        If there is something in the theatre that this model has no notion of, or the screen, whose
        white is the unit of all light, is black and projectors light floor or wall.
    """
    if resolution < 6:
        raise InputError(f"radiosity resolution must be at least 6, got {resolution}")
    _guard(theatre)
    room = Enclosure(theatre, resolution)
    stopped = not all_lit and not room.lit
    if stopped and min(theatre.screen_albedo) == 0:
        raise InputError(
            "radiosity has white as its unit of light, got a black screen and projectors that "
            "light floor or wall; give the screen an albedo above 0"
        )
    fine = _Solution(room, stopped=stopped)
    coarse = _Solution(Enclosure(theatre, round(resolution / 1.5)), stopped=stopped)
    modes, exact = fine.modes(nodes, tolerance)
    core = fine.core(modes, exact)
    discretisation = fine.off_by(coarse.direct(fine.room.points), fine.direct())
    # Of points that the modes were not made for
    shown, others = _shown(theatre.dome, modes, core, coarse.room.places), coarse.room.points
    sees = fine.room.sees
    closed = bool(sees.mean() > 0.99)
    provenance = {
        "method": "radiosity",
        "resolution": resolution,
        "tolerance": tolerance,
        "elements": fine.room.counts,
        "discretisation_error": discretisation,
        "sampling_error": coarse.off_by(shown, fine.direct(others)),
        "sees": [float(sees.min()), float(sees.max())],
        "closure_error": float(np.abs(1 - sees).max()) if closed else None,
    }
    ambient = np.zeros((len(core), nodes, nodes))
    return Transport(theatre.dome, modes, core, np.abs(core) * discretisation, ambient, provenance)


@lru_cache(maxsize=8)
def quick_radiosity(theatre: Theatre) -> Transport:
    """`radiosity` of a theatre's screen, floor and wall, kept for the next time.

    It takes some seconds. Of an ellipsoid of height ratio 0.8, white's reflected light is within
    0.3 % of the finest solution's.

    Parameters
    ----------
    theatre
        What else there is in it is left out.

    Returns
    -------
    Transport
        As `radiosity` gives it.

    Raises
    ------
    InputError
        If the screen is black and projectors light floor or wall.
    """
    return radiosity(theatre.enclosure, resolution=10, nodes=49, tolerance=3e-3)


def _guard(theatre: Theatre) -> None:
    if theatre.beyond_enclosure:
        raise InputError(
            f"radiosity knows a Lambertian screen, a floor and a wall, got "
            f"{', '.join(theatre.beyond_enclosure)}; use 'domesim tabulate', which traces paths"
        )


def _pictures(u: Floats, v: Floats) -> Floats:
    """(point, picture): white, brighter to the front, brighter to the right."""
    return np.stack([np.ones_like(u), 1 + v, 1 + u], -1)


def _shown(dome: Dome, modes: Floats, core: Floats, places: tuple[Floats, Floats]) -> Floats:
    """(primary, point, picture): phi of the pictures at places, as modes and core have it."""
    u, v, areas = disc_quadrature(dome, 48)
    collected = (sample_nodes(modes, u, v) * (areas / areas.sum())) @ _pictures(u, v)
    return np.asarray(sample_nodes(modes, *places).T @ (core @ collected))


# ---------------------------------------------------------------------------------------------
# The equation and its solution


@final
class _Solution:
    """The theatre's light for any emission of the screen's points."""

    def __init__(self, room: Enclosure, *, stopped: bool) -> None:
        self.room = room
        self._thrown = room.thrown() if stopped else None
        symmetric = room.exchange()
        self._solvers = {mix: Solver(symmetric, room.albedos(mix)) for mix in set(room.mixes)}

    def modes(self, nodes: int, tolerance: float) -> tuple[Floats, Floats]:
        """1, then what best spans the deviations from the closed form.

        They are (mode, node, node), and (mode, screen point) without the nodes' interpolation. The
        pictures are those that the nodes can tell apart, of all primaries together.
        """
        room, root = self.room, np.sqrt(self.room.share)[:, None]
        # Orthonormal pictures, and their answers less the mean: without what mode 0 has
        inputs = np.linalg.qr(_waves(*room.places) * root)[0] / root
        answers = [self._centred(self._deviation(mix, inputs)) for mix in room.mixes]
        _, values, weights = np.linalg.svd(np.concatenate(answers, 1) * root, full_matrices=False)
        tails = np.sqrt(np.cumsum(values[::-1] ** 2)[::-1])
        whole = np.sqrt(sum(room.closed_form(mix) ** 2 for mix in room.mixes))
        kept = tolerance * np.hypot(whole, np.linalg.norm(values))
        # Black screens have rounding only. Of equal ones at this limit either may go
        rank = int(np.sum(tails > max(kept, _CLOSE)))
        # sum over primaries of their answers to W / s: the left singular vectors, anywhere
        right = np.split((weights[:rank] / values[:rank, None]).T, len(room.mixes))
        pictures = [inputs @ part for part in right]
        sources = zip(room.mixes, pictures, strict=True)
        grid, exact = self._on_nodes(nodes, [self.radiosity(*each) for each in sources])
        modes = np.concatenate([np.ones((1, nodes, nodes)), grid])
        exact = np.concatenate([np.ones((1, len(room.share))), exact])
        if self._thrown is not None:
            basis, places = ScreenBasis(room.theatre.dome, _DEGREE), node_places(nodes)
            modes = np.concatenate([modes, basis.at(*np.meshgrid(places, places))[1:]])
            exact = np.concatenate([exact, basis.at(*room.places)[1:]])
        # Orthonormal as the nodes have them; the first stays 1
        sampled = sample_nodes(modes, *room.places)
        lower = np.linalg.cholesky((sampled * room.share) @ sampled.T)
        turn = np.linalg.inv(lower)
        return np.asarray(np.einsum("ij,jab->iab", turn, modes)), turn @ exact

    def core(self, modes: Floats, exact: Floats) -> Floats:
        """(primary, mode, mode) core that comes nearest to the solution (Galerkin).

        Pictures are taken apart by the modes as the nodes have them. Answers are, too, but where
        light is stopped and modes end at an edge, which the nodes blur: by what modes are.
        """
        room = self.room
        sampled = sample_nodes(modes, *room.places)
        inverse = np.linalg.inv((sampled * room.share) @ sampled.T)
        shown = sampled if self._thrown is None else exact
        seen = np.linalg.solve((shown * room.share) @ shown.T, shown * room.share)
        result = []
        for mix in room.mixes:
            core = seen @ self._deviation(mix, sampled.T) @ inverse
            core[0, 0] += room.closed_form(mix)
            result.append((core + core.T) / 2 if self._thrown is None else core)
        return np.stack(result)

    def radiosity(self, mix: Mix, emission: Floats) -> Floats:
        """(element, picture) B of (screen point, picture) E."""
        root = np.sqrt(self.room.areas)[:, None]
        return np.asarray(self._solvers[mix].solve(self._emitted(mix, emission) * root) / root)

    def _emitted(self, mix: Mix, emission: Floats) -> Floats:
        """(element, picture): what projectors make elements emit, for (screen point, picture) E."""
        result = np.zeros((len(self.room.areas), emission.shape[1]))
        result[: len(emission)] = emission
        if self._thrown is not None:
            lit, landed = self._thrown
            result[: len(lit)] *= lit[:, None]
            shares = self.room.albedos(mix)[len(lit) :, None] / mix.screen
            result[len(lit) :] = shares * (landed @ (emission / self._painted(mix)))
        return result

    def direct(self, points: Floats | None = None) -> Floats:
        """(primary, point, picture): phi of the pictures, by default at the screen's own points."""
        emission = _pictures(*self.room.places)
        if points is None:
            return np.stack([self._indirect(mix, emission) for mix in self.room.mixes])
        sent = np.stack([mix.screen * self.radiosity(mix, emission) for mix in self.room.mixes])
        seen = [self.room.seen_from(points[some]) @ sent for some in chunks(len(points))]
        return np.concatenate(seen, 1)

    def off_by(self, found: Floats, wanted: Floats) -> float:
        """Largest rms error of a picture's phi, relative to its mean."""
        share = self.room.share
        error = np.sqrt(share @ (found - wanted) ** 2)
        return float(np.max(error / np.maximum(share @ wanted, _CLOSE)))

    def _indirect(self, mix: Mix, emission: Floats) -> Floats:
        sent = self._emitted(mix, emission)
        return (self.radiosity(mix, emission) - sent)[: len(emission)] / self._painted(mix)

    def _deviation(self, mix: Mix, emission: Floats) -> Floats:
        closed = self.room.closed_form(mix) * (self.room.share @ emission)
        return self._indirect(mix, emission) - closed

    def _painted(self, mix: Mix) -> Floats:
        """(screen point, 1) what multiplies the screen's albedo."""
        return np.asarray(self.room.painted[mix.paint][:, None])

    def _centred(self, values: Floats) -> Floats:
        return values - self.room.share @ values

    def _on_nodes(self, nodes: int, given: list[Floats]) -> tuple[Floats, Floats]:
        """Phi of radiosities B, summed over primaries, less its mean.

        It is (mode, node, node), and (mode, screen point).
        """
        room = self.room
        sent = sum(mix.screen * radiosity for mix, radiosity in zip(room.mixes, given, strict=True))

        def values(u: Floats, v: Floats) -> Floats:
            points = room.screen_at(u, v)
            return np.concatenate([room.seen_from(points[some]) @ sent for some in chunks(len(u))])

        places = node_places(nodes)
        u, v = (axis.ravel() for axis in np.meshgrid(places, places))
        edge_u, edge_v, beyond = _onto_screen(room.theatre.dome, u, v, 4 * (places[1] - places[0]))
        grid = values(edge_u, edge_v)
        # Beyond the rim functions go on as their reflection in its value: without a kink.
        mirrored = values(2 * edge_u[beyond] - u[beyond], 2 * edge_v[beyond] - v[beyond])
        grid[beyond] = 2 * grid[beyond] - mirrored
        exact = values(*room.places)
        mean = room.share @ exact
        return np.ascontiguousarray((grid - mean).T).reshape(-1, nodes, nodes), (exact - mean).T


def _waves(u: Floats, v: Floats) -> Floats:
    """(point, picture): waves of all directions; the shortest wavelength is 2 pi `_FINEST`."""
    rng = np.random.default_rng(1)
    count = min(_PROBES, len(u) // 3)
    slope, phase = rng.standard_normal((2, count)) / _FINEST, rng.uniform(0, 2 * np.pi, count)
    slope[:, 0], phase[0] = 0, 0
    return np.asarray(np.cos(np.outer(u, slope[0]) + np.outer(v, slope[1]) + phase))


def _onto_screen(dome: Dome, u: Floats, v: Floats, reach: float) -> tuple[Floats, Floats, Flags]:
    """Places of the screen nearest to (u, v), and which (u, v) are off it but within `reach`."""
    near_u, near_v = u.copy(), v.copy()
    for _ in range(8 if dome.truncated_below is not None else 1):
        if dome.truncated_below is not None:
            rise, along_u, along_v = _rise(dome, near_u, near_v)
            step = np.maximum(-rise, 0) / np.maximum(along_u**2 + along_v**2, _CLOSE)
            near_u, near_v = near_u + step * along_u, near_v + step * along_v
        shrink = np.maximum(np.hypot(near_u, near_v) / (1 - 1e-7), 1)
        near_u, near_v = near_u / shrink, near_v / shrink
    away = np.hypot(u - near_u, v - near_v)
    return near_u, near_v, (away > 1e-6) & (away < reach)


def _rise(dome: Dome, u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
    """Height above the truncation at places of the domemaster, m, and its two slopes."""

    def height(u: Floats, v: Floats) -> Floats:
        theta = np.hypot(u, v) * dome.half_angle
        points = dome.surface(np.minimum(theta, np.pi), np.arctan2(v, u))
        return np.asarray(points @ dome.to_room[2])

    cut, step = dome.truncated_below or 0.0, 1e-4
    along_u = (height(u + step, v) - height(u - step, v)) / (2 * step)
    along_v = (height(u, v + step) - height(u, v - step)) / (2 * step)
    return height(u, v) - cut - 1e-6 * dome.radius, along_u, along_v
