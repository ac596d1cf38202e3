"""What a survey found: lines for a person, figures for a program, a picture, and a scene file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.host.numbers import decimal
from domesim.measure.dome.file import Task
from domesim.measure.dome.fit import GAIN, Survey
from domesim.measure.dome.measured import described, measured_section, numbers, projector_section
from domesim.measure.dome.photographs import Cells
from domesim.observation.uncertain import SIGMAS
from domesim.scene.writing import as_toml

Floats = NDArray[np.float64]


def lines_of(task: Task, survey: Survey) -> list[str]:
    """What was found, for a person."""
    lines = [] if task.registered is None else [task.registered.in_words()]
    unit = "cd/m²" if task.absolute else "of the photographs' unit"
    for name, value, error, answered in zip(
        survey.names, survey.value, survey.error, survey.answered, strict=True
    ):
        parts = [
            f"{p} {decimal(v, 4)} ± {decimal(SIGMAS * e, 2)}" if good else f"{p} not determined"
            for p, v, e, good in zip("RGB", value, error, answered, strict=True)
        ]
        what = f"white, direct light alone ({unit})" if name == GAIN else f"{name} albedo"
        share = task.scene.theatre.perforation if name == "screen" else 0.0
        holes = f", its holes counted in ({share:.0%} of it)" if share else ""
        lines.append(f"{what}{holes}: {', '.join(parts)}")
        if share and answered.all():
            kept = 1 - share
            lines.append(
                "  of the paint between the holes: "
                + ", ".join(
                    f"{p} {decimal(v / kept, 4)} ± {decimal(SIGMAS * e / kept, 2)}"
                    for p, v, e in zip("RGB", value, error, strict=True)
                )
            )
    if survey.answered[0].all():
        parts = [
            f"{p} {decimal(v)} ± {decimal(SIGMAS * e, 1)}"
            for p, v, e in zip("RGB", survey.ambient, survey.ambient_error, strict=True)
        ]
        lines.append(f"black as it is seen, of white: {', '.join(parts)}")
    verdict = "noise alone explains the residuals"
    if not survey.plausible:
        verdict = (
            f"more than noise: each place is off by another {survey.model_error:.2%}, which the "
            f"intervals have been widened for"
        )
    lines.append(f"fit: chi² {survey.chi2:.0f} for {survey.degrees} degrees of freedom; {verdict}")
    for name, assumed in survey.leaning.items():
        values = ", ".join(f"{p} {decimal(v)}" for p, v in zip("RGB", assumed.value, strict=True))
        lines.append(
            f"{name} albedo: the photographs tell little of it; it was taken to be {values} as "
            f"described, ± {decimal(SIGMAS * max(assumed.error), 2)}. If you know better: --hold "
            f"{name}=VALUE,ERROR"
        )
    lines += [f"check the description: {line}" for line in survey.doubts]
    return lines + [f"not told apart: {line}" for line in survey.confusions]


def figures_of(survey: Survey) -> dict[str, Any]:
    """The same for a program; what is not answered is null."""

    def table(values: Floats, answered: NDArray[np.bool_]) -> dict[str, list[float | None]]:
        return {
            name: [float(v) if good else None for v, good in zip(row, goods, strict=True)]
            for name, row, goods in zip(survey.names, values, answered, strict=True)
        }

    return {
        "values": table(survey.value, survey.answered),
        "standard_errors": table(survey.error, np.ones_like(survey.answered)),
        "correlations": survey.correlations.tolist(),
        "ambient_of_white": survey.ambient.tolist(),
        "ambient_standard_error": survey.ambient_error.tolist(),
        "chi2": survey.chi2,
        "degrees_of_freedom": survey.degrees,
        "model_error": survey.model_error,
        "nuisances": {name: list(pair) for name, pair in survey.nuisances.items()},
        "doubts": list(survey.doubts),
        "assumed": {
            name: {"value": list(what.value), "standard_error": list(what.error)}
            for name, what in survey.leaning.items()
        },
        "undetermined": list(survey.confusions),
    }


def measured_scene(task: Task, fit: Survey, name: str, survey: Path) -> str:
    """The theatre's file with what was found in it.

    Raises
    ------
    ValueError
        If not everything is answered.
    """
    if not fit.complete:
        raise ValueError("a scene needs all of its figures answered")
    scene = task.scene
    values = dict(zip(fit.names, fit.value, strict=True))
    content = described(task)
    content["name"] = name
    content["description"] = f"{scene.description} As measured: {survey.name}."
    kept = 1 - scene.theatre.perforation
    content["screen"]["albedo"] = numbers(values["screen"] / kept)
    for surface in ("floor", "wall"):
        if surface in values:
            content[surface]["albedo"] = numbers(values[surface])
    white = scene.projector.white
    if "lumens" in content["projector"]:
        weights = scene.projector.luminance_weights
        white *= float(weights @ values["screen"] / (weights @ scene.theatre.screen_albedo))
    content["projector"] = projector_section(task, white, values[GAIN], fit.ambient)
    content["ambient"] = {"luminance_cd_m2": 0.0}
    content.pop("lamps", None)
    measured = ", ".join(f"{surface}.albedo" for surface in fit.names[1:])
    content["sources"] = {
        **{
            key: text
            for key, text in content.get("sources", {}).items()
            if not key.startswith(("screen.albedo", "floor", "wall", "lamps"))
        },
        f"{measured}, projector.black_cd_m2": f"measured: {survey.name}",
    }
    content["measured"] = measured_section(
        task,
        survey,
        names=fit.names,
        values=fit.value,
        errors=fit.error,
        correlations=fit.correlations,
        chi2=fit.chi2,
        degrees=fit.degrees,
        model_error=fit.model_error,
    )
    return as_toml(content)


def residual_picture(cells: Cells, survey: Survey) -> NDArray[np.uint8]:
    """(row, col, RGB): residuals of each photograph beside each other; red is brighter than model.

    The strongest colour is five standard errors, in the second primary; grey is what was left out.
    """
    from matplotlib import colormaps  # noqa: PLC0415 (slow)

    colours = colormaps["RdBu_r"]
    pictures = []
    for residual in survey.residual[..., 1]:
        shown = np.full((*cells.label.shape, 3), 0.5)
        used = cells.label >= 0
        shown[used] = colours(np.clip(0.5 + residual / 10, 0, 1))[cells.label[used], :3]
        pictures.append(shown)
    return np.asarray(np.round(np.concatenate(pictures, 1) * 255), np.uint8)
