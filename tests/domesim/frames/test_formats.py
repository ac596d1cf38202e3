"""A format is one file and one line of a table."""

from __future__ import annotations

import pickle
from pathlib import Path

import OpenImageIO as oiio  # noqa: N813
from image_files import store
from test_frames import texture

from domesim.frames import read_frame
from domesim.frames.formats import FORMATS, SUFFIXES


def test_the_table_is_of_formats_that_openimageio_has() -> None:
    known = oiio.get_string_attribute("format_list").split(",")
    assert set(FORMATS) <= {*known, "heif"}  # which it is given as a PNG
    assert all(each.depths for each in SUFFIXES.values())


def test_what_a_file_said_goes_with_its_frame_to_another_process(tmp_path: Path) -> None:
    frame = read_frame(store(tmp_path / "in.dpx", texture("uint16"), Software="a test"))
    file = pickle.loads(pickle.dumps(frame)).header.file
    assert file == frame.header.file
    assert b"a test" in file.header
