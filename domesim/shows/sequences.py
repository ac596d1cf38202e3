"""Sequences: which files a numbered pattern such as ``show.####.exr`` means, in order.

Of a stereo show in two sequences, files of one number belong together.

A missing frame is an error, not a shorter film: a producer who rendered 5 000 frames wants to hear
of the one that is not there before the night's run, and says `frames` when a part is meant.

The number in a name may have any count of digits, so that ``show.9.png`` and ``show.10.png`` are
one sequence, and so are ``show.9999.png`` and ``show.10000.png``. It is the last one that a pattern
has a place for: ``dome@4k.####.png`` has an @ in its name. It is negative only behind a point or an
underscore, for ``n-0001.png`` is no frame -1.
"""

from __future__ import annotations

import re
import stat
from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from domesim.errors import InputError, reason
from domesim.frames.video import eye_of, file_of, frame_paths, is_picture, is_video, video_of

OF_VIDEO = ".png"
"""Suffix of the results for frames of a video: its integers and its encoding fit."""


def find_frames(pattern: str | Path, frames: str | None = None) -> tuple[Path, ...]:
    """The files that `pattern` means, by frame number.

    Parameters
    ----------
    pattern
        An existing file, or a numbered pattern: ``show.####.exr``, ``show.%04d.exr``,
        ``show.@.png``, ``show.$F4.exr``, ``show.<F4>.exr``, ``show.*.exr``; or a video, whose
        frames are numbered from 1, or one of these: ``film.mov/film.0012.mov``.
    frames
        Which frames, such as ``1-100x10`` (see `parse_frames`); all that there are if None.

    Raises
    ------
    InputError
        If `pattern` is a folder (but of a DCP), there is no such file or no frame, two files have
        one number, or frames are missing: in a gap if `frames` is None, else of those in `frames`;
        or are links to nothing.
    """
    return tuple(_find(Path(pattern), frames).values())


def files_by_number(pattern: str | Path) -> tuple[tuple[int | None, Path], ...]:
    """The files that `pattern` means, with their frames' numbers, of which any may be missing.

    Parameters
    ----------
    pattern
        As for `find_frames`; of videos it is not taken.

    Returns
    -------
    files
        By number; None is that of a single file.

    Raises
    ------
    InputError
        If there is no such file, or no frame.
    """
    path = Path(pattern)
    kind, numbered = _kind(path), _numbered(path)
    if numbered is None or kind == "file":
        return ((None, _single(path, kind, None)),)
    return tuple(sorted(_on_disk(path, numbered).items()))


def number_of(frame: Path) -> int | None:
    """The number of a sequence's frame: the last one in its name; None if it has none."""
    found = _LAST_NUMBER.search(frame.stem)
    return None if found is None else int(found[0])


