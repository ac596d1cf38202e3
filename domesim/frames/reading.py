"""Image file -> frame."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError, reason
from domesim.frames.alpha import shown_over_black
from domesim.frames.colour import Asked, ColourTag, meaning_of
from domesim.frames.depths import FLOATING, INTEGER, code_span, dtype_of
from domesim.frames.formats import FORMATS, LABELS
from domesim.frames.formats.base import Format, Window, camera_raw
from domesim.frames.formats.exr import EXR, Part, as_carried, halves_of
from domesim.frames.frame import Frame, Header, Pixels
from domesim.frames.halves import are_sound
from domesim.frames.integrity import (
    EQUIRECTANGULAR,
    SQUARE,
    DamagedError,
    damaged,
    enough_memory,
    projected,
    refuse_sides,
)
from domesim.frames.layers import (
    find_grey,
    find_layer,
    find_rgb,
    layer_of,
    layers_of,
    picture_part,
    refuse_layer,
)
from domesim.frames.messages import one_line, problem_of
from domesim.frames.orientation import UPRIGHT, known, turned
from domesim.frames.video import (
    START,
    container_of,
    other_container,
    read_video_frame,
    video_of,
    video_size,
)
from domesim.host.system import in_memory
from domesim.light.strips import all_within, converted, in_strips


def read_frame(path: str | Path, *, repair: bool = False, colour: Asked | None = None) -> Frame:
    """Read an image file of one of `domesim.frames.formats`.

    Parameters
    ----------
    path
        The file. Its content decides what it is, not its suffix. Or a frame of a video: see
        `domesim.frames.video`.
    repair
        Replace NaN and negative samples by 0 and +Inf by the channel's largest finite value,
        instead of refusing them.
    colour
        What the code values mean, whatever the file says; or the response of the projector that
        shows them; None to go by the file.

    Raises
    ------
    InputError
        If the file is missing, damaged or truncated, not an image, of several images, not RGB,
        encoded in a way that is not supported (unless `colour` is given), larger than its display
        window (overscan), of pixels that are not square, or holds NaN, Inf or negative samples and
        `repair` is off.
    """
    return read_image(Path(path), repair=repair, colour=colour)


def read_image(
    path: Path,
    *,
    repair: bool,
    grey: bool = False,
    signed: bool = False,
    halves: bool = False,
    colour: Asked | None = None,
    layer: str | None = None,
    projection: str = "",
) -> Frame:
    """`read_frame`, of a `layer` of an EXR; or a panorama of that `projection`.

    With `grey`, an EXR whose only picture is a channel Y is R = G = B = Y.
    With `signed`, negative samples are no damage: a camera's black level is subtracted from noise.
    With `halves`, what is stored as half stays half, in half the memory.
    """
    with enough_memory(path):
        if video_of(path) is not None:
            refuse_layer(path, layer, "a video")
            return read_video_frame(path, colour=colour, projection=projection)
        with opened(path, projection=projection) as (reader, form):
            specs = parts_of(reader)
            layout = partial(layout_of, grey=grey or len(specs) > 1, colour=colour)
            pictures = [picture_part(path, specs, layer)]
            ((found, samples),), parts = read_parts(path, reader, form, pictures, layer, layout)
            refuse_several_images(path, reader)
        found = replace(found, header=replace(found.header, parts=parts))
        return frame_of(path, found, samples, repair=repair, signed=signed, halves=halves)


def size_of(path: Path) -> tuple[int, int]:
    """Rows and columns of a file's picture, as its header says.

    Raises
    ------
    InputError
        If it is not of `domesim.frames.formats`.
    """
    if video_of(path) is not None:
        return video_size(path)
    with opened(path, header=True) as (reader, _):
        spec = reader.spec()
        sides = int(spec.full_height), int(spec.full_width)
        return sides if known(spec.getattribute("Orientation")) < 5 else sides[::-1]


def unsaid(frame: Frame) -> str:
    """What a frame's file says else than what its code values mean, for a person; or "".

    Most formats cannot say most encodings.
    """
    colour, stated = frame.colour, frame.header.colour
    if stated is not None and colour.means_the_same_as(stated):
        return ""
    taken = "nothing" if stated is None else f"{stated.named}"
    return f"{colour.named}, which the file cannot say: it reads as {taken}"


def use_threads(count: int) -> None:
    """Let reading and writing of all images use so many threads; by default all cores."""
    for name in ("threads", "exr_threads"):
        oiio.attribute(name, count)


@contextmanager
def opened(
    path: Path, *, header: bool = False, projection: str = ""
) -> Iterator[tuple[Any, Format]]:
    """OpenImageIO's reader of the file, or of what is stored anew of it; and its format.

    If only its header is asked for, the samples may be damaged.

    Raises
    ------
    InputError
        If there is none, or not all of it, or it is of no known format.
    """
    form = _examined(path, projection, header=header)
    reader = _reader_of(path, form)
    if form is not None and form.stored_anew:
        form = replace(form, stored_anew=(), stored=sum(map(len, form.stored_anew)))
    try:
        name = reader.format_name()
        if name not in FORMATS:
            raise InputError(f"{path}: wanted {LABELS}, got {name}. Convert it to EXR or PNG.")
        said = _ENVIRONMENTS.get(reader.spec().get_string_attribute("textureformat"), "")
        if said not in ("", projection):
            raise projected(path, said)
        # By its suffix OpenImageIO may take it for another than its first bytes say.
        yield reader, form if form is not None and form.name == name else FORMATS[name]
    finally:
        reader.close()


def _examined(path: Path, projection: str, *, header: bool) -> Format | None:
    """The format that a file's first bytes tell, with what it says; None if they tell none."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: wanted an image file, got a folder. Name a file in it.")
        if not path.exists():
            raise InputError(f"{path}: wanted an image file, there is none. Check the path.")
        if not path.is_file():
            raise InputError(f"{path}: wanted an image file, got a device or pipe. Name a file.")
        with path.open("rb") as file:
            start = file.read(16)
            if not start:
                raise InputError(
                    f"{path}: wanted an image, got an empty file. Copy or render it again."
                )
            file.seek(0)
            _refuse_projection(path, file, projection)
            form = next((each for each in FORMATS.values() if start.startswith(each.starts)), None)
            return None if form is None else _described_by_file(path, form, file, header=header)
    except OSError as error:
        raise InputError(
            f"{path}: wanted to read it, got '{reason(error)}'. Check its path and permissions."
        ) from error


