"""``domesim compensate``: the frames to project."""

from __future__ import annotations

import inspect
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from compensate.commands.aiming import Aiming
from compensate.methods import METHODS
from compensate.shows.compensating import worse_than_untouched
from compensate.shows.cue_list import CANDIDATES, read_cue_list
from compensate.shows.cues import AUTO, Cue, Looking, cued, listed
from compensate.shows.titles import titles_of
from compensate.solver.fitting import Fitted
from domesim.commands.options import Place, Telling, grouped
from domesim.commands.shows import Doing, Masters, Results, film_asked
from domesim.errors import InputError
from domesim.scene.grade import CLIPPED, KEPT
from domesim.shows.first_look import keep, look
from domesim.shows.job import FOLDER
from domesim.shows.run import Done


@grouped
def compensate(
    place: Place,
    masters: Masters,
    aiming: Aiming,
    results: Results,
    doing: Doing,
    telling: Telling,
    method: Annotated[
        str,
        typer.Option(
            help=f"What to project: {', '.join(METHODS)}; or {AUTO}: for each shot that of "
            f"{', '.join(CANDIDATES)} which by ColorVideoVDP is worse than untouched in no frame."
        ),
    ] = "perceptual",
    gamut: Annotated[
        str | None,
        typer.Option(
            help=f"Colours and highlights that the projector cannot show: {KEPT} in what is "
            f"written (the default on flat screens), where pixels without pollution keep their "
            f"codes; or {CLIPPED} to what it shows (the default in domes).",
            show_default=False,
        ),
    ] = None,
    only_visible: Annotated[
        bool,
        typer.Option(
            "--only-visible",
            help="--weighting paper: solve only rectangles in which what subtraction leaves is "
            "predicted to be seen ('domesim predict --combination local-contrast'), and subtract "
            "elsewhere: faster where that is next to nothing. No certificate.",
        ),
    ] = False,
    spatial: Annotated[
        bool,
        typer.Option(
            "--spatial-weights",
            help="--weighting paper, or --method paper: errors count by how visible 'domesim "
            "predict' finds the pollution there (eq. 7 of the paper). No certificate.",
        ),
    ] = False,
    overlay: Annotated[
        list[str] | None,
        typer.Option(
            "--overlay",
            metavar="FILE",
            help="Pairs: what the server composites over the frames, such as subtitles: a picture "
            "with alpha, a numbered sequence of some of the frames, or timed text of PNG pictures "
            "(the XML of SMPTE ST 428-7 or Interop, or its folder). Given once it is for both "
            "eyes, twice for left and right. Its ghosts are subtracted in advance; the results are "
            "without it.",
            show_default=False,
        ),
    ] = None,
    cue_list: Annotated[
        Path | None,
        typer.Option(
            "--cues",
            metavar="FILE",
            help="Sequences: a cue list (CSV) of parts of the show, by their first and last "
            f"frame, with a method ({', '.join(CANDIDATES)}), a lift, and a ramp, the frames in "
            "which the lift gets there. Frames of no part are done as without it.",
            show_default=False,
        ),
    ] = None,
    pages: Annotated[
        int | None,
        typer.Option(
            help="Sequences: for how many of the worst frames to write a page that compares "
            "methods; one takes as long as a few frames. By default one for each 40 frames, 3 at "
            "most.",
            min=0,
            show_default=False,
        ),
    ] = None,
    films: Annotated[
        int,
        typer.Option(
            help="Sequences: how many of the worst clips of two seconds to judge as films, by "
            "ColorVideoVDP, which sees changes (extra metrics; a minute each, or more).",
            min=0,
        ),
    ] = 0,
) -> None:
    """Compute the frames to project, so that the audience sees the master as closely as can be."""
    console = telling.console()
    choice, scene = place.load(console, gamut)
    recipe = aiming.recipe(choice, method, only_visible=only_visible, spatial=spatial)
    writing, found = results.writing(scene, repair=masters.repair), doing.find(masters, scene)
    whole = masters.find(scene) if doing.frames else found
    recipe = replace(recipe, titles=titles_of(overlay or [], scene, whole))
    if cue_list is not None:
        if method == AUTO:
            raise InputError(f"--cues tells each frame's method: leave --method {AUTO} out")
        recipe = replace(recipe, cue_list=read_cue_list(cue_list))
    recipe.require_sense(scene)
    if doing.scheduler is None:  # whose workers may have a device that this machine has not
        solver = recipe.solver(scene, console.note)
        known = solver if solver is None else inspect.unwrap(solver)
        if isinstance(known, Fitted) and (told := known.general(scene)):
            console.say(told)
    cues: list[Cue] = []
    if method == AUTO and not doing.dry_run:
        folder, _ = film_asked(doing.out, found, writing)
        looked = look(found, recipe, folder, repair=writing.repair)
        looking = Looking(choice, recipe.weighting(scene), recipe.titles)
        running = doing.running()
        cues = cued(whole, folder, looking, console, writing=writing, running=running)
        keep(looked, folder / FOLDER)  # or the job would look again
        recipe = replace(recipe, cue_list=listed(cues))

    def summary(done: Done) -> dict[str, Any]:
        if line := worse_than_untouched(done.frames):
            console.say(line)
        return {"cues": [asdict(cue) for cue in cues]} if method == AUTO else {}

    doing.show(
        found,
        recipe,
        console,
        what="compensating",
        writing=writing,
        summary=summary,
        facts=place.about(scene),
        pages=pages,
        clips=films,
    )
