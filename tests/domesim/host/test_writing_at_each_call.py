"""Each call of the system that writing makes fails once, and is once the last of its process."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from domesim.errors import InputError
from domesim.host.files import KEPT_OPEN
from domesim.host.writing import (
    LIST,
    is_own,
    make_own,
    note_written,
    prepare,
    prepare_folder,
    remove_own,
    write_together,
    write_whole,
    written_to,
)

CALLS = ("open", "link", "replace", "rename", "unlink", "rmdir", "mkdir", "fsync", "close")
LOOKS = ("stat", "lstat", "scandir", "listdir")
THEIRS = b"somebody else's"


class Killed(BaseException):
    """The process has ended: what comes after it does nothing."""


@contextmanager
def at_call(number: int, error: int | None) -> Iterator[list[str]]:
    """Let the call of that number fail with an error; with None it and all after it do not come.

    The list has the names of the calls that were made.
    """
    made: list[str] = []

    def counted(name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            made.append(name)
            if error is None and len(made) > number:
                raise Killed
            if len(made) == number + 1 and error is not None:
                if name == "close":
                    original(*arguments, **options)
                raise OSError(error, os.strerror(error))
            return original(*arguments, **options)

        return call

    class Written(io.FileIO):
        """What a process writes reaches the file when it is flushed."""

        def write(self, content: Any) -> int:
            return int(counted("write", super().write)(content))

    def fdopen(handle: int, mode: str = "r", buffering: int = -1) -> Any:
        raw = Written(handle, mode)
        return (
            raw
            if buffering == 0
            else io.BufferedRandom(raw)
            if "+" in mode
            else (io.BufferedWriter(raw) if "w" in mode else io.BufferedReader(raw))
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "getpid", lambda: 2**22 - 1)  # which is nobody's
        for name in (*CALLS, *LOOKS):
            patch.setattr(os, name, counted(name, getattr(os, name)))
        patch.setattr(os, "fdopen", fdopen)
        yield made


def whole(folder: Path) -> None:
    prepare(folder / "new", folder / "ours")
    write_whole(folder / "new", b"NEW")
    write_whole(folder / "ours", b"NEW")


def together(folder: Path) -> None:
    prepare(folder / "new", folder / "ours")
    write_together([(folder / "new", b"NEW"), (folder / "ours", b"NEW")])


def encoded(folder: Path) -> None:
    prepare(folder / "new", folder / "ours")
    for name in ("new", "ours"):
        with written_to(folder / name) as unfinished, unfinished.open("wb") as file:
            file.write(b"NEW")


def own_folder(folder: Path) -> None:
    prepare_folder(folder)
    remove_own(folder / "own")
    make_own(folder / "own")
    write_whole(folder / "own" / "file", b"NEW")


def noted(folder: Path) -> None:
    note_written({folder / "ours": "0" * 64, folder / "new": "1" * 64})


WAYS = (whole, together, encoded, own_folder, noted)


def made_before(folder: Path) -> None:
    """Files of the program, and of somebody else."""
    folder.mkdir()
    for name in ("theirs", "own theirs/file"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(THEIRS)
    make_own(folder / "own")
    write_whole(folder / "own" / "file", b"OLD")
    prepare(folder / "ours")
    write_whole(folder / "ours", b"OLD")
    KEPT_OPEN.close()


def left(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize("error", [None, errno.ENOSPC, errno.EACCES, errno.EIO, errno.ENOENT])
@pytest.mark.parametrize("way", WAYS)
def test_nothing_is_lost_at_any_call(
    tmp_path: Path, way: Callable[[Path], None], error: int | None
) -> None:
    for number in range(1000):
        folder = tmp_path / str(number)
        made_before(folder)
        ended: BaseException | None = None
        with at_call(number, error) as made:
            try:
                way(folder)
            except (InputError, Killed) as problem:
                ended = problem
            except OSError as problem:
                assert way is own_folder, (number, made[-3:])
                ended = problem
        KEPT_OPEN.close()
        found = left(folder)
        where = (number, made[number : number + 1], ended, sorted(found))
        assert found["theirs"] == found["own theirs/file"] == THEIRS, where
        for name in ("new", "ours", "own/file"):
            assert found.get(name, b"OLD") in (b"OLD", b"NEW"), where
        if way is not own_folder:
            assert found["ours"] in (b"OLD", b"NEW"), where
        # The same command goes on
        way(folder)
        KEPT_OPEN.close()
        mended = left(folder)
        names = {LIST, "own/" + LIST, "own/file", "own theirs/file", "ours", "theirs", "new"}
        if way in (own_folder, noted):
            names -= {"new"}
        assert set(mended) == names, where
        assert is_own(folder / "own")
        if number >= len(made):
            assert ended is None
            return
    raise AssertionError("it never ended")
