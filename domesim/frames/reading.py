"""Image file -> frame."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.alpha import shown_over_black
from domesim.frames.colour import ColourTag, colour_of
from domesim.frames.formats import FLOATING, INTEGER, LABELS, SQUARE, code_span, dpx, label
from domesim.frames.formats.jpeg2000 import is_associated
from domesim.frames.frame import Frame, Header, Pixels
from domesim.frames.integrity import (
    Container,
    damaged,
    enough_memory,
    examine,
    refuse_sides,
    stored_otherwise,
)
from domesim.frames.messages import one_line, problem_of
from domesim.frames.orientation import UPRIGHT, known, turned
from domesim.frames.video import SUFFIXES, container_of, read_video_frame, video_of, video_size
from domesim.light.strips import converted


def read_frame(path: str | Path, *, repair: bool = False, colour: ColourTag | None = None) -> Frame:
    """Read an image file: EXR, PNG, TIFF, DPX, JPEG, and what else is in `LABELS`.

    Parameters
    ----------
    path
        The file. Its content decides what it is, not its suffix. Or a frame of a video: see
        `domesim.frames.video`.
    repair
        Replace NaN and negative samples by 0 and +Inf by the channel's largest finite value,
        instead of refusing them.
    colour
        What the code values mean, whatever the file says; None to go by the file.

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
    colour: ColourTag | None = None,
) -> Frame:
    """`read_frame`; with `grey`, an EXR whose only picture is a channel Y is R = G = B = Y.

    With `signed`, negative samples are no damage: a camera's black level is subtracted from noise.
    """
    with enough_memory(path):
        return _read_image(path, repair=repair, grey=grey, signed=signed, colour=colour)


def _read_image(
    path: Path, *, repair: bool, grey: bool, signed: bool, colour: ColourTag | None
) -> Frame:
    if video_of(path) is not None:
        return read_video_frame(path, colour=colour)
    container = examine(path)
    reader = open_image(path, container)
    try:
        layout = layout_of(path, reader, container, grey=grey, colour=colour)
        samples = read_channels(path, reader, layout)
        refuse_several_images(path, reader)
    finally:
        reader.close()
    return frame_of(path, layout, samples, repair=repair, signed=signed)


def size_of(path: Path) -> tuple[int, int]:
    """Rows and columns of a file's picture, as its header says.

    Raises
    ------
    InputError
        If it does not open.
    """
    if video_of(path) is not None:
        return video_size(path)
    reader = open_image(path, examine(path))
    try:
        spec = reader.spec()
        sides = int(spec.full_height), int(spec.full_width)
        return sides if known(spec.getattribute("Orientation")) < 5 else sides[::-1]
    finally:
        reader.close()


def unsaid(frame: Frame) -> str:
    """What a frame's file says else than what its code values mean, for a person; or "".

    A TIFF, JPEG or DPX cannot say most encodings.
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


def open_image(path: Path, container: Container | None = None) -> Any:
    """OpenImageIO's reader of the file, or of what its examination has stored anew."""
    if container is not None and container.stored_anew is not None:
        with os.fdopen(os.memfd_create("stored-anew"), "rb+") as memory:
            memory.write(container.stored_anew)
            memory.flush()
            # The reader has it open by itself.
            return _open_at(path, f"/proc/self/fd/{memory.fileno()}")
    try:
        name = str(path).encode().decode()
    except UnicodeEncodeError:
        raise InputError(
            f"{path}: wanted a path in UTF-8, got other bytes. Rename the file or its folder."
        ) from None
    return _open_at(path, name)


def _open_at(path: Path, name: str) -> Any:
    # Without UnassociatedAlpha, R, G, B of PNG and TIFF come multiplied by alpha.
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(name, config)
    # An error that is not fetched is printed when the process ends.
    problem = problem_of(oiio)
    if reader is None:
        _refuse_compression(path, problem)
        _refuse_video(path)
        raise InputError(
            f"{path}: wanted an image, got something that does not open as one "
            f"({problem}). Copy or render it again, or convert it to EXR or PNG."
        )
    return reader


