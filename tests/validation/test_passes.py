"""Passes of a frame: what they move is counted."""

import math

import pytest

from testing.masters import night, write_exr
from validation.benchmarks.passes import passes


def test_bytes_of_each_pass_are_counted(tmp_path):
    write_exr(tmp_path / "a.exr", night(1024)[0])
    found = {
        each.name: each.moved
        for each in passes(tmp_path / "a.exr", "dome_imax", tmp_path / "b.exr", frames=2)
    }
    disc, codes, light, areas = math.pi / 4, 3 * 2, 3 * 4, 4
    assert found["reading"] == found["compressing, writing"] == found["reading back"] == codes
    # Strips are as wide as the screen is somewhere in their rows
    for name in ("what is seen of the master", "what is lost as stored"):
        assert found[name] == pytest.approx(disc * (codes + areas), rel=0.2)
    # Stars are looked for in the master
    expected = disc * (light + areas + codes)
    assert found["what is seen of it"] == pytest.approx(expected, rel=0.2)
    assert found["the aim, and its subtraction"] > disc * (2 * codes + 4 * light)
    assert found["all"] == pytest.approx(sum(found.values()) - found["all"])
