"""``domesim scene advise``: what a theatre should be like for a show, and what that costs."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from compensate.ruler import agreeing
from domesim.commands.options import Json, Overwrite, Quiet
from domesim.errors import InputError

if TYPE_CHECKING:
    from compensate.design import Advice, Outcome
    from domesim.frames.colour import ProjectorResponse

MOST = 4
"""Frames of a sequence that are taken: evenly spread."""


def advise(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="The scene: its name, or the path of a .toml file.",
            show_default=False,
        ),
    ],
    masters: Annotated[
        list[str],
        typer.Argument(
            metavar="MASTER...",
            help=f"Frames of the show: files, or numbered sequences, of which {MOST} frames are "
            "taken; for a pair files of two views.",
            show_default=False,
        ),
    ],
    quality: Annotated[
        float | None,
        typer.Option(
            "--quality",
            help="Quality that may be lost, JOD: what reaches it is advised.",
            show_default=False,
        ),
    ] = None,
    knob: Annotated[
        list[str] | None,
        typer.Option("--knob", help="Turn this one only; may be given again.", show_default=False),
    ] = None,
    trace: Annotated[
        bool,
        typer.Option("--trace", help="Path-trace each theatre's room (half a minute each)."),
    ] = False,
    packing: Annotated[
        str | None,
        typer.Option("--packing", help="Stereo, in one file: as for compensate."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="A plot to write, an .svg file.", show_default=False),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Tell which paint, holes, light or crosstalk would show a film better, and at what price."""
    from compensate.design import advise as advised  # noqa: PLC0415 - other commands load this
    from compensate.design import figures, knobs, left_out  # noqa: PLC0415
    from domesim.host.console import Console  # noqa: PLC0415
    from domesim.host.writing import prepare, write_whole  # noqa: PLC0415
    from domesim.scene.loading import load_scene, scene_content  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    if quality is not None and not quality > 0:
        raise InputError(f"--quality must be above 0 JOD, got {quality:g}")
    response = load_scene(scene).projector.response  # says what is wrong with the file by its name
    if out is not None:
        if out.suffix.lower() != ".svg":
            raise InputError(f"--out {out}: the plot is an .svg, name it so")
        prepare(out, inputs=[scene, *masters], overwrite=overwrite)
    content, frames = scene_content(scene), _frames(masters, packing, response)
    if unknown := left_out(content, trace=trace):
        console.say(f"{scene}: without {', '.join(unknown)}, which --trace knows")
    count = 1 + sum(len(each.values) for each in knobs(content, trace=trace))
    with console.progress("turning knobs", count) as start:
        advice = advised(content, frames, quality, trace=trace, names=knob, progress=start)
    for each in advice:
        console.say(*(f"{each.knob.name} {why}" for why in each.impossible))
    console.say(*_table(advice), *(_said(each, quality) for each in advice if quality is not None))
    if out is not None:
        write_whole(out, _plot(advice, quality))
        console.say(f"  -> {out}")
    console.figures({"scene": scene, "quality": quality, "traced": trace, "knobs": figures(advice)})


def _frames(
    masters: Sequence[str], packing: str | None, response: ProjectorResponse | None
) -> list[Any]:
    """The frames of all shows, at most `MOST` of each."""
    from domesim.host.console import about  # noqa: PLC0415
    from domesim.shows.show import find_show  # noqa: PLC0415

    frames = []
    for master in masters:
        show = find_show(master, packing=packing, response=response)
        step = max(1, -(-len(show.moments) // MOST))
        for moment in show.moments[::step]:
            with about(moment[0]):
                frames.append(show.read(moment, repair=False))
    return frames


def _table(advice: Sequence[Advice]) -> list[str]:
    lines = ["knob            value   lost, JOD   black, cd/m²   faintest star   white left"]
    for each in advice:
        for one in each.outcomes:
            star = "–" if one.star is None else f"{one.star:.1f}"
            mark = "  today" if one is each.now or one.value == each.now.value else ""
            lines.append(
                f"{each.knob.name:<13}{one.value:>8.3g}{one.lost:>12.2f}{one.black:>15.3g}"
                f"{star:>16}{one.white / each.now.white:>13.0%}{mark}"
            )
    return lines


def _said(advice: Advice, quality: float | None) -> str:
    knob, now, found = advice.knob, advice.now, advice.advised
    if found is None:
        best = advice.best
        return (
            f"{knob.name}: cannot reach {quality:g} JOD; the least is {best.lost:.2f}, at "
            f"{best.value:.3g} {knob.unit}"
        )
    if found.value == now.value:
        return f"{knob.name}: as it is ({now.lost:.2f} JOD)"
    return (
        f"{knob.name}: {found.value:.3g} {knob.unit} instead of {now.value:.3g}, {found.lost:.2f} "
        f"JOD instead of {now.lost:.2f} ({agreeing(found.lost, now.lost)}); white "
        f"{found.white / now.white:.0%} of today's"
    )


def _plot(advice: Sequence[Advice], quality: float | None) -> bytes:
    """An SVG: a row for each figure, a column for each knob."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    rows: dict[str, Callable[[Outcome, Outcome], float | None]] = {
        "quality lost, JOD": lambda one, now: one.lost,
        "black, cd/m²": lambda one, now: one.black,
        "faintest star, mag": lambda one, now: one.star,
        "white, of today's": lambda one, now: one.white / now.white,
    }
    if all(one.star is None for each in advice for one in each.outcomes):
        del rows["faintest star, mag"]
    with mpl.rc_context({"svg.hashsalt": "domesim", "font.size": 8}):
        figure = Figure((2.2 * len(advice) + 0.6, 1.7 * len(rows)), layout="constrained")
        grid = figure.subplots(len(rows), len(advice), squeeze=False, sharey="row", sharex="col")
        for col, each in enumerate(advice):
            for row, (label, figure_of) in enumerate(rows.items()):
                axes, shown = grid[row, col], each.outcomes
                drawn: list[Outcome] = sorted(
                    {*shown, *([each.advised] if each.advised else [])}, key=lambda one: one.value
                )
                axes.plot(
                    [one.value for one in drawn],
                    [figure_of(one, each.now) for one in drawn],
                    marker=".",
                )
                axes.axvline(each.now.value, color="0.6", linewidth=0.8)
                if each.advised is not None:
                    axes.plot(
                        [each.advised.value], [figure_of(each.advised, each.now)], "o", color="C1"
                    )
                if not row:
                    axes.set_title(each.knob.name)
                    if quality is not None:
                        axes.axhline(quality, color="C1", linewidth=0.8)
                if not col:
                    axes.set_ylabel(label)
                if row == len(rows) - 1:
                    axes.set_xlabel(each.knob.unit)
        memory = io.BytesIO()
        figure.savefig(memory, format="svg", metadata={"Date": None})
    return memory.getvalue()
