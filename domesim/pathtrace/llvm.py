"""Which libLLVM Dr.Jit may load, found without risking the process.

Dr.Jit compiles its kernels with a libLLVM that it loads at run time from ``DRJIT_LIBLLVM_PATH`` or
from the system. LLVM 14 is refused, and 15 and 16 abort the process on a real render (SIGABRT,
"Cannot select fminimum"), which nothing can catch. So a library is first loaded in a process of its
own and asked for its version; Dr.Jit sees it only when that went well. The order is: what the user
set, the ``karellen-llvm-core`` wheel, the system; and without any, Mitsuba's scalar variant.

`load_mitsuba` is how this package comes by Mitsuba.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from domesim.errors import InputError

VARIABLE = "DRJIT_LIBLLVM_PATH"
WHEEL = "karellen-llvm-core"
OLDEST = 18
"""The first major version that rendered without a fault (tried: 14 to 23)."""

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
# LLVMGetVersion came with LLVM 16: a library without it is older than that.
_PROBE = """
import ctypes, sys
*companions, library = sys.argv[1:]
loaded = [ctypes.CDLL(companion) for companion in companions]
version = [ctypes.c_uint() for _ in range(3)]
ask = getattr(ctypes.CDLL(library), "LLVMGetVersion", None)
if ask is not None:
    ask(*(ctypes.byref(part) for part in version))
print(*(part.value for part in version))
"""


@dataclass(frozen=True)
class LlvmChoice:
    """The libLLVM to use, and why.

    Attributes
    ----------
    path
        The library, or None when no usable one was found.
    version
        (major, minor, patch) as the library itself reports it.
    why
        Where it was found and what was passed over before it, in one line.
    companions
        Libraries that `path` needs and the loader would not find, in loading order.
    """

    path: Path | None
    version: Version | None
    why: str
    companions: tuple[Path, ...] = ()

    @property
    def variant(self) -> str:
        """The Mitsuba variant to render with."""
        return "scalar_rgb" if self.path is None else "llvm_ad_rgb"


@dataclass(frozen=True)
class _Candidate:
    found: str
    path: Path
    companions: tuple[Path, ...] = ()


def choose_llvm(environment: Mapping[str, str] | None = None) -> LlvmChoice:
    """Find a libLLVM that Dr.Jit can be trusted with.

    Parameters
    ----------
    environment
        Where to look for ``DRJIT_LIBLLVM_PATH``; the process's own by default.
    """
    passed_over: list[str] = []
    for candidate in _candidates(os.environ if environment is None else environment):
        try:
            version = query_version(candidate.path, candidate.companions)
        except InputError as fault:
            passed_over.append(f"passed over {fault}")
            continue
        if version[0] < OLDEST:
            passed_over.append(f"passed over {candidate.path}: {_too_old(version)}")
            continue
        why = "; ".join([candidate.found, *passed_over])
        return LlvmChoice(candidate.path, version, why, candidate.companions)
    why = "; ".join(["no usable libLLVM", *passed_over, f"pip install {WHEEL} or set {VARIABLE}"])
    return LlvmChoice(None, None, why)


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
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    command = [sys.executable, "-I", "-c", _PROBE, *map(str, companions), str(path)]
    try:
        probe = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: did not load within {timeout:g} s") from None
    if probe.returncode < 0:
        raise InputError(f"{path}: crashed with signal {-probe.returncode} while loading")
    if probe.returncode > 0:
        raise InputError(f"{path}: {probe.stderr.strip().splitlines()[-1]}")
    major, minor, patch = map(int, probe.stdout.split())
    return major, minor, patch


def load_mitsuba() -> Any:
    """Import Mitsuba with the library of `choose_llvm`, and set its variant.

    Dr.Jit looks for libLLVM once, so this must come before anything else in the process imports it.
    """
    choice = choose_llvm()
    for companion in choice.companions:
        ctypes.CDLL(str(companion))
    if choice.path is not None:
        os.environ[VARIABLE] = str(choice.path)
    mitsuba = import_module("mitsuba")
    mitsuba.set_variant(choice.variant)
    return mitsuba


def _too_old(version: Version) -> str:
    found = f"version {version[0]}" if any(version) else "no LLVMGetVersion"
    return f"{found}, {OLDEST} or later is needed"


def _candidates(environment: Mapping[str, str]) -> Iterator[_Candidate]:
    wheel = _wheel()
    seen = set()
    if environment.get(VARIABLE):
        path = Path(environment[VARIABLE])
        # load_mitsuba sets the variable: the wheel's library comes back here in child processes.
        ours = wheel is not None and path.exists() and path.samefile(wheel.path)
        yield _Candidate(f"set by {VARIABLE}", path, wheel.companions if ours and wheel else ())
        seen.add(path.resolve())
    if wheel is not None and wheel.path.resolve() not in seen:
        yield wheel
        seen.add(wheel.path.resolve())
    for path in _system():
        if path.resolve() not in seen:
            yield _Candidate("system", path)
            seen.add(path.resolve())


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
