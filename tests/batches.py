"""Work whose frames tell when they begin, and do harm where they are told to: for tests of batches.

Run as a program, it does a show as a command would: ``python batches.py FOLDER WORKERS``.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from domesim.frames import ColourTag, Frame, Master, write_frame
from domesim.host.console import Console
from domesim.shows import cluster
from domesim.shows.run import Done, Running, each_frame
from domesim.shows.show import Show, find_show
from domesim.shows.work import Column, Note, Recipe, Work, Write, Writing

LINEAR = ColourTag("linear", "BT.709", "the test")


@final
@dataclass(frozen=True)
class Harmful(Recipe):
    """Copies frames.

    Parameters
    ----------
    log
        Folder in which each attempt at a frame leaves a file of its process's number.
    seconds
        That each takes.
    deadly
        Name of a frame that kills its worker.
    endless, holding
        Name of a frame that is never done; and whether Python itself stands still meanwhile.
    removes
        A file or folder that each frame removes.
    faulty
        Name of a frame that is a fault of the program.
    needs_gpu
        Whether workers must have one; it is not used.
    """

    log: Path
    seconds: float = 0.0
    deadly: str = ""
    endless: str = ""
    holding: bool = False
    removes: Path | None = None
    faulty: str = ""
    needs_gpu: bool = False

    def work(self, note: Note) -> Work[Master, Master]:
        def solve(master: Master) -> Master:
            name = master.path.name
            begun = self.log / f"{name}.{time.time_ns()}"
            begun.write_text(str(os.getpid()))
            if self.removes is not None and self.removes.is_dir():
                shutil.rmtree(self.removes, ignore_errors=True)
            elif self.removes is not None:
                self.removes.unlink(missing_ok=True)
            if name == self.faulty:
                raise ZeroDivisionError("a fault\nof two lines")
            if name == self.deadly:
                os.kill(os.getpid(), signal.SIGKILL)
            while name == self.endless:
                if self.holding:
                    re.match(r"(a+)+$", "a" * 60 + "b")  # takes ages
                time.sleep(1.0)
            time.sleep(self.seconds)
            return master

        def finish(master: Master, write: Write) -> tuple[dict[str, Any], str]:
            write(master)
            return {"level": float(master.pixels.max())}, "copied"

        return Work(lambda master: master, solve, finish)

    def settings(self) -> dict[str, Any]:
        return {"command": "harm"}

    def columns(self) -> tuple[Column, ...]:
        return (Column("level", "Level", "codes"),)

    def memory(self, rows: int, cols: int) -> int:
        return 1

    def resources(self) -> dict[str, float]:
        return {"GPU": 1} if self.needs_gpu else {}

    def begun(self) -> list[str]:
        """Names of the frames that were begun, as often as they were."""
        return sorted(path.name.rsplit(".", 1)[0] for path in self.log.iterdir())

    def pids(self) -> set[int]:
        """Of the processes that began some."""
        return {int(path.read_text() or 0) for path in self.log.iterdir()} - {0}


def make_show(folder: Path, count: int, shape: tuple[int, int] = (4, 6)) -> None:
    """Frames ``in.0001.exr`` and so on; the level tells which."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, count + 1):
        path = folder / f"in.{number:04d}.exr"
        pixels = np.full((*shape, 3), number / (count + 1), np.float32)
        write_frame(Frame(pixels, path, LINEAR, 32, floating=True), path)


def show_of(folder: Path, frames: str | None = None) -> Show:
    return find_show(str(folder / "in.####.exr"), frames=frames)


def harmful_in(folder: Path, **options: Any) -> Harmful:
    """Work that is told of in ``folder/log``."""
    (folder / "log").mkdir(parents=True, exist_ok=True)
    return Harmful(folder / "log", **options)


def do_show(
    show: Show, folder: Path, recipe: Recipe, writing: Writing | None = None, **running: Any
) -> Done:
    """Do it as `running` says, by itself if nothing; results go to ``folder/out``."""
    return each_frame(
        show,
        folder / "out",
        recipe,
        Console(quiet="loud" not in sys.argv),
        what="copying",
        writing=writing,
        running=Running(**{"workers": 0, **running}),
    )


def copied(
    folder: Path, recipe: Recipe, workers: int, *, scheduler: str | None = None, **options: Any
) -> Done:
    """Do the show of ``folder/in``; results go to ``folder/out``."""
    options |= {"workers": None if scheduler else workers, "scheduler": scheduler}
    return do_show(show_of(folder / "in"), folder, recipe, **options)


def main() -> None:
    from domesim.commands import guarded  # noqa: PLC0415

    folder, workers, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    scheduler = sys.argv[4] if len(sys.argv) > 4 else None
    recipe = Harmful(folder / "log", seconds)
    cluster._SILENCE = float(os.environ.get("SILENCE", cluster._SILENCE))
    with guarded():
        done = copied(folder, recipe, workers, scheduler=scheduler)
        sys.exit(2 if done.failed else 0)


if __name__ == "__main__":
    main()
