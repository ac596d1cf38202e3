"""Masters: one moment of a show, as one frame or as a left and a right one.

A stereo master comes in two files, side by side or one above the other in one image, as views of
an OpenEXR file (``exr_parts.py``), or as an MPO, two JPEGs in one file; many views come as a quilt
(``quilts.py``). `read_master` takes it apart into ordinary frames, and refuses what is no pair
(``mistaken.py``); `write_master` puts it back together the way it came.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.advice import ADVICE
from domesim.errors import HopelessError, InputError
from domesim.frames.colour import Asked, ColourTag
from domesim.frames.depths import code_range
from domesim.frames.dithering import seed_of
from domesim.frames.exr_parts import (
    MultiView,
    SeveralInFile,
    encoded_several,
    read_several,
)
from domesim.frames.eyes import Eyes
from domesim.frames.formats import SUFFIXES, jpeg
from domesim.frames.formats.exr import EXR
from domesim.frames.frame import Frame, as_codes
from domesim.frames.integrity import enough_memory
from domesim.frames.mistaken import (
    refuse_mistaken_pair,
    refuse_one_file,
    refuse_other_view,
    refuse_packing,
    refuse_stated_packing,
)
from domesim.frames.packings import ANAGLYPH, Shared, put_together, taken_apart
from domesim.frames.quilts import Quilt, layout_in
from domesim.frames.reading import read_image
from domesim.frames.video import video_of
from domesim.frames.writing import encoded, target_of
from domesim.host.system import in_memory
from domesim.host.writing import write_together
from domesim.light import transfer

Packing: TypeAlias = Literal["single", "files", "multi-view", "multi-part", "mpo", "quilt"] | Shared
"""How a master's frames lie in files."""

TOGETHER: tuple[Shared, ...] = get_args(Shared)
"""Packings that any pair may be written in."""
READ: tuple[Packing, ...] = (
    *(each for each in TOGETHER if each != ANAGLYPH),
    "multi-view",
    "multi-part",
    "mpo",
    "quilt",
)
"""Packings of one file that are read."""
_DESCRIPTIONS = {
    "files": "left and right in two files",
    "side-by-side": "left and right side by side",
    "top-bottom": "left above right",
    "multi-view": "left and right as views of one part",
    "multi-part": "left and right in two parts",
    "mpo": "left and right in one MPO",
    "side-by-side-half": "left and right side by side at half width",
    "top-bottom-half": "left above right at half height",
    "frame-packed": "left and right frame-packed",
    "row-interleaved": "left and right row by row",
    ANAGLYPH: "an anaglyph",
}
_WHITE = 100.0  # cd/m²; any will do, for it cancels out
_FRAME_PACKED = {(1280, 1470): 720, (1920, 2205): 1080}  # HDMI 1.4a, 8.2.3.2: rows of a view


