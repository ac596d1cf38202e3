"""Damaged and huge inputs that are no pictures, each made by its number alone, and their cost.

Each is read in a process of its own, whose memory and time the system counts and
limits. So this module does it as a program (``python damaged_inputs.py FOLDER BEGIN END``), which
is small itself; it prints a line of JSON for each.
"""

from __future__ import annotations

import io
import json
import os
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from damaged_files import (
    changed_header,
    cut,
    flipped_bits,
    magic_and_noise,
    no_image,
    spliced,
    without_a_piece,
    zeroed,
)

from domesim.errors import InputError
from domesim.frames.formats.png import chunk
from domesim.host.arrays import write_arrays
from domesim.measure.dome.file import read_survey
from domesim.observation.transport import FORMAT, Transport, load_transport
from domesim.room.dome import Dome
from domesim.scene import load_dome, load_scene
from domesim.scene.mpcdi import read_mpcdi, written_mpcdi
from validation.audience.analysis import analyse_study
from validation.audience.files import read_answers, read_study

SECONDS, MEMORY = 5, 512
"""Limits of each: processor's time, and MiB that it holds at most."""
DAMAGES = (flipped_bits, changed_header, cut, zeroed, without_a_piece, spliced)
DAMAGES += (magic_and_noise, no_image)
SCENE = "dome_hemisphere"
SURVEY = 'theatre = "dome_hemisphere"\n\n[camera]\nfield_deg = 220.0\n'
SURVEY += '\n[[photographs]]\nfile = "a.exr"\npattern = "b.exr"\n'


def study_of(folder: Path) -> object:
    study = read_study(folder)
    return analyse_study(study, read_answers(folder, study)).figures()


READERS: dict[str, Callable[[Path], object]] = {
    "a.npz": load_transport,
    "a.mpcdi": read_mpcdi,
    "scene.toml": load_scene,
    "survey.toml": read_survey,
    "study": study_of,
}


# Sound ones.


def sound_inputs(folder: Path) -> None:
    """One of each kind; the study is there."""
    theatre = load_dome(SCENE).theatre
    tables, core = np.ones((2, 9, 9)), np.ones((3, 2, 2))
    Transport(theatre.dome, tables, core, 0 * core, np.zeros((3, 9, 9))).save(folder / "a.npz")
    two = replace(theatre, lenses=load_dome("dome_dark").theatre.lenses[:2])
    (folder / "a.mpcdi").write_bytes(written_mpcdi(two, (16, 10), "2026-01-01"))
    import scenes  # noqa: PLC0415

    scene = Path(scenes.__file__).with_name(f"{SCENE}.toml").read_bytes()
    (folder / "scene.toml").write_bytes(scene)
    (folder / "survey.toml").write_text(SURVEY)


# Huge ones.


def zeros(count: int, head: bytes = b"") -> bytes:
    """A stream of zlib of so many MiB of zeros."""
    packer = zlib.compressobj(1)
    block = bytes(1 << 20)
    parts = [packer.compress(head), *(packer.compress(block) for _ in range(count))]
    return b"".join([*parts, packer.flush()])


