"""
A dome of two albedos
=====================

Compensate for a dome by an observation of your own: 200° of screen, half of which was painted anew.
A scene's `screen.albedo_map` says the same without a program, and more: floor, walls, furniture.

On a sphere every place receives the same reflected light, whatever its own albedo. With rho a
pixel's albedo, a its area, and x the light that is projected, as seen on a screen of albedo 0.5:

    seen = rho / 0.5 (x + s),        s = sum(rho a x) / (4 pi r² - sum(rho a))

That is an observation of rank one. Mitsuba traces the same dome at the end.

``python docs/examples/two_albedos.py [SIZE]`` runs it.
"""

import sys
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from compensate import compensate
from domesim import load_scene
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.pathtrace.llvm import load_mitsuba

size = int(sys.argv[1]) if len(sys.argv) > 1 else 256
scene = load_scene(
    {
        "name": "repainted",
        "description": "A dome of 200 degrees, half of it darker.",
        "dome": {"radius_m": 10.0, "half_angle_deg": 100.0},
        "screen": {"albedo": 0.5},
        "projector": {"primaries": "BT.709", "white_cd_m2": 15.0, "black_cd_m2": 0.0},
        "viewing": {"adaptation_cd_m2": 1.5},
    }
)

# The dome, in domemaster coordinates: x to the right, y down, and the angle around the zenith.
y, x = (np.mgrid[:size, :size] + 0.5) * 2 / size - 1
around, down = np.arctan2(y, x) / (2 * np.pi) % 1, np.hypot(x, y) * 100 / 180
rho = np.where((around > 0.25) & (around < 0.75), 0.3, 0.6)
screen = scene.screen(size, size)
areas = scene.pixel_areas(size, size)
areas = areas / areas.sum() * 2 * np.pi * 10**2 * (1 - np.cos(np.radians(100)))

factors = LowRank(
    direct_gain=np.where(screen, rho / 0.5, 1.0),
    spread=(rho / 0.5 * screen)[None],
    core=np.full((3, 1, 1), 1 / (4 * np.pi * 10**2 - np.sum(rho * areas))),
    collect=(rho * areas)[None],
    ambient=np.zeros((3, size, size)),
)
dome = LowRankObservation(factors, screen)

# A lit window in the repainted half of a dark sky.
desired = np.full((1, size, size, 3), 0.004) * screen[..., None]
desired[0, (around > 0.4) & (around < 0.6) & (down > 0.2) & (down < 0.4)] = 0.5

result = compensate(desired, scene, observation=dome)
for name, light in (("untouched", desired), ("compensated", result.light)):
    dark = (dome.observe(light) - dome.direct(desired))[0][screen & (desired[0, ..., 0] < 0.1)]
    print(f"{name}: {dark.mean():.4f} of white too much where it should be dark")
print(result.status.value)

# %%
# The light that the window adds to both halves, by Mitsuba. Its light is emitted from the screen,
# so that a ray from the middle to another place meets reflected light only.
mi = load_mitsuba()  # with the LLVM that the project brings
v, u = (np.mgrid[:360, :360] + 0.5) / 360  # angle from the zenith, and around it
window = (u > 0.4) & (u < 0.6) & (v > 0.2) & (v < 0.4)
albedo = np.where((u > 0.25) & (u < 0.75), 0.3, 0.6)


def on_sphere(values: NDArray[Any]) -> dict[str, Any]:
    """A texture of (v, u)."""
    picture = mi.TensorXf(np.repeat(values.astype(np.float32)[..., None], 3, axis=-1))
    return {"type": "bitmap", "data": picture, "raw": True, "filter_type": "nearest"}


def painted() -> dict[str, Any]:
    """The dome, lit where the window is."""
    paint = {"type": "diffuse", "reflectance": on_sphere(albedo)}
    return {
        "type": "sphere",
        "radius": 10.0,
        "flip_normals": True,
        "bsdf": {"type": "mask", "opacity": on_sphere(v < 100 / 180), "inner": paint},
        "emitter": {"type": "area", "radiance": on_sphere(albedo * window)},
    }


lit = dome.observe(np.where(desired > 0.1, desired, 0))
for name, angle in (("repainted", 0.3), ("old", 0.9)):
    to = [np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle), 1.0]
    sensor = {
        "type": "radiancemeter",
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], to, [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 1 << 16},
    }
    place = {"type": "scene", "integrator": {"type": "path"}, "dome": painted(), "sensor": sensor}
    traced = np.array(mi.render(mi.load_dict(place)))[0, 0, 1]
    at = np.argmin(np.abs(around - angle) + np.abs(down - 0.25) + ~screen)
    print(f"{name} half: {lit[0, ..., 1].ravel()[at]:.5f} of white, traced {traced:.5f}")

# %%
# What is wanted and what is seen, brightened 30 times. The repainted half is darker, lit or not.
figure, axes = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
pictures = {
    "wanted": dome.direct(desired),
    "untouched": dome.observe(desired),
    "compensated": dome.observe(result.light),
}
for axis, (name, light) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(30 * light[0], 0, 1) ** (1 / 2.2))
    axis.set(title=name, xticks=(), yticks=())
plt.show()
