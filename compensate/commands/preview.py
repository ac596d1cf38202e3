"""``domesim preview``: a film for whoever decides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, final

import typer

from compensate.shows.previewing import Brightness, Previewing, write_preview
from domesim.commands.options import Overwrite, Place, Telling, grouped
from domesim.commands.shows import Masters, require_one_seat
from domesim.errors import InputError
from domesim.frames.containers import pyav
from domesim.frames.video import video_of
from domesim.host.writing import note_written, prepare
from domesim.shows.checksums import sha256
from domesim.shows.film import timing_asked
from domesim.shows.run import Running


@final
@dataclass(frozen=True)
class Showing:
    """What the film shows."""

    out: Annotated[Path, typer.Option("--out", help="The film, .mp4.", show_default=False)]
    frames: Annotated[
        str | None, typer.Option(help="Frames of a sequence to show, such as '1-36000x10'.")
    ] = None
    fps: Annotated[
        float | None,
        typer.Option(help="Frames a second, instead of the master's.", show_default=False),
    ] = None
    wipe: Annotated[
        bool,
        typer.Option(
            "--wipe", help="One picture, untouched beside compensated, divided by a moving line."
        ),
    ] = False
    display: Annotated[
        float | None,
        typer.Option(
            help="White of the display that shows the film, cd/m²: light is then what it is in "
            "the theatre. By default the theatre's white is the film's.",
            show_default=False,
        ),
    ] = None
    exposure: Annotated[
        float, typer.Option(help="Stops by which the film is brighter than that.")
    ] = 0.0
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes that make the frames; 0 for none but the command's own.",
            show_default=False,
        ),
    ] = None
    overwrite: Overwrite = False


@grouped
def preview(place: Place, masters: Masters, showing: Showing, telling: Telling) -> None:
    """Make a film of what a seat sees untouched, subtracted and compensated, with figures."""
    console = telling.console()
    brightness = Brightness(showing.display, showing.exposure)
    if showing.out.suffix.lower() != ".mp4":
        raise InputError(f"--out {showing.out}: wanted the name of a film, such as preview.mp4")
    choice, scene = place.load(console)
    require_one_seat(scene, place.seat, "a film is of what one seat sees")
    show = masters.find(scene, showing.frames)
    inputs = [*place.files(), *(path for moment in show.moments for path in moment)]
    prepare(showing.out, inputs=inputs, overwrite=showing.overwrite)
    pyav(showing.out)  # not only when all pictures are made
    figures = write_preview(
        show,
        showing.out,
        Previewing(choice, brightness, showing.wipe),
        console,
        timing=timing_asked(show, showing.fps),
        sound=None if showing.frames else video_of(show.moments[0][0]),
        running=Running(showing.workers),
        repair=masters.repair,
    )
    note_written({showing.out: sha256(showing.out)})
    console.say(f"-> {showing.out}")
    console.figures({**place.about(scene), "film": str(showing.out), "frames": figures})