_LACKING = re.compile(
    r"(\w+) compression support is not configured|Compression (scheme \d+) .*not implemented"
)
"""What libtiff says of a compression that it was built without."""


def _refuse_compression(path: Path, problem: str) -> None:
    """Name a TIFF's compression that is not read."""
    lacking = _LACKING.search(problem)
    if lacking is not None:
        raise stored_otherwise(path, lacking[1] or f"compression {lacking[2]}")


_STILLS = (b"heic", b"heix", b"heim", b"heis", b"mif1", b"avif")
"""Brands of pictures in the container of MP4 (ISO/IEC 23008-12, 10.2; AV1 Image File Format, 4)."""


def _refuse_video(path: Path) -> None:
    """Name the container of a video whose suffix is of none that is read."""
    with path.open("rb") as file:
        start = file.read(16)
    if start[4:8] == b"ftyp" and start[8:12] in _STILLS:
        raise InputError(
            f"{path}: wanted {', '.join(LABELS.values())}, got HEIF or AVIF. Convert it to EXR or "
            "PNG (ImageMagick: convert IN OUT.png)."
        )
    container = container_of(start)
    if container is not None:
        raise InputError(
            f"{path}: wanted a video in {', '.join(SUFFIXES)}, got one in {container} called "
            f"'{path.suffix}'. Convert it (ffmpeg -i IN -c:v ffv1 -c:a copy OUT.mkv), or rename "
            "it if its suffix is wrong."
        )


# The header: where the samples are.


Window: TypeAlias = tuple[int, int, int, int]
"""Left, top, cols, rows."""


@dataclass(frozen=True)
class View:
    """One view of a file that holds several: its name, and its channels.

    Parameters
    ----------
    name
        As the file has it: "left".
    channels
        Which of the part's channels -> what they are called in the view: without the view's name.
    """

    name: str
    channels: Mapping[int, str]


@dataclass(frozen=True)
class Layout:
    """What a header says of where a frame's samples are."""

    format: str
    places: tuple[int, ...]  # which of the part's channels
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    rgb: tuple[int, int, int]
    bits: int
    floating: bool
    data: Window
    display: Window
    attributes: tuple[tuple[str, str, Any], ...]
    colour: ColourTag
    stated: ColourTag | None  # what the file has for `colour`; None if that is not supported
    container: Container
    part: int  # of the file's
    orientation: int
    straight: bool  # whether colours are not multiplied by alpha
    legal: bool  # whether codes lie between black and white of video
    notes: tuple[str, ...]
    view: str = ""


def layout_of(
    path: Path,
    reader: Any,
    container: Container,
    *,
    view: View | None = None,
    grey: bool = False,
    colour: ColourTag | None = None,
) -> Layout:
    """Where the samples of the reader's present part are, or of one `view` of it.

    Their encoding is `colour`, or the file's.
    """
    spec = reader.spec()
    name = reader.format_name()
    if name not in LABELS:
        raise InputError(
            f"{path}: wanted {', '.join(LABELS.values())}, got {name}. Convert it to EXR or PNG."
        )
    if spec.deep:
        raise InputError(f"{path}: wanted a flat image, got deep samples. Flatten it first.")
    data, display = _windows(path, spec, name)
    refuse_implausible_size(path, spec, name, data, display, container.stored_anew)
    channels, places = channels_of(path, spec), tuple(range(spec.nchannels))
    if view is not None:
        channels, places = tuple(view.channels.values()), tuple(view.channels)
    rgb = find_grey(channels) if grey and name == "openexr" else None
    if rgb is None:
        rgb = _find_rgb(path, spec, channels, "" if view is None else view.name)
    kinds = tuple(kinds_of(spec)[place] for place in places)
    bits, floating = _depth(path, spec, {kinds[channel] for channel in rgb})
    meant, stated = _colours(path, spec, name, container, colour)
    orientation = _orientation(path, spec, name, container)
    legal = name == "dpx" and not floating and dpx.is_legal(spec, bits)
    notes = [*_pixel_notes(path, spec, name, container), *(["legal range"] if legal else [])]
    if orientation != UPRIGHT:
        notes.append(f"turned upright: its Orientation is {orientation}")
    return Layout(
        format=name,
        places=places,
        channels=channels,
        kinds=kinds,
        rgb=rgb,
        bits=bits,
        floating=floating,
        data=data,
        display=display,
        attributes=attributes_of(path, spec, container),
        colour=meant,
        stated=stated,
        container=container,
        part=reader.current_subimage(),
        orientation=orientation,
        straight=_is_straight(spec, name, container),
        legal=legal,
        notes=tuple(notes),
        view="" if view is None else view.name,
    )


