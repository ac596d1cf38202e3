"""The choice of a backend: never a library that may abort the process."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from domesim.errors import InputError
from domesim.pathtrace import llvm
from domesim.pathtrace.llvm import (
    NOTHING,
    OVERRIDE,
    VARIABLE,
    Backend,
    backend,
    choose_backend,
    query_version,
)

WHEEL = llvm._wheel()
DEBIAN = {
    major: Path(f"/usr/lib/x86_64-linux-gnu/libLLVM-{major}.so.1")
    for major in (14, 15)
    if Path(f"/usr/lib/x86_64-linux-gnu/libLLVM-{major}.so.1").is_file()
}
ABORT_WHEN = """
#include <stdlib.h>
__attribute__((constructor)) void fall(void) {{ if ({condition}) abort(); }}
void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) {{ *a = 19; *b = *c = 0; }}
"""
needs_wheel = pytest.mark.skipif(WHEEL is None, reason="karellen-llvm-core is not installed")
needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
needs_15 = pytest.mark.skipif(15 not in DEBIAN, reason="no Debian libLLVM-15")
on_each_debian = pytest.mark.parametrize(
    "major",
    [
        pytest.param(major, marks=pytest.mark.skipif(major not in DEBIAN, reason="not installed"))
        for major in (14, 15)
    ],
)


def choose_llvm(environment: Mapping[str, str]) -> Backend:
    """`choose_backend` where no GPU is looked for."""
    return llvm._choose_llvm(environment, llvm._Memory())


@pytest.fixture(autouse=True)
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and no settings of whoever runs the tests; the file it will be in."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.delenv(OVERRIDE, raising=False)
    return tmp_path / "cache" / "domesim" / "llvm.json"


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with neither the wheel nor a system library nor a CUDA device."""
    monkeypatch.setattr(llvm, "_wheel", lambda: None)
    monkeypatch.setattr(llvm, "_system", lambda: [])
    monkeypatch.setattr(llvm, "_query_device", failing("no usable CUDA device"))


@pytest.fixture
def trusting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever has the right version renders: fakes have nothing but a version."""
    monkeypatch.setattr(llvm, "_try_render", lambda *_: "")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The probes that were started."""
    calls: list[str] = []
    run = llvm._run

    def counted(script: str, arguments: list[str], who: str, doing: str, timeout: float) -> str:
        calls.append(f"{doing} {who}")
        return run(script, arguments, who, doing, timeout)

    monkeypatch.setattr(llvm, "_run", counted)
    return calls


