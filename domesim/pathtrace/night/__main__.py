"""Write the picture: ``python -m domesim.pathtrace.night --out scenes/masters/night.exr``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, write_frame
from domesim.pathtrace.night.picture import Night, render


def main() -> int:
    """Render, write, and say how long it took."""
    default = Night()
    parser = argparse.ArgumentParser(prog="python -m domesim.pathtrace.night", description=__doc__)
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
        pixels = rounded(render(night))
        colour = ColourTag("linear", "BT.709", "made so")
        frame = Frame(pixels, arguments.out, colour, bits=16, floating=True)
        write_frame(frame, arguments.out, bits=16)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{arguments.out}: {time.monotonic() - started:.0f} s")
    return 0


def rounded(picture: NDArray[np.float32], bits: int = 8) -> NDArray[np.float32]:
    """Round to `bits` of mantissa: steps of 0.2 to 0.4 %, unseen, and a file of half the size."""
    mantissa, exponent = np.frexp(picture)
    return np.ldexp(np.round(mantissa * 2.0**bits) / 2.0**bits, exponent).astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
