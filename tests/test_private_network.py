"""The commands of docs/shows.md for several machines on a private network, on one machine."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from documented import blocks
from image_files import store


@pytest.mark.long
def test_three_commands_are_all(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    (tmp_path / "masters").mkdir()
    for number in (1, 2, 3):
        store(tmp_path / f"masters/show.{number:04}.exr", np.full((48, 48, 3), 0.1 * number))
    (told,) = (each.text for each in blocks("docs/shows.md") if "dask worker tcp" in each.text)
    told = told.replace("10.0.0.1", "127.0.0.1").replace("8786", port)
    told = told.replace("--nworkers 8", "--nworkers 1")
    *daemons, command = told.splitlines()
    programs = str(Path(sys.executable).parent)
    environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    with ExitStack() as stack:
        for line in daemons:
            running = subprocess.Popen(
                ["bash", "-c", f"exec {line}"],
                env=environment,
                cwd=tmp_path,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            stack.callback(running.wait, 30)
            stack.callback(running.send_signal, signal.SIGINT)
        for _ in range(300):
            with socket.socket() as there:
                if there.connect_ex(("127.0.0.1", int(port))) == 0:
                    break
            time.sleep(0.1)
        done = subprocess.run(
            ["bash", "-c", command],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert "3 of 3 frames are done" in done.stdout + done.stderr
    assert len(list((tmp_path / "projected").glob("show.*.exr"))) == 3
