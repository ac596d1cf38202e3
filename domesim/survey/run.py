"""A survey from photographs to figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from domesim.survey.file import Task
from domesim.survey.fit import Evidence, Known, Survey, survey
from domesim.survey.model import Interreflection, nominal_albedos, surfaces_of
from domesim.survey.nuisances import Errors, effects_of
from domesim.survey.photographs import Cells, Photographs, cells_of
from domesim.theatre import Theatre

Floats = NDArray[np.float64]

WALL_ERROR = 0.5
"""Of a described wall's albedo, relative, if nothing else is said of it: little of it is seen."""


def surveyed(task: Task, known: Mapping[str, Known]) -> tuple[Cells, Survey]:
    """What the photographs of a survey file tell; `known` comes before what the file knows."""
    return survey_of(
        task.scene.theatre,
        task.patterns,
        task.photographs,
        {**task.known, **known},
        task.errors,
    )


def survey_of(
    theatre: Theatre,
    patterns: Floats,
    photographs: Photographs,
    known: Mapping[str, Known],
    errors: Errors,
    *,
    profile: bool = True,
) -> tuple[Cells, Survey]:
    """The cells of photographs, and what they tell of the theatre.

    Parameters
    ----------
    theatre
        As it is described; its albedos are where the search starts, and the wall's is taken to be
        right within `WALL_ERROR` unless it is among what is known.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    photographs
        Of them.
    known
        Of gain, screen, floor and wall.
    errors
        Of the description.
    profile
        As for `survey`.

    Raises
    ------
    InputError
        If the theatre is beyond the model, or the photographs cannot be used.
    """
    surfaces, albedos = surfaces_of(theatre), nominal_albedos(theatre)
    light = Interreflection(theatre, patterns)
    cells = cells_of(theatre, patterns, photographs)
    names, effects = effects_of(theatre, photographs.camera, cells, patterns, light, errors)
    if "wall" in surfaces and "wall" not in known:
        x, y, z = (float(value) for value in albedos[surfaces.index("wall")])
        spread = WALL_ERROR * x, WALL_ERROR * y, WALL_ERROR * z
        known = {**known, "wall": Known((x, y, z), spread)}
    evidence = Evidence(
        cells.places,
        photographs.pattern,
        cells.value,
        cells.variance,
        cells.area,
        names,
        effects if names else None,
    )
    return cells, survey(light, evidence, albedos, surfaces, known, profile=profile)
