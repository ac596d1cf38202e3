"""What an observation is made of, and so what solves the paper's least squares.

| kind | what is seen | the paper's least squares |
| --- | --- | --- |
| `LOW_RANK` | a dome, a room: a few sums of light | `ADMM`, certified |
| `PIXELWISE` | a pair on a flat screen | `ADMM`, certified |
| `REFLECTED_PAIR` | both, one after the other | `ADMM`, certified |
| `TABLE` | a pair by a grey-to-grey table | linearised first |
| `OTHER` | any other: glare, a map of yours | `Accelerated` |
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, cast, final

from domesim.observation.base import Observation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import ReflectedViews
from domesim.observation.followed import Followed
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.stereo import StereoObservation


@final
class Kind(Enum):
    """What an observation is; the value names it."""

    LOW_RANK = "a dome of low rank"
    PIXELWISE = "a pair whose views mix pixelwise"
    REFLECTED_PAIR = "a pair that is reflected, and mixes pixelwise"
    TABLE = "a grey-to-grey table"
    OTHER = "a composition that no fast solver knows"


class DomePair(NamedTuple):
    """The parts of a `REFLECTED_PAIR`."""

    reflected: ReflectedViews
    crosstalk: Crosstalk


def kind_of(observation: Observation) -> Kind:
    """Returns what an observation is."""
    if isinstance(observation, LowRankObservation):
        return Kind.LOW_RANK
    if isinstance(observation, StereoObservation):
        return Kind.PIXELWISE
    if isinstance(observation, GreyToGrey):
        return Kind.TABLE
    return Kind.OTHER if parts_of(observation) is None else Kind.REFLECTED_PAIR


def parts_of(observation: Observation) -> DomePair | None:
    """The parts of a `REFLECTED_PAIR`, else None."""
    if not isinstance(observation, Followed):
        return None
    first, then = observation.first, observation.then
    uniform = isinstance(then, Crosstalk) and then.share.shape[1:] == (1, 1)
    dark = uniform and not cast("Crosstalk", then).black.any()
    if not (isinstance(first, ReflectedViews) and dark):
        return None
    return DomePair(first, cast("Crosstalk", then))