@dataclass(frozen=True, eq=False)
class Master:
    """One moment of a show.

    Attributes
    ----------
    frames
        One frame, two of one size (left, right), or those of a quilt, the leftmost camera's first.
        Each is as if it came from a file of its own.
    packing
        How they lie in files. Another one may be chosen by `dataclasses.replace`, except the two
        of an EXR, which need a file to have come from.
    file
        What else an EXR of left and right holds, and its order; None for other files.
    eyes
        What a file of packed views says of them; None if it says nothing.
    quilt
        How views lie in a quilt; None for other packings.
    becomes
        Encoding of what is made of it; None for its own.
    limits
        Code values that what is made of it can hold; None for its own.

    Raises
    ------
    InputError
        If count and packing disagree.
    """

    frames: tuple[Frame, ...]
    packing: Packing = "single"
    file: SeveralInFile | None = None
    eyes: Eyes | None = None
    quilt: Quilt | None = None
    becomes: ColourTag | None = None
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        wanted = 1 if self.packing == "single" else 2
        if self.quilt is not None:
            wanted = self.quilt.across * self.quilt.down
        if len(self.frames) != wanted:
            raise InputError(f"Master of '{self.packing}' takes {wanted}, got {len(self.frames)}")

    @property
    def path(self) -> Path:
        """The first file's."""
        return self.frames[0].path

    @property
    def paths(self) -> tuple[Path, ...]:
        """Where it was read: left and right if these are two files."""
        return tuple(dict.fromkeys(frame.path for frame in self.frames))

    @property
    def colour(self) -> ColourTag:
        """What the code values mean."""
        return self.frames[0].colour

    @property
    def bits(self) -> int:
        """Bits of a sample; the larger number, should left and right differ."""
        return max(frame.bits for frame in self.frames)

    @property
    def floating(self) -> bool:
        """Whether values outside 0..1 are possible."""
        return all(frame.floating for frame in self.frames)

    @property
    def code_range(self) -> tuple[float, float]:
        """The least and the largest code value that what is made of it can hold."""
        if self.limits is not None:
            return self.limits
        least, largest = zip(*(frame.code_range for frame in self.frames), strict=True)
        return max(least), min(largest)

    @property
    def repaired(self) -> int:
        """How many samples were NaN, infinite or negative and were replaced."""
        return sum(frame.repaired for frame in self.frames)

    @property
    def pixels(self) -> NDArray[np.float32]:
        """(view, row, col, 3) float32: a copy of the frames' code values."""
        return np.stack([frame.pixels for frame in self.frames], dtype=np.float32)

    def with_pixels(self, pixels: ArrayLike) -> Master:
        """The same files with other R, G, B.

        Parameters
        ----------
        pixels
            (view, row, col, 3).

        Raises
        ------
        InputError
            If `pixels` has not this master's shape.
        """
        new = as_codes(pixels)
        wanted = (len(self.frames), *self.frames[0].pixels.shape)
        if new.shape != wanted:
            raise InputError(f"Master.with_pixels takes {wanted}, got {new.shape}")
        changed = (frame.with_pixels(view) for frame, view in zip(self.frames, new, strict=True))
        return replace(self, frames=tuple(changed))

    @property
    def fits(self) -> bool:
        """Whether its code values are, as they are, those of what is made of it."""
        least, largest = self.code_range
        within = all(
            least <= frame.pixels.min() and frame.pixels.max() <= largest for frame in self.frames
        )
        return within and (self.becomes is None or self.becomes.means_the_same_as(self.colour))

    def encoded_as(self, colour: ColourTag, pixels: ArrayLike) -> Master:
        """The same files with other pixels, in another encoding.

        Parameters
        ----------
        colour
            What the new code values mean.
        pixels
            As for `with_pixels`.

        Returns
        -------
        master
            The new one.
        """
        made = self.with_pixels(pixels)
        return replace(made, frames=tuple(replace(each, colour=colour) for each in made.frames))

    @property
    def of_several(self) -> str:
        """What a message adds to "one picture", if its file has more."""
        notes = [each for each in self.frames[0].header.notes if each.startswith("one of ")]
        return "".join(f" ({each})" for each in notes)

    def described(self) -> str:
        """One phrase for a person: ``2 x 1920 x 1080 EXR, ..., left and right in two files``."""
        first = self.frames[0].described()
        if self.packing == "single":
            held = self.frames[0].header.eyes
            return first if held is None else f"{first}; it says that it is {held}"
        if self.quilt is not None:
            return f"{len(self.frames)} x {first}, {self.quilt}"
        order = "" if self.eyes is None else f": it says {self.eyes}"
        return f"2 x {first}, {_DESCRIPTIONS[self.packing]}{order}"

    def facts(self) -> dict[str, Any]:
        """For a program: ``read``, as `described`, and ``encoding``: a `ColourTag`'s fields."""
        return {"read": self.described(), "encoding": asdict(self.colour)}


