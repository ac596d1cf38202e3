"""What an experiment's figures rest on: the modules that it imports, and the files that they read.

`digest` changes with what the modules do, not with their comments, docstrings and line breaks. It
is the same on every machine and with every Python.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final

ROOT = Path(__file__).parents[1]
PACKAGES = ("domesim", "compensate", "validation", "testing", "scenes")
_COMMAND_RUN = '"-m", "domesim"'
"""In the source of what runs commands; they rest on every module of these:"""
_OF_COMMANDS = ("domesim", "compensate")
_PACKAGE_READ = re.compile(r'\bfiles\("([a-z._]+)"\)')
"""In the source of what reads a package's data files."""


@final
@dataclass(frozen=True)
class _Module:
    imports: tuple[str, ...]
    packages: tuple[str, ...]
    """Those of which it reads the data files."""
    runs_commands: bool
    digest: str


def digest(experiment: str, root: Path = ROOT) -> str:
    """SHA-256 of the modules that an experiment imports, directly or not, and of their data files.

    Parameters
    ----------
    experiment
        Name of a module of `validation.experiments`.
    root
        Folder of the packages.
    """
    total = hashlib.sha256()
    for name, content in sorted(_contents(f"validation.experiments.{experiment}", root).items()):
        total.update(f"{name} {content}\n".encode())
    return total.hexdigest()


def _contents(module: str, root: Path) -> dict[str, str]:
    """Digests of modules and files, by their names."""
    found: dict[str, str] = {}
    waiting, met = [module], set[str]()
    while waiting:
        name = waiting.pop()
        path = None if name in met else _path(name, root)
        met.add(name)
        if path is None:
            continue
        read = _read(path.read_text(encoding="utf-8"))
        found[name] = read.digest
        waiting += read.imports
        if read.runs_commands:
            waiting += [each for package in _OF_COMMANDS for each in _modules(package, root)]
        for package in read.packages:
            found |= _data(root / package.replace(".", "/"))
    return found


def _path(module: str, root: Path) -> Path | None:
    """File of a module; None if it is not of our packages."""
    if module.split(".", maxsplit=1)[0] not in PACKAGES:
        return None
    path = root / module.replace(".", "/")
    candidates = (path / "__init__.py", path.with_suffix(".py"))
    return next((path for path in candidates if path.is_file()), None)


def _modules(package: str, root: Path) -> Iterator[str]:
    for path in (root / package).rglob("*.py"):
        yield ".".join(path.relative_to(root).with_suffix("").parts)


def _data(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder.parent).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc")
    }


@functools.cache
def _read(source: str) -> _Module:
    tree = ast.parse(source)
    meaning = hashlib.sha256(repr(_meaning(tree)).encode()).hexdigest()
    packages = tuple(_PACKAGE_READ.findall(source))
    return _Module(tuple(_imports(tree)), packages, _COMMAND_RUN in source, meaning)


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names of modules, also of some that there are not: a class may be imported, or a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _meaning(node: object) -> object:
    """A syntax tree without docstrings, places and what is empty, which differs by Python."""
    if isinstance(node, list):
        return [_meaning(each) for each in node if not _is_docstring(each)]
    if not isinstance(node, ast.AST):
        return node
    parts = ((name, _meaning(value)) for name, value in ast.iter_fields(node))
    return (type(node).__name__, *(part for part in parts if part[1] not in (None, [])))


def _is_docstring(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
