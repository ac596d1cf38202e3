"""The projector: code values of a file <-> linear light on the screen.

Light 1.0 is the projector's white. A master in other primaries than the projector's goes through a
3 x 3 matrix (colour-science's, chromatically adapted, applied in the pixels' own precision).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Light
from domesim.transfer import Transfer

Pixels = NDArray[np.floating]

PRIMARIES = {
    "BT.709": "ITU-R BT.709",
    "BT.2020": "ITU-R BT.2020",
    "P3-D65": "P3-D65",
    "P3-DCI": "DCI-P3",
    "ACES AP0": "ACES2065-1",
    "ACES AP1": "ACEScg",
    "XYZ": None,
}
"""Names of primaries -> colour-science's names of the colour spaces that have them."""


@final
@dataclass(frozen=True)
class Projector:
    """A projector, as seen on its screen.

    Parameters
    ----------
    primaries
        Name of its primaries, one of `PRIMARIES` except XYZ.
    white
        Luminance of its white on the screen, cd/m²: light 1.0.
    black
        Luminance of its full-frame black on the screen, cd/m².

    Raises
    ------
    InputError
        If a value is impossible.
    """

    primaries: str
    white: float
    black: float = 0.0

    def __post_init__(self) -> None:
        require_primaries(self.primaries)
        if self.primaries == "XYZ":
            raise InputError(
                "projector primaries must be real lights, got XYZ; use for instance P3-D65"
            )
        if not (np.isfinite(self.white) and self.white > 0):
            raise InputError(f"projector white must be above 0 cd/m², got {self.white:g}")
        if not 0 <= self.black < self.white:
            raise InputError(
                f"projector black must be at least 0 and below white ({self.white:g} cd/m²), "
                f"got {self.black:g}"
            )

    def decode(self, pixels: Pixels, transfer: Transfer, primaries: str) -> Light:
        """Light (view, row, col, primary) of code values (view, row, col, RGB).

        The result may leave 0..1 where the picture has colours or highlights that the projector
        has not; it is not clamped here.
        """
        return _convert(transfer.decode(pixels), primaries, self.primaries)

    def encode(self, light: Light, transfer: Transfer, primaries: str) -> Pixels:
        """Code values (view, row, col, RGB) of Light: inverse of `decode`."""
        return transfer.encode(_convert(light, self.primaries, primaries))

    def to_display(self, light: Light) -> Pixels:
        """(view, row, col, RGB) light in BT.709 primaries, for showing on a computer screen."""
        return _convert(light, self.primaries, "BT.709")

    @property
    def luminance_weights(self) -> NDArray[np.float64]:
        """(primary,): share of each primary in the luminance of white; sums to 1."""
        return _luminance_weights(self.primaries)


def require_primaries(name: str) -> None:
    """Check that `name` is one of `PRIMARIES`.

    Raises
    ------
    InputError
        If it is not.
    """
    if name not in PRIMARIES:
        raise InputError(f"primaries {name!r} are not known; use one of {', '.join(PRIMARIES)}")


def _convert(rgb: Pixels, source: str, target: str) -> Pixels:
    if source == target:
        return rgb
    return rgb @ conversion(source, target).T.astype(rgb.dtype)


@cache
def conversion(source: str, target: str) -> NDArray[np.float64]:
    """(3, 3) matrix from linear RGB in `source` primaries to `target` primaries.

    White goes to white (Bradford adaptation), except from and to XYZ, which is colorimetric with
    Y = 1 at white (SMPTE ST 428-1).
    """
    require_primaries(source)
    require_primaries(target)
    colour = _colour()
    if source == "XYZ":
        return np.asarray(colour.RGB_COLOURSPACES[PRIMARIES[target]].matrix_XYZ_to_RGB)
    if target == "XYZ":
        return np.asarray(colour.RGB_COLOURSPACES[PRIMARIES[source]].matrix_RGB_to_XYZ)
    spaces = (colour.RGB_COLOURSPACES[PRIMARIES[name]] for name in (source, target))
    return np.asarray(colour.matrix_RGB_to_RGB(*spaces, chromatic_adaptation_transform="Bradford"))


@cache
def _luminance_weights(primaries: str) -> NDArray[np.float64]:
    row = np.asarray(conversion(primaries, "XYZ"))[1]
    return np.asarray(row / row.sum())


def _colour() -> Any:
    """colour-science, imported late: it takes about a second, and warns of absent extras."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour  # noqa: PLC0415
    return colour