@pytest.fixture
def fresh_backend(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """`backend` as a process sees it that has neither asked it nor imported Dr.Jit."""
    monkeypatch.delitem(sys.modules, "drjit", raising=False)
    monkeypatch.setenv(VARIABLE, NOTHING)  # put back afterwards
    backend.cache_clear()
    yield
    backend.cache_clear()


def failing(message: str) -> Callable[..., str]:
    def probe(*_: object) -> str:
        raise InputError(message)

    return probe


def fake_library(folder: Path, body: str) -> Path:
    folder.mkdir(exist_ok=True)
    source, library = folder / "fake.c", folder / "libLLVM.so"
    source.write_text(body)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def reporting(folder: Path, major: int) -> Path:
    signature = "void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c)"
    return fake_library(folder, f"{signature} {{ *a = {major}; *b = 1; *c = 2; }}")


def a_missing_file(folder: Path) -> Path:
    return folder / "libLLVM.so"


def a_directory(folder: Path) -> Path:
    folder.mkdir()
    return folder


def random_bytes(folder: Path) -> Path:
    folder.mkdir()
    (folder / "libLLVM.so").write_bytes(os.urandom(100_000))
    return folder / "libLLVM.so"


def a_link_to_itself(folder: Path) -> Path:
    folder.mkdir()
    (folder / "libLLVM.so").symlink_to(folder / "libLLVM.so")
    return folder / "libLLVM.so"


def a_truncated_copy(folder: Path) -> Path:
    """Its header promises more than there is: touching the rest is a SIGBUS."""
    folder.mkdir()
    real = WHEEL.path if WHEEL else next(iter(DEBIAN.values()), None)
    if real is None:
        pytest.skip("no libLLVM to cut short")
    with real.open("rb") as whole:
        (folder / "libLLVM.so").write_bytes(whole.read(real.stat().st_size // 2))
    return folder / "libLLVM.so"


BAD = {
    a_missing_file: "No such file",
    a_directory: "not a file",
    a_link_to_itself: "Too many levels",
    random_bytes: "OSError",
    a_truncated_copy: "crashed with signal",
}


@pytest.mark.usefixtures("bare")
def test_nothing_at_all_falls_back_to_scalar() -> None:
    choice = choose_backend({})
    assert (choice.variant, choice.vectorised, choice.path) == ("scalar_rgb", False, None)
    assert choice.summary == (
        "Path tracing with NumPy, which is slower: no usable libLLVM; "
        "pip install karellen-llvm-core or set DRJIT_LIBLLVM_PATH"
    )


@needs_wheel
def test_wheel_is_found_and_renders(started: list[str]) -> None:
    assert WHEEL is not None
    choice = choose_llvm({})
    assert choice.path == WHEEL.path
    assert choice.variant == "llvm_ad_rgb"
    assert choice.version is not None
    assert choice.version[0] >= llvm.OLDEST
    assert [path.name.split(".so")[0] for path in choice.companions] == [
        "libunwind",
        "libc++abi",
        "libc++",
    ]
    major, minor, _ = choice.version
    assert choice.summary == f"Path tracing with LLVM {major}.{minor} ({WHEEL.found})"
    assert started == [f"loading {WHEEL.path}", f"rendering {WHEEL.path}"]


@needs_wheel
@on_each_debian
def test_debians_old_library_gives_way_to_the_wheel(major: int) -> None:
    assert WHEEL is not None
    choice = choose_llvm({VARIABLE: str(DEBIAN[major])})
    assert choice.path == WHEEL.path
    assert f"passed over {DEBIAN[major]}: version {major} by its name" in choice.summary


@pytest.mark.usefixtures("bare")
@pytest.mark.skipif(not DEBIAN, reason="no Debian libLLVM")
def test_debians_old_libraries_alone_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "_system", lambda: list(DEBIAN.values()))
    choice = choose_backend({})
    assert choice.path is None
    assert choice.why.count("by its name, 18 or later is needed") == len(DEBIAN)


@needs_15
@pytest.mark.usefixtures("bare")
def test_rendering_alone_would_have_found_out_15(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "OLDEST", 0)
    choice = choose_llvm({VARIABLE: str(DEBIAN[15])})
    assert choice.path is None
    assert "crashed with signal 6 while rendering" in choice.why


@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize("bad", BAD)
def test_bad_file_is_passed_over(bad: Callable[[Path], Path], tmp_path: Path) -> None:
    path = bad(tmp_path / "bad")
    choice = choose_llvm({VARIABLE: str(path)})
    assert choice.path is None
    assert f"passed over {path}: " in choice.why
    assert BAD[bad] in choice.why
    assert "\n" not in choice.summary


@needs_compiler
@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize(
    ("condition", "doing"), [("1", "loading"), ('getenv("DRJIT_LIBLLVM_PATH")', "rendering")]
)
def test_library_that_aborts_does_not_take_us_along(
    tmp_path: Path, condition: str, doing: str
) -> None:
    library = fake_library(tmp_path, ABORT_WHEN.format(condition=condition))
    choice = choose_llvm({VARIABLE: str(library)})
    assert choice.path is None
    assert f"{library}: crashed with signal 6 while {doing}" in choice.why


@needs_compiler
@pytest.mark.usefixtures("bare")
def test_library_of_the_right_version_that_is_no_llvm_is_passed_over(tmp_path: Path) -> None:
    choice = choose_llvm({VARIABLE: str(reporting(tmp_path, 19))})
    assert choice.path is None
    assert "LLVM backend is inactive" in choice.why


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
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
def test_library_that_hangs_is_given_up(tmp_path: Path) -> None:
    body = "#include <unistd.h>\n__attribute__((constructor)) void hang(void) { sleep(60); }"
    library = fake_library(tmp_path, body)
    with pytest.raises(InputError, match=r"still loading after 0\.5 s"):
        query_version(library, timeout=0.5)


def test_rendering_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "_RENDER_PROBE", "import time; time.sleep(60)")
    with pytest.raises(InputError, match=r"lib: still rendering after 0\.5 s"):
        llvm._try_render("llvm_ad_rgb", Path("lib"), (), timeout=0.5)


def test_no_process_to_probe_in_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    choice = choose_backend({})
    assert not choice.vectorised
    assert WHEEL is None or "no process to try it in" in choice.why


@needs_wheel
def test_the_wheel_set_by_ourselves_keeps_its_companions() -> None:
    assert WHEEL is not None
    choice = choose_llvm({VARIABLE: str(WHEEL.path)})
    assert (choice.path, choice.found) == (WHEEL.path, WHEEL.found)
    assert choice.companions == WHEEL.companions


@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize("value", ["", NOTHING])
def test_a_variable_that_names_no_library_is_none(value: str) -> None:
    assert choose_llvm({VARIABLE: value}).passed_over == ()


@needs_compiler
@pytest.mark.usefixtures("trusting")
def test_the_user_goes_before_the_system_and_the_system_before_scalar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, theirs = reporting(tmp_path / "mine", 18), reporting(tmp_path / "theirs", 19)
    monkeypatch.setattr(llvm, "_wheel", lambda: None)
    monkeypatch.setattr(llvm, "_system", lambda: [theirs])
    assert choose_llvm({VARIABLE: str(mine)}).path == mine
    assert choose_llvm({}) == Backend("llvm_ad_rgb", "system", theirs, (19, 1, 2))


# What the probes said is remembered.


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
def test_known_library_starts_no_process(tmp_path: Path, started: list[str]) -> None:
    environment = {VARIABLE: str(reporting(tmp_path, 19))}
    first = choose_llvm(environment)
    assert first.path is not None
    assert len(started) == 1
    assert choose_llvm(environment) == first
    assert len(started) == 1


@pytest.mark.usefixtures("bare")
def test_known_failure_starts_no_process(tmp_path: Path, started: list[str]) -> None:
    environment = {VARIABLE: str(random_bytes(tmp_path / "bad"))}
    first = choose_llvm(environment)
    assert len(started) == 1
    assert choose_llvm(environment) == first
    assert len(started) == 1


@pytest.mark.usefixtures("bare")
def test_an_override_asks_again_after_a_failure(tmp_path: Path, started: list[str]) -> None:
    environment = {VARIABLE: str(random_bytes(tmp_path / "bad")), OVERRIDE: "llvm"}
    for _ in range(2):
        with pytest.raises(InputError, match="DOMESIM_VARIANT=llvm: no usable libLLVM; passed"):
            choose_backend(environment)
    assert len(started) == 2


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
@pytest.mark.parametrize("change", ["mtime", "mitsuba", "python", "machine"])
def test_a_change_starts_a_new_probe(
    tmp_path: Path, started: list[str], monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    library = reporting(tmp_path, 19)
    choose_llvm({VARIABLE: str(library)})
    if change == "mtime":
        status = library.stat()
        os.utime(library, ns=(status.st_atime_ns, status.st_mtime_ns + 1_000))
    elif change == "mitsuba":
        monkeypatch.setattr(llvm, "_installed", lambda package: f"another {package}")
    elif change == "python":
        (tmp_path / "python").symlink_to(sys.executable)
        monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    else:
        monkeypatch.setattr(llvm.platform, "node", lambda: "another")
    choose_llvm({VARIABLE: str(library)})
    assert len(started) == 2


@needs_compiler
@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize("fault", ["timeout", "killed", "out of memory", "a limit of memory"])
def test_what_may_be_the_machines_load_is_not_remembered(
    tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    probe = {
        "timeout": "import time; time.sleep(60)",
        "killed": "import os; os.kill(os.getpid(), 9)",
        "out of memory": "raise MemoryError",
        "a limit of memory": "import sys; sys.exit('of something')",
    }
    if fault == "a limit of memory":
        monkeypatch.setattr(llvm.resource, "getrlimit", lambda which: (1 << 40, 1 << 40))
    monkeypatch.setattr(llvm, "_RENDER_PROBE", probe[fault])
    run = llvm._run
    patience = 0.5 if fault == "timeout" else 20.0
    monkeypatch.setattr(llvm, "_run", lambda *args, **_: run(*args[:4], patience))
    library = reporting(tmp_path, 19)
    assert not choose_llvm({VARIABLE: str(library)}).vectorised
    assert not memory.exists()


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
def test_what_an_llvm_needs_is_named_and_may_come_later(tmp_path: Path, memory: Path) -> None:
    needed = reporting(tmp_path / "needed", 19).rename(tmp_path / "libneeded.so")
    library = tmp_path / "libLLVM.so"
    code = tmp_path / "calls.c"
    code.write_text("void LLVMGetVersion(); void *needed = LLVMGetVersion;")
    linked = ["-Wl,-rpath,$ORIGIN", "-L", tmp_path, "-lneeded"]
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, code, *linked], check=True)
    needed.rename(tmp_path / "elsewhere")
    (fault,) = choose_llvm({VARIABLE: str(library)}).passed_over
    assert fault == f"{library}: needs libneeded.so, which is not installed"
    assert not memory.exists()
    (tmp_path / "elsewhere").rename(needed)
    assert choose_llvm({VARIABLE: str(library)}).path == library


@needs_wheel
@pytest.mark.usefixtures("memory")
def test_a_wheel_that_is_installed_is_no_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "_system", lambda: [])
    monkeypatch.setattr(llvm, "query_version", failing("out of order"))
    choice = choose_llvm({})
    assert choice.passed_over == ("out of order",)
    assert choice.remedy == "set DRJIT_LIBLLVM_PATH"


