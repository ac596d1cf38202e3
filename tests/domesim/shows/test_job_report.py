"""What a job's report says of each frame, and that it can be read on a phone."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from command_line import exit_code
from PIL import Image

from compensate.commands.compensate import compensate
from compensate.commands.predict import predict
from compensate.prediction import Prediction
from compensate.shows.compensating import Compensating
from compensate.shows.predicting import Predicting
from domesim.frames import read_master
from domesim.scene.choice import SceneChoice
from domesim.shows.report import _curve
from domesim.shows.small import SIDE, small_of, write_small
from domesim.shows.work import Column, Writing

NAMES = ("dark.1.png", "dark.2.png", "dark.3.png")


@pytest.fixture(scope="module")
def masters(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Three domemasters with a lit half and a dark one, of 8 bits: rounding shows in the dark."""
    folder = tmp_path_factory.mktemp("masters")
    y, x = np.mgrid[:96, :96] / 96
    for number, name in enumerate(NAMES):
        light = np.where(x < 0.3 + 0.1 * number, 0.9, 0.002 + 0.004 * (np.sin(40 * y) > 0))
        pixels = np.repeat(light[..., None], 3, axis=-1) ** (1 / 2.2)
        Image.fromarray(np.rint(255 * pixels).astype(np.uint8)).save(folder / name)
    return str(folder / "dark.#.png")


