"""Makes a study's folder: the page to play, pictures, frames for a server, sheets to print.

    index.html            the page to play
    pictures/             what it shows; names do not tell the method
    study.json            the plan, and which picture is which: for the analysis
    print.html            consent, instructions, the operator's list, answer sheets of sittings
    preregistration.md    what was decided before
    answers/              of viewers
    server/               frames for the theatre's server, and a playlist of each sitting

``study.json`` is written last: a folder that has it is whole.
"""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any, final

import numpy as np

from domesim.errors import InputError
from domesim.frames import Master, write_master, write_whole
from domesim.host.pages import hash_of_script
from domesim.host.writing import make_own, prepare, remove_own, require_own, temporary_of
from domesim.light import Light
from domesim.scene import Scene
from domesim.shows.checksums import sha256
from validation.audience.design import CATCH, SPOILT, TRAINING, Trial, plan
from validation.audience.files import ANSWERS, STUDY, Study
from validation.audience.stimuli import brightest, pictures, write_picture

PICTURES, SERVER = "pictures", "server"
PAGES = ("index.html", "print.html", "preregistration.md")
QUESTIONS = {
    True: "Which one is more comfortable to look at?",
    False: "Which one looks better?",
}
"""By whether pictures are pairs; the first is that of van Baar et al. 2011, section 4.1."""
_CHOOSING = 4.0
"""Time to answer, for the estimate of a session, s."""


@final
@dataclass(frozen=True)
class Settings:
    """What a study is to be.

    Attributes
    ----------
    methods
        What is compared.
    room
        Whether the theatre adds the stray light.
    viewers, repeats, seed
        As of `design.plan`.
    question
        What viewers are asked.
    together
        Whether both pictures are seen at once.
    seconds
        How long each is seen otherwise.
    sittings
        How many orders the theatre's server gets frames for.
    """

    methods: tuple[str, ...]
    room: bool
    viewers: int
    repeats: int
    seed: int
    question: str
    together: bool
    seconds: float
    sittings: int


def make(
    folder: Path,
    masters: dict[str, Callable[[], Master]],
    scene: Scene,
    settings: Settings,
    progress: Callable[[str], None] = lambda name: None,
) -> Study:
    """Write the folder of a study.

    Parameters
    ----------
    folder
        It is made; an older study in it without answers is replaced, once the new one is whole.
    masters
        Name -> reads the master.
    scene, settings
        Where it is shown, and how.
    progress
        Told each master's name.

    Raises
    ------
    InputError
        If the folder has answers of viewers or somebody's files, a master does not fit the scene,
        or a setting is impossible.
    """
    _require(folder, settings)
    plans = tuple(
        plan(
            list(masters),
            settings.methods,
            viewer=k,
            seed=settings.seed,
            repeats=settings.repeats,
        )
        for k in range(1, max(settings.viewers, settings.sittings) + 1)
    )
    prepare(folder / STUDY, *(folder / name for name in PAGES))
    for part in (PICTURES, SERVER):
        require_own(folder / part)
    making = temporary_of(folder / "study")
    make_own(making)
    try:
        study = _made(making, masters, scene, settings, plans, progress)
        # A study that was stopped on the way has none
        (folder / STUDY).unlink(missing_ok=True)
        for part in (PICTURES, SERVER):
            remove_own(folder / part)
            if (making / part).is_dir():
                (making / part).rename(folder / part)
        (folder / ANSWERS).mkdir(exist_ok=True)
        _write_pages(folder, study, settings.sittings)
        write_whole(folder / STUDY, study.model_dump_json(indent=1).encode())
    finally:
        remove_own(making)
    return study


def _made(
    folder: Path,
    masters: dict[str, Callable[[], Master]],
    scene: Scene,
    settings: Settings,
    plans: tuple[tuple[Trial, ...], ...],
    progress: Callable[[str], None],
) -> Study:
    """Write pictures, and frames for a server, into a new folder."""
    make_own(folder / PICTURES)
    if settings.sittings:
        make_own(folder / SERVER)
    named = _names(list(masters), settings)
    sums = {}
    white = 1.0
    for name, read in masters.items():
        progress(name)
        master = read()
        sums[name] = tuple(sha256(path) for path in master.paths)
        for picture in pictures(master, scene, settings.methods, room=settings.room):
            stem = folder / PICTURES / named[f"{name} {picture.condition}"]
            white = max(white, brightest({"": picture.shown}))
            np.save(stem.with_suffix(".npy"), picture.shown)
            if settings.sittings and picture.frame is not None:
                _write_frame(folder / SERVER / "frames", stem.name, picture.frame)
    for stored in sorted((folder / PICTURES).glob("*.npy")):
        light: Light = np.load(stored)
        write_picture(light, stored.with_suffix(""), white=white)
        stored.unlink()
    study = Study(
        version=metadata.version("domesim"),
        scene=scene.name,
        show="room" if settings.room else "display",
        stereo=scene.views == 2,
        question=settings.question or QUESTIONS[scene.views == 2],
        together=settings.together,
        seconds=settings.seconds,
        white=white * scene.projector.white,
        seed=settings.seed,
        repeats=settings.repeats,
        methods=settings.methods,
        masters=sums,
        pictures=named,
        viewers=plans,
    )
    for number in range(1, settings.sittings + 1):
        _write_sitting(folder / SERVER, study, number)
    return study


