"""What paths are traced with: CUDA, then an LLVM that renders, else one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from domesim.errors import InputError
from domesim.pathtrace import llvm
from domesim.pathtrace.llvm import OPTIX, VARIABLE, load_mitsuba, told, wheel

SENTENCE = "Path tracing needs an NVIDIA GPU or LLVM 18 or later, got {}: pip install karellen"


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Makes Dr.Jit find what a test says, without a wheel."""
    monkeypatch.setattr(llvm, "wheel", list)
    monkeypatch.setenv(VARIABLE, "")

    def finds(major: int = -1, *, cuda: bool = False, lacks: str = "") -> None:
        drjit = SimpleNamespace(
            JitBackend=SimpleNamespace(CUDA="cuda"),
            has_backend=lambda name: name == "cuda" and cuda,
            detail=SimpleNamespace(llvm_version=lambda: (major, 1, 0)),
        )
        monkeypatch.setattr(llvm, "import_module", lambda _: drjit)
        monkeypatch.setattr(llvm, "_loads", lambda library: library != lacks)

    llvm._chosen.cache_clear()
    yield finds
    llvm._chosen.cache_clear()


@pytest.mark.parametrize(("major", "found"), [(-1, "neither"), (14, "LLVM 14"), (17, "LLVM 17")])
def test_without_a_usable_one_it_says_so(
    machine: Callable[..., None], major: int, found: str
) -> None:
    machine(major)
    with pytest.raises(InputError, match=SENTENCE.format(found)):
        load_mitsuba()
    assert told().startswith(SENTENCE.format(found))


@pytest.mark.parametrize("major", [18, 23])
def test_what_renders_is_used(machine: Callable[..., None], major: int) -> None:
    machine(major)
    assert llvm._chosen() == ("llvm_ad_rgb", f"LLVM {major}.1")
    assert told() == f"Path tracing with LLVM {major}.1"


def test_a_gpu_goes_first_and_needs_no_llvm(machine: Callable[..., None]) -> None:
    machine(cuda=True)
    assert llvm._chosen()[0] == "cuda_ad_rgb"


@pytest.mark.skipif(sys.platform != "linux", reason="OptiX has another name there")
def test_a_gpu_whose_driver_meets_no_meshes_is_left_out(machine: Callable[..., None]) -> None:
    machine(23, cuda=True, lacks=OPTIX)
    assert llvm._chosen()[0] == "llvm_ad_rgb"


def test_another_variant_does_not_stay() -> None:
    """Polarised light wants one for a while."""
    mitsuba = load_mitsuba()
    before = mitsuba.variant()
    mitsuba.set_variant("scalar_rgb")
    assert load_mitsuba().variant() == before


def process(library: str) -> subprocess.CompletedProcess[str]:
    """A fresh process, told to use a library of LLVM."""
    code = (
        f"import os\nos.environ[{VARIABLE!r}] = {library!r}\n"
        "os.environ['CUDA_VISIBLE_DEVICES'] = ''\n"
        "from domesim.pathtrace.llvm import told\n"
        f"print(told())\nprint(os.environ[{VARIABLE!r}])"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.skipif(not wheel(), reason="the wheel of LLVM is not installed")
@pytest.mark.parametrize("before", ["", str((wheel() or [Path()])[-1])])
def test_the_wheel_is_used(before: str) -> None:
    """Also by a child of a process that uses it, whose environment names it."""
    found = process(before)
    assert found.stderr == ""
    line, library = found.stdout.splitlines()
    assert line.startswith("Path tracing with LLVM ")
    assert Path(library).name.startswith("libLLVM")


@pytest.mark.skipif(not wheel(), reason="the wheel of LLVM is not installed")
def test_who_imported_drjit_too_early_is_told_so() -> None:
    """Dr.Jit has taken the system's LLVM then, whichever that is."""
    code = "import drjit\nfrom domesim.pathtrace.llvm import told\nprint(told())"
    environment = {**os.environ, VARIABLE: "", "CUDA_VISIBLE_DEVICES": ""}
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    said = found.stdout.strip()
    assert said.startswith("Path tracing with LLVM") or said.endswith("import mitsuba or drjit")


def test_the_users_choice_goes_before_the_wheel(tmp_path: Path) -> None:
    none = tmp_path / "libLLVM.so"
    none.write_bytes(b"")
    found = process(str(none))
    assert found.stdout.splitlines() == [told_of("neither"), str(none)]


def told_of(found: str) -> str:
    end = f"-llvm-core (Linux, x86-64), or name another libLLVM in {VARIABLE}"
    return SENTENCE.format(found) + end
