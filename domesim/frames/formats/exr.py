"""OpenEXR: windows, channels of any name, and all attributes of its headers.

OpenEXR's own bindings read headers and write files: OpenImageIO loses types of attributes that it
does not know, and takes some for orders (``textureformat``: wait for MIP levels). OpenImageIO reads
the pixels: of damaged ones OpenEXR's bindings print a line and drop the part, and the next part
moves up (validation/notes/0018). What else they do unasked is seen to here, once for all files.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeAlias, final

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.colour import (
    ColourTag,
    chromaticities_of,
    interop_identifier,
    interop_named,
    primaries_of,
)
from domesim.frames.formats.base import Format, Target, Window, encode
from domesim.frames.formats.exr_pixels import compressed, decoded, is_available
from domesim.frames.integrity import DamagedError
from domesim.frames.messages import one_line
from domesim.light.strips import threads

MAGIC = b"v/1\x01"
_BEGIN = 8  # of the header
_LONG = 1 << 26  # bytes of headers: pictures of millions of things name them there
_WINDOW = b"dataWindow\0box2i\0\x10\0\0\0"

_COLOUR = ("chromaticities", "colorInteropID")
_ACES_FLAG = "acesImageContainerFlag"
_NAMES = {"oiio:subimagename": "name", "view": "view", "multiView": "multiView"}
_LINES = {OpenEXR.ZIP_COMPRESSION: 16, OpenEXR.ZIPS_COMPRESSION: 1}  # of a chunk
_STORED = {"type": OpenEXR.scanlineimage}
_JUDGED = re.compile(
    rb"(?<!type)(?<!name)"  # which parts cannot be without
    rb"\0(string|stringvector|floatvector|rational|keycode|idmanifest|deepImageState)\0"
)
"""Types, as they stand in a header, of which OpenEXR refuses some values."""
_LEFT_OUT = {
    *("channels", "dataWindow", "displayWindow", "lineOrder", "type", "version", "chunkCount"),
    *("compression", "tiles", "maxSamplesPerPixel", "openexr:levelmode", "openexr:roundingmode"),
    *("dwaCompressionLevel", "preview", "textureformat", "oiio:SHA-1", "oiio:AverageColor"),
}
"""Attributes of how pixels were stored, and of what they were."""

_SUBSAMPLED = re.compile(r"Subsampled channels are not supported \(channel \"([^\"]*)\"")

Attributes: TypeAlias = dict[str, Any]
"""Name -> value, as OpenEXR's bindings have them."""


@dataclass(frozen=True, eq=False)
class Part:
    """What an EXR holds beside a picture, in a part of its own."""

    carried: bytes  # attributes, as of `EXR`
    data: Window
    display: Window
    planes: Mapping[str, NDArray[Any]]  # (row, col) of the data window, by channel, as stored


@final
@dataclass(frozen=True)
class EXR(Format):
    """OpenEXR."""

    carried: tuple[bytes, ...] = ()
    """Attributes of each part, as an EXR: OpenEXR's types cannot be pickled."""

    starts = (MAGIC,)
    channels = "any"
    shaped = True
    largest_ratio = 1100.0  # PIZ and DWA know no useful limit
    storage = ("openexr:.*", "textureformat", "acesImageContainerFlag")

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """What OpenImageIO reads of text, and OpenEXR does not, is no damage."""
        try:
            return replace(self, carried=tuple(map(as_carried, _headers(file))))
        except RuntimeError as error:
            raise DamagedError(f"a header that does not read ({one_line(str(error))})") from error
        except ValueError as error:
            problem = one_line(str(error))
            note = f"its attributes are left out, which OpenEXR does not read ({problem})"
            return replace(self, notes=(note,))

    def windows(self, path: Path, spec: Any) -> tuple[Window, Window]:
        data = (spec.x, spec.y, spec.width, spec.height)
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
                f"{_window(data)}. Crop it first "
                f"({ADVICE['crop'].given(window=_window(display))})."
            )
        return data, display

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        """The identifier goes first (OpenEXR, *Color Interop*, 2026)."""
        identifier = spec.get_string_attribute("colorInteropID")
        if identifier == "data":
            raise InputError(
                f"{path}: wanted a picture, got numbers that are none (colorInteropID 'data'). "
                "Name another file, or say what it is (--encoding)."
            )
        known = interop_named(path, identifier)
        odd = f"; colorInteropID {one_line(identifier)!r} is not known"
        odd = "" if known or identifier in ("", "unknown") else odd
        chromaticities = spec.getattribute("chromaticities")
        named = None if chromaticities is None else primaries_of(chromaticities)
        if known:
            source = f"file: {identifier}"
            # P3-DCI has no identifier: see `interop_identifier`.
            if {named, known[1]} == {"P3-DCI", "P3-D65"} or named in (None, known[1]):
                return ColourTag(known[0], named or known[1], source)
            return ColourTag(*known, f"{source}; its chromaticities say {named}, and are not used")
        if chromaticities is None:
            return ColourTag("linear", "BT.709", f"assumed for EXR{odd}")
        if named is None:
            source = f"assumed for EXR; the file's chromaticities are no colours{odd}"
            return ColourTag("linear", "BT.709", source)
        return ColourTag("linear", named, f"file: chromaticities{odd}")

    def explain(self, path: Path, problem: str) -> None:
        """Luminance and chroma, and subsampled channels (*OpenEXR Technical Introduction*)."""
        subsampled = _SUBSAMPLED.search(problem)
        if subsampled is None:
            return
        if subsampled[1].upper().rpartition(".")[2] in ("RY", "BY"):
            raise InputError(
                f"{path}: wanted R, G, B, got an EXR of luminance and chroma (Y, RY, BY). It is "
                "not damaged: save it as R, G, B where it was made."
            )
        raise InputError(
            f"{path}: wanted channels of one size, got {one_line(subsampled[1])}, which is "
            "subsampled. It is not damaged: save it without that channel where it was made."
        )

    def of_part(self, part: int) -> Self:
        return replace(self, carried=self.carried[part : part + 1])

    def fitting_depth(self, bits: int, transfer: str, *, floating: bool) -> int:
        # Half has 11 significant bits.
        return bits if floating else 16 if bits <= 10 else 32

    def is_floating(self, bits: int) -> bool:
        return True


