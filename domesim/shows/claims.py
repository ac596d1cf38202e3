"""Who does which frame of a job: commands that work in one folder divide its frames.

A claim is a file of a frame's name that one command alone could make (``O_EXCL``), on any file
system. It holds the name of the command's own file (`clients`), which beats as long as the command
lives; clocks of machines are not compared. The claim of a command that is gone is taken away, and
the frame is anybody's.

A claim that nobody gave back tells a later run that an unfinished result is the job's own.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import final

from domesim.shows.clients import Clients

FOLDER = "claims"
"""Name of the claims' folder, in the job's."""


@final
class Claims:
    """The claims of one command.

    Parameters
    ----------
    job
        Folder of the job.
    clients
        The commands that work there.
    """

    def __init__(self, job: Path, clients: Clients) -> None:
        self._folder, self._clients = job / FOLDER, clients
        self._folder.mkdir(exist_ok=True)

    def take(self, frame: str) -> bool:
        """Claims a frame by the name of its result, unless another command has it."""
        place = self._folder / frame
        while True:
            try:
                handle = os.open(place, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
            except FileExistsError:
                pass
            except OSError:  # no claims can be made: whoever writes the result will say why
                return True
            else:
                with os.fdopen(handle, "w") as file:
                    file.write(self._clients.name)
                return True
            try:
                holder = place.read_text()
            except FileNotFoundError:  # it was just given back
                continue
            if holder == self._clients.name:
                return True
            if self._clients.works(holder):
                return False
            self._take_away(place, holder)

    def give_back(self, frame: str) -> None:
        """Lets go of a frame that has ended."""
        with suppress(OSError):
            (self._folder / frame).unlink()

    def tidy(self, frames: Iterable[str]) -> None:
        """Removes claims of frames that are done, which commands that were killed left."""
        with suppress(OSError):
            for frame in set(os.listdir(self._folder)).intersection(frames):  # noqa: PTH208
                if self.take(frame):
                    self.give_back(frame)

    def _take_away(self, place: Path, holder: str) -> None:
        """Remove the claim of a command that is gone, unless another has done so and claimed it."""
        gone = self._folder / f".{secrets.token_hex(8)}"
        with suppress(FileNotFoundError):
            place.rename(gone)
            if gone.read_text() != holder:
                with suppress(OSError):
                    os.link(gone, place)
            gone.unlink()