def _colours(
    path: Path, spec: Any, name: str, container: Container, given: ColourTag | None
) -> tuple[ColourTag, ColourTag | None]:
    """What code values mean; and what the file says of that, None if it is not supported."""
    if given is None:
        stated = colour_of(path, spec, name, container)
        return stated, stated
    try:
        return given, colour_of(path, spec, name, container)
    except InputError:
        return given, None


def _orientation(path: Path, spec: Any, name: str, container: Container) -> int:
    """Exif's number."""
    if name == "dpx":
        try:
            return dpx.orientation_of(container.carried[0], big_endian=container.big_endian)
        except ValueError as error:
            raise InputError(
                f"{path}: wanted lines that are rows, got {error}. Turn it first (ImageMagick: "
                "convert IN -auto-orient OUT)."
            ) from error
    if container.radiance is not None:
        return container.radiance.orientation
    return known(spec.getattribute("Orientation"))


def _is_straight(spec: Any, name: str, container: Container) -> bool:
    """Whether colours are not multiplied by alpha."""
    if name == "jpeg2000":
        return not is_associated(container.boxes)
    return name == "bmp" or bool(spec.get_int_attribute("oiio:UnassociatedAlpha"))


def _pixel_notes(path: Path, spec: Any, name: str, container: Container) -> tuple[str, ...]:
    """What is to be said of the pixels' shape; refuse pictures that are not of square ones."""
    stated = spec.getattribute("PixelAspectRatio")
    if container.radiance is not None:
        stated = container.radiance.pixel_aspect
    if not isinstance(stated, float | int) or not 0 < stated < np.inf:
        return ()
    if abs(stated - 1) <= SQUARE:
        return ()
    if name in ("openexr", "dpx", "hdr"):
        raise not_square(path, stated)
    # Others tell how densely to print.
    return (f"pixels taken as square, though its densities say {stated:.4g} : 1",)


def not_square(path: Path, aspect: float) -> InputError:
    """The error for a picture of pixels that are `aspect` times as wide as high."""
    return InputError(
        f"{path}: wanted square pixels, got ones of {aspect:.4g} : 1 (pixel aspect ratio). Resize "
        "the picture to square ones first, or correct what the file says if they are square "
        "(oiiotool IN --attrib PixelAspectRatio 1 -o OUT)."
    )


def kinds_of(spec: Any) -> tuple[str, ...]:
    """Each channel's type."""
    each = tuple(str(kind) for kind in spec.channelformats)
    return each or (str(spec.format),) * spec.nchannels


def attributes_of(
    path: Path, spec: Any, container: Container | None = None
) -> tuple[tuple[str, str, Any], ...]:
    """Name, type and value of each attribute."""
    invented: frozenset[str] = frozenset()
    if container is not None and spec.getattribute("dpx:Version") is not None:
        invented = dpx.INDUSTRY if len(container.carried[0]) < dpx.HEADER else invented
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


def _windows(path: Path, spec: Any, name: str) -> tuple[Window, Window]:
    """The data and the display window: left, top, cols, rows."""
    data = (spec.x, spec.y, spec.width, spec.height)
    # Only EXR means it: what PNG (oFFs) and TIFF (XPosition) tell is a place on a sheet of paper.
    if name != "openexr":
        return (0, 0, *data[2:]), (0, 0, *data[2:])
    display = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    inside = all(
        display[axis] <= data[axis]
        and data[axis] + data[axis + 2] <= display[axis] + display[axis + 2]
        for axis in (0, 1)
    )
    if not inside:
        # Light from beyond the edge of the screen is on no screen, and cutting it off unasked
        # would break the promise that a file keeps what it holds.
        raise InputError(
            f"{path}: wanted pixels within the display window {_window(display)}, got overscan "
            f"{_window(data)}. Crop it first (oiiotool IN --crop {_window(display)} -o OUT)."
        )
    return data, display


