"""The worst seconds of a show as films: which clips are judged, by what, and where it is told."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from stored_masters import store

from compensate.pose import Stage
from compensate.shows import films
from compensate.vision.colorvideovdp import film_lost, library
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import load_scene

SIZE, RATE = 32, 24.0
DOME = "dome_hemisphere"


def lit(share: float) -> Light:
    """A dome that is lit on the left, and has a faint texture on the right."""
    light = np.zeros((1, SIZE, SIZE, 3), np.float32)
    light[:, :, SIZE // 2 :] = 0.004
    light[:, ::4, SIZE // 2 :] = 0.008
    light[:, :, : int(share * SIZE)] = 0.8
    return light * load_scene(DOME).screen(SIZE, SIZE)[None, :, :, None]


@pytest.fixture
def masters(tmp_path: Path) -> Path:
    """Five seconds: the third and fourth are lit far more than the others."""
    for number in range(1, 121):
        store(tmp_path / f"m.{number:03}.exr", lit(0.4 if 49 <= number <= 96 else 0.1)[0])
    return tmp_path / "m.###.exr"


@pytest.mark.long
def test_the_worst_clip_is_judged_and_told(
    masters: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged = []

    def judge(wanted: list[Light], seen: list[Light], density: float, rate: float) -> float:
        judged.append((len(wanted), density, rate))
        return float(np.mean([np.abs(a - b).mean() for a, b in zip(wanted, seen, strict=True)]))

    monkeypatch.setattr(films, "film_lost", judge)
    out = masters.parent / "out"
    options = ("--scene", DOME, "--out", out, "--workers", "0", "--pages", "0")
    done = run("compensate", masters, *options, "--films", "1")
    assert done.code == 0
    assert "m.049.exr to m.120.exr, as a film: as shown" in done.out
    assert done.out.count("people order 51 of 100 pairs as it does") == 1
    frames = {count for count, *_ in judged}
    assert frames == {72}  # the fifth second is the last clip's
    assert {rate for *_, rate in judged} == {RATE}
    assert min(density for _, density, _ in judged) >= 2
    report = (out / "job/report.html").read_text()
    assert "<h2>Worst seconds</h2>" in report
    assert "people order 51 of 100 pairs as it does" in report
    assert 'm.049.exr to m.120.exr</td><td data-title="From, s">2.0</td>' in report
    assert "Untouched<br><small>JOD lost" in report
    both = run("compensate", masters, *options, "--films", "9")
    assert both.out.index("m.049.exr to m.120.exr, as") < both.out.index("m.001.exr to m.048.exr")


def test_without_the_judge_all_else_is_done(
    masters: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    library.cache_clear()
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    out = masters.parent / "out"
    options = ("--scene", DOME, "--out", out, "--workers", "0", "--pages", "0")
    done = run("compensate", masters, *options, "--frames", "1-3", "--films", "1")
    assert done.code == 2
    assert "not judged as a film, 'needs ColorVideoVDP: pip install 'domesim[metrics]'" in done.err
    assert len(list(out.glob("m.*.exr"))) == 3


def test_colorvideovdp_sees_what_flickers() -> None:
    """The same frames, once still and once with every other one 5 % brighter."""
    try:
        library()
    except InputError as error:
        pytest.skip(str(error))
    still = [np.full((64, 64, 3), 1.0, np.float32)] * 24
    flickering = [frame * (1 + 0.05 * (k % 2)) for k, frame in enumerate(still)]
    assert film_lost(still, still, 4.0, RATE) == pytest.approx(0, abs=1e-4)
    steady = film_lost(still, [frame * 1.025 for frame in still], 4.0, RATE)
    assert film_lost(still, flickering, 4.0, RATE) > steady + 0.05


def test_the_master_loses_nothing() -> None:
    try:
        library()
    except InputError as error:
        pytest.skip(str(error))
    stage = Stage(load_scene(DOME))

    def moments(share: float) -> list[object]:
        posed = stage.pose(lit(share))
        ways = {"subtracted": posed.subtractive, "untouched": posed.desired}
        return [(posed, ways)] * 6

    found = films.films_lost(moments(0.4), RATE)
    assert found["untouched"] > 0.05
    assert found["untouched"] > found["subtracted"] - 0.02
    assert films.films_lost(moments(0.0), RATE)["subtracted"] < 0.1
