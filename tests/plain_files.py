"""DPX and TIFF by the letter of their standards: readers and writers that know no library.

SMPTE ST 268-1:2014 (DPX) and TIFF, revision 6.0.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

# Name -> offset in a DPX's header, and struct's format.
DPX_FIELDS = {
    "created": (136, "24s"),
    "creator": (160, "100s"),
    "project": (260, "200s"),
    "copyright": (460, "200s"),
    "descriptor": (800, "B"),
    "transfer": (801, "B"),
    "colorimetric": (802, "B"),
    "bits": (803, "B"),
    "packing": (804, "H"),
    "source name": (1432, "100s"),
    "input device": (1556, "32s"),
    "film edge code": (1664, "16s"),
    "frame position": (1712, "I"),
    "frame rate": (1724, "f"),
    "slate": (1764, "100s"),
    "time code": (1920, "I"),
    "user bits": (1924, "I"),
}
DPX_SAMPLE = {
    "created": b"2020:01:02:03:04:05",
    "creator": b"renderer 1",
    "project": b"show",
    "copyright": b"us",
    "source name": b"sh010.0007.exr",
    "input device": b"camera",
    "frame position": 7,
    "frame rate": 24.0,
    "slate": b"a slate",
    "time code": 0x01020304,
    "user bits": 0x05060708,
}


def write_dpx(path: Path, codes: np.ndarray, bits: int, order: str, transfer: int = 2) -> Path:
    """(row, col, 3) codes: 10 bits filled by method A, 12 packed, in `order` ">" or "<"."""
    rows, cols, _ = codes.shape
    if bits == 10:
        shifts = np.array([22, 12, 2])
        body = (codes.astype(np.uint32) << shifts).sum(-1).astype(order + "u4").tobytes()
    elif bits == 12:
        # The first sample is the lowest bits of a word; lines are whole words.
        flat = codes.reshape(rows, -1).astype(np.uint16)
        bit = (flat[..., None] >> np.arange(12) & 1).reshape(rows, -1).astype(np.uint8)
        bit = np.pad(bit, ((0, 0), (0, -bit.shape[1] % 32)))
        body = (
            np.packbits(bit, axis=1, bitorder="little").view("<u4").astype(order + "u4").tobytes()
        )
    else:
        body = codes.astype(order + f"u{bits // 8}").tobytes()
    header = bytearray(b"\xff" * 2048)
    size = len(header) + len(body)
    magic = b"SDPX" if order == ">" else b"XPDS"
    struct.pack_into(order + "4sI8sIIII", header, 0, magic, 2048, b"V2.0", size, 1, 1664, 384)
    header[36:660] = bytes(624)
    struct.pack_into(order + "HHII", header, 768, 0, 1, cols, rows)
    struct.pack_into(order + "IIfIf", header, 780, 0, 0, 0.0, 2**bits - 1, 1.0)
    packing = 0 if bits == 12 else 1
    struct.pack_into(
        order + "BBBBHHIII", header, 800, 50, transfer, 6, bits, packing, 0, 2048, 0, 0
    )
    header[820:852] = b"picture".ljust(32, b"\0")
    for place, length in ((1432, 192), (1664, 48), (1732, 132)):
        header[place : place + length] = bytes(length)
    for name, value in DPX_SAMPLE.items():
        place, kind = DPX_FIELDS[name]
        struct.pack_into(order + kind, header, place, value)
    path.write_bytes(bytes(header) + body)
    return path


class Dpx(NamedTuple):
    """What a DPX holds."""

    codes: np.ndarray  # (row, col, 3)
    fields: dict[str, object]


def read_dpx(path: Path) -> Dpx:
    content = path.read_bytes()
    order = {b"SDPX": ">", b"XPDS": "<"}[content[:4]]
    cols, rows = struct.unpack_from(order + "II", content, 772)
    (offset,) = struct.unpack_from(order + "I", content, 808)
    fields = {
        name: struct.unpack_from(order + kind, content, place)[0]
        for name, (place, kind) in DPX_FIELDS.items()
    }
    fields = {
        name: value.partition(b"\0")[0] if isinstance(value, bytes) else value
        for name, value in fields.items()
    }
    bits, packing = fields["bits"], fields["packing"]
    body = content[offset:]
    if bits in (8, 16):
        samples = np.frombuffer(body, f"{order}u{bits // 8}", rows * cols * 3)
    elif (bits, packing) == (10, 1):
        words = np.frombuffer(body, order + "u4", rows * cols)
        samples = words[:, None] >> np.array([22, 12, 2]) & 1023
    elif (bits, packing) == (12, 1):
        samples = np.frombuffer(body, order + "u2", rows * cols * 3) >> 4
    else:
        assert (bits, packing) == (12, 0)
        length = -(-cols * 36 // 32)
        words = np.frombuffer(body, order + "u4", rows * length).astype("<u4").reshape(rows, -1)
        bit = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")[:, : cols * 36]
        samples = bit.reshape(-1, 12) @ (1 << np.arange(12))
    return Dpx(samples.reshape(rows, cols, 3), fields)


def write_tiff(path: Path, samples: np.ndarray, order: str) -> Path:
    """(row, col, 3) of 16 bits, uncompressed in one strip, with an artist."""
    rows, cols, _ = samples.shape
    body = samples.astype(order + "u2").tobytes()
    artist = b"the artist\0"
    depths = struct.pack(order + "3H", 16, 16, 16)
    behind = 8 + len(body)
    # Tag, type (2: text, 3: short, 4: long), count, value or offset.
    entries = [
        (256, 4, 1, cols),
        (257, 4, 1, rows),
        (258, 3, 3, behind + len(artist) + 1),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, 8),
        (277, 3, 1, 3),
        (278, 4, 1, rows),
        (279, 4, 1, len(body)),
        (315, 2, len(artist), behind),
    ]
    directory = behind + len(artist) + 1 + len(depths)
    content = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "HI", 42, directory)
    content += body + artist + b"\0" + depths + struct.pack(order + "H", len(entries))
    for tag, kind, count, value in entries:
        short = kind == 3 and count == 1
        content += struct.pack(order + ("HHIHxx" if short else "HHII"), tag, kind, count, value)
    path.write_bytes(content + bytes(4))
    return path


def read_tiff(path: Path) -> tuple[np.ndarray, bytes]:
    """(row, col, 3) samples of 16 bits, uncompressed; and the artist."""
    content = path.read_bytes()
    order = {b"II": "<", b"MM": ">"}[content[:2]]
    (directory,) = struct.unpack_from(order + "I", content, 4)
    (entries,) = struct.unpack_from(order + "H", content, directory)
    tags = {}
    for k in range(entries):
        place = directory + 2 + 12 * k
        tag, kind, count = struct.unpack_from(order + "HHI", content, place)
        each = {2: "s", 3: "H", 4: "I"}.get(kind)
        if each is None:
            continue
        form = f"{order}{count}{each}"
        if struct.calcsize(form) > 4:
            (start,) = struct.unpack_from(order + "I", content, place + 8)
        else:
            start = place + 8
        tags[tag] = struct.unpack_from(form, content, start)
    assert (tags[258], tags[259], tags[262], tags.get(284, (1,))) == ((16,) * 3, (1,), (2,), (1,))
    strips = zip(tags[273], tags[279], strict=True)
    body = b"".join(content[start : start + length] for start, length in strips)
    (cols,), (rows,) = tags[256], tags[257]
    samples = np.frombuffer(body, order + "u2").reshape(rows, cols, 3)
    return samples, tags[315][0].partition(b"\0")[0]
