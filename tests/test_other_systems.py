"""The commands on Windows and macOS, as far as Linux can pretend them (`other_system`)."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from documented import ROOT
from other_system import MISSING, OURS
from stored_masters import store

SCENE = ("--scene", "dome_hemisphere")
COMMANDS = {
    "sequence": ("compensate", "show.#.exr", *SCENE, "--out", "out", "--workers", "2"),
    "JPEG 2000": ("compensate", "show.1.exr", *SCENE, "--format", "j2k", "--out", "out"),
    "compare": ("compare", "show.1.exr", *SCENE, "--out", "out.html"),
    "shader": ("shader", *SCENE, "--size", "48x48", "--out", "out/show.glsl"),
    "doctor": ("doctor",),
}
TRIED = [
    ("win32", "sequence"),
    pytest.param("darwin", "sequence", marks=pytest.mark.long),  # it lacks less
    *(
        pytest.param("win32", name, marks=pytest.mark.long)
        for name in COMMANDS
        if name != "sequence"
    ),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(1, 5):
        light = np.random.default_rng(number).random((48, 48, 3)).astype(np.float32)
        store(tmp_path / f"show.{number}.exr", light, "half")
    (tmp_path / "site").mkdir()
    shutil.copy(ROOT / "tests/other_system.py", tmp_path / "site/sitecustomize.py")
    return tmp_path


def run_as(system: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    pretended = {"DOMESIM_TEST_SYSTEM": system, "PYTHONPATH": str(folder / "site")}
    return subprocess.run(
        [sys.executable, "-m", "domesim", *arguments], cwd=folder, env=os.environ | pretended,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("system", "name"), TRIED)
def test_a_command_works(system: str, name: str, folder: Path) -> None:
    done = run_as(system, folder, *COMMANDS[name])
    assert done.returncode == 0, done.stdout + done.stderr
    results = {
        path.name: path.read_bytes() for path in folder.glob("out/[!.]*.*") if path.is_file()
    }
    assert results or name in ("compare", "doctor")
    if results:
        shutil.rmtree(folder / "out")
        assert run_as("", folder, *COMMANDS[name]).returncode == 0
        assert results == {each: (folder / "out" / each).read_bytes() for each in results}


def test_the_pretence_is_one(folder: Path) -> None:
    """Who asks for what Windows has not is refused."""
    asks = "import domesim.host.system as s; exec('import fcntl', {'__name__': 'domesim.x'})"
    pretended = {"DOMESIM_TEST_SYSTEM": "win32", "PYTHONPATH": str(folder / "site")}
    done = subprocess.run(
        [sys.executable, "-c", asks], env=os.environ | pretended, capture_output=True, check=False
    )
    assert b"No module named 'fcntl', as on win32" in done.stderr


def test_one_module_knows_which_system_it_is_on() -> None:
    """What is only of Unix is imported, and asked for, by `domesim.host.system` alone."""
    alone = {"domesim/host/system.py", "validation/faults.py"}
    found = set()
    for package in OURS:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom) and node.module:
                    names = [node.module]
                if set(names) & set(MISSING["win32"]):
                    found.add(path.relative_to(ROOT).as_posix())
    assert found <= alone
