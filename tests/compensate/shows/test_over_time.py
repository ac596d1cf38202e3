"""Black over time: a planet that rises fast is warned of, in its frames; nothing else is."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from stored_masters import store

from compensate.figures import Appraisal
from compensate.pose import Stage
from compensate.shows.over_time import timeline
from compensate.solve import solved
from domesim.light import Light
from domesim.scene import load_scene
from domesim.shows.timeline import Panel, Timeline, _thinned, drawn, runs

FRAMES, SIZE, RATE = 48, 48, 24.0
FIRST, LAST = 16, 40
"""Frames between which the planet rises."""
NAMES = {"untouched": "untouched", "seen": "as shown"}


def sky() -> Light:
    """Black with some stars."""
    light = np.zeros((1, SIZE, SIZE, 3), np.float32)
    places = np.random.default_rng(3).integers(SIZE // 4, 3 * SIZE // 4, (2, 12))
    light[0, places[0], places[1]] = 0.2
    return light


def risen(share: float, radius: float = 0.2) -> Light:
    """A white disc that has come up over the rim by a share of its diameter."""
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE * 2 - 1
    distance = np.hypot(x, y - (1 + radius) + 2 * radius * share)
    cover = np.clip((radius - distance) * SIZE / 2 + 0.5, 0, 1)[..., None]
    return np.asarray(sky() * (1 - cover) + cover, np.float32)


def rising(frames: int = LAST - FIRST) -> Iterable[Light]:
    """The planet stands below the rim, rises within so many frames, and stands."""
    for number in range(FRAMES):
        yield risen(float(np.clip((number - FIRST) / frames, 0, 1)))


def over_time(show: Iterable[Light]) -> Timeline:
    stage, rows, lit = Stage(load_scene("dome_planetarium")), [], None
    for light in show:
        if lit is None or not np.array_equal(light, lit):
            posed = stage.pose(light * posed_screen(light))
            appraisal = Appraisal(posed)
            row = asdict(appraisal.dark(appraisal.look(solved(posed, "perceptual").light)))
        lit = light
        rows.append(row)
    found = timeline(rows, np.arange(len(rows)) / RATE, NAMES)
    assert found is not None
    return found


def posed_screen(light: Light) -> np.ndarray:
    return load_scene("dome_planetarium").screen(*light.shape[1:3])[None, :, :, None]


def test_a_planet_that_rises_fast_is_warned_of_in_its_frames() -> None:
    found = over_time(rising())
    (alarm,) = found.alarms
    assert FIRST < alarm.first <= FIRST + 5
    assert LAST - 5 <= alarm.last <= LAST + 7  # of 0.31 s at most
    assert "visible steps (Kelly 1961)" in alarm.why
    black, lift, moved, stars = found.panels
    shown = [float(value or 0) for value in black.lines["as shown"]]
    assert shown[-1] > 3 * shown[0]
    assert np.diff(shown[FIRST:LAST]).min() > 0
    assert lift.lines["as shown"] == pytest.approx(np.subtract(shown, black.lines["master"]))
    assert max(moved.lines["as shown"][: FIRST + 1]) == 0
    assert max(moved.lines["master"]) == 0
    known = stars.lines["as shown"]
    assert known[-1] < known[0] - 0.5
    assert stars.lines["master"][-1] == pytest.approx(stars.lines["master"][0], abs=0.2)


STILL_OR_SLOW = {
    "stars alone": lambda k: risen(0.0),
    "a planet that stands": lambda k: risen(0.6),
    # By a tenth of itself in two seconds
    "a planet that brightens": lambda k: sky() + (risen(0.6) - sky()) * (0.9 + 0.1 * k / FRAMES),
    # Two seconds of five minutes
    "a planet that rises slowly": lambda k: risen(0.5 + k / (300 * RATE)),
}


@pytest.mark.parametrize("name", STILL_OR_SLOW)
def test_what_is_still_or_slow_is_not_warned_of(name: str) -> None:
    assert not over_time(map(STILL_OR_SLOW[name], range(FRAMES))).alarms


def test_what_the_show_itself_does_is_not_warned_of() -> None:
    """All of the sky, black too, brightens with the planet: a cut to day."""
    found = over_time(risen(0.6) if k < 24 else 0.3 + 0.7 * risen(0.6) for k in range(FRAMES))
    moved = found.panels[2].lines
    assert max(moved["as shown"]) > 1
    assert not found.alarms


def test_a_jump_is_warned_of_at_once_and_not_for_long() -> None:
    (alarm,) = over_time(risen(0.2 if k < 24 else 1.0) for k in range(FRAMES)).alarms
    assert alarm.first == 24
    assert alarm.last <= 24 + 7


def test_frames_that_are_not_known_are_left_out() -> None:
    row = {"master": 0.04, "untouched": 0.1, "seen": 0.1}
    assert timeline([None, row, None], [0, 1, 2], NAMES) is None
    found = timeline([row, None, row | {"seen": 0.3}], [0, 1 / RATE, 2 / RATE], NAMES)
    assert found is not None
    assert [(alarm.first, alarm.last) for alarm in found.alarms] == [(2, 2)]
    assert found.panels[2].lines["as shown"][1] is None
    assert found.panels[1].lines["as shown"] == pytest.approx([0.06, None, 0.26])
    assert len(found.panels) == 3  # without a sky
    assert "currentColor" in drawn(found, [0, 1 / RATE, 2 / RATE])


def test_a_long_show_keeps_its_ends_and_a_small_drawing() -> None:
    values, seconds = [0.0] * 36_000, np.arange(36_000) / RATE
    values[12_345], values[12_346] = 7.0, -3.0
    times, ends = _thinned(seconds, values)
    assert (min(ends), max(ends)) == (-3, 7)
    assert abs(times[int(np.argmax(ends))] - seconds[12_345]) < 72 / RATE
    assert np.diff(times).min() >= 0
    assert len(drawn(Timeline([Panel("x", {"a": values}, from_zero=False)]), seconds)) < 50_000


def test_runs_of_marks() -> None:
    assert list(runs([True, True, False, True])) == [(0, 1), (3, 3)]
    assert list(runs([False, False])) == []


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of the rising planet."""
    folder = tmp_path_factory.mktemp("planet")
    for number, light in enumerate(rising(), 1):
        store(folder / f"planet.{number:04}.exr", light[0])
    return folder


def test_the_report_shows_it(reported: Path, run: Run) -> None:
    out, options = reported / "out", ("--scene", "dome_planetarium", "--workers", "0")
    masters = reported / "planet.####.exr"
    done = run("compensate", masters, *options, "--out", out, "--pages", "0")
    ((first, last),) = re.findall(r"planet\.(\d+)\.exr to planet\.(\d+)\.exr: black", done.err)
    assert FIRST + 1 < int(first) <= FIRST + 6
    assert int(last) <= LAST + 8
    text = (out / "job/report.html").read_text()
    assert f"planet.{first}.exr to planet.{last}.exr: black moves" in text
    assert "faintest star, mag" in text
    done = run("predict", masters, *options, "--out", out / "maps", "--frames", "20-26")
    assert "black moves by up to" in done.err
