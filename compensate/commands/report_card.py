"""``domesim report-card``: a flat screen's contrast and crosstalk; what two eyes see of a pair."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from compensate.figures import Appraisal
from compensate.pose import Stage
from compensate.report_card import (
    EYES_AGE,
    METHODS,
    Crosstalk,
    crosstalk,
    disparity,
    to_the_eye,
    viewer_crosstalk,
    ways,
)
from compensate.ruler import PEOPLE_SAY
from domesim.commands.options import SeatName, Telling, TransportFile, grouped
from domesim.commands.render import SceneArgument
from domesim.commands.shows import Masters, require_one_seat
from domesim.errors import InputError
from domesim.host.console import Console, about
from domesim.host.numbers import decimal, ratio
from domesim.inspection.contrast import contrast
from domesim.scene import CinemaScene, FlatScene, StereoScene
from domesim.scene.choice import SceneChoice


@grouped
def report_card(
    scene: SceneArgument,
    masters: Masters,
    telling: Telling,
    seat: SeatName = None,
    transport: TransportFile = None,
) -> None:
    """Tell a flat screen's contrast and crosstalk, and what two eyes see of a pair on it."""
    console = telling.console()
    system = SceneChoice(scene, transport, seat).load()
    if isinstance(system, CinemaScene):
        if not masters.master is masters.left is masters.right is None:
            raise InputError(
                f"{scene}: a 2-D cinema's report card is of the cinema alone; for a master in it "
                f"use 'domesim compare'"
            )
        console.figures({"scene": system.name} | _of_room(system, console))
        return
    if not isinstance(system, StereoScene):
        raise InputError(
            f"{scene}: a report card is of a flat screen, got a dome; for that use 'domesim "
            f"scene check {scene}'"
        )
    require_one_seat(system, seat, "a report card is of one seat")
    found = crosstalk(system)
    console.say(f"{system.name}, {system.chosen[0]}: {system.model}")
    for eye, each in found.items():
        console.say(*_told(eye, each))
    figures: dict[str, Any] = {
        "scene": system.name,
        "seat": system.chosen[0],
        "crosstalk": {
            eye: {**asdict(each), "verdict": each.verdict} for eye, each in found.items()
        },
    }
    if system.way is not None:
        figures |= _of_room(system, console)
    if not masters.master is masters.left is masters.right is None:
        figures["pair"] = _of_pair(system, masters, console)
    console.figures(figures)


def _of_room(scene: FlatScene, console: Console) -> dict[str, Any]:
    """Figures of system contrast, which are said, too."""
    found, (lit, dark) = contrast(scene), to_the_eye(scene)
    veil, seen = dark - found.dark, lit / dark
    console.say(
        *found.lines(),
        f"ANSI contrast to an eye of {EYES_AGE:g} years: {ratio(seen)} (its own stray light adds "
        f"{decimal(veil)} cd/m² to black fields)",
    )
    return {**found.figures(), "eye_veil_cd_m2": veil, "ansi_contrast_to_the_eye": seen}


def _told(eye: str, each: Crosstalk) -> tuple[str, ...]:
    worst = "" if each.worst == each.system else f" (worst place {each.worst:.2%})"
    return (
        f"{eye} eye: system crosstalk {each.system:.2%}{worst}, extinction ratio "
        f"{ratio(each.extinction)}",
        f"  {each.verdict}",
    )


def _of_pair(scene: StereoScene, masters: Masters, console: Console) -> dict[str, Any]:
    """Figures of a pair, which are said, too."""
    show = masters.find()
    if len(show.moments) > 1:
        raise InputError(
            f"{masters.master or masters.left}: a report card is of one pair, got "
            f"{len(show.moments)}; name one"
        )
    (moment,) = show.moments
    with about(moment[0]):
        posed, _ = Stage(scene).pose_frame(show.read(moment, repair=masters.repair))
        found = ways(posed)
    depth, viewer, clipped = disparity(posed), viewer_crosstalk(posed), Appraisal(posed).clipped
    console.say(
        f"{moment[0].name}:",
        f"  disparity: {depth['nearest_deg']:+.2f}° to {depth['farthest_deg']:+.2f}° (+ is before "
        f"the screen), known on {depth['sure']:.0%} of the picture",
        f"  viewer crosstalk: median {viewer['median']:.1%}, above 10% on "
        f"{viewer['share_above_10']:.1%} of the picture",
        f"  too dark for exact subtraction: {clipped:.1%} of the picture",
    )
    for method, each in found.items():
        console.say(
            f"  {METHODS[method]:<12} quality lost: {each.fused_loss:.2f} JOD with both eyes, "
            f"{each.one_eye:.2f} JOD with one; contrast off by {each.contrast:.2f} thresholds; "
            f"rivalry on {each.rivalry:.1%} of the picture"
        )
    console.say(f"  {PEOPLE_SAY}")
    return {
        "clipped": clipped,
        "disparity": dict(depth),
        "viewer_crosstalk": dict(viewer),
        "methods": {method: asdict(each) for method, each in found.items()},
    }
