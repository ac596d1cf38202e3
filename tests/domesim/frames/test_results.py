"""What a command wrote is looked at: a file that does not open never keeps its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store

from domesim.frames import Master
from domesim.shows import work


@pytest.mark.parametrize("command", ["observe", "compensate"])
def test_a_file_that_does_not_open_never_keeps_its_name(
    tmp_path: Path, out: Path, run: Run, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """As when an encoder reports success and has written half a file."""

    def write_half(master: Master, paths: tuple[Path, ...], **options: object) -> None:
        whole = master.path.read_bytes()
        paths[0].write_bytes(whole[: len(whole) // 2])

    source = store(tmp_path / "in.exr", np.full((32, 32, 3), 0.2, np.float16))
    monkeypatch.setattr(work, "write_master", write_half)
    options = ["--method", "subtractive"] if command == "compensate" else []
    result = run(command, source, "--scene", "dome_hemisphere", "--out", out, *options)
    result.is_refused("in.exr", "wanted")
    assert not (out / "in.exr").exists()
