"""Files are written whole or not at all, and over nobody else's."""

from __future__ import annotations

import ast
import errno
import os
import secrets
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest

from domesim.errors import InputError
from domesim.host.files import KEPT_OPEN
from domesim.host.writing import (
    LIST,
    create,
    is_own,
    make_own,
    note_written,
    prepare,
    remove_own,
    require_own,
    sweep,
    temporary_of,
    write_together,
    write_whole,
    written_to,
)

ROOT = Path(__file__).parents[3]
THEIRS = "somebody else's"


@pytest.fixture(autouse=True)
def _a_command() -> Iterator[None]:
    yield
    KEPT_OPEN.close()


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_was_prepared_is_listed_and_replaced_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    for content in (b"1", b"2", b"3"):
        prepare(path)
        write_whole(path, content)
        write_whole(path, content + b"again")
        KEPT_OPEN.close()
    assert path.read_bytes() == b"3again"
    assert left(path.parent) == [LIST, "a.txt"]
    prepare(path)
    with written_to(path) as unfinished:
        unfinished.write_bytes(b"encoded")
    prepare(path)
    assert path.read_bytes() == b"encoded"


@pytest.mark.parametrize("overwrite", [None, False])
def test_others_files_are_refused_whatever_they_are(tmp_path: Path, overwrite: bool | None) -> None:
    """They were never written by the program, were edited since, or are links."""
    never, edited, link = (tmp_path / name for name in ("never", "edited", "link"))
    prepare(edited, link)
    write_together([(edited, b"as written"), (link, b"as written")])
    never.write_text(THEIRS)
    edited.write_bytes(b"as written, and edited")
    target = tmp_path / "target"
    link.rename(target)
    link.symlink_to(target)
    for path in (never, edited, link):
        with pytest.raises(InputError, match=f"{path.name}: wanted a free place"):
            prepare(path, overwrite=overwrite)
    with pytest.raises(InputError, match="never and 2 more: wanted"):
        prepare(never, edited, link, overwrite=overwrite)
    prepare(never, edited, link, overwrite=True)
    write_together([(path, b"mine") for path in (never, edited, link)])
    assert target.read_bytes() == b"as written"


def test_an_input_is_never_replaced(tmp_path: Path) -> None:
    """By its device and inode: mounted or linked elsewhere, it has another path."""
    source = tmp_path / "scene.toml"
    prepare(source)
    write_whole(source, b"of the program")
    (tmp_path / "elsewhere").mkdir()
    other = tmp_path / "elsewhere" / "scene.toml"
    os.link(source, other)
    for path in (source, other):
        with pytest.raises(InputError, match="got the input itself"):
            prepare(path, inputs=[None, "dome_imax", source], overwrite=True)


def test_a_file_that_comes_meanwhile_stays(tmp_path: Path) -> None:
    new, old = tmp_path / "new", tmp_path / "old"
    prepare(old)
    write_whole(old, b"mine")
    prepare(new, old)
    for path in (new, old):
        path.write_text(THEIRS)
        with pytest.raises(InputError, match="came there meanwhile"):
            write_whole(path, b"result")
        assert path.read_text() == THEIRS
    assert left(tmp_path) == [LIST, "new", "old"]


@pytest.mark.parametrize("how", ["whole", "encoder"])
def test_no_link_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    """Even if somebody foresaw the name of the unfinished file."""
    monkeypatch.setattr(secrets, "token_hex", lambda count: "0" * 2 * count)
    victim, path = tmp_path / "victim", tmp_path / "a.exr"
    victim.write_text(THEIRS)
    temporary_of(path).symlink_to(victim)
    write = {"whole": lambda: write_whole(path, b"result"), "encoder": written_to(path).__enter__}
    with pytest.raises(InputError, match=r"a\.exr: wanted to write it"):
        write[how]()
    assert victim.read_text() == THEIRS
    assert not path.exists()


def test_names_of_unfinished_files_cannot_be_foreseen(tmp_path: Path) -> None:
    assert len({temporary_of(tmp_path / "a.exr") for _ in range(1000)}) == 1000


