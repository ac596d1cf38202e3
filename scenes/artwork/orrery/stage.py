"""The orrery in its hall as a Mitsuba scene.

1.0 is projector white. The sun lights the hall as if it were some 50 times brighter than it is
shown: its light has to reach the walls, and its face has to show. So it shines evenly, and
`picture` puts `Stage.faces` where it is seen. The lamps on the walls are only seen; light from so
small ones would add little but noise.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from domesim.pathtrace.solids import Triangles
from scenes.artwork.night.noise import Floats
from scenes.artwork.orrery.hall import hall
from scenes.artwork.orrery.orrery import (
    CENTRE,
    FRAME,
    SUN_RADIUS,
    Orrery,
    Placed,
    graduations,
    planet_rings,
    rails,
)
from scenes.artwork.orrery.surfaces import surface

_SUNLIGHT = 48.0 * np.array([1.0, 0.88, 0.70])
_MOONLIGHT = 0.12
_BRASS = (0.86, 0.60, 0.28)
_STEEL = (0.62, 0.64, 0.68)


@final
class Stage:
    """What stands still is made once; `at` adds what moves.

    Parameters
    ----------
    mi
        Mitsuba with a vectorised variant set.
    orrery
        What is filmed.

    Attributes
    ----------
    faces
        What glowing shapes look like: a Mitsuba texture for each of ``sun`` and ``lamp``.
    """

    def __init__(self, mi: Any, orrery: Orrery) -> None:
        self._mi, self._orrery = mi, orrery
        self._materials = {
            name: mi.load_dict({"type": "twosided", "inner": bsdf})
            for name, bsdf in _materials().items()
        }
        bodies = {placed.body.name for placed in orrery.bodies(0.0)}
        self._surfaces = {
            name: mi.load_dict({"type": "diffuse", "reflectance": self._map(name)})
            for name in sorted(bodies)
        }
        self.faces = {"sun": self._map("sun"), "lamp": mi.load_dict(_rgb((0.95, 0.62, 0.30)))}
        self._fixed = {
            material: self._solid(triangles, material) for material, triangles in hall().items()
        }
        self._fixed["rails"] = self._solid(rails(), "brass")
        band, strokes = graduations()
        self._fixed["band"] = self._solid(band, "dark band")
        self._fixed["strokes"] = self._solid(strokes, "strokes")

    def at(self, time: float) -> tuple[Any, dict[str, Any]]:
        """The scene at `time` (s), and the shapes in it that have `faces`."""
        mi = self._mi
        turn = np.eye(4)
        spin = 2 * np.pi * time / self._orrery.loop
        turn[:2, :2] = [[np.cos(spin), -np.sin(spin)], [np.sin(spin), np.cos(spin)]]
        sun = mi.load_dict(
            {
                "type": "sphere",
                "to_world": _placing(mi, CENTRE, FRAME @ turn[:3, :3], SUN_RADIUS),
                "light": {"type": "area", "radiance": _rgb(_SUNLIGHT), "sampling_weight": 6.0},
            }
        )
        scene: dict[str, Any] = {
            "type": "scene",
            "moon": {
                "type": "directional",
                "direction": [-0.62, 0.25, -0.74],
                "irradiance": _rgb(_MOONLIGHT * np.array([0.55, 0.75, 1.0])),
                "sampling_weight": 2.0,
            },
            "sun": sun,
            "machine": self._solid(self._orrery.machine(time), "brass"),
            **self._fixed,
        }
        for number, placed in enumerate(self._orrery.bodies(time)):
            scene[f"body {number}"] = {
                "type": "sphere",
                "to_world": _placing(mi, placed.centre, placed.axes, placed.body.radius),
                "bsdf": self._surfaces[placed.body.name],
            }
            if placed.body.name == "ringed":
                scene |= self._rings(placed)
        return mi.load_dict(scene), {"sun": sun, "lamp": self._fixed["lamp"]}

    def _rings(self, placed: Placed) -> dict[str, Any]:
        return {
            f"ring {number}": self._solid(triangles, f"ring {bright:g}")
            for number, (triangles, bright) in enumerate(planet_rings(placed))
        }

    def _map(self, name: str) -> Any:
        mi = self._mi
        texels = surface(name, self._orrery.seed).astype(np.float32)
        return mi.load_dict({"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True})

    def _solid(self, triangles: Triangles, material: str) -> Any:
        mi = self._mi
        properties = mi.Properties()
        properties["bsdf"] = self._materials[material]
        mesh = mi.Mesh(
            material,
            vertex_count=3 * len(triangles),
            face_count=len(triangles),
            props=properties,
        )
        buffers = mi.traverse(mesh)
        buffers["vertex_positions"] = triangles.astype(np.float32).ravel()
        buffers["faces"] = np.arange(3 * len(triangles), dtype=np.uint32)
        buffers.update()
        return mesh


def _materials() -> dict[str, dict[str, Any]]:
    def matt(red: float, green: float, blue: float) -> dict[str, Any]:
        return {"type": "diffuse", "reflectance": _rgb((red, green, blue))}

    def metal(colour: tuple[float, float, float], roughness: float) -> dict[str, Any]:
        return {
            "type": "roughconductor",
            "material": "none",
            "specular_reflectance": _rgb(colour),
            "alpha": roughness,
        }

    rings = {f"ring {bright:g}": matt(0.92 * bright, 0.82 * bright, 0.66 * bright)
             for bright in (0.30, 0.85, 0.60, 0.35)}  # fmt: skip
    return {
        "stone": matt(0.20, 0.18, 0.16),
        "recess": matt(0.030, 0.034, 0.045),
        "floor": matt(0.10, 0.09, 0.085),
        "iron": matt(0.045, 0.050, 0.055),
        "gilt": metal(_BRASS, 0.35),
        "lamp": matt(0.1, 0.1, 0.1),
        "brass": metal(_BRASS, 0.22),
        "dark band": matt(0.020, 0.022, 0.026),
        "strokes": metal(_STEEL, 0.40),
        **rings,
    }


def _placing(mi: Any, centre: Floats, axes: Floats, radius: float) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = radius * axes, centre
    return mi.ScalarTransform4f(matrix)


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(part) for part in value]}
