"""
Solvers side by side
====================

Solve one problem by several solvers, and see what each costs.

The problem is the bundled night scene in a giant dome, weighted as in the paper. All start at
exact clipped subtraction and stop by rules of their own. One FFT is one transform of one plane.

``python docs/examples/compare_solvers.py [SIZE]`` runs it.
"""

import sys
import time
from importlib import resources

import matplotlib.pyplot as plt
import numpy as np

from compensate.methods import Solver
from compensate.pose import pose
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.weighting import PerceptualWeighting
from domesim import load_master, load_scene

size = int(sys.argv[1]) if len(sys.argv) > 1 else 128
scene = load_scene("dome_imax")
with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
    night, _ = load_master(path, scene)
nearest = np.linspace(0, night.shape[1] - 1, size).round().astype(int)
posed = pose(night[:, nearest][:, :, nearest], scene, PerceptualWeighting())

print(f"{'solver':24} {'cost':>12} {'FFTs':>6} {'seconds':>8}  certified within")
solvers: dict[str, Solver] = {
    "ADMM": ADMM(),
    "GPCG": GPCG(),
    "GPCG, frozen (the paper)": GPCG(frozen=True),
    "Accelerated": Accelerated(),
}
costs = {}
for name, solver in solvers.items():
    begin = time.perf_counter()
    result = solver(posed.problem, posed.subtractive)
    seconds = time.perf_counter() - begin
    gap = "-" if result.gap is None else f"{result.gap:.1e}"
    cost = posed.problem.cost(result.light)  # of exact pollution, whatever the solver froze
    costs[name] = (result.ffts, cost)
    print(f"{name:24} {cost:12.6g} {result.ffts:6} {seconds:8.2f}  {gap}")

# %%
# Work against what it bought, relative to the best of them. Left and low is good.
figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
best = min(cost for _, cost in costs.values())
for name, (ffts, cost) in costs.items():
    axis.plot(ffts, cost / best - 1, "o", label=name)
axis.set(xscale="log", xlabel="FFTs of planes", ylabel="cost over the best, less 1")
axis.set_yscale("symlog", linthresh=1e-5)
axis.set_ylim(0, 0.1)
axis.legend()
plt.show()
