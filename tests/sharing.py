"""Whether commands that have one folder by several ways divide its frames.

Run as a program with those ways, such as the places where it is mounted: ``python sharing.py /mnt/a
/mnt/b``. On each it starts processes that claim frames as commands do, each under the name of a
machine of its own, kills one of them, and prints how often each frame was done.
"""

from __future__ import annotations

import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from domesim.host.writing import write_whole
from domesim.shows import clients
from domesim.shows.claims import Claims

FRAMES, SECONDS = 200, 0.01
BEAT, LEASE = 0.5, 6.0
"""Seconds, as of `domesim.shows.clients`: a test cannot wait for theirs."""


def work(folder: Path, log: Path) -> None:
    """Claims frames of a folder, does those that have no result, and writes down which."""
    socket.gethostname = lambda: log.name
    clients.BEAT, clients.LEASE = BEAT, LEASE
    with clients.clients_of(folder) as alive, log.open("a", buffering=1) as told:
        alive.enter_alone()
        alive.share()
        claims = Claims(folder, alive)
        left = [f"{number:04d}" for number in range(FRAMES)]
        while left:
            for name in list(left):
                if not claims.take(name):
                    continue
                if not (folder / f"{name}.json").exists():
                    told.write(f"{name}\n")
                    time.sleep(SECONDS)
                    write_whole(folder / f"{name}.json", name.encode())
                claims.give_back(name)
                left.remove(name)
            time.sleep(0.1)


def shared(ways: list[Path], *, killed: bool, seed: int = 0) -> Counter[int]:
    """How many frames were done how often, by two processes for each way."""
    folder = f"trial-{seed}-{time.time_ns()}"
    (ways[0] / folder).mkdir()
    with tempfile.TemporaryDirectory() as place:
        logs = [Path(place) / f"machine-{number}" for number in range(2 * len(ways))]
        runs = [
            subprocess.Popen([sys.executable, __file__, "--work", way / folder, log])
            for log, way in zip(logs, 2 * ways, strict=True)
        ]
        if killed:
            while not (logs[0].exists() and logs[0].read_text()):
                time.sleep(0.01)
            time.sleep(random.Random(seed).uniform(0, FRAMES * SECONDS / len(runs)))
            runs[0].send_signal(signal.SIGKILL)
        codes = [run.wait() for run in runs]
        assert codes == [-signal.SIGKILL if killed else 0] + [0] * (len(runs) - 1)
        done = Counter(name for log in logs for name in log.read_text().split())
    assert len(list((ways[0] / folder).glob("[!.]*.json"))) == len(done) == FRAMES
    return Counter(done.values())


def main() -> None:
    ways = [Path(way).absolute() for way in sys.argv[1:]]
    for killed in (False, True):
        for seed in range(3):
            done = shared(ways, killed=killed, seed=seed)
            told = ", ".join(f"{count} {often} times" for often, count in sorted(done.items()))
            print(f"{'one killed' if killed else 'none killed'}: {told}", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--work":
        work(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
