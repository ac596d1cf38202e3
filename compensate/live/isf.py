"""ISF shaders (Interactive Shader Format 2), and the same for TouchDesigner: eight passes at most.

Targets are of 32 bits (``FLOAT``). ISF has no images of floats, so that maps are polynomials here:
of a dome in closed form, whose reflected light has one mode, and of a pair. Others are for
`compensate.live.shader`. A pass adds up what levels of excited light leave of a dome's picture.
What is excited is found between two of them.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, pair
from compensate.aim.settings import MOST_LIFT
from compensate.blocks import smooth
from compensate.live.constants import DomeConstants, PairConstants, constants_of
from compensate.live.shader import (
    INTERVALS,
    LEVELS,
    about_scene,
    counted,
    glsl,
    of_any_dome,
    of_any_pair,
    rendered,
    vector,
)
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.observation.lowrank import LowRankObservation
from domesim.scene import Scene

_TILES = 16
"""Tiles along a side, whose light is added up by itself."""
_DEGREE = 6
"""Of the polynomials that maps become."""
_NEAR = 1e-4
"""By how much ambient light may be off, of white."""
_ALIKE = 0.02
"""By how much a map of crosstalk may be off, of its largest value."""


def isf_of(
    scene: Scene,
    rows: int,
    cols: int,
    colour: ColourTag,
    *,
    beside: bool = True,
    aim: Aim | None = None,
    touch: bool = False,
) -> str:
    """Writes an ISF shader for a scene.

    Parameters
    ----------
    scene, rows, cols, colour, beside
        As for `compensate.live.shader.shader_of`.
    aim
        Its lift is the default of the input `lift`.
    touch
        Whether it is the text of TouchDesigner's GLSL TOPs instead, one for each pass.

    Returns
    -------
    text
        The shader.

    Raises
    ------
    InputError
        As for `shader_of`; or if the screen is no circle and does not fill the picture, the
        reflected light has several modes or varies over the screen, or maps are no polynomials.
    """
    constants = constants_of(scene, rows, cols)
    about = about_scene(scene, rows, cols, colour, beside=beside)
    if isinstance(constants, DomeConstants):
        observation = scene.solvable(rows, cols)
        assert isinstance(observation, LowRankObservation)
        facts = _about_dome(scene.name, constants, observation)
    else:
        density = scene.viewing.pixels_per_degree(rows, cols)
        facts = _about_pair(scene.name, constants, density, beside=beside)
    targets = facts["targets"]
    sizes = [{"TARGET": n, "WIDTH": str(w), "HEIGHT": str(h), "FLOAT": True} for n, w, h in targets]
    lift = {"NAME": "lift", "TYPE": "float", "MIN": 0.0, "MAX": MOST_LIFT}
    header = {
        "ISFVSN": "2",
        "DESCRIPTION": f"Light pollution compensated: {scene.name}",
        "CREDIT": "domesim",
        "CATEGORIES": ["Filter"],
        "INPUTS": [
            {"NAME": "inputImage", "TYPE": "image"},
            {"NAME": "compensating", "TYPE": "bool", "DEFAULT": True},
            lift | {"DEFAULT": (aim or Aim()).lift},
        ],
        "PASSES": [*sizes, {}],
    }
    told = json.dumps(header).replace("*/", "* /")  # it is a comment
    usual = glsl((aim or Aim()).lift)
    facts |= {"textures": (), "header": "" if touch else told, "usual": usual}
    return rendered("isf.glsl.j2", about | facts)


def _about_dome(name: str, k: DomeConstants, observation: LowRankObservation) -> dict[str, Any]:
    rows, cols = k.screen.shape
    spread = float(k.spread.flat[0])
    if len(k.spread) != 1 or not np.allclose(k.spread, spread) or not np.allclose(k.gain, 1):
        raise _refused(name, "reflected light that is the same all over the screen")
    row, col = np.nonzero(k.screen)
    y, x = (row + 0.5) * 2 / rows - 1, (col + 0.5) * 2 / cols - 1
    collect = np.asarray(observation.factors.collect, np.float64)[0][k.screen]
    powers = np.polynomial.polynomial.polyfit(x**2 + y**2, collect / collect.sum(), _DEGREE // 2)
    ambient, off = _polynomial(k.ambient, k.cell, (rows, cols), counted(k) > 0)
    if off > _NEAR:
        raise _refused(name, "light without a picture that varies smoothly")
    answer = k.core[:, 0, 0] * collect.sum()
    known = of_any_dome(k)
    bw, bh = known["block_cols"], known["block_rows"]
    wide, levels = max(bw, LEVELS), 2 * (INTERVALS + 1)
    return {
        "dome": True,
        "targets": [
            ("TILES", _TILES**2, levels),
            ("MOMENTS", max(bw, levels), 2 * bh + 1),
            ("MIDDLE", wide, 2 * bh),
            ("SLOPE", wide, bh + 1),
            ("BASE", max(bw, 2), bh + 1),
            ("LEFT", _TILES**2, levels),
            ("SUMS", levels, 1),
        ],
        "tiles": _TILES,
        "tile_rows": -(-rows // _TILES),
        "tile_cols": -(-cols // _TILES),
        "radius_of_screen": _radius(name, k.screen),
        "ambient": ambient,
        "collect": _horner([glsl(each) for each in powers], "r"),
        "answer": vector(answer),
        "spread": glsl(spread),
        **known,
    }


def _about_pair(name: str, k: PairConstants, density: float, *, beside: bool) -> dict[str, Any]:
    bh, bw = len(k.down), len(k.across)
    share = [glsl(float(each.flat[0])) for each in k.share]
    if k.cell:
        everywhere = np.ones(k.share.shape[1:], bool)
        found = [_polynomial(each[None], k.cell, k.shape, everywhere) for each in k.share]
        if max(off for _, off in found) > _ALIKE * k.share.max():
            raise _refused(name, "a map of crosstalk that varies smoothly")
        share = [text for text, _ in found]
    sigma = pair.block_of(density)[1]
    reach = 3 * math.ceil(sigma + 1)
    line = smooth(np.eye(1, 2 * reach + 1, reach)[:, None], sigma)[0, 0]
    return {
        "dome": False,
        "targets": [("GHOSTS", 2 * bw, bh), ("MEANS", 2 * bw, bh), ("VEIL", 2 * bw, bh)],
        "weights_of": [(k - reach, glsl(w)) for k, w in enumerate(line.tolist()) if w],
        "share": share,
        **of_any_pair(k, beside=beside),
    }


def _radius(name: str, screen: NDArray[np.bool_]) -> str:
    """Radius of a round screen in the middle of the picture, pixels; beyond a full one."""
    rows, cols = screen.shape
    row, col = np.ogrid[:rows, :cols]
    far = np.hypot(row + 0.5 - rows / 2, col + 0.5 - cols / 2)
    inner, outer = far[screen].max(), far[~screen].min(initial=np.inf)
    if inner >= outer:
        raise _refused(name, "a round screen in the middle of the picture")
    return glsl(min((inner + outer) / 2, 2 * inner))


def _polynomial(
    planes: NDArray[np.float64], cell: int, shape: tuple[int, int], on: NDArray[np.bool_]
) -> tuple[str, float]:
    """Fits a map by cells, of one plane or three, and tells by how much it is off at most.

    The text has x and y from -1 to 1 over a picture of that `shape`.
    """
    row, col = np.nonzero(on)
    y, x = ((at + 0.5) * 2 * cell / side - 1 for at, side in zip((row, col), shape, strict=True))
    powers = [(i, j) for j in range(_DEGREE + 1) for i in range(_DEGREE + 1 - j)]
    terms = np.stack([x**i * y**j for i, j in powers], axis=1)
    known = planes[:, on].T
    found = np.linalg.lstsq(terms, known)[0]
    off = float(np.abs(terms @ found - known).max())
    of = {
        power: vector(each) if len(each) > 1 else glsl(each[0])
        for power, each in zip(powers, found, strict=True)
    }
    rows = [_horner([of[i, j] for i in range(_DEGREE + 1 - j)], "x") for j in range(_DEGREE + 1)]
    return _horner(rows, "y"), off


def _horner(factors: list[str], by: str) -> str:
    """A polynomial, from its constant term on."""
    *lower, text = factors
    for each in reversed(lower):
        text = f"({each} + {by} * {text})"
    return text


def _refused(name: str, wanted: str) -> InputError:
    return InputError(f"{name}: an ISF shader takes {wanted}; use --for mpv, or NDI (domesim live)")
