"""Hundreds of frames leave a worker as it was."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from image_files import store

FRAMES = 500


@pytest.mark.long
def test_hundreds_of_frames_take_no_memory_handles_or_files(tmp_path: Path) -> None:
    """After the first hundred: until then libraries make themselves at home."""
    noise = np.random.default_rng(1)
    for number in range(1, FRAMES + 1):
        picture = noise.integers(0, 256, (16, 16, 3), np.uint8)
        store(tmp_path / f"in.{number:04d}.png", picture)
    scratch, out = tmp_path / "scratch", tmp_path / "out"
    scratch.mkdir()
    shared: set[str] = set()
    words = [str(tmp_path / "in.####.png"), "--scene", "dome_planetarium", "--out", str(out)]
    command = [sys.executable, "-m", "domesim", "observe", *words, "--workers", "1", "--quiet"]
    handles: dict[int, list[int]] = {}
    with subprocess.Popen(command, env={**os.environ, "TMPDIR": str(scratch)}) as run:
        while run.poll() is None:
            done = len(list((out / "job").glob("[!.]*.png.json")))
            for process in [psutil.Process(run.pid), *psutil.Process(run.pid).children()]:
                if 100 < done < FRAMES - 10:
                    handles.setdefault(process.pid, []).append(process.num_fds())
                    shared.update(each.path for each in process.memory_maps())
            time.sleep(0.5)
    assert run.returncode == 0
    records = [json.loads(path.read_text()) for path in sorted((out / "job").glob("*.png.json"))]
    assert len(records) == FRAMES
    held = [record["maker"]["resident"] for record in records]
    (early, late) = (np.median(held[first : first + 20]) for first in (100, FRAMES - 20))
    told = {pid: (min(counts), max(counts)) for pid, counts in handles.items()}
    print(f"{early / 2**20:.1f} MiB after 100, {late / 2**20:.1f} after {FRAMES}; handles {told}")
    assert late < 1.02 * early
    assert len(handles) >= 2
    for counts in handles.values():
        middle = len(counts) // 2
        assert max(counts[middle:]) <= max(counts[:middle]) + 4  # connections come and go
    # Dask's own two of a machine
    assert {path.suffix for path in scratch.rglob("*") if path.is_file()} <= {".lock"}
    assert [path for path in shared if path.startswith("/dev/shm") and Path(path).exists()] == []
    left = {path.name for path in out.rglob("*") if path.is_file()} - {
        *(
            f"in.{number:04d}.png{end}"
            for number in range(1, FRAMES + 1)
            for end in ("", ".json", ".png")
        ),
        *(
            "settings.json",
            "report.html",
            "frames.csv",
            "frames.parquet",
            "lock",
            "SHA256SUMS",
            ".domesim",
        ),
    }
    assert [name for name in left if len(name) != 64 + len(".json")] == []
