"""Public functions of the reference (docs/api.md) say what they take, return and raise."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = re.findall(
    r"^   ((?:domesim|compensate|testing|validation)[.\w]*)$",
    (ROOT / "docs" / "api.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)
SECTION = re.compile(r"^(Parameters|Returns|Yields|Raises)\n-+$", re.MULTILINE)


@pytest.mark.parametrize("module", MODULES)
def test_functions_of_two_arguments_are_documented(module):
    assert gaps(source_of(module).read_text(encoding="utf-8")) == []


def source_of(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def gaps(source: str) -> list[str]:
    """What docstrings of public functions with two arguments or more lack."""
    return [
        f"{name}: {gap}"
        for name, function in functions(ast.parse(source))
        if len(arguments(function)) > 1
        for gap in gaps_of(function)
    ]


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Public functions and methods, by name."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                    yield f"{node.name}.{inner.name}", inner


def arguments(function: ast.FunctionDef) -> set[str]:
    args = function.args
    named = [*args.posonlyargs, *args.args, *args.kwonlyargs, args.vararg, args.kwarg]
    return {each.arg for each in named if each is not None} - {"self", "cls"}


def gaps_of(function: ast.FunctionDef) -> Iterator[str]:
    text = ast.get_docstring(function) or ""
    if inherited := re.match(r"See `(\w+)`", text):
        if f"{inherited[1]}.{function.name}" not in sectioned():
            yield f"{inherited[1]} does not describe it"
        return
    parts = SECTION.split(text)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    listed = re.findall(r"^(\S.*)$", sections.get("Parameters", ""), re.MULTILINE)
    described = {name.strip(" *") for line in listed for name in line.split(":")[0].split(",")}
    if missing := arguments(function) - described:
        yield f"Parameters lack {', '.join(sorted(missing))}"
    if not returns_nothing(function) and not {"Returns", "Yields"} & set(sections):
        yield "no Returns"
    if any(isinstance(node, ast.Raise) for node in ast.walk(function)) and "Raises" not in sections:
        yield "no Raises"


def returns_nothing(function: ast.FunctionDef) -> bool:
    return isinstance(function.returns, ast.Constant) and function.returns.value is None


@cache
def sectioned() -> set[str]:
    """Methods, as Class.method, whose docstrings have sections of their own."""
    return {
        name
        for package in ("domesim", "compensate", "testing", "validation")
        for path in (ROOT / package).rglob("*.py")
        for name, function in functions(ast.parse(path.read_text(encoding="utf-8")))
        if SECTION.search(ast.get_docstring(function) or "")
    }


FUNCTION = '''
def f(a, *, b: int) -> int:
    """Adds.

    Parameters
    ----------
    a, b
        Two numbers.
    {}
    """
    raise ValueError
'''


def test_what_is_missing_is_noticed():
    whole = """
    Returns
    -------
    c
        A number.

    Raises
    ------
    ValueError"""
    assert gaps(FUNCTION.format(whole)) == []
    assert gaps(FUNCTION.format("")) == ["f: no Returns", "f: no Raises"]
    assert gaps(FUNCTION.format(whole).replace("a, b\n", "a\n")) == ["f: Parameters lack b"]
    assert gaps('class C:\n    def f(self, a, b):\n        """See `Nobody`."""\n') == [
        "C.f: Nobody does not describe it"
    ]
