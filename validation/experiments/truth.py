"""Ways to the light that share no code agree, and the closed form is off by known amounts.

Rationale
    Our walks find the reflected light of any theatre. Nobody knows the answer there, but other ways
    do not share their faults: the closed form in a bare cap; radiosity in Lambertian enclosures;
    tabulated transport; Mitsuba's own integrator with its own shapes; Radiance, likewise; the
    balance of energy. One list has the theatres (`validation.rooms`): a hemisphere of albedo 0.5
    with one thing added at a time, furnished rooms, screens whose albedo differs from place to
    place and in each primary, and rooms drawn at random. Other people's cases were not chosen to
    suit us, either: those of CIE 171:2006 that are of diffuse surfaces (`validation.cie`). The
    closed form knows nothing but a Lambertian screen that is part of a sphere; a theatre engineer
    wants to know from which albedo on that matters.
Expected
    The closed form is exact, within 3e-3 (a patch 5e-3), whatever the tilt, a truncation, black
    holes, an albedo map or a lens off the centre. It is too dark over a floor, by a wall or before
    a lit cavity, the more the higher the albedo: by more than 5 % over a floor at the spring line
    of albedo 0.1, and less over a recessed one; too bright for a gain lobe. Among seats it may be
    off either way: they hide the screen from itself, and send light back. Radiosity is within 1 %
    of paths, the quick one of ellipsoids, too. Tabulated transport of a recessed floor is within
    1e-3 of paths for white (rms; quick: 2e-3), of others within 5e-3, and for a patch within 1e-2;
    eight modes, which is what solvers take, within 5 % of a patch. Mitsuba within 2.5e-3 of the
    reflected light and three of its standard errors (its rays start a little above the surface, in
    float32). 95 % of all differences from Radiance, of drawn theatres' tabulated means and of
    energies within two of their standard errors, none beyond four and a half. Walks within 0.5 % of
    each figure that CIE 171 publishes but for three standard errors, and no further from the form
    factors than their own standard errors say. Where Radiance is not installed, it is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from validation import cie, radiance
from validation.drawing import legend_beside, plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    between,
    require_tracer,
)
from validation.rooms import EXACT, Case, chosen, drawn
from validation.ways import (
    CLOSED,
    EIGHT,
    ENERGY,
    MITSUBA,
    QUICK_RADIOSITY,
    RADIANCE,
    RADIOSITY,
    TABULATED,
    Effort,
    Light,
    Opinion,
    light_of,
)

Found = Mapping[str, Mapping[str, Light]]
"""Theatre -> picture -> its light."""

TOLERABLE = 0.05
"""Error of the reflected light that the verdict allows: a few per cent of what is seen."""
SPRING, BELOW = "floor at the spring line, albedo 0.1", "floor 0.3 r below, albedo 0.1"
RECESSED, FURNISHED = "recessed floor", "furnished, with a gain lobe"
QUICK = (
    "bare hemisphere",
    SPRING,
    BELOW,
    RECESSED,
    "tilted 20°, cut off 0.15 r below the centre",
    "gain lobe, share 0.1",
    "ellipsoid, flatter by 0.2",
    "tilted, lens aside",
    FURNISHED,
)
DRAWN, QUICK_DRAWN = 20, 2
NOISY = (TABULATED, RADIANCE, ENERGY)
"""Ways whose differences are counted in standard errors."""


def run(work: Work) -> Finding:
    """Go through all theatres by all ways, and through the published cases."""
    require_tracer()
    asked = radiance.installed()
    effort = Effort(4.0, 8, 128, 20_000) if work.quick else Effort(1.0, 12, 1024, 200_000)
    effort = effort if asked else Effort(effort.error, effort.rings, effort.samples, 0)
    count = QUICK_DRAWN if work.quick else DRAWN
    wanted = [case for case in chosen() if not work.quick or case.name in QUICK]
    wanted += [drawn(number, 7 + work.seed) for number in range(count)]
    found = work.each(
        {case.name: case for case in wanted},
        dict[str, Light],
        lambda case: light_of(case, effort, 31 + 1000 * work.seed),
    )
    steps: Mapping[str, Callable[[], list[cie.Found]]] = cie.cases(
        8 if work.quick else 64, 1 + 1000 * work.seed, asked=asked
    )
    published = {name: work.step(name, list[cie.Found], case) for name, case in steps.items()}
    return finding(wanted, found, published, quick=work.quick)


def finding(
    wanted: Sequence[Case],
    found: Found,
    published: Mapping[str, Sequence[cie.Found]],
    *,
    quick: bool,
) -> Finding:
    """What all that was measured amounts to."""
    off = {
        case.name: found[case.name]["white"].by[CLOSED].off_by
        for case in wanted
        if "white" in case.pictures and not case.even
    }
    exact = [found[c.name][c.pictures[0]].by[CLOSED].off_by for c in wanted if c.closed == EXACT]
    tabulated = found[RECESSED]["white"].by[TABULATED]
    noise = found[RECESSED]["white"].noise
    furnished = found[FURNISHED]["coloured"].by[MITSUBA]
    scores = _scores(wanted, found)
    within = float(np.mean(np.abs(np.concatenate(list(scores.values()))) <= 2))
    worst = max(cie.off(one) for case in published.values() for one in case)
    return Finding(
        result=(
            f"Where the closed form ought to be exact ({len(exact)} theatres), it is within "
            f"{np.abs(exact).max():.1e}. Over a floor of albedo 0.1 at the spring line (level with "
            f"the screen's lower edge) it finds {-off[SPRING]:.1%} too little reflected light, "
            f"with the floor 0.3 radii lower {-off[BELOW]:.1%}. Tabulated transport of a recessed "
            f"floor took {tabulated.cpu_s:.0f} CPU-s and is within "
            f"{max(tabulated.rms or 0.0, noise):.1e} of paths (rms over the screen, of the mean). "
            f"In the furnished theatre (tilted dome, off-centre lens, floor, wall, seats with "
            f"people, gain lobe) Mitsuba's integrator differs by {furnished.off_by:+.1e} ± "
            f"{furnished.error:.0e} in the primary that differs most.\n\n"
            f"{within:.0%} of {sum(map(len, scores.values()))} differences of energies, tabulated "
            f"means and Radiance are within two standard errors; their rms, 1 where errors are "
            f"just: "
            + "; ".join(f"{way} {np.sqrt(np.mean(z**2)):.2f}" for way, z in scores.items())
            + f". {sum(map(len, published.values()))} figures of four cases of CIE 171 lie within "
            f"{worst:.2%} of the published values."
        ),
        advice=_advice(wanted, found),
        checks=(
            *_closed_form_checks(wanted, found),
            *_way_checks(wanted, found, quick=quick),
            *_score_checks(scores, within, quick=quick),
            *(check for name, case in published.items() for check in cie.checks(name, case)),
        ),
        plots=() if quick else (_errors(wanted, found),),
        tables=(_theatres(found), _over_the_screen(found), cie.table(published)),
        figures={
            "truth.exact_worst": float(np.abs(exact).max()),
            "truth.mitsuba": abs(furnished.off_by),
            "truth.tabulated": max(tabulated.rms or 0.0, noise),
            "truth.tabulated_cpu_s": tabulated.cpu_s,
            "truth.within": within,
            "truth.cie_worst": worst,
            **{f"truth.closed_form.{name}": value for name, value in off.items()},
            **{
                f"truth.eight_modes.{name}": lights["patch"].by[EIGHT].rms
                for name, lights in found.items()
                if "patch" in lights and EIGHT in lights["patch"].by
            },
        },
        left_out=() if radiance.installed() else (f"Radiance. {radiance.MISSING}.",),
    )


def _closed_form_checks(wanted: Sequence[Case], found: Found) -> Iterator[Check]:
    for case in wanted:
        if case.even:
            continue
        picture = case.pictures[0]
        one = found[case.name][picture].by[CLOSED]
        noise = 4 * one.error if picture == "coloured" else 0.0
        low, high = case.closed[0] - noise, case.closed[1] + noise
        yield between(f"{case.name}: error of the closed form", one.off_by, low, high)
        if case.closed == EXACT and "patch" in case.pictures:
            patch = found[case.name]["patch"].by[CLOSED].off_by
            yield at_most(f"{case.name}: its error for a patch", abs(patch), 5e-3)
    spring, below = (found[name]["white"].by[CLOSED].off_by for name in (SPRING, BELOW))
    yield at_most(f"{SPRING}: too dark by", spring, -0.05)
    yield at_least("a recessed floor does less: difference", below - spring, 0.01)
    for family, steps in _families(wanted, found).items():
        if family.startswith("floor") and len(steps) > 1:
            errors = [lights["white"].by[CLOSED].off_by for _, lights in steps]
            yield at_most(f"{family}: darker with each step", max(np.diff(errors)), 0.0)


def _way_checks(wanted: Sequence[Case], found: Found, *, quick: bool) -> Iterator[Check]:
    for case in wanted:
        for picture, light in found[case.name].items():
            what = f"{case.name}, {picture}"
            bounds = {RADIOSITY: 1e-2, TABULATED: 1e-2, EIGHT: 0.05}
            if case.even:
                bounds = {}
            if picture == "white":
                for way in (each for each in (RADIOSITY, QUICK_RADIOSITY) if each in light.by):
                    off = light.by[way].off_by
                    yield at_most(f"{what}: {way} over paths, less 1", abs(off), 0.01)
                strict = 1e-3 if case.name == RECESSED else 5e-3
                bounds[TABULATED] = 2 * strict if quick else strict
            for way, bound in bounds.items():
                one = light.by.get(way)
                if one is not None and one.rms is not None and case.tabulated and not case.even:
                    allowed = float(np.hypot(bound, one.noise))
                    yield at_most(f"{what}: rms error, {way}", one.rms, allowed)
            if MITSUBA in light.by:
                one = light.by[MITSUBA]
                bound = 2.5e-3 + 3 * one.error
                yield at_most(f"{what}: Mitsuba's over ours, less 1", abs(one.off_by), bound)
                assert one.rms is not None
                allowed = float(np.hypot(2e-2, one.noise))
                yield at_most(f"{what}: Mitsuba's, rms over the screen", one.rms, allowed)


def _scores(wanted: Sequence[Case], found: Found) -> dict[str, np.ndarray[Any, Any]]:
    """Way -> differences of means in their standard errors, where these are all that differs."""
    scores: dict[str, list[float]] = {}
    for case in wanted:
        for way, one in found[case.name][case.pictures[0]].by.items():
            if way in (RADIANCE, ENERGY) or (way == TABULATED and case.even):
                scores.setdefault(way, []).append(one.off_by / one.error)
    return {way: np.array(z) for way, z in scores.items()}


def _score_checks(
    scores: Mapping[str, np.ndarray[Any, Any]], within: float, *, quick: bool
) -> Iterator[Check]:
    # Of few differences, chance decides what share lies within two.
    yield at_least("share within two standard errors", within, 0.5 if quick else 0.88)
    for way, z in scores.items():
        yield at_most(f"{way}: largest difference, in standard errors", np.abs(z).max(), 4.5)
        mean = abs(z.mean()) * np.sqrt(len(z))
        yield at_most(f"{way}: mean difference, in its standard errors", mean, 3.5)


def _families(
    wanted: Sequence[Case], found: Found
) -> dict[str, list[tuple[float, Mapping[str, Light]]]]:
    """Family -> how strong, and what was found, where the closed form need not be exact."""
    families: dict[str, list[tuple[float, Mapping[str, Light]]]] = {}
    for case in wanted:
        if case.value > 0 and case.closed != EXACT:
            families.setdefault(case.family, []).append((case.value, found[case.name]))
    return families


def _largest(lights: Mapping[str, Light]) -> float:
    """The closed form's largest error: mean of white or of a patch, or its evenness."""
    white, patch = lights["white"], lights["patch"]
    return max(abs(white.by[CLOSED].off_by), abs(patch.by[CLOSED].off_by), white.unevenness)


