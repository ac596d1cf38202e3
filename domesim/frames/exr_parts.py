"""OpenEXR files of several parts, or of left and right, and back.

Left and right may lie in one file in two ways (*Storing Multi-View Images in OpenEXR Files*,
openexr.com), and a file comes back the way it was:

- multi-view: channels of one part. The attribute ``multiView`` lists the views; a channel is called
  ``layer.view.channel``, and belongs to the first view listed if it has no layer and no view;
- multi-part: parts with an attribute ``view`` each. One part for each view has the picture; what
  else there is (depth, disparity, ...) is carried along as it is, tiles becoming lines.

Of parts without views, one has the picture, and the others are carried along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.formats.base import Window
from domesim.frames.formats.exr import (
    EXR,
    MAGIC,
    attributes_in,
    said,
    state_compression,
    with_attributes,
)
from domesim.frames.frame import Frame
from domesim.frames.integrity import damaged
from domesim.frames.messages import one_line
from domesim.frames.reading import (
    Layout,
    View,
    attributes_of,
    channels_of,
    find_grey,
    frame_of,
    kinds_of,
    layers_of,
    layout_of,
    listed,
    opened,
    read_channels,
    read_plane,
    read_samples,
    refuse_implausible_size,
)
from domesim.frames.writing import (
    as_stored,
    bare_specification,
    encode,
    interleaved,
    planes_of,
    samples_of,
    specification,
    target_of,
)


@dataclass(frozen=True)
class MultiView:
    """How views lie in the channels of one part."""

    views: tuple[str, ...]  # in the file's order: the first is the default
    names: tuple[tuple[str, ...], ...]  # of the left and the right frame's channels, in the file


@dataclass(frozen=True, eq=False)
class Part:
    """A part that is carried along."""

    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    data: Window
    display: Window
    attributes: tuple[tuple[str, str, Any], ...]
    carried: bytes
    planes: tuple[NDArray[Any], ...]  # (row, col) of the data window, as stored


@dataclass(frozen=True, eq=False)
class MultiPart:
    """How frames lie in parts."""

    parts: tuple[int | Part, ...]  # 0: the only frame, or the left one; 1: the right one


SeveralInFile: TypeAlias = MultiView | MultiPart


def read_several(
    path: Path, *, repair: bool, colour: ColourTag | None = None, layer: str | None = None
) -> tuple[tuple[Frame, ...], SeveralInFile] | None:
    """The only frame, or left and right, and how they lie in the file; None if it is of one part.

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
        assert isinstance(form, EXR)
        count = reader.spec().get_int_attribute("oiio:subimages", 1)
        layout = partial(layout_of, grey=True, colour=colour)
        if count > 1:
            specs = [reader.spec(index) for index in range(count)]
            views = tuple(spec.get_string_attribute("view") for spec in specs)
            pictures = _pictures(path, specs, views, layer)
            return _read_parts(path, reader, form, views, pictures, layout, layer, repair=repair)
        views = stated_views(attributes_of(path, reader.spec(), form))
        if len(views) < 2:
            return None
        layout = partial(layout, layer=layer)
        return _read_views(path, reader, form, views, layout, repair=repair)


def encoded_several(
    frames: Sequence[Frame], file: SeveralInFile, path: Path, bits: int | None
) -> bytes:
    """A file's bytes in which `frames` lie as they did in `file`."""
    if isinstance(file, MultiView):
        return _encoded_views(frames, file, path, bits)
    return _encoded_parts(frames, file, path, bits)


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
    left, right = _left_and_right(path, views)
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


def _left_and_right(path: Path, views: Sequence[str]) -> tuple[int, int]:
    folded = [view.casefold() for view in views]
    if sorted(folded) != ["left", "right"]:
        raise InputError(
            f"{path}: wanted views left and right, got {listed(views)}. "
            "Write these two alone, under these names."
        )
    return folded.index("left"), folded.index("right")


def _encoded_views(frames: Sequence[Frame], file: MultiView, path: Path, bits: int | None) -> bytes:
    targets = [target_of(frame, path, bits) for frame in frames]
    for target, names in zip(targets, file.names, strict=True):
        if len(target.channels) != len(names):
            raise ValueError(f"wanted frames with channels {names}, got {target.channels}")
    stored = [as_stored(*each) for each in zip(frames, targets, strict=True)]
    kinds = targets[0].kinds + targets[1].kinds
    channels = file.names[0] + file.names[1]
    # Both frames have the part's attributes.
    whole = replace(targets[0], channels=channels, kinds=kinds)
    spec = specification(frames[0], whole)
    spec.erase_attribute("view")
    spec.attribute("multiView", oiio.TypeDesc(f"string[{len(file.views)}]"), file.views)
    planes = [*planes_of(stored[0], targets[0]), *planes_of(stored[1], targets[1])]
    content = encode(path, "openexr", [(spec, interleaved(planes, kinds))])
    return with_attributes(content, [said(whole)])


# Multi-part.


