"""Timed text of DCPs: its PNG pictures are overlays, on the frames and at the places it says."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from uuid import UUID

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run
from test_overlays import COLS, LINEAR, RIG, ROWS, night, title

from compensate.shows.timed_text import Place, Reel, read_reel
from domesim.errors import InputError
from domesim.frames import Frame, write_frame

COUNT, START = 5, 1001
IDS = [str(UUID(int=k, version=4)) for k in (1, 2)]
SIZES = ((6, 20), (4, 8))
"""Rows and columns of two pictures."""


def reel(*subtitles: str, rate: str = "24 1", clock: str = "24", more: str = "") -> str:
    """As ST 428-7 has it."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<SubtitleReel xmlns="http://www.smpte-ra.org/schemas/428-7/2014/DCST">
  <Id>urn:uuid:5d000000-0000-4000-8000-000000000030</Id>
  <ContentTitleText>The Night</ContentTitleText>
  <IssueDate>2026-11-28T00:00:00.000-00:00</IssueDate>
  <ReelNumber>1</ReelNumber>
  <Language>en</Language>
  <EditRate>{rate}</EditRate>
  <TimeCodeRate>{clock}</TimeCodeRate>
  {more}<SubtitleList>{"".join(subtitles)}</SubtitleList>
</SubtitleReel>
"""


def spot(
    first: str, end: str, image: str, of: str, fades: str = 'FadeUpTime="00:00:00:00" '
    'FadeDownTime="00:00:00:00"',
) -> str:  # fmt: skip
    return (
        f'<Subtitle SpotNumber="1" TimeIn="00:00:00:{first}" TimeOut="00:00:00:{end}" {fades}>'
        f"<Image {image}>{of}</Image></Subtitle>"
    )


def picture(path: Path, size: tuple[int, int], seed: int) -> np.ndarray:
    """White of any opacity; which."""
    alpha = np.random.default_rng(seed).integers(1, 256, size) / 255
    title(path, alpha)
    return alpha


@pytest.fixture
def show(tmp_path: Path) -> tuple[object, ...]:
    """Arguments for a night of five frames."""
    (tmp_path / "rig.toml").write_text(RIG)
    for number in range(START, START + COUNT):
        for view, eye in enumerate("LR"):
            path = tmp_path / f"{eye}.{number}.exr"
            write_frame(Frame(night(view), path, LINEAR, 32, floating=True), path)
    files = ("--left", f"{tmp_path}/L.####.exr", "--right", f"{tmp_path}/R.####.exr")
    scene = ("--scene", tmp_path / "rig.toml", "--method", "subtractive", "--workers", 0)
    return ("compensate", *files, *scene)


def frames(out: Path) -> np.ndarray:
    """(frame, view, row, col, 3)"""
    return np.stack([
        [oiio.ImageInput.open(str(out / f"{eye}.{START + k}.exr")).read_image("float")
         for eye in "LR"]
        for k in range(COUNT)
    ])  # fmt: skip


def laid(alpha: np.ndarray, top: int, left: int) -> np.ndarray:
    """(row, col) alpha of a whole frame."""
    whole = np.zeros((ROWS, COLS))
    whole[top : top + alpha.shape[0], left : left + alpha.shape[1]] = alpha
    return whole


def written(folder: Path, text: str, seeds: Sequence[int] = (1, 2)) -> list[np.ndarray]:
    folder.mkdir()
    (folder / "subtitles.xml").write_text(text)
    return [
        picture(folder / f"{name}.png", size, seed)
        for name, size, seed in zip(IDS, SIZES, seeds, strict=True)
    ]


def whole_pictures(folder: Path, by_frame: dict[int, tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """The same as pictures of whole frames, for each eye; the arguments that name them."""
    folder.mkdir()
    for number, pair in by_frame.items():
        for eye, alpha in zip("lr", pair, strict=True):
            title(folder / f"{eye}.{number}.png", alpha)
    return [part for eye in "lr" for part in ("--overlay", f"{folder}/{eye}.####.png")]


def test_pictures_are_shown_when_and_where_the_reel_says(run: Run, show, tmp_path: Path) -> None:
    """Frames 1 and 2 have one picture at the bottom, before the screen; frame 3 another."""
    text = reel(
        spot(
            "01",
            "03",
            'Valign="bottom" Vposition="10" Zposition="-6.25"',
            f"urn:uuid:{IDS[0]}",
        ),
        spot("03", "04", 'Halign="left" Hposition="12.5" Valign="top" Vposition="20"', IDS[1]),
    )
    one, other = written(tmp_path / "sub", text)
    # 40 - 4 - 6 rows from the top; (64 - 20) / 2 = 22, and 2 px to either side
    near = (laid(one, 30, 24), laid(one, 30, 20))
    flat = (laid(other, 8, 8),) * 2
    same = whole_pictures(tmp_path / "whole", {1002: near, 1003: near, 1004: flat})
    assert run(*show, "--overlay", tmp_path / "sub", "--out", tmp_path / "a").code == 0
    assert run(*show, *same, "--out", tmp_path / "b").code == 0
    assert run(*show, "--out", tmp_path / "none").code == 0
    timed, wanted, none = (frames(tmp_path / name) for name in ("a", "b", "none"))
    assert (timed == wanted).all()
    assert [bool((a != b).any()) for a, b in zip(timed, none, strict=True)] == [0, 1, 1, 1, 0]
    # another picture is another job
    picture(tmp_path / "sub" / f"{IDS[1]}.png", SIZES[1], 9)
    again = run(*show, "--overlay", tmp_path / "sub" / "subtitles.xml", "--out", tmp_path / "a")
    assert again.code == 2
    assert "overlay" in again.err


def test_a_part_counts_from_the_first_frame_of_the_show(run: Run, show, tmp_path: Path) -> None:
    (one, _) = written(tmp_path / "sub", reel(spot("02", "03", "", IDS[0])))
    same = whole_pictures(tmp_path / "whole", {1003: (laid(one, 17, 22),) * 2})
    part = ("--frames", "1003-1004", "--out")
    assert run(*show, "--overlay", tmp_path / "sub", *part, tmp_path / "a").code == 0
    assert run(*show, *same, *part, tmp_path / "b").code == 0
    for name in ("L.1003.exr", "R.1003.exr", "L.1004.exr"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_interops_subtitles_are_read(tmp_path: Path) -> None:
    (tmp_path / "one.png").write_bytes(b"")
    path = tmp_path / "sub.xml"
    path.write_text(
        '<?xml version="1.0"?><DCSubtitle Version="1.0"><SubtitleID>x</SubtitleID>'
        "<MovieTitle>x</MovieTitle><ReelNumber>1</ReelNumber><Language>en</Language>"
        '<Font><Subtitle SpotNumber="1" TimeIn="00:00:01:125" TimeOut="00:01:00.500" '
        'FadeUpTime="25" FadeDownTime="0">'
        '<Image HAlign="right" HPosition="5" VAlign="top" VPosition="0">one.png</Image>'
        "</Subtitle></Font></DCSubtitle>"
    )
    (found,) = read_reel(path, tmp_path / "x.0001.exr", 1).subtitles
    assert (found.first, found.end) == (36, 24 * 60 + 12)
    assert found.fades == (Fraction(24, 10), 0)
    assert found.place.corner(0, (1080, 2000), (50, 300)) == (0, 1600)


def test_times_are_those_of_the_time_code(tmp_path: Path) -> None:
    for name in IDS:
        (tmp_path / f"{name}.png").write_bytes(b"")

    def shown(**how: str) -> Reel:
        long = f'<Subtitle TimeIn="00:01:00:12" TimeOut="01:00:00:00"><Image>{IDS[0]}</Image>'
        (tmp_path / "x.xml").write_text(reel(long + "</Subtitle>", **how))
        return read_reel(tmp_path / "x.xml", tmp_path / "x.0.exr", 0)

    def range_of(found: Reel) -> tuple[int, int]:
        return found.subtitles[0].first, found.subtitles[0].end

    assert range_of(shown()) == (24 * 60 + 12, 24 * 3600)
    assert range_of(shown(rate="48 1", clock="24")) == (48 * 60 + 24, 48 * 3600)
    assert range_of(shown(rate="24000 1001")) == (24 * 60 + 12, 24 * 3600)
    # 80 ms of fades where nothing says otherwise: half a second frame
    opacities = [shown().subtitles[0].opacity(24 * 60 + k) for k in range(11, 16)]
    assert opacities == pytest.approx([0, 0, 1 / 1.92, 1, 1])
    assert [each for each, _ in shown().at(24 * 3600 - 1)] == list(shown().subtitles)
    assert not list(shown().at(24 * 3600))


@pytest.mark.parametrize(
    ("across", "down", "depth", "left", "right"),
    [
        ((1, "0"), (1, "0"), "0", (515, 900), (515, 900)),
        ((1, "0.1"), (1, "-0.1"), "0", (407, 1100), (407, 1100)),
        ((2, "0.1"), (2, "0.1"), "0", (922, 1600), (922, 1600)),
        ((0, "0.1"), (0, "0.1"), "0.01", (108, 190), (108, 210)),
    ],
)
def test_pictures_lie_where_dcp_o_matic_puts_them(across, down, depth, left, right) -> None:
    """Of 2000 x 1080 px, for a picture of 200 x 50."""
    place = Place((across[0], Fraction(across[1])), (down[0], Fraction(down[1])), Fraction(depth))
    corners = [place.corner(view, (1080, 2000), (50, 200)) for view in (0, 1)]
    assert corners == [left, right]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (reel("<Subtitle TimeIn='00:00:00:00' TimeOut='00:00:01:00'><Font><Text>Hello</Text></Font>"
              "</Subtitle>"), "wanted subtitles as PNG pictures, got text ('Hello')"),
        (reel(), "wanted subtitles, got none"),
        (reel(spot("01", "02", "", IDS[0]), rate="25 1"), None),
        (reel(spot("01", "02", "", IDS[0]), rate=""), "wanted an EditRate"),
        (reel(spot("01", "xx", "", IDS[0])), "wanted a time as TimeOut, got '00:00:00:xx'"),
        (reel(spot("01", "02", 'Vposition="120"', IDS[0])), "wanted Vposition in percent"),
        (reel(spot("01", "02", 'Halign="middle"', IDS[0])), "wanted Halign to be one of left"),
        (reel(spot("01", "02", 'VariableZ="z1"', IDS[0])), "got VariableZ"),
        (reel(spot("01", "02", "", "urn:uuid:0")), "wanted the picture 0.png beside it"),
        (reel(spot("01", "02", "", IDS[0]), more="<StartTime>01:00:00:00</StartTime>"),
         "wanted a StartTime of 00:00:00:00"),
        ("<tt xmlns='http://www.w3.org/ns/ttml'/>", "wanted a SubtitleReel"),
        ("<!DOCTYPE x><SubtitleReel/>", "got an XML of another kind"),
        ("<SubtitleReel>", "got XML that does not parse"),
    ],
)  # fmt: skip
def test_what_is_no_timed_text_is_refused(tmp_path: Path, text: str, told: str | None) -> None:
    path = tmp_path / "x.xml"
    path.write_text(text)
    picture(tmp_path / f"{IDS[0]}.png", SIZES[0], 1)
    if told is None:  # right, but for the show's rate
        assert read_reel(path, tmp_path / "x.0.exr", 0).subtitles
        return
    with pytest.raises(InputError, match=r"x\.xml: wanted") as refused:
        read_reel(path, tmp_path / "x.0.exr", 0)
    assert told in str(refused.value)


def test_a_rate_other_than_the_shows_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG)
    for view, eye in enumerate("LR"):
        path = tmp_path / f"{eye}.0001.dpx"
        writer = oiio.ImageOutput.create(str(path))
        spec = oiio.ImageSpec(COLS, ROWS, 3, "uint16")
        spec.attribute("dpx:FrameRate", 48.0)
        assert writer.open(str(path), spec)
        writer.write_image((65535 * night(view)).astype(np.uint16))
        writer.close()
    written(tmp_path / "sub", reel(spot("00", "02", "", IDS[0])))
    pair = ("--left", tmp_path / "L.0001.dpx", "--right", tmp_path / "R.0001.dpx")
    how = ("--scene", tmp_path / "rig.toml", "--out", tmp_path / "out", "--overlay")
    told = "wanted timed text of 48 frames a second as L.0001.dpx, got 24"
    run("compensate", *pair, *how, tmp_path / "sub").is_refused(told)
    (tmp_path / "sub" / "more.xml").write_text("<x/>")
    run("compensate", *pair, *how, tmp_path / "sub").is_refused("got more.xml, subtitles.xml")
    run("compensate", *pair, *how, tmp_path / "x.mxf").is_refused("got an MXF. Unwrap it")