def _window(window: Window) -> str:
    left, top, cols, rows = window
    return f"{cols}x{rows}{left:+d}{top:+d}"


# Decoded bytes a byte of file. zlib reaches 1032; flat JPEGs stay below it; PIZ and DWA know no
# useful limit, and of DPX OpenImageIO checks it itself.
_LARGEST_RATIO = {"openexr": 1100.0, "png": 1100.0, "tiff": 1100.0, "jpeg": 1100.0}
_UNLIMITED_COMPRESSION = ("piz", "dwaa", "dwab", "htj2k", "htj2k256", "htj2k32", "lj2k")


def refuse_implausible_size(
    path: Path,
    spec: Any,
    name: str,
    data: Window,
    display: Window,
    stored_anew: bytes | None = None,
) -> None:
    """Before memory is asked for."""
    for cols, rows in (data[2:], display[2:]):
        refuse_sides(path, cols, rows)
    if spec.depth > 1:
        raise InputError(f"{path}: wanted an image, got a volume of depth {spec.depth}. Slice it.")
    if spec.get_string_attribute("compression") in _UNLIMITED_COMPRESSION:
        return
    decoded, stored = spec.image_bytes(True), len(stored_anew or b"") or path.stat().st_size
    if decoded > _LARGEST_RATIO.get(name, np.inf) * stored:
        raise InputError(
            f"{path}: wanted a whole {label(name)}, got {stored} bytes for {data[2]} x {data[3]} "
            f"px of {spec.nchannels} channels. It is probably damaged: copy or render it again."
        )


def find_grey(channels: Sequence[str]) -> tuple[int, int, int] | None:
    """Which channel is Y, for R, G and B; None if Y is not the only picture that there is."""
    upper = [name.upper() for name in channels]
    # X: CIE XYZ. RY, BY: chroma, which OpenEXR keeps at half the size.
    if upper.count("Y") != 1 or not {"R", "G", "B", "X", "RY", "BY"}.isdisjoint(upper):
        return None
    return (upper.index("Y"),) * 3


def _find_rgb(path: Path, spec: Any, channels: tuple[str, ...], view: str) -> tuple[int, int, int]:
    """Which channels are R, G, B."""
    # OpenImageIO turns these into an RGB of its own making.
    for attribute in ("jpeg:ColorSpace", "tiff:ColorSpace"):
        model = spec.get_string_attribute(attribute)
        if model not in ("", "RGB", "YCbCr", "palette"):
            raise InputError(f"{path}: wanted channels R, G, B, got {model}. Convert it to RGB.")
    found = [[k for k, name in enumerate(channels) if name.lower() == wanted] for wanted in "rgb"]
    if all(len(matches) == 1 for matches in found):
        red, green, blue = (matches[0] for matches in found)
        return red, green, blue
    grey = next((name for name in channels if name.upper() in ("Y", "L", "I")), None)
    way = "R=Y,G=Y,B=Y".replace("Y", grey) if grey else "R=...,G=...,B=..."
    names = listed(channels)
    if view:
        raise InputError(
            f"{path}: wanted one each of channels R, G, B, or Y alone, in view {view}, got "
            f"{names or 'none'}. Name them so (oiiotool IN --chnames ... -o OUT)."
        )
    raise InputError(
        f"{path}: wanted one each of channels R, G, B, got {names}. "
        f"Convert it to RGB first (oiiotool IN --ch {way} -o OUT)."
    )


def listed(names: Sequence[str]) -> str:
    """The first of `names`, for a message."""
    return one_line(", ".join(names[:8])) + (", ..." if len(names) > 8 else "")


