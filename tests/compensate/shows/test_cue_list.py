"""A person's cue list: methods, lifts and ramps of a show's parts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from hypothesis import given
from hypothesis import strategies as st
from stored_masters import store

from compensate.shows.cue_list import CueList, Knobs, read_cue_list
from domesim.errors import InputError
from domesim.frames import read_frame

SCENE = "dome_hemisphere"


def listed(folder: Path, text: str) -> Path:
    path = folder / "cues.csv"
    path.write_text(text)
    return path


def test_a_list_says_what_each_frame_gets(tmp_path: Path) -> None:
    table = (
        "last,first,Lift,method,ramp,note\n20,11,4,,4,planet\nshow.0009.exr,show.0003.exr,,none,,"
    )
    cues = read_cue_list(listed(tmp_path, table))
    assert cues.cues == (Knobs(3, 9, "none"), Knobs(11, 20, None, 4.0, 4))
    methods = [cues.method(number, "subtractive") for number in (2, 3, 9, 10, 11)]
    assert methods == ["subtractive", "none", "none", "subtractive", "subtractive"]
    lifts = [cues.lift(number, 1.0) for number in range(9, 18)]
    np.testing.assert_allclose(lifts, [1, 1, 1.6, 2.2, 2.8, 3.4, 4, 4, 4])
    assert cues.lift(21, 1.0) == 1


@given(
    st.lists(
        st.tuples(st.integers(1, 9), st.floats(0, 4), st.integers(0, 12)), min_size=1, max_size=5
    ),
    st.floats(0, 4),
)
def test_lifts_stay_between_those_that_are_listed(
    parts: list[tuple[int, float, int]], usual: float
) -> None:
    """And a ramp's steps are alike, and all of one direction."""
    cues, first = [], 1
    for length, lift, ramp in parts:
        cues.append(Knobs(first, first + length - 1, None, lift, ramp))
        first += length
    found = CueList("made", tuple(cues))
    ends = [usual, *(lift for _, lift, _ in parts)]
    for cue in cues:
        lifts = [found.lift(number, usual) for number in range(cue.first - 1, cue.last + 1)]
        assert min(ends) - 1e-9 <= min(lifts) <= max(lifts) <= max(ends) + 1e-9
        steps = np.diff(lifts)[: cue.ramp + 1]
        np.testing.assert_allclose(steps, steps[0], atol=1e-9)


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ("", "no text"),
        ("first,last\n", "the columns first and last"),
        ("from,to\n1,2\n", "got 'from, to'"),
        ("first,last,method\n1,2,best\n", "'best' is not known; use one of perceptual"),
        ("first,last,lift\n1,2,9\n", "lift must lie between 0 and 4, got '9'"),
        ("first,last,lift\n1,2,nan\n", "got 'nan'"),
        ("first,last,ramp\n1,2,-1\n", "ramp must lie between 0"),
        ("first,last\n2,1\n", "a last frame from 2 on, got 1"),
        ("first,last\nshow,2\n", "a frame's number or name as first, got 'show'"),
        ("first,last\n1,5\n5,9\n", "do not overlap, got 1 to 5 and 5 to 9"),
    ],
)
def test_what_is_no_list(tmp_path: Path, table: str, word: str) -> None:
    with pytest.raises(InputError, match=r"cues\.csv") as told:
        read_cue_list(listed(tmp_path, table))
    assert word in str(told.value)


def test_frames_are_those_of_their_own_settings(run: Run, tmp_path: Path) -> None:
    """A show by a list has the bytes of frames that were done one by one."""
    row, col = np.mgrid[:32, :32] - 15.5
    night = np.where(np.hypot(row - 9, col)[..., None] < 5, 0.9, [0.05, 0.06, 0.1])
    for number in range(1, 5):
        store(tmp_path / f"in.{number}.png", night / number, "uint16")
    table = listed(tmp_path, "first,last,method,lift,ramp\n2,2,none,,\n3,4,,3,1\n")
    masters, scene = tmp_path / "in.#.png", ("--scene", SCENE, "--workers", 0)
    done = run("compensate", masters, *scene, "--cues", table, "--out", tmp_path / "cued", "--json")
    assert done.code == 0, done.err
    assert [each["method"] for each in json.loads(done.out)["frames"]][1] == "none"
    one_by_one = {1: (), 2: ("--method", "none"), 3: ("--lift", 2), 4: ("--lift", 3)}
    for number, options in one_by_one.items():
        alone = tmp_path / f"alone{number}"
        run("compensate", tmp_path / f"in.{number}.png", *scene, *options, "--out", alone)
        same = [read_frame(each / f"in.{number}.png").pixels for each in (alone, tmp_path / "cued")]
        np.testing.assert_array_equal(*same)
    report = (tmp_path / "cued/job/report.html").read_text()
    assert "--cues" in report
    assert "cues.csv" in report
    again = run("compensate", masters, *scene, "--out", tmp_path / "cued")
    again.is_refused("other settings")
    both = run("compensate", masters, *scene, "--cues", table, "--method", "auto", "--out", "x")
    both.is_refused("--cues", "--method auto")