def header_for(path: Path, target: Target, window: Window, spec: Any | None) -> Attributes:
    """Attributes of a part to be written.

    Parameters
    ----------
    path
        The file to write, for messages.
    target
        What is to be written.
    window
        The data and the display window.
    spec
        OpenImageIO's, if it is not from an EXR.
    """
    form = target.format
    assert isinstance(form, EXR)
    if spec is None:
        header = attributes_in(form.carried[0]) if form.carried else {}
        header = {name: value for name, value in header.items() if name not in _NAMES.values()}
        for name in {*_NAMES} & {*target.said}:
            value = target.said[name]
            texts = [_text(each.encode(errors="surrogateescape")) for each in np.atleast_1d(value)]
            header[_NAMES[name]] = texts[0] if isinstance(value, str) else texts
    else:  # as OpenImageIO names another format's attributes
        spec.width = spec.height = 1
        (found,) = _headers(io.BytesIO(encode(path, form, spec, np.zeros((1, 1, spec.nchannels)))))
        header = _kept(found)
    if not target.keeps_colour:
        header = {name: value for name, value in header.items() if name not in _COLOUR}
    if not (target.same and target.keeps_colour):
        header |= _stated(target.colour)
    # A container of SMPTE ST 2065-4 is half, of ACES AP0, and not compressed.
    if set(target.kinds) != {"half"} or not target.keeps_colour:
        header.pop(_ACES_FLAG, None)
    if _ACES_FLAG in header:
        header["compression"] = OpenEXR.NO_COMPRESSION
    return header | dict.fromkeys(("dataWindow", "displayWindow"), corners(window))


def _stated(colour: ColourTag) -> Attributes:
    if colour.managed:
        return {}
    stated: Attributes = {}
    if colour.transfer != "linear":
        stated["colorInteropID"] = interop_identifier(colour)
    if colour.primaries != "BT.709":
        stated["chromaticities"] = chromaticities_of(colour.primaries)
    return stated


def beside(part: Part, light: Attributes) -> tuple[Attributes, Mapping[str, NDArray[Any]]]:
    """A part that is written as it was, `light` aside: what OpenEXR wants alike in all parts."""
    windows = {"dataWindow": corners(part.data), "displayWindow": corners(part.display)}
    return attributes_in(part.carried) | light | windows, part.planes


def written(path: Path, parts: Sequence[tuple[Attributes, Mapping[str, NDArray[Any]]]]) -> bytes:
    """An EXR's bytes.

    Parameters
    ----------
    path
        The file to write, for messages.
    parts
        Attributes of each, and (row, col) of each of its channels: half, float or unsigned.

    Raises
    ------
    InputError
        If OpenEXR does not write that.
    """
    try:
        return _encoded(parts)
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"{path}: wanted to encode an EXR, got '{one_line(str(error))}'. Write another format."
        ) from error


def _encoded(parts: Sequence[tuple[Attributes, Mapping[str, NDArray[Any]]]]) -> bytes:
    (header, planes), *others = parts
    halves = {each.dtype for each in planes.values()} == {np.dtype(np.float16)}
    lines = _LINES.get(header.get("compression", OpenEXR.ZIP_COMPRESSION))
    if others or not halves or lines is None or not is_available():
        OpenEXR.set_global_thread_count(threads())  # else it has none
        return _by_openexr(parts)
    # One pixel as OpenEXR writes it, for the header; and chunks of our own, by all cores.
    rows, cols = next(iter(planes.values())).shape
    (left, top), _ = header.get("dataWindow", corners((0, 0, cols, rows)))
    pixel = header | {"dataWindow": corners((left, top, 1, 1))}
    content = _by_openexr([(pixel, {name: each[:1, :1] for name, each in planes.items()})])
    window, end = content.index(_WINDOW) + len(_WINDOW), _end_of_header(content)
    chunks = compressed([planes[name] for name in sorted(planes)], lines, int(top))
    places = end + 8 * len(chunks) + np.cumsum([0, *map(len, chunks[:-1])])
    corner = np.array([left + cols - 1, top + rows - 1], "<i4")
    before = [content[: window + 8], corner.tobytes(), content[window + 16 : end]]
    return b"".join([*before, places.astype("<u8").tobytes(), *chunks])


