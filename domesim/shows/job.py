"""A job: records of finished frames, by which a run that was killed goes on.

Beside the results, a folder ``job`` holds ``settings.json``, all that results depend on; and for
each frame a record, written after its result: its figures, the SHA-256 of master, result and
settings, and who made it with which versions. A record is one small file, so that as many machines
as wish can work on one show at once, and none needs to hear of the others (`clients` keeps those of
other settings away). Settings that some frames were made with and others not (``--mix``) are all
kept, in a folder ``settings``, by their SHA-256.

A frame is done if its record says so, its result is as it was written, byte by byte, and its master
too. Anything else is done again. Records have a checksum (`sealed`).
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError, reason
from domesim.frames.video import file_of, video_of
from domesim.host.files import read_plain
from domesim.host.writing import (
    create,
    is_listed,
    is_own,
    listed,
    make_own,
    mark_own,
    note_written,
    refuse,
    require_own,
    write_whole,
)
from domesim.shows.checksums import sha256
from domesim.shows.claims import FOLDER as CLAIMS
from domesim.shows.claims import Claims
from domesim.shows.clients import Clients, clients_of
from domesim.shows.sealed import read_sealed, write_sealed

FOLDER = "job"
"""Name of the folder, beside the results."""

_SETTINGS = "settings.json"

_PACKAGES = ("domesim", "numpy", "scipy", "openimageio", "distributed", "numba", "mkl-fft")


@final
@dataclass(frozen=True)
class Record:
    """Record of a finished frame.

    Parameters
    ----------
    figures, line, seconds
        As of `Finished`.
    sources
        Facts of each file of the master: size, time of its last change (ns), SHA-256.
    maker
        As of `Finished`.
    results
        SHA-256 of each file of the result, and then of those beside it, by their paths from the
        job's folder.
    settings
        SHA-256 of the settings it was made with.
    versions
        Versions of what made it.
    """

    figures: dict[str, Any]
    line: str
    seconds: dict[str, float]
    sources: dict[str, list[Any]]
    maker: dict[str, Any]
    results: dict[str, str] = field(default_factory=dict)
    settings: str = ""
    versions: dict[str, str] = field(default_factory=dict)


@final
@dataclass(frozen=True)
class Job:
    """One show's job.

    Parameters
    ----------
    folder
        Where its records are.
    settings
        SHA-256 of its settings.
    mixed
        Take results that were made with other settings.
    program
        What its frames are done with, as of `program_of`.
    claims
        Which frames this command does; None where nobody else can.
    """

    folder: Path
    settings: str
    mixed: bool = False
    program: str | None = None
    claims: Claims | None = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """Without the claims, which are the command's: workers are told what to do."""
        return {**vars(self), "claims": None}

    def kept(
        self, moment: Sequence[Path], output: Sequence[Path], sums: Sequence[str] = ()
    ) -> Record | str:
        """Returns the record of a finished frame; else why it is done again, "" if it is new.

        If there are `sums`, its master must have had them.

        Raises
        ------
        InputError
            If the master is not there any more.
        """
        record = self._read(output)
        if isinstance(record, str):
            return record
        if not (self.mixed or record.settings == self.settings):
            return "it was made with other settings"
        known = _named(moment)
        if set(record.sources) != set(known) or not all(
            self._unchanged(path, record.sources[name]) for name, path in known.items()
        ):
            return "its master has changed"
        if sums and [record.sources[name][2] for name in known] != list(sums):
            return "its master was not as --checksums has it"
        files = {name: self.folder / name for name in record.results}
        files |= {self._name(path): path for path in output}
        with suppress(InputError):
            if all(sha256(path) == record.results.get(name) for name, path in files.items()):
                return record
        return "its result is not as it was written"

    def _unchanged(self, path: Path, known: list[Any]) -> bool:
        """Whether a master is unchanged: by size and time, or else by content."""
        size, changed = _state(path)
        if size != known[0]:
            return False
        return bool(changed == known[1] or self._content(path, size, changed) == known[2])

    def _content(self, path: Path, size: int, changed: int) -> str:
        """SHA-256 of a master's file; of a video once for all its frames."""
        video = video_of(path)
        if video is None:
            return sha256(path)
        mark = hashlib.sha256(str(video.absolute()).encode(errors="surrogateescape")).hexdigest()
        return _video_content(video, size, changed, self.folder / f"{video.name}.{mark[:8]}.sha256")

    def record(self, output: Sequence[Path]) -> Record | None:
        """Returns the record of the frame whose result is `output`; None if none is whole."""
        record = self._read(output)
        return None if isinstance(record, str) else record

    def _read(self, output: Sequence[Path]) -> Record | str:
        """Returns the record of a frame; else why it is not used, "" if there is none."""
        try:
            return Record(**read_sealed(self._place(output)))
        except FileNotFoundError:
            return ""
        except (OSError, ValueError, TypeError):
            return "its record is damaged"

    def require_settings(self) -> None:
        """Refuses a folder whose settings have changed.

        Raises
        ------
        InputError
            If another command has changed them, which then took this one's for ended.
        """
        place = self.folder / _SETTINGS
        now = sha256(place) if place.is_file() else self.settings
        if now != self.settings and self.settings_file(now).is_file():  # else it is damaged
            raise InputError(
                f"{place}: wanted the settings that the frame was begun with, got other settings "
                f"meanwhile. Type the command again"
            )

    def recorded(self, outputs: Iterable[Sequence[Path]]) -> list[bool]:
        """Whether each of the frames with these results has a record, be it right or wrong."""
        there = {path.name for path in self.folder.glob("[!.]*.json")}
        return [self._place(output).name in there for output in outputs]

    def sources(self, moment: Sequence[Path]) -> dict[str, list[Any]]:
        """Size, time and SHA-256 of each file of a master, as of `Record`.

        Raises
        ------
        InputError
            If one cannot be read.
        """
        sources = {}
        for name, path in _named(moment).items():
            size, changed = _state(path)
            sources[name] = [size, changed, self._content(path, size, changed)]
        return sources

    def keep(
        self, output: Sequence[Path], record: Record, beside: Sequence[Path] = ()
    ) -> dict[str, str]:
        """Keep the record of a frame whose result, and files `beside` it, have been written.

        Returns
        -------
        `Record.results`.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        sums = {path: sha256(path) for path in (*output, *beside)}
        note_written(sums)
        results = {self._name(path): digest for path, digest in sums.items()}
        whole = {
            **asdict(record),
            "results": results,
            "settings": self.settings,
            "versions": versions(),
        }
        write_sealed(self._place(output), whole)
        return results

    def forget(self, output: Sequence[Path]) -> None:
        """Let a frame be done again."""
        for place in (self._place(output), self.fault(output)):
            place.unlink(missing_ok=True)

    def left_over(self, outputs: Iterable[Sequence[Path]], masters: Iterable[Path]) -> list[str]:
        """Returns the names of records of frames whose masters are not there any more.

        Parameters
        ----------
        outputs
            Results of the frames that the show has.
        masters
            Folders of its masters.
        """
        known = {output[0].name for output in outputs}
        places, left = set(masters), []
        for place in sorted(self.folder.glob("[!.]*.*.json")):
            name = place.name.removesuffix(".json")
            if name in known:
                continue
            with suppress(OSError, ValueError, TypeError):
                sources = Record(**read_sealed(place)).sources
                if not any((place / each).exists() for place in places for each in sources):
                    left.append(name)
        return left

    def remove(self, name: str) -> list[Path]:
        """Removes a left-over record and its results; returns those that were changed, and stay."""
        place = self.folder / f"{name}.json"
        results = Record(**read_sealed(place)).results
        files = {self.folder / each: digest for each, digest in results.items()}
        stay = []
        for path, digest in files.items():
            with suppress(InputError):  # it is not there
                if sha256(path) == digest:
                    path.unlink()
                else:
                    stay.append(path)
        place.unlink()
        return stay

    def settings_file(self, digest: str) -> Path:
        """Where the settings of that SHA-256 are."""
        return self.folder / "settings" / f"{digest}.json"

    def fault(self, output: Sequence[Path]) -> Path:
        """Where a fault of the program is written down, if a frame meets one."""
        return self.folder / f"{output[0].name}.fault.txt"

    def _name(self, path: Path) -> str:
        return os.path.relpath(path, self.folder)

    def _place(self, output: Sequence[Path]) -> Path:
        return self.folder / f"{output[0].name}.json"


@contextmanager
def open_job(
    out: Path, settings: dict[str, Any], *, mixed: bool = False, anew: bool = False
) -> Iterator[Job]:
    """Opens the job whose results go to the folder `out`, or makes it.

    Until it is left, no other command can change its settings.

    Parameters
    ----------
    out
        The folder; it exists.
    settings
        All that results depend on, for JSON.
    mixed
        Keep results that were made with other settings.
    anew
        Take other settings from now on; frames done with these are not done then.

    Raises
    ------
    InputError
        If the folder holds a job of other settings and neither is wanted, another command works
        there with other settings, or it cannot be written to.
    """
    text = json.dumps(settings, indent=1, sort_keys=True, allow_nan=False)
    digest = hashlib.sha256(text.encode()).hexdigest()
    job = Job(out / FOLDER, digest, mixed, settings.get("domesim"))
    with ExitStack() as stack:
        try:
            make_folder(job.folder)
            job.settings_file(digest).parent.mkdir(exist_ok=True)
            clients = stack.enter_context(clients_of(job.folder))
            there = _settle(job, text, clients, change=mixed or anew)
            job = replace(job, claims=Claims(job.folder, clients))
        except OSError as error:
            raise InputError(
                f"{job.folder}: wanted a folder for the job's records, got '{reason(error)}'. "
                f"Choose another --out"
            ) from error
        if there != text:
            others = clients.others()
            raise InputError(_refusal(out, job, there, settings, others, change=mixed or anew))
        yield job


def require_own_results(out: Path, files: Mapping[Path, str]) -> None:
    """Refuse a folder in which a job would replace somebody else's files.

    Parameters
    ----------
    out
        The folder.
    files
        All files that the job will write beside its own folder -> the name that its record has.

    Raises
    ------
    InputError
        If such a file is there without a record, a claim or a line in its folder's list, or the
        job's folder is somebody else's.
    """
    folder = out / FOLDER
    if not _is_of_before(folder):
        require_own(folder)
    there = {place: _Names(place) for place in {path.parent for path in files}}
    known = _names_in(folder) | {f"{name}.json" for name in _names_in(folder / CLAIMS)}
    others = [p for p, record in files.items() if record not in known and there[p.parent].has(p)]
    lists = {place: listed(place) for place in there}
    refuse([path for path in others if not is_listed(path, lists[path.parent])])


@final
class _Names:
    """Names in a folder, which its file system may take for others: other cases, other accents."""

    def __init__(self, folder: Path) -> None:
        names = _names_in(folder)
        self._lower = {name.lower() for name in names} if all(map(str.isascii, names)) else None

    def has(self, path: Path) -> bool:
        """Whether a file of that name is there, to the file system: it is asked of few."""
        alike = self._lower is None or not path.name.isascii() or path.name.lower() in self._lower
        return alike and os.path.lexists(path)


def _names_in(folder: Path) -> set[str]:
    with suppress(OSError):
        return set(os.listdir(folder))  # noqa: PTH208 - a hundred thousand
    return set()


def make_folder(folder: Path) -> None:
    """Make the job's own folder, or mark that of an earlier version."""
    if _is_of_before(folder):
        with suppress(FileExistsError):
            mark_own(folder)
    make_own(folder)


