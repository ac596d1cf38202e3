"""
Table 1 of the paper
====================

FFTs, iterations and seconds by size, as the paper's Table 1 has them, beside the same for a dome.

The paper times stereo pairs on a GPU of 2011, and says neither what it counts as one FFT nor when
it stopped. Here each size is the bundled night scene in a giant dome, with as many pixels. So
compare how the figures change with the size, not the figures. `domesim validate --only table1` is
the experiment, in which all solvers stop at the same true error.

``python docs/examples/paper_table1.py [SIZE ...]`` runs it.
"""

import sys
import time
from importlib import resources

import matplotlib.pyplot as plt
import numpy as np

from compensate.methods import Solver
from compensate.pose import pose
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.weighting import PerceptualWeighting
from domesim import load_master, load_scene

PAPER = {213: (2636, 109, 4.1634), 469: (3684, 154, 34.3573), 671: (3992, 167, 128.4280)}

sizes = [int(size) for size in sys.argv[1:]] or [128, 213]
scene = load_scene("dome_imax")
with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
    night, _ = load_master(path, scene)

print(f"{'size':>5} {'solver':28} {'FFTs':>6} {'iterations':>10} {'seconds':>9}")
found: dict[str, list[tuple[int, int]]] = {"the paper": []}
for size in sizes:
    if size in PAPER:
        ffts, iterations, seconds = PAPER[size]
        found["the paper"].append((size, ffts))
        print(f"{size:5} {'the paper':28} {ffts:6} {iterations:10} {seconds:9.2f}")
    nearest = np.linspace(0, night.shape[1] - 1, size).round().astype(int)
    posed = pose(night[:, nearest][:, :, nearest], scene, PerceptualWeighting())
    solvers: dict[str, Solver] = {
        "GPCG, frozen pollution": GPCG(frozen=True),
        "GPCG, exact pollution": GPCG(),
        "ADMM, by its certificate": ADMM(),
    }
    for name, solver in solvers.items():
        begin = time.perf_counter()
        result = solver(posed.problem, posed.subtractive)
        seconds = time.perf_counter() - begin
        found.setdefault(name, []).append((size, result.ffts))
        print(f"{size:5} {name:28} {result.ffts:6} {result.iterations:10} {seconds:9.2f}")

# %%
# How the number of FFTs changes with the size.
figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
for name, points in found.items():
    axis.plot(*np.array(points).reshape(-1, 2).T, "o-", label=name)
axis.set(xlabel="side of the picture, pixels", ylabel="FFTs of planes", yscale="log")
axis.legend()
plt.show()
