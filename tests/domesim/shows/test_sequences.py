"""Numbered files: all of them, in order, or a line that says what is missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from domesim.errors import InputError
from domesim.shows.sequences import find_frames, find_pairs, output_paths, parse_frames


def fill(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).touch()
    return folder


def numbered(folder: Path, *numbers: int) -> Path:
    return fill(folder, *(f"show.{number:04d}.exr" for number in numbers))


def found(folder: Path, pattern: str, frames: str | None = None) -> list[str]:
    paths = find_frames(folder / pattern, frames)
    assert all(path.parent == folder for path in paths)
    return [path.name for path in paths]


def refusal(pattern: Path | str, frames: str | None = None) -> str:
    with pytest.raises(InputError) as caught:
        find_frames(pattern, frames)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "pattern",
    [
        *("show.####.exr", "show.#.exr", "show.%04d.exr", "show.%d.exr", "show.@.exr"),
        *("show.@@@@.exr", "show.$F4.exr", "show.$F.exr", "show.<F4>.exr", "show.*.exr"),
    ],
)
def test_each_way_to_write_a_number_finds_all_frames_in_order(tmp_path: Path, pattern: str) -> None:
    numbered(tmp_path, 9998, 9999, 10000, 10001)  # sorted by name, 10000 comes first
    fill(tmp_path, "show.9997.png", "show2.9997.exr", "show.x.exr", "show.9997.exr.bak")
    (tmp_path / "show.9996.exr").mkdir()
    assert found(tmp_path, pattern) == [f"show.{k}.exr" for k in (9998, 9999, 10000, 10001)]


def test_padding_may_be_mixed(tmp_path: Path) -> None:
    fill(tmp_path, "a9.png", "a10.png", "a011.png")
    assert found(tmp_path, "a##.png") == ["a9.png", "a10.png", "a011.png"]


def test_a_name_is_taken_literally(tmp_path: Path) -> None:
    fill(tmp_path, "a[1]+.1.png", "a[1]+.2.png", "a1.3.png")
    assert found(tmp_path, "a[1]+.#.png") == ["a[1]+.1.png", "a[1]+.2.png"]


def test_numbers_may_be_negative(tmp_path: Path) -> None:
    fill(tmp_path, "a.-2.png", "a.-1.png", "a.0.png", "a.1.png")
    assert found(tmp_path, "a.#.png") == ["a.-2.png", "a.-1.png", "a.0.png", "a.1.png"]


@pytest.mark.parametrize("pattern", ["n-####.png", "n-%04d.png", "n-@.png", "n-*.png"])
def test_a_hyphen_is_no_minus(tmp_path: Path, pattern: str) -> None:
    fill(tmp_path, "n-0001.png", "n-0002.png", "n-0003.png")
    assert found(tmp_path, pattern) == ["n-0001.png", "n-0002.png", "n-0003.png"]
    assert found(tmp_path, pattern, "2-3") == ["n-0002.png", "n-0003.png"]
    assert f"Did you mean {tmp_path}/n-####.png?" in refusal(tmp_path)
    assert "none matches" in refusal(tmp_path / "n####.png")


@pytest.mark.parametrize(
    "name",
    [
        *(
            "dome@4k.",
            "shot#3.",
            "100%d.",
            "a*b.",
            "take$F.",
            "<b>.",
            "a<F4>.",
            "x##y@@.",
            "@",
            "#",
        ),
        *("v1-2_", "take2-"),
    ],
)
@pytest.mark.parametrize("place", ["####", "#", "@", "%04d", "$F4", "<F4>", "*"])
def test_what_comes_before_the_last_place_is_a_name(tmp_path: Path, name: str, place: str) -> None:
    if name[-1] in "@#" and place[0] == name[-1]:
        name = f"{name}_"
    names = [f"{name}0001.png", f"{name}0002.png"]
    fill(tmp_path, *names)
    assert found(tmp_path, f"{name}{place}.png") == names
    assert f"Did you mean {tmp_path}/{name}####.png?" in refusal(tmp_path / "other.####.png")


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_link_to_nothing_is_no_end_of_a_film(tmp_path: Path, lost: int) -> None:
    """As of a farm's disk that is not mounted."""
    numbered(tmp_path, *({1, 2, 3} - {lost}))
    link = tmp_path / f"show.{lost:04}.exr"
    link.symlink_to("nowhere/show.exr")
    message = refusal(tmp_path / "show.####.exr")
    assert f"got a link to nothing: {link.name} -> nowhere/show.exr" in message
    others = sorted({1, 2, 3} - {lost})
    assert len(find_frames(tmp_path / "show.####.exr", ",".join(map(str, others)))) == 2
    link.unlink()
    link.symlink_to(link)  # to itself
    assert "got a link to nothing" in refusal(tmp_path / "show.####.exr")
    link.unlink()
    (tmp_path / "elsewhere.exr").touch()
    link.symlink_to(tmp_path / "elsewhere.exr")
    assert len(find_frames(tmp_path / "show.####.exr")) == 3


def test_a_link_to_nothing_on_one_side_of_a_pair(tmp_path: Path) -> None:
    fill(tmp_path, "l.1.exr", "l.2.exr", "r.1.exr")
    (tmp_path / "r.2.exr").symlink_to("nowhere")
    with pytest.raises(InputError, match="got a link to nothing"):
        find_pairs(tmp_path / "l.#.exr", tmp_path / "r.#.exr")


