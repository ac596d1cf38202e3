"""Design mode: what a theatre should be like for a show; its paint, holes, light, crosstalk.

A *knob* is one figure of a scene's file. It is turned through its range, all else left alone, and
the show is compensated (the default method) in each theatre that this makes. Projectors send the
same lumens all along: a darker paint makes white, the projector's black and stray light darker by
the same share. What quality costs is told by the luminance of white that is left.

The observation is that of the closed form; floor and wall are added by radiosity. With `trace` the
room of each theatre is path-traced: furniture, exit signs and gain lobes, too. Without them paint
is advised to within 0.05 JOD of what tracing finds (the experiment `advice`).

Quality falls or rises along a knob nearly always one way. The advised value is the one next to
today's at which the quality is reached: where two values of the range have it between them, the
secant between them is followed, and the theatre at its end is computed.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, final

import numpy as np

from compensate.figures import Appraisal
from compensate.plain import PlainRuler
from compensate.pose import Stage
from compensate.solve import solved
from domesim.errors import InputError
from domesim.frames import Master
from domesim.scene import DomeScene, Scene
from domesim.scene.dome_file import StarProjectorSection
from domesim.scene.loading import load_scene
from domesim.scene.measured_dome import whole_transport

CLOSE = 0.01
"""JOD: an advised theatre loses at most so much less than it may."""
TRACED_ERROR = 2e-3
"""Relative standard error of traced light."""

Content = dict[str, Any]


@final
@dataclass(frozen=True)
class Knob:
    """One figure of a scene's file.

    Attributes
    ----------
    name, unit
        What it is.
    now
        Today's value.
    values
        Its range, rising.
    turn
        Changes a file's content to a value.
    """

    name: str
    unit: str
    now: float
    values: tuple[float, ...]
    turn: Callable[[Content, float], None]

    def at(self, content: Content, value: float) -> Content:
        """The file's content with the knob at a value."""
        turned = copy.deepcopy(content)
        self.turn(turned, value)
        return turned


@final
@dataclass(frozen=True)
class Outcome:
    """A show in a theatre, as compensated; means over its frames.

    Attributes
    ----------
    value
        Of the knob.
    lost
        Quality, JOD.
    black
        Luminance of the darker half, cd/m².
    star
        Magnitude of the faintest star by Crumey's typical observer: of the video, or of a star
        projector beside it. None without a sky.
    white
        Luminance of white, cd/m².
    """

    value: float
    lost: float
    black: float
    star: float | None
    white: float


@final
@dataclass(frozen=True)
class Advice:
    """What turning one knob does.

    Attributes
    ----------
    knob
        The knob.
    outcomes
        Over its range, today's value included.
    now
        Today's.
    advised
        The theatre next to today's with the wanted quality; None if no value of the range has it.
    impossible
        Values of the range that make no theatre, and why.
    """

    knob: Knob
    outcomes: tuple[Outcome, ...]
    now: Outcome
    advised: Outcome | None
    impossible: tuple[str, ...] = ()

    @property
    def best(self) -> Outcome:
        """The outcome of the range that loses least."""
        return min(self.outcomes, key=lambda outcome: outcome.lost)


def knobs(content: Content, *, trace: bool) -> list[Knob]:
    """Lists the knobs that a scene has.

    Parameters
    ----------
    content
        Of its file (`domesim.scene.loading.scene_content`).
    trace
        Whether rooms are path-traced: gain, lean and exit signs make no difference otherwise.
    """
    if "dome" in content:
        return list(_of_dome(content, trace=trace))
    return list(_of_pair(content))


