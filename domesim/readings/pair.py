"""A stereo pair of projectors from one file of readings: responses, crosstalk, common gamut.

Four sessions are needed, both projectors through both filters. Each eye's own one tells its
projector's primaries and response as this eye sees them; with the other one, crosstalk. A ramp may
be read without a filter instead: filters change how bright, not how light depends on codes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.readings.crosstalk import MeasuredCrosstalk, measured_crosstalk
from domesim.readings.gamut import CommonGamut, common_gamut
from domesim.readings.grey_to_grey import MeasuredGreyToGrey
from domesim.readings.meter import EYES, NO_FILTER, Readings
from domesim.readings.response import Display, Response, checked_display
from domesim.readings.tables import Mistakes

Floats = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class MeasuredPair:
    """Everything that readings of a stereo pair tell; tuples are (left, right).

    Parameters
    ----------
    source
        The file's name.
    noise
        How uncertain a reading is, in words.
    displays
        Each eye's own projector through its own filter.
    leaks
        The other projector through this eye's filter.
    bare
        Each projector without a filter; None where it was not read so.
    crosstalk
        To each eye.
    gamut
        What both projectors can show.
    grey_to_grey
        By eye, where it was measured.
    """

    source: str
    noise: str
    displays: tuple[Display, Display]
    leaks: tuple[Display, Display]
    bare: tuple[Display | None, Display | None]
    crosstalk: tuple[MeasuredCrosstalk, MeasuredCrosstalk]
    gamut: CommonGamut
    grey_to_grey: Mapping[str, MeasuredGreyToGrey] = field(default_factory=dict)

    @property
    def responses(self) -> tuple[Response | None, Response | None]:
        """Code value -> light, through the own filter or else without one; None without ramps."""
        left, right = (
            own.response or (None if bare is None else bare.response)
            for own, bare in zip(self.displays, self.bare, strict=True)
        )
        return left, right

    @property
    def matrices(self) -> Floats:
        """(view, own primary, other primary) C of both eyes, in the projectors' own linear RGB."""
        return np.stack([crosstalk.matrix for crosstalk in self.crosstalk])

    @property
    def common_matrices(self) -> Floats:
        """(view, primary, primary) C of both eyes, in linear RGB of the common gamut.

        P^-1 M_own C T_other: an entry may be negative, as a ghost's colour may lie outside the
        common gamut.
        """
        own = np.linalg.inv(self.gamut.matrices)
        return np.stack([own[v] @ self.matrices[v] @ self.gamut.matrices[1 - v] for v in range(2)])

    @property
    def common_uncertainty(self) -> Floats:
        """(change, view, primary, primary) of `common_matrices`, one standard deviation each.

        The changes are errors of the ghosts' readings: each component of each primary's colour is
        off by itself, black in all three primaries at once. What own primaries are off by makes the
        own picture's colours wrong, not the ghost.
        """
        inverse = np.linalg.inv(self.gamut.primaries)
        changes = []
        for view, leak in enumerate(self.leaks):
            other = self.gamut.matrices[1 - view]
            single = np.sqrt(leak.primaries_variance)
            for xyz, primary in np.ndindex(3, 3):
                seen = np.zeros((3, 3))
                seen[xyz, primary] = single[xyz, primary]
                changes.append((view, inverse @ seen @ other))
            for xyz, error in enumerate(np.sqrt(leak.black_variance)):
                seen = np.zeros((3, 3))
                seen[xyz] = error
                changes.append((view, inverse @ seen @ other))
        result = np.zeros((len(changes), 2, 3, 3))
        for number, (view, change) in enumerate(changes):
            result[number, view] = change
        return result

    def report(self) -> list[str]:
        """Lines for a person."""
        lines = [f"{self.source}: noise of a reading {self.noise}"]
        for display in (*self.displays, *self.bare):
            lines += [] if display is None else display.report()
        for leak in self.leaks:
            lines += [f"{leak.name}: {note}" for note in leak.notes]
        for crosstalk in self.crosstalk:
            lines += crosstalk.report()
        for table in self.grey_to_grey.values():
            lines += table.report()
        lines += self.gamut.report()
        for eye, matrix in zip(EYES, self.common_matrices, strict=True):
            rows = ", ".join("[" + ", ".join(f"{cell:.5f}" for cell in row) + "]" for row in matrix)
            lines.append(f"  crosstalk in the common gamut, as scenes have it: to_{eye} = [{rows}]")
        return lines


def measured_pair(
    readings: Readings,
    *,
    allow_negative: bool = False,
    white: tuple[float, float] | None = None,
    grey_to_grey: Mapping[str, MeasuredGreyToGrey] | None = None,
) -> MeasuredPair:
    """A stereo pair from readings.

    Parameters
    ----------
    readings
        Readings of both projectors through both filters (`domesim.readings.meter.read_readings`).
    allow_negative
        See `domesim.readings.crosstalk.measured_crosstalk`.
    white
        See `domesim.readings.gamut.common_gamut`.
    grey_to_grey
        Tables of another file (`domesim.readings.grey_to_grey.read_grey_to_grey`), to keep and
        report with the rest.

    Raises
    ------
    InputError
        If a session is missing, or with everything that does not fit together.
    """
    missing = [
        f"{projector} projector through {eye} filter"
        for eye in EYES
        for projector in EYES
        if (projector, eye) not in readings.sessions
    ]
    if missing:
        raise InputError(
            f"{readings.source}: a stereo pair needs both projectors through both filters, got no "
            f"reading of the {', '.join(missing)}; measure them, or read the file as one display"
        )
    mistakes = Mistakes(readings.source)
    displays = [checked_display(readings.session(eye, eye), mistakes) for eye in EYES]
    leaks = [
        checked_display(readings.session(other, eye), mistakes, with_response=False)
        for eye, other in zip(EYES, reversed(EYES), strict=True)
    ]
    bare = [
        checked_display(readings.session(eye, NO_FILTER), mistakes)
        if (eye, NO_FILTER) in readings.sessions
        else None
        for eye in EYES
    ]
    mistakes.raise_any()
    own, other = _both(displays), _both(leaks)
    crosstalk = []
    for eye, intended, unintended in zip(EYES, own, other, strict=True):
        with mistakes.collecting():
            crosstalk.append(
                measured_crosstalk(eye, intended, unintended, allow_negative=allow_negative)
            )
    left, right = (np.nan if d.black is None else float(d.black[1]) for d in own)
    gamut = None
    with mistakes.collecting():
        gamut = common_gamut(own[0].primaries, own[1].primaries, white=white, blacks=(left, right))
    mistakes.raise_any()
    assert gamut is not None
    noise = readings.noise
    return MeasuredPair(
        source=readings.source,
        noise=f"{noise.relative:.2%} and {decimal(noise.absolute, 2)} cd/m² ({noise.origin})",
        displays=own,
        leaks=other,
        bare=(bare[0], bare[1]),
        crosstalk=(crosstalk[0], crosstalk[1]),
        gamut=gamut,
        grey_to_grey=dict(grey_to_grey or {}),
    )


def _both(displays: list[Display | None]) -> tuple[Display, Display]:
    left, right = displays
    assert left is not None
    assert right is not None
    return left, right
