"""What is left in rooms that are known, to compare with what was foreseen."""

from __future__ import annotations

import numpy as np
from pairs import pair

from compensate.figures import Appraisal
from compensate.foresight import Interval
from compensate.pose import Posed, pose
from domesim.light import Light
from domesim.observation.base import Observation
from domesim.scene import Scene


def night(scene: Scene, rows: int, cols: int, lift: float = 0.0) -> Light:
    light = pair(rows, cols, dtype=np.float32)[: scene.views]
    light = lift + (1 - lift) * light
    return light * scene.screen(rows, cols)[None, :, :, None].astype(np.float32)


def posed_in(scene: Scene, desired: Light) -> Posed:
    return pose(desired, scene)


def left(posed: Posed, light: Light, room: Observation) -> tuple[float, float]:
    """What is left in a room: rms light over the screen, and visible error."""
    residual = room.observe(light) - posed.problem.desired
    areas = posed.setting.areas * posed.screen
    areas = areas / areas.sum()
    judge = posed.setting.judge
    squares = np.einsum("rc,vrcp->vp", areas, residual.astype(np.float64) ** 2)
    error = Appraisal(posed)._in_differences(judge.energy(residual), judge)
    return float(np.sqrt(squares.mean())), error


def held(intervals: list[Interval], values: list[float]) -> float:
    inside = [one.low <= value <= one.high for one, value in zip(intervals, values, strict=True)]
    return float(np.mean(inside))
