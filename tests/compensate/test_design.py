"""Design: knobs change what they say and nothing else, and what is advised has the quality."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from stored_masters import store

from compensate import design
from compensate.design import CLOSE, Knob, advise, knobs, left_out, outcome, theatre
from compensate.plain import PlainRuler
from compensate.pose import Stage
from compensate.solve import solved
from domesim.errors import InputError
from domesim.frames import Master, read_master
from domesim.scene import DomeScene
from domesim.scene.loading import scene_content
from testing.content import charts

DOME = {
    "name": "mine",
    "dome": {"radius_m": 6.0},
    "screen": {"albedo": [0.5, 0.6, 0.4], "perforation": 0.2},
    "projector": {"white_cd_m2": 10.0, "black_cd_m2": 0.005, "primaries": "BT.709"},
    "ambient": {"luminance_cd_m2": 0.002},
    "viewing": {"adaptation_cd_m2": 1.0},
}
WAYS = {"paint", "holes", "stray light", "lumens"}


def knob(content: dict[str, object], name: str, *, trace: bool = False) -> Knob:
    return {each.name: each for each in knobs(content, trace=trace)}[name]


@pytest.fixture
def frame(tmp_path: Path) -> Master:
    light = charts.CHARTS["magnitudes"](64)[0]
    return read_master([store(tmp_path / "m.exr", np.asarray(light), "float")])


def test_paint_changes_all_light_on_the_screen() -> None:
    paint = knob(DOME, "paint")
    turned = paint.at(DOME, paint.now / 2)
    assert paint.now == pytest.approx(0.2126 * 0.5 + 0.7152 * 0.6 + 0.0722 * 0.4, abs=1e-4)
    assert turned["screen"]["albedo"] == pytest.approx([0.25, 0.3, 0.2])
    assert turned["projector"]["white_cd_m2"] == pytest.approx(5)
    assert turned["projector"]["black_cd_m2"] == pytest.approx(0.0025)
    assert turned["ambient"]["luminance_cd_m2"] == pytest.approx(0.001)
    assert DOME["screen"] == {"albedo": [0.5, 0.6, 0.4], "perforation": 0.2}


def test_holes_are_paint_that_is_not_there() -> None:
    turned = knob(DOME, "holes").at(DOME, 0.6)
    assert turned["screen"] == {"albedo": [0.5, 0.6, 0.4], "perforation": 0.6}
    assert turned["projector"]["white_cd_m2"] == pytest.approx(5)
    lumens = {**DOME, "projector": {"lumens": 3000.0, "primaries": "BT.709"}}
    bright, dark = (
        theatre(knob(lumens, "holes").at(lumens, holes), trace=False).projector.white
        for holes in (0.2, 0.6)
    )
    assert bright == pytest.approx(2 * dark)


def test_lumens_are_the_projectors_and_stray_light_is_all_else() -> None:
    lit = knob(DOME, "lumens").at(DOME, 4.0)
    assert lit["projector"]["white_cd_m2"] == 40
    assert lit["projector"]["black_cd_m2"] == pytest.approx(0.02)
    assert lit["ambient"] == DOME["ambient"]
    room = scene_content("dome_planetarium")
    dimmed = knob(room, "stray light").at(room, 0.5)
    assert dimmed["lamps"][0]["luminance_cd_m2"] == [0, 6, 0.75]
    assert dimmed["projector"] == room["projector"]


def test_gain_and_lean_need_a_traced_room() -> None:
    assert {each.name for each in knobs(DOME, trace=False)} == WAYS
    assert {each.name for each in knobs(DOME, trace=True)} == WAYS | {"gain", "lean"}
    scenes = [knob(DOME, name, trace=True).at(DOME, 0.4) for name in ("gain", "lean")]
    gain, lean = (theatre(each, trace=False) for each in scenes)
    assert isinstance(gain, DomeScene)
    assert isinstance(lean, DomeScene)
    assert gain.theatre.lobe is not None
    assert gain.theatre.lobe.share == 0.4
    assert np.degrees(lean.dome.tilt) == pytest.approx(0.4)


@pytest.mark.parametrize("name", ["stereo_polarised_paper", "stereo_cinema_silver"])
def test_crosstalk_of_a_pair(name: str) -> None:
    content = scene_content(name)
    half = knob(content, "crosstalk").at(content, 0.5)["crosstalk"]
    told = content["crosstalk"]
    if "share" in told:
        assert half["share"] == pytest.approx(told["share"] / 2)
        return
    for key in ("depolarising_share", "projector_leak", "glasses_leak"):
        assert half["polarisation"][key] == pytest.approx(told["polarisation"][key] / 2)
    assert half["polarisation"]["roughness"] == told["polarisation"]["roughness"]


@pytest.mark.long
def test_furniture_is_known_to_a_traced_room_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design, "TRACED_ERROR", 0.2)
    box = {"name": "console", "low_m": [-1.0, -1.0, -2.0], "high_m": [1.0, 1.0, -1.0]}
    room = {**DOME, "floor": {"height_m": -2.0, "albedo": 0.3}, "boxes": [{**box, "albedo": 0.5}]}
    closed, traced = (theatre(room, trace=trace) for trace in (False, True))
    assert isinstance(closed, DomeScene)
    assert isinstance(traced, DomeScene)
    empty = theatre({**room, "boxes": []}, trace=False)
    assert isinstance(empty, DomeScene)
    assert closed.transport is not None
    assert empty.transport is not None
    assert np.array_equal(closed.transport.core, empty.transport.core)
    assert left_out(room, trace=False) == ("solids (console)",)
    assert left_out(room, trace=True) == ()
    assert traced.transport is not None
    assert traced.transport.provenance["walks"] > 0


def test_what_is_advised_has_the_quality(frame: Master) -> None:
    """And is next to today's: a little more paint has not."""
    (today,) = advise(DOME, [frame], None, names=["paint"])
    wanted = 0.6 * today.now.lost
    assert today.advised is None
    (paint,) = advise(DOME, [frame], wanted, names=["paint"])
    found = paint.advised
    assert found is not None
    assert wanted - CLOSE <= found.lost <= wanted
    assert found.value < paint.now.value
    assert found.white / paint.now.white == pytest.approx(found.value / paint.now.value)
    assert found.black < paint.now.black
    posed, _ = Stage(theatre(DOME, trace=False)).pose_frame(frame)
    ruler = PlainRuler(posed.wanted, posed.scene, posed.screen)
    black = ruler.black(posed.seen(solved(posed, "perceptual").light))
    assert paint.now.black == pytest.approx(black)
    assert black > 2 * ruler.black(posed.wanted)
    assert found.star is not None
    assert found.star > (paint.now.star or 0)
    again = outcome(paint.knob.at(DOME, found.value), [frame], found.value)
    assert again == found
    more = found.value + 0.25 * (paint.now.value - found.value)
    assert outcome(paint.knob.at(DOME, more), [frame], more).lost > wanted
    assert [one.value for one in paint.outcomes] == sorted({*paint.knob.values, paint.knob.now})


