"""Image files by OpenImageIO alone, without the project's own writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813


def store(path: Path, samples: np.ndarray, channels: str = "", **attributes: object) -> Path:
    """Write `samples` (row, col, channel) by OpenImageIO alone."""
    kind = {"float16": "half", "float32": "float"}.get(str(samples.dtype), str(samples.dtype))
    rows, cols, count = samples.shape
    spec = oiio.ImageSpec(cols, rows, count, kind)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    if channels:
        spec.channelnames = tuple(channels.split(","))
        spec.alpha_channel = spec.channelindex("A")
    for name, value in attributes.items():
        key = name.replace("__", ":")
        if isinstance(value, tuple):
            spec.attribute(key, oiio.TypeDesc(value[0]), value[1])
        else:
            spec.attribute(key, value)
    save(path, spec, samples)
    return path


def save(path: Path, spec: oiio.ImageSpec, samples: np.ndarray) -> None:
    writer = oiio.ImageOutput.create(str(path))
    assert writer.open(str(path), spec), writer.geterror()
    assert writer.write_image(np.ascontiguousarray(samples)), writer.geterror()
    assert writer.close()
    writer.geterror()
