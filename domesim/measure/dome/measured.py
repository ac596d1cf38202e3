"""What a survey puts into a theatre's file, whichever way it was fitted."""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.measure.dome.file import Task

Floats = NDArray[np.float64]


def described(task: Task, keys: Sequence[str] | None = None) -> dict[str, Any]:
    """The theatre's file as it was, for changes; all of it, or the sections of `keys`."""
    return {
        key: dict(value) if isinstance(value, Mapping) else value
        for key, value in task.content.items()
        if keys is None or key in keys
    }


def projector_section(task: Task, white: float, gain: Floats, ambient: Floats) -> dict[str, Any]:
    """The projector with its measured black, and white in cd/m² instead of lumens.

    Parameters
    ----------
    task
        What was asked for.
    white
        As it is on this screen if the survey does not tell, cd/m².
    gain
        (primary,) white as it is seen, in the survey's unit.
    ambient
        (primary,) black as it is seen, of white.
    """
    weights = task.scene.projector.luminance_weights
    if task.file.absolute:
        white = float(weights @ gain)
    section = {key: value for key, value in task.content["projector"].items() if key != "lumens"}
    black = max(0.0, float(weights @ ambient) * white)
    return {**section, "white_cd_m2": white, "black_cd_m2": black}


def measured_section(
    task: Task,
    survey: Path,
    *,
    names: Sequence[str],
    values: Floats,
    errors: Floats,
    correlations: Floats,
    chi2: float,
    degrees: int,
    model_error: float,
) -> dict[str, Any]:
    """What was measured, how surely, and from which files.

    Parameters
    ----------
    task, survey
        What was asked for, and the file that did.
    names
        Names of the parameters.
    values, errors
        (parameter, primary) and their standard errors.
    correlations
        (primary and parameter, the same) of them.
    chi2, degrees, model_error
        Figures of the fit: chi², degrees of freedom, and the error of the model.
    """
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "survey": survey.name,
        "unit": "cd/m2" if task.file.absolute else "camera",
        "parameters": list(names),
        "chi2": chi2,
        "degrees_of_freedom": degrees,
        "model_error": model_error,
        "values": {name: numbers(row) for name, row in zip(names, values, strict=True)},
        "standard_errors": {name: numbers(row) for name, row in zip(names, errors, strict=True)},
        "correlations": {
            f"{primary} {name}": [float(f"{value:.5f}") for value in row]
            for (primary, name), row in zip(
                itertools.product("RGB", names), correlations, strict=True
            )
        },
        "sha256": dict(task.digests),
    }


def numbers(values: Floats) -> list[float]:
    """Rounds to the digits that are worth writing down."""
    return [float(f"{value:.8g}") for value in values]
