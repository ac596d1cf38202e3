"""The one way to write: files come whole or not at all, and nobody else's are replaced or removed.

A command says what it will write before its work begins (`prepare`). Each folder has a list
``.domesim`` of what the program wrote there for people, in lines of ``sha256sum``. A file is the
program's own if it is listed and as it was written; any other is somebody's, and so is a folder
without a mark of the program (`make_own`). A job's frames are known by their records instead
(`domesim.shows.job`).

A file is written under a name that nobody can foresee, beside its place, and then renamed. It was
made with ``O_EXCL``, so that no link is followed.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO, TypeAlias

import psutil

from domesim.errors import InputError, NoPlaceError, reason
from domesim.host.files import KEPT_OPEN, written_sums
from domesim.host.system import BINARY, CLOEXEC, NOFOLLOW, NONBLOCK

LIST = ".domesim"
"""Name of a folder's list of what the program wrote there; or of the mark of its own folder."""

_HEAD = b"# What domesim wrote here, as it was written. It replaces these files, and no others.\n"
_OWN = b"# domesim made this folder. It removes it when it makes it anew.\n"
_LONGEST = 1 << 28  # bytes of a list: of a show of a hundred thousand frames, done many times

_MOVE = "Move it away, or choose another folder"

_FULL = (errno.ENOSPC, errno.EDQUOT)
_OF_ONE = (errno.EISDIR, errno.ENAMETOOLONG, errno.EEXIST)
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EXDEV, errno.EMLINK)
_TEMPORARY = re.compile(r"\.tmp-([0-9a-f]{4})-([0-9]+)-[0-9a-f]{16}(?:\.[^.]*)?$")

_State: TypeAlias = tuple[int, int, int, int]
_prepared: dict[Path, _State | None] = {}
"""What this command said it would write -> what was there when it last looked."""


# Before the work.


def prepare(
    *targets: Path,
    inputs: Iterable[str | Path | None] = (),
    overwrite: bool | None = None,
) -> None:
    """See that all files that a command will write can be made, and that no other is lost.

    Parameters
    ----------
    targets
        The files. Folders that they lie in are made.
    inputs
        What the command reads, which is never replaced; names of no file do not matter.
    overwrite
        Replace files that are not the program's own. None for a command that has no such option.

    Raises
    ------
    InputError
        If a target cannot be made, is one of the `inputs`, or is not the program's to replace.
    """
    there = {path: state for path in targets if (state := _state(path)) is not None}
    read = {found for each in inputs if each and (found := _followed(Path(each)))}
    for path in there:
        with _told(path):
            is_folder = path.is_dir()
        if is_folder:
            raise InputError(
                f"{path}: wanted a file for the results, got 'is a directory'. Choose another name."
            )
        if _followed(path) in read:
            raise InputError(
                f"{path}: wanted a place for the result, got the input itself. Choose another name."
            )
    folders = dict.fromkeys(path.parent for path in targets)
    lists = {folder: listed(folder) for folder in folders}
    if not overwrite:
        refuse(
            [path for path in there if not is_listed(path, lists[path.parent])],
            _MOVE if overwrite is None else "Choose another name, or --overwrite",
        )
    for folder in folders:
        prepare_folder(folder)
    for path in targets:
        _require_name(path)
    if not _prepared:
        KEPT_OPEN.callback(_prepared.clear)
    _prepared.update((path.absolute(), there.get(path)) for path in targets)


def prepare_folder(folder: Path) -> None:
    """Make `folder`, and see that files can be made in it, before hours of work on them.

    What killed commands left half-written there is removed.

    Raises
    ------
    InputError
        If it cannot be made or written to.
    """
    try:
        str(folder).encode()
    except UnicodeEncodeError:  # OpenImageIO could write there, but not read
        raise InputError(f"{folder}: wanted a folder named in UTF-8. Choose another.") from None
    made = temporary_of(folder / "results")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.close(_new(made))
        made.unlink()
    except OSError as error:
        raise InputError(
            f"{folder}: wanted a folder for the results, got '{reason(error)}'. "
            "Choose one that can be made and written to."
        ) from error
    sweep(folder)


