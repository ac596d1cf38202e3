"""Timed text of a DCP: which picture is shown on which frame, and where.

The XML is SMPTE ST 428-7 (``SubtitleReel``) or Interop's (``DCSubtitle``), with PNG pictures beside
it. What neither the schema nor the file says is taken as libdcp 1.10 and DCP-o-matic take it [1]:
positions are from the aligned edge, or from the middle; times are rounded to frames; a subtitle
without a fade time fades in and out within 80 ms; pictures are not scaled. Zposition is a share of
the width, and negative before the screen.

[1] C. Hetherington, libdcp, ``text_asset.cc``, ``smpte_text_asset.cc``, and DCP-o-matic,
``render_text.cc``; the schema of ST 428-7:2014 is in libdcp's folder ``xsd``.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import final

from domesim.errors import InputError, reason
from domesim.frames.timing import timing_of
from domesim.host.files import read_plain
from domesim.shows.checksums import sum_of

SUFFIX = ".xml"
_ROOTS = ("SubtitleReel", "DCSubtitle")
_FADE = Fraction(80, 1000)  # s
_TICKS = 250  # a second, of Interop


@final
@dataclass(frozen=True)
class Place:
    """Where a picture lies on a frame.

    Parameters
    ----------
    across, down
        Alignment (0 left or top, 1 center, 2 right or bottom), and how far it is moved from there
        into the frame, or from the middle to the right or down, in shares of the frame.
    depth
        Disparity, in shares of the width; positive is behind the screen.
    """

    across: tuple[int, Fraction]
    down: tuple[int, Fraction]
    depth: Fraction

    def corner(
        self, view: int, frame: tuple[int, int], picture: tuple[int, int]
    ) -> tuple[int, int]:
        """Row and column of a picture's first pixel.

        Parameters
        ----------
        view
            0 for the left eye, 1 for the right one.
        frame, picture
            Their rows and columns.
        """
        top, left = (
            _start(*aligned, whole, part)
            for aligned, whole, part in zip((self.down, self.across), frame, picture, strict=True)
        )
        moved = self.depth * frame[1] / 2
        return _whole(top), _whole(left + (moved if view else -moved))


@final
@dataclass(frozen=True)
class Subtitle:
    """A picture that is shown for some time.

    Parameters
    ----------
    picture
        Its file.
    place
        Where.
    first, end
        Its first frame, and the one after its last, from 0.
    fades
        Frames that it takes to appear, and to go.
    """

    picture: Path
    place: Place
    first: int
    end: int
    fades: tuple[Fraction, Fraction]

    def opacity(self, frame: int) -> float:
        """How opaque it is on a frame: 0 before and after, 1 between its fades."""
        if not self.first <= frame < self.end:
            return 0.0
        appear, go = self.fades
        shown = min(
            Fraction(frame - self.first) / appear if appear else 1,
            Fraction(self.end - frame) / go if go else 1,
            1,
        )
        return float(shown)


@final
@dataclass(frozen=True)
class Reel:
    """The timed text of a show.

    Parameters
    ----------
    path
        Its XML.
    start
        Number of the show's first frame.
    subtitles
        In the order that they are drawn.
    """

    path: Path
    start: int
    subtitles: tuple[Subtitle, ...]

    def at(self, number: int) -> Iterator[tuple[Subtitle, float]]:
        """Yields what is seen on the frame of that number, and how opaque it is."""
        for each in self.subtitles:
            if opacity := each.opacity(number - self.start):
                yield each, opacity

    def sums(self) -> dict[str, str]:
        """SHA-256 of all its files, and where it starts."""
        files = {self.path, *(each.picture for each in self.subtitles)}
        return {"start": str(self.start)} | {path.name: sum_of(path) for path in sorted(files)}


def reel_in(path: Path) -> Path | None:
    """The XML of timed text that a path names: itself, or the only one in a folder; else None.

    Raises
    ------
    InputError
        If a folder has several, or the timed text is in an MXF.
    """
    if path.suffix.lower() == ".mxf":
        raise InputError(
            f"{path}: wanted timed text as XML beside its PNG pictures, got an MXF. Unwrap it "
            f"(asdcp-unwrap), or name the folder that it was made from."
        )
    if not path.is_dir():
        return path if path.suffix.lower() == SUFFIX else None
    found = [each for each in sorted(path.iterdir()) if each.suffix.lower() == SUFFIX]
    found = [each for each in found if each.name.lower() not in ("assetmap.xml", "volindex.xml")]
    if len(found) != 1:
        names = ", ".join(each.name for each in found) or "none"
        raise InputError(
            f"{path}: wanted a folder with one XML of timed text, got {names}. Name the XML."
        )
    return found[0]


def read_reel(path: Path, first: Path, start: int) -> Reel:
    """Reads timed text.

    Parameters
    ----------
    path
        The XML; its pictures lie beside it.
    first
        The first frame of the show, which may say its rate.
    start
        Its number: the reel begins there.

    Raises
    ------
    InputError
        If it is no timed text, has texts instead of pictures, its pictures are not there, or the
        rate is another than the show's.
    """
    root = _root(path)
    rate, clock = _rate(path, root, first)
    subtitles = tuple(
        _subtitle(path, node, image, rate, clock)
        for node in root.iter("Subtitle")
        for image in _images(path, node)
    )
    if not subtitles:
        raise InputError(f"{path}: wanted subtitles, got none. Leave --overlay out.")
    return Reel(path, start, subtitles)


def _root(path: Path) -> ET.Element:
    """The XML, without namespaces; attributes in lower case, which both standards then share."""
    try:
        content = read_plain(path)
    except OSError as error:
        raise InputError(
            f"{path}: wanted timed text, got '{reason(error)}'. Check the path."
        ) from error
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(f"{path}: wanted timed text, got an XML of another kind. Name another.")
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError):
        raise InputError(
            f"{path}: wanted timed text, got XML that does not parse. Export it again."
        ) from None
    for node in root.iter():
        node.tag = node.tag.rpartition("}")[2]
        lower = {key.lower(): value.strip() for key, value in node.attrib.items()}
        node.attrib.clear()
        node.attrib.update(lower)
    if root.tag not in _ROOTS:
        raise InputError(
            f"{path}: wanted a SubtitleReel (SMPTE ST 428-7) or a DCSubtitle (Interop), got a "
            f"{root.tag}. Name the timed text."
        )
    return root


def _rate(path: Path, root: ET.Element, first: Path) -> tuple[Fraction, int | None]:
    """Frames a second; and units of a time code a second, None for Interop's times."""
    if root.tag == "DCSubtitle":
        return timing_of(first).rate, None
    start = (root.findtext("StartTime") or "").strip()
    if start.strip("0:"):
        raise InputError(f"{path}: wanted a StartTime of 00:00:00:00, got {start}. Export it so.")
    try:
        numbers = [int(each) for each in (root.findtext("EditRate") or "").split()]
        rate = Fraction(*numbers)
        clock = int(root.findtext("TimeCodeRate") or "")
        if rate <= 0 or clock <= 0 or len(numbers) > 2:
            raise ValueError(numbers)
    except (ValueError, TypeError, ZeroDivisionError):
        raise InputError(
            f"{path}: wanted an EditRate such as '24 1' and a TimeCodeRate such as 24, got "
            f"{root.findtext('EditRate')!r} and {root.findtext('TimeCodeRate')!r}. Export it again."
        ) from None
    stated = timing_of(first, rate).rate
    if stated != rate:
        raise InputError(
            f"{path}: wanted timed text of {float(stated):g} frames a second as {first.name}, got "
            f"{float(rate):g}. Export it at that rate."
        )
    return rate, clock