def _advice(wanted: Sequence[Case], found: Found) -> str:
    """How far each family may go, by interpolation between what was traced."""
    limits = []
    for family, steps in _families(wanted, found).items():
        errors = [0.0, *(_largest(lights) for _, lights in steps)]
        if max(errors) > TOLERABLE:
            values = [0.0, *(value for value, _ in steps)]
            limits.append(f"{family} {float(np.interp(TOLERABLE, errors, values)):.2g}")
    return (
        f"On a hemisphere of albedo 0.5 with one of these at a time, the closed form is more than "
        f"{TOLERABLE:.0%} off in reflected light (its mean or its evenness, for white or a patch) "
        f"beyond: {'; '.join(limits)}. With several, or a brighter screen, run domesim tabulate. "
        f"Tilt, truncation, holes over black, an albedo map and a lens that the scene file knows "
        f"do not matter."
    )


def _errors(wanted: Sequence[Case], found: Found) -> Plot:
    def draw(axes: Any) -> None:
        for family, steps in _families(wanted, found).items():
            errors = [0.0, *(100 * lights["white"].by[CLOSED].off_by for _, lights in steps)]
            axes.plot([0.0, *(value for value, _ in steps)], errors, "o-", label=family)
        axes.axhspan(-100 * TOLERABLE, 100 * TOLERABLE, color="#009e73", alpha=0.12, lw=0)
        axes.set(xlabel="albedo, or share", ylabel="error of the closed form, %")
        legend_beside(axes)

    return plot(
        "Error of the closed form for white against how strong is what it does not know. Green: "
        f"within {TOLERABLE:.0%}.",
        "Falling lines: the higher an albedo, the more light the closed form misses; rising ones "
        "for gain lobes and flat domes.",
        draw,
    )


