"""Left and right that are no pair: each mistake in one line, with the way out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from domesim.errors import HopelessError, InputError, PairError
from domesim.frames.colour import transfer_in_words
from domesim.frames.exr_parts import channels_by_view, stated_views
from domesim.frames.eyes import Eyes
from domesim.frames.frame import Frame, Pixels
from domesim.frames.layers import listed
from domesim.frames.timing import differing
from domesim.frames.video import EYES, eye_of, file_of


def refuse_packing(paths: Sequence[Path], packing: str | None, got: str) -> None:
    """Refuses a master whose packing is another than the one asked for."""
    if packing not in (None, got):
        raise InputError(
            f"{_named(paths)}: wanted a master packed as {packing}, got {got}. "
            "Leave the packing out, or name other files."
        )


def refuse_stated_packing(path: Path, packing: str | None, eyes: Eyes | None) -> None:
    """Refuse a file that says of itself that it is packed in another way than was asked."""
    if eyes is not None and packing not in (None, eyes.packing, f"{eyes.packing}-half"):
        raise InputError(
            f"{path}: wanted a master packed as {packing}, got one that says it is {eyes}. Name "
            f"that packing, or correct the file."
        )


def refuse_one_file(left: Path, right: Path) -> None:
    """Refuse one file given twice, by whatever name or link."""
    try:
        same = file_of(left).samefile(file_of(right))
    except OSError:  # reading it will tell
        return
    if same and {eye_of(left), eye_of(right)} != set(EYES):
        raise InputError(
            f"{left} and {right}: wanted two files for left and right, got the same file twice. "
            "Name the other one, or add --as-given if the shot is meant to be flat."
        )


def refuse_other_view(frame: Frame, side: str) -> None:
    """Refuse a file for `side`, "left" or "right", that says of itself that it is not that."""
    if frame.header.eyes is not None:
        raise InputError(
            f"{frame.path}: wanted the {side} view, got a file that says it holds both "
            f"({frame.header.eyes.said_by}). Give this file alone, without the other."
        )
    attributes = frame.header.attributes
    views = stated_views(attributes)
    if len(views) > 1 and all(channels_by_view(frame.header.channels, views)[:2]):
        raise InputError(
            f"{frame.path}: wanted the {side} view, got an EXR of views {listed(views)}. "
            "Give this file alone, without the other."
        )
    stated = next((str(value) for name, _, value in attributes if name == "view"), side)
    if stated.casefold() != side and stated.casefold() in ("left", "right"):
        raise InputError(
            f"{frame.path}: wanted the {side} view, got a file that says it is {stated}. "
            "Exchange left and right, or correct its attribute 'view'."
        )


def refuse_mistaken_pair(frames: Sequence[Frame], *, allow_identical: bool) -> None:
    """Refuse left and right of several sizes or encodings, or that are one image."""
    left, right = frames
    where = _named(dict.fromkeys((left.path, right.path)))
    if left.pixels.shape != right.pixels.shape:
        sizes = [f"{frame.pixels.shape[1]} x {frame.pixels.shape[0]}" for frame in frames]
        raise PairError(
            f"{where}: wanted left and right of one size, got {' and '.join(sizes)} px. "
            "Render both alike."
        )
    if not left.colour.means_the_same_as(right.colour):
        encodings = [
            f"{transfer_in_words(colour.transfer)} {colour.primaries} ({colour.source})"
            for colour in (left.colour, right.colour)
        ]
        raise PairError(
            f"{where}: wanted one encoding of left and right, got {' and '.join(encodings)}. "
            "Convert one of them where it was made, or say what both are (--encoding)."
        )
    if left.header.legal != right.header.legal:
        ranges = " and ".join("legal" if one.header.legal else "full" for one in frames)
        raise HopelessError(
            f"{where}: wanted one range of left and right, got {ranges}. Render both alike, or "
            "correct the headers."
        )
    if apart := differing(left, right):
        raise HopelessError(
            f"{where}: wanted left and right of one moment, got {apart}. Name the frames that "
            "belong together, or correct the headers."
        )
    identical = np.array_equal(left.pixels, right.pixels)
    if identical and not allow_identical and not _is_plain(left.pixels):
        raise PairError(
            f"{where}: wanted left and right that differ, got the same image twice. Use the other "
            "view's file, or one image alone (mono), or add --as-given if the shot is meant to "
            "be flat."
        )


def _is_plain(pixels: Pixels) -> bool:
    """Whether a picture has one colour only, such as the black before a show."""
    return bool(np.all(pixels == pixels[0, 0]))


def _named(paths: Iterable[Path]) -> str:
    return " and ".join(str(path) for path in paths)
