"""A show, as the command line names it: one file or sequence, or a left and a right one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from domesim.errors import InputError
from domesim.frames import Master, read_master
from domesim.frames.colour import Asked, ProjectorResponse
from domesim.frames.encodings import encoding_named
from domesim.frames.mistaken import refuse_one_file
from domesim.frames.views import READ
from domesim.shows.checksums import listed_sums, require_sum, sum_of
from domesim.shows.sequences import (
    find_moments,
    find_pairs,
    output_pairs,
    output_paths,
    parse_frames,
    ranges_of,
    source_of,
)

PACKINGS = READ
"""How left and right may lie in one file."""


_OF_VIEWS = re.compile("%[Vv]")
"""Nuke's places for a view's name, and for its first letter."""


@final
@dataclass(frozen=True)
class Show:
    """Masters that belong together, in order.

    Parameters
    ----------
    moments
        The files of each: one, or left and right.
    packing
        How views lie in one file; None to go by the file itself.
    layer
        Which layer or part of EXRs, as for `read_master`.
    as_given
        Take left and right as they are: the same image, exchanged by their looks.
    colour
        What all code values mean, or the projector's response; None to go by the files.
    numbered
        Whether they are frames of a sequence, be it one of its frames.
    part
        Which of a sequence's frames were asked for, as `ranges_of` writes them; "" for all.
    sources
        Where they come from: one place, or left's and right's, with # for a frame's number.
    sums
        SHA-256 of each moment's files, that they must have; nothing if nobody says so.
    """

    moments: tuple[tuple[Path, ...], ...]
    packing: str | None = None
    layer: str | None = None
    as_given: bool = False
    colour: Asked | None = None
    numbered: bool = False
    part: str = ""
    sources: tuple[Path, ...] = ()
    sums: tuple[tuple[str, ...], ...] = ()

    def listed_in(self, listing: Path | None) -> Show:
        """Returns the show with checksums to be checked; unchanged for None.

        Raises
        ------
        InputError
            As for `listed_sums`.
        """
        if listing is None:
            return self
        sums = iter(listed_sums(listing, [path for moment in self.moments for path in moment]))
        return replace(self, sums=tuple(tuple(next(sums) for _ in each) for each in self.moments))

    def some(self, places: Iterable[int]) -> Show:
        """The show with only some of its moments."""
        chosen = tuple(places)
        sums = tuple(self.sums[k] for k in chosen) if self.sums else ()
        return replace(self, moments=tuple(self.moments[k] for k in chosen), sums=sums)

    def read(self, moment: tuple[Path, ...], *, repair: bool, known: Sequence[str] = ()) -> Master:
        """Reads one of the masters, whose SHA-256 may be `known`.

        Raises
        ------
        InputError
            As for `read_master`; or if its files have not the sums that they must have.
        """
        if self.sums:
            found = known or [sum_of(path) for path in moment]
            wanted = self.sums[self.moments.index(moment)]
            for path, *sums in zip(moment, wanted, found, strict=True):
                require_sum(path, *sums)
        return read_master(
            moment,
            packing=self.packing,
            repair=repair,
            allow_identical=self.as_given,
            halves=True,
            colour=self.colour,
            layer=self.layer,
        )

    def outputs(
        self, folder: Path, suffix: str | None, *, together: bool = False
    ) -> tuple[tuple[Path, ...], ...]:
        """Where in `folder` the results for each go.

        Parameters
        ----------
        folder, suffix
            As for `output_paths`.
        together
            Whether left and right become one file: it has the left one's name.

        Returns
        -------
        paths
            One of each moment, or left and right.

        Raises
        ------
        InputError
            If a result would replace an input, or another result.
        """
        pairs = tuple((files[0], files[1]) for files in self.moments if len(files) == 2)
        if pairs and not together:
            return output_pairs(pairs, folder, suffix)
        paths = output_paths([files[0] for files in self.moments], folder, suffix)
        return tuple((path,) for path in paths)


def find_show(
    master: str | None,
    left: str | None = None,
    right: str | None = None,
    *,
    packing: str | None = None,
    layer: str | None = None,
    frames: str | None = None,
    as_given: bool = False,
    encoding: str | None = None,
    response: ProjectorResponse | None = None,
) -> Show:
    """The show that a command's arguments name.

    Parameters
    ----------
    master
        A file or numbered pattern, of both views where it has Nuke's ``%V`` ("left", "right") or
        ``%v`` ("l", "r"); or None, with `left` and `right`.
    left, right
        Those of the two eyes.
    packing
        One of `PACKINGS`, for a master of two views.
    layer
        Which layer or part of EXRs, as for `read_master`.
    frames
        Which frames, as for `find_frames`.
    as_given
        As of `Show`.
    encoding
        A name of `encoding_named`, for what files do not say or say wrongly.
    response
        The projector's, which says what a display's levels are where `encoding` does not.

    Raises
    ------
    InputError
        If both ways are used, or none; left and right are one file; no encoding is so named; and
        as for `find_frames` and `find_pairs`.
    """
    colour = response if encoding is None else encoding_named(encoding)
    part = ranges_of(parse_frames(frames)) if frames else ""
    if packing is not None and packing not in PACKINGS:
        raise InputError(f"--packing {packing!r} is not known; use one of {', '.join(PACKINGS)}")
    if master is not None and _OF_VIEWS.search(master):
        if left is not None or right is not None:
            raise InputError(f"{master}: names both views (%V); leave --left and --right out")
        left, right = (
            master.replace("%V", name).replace("%v", name[0]) for name in ("left", "right")
        )
        master = None
    if master is not None and (left is not None or right is not None):
        raise InputError(
            f"wanted one master or --left and --right, got both: {master} and {left or right}; "
            f"leave one of them out"
        )
    if master is not None:
        moments = find_moments(master, frames)
        numbered = moments != ((Path(master),),)
        origin = (source_of(Path(master)),)
        return Show(moments, packing, layer, as_given, colour, numbered, part, origin)
    if left is None or right is None:
        if left is None and right is None:
            raise InputError(
                "wanted a master, or --left and --right, got none of them; name a file or a "
                "numbered sequence"
            )
        named, other = ("--left", "--right") if right is None else ("--right", "--left")
        raise InputError(
            f"wanted --left and --right, got {named} {left or right} only; name the other eye's as "
            f"{other}"
        )
    if packing is not None:
        raise InputError(
            f"--packing {packing} is for one file of two views, got --left and --right; leave "
            f"--packing out"
        )
    pairs = find_pairs(left, right, frames)
    if not as_given:
        for pair in pairs:
            refuse_one_file(*pair)
    numbered = pairs != ((Path(left), Path(right)),)
    origins = source_of(Path(left)), source_of(Path(right))
    return Show(pairs, None, layer, as_given, colour, numbered, part, origins)
