"""Pages of the documentation as programs: their files, commands and lines of Python, in order."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]


class Block(NamedTuple):
    """A fenced block: what follows the fence, and what is in it."""

    language: str
    text: str


def blocks(page: str) -> Iterator[Block]:
    """The fenced blocks of a page, given by its path in the repository."""
    parts = re.split(r"^```", (ROOT / page).read_text(), flags=re.MULTILINE)[1::2]
    for part in parts:
        head, _, body = part.partition("\n")
        yield Block(head, body)


def commands(page: str) -> list[list[str]]:
    """The words of each `domesim` command on a page."""
    return [
        shlex.split(line)
        for block in blocks(page)
        if block.language == ""
        for line in block.text.splitlines()
        if line.startswith("domesim ")
    ]


def play(page: str, run: Callable[..., int], instead: Mapping[str, str]) -> dict[str, Any]:
    """Do in the current folder what a page says, and return the names of its Python.

    TOML is written to ``mine.toml``. Words of commands that are in `instead` are exchanged.
    """
    names: dict[str, Any] = {}
    for block in blocks(page):
        if block.language == "toml":
            Path("mine.toml").write_text(block.text)
        elif block.language == "python":
            exec(block.text, names)
        elif block.language == "":
            for line in block.text.splitlines():
                if line.startswith("domesim "):
                    _do([instead.get(word, word) for word in shlex.split(line)], run)
        else:
            assert block.language == "text", block.language
    return names


def _do(words: list[str], run: Callable[..., int]) -> None:
    """One command, which must go well and write what it was asked to."""
    assert run(*words[1:]) == 0, shlex.join(words)
    if "--out" in words:
        out = Path(words[words.index("--out") + 1])
        assert out.exists() != ("--dry-run" in words), shlex.join(words)
