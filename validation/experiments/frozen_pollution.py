"""Frozen pollution converges to a light that is not the minimiser.

Rationale
    The paper (section 3.4, eq. 9) keeps the pollution constant during an iteration of its solver
    and updates it afterwards. The gradient then lacks the pollution's part.
Expected
    Its fixed point costs more than the minimum of the same objective, and the more so the stronger
    the pollution: above 1e-4 of it in a dome, where exact pollution reaches any accuracy.
"""

from __future__ import annotations

import numpy as np

from compensate.master import pose
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from domesim.scene import load_scene
from validation.masters import night


def measure(size: int = 256, scene: str = "dome_imax") -> dict[str, float]:
    """Relative excess cost of GPCG with frozen and exact pollution over the certified minimum."""
    posed = pose(night(size).astype(np.float64), load_scene(scene))
    problem, start = posed.problem, posed.subtractive
    least = ADMM(tolerance=1e-7, max_iterations=600, stop_when_invisible=False)(problem, start).cost
    frozen = GPCG(frozen=True, tolerance=1e-5, max_iterations=60)(problem, start)
    exact = GPCG(tolerance=1e-5, max_iterations=60)(problem, start)
    return {
        "pollution_cd_m2": posed.pollution,
        "excess_frozen": frozen.cost / least - 1,
        "excess_exact": exact.cost / least - 1,
        "excess_subtractive": problem.cost(start) / least - 1,
    }


if __name__ == "__main__":
    for name in ("dome_planetarium", "dome_imax", "dome_hemisphere"):
        print(name, measure(scene=name))
