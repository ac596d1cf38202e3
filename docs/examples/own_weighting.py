"""
A weighting of your own
=======================

Say yourself how much an error matters: here the front of the dome counts four times the back.

A weighting is a linear map of the residual (what is seen minus what is desired) and its adjoint;
the sum of squares of what it returns is minimised. One that multiplies pixels is its own adjoint.

``python docs/examples/own_weighting.py [SIZE]`` runs it.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from compensate import compensate
from compensate.own import LinearWeighting, own_problem
from compensate.solver.fitting import fitting
from domesim import load_scene, observe
from domesim.light import Light

size = int(sys.argv[1]) if len(sys.argv) > 1 else 256
scene = load_scene("dome_imax")

# Rows of a domemaster go from the back (first) to the front (last) of the theatre.
importance = np.linspace(1, 4, size)[None, :, None, None]


def weigh(residual: Light) -> Light:
    """Errors, each times how much it matters."""
    return importance.astype(residual.dtype) * residual


front = LinearWeighting((1, size, size, 3), weigh, adjoint=weigh)

random = np.random.default_rng(1)
desired = (0.5 * random.random((1, size, size, 3)) ** 4).astype(np.float32)  # mostly dark
print(fitting(own_problem(desired, scene, weighting=front)).why)
result = compensate(desired, scene, weighting=front)
on = scene.screen(size, size)[None, :, :, None]
error = np.abs(observe(result.light, scene) - desired) * on
half = size // 2
print(f"mean error: back {error[:, :half].mean():.2e}, front {error[:, half:].mean():.2e} of white")
print(result.status.value)

# %%
# Where the errors lie: below is the front, which has been spared.
figure, axis = plt.subplots(figsize=(4.5, 3.5), layout="constrained")
shown = axis.imshow(error[0].mean(-1))
axis.set(title="error of what is seen, of white", xticks=(), yticks=())
figure.colorbar(shown)
plt.show()
