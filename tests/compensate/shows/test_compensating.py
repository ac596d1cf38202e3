"""Whoever does the frames of a show: the same bytes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from stored_masters import store

from compensate.aim import Aim
from compensate.pose import Stage
from compensate.shows.compensating import CONTRAST, PAPER, Compensating
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.scene import load_scene
from domesim.scene.choice import SceneChoice
from domesim.shows.estimate import estimate
from domesim.shows.run import Done, Running, each_frame, pages_of
from domesim.shows.show import Show, find_show
from domesim.shows.work import Recipe, Writing
from testing.schedulers import scheduler

COUNT = 4


@pytest.fixture(scope="module")
def shows(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Show]:
    """A light that moves over a dark picture, in a dome and on a stereo screen."""
    folder = tmp_path_factory.mktemp("in")
    noise = np.random.default_rng(2)
    texture = {shape: 0.03 * noise.random((*shape, 3)) for shape in ((96, 96), (72, 128))}
    for number in range(1, COUNT + 1):
        for name, shape, shift in (
            ("dome", (96, 96), 0),
            ("l", (72, 128), 0),
            ("r", (72, 128), 24),
        ):
            row, col = np.mgrid[: shape[0], : shape[1]]
            place = col - shape[1] * number / (COUNT + 1) - shift
            light = np.exp(-(place**2 + (row - 40) ** 2) / 120)[..., None] * [1.0, 0.8, 0.5]
            pixels = np.clip(texture[shape] + light, 0, 1).astype(np.float32)
            store(folder / f"{name}.{number}.exr", pixels)
    return {
        "dome_planetarium": find_show(str(folder / "dome.#.exr")),
        "stereo_polarised_paper": find_show(None, str(folder / "l.#.exr"), str(folder / "r.#.exr")),
    }


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with scheduler(2) as (found, _):
        yield found


def recipe_of(scene: str) -> Recipe:
    return Compensating(SceneChoice(scene).settled(load_scene(scene)))


def done(show: Show, folder: Path, recipe: Recipe, running: Running) -> Done:
    # 8 bit: dithered
    writing = Writing(".png", bits=8, dither=True)
    return each_frame(
        show, folder, recipe, Console(quiet=True), what="testing", writing=writing, running=running
    )


def test_only_what_is_seen_of_a_sequence(shows: dict[str, Show], tmp_path: Path) -> None:
    name = "stereo_polarised_paper"
    show = replace(shows[name], moments=shows[name].moments[:1])
    told = {}
    for only in (False, True):
        scene = SceneChoice(name).settled(load_scene(name))
        recipe = Compensating(scene, eye=PAPER, only_visible=only)
        (told[only],) = done(show, tmp_path / str(only), recipe, Running(0)).frames
    assert told[True]["ffts"] < told[False]["ffts"]


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.png"))}


@pytest.mark.parametrize("scene", ["dome_planetarium", "stereo_polarised_paper"])
def test_the_same_bytes_whoever_does_them(
    scene: str,
    shows: dict[str, Show],
    address: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recipe, show = recipe_of(scene), shows[scene]
    monkeypatch.chdir(tmp_path)  # a scheduler's workers are elsewhere
    crews = {"alone": Running(0, pages=0)}
    if scene == "dome_planetarium":
        crews["2"] = Running(2, 1, pages=0)
    else:
        crews |= {"1": Running(1, 2, pages=0), "scheduler": Running(scheduler=address, pages=0)}
    found = {}
    for name, running in crews.items():
        outcome = done(show, Path(name), recipe, running)
        assert not outcome.failed
        found[name] = content(Path(name))
    assert len(found["alone"]) == COUNT * len(show.moments[0])
    assert all(each == found["alone"] for each in found.values())
    figures = [frame["loss_after"] for frame in outcome.frames]
    assert len(set(figures)) == COUNT  # different work, not one frame again and again


@pytest.mark.parametrize("scene", ["dome_planetarium", "stereo_polarised_paper"])
def test_the_same_bytes_and_figures_with_fast_and_without(
    scene: str, shows: dict[str, Show], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba")
    show = replace(shows[scene], moments=shows[scene].moments[:2])
    found, figures = [], []
    for fast in "01":
        monkeypatch.setenv("DOMESIM_FAST", fast)
        outcome = done(show, tmp_path / fast, recipe_of(scene), Running(0))
        found.append(content(tmp_path / fast))
        others = ("output", "seconds", "settings")
        figures.append(
            [
                {name: value for name, value in frame.items() if name not in others}
                for frame in outcome.frames
            ]
        )
    assert len(found[0]) == 2 * len(show.moments[0])
    assert found[0] == found[1]
    assert figures[0] == figures[1]


@pytest.mark.parametrize("scene", ["dome_planetarium", "stereo_polarised_paper"])
def test_a_job_knows_the_transforms_of_its_solver_alone(
    scene: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They round otherwise with another library; nothing else uses them."""
    settings = []
    for name in ("scipy.fft", "another"):
        monkeypatch.setattr(
            "compensate.shows.compensating.transforms", lambda name=name: ModuleType(name)
        )
        settings.append(
            [Compensating(SceneChoice(scene), eye=eye).settings() for eye in (CONTRAST, PAPER)]
        )
    assert [one == other for one, other in zip(*settings, strict=True)] == [True, False]


