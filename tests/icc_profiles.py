"""ICC profiles as programs embed them, made from primaries and a tone curve (ICC.1:2001-04)."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

D50 = np.array([0.9642, 1.0, 0.8249])
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
D65 = (0.3127, 0.3290)
PRIMARIES = {
    "BT.709": (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *D65),
    "P3-D65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65),
    "P3-DCI": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),
    "BT.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65),
    "ACES AP1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "Adobe": (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, *D65),
}


def linear() -> bytes:
    """A curve of no entries is the identity."""
    return b"curv" + bytes(8)


def gamma(exponent: float) -> bytes:
    return b"curv" + struct.pack(">IIH", 0, 1, round(exponent * 256)) + bytes(2)


def sampled(curve: Callable[[np.ndarray], np.ndarray], count: int = 1024) -> bytes:
    values = np.rint(curve(np.linspace(0, 1, count)) * 65535).astype(">u2")
    return b"curv" + struct.pack(">II", 0, count) + values.tobytes()


def parametric(*parameters: float) -> bytes:
    """Type 3: (a x + b)^g above d, c x below."""
    fixed = [round(value * 65536) for value in parameters]
    return b"para" + struct.pack(">IHH5i", 0, 3, 0, *fixed)


SRGB_CURVE = parametric(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def icc_profile(
    description: str, primaries: str = "BT.709", curve: bytes = SRGB_CURVE
) -> np.ndarray:
    """A display profile of three colorants and one curve."""
    xy = np.array(PRIMARIES[primaries])
    columns = np.array([xy[:6:2], xy[1:6:2], 1 - xy[:6:2] - xy[1:6:2]])
    white = np.array([xy[6], xy[7], 1 - xy[6] - xy[7]]) / xy[7]
    columns = columns * np.linalg.solve(columns, white)
    cones = np.diag(BRADFORD @ D50 / (BRADFORD @ white))
    columns = np.linalg.inv(BRADFORD) @ cones @ BRADFORD @ columns
    text = description.encode()
    described = b"desc\0\0\0\0" + struct.pack(">I", len(text) + 1) + text + b"\0" * 80
    tags = {b"desc": described, b"wtpt": xyz(D50), b"rTRC": curve, b"gTRC": curve, b"bTRC": curve}
    tags |= {name: xyz(column) for name, column in zip(COLORANTS, columns.T, strict=True)}
    table, body = struct.pack(">I", len(tags)), b""
    for name, content in tags.items():
        table += struct.pack(">4sII", name, 132 + 12 * len(tags) + len(body), len(content))
        body += content + b"\0" * (-len(content) % 4)
    size = 128 + len(table) + len(body)
    header = struct.pack(">I4sI4s4s4s", size, b"lcms", 0x02100000, b"mntr", b"RGB ", b"XYZ ")
    header += struct.pack(">6H4s", 2020, 1, 2, 3, 4, 5, b"acsp") + b"\0" * 28
    header += struct.pack(">3i", 0xF6D6, 0x10000, 0xD32D) + b"\0" * 48
    assert len(header) == 128
    return np.frombuffer(header + table + body, np.uint8)


COLORANTS = (b"rXYZ", b"gXYZ", b"bXYZ")


def xyz(values: np.ndarray) -> bytes:
    return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(65536 * value) for value in values))