def test_a_file_is_a_file_whatever_its_name(tmp_path: Path) -> None:
    numbered(tmp_path, 1, 3)
    fill(tmp_path, "a#.png")
    assert found(tmp_path, "show.0003.exr") == ["show.0003.exr"]
    assert found(tmp_path, "a#.png") == ["a#.png"]
    assert find_frames(str(tmp_path / "a#.png")) == (tmp_path / "a#.png",)


def test_frames_choose(tmp_path: Path) -> None:
    numbered(tmp_path, *range(1, 32))
    names = ["show.0001.exr", "show.0011.exr", "show.0021.exr", "show.0031.exr"]
    assert found(tmp_path, "show.####.exr", "1-31x10") == names
    assert found(tmp_path, "show.####.exr", "21,31,1-11x10") == names
    assert found(tmp_path, "show.1-31x10####.exr") == names


def test_frames_allow_for_gaps(tmp_path: Path) -> None:
    numbered(tmp_path, 1, 2, 5)
    assert found(tmp_path, "show.####.exr", "1,5") == ["show.0001.exr", "show.0005.exr"]


def test_a_gap_is_named_with_the_way_out(tmp_path: Path) -> None:
    numbered(tmp_path, 1, 2, 5, 6, 7, 8, 10)
    pattern = tmp_path / "show.####.exr"
    message = refusal(pattern)
    assert message.startswith(f"{pattern}: wanted frames 1-10, missing 3-4,9. ")
    assert message.endswith("--frames 1-2,5-8,10")
    assert len(find_frames(pattern, "1-2,5-8,10")) == 7


def test_a_gap_may_be_of_any_size(tmp_path: Path) -> None:
    fill(tmp_path, "a.1.png", "a.20261121103000.png")
    assert "missing 2-20261121102999" in refusal(tmp_path / "a.#.png")


def test_frames_that_are_not_there_are_named(tmp_path: Path) -> None:
    numbered(tmp_path, 1, 2, 3)
    message = refusal(tmp_path / "show.####.exr", "2-5")
    assert "wanted frames 2-5, missing 4-5." in message
    assert "--frames 1-3" in message


def test_one_frame_in_two_files_is_refused(tmp_path: Path) -> None:
    fill(tmp_path, "a.5.png", "a.0005.png")
    message = refusal(tmp_path / "a.#.png")
    assert "a.5.png" in message
    assert "a.0005.png" in message


def test_a_folder_is_refused_with_a_proposal(tmp_path: Path) -> None:
    assert f"such as {tmp_path}/name.####.png" in refusal(tmp_path)
    numbered(tmp_path, 1, 2, 3)
    fill(tmp_path, "notes.txt", "poster.png")
    assert f"got a folder. Did you mean {tmp_path}/show.####.exr?" in refusal(tmp_path)
    assert find_frames(tmp_path / "show.####.exr")
    fill(tmp_path, "left.1.png", "left.2.png")
    assert "Did you mean" not in refusal(tmp_path)


def test_nothing_found_is_refused(tmp_path: Path) -> None:
    assert "none matches" in refusal(tmp_path / "show.####.exr")
    assert "there is no such file" in refusal(tmp_path / "show.0001.exr")
    assert "got 'no such file or directory'" in refusal(tmp_path / "missing" / "show.####.exr")
    numbered(tmp_path, 1, 2)
    assert "Did you mean" in refusal(tmp_path / "shaw.####.exr")


def test_frames_need_a_pattern(tmp_path: Path) -> None:
    numbered(tmp_path, 1)
    assert "Leave --frames out" in refusal(tmp_path / "show.0001.exr", "1")


def test_parse_frames() -> None:
    assert tuple(parse_frames("1-3,7")) == (1, 2, 3, 7)
    assert tuple(parse_frames("1-100x10")) == tuple(range(1, 101, 10))
    for bad in ("", "x", "1-", "1-10x0", "1.5", "1-99999999999"):
        with pytest.raises(InputError, match="--frames: wanted") as caught:
            parse_frames(bad)
        assert "\n" not in str(caught.value)
        assert f"'{bad}'" in str(caught.value)


def test_output_paths(tmp_path: Path) -> None:
    sources = [fill(tmp_path, name) / name for name in ("show.0001.exr", "show.0002.exr")]
    out = tmp_path / "out"
    assert output_paths(sources, out) == (out / "show.0001.exr", out / "show.0002.exr")
    assert output_paths(sources[:1], out, ".png") == (out / "show.0001.png",)
    assert output_paths(sources[:1], tmp_path, ".png") == (tmp_path / "show.0001.png",)


def test_output_never_goes_over_the_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = fill(tmp_path, "show.0001.exr") / "show.0001.exr"
    (tmp_path / "link").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    for folder in (tmp_path, tmp_path / "link", Path(), tmp_path / "x" / ".."):
        for suffix in (None, ".exr"):
            with pytest.raises(InputError, match="got the input itself"):
                output_paths([source], folder, suffix)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/show.0001.exr").symlink_to(source)
    with pytest.raises(InputError, match="got the input itself"):
        output_paths([source], tmp_path / "out")