def _read_parts(
    path: Path,
    reader: Any,
    form: EXR,
    views: Sequence[str],
    pictures: Sequence[int],
    layout: Callable[..., Layout],
    layer: str | None,
    *,
    repair: bool,
) -> tuple[tuple[Frame, ...], MultiPart]:
    """Reads the parts that are `pictures` as frames, by their `layout`."""
    frames: dict[int, Frame] = {}
    parts: list[int | Part] = []
    for index, view in enumerate(views):
        if not reader.seek_subimage(index, 0):
            raise damaged(path, "EXR", f"one without part {index + 1} of {len(views)}")
        if index not in pictures:
            parts.append(_read_part(path, reader, form))
            continue
        names = tuple(reader.spec().channelnames)
        own = View(view, dict(enumerate(names))) if view else None
        of_part = layer if layer in layers_of(names) else None
        found = layout(path, reader, form, view=own, layer=of_part)
        if not view:
            note = f"part {one_line(reader.spec().get_string_attribute('oiio:subimagename'))}"
            header = replace(found.header, notes=(*found.header.notes, f"{note} of {len(views)}"))
            found = replace(found, header=header)
        place = pictures.index(index)
        frames[place] = frame_of(path, found, read_channels(path, reader, found), repair=repair)
        parts.append(place)
    return tuple(frames[place] for place in sorted(frames)), MultiPart(tuple(parts))


def _pictures(
    path: Path, specs: Sequence[Any], views: Sequence[str], layer: str | None
) -> tuple[int, ...]:
    """Which part has the picture; or left's, and right's."""
    if any(views):
        _left_and_right(path, tuple(dict.fromkeys(view for view in views if view)))
        return tuple(_picture(path, specs, views, side, layer) for side in ("left", "right"))
    names = [spec.get_string_attribute("oiio:subimagename") for spec in specs]
    layers = [layers_of(spec.channelnames) for spec in specs]
    if layer is None:
        whole = [k for k, spec in enumerate(specs) if _has_picture(spec.channelnames)]
        found = whole or [k for k, each in enumerate(layers) if each]
    else:
        found = [k for k, each in enumerate(names) if layer in (each, str(k))]
        found = found or [k for k, each in enumerate(layers) if layer in each]
    if len(found) == 1:
        return (found[0],)
    known = [name or str(k) for k, name in enumerate(names)]
    wanted = "one picture" if layer is None else f"one part or layer {one_line(layer)!r}"
    raise InputError(
        f"{path}: wanted {wanted}, got a file of several parts ({listed(known)}). Choose one of "
        f"them (--layer {one_line(known[found[0] if found else 0])})."
    )


def _picture(
    path: Path, specs: Sequence[Any], views: Sequence[str], side: str, layer: str | None
) -> int:
    """Which part has the picture, or the layer, of that side."""
    of_side = [index for index, view in enumerate(views) if view.casefold() == side]
    pictures = [index for index in of_side if _has_picture(specs[index].channelnames)]
    wanted = "channels R, G, B, or Y alone"
    if layer is not None:
        pictures = [index for index in of_side if layer in layers_of(specs[index].channelnames)]
        wanted = f"layer {one_line(layer)!r}"
    if len(pictures) != 1:
        got = "; ".join(
            f"{one_line(specs[index].get_string_attribute('oiio:subimagename'))} with "
            f"{listed(specs[index].channelnames)}"
            for index in of_side[:4]
        )
        raise InputError(
            f"{path}: wanted one part of view {side} with {wanted}, "
            f"got {got}. Keep one such part for each view."
        )
    return pictures[0]


def _has_picture(channels: Sequence[str]) -> bool:
    names = {name.upper() for name in channels}
    return {"R", "G", "B"} <= names or find_grey(channels) is not None


def _read_part(path: Path, reader: Any, form: EXR) -> Part:
    spec = reader.spec()
    carried = form.carried[reader.current_subimage()]
    if spec.deep:
        raise InputError(
            f"{path}: wanted flat parts beside the views, got one of deep samples. "
            "Remove or flatten it first."
        )
    data: Window = (spec.x, spec.y, spec.width, spec.height)
    display: Window = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    refuse_implausible_size(path, spec, form, data, display)
    kinds, channels = kinds_of(spec), channels_of(path, spec)
    if len(set(kinds)) == 1:
        samples = read_samples(path, reader, range(len(channels)), kinds[0])
        planes = tuple(np.ascontiguousarray(samples[..., k]) for k in range(len(channels)))
    else:
        each = enumerate(zip(channels, kinds, strict=True))
        planes = tuple(read_plane(path, reader, k, name, kind) for k, (name, kind) in each)
    return Part(channels, kinds, data, display, attributes_of(path, spec, form), carried, planes)


def _encoded_parts(frames: Sequence[Frame], file: MultiPart, path: Path, bits: int | None) -> bytes:
    targets = [target_of(frame, path, bits) for frame in frames]
    stored = [as_stored(*each) for each in zip(frames, targets, strict=True)]
    specs = [specification(*each) for each in zip(frames, targets, strict=True)]
    carried = [said(target) for target in targets]
    # OpenEXR wants the same of all parts.
    chromaticities = specs[0].getattribute("chromaticities")
    parts, attributes = [], []
    for part in file.parts:
        if isinstance(part, Part):
            spec = _specification_of(part)
            own = attributes_in(part.carried)
            if chromaticities is not None:
                spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), chromaticities)
                own.pop(b"chromaticities", None)
            parts.append((spec, interleaved(part.planes, part.kinds)))
            attributes.append(own)
        else:
            parts.append((specs[part], samples_of(stored[part], targets[part])))
            attributes.append(carried[part])
    return with_attributes(encode(path, "openexr", parts), attributes)


def _specification_of(part: Part) -> Any:
    kept = [each for each in part.attributes if each[0] in EXR.kept]
    spec = bare_specification(part.channels, part.kinds, part.data[2:], kept)
    spec.x, spec.y = part.data[:2]
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = part.display
    compression = next((value for name, _, value in part.attributes if name == "compression"), "")
    state_compression(spec, compression)
    return spec
