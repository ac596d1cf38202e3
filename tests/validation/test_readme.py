"""The figures of README and docs, and the README's commands and code, as they stand there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from documented import play
from pydantic import BaseModel

from compensate.methods import STEREO
from compensate.shows.cues import AUTO
from domesim import scene
from domesim.errors import InputError
from validation import results
from validation.experiments import EXPERIMENTS
from validation.origin import ROOT
from validation.readme import PAGES, quoted, written
from validation.results import Results

PUBLISHED = Results.read(results.PUBLISHED)
README = (ROOT / "README.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Looks like the repository to the commands, but takes their outputs."""
    path = tmp_path_factory.mktemp("readme")
    (path / "scenes").symlink_to(ROOT / "scenes")
    return path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "domesim", *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True
    )


def test_it_is_short():
    assert len(README.split()) <= 900


@pytest.mark.long
def test_as_it_stands(folder, monkeypatch):
    """Each command is a process of its own; later ones take what earlier ones wrote."""
    monkeypatch.chdir(folder)
    names = play("README.md", lambda *arguments: run(folder, *arguments).returncode, {})
    assert names["seen"].shape == (1, 1024, 1024, 3)
    assert Path("project.exr").is_file()


@pytest.mark.long
def test_figures(folder):
    told = run(folder, "demo", "--out", "out/demo", "--json").stdout
    found = json.loads(told)["methods"]
    rows = re.findall(r"^\| (.+?) \| \**([0-9.]+)\** \|", README, re.MULTILINE)
    assert [float(error) for _, error in rows] == pytest.approx(
        [found[m]["loss_after"] for m in ("none", "subtractive", "raised-black", "perceptual")],
        abs=0.006,
    )
    share = float(re.search(r"subtraction on (\d+) % of the screen", README)[1])
    assert share == pytest.approx(100 * found["none"]["clipped"], abs=0.6)


@pytest.mark.parametrize("page", PAGES)
def test_every_figure_is_of_the_published_results(page):
    assert written(page, PUBLISHED) == (ROOT / page).read_text(), "make readme writes it anew"


def test_what_is_published_is_quoted():
    assert set(PUBLISHED.figures) == quoted()
    assert set(PUBLISHED.experiments) <= set(EXPERIMENTS)


def test_what_the_evidence_says():
    """Its words, not only its figures."""
    fog, trunks = (
        [PUBLISHED.figures[f"deghosting.{picture}.5%.{method}.quality"] for method in methods]
        for picture, methods in (
            ("fog", ("none", "subtractive", "perceptual", "paper")),
            ("trunks", ("none", "subtractive", "perceptual")),
        )
    )
    assert abs(fog[1] - fog[2]) < 0.02
    assert fog[3] < min(fog[1:3]) - 0.1
    assert max(trunks) - min(trunks) < 0.02
    for judge in ("ColorVideoVDP", "FovVideoVDP"):
        pairs = f"quality.pairs.{judge}"
        gain = PUBLISHED.figures[f"{pairs}.default"] - PUBLISHED.figures[f"{pairs}.subtraction"]
        assert abs(gain) < 0.02


def test_experiments_that_pages_name_exist():
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("*/*.md")]
    named = {
        name
        for page in pages
        for pair in re.findall(r"--only ([a-z0-9_,]+)|experiment `([a-z0-9_]+)`", page.read_text())
        for name in "".join(pair).split(",")
    }
    assert len(named) > 5
    assert named <= set(EXPERIMENTS)


@pytest.mark.parametrize("page", PAGES)
def test_a_figure_that_nobody_measured_is_not_quoted(page):
    with pytest.raises(InputError, match=rf"{page} quotes .*, which the results do not have"):
        written(page, Results())


def test_the_keys_of_theatres_exist():
    """Every key that docs/theatres.md lists is one of its section's, and none is missing."""
    listed = re.findall(
        r"^\| `\[+([a-z.A-Z]+)\]+` \| (.+) \|$",
        (ROOT / "docs/theatres.md").read_text(),
        re.MULTILINE,
    )
    assert len(listed) >= 12
    for section, keys in listed:
        model = scene.DomeFile
        for part in section.split("."):
            if part == "NAME":
                continue
            model = submodel(model.model_fields[part].annotation)
        plain = {n for n, f in model.model_fields.items() if not is_section(f.annotation)}
        assert set(re.findall(r"`([a-z_0-9]+)`", keys)) == plain, section


def test_what_the_page_on_3d_screens_says(tmp_path):
    """Its scene loads, its methods and systems are those that there are."""
    page = (ROOT / "docs/stereo.md").read_text()
    (tmp_path / "mine.toml").write_text(re.search(r"^```toml\n(.*?)^```", page, re.M | re.S)[1])
    mine = scene.load_stereo(tmp_path / "mine.toml")
    assert mine.observation(4, 8).matrices[0, 0, 0] == 0.012
    assert mine.observation(4, 8).matrices[1, 2, 2] == 0.016
    aisle = mine.seen_from("aisle").observation(4, 9).share
    assert aisle[:, :, -1] == pytest.approx(1.9)
    methods = page.partition("\n## Methods\n")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `([a-z][a-z-]*)` \|", methods, re.MULTILINE)
    assert set(listed) == {*STEREO, AUTO}
    systems = set(re.findall(r"^\| `(stereo_[a-z_]+)` \|", page, re.MULTILINE))
    assert systems == {name for name in scene.scene_names() if name.startswith("stereo")}


def submodel(annotation):
    """The section in an annotation such as `tuple[Section, ...] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(submodel, get_args(annotation))), None)


def is_section(annotation) -> bool:
    return submodel(annotation) is not None
