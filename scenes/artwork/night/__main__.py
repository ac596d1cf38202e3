"""Write the picture: ``python -m scenes.artwork.night --out scenes/masters/night.exr``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.formats.base import writer_of
from domesim.host.writing import written_to
from scenes.artwork.night.picture import Night, render

BT709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Chromaticities (x, y) of red, green, blue and white: Recommendation ITU-R BT.709-6, item 1.3."""


def main() -> int:
    """Render, write, and say how long it took."""
    default = Night()
    parser = argparse.ArgumentParser(prog="python -m scenes.artwork.night", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="EXR file to write")
    parser.add_argument("--size", type=int, default=default.size, help="rows and columns")
    parser.add_argument(
        "--samples", type=int, default=default.samples, help="paths to the pixel, a power of four"
    )
    parser.add_argument("--seed", type=int, default=default.seed)
    arguments = parser.parse_args()
    started = time.monotonic()
    try:
        night = Night(size=arguments.size, samples=arguments.samples, seed=arguments.seed)
        write(arguments.out, render(night), night)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{arguments.out}: {time.monotonic() - started:.0f} s")
    return 0


def write(path: Path, picture: NDArray[np.float32], night: Night) -> None:
    """Write `picture` as half-float ZIP EXR that states its primaries, whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path.suffix != ".exr":
        raise InputError(f"{path}: the picture is written as EXR, so its name must end in .exr")
    rows, cols, _ = picture.shape
    spec = oiio.ImageSpec(cols, rows, 3, oiio.HALF)
    spec.channelnames = ("R", "G", "B")
    spec.attribute("compression", "zip")
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), BT709)
    made_with = f"scenes.artwork.night, seed {night.seed}, {night.samples} samples"
    spec.attribute("ImageDescription", f"Equidistant domemaster, 180 degrees; {made_with}")
    with written_to(path) as unfinished, writer_of(str(unfinished)) as output:
        opened = output.open(str(unfinished), spec)
        written = opened and output.write_image(rounded(picture)) and output.close()
        if not written:
            raise InputError(f"{path}: cannot be written ({output.geterror()})")


def rounded(picture: NDArray[np.float32], bits: int = 8) -> NDArray[np.float32]:
    """Round to `bits` of mantissa: steps of 0.2 to 0.4 %, unseen, and a file of half the size."""
    mantissa, exponent = np.frexp(picture)
    return np.ldexp(np.round(mantissa * 2.0**bits) / 2.0**bits, exponent).astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
