"""What a study's folder holds: the study itself (``study.json``), and each viewer's answers.

Answers come from the page, one ``answers/viewer-007.json`` a viewer; or from sheets of paper of a
sitting that all saw together, typed as ``answers/sitting-2.csv`` with the columns viewer, trial and
choice (1 or 2). A sitting's trials are those of the viewer of its number.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, final

from pydantic import Field, ValidationError

from domesim.errors import InputError, reason
from domesim.host.files import read_plain
from domesim.host.texts import text_in
from validation.audience.design import Trial
from validation.experiment import Record

STUDY = "study.json"
ANSWERS = "answers"
"""Names in the folder."""

LARGEST = 1 << 20
"""Bytes of a viewer's answers, or of a sheet."""
LARGEST_STUDY = 8 << 20
"""Bytes of a study: those of 80,000 trials."""


@final
class Study(Record):
    """Everything that was decided before the first viewer came.

    Attributes
    ----------
    scene, show
        The theatre; whether pictures are what it is sent ("room"), or what is seen there
        ("display").
    stereo
        Whether pictures are pairs, of files ``..._L.png`` and ``..._R.png``.
    question
        What viewers are asked.
    together
        Whether the two pictures of a trial are seen side by side, not one after the other.
    seconds
        How long each picture is seen, of those that follow each other.
    white
        Luminance that the white of the pictures must have, cd/m².
    seed, repeats
        As of `design.plan`.
    methods
        What is compared.
    masters
        Name of each master -> SHA-256 of its files.
    pictures
        "master condition" -> name of its picture, which does not tell the condition.
    viewers
        Trials of each viewer, from number 1 on.
    """

    format: Literal["domesim study 1"] = "domesim study 1"
    version: str
    scene: str
    show: Literal["room", "display"]
    stereo: bool
    question: str
    together: bool
    seconds: float
    white: float
    seed: int
    repeats: int
    methods: tuple[str, ...]
    masters: Mapping[str, tuple[str, ...]]
    pictures: Mapping[str, str]
    viewers: tuple[tuple[Trial, ...], ...]

    @property
    def digest(self) -> str:
        """What answers name the study by."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def picture(self, master: str, condition: str) -> str:
        """Name of the picture of a master and a condition."""
        return self.pictures[f"{master} {condition}"]


@final
class Answer(Record):
    """What a viewer chose in a trial.

    Attributes
    ----------
    trial
        Its place in the viewer's plan, from 0.
    choice
        1 or 2.
    seconds
        From the question to the answer; None on paper.
    again
        How often the pictures were looked at once more.
    """

    trial: int = Field(ge=0)
    choice: int = Field(ge=1, le=2)
    seconds: float | None = None
    again: int = 0


@final
class Answers(Record):
    """All answers of one viewer, in the plan's order.

    Attributes
    ----------
    study
        `Study.digest`.
    viewer
        Number of the viewer's plan.
    name
        What reports call the viewer: the number, or what a sheet says.
    began
        When, ISO 8601.
    layout
        How views were shown.
    white, black, meter
        Readings of the display before the first trial, cd/m², and of what.
    resumed
        How often the session went on after a break of the program.
    answers
        The answers so far.
    """

    study: str
    viewer: int = Field(ge=1)
    name: str = ""
    began: str = ""
    layout: str = ""
    white: float | None = None
    black: float | None = None
    meter: str = ""
    resumed: int = 0
    answers: tuple[Answer, ...] = ()

    def model_post_init(self, context: object, /) -> None:
        """Answers follow each other without a gap."""
        if [one.trial for one in self.answers] != list(range(len(self.answers))):
            raise ValueError("answers are of the trials 0, 1, 2, ... in that order")


def read_study(folder: Path) -> Study:
    """The study of a folder.

    Raises
    ------
    InputError
        If there is none, or it cannot be understood.
    """
    path = folder / STUDY
    try:
        return Study.model_validate_json(read_plain(path, LARGEST_STUDY))
    except OSError as error:
        raise InputError(
            f"{path}: wanted the study of this folder, got '{reason(error)}'; make one with "
            f"'domesim study new'"
        ) from error
    except ValidationError as error:
        raise InputError(f"{path}: wanted a study, got {_first(error)}; make it anew") from None


def read_answers(folder: Path, study: Study) -> list[Answers]:
    """Everybody's answers, of viewers who gave any.

    Raises
    ------
    InputError
        If a file cannot be read, is of another study, or answers trials that there are not.
    """
    place = folder / ANSWERS
    found = []
    for path in sorted(place.glob("*.json")):
        try:
            one = Answers.model_validate_json(read_plain(path, LARGEST))
        except OSError as error:
            raise InputError(f"{path}: wanted to read it, got '{reason(error)}'") from error
        except ValidationError as error:
            raise InputError(f"{path}: wanted a viewer's answers, got {_first(error)}") from None
        require_of(one, study, str(path))
        found.append(one.model_copy(update={"name": one.name or str(one.viewer)}))
    for path in sorted(place.glob("*.csv")):
        found += _sheet(path, study)
    return [one for one in found if one.answers]


def require_of(answers: Answers, study: Study, who: str) -> None:
    """See that answers are of this study.

    Raises
    ------
    InputError
        If they are not.
    """
    if answers.study != study.digest:
        raise InputError(
            f"{who}: wanted answers of the study {study.digest}, got those of {answers.study}; "
            f"take them out of the folder"
        )
    if answers.viewer > len(study.viewers):
        raise InputError(
            f"{who}: wanted one of {len(study.viewers)} viewers, got number {answers.viewer}"
        )
    trials = len(study.viewers[answers.viewer - 1])
    if len(answers.answers) > trials:
        raise InputError(f"{who}: wanted at most {trials} answers, got {len(answers.answers)}")


def _sheet(path: Path, study: Study) -> list[Answers]:
    """Answers of a sitting, from paper."""
    number = re.fullmatch(r"sitting-([0-9]+)\.csv", path.name)
    if number is None or not 1 <= int(number[1]) <= len(study.viewers):
        raise InputError(f"{path}: wanted a name such as sitting-1.csv; rename it")
    chosen: dict[str, dict[int, int]] = {}
    try:
        rows = list(csv.DictReader(io.StringIO(text_in(read_plain(path, LARGEST)), newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: wanted a table of answers in UTF-8, got '{error}'") from error
    for line, row in enumerate(rows, 2):
        try:
            trial, choice = int(row["trial"]), int(row["choice"])
            if choice not in (1, 2):
                raise ValueError
            chosen.setdefault(row["viewer"].strip(), {})[trial - 1] = choice
        except (KeyError, ValueError, AttributeError, TypeError):
            raise InputError(
                f"{path}, line {line}: wanted viewer, trial and choice (1 or 2), got "
                f"{', '.join(map(str, row.values()))}"
            ) from None
    found = []
    trials = len(study.viewers[int(number[1]) - 1])
    for name, answers in chosen.items():
        if sorted(answers) != list(range(trials)):
            raise InputError(
                f"{path}: wanted all {trials} answers of viewer {name}, got {len(answers)}; an "
                f"incomplete sheet is left out whole"
            )
        given = tuple(Answer(trial=k, choice=answers[k]) for k in range(trials))
        found.append(
            Answers(
                study=study.digest,
                viewer=int(number[1]),
                name=f"{name}, sitting {number[1]}",
                layout="paper",
                answers=given,
            )
        )
    return found


def names_of(paths: Sequence[Path]) -> list[str]:
    """A short name for each master, from its files' stems; no two are the same."""
    names: list[str] = []
    for path in paths:
        stem = re.sub(r"[._-](L|left)(?=$|[._-])", "", path.stem)
        stem = re.sub(r"[^A-Za-z0-9.-]+", "-", stem)
        name, count = stem, 2
        while name in names:
            name, count = f"{stem}-{count}", count + 1
        names.append(name)
    return names


def _first(error: ValidationError) -> str:
    one = error.errors()[0]
    return f"'{one['msg']}' at {'.'.join(map(str, one['loc'])) or 'its top'}"
