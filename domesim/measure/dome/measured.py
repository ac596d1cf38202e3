"""What a survey puts into a theatre's file, whichever way it was fitted."""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from domesim.scene import DomeScene
from domesim.scene.writing import as_toml

Floats = NDArray[np.float64]


class Described(Protocol):
    """What was measured: a theatre, by files.

    Attributes
    ----------
    scene, content
        The theatre as it is described, and its file as it is written.
    absolute
        Whether white is found in cd/m².
    digests
        File -> SHA-256.
    """

    @property
    def scene(self) -> DomeScene: ...  # noqa: D102
    @property
    def content(self) -> Mapping[str, Any]: ...  # noqa: D102
    @property
    def absolute(self) -> bool: ...  # noqa: D102
    @property
    def digests(self) -> Mapping[str, str]: ...  # noqa: D102


def described(task: Described, keys: Sequence[str] | None = None) -> dict[str, Any]:
    """The theatre's file as it was, for changes; all of it, or the sections of `keys`."""
    return {
        key: dict(value) if isinstance(value, Mapping) else value
        for key, value in task.content.items()
        if keys is None or key in keys
    }


def projector_section(
    task: Described, white: float, gain: Floats, ambient: Floats
) -> dict[str, Any]:
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
    if task.absolute:
        white = float(weights @ gain)
    section = {key: value for key, value in task.content["projector"].items() if key != "lumens"}
    black = max(0.0, float(weights @ ambient) * white)
    section["white_cd_m2"] = white
    if not any(lens.black for lens in task.scene.theatre.lenses):
        return {**section, "black_cd_m2": black}
    more = black / task.scene.projector.black  # their mean is measured, not what each has of it
    units = [{**each, "black_cd_m2": each["black_cd_m2"] * more} for each in section["units"]]
    return {**section, "units": units}


def measured_section(
    task: Described,
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
        "unit": "cd/m2" if task.absolute else "camera",
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


def bare_scene(
    task: Described,
    name: str,
    source: Path,
    *,
    told: str,
    albedo: Floats,
    gain: Floats,
    ambient: Floats,
    measured: Mapping[str, Any],
) -> str:
    """A scene of the bare screen that reflects as much of white as was measured.

    Parameters
    ----------
    task
        What was asked for.
    name, source
        The scene's, and the file that was read.
    told
        How it was measured, for the scene's description.
    albedo
        (primary,) of that bare screen.
    gain, ambient
        As for `projector_section`.
    measured
        Its [measured] section.
    """
    content = described(task, ("dome", "projector", "viewing", "viewpoints"))
    content["projector"] = projector_section(task, task.scene.projector.white, gain, ambient)
    return as_toml(
        {
            "name": name,
            "description": f"{task.scene.description} {told}",
            **content,
            "screen": {"albedo": numbers(np.clip(albedo, 0.0, 0.98))},
            "sources": {
                "screen.albedo": f"measured: {source.name}; not the paint's, but that of a bare "
                f"screen that reflects as much of white as the whole room does",
                **{
                    key: text
                    for key, text in task.content.get("sources", {}).items()
                    if key.startswith(("dome", "projector", "viewing", "viewpoints"))
                },
            },
            "measured": dict(measured),
        }
    )