_ENVIRONMENTS = {"LatLong Environment": EQUIRECTANGULAR, "CubeFace Environment": "a cube"}
"""OpenImageIO's names of EXR's attribute envmap."""

_ENDS = 1 << 18  # bytes in which XMP is looked for
_PACKED = re.compile(
    rb"XML:com\.adobe\.xmp\x00\x01\x00[^\x00]*\x00[^\x00]*\x00|(Raw profile type xmp\x00\x00)"
)
_PROJECTION = re.compile(rb"GPano:ProjectionType\s*(?:=\s*[\"']|>)\s*(\w+)")


def _refuse_projection(path: Path, file: BinaryIO, wanted: str) -> None:
    """Refuse a panorama that says so (Google's GPano, in XMP), unless it is `wanted`."""
    ends = file.read(_ENDS)
    file.seek(max(file.tell(), file.seek(0, os.SEEK_END) - _ENDS))
    ends += file.read()
    said = _PROJECTION.search(ends) or _PROJECTION.search(_packed(ends))
    file.seek(0)
    name = "" if said is None else one_line(said[1].decode("latin-1")).lower()
    if name not in ("", "fisheye", wanted):
        raise projected(path, name)


def _described_by_file(path: Path, form: Format, file: BinaryIO, *, header: bool) -> Format:
    try:
        return form.introduced(path, file) if header else form.examined(path, file)
    except InputError:
        raise
    except DamagedError as error:
        raise damaged(path, form.label, str(error)) from error
    except ValueError as error:
        raise InputError(
            f"{path}: wanted a complete {form.label} of {form.wanted}, got {error}. "
            "Copy or render it again, or convert it."
        ) from error


