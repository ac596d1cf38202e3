"""Frame -> image file, whole or not at all.

It is encoded in memory, because some encoders of OpenImageIO end the whole process on a full disk
(JPEG) or report success (PNG); Python then writes the bytes under a temporary name and renames the
file.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.alpha import is_opaque, straightened
from domesim.frames.colour import BT709_LUMINANCE
from domesim.frames.depths import code_range, code_span, dtype_of, kind_of
from domesim.frames.dithering import Seed, dither, seed_of
from domesim.frames.formats import FORMATS, SUFFIXES
from domesim.frames.formats.base import Format, Target
from domesim.frames.formats.exr import EXR, Attributes, Part, beside, header_for, written
from domesim.frames.frame import Frame, Pixels
from domesim.frames.halves import are_sound
from domesim.frames.integrity import LARGEST_SIDE
from domesim.frames.orientation import UPRIGHT, turned_back
from domesim.host.writing import write_whole
from domesim.light.strips import converted, in_strips


def write_frame(
    frame: Frame, path: str | Path, *, bits: int | None = None, dither: bool = False
) -> None:
    """Write `frame` to `path`, whole or not at all.

    The suffix names the format. The format that the frame came from keeps its bit depth, metadata
    and all channels. Another format gets the least depth that holds every code value, the metadata
    that it knows, alpha if it has one, and other channels if it is EXR. The pixels are turned back
    and divided by alpha as the file has it, and else written as they are: for another encoding,
    give `frame` other pixels *and* another `colour`. What is particular to a format is told by its
    class in `domesim.frames.formats`.

    Parameters
    ----------
    frame
        Integer formats need its pixels finite and in 0..1; they are rounded to the nearest code,
        ties to even.
    path
        Its suffix is one of `domesim.frames.formats.SUFFIXES`.
    bits
        Bits of a sample: one of the format's `depths`; EXR's, and TIFF's 32, are floating.
    dither
        Round to integers with noise instead (`domesim.frames.dithering`), seeded by the numbers in
        the name of the file that `frame` came from.

    Raises
    ------
    InputError
        If the suffix or `bits` is not one of these, or `path` cannot be written (no such folder,
        not writable, disk full, ...). A file that was there before is then still there, unchanged.
    ValueError
        If pixels are not finite, or not what the format can hold.
    """
    path = Path(path)
    write_whole(path, encoded(frame, path, bits, seed_of(frame.path) if dither else None))


def encoded(frame: Frame, path: Path, bits: int | None, seed: Seed | None = None) -> bytes:
    """What `write_frame` puts at `path`, dithered if there is a `seed`."""
    target = target_of(frame, path, bits)
    if isinstance(target.format, EXR):
        return encoded_parts(path, [frame], [target], frame.header.parts)
    frame = as_stored(frame, target)
    spec = specification(frame, target)
    content = target.format.encoded(path, spec, samples_of(frame, target, seed))
    return target.format.finished(content, path, target)


def encoded_parts(
    path: Path, frames: Sequence[Frame], targets: Sequence[Target], order: Sequence[int | Part]
) -> bytes:
    """An EXR's bytes.

    Parameters
    ----------
    path
        The file to write, for messages.
    frames, targets
        What is written, and how.
    order
        Its parts: which of the frames, or what is beside them.
    """
    made = [part_of(path, *each) for each in zip(frames, targets, strict=True)]
    stated = {name: value for name, value in made[0][0].items() if name == "chromaticities"}
    parts = [made[each] if isinstance(each, int) else beside(each, stated) for each in order]
    return written(path, parts)


def part_of(path: Path, frame: Frame, target: Target) -> tuple[Attributes, dict[str, NDArray[Any]]]:
    """Attributes and (row, col) of each channel of an EXR's part; parameters as above."""
    stored = as_stored(frame, target)
    window = (*frame.header.origin, *stored.pixels.shape[1::-1])
    spec = None if target.same else specification(stored, target)
    header = header_for(path, target, window, spec)
    return header, dict(zip(target.channels, planes_of(stored, target), strict=True))


# Which file, of which samples.

_LUMINANCE = -1


def target_of(frame: Frame, path: Path, bits: int | None) -> Target:
    """What to write at `path`."""
    form = SUFFIXES.get(path.suffix.lower())
    if form is None:
        raise InputError(
            f"{path}: wanted a name that ends in {', '.join(SUFFIXES)}, "
            f"got '{path.suffix}'. Choose one of these (--format png)."
        )
    if bits is not None and bits not in form.depths:
        depths = ", ".join(str(depth) for depth in form.depths)
        raise InputError(f"{path}: wanted {depths} bits for {form.label}, got {bits}. Choose one.")
    header, colour = frame.header, frame.colour
    same = header.file is not None and header.file.name == form.name
    form = header.file if header.file is not None and same else form
    form = form.aimed_at(path, colour, frame.pixels.shape[:2], bits)
    kept = same and bits in (None, frame.bits) and not form.is_reduced()
    if kept:
        bits, floating = frame.bits, frame.floating
    else:
        bits = bits or form.fitting_depth(frame.bits, colour.transfer, floating=frame.floating)
        floating = form.is_floating(bits)
    kind = kind_of(bits, floating=floating)
    channels, kinds, sources = _channels(frame, form, kind, same=same, kept=kept)
    straight = form.straight == "always"
    if same or form.straight == "either":
        straight = header.straight
    return Target(
        format=form,
        same=same,
        colour=colour,
        keeps_colour=_keeps_colour(frame),
        bits=bits,
        floating=floating,
        channels=channels,
        kinds=kinds,
        sources=sources,
        straight=straight and not form.is_reduced(),
        zero_padded=header.zero_padded if kept else form.pads(bits, colour.transfer),
        legal=same and header.legal,
        said={name: value for name, _, value in header.attributes},
        eyes=header.eyes,
    )