def _is_of_before(folder: Path) -> bool:
    """Whether an earlier version made a job's folder, which had no mark: by its settings."""
    if is_own(folder):
        return False
    with suppress(InputError, OSError):
        digest = hashlib.sha256(read_plain(folder / _SETTINGS)).hexdigest()
        return (folder / "settings" / f"{digest}.json").is_file()
    return False


def _settle(job: Job, text: str, clients: Clients, *, change: bool) -> str:
    """Give the folder the settings `text` if it has none, or if they may change and nobody works
    there; those that it has then.
    """
    place, known = job.folder / _SETTINGS, job.settings_file(job.settings)
    if not known.exists():
        write_whole(known, text.encode())
    if clients.enter_alone():
        change = change or _is_unused(job, text)
        if change and place.exists() and _text(place) != text:
            write_whole(place, text.encode())
        _create(place, known)
    clients.share()
    _create(place, known)  # who was alone may have been killed
    return _text(place)


def _is_unused(job: Job, text: str) -> bool:
    """Whether a program of another version has left its settings, and no frame."""
    try:
        there, now = (json.loads(each) for each in (_text(job.folder / _SETTINGS), text))
        alike = {**there, "domesim": ""} == {**now, "domesim": ""}
    except (OSError, ValueError, TypeError):
        return False
    return alike and not any(job.folder.glob("[!.]*.*.json"))


