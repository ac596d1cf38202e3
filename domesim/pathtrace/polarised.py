"""Crosstalk of a polarised 3D cinema, path traced with Mitsuba's polarised light.

One projector at a time lights the screen. It is a small light in two spheres: Mitsuba's linear
``polarizer``, two of them crossed and blended by the leak, in a ``retarder``. (Spheres, so that
light passes every filter at right angles; their parallels are horizontal, as axes of 0 degrees
are.) The screen is a blend of a polarised ``roughconductor`` and a ``diffuse``. ``volpath`` carries
Mueller matrices along the paths and finds lights through filters, which ``path`` does not. The
glasses are applied to the Stokes vectors that arrive, by Mitsuba's own Mueller matrices: in the
scene they would shade a part of it, and a leak of a thousandth would be met once in a thousand
paths.

The pictures of both projectors that an eye sees use the same random places on the screen: in their
quotient most of the noise cancels.

Light is reflected once: a flat screen does not light itself, and the room is black. (What walls and
people send back to the screen comes from all of a picture; it is no crosstalk of a place on it.)
`domesim.stereo.polarisation` computes the same in NumPy, by other means.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.tracer import interruptible, launch_seed
from domesim.stereo.polarisation import ALUMINIUM
from domesim.stereo.system import QUARTER, CircularFilter, Point, SilverScreen, StereoTheatre

Progress = Callable[[float], None]
"""Told the share of the work that is done."""

_Floats = NDArray[np.float64]
_LAUNCH = 1 << 18
"""Paths that are computed before anyone may interrupt: a second or few."""
_LENS_RADIUS = 0.05
"""Least radius of the outer sphere round a lens, m."""
_APART = 4e-4
"""Least radius of that sphere over the lens's largest coordinate plus 1 m: Mitsuba lets a ray go on
from a quarter of that beyond what it has met, and must not miss the other sphere."""


@final
@dataclass(frozen=True)
class CrosstalkMap:
    """What one seat's eyes see of each other's pictures.

    Attributes
    ----------
    seat
        Its name.
    share
        (eye, row, col) the other picture's luminance over the eye's own, for equal pictures; eye 0
        is the left one, which sees the right one's picture. Means over cells of the screen.
    standard_error
        Standard errors of `share`, same shape. The errors of different entries are independent.
    samples
        Places in each cell, for each eye.
    """

    seat: str
    share: _Floats
    standard_error: _Floats
    samples: int


def crosstalk_map(
    theatre: StereoTheatre,
    seat: str,
    rows: int,
    cols: int,
    *,
    samples: int = 1024,
    seed: int = 0,
    progress: Progress | None = None,
) -> CrosstalkMap:
    """Trace polarised light from the projectors to the eyes of one seat.

    Parameters
    ----------
    theatre
        The theatre.
    seat
        Name of the seat.
    rows, cols
        Cells of the screen; 9 x 16 is plenty, as crosstalk is smooth.
    samples
        Places in each cell, for each eye. With 1024 of them in 9 x 16 cells the standard error
        is some thousandths of the crosstalk.
    seed
        Seed of the random places, which differ between seats. The same arguments give the same map.
    progress
        Told how far it is, after every launch.

    Returns
    -------
    map
        (view, row, col) crosstalk, with standard errors.

    Raises
    ------
    InputError
        If there is no such seat, there are no cells, fewer than 2 samples, or Mitsuba cannot trace
        polarised light here.
    KeyboardInterrupt
        After Ctrl-C, when the present launch has ended; there is no map then.
    """
    eye = theatre.seat(seat)
    if rows < 1 or cols < 1:
        raise InputError(f"a crosstalk map needs rows and cols of at least 1, got {rows} x {cols}")
    if samples < 2:
        raise InputError(f"a crosstalk map needs at least 2 samples for its error, got {samples}")
    sums = [_Sums(rows * cols) for _ in theatre.eyewear]
    random = np.random.default_rng(launch_seed(seed, *seat.encode()))
    with polarised() as mi, interruptible() as interrupted:
        integrator = mi.load_dict({"type": "volpath", "max_depth": 2})
        scenes = [_scene(mi, theatre, projector) for projector in (0, 1)]
        passed = [_passed(mi, glass) for glass in theatre.eyewear]

        def seen(projector: int, glass: int, points: _Floats) -> _Floats:
            stokes = arriving(mi, integrator, scenes[projector], eye, points)
            return np.asarray(passed[glass] @ stokes)

        for done, count in _launches(samples, rows * cols):
            for e in (0, 1):
                points = _places(theatre.screen, rows, cols, count, random)
                own, other = (seen(p, e, points).reshape(-1, count) for p in (e, 1 - e))
                sums[e].add(own, other)
            if progress is not None:
                progress((done + count) / samples)
            if interrupted():
                raise KeyboardInterrupt
    maps = np.array([one.quotient() for one in sums]).reshape(2, 2, rows, cols)
    return CrosstalkMap(seat, share=maps[:, 0], standard_error=maps[:, 1], samples=samples)


def luminance_map(
    theatre: StereoTheatre,
    weights: _Floats,
    seat: str,
    rows: int,
    cols: int,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> CrosstalkMap:
    """`crosstalk_map` of luminance, for a theatre whose filters may depend on the primary.

    Parameters
    ----------
    theatre
        The theatre; each of its `by_primary` is traced, with the same random places.
    weights
        (primary,) of luminance; they sum to 1.
    seat, rows, cols, seed, progress
        As of `crosstalk_map`.

    Returns
    -------
    map
        (view, row, col) crosstalk of luminance, with standard errors.
    """
    each = theatre.by_primary()
    maps = []
    for number, one in enumerate(each):

        def told(done: float, n: int = number) -> None:
            if progress is not None:
                progress((n + done) / len(each))

        maps.append(crosstalk_map(one, seat, rows, cols, seed=seed, progress=told))
    if len(maps) == 1:
        return maps[0]
    share, error = (
        np.tensordot(weights, np.stack([getattr(one, name) for one in maps]), axes=1)
        for name in ("share", "standard_error")  # of the same places: errors add up
    )
    return CrosstalkMap(seat, share, error, maps[0].samples)


@final
class _Sums:
    """Sums for the quotient of two means and its standard error, cell by cell."""

    def __init__(self, cells: int) -> None:
        self.count = 0
        self.mean = np.zeros((2, cells))
        self.spread = np.zeros((2, 2, cells))

    def add(self, own: _Floats, other: _Floats) -> None:
        """Merge samples (cell, sample) of both, pairwise (Chan, Golub and LeVeque 1979)."""
        both = np.stack([own, other])
        count = both.shape[-1]
        mean = both.mean(axis=-1)
        away = both - mean[..., None]
        step = mean - self.mean
        total = self.count + count
        self.spread += np.einsum("acs,bcs->abc", away, away)
        self.spread += step[:, None] * step * (self.count * count / total)
        self.mean += step * (count / total)
        self.count = total

    def quotient(self) -> tuple[_Floats, _Floats]:
        """Mean of the other over that of the own, and its standard error to first order."""
        own, other = self.mean
        share = other / own
        spread = self.spread[1, 1] - 2 * share * self.spread[0, 1] + share**2 * self.spread[0, 0]
        variance = np.maximum(spread, 0) / (self.count * (self.count - 1))
        return share, np.sqrt(variance) / own


@contextmanager
def polarised() -> Iterator[Any]:
    """Mitsuba with polarisation; whoever comes after finds the variant of `load_mitsuba` again."""
    mi = load_mitsuba()
    before = mi.variant()
    wanted = before.replace("_rgb", "_mono_polarized")
    if wanted not in mi.variants():
        raise InputError(
            f"polarised light wants a Mitsuba with the variant {wanted}, this one has "
            f"{', '.join(mi.variants())}; pip install mitsuba has it"
        )
    mi.set_variant(wanted)
    try:
        yield mi
    finally:
        mi.set_variant(before)


def _scene(mi: Any, theatre: StereoTheatre, projector: int) -> Any:
    """One projector and the screen."""
    screen = theatre.screen
    lens = theatre.projectors[projector]
    radius = max(_LENS_RADIUS, _APART * (1 + max(abs(x) for x in lens.position)))
    facing = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    extent = mi.ScalarTransform4f().scale([screen.width / 2, screen.height / 2, 1])
    return mi.load_dict(
        {
            "type": "scene",
            "screen": {"type": "rectangle", "to_world": facing @ extent, "bsdf": silver(screen)},
            "lamp": {"type": "point", "position": list(lens.position), "intensity": 1.0},
            "polariser": around(lens.position, radius / 2, leaking(lens.filter)),
            "retarder": around(lens.position, radius, retarder(lens.filter)),
        }
    )


def silver(screen: SilverScreen) -> dict[str, Any]:
    """Facets of aluminium, and paint that forgets polarisation."""
    return {
        "type": "blendbsdf",
        "weight": screen.depolarising_share,
        "facets": {
            "type": "roughconductor",
            "eta": ALUMINIUM.real,
            "k": ALUMINIUM.imag,
            "distribution": "ggx",
            "alpha": screen.roughness,
            "specular_reflectance": screen.albedo,
        },
        "paint": {"type": "diffuse", "reflectance": screen.albedo},
    }


def leaking(glass: CircularFilter) -> dict[str, Any]:
    """Crossed polarisers of a lens that share its light as 1 : leak, adding up to half."""
    # Mitsuba 3.9 turns a polariser one way, and a retarder the other way, on the same surface
    passed, blocked = ({"type": "polarizer", "theta": glass.axis + turn} for turn in (0.0, 90.0))
    return {
        "type": "blendbsdf",
        "weight": glass.leak / (1 + glass.leak),
        "passed": passed,
        "blocked": blocked,
    }


def retarder(glass: CircularFilter) -> dict[str, Any]:
    """The wave plate of a lens, which makes the hand."""
    delta = QUARTER + glass.retardance_error
    return {"type": "retarder", "theta": -_fast(glass), "delta": delta}


def _fast(glass: CircularFilter) -> float:
    """Angle of a retarder's fast axis, degrees: it makes the hand."""
    return glass.axis + (-45.0 if glass.hand == "right" else 45.0)


