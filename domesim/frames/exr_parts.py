"""OpenEXR files of left and right, and back.

Left and right may lie in one file in two ways (*Storing Multi-View Images in OpenEXR Files*,
openexr.com), and a file comes back the way it was:

- multi-view: channels of one part. The attribute ``multiView`` lists the views; a channel is called
  ``layer.view.channel``, and belongs to the first view listed if it has no layer and no view;
- multi-part: parts with an attribute ``view`` each. One part for each view has the picture; what
  else there is (depth, disparity, ...) is carried along as it is, tiles becoming lines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.colour import Asked
from domesim.frames.formats.exr import EXR, MAGIC, Part, written
from domesim.frames.frame import Frame
from domesim.frames.layers import left_and_right, picture_of_side, views_of
from domesim.frames.reading import (
    Layout,
    View,
    attributes_of,
    channels_of,
    frame_of,
    layout_of,
    opened,
    parts_of,
    read_channels,
    read_parts,
)
from domesim.frames.writing import encoded_parts, part_of, target_of


@dataclass(frozen=True)
class MultiView:
    """How views lie in the channels of one part."""

    views: tuple[str, ...]  # in the file's order: the first is the default
    names: tuple[tuple[str, ...], ...]  # of the left and the right frame's channels, in the file


@dataclass(frozen=True, eq=False)
class MultiPart:
    """How frames lie in parts."""

    parts: tuple[int | Part, ...]  # 0: the left frame; 1: the right one


SeveralInFile: TypeAlias = MultiView | MultiPart


def read_several(
    path: Path, *, repair: bool, colour: Asked | None = None, layer: str | None = None
) -> tuple[tuple[Frame, ...], SeveralInFile] | None:
    """Left and right, and how they lie in the file; None if they are not in one EXR.

    Parameters as for `read_master`.

    Raises
    ------
    InputError
        As for `read_master`; or if the views are not left and right, or the pictures are not to
        be distinguished from other parts.
    """
    if not _is_exr(path):
        return None
    with opened(path) as (reader, form):
        if not isinstance(form, EXR):  # by its suffix
            return None
        specs = parts_of(reader)
        if len(specs) > 1 and any(views_of(specs)):
            left_and_right(path, tuple(dict.fromkeys(view for view in views_of(specs) if view)))
            sides = [picture_of_side(path, specs, side, layer) for side in ("left", "right")]
            layout = partial(layout_of, grey=True, colour=colour)
            found, parts = read_parts(path, reader, form, sides, layer, layout)
            frames = tuple(frame_of(path, *each, repair=repair) for each in found)
            return frames, MultiPart(parts)
        views = stated_views(attributes_of(path, reader.spec(), form))
        if len(specs) > 1 or len(views) < 2:
            return None
        layout = partial(layout_of, grey=True, colour=colour, layer=layer)
        return _read_views(path, reader, form, views, layout, repair=repair)


def encoded_several(
    frames: Sequence[Frame], file: SeveralInFile, path: Path, bits: int | None
) -> bytes:
    """A file's bytes in which `frames` lie as they did in `file`."""
    targets = [target_of(frame, path, bits) for frame in frames]
    if isinstance(file, MultiPart):
        return encoded_parts(path, frames, targets, file.parts)
    for target, names in zip(targets, file.names, strict=True):
        if len(target.channels) != len(names):
            raise ValueError(f"wanted frames with channels {names}, got {target.channels}")
    named = [
        replace(target, channels=names) for target, names in zip(targets, file.names, strict=True)
    ]
    (header, left), (_, right) = (part_of(path, *each) for each in zip(frames, named, strict=True))
    # Both frames have the part's attributes.
    header.pop("view", None)
    return written(path, [(header | {"multiView": list(file.views)}, left | right)])


def stated_views(attributes: Sequence[tuple[str, str, Any]]) -> tuple[str, ...]:
    """What ``multiView`` lists; nothing if it is not there."""
    stated = next(
        (
            value
            for name, kind, value in attributes
            if name == "multiView" and kind.startswith("string")
        ),
        (),
    )
    return (stated,) if isinstance(stated, str) else tuple(stated)


def channels_by_view(channels: Sequence[str], views: Sequence[str]) -> tuple[dict[int, str], ...]:
    """Maps each view's own channels, by index, to their names without the view's name.

    What belongs to no view (``disparity.x``) goes with the default view, which comes first.
    """
    of_view: tuple[dict[int, str], ...] = tuple({} for _ in views)
    folded = [view.casefold() for view in views]
    for place, channel in enumerate(channels):
        *layer, last = channel.split(".")
        view = layer.pop().casefold() if layer else folded[0]
        if view in folded:
            of_view[folded.index(view)][place] = ".".join([*layer, last])
        else:
            of_view[0][place] = channel
    return of_view


def _is_exr(path: Path) -> bool:
    """Whether the first bytes are an EXR's, as for OpenImageIO; errors are for others to tell."""
    try:
        with path.open("rb") as file:
            return file.read(4) == MAGIC
    except OSError:
        return False


# Multi-view.


def _read_views(
    path: Path,
    reader: Any,
    form: EXR,
    views: tuple[str, ...],
    layout: Callable[..., Layout],
    *,
    repair: bool,
) -> tuple[tuple[Frame, ...], MultiView]:
    left, right = left_and_right(path, views)
    channels = channels_of(path, reader.spec())
    of_view = channels_by_view(channels, views)
    missing = [view for view, indices in zip(views, of_view, strict=True) if not indices]
    if missing:
        raise InputError(
            f"{path}: wanted channels of the views that multiView lists, got none of {missing[0]}. "
            f"Write both views, or remove that attribute ({ADVICE['one view'].given()})."
        )

    def read(index: int) -> Frame:
        view = View(views[index], of_view[index])
        found = layout(path, reader, form, view=view)
        frame = frame_of(path, found, read_channels(path, reader, found), repair=repair)
        # Alone, it is a file of one view, which says so by this attribute.
        kept = [each for each in found.header.attributes if each[0] not in ("multiView", "view")]
        attributes = (*kept, ("view", "string", views[index]))
        return replace(frame, header=replace(frame.header, attributes=attributes))

    names = tuple(tuple(channels[k] for k in of_view[index]) for index in (left, right))
    return (read(left), read(right)), MultiView(views, names)