def test_what_cannot_be_reached_is_not_advised(frame: Master) -> None:
    lumens, paint = advise(DOME, [frame], 1e-6, names=["lumens", "paint"])[::-1]
    assert lumens.advised is None
    assert paint.best.lost == min(one.lost for one in paint.outcomes)
    (as_it_is,) = advise(DOME, [frame], 9.0, names=["holes"])
    assert as_it_is.advised is as_it_is.now


def test_a_value_that_makes_no_theatre_is_told(frame: Master) -> None:
    table = scene_content("stereo_polarised_paper")
    table["crosstalk"]["share"] = 0.3
    pair = Master((frame.frames[0], frame.frames[0]), frame.paths * 2, frame.colour)
    (turned,) = advise(table, [pair], None, names=["crosstalk"])
    assert [why.partition(":")[0] for why in turned.impossible] == ["2"]
    assert "crosstalk to the left eye" in turned.impossible[0]
    assert len(turned.outcomes) == len(turned.knob.values)
    assert turned.now.star is None


def test_mistakes_are_one_line(frame: Master) -> None:
    with pytest.raises(InputError, match="'paints' is not known here; use one of paint"):
        advise(DOME, [frame], None, names=["paints"])
    with pytest.raises(InputError, match="wanted a dome, or a pair"):
        advise(scene_content("cinema_2d"), [frame], None)


def test_the_command_says_what_it_costs(run: Run, tmp_path: Path) -> None:
    master = store(tmp_path / "m.exr", np.asarray(charts.CHARTS["magnitudes"](64)[0]), "float")
    arguments = ("scene", "advise", "dome_hemisphere", master, "--knob", "paint")
    out = tmp_path / "plot.svg"
    found = run(*arguments, "--quality", "0.3", "--out", out, "--json").figures()
    paint = found["knobs"]["paint"]
    said = run(*arguments, "--quality", "0.3").out
    assert f"paint: {paint['advised']['value']:.3g} albedo instead of" in said
    share = paint["advised"]["white"] / paint["now"]["white"]
    assert f"white {share:.0%} of today's" in said
    assert "<svg" in out.read_text()
    run(*arguments, "--quality", "-1").is_refused("--quality must be above 0")
