"""A master compensated as commands do it, with its figures."""

from __future__ import annotations

from compensate.master import Outcome, solve_frame
from compensate.methods import Solver, require_method
from compensate.pose import Eye, Stage
from domesim.frames import Master
from domesim.scene import Scene


def compensate_frame(
    frame: Master,
    scene: Scene,
    *,
    method: str = "perceptual",
    solver: Solver | None = None,
    weighting: Eye | None = None,
) -> Outcome:
    require_method(method, scene)
    posed, out_of_range = Stage(scene, weighting).pose_frame(frame)
    return solve_frame(frame, posed, out_of_range, method, solver).outcome()
