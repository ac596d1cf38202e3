"""Uncertainty of the light that a dome with measured albedos reflects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from domesim.light.ties import root_of
from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import bare_gain, bare_transport
from domesim.observation.transport import Transport
from domesim.observation.uncertain import Step
from domesim.room.theatre import Theatre
from domesim.scene.dome_file import MeasuredSection
from domesim.scene.fields import three

Floats = NDArray[np.float64]

_RESOLUTION = 6
"""Resolution of radiosity."""
_STEP = 0.02
"""Relative step of an albedo: more than two solutions differ by for other reasons, yet linear."""
SURFACES = ("screen", "floor", "wall")


def whole_transport(theatre: Theatre) -> Transport:
    """The room's transport by radiosity; the bare screen's if there is more than that knows."""
    if not theatre.beyond_enclosure:
        return radiosity(theatre, resolution=_RESOLUTION)
    return bare_transport(theatre)


def albedo_steps(
    theatre: Theatre, measured: MeasuredSection, stored: Transport
) -> tuple[list[Step], Floats]:
    """Changes of the transport by the errors of measured albedos, for `UncertainDome`.

    In a room that radiosity does not know the screen's albedo alone scales what is `stored`.
    """
    names = [name for name in SURFACES if name in measured.parameters]
    if theatre.beyond_enclosure:
        names = names[:1]
        albedo = np.array(theatre.screen_albedo)
        gains = np.array([bare_gain(rho, theatre.dome) for rho in albedo])
        core = stored.core * (1 + _STEP * (1 + gains))[:, None, None]
        steps = [Step(stored, replace(stored, core=core), _STEP * albedo)]
    else:
        base = whole_transport(theatre)
        steps = [_stepped(theatre, base, name) for name in names]
    return steps, _factor(measured.covariance(names))


def _stepped(theatre: Theatre, base: Transport, name: str) -> Step:
    floor, wall = theatre.floor, theatre.wall
    if name == "floor":
        assert floor is not None
        size = _size(floor.albedo)
        other = replace(theatre, floor=replace(floor, albedo=three(floor.albedo + size)))
    elif name == "wall":
        assert wall is not None
        size = _size(wall.albedo)
        other = replace(theatre, wall=replace(wall, albedo=three(wall.albedo + size)))
    else:
        size = _size(theatre.screen_albedo)
        kept = 1 - theatre.perforation
        other = replace(theatre, albedo=three(theatre.albedo + size / kept))
    return Step(base, whole_transport(other), size)


def _size(albedo: tuple[float, float, float]) -> Floats:
    return np.asarray(np.maximum(_STEP * np.array(albedo), 1e-3))


def _factor(covariance: Floats) -> Floats:
    """(surface, primary, change) L with L L' = covariance, which is rounded as files are."""
    surfaces = len(covariance)
    return root_of(covariance.reshape(3 * surfaces, 3 * surfaces)).reshape(surfaces, 3, -1)