def _depth(path: Path, spec: Any, kinds: set[str]) -> tuple[int, bool]:
    """Bits of a sample of R, G, B, and whether they are floating."""
    if kinds <= set(FLOATING):
        return max(FLOATING[kind] for kind in kinds), True
    kind = min(kinds)
    if len(kinds) > 1 or kind not in INTEGER:
        raise InputError(
            f"{path}: wanted R, G, B of 8 to 16 bit integers or 16 or 32 bit floats, "
            f"got {', '.join(sorted(kinds))}. Convert it (oiiotool IN -d float -o OUT)."
        )
    stated = spec.get_int_attribute("oiio:BitsPerSample")
    return (stated if kind == "uint16" and stated in (10, 12) else INTEGER[kind]), False


# The samples.


Samples: TypeAlias = tuple[NDArray[Any], list[NDArray[Any]]]
"""(row, col, 3) R, G, B and (row, col) others, as they are stored (R, G, B may be widened)."""


def read_channels(path: Path, reader: Any, layout: Layout) -> Samples:
    """The samples that `layout` tells of."""
    others = [k for k in range(len(layout.channels)) if k not in layout.rgb]
    if len(set(layout.kinds)) == 1:
        # One pass, in the file's own type: OpenImageIO converts half to float 4 times slower
        # than NumPy does.
        span = range(min(layout.places), max(layout.places) + 1)
        samples = read_samples(path, reader, span, layout.kinds[0])
        at = [span.index(place) for place in layout.places]
        plain = [at[k] for k in layout.rgb] == [0, 1, 2] and len(span) == 3
        rgb = samples if plain else samples[..., [at[k] for k in layout.rgb]]
        return rgb, [np.ascontiguousarray(samples[..., at[k]]) for k in others]
    places = [layout.places[k] for k in layout.rgb]
    span = range(min(places), max(places) + 1)
    rgb = read_samples(path, reader, span, "float")[..., [span.index(k) for k in places]]
    return rgb, [
        read_plane(path, reader, layout.places[k], layout.channels[k], layout.kinds[k])
        for k in others
    ]


def read_plane(path: Path, reader: Any, place: int, channel: str, kind: str) -> NDArray[Any]:
    """(row, col) of one channel among several types, as stored."""
    plane = read_samples(path, reader, range(place, place + 1), kind)[..., 0]
    # Channels of several types can only be written through float32, which scales integers to
    # 0..1: below 2^22 each comes back exactly (tried), above it does not.
    if kind == "uint" and plane.max() >= 2**22:
        raise InputError(
            f"{path}: wanted integers below {2**22} in channel {channel}, got "
            f"{plane.max()}. Remove the channel (oiiotool IN --ch R,G,B -o OUT)."
        )
    return plane


def read_samples(path: Path, reader: Any, channels: range, kind: str) -> NDArray[Any]:
    """(row, col, channel) of the data window of the reader's present part."""
    samples = reader.read_image(reader.current_subimage(), 0, channels.start, channels.stop, kind)
    problem = problem_of(reader)
    _refuse_compression(path, problem)
    if samples is None or problem:
        got = f"one that does not decode ({problem})"
        raise damaged(path, label(reader.format_name()), got)
    result: NDArray[Any] = samples
    return result


def refuse_several_images(path: Path, reader: Any) -> None:
    """To be called last, for a reader may not find its way back from a second image."""
    several = bool(reader.seek_subimage(1, 0))
    problem_of(reader)
    if several:
        raise InputError(
            f"{path}: wanted one image, got a file of several parts or pages. "
            "Split it first (oiiotool IN --sisplit -o OUT)."
        )


# The frame.