def _require_name(path: Path) -> None:
    """See that a file can have that name, and an unfinished one its longer name."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(
            f"{path}: wanted a file named in UTF-8. Choose another name. Rename the master."
        ) from None
    try:
        temporary_of(path).lstat()
    except FileNotFoundError:
        pass
    except OSError as error:
        raise InputError(
            f"{path}: wanted a file for the results, got '{reason(error)}'. Choose another name."
        ) from error


def refuse(others: Sequence[Path], way: str = _MOVE) -> None:
    """Refuse to replace somebody else's files, if there are any; `way` is what to do instead.

    Raises
    ------
    InputError
        If there are.
    """
    if others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise InputError(
            f"{others[0]}{more}: wanted a free place for the result, got a file that domesim did "
            f"not write, or that was changed since. {way}."
        )


def is_listed(path: Path, lines: frozenset[bytes], name: str | None = None) -> bool:
    """Whether a file is as a line of ``sha256sum`` has it, under its `name` there."""
    if not lines:
        return False
    try:
        if path.is_symlink() or not path.is_file():
            return False
        with path.open("rb") as file:
            digest = _sha256(file)
    except OSError:
        return False
    return written_sums({name or path.name: digest}) in lines


def listed(folder: Path) -> frozenset[bytes]:
    """Lines of a folder's list of what the program wrote there, as of ``sha256sum``.

    Raises
    ------
    InputError
        If something else is in its place.
    """
    place = folder / LIST
    content = _content_of(place)
    if content is None and _state(place) is None:
        return frozenset()
    if content is None or not content.startswith(_HEAD):
        raise InputError(
            f"{place}: wanted the list of what domesim wrote there, got something else. Rename it, "
            "or choose another folder."
        )
    return frozenset(content.splitlines(keepends=True))


# Files.


def write_whole(path: Path, content: bytes) -> None:
    """Put `content` at `path`: under a temporary name beside it, then renamed.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_together([(path, content)])


def write_together(contents: Sequence[tuple[Path, bytes]]) -> None:
    """Put each content at its path: all under temporary names first, then renamed.

    A full disk or an interruption thus leaves all the old files or, from the first renaming on,
    which takes no space and next to no time, some new ones beside old ones; never half a file.

    Raises
    ------
    InputError
        If one of them cannot be written: `NoPlaceError` if others could not be, either.
    """
    temporaries: list[Path] = []
    with _tidied(temporaries):
        for path, content in contents:
            temporaries.append(temporary_of(path))
            with _told(path), os.fdopen(_new(temporaries[-1]), "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        digests = [
            hashlib.sha256(content).hexdigest() if _is_prepared(path) else None
            for path, content in contents
        ]
        _put([path for path, _ in contents], temporaries, digests)


def create(place: Path, content: bytes) -> None:
    """Make a file that others may look for at once: nobody sees it without its content.

    Raises
    ------
    FileExistsError
        If there is one.
    OSError
        If it cannot be made.
    """
    temporary = temporary_of(place)
    try:
        with os.fdopen(_new(temporary), "wb") as file:
            file.write(content)
        try:
            os.link(temporary, place)
        except OSError as error:
            if _state(place) is not None:  # sshfs says that it is not permitted
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from error
            if error.errno not in _NO_LINKS:
                raise
            os.close(_new(place))
            temporary.replace(place)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def written_to(path: Path) -> Iterator[Path]:
    """A file that an encoder writes by its name; it gets the name `path` if all goes well.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    temporary = temporary_of(path)
    with _tidied([temporary]):
        with _told(path):
            os.close(_new(temporary))
            yield temporary
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
                digest = _sha256(file) if _is_prepared(path) else None
        _put([path], [temporary], [digest])


def note_written(sums: Mapping[Path, str]) -> None:
    """List files that are the program's own, whoever wrote them, with their SHA-256.

    Raises
    ------
    InputError
        If one cannot be listed.
    """
    for path, digest in sums.items():
        with _told(path):
            _note(path, digest)


def temporary_of(path: Path) -> Path:
    """A name beside `path` that no other process has, on any machine, while it is written."""
    mark = f"{_machine()}-{os.getpid()}-{secrets.token_hex(8)}"
    return path.with_name(f".{path.stem}.tmp-{mark}{path.suffix}")


def sweep(folder: Path) -> None:
    """Remove what processes of this machine that are gone left half-written in `folder`."""
    names: list[str] = []
    with suppress(OSError):
        names = os.listdir(folder)  # noqa: PTH208 - a hundred thousand
    for name in names:
        match = _TEMPORARY.search(name)
        if match and match[1] == _machine() and not psutil.pid_exists(int(match[2])):
            path = folder / name
            with suppress(OSError, InputError):
                if path.is_dir():
                    remove_own(path)
                else:
                    path.unlink()


# Folders.


def make_own(folder: Path) -> None:
    """Make a folder that is the program's own with all that is in it, if it is not there.

    Raises
    ------
    InputError
        If somebody else's is there.
    OSError
        If it cannot be made.
    """
    with suppress(FileExistsError):
        folder.mkdir(parents=True)
    require_own(folder)
    with suppress(FileExistsError):
        mark_own(folder)


def mark_own(folder: Path) -> None:
    """Mark a folder as the program's own.

    Raises
    ------
    OSError
        If it cannot be marked, or is.
    """
    create(folder / LIST, _OWN)


def require_own(folder: Path) -> None:
    """Refuse a folder that is there and is somebody else's; an empty one is nobody's.

    Raises
    ------
    InputError
        If it is.
    OSError
        If it cannot be looked at.
    """
    # Looked at first: another process may mark it meanwhile
    empty = (
        folder.is_dir()
        and not folder.is_symlink()
        and all(_TEMPORARY.search(each.name) for each in folder.iterdir())
    )
    if not (empty or is_own(folder) or _state(folder) is None):
        raise InputError(
            f"{folder}: wanted a folder of domesim's own, got one that it did not make. Rename it, "
            "or choose another --out"
        )


def is_own(folder: Path) -> bool:
    """Whether the program made a folder."""
    return not folder.is_symlink() and _content_of(folder / LIST) == _OWN


def remove_own(folder: Path) -> None:
    """Remove a folder that the program made, if it is there, with all that is in it.

    Raises
    ------
    InputError
        If somebody else's is there.
    OSError
        If it cannot be removed.
    """
    require_own(folder)
    if _state(folder) is None:
        return
    gone = temporary_of(folder)
    folder.rename(gone)  # the mark goes with it: what is half removed is swept later
    for each in gone.iterdir():
        if each.name == LIST:
            continue
        if each.is_dir() and not each.is_symlink():
            shutil.rmtree(each)
        else:
            each.unlink()
    shutil.rmtree(gone)


# How.


_PLAIN = NOFOLLOW | CLOEXEC | BINARY


def _new(path: Path) -> int:
    """Descriptor of a file that nobody had."""
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _PLAIN, 0o666)


def _state(path: Path) -> _State | None:
    """What tells the file at `path` from another there, or as it was; None for none."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _followed(path: Path) -> tuple[int, int] | None:
    """Device and inode of the file that a name leads to; None for none."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


def _content_of(path: Path) -> bytes | None:
    """What a small regular file holds; None if there is none."""
    try:
        handle = os.open(path, os.O_RDONLY | NONBLOCK | _PLAIN)
    except OSError:
        return None
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_size > _LONGEST:
        os.close(handle)
        return None
    with os.fdopen(handle, "rb") as file:
        return file.read()


def _is_prepared(path: Path) -> bool:
    return path.absolute() in _prepared


def _sha256(file: BinaryIO) -> str:
    return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def _note(path: Path, digest: str) -> None:
    """Add a line to the list of a file's folder: in one step, for others may add theirs."""
    place, line = path.parent / LIST, written_sums({path.name: digest})
    if _state(place) is None:
        with suppress(FileExistsError):
            create(place, _HEAD)
    handle = os.open(place, os.O_RDWR | os.O_APPEND | NONBLOCK | _PLAIN)
    with os.fdopen(handle, "rb+", buffering=0) as file:
        if not file.read(len(_HEAD)) == _HEAD:
            raise FileExistsError(errno.EEXIST, f"another {LIST} in its folder")
        file.write(line)