def _reader_of(path: Path, form: Format | None) -> Any:
    if form is not None and form.stored_anew:
        with in_memory() as (memory, place):
            memory.writelines(form.stored_anew)
            memory.flush()
            # The reader has it open by itself.
            return _open_at(path, place, form)
    try:
        name = str(path).encode().decode()
    except UnicodeEncodeError:
        raise InputError(
            f"{path}: wanted a path in UTF-8, got other bytes. Rename the file or its folder."
        ) from None
    return _open_at(path, name, form)


def _open_at(path: Path, name: str, form: Format | None) -> Any:
    # Without UnassociatedAlpha, R, G, B of PNG and TIFF come multiplied by alpha.
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(name, config)
    # An error that is not fetched is printed when the process ends.
    problem = problem_of(oiio)
    if reader is None:
        if form is not None:
            form.explain(path, problem)
        _refuse_video(path)
        raise InputError(
            f"{path}: wanted an image, got something that does not open as one "
            f"({problem}). Copy or render it again, or convert it to EXR or PNG."
        )
    return reader


_RAW = (b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FUJIFILMCCD-RAW", b"FOVb", b"\0MRM")
"""First bytes of Olympus', Panasonic's, Fujifilm's, Sigma's and Minolta's raw files."""


def _refuse_video(path: Path) -> None:
    """Name the container of a video whose suffix is of none that is read."""
    with path.open("rb") as file:
        start = file.read(START)
    if start.startswith(_RAW) or start[4:12] == b"ftypcrx ":
        raise camera_raw(path)
    container = container_of(start)
    if container is not None:
        raise other_container(path, container)


def _packed(content: bytes) -> bytes:
    """XMP that a PNG holds compressed, as ImageMagick also in hexadecimal digits."""
    if b"xmp\0" not in content:
        return b""
    found = _PACKED.search(content)
    if found is None:
        return b""
    try:
        text = zlib.decompressobj().decompress(content[found.end() :], _ENDS)
        return text if found[1] is None else bytes.fromhex("".join(text.decode().split()[2:]))
    except (zlib.error, ValueError):  # of damage, which its checksum tells
        return b""


# The header: where the samples are.


@dataclass(frozen=True)
class View:
    """One view of a file that holds several."""

    name: str  # as the file has it: "left"
    channels: Mapping[int, str]  # which of the part's -> what they are called without the view


@dataclass(frozen=True)
class Layout:
    """What a header says of where a frame's samples are."""

    format: Format
    header: Header  # without the samples of other channels
    places: tuple[int, ...]  # which of the part's channels `header.channels` are
    bits: int
    floating: bool
    data: Window
    display: Window
    colour: ColourTag
    view: str


def layout_of(
    path: Path,
    reader: Any,
    form: Format,
    *,
    view: View | None = None,
    grey: bool = False,
    colour: Asked | None = None,
    layer: str | None = None,
) -> Layout:
    """Where the samples of the reader's present part are, or of one `view` of it, or one `layer`.

    Their encoding is as for `read_frame`.
    """
    spec = reader.spec()
    if spec.deep:
        raise InputError(f"{path}: wanted a flat image, got deep samples. Flatten it first.")
    data, display = form.windows(path, spec)
    refuse_implausible_size(path, spec, form, data, display)
    channels, places, named = channels_of(path, spec), tuple(range(spec.nchannels)), ""
    if view is not None:
        channels, places, named = tuple(view.channels.values()), tuple(view.channels), view.name
    if form.channels != "any":
        refuse_layer(path, layer, form.label)
    rgb = find_grey(channels) if grey and layer is None and form.channels == "any" else None
    notes, found = list(form.notes), layer
    if layer is not None:
        rgb = layer_of(path, channels, layer)
    elif rgb is None and view is None and form.channels == "any":
        rgb, found = find_layer(channels)
    notes += [f"layer {found}"] if found else []
    if rgb is None:
        rgb = find_rgb(path, spec.get_string_attribute(f"{form.name}:ColorSpace"), channels, named)
    kinds = tuple(kinds_of(spec)[place] for place in places)
    bits, floating = _depth(path, spec, {kinds[channel] for channel in rgb})
    xyz = [channels[k].upper() for k in rgb] == [*"XYZ"]
    of_channels = ColourTag("linear", "XYZ", "file: channels X, Y, Z")
    meant, stated = meaning_of(colour, lambda: of_channels if xyz else form.colour(path, spec))
    orientation = form.turned or known(spec.getattribute("Orientation"))
    legal = not floating and form.is_legal(spec, bits)
    straight = form.unassociated
    if straight is None:
        straight = bool(spec.get_int_attribute("oiio:UnassociatedAlpha"))
    notes += [*_pixel_notes(path, spec, form), *(["legal range"] if legal else [])]
    if orientation != UPRIGHT:
        notes.append(f"turned upright: its Orientation is {orientation}")
    header = Header(
        format=form.label,
        file=form.of_part(reader.current_subimage()),
        attributes=attributes_of(path, spec, form),
        channels=channels,
        kinds=kinds,
        rgb=rgb,
        origin=display[:2],
        colour=stated,
        legal=legal,
        straight=straight,
        orientation=orientation,
        eyes=form.eyes,
        notes=tuple(notes),
    )
    return Layout(form, header, places, bits, floating, data, display, meant, named)


def _pixel_notes(path: Path, spec: Any, form: Format) -> tuple[str, ...]:
    """Notes on the pixels' shape; refuses pictures whose pixels are not square."""
    stated = form.aspect or spec.getattribute("PixelAspectRatio")
    if not isinstance(stated, float | int) or not 0 < stated < np.inf:
        return ()
    if abs(stated - 1) <= SQUARE:
        return ()
    if form.shaped:
        raise not_square(path, stated)
    return (f"pixels taken as square, though its densities say {stated:.4g} : 1",)


def not_square(path: Path, aspect: float) -> InputError:
    """The error for a picture of pixels that are `aspect` times as wide as high."""
    return InputError(
        f"{path}: wanted square pixels, got ones of {aspect:.4g} : 1 (pixel aspect ratio). Resize "
        "the picture to square ones first, or correct what the file says if they are square "
        f"({ADVICE['square pixels'].given()})."
    )


def kinds_of(spec: Any) -> tuple[str, ...]:
    """Each channel's type."""
    each = tuple(str(kind) for kind in spec.channelformats)
    return each or (str(spec.format),) * spec.nchannels


def attributes_of(path: Path, spec: Any, form: Format) -> tuple[tuple[str, str, Any], ...]:
    """Name, type and value of each attribute."""
    invented = form.invented()
    attributes = tuple(
        (attribute.name, str(attribute.type), attribute.value)
        for attribute in spec.extra_attribs
        if attribute.name not in invented
    )
    _refuse_unprintable(path, "attributes", [name for name, _, _ in attributes])
    return attributes


def channels_of(path: Path, spec: Any) -> tuple[str, ...]:
    """Each channel's name."""
    names = tuple(spec.channelnames)
    _refuse_unprintable(path, "channels", names)
    return names


def _refuse_unprintable(path: Path, what: str, names: Sequence[str]) -> None:
    # OpenImageIO reads any bytes as names, but does not write all of them.
    for name in names:
        if not name.isprintable():
            raise InputError(
                f"{path}: wanted {what} with printable names, got '{one_line(name)}'. "
                "It is probably damaged: copy or render it again."
            )


_UNLIMITED_COMPRESSION = ("piz", "dwaa", "dwab", "htj2k", "htj2k256", "htj2k32", "lj2k")


def refuse_implausible_size(
    path: Path, spec: Any, form: Format, data: Window, display: Window
) -> None:
    """Before memory is asked for."""
    for cols, rows in (data[2:], display[2:]):
        refuse_sides(path, cols, rows)
    if spec.depth > 1:
        raise InputError(f"{path}: wanted an image, got a volume of depth {spec.depth}. Slice it.")
    if spec.get_string_attribute("compression") in _UNLIMITED_COMPRESSION:
        return
    decoded, stored = spec.image_bytes(True), form.stored or path.stat().st_size
    if decoded > form.largest_ratio * stored:
        raise InputError(
            f"{path}: wanted a whole {form.label}, got {stored} bytes for {data[2]} x {data[3]} "
            f"px of {spec.nchannels} channels. It is probably damaged: copy or render it again."
        )


def _depth(path: Path, spec: Any, kinds: set[str]) -> tuple[int, bool]:
    """Bits of a sample of R, G, B, and whether they are floating."""
    if kinds <= set(FLOATING):
        return max(FLOATING[kind] for kind in kinds), True
    kind = min(kinds)
    if len(kinds) > 1 or kind not in INTEGER:
        raise InputError(
            f"{path}: wanted R, G, B of 8 to 16 bit integers or 16 or 32 bit floats, "
            f"got {', '.join(sorted(kinds))}. Convert it ({ADVICE['whole numbers'].given()})."
        )
    stated = spec.get_int_attribute("oiio:BitsPerSample")
    return (stated if kind == "uint16" and stated in (10, 12) else INTEGER[kind]), False


# The samples.


Samples: TypeAlias = tuple[NDArray[Any], list[NDArray[Any]]]
"""(row, col, 3) R, G, B and (row, col) others, as they are stored (R, G, B may be widened)."""


def parts_of(reader: Any) -> list[Any]:
    """Headers of an EXR's parts; of another file, of its first image."""
    count = reader.spec().get_int_attribute("oiio:subimages", 1)
    of_exr = reader.format_name() == "openexr"
    return [reader.spec(part) for part in range(count)] if of_exr else [reader.spec()]


def read_parts(
    path: Path,
    reader: Any,
    form: Format,
    pictures: Sequence[int],
    layer: str | None,
    layout: Callable[..., Layout],
) -> tuple[list[tuple[Layout, Samples]], tuple[int | Part, ...]]:
    """The parts that are `pictures`; and the order of all, as of `Header.parts`."""
    specs = parts_of(reader)
    found: dict[int, tuple[Layout, Samples]] = {}
    parts: list[int | Part] = []
    for index, spec in enumerate(specs):
        if not reader.seek_subimage(index, 0):
            raise damaged(path, form.label, f"one without part {index + 1} of {len(specs)}")
        if index not in pictures:
            parts.append(_read_beside(path, reader, form))
            continue
        own, of_part, names = None, layer, tuple(spec.channelnames)
        if len(specs) > 1:
            view = spec.get_string_attribute("view")
            own = View(view, dict(enumerate(names))) if view else None
            of_part = layer if layer in layers_of(names) else None
        where = layout(path, reader, form, view=own, layer=of_part)
        if len(specs) > 1 and own is None:
            name = one_line(spec.get_string_attribute("oiio:subimagename"))
            notes = (*where.header.notes, f"part {name} of {len(specs)}")
            where = replace(where, header=replace(where.header, notes=notes))
        place = pictures.index(index)
        found[place] = where, read_channels(path, reader, where)
        parts.append(place)
    return [found[place] for place in sorted(found)], tuple(parts)


def _read_beside(path: Path, reader: Any, form: Format) -> Part:
    """The reader's present part, which is no picture."""
    spec, of_part = reader.spec(), form.of_part(reader.current_subimage())
    if spec.deep:
        raise InputError(
            f"{path}: wanted flat parts beside the picture, got one of deep samples. "
            "Remove or flatten it first."
        )
    data: Window = (spec.x, spec.y, spec.width, spec.height)
    display: Window = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    refuse_implausible_size(path, spec, form, data, display)
    kinds, channels = kinds_of(spec), channels_of(path, spec)
    if len(set(kinds)) == 1:
        samples = read_samples(path, reader, range(len(channels)), kinds[0])
        planes = [samples[..., k] for k in range(len(channels))]
    else:
        planes = [read_plane(path, reader, k, kind) for k, kind in enumerate(kinds)]
    assert isinstance(of_part, EXR)
    named = {"name": spec.get_string_attribute("oiio:subimagename")}
    carried = of_part.carried[0] if of_part.carried else as_carried(named)
    return Part(carried, data, display, dict(zip(channels, planes, strict=True)))


def read_channels(path: Path, reader: Any, layout: Layout) -> Samples:
    """Reads the samples of `layout`."""
    header = layout.header
    others = [k for k in range(len(header.channels)) if k not in header.rgb]
    if len(set(header.kinds)) == 1:
        # One pass, in the file's own type: OpenImageIO converts half to float 4 times slower
        # than NumPy does.
        span = range(min(layout.places), max(layout.places) + 1)
        samples = read_samples(path, reader, span, header.kinds[0])
        at = [span.index(place) for place in layout.places]
        plain = [at[k] for k in header.rgb] == [0, 1, 2] and len(span) == 3
        rgb = samples if plain else samples[..., [at[k] for k in header.rgb]]
        return rgb, [np.ascontiguousarray(samples[..., at[k]]) for k in others]
    places = [layout.places[k] for k in header.rgb]
    span = range(min(places), max(places) + 1)
    rgb = read_samples(path, reader, span, "float")[..., [span.index(k) for k in places]]
    return rgb, [read_plane(path, reader, layout.places[k], header.kinds[k]) for k in others]


def read_plane(path: Path, reader: Any, place: int, kind: str) -> NDArray[Any]:
    """(row, col) of one channel among several types, as stored."""
    return np.asarray(read_samples(path, reader, range(place, place + 1), kind)[..., 0])


def read_samples(path: Path, reader: Any, channels: range, kind: str) -> NDArray[Any]:
    """(row, col, channel) of the data window of the reader's present part."""
    samples = _samples(path, reader, channels, kind)
    problem, form = problem_of(reader), FORMATS[reader.format_name()]
    form.explain(path, problem)
    if samples is None or problem:
        raise damaged(path, form.label, f"one that does not decode ({problem})")
    result: NDArray[Any] = samples
    return result


_BAND = 256
"""Rows that are read at once: whole blocks of any compression of EXR."""
_BY_BANDS = ("openexr", "png")


def _samples(path: Path, reader: Any, channels: range, kind: str) -> NDArray[Any] | None:
    """(row, col, channel) of the data window; None if they cannot be read.

    A picture that is read at once is copied by OpenImageIO, from memory that as many bytes take.
    """
    spec, part = reader.spec(), reader.current_subimage()
    name = reader.format_name()
    if name == "openexr" and kind == "half" and len(channels) == spec.nchannels:
        halves = halves_of(path, spec.channelnames)
        if halves is not None:
            return halves
    if name not in _BY_BANDS or spec.tile_width or spec.height <= _BAND:
        whole: NDArray[Any] | None = reader.read_image(part, 0, channels.start, channels.stop, kind)
        return whole
    samples = np.empty((spec.height, spec.width, len(channels)), dtype_of(kind))
    for row in range(0, spec.height, _BAND):
        band = samples[row : row + _BAND]
        first = spec.y + row
        found = reader.read_scanlines(
            part, 0, first, first + len(band), 0, channels.start, channels.stop, kind
        )
        if found is None:
            return None
        band[...] = found.reshape(band.shape)
    return samples


def refuse_several_images(path: Path, reader: Any) -> None:
    """To be called last, for a reader may not find its way back from a second image."""
    spec = reader.spec()
    # FFmpeg's image2pipe makes one file of all frames; OpenImageIO reads the first.
    piped = reader.format_name() == "pnm" and spec.get_int_attribute("pnm:binary")
    several = piped and path.stat().st_size >= 2 * spec.image_bytes(True)
    # Their parts are told apart, or are layers.
    form = FORMATS[reader.format_name()]
    one = form.channels == "any" or form.layered
    if several or (not one and reader.seek_subimage(1, 0)):
        raise InputError(
            f"{path}: wanted one image, got a file of several parts or pages. Take one alone "
            f"({ADVICE['one part'].given(number=0)})."
        )
    problem_of(reader)


# The frame.


def frame_of(
    path: Path,
    layout: Layout,
    samples: Samples,
    *,
    repair: bool,
    signed: bool = False,
    halves: bool = False,
) -> Frame:
    """What was read, as a frame; `repair`, `signed` and `halves` as for `read_image`."""
    rgb, extra = samples
    header = layout.header
    zero_padded = layout.format.is_padded(path, rgb, layout.bits, layout.colour)
    bits = 12 if zero_padded else layout.bits
    pixels, repaired = rgb, 0
    kept = halves and rgb.dtype == np.float16 and are_sound(rgb) and not header.straight
    if not kept:
        pixels = layout.format.exposed(_code_values(rgb, bits, legal=header.legal))
    if layout.floating and not kept:
        grey = len(set(header.rgb)) == 1
        pixels, repaired = _without_impossible_samples(
            path, pixels[..., : 1 if grey else 3], layout, repair=repair, signed=signed
        )
        pixels = np.repeat(pixels, 3, axis=-1) if grey else pixels
    planes = tuple(_as_shown(plane, layout) for plane in extra)
    header = replace(header, extra=planes, zero_padded=zero_padded)
    shown, colour, floating = _as_shown(pixels, layout), layout.colour, layout.floating
    return shown_over_black(Frame(shown, path, colour, bits, floating, repaired, header))


def _code_values(samples: NDArray[Any], bits: int, *, legal: bool = False) -> Pixels:
    """(row, col, 3) float32, integers scaled so that 1.0 is the largest code, or video's white."""
    if not np.issubdtype(samples.dtype, np.integer):
        return converted(samples, np.dtype(np.float32))
    # OpenImageIO widens 10 and 12 bits to 16 by repeating the upper bits below.
    unused = 8 * samples.dtype.itemsize - bits
    black, white = code_span(bits, legal=legal)
    pixels = np.empty(samples.shape, np.float32)

    def scale(_: int, some: slice) -> None:
        part = pixels[some]
        part[...] = samples[some] >> unused if unused else samples[some]
        if legal:
            part -= np.float32(black)
        part /= np.float32(white - black)
        if legal:
            np.clip(part, 0, 1, out=part)

    in_strips(scale, (1, *samples.shape))
    return pixels


def _as_shown(samples: NDArray[Any], layout: Layout) -> NDArray[Any]:
    """`samples` of the data window, with 0 around them up to the display window, upright."""
    whole, orientation = _over_display_window(samples, layout), layout.header.orientation
    return whole if orientation == UPRIGHT else turned(whole, orientation)


def _over_display_window(samples: NDArray[Any], layout: Layout) -> NDArray[Any]:
    if layout.data == layout.display:
        return samples
    (left, top, cols, rows), (display_left, display_top, *size) = layout.data, layout.display
    whole = np.zeros((size[1], size[0], *samples.shape[2:]), samples.dtype)
    row, col = top - display_top, left - display_left
    whole[row : row + rows, col : col + cols] = samples
    return whole


def _without_impossible_samples(
    path: Path, pixels: Pixels, layout: Layout, *, repair: bool, signed: bool
) -> tuple[Pixels, int]:
    """`pixels` without NaN, Inf and negative samples, and how many of them were replaced."""
    least = -np.inf if signed else 0.0
    largest = float(np.finfo(np.float32).max)
    if all_within(pixels[None], max(least, -largest), largest):
        return pixels, 0
    nan, infinite, negative = np.isnan(pixels), np.isposinf(pixels), pixels < least
    bad = nan | infinite | negative
    if not repair:
        kinds = {"NaN": nan, "Inf": infinite, "negative": negative}
        counts = ", ".join(f"{mask.sum()} {kind}" for kind, mask in kinds.items() if mask.any())
        row, col, channel = np.unravel_index(bad.argmax(), bad.shape)
        where = "channel " + ("Y" if pixels.shape[-1] == 1 else "RGB"[channel])
        where += f" of view {layout.view}" if layout.view else ""
        raise InputError(
            f"{path}: wanted finite samples{'' if signed else ' >= 0'}, got {counts}, the first at "
            f"row {row}, col {col}, {where}. "
            f"{'Develop it again.' if signed else 'Add --repair to replace them.'}"
        )
    brightest = np.where(bad, np.float32(0), pixels).max(axis=(0, 1))
    repaired = np.where(infinite, brightest, np.where(bad, np.float32(0), pixels))
    return repaired, int(bad.sum())
