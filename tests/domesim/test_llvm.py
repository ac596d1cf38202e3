"""The choice of libLLVM: never a library that may abort the process."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from domesim.errors import InputError
from domesim.pathtrace import llvm
from domesim.pathtrace.llvm import VARIABLE, LlvmChoice, choose_llvm, query_version

WHEEL = llvm._wheel()
needs_wheel = pytest.mark.skipif(WHEEL is None, reason="karellen-llvm-core is not installed")
needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with neither the wheel nor a system library."""
    monkeypatch.setattr(llvm, "_wheel", lambda: None)
    monkeypatch.setattr(llvm, "_system", lambda: [])


def fake_library(folder: Path, body: str) -> Path:
    source, library = folder / "fake.c", folder / "libLLVM.so"
    source.write_text(body)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def reporting(folder: Path, major: int) -> Path:
    signature = "void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c)"
    return fake_library(folder, f"{signature} {{ *a = {major}; *b = 1; *c = 2; }}")


@pytest.mark.usefixtures("bare")
def test_no_candidate_falls_back_to_scalar() -> None:
    choice = choose_llvm({})
    assert choice.path is None
    assert choice.variant == "scalar_rgb"
    assert "pip install karellen-llvm-core" in choice.why


@pytest.mark.usefixtures("bare")
def test_missing_file_is_passed_over(tmp_path: Path) -> None:
    choice = choose_llvm({VARIABLE: str(tmp_path / "libLLVM.so")})
    assert choice.path is None
    assert "no such file" in choice.why


@pytest.mark.usefixtures("bare")
def test_corrupt_file_is_passed_over(tmp_path: Path) -> None:
    corrupt = tmp_path / "libLLVM.so"
    corrupt.write_bytes(b"\x7fELF and then nothing")
    choice = choose_llvm({VARIABLE: str(corrupt)})
    assert choice.path is None
    assert str(corrupt) in choice.why


@needs_compiler
@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize(("major", "accepted"), [(16, False), (17, False), (18, True), (23, True)])
def test_version_decides(tmp_path: Path, major: int, accepted: bool) -> None:
    library = reporting(tmp_path, major)
    choice = choose_llvm({VARIABLE: str(library)})
    assert (choice.path == library) is accepted
    assert choice.version == ((major, 1, 2) if accepted else None)
    assert accepted or f"version {major}, 18 or later is needed" in choice.why


@needs_compiler
@pytest.mark.usefixtures("bare")
def test_library_without_a_version_is_too_old(tmp_path: Path) -> None:
    library = fake_library(tmp_path, "int nothing;")
    assert query_version(library) == (0, 0, 0)
    assert "no LLVMGetVersion" in choose_llvm({VARIABLE: str(library)}).why


@needs_compiler
def test_library_that_aborts_does_not_take_us_along(tmp_path: Path) -> None:
    body = "#include <stdlib.h>\n__attribute__((constructor)) void fall(void) { abort(); }"
    library = fake_library(tmp_path, body)
    with pytest.raises(InputError, match="signal 6"):
        query_version(library)


@needs_compiler
def test_library_that_hangs_is_given_up(tmp_path: Path) -> None:
    body = "#include <unistd.h>\n__attribute__((constructor)) void hang(void) { sleep(60); }"
    library = fake_library(tmp_path, body)
    with pytest.raises(InputError, match="did not load within"):
        query_version(library, timeout=0.5)


@needs_compiler
@needs_wheel
def test_bad_setting_falls_through_to_the_wheel(tmp_path: Path) -> None:
    assert WHEEL is not None
    choice = choose_llvm({VARIABLE: str(reporting(tmp_path, 15))})
    assert choice.path == WHEEL.path
    assert "version 15" in choice.why


@needs_wheel
def test_wheel_is_found_and_new_enough() -> None:
    assert WHEEL is not None
    choice = choose_llvm({})
    assert choice.path == WHEEL.path
    assert choice.version is not None
    assert choice.version[0] >= llvm.OLDEST
    assert [path.name.split(".so")[0] for path in choice.companions] == [
        "libunwind",
        "libc++abi",
        "libc++",
    ]


@needs_wheel
def test_the_wheel_set_by_ourselves_keeps_its_companions() -> None:
    assert WHEEL is not None
    choice = choose_llvm({VARIABLE: str(WHEEL.path)})
    assert choice.path == WHEEL.path
    assert choice.companions == WHEEL.companions


@needs_compiler
def test_the_user_goes_before_the_system_and_the_system_before_scalar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    users, systems = tmp_path / "users", tmp_path / "systems"
    users.mkdir()
    systems.mkdir()
    mine, theirs = reporting(users, 18), reporting(systems, 19)
    monkeypatch.setattr(llvm, "_wheel", lambda: None)
    monkeypatch.setattr(llvm, "_system", lambda: [theirs])
    assert choose_llvm({VARIABLE: str(mine)}).path == mine
    assert choose_llvm({}) == LlvmChoice(theirs, (19, 1, 2), "system")
