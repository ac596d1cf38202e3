"""Circularly polarised light in a 3D dome, path traced with Mitsuba: all reflections, Stokes I, V.

One lens behind its filter lights the screen of a bare dome evenly in all directions, as
`domesim.pathtrace.polarised` does a flat one; Mueller matrices are carried along the paths. `paint`
is Lambertian and keeps a share of circular polarisation, with the Mueller matrix diag(1, 0, 0, k):
k < 0 turns the hand, as metal does. `silver` is the flat cinema's blend of facets and of paint that
forgets.

This is what `domesim.observation.dome_pair` is checked against: intensities are how the sum of both
views is seen, circular parts how their difference is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.polarised import around, arriving, leaking, polarised, retarder, silver
from domesim.pathtrace.tracer import interruptible
from domesim.room.dome import Dome
from domesim.stereo.system import CircularFilter, Point, SilverScreen

_Floats = NDArray[np.float64]
_LENS_RADIUS = 0.05
_REFLECTIONS = 60
_NAME = "domesim_polarised_paint"
_BLACK = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.0}}


@final
@dataclass(frozen=True)
class Arriving:
    """Light that comes from places of the screen.

    Attributes
    ----------
    direct, all
        (place, 2) intensity and circular part, after one reflection and after all, for a lens that
        sends an intensity of 1 per steradian and polarisation before the filter.
    error
        (place, 2) standard errors of `all`.
    """

    direct: _Floats
    all: _Floats
    error: _Floats


def polarised_dome(
    dome: Dome,
    paint: tuple[float, float] | SilverScreen,
    lens: Point,
    eye: Point,
    points: _Floats,
    *,
    samples: int = 64,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Arriving:
    """Trace light from a lens to an eye, by way of places on a spherical screen.

    Parameters
    ----------
    dome
        The screen, in the frame of the dome.
    paint
        (albedo, k), or the facets and paint of a silver screen.
    lens, eye
        Where they are, m, in the dome's frame; above the rim.
    points
        (place, xyz) on the screen, m.
    samples
        Paths to the place.
    seed
        Of the random numbers.
    progress
        Told the share that is done.

    Raises
    ------
    InputError
        If there are fewer than 2 samples, or Mitsuba cannot trace polarised light here.
    KeyboardInterrupt
        After Ctrl-C.
    """
    if samples < 2:
        raise InputError(f"polarised_dome needs at least 2 samples for its error, got {samples}")
    glass = CircularFilter("left")
    with polarised() as mi, interruptible() as interrupted:
        mi.register_bsdf(_NAME, _paint(mi))
        surface: dict[str, Any] = {"type": _NAME}
        if isinstance(paint, SilverScreen):
            surface = {"type": "twosided", "bsdf": silver(paint)}
        else:
            surface["albedo"], surface["kept"] = paint
        height = float(dome.radius * np.cos(dome.half_angle))
        rim = mi.ScalarTransform4f().translate([0, 0, height])
        extent = mi.ScalarTransform4f().scale(float(dome.radius * np.sin(dome.half_angle)))
        scene = mi.load_dict(
            {
                "type": "scene",
                "screen": {
                    "type": "sphere",
                    "radius": dome.radius,
                    "flip_normals": True,
                    "bsdf": surface,
                },
                # What leaves the dome does not come back
                "opening": {"type": "disk", "to_world": rim @ extent, "bsdf": _BLACK},
                "lamp": {"type": "point", "position": list(lens), "intensity": 1.0},
                "polariser": around(lens, _LENS_RADIUS / 2, leaking(glass)),
                "retarder": around(lens, _LENS_RADIUS, retarder(glass)),
            }
        )
        parts = []
        for depth, count in ((2, 1), (_REFLECTIONS, samples)):
            integrator = mi.load_dict({"type": "volpath", "max_depth": depth, "rr_depth": depth})
            each = []
            for k in range(count):
                stokes = arriving(mi, integrator, scene, eye, points, seed * samples + k)
                each.append(stokes[[0, 3]].T)
                if progress is not None:
                    progress((k + 1) / count)
                if interrupted():
                    raise KeyboardInterrupt
            parts.append(np.stack(each))
    (direct,), every = parts
    return Arriving(direct, every.mean(axis=0), every.std(axis=0, ddof=1) / np.sqrt(samples))


def _paint(mi: Any) -> Any:
    """The BSDF's class; it derives from the present variant's own."""
    dr = import_module("drjit")
    lobe = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide

    class Paint(mi.BSDF):  # type: ignore[misc]
        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            self.albedo = properties.get("albedo", 0.5)
            self.kept = properties.get("kept", 0.0)
            self.m_components, self.m_flags = [lobe], lobe

        def _mueller(self, value: Any) -> Any:
            # The same in all axes: no Q and U
            matrix = mi.Spectrum(0.0)
            matrix[0, 0], matrix[3, 3] = value, value * self.kept
            return matrix

        def sample(self, context: Any, si: Any, one: Any, two: Any, active: Any = True) -> Any:
            above = mi.warp.square_to_cosine_hemisphere(two)
            sampled = dr.zeros(mi.BSDFSample3f)
            side = dr.select(mi.Frame3f.cos_theta(si.wi) > 0, 1.0, -1.0)
            sampled.wo = mi.Vector3f(above.x, above.y, side * above.z)
            sampled.pdf = mi.warp.square_to_cosine_hemisphere_pdf(above)
            sampled.eta = 1.0
            sampled.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            return sampled, self._mueller(dr.select(active, mi.Float(self.albedo), 0.0))

        def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self._mueller(self.albedo * self.pdf(context, si, wo, active))

        def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            cosine = mi.Frame3f.cos_theta(wo)
            same = mi.Frame3f.cos_theta(si.wi) * cosine > 0
            return dr.select(active & same, dr.abs(cosine) / np.pi, 0.0)

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

        def to_string(self) -> str:
            return f"Paint[albedo={self.albedo:g}, kept={self.kept:g}]"

    return Paint