def _put(paths: Sequence[Path], temporaries: Sequence[Path], digests: Sequence[str | None]) -> None:
    """Give written files their names; those with a digest are listed."""
    for path in paths:
        # Found by the renaming itself, it would come after others' renaming.
        with _told(path):
            if path.is_dir() and not path.is_symlink():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    for path, digest in zip(paths, digests, strict=True):
        if digest is not None:
            note_written({path: digest})
    for path, temporary in zip(paths, temporaries, strict=True):
        with _told(path):
            _rename(temporary, path)


def _rename(temporary: Path, path: Path) -> None:
    """Give a written file its name, unless somebody took it while the command worked."""
    said = path.absolute()
    if said not in _prepared:
        temporary.replace(path)
        return
    before, now = _prepared[said], _state(path)
    if now not in (None, before):
        raise FileExistsError(errno.EEXIST, "somebody else's file came there meanwhile")
    try:
        if now is None:
            os.link(temporary, path)
        else:
            temporary.replace(path)
    except OSError as error:
        if error.errno not in _NO_LINKS or _state(path) != now:
            raise
        temporary.replace(path)
    _prepared[said] = _state(path)


@contextmanager
def _tidied(temporaries: list[Path]) -> Iterator[None]:
    """Leave no temporary file behind, however this ends."""
    try:
        yield
    finally:
        for temporary in temporaries:
            with suppress(OSError):
                temporary.unlink()


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """What the system says while a file is written, as an `InputError`."""
    try:
        yield
    except OSError as error:
        raise _unwritten(path, error) from error


def _unwritten(path: Path, error: OSError) -> InputError:
    ways = {
        **dict.fromkeys(_FULL, "Free some space, or write elsewhere"),
        errno.ENOENT: "Create the folder first",
        errno.EISDIR: "Name a file",
        errno.EEXIST: "Choose another name",
    }
    way = ways.get(error.errno or 0, "Choose a folder that can be written to")
    kind = InputError if error.errno in _OF_ONE else NoPlaceError
    return kind(f"{path}: wanted to write it, got '{reason(error)}'. {way}.")


@cache
def _machine() -> str:
    """Returns a mark of this machine, and of the processes that this one can see there."""
    return hashlib.sha256(f"{socket.gethostname()} {processes_seen()}".encode()).hexdigest()[:4]


def processes_seen() -> str:
    """Returns a mark of the processes that this one can see: those of its container."""
    with suppress(OSError):
        return str(Path("/proc/self/ns/pid").readlink())
    return ""
