"""What a viewer is asked, in which order, and what they answered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, Self, TypeAlias, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from domesim.errors import InputError
from domesim.host.files import read_plain

Kind: TypeAlias = Literal["stereo", "dome"]
Eye: TypeAlias = Literal["left", "right", "both"]
Side: TypeAlias = Literal["below", "above"]

EACH = 3
"""Settings from each side that count."""
LEVELS: dict[Kind, int] = {"stereo": 3, "dome": 2}
"""Levels of the response that are matched, each a quarter of the one before.

A ghost is nulled on a grey of a few hundredths of white. A dome's light is too dim for a third."""
STEP = 1 / 250
"""The page's smallest step, of the code: nothing is set more finely."""
LARGEST = 1 << 20
"""Bytes of a session's file."""
SETTINGS = "settings.json"
"""Its name."""


@final
@dataclass(frozen=True)
class Block:
    """Settings of one quantity.

    Parameters
    ----------
    task
        ``match``: a code of the response; ``null``: crosstalk, or reflected light.
    eye
        Who looks.
    primary
        W, R, G or B.
    level
        Of a match: it has 4^-level of full light; of a null 0.
    """

    task: Literal["match", "null"]
    eye: Eye
    primary: str
    level: int = 0


@final
@dataclass(frozen=True)
class Trial:
    """One setting: its block, the side that it comes from, and how far away it starts, 0..1."""

    block: int
    side: Side
    start: float
    counted: bool


@cache
def blocks_of(kind: Kind) -> tuple[Block, ...]:
    """All that is measured, in order."""
    eyes: tuple[Eye, ...] = ("left", "right") if kind == "stereo" else ("both",)
    return tuple(
        block
        for eye in eyes
        for block in (
            *(Block("match", eye, "W", level) for level in range(1, LEVELS[kind] + 1)),
            *(Block("null", eye, primary) for primary in "RGB"),
        )
    )


@cache
def trials_of(kind: Kind) -> tuple[Trial, ...]:
    """All settings: of each block one to try, then both sides in turn, from random starts.

    The order is the same for everybody, so that a session goes on where it ended.
    """
    random = np.random.default_rng(0)
    sides: tuple[Side, Side] = ("below", "above")

    def made() -> Iterator[Trial]:
        for number, _ in enumerate(blocks_of(kind)):
            first = int(random.integers(2))
            # A drift makes no difference between sides that are in the order ABBAAB
            order = [first, 1 - first, 1 - first, first, first, 1 - first]
            for k, side in enumerate((int(random.integers(2)), *order)):
                yield Trial(number, sides[side], round(float(random.random()), 3), k > 0)

    return tuple(made())


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


Code = Annotated[float, Field(ge=0, le=1)]


class Setting(_Record):
    """What a viewer set.

    Attributes
    ----------
    trial
        Which trial it is of.
    base
        Code that it is set against: the lines' (wedges') of a match; the grey of a ghost's null;
        the rear half's.
    code
        Code that was set.
    limit
        Whether it could not be turned further: it does not count, and is asked again.
    seconds
        How long it took.
    """

    trial: Annotated[int, Field(ge=0)]
    base: Annotated[float, Field(gt=0, le=1)]
    code: Code
    limit: bool = False
    seconds: Annotated[float, Field(ge=0)]


class Session(_Record):
    """All settings of one viewer so far."""

    kind: Kind
    scene: str
    digest: str
    began: str
    layout: str = ""
    resumed: Annotated[int, Field(ge=0)] = 0
    settings: tuple[Setting, ...] = ()

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        place = 0
        for setting in self.settings:
            if setting.trial != place:
                raise ValueError(f"settings must be in order: wanted trial {place}")
            place += not setting.limit
        if place > len(trials_of(self.kind)):
            raise ValueError("settings must be as many as there are trials at most")
        return self

    @property
    def done(self) -> bool:
        """Whether all trials are set."""
        return sum(not each.limit for each in self.settings) == len(trials_of(self.kind))

    def continues(self, before: Session) -> bool:
        """Whether it has all settings of an earlier state."""
        return (self.kind, self.digest) == (before.kind, before.digest) and (
            self.settings[: len(before.settings)] == before.settings
        )


def read_session(path: Path, kind: Kind, digest: str) -> Session | None:
    """The session that a folder keeps; None if it has none.

    Raises
    ------
    InputError
        If it cannot be read, or is of another scene.
    """
    if not path.is_file():
        return None
    try:
        session = Session.model_validate_json(read_plain(path, LARGEST))
    except ValidationError as error:
        raise InputError(
            f"{path}: wanted settings of 'measure by-eye', got something else "
            f"({error.errors()[0]['msg']}); choose another folder"
        ) from None
    if (session.kind, session.digest) != (kind, digest):
        raise InputError(
            f"{path}: these settings are of the scene {session.scene} as it was; choose another "
            f"folder for this one"
        )
    return session


@final
@dataclass(frozen=True)
class Settings:
    """The settings of one block that count, in order.

    Parameters
    ----------
    block
        What they are of.
    above
        (setting,) whether each came from above.
    base, code
        (setting,) codes.
    """

    block: Block
    above: np.ndarray
    base: np.ndarray
    code: np.ndarray


def counted(session: Session) -> Sequence[Settings]:
    """All blocks' settings that count."""
    trials = trials_of(session.kind)
    found = []
    for number, block in enumerate(blocks_of(session.kind)):
        mine = [
            each
            for each in session.settings
            if not each.limit and trials[each.trial].counted and trials[each.trial].block == number
        ]
        above = np.array([trials[each.trial].side == "above" for each in mine])
        base, code = (np.array([getattr(each, name) for each in mine]) for name in ("base", "code"))
        found.append(Settings(block, above, base, code))
    return found