@pytest.mark.parametrize(("count", "pages"), [(24, 0), (40, 1), (1000, 3)])
def test_pages_take_a_tenth_of_the_time_at_most(count: int, pages: int) -> None:
    assert pages_of(Running(), count) == pages
    assert pages_of(Running(pages=2), count) == 2


@pytest.fixture(scope="module")
def paged(shows: dict[str, Show], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Done]:
    """A show whose two worst frames have pages, and where its results are."""
    scene, folder = "dome_planetarium", tmp_path_factory.mktemp("paged")
    return folder, done(shows[scene], folder, recipe_of(scene), Running(0, pages=2))


def test_a_page_for_the_worst_frames(paged: tuple[Path, Done]) -> None:
    folder, outcome = paged
    worst = sorted(outcome.frames, key=lambda frame: -frame["loss_after"])[:2]
    pages = {path.name for path in (folder / "job").glob("compare-*.html")}
    assert pages == {f"compare-{Path(frame['output']).name}.html" for frame in worst}
    report = (folder / "job/report.html").read_text()
    first = Path(worst[0]["output"]).name
    assert report.index(first) < report.index(Path(worst[1]["output"]).name)
    assert all(page in report for page in pages)
    assert sys.getsizeof(report) < 150_000


def test_a_dry_run_counts_the_pages(
    shows: dict[str, Show], paged: tuple[Path, Done], tmp_path: Path
) -> None:
    scene = "dome_planetarium"
    folder, _ = paged
    show, recipe = shows[scene], recipe_of(scene)
    promised = estimate(
        show, tmp_path / "dry", recipe, Console(quiet=True), Writing(".png"), Running(0, pages=2)
    )
    pages = sum(path.stat().st_size for path in (folder / "job").glob("compare-*.html"))
    assert promised["disk_pages"] == pytest.approx(pages, rel=0.25)
    assert promised["disk_total"] == COUNT * promised["disk_frame"] + promised["disk_pages"]
    assert promised["seconds_pages"] > 0
    frames = COUNT * promised["seconds_frame"]
    assert promised["seconds_total"] >= frames + promised["seconds_pages"]


def test_a_scene_that_was_changed_is_not_taken(tmp_path: Path, shows: dict[str, Show]) -> None:
    """A worker that reads another scene than the command did must not go on with it."""
    other = Compensating(SceneChoice("dome_planetarium", content="0" * 64))
    with pytest.raises(Exception, match="another; its files were changed"):
        done(shows["dome_planetarium"], tmp_path, other, Running(0))


def test_all_are_made_for_contrast() -> None:
    """One default for Python and the command line, one seat and several: validation/notes/0007."""
    pair = load_scene("stereo_polarised_paper")
    for scene in (load_scene("dome_planetarium"), pair, pair.seen_from("left", "right")):
        assert Compensating(SceneChoice("any")).weighting(scene) == Aim()
        assert Stage(scene).pose(np.zeros((scene.views, 8, 8, 3))).setting.eye == Aim()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"eye": "contours"}, "'contours' is not known; use one of contrast, paper"),
        ({"eye": PAPER, "lift": 1.0}, "--lift belongs to --weighting contrast"),
        ({"low_frequency_gain": 0.2}, "for contrast, use --lift"),
        ({"eye": CONTRAST, "device": "torch"}, "contrasts need no solver"),
        ({"only_visible": True}, "contrasts need no solver"),
        ({"spatial": True}, "--spatial-weights is for --weighting paper or --method paper"),
        ({"lift": -1.0}, "lift"),
        ({"eye": PAPER, "only_visible": True, "device": "torch"}, "--only-visible is for"),
    ],
)
def test_settings_that_do_not_go_together(settings: dict[str, Any], message: str) -> None:
    recipe = Compensating(SceneChoice("dome_imax"), **settings)
    with pytest.raises(InputError, match=message):
        recipe.require_sense(load_scene("dome_imax"))


def test_a_table_has_no_optimum_to_look_for_in_parts() -> None:
    recipe = Compensating(SceneChoice("stereo_shutter"), eye=PAPER, only_visible=True)
    with pytest.raises(InputError, match="--only-visible is for"):
        recipe.require_sense(load_scene("stereo_shutter"))