def as_stored(frame: Frame, target: Target) -> Frame:
    """`frame` with its samples as they lie in the file: turned, and not multiplied by alpha."""
    header, pixels = frame.header, frame.pixels
    extra, alpha = list(header.extra), header.alpha
    if target.straight and alpha is not None and not is_opaque(extra[alpha]):
        pixels, extra[alpha] = straightened(
            pixels, extra[alpha], frame.colour.transfer, floating=target.floating
        )
    if target.same and header.orientation != UPRIGHT:
        pixels = turned_back(pixels, header.orientation)
        extra = [turned_back(plane, header.orientation) for plane in extra]
    return replace(frame, pixels=pixels, header=replace(header, extra=tuple(extra)))


def _channels(
    frame: Frame, form: Format, kind: str, *, same: bool, kept: bool
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[int, ...]]:
    """Names, types and sources of the channels that are written."""
    header, free, whole = frame.header, form.channels == "any", not form.is_reduced()
    grey = len(set(header.rgb)) == 1
    place = {channel: _LUMINANCE if grey else k for k, channel in enumerate(header.rgb)}
    others = iter(range(3, 3 + len(header.extra)))
    sources = [place[k] if k in place else next(others) for k in range(len(header.channels))]
    extra = [k for k in range(len(header.channels)) if k not in header.rgb]
    alpha = None if header.alpha is None else extra[header.alpha]
    chosen = [
        # What is free has no integers of 8 or 16 bits.
        (channel, header.kinds[k] if kept or (free and same and source >= 3) else kind, source)
        for k, (channel, source) in enumerate(zip(header.channels, sources, strict=True))
        if source < 3 or free or (whole and (same or (k == alpha and form.channels == "alpha")))
    ]
    if not free:  # layers have no names there
        plain = ["RGB"[k] if 0 <= k < 3 else name.rpartition(".")[2] for name, _, k in chosen]
        chosen = [(name, *each[1:]) for name, each in zip(plain, chosen, strict=True)]
    if grey and not free:
        rgb = [(channel, kind, source) for source, channel in enumerate("RGB")]
        chosen = rgb + [each for each in chosen if each[2] != _LUMINANCE]
    channels, kinds, order = zip(*chosen, strict=True)
    return channels, kinds, order


# The samples.


def samples_of(frame: Frame, target: Target, seed: Seed | None = None) -> NDArray[Any]:
    """(row, col, channel) in the type that the encoder takes, dithered if there is a `seed`."""
    if target.sources == (0, 1, 2):
        return _encoded_rgb(frame.pixels, target, seed)
    return np.stack(planes_of(frame, target, seed), -1)


def planes_of(frame: Frame, target: Target, seed: Seed | None = None) -> list[NDArray[Any]]:
    """(row, col) of each channel, in the type of the file; `seed` as for `samples_of`."""
    rgb = _encoded_rgb(frame.pixels, target, seed)
    planes = [
        _luminance(frame.pixels)
        if source == _LUMINANCE
        else rgb[..., source]
        if source < 3
        else frame.header.extra[source - 3]
        for source in target.sources
    ]
    return [_as_kind(*each) for each in zip(planes, map(dtype_of, target.kinds), strict=True)]


def _luminance(pixels: Pixels) -> NDArray[np.float64]:
    """(row, col) of BT.709; in float64, so that grey comes back to the bit."""
    luminance: NDArray[np.float64] = pixels.astype(np.float64) @ BT709_LUMINANCE
    return luminance


