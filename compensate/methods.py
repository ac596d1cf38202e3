"""What may be projected: the methods, by the kind of scene, with their default settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import RaisedBlack, Subtractive, Untouched
from compensate.solver.deghosting import (
    ClippedSubtraction,
    LocallyRaisedBlack,
    PerceptualSubtraction,
    PlayerShader,
    RangeCompression,
)
from compensate.solver.paper import PaperMethod
from compensate.solver.relinearised import Relinearised
from compensate.solver.result import Result
from domesim.errors import InputError
from domesim.light import Light
from domesim.observation.grey_to_grey import Linearised
from domesim.scene import DomeScene, Scene, StereoScene

Solver: TypeAlias = Callable[[Problem, Light], Result]

Chosen: TypeAlias = Callable[[Scene, Problem], Solver]
"""A method's solver for a problem of a scene."""


def _perceptual(scene: Scene, problem: Problem) -> Solver:
    """Ours: the least visible error."""
    return Relinearised() if isinstance(problem.observation, Linearised) else ADMM()


def _locally_raised(scene: Scene, problem: Problem) -> Solver:
    rows, cols = problem.observation.shape[1:3]
    return LocallyRaisedBlack(scene.viewing.pixels_per_degree(rows, cols))


DOME: Mapping[str, Chosen] = {
    "perceptual": _perceptual,
    "subtractive": lambda scene, problem: Subtractive(),
    "raised-black": lambda scene, problem: RaisedBlack(),
    "none": lambda scene, problem: Untouched(),
}

STEREO: Mapping[str, Chosen] = {
    "perceptual": _perceptual,
    "paper": lambda scene, problem: PaperMethod(scene.viewing),
    "subtractive": lambda scene, problem: ClippedSubtraction(),
    "lab-subtractive": lambda scene, problem: PerceptualSubtraction(scene.projector.to_xyz),
    "raised-black": lambda scene, problem: RangeCompression(),
    "raised-black-local": _locally_raised,
    "player-shader": lambda scene, problem: PlayerShader(),
    "none": lambda scene, problem: Untouched(),
}

METHODS = tuple(dict.fromkeys([*DOME, *STEREO]))
"""The names of all methods."""


def methods_of(scene: Scene) -> Mapping[str, Chosen]:
    """The methods that a scene has."""
    if isinstance(scene, DomeScene):
        return DOME
    if isinstance(scene, StereoScene) and scene.table is not None:
        # These know crosstalk as one matrix
        matrix_only = ("paper", "player-shader")
        return {name: method for name, method in STEREO.items() if name not in matrix_only}
    return STEREO


def require_method(name: str, scene: Scene) -> Chosen:
    """The method of that name.

    Raises
    ------
    InputError
        If the scene has none.
    """
    known = methods_of(scene)
    if name not in known:
        raise InputError(
            f"method {name!r} is not known for {scene.name}; use one of {', '.join(known)}"
        )
    return known[name]
