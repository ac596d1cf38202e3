"""A picture of a theatre's light: what projectors reach, their blends, the brightness of white.

Domemasters side by side, the front of the theatre at the bottom: how many projectors reach a
place, with those that none reaches in orange; the sum of their soft edges, which the projection
system has to even out; the luminance of a white frame, and of a black one if it differs from place
to place; and the albedo of a screen that has a map,
in the primaries' colours, over its largest.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from domesim.inspection.coverage import Coverage
from domesim.inspection.photometry import Photometry

SIZE = 440
"""Pixels a side of each domemaster."""

UNEVEN = 0.01
"""Differences of black up to so much are neither drawn nor told, relative."""

HOLE = (0.84, 0.37, 0.0)
"""Vermilion: also the colour-blind tell it from greys."""

_GREYS = (0.0, 0.28, 0.48, 0.64, 0.78, 0.9)  # of places that 1, 2, ... projectors reach
_INK = "#7d838c"  # is read on white, and on black
_EDGE, _TOP, _BELOW = 24, 48, 120  # pixels round a domemaster
_DOTS = 100  # an inch


def picture(coverage: Coverage, photometry: Photometry | None) -> bytes:
    """All side by side: a PNG file with a transparent background.

    Parameters
    ----------
    coverage
        Coverage of a domemaster of `SIZE` x `SIZE`.
    photometry
        Photometry of such a domemaster; None if there are holes, and no observation.
    """
    return _stored(_drawers(coverage, photometry))


def pictures(coverage: Coverage, photometry: Photometry | None) -> list[bytes]:
    """The same, each a PNG file of its own."""
    return [_stored([drawer]) for drawer in _drawers(coverage, photometry)]


_Drawer: TypeAlias = Callable[[Any, int, int], None]
"""Draws one of several domemasters: (figure, number, of how many)."""


def _drawers(coverage: Coverage, photometry: Photometry | None) -> list[_Drawer]:
    def counts(figure: Any, number: int, parts: int) -> None:
        most = min(int(coverage.count.max()), len(_GREYS) - 1)
        last = len(_GREYS) - 1
        shades: list[tuple[Any, str]] = [
            ((_GREYS[count],) * 3, f"{count}{' or more' if count == last else ''}")
            for count in range(1, most + 1)
        ]
        if coverage.holes.any():
            shades.insert(0, (HOLE, "none"))
        _disc(figure, number, parts, "Projectors that reach a place", _counted(coverage))
        _legend(figure, number, parts, shades)

    def edges(figure: Any, number: int, parts: int) -> None:
        values = np.where(coverage.screen & ~coverage.holes, coverage.edges, np.nan)
        shown = _disc(figure, number, parts, "Sum of soft edges, not yet evened out", values)
        _scale(figure, number, parts, shown, "1: as bright as one projector alone")

    def white(figure: Any, number: int, parts: int) -> None:
        assert photometry is not None
        values = np.where(coverage.screen, photometry.luminance, np.nan)
        shown = _disc(figure, number, parts, "White frame, cd/m²", values)
        _scale(figure, number, parts, shown, f"brightest over darkest: {photometry.uneven:.3g}")

    def black(figure: Any, number: int, parts: int) -> None:
        assert photometry is not None
        values = np.where(coverage.screen, photometry.darkness, np.nan)
        shown = _disc(figure, number, parts, "Black frame, cd/m²", values)
        least, most = photometry.blackest
        _scale(figure, number, parts, shown, f"brightest over darkest: {most / least:.3g}")

    def albedo(figure: Any, number: int, parts: int) -> None:
        assert photometry is not None
        assert photometry.albedo is not None
        values = photometry.albedo
        most, on = values.max(), coverage.screen[..., None]
        _disc(figure, number, parts, "Albedo of the screen", np.dstack([values / most, on]))
        _legend(figure, number, parts, [((1.0, 1.0, 1.0), f"{most:.2g}"), ((0, 0, 0), "0")])

    if photometry is None:
        return [counts, edges]
    least, most = photometry.blackest
    uneven = most > least * (1 + UNEVEN) > 0
    return [counts, edges, white] + [black] * uneven + [albedo] * (photometry.albedo is not None)


def _stored(drawers: Sequence[_Drawer]) -> bytes:
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    wide, high = len(drawers) * (SIZE + 2 * _EDGE), SIZE + _TOP + _BELOW
    figure = Figure((wide / _DOTS, high / _DOTS), dpi=_DOTS)
    figure.patch.set_alpha(0)
    for number, drawer in enumerate(drawers):
        drawer(figure, number, len(drawers))
    stored = io.BytesIO()
    figure.savefig(stored, format="png", dpi=_DOTS)
    return stored.getvalue()


def _counted(coverage: Coverage) -> NDArray[np.float64]:
    """(row, col, RGBA) greys by the number of projectors, and holes."""
    shades = np.array(_GREYS)[np.minimum(coverage.count, len(_GREYS) - 1)]
    pixels = np.dstack([shades, shades, shades, coverage.screen.astype(float)])
    pixels[coverage.holes, :3] = HOLE
    return pixels


def _disc(figure: Any, number: int, parts: int, title: str, values: NDArray[np.float64]) -> Any:
    """Draw a domemaster, pixel for pixel."""
    axes = _axes(figure, number, parts, 0, _BELOW, SIZE, SIZE)
    axes.set_axis_off()
    axes.set_title(title, color=_INK, fontsize=14, pad=10)
    axes.text(0.5, -0.02, "front", color=_INK, fontsize=12, ha="center", va="top",
              transform=axes.transAxes)  # fmt: skip
    low, high = np.nanmin(values), np.nanmax(values)
    if values.ndim == 2 and high - low < 1e-3 * high:  # rounding is no pattern
        low, high = 0.9 * low, 1.1 * high
    return axes.imshow(values, interpolation="none", cmap="viridis", vmin=low, vmax=high)


def _scale(figure: Any, number: int, parts: int, shown: Any, label: str) -> None:
    axes = _axes(figure, number, parts, 40, 66, SIZE - 80, 14)
    bar = figure.colorbar(shown, cax=axes, orientation="horizontal")
    bar.outline.set_edgecolor(_INK)
    bar.ax.locator_params(nbins=4)
    bar.set_label(label, color=_INK, fontsize=12)
    axes.tick_params(color=_INK, labelcolor=_INK, labelsize=12)


def _legend(figure: Any, number: int, parts: int, shades: list[tuple[Any, str]]) -> None:
    axes = _axes(figure, number, parts, 0, 40, SIZE, 30)
    axes.set_axis_off()
    axes.set_xlim(0, len(_GREYS))
    axes.set_ylim(0, 1)
    for place, (colour, text) in enumerate(shades):
        axes.add_patch(_rectangle(place + 0.1, tuple(colour)))
        axes.text(place + 0.4, 0.5, text, color=_INK, fontsize=12, va="center")


def _rectangle(left: float, colour: Any) -> Any:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    return Rectangle((left, 0.2), 0.24, 0.6, facecolor=colour, edgecolor=_INK)


def _axes(
    figure: Any, number: int, parts: int, left: int, bottom: int, wide: int, high: int
) -> Any:
    """Axes at pixels of one of the parts."""
    width, height = parts * (SIZE + 2 * _EDGE), SIZE + _TOP + _BELOW
    start = number * (SIZE + 2 * _EDGE) + _EDGE + left
    return figure.add_axes((start / width, bottom / height, wide / width, high / height))
