"""The region of a pair where most of a ghost is left, large enough to be looked at."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from scipy.ndimage import gaussian_filter

from compensate.pose import Posed
from compensate.problem import Problem
from compensate.solve import solved
from compensate.solver.gpcg import GPCG
from compensate.solver.paper import PaperMethod
from compensate.solver.result import Result
from compensate.weighting import REGULARISATION
from domesim.light import Light
from domesim.scene import Scene, StereoScene
from testing.pairs import averaged, generated
from validation.data import from_data, present
from validation.drawing import panel, pictures
from validation.experiment import (
    Panel,
    Pictures,
    Work,
)
from validation.judges import luminance

GENERATED = "generated"

EYES = ("left", "right")

REGION = 0.25
"""Width and height of the region, in widths of the picture; the height 9/16 of it."""

SHOWN = 300
"""Least width of a picture on the page, pixels."""

BRIGHTEST = 12
"""Largest factor by which a region is brightened; bright regions get less."""


def pair(name: str, width: int, scene: StereoScene, seed: int = 0) -> Light:
    """A pair about `width` pixels wide, in float64.

    Raises
    ------
    Missing
        If it is of the test data, which is not there.
    """
    if name == GENERATED:
        return generated(width, seed).astype(np.float64)
    light, _ = from_data(name, scene)
    times = max(1, round(light.shape[2] / width))
    return averaged(light, times).astype(np.float64)


def listed(names: Iterable[str]) -> str:
    """The names of pairs, in words."""
    return ", ".join("a generated night" if name == GENERATED else name for name in names)


def project(posed: Posed, method: str) -> Light:
    """What a method projects; the paper's with the product's regulariser."""
    if method != "paper":
        return solved(posed, method).light
    solver = cast("GPCG", _regularised)
    scene = posed.scene
    paper = PaperMethod(scene.viewing, scene.projector.luminance_weights, solver)
    return solved(posed, method, paper).light


def _regularised(problem: Problem, start: Light) -> Result:
    kept = Problem(
        problem.observation,
        problem.weighting,
        problem.desired,
        (problem.lower, problem.upper),
        anchor=start,
        regularisation=REGULARISATION,
    )
    return GPCG(frozen=True, max_iterations=60)(kept, start)


def uncorrectable(posed: Posed) -> tuple[slice, slice]:
    """Rows and cols of the region where subtraction leaves most of a ghost."""
    rows, cols = posed.screen.shape
    wide = round(REGION * cols)
    high = min(rows, round(wide * 9 / 16))
    left = luminance(posed.seen(posed.subtractive) - posed.wanted, posed.scene)
    # What is in the middle counts most, so that the ghost is not at the region's edge
    energy = gaussian_filter(np.sum(left**2, axis=0), (high / 4, wide / 4), mode="constant")
    # Where the whole region is in the picture
    inner = energy[high // 2 : rows - (high - 1) // 2, wide // 2 : cols - (wide - 1) // 2]
    top, first = np.unravel_index(int(np.argmax(inner)), inner.shape)
    return slice(int(top), int(top) + high), slice(int(first), int(first) + wide)


def ghosted_eye(posed: Posed, region: tuple[slice, slice]) -> int:
    """The eye to which subtraction leaves more of the ghost in a region: 0 is the left one."""
    left = luminance(posed.seen(posed.subtractive) - posed.wanted, posed.scene)
    return int(np.argmax(np.sum(left[:, region[0], region[1]] ** 2, axis=(1, 2))))


def panels(
    caption: str, lights: Mapping[str, Light], scene: Scene, *, brighter: float, eye: str
) -> Pictures:
    """Pictures of an eye's view, large enough to be looked at, brightened by a factor."""
    shown = {title: _enlarged(light) for title, light in lights.items()}
    drawn = pictures(caption, shown, scene, brightest=1 / brighter)
    return Pictures(
        caption=caption,
        panels=tuple(replace(one, alt=f"{eye}: {one.title}") for one in drawn.panels),
    )


def closeup(title: str, light: Light, scene: Scene, *, brighter: float) -> Panel:
    """One picture of an eye's view, large enough to be looked at, brightened by a factor."""
    what = "Domemaster" if scene.views == 1 else "Left eye's region"
    return panel(title, _enlarged(light), scene, what=what, brightest=1 / brighter)


def _enlarged(light: Light) -> Light:
    times = max(1, -(-SHOWN // light.shape[2]))
    return np.asarray(light).repeat(times, axis=1).repeat(times, axis=2)


def exposure(region: Light, scene: Scene) -> int:
    """Factor by which to brighten a region, so that half of it is below mid-grey."""
    return int(np.clip(0.2 / max(np.median(luminance(region, scene)), 1e-6), 1, BRIGHTEST))


def looked_at(work: Work, data: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Pairs, those of the test data in full runs only, and what is left out."""
    if work.quick:
        return (GENERATED,), ("The test data's pairs: they take minutes.",)
    found, left_out = present(data)
    return (GENERATED, *found), tuple(left_out)
