"""Text files as editors save them, and TOML of a size and depth that people write."""

from __future__ import annotations

import codecs
import re
import tomllib
from typing import Any

LARGEST_TOML = 1_000_000
"""Characters of a TOML text: a thousand times what scenes take."""

DEEPEST_TOML = 8
"""Parts of a dotted key. The time that `tomllib` takes grows with their square."""

_PART = r"""(?:"[^"\n]*+"|'[^'\n]*+'|[A-Za-z0-9_-]++)[ \t]*+"""
_DEEPER = re.compile(rf"(?<![\w-]){_PART}(?:\.[ \t]*+{_PART}){{{DEEPEST_TOML}}}")


def text_in(content: bytes) -> str:
    """The text of a file: UTF-8, or what a byte order mark says, as Windows's editors write it.

    Raises
    ------
    UnicodeDecodeError
        If it is none of these.
    """
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8-sig")


def toml_in(text: str) -> dict[str, Any]:
    """What a TOML text holds.

    Raises
    ------
    tomllib.TOMLDecodeError
        If it is none, longer than `LARGEST_TOML`, or its keys are deeper than `DEEPEST_TOML` and
        its tables than Python's own calls.
    """
    if len(text) > LARGEST_TOML:
        raise tomllib.TOMLDecodeError(
            f"wanted at most {LARGEST_TOML} characters, got {len(text)}. Is it another file?"
        )
    if deeper := _DEEPER.search(text):
        line = text.count("\n", 0, deeper.start()) + 1
        raise tomllib.TOMLDecodeError(
            f"wanted keys of at most {DEEPEST_TOML} parts, got more at line {line}"
        )
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError("arrays or tables are too deep (recursion)") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:
        raise tomllib.TOMLDecodeError("a whole number has more than 4300 digits") from None
