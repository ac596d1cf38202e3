"""Image formats: one file each, and one line of a table."""

from domesim.frames.formats.base import Format, Plain
from domesim.frames.formats.bmp import BMP
from domesim.frames.formats.dpx import DPX
from domesim.frames.formats.exr import EXR
from domesim.frames.formats.hdr import HDR
from domesim.frames.formats.heif import HEIF
from domesim.frames.formats.jpeg import JPEG
from domesim.frames.formats.jpeg2000 import JPEG2000
from domesim.frames.formats.jpegxl import JPEGXL
from domesim.frames.formats.png import PNG
from domesim.frames.formats.psd import PSD
from domesim.frames.formats.tiff import TIFF

FORMATS: dict[str, Format] = {
    each.name: each
    for each in (
        EXR("openexr", "EXR", (".exr",), (16, 32)),
        PNG("png", "PNG", (".png", ".pns"), (8, 16)),
        TIFF("tiff", "TIFF", (".tif", ".tiff"), (8, 10, 12, 16, 32)),
        DPX("dpx", "DPX", (".dpx",), (8, 10, 12, 16)),
        JPEG("jpeg", "JPEG", (".jpg", ".jpeg", ".jpe", ".jps", ".mpo"), (8,)),
        JPEG2000("jpeg2000", "JPEG 2000", (".jp2", ".j2k", ".j2c", ".jpc"), (8, 10, 12, 16)),
        # Read only. Each of these was seen to notice truncation; OpenImageIO also has formats that
        # do not (and one, "null", that makes images up), hence a list.
        BMP("bmp", "BMP", unassociated=True),
        HDR("hdr", "HDR"),
        HEIF("heif", "HEIF"),
        Plain("iff", "IFF"),
        JPEGXL("jpegxl", "JPEG XL"),
        Plain("pnm", "PNM"),
        PSD("psd", "PSD"),
        Plain("rla", "RLA"),
        Plain("sgi", "SGI"),
        Plain("targa", "TGA"),
        Plain("webp", "WebP"),
    )
}
"""Formats by the names that OpenImageIO has for them."""

SUFFIXES = {suffix: each for each in FORMATS.values() for suffix in each.suffixes}
"""Formats that are written, by their files' suffixes."""

WRITTEN = tuple(each.suffixes[0][1:] for each in FORMATS.values() if each.suffixes)
"""Names of the formats that are written, as options take them."""

LABELS = ", ".join(each.label for each in FORMATS.values())
"""Names of the formats that are read, for a message."""