@pytest.fixture(scope="module")
def jobs(masters: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of results: of ``compensate`` and of ``predict``."""
    found = {}
    for command, options in (("compensate", ["--lift", "1.5", "--pages", "1"]), ("predict", [])):
        out = tmp_path_factory.mktemp(command) / "out"
        arguments = [command, masters, "--scene", "dome_imax", "--out", str(out), *options]
        assert exit_code(*arguments, "--workers", "0", "--quiet") == 0
        found[command] = out
    return found


def report_of(out: Path) -> str:
    return (out / "job/report.html").read_text()


def test_settings_are_told_by_their_options_names(jobs: dict[str, Path]) -> None:
    page = report_of(jobs["compensate"])
    told = dict(re.findall(r"<dt>(--[\w-]+)</dt><dd>([^<]*)</dd>", page))
    assert told["--scene"] == "dome_imax"
    assert told["--lift"] == "1.5"
    assert told["--dither"] == "tpdf"
    assert "scene_content" not in page
    told = dict(re.findall(r"<dt>(--[\w-]+)</dt><dd>([^<]*)</dd>", report_of(jobs["predict"])))
    assert told["--combination"] == "with-veils"
    assert "--format" not in told  # which predict has not


def test_options_that_are_told_are_the_commands(jobs: dict[str, Path]) -> None:
    for command, function in (("compensate", compensate), ("predict", predict)):
        app = typer.Typer()
        app.command()(function)
        parameters, out = typer.main.get_command(app).params, jobs[command]
        known = {name for each in parameters for name in (*each.opts, *each.secondary_opts)}
        assert set(re.findall(r"<dt>(--[\w-]+)</dt>", report_of(out))) <= known


def test_each_frame_has_a_verdict_with_its_reason(jobs: dict[str, Path]) -> None:
    for command, out in jobs.items():
        page = report_of(out)
        rows = re.findall(
            r'<td class="verdict"><b class="needs-\d">([^<]+)</b><small>([^<]+)', page
        )
        assert len(rows) == 3
        assert all(re.search(r"\d", reason) for _, reason in rows), command
        counts = re.findall(r'<li class="verdict"><b class="needs-\d">([^<]+)</b>: (\d+)', page)
        assert sum(int(count) for _, count in counts) == 3
        assert {name for name, _ in counts} == {name for name, _ in rows}


def test_what_was_lost_as_stored_is_told(jobs: dict[str, Path]) -> None:
    page = report_of(jobs["compensate"])
    assert "As stored" in page
    cells = re.findall(r'<td data-title="As stored, JOD">([^<]+)</td>', page)
    assert len(cells) == 3
    assert all(float(cell) > 0 for cell in cells)


LOST = {"loss_before": 1.0, "loss_subtractive": 0.6, "loss_after": 0.3, "loss_stored": 0.31}


@pytest.mark.parametrize(
    ("change", "verdict", "needs"),
    [
        ({}, "better than subtraction", 0),
        ({"loss_before": None, "loss_stored": None}, "as the master", 0),
        ({"loss_after": 0.01, "loss_stored": 0.01}, "as the master, to the eye", 0),
        ({"loss_stored": 0.4}, "rounding shows", 2),
        ({"loss_after": 0.05, "loss_stored": 0.065}, "better than subtraction", 0),
        ({"loss_after": 0.59, "loss_stored": None}, "no different from subtraction", 0),
        ({"loss_after": 0.7, "loss_stored": None}, "worse than subtraction", 1),
        ({"loss_after": 0.99, "loss_stored": None}, "no different from untouched", 1),
        ({"loss_after": 1.2, "loss_stored": 1.2}, "worse than untouched", 2),
    ],
)
def test_verdicts_rest_on_their_figures(change: dict[str, Any], verdict: str, needs: int) -> None:
    figures = LOST | change
    found = Compensating(SceneChoice("dome_imax"), "perceptual").judged(figures)
    assert found is not None
    assert (found.verdict, found.needs) == (verdict, needs)
    named = [f"{v:.2f}" for k, v in figures.items() if v is not None and k in ("loss_after",)]
    assert figures["loss_before"] is None or all(value in found.reason for value in named)


def test_a_curve_tells_the_worst() -> None:
    values = {"a": 0.9, "b": 0.4, "not measured": -math.inf}
    more, less = (_curve(Column("k", "K", "%", less), values, 0.9) for less in (False, True))
    assert (more.most, more.mean, more.worst) == ("90", "65", "a")
    assert (less.most, less.mean, less.worst) == ("40", "65", "b")


@pytest.mark.parametrize(("verdict", "needs"), [("nothing", 0), ("subtract", 1), ("compensate", 2)])
def test_predictions_are_verdicts(verdict: str, needs: int) -> None:
    recipe = Predicting(SceneChoice("dome_imax"), Prediction())
    figures = {"verdict": verdict, "visible": 0.5, "visible_subtracted": 0.013}
    found = recipe.judged(figures)
    assert found is not None
    assert found.needs == needs
    assert "50%" in found.reason
    assert "1.30%" in found.reason
    assert "--repair" in recipe.options(Writing(repair=True))


def test_small_pictures_are_side_by_side_in_their_colours(tmp_path: Path) -> None:
    red = np.zeros((4 * SIDE, 4 * SIDE, 3))
    red[..., 0] = 0.25
    with pytest.raises(OSError, match="No such file"):
        write_small(small_of(tmp_path / "gone", "a.exr"), [red])
    place = small_of(tmp_path, "a.exr")
    write_small(place, [red, np.ones_like(red)])
    pixels = np.asarray(read_master([place]).pixels)
    assert pixels.shape[-3:-1] == (SIDE, 2 * SIDE + 4)
    middle = pixels.reshape(SIDE, 2 * SIDE + 4, -1)[SIDE // 2]
    code = 1.055 * 0.25 ** (1 / 2.4) - 0.055
    scale = 255 if middle.max() > 1 else 1
    np.testing.assert_allclose(middle[SIDE // 2][:3] / scale, [code, 0, 0], atol=0.003)
    np.testing.assert_allclose(middle[-2][:3] / scale, 1)


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("command", ["compensate", "predict"])
def test_a_report_fits_a_phone_and_shows_its_pictures(
    browser: Any, jobs: dict[str, Path], command: str, scheme: str
) -> None:
    for width in (390, 1280):
        page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
        complaints: list[str] = []
        page.on("console", lambda message, to=complaints: to.append(message.text))
        page.goto((jobs[command] / "job/report.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.evaluate("for (const each of document.images) each.loading = 'eager'")
        page.wait_for_function("[...document.images].every((each) => each.complete)")
        wide = page.evaluate("[...document.images].map((each) => each.naturalWidth)")
        assert len(wide) == 3
        assert min(wide) > 150
        links = page.evaluate("[...document.links].map((each) => each.href)")
        assert all(Path(link.removeprefix("file://")).is_file() for link in links)
        assert any("compare" in link or "prediction.png" in link for link in links)
        back = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (back == "rgb(255, 255, 255)") == (scheme == "light")
        page.close()
        assert complaints == []
