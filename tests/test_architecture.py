"""What imports what: seen in fresh processes, where an `__init__` cannot hide it."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]


def loaded_by(statement: str, *modules: str) -> set[str]:
    """Which of `modules` a fresh interpreter has loaded after `statement`."""
    code = f"{statement}\nimport sys\nprint(*(m for m in {modules!r} if m in sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_the_tops_of_the_packages_load_nothing():
    modules = ("numpy", "domesim.scene", "compensate.master", "importlib.metadata")
    assert loaded_by("import domesim, compensate", *modules) == set()
    assert loaded_by("from domesim import observe", "domesim.scene") == {"domesim.scene"}


def test_slow_imports_wait_until_they_are_needed():
    modules = ("colour", "torch", "matplotlib", "mitsuba", "av")
    assert loaded_by("from domesim.commands import build; build()", *modules) == set()


COMPENSATING = """
import compensate.commands.compensate, compensate.master, domesim.commands.shows
import numpy as np
from compensate.figures import Appraisal
from compensate.pose import pose
from domesim.scene import load_scene
for name, views in (("dome_hemisphere", 1), ("stereo_spectral", 2)):
    posed = pose(np.linspace(0, 1, views * 64**2 * 3).reshape(views, 64, 64, 3), load_scene(name))
    light, appraisal = posed.aimed(), Appraisal(posed)
    appraisal.loss(light), appraisal.pollution, appraisal.ghost_edges(light)
"""


def test_compensating_does_without_what_is_slow_to_load():
    """Together they take half a second."""
    parts = ("fft", "integrate", "linalg", "ndimage", "optimize", "sparse", "spatial", "special")
    slow = [
        *(f"scipy.{part}" for part in parts),
        "numpy.f2py",
        "colour",
        "fileseq",
        "asyncio",
        "rich",
        "mitsuba",
        "drjit",
    ]
    assert loaded_by(COMPENSATING, *slow) == set()


def test_help_loads_no_command():
    code = "from domesim.commands import build; build(['--help'])"
    assert loaded_by(code, "domesim.commands.observe", "numpy", "rich", "OpenImageIO") == set()


def test_only_the_command_that_runs_is_loaded():
    code = "from domesim.commands import build; build(['observe', 'a.png'])"
    assert loaded_by(
        code, "domesim.commands.observe", "compensate.commands.compensate", "validation.cli"
    ) == {"domesim.commands.observe"}


def test_the_probe_can_fail():
    assert loaded_by("import json", "json", "mitsuba") == {"json"}


def test_only_its_own_tests_import_validation():
    """What others share with experiments is in `testing`."""
    tests = Path(__file__).parent
    importing = re.compile(r"^\s*(?:from|import) validation\b", re.MULTILINE)
    found = {
        path.relative_to(tests)
        for path in tests.rglob("*.py")
        if importing.search(path.read_text())
    }
    assert Path("validation/test_report.py") in found
    assert {path for path in found if path.parts[0] != "validation"} == set()


def test_what_a_user_installs_is_what_the_product_uses():
    """Its modules are imported somewhere, or it is named: libLLVM is no module."""
    code = "\n".join(
        path.read_text()
        for folder in ("domesim", "compensate", "scenes")
        for path in (ROOT / folder).rglob("*.py")
    )
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    # Names as they are in the package index; one of another Python's has a condition
    modules = {re.split(r"[^\w-]", one)[0]: set() for one in listed if "python_version" not in one}
    for module, distributions in packages_distributions().items():
        for name in distributions:
            modules.get(re.sub(r"[_.]", "-", name).lower(), set()).add(module)
    assert len(modules) > 10
    for name, found in modules.items():
        module = f"({'|'.join(found | {name})})"
        imported = rf"""^\s*(import|from) {module}\b|import_module\("{module}"\)|"{name}"\n"""
        assert re.search(imported, code, re.MULTILINE), name