def read_master(
    paths: Sequence[str | Path],
    *,
    packing: str | None = None,
    repair: bool = False,
    allow_identical: bool = False,
    halves: bool = False,
    colour: Asked | None = None,
    layer: str | None = None,
) -> Master:
    """Read one moment of a show.

    An EXR whose only picture is a channel Y (or Y and right.Y) is grey as one of two views: its
    frame has R = G = B = Y, and Y is written back as the frame's luminance by ITU-R BT.709
    (0.2126 R + 0.7152 G + 0.0722 B). Any colour that it was given is lost.

    Parameters
    ----------
    paths
        One file; or left and right.
    packing
        How the frames lie in one file. If None, an EXR of views left and right is known by its
        attributes, a quilt by its name, and anything else is one frame. "side-by-side" has left on
        the left, "top-bottom" on top, unless the file says otherwise (``eyes.py``); the views are
        not stretched.
    repair
        As for `read_frame`. What is repaired in one image of two views counts for its left frame.
    allow_identical
        Take left and right that are the same image, even the same file: a flat shot in a stereo
        show. Of one plain colour, such as black, they may always be.
    halves
        Leave the pixels of plain half EXRs half, which takes half the memory; else they are
        float32.
    colour
        As for `read_frame`.
    layer
        Which layer of an EXR, or which of its parts, by its name, or its number from 0. If None,
        the only one that has R, G and B, or combines others.

    Returns
    -------
    master
        One view, or two: left, right.

    Raises
    ------
    InputError
        As for `read_frame`; if left and right differ in size or encoding, name themselves the
        other way round, or are the same image; if an image cannot be halved; if an EXR's views
        are not left and right; or if a file is not packed as `packing` says.
    InputError
        If there are not one or two paths, or `packing` is not a `Packing`.
    """
    files = tuple(Path(path) for path in paths)
    if len(files) not in (1, 2):
        raise InputError(f"read_master takes one or two paths, got {len(files)}")
    known = ("single", "files", *READ)
    if packing is not None and packing not in known:
        raise InputError(f"read_master takes packing {', '.join(known)}, got '{packing}'")
    read = partial(read_image, repair=repair, halves=halves, colour=colour, layer=layer)
    if len(files) == 2:
        refuse_packing(files, packing, "files")
        if not allow_identical:
            refuse_one_file(*files)
        master = _read_pair(*files, read)
    else:
        several = partial(read_several, repair=repair, colour=colour, layer=layer)
        master = _read_file(files[0], packing, read, several)
        refuse_packing(files, packing, master.packing)
    if len(master.frames) == 2 and master.quilt is None:
        refuse_mistaken_pair(master.frames, allow_identical=allow_identical)
    return master


def write_master(
    master: Master,
    paths: Sequence[str | Path],
    *,
    bits: int | None = None,
    dither: bool = False,
) -> None:
    """Write `master` the way that its packing says, whole or not at all.

    Both files of a pair are complete on the disk before the first of them takes its name. An EXR
    of two views comes back with its views, channels, parts and metadata, losslessly compressed; of
    other packings each frame is written as `write_frame` does, an image of two views with the
    left frame's metadata.

    Parameters
    ----------
    master
        What to write; for pixels as for `write_frame`.
    paths
        One file, or left and right for "files".
    bits, dither
        As for `write_frame`; left and right in two files have noise of their own.

    Raises
    ------
    InputError
        As for `write_frame`; if both files of a pair are one; or if an EXR of two views is to
        become another format.
    InputError
        As for `write_frame`; if there are not as many paths as the packing has files; or if the
        frames of what is to be one file differ in encoding or channels.
    """
    files = tuple(Path(path) for path in paths)
    require_writable(master, files, bits)
    if master.packing in ("single", "files"):
        with ThreadPoolExecutor(len(files)) as eyes:
            seeds = [
                seed_of(frame.path, view) if dither else None
                for view, frame in enumerate(master.frames)
            ]
            contents = list(eyes.map(encoded, master.frames, files, repeat(bits), seeds))
        write_together(list(zip(files, contents, strict=True)))
    else:
        write_together([(files[0], _encoded_together(master, files[0], bits, dither=dither))])