def around(centre: Point, radius: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    """A sphere round a lens, for Mitsuba.

    Parameters
    ----------
    centre
        Of the lens, m.
    radius
        Of the sphere, m.
    bsdf
        Mitsuba's, of its surface.

    Returns
    -------
    shape
        Mitsuba's.
    """
    return {"type": "sphere", "center": list(centre), "radius": radius, "bsdf": bsdf}


def _passed(mi: Any, glass: CircularFilter) -> _Floats:
    """(Stokes,) how much glasses pass of light whose axes are right and up."""
    mueller = mi.mueller

    def turned(degrees: float, element: Any) -> _Floats:
        matrix = mueller.rotated_element(mi.Float(np.radians(degrees)), element)
        return _numbers([matrix[i, j] for i in range(4) for j in range(4)]).reshape(4, 4)

    polariser, crossed = (
        turned(glass.axis + turn, mueller.linear_polarizer(mi.Float(1.0))) for turn in (0.0, 90.0)
    )
    phase = np.radians(QUARTER + glass.retardance_error)
    plate = turned(_fast(glass), mueller.linear_retarder(mi.Float(phase)))
    return np.asarray((polariser + glass.leak * crossed)[0] @ plate)


def _numbers(entries: list[Any], rays: int = 1) -> _Floats:
    """(entry, ray) numbers of Dr.Jit's `entries`, computed at once."""
    import drjit as dr  # noqa: PLC0415

    dr.eval(entries)  # at once: each by itself would trace all paths anew
    return np.stack([np.broadcast_to(np.ravel(each), rays) for each in entries]).astype(np.float64)


def _launches(samples: int, cells: int) -> Iterator[tuple[int, int]]:
    """(done before, count) of samples a cell, in launches."""
    most = max(1, _LAUNCH // cells)
    for done in range(0, samples, most):
        yield done, min(most, samples - done)


def _places(
    screen: SilverScreen, rows: int, cols: int, count: int, random: np.random.Generator
) -> _Floats:
    """(row col sample, xyz) evenly distributed places of each cell of the screen, m."""
    inner = random.random((2, rows, cols, count))
    down = (np.arange(rows)[:, None, None] + inner[0]) / rows
    across = (np.arange(cols)[:, None] + inner[1]) / cols
    x, z = (across - 0.5) * screen.width, (0.5 - down) * screen.height
    return np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)


def arriving(
    mi: Any, integrator: Any, scene: Any, eye: Point, points: _Floats, seed: int = 0
) -> _Floats:
    """Light that comes from points of the screen, by axes that are right and up.

    Parameters
    ----------
    mi
        Mitsuba, with its variant set.
    integrator, scene
        Mitsuba's.
    eye
        Where it is seen from, m.
    points
        (ray, xyz) of the screen, m.
    seed
        Seed of the random numbers; of no effect where paths end at their first reflection.

    Returns
    -------
    light
        (Stokes, ray).
    """
    way = points - np.asarray(eye)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    right = np.cross(way, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    towards, across = (mi.Vector3f(*each.T.astype(np.float32)) for each in (-way, right))
    ray = mi.RayDifferential3f(o=mi.Point3f(*eye), d=-towards)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(points))
    mueller, _, _ = integrator.sample(scene, sampler, ray)
    basis = mi.mueller.stokes_basis(towards)
    turn = mi.mueller.rotate_stokes_basis(towards, basis, across)
    # The first column is of unpolarised light that was sent
    return _numbers(
        [sum(turn[i, j] * mueller[j, 0] for j in range(4)) for i in range(4)], len(points)
    )
