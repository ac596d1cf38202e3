"""Texts of libraries and files, made fit for a message of one line."""

from __future__ import annotations

from typing import Any


def problem_of(source: Any) -> str:
    """The pending error of a reader, a writer or all of OpenImageIO; "" if there is none."""
    try:
        return one_line(source.geterror())
    except UnicodeDecodeError as error:  # it quotes what it found in a damaged file
        return one_line(error.object.decode("utf-8", "replace"))


def joined(text: str) -> str:
    """Joins all lines of `text`, of a library, into one."""
    return " ".join(text.split())


def one_line(text: str) -> str:
    """What `text`, of a library or a file, can add to a message: one line, printable, not long."""
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    printable = "".join(letter if letter.isprintable() else "?" for letter in first)
    return printable[:160]
