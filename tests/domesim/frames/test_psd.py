"""PSD and PSB: the flattened picture, of R, G, B without alpha, or a word."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from icc_profiles import icc_profile

from domesim.errors import InputError
from domesim.frames import read_frame

PICTURE = np.random.default_rng(63).random((10, 14, 3))
LAYER = PICTURE[2:6, 3:9] * 0.5


def psd(
    path: Path,
    samples: np.ndarray,
    *,
    mode: int = 3,
    large: bool = False,
    count: int | None = None,
    blocks: bytes = b"",
    resources: dict[int, bytes] | None = None,
) -> Path:
    """By Adobe's specification; with a layer if there is a `count` of them."""
    rows, cols, channels = samples.shape
    length = ">Q" if large else ">I"
    depth = 8 * samples.dtype.itemsize
    header = struct.pack(">4sH6xHIIHH", b"8BPS", 1 + large, channels, rows, cols, depth, mode)
    said = b"".join(
        b"8BIM" + struct.pack(">HxxI", kind, len(content)) + content + bytes(len(content) % 2)
        for kind, content in (resources or {}).items()
    )
    layers = b"" if count is None else layer(samples.dtype, count, length)
    section = struct.pack(length, len(layers)) + layers + bytes(4) + blocks
    section = section if layers or blocks else b""
    planes = np.moveaxis(samples, -1, 0).astype(samples.dtype.newbyteorder(">")).tobytes()
    parts = [header, bytes(4), struct.pack(">I", len(said)), said]
    parts += [struct.pack(length, len(section)), section, bytes(2), planes]
    path.write_bytes(b"".join(parts))
    return path


def layer(dtype: np.dtype, count: int, length: str) -> bytes:
    """Layer info of one layer, of its own colours."""
    codes = np.rint(LAYER * np.iinfo(dtype).max).astype(dtype.newbyteorder(">"))
    rows, cols, channels = codes.shape
    plane = 2 + codes[..., 0].nbytes
    record = struct.pack(">4iH", 2, 3, 2 + rows, 3 + cols, channels)
    record += b"".join(struct.pack(f">h{length[1]}", k, plane) for k in range(channels))
    extra = bytes(8) + b"\1a\0\0"
    record += b"8BIMnorm" + struct.pack(">4BI", 255, 0, 0, 0, len(extra)) + extra
    planes = b"".join(bytes(2) + codes[..., k].tobytes() for k in range(channels))
    info = struct.pack(">h", count) + record + planes
    return info + bytes(len(info) % 2)


def codes(kind: str) -> np.ndarray:
    return np.rint(PICTURE * np.iinfo(kind).max).astype(kind)


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("count", [None, 1])
@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_the_flattened_picture_is_read(
    tmp_path: Path, kind: str, count: int | None, large: bool
) -> None:
    frame = read_frame(psd(tmp_path / "x.psd", codes(kind), count=count, large=large))
    np.testing.assert_allclose(frame.pixels, PICTURE, atol=0.51 / np.iinfo(kind).max)
    assert ("flattened" in frame.described()) == (count is not None)
    assert frame.colour.source == "assumed for PSD"


def test_floats_are_linear_and_profiles_are_heard(tmp_path: Path) -> None:
    frame = read_frame(psd(tmp_path / "x.psd", 3 * PICTURE.astype(np.float32)))
    assert frame.colour.transfer == "linear"
    np.testing.assert_array_equal(frame.pixels, 3 * PICTURE.astype(np.float32))
    profile = icc_profile("Display P3", "P3-D65").tobytes()
    frame = read_frame(psd(tmp_path / "x.psd", codes("uint8"), resources={1039: profile}))
    assert (frame.colour.transfer, frame.colour.primaries) == ("srgb", "P3-D65")


def test_a_saved_selection_is_no_alpha(tmp_path: Path) -> None:
    more = np.dstack([codes("uint8"), np.zeros((10, 14), np.uint8)])
    np.testing.assert_allclose(read_frame(psd(tmp_path / "x.psd", more)).pixels, PICTURE, atol=2e-3)


VERSION = struct.pack(">IB", 1, 0) + bytes(12)  # no flattened picture
TRANSPARENT = b"8BIMMt16" + bytes(8)


@pytest.mark.parametrize(
    ("options", "got"),
    [
        ({"mode": 4}, "CMYK"),
        ({"mode": 9}, "Lab"),
        ({"mode": 2}, "indexed"),
        ({"resources": {1005: b"\1" * 15, 1057: VERSION}}, "layers alone"),
        ({"count": -1}, "transparent"),
        ({"blocks": b"8BIMPatt" + struct.pack(">I", 3) + bytes(4) + b"8BIMMt16\0\0\0\0"}, "transp"),
        ({"blocks": TRANSPARENT, "large": True, "count": 1}, "transparent"),
    ],
)
def test_what_is_no_flattened_picture_is_told(
    tmp_path: Path, options: dict[str, object], got: str
) -> None:
    path = psd(tmp_path / "x.psd", codes("uint16"), **options)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="wanted a flattened picture of R, G, B, got") as caught:
        read_frame(path)
    assert got in str(caught.value)
    assert "again" not in str(caught.value)
