"""Mitsuba, and what it traces paths by: an NVIDIA GPU, or processors by an LLVM.

Dr.Jit loads a libLLVM as soon as it is imported: the one that ``DRJIT_LIBLLVM_PATH`` names, else
the newest that it finds in the system. Without a name of the user's, it is given that of the wheel
`WHEEL`. LLVM 14 is refused by Dr.Jit, and 15 and 16 abort the process on a real render (SIGABRT,
"Cannot select fminimum"), which nothing can catch: versions before `OLDEST` are not used.

Dr.Jit and the wheel also need `ATOMIC`, a library of GCC that no wheel brings and that small
systems lack. Importing Dr.Jit without it ends in a traceback, so it is loaded first.
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from domesim.errors import InputError

VARIABLE = "DRJIT_LIBLLVM_PATH"
WHEEL = "karellen-llvm-core"
OLDEST = 18
"""The first major version that rendered without a fault (tried: 14 to 23)."""
ATOMIC = "libatomic.so.1"
"""The one library outside the wheels that a Debian with Python may lack."""
OPTIX = "libnvoptix.so.1"
"""The part of NVIDIA's driver that meets rays with meshes; containers may lack it."""

_LIBRARIES = (
    r"libunwind\.so\.1(\.\d+)*",
    r"libc\+\+abi\.so\.1(\.\d+)*",
    r"libc\+\+\.so\.1(\.\d+)*",
    r"libLLVM(-\d+)?\.so(\.\d+)*",
)
"""Names of the wheel's libraries, each of which may need those before it."""


def load_mitsuba() -> Any:
    """Import Mitsuba and set its variant: CUDA where there is a GPU, else LLVM.

    Raises
    ------
    InputError
        If there is neither, or `ATOMIC` is missing.
    """
    variant, _ = _chosen()
    mitsuba = import_module("mitsuba")
    mitsuba.set_variant(variant)
    return mitsuba


def lacking() -> str:
    """Name the system's library without which no path can be traced, and how to get it.

    It is "" where the library is there. Neither Dr.Jit nor Mitsuba is imported.
    """
    if sys.platform != "linux" or _loads(ATOMIC):
        return ""
    return (
        f"Path tracing needs the library {ATOMIC}, which is not installed: "
        "apt install libatomic1 (Debian, Ubuntu), dnf install libatomic (Fedora)"
    )


def told() -> str:
    """One line for people: what traces paths, or why none can be traced."""
    try:
        return f"Path tracing with {_chosen()[1]}"
    except InputError as fault:
        return str(fault)


@cache
def _chosen() -> tuple[str, str]:
    """The variant of Mitsuba and what it computes with, in words."""
    if fault := lacking():
        raise InputError(fault)
    libraries = wheel()
    if libraries and not os.environ.get(VARIABLE):
        os.environ[VARIABLE] = str(libraries[-1])
    if libraries and os.environ[VARIABLE] == str(libraries[-1]):
        for library in libraries:
            ctypes.CDLL(str(library))
    early = "drjit" in sys.modules
    drjit = import_module("drjit")
    optix = os.environ.get("DRJIT_LIBOPTIX_PATH", OPTIX)
    if drjit.has_backend(drjit.JitBackend.CUDA) and (sys.platform != "linux" or _loads(optix)):
        return "cuda_ad_rgb", "CUDA"
    major, minor, _ = drjit.detail.llvm_version()  # -1 where there is none
    if major < OLDEST:
        available = f"LLVM {major}" if major > 0 else "neither"
        way_out = f"pip install {WHEEL} (Linux, x86-64), or name another libLLVM in {VARIABLE}"
        if libraries and early:
            way_out = (
                "call domesim.pathtrace.llvm.load_mitsuba() before you import mitsuba or drjit"
            )
        raise InputError(
            f"Path tracing needs an NVIDIA GPU or LLVM {OLDEST} or later, got {available}: "
            f"{way_out}"
        )
    return "llvm_ad_rgb", f"LLVM {major}.{minor}"


def wheel() -> list[Path]:
    """The libraries of the wheel `WHEEL` in the order to load them; none if it is not installed."""
    try:
        files = metadata.files(WHEEL) or []
    except metadata.PackageNotFoundError:
        return []
    paths = []
    for name in _LIBRARIES:
        libraries = (Path(str(file.locate())) for file in files if re.fullmatch(name, file.name))
        paths += [path.resolve() for path in libraries if path.is_file()][:1]
    return paths


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