def _by_openexr(parts: Sequence[tuple[Attributes, Mapping[str, NDArray[Any]]]]) -> bytes:
    made = io.BytesIO()
    OpenEXR.File(
        [
            OpenEXR.Part(
                {"compression": OpenEXR.ZIP_COMPRESSION, **header, **_STORED},
                # Of other than C order it would write other numbers, without an error.
                {name: np.ascontiguousarray(plane) for name, plane in planes.items()},
            )
            for header, planes in parts
        ]
    ).write(made)
    return made.getvalue()


def halves_of(path: Path, channels: Sequence[str]) -> NDArray[np.float16] | None:
    """Reads an EXR of halves that ZIP has compressed, faster than OpenImageIO does.

    Parameters
    ----------
    path
        The file.
    channels
        All of its channels.

    Returns
    -------
    samples
        (row, col, channel) of the data window; None if it is another kind of EXR, or damaged.
    """
    if not is_available():
        return None
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        try:
            (header,) = _headers(file)
            lines = _LINES[header["compression"]]
            order = [channels.index(each.name) for each in header["channels"]]
            end = _end_of_header(content)
        except (LookupError, ValueError, RuntimeError, ArithmeticError):
            return None
        (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
        rows, cols = bottom - top + 1, right - left + 1
        places = np.frombuffer(content[end : end + 8 * -(-rows // lines)], "<u8").tolist()
        flat = header["type"] == OpenEXR.scanlineimage and sorted(order) == [*range(len(channels))]
        if not flat or (len(places) - 1) * lines >= rows or len(places) * lines < rows:
            return None
        return decoded(content, places, order, lines, top, (rows, cols))


def _end_of_header(content: bytes | mmap) -> int:
    """Where the chunks' places begin in a file of one part (*OpenEXR File Layout*)."""
    place = _BEGIN
    while content[place]:
        for _ in range(2):  # name and type
            place = content.find(b"\0", place) + 1 or len(content)
        place += 4 + int.from_bytes(content[place : place + 4], "little")
    return place + 1


def corners(window: Window) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The first and the last pixel of a window, (col, row) each."""
    left, top, cols, rows = window
    return np.array([left, top], np.int32), np.array([left + cols - 1, top + rows - 1], np.int32)


def _window(window: Window) -> str:
    left, top, cols, rows = window
    return f"{cols}x{rows}{left:+d}{top:+d}"


# Attributes.


def as_carried(header: Attributes) -> bytes:
    """Attributes that still hold when pixels are stored anew, as an EXR of one pixel."""
    return _by_openexr([(_kept(header), {"Y": np.zeros((1, 1), np.float16)})])


def attributes_in(carried: bytes) -> Attributes:
    """The attributes that `EXR.carried` has of a part."""
    return _kept(_headers(io.BytesIO(carried))[0])


def _kept(header: Attributes) -> Attributes:
    """Less those that say how pixels are stored; ZIP, for others miss damage, or lose precision."""
    kept = {name: value for name, value in header.items() if name not in _LEFT_OUT}
    zips = header.get("compression") == OpenEXR.ZIPS_COMPRESSION
    return kept | ({"compression": OpenEXR.ZIPS_COMPRESSION} if zips else {})


def _headers(file: BinaryIO) -> list[Attributes]:
    """Each part's attributes, less empty lists, which OpenEXR does not write.

    One value that OpenEXR judges, and refuses, makes all of a header unreadable: then those types
    are renamed, for it takes what it does not know as it is.
    """
    try:
        return _read(file)
    except (RuntimeError, ValueError, ArithmeticError):
        file.seek(0)
        renamed = _JUDGED.sub(lambda found: found[0].swapcase(), file.read(_LONG))
        parts = _read(io.BytesIO(renamed))
        return [{name: _as_stated(value) for name, value in part.items()} for part in parts]


def _read(file: BinaryIO) -> list[Attributes]:
    file.seek(0)
    with OpenEXR.File(file, header_only=True) as found:
        return [
            {name: value for name, value in part.header.items() if not _is_empty(value)}
            for part in found.parts
        ]


def _is_empty(value: Any) -> bool:
    return isinstance(value, list) and not value


def _as_stated(value: Any) -> Any:
    """The value of a renamed type; old files' text is Latin-1, for OpenEXR writes UTF-8 only."""
    if not isinstance(value, OpenEXR.OpaqueAttribute):
        return value
    kind = value.typeName.swapcase()
    if kind != "string":
        known = _JUDGED.fullmatch(b"\0" + kind.encode() + b"\0")
        return OpenEXR.OpaqueAttribute(value.data, kind) if known else value
    return _text(value.data)


def _text(stated: bytes) -> str:
    try:
        return stated.decode()
    except UnicodeDecodeError:
        return stated.decode("latin-1")
