"""A show's results as a video: ``--format mov``, ``mkv`` and ``mp4``.

Workers do frames in any order, and a run may be killed at any: results are numbered files as ever.
When all of a command's frames are done, it makes the video of them, beside them. Beside the records
it keeps what the video was made of and its SHA-256, so that the same command makes it anew only if
frames are new, or the video is lost or not as it was written.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame
from domesim.frames.colour import is_sayable
from domesim.frames.containers import pyav
from domesim.frames.film import FILMS, FilmFormat, write_film
from domesim.frames.timing import RATES, Timing, exact_rate, timing_of
from domesim.frames.video import video_of
from domesim.host.console import Console
from domesim.host.writing import note_written
from domesim.shows.checksums import sha256
from domesim.shows.job import Job
from domesim.shows.sealed import read_sealed, write_sealed
from domesim.shows.sequences import refuse_inputs
from domesim.shows.show import Show
from domesim.shows.work import Files, Order, Writing

_NUMBER = re.compile(r"[._-]?[0-9]+(?!.*[0-9])")


@final
@dataclass(frozen=True)
class Films:
    """The videos that a show's results become: one, or of left and right.

    Parameters
    ----------
    paths
        Where they go.
    format
        Theirs.
    timing
        When frames are shown.
    dither
        Whether rounding to fewer codes is dithered.
    sounds
        For each, the video whose sound it gets; None for none.
    """

    paths: Files
    format: FilmFormat
    timing: Timing
    dither: bool
    sounds: tuple[Path | None, ...]

    def make(self, orders: Sequence[Order], job: Job, console: Console) -> None:
        """Makes the videos that are not there.

        Parameters
        ----------
        orders
            The frames, in order, all done.
        job
            Theirs.
        console
            Where messages go.

        Raises
        ------
        InputError
            If frames are no video together, or it cannot be written.
        """
        for view, path in enumerate(self.paths):
            colour, frames = self._frames(orders, view, job)
            made_of = self._digest(colour, frames.values())
            if is_made(path, job, made_of):
                console.say(f"{path} (made before)")
                continue
            with console.progress("assembling", len(frames)) as start:
                lost = self.write(view, path, frames, colour, start)
            note_made(path, job, made_of)
            unsaid = [] if is_sayable(colour) else [f"{colour.named}, which the file cannot say"]
            notes = "; ".join([f"{float(self.timing.rate):.6g} frames a second", *unsaid, *lost])
            console.say(f"-> {path} ({notes})")

    def write(
        self,
        view: int,
        path: Path,
        frames: Mapping[Path, str],
        colour: ColourTag,
        start: Callable[[str], None],
    ) -> list[str]:
        """Makes a video of frames; returns what it lacks, for a person.

        Parameters
        ----------
        view
            Whose it is.
        path
            Where to.
        frames
            Their files in order, with the SHA-256 of each.
        colour
            What they mean.
        start
            Called with the name of each.

        Raises
        ------
        InputError
            As for `make`; or if a file is not as it was written.
        """
        return write_film(
            path,
            _read(frames, colour, start),
            len(frames),
            colour,
            self.timing,
            film=self.format,
            dithered=self.dither,
            sound=self.sounds[view] if view < len(self.sounds) else None,
        )

    def _frames(
        self, orders: Sequence[Order], view: int, job: Job
    ) -> tuple[ColourTag, dict[Path, str]]:
        """What all frames mean; and as for `write`."""
        colours: set[tuple[str, str]] = set()
        frames: dict[Path, str] = {}
        for order in orders:
            record = job.record(order.output)
            if record is None:
                raise InputError(f"{order.output[view]}: wanted its record, there is none")
            colours.add(encoding_of(record.figures))
            frames[order.output[view]] = list(record.results.values())[view]
        if len(colours) > 1:
            encodings = " and ".join(" ".join(each) for each in sorted(colours))
            raise InputError(
                f"{self.paths[view]}: wanted frames of one encoding for a video, got {encodings}. "
                f"Say what they are (--encoding)"
            )
        return ColourTag(*colours.pop(), "domesim"), frames

    def _digest(self, colour: ColourTag, frames: Iterable[str]) -> str:
        """Digest of all that a video depends on."""
        how = asdict(self.format), str(self.timing), self.dither, str(self.sounds)
        depends = [list(frames), asdict(colour), *how]
        return hashlib.sha256(json.dumps(depends).encode()).hexdigest()


def _read(
    frames: Mapping[Path, str], colour: ColourTag, start: Callable[[str], None]
) -> Iterator[Frame]:
    """Reads frames again, and refuses those that have changed since they were written."""
    for path, digest in frames.items():
        start(path.name)
        if sha256(path) != digest:
            raise InputError(
                f"{path}: wanted a frame for the video as it was written, got a changed file. The "
                f"same command does it again"
            )
        yield read_frame(path, colour=colour)


def encoding_of(figures: Mapping[str, Any]) -> tuple[str, str]:
    """Transfer and primaries of a frame, by its figures."""
    encoding = figures["encoding"]
    return encoding["transfer"], encoding["primaries"]


def films_of(show: Show, folder: Path, writing: Writing) -> tuple[Writing, Films | None]:
    """How the frames of a show are written, and the videos that they become, if that is asked for.

    Raises
    ------
    InputError
        If it is no sequence, does not go with the depth or rate asked for, a video would go over an
        input, or PyAV is missing.
    """
    kinds = FILMS.get(writing.suffix or "", ())
    if not kinds:
        if writing.fps is not None:
            raise InputError("--fps is for videos (--format mov, mkv or mp4); leave it out")
        return writing, None
    if not show.numbered:
        raise InputError(
            f"--format {kinds[0].suffix[1:]} is for a sequence or video, got one file; leave it out"
        )
    film = next((each for each in kinds if writing.bits in each.bits), None)
    if film is None:
        depths = ", ".join(str(bits) for each in kinds for bits in each.bits if bits is not None)
        raise InputError(f"--bits {writing.bits}: a {kinds[0].suffix} holds {depths}; choose one")
    # PNGs have 8 or 16 bits.
    exact = film.codec == "ffv1"
    suffix = ".tif" if exact and writing.bits in (10, 12) else ".png"
    frames = replace(writing, suffix=suffix, bits=writing.bits if exact else 16)
    frames = replace(frames, fps=None, film=None)
    outputs = frames.places(show, folder)
    paths = tuple(writing.film or place_of(output, film.suffix) for output in outputs[0])
    if len(set(paths)) < len(paths):
        paths = tuple(
            path.with_stem(f"{path.stem}_{side}")
            for path, side in zip(paths, ("left", "right"), strict=True)
        )
    pyav(paths[0])
    refuse_inputs(paths, chain(*show.moments))
    timing = timing_asked(show, writing.fps)
    sounds = tuple(video_of(first) for first in show.moments[0])
    return frames, Films(paths, film, timing, writing.dither, sounds)


def place_of(output: Path, suffix: str) -> Path:
    """``show.mov`` for ``show.0001.png``."""
    name = _NUMBER.sub("", output.stem, count=1)
    return output.with_name(f"{name.strip('._- ') or 'show'}{suffix}")


def timing_asked(show: Show, fps: float | None) -> Timing:
    """Timing as asked for, as the first master says, or the usual."""
    timing = timing_of(show.moments[0][0])
    if fps is None or abs(fps - timing.rate) < 1e-3:
        return timing
    if not RATES[0] <= fps <= RATES[1]:
        raise InputError(f"--fps must lie between 1 and 1000, got {fps:g}")
    return Timing(exact_rate(fps))


def record_of(path: Path) -> str:
    """Name of a video's record, in the job's folder."""
    return f"{path.name}.film"


def note_made(path: Path, job: Job, made_of: str) -> None:
    """Keep what a video was made of, and its digest, for `is_made`."""
    digest = sha256(path)
    note_written({path: digest})
    write_sealed(job.folder / record_of(path), {"made_of": made_of, "sha256": digest})


def is_made(path: Path, job: Job, made_of: str) -> bool:
    """Whether a video is there, of these frames, and as it was written."""
    try:
        kept = read_sealed(job.folder / record_of(path))
        return bool(kept["made_of"] == made_of and kept["sha256"] == sha256(path))
    except (OSError, ValueError, KeyError):
        return False
