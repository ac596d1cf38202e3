"""A projector's gamut in the CIE 1976 u'v' diagram, as SVG.

Colours and letters are the page's (classes in ``show.css``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from domesim.frames.colour import CHROMATICITIES
from domesim.observation.projector import Projector
from domesim.readings.colorimetry import COVERED, Colours, locus
from domesim.readings.response import uv

Floats = NDArray[np.float64]

_SIDE = 640
_SPAN = 0.64  # of u' and v', from 0
_EDGE = 12  # pixels


def colours_of(projector: Projector) -> Colours:
    """Returns white and gamut of a projector.

    Parameters
    ----------
    projector
        Its primaries have a name, or were measured.
    """
    return Colours(projector.white * projector.to_xyz)


def gamut_drawing(colours: Colours) -> str:
    """Returns a drawing of a gamut among those of `COVERED`, with the spectral colours.

    Parameters
    ----------
    colours
        White and primaries.
    """
    edge = _at(locus())
    parts = [_line(edge, "wall"), _line(edge[[0, -1]], "level")]
    for name in COVERED:
        x, y = np.reshape(CHROMATICITIES[name][:6], (3, 2)).T
        corners = _at(uv(np.stack([x, y, 1 - x - y], -1)))
        parts += [_line(corners, "level", closed=True), _text(corners[1], name, "size")]
    corners = _at(uv(colours.primaries.T))
    parts.append(_line(corners, "screen", closed=True))
    parts += [_text(place, letter, "mark") for place, letter in zip(corners, "RGB", strict=True)]
    (x, y) = _at(uv(colours.white))
    parts.append(f'<circle class="marked" cx="{x:.1f}" cy="{y:.1f}" r="5"/>')
    label = "The projector's gamut in CIE 1976 u'v', among BT.709, P3 and BT.2020"
    return (
        f'<svg viewBox="0 0 {_SIDE} {_SIDE}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )


def _at(places: Floats) -> Floats:
    """(..., 2) pixels of u'v'."""
    scale = (_SIDE - 2 * _EDGE) / _SPAN
    return np.stack([places[..., 0], _SPAN - places[..., 1]], -1) * scale + _EDGE


def _line(places: Floats, style: str, *, closed: bool = False) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    return f'<{"polygon" if closed else "polyline"} class="{style}" points="{points}"/>'


def _text(place: Floats, text: str, style: str) -> str:
    x, y = place
    return f'<text class="{style}" x="{x + 8:.1f}" y="{y - 6:.1f}">{text}</text>'