def find_moments(pattern: str | Path, frames: str | None = None) -> tuple[tuple[Path, ...], ...]:
    """The files of each moment: one of `find_frames`, or left and right of a DCP of two eyes.

    Raises
    ------
    InputError
        As for `find_frames`.
    """
    video = _video_at(Path(pattern))
    if video is None or not eye_of(frame_paths(video)[0]):
        return tuple((path,) for path in find_frames(pattern, frames))
    paths = frame_paths(video)
    pairs = zip(paths[: len(paths) // 2], paths[len(paths) // 2 :], strict=True)
    chosen = _chosen(video, dict(enumerate(pairs, 1)), frames)
    return tuple(chosen.values())


def find_pairs(
    left: str | Path, right: str | Path, frames: str | None = None
) -> tuple[tuple[Path, Path], ...]:
    """The files of a left and a right sequence that belong together, by frame number.

    Parameters
    ----------
    left, right
        Two existing files, or two numbered patterns, as for `find_frames`.
    frames
        Which frames of both, as for `find_frames`.

    Raises
    ------
    InputError
        As for `find_frames`; if one is a file and the other a pattern; or if one has frames that
        the other has not.
    """
    sides = _find(Path(left), frames), _find(Path(right), frames)
    single = [None in side for side in sides]
    if any(single) and not all(single):
        raise InputError(
            f"{left} and {right}: wanted two files or two numbered patterns, got one of each. "
            "Write the frame's number as #### in both (show.####.exr)."
        )
    if any(single):
        _refuse_other_number(Path(left), Path(right))
    else:
        _refuse_unmatched(f"{left} and {right}", *({*side} for side in sides))
    return tuple((sides[0][number], sides[1][number]) for number in sides[0])


def parse_frames(text: str) -> Collection[int]:
    """The frame numbers that `text` names: ``1-5``, ``1-100x10`` (every tenth), ``1-3,7``.

    Raises
    ------
    InputError
        If `text` names no frames.
    """
    import fileseq  # noqa: PLC0415 - sixty modules

    # fileseq also knows frames such as 1.5, and reads "" as no frame.
    numbers: Collection[int]
    try:
        numbers = fileseq.FrameSet(text)
    except ValueError:
        numbers = ()
    if not numbers or not all(isinstance(number, int) for number in numbers):
        raise InputError(f"--frames: wanted frames such as 1-100, 1-100x10 or 1,4,7, got '{text}'.")
    return numbers


def ranges_of(numbers: Iterable[int]) -> str:
    """Frame numbers as one text that `parse_frames` reads: 1-3,7 for these, in any order."""
    import fileseq  # noqa: PLC0415 - as above

    return str(fileseq.framesToFrameRange(sorted(numbers)))


def source_of(pattern: Path) -> Path:
    """Normalises `pattern`: ``show.#.exr`` for ``show.####.exr``."""
    sequence = _numbered(pattern)
    if sequence is None or pattern.is_file():
        return pattern
    return pattern.with_name(f"{sequence.base}#{sequence.extension}")


def output_paths(
    sources: Sequence[Path], folder: Path, suffix: str | None = None
) -> tuple[Path, ...]:
    """Where in `folder` the results for `sources` go: under their names, with `suffix` if given.

    Raises
    ------
    InputError
        If one is one of the `sources`.
    """
    paths = tuple(folder / _output_name(source, suffix) for source in sources)
    refuse_inputs(paths, sources)
    return paths


def output_pairs(
    pairs: Sequence[tuple[Path, Path]], folder: Path, suffix: str | None = None
) -> tuple[tuple[Path, Path], ...]:
    """Where in `folder` the results for pairs of left and right go.

    Under their own names, with `suffix` if given. Where left and right are told apart by their
    folders (``L/0001.exr`` and ``R/0001.exr``), in `folder`'s subfolders ``left`` and ``right``;
    whoever writes there makes them.

    Raises
    ------
    InputError
        If two files that lie in one folder would have one result, or a result would go over one
        of the sources.
    """
    lefts, rights = ([_output_name(pair[side], suffix) for pair in pairs] for side in (0, 1))
    places = (folder, folder)
    if not set(lefts).isdisjoint(rights):
        for left, right in pairs:
            if left.parent.resolve() == right.parent.resolve():
                raise InputError(
                    f"{left} and {right}: wanted two names for two results, got "
                    f"{_output_name(left, suffix)} for both. Rename one, or keep left and right in "
                    "two folders."
                )
        places = (folder / "left", folder / "right")
    results = tuple(
        (places[0] / left, places[1] / right) for left, right in zip(lefts, rights, strict=True)
    )
    refuse_inputs(chain(*results), chain(*pairs))
    return results


def _output_name(source: Path, suffix: str | None) -> str:
    if suffix is None and video_of(source) is not None:
        suffix = OF_VIDEO
    return source.name if suffix is None else source.with_suffix(suffix).name


def refuse_inputs(results: Iterable[Path], sources: Iterable[Path]) -> None:
    """Refuse results that would go over a source, by whatever way its folder is reached.

    Raises
    ------
    InputError
        If one would.
    """

    @cache  # folders are few
    def identity(folder: Path) -> object:
        folder = folder.resolve()
        try:
            found = folder.stat()
        except OSError:  # it is not there yet
            return folder
        return found.st_dev, found.st_ino

    def place(path: Path) -> tuple[object, str]:
        # A link to the source is the source, too.
        path = path.resolve() if path.is_symlink() else path
        return identity(path.parent), path.name

    taken = {place(file_of(source)) for source in sources}
    for path in results:
        if place(path) in taken:
            raise InputError(
                f"{path}: wanted a place for the result, got the input itself. "
                "Choose another folder."
            )


def _find(path: Path, frames: str | None) -> dict[int | None, Path]:
    """Files by frame number, in order; a single file has none."""
    video = _video_at(path)
    if video is not None:
        paths = frame_paths(video)
        if eye_of(paths[0]):
            raise InputError(
                f"{path}: wanted one eye's pictures, got a DCP of left and right. Name it alone, "
                "without --left and --right, for a stereo scene."
            )
        return _chosen(video, dict(enumerate(paths, 1)), frames)
    kind = _kind(path)
    if video_of(path) is not None and path in frame_paths(path.parent):
        kind = "file"
    numbered = _numbered(path)
    if numbered is None or kind == "file":
        return {None: _single(path, kind, frames)}
    # show.1-5####.exr names its frames itself
    chosen = _chosen(path, _on_disk(path, numbered), frames or numbered.frames)
    _refuse_links_to_nothing(path, chosen)
    return chosen


def _video_at(path: Path) -> Path | None:
    """The video that `path` is, or the DCP there has; None if it is something else."""
    if _kind(path) == "folder":
        path = _picture_of(path)
    return path if is_video(path) else None


_Moment = TypeVar("_Moment", Path, tuple[Path, Path])


def _chosen(path: Path, files: dict[int, _Moment], frames: str | None) -> dict[int | None, _Moment]:
    """Moments of `frames`, or all, in order."""
    numbers = sorted(files)
    if frames:
        numbers = sorted(parse_frames(frames))
        missing = ranges_of(number for number in numbers if number not in files)
        wanted, way = frames, "choose from"
    else:
        missing = _gaps(numbers)
        wanted, way = f"{numbers[0]}-{numbers[-1]}", "name those to use:"
    if missing:
        raise InputError(
            f"{path}: wanted frames {wanted}, missing {missing}. "
            f"Render what is missing, or {way} --frames {ranges_of(files)}"
        )
    return {number: files[number] for number in numbers}


def _refuse_links_to_nothing(path: Path, files: dict[int | None, Path]) -> None:
    for number, file in files.items():
        if file.is_symlink() and not _is_file(file):
            raise InputError(
                f"{path}: wanted frame {number}, got a link to nothing: {file.name} -> "
                f"{file.readlink()}. Mount its disk, or name others: --frames"
            )


def _refuse_other_number(left: Path, right: Path) -> None:
    """Files that both end in a number of several digits are frames: they must be one moment's."""
    numbers = [re.findall(r"\d{3,}", path.stem)[-1:] for path in (left, right)]
    if all(numbers) and len({int(number) for (number,) in numbers}) > 1:
        raise InputError(
            f"{left} and {right}: wanted left and right of one moment, got frames "
            f"{int(numbers[0][0])} and {int(numbers[1][0])}. Name one frame of both, or rename "
            f"them."
        )


def _refuse_unmatched(where: str, left: set[Any], right: set[Any]) -> None:
    missing = {"left": right - left, "right": left - right}
    if not any(missing.values()):
        return
    sides = " and ".join(
        f"{ranges_of(numbers)} on the {side}" for side, numbers in missing.items() if numbers
    )
    both = ranges_of(left & right)
    way = f"name those that both have: --frames {both}" if both else "check the patterns."
    raise InputError(
        f"{where}: wanted the same frames on both sides, missing {sides}. "
        f"Render what is missing, or {way}"
    )


_Kind = Literal["file", "folder", "nothing", "device or pipe"]


def _kind(path: Path) -> _Kind:
    """Returns what kind of thing `path` is."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "nothing"
    except OSError as error:
        raise InputError(
            f"{path}: wanted to read it, got '{reason(error)}'. Check its path and permissions."
        ) from error
    if stat.S_ISREG(mode):
        return "file"
    return "folder" if stat.S_ISDIR(mode) else "device or pipe"


def _single(path: Path, kind: _Kind, frames: str | None) -> Path:
    if kind == "nothing":
        raise InputError(
            f"{path}: wanted a file or a numbered pattern, there is no such file. "
            "Check the path, or write the frame's number as #### (show.####.exr)."
        )
    if kind != "file":
        raise InputError(
            f"{path}: wanted a file or a numbered pattern, got a {kind}. Save it as a file first."
        )
    if frames is not None:
        raise InputError(
            f"{path}: wanted a numbered pattern for --frames {frames}, got one file. "
            "Leave --frames out, or write the frame's number as #### (show.####.exr)."
        )
    return path


_PLACE = re.compile(r"#+|@+|%0?[0-9]*d|\$F[0-9]*|<F[0-9]*>|\*")
_RANGE = r"-?[0-9]+(?:--?[0-9]+(?:x[0-9]+)?)?"
_RANGES = re.compile(rf"(?:^|(?<=[._])){_RANGE}(?:,{_RANGE})*$")
_LAST_NUMBER = re.compile(r"[0-9]+(?!.*[0-9])")


class _Numbered(NamedTuple):
    """A pattern, taken apart around the place of its number."""

    base: str
    frames: str  # that it names itself; "" for all
    extension: str


def _numbered(path: Path) -> _Numbered | None:
    """`path` as a pattern; None if it has no place for a number."""
    places = list(_PLACE.finditer(path.name))
    if not places:
        return None
    base, extension = path.name[: places[-1].start()], path.name[places[-1].end() :]
    named = _RANGES.search(base)
    frames = "" if named is None else named[0]
    return _Numbered(base.removesuffix(frames), frames, extension)


def _is_file(path: Path) -> bool:
    """Whether there is a file; a disk that is gone has none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _on_disk(path: Path, numbered: _Numbered) -> dict[int, Path]:
    """Each frame's file, or link to nothing, by number."""
    folder = path.parent
    sign = "-?" if numbered.base[-1:] in ("", ".", "_") else ""
    name = re.compile(f"{re.escape(numbered.base)}({sign}[0-9]+){re.escape(numbered.extension)}")
    files: dict[int, Path] = {}
    for file in _entries(folder, path):
        match = name.fullmatch(file.name)
        if match is None or not (_is_file(file) or file.is_symlink()):
            continue
        number = int(match[1])
        if number in files:
            raise InputError(
                f"{path}: wanted one file for frame {number}, got {files[number].name} and "
                f"{file.name}. Move one of them elsewhere."
            )
        files[number] = file
    if not files:
        raise InputError(f"{path}: wanted numbered frames, none matches.{_suggestion(folder)}")
    return files


def _picture_of(folder: Path) -> Path:
    """The MXF of the pictures of a DCP in a folder.

    Raises
    ------
    InputError
        If there is none, or several.
    """
    if not any((folder / name).is_file() for name in ("ASSETMAP", "ASSETMAP.xml")):
        raise _is_a_folder(folder)
    tracks = [path for path in _entries(folder, folder) if path.suffix.lower() == ".mxf"]
    pictures = [path for path in tracks if is_picture(path)]
    if len(pictures) == 1:
        return pictures[0]
    names = ", ".join(path.name for path in pictures) or "none"
    raise InputError(
        f"{folder}: wanted a DCP of one reel's picture (JPEG 2000 in MXF, not encrypted), got "
        f"{names}. Name one of its files."
    )


def _is_a_folder(folder: Path) -> InputError:
    suggestion = _suggestion(folder) or f" Name a file or a pattern such as {folder}/name.####.png"
    return InputError(f"{folder}: wanted a file or a numbered pattern, got a folder.{suggestion}")


def _entries(folder: Path, path: Path) -> list[Path]:
    """Lists a folder by name."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise InputError(
            f"{path}: wanted to look into {folder}, got '{reason(error)}'. Check the path."
        ) from error


def _suggestion(folder: Path) -> str:
    """The pattern to use, if `folder` holds exactly one sequence; else nothing."""
    digits: dict[tuple[str, str], set[str]] = defaultdict(set)
    for file in _entries(folder, folder):
        number = _LAST_NUMBER.search(file.stem)
        if number is not None and _is_file(file):
            base, rest = file.stem[: number.start()], file.stem[number.end() :]
            digits[base, f"{rest}{file.suffix}"].add(number[0])
    sequences = [(name, numbers) for name, numbers in digits.items() if len(numbers) > 1]
    if len(sequences) != 1:
        return ""
    (((base, extension), numbers),) = sequences
    name = f"{base}{'#' * min(map(len, numbers))}{extension}"
    return f" Did you mean {folder / name}?"


def _gaps(numbers: list[int]) -> str:
    """What is missing between sorted `numbers`; by ranges, for a gap may be of any size."""
    return ",".join(
        f"{before + 1}" if after - before == 2 else f"{before + 1}-{after - 1}"
        for before, after in pairwise(numbers)
        if after - before > 1
    )
