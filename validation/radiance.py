"""Theatres for Radiance, a second program that traces light, and what it finds in them.

Radiance [1] has its own shapes, random numbers and bounces; it shares nothing with ours but the
description of the theatre, which is written here as its scene text. The projector is a sphere of
a thousandth of the dome's radius in its centre, whose light goes to the screen only. Walks are
unweighted: one ambient ray a bounce, no cache, ended at random (``-ad 1 -aa 0 -lr -1000``), so that
means over rays are unbiased and their spread tells their error. Its random numbers differ from run
to run, and so do its figures, within their errors.

[1] G. Ward Larson, R. Shakespeare, *Rendering with Radiance*, Morgan Kaufmann 1998; the package
pyradiance has its programs.
"""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.theatre import Albedo, Theatre

Floats = NDArray[np.float64]

MISSING = "Radiance is not installed (pip install 'domesim[radiance]')"
"""Message where Radiance is left out."""
_LENS, _APART, _START = 1e-3, 1e-4, 1e-4
"""Radius of the lens, distance of black backs, and distance of rays' starts from the screen, in the
dome's radius."""
_BOUNCES, _DEEPEST = 200, 1000
"""Numbers of reflections. Radiance cuts walks off beyond the second; 60 lose 4.5 % at albedo
0.95."""


def installed() -> bool:
    """Whether Radiance's programs are there."""
    return find_spec("pyradiance") is not None


def reflected(theatre: Theatre, *, rays: int, seed: int) -> tuple[Floats, Floats]:
    """Mean reflected light of a white picture over the screen, and its standard error.

    Parameters
    ----------
    theatre
        The theatre; its lens is in the dome's centre.
    rays
        How many points of the screen are looked at.
    seed
        Seed of their places.

    Returns
    -------
    mean, error
        (primary,) in units of what projector white shows on the screen directly.

    Raises
    ------
    InputError
        If the theatre has more than is written here.
    """
    dome, rng = theatre.dome, np.random.default_rng(seed)
    theta = np.arccos(1 - (np.arange(rays) + rng.random()) / rays * (1 - np.cos(dome.half_angle)))
    points = dome.surface(theta, 2 * np.pi * rng.random(rays)) @ dome.to_room.T
    looks = np.concatenate([points * (1 - _START), points], 1)
    text = scene(theatre)
    # What is direct is the same in both: shadow rays go to the lens's middle.
    light = traced(text, looks, bounces=_BOUNCES) - traced(text, looks, bounces=0)
    light = light * np.pi / np.array(theatre.screen_albedo)
    return light.mean(0), light.std(0, ddof=1) / np.sqrt(rays)


def traced(scene: str, rays: Floats, *, bounces: int, irradiance: bool = False) -> Floats:
    """(ray, primary) radiance along rays, or irradiance about them.

    Parameters
    ----------
    scene
        Radiance's text.
    rays
        (ray, 6) origins and directions (of irradiance: normals).
    bounces
        Most reflections by which light is found, besides the last.
    irradiance
        Whether irradiance is wanted.
    """
    # An optional extra
    import pyradiance  # noqa: PLC0415

    settings = ["-dt", "0", "-dj", "0", "-ds", "0", "-aa", "0", "-ad", "1", "-lw", "1e-7",
                "-lr", f"-{_DEEPEST}", "-ab", str(bounces)]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        octree = Path(folder) / "scene.oct"
        octree.write_bytes(pyradiance.oconv(stdin=scene.encode(), frozen=True, warning=False))
        found = pyradiance.rtrace(
            np.ascontiguousarray(rays, np.float64).tobytes(), octree, header=False, inform="d",
            outform="d", irradiance=irradiance, uncorrelated=True, params=settings,
        )  # fmt: skip
    return np.frombuffer(found, np.float64).reshape(-1, 3)


def scene(theatre: Theatre) -> str:
    """A theatre as Radiance's text; lengths in m, projector white has an irradiance of 1.

    Raises
    ------
    InputError
        If the theatre has more than a Lambertian spherical cap, floor, wall and solids, lit from
        the centre.
    """
    _require_plain(theatre)
    dome = theatre.dome
    unit = dome.radius
    axis = " ".join(f"{part:.12g}" for part in dome.to_room[:, 2])
    cap, rim = float(np.cos(dome.half_angle)), float(np.cos(dome.half_angle) * unit)
    within, aimed = "if(A1*Px+A2*Py+A3*Pz-A4,1,0)", "if(-A1*Dx-A2*Dy-A3*Dz-A4,1,0)"
    power = 1 / (np.pi * _LENS**2)  # pi L (lens / r)² = 1
    parts = [
        paint("paint", theatre.screen_albedo),
        paint("black", (0.0, 0.0, 0.0)),
        f"void mixfunc screen\n4 paint void {within} .\n0\n4 {axis} {rim:.12g}",
        f"void mixfunc back\n4 black void {within} .\n0\n4 {axis} {rim:.12g}",
        f"screen bubble dome\n0\n0\n4 0 0 0 {unit}",
        f"back sphere outside\n0\n0\n4 0 0 0 {unit * (1 + _APART)}",
        f"void brightfunc beam\n2 {aimed} .\n0\n4 {axis} {cap:.12g}",
        f"beam light lamp\n0\n0\n3 {power} {power} {power}",
        f"lamp sphere lens\n0\n0\n4 0 0 0 {_LENS * unit}",
    ]
    if theatre.floor is not None:
        at, reach = theatre.floor.height, theatre.floor.radius
        parts.append(paint("flooring", theatre.floor.albedo))
        for name, height in (("flooring", at), ("black", at - _APART * unit)):
            parts.append(f"{name} ring {name}disk\n0\n0\n8 0 0 {height} 0 0 1 0 {reach}")
    if theatre.wall is not None:
        low, high = theatre.wall.bottom, theatre.wall.top
        parts.append(paint("walling", theatre.wall.albedo))
        for name, away in (("walling", 0.0), ("black", _APART * unit)):
            radius = theatre.wall.radius + away
            parts.append(f"{name} tube {name}tube\n0\n0\n7 0 0 {low} 0 0 {high} {radius}")
    for number, solid in enumerate(theatre.solids):
        parts.append(paint(f"solid{number}", solid.albedo))
        for face, corners in enumerate(solid.vertices[solid.faces]):
            places = " ".join(f"{part:.12g}" for part in corners.ravel())
            parts.append(f"solid{number} polygon face{number}.{face}\n0\n0\n9 {places}")
    return "\n".join(parts) + "\n"


def paint(name: str, albedo: Albedo) -> str:
    """A Lambertian material."""
    return f"void plastic {name}\n0\n0\n5 {' '.join(f'{part:.12g}' for part in albedo)} 0 0"


def _require_plain(theatre: Theatre) -> None:
    beyond = {
        "a cavity": theatre.cavity is not None and theatre.perforation > 0,
        "a gain lobe": not theatre.lambertian,
        "lamps": bool(theatre.lamps),
        "a truncated dome": theatre.dome.truncated_below is not None,
        "an ellipsoid": theatre.dome.height_ratio != 1,
        "projectors off the centre": bool(theatre.lenses),
        "an albedo map": theatre.paint is not None,
        "a black screen": min(theatre.screen_albedo) <= 0,
    }
    found = [name for name, is_there in beyond.items() if is_there]
    if found:
        raise InputError(f"what is written for Radiance cannot have {', '.join(found)}")
