"""A seat away from the centre of a dome sees other pixels per degree, and hardly other errors.

Rationale
    Vision models here take the pixels per degree of a dome's centre everywhere. A seat near the
    front sees what is close to it coarser, and what is far finer and aslant. Domemasters of
    `quality`, 256 pixels across, are shown in `dome_planetarium` (by its closed form), and looked
    at from its seats in the middle, in the front, in the back, and at the ends of both rows. What
    is left by subtraction is weighed by Daly's sensitivity, at the seat's own pixels per degree in
    each place (`compensate.vision.resolution`) and at the assumed ones, in just-noticeable
    differences; by ColorVideoVDP, in JOD; and predicted to be seen or not.
Expected
    Seats see 0.3 to 2.4 times the assumed pixels per degree. Ignoring it changes the visible error
    of a seat by at most a quarter, and the quality lost by at most 0.3 JOD; at most 5 % of the
    screen is predicted otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from compensate.figures import Appraisal
from compensate.pose import Posed, pose
from compensate.prediction import remaining
from compensate.vision.resolution import by_resolution
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import DomeScene, load_dome
from testing.pairs import no_wider
from validation.experiment import Check, Column, Finding, Table, Work, at_least, at_most
from validation.inputs import Input, reported_domemasters

SCENE = "dome_planetarium"
SIZE = 256
CENTRE = "assumed"


@final
@dataclass(frozen=True)
class Seat:
    """What is left by subtraction, for one seat; or for the assumed centre.

    Attributes
    ----------
    least, most
        Least and largest ratio of its pixels per degree to the assumed ones.
    error
        Visible error, JND rms.
    apart
        Root-mean-square of what its JND differ from the assumed ones, place by place.
    loss
        Quality lost, JOD.
    visible
        Share of the screen that is predicted to be seen.
    otherwise
        Share of the screen that is predicted otherwise than assumed.
    """

    least: float
    most: float
    error: float
    apart: float
    loss: float
    visible: float
    otherwise: float


def seats(scene: DomeScene) -> list[str]:
    """The middle one; front and back, in the middle and at the row's end."""
    views = scene.theatre.viewpoints
    ends = []
    for row in ("front", "back"):
        depth = views[row].position[1]
        beside = [name for name, view in views.items() if view.position[1] == depth]
        ends.append(max(beside, key=lambda name: views[name].position[0]))
    return ["centre", "front", ends[0], "back", ends[1]]


def differences(posed: Posed, residual: Light) -> NDArray[np.float64]:
    """(row, col) JND of a residual, at the pixels per degree of the posed scene's seat."""
    scene = posed.scene
    viewing = replace(scene.viewing, seat=None)

    def at(factor: float) -> tuple[NDArray[np.float64]]:
        here = replace(viewing, extent=viewing.extent / factor)
        weights = scene.projector.luminance_weights
        weighting = PerceptualWeighting()(here, weights, posed.screen, scene.views)
        seen = np.asarray(weighting.apply(residual))[0]
        rows, cols = posed.screen.shape
        unit = scene.projector.white / viewing.adaptation * weighting.peak
        return (unit * np.sqrt(np.sum(seen[:, :rows, :cols] ** 2, axis=0)) * posed.screen,)

    seat = scene.viewing.seat
    if seat is None:
        return at(1.0)[0]
    return np.asarray(by_resolution(seat.scale(*posed.screen.shape), posed.screen, at)[0])


def measure(one: Input, size: int) -> dict[str, Seat]:
    """One domemaster, from every seat."""
    light = no_wider(one.read(), size).astype(np.float32)
    scene = load_dome(SCENE)
    centre = pose(light, scene)
    residual = centre.residual(centre.subtractive)
    assumed, mask = differences(centre, residual), remaining(centre).mask
    found = {
        CENTRE: Seat(
            1.0,
            1.0,
            _rms(assumed, centre),
            0.0,
            Appraisal(centre).loss_subtractive,
            float(mask[0, centre.screen].mean()),
            0.0,
        )
    }
    for name in seats(scene):
        posed = pose(light, scene.seen_from(name))
        seat = posed.scene.viewing.seat
        assert seat is not None
        scale = seat.scale(*posed.screen.shape)[posed.screen]
        here, seen = differences(posed, residual), remaining(posed).mask
        found[name] = Seat(
            float(scale.min()),
            float(scale.max()),
            _rms(here, posed),
            _rms(here - assumed, posed),
            Appraisal(posed).loss_subtractive,
            float(seen[0, posed.screen].mean()),
            float((seen != mask)[0, posed.screen].mean()),
        )
    return found