def frame_of(
    path: Path, layout: Layout, samples: Samples, *, repair: bool, signed: bool = False
) -> Frame:
    """What was read, as a frame; `repair` and `signed` as for `read_image`."""
    rgb, extra = samples
    _refuse_unsaid_dcdm(path, rgb, layout)
    zero_padded = _is_zero_padded(rgb, layout)
    bits = 12 if zero_padded else layout.bits
    pixels = _code_values(rgb, bits, legal=layout.legal)
    if layout.container.radiance is not None:
        pixels /= np.array(layout.container.radiance.exposure, np.float32)
    repaired = 0
    if layout.floating and len(set(layout.rgb)) == 1:
        grey, repaired = _without_impossible_samples(
            path, pixels[..., :1], layout, repair=repair, signed=signed
        )
        pixels = np.repeat(grey, 3, axis=-1)
    elif layout.floating:
        pixels, repaired = _without_impossible_samples(
            path, pixels, layout, repair=repair, signed=signed
        )
    pixels = _as_shown(pixels, layout)
    planes = tuple(_as_shown(plane, layout) for plane in extra)
    header = Header(
        format=layout.format,
        attributes=layout.attributes,
        channels=layout.channels,
        kinds=layout.kinds,
        rgb=layout.rgb,
        extra=planes,
        origin=layout.display[:2],
        colour=layout.stated,
        colour_chunks=layout.container.colour_chunks,
        big_endian=layout.container.big_endian,
        carried=layout.container.carried[layout.part],
        boxes=layout.container.boxes,
        comments=layout.container.comments,
        zero_padded=zero_padded,
        legal=layout.legal,
        straight=layout.straight,
        orientation=layout.orientation,
        eyes=layout.container.eyes,
        notes=layout.notes,
    )
    frame = Frame(
        pixels=pixels,
        path=path,
        colour=layout.colour,
        bits=bits,
        floating=layout.floating,
        repaired=repaired,
        header=header,
    )
    return shown_over_black(frame)


def _is_zero_padded(rgb: NDArray[Any], layout: Layout) -> bool:
    """Whether it is a DCDM's TIFF: 12 bits, above four that are 0 (DCI DCSS, 3.2.2)."""
    if (layout.format, layout.bits, layout.colour.transfer) != ("tiff", 16, "dcdm"):
        return False
    return not np.bitwise_or.reduce(rgb, axis=None) & 15


def _refuse_unsaid_dcdm(path: Path, rgb: NDArray[Any], layout: Layout) -> None:
    """Ask about 12 bits in 16 that nobody says the meaning of: sRGB has no reason for them."""
    if (layout.format, layout.kinds[0], layout.colour.assumed) != ("tiff", "uint16", True):
        return
    used = np.bitwise_or.reduce(rgb, axis=None)
    if used & 0xF0 and not used & 0x0F:
        raise InputError(
            f"{path}: wanted to know what its code values are, got 12 bits in 16, as a DCDM's "
            "X'Y'Z', and no word of it. Add --encoding dcdm, or --encoding srgb (or what it is) "
            "if it is none."
        )


def _code_values(samples: NDArray[Any], bits: int, *, legal: bool = False) -> Pixels:
    """(row, col, 3) float32, integers scaled so that 1.0 is the largest code, or video's white."""
    if not np.issubdtype(samples.dtype, np.integer):
        return converted(samples, np.dtype(np.float32))
    # OpenImageIO widens 10 and 12 bits to 16 by repeating the upper bits below.
    unused = 8 * samples.dtype.itemsize - bits
    codes = samples >> unused if unused else samples
    pixels = codes.astype(np.float32)
    black, white = code_span(bits, legal=legal)
    if legal:
        pixels -= np.float32(black)
    pixels /= np.float32(white - black)
    return np.clip(pixels, 0, 1, out=pixels) if legal else pixels


def _as_shown(samples: NDArray[Any], layout: Layout) -> NDArray[Any]:
    """`samples` of the data window, with 0 around them up to the display window, upright."""
    if layout.orientation != UPRIGHT:
        return turned(_over_display_window(samples, layout), layout.orientation)
    return _over_display_window(samples, layout)


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
    # NaN makes a minimum NaN, and so fails the first comparison.
    if pixels.min() >= least and abs(pixels).max() < np.inf:
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
    largest = np.where(bad, np.float32(0), pixels).max(axis=(0, 1))
    repaired = np.where(infinite, largest, np.where(bad, np.float32(0), pixels))
    return repaired, int(bad.sum())