def _images(path: Path, node: ET.Element) -> Iterator[ET.Element]:
    for each in node.iter():
        if each.tag == "Text":
            words = " ".join("".join(each.itertext()).split())
            raise InputError(
                f"{path}: wanted subtitles as PNG pictures, got text ({words[:30]!r}), whose look "
                f"the server decides. Export them as pictures."
            )
        if each.tag == "Image":
            yield each


def _subtitle(
    path: Path, node: ET.Element, image: ET.Element, rate: Fraction, clock: int | None
) -> Subtitle:
    def frames(name: str, unsaid: Fraction | None = None) -> Fraction:
        text = node.get(name.lower())
        if text is None and unsaid is not None:
            return unsaid * rate
        seconds = _seconds(text or "", clock)
        if seconds is None:
            raise InputError(
                f"{path}: wanted a time as {name}, got {text!r} of subtitle "
                f"{node.get('spotnumber', '?')}. Export it again."
            )
        # A time code counts frames, also where these are a thousandth slower
        return seconds * (rate if clock is None else round(rate))

    place = Place(
        (_aligned(path, image, "Halign", _ACROSS), _share(path, image, "Hposition")),
        (_aligned(path, image, "Valign", _DOWN), _share(path, image, "Vposition")),
        _share(path, image, "Zposition"),
    )
    if "variablez" in image.attrib:
        raise InputError(
            f"{path}: wanted subtitles at one depth each (Zposition), got VariableZ. Export them "
            f"as pictures, and name one sequence for each eye."
        )
    return Subtitle(
        _picture(path, (image.text or "").strip()),
        place,
        _whole(frames("TimeIn")),
        _whole(frames("TimeOut")),
        (frames("FadeUpTime", _FADE), frames("FadeDownTime", _FADE)),
    )