def spoil(memory: Path, how: str) -> None:
    if how == "a folder instead":
        memory.unlink()
        memory.mkdir()
    elif how == "unexpected answers":
        known = json.loads(memory.read_text())
        memory.write_text(json.dumps({key: {"said": "twenty-three"} for key in known}))
    else:
        memory.write_bytes(
            {
                "empty": b"",
                "cut short": memory.read_bytes()[:-20],
                "no text": b"\xff\xfe\x00",
                "a list": b"[1, 2]",
                "too deep": b"[" * 100_000,
            }[how]
        )


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
@pytest.mark.parametrize(
    "how",
    [
        "empty",
        "cut short",
        "no text",
        "a list",
        "too deep",
        "a folder instead",
        "unexpected answers",
    ],
)
def test_damaged_memory_is_ignored(
    tmp_path: Path, memory: Path, started: list[str], how: str
) -> None:
    environment = {VARIABLE: str(reporting(tmp_path, 19))}
    first = choose_llvm(environment)
    spoil(memory, how)
    assert choose_llvm(environment) == first
    assert len(started) == 2


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting")
def test_memory_that_cannot_be_written_is_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Not by permissions: root may write everywhere.
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert choose_llvm({VARIABLE: str(reporting(tmp_path, 19))}).vectorised


