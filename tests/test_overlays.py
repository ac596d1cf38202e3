"""Titles that a server composites over compensated frames: their ghosts are counted in advance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run

from compensate.overlay import Overlay
from compensate.pose import Stage
from compensate.shows.cues import signature
from compensate.solve import solved
from domesim.frames import ColourTag, Frame, write_frame
from domesim.frames.views import Master
from domesim.scene import load_scene

ROWS, COLS = 40, 64
LINEAR = ColourTag("linear", "BT.709", "test")
LEAK = np.array([0.02, 0.03])
RIG = """
name = "rig"
[screen]
width_m = 10.0
height_m = 6.25
[projector]
primaries = "BT.709"
white_cd_m2 = 15.0
black_cd_m2 = 0.0
[crosstalk]
to_left = 0.02
to_right = 0.03
[viewing]
distance_m = 12.0
adaptation_cd_m2 = 2.0
"""
TITLE = (slice(30, 35), slice(20, 44))
SHIFT = 4
"""Rows and columns of the left eye's title; the right one's is further left: it is near."""
SOFT = 0.5
"""Opacity of the row above a title."""


def night(view: int) -> np.ndarray:
    """Mostly dark, with light enough to subtract a title's ghost from, and black in a corner."""
    light = 0.05 + 0.03 * np.random.default_rng(view).random((ROWS, COLS, 3))
    light[5:10, 10 + 3 * view : 16 + 3 * view] = 0.8
    light[28:, 42:] = 0.0
    return light.astype(np.float32)


def opacity(view: int) -> np.ndarray:
    """(row, col)"""
    rows, cols = TITLE
    found, cols = np.zeros((ROWS, COLS)), slice(cols.start - SHIFT * view, cols.stop - SHIFT * view)
    found[rows, cols], found[rows.start - 1, cols] = 1.0, SOFT
    return found