def minutes(study: Study) -> int:
    """About how long a viewer takes."""
    looking = 2.0 if study.together else 2 * study.seconds + 1.5
    return round(len(study.viewers[0]) * (looking + _CHOOSING) / 60 + 1)


def environment() -> Any:
    """Jinja's, for the templates of this package."""
    import jinja2  # noqa: PLC0415 - slow to import

    return jinja2.Environment(
        loader=jinja2.FunctionLoader(template),
        autoescape=lambda name: name is not None and ".html" in name,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )


def template(name: str) -> str:
    """A file of the templates' folder."""
    return files("validation.audience").joinpath("templates", name).read_text(encoding="utf-8")


def _require(folder: Path, settings: Settings) -> None:
    if next((folder / ANSWERS).glob("*.*"), None) is not None:
        raise InputError(
            f"{folder}: wanted a folder without answers, got a study that viewers took part in; "
            f"name another"
        )
    if settings.sittings and not settings.room:
        raise InputError(
            "--sittings are for the theatre's server, got --show display; leave one of them out"
        )
    if not 0.2 <= settings.seconds <= 600:
        raise InputError(f"--seconds are from 0.2 to 600, got {settings.seconds:g}")


def _names(masters: Sequence[str], settings: Settings) -> dict[str, str]:
    """Names of pictures, in an order that does not tell the method."""
    keys = [f"{name} {way}" for name in masters for way in (*settings.methods, SPOILT)]
    order = np.random.default_rng([settings.seed, 0]).permutation(len(keys))
    return {key: f"p{number + 1:03}" for key, number in zip(keys, order, strict=True)}


def _write_frame(folder: Path, name: str, frame: Master) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    suffix = frame.paths[0].suffix
    ends = ("_L", "_R") if len(frame.paths) == 2 else ("",)
    write_master(frame, [folder / f"{name}{end}{suffix}" for end in ends], dither=True)


def _write_sitting(folder: Path, study: Study, number: int) -> None:
    """Frames by trial and interval, which are links to the pictures', and the playlist."""
    place = folder / f"sitting-{number}"
    place.mkdir()
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("trial", "interval", "seconds", "file"))
    for k, trial in enumerate(study.viewers[number - 1], 1):
        for interval, condition in enumerate((trial.first, trial.second), 1):
            name = study.picture(trial.master, condition)
            for source in sorted((folder / "frames").glob(f"{name}[._]*")):
                rest = source.name[len(name) :]
                target = place / f"trial-{k:03}-{interval}{rest}"
                _link(source, target)
                rows.writerow((k, interval, f"{study.seconds:g}", target.name))
    write_whole(place / "playlist.csv", text.getvalue().encode())


def _link(source: Path, target: Path) -> None:
    """The same file under another name; a copy where there are no links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _write_pages(folder: Path, study: Study, sittings: int) -> None:
    facts = {
        "version": study.version,
        "digest": study.digest,
        "scene": study.scene,
        "room": study.show == "room",
        "stereo": study.stereo,
        "question": study.question,
        "together": study.together,
        "seconds": study.seconds,
        "white": study.white,
        "seed": study.seed,
        "repeats": study.repeats,
        "methods": study.methods,
        "minutes": minutes(study),
        "viewers": len(study.viewers),
        "trials": len(study.viewers[0]),
        "choices": sum(trial.kind == "choice" for trial in study.viewers[0]),
        "training": TRAINING,
        "catch": CATCH,
        "pairs": len(list(combinations(study.methods, 2))),
        "sittings": sittings,
        "lengths": [len(trials) for trials in study.viewers],
    }
    from markupsafe import Markup  # noqa: PLC0415 - comes with Jinja

    pages = environment()
    script = f"\nconst STUDY = {_data(study)};\n{template('play.js')}\n"
    play = {
        "masters": len(study.masters),
        "style": Markup(template("play.css")),
        "script": Markup(script),
        "script_hash": Markup(hash_of_script(script)),
    }
    sources: tuple[dict[str, Any], ...] = (play, {}, {"masters": study.masters})
    for name, more in zip(PAGES, sources, strict=True):
        source = pages.get_template(f"{name.replace('index', 'play')}.j2")
        write_whole(folder / name, source.render({**facts, **more}).encode())


def _data(study: Study) -> str:
    """What the page knows of the study, as JavaScript: of conditions only the pictures' names."""

    def told(trial: Trial) -> dict[str, Any]:
        first, second = (
            study.picture(trial.master, condition) for condition in (trial.first, trial.second)
        )
        right = trial.right if trial.kind == "training" else None
        kind = "training" if trial.kind == "training" else "choice"
        return {"kind": kind, "first": first, "second": second, "right": right}

    data = {
        "digest": study.digest,
        "question": study.question.replace("&", "&amp;").replace("<", "&lt;"),
        "together": study.together,
        "seconds": study.seconds,
        "stereo": study.stereo,
        "white": study.white,
        "viewers": [[told(trial) for trial in trials] for trials in study.viewers],
    }
    return json.dumps(data).replace("<", "\\u003c")