def keeps_layers(path: Path) -> bool:
    """Whether a file at `path` can have layers and parts beside its picture."""
    return isinstance(SUFFIXES.get(path.suffix.lower()), EXR)


def require_writable(master: Master, paths: Sequence[str | Path], bits: int | None = None) -> None:
    """Refuse, before work on the pixels, what `write_master` would refuse whatever they are.

    Parameters
    ----------
    master, paths, bits
        As for `write_master`.

    Raises
    ------
    InputError
        As for `write_master`, but for what depends on the pixels or the disk.
    """
    files = tuple(Path(path) for path in paths)
    wanted = 2 if master.packing == "files" else 1
    if len(files) != wanted:
        raise InputError(f"write_master takes {wanted} for '{master.packing}', got {len(files)}")
    if wanted == 2 and files[0].resolve() == files[1].resolve():
        raise InputError(
            f"{files[0]}: wanted two files for left and right, got one twice. Name another."
        )
    if master.packing != "mpo" and any(path.suffix.lower() == ".mpo" for path in files):
        raise InputError(
            f"{files[0]}: wanted left and right of an MPO for .mpo, got "
            f"{_DESCRIPTIONS.get(master.packing, 'one picture')}{master.of_several}. Choose .jpg "
            "(--format jpg)."
        )
    if master.packing == "mpo" and not isinstance(SUFFIXES.get(files[0].suffix.lower()), jpeg.JPEG):
        raise InputError(
            f"{files[0]}: wanted .mpo or .jpg for left and right in one MPO, got "
            f"'{files[0].suffix}'. Choose one of these, or save left and right as two files first."
        )
    if master.packing in TOGETHER:
        rows, cols = master.frames[0].pixels.shape[:2]
        try:
            put_together([np.empty((rows, cols), np.uint8)] * 2, master.packing, abs, abs)
        except ValueError as error:
            raise InputError(
                f"{files[0]}: wanted {error} to write them {master.packing}, got {cols} x {rows}. "
                f"Choose another packing."
            ) from error
    if master.packing in ("multi-view", "multi-part"):
        if master.file is None:
            raise InputError(
                f"write_master takes '{master.packing}' as read from such a file, got new"
            )
        if not keeps_layers(files[0]):
            raise InputError(
                f"{files[0]}: wanted .exr for left and right in one {master.packing} file, got "
                f"'{files[0].suffix}'. Choose .exr, two files, or side-by-side."
            )
    for frame, path in zip(master.frames, files, strict=False):
        target_of(frame, path, bits)


def made_for(
    master: Master,
    paths: Sequence[str | Path],
    bits: int | None = None,
    colour: ColourTag | None = None,
) -> Master:
    """`master` that knows what is to be made of it: files at `paths`, of another encoding if given.

    Parameters
    ----------
    master
        What was read.
    paths, bits
        As for `write_master`.
    colour
        The encoding; None for the master's own.

    Returns
    -------
    master
        The same pixels; `becomes` and `limits` say what they are to become.

    Raises
    ------
    InputError
        As for `require_writable`.
    """
    require_writable(master, paths, bits)
    meant = colour or master.colour
    targets = [
        target_of(replace(frame, colour=meant), Path(path), bits)
        for frame, path in zip(master.frames, paths, strict=False)
    ]
    ranges = [code_range(target.bits, floating=target.floating) for target in targets]
    limits = max(low for low, _ in ranges), min(high for _, high in ranges)
    return replace(master, becomes=colour, limits=limits)


def packed(master: Master, packing: Shared) -> Master:
    """The same pair, to be written as one picture.

    Parameters
    ----------
    master
        A pair.
    packing
        How left and right are to lie in it.

    Returns
    -------
    master
        With that packing.

    Raises
    ------
    InputError
        If it is no pair.
    """
    if len(master.frames) != 2 or master.quilt is not None:
        raise HopelessError(
            f"{master.path}: wanted left and right for --output-packing {packing}, got "
            f"{master.quilt or 'one picture'}; leave it out"
        )
    return replace(master, packing=packing)