def _picture(path: Path, named: str) -> Path:
    """The file of a picture, by its UUID or name."""
    identity = named.removeprefix("urn:uuid:")
    for name in (named, identity, f"{identity}.png"):
        place = path.parent / Path(name).name
        if place.is_file():
            return place
    raise InputError(
        f"{path}: wanted the picture {identity or '?'}.png beside it, got none. Put it there."
    )


def _seconds(text: str, clock: int | None) -> Fraction | None:
    """A time: hours, minutes, seconds, and units of the clock; None if it is none."""
    if clock is None and text.isdecimal():  # fades of Interop
        return Fraction(int(text), _TICKS)
    found = _TIME.fullmatch(text)
    if found is None:
        return None
    hours, minutes, seconds = (int(found[k]) for k in (1, 2, 3))
    if found[5] is not None:  # Interop's thousandths, as libdcp reads them: .5 is 5 ms
        if clock is not None:
            return None
        rest = Fraction(int(found[5]), 1000)
    else:
        rest = Fraction(int(found[4]), clock or _TICKS)
    return 3600 * hours + 60 * minutes + seconds + rest


_TIME = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})(?::(\d{1,3})|\.(\d{1,3}))")


def _share(path: Path, image: ET.Element, name: str) -> Fraction:
    text = image.get(name.lower(), "0")
    try:
        share = Fraction(text) / 100
    except (ValueError, ZeroDivisionError):
        share = Fraction(2)
    if abs(share) > 1:
        raise InputError(
            f"{path}: wanted {name} in percent, -100 to 100, got {text!r}. Export it again."
        )
    return share


_ACROSS, _DOWN = ("left", "center", "right"), ("top", "center", "bottom")


def _aligned(path: Path, image: ET.Element, name: str, known: Sequence[str]) -> int:
    text = image.get(name.lower(), "center")
    if text not in known:
        raise InputError(
            f"{path}: wanted {name} to be one of {', '.join(known)}, got {text!r}. Export it again."
        )
    return known.index(text)


def _start(align: int, share: Fraction, whole: int, part: int) -> Fraction:
    """Where a picture's side begins."""
    moved = share * whole
    return Fraction((whole - part) * align, 2) + (moved if align < 2 else -moved)


def _whole(value: Fraction) -> int:
    """The nearest whole number, halves up."""
    return (value + Fraction(1, 2)).__floor__()
