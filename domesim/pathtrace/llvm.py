"""What to trace paths with, found without risking the process.

Dr.Jit compiles its kernels with a libLLVM that it loads, as soon as it is imported, from
``DRJIT_LIBLLVM_PATH`` or from the system. A damaged file kills the process there and then (SIGBUS);
LLVM 14 is refused, and 15 and 16 abort the process on a real render (SIGABRT, "Cannot select
fminimum"), which nothing can catch. So a library is first loaded in a process of its own and asked
for its version, and then renders a small picture in another; Dr.Jit sees it only when that went
well. The order is: what the user set, the ``karellen-llvm-core`` wheel, the system. Without any,
Dr.Jit is kept from loading one, and the variant is Mitsuba's scalar one. A CUDA device that passes
the same test goes before all of them, and ``DOMESIM_VARIANT`` (cuda, llvm or scalar) before that.

Dr.Jit and the wheel also need `ATOMIC`, a library of GCC that no wheel brings and that small
systems lack. Importing Dr.Jit without it ends in a traceback, so it is loaded first.

What the probes said, failures too, is remembered for this machine in the user's cache folder;
``DOMESIM_VARIANT=llvm`` or ``=cuda`` asks a failed one again.

`backend` says what this process uses; `load_mitsuba` is how this package comes by Mitsuba.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import re
import resource
import signal
import stat
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from domesim.errors import InputError

VARIABLE = "DRJIT_LIBLLVM_PATH"
OVERRIDE = "DOMESIM_VARIANT"
WHEEL = "karellen-llvm-core"
OLDEST = 18
"""The first major version that rendered without a fault (tried: 14 to 23)."""
NOTHING = os.devnull
"""What `VARIABLE` is set to when Dr.Jit is to load no libLLVM: unset, it would search for one."""
ATOMIC = "libatomic.so.1"
"""The one library outside the wheels that a Debian with Python may lack."""

Version = tuple[int, int, int]

_COMPANIONS = (
    r"libunwind\.so\.1(\.\d+)*",
    r"libc\+\+abi\.so\.1(\.\d+)*",
    r"libc\+\+\.so\.1(\.\d+)*",
)
_SYSTEM = (
    "/usr/lib/*-linux-gnu/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib64/llvm*/lib/libLLVM*.so*",
    "/usr/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM.dylib",
    "/usr/local/opt/llvm*/lib/libLLVM.dylib",
)


@dataclass(frozen=True)
class Backend:
    """What to trace paths with, and why.

    Attributes
    ----------
    variant
        The Mitsuba variant: ``cuda_ad_rgb``, ``llvm_ad_rgb`` or ``scalar_rgb``.
    found
        Where the library or device was found, or why there is none.
    path
        The libLLVM that Dr.Jit may load; None when there is no usable one, or when Dr.Jit had
        loaded its own before we were asked.
    version
        (major, minor, patch) as the library itself reports it.
    companions
        Libraries that `path` needs and the loader would not find, in loading order.
    passed_over
        What was tried before and could not be used, each with its reason.
    remedy
        How to come by something faster.
    """

    variant: str
    found: str
    path: Path | None = None
    version: Version | None = None
    companions: tuple[Path, ...] = ()
    passed_over: tuple[str, ...] = ()
    remedy: str = ""

    @property
    def vectorised(self) -> bool:
        """Whether Mitsuba traces batches of rays."""
        return self.variant != "scalar_rgb"

    @property
    def why(self) -> str:
        """Where it was found and what was passed over before it, in one line."""
        passed_over = [f"passed over {reason}" for reason in self.passed_over]
        return "; ".join(filter(None, [self.found, *passed_over, self.remedy]))

    @property
    def summary(self) -> str:
        """What was chosen and why, in one line for people."""
        if not self.vectorised:
            return f"Path tracing with NumPy, which is slower: {self.why}"
        if self.variant == "cuda_ad_rgb" or self.version is None:
            return f"Path tracing with CUDA ({self.why})"
        return f"Path tracing with LLVM {self.version[0]}.{self.version[1]} ({self.why})"


@cache
def backend() -> Backend:
    """The choice for this process, made once, without importing Mitsuba.

    From here on Dr.Jit, whoever imports it, loads the library chosen. If Dr.Jit was imported
    before, its library can only be judged by its version.

    Raises
    ------
    InputError
        As `choose_backend`.
    """
    drjit = sys.modules.get("drjit")
    if drjit is not None:
        return _choose(os.environ, lambda _: _loaded_by(drjit))
    chosen = choose_backend()
    for companion in chosen.companions:
        ctypes.CDLL(str(companion))
    os.environ[VARIABLE] = str(chosen.path or NOTHING)
    return chosen


def load_mitsuba() -> Any:
    """Import Mitsuba and set the variant that `backend` chose.

    Raises
    ------
    InputError
        As `backend`.
    """
    variant = backend().variant
    mitsuba = import_module("mitsuba")
    mitsuba.set_variant(variant)
    return mitsuba


def lacking() -> str:
    """The library without which no path can be traced, and how to get it; "" where it is there."""
    try:
        if sys.platform == "linux":
            ctypes.CDLL(ATOMIC)
    except OSError:
        return (
            f"Path tracing needs the library {ATOMIC}, which is not installed: "
            "apt install libatomic1 (Debian, Ubuntu), dnf install libatomic (Fedora)"
        )
    return ""


def told() -> str:
    """What paths are traced with, or why none can be, in one line for people."""
    try:
        return backend().summary
    except InputError as fault:
        return str(fault)


def choose_backend(environment: Mapping[str, str] | None = None) -> Backend:
    """Find the fastest way of tracing paths that can be trusted.

    Parameters
    ----------
    environment
        Where to look for ``DOMESIM_VARIANT`` and ``DRJIT_LIBLLVM_PATH``; the process's own by
        default.

    Raises
    ------
    InputError
        If `ATOMIC` is missing, or ``DOMESIM_VARIANT`` asks for what this machine cannot do.
    """
    if fault := lacking():
        raise InputError(fault)
    environment = os.environ if environment is None else environment
    return _choose(environment, partial(_choose_llvm, environment))


def query_version(path: Path, companions: tuple[Path, ...] = (), timeout: float = 60.0) -> Version:
    """Ask the library at `path` for its version, in a process of its own.

    Returns
    -------
    Version
        (0, 0, 0) if the library cannot tell, which means that it is older than LLVM 16.

    Raises
    ------
    InputError
        If there is no such file, or it does not load, or loading it crashes or takes `timeout` (s).
    """
    _file_status(path)
    arguments = [*map(str, companions), str(path)]
    return _version(_run(_VERSION_PROBE, arguments, f"{path}", "loading", timeout))


def _choose(environment: Mapping[str, str], llvm_of: Callable[[_Memory], Backend]) -> Backend:
    wanted = environment.get(OVERRIDE, "")
    if wanted not in {"", "cuda", "llvm", "scalar"}:
        raise InputError(f"{OVERRIDE} must be cuda, llvm or scalar, got {wanted!r}")
    if wanted == "scalar":
        return Backend("scalar_rgb", f"{OVERRIDE}=scalar")
    memory = _Memory(insist=bool(wanted))
    llvm = llvm_of(memory)
    if wanted == "llvm":
        if not llvm.vectorised:
            raise InputError(f"{OVERRIDE}=llvm: {llvm.why}")
        return llvm
    key = ["cuda", *_cuda_status(environment), str(llvm.path)]
    try:
        device = memory.ask(["device", *key], _query_device)
    except InputError as fault:
        # Most machines have none: that needs no explanation unless one was asked for.
        if wanted == "cuda":
            raise InputError(f"{OVERRIDE}=cuda: {fault}") from None
        return llvm
    try:
        memory.ask(key, partial(_try_render, "cuda_ad_rgb", llvm.path, llvm.companions))
    except InputError as fault:
        if wanted == "cuda":
            raise InputError(f"{OVERRIDE}=cuda: {device} with {fault}") from None
        return replace(llvm, passed_over=(f"{device} with {fault}", *llvm.passed_over))
    return Backend("cuda_ad_rgb", device, llvm.path, llvm.version, llvm.companions)


def _choose_llvm(environment: Mapping[str, str], memory: _Memory) -> Backend:
    passed_over: list[str] = []
    for candidate in _candidates(environment):
        try:
            version = candidate.version(memory)
        except InputError as fault:
            passed_over.append(str(fault))
            continue
        if version[0] < OLDEST:
            passed_over.append(f"{candidate.path}: {_too_old(candidate.path, version)}")
            continue
        return Backend(
            "llvm_ad_rgb",
            candidate.found,
            candidate.path,
            version,
            candidate.companions,
            tuple(passed_over),
        )
    return Backend(
        "scalar_rgb",
        "no usable libLLVM",
        passed_over=tuple(passed_over),
        remedy=f"set {VARIABLE}" if _wheel() else f"pip install {WHEEL} or set {VARIABLE}",
    )


def _loaded_by(drjit: Any) -> Backend:
    found = "loaded by Dr.Jit, which was imported first"
    version: Version = (0, 0, 0)
    if drjit.has_backend(drjit.JitBackend.LLVM):
        version = drjit.detail.llvm_version()
    if version[0] >= OLDEST:
        return Backend("llvm_ad_rgb", found, version=version)
    fault = f"LLVM {version[0]}, {OLDEST} or later is needed" if any(version) else "no libLLVM"
    remedy = f"call {__name__}.backend() before Dr.Jit is imported"
    return Backend("scalar_rgb", f"{fault}, {found}", remedy=remedy)


@dataclass(frozen=True)
class _Candidate:
    found: str
    path: Path
    companions: tuple[Path, ...] = ()

    def version(self, memory: _Memory) -> Version:
        """The version of a library that loads and, if it is new enough, renders."""
        status = _file_status(self.path)
        key = [self.path, status.st_size, status.st_mtime_ns, *self.companions]
        return _version(memory.ask(["llvm", *map(str, key)], self._probe, r"\d+ \d+ \d+"))

    def _probe(self) -> str:
        version = query_version(self.path, self.companions)
        if version[0] >= OLDEST:
            _try_render("llvm_ad_rgb", self.path, self.companions)
        return " ".join(map(str, version))


def _candidates(environment: Mapping[str, str]) -> Iterator[_Candidate]:
    wheel = _wheel()
    seen = set()
    if environment.get(VARIABLE, "") not in {"", NOTHING}:
        path = Path(environment[VARIABLE]).absolute()
        # `backend` sets the variable: the wheel's library comes back here in child processes.
        ours = wheel is not None and _real(path) == _real(wheel.path)
        yield wheel if ours and wheel else _Candidate(f"set by {VARIABLE}", path)
        seen.add(_real(path))
    if wheel is not None and _real(wheel.path) not in seen:
        yield wheel
        seen.add(_real(wheel.path))
    for path in _system():
        if _real(path) not in seen:
            yield _Candidate("system", path)
            seen.add(_real(path))


def _real(path: Path) -> str:
    # Path.resolve raises on a link to itself.
    return os.path.realpath(path)


def _wheel() -> _Candidate | None:
    try:
        files = metadata.files(WHEEL) or []
    except metadata.PackageNotFoundError:
        return None

    def located(pattern: str) -> Path | None:
        matches = (Path(str(file.locate())) for file in files if re.fullmatch(pattern, file.name))
        return next((path.resolve() for path in matches if path.is_file()), None)

    library = located(r"libLLVM(-\d+)?\.so(\.\d+)*")
    if library is None:
        return None
    companions = tuple(path for path in map(located, _COMPANIONS) if path is not None)
    return _Candidate(f"wheel {WHEEL} {metadata.version(WHEEL)}", library, companions)


def _system() -> list[Path]:
    """System libraries, the newest by name first."""
    found = [path for pattern in _SYSTEM for path in Path("/").glob(pattern[1:])]

    def named_version(path: Path) -> list[int]:
        return [int(number) for number in re.findall(r"\d+", path.name)]

    return sorted(found, key=named_version, reverse=True)


def _too_old(path: Path, version: Version) -> str:
    named = re.search(r"libLLVM-(\d+)", path.name)
    if any(version):
        found = f"version {version[0]}"
    else:
        found = f"version {named[1]} by its name" if named else "no LLVMGetVersion"
    return f"{found}, {OLDEST} or later is needed"


def _version(text: str) -> Version:
    major, minor, patch = map(int, text.split())
    return major, minor, patch


def _file_status(path: Path) -> os.stat_result:
    try:
        status = path.stat()
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: not a file")
    return status


def _cuda_status(environment: Mapping[str, str]) -> list[str]:
    """What tells one state of this machine's CUDA devices from another."""
    names = ("CUDA_VISIBLE_DEVICES", "DRJIT_LIBCUDA_PATH", "DRJIT_LIBOPTIX_PATH")
    try:
        driver = Path("/proc/driver/nvidia/version").read_text(encoding="utf-8")
    except (OSError, ValueError):
        driver = ""
    nodes = sorted(
        path.name for pattern in ("nvidia*", "dxg") for path in Path("/dev").glob(pattern)
    )
    return [driver, *nodes, *(f"{name}={environment.get(name)}" for name in names)]


