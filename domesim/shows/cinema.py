"""A show's results as the picture of a DCP: ``--format mxf``, wrapped by asdcplib's ``asdcp-wrap``.

Results are codestreams of X'Y'Z' as ever (.j2c), which workers make; two eyes are two sequences.
When all are done, asdcp-wrap makes one MXF of them, of SMPTE's labels. What programs of other
makers need of a DCP besides, its sound and its lists, DCP-o-matic adds.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError
from domesim.frames.containers import pyav
from domesim.frames.encodings import encoding_named
from domesim.frames.messages import one_line
from domesim.frames.video import frame_paths
from domesim.host.console import Console
from domesim.host.writing import written_to
from domesim.shows.film import (
    Films,
    films_of,
    is_made,
    note_made,
    place_of,
    timing_asked,
)
from domesim.shows.job import Job
from domesim.shows.sequences import refuse_inputs
from domesim.shows.show import Show
from domesim.shows.work import Order, Writing

SUFFIX = ".mxf"
WRAPPER = "asdcp-wrap"
_FRAMES = ".j2c"
_RATES = (24, 25, 30, 48, 50, 60)
"""Frames a second of DCPs (SMPTE ST 428-11)."""
_RATE = 250_000_000
"""Bits a second of a DCP's picture (DCI DCSS, 4.3.2)."""
_OTHERWISE = (
    "--format tif --output-encoding dcdm writes frames, which DCP-o-matic takes, too; --format j2c "
    "codestreams"
)


@final
@dataclass(frozen=True)
class Cinema:
    """The MXF that a show's results become.

    Parameters
    ----------
    path
        Where it goes.
    rate
        Frames a second.
    """

    path: Path
    rate: int

    @property
    def paths(self) -> tuple[Path, ...]:
        """All files that are made."""
        return (self.path,)

    def make(self, orders: Sequence[Order], job: Job, console: Console) -> None:
        """Makes the MXF, unless it is there.

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
            If it cannot be made, or does not read as it should.
        """
        records = [job.record(order.output) for order in orders]
        sums = [None if record is None else sorted(record.results.items()) for record in records]
        made_of = hashlib.sha256(json.dumps(sums).encode()).hexdigest()
        if is_made(self.path, job, made_of):
            console.say(f"{self.path} (made before)")
            return
        with written_to(self.path) as temporary:
            with console.progress("wrapping", 1) as start:
                start(self.path.name)
                eyes = self._wrapped(orders, temporary)
            paths = frame_paths(temporary)
            if len(paths) != len(orders) * eyes:
                raise InputError(
                    f"{self.path}: wanted {len(orders) * eyes} pictures, got {len(paths)} by "
                    f"{WRAPPER}. Try again."
                )
        note_made(self.path, job, made_of)
        views = "left and right" if eyes == 2 else "2D"
        console.say(f"-> {self.path} ({self.rate} frames a second, {views}, without sound)")

    def _wrapped(self, orders: Sequence[Order], temporary: Path) -> int:
        """Wraps the frames as `temporary` by asdcp-wrap; returns the number of eyes."""
        eyes = len(orders[0].output)
        largest = _RATE // 8 // self.rate // eyes
        for order in orders:
            for path in order.output:
                if path.stat().st_size > largest:
                    raise InputError(
                        f"{path}: wanted at most {largest} bytes for a picture of a DCP of "
                        f"{('one eye', 'two eyes')[eyes - 1]} at {self.rate} frames a second (250 "
                        f"Mbit/s), got {path.stat().st_size}. Let DCP-o-matic encode it (--format "
                        f"tif --output-encoding dcdm)"
                    )
        with tempfile.TemporaryDirectory(prefix="domesim-") as scratch:
            folders = [Path(scratch) / f"{eye}" for eye in range(eyes)]
            for eye, folder in enumerate(folders):
                folder.mkdir()
                for number, order in enumerate(orders):
                    link = folder / f"{number:08}{_FRAMES}"
                    link.symlink_to(order.output[eye].absolute())
            options = [*(["-3"] if eyes == 2 else []), "-L", "-p", str(self.rate)]
            command = [WRAPPER, *options, *map(str, folders), str(temporary)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode or not temporary.is_file():
            problem = one_line("\n".join(reversed(done.stderr.splitlines())))
            raise InputError(
                f"{self.path}: wanted {WRAPPER} to make it, got '{problem}' (it ended with "
                f"{done.returncode}). Frames that are done stay; {_OTHERWISE}"
            )
        return eyes


def becoming(show: Show, folder: Path, writing: Writing) -> tuple[Writing, Films | Cinema | None]:
    """Returns how frames are written, and the MXF that they become, if one is asked for.

    Raises
    ------
    InputError
        As for `films_of`; or of a DCP's MXF, if asdcp-wrap is not installed, or another encoding or
        rate is asked for.
    """
    if writing.suffix != SUFFIX:
        return films_of(show, folder, writing)
    if not show.numbered:
        raise InputError("--format mxf is for a sequence or video, got one file; leave it out")
    xyz = encoding_named("dcdm", "--format mxf:")
    if writing.output is not None and not writing.output.means_the_same_as(xyz):
        raise InputError(
            f"--format mxf is X'Y'Z'; leave --output-encoding out, got {writing.output.named}"
        )
    if shutil.which(WRAPPER) is None:
        raise InputError(
            f"--format mxf: {WRAPPER} is not installed (build asdcplib from its sources); "
            f"{_OTHERWISE}"
        )
    rate = timing_asked(show, writing.fps).rate
    if rate not in _RATES:
        raise InputError(
            f"--format mxf has {', '.join(map(str, _RATES))} frames a second, got "
            f"{float(rate):.6g}; say which is meant, such as --fps 24"
        )
    frames = replace(writing, suffix=_FRAMES, fps=None, output=xyz)
    path = place_of(frames.places(show, folder)[0][0], SUFFIX)
    if len(show.moments[0]) == 2:  # of both
        path = path.with_stem(path.stem.removesuffix(".left").removesuffix("_left") or path.stem)
    pyav(path)
    refuse_inputs([path], chain(*show.moments))
    return frames, Cinema(path, int(rate))


def dcp_hint(orders: Sequence[Order], done: Sequence[Mapping[str, Any]]) -> str:
    """What makes a DCP of results that are X'Y'Z'; "" if they are not."""
    kinds = {path.suffix.lower() for order in orders for path in order.output}
    if not done or not kinds <= {".tif", ".tiff", _FRAMES}:
        return ""
    if any(each["encoding"]["transfer"] != "dcdm" for each in done):
        return ""
    return f"For a DCP of these, use DCP-o-matic; --format mxf makes its picture ({WRAPPER})"