def test_an_encoder_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with suppress(ValueError), written_to(tmp_path / "a.exr") as unfinished:
        unfinished.write_bytes(b"half")
        raise ValueError
    assert left(tmp_path) == []


def test_lists_and_marks_are_whole_when_they_are_first_seen(tmp_path: Path) -> None:
    """Threads that list their files at once, and make the same folder, see no list without head."""
    for number in range(200):
        folder = tmp_path / str(number)

        def note(name: str, folder: Path = folder) -> None:
            make_own(folder / "own")
            note_written({folder / name: "0" * 64})

        with ThreadPoolExecutor(4) as pool:
            list(pool.map(note, "abcd"))
        assert len((folder / LIST).read_text().splitlines()) == 5
        assert not list(folder.glob("*.tmp-*"))


@pytest.mark.parametrize("content", ["", "something else\n", "folder", "pipe"])
def test_a_list_of_somebody_else_stays(tmp_path: Path, content: str) -> None:
    place = tmp_path / LIST
    if content == "folder":
        place.mkdir()
    elif content == "pipe":
        os.mkfifo(place)
    else:
        place.write_text(content)
    with pytest.raises(InputError, match="wanted the list of what domesim wrote"):
        prepare(tmp_path / "a")
    assert left(tmp_path) == [LIST]


def test_folders_of_somebody_else_are_not_removed(tmp_path: Path) -> None:
    theirs, empty, own, link = (tmp_path / name for name in ("theirs", "empty", "own", "link"))
    (theirs / "deep").mkdir(parents=True)
    (theirs / LIST).write_text("a list of theirs")
    empty.mkdir()
    make_own(own)
    (own / "sub").mkdir()
    (own / "sub" / "file").write_text("made")
    (own / "to theirs").symlink_to(theirs)
    link.symlink_to(own)
    for folder in (theirs, link):
        for harm in (remove_own, require_own, make_own):
            with pytest.raises(InputError, match="got one that it did not make"):
                harm(folder)
    make_own(empty)
    assert is_own(empty)
    make_own(own)
    remove_own(own)
    remove_own(tmp_path / "none")
    assert left(tmp_path) == ["empty", "link", "theirs"]
    assert left(theirs) == [LIST, "deep"]


def test_half_a_folder_of_a_killed_command_is_removed_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getpid", lambda: 2**22 - 1)
    made, theirs = temporary_of(tmp_path / "study"), temporary_of(tmp_path / "other")
    make_own(made)
    (made / "pictures").mkdir()
    theirs.mkdir()
    (theirs / "file").write_text(THEIRS)
    sweep(tmp_path)
    assert left(tmp_path) == [theirs.name]


def test_trees_are_removed_in_one_place() -> None:
    """And files are opened to be written in one, but for what is in a folder of its own."""
    removing = {"rmtree", "removedirs"}
    found = set()
    for package in ("domesim", "compensate", "scenes", "testing", "validation"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                name = getattr(node, "attr", getattr(node, "id", None))
                if isinstance(node, ast.Attribute | ast.Name) and name in removing:
                    found.add(str(path.relative_to(ROOT)))
    assert found == {"domesim/host/writing.py"}


@pytest.mark.parametrize("refused", [errno.EPERM, errno.ENOTSUP])
@pytest.mark.parametrize("is_there", [False, True])
def test_without_links_no_file_of_another_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: int, is_there: bool
) -> None:
    """Some file systems have none; sshfs says so, too, where a file has come meanwhile."""
    made, path = tmp_path / "settings", tmp_path / "result"
    prepare(path)

    def link(source: Path, target: Path) -> None:
        if is_there and Path(target).name != LIST:
            Path(target).write_text(THEIRS)
        raise OSError(refused, os.strerror(refused))

    monkeypatch.setattr(os, "link", link)
    with pytest.raises(FileExistsError) if is_there else nullcontext():
        create(made, b"ours")
    with pytest.raises(InputError, match="wanted to write it") if is_there else nullcontext():
        write_whole(path, b"ours")
    assert made.read_text() == path.read_text() == (THEIRS if is_there else "ours")