def test_memory_without_a_home_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", "relative/is/not/allowed")
    monkeypatch.setattr(llvm.Path, "home", staticmethod(homeless))
    assert llvm._Memory().ask(["key"], lambda: "said") == "said"


def test_memory_is_written_whole_and_does_not_grow_for_ever(memory: Path) -> None:
    for number in range(100):
        assert llvm._Memory().ask([str(number)], lambda: "said") == "said"
    known = json.loads(memory.read_text())
    assert len(known) == 64
    assert json.loads(list(known)[-1])[-1] == "99"
    assert list(memory.parent.iterdir()) == [memory]


# CUDA, and what the user asks for. There need not be a device: its probes are faked.


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "_query_device", lambda: "NVIDIA H200")


@pytest.mark.usefixtures("bare", "trusting", "device")
def test_cuda_goes_first_even_without_llvm() -> None:
    choice = choose_backend({})
    assert (choice.variant, choice.vectorised, choice.path) == ("cuda_ad_rgb", True, None)
    assert choice.summary == "Path tracing with CUDA (NVIDIA H200)"


@needs_compiler
@pytest.mark.usefixtures("bare", "trusting", "device")
def test_cuda_keeps_the_library_that_dr_jit_will_load_too(tmp_path: Path) -> None:
    library = reporting(tmp_path, 19)
    choice = choose_backend({VARIABLE: str(library)})
    assert (choice.variant, choice.path) == ("cuda_ad_rgb", library)
    assert choose_backend({VARIABLE: str(library), OVERRIDE: "llvm"}).variant == "llvm_ad_rgb"


