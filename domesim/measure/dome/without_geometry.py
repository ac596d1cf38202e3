"""A survey without geometry: photographs of patterns -> the screen's reflected light as stored.

Whatever reflects in the room, the result is a `Transport` of a few modes, and a scene of the bare
screen that goes with it. That scene's albedo is no paint's: it is the albedo with which the closed
form of the bare screen reflects as much of a white picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.measure.dome.file import Task
from domesim.measure.dome.measured import bare_scene, measured_section
from domesim.measure.dome.ranks import Ranks, cross_validated, modes_of
from domesim.measure.dome.reflected import Core, fitted
from domesim.measure.dome.responses import Responses, responses_of
from domesim.observation.transport import NODES, PHOTOGRAPHS, Transport, node_places
from domesim.observation.uncertain import SIGMAS
from domesim.room.theatre import Theatre
from domesim.scene import DomeScene

Floats = NDArray[np.float64]

DEGREE = 6
"""Degree of the functions on the screen, the same as that of tabulated transports."""
_LOOSER = 3.0
"""Factor by which parts of the core may be larger where white alone is asked for. What they are
expected to be foretells other pictures best, but draws white with it, by 1.7 of its standard errors
at 1 % noise of a pixel. With 10 in place of 3 heavy-tailed noise costs a third more."""
_AMBIENT_DEGREE = 3
_FADING = 0.4
"""Standard deviation of ambient light's parts of one degree over that of the degree below."""
_LARGE = 0.01
"""Error of the reflected light of left-out patterns that is reported."""
_MOST_MISFIT = 4.0
"""Chi² over its degrees of freedom from which nothing is answered."""


@final
@dataclass(frozen=True, eq=False)
class Found:
    """What photographs tell of a screen's reflected light.

    Attributes
    ----------
    transport
        The operator, of its few modes.
    ranks
        How many modes the patterns tell.
    gain
        (primary,) median over the places of white by direct light alone, in the photographs' unit.
    spread
        (primary, 2) between which 90 % of the places' gains lie.
    white, white_error
        (primary,) reflected light of a white picture, 1 = its direct light, and standard errors.
    ambient
        (primary,) mean over the screen of the light of a black picture, 1 = projector white.
    places, hidden
        How many places of the screen count, and how many the camera does not see.
    photographs, patterns
        How many there are; black is no pattern.
    chi2, degrees
        Over all primaries.
    """

    transport: Transport
    ranks: Ranks
    gain: Floats
    spread: Floats
    white: Floats
    white_error: Floats
    ambient: Floats
    places: int
    hidden: int
    photographs: int
    patterns: int
    chi2: float
    degrees: int

    @property
    def misfit(self) -> float:
        """Factor by which standard errors have been widened for residuals beyond noise."""
        return float(np.sqrt(max(1.0, self.chi2 / self.degrees)))


def surveyed_alone(task: Task) -> Found:
    """What a survey file's photographs tell.

    Raises
    ------
    InputError
        If it has none, if there are readings as well, or if they tell too little.
    """
    if task.photographs is None:
        raise InputError("--without-geometry needs photographs, got readings of a meter")
    if task.readings:
        raise InputError("--without-geometry takes photographs only; leave the readings out")
    return found_in(
        responses_of(task.scene.theatre, task.patterns, task.photographs, DEGREE),
        task.scene.theatre,
    )


