"""MXF of a DCP's picture, as asdcplib lays it out (SMPTE ST 377-1, 390, 422, 429-3, 429-4, 429-10).

FFmpeg writes no stereoscopic one. There, each edit unit holds two codestreams, left and right; the
index has an entry for each pair, and samples come at twice the edit rate.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

LABEL = bytes.fromhex("060e2b34")
OP_ATOM = bytes.fromhex("060e2b34040101020d01020110000000")
JPEG_2000_FRAMES = bytes.fromhex("060e2b34040101070d010301020c0100")
SEVERAL_MAPPINGS = bytes.fromhex("060e2b34040101030d010301027f0100")
ENCRYPTED = bytes.fromhex("060e2b34040101070d010301020b0100")
ESSENCE = bytes.fromhex("060e2b34010201010d01030115010801")
TRIPLET = bytes.fromhex("060e2b34010201010d010301027e0100")  # encrypted
PICTURE = bytes.fromhex("060e2b34040101010103020201000000")
TIMECODE = bytes.fromhex("060e2b34040101010103020101000000")
CODING_2K = bytes.fromhex("060e2b34040101090401020203010103")
BODY, INDEX, TRACK = 1, 129, int.from_bytes(ESSENCE[-4:])


def klv(key: bytes, value: bytes) -> bytes:
    return key + b"\x83" + len(value).to_bytes(3) + value


def pack(kind: int, *, here: int, footer: int, before: int, size: int, index: int = 0) -> bytes:
    """A partition of that kind: 2 header, 3 body, 4 footer; closed and complete."""
    body = (BODY if kind == 3 else 0,)
    value = struct.pack(">HHIQQQQQIQI", 1, 2, 1, here, before, footer, size, index,
                        INDEX if index else 0, 0, *body)  # fmt: skip
    value += OP_ATOM + several(SEVERAL_MAPPINGS, JPEG_2000_FRAMES)
    return klv(LABEL + bytes.fromhex("020501010d01020101") + bytes([kind, 4, 0]), value)


class Sets:
    """Header metadata: sets of items, whose longer names the primer has."""

    def __init__(self) -> None:
        self.sets = b""
        self.names: dict[int, bytes] = {}

    def add(self, kind: int, me: int, items: dict[int, bytes]) -> None:
        value = b"".join(
            struct.pack(">HH", tag, len(each)) + each
            for tag, each in {0x3C0A: uid(me), **items}.items()
        )
        key = LABEL + bytes.fromhex("025301010d0101010101") + bytes([kind, 0])
        self.sets += klv(key, value)

    def local(self, tag: int, name: str) -> int:
        self.names[tag] = bytes.fromhex(name)
        return tag

    def primer(self) -> bytes:
        entries = b"".join(struct.pack(">H", tag) + name for tag, name in self.names.items())
        value = struct.pack(">II", len(self.names), 18) + entries
        return klv(LABEL + bytes.fromhex("020501010d01020101050100"), value)


def uid(number: int) -> bytes:
    return b"domesim test" + number.to_bytes(4)


def umid(number: int) -> bytes:
    return bytes.fromhex("060a2b340101010501010f2013000000") + uid(number)


def ratio(value: Fraction) -> bytes:
    return struct.pack(">ii", value.numerator, value.denominator)


def several(*items: bytes) -> bytes:
    return struct.pack(">II", len(items), len(items[0]) if items else 16) + b"".join(items)


def cinema_mxf(
    codestreams: Sequence[bytes],
    *,
    size: tuple[int, int],
    rate: Fraction = Fraction(24),
    stereo: bool = False,
    labelled: bool = True,
    essence: bytes = ESSENCE,
    container: bytes = JPEG_2000_FRAMES,
    mappings: Sequence[bytes] = (SEVERAL_MAPPINGS,),
) -> bytes:
    """The file; `codestreams` of left and right in turn if `stereo`.

    Interop files do not say that they are (`labelled`). Without `mappings` FFmpeg takes the file
    for a single clip, and finds nothing by its index.
    """
    step = 2 if stereo else 1
    units = len(codestreams) // step
    long, cols_rows = struct.pack(">q", units), [struct.pack(">I", each) for each in size]
    sets = Sets()
    sets.add(0x2F, 1, {
        0x3B02: bytes(8), 0x3B05: b"\1\2", 0x3B07: struct.pack(">I", 1), 0x3B06: several(uid(2)),
        0x3B03: uid(3), 0x3B09: OP_ATOM, 0x3B0A: several(*mappings, container), 0x3B0B: several(),
    })  # fmt: skip
    name = "domesim".encode("utf-16-be")
    sets.add(0x30, 2, {
        0x3C09: uid(99), 0x3C01: name, 0x3C02: name, 0x3C04: name, 0x3C05: uid(98),
        0x3C06: bytes(8),
    })  # fmt: skip
    sets.add(0x18, 3, {0x1901: several(uid(10), uid(20)), 0x1902: several(uid(4))})
    sets.add(0x23, 4, {
        0x2701: umid(20), 0x3F06: struct.pack(">I", INDEX), 0x3F07: struct.pack(">I", BODY),
    })  # fmt: skip
    for package, kind in ((10, 0x36), (20, 0x37)):
        more = {0x4701: uid(30)} if package == 20 else {}
        sets.add(kind, package, {
            0x4401: umid(package), 0x4404: bytes(8), 0x4405: bytes(8),
            0x4403: several(uid(package + 1), uid(package + 4)), **more,
        })  # fmt: skip
        for first, data, number in ((1, TIMECODE, 0), (4, PICTURE, TRACK if more else 0)):
            here = package + first
            sets.add(0x3B, here, {
                0x4801: struct.pack(">I", first), 0x4804: struct.pack(">I", number),
                0x4B01: ratio(rate), 0x4B02: bytes(8), 0x4803: uid(here + 1),
            })  # fmt: skip
            sets.add(0x0F, here + 1, {
                0x0201: data, 0x0202: long, 0x1001: several(uid(here + 2)),
            })  # fmt: skip
            if data == TIMECODE:
                sets.add(0x14, here + 2, {
                    0x0201: data, 0x0202: long, 0x1501: bytes(8),
                    0x1502: struct.pack(">H", int(rate)), 0x1503: b"\0",
                })  # fmt: skip
            else:
                source = bytes(32) if more else umid(20)
                track = bytes(4) if more else struct.pack(">I", first)
                sets.add(0x11, here + 2, {
                    0x0201: data, 0x0202: long, 0x1201: bytes(8), 0x1101: source, 0x1102: track,
                })  # fmt: skip
    parts = [uid(31), *([uid(32)] if stereo and labelled else [])]
    subs = sets.local(0x8001, "060e2b34010101090601010406100000")
    sets.add(0x29, 30, {
        0x3006: struct.pack(">I", 4), 0x3001: ratio(rate * step), 0x3002: long, 0x3004: container,
        0x320C: b"\0", 0x320D: several(bytes(4), bytes(4)), 0x3203: cols_rows[0],
        0x3202: cols_rows[1], 0x320E: ratio(Fraction(*size)), 0x3201: CODING_2K,
        0x3406: struct.pack(">I", 4095), 0x3407: bytes(4), subs: several(*parts),
    })  # fmt: skip
    rsiz = sets.local(0x8002, "060e2b340101010a0401060301000000")
    sets.add(0x5A, 31, {rsiz: struct.pack(">H", 3)})
    if stereo and labelled:
        sets.add(0x63, 32, {})
    header = sets.primer() + sets.sets
    length = len(pack(2, here=0, footer=0, before=0, size=0))
    packets = [klv(essence, each) for each in codestreams]
    body_at = length + len(header)
    footer_at = body_at + length + sum(map(len, packets))
    places = np.cumsum([0, *map(len, packets)])[:-1][::step]
    entries = b"".join(struct.pack(">bbBQ", 0, 0, 0x80, int(place)) for place in places)
    items = {
        0x3C0A: uid(40), 0x3F0B: ratio(rate), 0x3F0C: bytes(8), 0x3F0D: long, 0x3F05: bytes(4),
        0x3F06: struct.pack(">I", INDEX), 0x3F07: struct.pack(">I", BODY), 0x3F08: b"\0",
        0x3F0A: struct.pack(">II", units, 11) + entries,
    }  # fmt: skip
    index = klv(
        LABEL + bytes.fromhex("025301010d01020101100100"),
        b"".join(struct.pack(">HH", tag, len(each)) + each for tag, each in items.items()),
    )
    partitions = ((0, 0), (BODY, body_at), (0, footer_at))
    table = b"".join(struct.pack(">IQ", *each) for each in partitions)
    rip = LABEL + bytes.fromhex("020501010d01020101110100")
    rip_value = table + struct.pack(">I", len(table) + 4 + 20)
    return b"".join([
        pack(2, here=0, footer=footer_at, before=0, size=len(header)), header,
        pack(3, here=body_at, footer=footer_at, before=0, size=0), *packets,
        pack(4, here=footer_at, footer=footer_at, before=body_at, size=0, index=len(index)), index,
        klv(rip, rip_value),
    ])  # fmt: skip


def codestreams_of(pictures: Sequence[np.ndarray]) -> list[bytes]:
    """Each picture, (row, col, XYZ) of 12 bits, in JPEG 2000 of digital cinema, by FFmpeg."""
    if shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg, whose encoder knows digital cinema's profile")
    rows, cols = pictures[0].shape[:2]
    raw = b"".join((each << 4).astype("<u2").tobytes() for each in pictures)
    size = ("-pix_fmt", "xyz12le", "-s", f"{cols}x{rows}", "-r", "24")
    profile = ("-c:v", "libopenjpeg", "-format", "j2k", "-cinema_mode", "2k_24")
    command = ["ffmpeg", "-v", "error", "-f", "rawvideo", *size, "-i", "-", *profile]
    done = subprocess.run([*command, "-f", "image2pipe", "-"], input=raw, check=True,
                          capture_output=True).stdout  # fmt: skip
    start = b"\xff\x4f\xff\x51"
    return [start + each for each in done.split(start)[1:]]


def write_cinema_mxf(path: Path, pictures: Sequence[np.ndarray], **options: object) -> Path:
    rows, cols = pictures[0].shape[:2]
    content = cinema_mxf(codestreams_of(pictures), size=(cols, rows), **options)  # type: ignore[arg-type]
    path.write_bytes(content)
    return path
