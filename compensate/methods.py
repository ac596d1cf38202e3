"""What may be projected: the methods, by the kind of scene, with their default settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import RaisedBlack, Subtractive, Untouched
from compensate.solver.deghosting import (
    LocallyRaisedBlack,
    PerceptualSubtraction,
    PlayerShader,
)
from compensate.solver.fitting import Fitted
from compensate.solver.paper import PaperMethod
from compensate.solver.result import Result
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import DomeScene, FlatScene, Scene, StereoScene

Solver: TypeAlias = Callable[[Problem, Light], Result]

Chosen: TypeAlias = Callable[[Scene, Problem], Solver]
"""A method's solver for a problem of a scene."""


def perceptual(
    scene: Scene,
    tolerance: float = 1e-3,
    *,
    progress: Callable[[int, float], None] | None = None,
) -> Solver:
    """Makes the solver of the paper's weighting, which minimises the visible error.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    tolerance
        Certified relative gap of the cost at which to stop.
    progress
        As for `ADMM`.

    Returns
    -------
    solver
        Takes a problem and a start.
    """
    admm = ADMM(tolerance=tolerance, progress=progress)
    return Fitted(admm) if _in_a_room(scene) else admm


def _perceptual(scene: Scene, problem: Problem) -> Solver:
    return perceptual(scene)


def _locally_raised(scene: Scene, problem: Problem) -> Solver:
    rows, cols = problem.observation.shape[1:3]
    return LocallyRaisedBlack(scene.viewing.pixels_per_degree(rows, cols))


COMMON: Mapping[str, Chosen] = {
    "perceptual": _perceptual,
    "subtractive": lambda scene, problem: Subtractive(),
    "raised-black": lambda scene, problem: RaisedBlack(),
    "none": lambda scene, problem: Untouched(),
}

STEREO: Mapping[str, Chosen] = {
    "perceptual": _perceptual,
    "paper": lambda scene, problem: PaperMethod(scene.viewing, scene.projector.luminance_weights),
    "subtractive": lambda scene, problem: Subtractive(),
    "lab-subtractive": lambda scene, problem: PerceptualSubtraction(scene.projector.to_xyz),
    "raised-black": lambda scene, problem: RaisedBlack(),
    "raised-black-local": _locally_raised,
    "player-shader": lambda scene, problem: PlayerShader(scene.kept),
    "none": lambda scene, problem: Untouched(),
}

METHODS = tuple(dict.fromkeys([*COMMON, *STEREO]))
"""The names of all methods."""


def methods_of(scene: Scene) -> Mapping[str, Chosen]:
    """Returns the methods that a scene has, by name."""
    if isinstance(scene, DomeScene) or _in_a_room(scene) or scene.views > 2:
        return COMMON
    if isinstance(scene, StereoScene) and scene.table is not None:
        # These know crosstalk as one matrix
        matrix_only = ("paper", "player-shader")
        return {name: method for name, method in STEREO.items() if name not in matrix_only}
    return STEREO


def require_method(name: str, scene: Scene) -> Chosen:
    """Looks up a method of a scene.

    Parameters
    ----------
    name
        One of `METHODS`.
    scene
        The theatre, or stereo system.

    Returns
    -------
    chosen
        Takes the scene and a problem, and makes the solver.

    Raises
    ------
    InputError
        If the scene has no such method.
    """
    known = methods_of(scene)
    if name not in known:
        raise InputError(
            f"method {name!r} is not known for {scene.name}; use one of {', '.join(known)}"
        )
    return known[name]


def _in_a_room(scene: Scene) -> bool:
    """Whether lens and room of a flat screen are described."""
    return isinstance(scene, FlatScene) and scene.way is not None
