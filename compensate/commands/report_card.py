"""``domesim report-card``: a flat screen's contrast and crosstalk; what two eyes see of a pair."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from compensate.figures import Appraisal
from compensate.pose import Posed, Stage
from compensate.report_card import (
    EYES_AGE,
    METHODS,
    Crosstalk,
    crosstalk,
    disparity,
    losses,
    to_the_eye,
    viewer_crosstalk,
    ways,
)
from compensate.ruler import PEOPLE_SAY
from compensate.shows.eyes import told, votes
from domesim.commands.options import AmbientIs, BlackIs, SeatName, Telling, TransportFile, grouped
from domesim.commands.render import SceneArgument
from domesim.commands.shows import Masters, require_one_seat
from domesim.errors import InputError
from domesim.host.console import Console, about
from domesim.host.numbers import decimal, ratio
from domesim.inspection.contrast import contrast
from domesim.inspection.gamuts import colours_of
from domesim.observation.stereo import VIEWS
from domesim.scene import CinemaScene, FlatScene, StereoScene
from domesim.scene.choice import SceneChoice


@grouped
def report_card(
    scene: SceneArgument,
    masters: Masters,
    telling: Telling,
    seat: SeatName = None,
    transport: TransportFile = None,
    black: BlackIs = None,
    ambient: AmbientIs = None,
) -> None:
    """Tell a flat screen's contrast and crosstalk, and what two eyes see of a pair on it."""
    console = telling.console()
    system = SceneChoice(scene, transport, seat, black, ambient).load()
    if isinstance(system, CinemaScene):
        if not masters.master is masters.left is masters.right is None:
            raise InputError(
                f"{scene}: a 2-D cinema's report card is of the cinema alone; for a master in it "
                f"use 'domesim compare'"
            )
        colours = colours_of(system.projector)
        console.say(*colours.lines())
        console.figures({"scene": system.name} | _of_room(system, console) | colours.figures())
        return
    if not isinstance(system, StereoScene):
        raise InputError(
            f"{scene}: a report card is of a flat screen, got a dome; for that use 'domesim "
            f"scene check {scene}'"
        )
    require_one_seat(system, seat, "a report card is of one seat")
    found = crosstalk(system)
    console.say(f"{system.name}, {system.chosen[0]}: {system.model}")
    ranked = sorted(found, key=lambda name: found[name].system)
    for eye in found if len(found) == 2 else dict.fromkeys((ranked[0], ranked[-1])):
        console.say(*_told(eye, found[eye]))
    colours = colours_of(system.projector)
    console.say(*colours.lines())
    figures: dict[str, Any] = {
        **colours.figures(),
        "scene": system.name,
        "seat": system.chosen[0],
        "crosstalk": {
            eye: {**asdict(each), "verdict": each.verdict} for eye, each in found.items()
        },
    }
    if system.way is not None:
        figures |= _of_room(system, console)
    if not masters.master is masters.left is masters.right is None:
        if system.views == 2:
            figures["pair"] = _of_pair(system, masters, console)
        else:
            figures["quilt"] = _of_quilt(system, masters, console)
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
    name = f"{eye} eye" if eye in VIEWS else eye
    return (
        f"{name}: system crosstalk {each.system:.2%}{worst}, extinction ratio "
        f"{ratio(each.extinction)}",
        f"  {each.verdict}",
    )


def _of_pair(scene: StereoScene, masters: Masters, console: Console) -> dict[str, Any]:
    """Figures of a pair, which are said, too."""
    moment, posed = _posed(scene, masters, "pair")
    with about(moment):
        found = ways(posed)
    depth = disparity(posed)
    console.say(
        f"{moment.name}:",
        f"  disparity: {depth['nearest_deg']:+.2f}° to {depth['farthest_deg']:+.2f}° (+ is before "
        f"the screen), known on {depth['sure']:.0%} of the picture",
    )
    counted = votes(posed.desired, scene)
    if line := told(counted):
        console.say(f"  {line}")
    figures = _of_views(posed, console) | {"exchanged": counted.exchanged}
    for method, each in found.items():
        console.say(
            f"  {METHODS[method]:<12} quality lost: {each.fused_loss:.2f} JOD with both eyes, "
            f"{each.one_eye:.2f} JOD with one; contrast off by {each.contrast:.2f} thresholds; "
            f"rivalry on {each.rivalry:.1%} of the picture"
        )
    console.say(f"  {PEOPLE_SAY}")
    methods = {method: asdict(each) for method, each in found.items()}
    return {**figures, "disparity": dict(depth), "methods": methods}


def _of_quilt(scene: StereoScene, masters: Masters, console: Console) -> dict[str, Any]:
    """Figures of a quilt, which are said, too."""
    moment, posed = _posed(scene, masters, "quilt")
    console.say(f"{moment.name}:")
    figures, found = _of_views(posed, console), losses(posed)
    for method, lost in found.items():
        console.say(f"  {METHODS[method]:<12} quality lost: {lost:.2f} JOD with one eye")
    console.say(f"  {PEOPLE_SAY}")
    return {**figures, "methods": {method: {"one_eye": lost} for method, lost in found.items()}}


def _posed(scene: StereoScene, masters: Masters, kind: str) -> tuple[Path, Posed]:
    """The one master that was asked for."""
    show = masters.find(scene)
    if len(show.moments) > 1:
        raise InputError(
            f"{masters.master or masters.left}: a report card is of one {kind}, got "
            f"{len(show.moments)}; name one"
        )
    (moment,) = show.moments
    with about(moment[0]):
        posed, _ = Stage(scene).pose_frame(show.read(moment, repair=masters.repair))
    return moment[0], posed


def _of_views(posed: Posed, console: Console) -> dict[str, Any]:
    """What is told of views by themselves."""
    viewer, clipped = viewer_crosstalk(posed), Appraisal(posed).clipped
    console.say(
        f"  {posed.scene.graded}",
        f"  viewer crosstalk: median {viewer['median']:.1%}, above 10% on "
        f"{viewer['share_above_10']:.1%} of the picture",
        f"  too dark for exact subtraction: {clipped:.1%} of the picture",
    )
    return {**vars(posed.scene.grade), "clipped": clipped, "viewer_crosstalk": dict(viewer)}
