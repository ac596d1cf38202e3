"""Masters as OpenImageIO alone stores them: domesim would not write some of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from image_files import save

from domesim.host.writing import LIST

SIDE = 32


def written(folder: Path) -> list[str]:
    """All that is in `folder`, hidden files too, but for a job's records and lists of files."""
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.name != LIST)
    return sorted(str(path) for path in found if path.parts[0] != "job")


def picture(rows: int = SIDE, cols: int = SIDE, seed: int = 3) -> np.ndarray:
    return (0.6 * np.random.default_rng(seed).random((rows, cols, 3))).astype(np.float32)


def store(path: Path, samples: np.ndarray | None = None, kind: str = "half") -> Path:
    """An image file of samples of a `kind`."""
    samples = picture() if samples is None else samples
    return save(path, (oiio.ImageSpec(*samples.shape[1::-1], samples.shape[2], kind), samples))


def with_sample(path: Path, value: float) -> Path:
    """An EXR with four samples of `value`, the first at row 4, col 20, G."""
    samples = picture()
    samples[4, 20, 1] = samples[5, 20] = value
    return store(path, samples, "float")


def sequence(folder: Path, count: int) -> Path:
    """Numbered EXRs, one file under all names, and their pattern."""
    folder.mkdir()
    first = store(folder / "show.0001.exr")
    for number in range(2, count + 1):
        os.link(first, folder / f"show.{number:04d}.exr")
    return folder / "show.####.exr"


def touched(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def truncated(path: Path) -> Path:
    """A part of `path`; other names of the file keep the whole."""
    content = path.read_bytes()
    path.unlink()
    return touched(path, content[: len(content) * 2 // 3])
