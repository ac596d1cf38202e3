"""What is no pair is refused, or asked about, once and before any frame is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from command_line import Outcome, Run
from image_files import store

from domesim.shows import first_look
from domesim.shows.show import Show
from testing.content.stereo import PAIRS

HOW = ("--scene", "stereo_spectral", "--method", "none", "--workers", 0)
COUNT = 12
CODED = 1 / 2.6

Said = Mapping[str, object]
RATE_24 = {"dpx:FrameRate": ("float", 24.0)}
LEGAL = {"dpx:LowData": ("uint", 16 << 8), "dpx:HighData": ("uint", 235 << 8)}


def code(hour: int) -> Said:
    return {"smpte:TimeCode": ("timecode", (hour << 24, 0))}


@pytest.fixture(scope="module")
def street() -> np.ndarray:
    return np.asarray(PAIRS["night street"](192), np.float32)


def written(folder: Path, light: np.ndarray, says: Said | None = None) -> str:
    """A view's frames, each a little brighter than the one before; the pattern."""
    folder.mkdir()
    for number in range(COUNT):
        codes = np.clip(light * (1 + 0.01 * number), 0, 1) ** CODED
        path = folder / f"x.{number:04d}.dpx"
        store(path, np.rint(1023 * codes).astype(np.uint16) << 6, **(says or {}))
    return str(folder / "x.####.dpx")


def asked(run: Run, folder: Path, left: str, right: str, *more: object) -> Outcome:
    out = folder / "out"
    return run("compensate", "--left", left, "--right", right, *HOW, "--out", out, *more)


def nothing_done(folder: Path) -> bool:
    return not (folder / "out").exists()


FAULTS: Mapping[str, tuple[Said, Said, str]] = {
    "ranges": ({}, LEGAL, "wanted one range of left and right, got full and legal"),
    "rates": (
        RATE_24,
        {"dpx:FrameRate": ("float", 25.0)},
        "got 24 and 25 frames a second",
    ),
    "time codes": (code(1), code(2), "got time codes 01:00:00:00 and 02:00:00:00"),
    "encodings": ({}, {"dpx:Transfer": "Linear"}, "wanted one encoding of left and right"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_headers_that_disagree_are_refused(run: Run, street, tmp_path: Path, fault: str) -> None:
    of_left, of_right, told = FAULTS[fault]
    left = written(tmp_path / "L", street[0], of_left)
    right = written(tmp_path / "R", street[1], of_right)
    asked(run, tmp_path, left, right).is_refused(told)
    asked(run, tmp_path, left, right, "--as-given").is_refused(told)
    assert nothing_done(tmp_path)


def test_a_missing_packing_is_told_once(run: Run, street, tmp_path: Path) -> None:
    both = written(tmp_path / "both", np.concatenate(list(street), axis=1))
    run("compensate", both, *HOW, "--out", tmp_path / "out").is_refused("got one pict", "--packing")
    assert nothing_done(tmp_path)


def test_identical_eyes_are_asked_about(run: Run, street, tmp_path: Path) -> None:
    left, right = (written(tmp_path / eye, street[0]) for eye in "LR")
    asked(run, tmp_path, left, right).is_refused("got the same image twice", "--as-given")
    assert nothing_done(tmp_path)
    assert asked(run, tmp_path, left, right, "--as-given").code == 0


def test_an_exposure_is_asked_about(run: Run, street, tmp_path: Path) -> None:
    left = written(tmp_path / "L", street[0])
    right = written(tmp_path / "R", street[1] / 2)
    told = ("wanted left and right of one exposure, got left ", "times as bright as right")
    asked(run, tmp_path, left, right).is_refused(*told, "--as-given")
    asked(run, tmp_path, right, left, "--dry-run").is_refused(
        "got right ", "times as bright as left"
    )
    assert nothing_done(tmp_path)
    assert asked(run, tmp_path, left, right, "--as-given").code == 0


def test_exchanged_eyes_are_asked_about(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    light = np.asarray(PAIRS["snow"](512), np.float32)
    left, right = (written(tmp_path / eye, view) for eye, view in zip("LR", light, strict=True))
    swapped = asked(run, tmp_path, right, left)
    swapped.is_refused("left and right look exchanged", "--as-given")
    assert nothing_done(tmp_path)
    assert asked(run, tmp_path, left, right, "--frames", "0-1").code == 0


def test_a_damaged_frame_is_no_reason_to_refuse_a_show(run: Run, street, tmp_path: Path) -> None:
    left, right = (written(tmp_path / eye, view) for eye, view in zip("LR", street, strict=True))
    (tmp_path / "L" / "x.0000.dpx").write_bytes(b"SDPX")
    told = asked(run, tmp_path, left, right)
    assert told.code == 2
    assert "x.0000.dpx" in told.err
    assert len(list((tmp_path / "out").glob("**/x.*.dpx"))) == 2 * (COUNT - 1)


@pytest.fixture
def looked(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The masters that are read from now on."""
    found: list[Path] = []
    read: Callable[..., object] = Show.read

    def counted(show: Show, moment: tuple[Path, ...], **how: bool) -> object:
        found.append(moment[0])
        return read(show, moment, **how)

    monkeypatch.setattr(first_look.Show, "read", counted)
    return found


def test_a_job_that_goes_on_does_not_look_again(
    run: Run, street, tmp_path: Path, looked: list[Path]
) -> None:
    left, right = (written(tmp_path / eye, view) for eye, view in zip("LR", street, strict=True))
    few = ("--frames", "0-2")
    assert asked(run, tmp_path, left, right, *few).code == 0
    assert len(looked) == 3 + 3
    assert asked(run, tmp_path, left, right).code == 0
    assert len(looked) == 6 + first_look.FRAMES + COUNT - 3
    (tmp_path / "out" / "job" / "x.0004.dpx.json").unlink()
    assert asked(run, tmp_path, left, right).code == 0
    assert looked[6 + first_look.FRAMES + COUNT - 3 :] == [tmp_path / "L" / "x.0004.dpx"]
