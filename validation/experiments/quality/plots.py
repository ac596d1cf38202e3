"""Diagrams: gains of each input, and quality against pollution."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from validation import drawing
from validation.experiment import Plot
from validation.experiments.quality.gains import VISIBLE, gains, quality
from validation.experiments.quality.inputs import PAIRED, Input, kinds
from validation.experiments.quality.judging import Cells
from validation.experiments.quality.ways import CHOSEN, MAIN, WAYS
from validation.statistics import estimate


def drawn(cells: Cells, wanted: Mapping[str, Input]) -> Iterator[Plot]:
    """Gains by input, and quality against pollution."""
    names = [name for name in wanted if name in gains(cells, CHOSEN)]

    def draw(axes: Any) -> None:
        for offset, way in enumerate(("uniform 0.1", "uniform 0.3", CHOSEN)):
            by_input = gains(cells, way)
            found = estimate(by_input.values())
            heights = [row + 0.2 * (offset - 1) for row in range(len(names) + 1)]
            colour = drawing.COLOURS[offset]
            axes.plot(
                [by_input[name] for name in names],
                heights[:-1],
                marker="o",
                linestyle="",
                color=colour,
                label=WAYS[way].title,
            )
            axes.plot([found.low, found.high], [heights[-1]] * 2, color=colour, linewidth=2.5)
            axes.plot([found.mean], heights[-1:], marker="D", color=colour)
        axes.axvline(0, color="#666666", linewidth=0.8)
        axes.set_yticks(range(len(names) + 1), [*names, "mean, 95 %"])
        axes.invert_yaxis()
        axes.set_xlabel("gain over subtraction, JOD")
        drawing.legend_beside(axes)

    yield drawing.plot(
        f"Gain over subtraction where that is seen (JOD < {VISIBLE:g}), by input, and its mean "
        f"with Student's 95 % interval over inputs.",
        "Gain in JOD of three perceptual methods over subtraction for every input.",
        draw,
        size=(7.0, 3.8),
    )
    for kind, of_kind in kinds(wanted).items():
        yield _against_pollution(cells, kind, of_kind)


def _against_pollution(cells: Cells, kind: str, names: Sequence[str]) -> Plot:
    pollutions = sorted({pollution for name, pollution, _ in cells if name in names})
    what = "crosstalk" if kind == PAIRED else "albedo"

    def draw(axes: Any) -> None:
        for way, one in MAIN.items():
            means = [
                np.mean(
                    [
                        quality(ways[way])
                        for (name, there, _), ways in cells.items()
                        if name in names and there == pollution
                    ]
                )
                for pollution in pollutions
            ]
            axes.plot(
                pollutions,
                means,
                marker="o",
                linewidth=2.5 if way == CHOSEN else 1.2,
                color="#999999" if way == "none" else None,
                label=one.title,
            )
        axes.set_xlabel(what)
        axes.set_ylabel("ColorVideoVDP, JOD")
        drawing.legend_beside(axes)

    return drawing.plot(
        f"Quality against {what}: means of {len(names)} {kind} over all luminances.",
        f"JOD of each method over {what}, for {kind}.",
        draw,
        size=(7.0, 3.5),
    )
