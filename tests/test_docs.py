"""The documentation: tutorials and how-to pages run, the site builds, what it quotes is there."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from command_line import exit_code
from documented import ROOT, play

import domesim
from compensate.live.constants import constants_of
from domesim.commands import manual
from domesim.errors import InputError
from domesim.frames import read_frame, write_frame
from domesim.pathtrace import tabulate
from domesim.pathtrace.tracer import Settings
from domesim.scene import load_scene, scene_names

QUICKER = {
    "0.005": "0.05", "1-4": "1-2", "256": "48", "16": "4", "320": "64", "360": "64",
}  # fmt: skip
"""Words of the pages' commands, and those that do for a test."""
NIGHT = Path("scenes/masters/night.exr")
PAGES = [
    page
    for pattern in ("README.md", "docs/*.md", "docs/tutorials/*.md")
    for page in sorted(str(path.relative_to(ROOT)) for path in ROOT.glob(pattern))
    if page != "docs/commands.md"
]
MEASURED = re.compile(
    r"\d\s(?:s|ms|minutes|hours|GiB|JOD|JND|FFTs|core-(?:ms|seconds)|frames a second)\b"
)


@pytest.mark.long
@pytest.mark.parametrize(
    "page",
    [
        "tutorials/theatre",
        "tutorials/pair",
        "tutorials/research",
        "compensating",
        "predicting",
        "rooms",
    ],
)
def test_a_page_runs(page, tmp_path, monkeypatch):
    """What it says, one after the other, in an empty folder; masters are smaller."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tabulate, "LANES", 1 << 12)
    monkeypatch.setattr(tabulate, "Settings", lambda **given: Settings(**{**given, "error": 0.05}))
    NIGHT.parent.mkdir(parents=True)
    night = read_frame(ROOT / NIGHT)
    write_frame(replace(night, pixels=night.pixels[::8, ::8].copy()), NIGHT)
    play(f"docs/{page}.md", exit_code, QUICKER)


def test_every_option_says_what_it_is():
    rows = re.findall(r"^\| `(.+)` \| (.*) \|$", manual.page(), re.MULTILINE)
    assert len(rows) > 200
    assert all(told and told[0] not in "\\[(" for _, told in rows)
    assert set(re.findall(r"^## domesim (\S+)", manual.page(), re.MULTILINE)) >= {
        "compensate", "compare", "demo", "doctor", "measure", "observe", "scene", "validate"
    }  # fmt: skip


def test_modules_of_the_reference_are_there():
    page = (ROOT / "docs" / "api.md").read_text()
    listed = re.findall(r"^   ((?:domesim|compensate|validation)[.\w]+)$", page, re.MULTILINE)
    assert len(listed) > 40
    assert [name for name in listed if find_spec(name) is None] == []


def test_messages_that_are_explained_are_the_programs():
    """Each part of a quoted message is of one text in the source."""
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    quoted = re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE)
    assert len(quoted) > 20
    source = set(texts())
    for message in quoted:
        parts = [part.strip() for part in message.split("...")]
        assert any(all(part in text for part in parts) for text in source), message


def texts() -> Iterator[str]:
    """The texts in the source, without what is put into them."""
    for package in ("domesim", "compensate"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.JoinedStr):
                    constants = (each for each in node.values if isinstance(each, ast.Constant))
                    yield "".join(str(each.value) for each in constants)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def prose(page: str) -> str:
    """A page without the contents of scene files."""
    return re.sub(r"^```toml.*?^```", "", (ROOT / page).read_text(), flags=re.M | re.S)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_that_need_not_be_made(page):
    targets = re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", prose(page))
    found = [(ROOT / page).parent.joinpath(target).resolve() for target in targets]
    made = [ROOT / "docs" / name for name in ("api", "commands.md", "gallery")]
    assert [path for path in found if not path.exists() or {path, *path.parents} & {*made}] == []


@pytest.mark.parametrize("page", PAGES)
def test_measured_numbers_stand_beside_their_run(page):
    """A section with seconds, GiB or JOD names a command, an experiment, a note or the results."""
    run = re.compile(
        r"`(?:domesim|python -m|make|/usr/bin/time) |^domesim |--only |experiment `"
        r"|results\.json|validation/(?:notes|experiments)/",
        re.M,
    )
    sections = re.split(r"^(?=##? )", prose(page), flags=re.M)
    assert [s for s in sections if MEASURED.search(s) and not run.search(s)] == []


def test_lists_are_whole():
    """Extras of the package, notes, and scenes that cannot be compensated live."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    assert set(
        re.findall(r"`(?:pip install ')?\.\[(\w+)\]'?` \|", prose("docs/install.md"))
    ) == set(extras)
    notes = {path.name for path in (ROOT / "validation/notes").glob("0*.md")}
    assert set(re.findall(r"notes/(0[^)]+)\)", prose("docs/evidence.md"))) == notes


def test_scenes_that_live_refuses_are_listed():
    page = prose("docs/live.md")
    listed = page[page.index("The bundled scenes that are refused") : page.index("In a shader")]
    refused = set()
    for name in scene_names():
        try:
            constants_of(load_scene(name), 48, 48)
        except InputError:
            refused.add(name)
    assert set(re.findall(r"`(\w+)`", listed)) == refused


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path):
    """But for the gallery's programs, which test_examples runs."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-D", "plot_gallery=0"]
    command += ["-c", "docs", ".", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    site = tmp_path / "site" / "docs"
    reference = (site / "api.html").read_text()
    for name in ("domesim.load_master", "domesim.load_scene", "domesim.observe", "domesim.save"):
        assert f'id="{name}"' in reference
    assert 'id="compensate.compensate"' in reference
    assert 'id="compensate.problem.Problem"' in (site / "api/compensate.problem.html").read_text()
    assert "--dry-run" in (site / "commands.html").read_text()


@pytest.mark.long
def test_a_wheel_has_all_that_it_needs(tmp_path):
    """The demo and an experiment, from an empty folder, with this environment's dependencies."""
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "-w", str(tmp_path), str(ROOT)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    (tmp_path / "empty").mkdir()
    demo = ["demo", "--out", "demo"]
    experiment = ["validate", "--quick", "--only", "closed_form", "--out", "validation"]
    for arguments in (["--version"], demo, experiment):
        subprocess.run(
            [sys.executable, "-m", "domesim", *arguments],
            cwd=tmp_path / "empty",
            env={"PYTHONPATH": str(tmp_path / "installed"), "PATH": ""},
            check=True,
        )
    assert (tmp_path / "empty/demo/compare.html").is_file()
    assert (tmp_path / "empty/validation/report.html").is_file()


def test_the_citation_is_of_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {domesim.__version__}\n" in text