def _create(place: Path, known: Path) -> None:
    """Put what `known` holds at `place` if nothing is there: one step, even without locks."""
    if not place.exists():
        with suppress(FileExistsError):
            create(place, known.read_bytes())


def _text(place: Path) -> str:
    return place.read_text(errors="replace")


def _refusal(
    out: Path, job: Job, there: str, settings: dict[str, Any], others: str, *, change: bool
) -> str:
    """Why a folder's settings are not these."""
    difference = _difference(there, settings)
    if change:
        return (
            f"{out}: wanted it alone to change the job's settings ({difference}), got another "
            f"command that works there ({others or 'it does not say who'}). Wait for it, end it, "
            f"or choose another --out"
        )
    at_work = f", and a command at work ({others})" if others else ""
    way = (
        "Choose another --out, or do all frames again (--anew), or only those that are missing, "
        "beside the others (--mix)"
    )
    if not job.settings_file(hashlib.sha256(there.encode()).hexdigest()).exists():
        return f"{job.folder / _SETTINGS}: is damaged, or was edited ({difference}){at_work}. {way}"
    return f"{out}: holds a job of other settings ({difference}){at_work}. {way}"


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results are made with."""
    versions_by_name = {"python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            versions_by_name[package] = version(package)
    return versions_by_name


def _named(paths: Sequence[Path]) -> dict[str, Path]:
    """Left and right by their names, with their places where these are one."""
    if len({path.name for path in paths}) == len(paths):
        return {path.name: path for path in paths}
    return {f"{place} {path.name}": path for place, path in enumerate(paths)}


def _state(path: Path) -> tuple[int, int]:
    """Size and time of a master's file; all frames of a video have those of the video."""
    try:
        state = file_of(path).stat()
    except OSError as error:
        raise InputError(f"{path}: wanted to read it, got '{reason(error)}'") from error
    return state.st_size, state.st_mtime_ns


