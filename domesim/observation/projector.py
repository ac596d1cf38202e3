"""The projector: code values of a file <-> linear light on the screen.

Light 1.0 is the projector's white. A master in other primaries than the projector's goes through a
3 x 3 matrix (chromatically adapted, applied in the pixels' own precision). A projector's primaries
have a name, or were measured.

SMPTE RP 177 derives the matrices from chromaticities. Names that are not ours are looked up among
the RGB colour spaces of colour-science, which is imported for such alone: it takes two seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.frames.colour import CHROMATICITIES, ProjectorResponse, chromaticities_of
from domesim.light import Light
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips
from domesim.light.transfer import Transfer

Pixels = NDArray[np.floating]

PRIMARIES = tuple(CHROMATICITIES)
"""Names of primaries that need no look-up."""

CINEMA = ("P3-DCI", "XYZ")
"""Primaries of files whose white is a colour as any other, shown as it is (RP 431-2)."""

NAMES = (
    f"one of {', '.join(name for name in PRIMARIES if name != 'XYZ')}, or of the RGB colour spaces "
    "of colour-science, such as 'Adobe RGB (1998)'"
)
"""What a projector's primaries may be called, for messages."""

MEASURED = "measured"
"""Name of primaries that have no other."""

Matrix: TypeAlias = tuple[tuple[float, float, float], ...]
"""(XYZ, RGB) of measured primaries: linear RGB -> XYZ, with Y = 1 at white."""

_SINGULAR = 1e4
"""Condition of a matrix beyond which its primaries are one colour; BT.709's is 5."""


@final
@dataclass(frozen=True)
class Projector:
    """A projector, as seen on its screen.

    Parameters
    ----------
    primaries
        Name of its primaries, one of `PRIMARIES` except XYZ; or `MEASURED`.
    white
        Luminance of its white on the screen, cd/m²: light 1.0.
    black
        Luminance of its full-frame black on the screen, cd/m².
    measured
        Its primaries if they were measured (see `relative_primaries`), None if they have a name.
    response
        What it makes of a display's levels; None to go by files, or what is usual for them.

    Raises
    ------
    InputError
        If a value is impossible.
    """

    primaries: str
    white: float
    black: float = 0.0
    measured: Matrix | None = None
    response: ProjectorResponse | None = None

    def __post_init__(self) -> None:
        if self.measured is None:
            require_primaries(self.primaries)
        else:
            _require_measured(self.primaries, self.measured)
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
        """Light that code values stand for.

        It may leave 0..1, unclamped, where the projector has not the colours or highlights.

        Parameters
        ----------
        pixels
            (view, row, col, RGB) code values.
        transfer
            Their transfer function.
        primaries
            Name of their primaries.

        Returns
        -------
        light
            (view, row, col, primary), 1.0 = projector white.
        """
        return _convert(transfer.decode(pixels), primaries, self._space, kept=primaries in CINEMA)

    def encode(self, light: Light, transfer: Transfer, primaries: str) -> Pixels:
        """Code values that stand for light: the inverse of `decode`.

        Parameters
        ----------
        light
            (view, row, col, primary), 1.0 = projector white.
        transfer, primaries
            As for `decode`.

        Returns
        -------
        pixels
            (view, row, col, RGB) code values.
        """
        return transfer.encode(_convert(light, self._space, primaries, kept=primaries in CINEMA))

    def to_display(self, light: Light) -> Pixels:
        """(view, row, col, RGB) light in BT.709 primaries, for showing on a computer screen."""
        return _convert(light, self._space, "BT.709")

    @property
    def to_xyz(self) -> NDArray[np.float64]:
        """(XYZ, primary) matrix from light to XYZ, with Y = 1 at white."""
        return conversion(self._space, "XYZ")

    @property
    def luminance_weights(self) -> NDArray[np.float64]:
        """(primary,): share of each primary in the luminance of white; sums to 1."""
        return _luminance_weights(self._space)

    def luminance(self, light: Light) -> NDArray[Any]:
        """(view, row, col) luminance of (view, row, col, primary) light, cd/m²."""
        weights = (self.white * self.luminance_weights).astype(light.dtype)
        planes = np.empty(light.shape[:-1], light.dtype)

        def weigh(view: int, rows: slice) -> None:
            np.matmul(light[view, rows], weights, out=planes[view, rows])

        in_strips(weigh, light.shape)
        return planes

    @property
    def _space(self) -> str | Matrix:
        return self.primaries if self.measured is None else self.measured


