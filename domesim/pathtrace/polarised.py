"""Crosstalk of a polarised 3D cinema, path traced with Mitsuba's polarised light.

One projector at a time lights the screen. What it sends is a small light in a sphere of Mitsuba's
``circular`` polarisers, one of each hand blended by its leak; the screen is a blend of a polarised
``roughconductor`` and a ``diffuse``; the eye looks out of a sphere of the ``circular`` polariser of
its glasses. Spheres, so that light passes every filter at right angles. ``volpath`` carries Mueller
matrices along the paths and finds lights through filters, which ``path`` does not.

A filter that is met by a camera's ray lets through or does not; a leak of a thousandth would be
sampled once in a thousand paths. So the eye looks through ideal filters of either hand in turn, and
the light of both is added, weighted by its own filter's leak. The pictures of both projectors that
an eye sees use the same random places on the screen: in their quotient most of the noise cancels.

Light is reflected once: a flat screen does not light itself, and the room is black. (What walls and
people send back to the screen comes from all of a picture; it is no crosstalk of a place on it.)
`domesim.polarisation` computes the same in NumPy, by other means.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.llvm import backend, load_mitsuba
from domesim.pathtrace.tracer import interruptible, launch_seed
from domesim.polarisation import ALUMINIUM
from domesim.stereo import CircularFilter, Hand, Point, SilverScreen, StereoTheatre

Progress = Callable[[float], None]
"""Told the share of the work that is done."""

_Floats = NDArray[np.float64]
_OPPOSITE: dict[Hand, Hand] = {"left": "right", "right": "left"}
_LAUNCH = 1 << 18
"""Paths that are computed before anyone may interrupt: a second or few."""
_LENS_RADIUS = 0.05
_GLASS_RADIUS = 0.002
"""Of the spheres round lens and eye, m: an eye in the beam hides next to nothing of the screen."""


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
        Of `share`, same shape. The errors of different entries are independent.
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
        Of the random places, which differ between seats. The same arguments give the same map.
    progress
        Told how far it is, after every launch.

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
    with _polarised() as mi, interruptible() as interrupted:
        integrator = mi.load_dict({"type": "volpath", "max_depth": 2})
        scenes = {
            (p, hand): _scene(mi, theatre, p, eye, hand) for p in (0, 1) for hand in _OPPOSITE
        }

        def seen(projector: int, glass: CircularFilter, points: _Floats) -> _Floats:
            light = _luminance(mi, integrator, scenes[projector, glass.hand], eye, points)
            if glass.leak > 0:
                blocked = scenes[projector, _OPPOSITE[glass.hand]]
                light += glass.leak * _luminance(mi, integrator, blocked, eye, points)
            return light

        for done, count in _launches(samples, rows * cols):
            for e, glass in enumerate(theatre.eyewear):
                points = _places(theatre.screen, rows, cols, count, random)
                own, other = (seen(p, glass, points).reshape(-1, count) for p in (e, 1 - e))
                sums[e].add(own, other)
            if progress is not None:
                progress((done + count) / samples)
            if interrupted():
                raise KeyboardInterrupt
    maps = np.array([one.quotient() for one in sums]).reshape(2, 2, rows, cols)
    return CrosstalkMap(seat, share=maps[:, 0], standard_error=maps[:, 1], samples=samples)


@final
class _Sums:
    """What is needed for the quotient of two means and its standard error, cell by cell."""

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
def _polarised() -> Iterator[Any]:
    """Mitsuba with polarisation; whoever comes after finds the variant of `load_mitsuba` again."""
    if not backend().vectorised:
        raise InputError(
            "crosstalk_map traces polarised light and wants a vectorised Mitsuba, got "
            f"{backend().variant} ({backend().why})"
        )
    mi = load_mitsuba()
    before = mi.variant()
    wanted = before.replace("_rgb", "_mono_polarized")
    if wanted not in mi.variants():
        raise InputError(
            f"crosstalk_map wants a Mitsuba with the variant {wanted}, this one has "
            f"{', '.join(mi.variants())}; pip install mitsuba has it"
        )
    mi.set_variant(wanted)
    try:
        yield mi
    finally:
        mi.set_variant(before)


def _scene(mi: Any, theatre: StereoTheatre, projector: int, eye: Point, hand: Hand) -> Any:
    """One projector, the screen, and an eye behind an ideal filter."""
    screen = theatre.screen
    lens = theatre.projectors[projector]
    facing = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    extent = mi.ScalarTransform4f().scale([screen.width / 2, screen.height / 2, 1])
    return mi.load_dict(
        {
            "type": "scene",
            "screen": {"type": "rectangle", "to_world": facing @ extent, "bsdf": _silver(screen)},
            "lamp": {"type": "point", "position": list(lens.position), "intensity": 1.0},
            "filter": _around(lens.position, _LENS_RADIUS, _leaking(lens.filter)),
            "glass": _around(eye, _GLASS_RADIUS, _circular(hand)),
        }
    )


def _silver(screen: SilverScreen) -> dict[str, Any]:
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


def _leaking(filter_: CircularFilter) -> dict[str, Any]:
    """A filter that shares its light between hands in proportion 1 : leak, adding up to half."""
    return {
        "type": "blendbsdf",
        "weight": filter_.leak / (1 + filter_.leak),
        "passed": _circular(filter_.hand),
        "blocked": _circular(_OPPOSITE[filter_.hand]),
    }


def _circular(hand: Hand) -> dict[str, Any]:
    return {"type": "circular", "left_handed": hand == "left"}


def _around(centre: Point, radius: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sphere", "center": list(centre), "radius": radius, "bsdf": bsdf}


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


def _luminance(mi: Any, integrator: Any, scene: Any, eye: Point, points: _Floats) -> _Floats:
    """(ray) what comes from points of the screen through the glass."""
    way = points - np.asarray(eye)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    ray = mi.RayDifferential3f(o=mi.Point3f(*eye), d=mi.Vector3f(*way.T.astype(np.float32)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, len(points))  # it decides nothing: paths end at their first reflection
    mueller, _, _ = integrator.sample(scene, sampler, ray)
    # Of unpolarised light that was sent, what arrives whatever its polarisation
    return np.asarray(mueller[0, 0].numpy(), np.float64).reshape(-1)