def advise(
    content: Content,
    frames: Sequence[Master],
    wanted: float | None,
    *,
    trace: bool = False,
    names: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> list[Advice]:
    """Turns all knobs of a scene.

    Parameters
    ----------
    content
        Of its file.
    frames
        Of the show.
    wanted
        Quality that may be lost, JOD; None to advise nothing.
    trace
        Whether to path-trace each theatre's room.
    names
        Knobs to turn; all of them by default.
    progress
        Told which theatre is next.

    Returns
    -------
    advice
        One a knob.

    Raises
    ------
    InputError
        If a frame is no master for the scene, there is no such knob, or no room can be traced.
    """
    found = knobs(content, trace=trace)
    known = [knob.name for knob in found]
    for name in names or ():
        if name not in known:
            raise InputError(f"--knob {name!r} is not known here; use one of {', '.join(known)}")
    if not found:
        raise InputError(
            f"{content.get('name', 'the scene')}: wanted a dome, or a pair whose crosstalk is a "
            f"share or polarisation, got neither"
        )
    chosen = [knob for knob in found if not names or knob.name in names]
    progress("today")
    today = outcome(content, frames, 0.0, trace=trace)
    return [_advice(knob, content, frames, wanted, today, progress, trace) for knob in chosen]


def _advice(
    knob: Knob,
    content: Content,
    frames: Sequence[Master],
    wanted: float | None,
    today: Outcome,
    progress: Callable[[str], None],
    trace: bool,
) -> Advice:
    now = replace(today, value=knob.now)

    def at(value: float) -> Outcome:
        if value == knob.now:
            return now
        progress(f"{knob.name} {value:g}")
        return outcome(knob.at(content, value), frames, value, trace=trace)

    outcomes, impossible = [], []
    for value in sorted({*knob.values, knob.now}):
        try:
            outcomes.append(at(value))
        except InputError as error:
            impossible.append(f"{value:g}: {error}")
    advised = None if wanted is None else _reached(outcomes, now, wanted, at)
    return Advice(knob, tuple(outcomes), now, advised, tuple(impossible))


def _reached(
    outcomes: Sequence[Outcome], now: Outcome, wanted: float, at: Callable[[float], Outcome]
) -> Outcome | None:
    """The outcome next to now's that loses no more than `wanted`."""
    if now.lost <= wanted:
        return now
    place = outcomes.index(now)
    crossings = []
    for way in (outcomes[place:], outcomes[place::-1]):
        for bad, good in pairwise(way):
            if good.lost <= wanted:
                crossings.append((bad, good))
                break
    if not crossings:
        return None
    bad, good = min(crossings, key=lambda pair: abs(pair[0].value - now.value))
    for _ in range(6):
        if good.lost > wanted - CLOSE:
            break
        # A little beyond the secant's crossing, so that it ends on the good side
        share = (bad.lost - wanted + CLOSE / 2) / (bad.lost - good.lost)
        tried = at(bad.value + min(share, 1.0) * (good.value - bad.value))
        bad, good = (bad, tried) if tried.lost <= wanted else (tried, good)
    return good


def outcome(
    content: Content, frames: Sequence[Master], value: float, *, trace: bool = False
) -> Outcome:
    """Compensates a show in a theatre.

    Parameters
    ----------
    content
        Of the scene's file.
    frames
        The show.
    value
        Of the knob that was turned.
    trace
        Whether to path-trace the room.
    """
    return outcome_in(theatre(content, trace=trace), frames, value)


def outcome_in(scene: Scene, frames: Sequence[Master], value: float) -> Outcome:
    """Compensates a show in a theatre that is loaded: see `outcome`."""
    stage, found = Stage(scene), []
    for frame in frames:
        posed, _ = stage.pose_frame(frame)
        light = solved(posed, "perceptual").light
        ruler = PlainRuler(posed.wanted[: scene.views], scene, posed.screen)
        black = ruler.black(posed.seen(light)[: scene.views])
        star = ruler.projected(black) or ruler.faintest(black)
        found.append((Appraisal(posed).loss(light), black, star.crumey if star else np.nan))
    lost, black, crumey = np.mean(found, axis=0).tolist()
    return Outcome(value, lost, black, None if np.isnan(crumey) else crumey, scene.projector.white)


def theatre(content: Content, *, trace: bool) -> Scene:
    """Loads a scene with the light of its room.

    Parameters
    ----------
    content
        Of its file.
    trace
        Whether to path-trace it; else radiosity knows screen, floor and wall alone, and lamps by
        what they send to the screen.

    Raises
    ------
    InputError
        If the file is wrong, or nothing can trace.
    """
    scene = load_scene(content)
    if not isinstance(scene, DomeScene) or not scene.theatre.departures():
        return scene
    if trace:
        from domesim.pathtrace.tabulate import tabulate  # noqa: PLC0415 - loads Mitsuba

        return scene.with_transport(tabulate(scene.theatre, error=TRACED_ERROR).transport)
    return scene.with_transport(whole_transport(scene.theatre.enclosure))


def left_out(content: Content, *, trace: bool) -> tuple[str, ...]:
    """Lists what of a scene's room `theatre` leaves out."""
    scene = load_scene(content)
    if trace or not isinstance(scene, DomeScene):
        return ()
    return replace(scene.theatre, lamps=()).beyond_enclosure


# Knobs.


def _of_dome(content: Content, *, trace: bool) -> Iterator[Knob]:
    screen, weights = content["screen"], load_scene(content).projector.luminance_weights
    albedo = float(weights @ np.broadcast_to(screen["albedo"], 3))
    holes = screen.get("perforation", 0.0)

    def paint(turned: Content, value: float) -> None:
        each = np.broadcast_to(screen["albedo"], 3) * (value / albedo)
        turned["screen"]["albedo"] = [float(x) for x in np.minimum(each, 0.99)]
        _screen_light(turned, value / albedo)

    def perforate(turned: Content, value: float) -> None:
        turned["screen"]["perforation"] = value
        _screen_light(turned, (1 - value) / (1 - holes))

    yield Knob("paint", "albedo", albedo, (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8), paint)
    yield Knob("holes", "share", holes, (0.0, 0.1, 0.2, 0.3, 0.4), perforate)
    if trace:
        lobe = screen.get("lobe", {"share": 0.0, "roughness": 0.3})

        def gain(turned: Content, value: float) -> None:
            turned["screen"]["lobe"] = {**lobe, "share": value}

        def lean(turned: Content, value: float) -> None:
            turned["dome"]["tilt_deg"] = value

        yield Knob("gain", "share in the lobe", lobe["share"], (0.0, 0.2, 0.4), gain)
        tilt = content["dome"].get("tilt_deg", 0.0)
        yield Knob("lean", "°", tilt, (0.0, 10.0, 20.0, 30.0), lean)
    if _stray(content) or content.get("lamps"):
        yield Knob("stray light", "times today's", 1.0, (0.0, 0.25, 0.5, 2.0), _dim)
    yield Knob("lumens", "times today's", 1.0, (0.5, 2.0, 4.0), _brighten)


def _of_pair(content: Content) -> Iterator[Knob]:
    crosstalk = content.get("crosstalk", {})
    if not ("share" in crosstalk or "polarisation" in crosstalk):
        return

    def leak(turned: Content, value: float) -> None:
        told = turned["crosstalk"]
        if "share" in told:
            told["share"] = (np.asarray(told["share"]) * value).tolist()
            return
        for key in ("depolarising_share", "projector_leak", "glasses_leak"):
            told["polarisation"][key] = told["polarisation"].get(key, 0.0) * value

    yield Knob("crosstalk", "times today's", 1.0, (0.125, 0.25, 0.5, 2.0), leak)
    if _stray(content):
        yield Knob("stray light", "times today's", 1.0, (0.0, 0.25, 0.5, 2.0), _dim)
    yield Knob("lumens", "times today's", 1.0, (0.5, 2.0, 4.0), _brighten)


def _screen_light(content: Content, more: float) -> None:
    """All light on the screen, but for what its room sends back, `more` times as bright."""
    _projectors_scaled(content, ("white_cd_m2", "black_cd_m2"), more)
    _scaled(content.get("ambient", {}), ("luminance_cd_m2",), more)
    if "star_projector" in (sky := content.get("sky", {})):
        stars = StarProjectorSection(**sky["star_projector"])
        sky["star_projector"]["zero_point_lux"] = stars.zero_point_lux * more


def _brighten(content: Content, more: float) -> None:
    _projectors_scaled(content, ("white_cd_m2", "lumens", "black_cd_m2"), more)


def _projectors_scaled(content: Content, keys: Sequence[str], more: float) -> None:
    projector = content["projector"]
    for section in (projector, *projector.get("units", ())):
        _scaled(section, keys, more)


def _stray(content: Content) -> bool:
    """Whether there is light on the screen besides the projectors'."""
    return bool(content.get("ambient", {}).get("luminance_cd_m2", 0) > 0)


def _dim(content: Content, more: float) -> None:
    """Exit signs and other light that is always on."""
    for lamp in content.get("lamps", ()):
        _scaled(lamp, ("luminance_cd_m2",), more)
    _scaled(content.get("ambient", {}), ("luminance_cd_m2",), more)


def _scaled(section: dict[str, Any], keys: Sequence[str], more: float) -> None:
    for key in keys:
        if key in section:
            section[key] = (np.asarray(section[key]) * more).tolist()


def figures(advice: Sequence[Advice]) -> dict[str, Mapping[str, Any]]:
    """Returns the figures by knob, for programs."""
    return {
        each.knob.name: {
            "unit": each.knob.unit,
            "now": vars(each.now),
            "advised": None if each.advised is None else vars(each.advised),
            "outcomes": [vars(one) for one in each.outcomes],
        }
        for each in advice
    }
