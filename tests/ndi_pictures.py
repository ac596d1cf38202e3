"""Moving pictures by NDI through ``domesim live``, in a network of their own: a program by itself.

It has loopback only (`alone`), so that nobody else's pictures come, and nobody else gets these.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from fractions import Fraction
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from compensate.live.ndi import Receiver, Sender, decoded, encoded

BITS, CELL = 5, 8
RATE = Fraction(30000, 1001)
SHOW, OUT = f"show {os.getpid()}", f"dome {os.getpid()}"
"""Names are a computer's, whatever network a program is in."""
CONFIG = {"ndi": {"networks": {"ips": "127.0.0.1"}}}
"""Without it sender and receiver do not meet on loopback."""


def picture(number: int, rows: int, cols: int, *, alpha: bool) -> NDArray[np.uint16]:
    """(row, col, channel) codes of a dark blue sky, a glow that moves, and the number in bars."""
    down, across = np.mgrid[:rows, :cols]
    at = cols * (0.3 + 0.4 * (number % 32) / 32)
    glow = np.exp(-((across - at) ** 2 + (down - rows * 0.4) ** 2) / (rows * cols / 80))
    pixels = np.stack([150 * glow, 140 * glow, 27 + 120 * glow], axis=-1)
    left, top = (cols - BITS * CELL) // 2, rows * 3 // 4
    for bit in range(BITS):
        code = 235 if number >> bit & 1 else 0
        pixels[top : top + CELL, left + bit * CELL : left + (bit + 1) * CELL] = code
    opaque = across[..., None] * 255.0 / cols
    parts = [pixels, opaque] if alpha else [pixels]
    return np.rint(np.concatenate(parts, -1)).astype(np.uint16) * np.uint16(257)


def number_of(pixels: NDArray[np.uint16]) -> int:
    """Which picture it is, of 32."""
    rows, cols = pixels.shape[:2]
    left, top = (cols - BITS * CELL) // 2, rows * 3 // 4
    middles = [
        pixels[top + 2 : top + CELL - 2, left + bit * CELL + 2 : left + (bit + 1) * CELL - 2, 1]
        for bit in range(BITS)
    ]
    return sum(int(middle.mean() > 0.4 * 65535) << bit for bit, middle in enumerate(middles))


def lines_of(codes: NDArray[np.uint8], shape: tuple[int, int], *, alpha: bool) -> Any:
    """Code values of what `encoded` makes."""
    rows, cols = shape
    packed = codes[: 2 * rows * cols].reshape(rows, 2 * cols)
    return decoded(packed, codes[2 * rows * cols :].reshape(rows, cols) if alpha else None)


class Sending:
    """Sends numbered pictures until it is closed, and again when it is started again."""

    def __init__(self, rows: int, cols: int, *, alpha: bool, rate: float) -> None:
        self._like: Any = SimpleNamespace(shape=(rows, cols), alpha=alpha, rate=RATE)
        self._shown = [encoded(picture(k, rows, cols, alpha=alpha)) for k in range(1, 32)]
        self._wait = 1 / rate
        self.start()

    def start(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        with Sender(SHOW, self._like) as sender:
            for codes in cycle(self._shown):
                sender.send(codes)
                if self._over.wait(self._wait):
                    return

    def close(self) -> None:
        self._over.set()
        self._thread.join()


def taken(receiver: Receiver, count: int) -> list[NDArray[np.uint16]]:
    """So many pictures of a receiver."""
    found = []
    for pixels in receiver.pictures():
        found.append(pixels)
        if len(found) == count:
            break
    return found


def address_of(pid: int, ended: threading.Event) -> str:
    """Where a program's source is: without Avahi no list has those of two programs.

    Of its two ports the lower one is for lists, and everybody's.
    """
    while not ended.wait(0.1):
        ports = {
            each.laddr.port
            for each in psutil.net_connections("tcp")
            if each.pid == pid and each.status == psutil.CONN_LISTEN
        }
        if len(ports) > 1:
            return f"127.0.0.1:{max(ports)}"
    raise TimeoutError("no source")


def main(scene: str, out: str, rows: int, cols: int, alpha: bool, rate: float, count: int) -> None:
    """Sends, compensates and receives; stores what came."""
    live_command = [sys.executable, "-m", "domesim", "live", "--scene", scene]
    # The first start compiles its loops for a minute or two, which is no waiting for a source
    subprocess.run(
        [*live_command, "--size", f"{cols}x{rows}"], input=b"", capture_output=True, check=True
    )
    ended = threading.Event()
    timer = threading.Timer(100, ended.set)
    timer.daemon = True
    timer.start()
    sending = Sending(rows, cols, alpha=alpha, rate=rate)
    told: list[str] = []
    facts: dict[str, Any] = {}
    command = [*live_command, "--ndi-in", SHOW, "--ndi-out", OUT, "--json"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as live:
        try:
            with Receiver(address_of(live.pid, ended), ended, told.append) as receiver:
                assert receiver.connect()
                made = taken(receiver, count)
                facts |= {"made_rate": float(receiver.rate), "made_alpha": receiver.alpha}
        finally:
            live.send_signal(signal.SIGINT)
            facts["said"] = live.communicate(timeout=60)[1]
    facts["code"] = live.returncode
    with Receiver(SHOW, ended, told.append) as receiver:
        assert receiver.connect()
        straight = taken(receiver, 3)
        facts |= {"rate": float(receiver.rate), "alpha": receiver.alpha}
        sending.close()  # it goes away
        threading.Timer(3, sending.start).start()
        later = taken(receiver, 3)
    sending.close()
    timer.cancel()
    facts["told"] = [line.replace(SHOW, "show") for line in told]
    np.savez(out, straight=straight, made=made, later=later, facts=json.dumps(facts))


def alone(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs this program in a network namespace that has loopback only."""
    (folder / "ndi-config.v1.json").write_text(json.dumps(CONFIG))
    words = " ".join(map(str, arguments))
    return subprocess.run(
        ["unshare", "-rn", "sh", "-c", f"ip link set lo up && exec {sys.executable} {words}"],
        env={**os.environ, "NDI_CONFIG_DIR": str(folder), "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )


if __name__ == "__main__":
    place, result, *numbers = sys.argv[1:]
    main(
        place,
        result,
        int(numbers[0]),
        int(numbers[1]),
        numbers[2] == "alpha",
        float(numbers[3]),
        int(numbers[4]),
    )