def _theatres(found: Found) -> Table:
    def said(lights: Mapping[str, Light], way: str) -> str | None:
        one = next(iter(lights.values())).by.get(way)
        if one is None:
            return None
        # What has no noise of its own is told by one figure.
        if way in (CLOSED, RADIOSITY, QUICK_RADIOSITY):
            return f"{100 * one.off_by:+.1f}"
        return f"{100 * one.off_by:+.2f} ± {100 * one.error:.2f}"

    ways = (CLOSED, RADIOSITY, QUICK_RADIOSITY, TABULATED, MITSUBA, RADIANCE, ENERGY)
    rows: list[tuple[str | float | None, ...]] = []
    for name, lights in found.items():
        first, patch = next(iter(lights.values())), lights.get("patch")
        rows.append(
            (
                name,
                first.traced,
                first.error,
                100 * first.unevenness,
                None if patch is None else 100 * patch.by[CLOSED].off_by,
                *(said(lights, way) for way in ways),
            )
        )
    return Table(
        caption="Mean reflected light over the screen, of a white picture (Mitsuba's theatres: a "
        "coloured one), projector white = 1: by paths, and what other ways are off by, %. "
        "Unevenness: how far (rms) it differs from an even veil, which is all that the closed form "
        "knows. Energy: light that is missing, % of what projectors emit.",
        columns=(
            Column(name="theatre"),
            Column(name="paths", digits=".4f"),
            Column(name="±", digits=".4f"),
            Column(name="unevenness", unit="%", digits=".1f"),
            Column(name="closed form, patch", unit="%", digits="+.1f"),
            *(Column(name=way, unit="%") for way in ways),
        ),
        rows=tuple(rows),
    )


def _over_the_screen(found: Found) -> Table:
    ways = (CLOSED, RADIOSITY, TABULATED, EIGHT, MITSUBA)

    def rms(one: Opinion | None) -> str | None:
        if one is None or one.rms is None:
            return None
        return f"{100 * one.rms:.2f}" if one.rms > one.noise / 2 else f"< {100 * one.noise:.2f}"

    return Table(
        caption="Rms error over the screen relative to a picture's mean reflected light, %. Where "
        "an error is far below noise (two standard errors), only that is said.",
        columns=(
            Column(name="theatre, picture"),
            Column(name="noise of paths", unit="%", digits=".2f"),
            *(Column(name=way, unit="%") for way in ways),
            Column(name="tabulation took", unit="CPU-s", digits=".1f"),
        ),
        rows=tuple(
            (
                f"{name}, {picture}",
                100 * light.noise,
                *(rms(light.by.get(way)) for way in ways),
                light.by[TABULATED].cpu_s if TABULATED in light.by else None,
            )
            for name, lights in found.items()
            for picture, light in lights.items()
            if {EIGHT, MITSUBA} & set(light.by) and ENERGY not in light.by
        ),
    )
