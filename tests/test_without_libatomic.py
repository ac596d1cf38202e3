"""A system without libatomic, as small container images are: one line, and Dr.Jit not imported."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store

from compensate.commands import compare
from domesim.frames import read_master
from domesim.pathtrace import llvm

LINE = (
    "Path tracing needs the library libmissing.so.1, which is not installed: "
    "apt install libatomic1 (Debian, Ubuntu), dnf install libatomic (Fedora)"
)


@pytest.fixture
def _missing(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(llvm, "ATOMIC", "libmissing.so.1")
    for name in ("drjit", "mitsuba"):  # as other tests may have left them
        monkeypatch.delitem(sys.modules, name, raising=False)
    llvm._chosen.cache_clear()
    yield
    llvm._chosen.cache_clear()
    assert not {"drjit", "mitsuba"} & set(sys.modules)


TRACING = {
    "render dome_hemisphere --size 32 --samples 2": "seen.exr",
    "tabulate dome_hemisphere --walks 1 --degree 2": "table.npz",
    "master": "master",
}


@pytest.mark.usefixtures("_missing")
@pytest.mark.parametrize("command", TRACING)
def test_what_traces_says_one_line(run: Run, tmp_path: Path, command: str) -> None:
    place = tmp_path / TRACING[command]
    outcome = run(*command.split(), "--out", place)
    outcome.is_refused(LINE)
    assert not place.is_file()


@pytest.mark.usefixtures("_missing")
def test_a_theatre_is_shown_without_views(run: Run, tmp_path: Path) -> None:
    outcome = run("scene", "show", "dome_hemisphere", "--out", tmp_path / "scene.html")
    assert (outcome.code, outcome.err) == (0, "")
    assert LINE in outcome.out
    page = (tmp_path / "scene.html").read_text()
    assert "Section, from the right" in page
    assert "What seats see" not in page


@pytest.mark.usefixtures("_missing")
def test_doctor_tells(run: Run) -> None:
    assert f"needs{LINE.partition('needs')[2]}" in run("doctor").out


ON_EVERY_DEBIAN = r"lib(c|m|dl|rt|pthread|stdc\+\+|gcc_s|z)\.so\.\d+|ld-linux-x86-64\.so\.2"
"""Of the packages that are essential, or needed by those."""


@pytest.mark.skipif(sys.platform != "linux", reason="asks glibc's loader")
@pytest.mark.parametrize("package", ["drjit", "mitsuba", llvm.WHEEL])
def test_wheels_for_path_tracing_need_no_other_library(package: str) -> None:
    try:
        files = [Path(str(file.locate())) for file in metadata.files(package) or ()]
    except metadata.PackageNotFoundError:
        pytest.skip(f"{package} is not installed")
    libraries = [file for file in files if re.search(r"\.so(\.\d+)*$", file.name)]
    if package == llvm.WHEEL:
        libraries = llvm.wheel()
    wheels = {file.name for file in files} | {file.name for file in metadata.files("drjit") or ()}
    found = subprocess.run(
        ["ldd", *map(str, libraries)], capture_output=True, text=True, check=True
    ).stdout
    needed = set(re.findall(r"^\t(?:\S*/)?(\S+) (?:=>|\()", found, re.MULTILINE))
    assert needed
    others = {name for name in needed - wheels if not re.fullmatch(ON_EVERY_DEBIAN, name)}
    assert others - {"linux-vdso.so.1"} <= {llvm.ATOMIC}


@pytest.mark.usefixtures("_missing")
def test_the_demo_works_and_tells(
    run: Run, out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = read_master([store(tmp_path / "m.exr", np.full((32, 32, 3), 0.2, np.float32))])
    monkeypatch.setattr(compare, "bundled_night", lambda: small)
    outcome = run("demo", "--scene", "dome_hemisphere", "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    *_, told, _, page = outcome.out.splitlines()
    assert (told, page) == (LINE, f"Open {out / 'compare.html'}")
