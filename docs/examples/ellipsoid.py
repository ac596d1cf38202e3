"""
A dome that is no sphere
========================

Compensate for a flattened dome: an ellipsoid of 0.7 of a hemisphere's height.

The closed form holds on a sphere alone. A scene whose dome is none is asked by radiosity instead:
once, which takes some seconds, and it is kept. Mitsuba traces the same dome at the end.

``python docs/examples/ellipsoid.py [SIZE]`` runs it.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from compensate import compensate
from domesim import load_scene, observe
from domesim.pathtrace.llvm import load_mitsuba

size = int(sys.argv[1]) if len(sys.argv) > 1 else 256
scene = load_scene("dome_hemisphere", dome={"height_ratio": 0.7}, projector={"black_cd_m2": 0.0})

# A lit window in front, in a dark sky. In the domemaster x is to the right and y down.
y, x = (np.mgrid[:size, :size] + 0.5) * 2 / size - 1
window = (np.abs(x) < 0.2) & (np.abs(y - 0.5) < 0.2)
desired = np.where(window, 0.8, 0.004)[None, ..., None] * np.ones(3)

result = compensate(desired, scene)
dark = scene.screen(size, size) & ~window
for name, light in (("untouched", desired), ("compensated", result.light)):
    more = (observe(light, scene) - desired)[0][dark].mean()
    print(f"{name}: {more:.4f} of white too much where it should be dark")
print(result.status.value)

# %%
# The light that the window adds, by Mitsuba: a mesh over directions from the middle, which is lit
# where the window is. A ray from the middle to another place meets reflected light only.
mi = load_mitsuba()  # with the LLVM that the project brings
steps = 256
down, around = np.meshgrid(np.linspace(0, np.pi / 2, steps), np.linspace(0, 2 * np.pi, steps))
far = 10 / np.hypot(np.sin(down), np.cos(down) / 0.7)  # to the ellipsoid
across, ahead = np.sin(down) * np.cos(around), np.sin(down) * np.sin(around)
corner = np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)
inwards = [corner, corner + steps + 1, corner + 1, corner, corner + steps, corner + steps + 1]
picture = mi.TensorXf(0.5 * window.astype(np.float32)[..., None].repeat(3, -1))
texture = {"type": "bitmap", "data": picture, "raw": True, "filter_type": "nearest"}

made_of = mi.Properties()
made_of["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}})
made_of["emitter"] = mi.load_dict({"type": "area", "radiance": texture})
dome = mi.Mesh("dome", steps**2, 2 * (steps - 1) ** 2, props=made_of, has_vertex_texcoords=True)
parameters = mi.traverse(dome)
places = {
    "vertex_positions": far * (across, ahead, np.cos(down)),
    "vertex_texcoords": 0.5 + down / np.pi * (np.cos(around), np.sin(around)),
}
for name, values in places.items():
    parameters[name] = values.reshape(len(values), -1).T.ravel().astype(np.float32)
parameters["faces"] = np.stack(inwards, -1).ravel().astype(np.uint32)
parameters.update()

lit = observe(np.where(window[..., None], desired / 0.8, 0), scene)
for name, angle in (("above", 0.0), ("behind", -45.0), ("at the rim", -85.0)):
    to = [0.0, np.sin(np.radians(angle)), np.cos(np.radians(angle))]
    sensor = {
        "type": "radiancemeter",
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], to, [1, 0, 0]),
        "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 1 << 16},
    }
    place = {"type": "scene", "integrator": {"type": "path"}, "dome": dome, "sensor": sensor}
    traced = np.array(mi.render(mi.load_dict(place)))[0, 0, 1]
    # Light is in units of white, which is emitted as 0.5
    row = int((1 + angle / 90) * size / 2)
    print(f"{name}: {lit[0, row, size // 2, 1]:.5f} of white, traced {traced / 0.5:.5f}")

# %%
# What is wanted and what is seen, brightened 30 times.
figure, axes = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
pictures = {
    "wanted": desired,
    "untouched": observe(desired, scene),
    "compensated": observe(result.light, scene),
}
for axis, (name, light) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(30 * light[0], 0, 1) ** (1 / 2.2))
    axis.set(title=name, xticks=(), yticks=())
plt.show()
