"""Frames: image files <-> code values and their colour.

`read_frame` takes an image file to R, G, B code values, a `ColourTag` that says what they mean,
and a header that keeps everything else the file holds; `write_frame` takes them back. What a user
did not ask to change survives: bit depth, metadata, channel order, alpha and other channels.

`read_master` and `write_master` do the same for a moment of a show, which may be two frames: left
and right, in two files or packed in one.

Two promises shape the code. A damaged file is an error, never a picture with a black or grey part
(``formats``, ``reading.py``). And an output is whole or not there (``writing.py``).

Code values are of the picture as it is shown: upright, and over black where it has an alpha. The
result is stored as the master was. An EXR is read over its display window.
"""

from domesim.frames.colour import ColourTag
from domesim.frames.frame import Frame, Pixels
from domesim.frames.integrity import LARGEST_SIDE
from domesim.frames.reading import read_frame
from domesim.frames.views import Master, Packing, read_master, write_master
from domesim.frames.writing import write_frame
from domesim.host.writing import write_whole

__all__ = [
    "LARGEST_SIDE",
    "ColourTag",
    "Frame",
    "Master",
    "Packing",
    "Pixels",
    "read_frame",
    "read_master",
    "write_frame",
    "write_master",
    "write_whole",
]