class _Memory:
    """What probes said on this machine, in a file that may be lost or damaged at any time.

    Parameters
    ----------
    insist
        Ask again where the probe failed the last time.
    """

    def __init__(self, insist: bool = False) -> None:
        self.insist = insist

    def ask(self, key: list[str], probe: Callable[[], str], pattern: str = ".*") -> str:
        """What `probe` returned (it matches `pattern`) or raised, the last time or now.

        Raises
        ------
        InputError
            As `probe` does. An `_InconclusiveError` is not remembered.
        """
        software = [sys.executable, _installed("mitsuba"), _installed("drjit"), _PROBES]
        searched = os.environ.get("LD_LIBRARY_PATH", "")
        name = json.dumps([platform.node(), *software, searched, *key])
        match self._read().get(name):
            case {"said": str(said)} if re.fullmatch(pattern, said):
                return said
            case {"fault": str(fault)} if not self.insist:
                raise InputError(fault)
        try:
            said = probe()
        except _InconclusiveError:
            raise
        except InputError as fault:
            self._add(name, {"fault": str(fault)})
            raise
        self._add(name, {"said": said})
        return said

    def _read(self) -> dict[str, Any]:
        try:
            known = json.loads(_memory_file().read_text(encoding="utf-8"))
        except (OSError, ValueError, RuntimeError):  # RuntimeError: no home, or nested too deep
            return {}
        return known if isinstance(known, dict) else {}

    def _add(self, name: str, answer: dict[str, str]) -> None:
        known = {other: said for other, said in self._read().items() if other != name}
        latest = dict([*known.items(), (name, answer)][-64:])
        try:
            file = _memory_file()
            file.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=file.parent) as folder:
                written = Path(folder) / file.name
                written.write_text(json.dumps(latest, indent=1), encoding="utf-8")
                written.replace(file)
        except (OSError, RuntimeError):
            pass  # the next process asks again


