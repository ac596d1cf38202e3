"""Traced polarised crosstalk rises off the axis, as estimated by hand from the depolarised share.

Rationale
    A silver screen keeps the hand of circularly polarised light, but for a small depolarising
    share s of it, half of which goes through the wrong filter. Where the gain lobe falls, that
    half is a larger part of what is seen: c = (s/2) / (gain - s/2) + e + e', with the leaks e, e'
    of both filters. In `stereo_cinema_silver`, polarised light is traced to seats in the sweet
    spot's row, further and further to the side (`domesim.pathtrace.polarised`, Mitsuba). It is
    compared with Mueller calculus for all cells of the screen and both eyes
    (`domesim.stereo.polarisation`, NumPy: no code is shared), and in the middle of the screen with
    the line above. Both take the same screen for granted: GGX facets of aluminium, one reflection.
    Whether a real screen is one, no measurement here tells.
Expected
    No bias against Mueller calculus, with z-scores that are standard normal. In the middle of the
    screen crosstalk rises from seat to seat, with 95 % intervals that do not touch; the line by
    hand is within 2 %. At the sweet spot it is 1.1 % within 0.05 %, which the paper has for its
    cinema: the share s and the leaks are those of Lipton (2010), and nothing is fitted. Without
    depolarisation and leaks it is 0, on a screen that forgets polarisation 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.observation.uncertain import SIGMAS
from domesim.pathtrace.polarised import crosstalk_map
from domesim.scene import load_stereo
from domesim.stereo.polarisation import crosstalk_estimate, screen_gain
from domesim.stereo.system import CircularFilter, PolarisedProjector, StereoTheatre
from testing.statistics import FALSE_ALARM, bias_p, calibration
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    at_most,
    between,
    require_tracer,
)

SCENE = "stereo_cinema_silver"
SWEET_SPOT = "sweet spot"
CELLS = (5, 9)
"""Rows and cols of the screen; the middle cell is about a metre either way."""


@dataclass(frozen=True)
class Seat:
    """Crosstalk at one seat.

    Attributes
    ----------
    aside
        How far it is to the right of the sweet spot, m.
    share, error, estimate
        (eye, row, col) traced relative crosstalk, its standard error, and that by Mueller calculus.
    by_hand
        In the middle of the screen, by the line of the module's docstring.
    """

    aside: float
    share: list[list[list[float]]]
    error: list[list[list[float]]]
    estimate: list[list[list[float]]]
    by_hand: float

    def middle(self) -> tuple[float, float, float]:
        """Traced crosstalk of the middle cell, mean of the eyes, its standard error; estimate."""
        row, col = (count // 2 for count in CELLS)
        share, error, estimate = (
            np.array(part)[:, row, col] for part in (self.share, self.error, self.estimate)
        )
        return float(share.mean()), float(np.hypot(*error) / 2), float(estimate.mean())

    def interval(self) -> tuple[float, float]:
        """95 % interval in the middle of the screen."""
        share, error, _ = self.middle()
        return share - SIGMAS * error, share + SIGMAS * error


def measure(aside: float, *, samples: int, seed: int) -> Seat:
    """Trace to a seat of the sweet spot's row, and estimate."""
    theatre = _theatre()
    x, y, z = theatre.seat(SWEET_SPOT)
    name = f"{aside:g} m aside"
    theatre = replace(theatre, seats={name: (x + aside, y, z)})
    traced = crosstalk_map(theatre, name, *CELLS, samples=samples, seed=seed)
    return Seat(
        aside,
        traced.share.tolist(),
        traced.standard_error.tolist(),
        crosstalk_estimate(theatre, name, *CELLS).tolist(),
        by_hand(theatre, float(np.arctan2(aside, -y))),
    )


def by_hand(theatre: StereoTheatre, bearing: float) -> float:
    """Crosstalk in the middle of the screen from a bearing (radians), lamps on its axis."""
    screen = theatre.screen
    astray = screen.depolarising_share * screen.albedo / 2
    leaks = theatre.projectors[0].filter.leak + theatre.eyewear[0].leak
    return astray / (float(screen_gain(screen, 0.0, bearing)) - astray) + leaks


def limits(seed: int) -> dict[str, float]:
    """Largest crosstalk without depolarisation and leaks; least and largest with nothing else."""
    theatre = _theatre()
    ideal = replace(
        theatre,
        # Small, on the axis of lamps and eye: oblique aluminium makes light a little elliptical
        screen=replace(theatre.screen, width=0.05, height=0.03, depolarising_share=0.0),
        projectors=(_ideal_lamp("left"), _ideal_lamp("right")),
        eyewear=(CircularFilter("right"), CircularFilter("left")),
        seats={"axis": (0.0, -20.0, 0.0)},
    )
    one_place = theatre.projectors[0].position
    left, right = (replace(lamp, position=one_place) for lamp in theatre.projectors)
    matt = replace(
        theatre,
        screen=replace(theatre.screen, depolarising_share=1.0),
        projectors=(left, right),
    )
    # Few cells: the eye's own shadow must not cover one
    nothing = crosstalk_map(ideal, "axis", 2, 3, samples=64, seed=seed).share
    everything = crosstalk_map(matt, "left", 2, 3, samples=64, seed=seed).share
    return {
        "none": float(np.abs(nothing).max()),
        "least of all": float(everything.min()),
        "most of all": float(everything.max()),
    }


def _ideal_lamp(hand: Any) -> PolarisedProjector:
    return PolarisedProjector((0.0, -30.0, 0.0), CircularFilter(hand))


def _theatre() -> StereoTheatre:
    theatre = load_stereo(SCENE).theatre
    assert theatre is not None
    return theatre


