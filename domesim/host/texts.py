"""Text files as editors save them."""

from __future__ import annotations

import codecs


def text_in(content: bytes) -> str:
    """The text of a file: UTF-8, or what a byte order mark says, as Windows's editors write it.

    Raises
    ------
    UnicodeDecodeError
        If it is none of these.
    """
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8-sig")