@pytest.mark.usefixtures("bare", "device")
def test_a_device_that_cannot_render_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvm, "_try_render", failing("CUDA: crashed with signal 11"))
    assert "passed over NVIDIA H200 with CUDA: crashed with signal 11" in choose_backend({}).summary
    with pytest.raises(InputError, match="DOMESIM_VARIANT=cuda: NVIDIA H200 with CUDA: crashed"):
        choose_backend({OVERRIDE: "cuda"})


def test_the_device_is_asked_once(
    monkeypatch: pytest.MonkeyPatch, bare: None, trusting: None
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(llvm, "_query_device", lambda: asked.append(1) or "NVIDIA H200")
    assert choose_backend({}) == choose_backend({})
    assert len(asked) == 1
    choose_backend({"CUDA_VISIBLE_DEVICES": "1"})
    assert len(asked) == 2


@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ("cuda", r"DOMESIM_VARIANT=cuda: no usable CUDA device"),
        ("llvm", r"DOMESIM_VARIANT=llvm: no usable libLLVM; pip install"),
        ("gpu", r"DOMESIM_VARIANT must be cuda, llvm or scalar, got 'gpu'"),
    ],
)
def test_what_the_machine_cannot_do_is_one_clear_line(wanted: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        choose_backend({OVERRIDE: wanted})
    assert "\n" not in str(raised.value)


def test_scalar_on_request_probes_nothing(started: list[str]) -> None:
    choice = choose_backend({OVERRIDE: "scalar"})
    assert choice == Backend("scalar_rgb", "DOMESIM_VARIANT=scalar")
    assert not started


def test_probe_without_a_driver_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_LIBCUDA_PATH", "/no/libcuda.so")
    with pytest.raises(InputError, match=r"no usable CUDA device: no driver \(/no/libcuda\.so\)"):
        llvm._query_device()


@needs_compiler
@pytest.mark.parametrize(("count", "status"), [(2, 0), (0, 0), (1, 100)])
def test_probe_asks_the_driver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, status: int
) -> None:
    body = f"""#include <string.h>
    int cuInit(unsigned flags) {{ return {status}; }}
    int cuDeviceGetCount(int *count) {{ *count = {count}; return 0; }}
    int cuDeviceGetName(char *name, int size, int device) {{ strcpy(name, "Fake"); return 0; }}"""
    monkeypatch.setenv("DRJIT_LIBCUDA_PATH", str(fake_library(tmp_path, body)))
    if (count, status) == (2, 0):
        assert llvm._query_device() == "Fake"
    else:
        with pytest.raises(InputError, match="no device" if status == 0 else "status 100"):
            llvm._query_device()


# This process, and processes of their own.


