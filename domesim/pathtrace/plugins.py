"""Mitsuba plugins that think in domemasters: a camera that takes one, a projector that throws it.

Both use the mapping of `domesim.room.dome` in a frame of their own: x to the picture's right, y to
its bottom, z along the axis (a dome's right, front and zenith). `to_world` places that frame; for a
dome it is ``look_at(origin, target=origin + zenith, up=front)``. Angles are in radians.

``domemaster``, a sensor
    ``half_angle`` (pi/2); ``eye_offset`` (0) and ``convergence`` (infinite), both in metres. Rays
    outside the circle weigh nothing. The film is square.

``fisheye_projector``, an emitter
    ``half_angle`` (pi/2), ``bitmap`` (a float `mi.Bitmap` of R, G, B) and ``filter_type``
    (``bilinear`` or ``nearest``). A picture of value v in a direction is a radiant intensity of
    v W/sr there: at distance d, and cosine c to the normal, the irradiance is v c / d². (Mitsuba's
    own ``projector`` gives pi times what its scale says.)

**Omnidirectional stereo.** A domemaster has one picture for heads that turn anywhere. For the
picture's direction d an audience in the centre turns to d; their eyes are then `eye_offset` e to
either side, at right angles to d and to the axis z their heads turn about::

    o = e (d x z)         e < 0: left eye, e > 0: right eye, |e| half the distance of the eyes
    ray from o through c d, or along d if c is infinite

This is the circular projection of Peleg, Ben-Ezra and Pritch (Omnistereo: panoramic stereo imaging,
IEEE PAMI 23(3), 2001), with a viewing circle of radius |e|. Theirs is for panoramas. On a dome a
full offset would swirl round the zenith, where "left" has no meaning; d x z is left unnormalised,
so that the circle shrinks with the sine of the angle from z and stereo fades out there. (Bourke,
Omni-directional stereoscopic fisheye images, CGAT 2009, is about such pairs in domes.) The
`convergence` c is where both eyes' pictures agree, which should be the screen: what is at infinity
then appears behind it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from domesim.errors import InputError

_registered: set[str] = set()


def register(mi: Any) -> None:
    """Make ``domemaster`` and ``fisheye_projector`` known to `mi` in its present variant.

    Parameters
    ----------
    mi
        Mitsuba as `domesim.pathtrace.llvm.load_mitsuba` gives it. More calls change nothing.
    """
    variant = mi.variant()
    if variant not in _registered:
        mi.register_sensor("domemaster", _domemaster(mi))
        mi.register_emitter("fisheye_projector", _fisheye_projector(mi))
        _registered.add(variant)


def _domemaster(mi: Any) -> Any:
    """The sensor's class; it derives from the present variant's own."""
    dr = import_module("drjit")

    class Domemaster(mi.Sensor):  # type: ignore[misc]
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.half_angle = _half_angle(properties)
            self.eye_offset = properties.get("eye_offset", 0.0)
            self.convergence = properties.get("convergence", float("inf"))
            if not self.convergence > abs(self.eye_offset):
                raise InputError(
                    f"domemaster's convergence must be beyond the eyes, {abs(self.eye_offset):g} m "
                    f"from the centre, got {self.convergence:g} m"
                )
            width, height = self.film().size()
            if width != height:
                raise InputError(f"domemaster's film must be square, got {width} x {height}")

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> Any:
            film = self.film()
            place = sample2 * mi.Vector2f(film.crop_size()) + mi.Vector2f(film.crop_offset())
            toward, inside = _direction(
                mi, dr, place / mi.Vector2f(film.size()) * 2 - 1, self.half_angle
            )
            eye = self.eye_offset * dr.cross(toward, mi.Vector3f(0, 0, 1))
            if np.isfinite(self.convergence):
                toward = dr.normalize(self.convergence * toward - eye)
            wavelengths, weight = self.sample_wavelengths(
                dr.zeros(mi.SurfaceInteraction3f), sample1, active
            )
            to_world = self.world_transform()
            ray = mi.Ray3f(
                to_world @ mi.Point3f(eye), to_world @ mi.Vector3f(toward), time, wavelengths
            )
            return ray, dr.select(inside, weight, 0.0)

        def sample_ray_differential(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> Any:
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            return (
                f"Domemaster[half_angle={self.half_angle:g}, eye_offset={self.eye_offset:g}, "
                f"convergence={self.convergence:g}]"
            )

    return Domemaster


def _fisheye_projector(mi: Any) -> Any:
    """The emitter's class; it derives from the present variant's own."""
    dr = import_module("drjit")

    class FisheyeProjector(mi.Emitter):  # type: ignore[misc]
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            if not mi.is_rgb or mi.is_polarized:
                raise InputError(
                    f"fisheye_projector wants an RGB variant of Mitsuba, got {mi.variant()}"
                )
            self.half_angle = _half_angle(properties)
            self.picture = _picture(mi, dr, properties)
            self.m_flags = mi.EmitterFlags.DeltaPosition
            self.m_needs_sample_2 = False

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Color3f(0.0)

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
            ds = dr.zeros(mi.DirectionSample3f, dr.width(it.p))
            ds.p = self.world_transform().translation()
            ds.time, ds.pdf, ds.delta = it.time, 1.0, True
            ds.emitter = mi.EmitterPtr(self)
            ds.d = ds.p - it.p
            ds.dist = dr.norm(ds.d)
            ds.d /= ds.dist
            return ds, self._intensity(-ds.d, active) / dr.square(ds.dist)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return self._intensity(-ds.d, active) / dr.square(ds.dist)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0.0)

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> Any:
            """A ray in a uniform direction of the field."""
            lowest = float(np.cos(self.half_angle))
            local = mi.warp.square_to_uniform_cone(sample3, lowest)
            to_world = self.world_transform()
            toward = to_world @ mi.Vector3f(local)
            ray = mi.Ray3f(to_world.translation(), toward, time, mi.Color0f())
            return ray, self._intensity(toward, active) * (2 * np.pi * (1 - lowest))

        def bbox(self) -> Any:
            place = self.world_transform().translation()
            return mi.ScalarBoundingBox3f([float(part[0]) for part in place])

        def to_string(self) -> str:
            return f"FisheyeProjector[half_angle={self.half_angle:g}]"

        def _intensity(self, toward: Any, active: Any) -> Any:
            """Radiant intensity in the direction `toward` of the world, W/sr."""
            local = dr.normalize(self.world_transform().inverse() @ mi.Vector3f(toward))
            theta = mi.Float(dr.safe_acos(local.z))
            ring = dr.norm(local.xy)
            radius = theta / self.half_angle
            scale = dr.select(ring > 0, radius / ring, 0.0)
            value = mi.Color3f(self.picture.eval((local.xy * scale + 1) / 2, active))
            return dr.select(active & (radius <= 1), value, 0.0)

    return FisheyeProjector


def _direction(mi: Any, dr: Any, place: Any, half_angle: float) -> tuple[Any, Any]:
    """Direction of a `place` on the picture (1 on the circle), and whether it is inside."""
    distance = dr.norm(place)
    theta = distance * half_angle
    scale = dr.select(distance > 1e-6, dr.sin(theta) / distance, half_angle)
    return mi.Vector3f(place.x * scale, place.y * scale, dr.cos(theta)), distance <= 1


def _half_angle(properties: Any) -> float:
    half_angle = float(properties.get("half_angle", np.pi / 2))
    if not 0 < half_angle <= np.pi:
        raise InputError(
            f"{properties.plugin_name()}'s half_angle must be above 0 and at most pi, "
            f"got {half_angle:g}"
        )
    return half_angle


def _picture(mi: Any, dr: Any, properties: Any) -> Any:
    """The texture (row, col, rgb); it counts from the picture's top left corner, as Dome does."""
    bitmap = properties["bitmap"]
    values = np.array(bitmap)
    if values.dtype.kind != "f" or values.ndim != 3 or values.shape[2] != 3:
        raise InputError(
            f"fisheye_projector wants a bitmap of (row, col, 3) floats, got {values.shape} of "
            f"{values.dtype}"
        )
    if values.shape[0] != values.shape[1]:
        raise InputError(f"fisheye_projector wants a square bitmap, got {values.shape}")
    filters = {"bilinear": dr.FilterMode.Linear, "nearest": dr.FilterMode.Nearest}
    name = properties.get("filter_type", "bilinear")
    if name not in filters:
        raise InputError(f"fisheye_projector's filter_type is {', '.join(filters)}, got {name!r}")
    # The texture units of a GPU round the place between two pixels to 1/256.
    return mi.Texture2f(
        mi.TensorXf(values.astype(np.float32)),
        use_accel=False,
        filter_mode=filters[name],
        wrap_mode=dr.WrapMode.Clamp,
    )
