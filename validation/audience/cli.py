"""``domesim study``: ask an audience which method's pictures it prefers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, final

import typer

from compensate.methods import methods_of
from domesim.commands.options import SceneName, Telling, TransportFile, grouped, scene_of
from domesim.errors import InputError
from domesim.frames import Master, write_whole
from domesim.host.writing import prepare, prepare_folder
from domesim.scene import Scene
from domesim.scene.choice import SceneChoice
from domesim.shows.show import PACKINGS, find_show
from validation.audience.analysis import analyse_study
from validation.audience.files import names_of, read_answers, read_study
from validation.audience.folder import Settings, make, minutes
from validation.audience.playing import server
from validation.audience.power import Situation
from validation.audience.power import power as power_of
from validation.experiment import Missing

app = typer.Typer(
    help="Ask an audience which method's pictures it prefers: make, play and analyse a study.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="The study's folder.", show_default=False)
]


@final
@dataclass(frozen=True)
class Masters:
    """Which masters a study shows."""

    master: Annotated[
        list[str] | None,
        typer.Argument(
            help="Domemasters, or files of two views. Numbered sequences give a master a frame.",
            show_default=False,
        ),
    ] = None
    left: Annotated[
        list[str] | None,
        typer.Option(
            "--left", help="Stereo: a left eye's file; once for each pair.", show_default=False
        ),
    ] = None
    right: Annotated[
        list[str] | None,
        typer.Option(
            "--right", help="Stereo: its right eye's file, in that order.", show_default=False
        ),
    ] = None
    packing: Annotated[
        str | None,
        typer.Option(
            help=f"Stereo, in one file: {', '.join(PACKINGS)}. EXR files say so themselves.",
            show_default=False,
        ),
    ] = None
    encoding: Annotated[
        str | None,
        typer.Option(
            help="What the masters' code values are, as for 'domesim compensate'.",
            show_default=False,
        ),
    ] = None

    def readers(self, scene: Scene) -> dict[str, Callable[[], Master]]:
        """Name of each master of a scene -> reads it.

        Raises
        ------
        InputError
            If none is named, a left one has no right one, or as for `find_show`.
        """
        left, right = self.left or [], self.right or []
        if not self.master and not left and not right:
            raise InputError("a study wants masters, or --left and --right, got none; name some")
        if len(left) != len(right):
            raise InputError(
                f"wanted a --right for each --left, got {len(left)} --left and {len(right)} --right"
            )
        find = partial(find_show, encoding=self.encoding, response=scene.projector.response)
        shows = [find(name, packing=self.packing) for name in self.master or []]
        shows += [find(None, *pair) for pair in zip(left, right, strict=True)]
        moments = [(show, moment) for show in shows for moment in show.moments]
        names = names_of([moment[0] for _, moment in moments])
        return {
            name: partial(show.read, moment, repair=False)
            for name, (show, moment) in zip(names, moments, strict=True)
        }


@final
@dataclass(frozen=True)
class Asking:
    """What viewers see, and are asked."""

    methods: Annotated[
        str, typer.Option(help="What is compared, by commas: methods of 'domesim compensate'.")
    ] = "none,subtractive,perceptual"
    show: Annotated[
        str,
        typer.Option(
            help="room: frames to project in the theatre, which adds its stray light; display: "
            "what is seen there, to be shown on one display at home."
        ),
    ] = "room"
    viewers: Annotated[
        int, typer.Option(help="How many viewers at most; each has an order.", min=2, max=9999)
    ] = 40
    repeats: Annotated[
        int, typer.Option(help="How often each pair of methods is shown of each master.", min=1)
    ] = 2
    question: Annotated[
        str,
        typer.Option(
            help="What viewers are asked; for pairs it is which one is more comfortable to look "
            "at, for domes which one looks better.",
            show_default=False,
        ),
    ] = ""
    together: Annotated[
        bool,
        typer.Option(
            "--side-by-side", help="Show both pictures of a trial at once, not one after the other."
        ),
    ] = False
    seconds: Annotated[float, typer.Option(help="How long each picture is seen.")] = 4.0
    sittings: Annotated[
        int,
        typer.Option(
            help="Frames and playlists for the theatre's server, for so many orders; answers are "
            "given on paper.",
            min=0,
        ),
    ] = 0
    seed: Annotated[int, typer.Option(help="Seed of all orders.", min=0)] = 0

    def settings(self, scene: Scene) -> Settings:
        """The same for `make`.

        Raises
        ------
        InputError
            If the scene has no such method, or there is no such show.
        """
        if self.show not in ("room", "display"):
            raise InputError(f"--show is room or display, got {self.show!r}")
        methods = tuple(name.strip() for name in self.methods.split(","))
        known = methods_of(scene)
        for name in methods:
            if name not in known:
                raise InputError(
                    f"--methods: {name!r} is not known for {scene.name}; use some of "
                    f"{', '.join(known)}"
                )
        return Settings(
            methods,
            self.show == "room",
            self.viewers,
            self.repeats,
            self.seed,
            self.question.strip(),
            self.together,
            self.seconds,
            self.sittings,
        )


@app.command()
@grouped
def new(
    scene: SceneName,
    masters: Masters,
    asking: Asking,
    telling: Telling,
    out: Annotated[Path, typer.Option("--out", help="The study's folder.", show_default=False)],
    transport: TransportFile = None,
) -> None:
    """Make a study: a folder to play in the room, and to print.

    Each viewer sees all pairs of methods of all masters, in an order of their own, and chooses. See
    docs/audience.md.
    """
    console = telling.console()
    theatre = scene_of(SceneChoice(scene, transport), console)
    settings, readers = asking.settings(theatre), masters.readers(theatre)
    with console.progress("making", len(readers)) as start:
        study = make(out, readers, theatre, settings, start)
    trials = len(study.viewers[0])
    console.say(
        f"{trials} pairs for each viewer, about {minutes(study)} minutes; masters: "
        f"{', '.join(study.masters)}",
        f"Print {(out / 'print.html').resolve()}",
        f"Fill in {(out / 'preregistration.md').resolve()}",
        f"Then: domesim study play {out}",
    )
    console.figures(
        {
            "study": study.digest,
            "folder": str(out),
            "masters": list(study.masters),
            "methods": list(study.methods),
            "trials": trials,
            "minutes": minutes(study),
            "white": study.white,
            "sittings": settings.sittings,
        }
    )


@app.command()
@grouped
def play(
    folder: Folder,
    telling: Telling,
    port: Annotated[
        int,
        typer.Option(help="Port of the page's address; 0 for any that is free.", min=0, max=65535),
    ] = 8642,
) -> None:
    """Play a study to viewers in a browser of this machine, and keep each answer at once.

    Nobody else can reach it, and nothing is sent anywhere. Ctrl-C ends it.
    """
    console = telling.console()
    study = read_study(folder)
    prepare_folder(folder)
    with server(folder, study, port) as running:
        console.say(f"Open http://127.0.0.1:{running.server_address[1]}/ (Ctrl-C ends it)")
        running.serve_forever()


@app.command()
@grouped
def power(
    telling: Telling,
    share: Annotated[
        float,
        typer.Option(help="Share of choices for the best method over each other one, 0.5 to 1."),
    ] = 0.65,
    spread: Annotated[
        float,
        typer.Option(
            help="How much people differ: standard deviation of the log-odds of a pair. Nobody "
            "knows it before; try 0 and 1, too."
        ),
    ] = 0.5,
    methods: Annotated[int, typer.Option(help="Methods that are compared.", min=2, max=12)] = 3,
    masters: Annotated[int, typer.Option(help="Masters that are shown.", min=1)] = 10,
    repeats: Annotated[
        int, typer.Option(help="How often each pair of methods is shown of each master.", min=1)
    ] = 2,
    viewers: Annotated[
        str, typer.Option(help="Numbers to try, by commas.")
    ] = "6,8,12,16,20,26,32,40",
    audiences: Annotated[
        int, typer.Option(help="Audiences that are simulated for each number of viewers.", min=100)
    ] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 0,
) -> None:
    """Tell how many viewers are enough, by simulated audiences.

    Power is the probability that the best method is significantly preferred to all others.
    """
    console = telling.console()
    situation = Situation(share=share, spread=spread, methods=methods, each=masters * repeats)
    situation.require()
    try:
        numbers = sorted({int(number) for number in viewers.split(",")})
    except ValueError:
        raise InputError(f"--viewers takes numbers such as 8,16, got {viewers!r}") from None
    found = {}
    for number in numbers:
        found[number] = power_of(situation, number, audiences=audiences, seed=seed)
        console.say(f"{number:4} viewers: power {found[number]:.0%}")
    enough = next((number for number, each in found.items() if each >= 0.8), None)
    console.say(
        f"{enough} viewers have a power of 80 % and more"
        if enough is not None
        else "None of these has a power of 80 %: ask more people, show more masters, or look for "
        "larger differences"
    )
    console.figures(
        {
            **situation.model_dump(),
            "power": {str(number): each for number, each in found.items()},
            "enough": enough,
        }
    )


@app.command()
@grouped
def analyse(
    folder: Folder,
    telling: Telling,
) -> None:
    """Tell what a study shows: results.html in its folder, with diagrams.

    All viewers count. Whose answers are odd is told, and the results without them beside.
    """
    console = telling.console()
    study = read_study(folder)
    page = folder / "results.html"
    prepare(page)
    try:
        found = analyse_study(study, read_answers(folder, study))
    except Missing as missing:
        raise InputError(f"study analyse {missing}") from None
    write_whole(page, found.page().encode())
    console.say(*found.lines(), f"Open {page.resolve()}")
    console.figures({**found.figures(), "page": str(page)})