# Reading.


def _read_pair(left: Path, right: Path, read: Callable[..., Frame]) -> Master:
    with ThreadPoolExecutor(2) as eyes:
        frames = tuple(eyes.map(partial(read, grey=True), (left, right)))
    for frame, side in zip(frames, ("left", "right"), strict=True):
        refuse_other_view(frame, side)
    return Master(frames, "files")


def _read_file(
    path: Path,
    packing: Packing | None,
    read: Callable[..., Frame],
    several: Callable[[Path], tuple[tuple[Frame, ...], SeveralInFile] | None],
) -> Master:
    with enough_memory(path):
        found = several(path)
    if found is not None:
        frames, file = found
        return Master(frames, "multi-view" if isinstance(file, MultiView) else "multi-part", file)
    with enough_memory(path):
        pair = _read_mpo(path, read, taken=packing == "mpo")
    if pair is not None:
        return Master(pair, "mpo")
    layout = layout_in(path)
    if packing is None and layout is not None:
        packing = "quilt"
    frame = read(path, grey=packing in TOGETHER or packing == "quilt")
    if packing == "quilt":
        return _quilted(frame, layout)
    eyes = frame.header.eyes
    refuse_stated_packing(path, packing, eyes)
    if packing is not None and packing in TOGETHER:
        return Master(_apart(frame, packing, eyes), packing, eyes=eyes)
    return Master((frame,))


def _read_mpo(path: Path, read: Callable[..., Frame], *, taken: bool) -> tuple[Frame, ...] | None:
    """Left and right of an MPO, or what is `taken` for one; None if it is none."""
    try:
        with path.open("rb") as file:
            start = file.read(len(jpeg.START))
            content = start + file.read() if start == jpeg.START else b""
        views = jpeg.pair_of(content, taken=taken) if content else None
    except OSError:  # reading it otherwise will tell
        return None
    except ValueError as error:
        raise InputError(
            f"{path}: wanted a JPEG of one picture, or of left and right, got {error}. Copy it "
            "again, or save two of its pictures as two files."
        ) from error
    return None if views is None else tuple(_read_inner(path, each, read) for each in views)


def _read_inner(path: Path, content: bytes, read: Callable[..., Frame]) -> Frame:
    """The frame of a file within `path`."""
    with in_memory() as (memory, name):
        memory.write(content)
        memory.flush()
        place = Path(name)
        try:
            frame = read(place)
        except InputError as error:
            raise InputError(str(error).replace(str(place), str(path))) from error
    return replace(frame, path=path)


def _apart(frame: Frame, packing: Shared, eyes: Eyes | None) -> tuple[Frame, ...]:
    """Left and right of one picture."""
    rows, cols = frame.pixels.shape[:2]
    way = ADVICE["without the gap" if video_of(frame.path) is None else "a film without the gap"]
    if packing == "top-bottom" and (high := _FRAME_PACKED.get((cols, rows))) is not None:
        raise InputError(
            f"{frame.path}: wanted left above right, got frame-packed 3D ({cols} x {rows} px), "
            f"whose lines {high + 1} to {rows - high} are neither's. Take them out "
            f"({way.given(cols=cols, high=high, low=rows - high)})."
        )
    try:
        pixels = taken_apart(frame.pixels, packing)
    except ValueError as error:
        raise InputError(
            f"{frame.path}: wanted {error} for two views packed as {packing}, got {cols} x {rows} "
            f"px. Crop it first, or name another packing."
        ) from error
    order = _order(eyes)
    extra = [taken_apart(plane, packing) for plane in frame.header.extra]
    return tuple(
        replace(
            frame,
            pixels=pixels[half],
            repaired=repaired,
            header=replace(frame.header, extra=tuple(planes[half] for planes in extra), eyes=None),
        )
        for half, repaired in zip(order, (frame.repaired, 0), strict=True)
    )