@lru_cache(maxsize=4)
def _video_content(video: Path, size: int, changed: int, place: Path) -> str:
    """SHA-256 of a video, which is written down at `place` for other processes."""
    with suppress(OSError, ValueError, LookupError):
        known = read_sealed(place)
        if [known["size"], known["changed"]] == [size, changed]:
            return str(known["sha256"])
    content = sha256(video)
    kept = {"video": str(video), "size": size, "changed": changed, "sha256": content}
    write_sealed(place, kept)
    return content


def _difference(before: str, settings: dict[str, Any]) -> str:
    """Difference of settings, for a person: ``method: subtractive there, perceptual now``."""
    try:
        there = json.loads(before)
    except ValueError:
        there = None
    if not isinstance(there, dict):
        return "which cannot be read"
    now = json.loads(json.dumps(settings))
    differing = [
        f"{name}: {_brief(there.get(name))} there, {_brief(now.get(name))} now"
        for name in sorted({*there, *now})
        if there.get(name) != now.get(name)
    ]
    return "; ".join(differing)


def _brief(value: Any) -> str:
    if isinstance(value, str) and len(value) == 64:
        return f"SHA-256 {value[:8]}..."
    if isinstance(value, list):
        return " and ".join(map(_brief, value))
    return "none" if value is None else str(value)