def _memory_file() -> Path:
    folder = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (folder if folder.is_absolute() else Path.home() / ".cache") / "domesim" / "llvm.json"


def _installed(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


class _InconclusiveError(InputError):
    """The probe failed by what may be otherwise the next time: load, memory, another library."""


def _query_device() -> str:
    """The name of the first CUDA device, asked in a process of its own."""
    return _run(_DEVICE_PROBE, [], "no usable CUDA device", "starting", timeout=60.0)


def _try_render(
    variant: str, path: Path | None, companions: tuple[Path, ...], timeout: float = 120.0
) -> str:
    """Render a small picture in a process of its own."""
    arguments = [json.dumps(sys.path), variant, str(path or NOTHING), *map(str, companions)]
    who = "CUDA" if variant == "cuda_ad_rgb" else f"{path}"
    return _run(_RENDER_PROBE, arguments, who, "rendering", timeout)


def _run(script: str, arguments: list[str], who: str, doing: str, timeout: float) -> str:
    """What `script` prints; it is named `who`, and said to be `doing` something, if it fails."""
    try:
        probe = subprocess.run(
            [sys.executable, "-I", "-c", _PRELUDE + script, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _InconclusiveError(f"{who}: still {doing} after {timeout:g} s") from None
    except OSError as fault:
        raise _InconclusiveError(f"{who}: no process to try it in: {fault.strerror}") from None
    missing = re.search(r"(\S+): cannot open shared object file", probe.stderr)
    if missing and missing[1] != who:
        raise _InconclusiveError(f"{who}: needs {missing[1]}, which is not installed")
    kind = _InconclusiveError if _lacked_memory(probe) else InputError
    if probe.returncode < 0:
        raise kind(f"{who}: crashed with signal {-probe.returncode} while {doing}")
    if probe.returncode > 0:
        said = probe.stderr.strip().splitlines() or [f"exit status {probe.returncode}"]
        raise kind(f"{who}: {said[-1]}")
    return probe.stdout.strip()


def _lacked_memory(probe: subprocess.CompletedProcess[str]) -> bool:
    """Whether a probe that failed may have done so for want of memory, which may come again."""
    limited = resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
    killed = -probe.returncode == signal.SIGKILL
    told = re.search("memory|allocate|map segment|new thread", probe.stderr, re.IGNORECASE)
    return limited or killed or told is not None


_PRELUDE = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except (ImportError, OSError, ValueError):
    pass
"""
# LLVMGetVersion came with LLVM 16: a library without it is older than that.
_VERSION_PROBE = """
import ctypes
*companions, library = sys.argv[1:]
loaded = [ctypes.CDLL(companion) for companion in companions]
version = [ctypes.c_uint() for _ in range(3)]
ask = getattr(ctypes.CDLL(library), "LLVMGetVersion", None)
if ask is not None:
    ask(*(ctypes.byref(part) for part in version))
print(*(part.value for part in version))
"""
_DEVICE_PROBE = """
import ctypes, os
driver = os.environ.get("DRJIT_LIBCUDA_PATH") or "libcuda.so.1"
try:
    cuda = ctypes.CDLL(driver)
except OSError:
    sys.exit(f"no driver ({driver})")
count, name = ctypes.c_int(), ctypes.create_string_buffer(256)
status = cuda.cuInit(0)
if status:
    sys.exit(f"cuInit failed with status {status}")
if cuda.cuDeviceGetCount(ctypes.byref(count)) or count.value < 1:
    sys.exit("no device")
cuda.cuDeviceGetName(name, len(name), 0)
print(name.value.decode(errors="replace") or "CUDA device")
"""
# Without HOME, Dr.Jit does not take the kernels from its cache that it is here to compile.
_RENDER_PROBE = """
import ctypes, json, os
path, variant, library, *companions = sys.argv[1:]
sys.path[:] = json.loads(path)
for name in ("HOME", "DRJIT_CACHE_DIR"):
    os.environ.pop(name, None)
loaded = [ctypes.CDLL(companion) for companion in companions]
os.environ["DRJIT_LIBLLVM_PATH"] = library
import drjit, mitsuba
mitsuba.set_variant(variant)
ramp = drjit.linspace(mitsuba.Float, -1.0, 1.0, 64)
clipped = drjit.sum(drjit.maximum(drjit.minimum(ramp, 0.5), -0.5) + drjit.sqrt(drjit.abs(ramp)))[0]
if not 40.0 < clipped < 45.0:
    sys.exit(f"computed a wrong sum, {clipped}")
box = mitsuba.cornell_box()
box["sensor"]["film"].update(width=8, height=8)
image = mitsuba.render(mitsuba.load_dict(box), spp=1, seed=1).array
if not drjit.all(drjit.isfinite(image)) or not 0.0 < drjit.mean(image)[0] < 10.0:
    sys.exit("rendered a wrong picture")
"""
_PROBES = str(zlib.crc32(f"{OLDEST}{_VERSION_PROBE}{_DEVICE_PROBE}{_RENDER_PROBE}".encode()))
