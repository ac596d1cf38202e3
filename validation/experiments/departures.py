"""The closed form is exact for a bare spherical screen, and off by known amounts in other rooms.

Rationale
    The closed form knows nothing but a Lambertian screen that is part of a sphere. Floors and walls
    send light back, gain lobes and ellipsoids spread it unevenly (design section 3). A theatre
    engineer wants to know from which albedo on that matters. Each thing is added alone to a
    hemisphere of albedo 0.5, which is path-traced.
Expected
    Exact, within 3e-3 (a patch 5e-3), whatever the tilt, a truncation, black holes or an off-centre
    projector whose falloff is known. Too dark over a floor, by a wall or before a lit cavity, the
    more the higher its albedo: by more than 5 % over a floor at the spring line of albedo 0.1, and
    less over a recessed one. Too bright for a gain lobe, which sends light out of the screen's
    opening, and among seats, which stand in its way. Radiosity, which shares no code with the path
    tracer, finds the same for floors, walls and ellipsoids, within 1 %.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import ClosedFormDome
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.furniture import seating
from domesim.room.lenses import lens_gains
from domesim.room.theatre import Cavity, Floor, Lens, Lobe, Theatre, Wall
from testing.statistics import rms_difference
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    require_tracer,
)
from validation.reflection import patch, reflected

SIZE = 64
RADIUS = 5.0
TOLERABLE = 0.05
"""Error of the reflected light that the verdict allows: a few per cent of what is seen."""

DOME = Dome(RADIUS, np.pi / 2)
BARE = Theatre(DOME, (0.5, 0.5, 0.5))


@final
@dataclass(frozen=True)
class Case:
    """A theatre and what is special about it.

    Attributes
    ----------
    family
        What is varied.
    value
        How strong it is, in the family's unit.
    theatre
        The whole theatre.
    exact
        Whether the closed form ought to be exact.
    ignores_lens
        Whether the closed form is used as if the projector were even.
    eye
        Where the audience sits, m.
    """

    family: str
    value: float
    theatre: Theatre
    exact: bool = False
    ignores_lens: bool = False
    eye: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.family} {self.value:g}" if self.value else self.family


@final
@dataclass(frozen=True)
class Deviation:
    """How far the closed form is from a traced theatre.

    Attributes
    ----------
    traced, error
        Mean reflected light of a white picture, projector white = 1, and its standard error.
    closed
        By the closed form.
    unevenness
        Rms over the screen of what no even light can be: relative to the mean.
    patch_off_by
        Error of the closed form for a bright patch, mean over the screen.
    radiosity
        By radiosity, where it applies.
    """

    traced: float
    error: float
    closed: float
    unevenness: float
    patch_off_by: float
    radiosity: float | None

    @property
    def off_by(self) -> float:
        """Relative error of the closed form for a white picture."""
        return self.closed / self.traced - 1

    @property
    def largest(self) -> float:
        """The largest of its errors."""
        return max(abs(self.off_by), abs(self.patch_off_by), self.unevenness)


def cases() -> tuple[Case, ...]:
    """Every theatre, family by family."""
    found = [Case("bare hemisphere", 0.0, BARE, exact=True)]
    for albedo in (0.05, 0.1, 0.2, 0.3):
        floor = Floor(0.0, RADIUS, _grey(albedo))
        found.append(Case("floor at the spring line, albedo", albedo, replace(BARE, floor=floor)))
    for albedo in (0.05, 0.1, 0.2, 0.3):
        floor = Floor(-0.3 * RADIUS, RADIUS, _grey(albedo))
        found.append(Case("floor 0.3 r below, albedo", albedo, replace(BARE, floor=floor)))
    for height in (0.1, 0.6):
        floor = Floor(-height * RADIUS, RADIUS, _grey(0.2))
        found.append(Case("floor of albedo 0.2, depth in r", height, replace(BARE, floor=floor)))
    black = Floor(-0.3 * RADIUS, RADIUS, _grey(0.0))
    for albedo in (0.1, 0.3):
        wall = Wall(RADIUS, -0.3 * RADIUS, 0.0, _grey(albedo))
        found.append(Case("wall 0.3 r high, albedo", albedo, replace(BARE, floor=black, wall=wall)))
    for tilt in (15.0, 30.0):
        tilted = Dome(RADIUS, np.pi / 2, np.radians(tilt))
        found.append(Case("tilted alone, degrees", tilt, replace(BARE, dome=tilted), exact=True))
    cut = Dome(RADIUS, np.pi / 2, np.radians(20.0), truncated_below=-0.15 * RADIUS)
    found.append(
        Case(
            "tilted 20°, cut off below the centre, in r", 0.15, replace(BARE, dome=cut), exact=True
        )
    )
    holes = replace(BARE, perforation=0.25)
    found.append(Case("perforated over black, open share", 0.25, holes, exact=True))
    for albedo in (0.2, 0.6):
        cavity = Cavity(0.6, _grey(albedo), _grey(albedo))
        found.append(
            Case("cavity behind 25 % holes, albedo", albedo, replace(holes, cavity=cavity))
        )
    found += [
        Case("gain lobe, share", share, replace(BARE, lobe=Lobe(share, 0.3)))
        for share in (0.05, 0.1, 0.3, 0.5)
    ]
    seat = (0.0, -0.6 * RADIUS, -0.1 * RADIUS)
    found.append(
        Case(
            "gain lobe seen from the back, share", 0.3, replace(BARE, lobe=Lobe(0.3, 0.3)), eye=seat
        )
    )
    for ratio in (0.7, 0.8, 0.9, 0.95, 1.2):
        dome = Dome(RADIUS, np.pi / 2, height_ratio=ratio)
        found.append(Case("ellipsoid, height ratio", ratio, replace(BARE, dome=dome)))
    lens = Lens("fisheye", (0.0, -0.5 * RADIUS, 0.0), (0.0, 0.0, RADIUS), field=2 * np.pi)
    aside = replace(BARE, lenses=(lens,), corrected=False)
    found.append(Case("projector off centre, falloff known, in r", 0.5, aside, exact=True))
    found.append(Case("projector off centre, falloff ignored, in r", 0.5, aside, ignores_lens=True))
    for albedo in (0.1, 0.3):
        solids, _ = seating(
            floor_height=-0.3 * RADIUS, rows=6, seats_per_row=9, first_row=2.5, row_spacing=0.95,
            seat_spacing=0.6, rise=0.15, within=0.95 * RADIUS, albedo=_grey(albedo), occupied=0.8,
            audience_albedo=_grey(albedo), seed=1, look_at=(0.0, 4.0, 3.0),
        )  # fmt: skip
        found.append(
            Case(
                "seats and audience, black floor, albedo",
                albedo,
                replace(BARE, floor=black, solids=tuple(solids)),
            )
        )
    return tuple(found)


QUICK = (
    "bare hemisphere",
    "floor at the spring line, albedo 0.1",
    "floor 0.3 r below, albedo 0.1",
    "tilted 20°, cut off below the centre, in r 0.15",
    "perforated over black, open share 0.25",
    "gain lobe, share 0.1",
    "ellipsoid, height ratio 0.8",
    "projector off centre, falloff known, in r 0.5",
)


def measure(case: Case, *, error: float, resolution: int, seed: int) -> Deviation:
    """Trace a theatre with a white picture and a patch, each pixel to a relative `error`.

    `resolution` is that of radiosity.
    """
    theatre = case.theatre
    tracer = Tracer(theatre)
    gain = lens_gains(theatre, SIZE, SIZE).sum(0) if theatre.lenses else None
    closed = ClosedFormDome(
        theatre.dome,
        SIZE,
        SIZE,
        albedo=theatre.screen_albedo,
        lens_gain=None if case.ignores_lens else gain,
    )
    areas = theatre.dome.screen_areas(SIZE, SIZE)
    share = areas / areas.sum()
    means: list[float] = []
    errors: list[float] = []
    models: list[float] = []
    uneven: list[float] = []
    for picture in (np.ones((SIZE, SIZE, 3), np.float32), patch(SIZE)):
        source = tracer.picture(picture)
        pair = [
            tracer.screen(
                source,
                SIZE,
                SIZE,
                Settings(error=error, least=16, most=1 << 14, seed=seed + number),
                eye=case.eye,
            )
            for number in range(2)
        ]
        mean = sum(traced.pooled_error(share)[0] for traced in pair) / 2
        even = np.full((SIZE, SIZE, 3), mean)
        means.append(mean)
        one, other = (traced.pooled_error(share)[1] for traced in pair)
        errors.append(float(np.hypot(one, other)) / 2)
        uneven.append(rms_difference(even, pair[0].mean, pair[1].mean, share) / mean)
        models.append(float(np.sum(share * reflected(closed, picture)[..., 0])))
    second = None
    others = theatre.floor is not None or theatre.dome.height_ratio != 1
    if others and not theatre.beyond_enclosure:
        second = float(radiosity(theatre, resolution=resolution).mean_gain()[0])
    return Deviation(
        traced=means[0],
        error=errors[0],
        closed=models[0],
        unevenness=max(0.0, uneven[0]),
        patch_off_by=models[1] / means[1] - 1,
        radiosity=second,
    )


def run(work: Work) -> Finding:
    """Trace all theatres, and say how far one may go."""
    require_tracer()
    wanted = [case for case in cases() if not work.quick or case.name in QUICK]
    error, resolution = (0.1, 8) if work.quick else (0.06, 12)
    found = work.each(
        {case.name: case for case in wanted},
        Deviation,
        lambda case: measure(case, error=error, resolution=resolution, seed=31 + 1000 * work.seed),
    )
    families: dict[str, list[tuple[float, Deviation]]] = {}
    for case in wanted:
        families.setdefault(case.family, []).append((case.value, found[case.name]))
    limits = _limits(families)
    exact = [abs(found[case.name].off_by) for case in wanted if case.exact]
    spring = found["floor at the spring line, albedo 0.1"]
    below = found["floor 0.3 r below, albedo 0.1"]
    worst = max((found[case.name] for case in wanted), key=lambda one: abs(one.off_by))
    verdict = (
        f"On a hemisphere of albedo 0.5 with one of these at a time, the closed form is more than "
        f"{TOLERABLE:.0%} off in reflected light (its mean or its evenness, for a white picture or "
        f"a patch) if {'; or '.join(limits)}. With several, or a brighter screen, run domesim "
        f"tabulate. Tilt, truncation and screen perforations over black do not matter, nor does an "
        f"off-centre projector that the scene file knows."
        + (" Walls, cavities, seats: in the full run only." if work.quick else "")
    )
    return Finding(
        result=(
            f"Where the closed form ought to be exact ({len(exact)} theatres), it is within "
            f"{max(exact):.1e}. Over a floor of albedo 0.1 at the spring line (level with the "
            f"screen's lower edge) it finds {-spring.off_by:.1%} too little reflected light, with "
            f"the floor 0.3 radii lower {-below.off_by:.1%}. The largest error of {len(found)} "
            f"theatres is {worst.off_by:+.0%}.{_remarks(found)}"
        ),
        advice=verdict,
        checks=tuple(_checks(wanted, found, work.quick)),
        plots=() if work.quick else (_floors(families), _shapes(families)),
        tables=(_table(wanted, found),),
        figures={
            **{f"departures.{name}": one.off_by for name, one in found.items()},
            "departures.exact_worst": max(exact),
        },
    )


def _checks(wanted: Sequence[Case], found: Mapping[str, Deviation], quick: bool) -> list[Check]:
    checks = [
        at_most(f"{case.name}: error of the closed form", abs(found[case.name].off_by), 3e-3)
        for case in wanted
        if case.exact
    ]
    spring = found["floor at the spring line, albedo 0.1"].off_by
    below = found["floor 0.3 r below, albedo 0.1"].off_by
    checks += [
        at_most(f"{case.name}: its error for a patch", abs(found[case.name].patch_off_by), 5e-3)
        for case in wanted
        if case.exact
    ]
    for case in wanted:
        if case.family.startswith(("floor", "wall", "cavity")):
            checks.append(at_most(f"{case.name}: too dark", found[case.name].off_by, -0.01))
        if case.family.startswith("gain lobe"):
            checks.append(at_least(f"{case.name}: too bright", found[case.name].off_by, 0.02))
        if case.family.startswith("seats"):
            checks.append(at_least(f"{case.name}: too bright", found[case.name].off_by, -0.01))
    checks += [
        at_most("floor at the spring line, albedo 0.1: too dark by", spring, -0.05),
        at_least("a recessed floor does less: difference", below - spring, 0.01),
    ]
    for case in wanted:
        one = found[case.name]
        if one.radiosity is not None:
            checks.append(
                at_most(
                    f"{case.name}: radiosity over traced, less 1",
                    abs(one.radiosity / one.traced - 1),
                    0.01,
                )
            )
    if not quick:
        for family in ("floor at the spring line, albedo", "floor 0.3 r below, albedo"):
            errors = [found[case.name].off_by for case in wanted if case.family == family]
            checks.append(at_most(f"{family}: darker with each step", max(np.diff(errors)), 0.0))
    return checks


def _remarks(found: Mapping[str, Deviation]) -> str:
    """What only the full run traces."""
    dark, light = (
        found.get(f"seats and audience, black floor, albedo {albedo}") for albedo in (0.1, 0.3)
    )
    aside = found.get("projector off centre, falloff ignored, in r 0.5")
    if dark is None or light is None or aside is None:
        return ""
    return (
        f" Seats and people hide the screen from itself as well as sending light back: "
        f"{dark.off_by:+.1%} with an albedo of 0.1 and {light.off_by:+.1%} with 0.3, but "
        f"{light.patch_off_by:+.1%} for a patch. Where the falloff of a projector that stands half "
        f"a radius off the centre is ignored, a patch's reflected light is "
        f"{aside.patch_off_by:+.0%} off."
    )


def _limits(families: Mapping[str, Sequence[tuple[float, Deviation]]]) -> list[str]:
    """How far each family may go, by interpolation between what was traced."""
    sentences = {
        "floor at the spring line, albedo": "a floor at the lower edge has an albedo above {:.2f}",
        "floor 0.3 r below, albedo": "one 0.3 radii lower has more than {:.2f}",
        "wall 0.3 r high, albedo": "a wall of that height has more than {:.2f}",
        "gain lobe, share": "a gain lobe (shiny paint) has more than {:.1%} of the light",
        "cavity behind 25 % holes, albedo": "what is behind holes of 25 % has more than {:.2f}",
    }
    found = []
    for family, sentence in sentences.items():
        steps = [(0.0, 0.0)] + [(value, one.largest) for value, one in families.get(family, ())]
        values, errors = (np.array(column) for column in zip(*steps, strict=True))
        if errors.max() > TOLERABLE:
            found.append(sentence.format(float(np.interp(TOLERABLE, errors, values))))
    flat = [
        (1 - value, one.largest)
        for value, one in families.get("ellipsoid, height ratio", ())
        if value < 1
    ]
    if flat and max(error for _, error in flat) > TOLERABLE:
        values, errors = (
            np.array(column) for column in zip(*sorted([(0.0, 0.0), *flat]), strict=True)
        )
        found.append(
            f"the dome is more than {float(np.interp(TOLERABLE, errors, values)):.0%} flatter than "
            f"a sphere"
        )
    seats = [one for _, one in families.get("seats and audience, black floor, albedo", ())]
    if seats and max(one.largest for one in seats) > TOLERABLE:
        found.append(f"there are seats and people (up to {max(x.largest for x in seats):.0%})")
    return found


def _table(wanted: Sequence[Case], found: Mapping[str, Deviation]) -> Table:
    return Table(
        caption="A hemisphere of albedo 0.5 with one thing added, white picture. Error: reflected "
        "light by the closed form over the traced light, less 1; unevenness: how far (rms) the "
        "traced light differs from an even veil, which is all that the closed form knows.",
        columns=(
            Column(name="theatre"),
            Column(name="traced", unit="of direct", digits=".4f"),
            Column(name="±", digits=".4f"),
            Column(name="closed form", unit="of direct", digits=".4f"),
            Column(name="error", unit="%", digits="+.1f"),
            Column(name="error, patch", unit="%", digits="+.1f"),
            Column(name="unevenness", unit="%", digits=".1f"),
            Column(name="radiosity", unit="of direct", digits=".4f"),
        ),
        rows=tuple(
            (
                case.name,
                one.traced,
                one.error,
                one.closed,
                100 * one.off_by,
                100 * one.patch_off_by,
                100 * one.unevenness,
                one.radiosity,
            )
            for case in wanted
            for one in (found[case.name],)
        ),
    )


def _floors(families: Mapping[str, Sequence[tuple[float, Deviation]]]) -> Plot:
    names = {
        "floor at the spring line, albedo": "floor at the spring line",
        "floor 0.3 r below, albedo": "floor 0.3 r below",
        "wall 0.3 r high, albedo": "wall 0.3 r high",
        "seats and audience, black floor, albedo": "seats and audience",
        "cavity behind 25 % holes, albedo": "cavity behind 25 % holes",
    }

    def draw(axes: Any) -> None:
        for family, name in names.items():
            steps = [(0.0, 0.0)] + [(value, one.off_by) for value, one in families[family]]
            values, errors = zip(*steps, strict=True)
            axes.plot(values, [100 * error for error in errors], "o-", label=name)
        axes.axhspan(-100 * TOLERABLE, 100 * TOLERABLE, color="#009e73", alpha=0.12, lw=0)
        axes.set(xlabel="its albedo", ylabel="error of the closed form, %")
        axes.legend()

    return plot(
        "Error of the closed form against the albedo of what else is in the room. Green: within "
        f"{TOLERABLE:.0%}.",
        "Falling lines: the higher the albedo, the more light the closed form misses.",
        draw,
    )


def _shapes(families: Mapping[str, Sequence[tuple[float, Deviation]]]) -> Plot:
    def draw(axes: Any) -> None:
        lobes, flat = families["gain lobe, share"], families["ellipsoid, height ratio"]
        axes.plot(
            [0, *(value for value, _ in lobes)],
            [0, *(100 * one.off_by for _, one in lobes)],
            "o-",
            label="gain lobe of that share: error",
        )
        axes.plot(
            [0, *(value for value, _ in lobes)],
            [0, *(100 * one.unevenness for _, one in lobes)],
            "o--",
            label="its unevenness",
        )
        order = sorted((abs(1 - value), one) for value, one in flat if value < 1)
        axes.plot(
            [0, *(value for value, _ in order)],
            [0, *(100 * one.off_by for _, one in order)],
            "s-",
            label="ellipsoid flatter by that share: error",
        )
        axes.plot(
            [0, *(value for value, _ in order)],
            [0, *(100 * one.unevenness for _, one in order)],
            "s--",
            label="its unevenness",
        )
        axes.axhspan(-100 * TOLERABLE, 100 * TOLERABLE, color="#009e73", alpha=0.12, lw=0)
        axes.set(xlabel="share", ylabel="%")
        axes.legend(fontsize=8.5)

    return plot(
        "Gain lobes (roughness 0.3) and flat ellipsoids: error of the mean, and rms unevenness of "
        "the reflected light over the screen.",
        "Errors and unevenness grow with the share of the lobe and with the flattening.",
        draw,
    )


def _grey(albedo: float) -> tuple[float, float, float]:
    return (albedo, albedo, albedo)
