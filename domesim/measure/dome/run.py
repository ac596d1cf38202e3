"""A survey from photographs, readings or both to figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.measure.dome.file import Task
from domesim.measure.dome.fit import LARGEST_MODEL_ERROR, Evidence, Known, Survey, survey
from domesim.measure.dome.model import RESOLUTION, Interreflection, nominal_albedos, surfaces_of
from domesim.measure.dome.nuisances import CAMERA, Errors, effects_of, seen_again
from domesim.measure.dome.photographs import Cells, Photographs, cells_of
from domesim.measure.dome.separated import boards_in
from domesim.measure.dome.spots import Metered, Reading, evidence_of, grey, with_readings
from domesim.room.theatre import Theatre
from domesim.scene.fields import three

Floats = NDArray[np.float64]

COARSE = 8
"""Resolution of radiosity at which noise and small effects are computed: within a percent."""
DESCRIBED_ERROR = 0.25
"""Standard error of the described albedo of a wall, or of a floor that the data do not tell, if
nothing else is said of it: it may have any paint."""


def surveyed(task: Task, known: Mapping[str, Known]) -> tuple[Cells | None, Survey]:
    """What a survey file tells, and the photographs' cells if there are photographs.

    `known` comes before what the file knows.
    """
    known = {**task.known, **known}
    theatre = task.scene.theatre
    weights = task.scene.projector.luminance_weights
    if task.photographs is not None:
        metered = None
        if task.readings:
            metered = Metered(task.readings, weights, white=task.file.unit == "camera")
        # Their fields are too fine for a cell of the screen to be clear of edges
        shots = task.photographs.only(~boards_in(task))
        return survey_of(theatre, task.patterns, shots, known, task.errors, metered=metered)
    return None, survey_of_spots(theatre, task.patterns, task.readings, known, weights)


def survey_of_spots(
    theatre: Theatre,
    patterns: Floats,
    readings: Sequence[Reading],
    known: Mapping[str, Known],
    weights: Floats,
    *,
    profile: bool = True,
) -> Survey:
    """What readings tell: the same for all primaries.

    Parameters
    ----------
    theatre, patterns, known, profile
        As for `survey_of`.
    readings
        Readings of a luminance or lux meter.
    weights
        (primary,) shares of the primaries in the luminance of white.

    Raises
    ------
    InputError
        If the theatre is beyond the model, no place on the screen was read in cd/m², or the
        readings cannot be used.
    """
    shown = grey(patterns, weights)
    seen = evidence_of(theatre, shown, readings)
    if not seen.area.any():
        raise InputError(
            "wanted readings in cd/m2 of the screen, which tell white and black, got lux alone; "
            "a lux meter's own table needs none (domesim measure patterns --dome --with lux)"
        )
    albedos = np.repeat((nominal_albedos(theatre) @ weights)[:, None], 3, 1)
    surfaces = surfaces_of(theatre)
    known = _described(known, "wall", surfaces, albedos)
    light = Interreflection(theatre, shown)
    fit = survey(light, seen, albedos, surfaces, known, profile=profile)
    if _floor_is_open(fit):
        known = _described(known, "floor", surfaces, albedos)
        held = survey(light, seen, albedos, surfaces, known, profile=profile)
        fit = held if held.complete else fit
    # The primaries are the same figures, so they are off together.
    one = fit.covariance[:1, :, :1]
    return replace(fit, covariance=np.tile(one, (3, 1, 3, 1)))


def _described(
    known: Mapping[str, Known], surface: str, surfaces: tuple[str, ...], albedos: Floats
) -> Mapping[str, Known]:
    """What is known, and a surface as it is described, if there is one and nobody knows better."""
    if surface not in surfaces or surface in known:
        return known
    value = three(albedos[surfaces.index(surface)])
    return {**known, surface: Known(value, (DESCRIBED_ERROR,) * 3, assumed=True)}


def _floor_is_open(fit: Survey) -> bool:
    """Whether the data leave the floor's albedo open, and the model explains them."""
    if "floor" not in fit.names or fit.model_error > LARGEST_MODEL_ERROR:
        return False
    return not bool(fit.answered[fit.names.index("floor")].all())


def survey_of(
    theatre: Theatre,
    patterns: Floats,
    photographs: Photographs,
    known: Mapping[str, Known],
    errors: Errors,
    *,
    metered: Metered | None = None,
    profile: bool = True,
    resolution: int = RESOLUTION,
) -> tuple[Cells, Survey]:
    """The cells of photographs, and what they tell of the theatre.

    A first fit, by coarse radiosity and without nuisances, tells how bright each cell should be and
    roughly what the albedos are. The second takes noise and nuisances' effects at these, and tells
    roughly where the camera is. The third takes effects about there.

    Parameters
    ----------
    theatre
        As it is described; its albedos are where the search starts. The wall's is taken to be
        right within `DESCRIBED_ERROR` unless it is among what is known, and so is the floor's if
        the photographs do not tell it.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    photographs
        Photographs of the patterns.
    known
        What is known of gain, screen, floor and wall.
    errors
        Errors of the description.
    metered
        Readings that there are beside the photographs.
    profile
        As for `survey`.
    resolution
        As for `Interreflection`.

    Raises
    ------
    InputError
        If the theatre is beyond the model, or the photographs or readings cannot be used.
    """
    surfaces, albedos = surfaces_of(theatre), nominal_albedos(theatre)
    light = Interreflection(theatre, patterns, resolution)
    cells = cells_of(theatre, patterns, photographs)
    known = _described(known, "wall", surfaces, albedos)
    nominal = albedos
    seen = Evidence(cells.places, photographs.pattern, cells.value, cells.variance, cells.area)

    def whole(photographed: Evidence) -> Evidence:
        if metered is None:
            return photographed
        return with_readings(photographed, theatre, patterns, metered)

    coarse = light if resolution <= COARSE else Interreflection(theatre, patterns, COARSE)
    shots, places = cells.value.shape[:2]
    first = survey(coarse, whole(seen), albedos, surfaces, known, profile=False)
    if first.complete:
        albedos = first.value[1:]
        seen = replace(seen, variance=cells.variance_at(first.modelled[:shots, :places]))

    def fitted(model: Interreflection, about: Mapping[str, float], *, tested: bool) -> Survey:
        camera, moved = seen_again(theatre, photographs.camera, cells, errors, about)
        names, effects = effects_of(theatre, camera, moved, patterns, coarse, errors, albedos)
        full = replace(
            seen,
            places=moved.places,
            names=names,
            effects=effects if names else None,
            about=np.array([about.get(name, 0.0) * name.startswith(CAMERA) for name in names]),
        )
        return survey(model, whole(full), albedos, surfaces, known, profile=tested)

    near = fitted(coarse, {}, tested=False).nuisances
    about = {name: value for name, (value, _) in near.items()}
    fit = fitted(light, about, tested=profile)
    if _floor_is_open(fit):
        known = _described(known, "floor", surfaces, nominal)
        held = fitted(light, about, tested=profile)
        fit = held if held.complete else fit
    return cells, replace(fit, residual=fit.residual[:shots, :places])