def _rms(values: NDArray[np.float64], posed: Posed) -> float:
    return float(np.sqrt(np.mean(values[posed.screen] ** 2)))


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    inputs, left_out = reported_domemasters(work)
    found = work.each(inputs, dict[str, Seat], partial(measure, size=SIZE))
    pairs = [
        (seats[CENTRE], seat)
        for seats in found.values()
        for name, seat in seats.items()
        if name != CENTRE
    ]
    rise = [seat.error / assumed.error - 1 for assumed, seat in pairs]
    apart = [seat.apart for _, seat in pairs]
    jod = [seat.loss - assumed.loss for assumed, seat in pairs]
    otherwise = [seat.otherwise for _, seat in pairs]
    return Finding(
        result=(
            f"Five seats of {SCENE} see {min(s.least for _, s in pairs):.2f} to "
            f"{max(s.most for _, s in pairs):.2f} times the assumed pixels per degree. What "
            f"subtraction leaves is off by {min(apart):.2f} to {max(apart):.2f} JND rms if that is "
            f"ignored, and the visible error differs by {min(rise):+.0%} to {max(rise):+.0%} from "
            f"what is assumed, the quality lost by {min(jod):+.2f} to {max(jod):+.2f} JOD "
            f"({np.mean(jod):+.2f} in the mean); {max(otherwise):.1%} of the screen at most is "
            f"predicted otherwise. Pixels are smaller to a seat than assumed where they are seen "
            f"aslant, or lie across a ring, and so they are to the middle one, too. `--seat` takes "
            f"them as they are."
        ),
        checks=tuple(_checks(pairs, rise, jod, otherwise)),
        tables=(_table(found),),
        figures={
            "dome_seats.apart": float(np.mean(apart)),
            "dome_seats.rise": float(np.mean(rise)),
            "dome_seats.jod": float(np.mean(jod)),
        },
        left_out=tuple(left_out),
    )


def _checks(
    pairs: list[tuple[Seat, Seat]], rise: list[float], jod: list[float], otherwise: list[float]
) -> Iterator[Check]:
    yield at_least("least pixels per degree of a seat", min(s.least for _, s in pairs), 0.3)
    yield at_most("most pixels per degree of a seat", max(s.most for _, s in pairs), 2.4)
    yield at_most("visible error of a seat, largest relative change", max(map(abs, rise)), 0.25)
    yield at_most("quality lost at a seat, largest change", max(map(abs, jod)), 0.3, "JOD")
    yield at_most("screen that is predicted otherwise", 100 * max(otherwise), 5.0, "%")


def _table(found: Mapping[str, Mapping[str, Seat]]) -> Table:
    return Table(
        caption="What subtraction leaves, as it is seen from the seats and as it is assumed.",
        columns=(
            Column(name="input"),
            Column(name="seat"),
            Column(name="least pixels per degree over the assumed", digits=".2f"),
            Column(name="most", digits=".2f"),
            Column(name="visible error", unit="JND rms", digits=".3f"),
            Column(name="apart from the assumed", unit="JND rms", digits=".3f"),
            Column(name="quality lost", unit="JOD", digits=".3f"),
            Column(name="predicted to be seen", unit="%", digits=".1f"),
            Column(name="predicted otherwise", unit="%", digits=".1f"),
        ),
        rows=tuple(
            (
                name,
                place,
                seat.least,
                seat.most,
                seat.error,
                seat.apart,
                seat.loss,
                100 * seat.visible,
                100 * seat.otherwise,
            )
            for name, places in found.items()
            for place, seat in places.items()
        ),
    )