def _encoded_rgb(pixels: Pixels, target: Target, seed: Seed | None) -> NDArray[Any]:
    rows, cols, *last = pixels.shape
    if last != [3] or not (0 < rows <= LARGEST_SIDE and 0 < cols <= LARGEST_SIDE):
        # libjpeg ends the process above 65500.
        raise ValueError(
            f"write_frame takes (row, col, 3) with sides of 1 to {LARGEST_SIDE} px, "
            f"got {pixels.shape}"
        )
    if pixels.dtype == np.float16:
        if target.floating and target.bits == 16 and are_sound(np.asarray(pixels)):
            return pixels
        pixels = converted(pixels, np.dtype(np.float32))
    low, high = float(pixels.min()), float(pixels.max())
    least, largest = code_range(target.bits, floating=target.floating)
    if not (least <= low and high <= largest):
        raise ValueError(
            f"write_frame takes pixels in {least:g}..{largest:g} for a {target.bits} bit "
            f"{target.format.label}, got {low:g}..{high:g}. Clip them first."
        )
    if target.floating:
        return converted(pixels, dtype_of(kind_of(target.bits, floating=True)))
    black, white = code_span(target.bits, legal=target.legal)
    codes: NDArray[Any] = np.empty(pixels.shape, dtype_of(kind_of(target.bits, floating=False)))

    def quantise(_: int, some: slice) -> None:
        scaled = np.multiply(pixels[some], np.float32(white - black), order="C")
        if target.legal:
            scaled += np.float32(black)
        if seed is None:
            np.rint(scaled, out=scaled)
        else:
            dither(scaled, 2**target.bits - 1, seed, some.start * cols * 3)
        codes[some] = scaled

    in_strips(quantise, (1, *pixels.shape))
    if target.zero_padded:
        codes <<= 4
    elif target.bits in (10, 12):
        # Repeated below, the upper bits are exact whether OpenImageIO cuts (it does) or rounds.
        codes = codes << (16 - target.bits) | codes >> (2 * target.bits - 16)
    return codes


def _as_kind(plane: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """`plane` as `kind`, integers standing for 0..1."""
    if plane.dtype == kind:
        return plane
    values = plane.astype(np.float64)
    if np.issubdtype(plane.dtype, np.integer):
        values /= np.iinfo(plane.dtype).max
    if np.issubdtype(kind, np.integer):
        values = np.rint(np.clip(np.nan_to_num(values), 0, 1) * np.iinfo(kind).max)
    elif kind == np.float16:
        values = np.clip(values, *code_range(16, floating=True))
    return values.astype(kind)


# The header.

# Attributes of how a format is stored, not of the image; they are written anew.
_STORAGE = re.compile(
    "|".join(
        [
            "oiio:.*|ICCProfile:.*|compression|planarconfig",
            *(each for form in FORMATS.values() for each in form.storage),
        ]
    ),
    re.IGNORECASE,
)
_COLOUR_ATTRIBUTES = ("ICCProfile", "CICP", "chromaticities", "colorInteropID", "Exif:ColorSpace")
_FORMAT_PREFIXES = tuple(f"{name}:" for name in FORMATS)

# OpenImageIO does not write these by the names that it reads them by.
_WRITABLE_TYPES = {
    "vector2i": "int[2]",
    "vectori": "int[3]",
    "vector2i[2]": "box2i",
    "uint16": "int",
}


def specification(frame: Frame, target: Target) -> Any:
    """OpenImageIO's description of what is to be written."""
    rows, cols = frame.pixels.shape[:2]
    attributes = [each for each in frame.header.attributes if _survives(target, each[0])]
    spec = bare_specification(target.channels, target.kinds, (cols, rows), attributes)
    spec.x, spec.y = spec.full_x, spec.full_y = frame.header.origin
    target.format.state_storage(spec, target)
    if target.bits in (10, 12) and not target.zero_padded:
        spec.attribute("oiio:BitsPerSample", target.bits)
    # See `as_stored`: no encoder may divide R, G, B by alpha.
    always = target.format.straight == "always"
    if (always or target.straight) and not target.format.is_reduced():
        spec.attribute("oiio:UnassociatedAlpha", 1)
    if not (target.same and target.keeps_colour):
        target.format.state_colour(spec, target.colour)
    return spec


def bare_specification(
    channels: tuple[str, ...],
    kinds: tuple[str, ...],
    size: tuple[int, int],
    attributes: Sequence[tuple[str, str, Any]],
) -> Any:
    """Channels of `kinds` over `size` (cols, rows) px, and nothing of how they are stored."""
    spec = oiio.ImageSpec(*size, len(channels), kinds[0])
    spec.channelnames = channels
    if len(set(kinds)) > 1:
        spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in kinds)
    upper = [name.upper() for name in channels]
    spec.alpha_channel = upper.index("A") if "A" in upper else -1
    # OpenImageIO would fill in the present time: the same input would give another output.
    spec.attribute("DateTime", "")
    for name, kind, value in attributes:
        _set(spec, name, kind, value)
    return spec


def _set(spec: Any, name: str, kind: str, value: Any) -> None:
    if kind == "string":
        # Old files hold Latin-1 as well, which OpenImageIO gives as surrogates but does not take.
        spec.attribute(name, value.encode("utf-8", "surrogateescape"))
    else:
        spec.attribute(name, oiio.TypeDesc(_WRITABLE_TYPES.get(kind, kind)), value)


def _survives(target: Target, name: str) -> bool:
    if _STORAGE.fullmatch(name) or (name in _COLOUR_ATTRIBUTES and not target.keeps_colour):
        return False
    return target.same or not (name == "Orientation" or name.startswith(_FORMAT_PREFIXES))


def _keeps_colour(frame: Frame) -> bool:
    """Whether the file's own statement of its colour still holds, and is complete."""
    read = frame.header.colour
    if read is None or not frame.colour.means_the_same_as(read):
        return False
    return frame.colour.assumed or not read.assumed
