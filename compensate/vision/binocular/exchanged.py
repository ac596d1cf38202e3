"""Whether left and right are exchanged: what one eye alone sees must look like what lies behind.

Beside a near thing each eye sees a strip of the background that is hidden from the other: on the
near thing's left in the left picture, on its right in the right one. With exchanged eyes near and
far change places, and the strip looks like what seems to be the near thing. So each strip that
neither way of matching is sure of, and that is about as wide as disparity jumps there, is compared
with its two neighbours: it votes for the one whose luminance it has.

Note 0019 has how often that is right. That lower things are nearer was of no use: the sign was
wrong for seven of 16 pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.vision.binocular.disparity import DARKEST, Disparity, Floats, disparities

ENOUGH = 200
"""Votes of one pair below which nothing is said; of several, each must have them."""
EXCHANGED = 0.42
"""Share of strips that look like what is behind, below which eyes look exchanged."""
_BESIDE = 3  # pixels on each side that must be sure
_LEAST_JUMP = 2.0  # pixels
_TELLING = np.log(1.4)
"""Difference of the two neighbours' likeness, of logarithms, below which a strip does not vote."""


@final
@dataclass(frozen=True)
class Votes:
    """Strips that one eye alone sees.

    Attributes
    ----------
    behind, count
        How many look like what is behind, of how many.
    """

    behind: int
    count: int

    def __add__(self, other: Votes) -> Votes:
        """Adds the votes of another pair."""
        return Votes(self.behind + other.behind, self.count + other.count)

    @property
    def enough(self) -> bool:
        """Whether they are enough to say something."""
        return self.count >= ENOUGH

    @property
    def exchanged(self) -> bool:
        """Whether left and right look exchanged; False where too few strips say it."""
        return self.enough and self.behind < EXCHANGED * self.count


def votes_of(left: Floats, right: Floats) -> Votes:
    """Lets the strips of a pair vote.

    Parameters
    ----------
    left, right
        (row, col) luminance, white = 1.

    Returns
    -------
    votes
        Of both pictures.

    Raises
    ------
    InputError
        As for `disparities`.
    """
    from_left, from_right = disparities(left, right)
    mirrored = Disparity(-from_right.shift[:, ::-1], from_right.sure[:, ::-1])
    seen = [(left, from_left), (right[:, ::-1], mirrored)]
    votes = [vote for light, disparity in seen for vote in _votes(light, disparity)]
    return Votes(sum(votes), len(votes))


def _votes(luminance: Floats, disparity: Disparity) -> Iterator[bool]:
    """Whether each strip looks like what is behind, which is on its left."""
    light = np.log(np.clip(luminance, DARKEST, 1))
    cols = light.shape[1]
    for line, shift, sure in zip(light, disparity.shift, disparity.sure, strict=True):
        ends = np.flatnonzero(np.diff(np.concatenate([[True], sure, [True]])))
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            if first < _BESIDE or last > cols - _BESIDE:
                continue
            before, after = slice(first - _BESIDE, first), slice(last, last + _BESIDE)
            jump = shift[last] - shift[first - 1]
            fits = jump >= _LEAST_JUMP and abs(last - first - jump) <= 0.5 * jump + 2
            if not (fits and sure[before].all() and sure[after].all()):
                continue
            strip = np.median(line[first:last])
            behind, near = (abs(strip - np.median(line[side])) for side in (before, after))
            if abs(behind - near) > _TELLING:
                yield bool(behind < near)
