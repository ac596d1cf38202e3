"""What subcommands share that do all frames of a show: options in groups, and the doing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, final

import typer

from domesim.commands.options import OutFolder, Repair, finish
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.encodings import ENCODINGS, encoding_named
from domesim.frames.film import FILMS
from domesim.frames.formats import SUFFIXES, WRITTEN
from domesim.frames.video import SUFFIXES as VIDEOS
from domesim.frames.views import TOGETHER
from domesim.host.console import Console
from domesim.scene import Scene
from domesim.shows.cinema import SUFFIX as CINEMA
from domesim.shows.estimate import estimate
from domesim.shows.run import FRAME_TIMEOUT, Done, Running, each_frame
from domesim.shows.sequences import parse_frames
from domesim.shows.show import PACKINGS, Show, find_show
from domesim.shows.work import Recipe, Writing

TPDF = "tpdf"

Encoding = Annotated[
    str | None,
    typer.Option(
        "--encoding",
        help="What the master's code values are, whatever its files say: "
        f"{', '.join(ENCODINGS)}; or hlg400, of a display of 400 cd/m²; or transfer and "
        "primaries, such as st2084:p3-d65; or a space of OpenColorIO's configuration in $OCIO, "
        "such as ocio:ACEScct.",
        show_default=False,
    ),
]


@final
@dataclass(frozen=True)
class Masters:
    """Which masters a command takes, and how it reads them."""

    master: Annotated[
        str | None,
        typer.Argument(
            metavar="MASTER",
            help="The domemaster, or a file of two views: an EXR, PNG, TIFF, DPX, JPEG or JPEG "
            "2000 file, a numbered sequence such as 'show.####.png', or a video.",
            show_default=False,
        ),
    ] = None
    left: Annotated[
        str | None,
        typer.Option(
            "--left",
            help="Stereo: the left eye's file or numbered sequence, instead of a master.",
            show_default=False,
        ),
    ] = None
    right: Annotated[
        str | None,
        typer.Option(
            "--right", help="Stereo: the right eye's file or numbered sequence.", show_default=False
        ),
    ] = None
    packing: Annotated[
        str | None,
        typer.Option(
            "--packing",
            help=f"Stereo, in one file: {', '.join(PACKINGS)}. EXR files say so themselves.",
            show_default=False,
        ),
    ] = None
    layer: Annotated[
        str | None,
        typer.Option(
            "--layer",
            help="Which layer of an EXR, such as ViewLayer.Combined, or which of its parts, by "
            "name or number from 0, if several have R, G and B.",
            show_default=False,
        ),
    ] = None
    encoding: Encoding = None
    checksums: Annotated[
        Path | None,
        typer.Option(
            "--checksums",
            metavar="FILE",
            help="Refuse masters that have not the SHA-256 that FILE lists, as sha256sum writes "
            "it.",
            show_default=False,
        ),
    ] = None
    repair: Repair = False
    as_given: Annotated[
        bool,
        typer.Option(
            "--as-given",
            "--allow-identical",
            help="Stereo: take left and right as they are, even if they are the same, look "
            "exchanged, or one is brighter.",
        ),
    ] = False

    def find(self, scene: Scene, frames: str | None = None) -> Show:
        """The show that they are, in a scene.

        Raises
        ------
        InputError
            As for `find_show` and `Show.listed_in`.
        """
        return find_show(
            self.master,
            self.left,
            self.right,
            packing=self.packing,
            layer=self.layer,
            frames=frames,
            as_given=self.as_given,
            encoding=self.encoding,
            response=scene.projector.response,
        ).listed_in(self.checksums)


@final
@dataclass(frozen=True)
class Results:
    """How a command writes its results."""

    file_format: Annotated[
        str | None,
        typer.Option(
            "--format",
            help=f"Write another format than the master's: {', '.join(WRITTEN)}; or, of a "
            "sequence, besides its frames a video: mov (ProRes 4444), mkv (FFV1, lossless) or, for "
            "previews, mp4 (H.264; with --bits 10 HEVC).",
            show_default=False,
        ),
    ] = None
    output_encoding: Annotated[
        str | None,
        typer.Option(
            "--output-encoding",
            help="What the results' code values are, instead of the master's encoding: names as "
            "for --encoding, such as dcdm for X'Y'Z' (TIFFs then have 12 bits in 16); or response, "
            "the levels for the scene's projector.",
            show_default=False,
        ),
    ] = None
    bits: Annotated[
        int | None,
        typer.Option(
            "--output-bits",
            "--bits",
            help="Bits a sample instead of the master's, as the format allows.",
            show_default=False,
        ),
    ] = None
    together: Annotated[
        str | None,
        typer.Option(
            "--output-packing",
            help=f"Pairs: write left and right as one picture: {', '.join(TOGETHER)}.",
            show_default=False,
        ),
    ] = None
    dither: Annotated[
        str,
        typer.Option(
            "--dither",
            help="How light between two codes of an integer format is rounded: tpdf, with noise "
            "that keeps gradients free of bands; or none, to the nearest code.",
        ),
    ] = TPDF
    fps: Annotated[
        float | None,
        typer.Option(
            help="Videos: frames a second, instead of the master's, or 24 where it says nothing.",
            show_default=False,
        ),
    ] = None

    def writing(self, scene: Scene, *, repair: bool) -> Writing:
        """How results are written, and masters of a scene read.

        Raises
        ------
        InputError
            If an option has no such value.
        """
        if self.dither not in (TPDF, "none"):
            raise InputError(f"--dither {self.dither!r} is not known; use {TPDF} or none")
        colour = None
        if self.output_encoding is not None:
            colour = self._encoding(scene)
        together = next((each for each in TOGETHER if each == self.together), None)
        if self.together is not None and together is None:
            raise InputError(
                f"--output-packing {self.together!r} is not known; use one of {', '.join(TOGETHER)}"
            )
        suffix = suffix_of(self.file_format)
        dither = self.dither == TPDF
        return Writing(suffix, self.bits, dither, repair, self.fps, colour, together)

    def _encoding(self, scene: Scene) -> ColourTag:
        """What results' code values are to be; by the projector's response, if that is asked."""
        option, name = "--output-encoding", self.output_encoding or ""
        curve, _, gamut = name.lower().partition(":")
        if curve != "response":
            return encoding_named(name, option)
        if scene.projector.response is None:
            raise InputError(
                f"{option} {name}: {scene.name} states no response of its projector; add one "
                f'([projector] response = "bt1886"), or name an encoding'
            )
        primaries = encoding_named(f"srgb:{gamut or 'bt709'}", option).primaries
        return ColourTag(scene.projector.response.transfer, primaries, f"{option} {name}")


@final
@dataclass(frozen=True)
class Doing:
    """Which frames of a show a command does, by whom, and where results go."""

    out: OutFolder
    frames: Annotated[
        str | None, typer.Option(help="Frames of a sequence to do, such as '1-100x10'.")
    ] = None
    workers: Annotated[
        int | None,
        typer.Option(
            help="Sequences: processes that do the frames, on this machine; 0 for none but the "
            "command's own. As many as cores and memory allow by default.",
            show_default=False,
        ),
    ] = None
    threads: Annotated[
        int | None,
        typer.Option(
            help="Threads of a worker; by default workers share the cores.", show_default=False
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Sequences: let the workers of this Dask scheduler do the frames, such as "
            "tcp://node1:8786. All must see the files under the same names.",
            show_default=False,
        ),
    ] = None
    anew: Annotated[
        bool, typer.Option("--anew", help="Sequences: do frames that are done already once more.")
    ] = False
    mix: Annotated[
        bool,
        typer.Option("--mix", help="Sequences: keep frames that were done with other settings."),
    ] = False
    prune: Annotated[
        bool,
        typer.Option(
            "--prune",
            help="Sequences: remove results of this job whose masters are not there any more.",
        ),
    ] = False
    frame_timeout: Annotated[
        float,
        typer.Option(
            help="Sequences: seconds after which a worker that is not done with a frame is ended, "
            "and the frame tried by another, three times in all; 0 for never.",
        ),
    ] = FRAME_TIMEOUT
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Do a few frames, throw them away, and tell what time, memory and disk all will "
            "take.",
        ),
    ] = False
    like: Annotated[
        bool,
        typer.Option(
            "--like",
            help="With --dry-run and --frames: the master is one file, and the show has as many "
            "frames like it.",
        ),
    ] = False

    def find(self, masters: Masters, scene: Scene) -> Show:
        """The frames to do, or one that they are like.

        Raises
        ------
        InputError
            As for `Masters.find`; or if `like` does not go with what else was asked for.
        """
        if not self.like:
            return masters.find(scene, self.frames)
        if not (self.dry_run and self.frames):
            raise InputError(
                "--like belongs to an estimate; say how many frames there will be (--dry-run "
                "--frames 1-36000), or leave it out"
            )
        show = masters.find(scene)
        if show.numbered:
            raise InputError(
                f"--like: wanted one master, got {len(show.moments)}; name one of them, or leave "
                f"--like out"
            )
        return show

    def running(self, pages: int | None = None, clips: int = 0) -> Running:
        """How a show is done; `pages` and `clips` are as for `show`."""
        return Running(
            self.workers,
            self.threads,
            self.scheduler,
            self.anew,
            self.mix,
            pages,
            self.frame_timeout,
            self.prune,
            clips,
        )

    def show(
        self,
        show: Show,
        recipe: Recipe,
        console: Console,
        *,
        what: str,
        writing: Writing,
        facts: dict[str, Any],
        summary: Callable[[Done], dict[str, Any]] | None = None,
        pages: int | None = None,
        clips: int = 0,
    ) -> None:
        """Do each frame of a show, or only estimate it, print the figures, and end.

        Parameters
        ----------
        show, recipe, console, what, writing
            As for `each_frame`.
        facts
            What the command's figures say besides.
        summary
            Called with what became of all frames; what the figures say of them together.
        pages
            For how many of the worst frames a page is written, as for `Running`.
        clips
            How many of the worst clips are judged as films.

        Raises
        ------
        InputError
            If the folder has a picture's or film's name; as for `each_frame`.
        """
        out, writing = film_asked(self.out, show, writing)
        running = self.running(pages, clips)
        if self.dry_run:
            count = len(parse_frames(self.frames)) if self.like and self.frames else None
            estimated = estimate(show, out, recipe, console, writing, running, count)
            console.figures({**facts, "estimate": estimated})
            return
        done = each_frame(show, out, recipe, console, what=what, writing=writing, running=running)
        summed = {} if summary is None else summary(done)
        finish(console, {**facts, **summed, **_frames_figures(done)}, done.failed)


def film_asked(out: Path, show: Show, writing: Writing) -> tuple[Path, Writing]:
    """Returns the folder of results, and how they are written: ``--out`` may name a film beside it.

    Raises
    ------
    InputError
        If it is a picture's name, or a film's for one picture or for another format.
    """
    suffix = out.suffix.lower()
    if suffix in FILMS and show.numbered and not out.is_dir():
        if writing.suffix not in (None, suffix):
            asked = writing.suffix.removeprefix(".")
            raise InputError(
                f"--out {out}: wanted a folder for --format {asked}, got a film's name"
            )
        return out.with_suffix(""), replace(writing, suffix=suffix, film=out)
    if suffix in (*SUFFIXES, *VIDEOS) and not out.exists():
        kind = "film" if suffix in VIDEOS else "picture"
        raise InputError(
            f"--out {out}: wanted a folder for the results, got a {kind}'s name. Name a folder "
            f"(--out {out.parent / out.stem})"
        )
    return out, writing


def suffix_of(file_format: str | None) -> str | None:
    """The suffix of files in that format, for `Writing`.

    Raises
    ------
    InputError
        If frames cannot be written in it.
    """
    if file_format is None:
        return None
    suffix = f".{file_format.lower().removeprefix('.')}"
    if suffix not in (*SUFFIXES, *FILMS, CINEMA):
        raise InputError(
            f"--format {file_format!r} is not known; use {', '.join(WRITTEN)}; mov, mkv or mp4; or "
            "mxf"
        )
    return suffix


def require_one_seat(scene: Scene, seat: str | None, why: str) -> None:
    """See that a scene is looked at from one seat.

    Raises
    ------
    InputError
        If it is looked at from several, by ``--seat SEAT``; it says why not.
    """
    if scene.several_seats:
        raise InputError(f"--seat {seat}: {why}; name one of {', '.join(scene.chosen)}")


def _frames_figures(done: Done) -> dict[str, Any]:
    """What a command's figures say of its frames."""
    seconds = {f"seconds_{step}": value for step, value in done.seconds.items()}
    report = None if done.report is None else str(done.report)
    films = {"films": [str(path) for path in done.films]} if done.films else {}
    return {"frames": done.frames, "kept": done.kept, "report": report, **films, **seconds}
