"""A format is one file and one line of a table."""

from __future__ import annotations

import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import OpenImageIO as oiio  # noqa: N813
from image_files import store
from test_frames import texture

from domesim.frames import read_frame
from domesim.frames.formats import FORMATS, SUFFIXES

ROOT = Path(__file__).parents[3]

MODULE = """
from dataclasses import dataclass, replace
from domesim.frames.formats.base import Format


@dataclass(frozen=True)
class PNM(Format):
    remark: bytes = b"# by a test"
    starts = (b"P6",)

    def examined(self, path, file):
        return replace(self, remark=file.read().split(b"\\n")[1])

    def finished(self, content, path, target):
        return content[:3] + self.remark + b"\\n" + content[3:]
"""
PROGRAM = """
from dataclasses import replace
import numpy as np
from domesim.errors import InputError
from domesim.frames import read_frame, write_frame

first = read_frame("in.png")
write_frame(first, "out.ppm")
second = read_frame("out.ppm")
np.testing.assert_array_equal(second.pixels, first.pixels)
print(second.described())
write_frame(replace(second, header=replace(second.header, file=replace(
    second.header.file, remark=b"# as it was"))), "again.ppm")
for name in ("out.ppm", "again.ppm"):
    print(*open(name, "rb").read().decode("latin-1").split("\\n")[:4])
for path, bits in (("out.ppm", 10), ("out.pam", 8)):
    try:
        write_frame(first, path, bits=bits)
    except InputError as error:
        print(error)
"""


def test_a_new_format_is_one_file_and_one_line(tmp_path: Path) -> None:
    """Expected: read, written, its own words kept, and named in messages, in a changed copy."""
    shutil.copytree(ROOT / "domesim", tmp_path / "domesim")
    formats = tmp_path / "domesim" / "frames" / "formats"
    (formats / "pnm.py").write_text(MODULE)
    table = (formats / "__init__.py").read_text()
    old, new = 'Plain("pnm", "PNM")', 'PNM("pnm", "PNM", (".ppm",), (8, 16))'
    assert table.count(old) == 1
    line = "from domesim.frames.formats.png import PNG\n"
    table = table.replace(line, f"{line}from domesim.frames.formats.pnm import PNM\n")
    (formats / "__init__.py").write_text(table.replace(old, new))
    store(tmp_path / "in.png", texture("uint16"))
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    described, out, again, depth, suffix = done.stdout.splitlines()
    assert described == "31 x 23 PNM, 16 bit, sRGB (assumed for PNM)"
    assert (out, again) == ("P6 # by a test 31 23 65535", "P6 # as it was 31 23 65535")
    assert depth == "out.ppm: wanted 8, 16 bits for PNM, got 10. Choose one."
    assert ".ppm" in suffix


def test_the_table_is_of_formats_that_openimageio_has() -> None:
    known = oiio.get_string_attribute("format_list").split(",")
    assert set(FORMATS) <= {*known, "heif"}  # which it is given as a PNG
    assert all(each.depths for each in SUFFIXES.values())


def test_what_a_file_said_goes_with_its_frame_to_another_process(tmp_path: Path) -> None:
    frame = read_frame(store(tmp_path / "in.dpx", texture("uint16"), Software="a test"))
    file = pickle.loads(pickle.dumps(frame)).header.file
    assert file == frame.header.file
    assert b"a test" in file.header