def run(work: Work) -> Finding:
    """Trace the row, and compare."""
    require_tracer()
    places, samples = (
        ((0.0, 2.0, 4.0, 6.0, 8.0), 512) if work.quick else (tuple(np.arange(9.0)), 4096)
    )
    found = work.each(
        {f"{aside:g} m aside, {samples} samples": aside for aside in places},
        Seat,
        lambda aside: measure(float(aside), samples=samples, seed=work.seed),
    )
    seats = tuple(found.values())
    ends = work.step("limits", dict[str, float], lambda: limits(work.seed))
    share, error, estimate = _pooled(seats)
    spread, shared = bias_p(share, error, estimate)
    normal = calibration((share - estimate) / error)
    agree = "agree" if min(spread, shared) >= FALSE_ALARM / 2 else "disagree"
    hand = max(abs(seat.by_hand / seat.middle()[0] - 1) for seat in seats)
    first, last = seats[0].middle(), seats[-1].middle()
    far = np.array(seats[-1].share).mean(axis=0)
    return Finding(
        result=(
            f"In the middle of the screen crosstalk rises from {first[0]:.3%} "
            f"(± {100 * SIGMAS * first[1]:.1g}%, 95 %) at the sweet spot to {last[0]:.2%} "
            f"(± {100 * SIGMAS * last[1]:.1g}%) {seats[-1].aside:g} m to the side. "
            f"{len(share)} figures, of cells, eyes and seats, {agree} with Mueller calculus "
            f"(chi-square p {spread:.2f}, common bias p {shared:.2f}, z-scores normal p "
            f"{normal:.2f}). The "
            f"line by hand, half of the depolarised light over what is left, and the filters' "
            f"leaks, is within {hand:.1%} in the middle.\n\n"
            f"The paper's cinema has 1.1 % at the sweet spot, too. Nothing was fitted to that: "
            f"the share follows from 200:1 that Lipton (2010) measured off silver screens with "
            f"linear filters of 3000:1, the leaks from a tenth of that for circular ones. If "
            f"3000:1 is the ratio of a crossed pair of filters, and not of each, it would be "
            f"0.8 %. How much it rises off the axis follows from the gain lobe. The paper's cinema "
            f"has 2.0 % at its periphery; here the far edge of the screen reaches {far.max():.1%} "
            f"from {seats[-1].aside:g} m aside, for a flat screen's lobe turns away from the sides "
            f"(real ones are curved)."
        ),
        checks=tuple(_checks(seats, ends, hand)),
        tables=(_table(seats),),
        figures={
            "polarised.sweet_spot": first[0],
            "polarised.side": last[0],
            "polarised.by_hand_off": hand,
            "polarised.bias_p": min(spread, shared),
        },
        left_out=(
            "Light that walls and people send back, heads, curved screens, and how filters change "
            "with angle and wavelength: the tracer has none of them.",
        ),
    )


def _pooled(seats: tuple[Seat, ...]) -> tuple[NDArray[np.float64], ...]:
    """Traced crosstalk, standard errors and estimates of all cells, eyes and seats."""
    return tuple(
        np.concatenate([np.ravel(part) for part in parts])
        for parts in zip(*((seat.share, seat.error, seat.estimate) for seat in seats), strict=True)
    )


def _checks(seats: tuple[Seat, ...], ends: Mapping[str, float], hand: float) -> Iterator[Check]:
    share, error, estimate = _pooled(seats)
    spread, shared = bias_p(share, error, estimate)
    yield at_least("p of the cells being unbiased, by their spread", spread, FALSE_ALARM / 2)
    yield at_least("p of the cells being unbiased, by what they share", shared, FALSE_ALARM / 2)
    yield at_least(
        "p of z-scores being standard normal", calibration((share - estimate) / error), FALSE_ALARM
    )
    yield between("sweet spot, middle of the screen", 100 * seats[0].middle()[0], 1.05, 1.15, "%")
    gaps = [b.interval()[0] - a.interval()[1] for a, b in pairwise(seats)]
    yield at_least("least gap between neighbours' 95 % intervals", 100 * min(gaps), 0, "%")
    rise, expected = (
        seats[-1].middle()[0] / seats[0].middle()[0],
        seats[-1].by_hand / seats[0].by_hand,
    )
    yield between(
        "crosstalk of the last seat over that of the sweet spot",
        rise,
        0.98 * expected,
        1.02 * expected,
    )
    yield at_most("the line by hand, largest relative difference", hand, 0.02)
    yield at_most("without depolarisation and leaks, largest crosstalk", ends["none"], 1e-6)
    yield at_least("on a screen that forgets, least crosstalk", ends["least of all"], 1 - 1e-5)
    yield at_most("on a screen that forgets, largest crosstalk", ends["most of all"], 1 + 1e-5)


def _table(seats: tuple[Seat, ...]) -> Table:
    def row(seat: Seat) -> tuple[float, ...]:
        share, error, estimate = seat.middle()
        whole = np.array(seat.share).mean()
        return (
            seat.aside,
            *(100 * x for x in (share, SIGMAS * error, estimate, seat.by_hand, whole)),
        )

    return Table(
        caption="Crosstalk in the middle cell of the screen, mean of both eyes, by how far the "
        "seat is to the side of the sweet spot, in its row 20 m from the screen.",
        columns=(
            Column(name="aside", unit="m", digits="g"),
            Column(name="traced", unit="%", digits=".3f"),
            Column(name="± 95 %", unit="%", digits=".1g"),
            Column(name="Mueller calculus", unit="%", digits=".3f"),
            Column(name="the line by hand", unit="%", digits=".3f"),
            Column(name="traced, mean of the whole screen", unit="%", digits=".3f"),
        ),
        rows=tuple(row(seat) for seat in seats),
    )
