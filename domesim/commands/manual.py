"""The page that lists every command and its options, as they tell it themselves.

The site's builder takes it (docs/conf.py); ``python -m domesim.commands.manual`` prints it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer

from domesim.commands import build

_HEAD = """\
# Commands

Every command and its options, by `domesim COMMAND --help`. Text in capitals stands for yours. All
exit with 0 when all went well and with 2 for bad input, which is told in one line.

"""


def page() -> str:
    """The whole page, in Markdown."""
    command = typer.main.get_command(build())
    return _HEAD + "\n".join(_sections(command, "domesim"))


def _sections(group: Any, path: str) -> Iterator[str]:
    """What the commands of a group, and of groups within it, say of themselves."""
    for name, command in sorted(group.commands.items()):
        if hasattr(command, "commands"):
            yield from _sections(command, f"{path} {name}")
        else:
            yield _section(command, f"{path} {name}")


def _section(command: Any, path: str) -> str:
    """A command: what it does, how it is called, and a row for each argument and option."""
    context = typer.Context(command, info_name=path)
    records = (each.get_help_record(context) for each in command.get_params(context))
    rows = [f"| `{names}` | {_plain(help_text)} |" for names, help_text in filter(None, records)]
    usage = command.get_usage(context).removeprefix("Usage: ")
    lines = [f"## {path}", "", command.help or "", "", "```", " ".join(usage.split()), "```", ""]
    return "\n".join([*lines, "| | |", "| --- | --- |", *rows, ""])


def _plain(text: str) -> str:
    """Text that Markdown leaves as it is."""
    return re.sub(r"([|<>*_\[\]#])", r"\\\1", " ".join(text.split()))


if __name__ == "__main__":
    print(page(), end="")