def found_in(responses: Responses, theatre: Theatre) -> Found:
    """What responses tell.

    Raises
    ------
    InputError
        If they cannot tell direct from reflected light, if no pattern can be left out, or if they
        are not what light of the patterns can look like.
    """
    seen = [fitted(responses, p) for p in range(3)]
    shown = np.stack([core.shown(responses, p) for p, core in enumerate(seen)], -1)
    responses = responses.weighed(shown, shared=True)
    # Places that count in no fit are shown as they were seen
    chi2 = float(np.sum((responses.value - shown) ** 2 / responses.variance))
    degrees = sum(core.degrees for core in seen)
    if degrees <= 0 or chi2 > _MOST_MISFIT * degrees:
        raise InputError(
            f"the photographs are not what the patterns can look like on this screen: chi² "
            f"{chi2:.0f} for {degrees} degrees of freedom; check which pattern each photograph "
            f"shows, exposures, the camera's place and direction, and the dome's shape"
        )
    # What residuals have beyond the noise of neighbours is noise to all that follows
    widened = replace(responses, variance=responses.variance * max(1.0, chi2 / degrees))
    cores = [fitted(widened, p, core.expectation, core.core) for p, core in enumerate(seen)]
    ranks = cross_validated(widened, cores)
    if ranks is None:
        raise InputError(
            "too few patterns: with one left out, the others do not tell what it should look like; "
            "photograph halves, rings and sectors besides black and white"
        )
    modes = modes_of([core.core for core in cores])[:, : ranks.rank]
    pairs = np.einsum("fi,gj->ijfg", modes, modes).reshape(-1, *cores[0].core.shape)
    error = [np.sqrt(np.diag(core.uncertainty.of(pairs))) for core in cores]
    ambient = np.stack([_ambient(widened, core, p) for p, core in enumerate(cores)])
    tables = responses.basis.at(*np.meshgrid(node_places(NODES), node_places(NODES)))
    transport = Transport(
        theatre.dome,
        np.tensordot(modes.T, tables, axes=1),
        np.stack([modes.T @ core.core @ modes for core in cores]),
        ranks.widening * np.stack(error).reshape(3, ranks.rank, ranks.rank),
        np.tensordot(ambient, tables, axes=1),
    )
    first = np.zeros((1, *cores[0].core.shape))
    first[0, 0, 0] = 1
    whites = [
        fitted(
            widened,
            p,
            replace(core.expectation, size=_LOOSER * core.expectation.size),
            core.core,
        )
        for p, core in enumerate(cores)
    ]
    gains = [core.gain[core.counted] for core in cores]
    return Found(
        transport=transport,
        ranks=ranks,
        gain=np.array([np.median(gain) for gain in gains]),
        spread=np.array([np.quantile(gain, (0.05, 0.95)) for gain in gains]),
        white=np.array([core.core[0, 0] for core in whites]),
        white_error=ranks.widening
        * np.sqrt([float(core.uncertainty.of(first)[0, 0]) for core in whites]),
        ambient=ambient[:, 0],
        places=min(int(core.counted.sum()) for core in cores),
        hidden=max(core.hidden for core in cores),
        photographs=len(responses.pattern),
        patterns=len(np.unique(responses.pattern[responses.excitation.any((1, 2))])),
        chi2=chi2,
        degrees=degrees,
    )


def _ambient(responses: Responses, core: Core, primary: int) -> Floats:
    """(function,) ambient light over local gain, smooth where the camera sees nothing of it."""
    here = core.counted
    seen = core.ambient[here] / core.gain[here]
    low = responses.basis.degrees <= _AMBIENT_DEGREE
    functions = responses.functions[np.ix_(low, here)]
    noise = (responses.variance[..., primary] ** -1).sum(0)[here] ** -0.5 / core.gain[here]
    size = max(float(np.sqrt(np.mean(seen**2))), float(np.median(noise)))
    expected = size * _FADING ** responses.basis.degrees[low]
    expected[0] *= 10
    # Nothing is known of how uneven it is within a place: no place counts alone.
    weighted = functions / np.hypot(noise, 0.1 * size)
    matrix = weighted @ weighted.T + np.diag(expected**-2)
    result = np.zeros(len(responses.basis))
    right = weighted @ (seen / np.hypot(noise, 0.1 * size))
    result[low] = np.linalg.solve(matrix, right)
    return result


def stored(fit: Found, scene: DomeScene, survey: Path) -> Transport:
    """The transport as it is stored, for a scene that was written with it: less its black."""
    return replace(
        fit.transport,
        ambient=fit.transport.ambient - scene.ambient / scene.projector.white,
        provenance={
            "scene": scene.name,
            "digest": scene.digest,
            "method": PHOTOGRAPHS,
            "measured": survey.name,
            "rank": fit.ranks.rank,
            "cross_validated_error": fit.ranks.error.tolist(),
            "relative_error": fit.transport.relative_error(),
            "domesim": version("domesim"),
        },
    )


