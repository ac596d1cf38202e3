"""The ``domesim`` command: finds its subcommands, and ends with one line where one is mistaken.

Subcommands are found through the entry-point group ``domesim.commands``, so that the packages above
add theirs without being imported here. Only the one that runs is imported, for that takes a second;
``--help`` reads what it says of them from their source. Bad input is one line on standard error and
exit code 2.
"""

from __future__ import annotations

import ast
import gc
import inspect
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

import domesim
from domesim.errors import InputError, reason
from domesim.host.console import complain, output_is_lost, printable
from domesim.host.endings import alike, exit_code
from domesim.host.endings import name as ending
from domesim.host.files import KEPT_OPEN

_UsageError: Any = typer.BadParameter.__base__  # typer has it from click, or as its own

BAD_INPUT = 2
INTERRUPTED = 130
_ITS_OWN = ("--help", "--version", "--install-completion", "--show-completion")
"""Options of the command itself."""


def build(arguments: Sequence[str] | None = None) -> typer.Typer:
    """The command with all subcommands that the installed packages offer.

    If its `arguments` name one, the others are only named.
    """
    app = typer.Typer(
        name="domesim",
        help="Simulate and compensate light pollution in dome theatres and 3D cinema.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    entries = sorted(entry_points(group="domesim.commands"), key=lambda entry: entry.name)
    first = arguments[0] if arguments else "--help"
    named = any(entry.name == first for entry in entries)
    for entry in entries:
        if arguments is not None and (named or first in _ITS_OWN) and entry.name != first:
            help_text = None if named else _help_of(entry)
            app.command(entry.name, help=help_text, short_help=_first(help_text))(lambda: None)
            continue
        loaded = entry.load()
        if isinstance(loaded, typer.Typer):  # a command with subcommands of its own
            for each in loaded.registered_commands:
                each.short_help = _first(inspect.getdoc(each.callback))
            app.add_typer(loaded, name=entry.name, short_help=_first(_help_of(entry)))
        else:
            app.command(entry.name, short_help=_first(loaded.__doc__))(loaded)
    app.callback(help=app.info.help)(_common)
    return app


def _tell_version(asked: bool) -> None:
    if asked:
        print("domesim", domesim.__version__)
        raise typer.Exit


_Version = Annotated[
    bool,
    typer.Option(
        "--version", callback=_tell_version, is_eager=True, help="Print the version and exit."
    ),
]


def _common(version: _Version = False) -> None:
    """Take the options of the command itself; with one subcommand alone typer drops its name."""


def _first(text: str | None) -> str | None:
    """The first paragraph of a help text, which typer would cut off in a list of commands."""
    return None if text is None else " ".join(text.split("\n\n")[0].split())


def _help_of(entry: EntryPoint) -> str | None:
    """What a subcommand's docstring says, or the ``help`` of an app; its module is not run."""
    place = find_spec(entry.module)
    if place is None or place.origin is None:
        return None
    for node in ast.parse(Path(place.origin).read_bytes()).body:
        if isinstance(node, ast.FunctionDef) and node.name == entry.attr:
            return ast.get_docstring(node)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == entry.attr:
            call = node.value
            keywords = {each.arg: each.value for each in getattr(call, "keywords", ())}
            return ast.literal_eval(keywords["help"]) if "help" in keywords else None
    return None


def run() -> None:
    """Run the command; the process's exit code says whether all went well."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A name that the terminal cannot show is no reason to stop.
        sys.stdout.reconfigure(errors="backslashreplace")
    with guarded(), KEPT_OPEN:
        command = build(_typed())
        gc.freeze()  # what modules made stays: nothing to look through, but at the end
        gc.enable()
        try:
            sys.exit(command(standalone_mode=False, prog_name="domesim"))
        except _UsageError as error:
            printed = io.StringIO()
            error.show(printed)
            print(*map(printable, printed.getvalue().splitlines()), sep="\n", file=sys.stderr)
            sys.exit(error.exit_code)
        finally:
            gc.unfreeze()


def _typed() -> list[str]:
    """The command's arguments, or those that a shell wants completed: only a whole first one."""
    if "_DOMESIM_COMPLETE" not in os.environ:
        return sys.argv[1:]
    words = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    typed = words.split()[1:]
    return typed if typed and typed[0] in entry_points(group="domesim.commands").names else []


@contextmanager
def guarded() -> Iterator[None]:
    """Mistakes, and Ctrl-C and the like, end the process with one line and an exit code."""
    try:
        with alike():
            yield
    except InputError as error:
        complain(error)
        sys.exit(BAD_INPUT)
    except MemoryError:
        complain("not enough memory for frames of this size")
        sys.exit(BAD_INPUT)
    except OSError as error:  # that no part of the program expects
        complain(f"{error.filename or 'the system'}: got '{reason(error)}'. Mend it, and try again")
        sys.exit(BAD_INPUT)
    except (KeyboardInterrupt, SystemExit) as end:
        # typer turns Ctrl-C into an exit, and says nothing.
        if isinstance(end, SystemExit) and end.code != INTERRUPTED:
            if not end.code and output_is_lost():
                sys.exit(BAD_INPUT)
            raise
        complain(f"{ending()}; what was written is complete")
        sys.exit(exit_code())
