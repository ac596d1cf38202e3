"""A frame of another size or encoding among the others of a sequence is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store


@pytest.mark.parametrize("odd", ["size", "encoding", ""])
def test_a_frame_unlike_the_others_is_told(tmp_path: Path, out: Path, run: Run, odd: str) -> None:
    for number in (1, 2, 3):
        side = 64 if (odd, number) == ("size", 2) else 96
        store(tmp_path / f"s.{number}.png", np.full((side, side, 3), 100, np.uint8))
    if odd == "encoding":
        frame = np.full((96, 96, 3), 100, np.uint8)
        store(tmp_path / "s.2.png", frame, CICP=("int[4]", (9, 16, 0, 1)))
    outcome = run(
        *("compensate", tmp_path / "s.#.png", "--scene", "dome_hemisphere", "--out", out),
        *("--method", "none", "--workers", "0"),
    )
    report = (out / "job" / "report.html").read_text()
    told = {
        "size": "s.2.png: 64 x 64, srgb BT.709; the others 96 x 96, srgb BT.709",
        "encoding": "s.2.png: 96 x 96, st2084 BT.2020; the others 96 x 96, srgb BT.709",
    }
    for line in told.values():
        assert (line in outcome.err) == (line == told.get(odd))
        assert (line in report) == (line == told.get(odd))