def lines_of(task: Task, fit: Found) -> list[str]:
    """What was found, for a person."""
    unit = "cd/m²" if task.file.absolute else "of the photographs' unit"
    hidden = f"; {fit.hidden} others are hidden from the camera" if fit.hidden else ""
    lines = [] if task.registered is None else [task.registered.in_words()]
    lines += [
        f"{fit.photographs} photographs of black and {fit.patterns} patterns, {fit.places} "
        f"places of the screen{hidden}",
        f"white, direct light alone ({unit}), median and 90 % of the places: "
        + _each(
            f"{decimal(gain)} ({decimal(low)} to {decimal(high)})"
            for gain, (low, high) in zip(fit.gain, fit.spread, strict=True)
        ),
        "reflected light of a white picture, of its direct light: "
        + _each(
            f"{white:.4f} ± {decimal(SIGMAS * error, 1)}"
            for white, error in zip(fit.white, fit.white_error, strict=True)
        ),
        "black as it is seen, of white: " + _each(decimal(part) for part in fit.ambient),
    ]
    verdict = "noise alone explains the residuals"
    if fit.misfit > 1 + 3 / np.sqrt(2 * fit.degrees):
        verdict = f"more than noise, for which errors have been widened {fit.misfit:.2f} times"
    lines.append(f"fit: chi² {fit.chi2:.0f} for {fit.degrees} degrees of freedom; {verdict}")
    ranks = fit.ranks
    errors = ", ".join(f"{rank}: {_share(part)}" for rank, part in enumerate(ranks.error, 1))
    lines.append(
        f"error of the reflected light of patterns left out, by number of modes: {errors}; taken: "
        f"{ranks.rank}"
    )
    if ranks.widening > 1:
        lines.append(
            f"patterns left out are foretold worse than claimed: errors have been widened "
            f"{ranks.widening:.2f} times"
        )
    left = float(ranks.error[ranks.rank - 1])
    if left > _LARGE:
        lines.append(
            f"check the room: smooth modes leave {left:.1%} of the reflected light unexplained, as "
            f"of a glossy screen, shadows before a projector, or a floor that meets the screen"
        )
    if ranks.exhausted:
        lines.append(
            f"too few patterns: these can tell no more than {len(ranks.error)} modes; photograph "
            f"halves, rings, sectors and checkerboards"
        )
    return lines


def figures_of(fit: Found) -> dict[str, Any]:
    """The same for a program."""
    return {
        "gain": fit.gain.tolist(),
        "reflected_of_white": fit.white.tolist(),
        "reflected_standard_error": fit.white_error.tolist(),
        "ambient_of_white": fit.ambient.tolist(),
        "rank": fit.ranks.rank,
        "cross_validated_error": fit.ranks.error.tolist(),
        "error_widening": fit.ranks.widening,
        "more_patterns_would_tell_more": fit.ranks.exhausted,
        "places": fit.places,
        "hidden_places": fit.hidden,
        "chi2": fit.chi2,
        "degrees_of_freedom": fit.degrees,
    }


def measured_scene(task: Task, fit: Found, name: str, survey: Path) -> str:
    """A scene of the bare screen that goes with the transport."""
    share = task.scene.dome.screen_area / (4 * np.pi * task.scene.dome.radius**2)
    albedo = fit.white / (share * (1 + fit.white))
    slope = 1 / (share * (1 + fit.white) ** 2)
    return bare_scene(
        task,
        name,
        survey,
        told=f"Reflected light as measured: {survey.name}; its transport goes with it.",
        albedo=albedo,
        gain=fit.gain,
        ambient=fit.ambient,
        measured=measured_section(
            task,
            survey,
            names=("screen",),
            values=albedo[None],
            errors=(slope * fit.white_error)[None],
            correlations=np.eye(3),
            chi2=fit.chi2,
            degrees=fit.degrees,
            model_error=float(fit.ranks.error[fit.ranks.rank - 1]),
        ),
    )


def _each(parts: Any) -> str:
    return ", ".join(f"{p} {part}" for p, part in zip("RGB", parts, strict=True))


def _share(part: float) -> str:
    return f"{part:.2%}" if part > 0 else "as small as noise"
