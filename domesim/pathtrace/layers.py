"""Layered EXR files: what is direct, what has bounced, and how sure each pixel is, in cd/m²."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.formats.base import writer_of
from domesim.host.writing import written_to

if TYPE_CHECKING:
    from domesim.pathtrace.observation import Observed

_STRIP = 64


def layers_of(seen: Observed, screen: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    """Layers of a traced domemaster, of light on the (row, col) `screen`, by name.

    "" is all of it but for the projectors' black; there is "ambient" where lamps are, and
    "bounce1" and so on where bounces were kept.
    """
    on = screen[..., None]
    layers = {
        "": np.where(on, seen.mean[0], 0),
        "direct": np.where(on, seen.direct[0], 0),
        "indirect": seen.indirect.mean,
        "variance": np.where(on, seen.standard_error[0] ** 2, 0),
    }
    if seen.ambient is not None:
        layers["ambient"] = seen.ambient.mean
    return layers | bounces_of(seen.indirect.bounces)


def bounces_of(bounces: NDArray[Any] | None) -> dict[str, NDArray[Any]]:
    """Layers of bounces (bounce, row, col, primary), from the first; none of None."""
    return {} if bounces is None else {f"bounce{k}": bounces[k] for k in range(1, len(bounces))}


def write_layers(
    path: Path,
    layers: Mapping[str, NDArray[Any]],
    attributes: Mapping[str, Any],
) -> None:
    """Write float32 ZIP EXR with one RGB triple a layer, whole or not at all.

    Parameters
    ----------
    path
        The ``.exr`` file.
    layers
        (row, col, primary) pictures by name; the one named "" becomes R, G, B.
    attributes
        Header entries: text, numbers, or tuples of 8 floats (chromaticities).

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path.suffix.lower() != ".exr":
        raise InputError(f"{path}: layers are written as EXR, so its name must end in .exr")
    names = [f"{name}.{part}" if name else part for name in layers for part in "RGB"]
    rows, cols, _ = next(iter(layers.values())).shape
    spec = oiio.ImageSpec(cols, rows, len(names), oiio.FLOAT)
    spec.channelnames = tuple(names)
    spec.attribute("compression", "zip")
    for key, value in attributes.items():
        if isinstance(value, tuple):
            spec.attribute(key, oiio.TypeDesc(f"float[{len(value)}]"), value)
        elif isinstance(value, int) and abs(value) >= 1 << 31:
            spec.attribute(key, str(value))  # EXR has no longer whole numbers
        else:
            spec.attribute(key, value)
    with written_to(path) as unfinished, writer_of(str(unfinished)) as output:
        written = (
            output.open(str(unfinished), spec)
            and all(_write_rows(output, layers, first) for first in range(0, rows, _STRIP))
            and output.close()
        )
        if not written:
            raise InputError(f"{path}: cannot be written ({output.geterror() or 'disk full?'})")


def _write_rows(output: Any, layers: Mapping[str, NDArray[Any]], first: int) -> bool:
    """Some rows of all layers, so that they need not be held together."""
    parts = [np.asarray(layer[first : first + _STRIP], np.float32) for layer in layers.values()]
    pixels = np.ascontiguousarray(np.concatenate(parts, axis=-1))
    return bool(output.write_scanlines(first, first + len(pixels), 0, pixels))
