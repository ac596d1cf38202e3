"""``domesim measure reflected``: a map of a dome's reflected light, by shifted boards."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from domesim.commands.options import Json, Overwrite, Quiet, TransportFile, finish
from domesim.errors import InputError
from domesim.host.console import Console, about
from domesim.host.numbers import decimal
from domesim.host.writing import prepare, write_together
from domesim.observation.transport import load_transport

if TYPE_CHECKING:
    from domesim.measure.dome.separated import Separated

Floats = NDArray[np.float64]

_CERTAIN = 2.0
"""Standard errors beyond which a model is called wrong."""


def reflected(
    survey: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEY",
            help="A .toml file as for measure dome, with photographs of the eight shifted boards, "
            "and of black if there is one.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            help="The map, a .csv file: reflected over direct light, its error and the model's, by "
            "place. A picture (.png) is written beside it.",
            show_default=False,
        ),
    ],
    transport: TransportFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Take direct and reflected light apart in the room itself, and check the model by that."""
    from domesim.measure.dome.file import read_survey  # noqa: PLC0415 - other commands load this
    from domesim.measure.dome.separated import modelled, separated_in, table  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    stored = None
    if transport is not None:
        with about(transport):
            stored = load_transport(transport)
    if out.suffix.lower() != ".csv":
        raise InputError(f"--out {out}: the map is a .csv file, name it so")
    picture = out.with_suffix(".png")
    task = read_survey(survey)
    prepare(
        out, picture, inputs=[survey, task.scene.file, *filter(None, [transport])],
        overwrite=overwrite,
    )  # fmt: skip
    scene = task.scene if stored is None else task.scene.with_transport(stored)
    with about(survey):
        found = separated_in(task)
    model = modelled(scene, found.places)
    content = table(scene.dome, found, model).encode()
    write_together([(out, content), (picture, _drawn(found, model))])
    figures = _figures(found, model)
    console.say(
        f"Reflected over direct light of white, mean of {len(found.ratio)} places: "
        f"{_three(found.mean)} (R, G, B), ± {_three(found.mean_error, 2)}",
        f"Model ({scene.facts()['Model']}): {_three(model.mean(0))}; {_verdict(figures)}",
        f"  -> {out}, {picture}",
    )
    finish(console, {"output": str(out), "survey": str(survey), **figures}, [])


def _figures(found: Separated, model: Floats) -> dict[str, Any]:
    off = model / found.ratio - 1
    mean = model.mean(0) / found.mean - 1
    return {
        "places": len(found.ratio),
        "ratio": found.mean.tolist(),
        "standard_error": found.mean_error.tolist(),
        "model": model.mean(0).tolist(),
        "model_off": mean.tolist(),
        "model_off_by_place": np.sqrt(np.mean(off**2, axis=0)).tolist(),
    }


def _verdict(figures: dict[str, Any]) -> str:
    """Says whether the model is what was measured."""
    off = np.array(figures["model_off"])
    error = np.array(figures["standard_error"]) / np.array(figures["ratio"])
    worst = int(np.argmax(np.abs(off) / error))
    place = max(figures["model_off_by_place"])
    told = f"{off[worst]:+.1%} in the mean, {place:.1%} by place (rms)"
    if abs(off[worst]) <= _CERTAIN * error[worst]:
        return f"within what is measured ({told})"
    return f"off by more than the measurement ({told})"


def _three(values: Floats, digits: int = 3) -> str:
    return ", ".join(decimal(float(value), digits) for value in values)


def _drawn(found: Separated, model: Floats) -> bytes:
    """A PNG of the map, green alone: measured, modelled, and the model over what was measured."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    figure = Figure((13.5, 4.6), dpi=100, layout="constrained")
    ratio, modelled = found.ratio[:, 1], model[:, 1]
    parts = {
        "measured: reflected over direct light": ratio,
        "the model's": modelled,
        "the model over what was measured": modelled / ratio,
    }
    for axes, (title, values) in zip(figure.subplots(1, 3), parts.items(), strict=True):
        low, high = np.percentile(values, (1, 99))
        shown = axes.scatter(*found.places, c=values, s=9, vmin=low, vmax=high, marker="s")
        axes.set(xlim=(-1, 1), ylim=(1, -1), aspect="equal", title=title, xlabel="front")
        axes.set_xticks([])
        axes.set_yticks([])
        figure.colorbar(shown, ax=axes)
    stored = io.BytesIO()
    figure.savefig(stored, format="png")
    return stored.getvalue()