@pytest.mark.usefixtures("bare", "fresh_backend")
def test_without_a_usable_library_dr_jit_is_told_to_load_none() -> None:
    assert not backend().vectorised
    assert os.environ[VARIABLE] == NOTHING
    assert "drjit" not in sys.modules
    assert backend() is backend()


@needs_wheel
@pytest.mark.usefixtures("fresh_backend")
def test_backend_prepares_the_process_for_whoever_imports_dr_jit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert WHEEL is not None
    loaded: list[str] = []
    monkeypatch.setattr(llvm, "_query_device", failing("none"))
    monkeypatch.setattr(ctypes, "CDLL", loaded.append)
    assert backend().path == WHEEL.path
    assert loaded == [llvm.ATOMIC, *(str(path) for path in WHEEL.companions)]
    assert os.environ[VARIABLE] == str(WHEEL.path)


@pytest.mark.usefixtures("bare", "fresh_backend")
@pytest.mark.parametrize(
    ("loaded", "variant"),
    [((15, 0, 6), "scalar_rgb"), (None, "scalar_rgb"), ((19, 1, 7), "llvm_ad_rgb")],
)
def test_dr_jit_that_was_imported_first_is_judged_by_its_version(
    monkeypatch: pytest.MonkeyPatch, loaded: Any, variant: str
) -> None:
    drjit = SimpleNamespace(
        JitBackend=SimpleNamespace(LLVM="llvm"),
        has_backend=lambda _: loaded is not None,
        detail=SimpleNamespace(llvm_version=lambda: loaded),
    )
    monkeypatch.setitem(sys.modules, "drjit", drjit)
    assert backend().variant == variant
    assert "imported first" in backend().summary
    assert os.environ[VARIABLE] == NOTHING


RENDER = """
import sys
from domesim.pathtrace.llvm import backend, load_mitsuba
mi = load_mitsuba()
box = mi.cornell_box()
box["sensor"]["film"].update(width=8, height=8)
picture = mi.TensorXf(mi.render(mi.load_dict(box), spp=1, seed=1))
maps = open("/proc/self/maps").read() if sys.platform == "linux" else ""
assert {bad!r} not in maps, "the bad library was loaded"
print(mi.variant(), backend().vectorised, picture.shape)
"""


def process(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("bad", ["15", "truncated"])
@pytest.mark.parametrize("wanted", ["", "scalar"])
def test_no_bad_library_aborts_a_render(tmp_path: Path, bad: str, wanted: str) -> None:
    if bad == "15" and 15 not in DEBIAN:
        pytest.skip("no Debian libLLVM-15")
    path = DEBIAN[15] if bad == "15" else a_truncated_copy(tmp_path / "bad")
    ran = process(RENDER.format(bad=str(path)), **{VARIABLE: str(path), OVERRIDE: wanted})
    assert ran.returncode == 0, ran.stderr
    variants = {"scalar_rgb"} if wanted or not WHEEL else {"llvm_ad_rgb", "cuda_ad_rgb"}
    assert ran.stdout.split()[0] in variants
    assert ran.stdout.endswith("(8, 8, 3)\n")


@needs_15
def test_dr_jit_imported_first_with_15_does_not_abort_a_render() -> None:
    ran = process("import drjit\n" + RENDER.format(bad="nothing"), **{VARIABLE: str(DEBIAN[15])})
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.split()[0] in {"scalar_rgb", "cuda_ad_rgb"}


@needs_15
def test_15_does_abort_a_render_of_its_own() -> None:
    """The fault that all this is about: should it go away, so may this."""
    unguarded = RENDER.replace("load_mitsuba()", "__import__('mitsuba')").format(bad="nothing")
    code = unguarded.replace("box = ", "mi.set_variant('llvm_ad_rgb'); box = ", 1)
    ran = process(code, **{VARIABLE: str(DEBIAN[15]), "DRJIT_CACHE_DIR": NOTHING})
    assert ran.returncode == -6
    assert "Cannot select" in ran.stderr