def title(path: Path, alpha: np.ndarray) -> Path:
    """White, with straight alpha, as subtitles' pictures are."""
    codes = np.full((*alpha.shape, 4), 255, np.uint8)
    codes[..., 3] = np.rint(255 * alpha)
    writer = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(alpha.shape[1], alpha.shape[0], 4, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    writer.open(str(path), spec)
    writer.write_image(codes)
    writer.close()
    return path


@pytest.fixture
def show(tmp_path: Path) -> tuple[object, ...]:
    """Arguments for a night pair, and its titles in files."""
    (tmp_path / "rig.toml").write_text(RIG)
    for view, eye in enumerate("LR"):
        path = tmp_path / f"{eye}.exr"
        write_frame(Frame(night(view), path, LINEAR, 32, floating=True), path)
        title(tmp_path / f"{eye}.png", opacity(view))
    files = ("--left", tmp_path / "L.exr", "--right", tmp_path / "R.exr")
    return ("compensate", *files, "--scene", tmp_path / "rig.toml")


def overlays(folder: Path) -> tuple[object, ...]:
    return ("--overlay", folder / "L.png", "--overlay", folder / "R.png")


def frames(out: Path) -> np.ndarray:
    read = [oiio.ImageInput.open(str(out / f"{eye}.exr")).read_image("float") for eye in "LR"]
    return np.stack(read)[..., :3].astype(float)


def served(light: np.ndarray) -> np.ndarray:
    """What a server shows: white over frames, by codes of 8 bits, in linear light."""
    alpha = np.stack([np.rint(255 * opacity(view)) / 255 for view in (0, 1)])[..., None]
    return (1 - alpha) * light + alpha


def seen(shown: np.ndarray) -> np.ndarray:
    """An independent model of the rig."""
    return shown + LEAK[:, None, None, None] * shown[::-1]


WANTED = served(np.stack([night(0), night(1)]).astype(float))
GHOSTS = np.stack([(opacity(1) == 1) & (opacity(0) == 0), (opacity(0) == 1) & (opacity(1) == 0)])
"""Where an eye sees the other's title only."""


def ghost(light: np.ndarray, where: np.ndarray) -> float:
    """Mean light that the eyes see too much there."""
    return float((seen(served(light)) - WANTED)[where].mean())


def test_the_ghosts_of_titles_go(run: Run, show, tmp_path: Path) -> None:
    way = ("--method", "subtractive", "--out")
    assert run(*show, *way, tmp_path / "without").code == 0
    assert run(*show, *overlays(tmp_path), *way, tmp_path / "with").code == 0
    without, compensated = frames(tmp_path / "without"), frames(tmp_path / "with")
    lit = GHOSTS & (np.stack([night(0), night(1)]) > 0).all(axis=-1)
    assert lit.sum() == 30
    assert ghost(without, lit) > 0.015
    assert abs(ghost(compensated, lit)) < 0.01 * ghost(without, lit)
    soft = np.stack([opacity(view) == SOFT for view in (0, 1)])
    error = seen(served(compensated)) - WANTED
    assert np.abs(error[soft]).max() < 1e-5
    away = np.ones_like(GHOSTS)
    away[:, 25:] = False
    assert compensated[away] == pytest.approx(without[away], abs=1e-6)


def test_what_the_server_shows_is_exact_subtraction_within_what_it_can(show, tmp_path) -> None:
    """x' = clip(wanted - leak of x', a o, a o + 1 - a): a title's light is given."""
    stage, alpha = Stage(load_scene(tmp_path / "rig.toml")), np.stack([opacity(0), opacity(1)])
    overlay = Overlay(
        np.repeat(alpha[..., None], 3, -1).astype(np.float32),
        (1 - alpha)[..., None].astype(np.float32),
    )
    masters = tuple(Frame(night(v), tmp_path / "x.exr", LINEAR, 32, True) for v in (0, 1))
    posed, _ = stage.pose_frame(Master(masters, "files"), overlay)
    for method in ("subtractive", "perceptual"):
        shown = solved(posed, method).light
        low, high = overlay.bounds
        assert (shown >= low - 1e-6).all()
        assert (shown <= high + 1e-6).all()
        under = overlay.under(shown, np.stack([night(0), night(1)]))
        assert overlay.over(under) == pytest.approx(shown, abs=1e-6)
        assert (under[alpha == 1] == np.stack([night(0), night(1)])[alpha == 1]).all()
    shown = solved(posed, "subtractive").light
    needed = posed.wanted - (posed.observation.observe(shown) - shown)
    assert shown == pytest.approx(np.clip(needed, low, high), abs=1e-6)


def test_numbered_titles_are_those_of_their_frames(run: Run, show, tmp_path: Path) -> None:
    left, right = (tmp_path / f"{eye}.exr" for eye in "LR")
    for number in (1, 2):
        for eye, path in (("L", left), ("R", right)):
            (tmp_path / f"{eye}.000{number}.exr").write_bytes(path.read_bytes())
    for view, eye in enumerate("LR"):
        title(tmp_path / f"sub{eye}.0002.png", opacity(view))
    patterns = [f"{tmp_path}/sub{eye}.####.png" for eye in "LR"]
    numbered = ("--left", f"{tmp_path}/L.####.exr", "--right", f"{tmp_path}/R.####.exr")
    scene = ("--scene", tmp_path / "rig.toml", "--method", "subtractive", "--workers", 0)
    arguments = ("compensate", *numbered, *scene, "--out", tmp_path / "out")
    both = ("--overlay", patterns[0], "--overlay", patterns[1])
    assert run(*arguments, *both).code == 0
    first, second = (
        np.stack([oiio.ImageInput.open(str(tmp_path / "out" / f"{eye}.000{number}.exr"))
                  .read_image("float")[..., :3] for eye in "LR"])
        for number in (1, 2)
    )  # fmt: skip
    assert np.abs(first - second)[:, 25:].max() > 0.01
    assert ghost(second, GHOSTS) < 0.8 * ghost(first, GHOSTS)
    title(tmp_path / "subL.0001.png", opacity(0))  # a job knows its overlays
    again = run(*arguments, *both)
    assert again.code == 2
    assert "overlay" in again.err


def test_a_cue_list_counts_titles(run: Run, show, tmp_path: Path) -> None:
    """What it says of a frame is what the frame's own figures say, with its title."""
    how = ("--method", "auto", "--out", tmp_path / "out", "--json")
    figures = run(*show, *overlays(tmp_path), *how).figures()
    (cue,), (frame,) = figures["cues"], figures["frames"]
    told = (cue["lost"]["none"], cue["lost"][cue["method"]])
    assert told == pytest.approx((frame["loss_before"], frame["loss_after"]), abs=2e-3)
    again = run(*show, "--method", "auto", "--out", tmp_path / "bare", "--json").figures()
    assert told[0] > again["cues"][0]["lost"]["none"] + 0.05


def test_titles_are_no_cuts(show, tmp_path: Path) -> None:
    stage, alpha = Stage(load_scene(tmp_path / "rig.toml")), np.ones((2, ROWS, COLS, 1), np.float32)
    light = np.stack([night(0), night(1)])
    white = Overlay(np.ones_like(light), 0 * alpha)
    assert signature(stage.pose(light, white)) == signature(stage.pose(light))
    assert stage.pose(light, white).desired.min() == 1


def test_an_overlay_in_small_shows_the_mean_of_what_it_shows() -> None:
    random = np.random.default_rng(5)
    clear, light = random.random((2, 6, 9, 1)), random.random((2, 6, 9, 3))
    overlay = Overlay(light * (1 - clear), clear)
    small = overlay.in_small(3)
    even = np.full((2, 6, 9, 3), 0.25)
    blocks = overlay.over(even).reshape(2, 2, 3, 3, 3, 3).mean(axis=(2, 4))
    assert small.over(even[:, ::3, ::3]) == pytest.approx(blocks)


def test_what_is_no_overlay_is_refused(run: Run, show, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    small = title(tmp_path / "small.png", np.ones((8, 8)))
    run(*show, "--overlay", small, *out).is_refused("frames' size, 64 x 40 px, got 8 x 8")
    run(*show, "--overlay", tmp_path / "L.exr", *out).is_refused("wanted an overlay with alpha")
    run(*show, "--overlay", tmp_path / "no.png", *out).is_refused("no.png")
    run(*show, *overlays(tmp_path), "--overlay", small, *out).is_refused("got it 3 times")
    dome = ("compensate", tmp_path / "L.exr", "--scene", "dome_imax", *out)
    run(*dome, "--overlay", small).is_refused("--overlay is for pairs on flat screens")


def test_pages_and_the_report_name_titles(run: Run, show, tmp_path: Path) -> None:
    for eye in "LR":
        (tmp_path / f"{eye}.0001.exr").write_bytes((tmp_path / f"{eye}.exr").read_bytes())
    numbered = ("--left", f"{tmp_path}/L.####.exr", "--right", f"{tmp_path}/R.####.exr")
    how = ("--scene", tmp_path / "rig.toml", "--pages", 1, "--out", tmp_path / "out")
    assert run("compensate", *numbered, *how, *overlays(tmp_path)).code == 0
    command = f"--overlay {tmp_path / 'L.png'} --overlay {tmp_path / 'R.png'}"
    (page,) = (tmp_path / "out" / "job").glob("compare-*.html")
    assert command in page.read_text()
    assert "L.png and " in (tmp_path / "out" / "job" / "report.html").read_text()
