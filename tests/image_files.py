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
    say(spec, **attributes)
    return save(path, (spec, samples))


def say(spec: oiio.ImageSpec, **attributes: object) -> None:
    """Attributes of a file; of another type than that of the value as (type, value)."""
    for name, value in attributes.items():
        key = name.replace("__", ":")
        if isinstance(value, tuple):
            spec.attribute(key, oiio.TypeDesc(value[0]), value[1])
        else:
            spec.attribute(key, value)


def save(path: Path, *parts: tuple[oiio.ImageSpec, np.ndarray]) -> Path:
    """Write an image, or an EXR of several parts, by OpenImageIO alone."""
    writer = oiio.ImageOutput.create(str(path))
    specs = tuple(spec for spec, _ in parts)
    assert writer.open(str(path), specs[0] if len(specs) == 1 else specs), writer.geterror()
    for k, (spec, samples) in enumerate(parts):
        assert k == 0 or writer.open(str(path), spec, "AppendSubimage"), writer.geterror()
        assert writer.write_image(np.ascontiguousarray(samples)), writer.geterror()
    assert writer.close()
    writer.geterror()
    return path
