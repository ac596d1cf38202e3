"""The commands on stereo shows: each way that left and right come, each way to look at them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run
from stored_masters import store, touched, written

from domesim.commands import render as rendering
from domesim.frames import read_frame, read_master
from domesim.scene import load_stereo
from domesim.scene.screening import decoded

SCENE = "stereo_polarised_paper"
ROWS, COLS = 12, 20


def view(seed: int) -> np.ndarray:
    """With ghosts that fall into the dark, so that not all can be subtracted."""
    pixels = 0.02 + 0.3 * np.random.default_rng(seed).random((ROWS, COLS, 3))
    pixels[2:6, 2 + 6 * seed : 7 + 6 * seed] = 0.95
    pixels[8:, 10 - 8 * seed : 18 - 8 * seed] = 0.0
    return pixels.astype(np.float32)


def sequence(folder: Path, name: str, seed: int, count: int = 2) -> Path:
    folder.mkdir(exist_ok=True)
    for number in range(1, count + 1):
        store(folder / f"{name}.{number:04d}.exr", view(seed) * (0.9 + 0.05 * number), "float")
    return folder / f"{name}.####.exr"


def pair(folder: Path) -> tuple[object, ...]:
    """Arguments that name two files."""
    folder.mkdir(exist_ok=True)
    left = store(folder / "l.exr", view(0), "float")
    return "--left", left, "--right", store(folder / "r.exr", view(1), "float")


def figures(run: Run, *arguments: object) -> dict[str, object]:
    return run(*arguments, "--json").figures()


def test_a_sequence_of_left_and_right(run: Run, tmp_path: Path, out: Path) -> None:
    left, right = (sequence(tmp_path / eye, "show", seed) for seed, eye in enumerate("LR"))
    arguments = ("--left", left, "--right", right, "--scene", SCENE, "--out", out)
    found = figures(run, "compensate", *arguments, "--workers", 0)
    names = [f"{eye}/show.{number:04d}.exr" for eye in ("left", "right") for number in (1, 2)]
    assert written(out) == ["left", *names[:2], "right", *names[2:]]
    assert (found["scene"], found["seats"]) == (SCENE, ["sweet spot"])
    solving = sum(frame["seconds"] for frame in found["frames"])
    assert 0 < solving <= found["seconds_solving"] < found["seconds_total"]
    assert found["seconds_reading"] > 0
    assert found["seconds_writing"] > 0
    for number, frame in enumerate(found["frames"], 1):
        assert frame["input"] == [str(tmp_path / eye / f"show.000{number}.exr") for eye in "LR"]
        assert frame["output"] == [
            str(out / eye / f"show.000{number}.exr") for eye in ("left", "right")
        ]
        assert frame["loss_after"] < 1.05 * min(frame["loss_before"], frame["loss_subtractive"])
        assert frame["gap"] is None


def test_left_is_left(run: Run, tmp_path: Path, out: Path) -> None:
    """Exchanged masters give exchanged results, in a system that is alike for both eyes."""
    _, left, _, right = pair(tmp_path / "in")
    for name, one, other in (("a", left, right), ("b", right, left)):
        arguments = ("--left", one, "--right", other, "--scene", SCENE, "--out", out / name)
        assert run("compensate", *arguments).code == 0
    for name in ("l.exr", "r.exr"):
        same = read_frame(out / "a" / name).pixels, read_frame(out / "b" / name).pixels
        np.testing.assert_allclose(*same, atol=2e-3)
        assert np.abs(same[0] - view(0)).max() > 0.005


def test_what_cannot_be_written_is_not_solved(
    run: Run, tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "m.exr"
    spec = oiio.ImageSpec(COLS, ROWS, 6, "half")
    spec.channelnames = ("R", "G", "B", "right.R", "right.G", "right.B")
    spec.attribute("multiView", oiio.TypeDesc("string[2]"), ("left", "right"))
    writer = oiio.ImageOutput.create(str(source))
    assert writer.open(str(source), spec), writer.geterror()
    writer.write_image(np.concatenate([view(0), view(1)], 2).astype(np.float32))
    writer.close()
    solved: list[int] = []
    for solve in ("compensate.shows.compensating.solve_frame", "domesim.shows.observing.decoded"):
        monkeypatch.setattr(solve, lambda *_, **__: solved.append(1))
    for command in ("compensate", "observe"):
        outcome = run(command, source, "--scene", SCENE, "--out", out, "--format", "png")
        outcome.is_refused("m.png", "wanted .exr", "multi-view", "two files")
    assert solved == []


def test_what_each_eye_sees(run: Run, tmp_path: Path, out: Path) -> None:
    arguments = pair(tmp_path / "in")
    found = figures(run, "observe", *arguments, "--scene", SCENE, "--seat", "left", "--out", out)
    assert found["seats"] == ["left"]
    assert found["frames"][0]["pollution_cd_m2"] > 0
    scene = load_stereo(SCENE).seen_from("left")
    wanted = scene.observation(ROWS, COLS).observe(np.stack([view(0), view(1)]))
    seen = np.stack([read_frame(out / name).pixels for name in ("l.exr", "r.exr")])
    np.testing.assert_allclose(seen, wanted, atol=2e-6)
    assert np.abs(seen[0] - view(0)).max() > 0.005
    plain = run("observe", *arguments, "--scene", SCENE, "--out", out)
    assert "crosstalk sweet spot 1.10%" in plain.out
    assert "the other eye's and stray light" in plain.out


# Traced crosstalk.


@pytest.mark.parametrize(
    ("share", "error", "text"),
    [
        (0.01098, 3e-6, "1.098% ± 0.00030%"),
        (0.0234, 2.34e-4, "2.340% ± 0.023%"),
        (0.5, 0.123, "50.000% ± 12%"),
        (0.5, 0.0, "50.000% ± 0%"),
    ],
)
def test_an_error_has_two_digits(share: float, error: float, text: str) -> None:
    assert rendering._sure(share, error) == text


CINEMA = """
name = "a small cinema"
screen = { width_m = 10, height_m = 5.3 }
projector = { white_cd_m2 = 15 }
seats = [{ name = "middle", position_m = [0, -15, -1] }, { name = "side", position_m = [4, -12, -1] }]
viewing = { distance_m = 15, adaptation_cd_m2 = 5 }
[crosstalk.polarisation]
lenses_m = [[-0.4, -24, 2], [0.3, -23, 1.5]]
depolarising_share = 0.05
roughness = 0.305
projector_leak = 0.002
glasses_leak = 0.003
"""  # noqa: E501


@pytest.mark.long
def test_traced_crosstalk_is_accepted(run: Run, tmp_path: Path, out: Path) -> None:
    scene = touched(tmp_path / "cinema.toml", CINEMA.encode())
    table = tmp_path / "maps.npz"
    told = figures(run, "tabulate", scene, "--out", table)
    assert [row["seat"] for row in told["seats"]] == ["middle", "side"]
    # A few per cent, of which some hundredths are noise
    for row in told["seats"]:
        assert 0.01 < row["mean"] < 0.1
        assert row["off_the_estimate"] < 0.1
    arguments = (*pair(tmp_path / "in"), "--scene", scene, "--transport", table)
    plain = run("compensate", *arguments, "--seat", "side", "--out", out)
    assert (plain.code, plain.err) == (0, "")
    assert "traced through the described hardware" in plain.out
    found = figures(run, "observe", *arguments, "--out", out / "seen")
    assert found["seats"] == ["middle"]


def test_what_is_written_is_what_makes_the_ghosts_go(run: Run, tmp_path: Path, out: Path) -> None:
    arguments = pair(tmp_path / "in")
    assert run("compensate", *arguments, "--scene", SCENE, "--out", out).code == 0
    scene = load_stereo(SCENE)
    observation = scene.observation(ROWS, COLS)
    wanted = decoded(read_master([arguments[1], arguments[3]]), scene)
    frames = decoded(read_master([out / "l.exr", out / "r.exr"]), scene)
    # Where there is light to take away, the eyes see the masters.
    bright = (wanted > 0.05).all(axis=(0, 3))
    assert bright.sum() > 20
    before = np.abs(observation.observe(wanted) - wanted)[:, bright].mean()
    after = np.abs(observation.observe(frames) - wanted)[:, bright].mean()
    assert after < 0.3 * before