@guarded(xyz="3 3")
def relative_primaries(xyz: ArrayLike) -> Matrix:
    """Measured primaries as `Projector` takes them.

    Parameters
    ----------
    xyz
        (XYZ, RGB) of full R, G and B without black, in any unit.
    """
    measured = np.asarray(xyz, np.float64)
    rows = (measured / measured[1].sum()).tolist()
    return tuple((float(r), float(g), float(b)) for r, g, b in rows)


def _require_measured(name: str, matrix: Matrix) -> None:
    if name != MEASURED:
        raise InputError(
            f"projector primaries must be called {MEASURED!r} when they are given, got {name!r}"
        )
    measured = np.asarray(matrix, np.float64)
    if measured.shape != (3, 3) or not np.isfinite(measured).all():
        raise InputError(f"measured primaries must be 3 x 3 finite numbers, got {matrix}")
    if abs(measured[1].sum() - 1) > 1e-6:
        raise InputError(
            f"measured primaries must have Y = 1 at white, got {measured[1].sum():g}; divide by "
            f"that"
        )
    lengths = np.linalg.norm(measured, axis=0)
    if not lengths.min() > 0 or np.linalg.cond(measured / lengths) > _SINGULAR:
        raise InputError(f"measured primaries must be three colours, got {matrix}; measure again")


def require_primaries(name: str) -> None:
    """Check that `name` is one of `PRIMARIES`, or an RGB colour space of colour-science.

    Raises
    ------
    InputError
        If it is not.
    """
    if chromaticities_of(name) is None:
        raise InputError(f"primaries {name!r} are not known; use {NAMES}")


def _convert(
    rgb: Pixels, source: str | Matrix, target: str | Matrix, *, kept: bool = False
) -> Pixels:
    if source == target:
        return rgb
    return rgb @ conversion(source, target, kept=kept).T.astype(rgb.dtype)


@cache
def conversion(
    source: str | Matrix, target: str | Matrix, *, kept: bool = False
) -> NDArray[np.float64]:
    """Matrix from linear RGB in `source` primaries to `target` primaries.

    White goes to white (Bradford adaptation), except from and to XYZ, which is colorimetric with
    Y = 1 at white (SMPTE ST 428-1).

    Parameters
    ----------
    source, target
        Names of primaries, or measured ones (see `relative_primaries`).
    kept
        Whether white, too, keeps its chromaticity.

    Returns
    -------
    matrix
        (3, 3), target by source.

    Raises
    ------
    InputError
        If a name is not known.
    """
    for space in (source, target):
        if isinstance(space, str):
            require_primaries(space)
    to_xyz, from_target = _to_xyz(source), np.linalg.inv(_to_xyz(target))
    if kept or "XYZ" in (source, target):
        return np.asarray(from_target @ to_xyz)
    whites = [_BRADFORD @ matrix.sum(axis=1) for matrix in (to_xyz, _to_xyz(target))]
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(whites[1] / whites[0]) @ _BRADFORD
    return np.asarray(from_target @ adapted @ to_xyz)


_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
"""XYZ -> cone responses in which white is adapted to (Lam 1985; ICC.1:2022, annex E)."""


def _to_xyz(space: str | Matrix) -> NDArray[np.float64]:
    """(XYZ, RGB) matrix of light in these primaries, with Y = 1 at white (SMPTE RP 177)."""
    if not isinstance(space, str):
        return np.asarray(space, np.float64)
    if space == "XYZ":
        return np.eye(3)
    x, y = np.reshape(chromaticities_of(space) or (), (4, 2)).T
    red, green, blue, white = (np.stack([x, y, 1 - x - y]) / y).T
    primaries = np.stack([red, green, blue], axis=1)
    return np.asarray(primaries * np.linalg.solve(primaries, white))


@cache
def _luminance_weights(primaries: str | Matrix) -> NDArray[np.float64]:
    row = np.asarray(conversion(primaries, "XYZ"))[1]
    return np.asarray(row / row.sum())