def png_of_zeros(cols: int, rows: int, mode: int) -> bytes:
    """Of mode 0, grey, or 2, RGB; 8 bits."""
    size = -(-rows * (cols * (3 if mode else 1) + 1) >> 20)
    header = struct.pack(">2I5B", cols, rows, 8, mode, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zeros(size)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def zipped(files: Iterable[tuple[str, bytes | int]]) -> bytes:
    """Of contents, or of so many MiB of zeros."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as package:
        for name, content in files:
            with package.open(name, "w", force_zip64=True) as entry:
                if isinstance(content, bytes):
                    entry.write(content)
                else:
                    for _ in range(content):
                        entry.write(bytes(1 << 20))
    return made.getvalue()


def npy_header(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    made = io.BytesIO()
    header = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_2_0(made, header)
    return made.getvalue()


def stored(folder: Path, rank: int) -> bytes:
    """A sound transport of many modes."""
    dome = Dome(1.0, 1.5)
    arrays = {"format": FORMAT, "dome": np.array([1.0, dome.half_angle, 0.0, 1.0, np.nan])}
    arrays |= {"modes": np.zeros((rank, 9, 9)), "core": np.zeros((3, rank, rank))}
    arrays |= {"core_error": np.zeros((1, 1)), "ambient": np.zeros((3, 9, 9)), "provenance": "{}"}
    write_arrays(folder / "made.npz", arrays)
    return (folder / "made.npz").read_bytes()


def huge_arrays(folder: Path) -> Iterator[bytes]:
    numbers = npy_header((1 << 26,))
    bomb = zipped([("format.npy", npy_header(())), ("core.npy", 600)])
    size = struct.pack("<Q", 600 << 20)
    yield bomb
    yield bomb.replace(size, struct.pack("<Q", 100))
    yield zipped([("format.npy", numbers), ("core.npy", numbers)])
    yield zipped([("format.npy", npy_header((1 << 40,)))])
    yield zipped([("format.npy", npy_header((1,), "|O") + b"\x80\x04]\x94.")])
    yield zipped([("format.npy", b"\x93NUMPY\2\0" + struct.pack("<I", 90 << 20)), ("a", 90)])
    yield zipped([("format.npy", npy_header((7,) * 32) + b"(" * 100_000)])
    yield zipped((f"{number}.npy", b"") for number in range(60_000))
    yield stored(folder, 1800)
    yield zipped([("format.npy", 110), ("sha256.npy", b"")])


REGION = (
    '<region id="{id}" xResolution="1920" yResolution="1200"><frustum><yaw>0</yaw><pitch>0</pitch>'
    "<roll>0</roll><leftAngle>-30</leftAngle><rightAngle>30</rightAngle><downAngle>-20</downAngle>"
    "<upAngle>20</upAngle></frustum><coordinateFrame><posx>0</posx><posy>0</posy><posz>0</posz>"
    "<yawx>0</yawx><yawy>-1</yawy><yawz>0</yawz><pitchx>1</pitchx><pitchy>0</pitchy>"
    "<pitchz>0</pitchz><rollx>0</rollx><rolly>0</rolly><rollz>-1</rollz></coordinateFrame></region>"
)
FILES = (
    '<fileset region="{id}"><alphaMap><path>a.png</path></alphaMap>'
    "<geometryWarpFile><path>a.pfm</path></geometryWarpFile></fileset>"
)


def projectors(count: int, *files: tuple[str, bytes | int]) -> bytes:
    regions = "".join(REGION.format(id=number) for number in range(count))
    sets = "".join(FILES.format(id=number) for number in range(count))
    if not any(name == "a.pfm" for name, _ in files):
        sets = sets.replace("a.pfm", "none.txt")
    if not any(name == "a.png" for name, _ in files):
        sets = sets.replace("<path>a.png</path>", "")
    text = f'<MPCDI profile="sl"><display>{regions}</display><files>{sets}</files></MPCDI>'
    return zipped([("mpcdi.xml", text.encode()), *files])


def warp(cols: int, rows: int) -> bytes:
    return b"PF\n%d %d\n-1.0\n" % (cols, rows) + bytes(cols * rows * 12)


def huge_projectors(_: Path) -> Iterator[bytes]:
    begin = b'<MPCDI profile="sl">'
    yield projectors(1, ("a.png", png_of_zeros(5700, 5800, 0)))
    yield projectors(1, ("a.png", png_of_zeros(5700, 5800, 2)))
    yield projectors(1, ("a.png", png_of_zeros(16384, 16384, 0)))
    yield projectors(40, ("a.png", png_of_zeros(5700, 5800, 0)))
    yield projectors(1, ("a.pfm", warp(3840, 2160)))
    yield projectors(40, ("a.pfm", warp(3840, 2160)))
    yield projectors(1, ("a.pfm", 400))
    yield projectors(20_000)
    yield zipped([("mpcdi.xml", begin + b"<a/>" * 20_000_000)])
    yield zipped([("mpcdi.xml", begin + b"<a>" * 1_000_000)])
    yield zipped([("mpcdi.xml", begin + b'<a b="' + b"c" * 100_000_000)])
    yield zipped([("mpcdi.xml", 600)])
    yield zipped((f"{number}.xml", b"") for number in range(60_000))


def huge_texts(sound: str) -> Iterator[str]:
    """Of TOML: long, deep, or of many."""
    parts = "abcdefgh"
    yield ".".join("a" * 100_000) + " = 1"
    yield "".join(f"{'.'.join(parts)}.k{number} = 1\n" for number in range(40_000))
    yield "a = " + "[" * 450_000
    yield "a = " + "{a=" * 300_000
    yield "a = " + "9" * 900_000
    yield "a = 0." + "9" * 900_000
    yield 'a = "' + "\\n" * 450_000 + '"'
    yield "[[a]]\n" * 160_000
    yield "".join(f"[t{number}]\n" for number in range(90_000))
    yield "".join(f"k{number} = 1\n" for number in range(80_000))
    yield sound + '[[meshes]]\nfile = "/dev/zero"\n' * 25_000
    yield sound + '[[projector.units]]\nname = "a"\nkind = "fisheye"\n' * 15_000
    yield sound + "# " + "x" * 2_000_000
    yield 'a = """' + "\n" * 900_000
    yield "a = [" + "1," * 450_000 + "]"
    yield sound.replace("= 0.", "= 1e308 # ")


def huge_studies(sound: bytes) -> Iterator[bytes]:
    yield b"[" * (60 << 20)
    yield b'{"a":' * (10 << 20)
    yield b"[" + b"0," * (30 << 20) + b"0]"
    yield with_value(sound, "viewers", b"[" + b"[]," * (20 << 20) + b"[]]")
    yield with_value(sound, "viewers", b"[" + b"[]," * (1 << 20) + b"[]]")
    yield with_value(sound, "seed", b"9" * 5_000_000)
    yield with_value(sound, "question", b'"' + b"\\u00e9" * 1_000_000 + b'"')
    yield sound + b" " * (63 << 20)
    yield sound + b" " * (7 << 20)


def with_value(sound: bytes, key: str, value: bytes) -> bytes:
    study = json.loads(sound)
    return json.dumps(study | {key: "HERE"}).encode().replace(b'"HERE"', value)


HUGE_ANSWERS = (
    ("viewer-001.json", b"[" * (1 << 20)),
    ("sitting-1.csv", b"viewer,trial,choice\n" + b"a,1,1\n" * 170_000),
    ("sitting-1.csv", b"viewer,trial,choice\n" + b'"' * 1_000_000),
    ("sitting-1.csv", b"," * (1 << 20)),
)


# What becomes of them.


class Cost(NamedTuple):
    """What reading an input cost; `found` as of `damaged_files.Reading`."""

    name: str
    found: str
    mebibytes: float
    seconds: float


def made(kind: str, number: int, folder: Path) -> tuple[str, Path]:
    """Makes an input in a folder of its own; returns what was done, and where it is."""
    place = folder / f"made-{number}"
    place.mkdir()
    rng = np.random.default_rng([11, number])
    names = ("a.npz", "a.mpcdi", "scene.toml", "survey.toml", "study")
    if kind == "study":
        path = place / "study"
        (path / "answers").mkdir(parents=True)
        sources = {
            str(each.relative_to(folder / "study")): each.read_bytes()
            for each in (folder / "study/study.json", *(folder / "study/answers").glob("*.json"))
        }
        for name, content in sources.items():
            (path / name).write_bytes(content)
        target = path / sorted(sources)[number % len(sources)]
        content, others = target.read_bytes(), sources
    else:
        target = path = place / kind
        others = {name: (folder / name).read_bytes() for name in names[:-1]}
        content = others[kind]
    damage = DAMAGES[rng.integers(len(DAMAGES))]
    target.write_bytes(damage(bytearray(content), rng, others))
    return damage.__name__, path


def huge_ones(kind: str, folder: Path) -> Iterator[tuple[str, bytes]]:
    """Contents of huge ones of a kind, and the files they go to; one at a time is in memory."""
    if kind == "study":
        for content in huge_studies((folder / "study/study.json").read_bytes()):
            yield "study.json", content
        for name, content in HUGE_ANSWERS:
            yield f"answers/{name}", content
    elif kind.endswith("toml"):
        for text in huge_texts((folder / kind).read_text()):
            yield "", text.encode()
    else:
        for content in (huge_arrays if kind == "a.npz" else huge_projectors)(folder):
            yield "", content


def cost(kind: str, name: str, path: Path) -> Cost:
    """Reads an input in a process of its own."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        try:
            READERS[kind](path)
            found = "read"
        except InputError as error:
            # One line; of a scene one for each mistake, of which some are told
            lines = str(error).split("\n")
            told = len(lines) < 60 and all(line.isprintable() and len(line) < 900 for line in lines)
            found = f"{'refused' if told else 'WRONG'}: {str(error)[:300]}"
        except BaseException as error:
            found = f"WRONG: {type(error).__name__}: {error}"[:300]
        os.write(writer, found.encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as told:
        found = told.read().decode()
    _, status, used = os.wait4(child, 0)
    if status:
        found = f"WRONG: lost ({os.waitstatus_to_exitcode(status)})"
    return Cost(name, found, used.ru_maxrss / 1024, used.ru_utime + used.ru_stime)


def costs(folder: Path, begin: int, end: int) -> list[Cost]:
    """Of damaged inputs of these numbers, by a program of its own; of huge ones for `end` = 0."""
    command = [sys.executable, __file__, str(folder), str(begin), str(end)]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=paths)
    return [Cost(*json.loads(line)) for line in done.stdout.splitlines()]


def main(folder: Path, begin: int, end: int) -> None:
    kinds = list(READERS)
    for number in range(begin, end):
        kind = kinds[number % len(kinds)]
        damage, path = made(kind, number, folder)
        print(json.dumps(cost(kind, f"{number} {damage} {kind}", path)), flush=True)
    for kind in () if end else kinds:
        for number, (name, content) in enumerate(huge_ones(kind, folder)):
            _, path = made(kind, 100_000 * (kinds.index(kind) + 1) + number, folder)
            if kind == "study":
                for each in (folder / "study").rglob("*.json"):
                    target = path / each.relative_to(folder / "study")
                    target.write_bytes(each.read_bytes())
            (path / name if name else path).write_bytes(content)
            del content
            print(json.dumps(cost(kind, f"huge {number} {kind} {name}", path)), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
