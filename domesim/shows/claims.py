"""Who does which frame of a job: commands that work in one folder divide its frames.

A claim is a file of a frame's name that one command alone could make (``O_EXCL``), on any file
system. It holds the name of the command's own file (`clients`), which beats as long as the command
lives; clocks of machines are not compared. The claim of a command that is gone is taken away, and
the frame is anybody's.

A claim that nobody gave back tells a later run that an unfinished result is the job's own.
"""

from __future__ import annotations

import hashlib
import os
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
                with place.open("x") as file:
                    file.write(self._clients.name)
                return True
            except OSError as error:
                holder = self._holder(frame)
                if holder is None and isinstance(error, FileExistsError):  # it was just given back
                    continue
                # sshfs does not say that there is one. Where none can be made, writing will say why
                if holder in (None, self._clients.name):
                    return True
            if self._clients.works(holder):
                return False
            # Only one command may take it away, while it is still the claim of the one that is gone
            right = "." + hashlib.sha256(f"{frame} {holder}".encode()).hexdigest()
            if not self.take(right):
                return False
            try:
                if self._holder(frame) == holder:
                    place.unlink(missing_ok=True)
            except OSError:  # another user's
                return True
            finally:
                self.give_back(right)

    def give_back(self, frame: str) -> None:
        """Lets go of a frame that has ended, unless another command has taken it away."""
        if self._holder(frame) == self._clients.name:
            with suppress(OSError):
                (self._folder / frame).unlink()

    def is_taken(self, frame: str) -> bool:
        """Whether any command, be it gone, has a frame that it did not give back."""
        return self._holder(frame) is not None

    def _holder(self, frame: str) -> str | None:
        """Name of the file of the command that has a frame; None if none has, "" if unreadable."""
        try:
            return (self._folder / frame).read_text(errors="replace")
        except FileNotFoundError:
            return None
        except OSError:
            return ""

    def tidy(self, frames: Iterable[str]) -> None:
        """Removes claims of frames that are done, which commands that were killed left."""
        with suppress(OSError):
            ended = set(frames)
            for frame in os.listdir(self._folder):  # noqa: PTH208
                if (frame in ended or frame.startswith(".")) and self.take(frame):
                    self.give_back(frame)
