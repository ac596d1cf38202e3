"""``domesim doctor``: what is installed here and what it amounts to, for a bug report."""

from __future__ import annotations

import importlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import psutil

import domesim
from compensate.fourier import transforms
from domesim.commands.options import Json, Quiet
from domesim.host.console import Console, sized

_LIBRARIES = ("numpy", "scipy", "openimageio", "mitsuba", "drjit", "typer", "pydantic")
_DEVELOPERS = ("dev", "docs")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_BLOCK = bytes(1 << 23)
_SECONDS = 1.0


def doctor(quiet: Quiet = False, json: Json = False) -> None:
    """Tell what is installed here, for bug reports: versions, extras, LLVM, GPU, disk."""
    console = Console(quiet=quiet, json=json)
    facts = {
        "domesim": f"{domesim.__version__}, {Path(domesim.__file__).parent}",
        "Python": f"{platform.python_version()}, {sys.executable}",
        "System": f"{platform.platform()}, {os.cpu_count()} cores, "
        f"{sized(psutil.virtual_memory().total)} of memory, "
        f"{sized(psutil.virtual_memory().available)} free",
        "Libraries": ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES),
        **{f"Extra {name}": _told(packages) for name, packages in _extras().items()},
        "FFT": transforms().__name__,
        "Path tracing": _path_tracing(),
        "GPU": _gpu(),
        "ffmpeg": _program("ffmpeg", "-version"),
        "Browser": next(
            (text for name in _BROWSERS if (text := _program(name, "--version")) != _NONE), _NONE
        ),
        "Disk": _disk(Path.cwd()),
        "Settings": ", ".join(
            f"{name}={value}" for name, value in os.environ.items() if name.startswith(_OURS)
        )
        or _NONE,
    }
    width = max(map(len, facts))
    console.say(*(f"{name:{width}}  {value}" for name, value in facts.items()))
    console.figures({"doctor": facts})


_NONE = "none"
_OURS = ("DOMESIM_", "DRJIT_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_")


def _version(package: str) -> str:
    """Installed version of a package; "" if there is none."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _extras() -> dict[str, list[str]]:
    """The packages of each extra, but for those of some systems only and of developers."""
    packages = defaultdict(list)
    for line in metadata.requires("domesim") or ():
        name, extra = re.match(r"[\w.-]+", line), re.search(r"extra == ['\"](\w+)", line)
        if name and extra and "platform" not in line and extra[1] not in _DEVELOPERS:
            packages[extra[1]].append(name[0])
    return dict(packages)


def _told(packages: list[str]) -> str:
    have = [f"{name} {_version(name)}" for name in packages if _version(name)]
    missing = [name for name in packages if not _version(name)]
    if not have:
        return f"not installed ({', '.join(missing)})"
    return ", ".join(have) + (f"; without {', '.join(missing)}" if missing else "")


def _path_tracing() -> str:
    from domesim.pathtrace.llvm import told  # noqa: PLC0415 - asks for it in processes

    return told().removeprefix("Path tracing ")


def _gpu() -> str:
    if find_spec("torch") is None:
        return f"{_NONE} for torch, which is not installed"
    torch = importlib.import_module("torch")
    if not torch.cuda.is_available():
        return f"{_NONE} for torch {torch.__version__}"
    return f"{torch.cuda.get_device_name()}, CUDA {torch.version.cuda}, torch {torch.__version__}"


def _program(name: str, asking: str) -> str:
    """Path of a program, and the first line that it says of itself."""
    path = shutil.which(name)
    if path is None:
        return _NONE
    try:
        done = subprocess.run(
            [path, asking], capture_output=True, text=True, timeout=20, check=False
        )
    except (OSError, subprocess.SubprocessError) as error:
        return f"{path}, which does not run ({type(error).__name__})"
    return f"{path}, {(done.stdout.strip() or 'no version').splitlines()[0][:60]}"


def _disk(folder: Path) -> str:
    """How fast files are written there, and what is free."""
    free = f"{sized(shutil.disk_usage(folder).free)} free in {folder}"
    begin, written = time.perf_counter(), 0
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            while written < 32 * len(_BLOCK) and time.perf_counter() < begin + _SECONDS:
                written += file.write(_BLOCK)
                file.flush()
                os.fsync(file.fileno())
    except OSError as error:
        return f"{free}, which cannot be written to ({error.strerror})"
    return f"{sized(written / (time.perf_counter() - begin))}/s written, {free}"
