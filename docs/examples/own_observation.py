"""
A light pollution of your own
=============================

Compensate for a light pollution of your own: here a hazy window before the projector.

The window spreads a tenth of the light over its surroundings: seen = 0.9 x + 0.1 (x blurred). A
symmetric blur is its own adjoint. Any other map needs `adjoint` with <A x, y> = <x, A' y>;
`LinearObservation.of_matrix` takes a matrix instead, which may be sparse.

``python docs/examples/own_observation.py [SIZE]`` runs it.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter

from compensate import compensate
from compensate.own import own_problem
from compensate.solver.fitting import fitting
from domesim import load_scene
from domesim.light import Light
from domesim.observation.linear import LinearObservation

size = int(sys.argv[1]) if len(sys.argv) > 1 else 128


def hazy(light: Light) -> Light:
    """What is seen through the window."""
    sigma = size / 16
    return 0.9 * light + 0.1 * gaussian_filter(light, (0, sigma, sigma, 0), mode="constant")


window = LinearObservation((1, size, size, 3), hazy, adjoint=hazy)

# The scene says where the screen is, how bright it is and how it is looked at.
scene = load_scene("dome_imax")
desired = np.full((1, size, size, 3), 0.02)  # in double precision, which the solver needs
desired[:, size // 3 : size // 2, size // 3 : size // 2] = 0.8  # a lit square in the dark

print(fitting(own_problem(desired, scene, window)).why)
result = compensate(desired, scene, observation=window)
on = scene.screen(size, size)
for name, light in (("untouched", desired), ("compensated", result.light)):
    error = (window.observe(light) - desired)[0][on]
    print(f"{name}: error {np.sqrt(np.mean(error**2)):.2e} of white, root-mean-square")
print(result.status.value)

# %%
# What is seen of the lit square, its surroundings brightened 20 times. The haze takes light from
# the square, which cannot be brighter than white. It puts that light around, where none can be
# taken away.
figure, axes = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
pictures = {
    "wanted": desired,
    "untouched": window.observe(desired),
    "compensated": window.observe(result.light),
}
for axis, (name, light) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(20 * light[0], 0, 1) ** (1 / 2.2))
    axis.set(title=name, xticks=(), yticks=())
plt.show()
