"""``--method auto``: shots, what each gets, and that no frame is worse than untouched."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
from command_line import Run
from pair_films import SCENE, film, three_shots

from compensate.pose import Stage
from compensate.shows.compensating import worse_than_untouched
from compensate.shows.cue_list import CANDIDATES
from compensate.shows.cues import chosen, shots, signature
from domesim.scene import load_scene
from testing.content.evening import lamps
from testing.content.orbit import space

PAPER = "stereo_polarised_paper"


def signatures(frames: Sequence[np.ndarray]) -> list[list[float]]:
    stage = Stage(load_scene(SCENE))
    return [signature(stage.pose(np.clip(each, 0, 1).astype(np.float32))) for each in frames]


def test_a_show_is_parted_at_its_cuts() -> None:
    frames = three_shots(64, lamps(64), 5)
    assert shots(signatures(frames)) == [range(5), range(5, 10), range(10, 15)]
    flash = [*frames[:5]]
    flash[2] = np.minimum(flash[2] + 0.5, 1)
    assert shots(signatures(flash)) == [range(5)]
    assert shots(signatures(frames[10:])) == [range(5)]
    assert shots(signatures(frames[4:6])) == [range(1), range(1, 2)]
    assert shots([]) == []


def test_a_shot_gets_what_is_worse_in_none_of_its_frames() -> None:
    better = {"perceptual": 0.1, "subtractive": 0.15, "none": 0.2}
    worse = {"perceptual": 0.21, "subtractive": 0.2, "none": 0.2}
    worst = {"perceptual": 0.21, "subtractive": 0.21, "none": 0.2}
    assert chosen([better, better]) == "perceptual"
    assert chosen([better, worse]) == "subtractive"
    assert chosen([better, worse, worst]) == "none"
    assert chosen([dict.fromkeys(CANDIDATES, 0.0)]) == "perceptual"


def test_each_shot_has_one_method_that_is_not_worse(run: Run, tmp_path: Path, out: Path) -> None:
    masters = film(tmp_path / "in", three_shots(96, space(96), 3))
    how = ("--scene", SCENE, "--lift", 4, "--workers", 0, "--out", out)
    alone = ("compensate", *masters, *how[:-1], tmp_path / "plain")
    plain = run(*alone, "--json").figures()
    said = run(*alone, "--frames", "5")
    assert "worse than untouched: 1 of 1 frames, l.0005.dpx" in said.out + said.err
    figures = run("compensate", *masters, *how, "--method", "auto", "--json").figures()
    methods = [frame["method"] for frame in figures["frames"]]
    assert methods == ["perceptual"] * 3 + ["subtractive"] * 3 + ["perceptual"] * 3
    assert [cue["method"] for cue in figures["cues"]] == methods[::3]
    losses_of = {
        name: [
            frame["loss_after"] - frame["loss_before"]
            for frame in found["frames"]
            if frame["loss_before"] is not None
        ]
        for name, found in (("plain", plain), ("auto", figures))
    }
    assert max(losses_of["plain"]) > 0.005
    assert max(losses_of["auto"]) < 0.002
    with (out / "job" / "cues.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["first"], row["last"], row["method"]) for row in rows] == [
        ("l.0001.dpx", "l.0003.dpx", "perceptual"),
        ("l.0004.dpx", "l.0006.dpx", "subtractive"),
        ("l.0007.dpx", "l.0009.dpx", "perceptual"),
    ]
    again = run("compensate", *masters, *how, "--method", "auto", "--frames", "5")
    assert again.code == 0
    assert "cues.csv (made before)" in again.out + again.err
    assert "subtractive" in again.out + again.err


def test_a_cue_list_is_of_its_layer(run: Run, tmp_path: Path, out: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    light = lamps(64).astype(np.float32)
    for number in (1, 2):
        for eye, view in zip(("l", "r"), light, strict=True):
            planes = {
                f"{layer}{end}": view[..., k] * share
                for layer, share in (("", 1), ("dim.", 0.1))
                for k, end in enumerate("RGB")
            }
            planes = {
                name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()
            }
            OpenEXR.File(dict(header), planes).write(str(tmp_path / f"{eye}.{number}.exr"))
    masters = ("--left", tmp_path / "l.#.exr", "--right", tmp_path / "r.#.exr")
    how = ("--scene", SCENE, "--workers", 0, "--out", out, "--method", "auto")
    first, again, dim = (
        run("compensate", *masters, *how, *more)
        for more in ((), ("--anew",), ("--anew", "--layer", "dim"))
    )
    assert [each.code for each in (first, again, dim)] == [0, 0, 0], dim
    reused = ["(made before)" in each.out + each.err for each in (first, again, dim)]
    assert reused == [False, True, False]


def test_what_is_worse_is_said() -> None:
    frame = {"input": ["a/l.7.dpx", "a/r.7.dpx"], "loss_before": 0.2, "loss_after": 0.25}
    fine = [{**frame, "loss_after": 0.2}, {**frame, "loss_before": None, "loss_after": 0.0}]
    assert worse_than_untouched(fine) == ""
    other = {**frame, "input": "a.8.dpx", "loss_after": 0.22}
    told = worse_than_untouched([other, frame, *fine])
    assert told.startswith("worse than untouched: 2 of 4 frames, l.7.dpx by 0.050 JOD")


def test_prediction_advises_nothing_that_is_worse(run: Run, tmp_path: Path) -> None:
    pair = film(tmp_path / "in", [space(96)])
    how = ("--scene", PAPER, "--frames", "1")
    kept, taken = (
        run("predict", *pair, *how, *grade, "--out", tmp_path / f"{len(grade)}", "--json").figures()
        for grade in ((), ("--black", "taken-out"))
    )
    assert kept["frames"][0]["verdict"] == "compensate"
    assert taken["frames"][0]["verdict"] == "leave"
    lost = taken["frames"][0]["lost"]
    assert min(lost, key=lambda method: lost[method]) == "none"
    assert kept["black"] == "kept"
    assert taken["black"] == "taken-out"


def test_auto_is_for_the_aim(run: Run, tmp_path: Path, out: Path) -> None:
    pair = film(tmp_path / "in", [space(32)])
    how = ("--scene", SCENE, "--method", "auto", "--weighting", "paper", "--out", out)
    run("compensate", *pair, *how).is_refused("--method auto", "leave --weighting paper out")