def _quilted(frame: Frame, layout: tuple[int, int] | None) -> Master:
    """The views of a quilt."""
    rows, cols = frame.pixels.shape[:2]
    if layout is None:
        raise InputError(
            f"{frame.path}: wanted a quilt, whose name says how many columns and rows of views it "
            f"has, such as show_qs8x6a0.75.png, got none. Rename it."
        )
    across, down = layout
    if not (1 <= across <= cols and 1 <= down <= rows and across * down > 1):
        raise InputError(
            f"{frame.path}: wanted a quilt of {across} x {down} views, as its name says, got "
            f"{cols} x {rows} px. Correct the name."
        )
    quilt = Quilt(across, down, (rows, cols))
    pixels = quilt.taken_apart(frame.pixels)
    extra = [quilt.taken_apart(plane) for plane in frame.header.extra]
    frames = tuple(
        replace(
            frame,
            pixels=each,
            repaired=frame.repaired if k == 0 else 0,
            header=replace(frame.header, extra=tuple(planes[k] for planes in extra)),
        )
        for k, each in enumerate(pixels)
    )
    return Master(frames, "quilt", quilt=quilt)


def _order(eyes: Eyes | None) -> tuple[int, int]:
    """Which half is left, and which is right; and the other way round."""
    return (1, 0) if eyes is not None and eyes.right_first else (0, 1)


# Writing.


def _encoded_together(master: Master, path: Path, bits: int | None, *, dither: bool) -> bytes:
    """Several frames in one file."""
    if master.quilt is not None:
        whole = _joined(master.frames, master.quilt.put_together)
        return encoded(whole, path, bits, seed_of(whole.path) if dither else None)
    left, right = master.frames
    if master.packing == "mpo":
        seeds = [seed_of(left.path, view) if dither else None for view in range(2)]
        return jpeg.joined_pair(*map(encoded, (left, right), repeat(path), repeat(bits), seeds))
    if not left.colour.means_the_same_as(right.colour):
        raise InputError(f"write_master takes one encoding, got {left.colour} and {right.colour}")
    if master.packing in TOGETHER:
        eyes = master.eyes
        # What cannot be said is not so, either: then left comes first.
        form = SUFFIXES[path.suffix.lower()]  # see `require_writable`
        if eyes is not None and not (eyes.packing == master.packing and form.stated_eyes(eyes)):
            eyes = None
        first, second = (master.frames[view] for view in _order(eyes))
        whole = _whole(first, second, master.packing)
        whole = replace(whole, header=replace(whole.header, eyes=eyes))
        return encoded(whole, path, bits, seed_of(whole.path) if dither else None)
    assert master.file is not None  # see `require_writable`
    return encoded_several(master.frames, master.file, path, bits)


def _whole(left: Frame, right: Frame, packing: Shared) -> Frame:
    """The image that `_apart` takes apart."""
    if left.header.channels != right.header.channels:
        raise InputError(
            f"write_master takes the same channels of left and right for '{packing}', "
            f"got {left.header.channels} and {right.header.channels}"
        )
    curve = transfer.named(left.colour.transfer, white=_WHITE)
    join = partial(put_together, packing=packing, decode=curve.decode, encode=curve.encode)
    return _joined((left, right), join)


def _joined(
    frames: Sequence[Frame], join: Callable[[Sequence[NDArray[Any]]], NDArray[Any]]
) -> Frame:
    """One image of frames, with all channels, and the first one's metadata."""
    first = frames[0]
    extra = tuple(
        join(planes) for planes in zip(*(frame.header.extra for frame in frames), strict=True)
    )
    attributes = tuple(each for each in first.header.attributes if each[0] != "view")
    return replace(
        first,
        pixels=join([frame.pixels for frame in frames]),
        header=replace(first.header, extra=extra, attributes=attributes),
    )
