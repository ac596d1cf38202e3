"""Which places of a screen projectors reach: by hand, as a command, and before a job."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from domesim.frames import read_frame
from domesim.inspection.coverage import Coverage, coverage
from domesim.inspection.lightmaps import _EDGE, _TOP, HOLE, SIZE
from domesim.room.dome import Dome
from domesim.room.theatre import Lens, Theatre

DOME = Dome(4.0, np.pi / 2)
HERE = (0.0, 0.0, 0.0)
THEATRE = """
name = "mine"
[dome]
radius_m = 8.0
[screen]
albedo = 0.5
[projector]
white_cd_m2 = 10.0
[[projector.units]]
name = "only"
position_m = [0.0, 0.0, 0.0]
look_at_m = [0.0, 0.0, 1.0]
field_deg = 120.0
[viewing]
adaptation_cd_m2 = 1.0
"""


def lit_by(*lenses: Lens) -> Coverage:
    return coverage(Theatre(DOME, (0.5, 0.5, 0.5), lenses=lenses), 101)


def test_a_fisheye_that_is_too_narrow_leaves_a_ring() -> None:
    found = lit_by(Lens("half", HERE, (0.0, 0.0, 9.0), field=np.radians(120)))
    # Equidistant: two thirds of the radius, 4/9 of the disc
    assert found.dark == pytest.approx(5 / 9, abs=0.01)
    assert found.blended == 0
    (told,) = found.holes_in_words()
    assert told.startswith("55.")
    assert told.endswith("% all round, 60° to 90° from the dome's zenith")


def test_a_hole_is_where_it_is_told() -> None:
    """Two projectors, to the front and to the left (x is right, y is front): the right is dark."""
    front = Lens("front", HERE, (0.0, 1.0, 0.0), field=np.pi)
    left = Lens("left", HERE, (-1.0, 0.0, 0.0), field=np.pi)
    found = lit_by(front, left)
    assert found.dark == pytest.approx(1 / 4, abs=0.01)
    assert found.blended == pytest.approx(1 / 4, abs=0.01)
    assert "135° to the right of the front" in found.holes_in_words()[0]
    assert found.holes[20, 80]  # back and right of the picture
    assert not found.whole


def test_holes_in_the_middle_are_told_on_one_side() -> None:
    """They are as far right as left of the front but for rounding."""
    found = lit_by(Lens("one", HERE, (0.0, 1.0, 0.0), field=np.pi))
    for rows in range(1, 20):
        hole = np.zeros_like(found.screen)
        hole[10 : 10 + rows] = found.screen[10 : 10 + rows]
        for place, side in ((hole, "180"), (hole[::-1], "0")):
            assert f"{side}° to the right of the front" in found._place(place)


def test_soft_edges_add_up_before_they_are_evened_out() -> None:
    """Of two that look the same way, twice one's; a smooth step is a half in its middle."""
    one = Lens("one", HERE, (0.0, 0.0, 9.0), field=np.radians(190), blend=np.radians(20))
    alone, both = lit_by(one), lit_by(one, one)
    assert np.array_equal(both.edges, 2 * alone.edges)
    assert alone.edges[50, 50] == 1
    # At the rim 5 degrees within the edge: a quarter of the step
    assert alone.weakest == pytest.approx(3 * 0.25**2 - 2 * 0.25**3, abs=0.02)


def test_one_in_the_centre_reaches_all() -> None:
    assert lit_by().whole
    assert lit_by(Lens("all", HERE, (0.0, 0.0, 9.0), field=2 * np.pi)).whole


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    (tmp_path / "mine.toml").write_text(THEATRE)
    return tmp_path / "mine.toml"


def test_the_check_draws_holes_and_fails(run, mine, tmp_path):
    outcome = run("scene", "check", mine, "--out", tmp_path / "holes.png")
    assert outcome.code == 2
    assert "leave 55" in outcome.err
    assert f"See {tmp_path / 'holes.png'}" in outcome.err
    assert len(outcome.err.splitlines()) == 1
    pixels = read_frame(tmp_path / "holes.png").pixels
    orange = np.all(np.abs(pixels[..., :3] - HOLE) < 0.01, axis=-1)
    disc = orange[_TOP : _TOP + SIZE, _EDGE : _EDGE + SIZE]
    assert disc.sum() == pytest.approx(np.pi / 4 * SIZE**2 * 5 / 9, rel=0.01)
    assert disc[0, SIZE // 2]
    assert not disc[SIZE // 2, SIZE // 2]


def test_a_seam_without_a_blend_is_told(run, mine):
    """Four fields that meet with their edges only, or overlap."""
    unit = THEATRE[THEATRE.index("[[") : THEATRE.index("[viewing]")]
    aims = ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0])

    def said(field: float) -> str:
        units = "".join(
            unit.replace("[0.0, 0.0, 1.0]", str(aim)).replace("120.0", f"{field}\nblend_deg = 20.0")
            for aim in aims
        )
        mine.write_text(THEATRE.replace(unit, units))
        outcome = run("scene", "check", mine)
        assert outcome.code == 0
        return outcome.out

    assert "Seams: at one place soft edges add up to" in said(184.0)
    assert "Seams" not in said(220.0)


def test_a_scene_without_mistakes(run, mine, tmp_path):
    mine.write_text(THEATRE.replace("120.0", "360.0"))
    figures = run("scene", "check", mine, "--json").figures()
    assert figures["dark_share"] == 0
    # Luminance of a Lambertian screen: rho E / pi
    assert figures["lumens"] == pytest.approx(10 * np.pi * 2 * np.pi * 64 / 0.5)
    assert figures["blend_sum_least"] == figures["blend_sum_most"] == 1
    assert run("scene", "check", mine, "--out", tmp_path / "a.png").code == 0
    assert read_frame(tmp_path / "a.png").pixels.shape[1] == 3 * (SIZE + 2 * _EDGE)
    run("scene", "check", "stereo_shutter", "--out", tmp_path / "a.png").is_refused("leave --out")


@pytest.mark.parametrize("command", ["observe", "compensate", "compare", "predict"])
def test_no_job_begins_in_a_theatre_with_holes(run, mine, out, command):
    """Nor is the master looked for."""
    outcome = run(command, "no.exr", "--scene", mine, "--out", out)
    outcome.is_refused("55", "of the screen dark", f"domesim scene check {mine} --out holes.png")
    assert not out.exists()


@pytest.mark.parametrize("command", ["render", "tabulate"])
def test_nor_is_light_traced_there(run, mine, tmp_path, command):
    run(command, mine, "--out", tmp_path / "a.npz").is_refused("of the screen dark")
