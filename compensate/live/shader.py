"""User shaders for mpv and libplacebo: a scene's live pictures as one file.

The passes do what `compensate.aim` does, on a GPU. Textures between passes are of half precision in
players, so that what must be known better is kept in two numbers. A dome's pixels are looked at
once for a floor: what any floor leaves of a cell's light is a table. The floor is found with it by
a relaxed iteration, s + w (G(s) - s), whose error shrinks by half of the feedback over one and that
half in each step, whatever is clipped, if w is one over one and half of the feedback.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, pair
from compensate.aim.dome import DARKEST, EDGE
from compensate.aim.settings import MOST_LIFT
from compensate.live.coding import Coding
from compensate.live.constants import (
    DomeConstants,
    PairConstants,
    constants_of,
    turns_of,
)
from compensate.shows.cue_list import CueList
from domesim import __version__
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.host.console import printable
from domesim.light.blocks import block_sums
from domesim.light.transfer import DCDM, SRGB, ST2084, Gamma, Linear, Table
from domesim.scene import Scene

_EXACT = 1e-6
"""Share of their first error to which floors are found, by tables."""
INTERVALS = 15
"""Pieces of a table: with one more, levels divide a group of 256 threads."""
_SIDE = 256  # texels of a row of spans
LEVELS = 256
"""Levels of missing light, from 0 to white, between which the darkest places are looked for."""


@final
@dataclass(frozen=True)
class _Texture:
    """Numbers that a shader's file holds: (row, col, channel)."""

    values: NDArray[np.float32]

    @property
    def width(self) -> int:
        return int(self.values.shape[1])

    @property
    def height(self) -> int:
        return int(self.values.shape[0])

    @property
    def hex(self) -> str:
        return self.values.astype("<f4").tobytes().hex()


def shader_of(
    scene: Scene,
    rows: int,
    cols: int,
    colour: ColourTag,
    *,
    beside: bool = True,
    aim: Aim | None = None,
    uniforms: bool = False,
) -> str:
    """Writes a user shader for a scene.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    rows, cols
        Size of a view, pixels.
    colour
        What code values are.
    beside
        Whether the video has both views of a pair side by side, and not one above the other.
    aim
        Its settings.
    uniforms
        Whether players may change the lift and turn it off, by libplacebo's ``//!PARAM``: not all
        of them read such a file.

    Returns
    -------
    text
        The shader.

    Raises
    ------
    InputError
        As for `constants_of`; or if no shader knows the colour's curve, or the screen has holes.
    """
    constants = constants_of(scene, rows, cols)
    about = about_scene(scene, rows, cols, colour, beside=beside)
    usual = glsl((aim or Aim()).lift)
    about |= {"lift": "lift" if uniforms else usual, "usual": usual, "uniforms": uniforms}
    about["most_lift"] = glsl(MOST_LIFT)
    if isinstance(constants, DomeConstants):
        name, facts = "dome.glsl.j2", _about_dome(constants)
    else:
        name, facts = "pair.glsl.j2", _about_pair(constants, beside=beside)
    return rendered(name, about | facts)


def script_of(cues: CueList, usual: float, name: str) -> str:
    """Writes a script by which mpv sets a shader's uniforms, frame by frame.

    Parameters
    ----------
    cues
        The cue list.
    usual
        Lift of frames that it does not name.
    name
        Of the script's file.

    Returns
    -------
    text
        In Lua.
    """
    known = [
        {
            **vars(cue),
            "before": cues.lift(cue.first - 1, usual),
            "lift": usual if cue.lift is None else cue.lift,
            "compensating": int(cue.method != "none"),
        }
        for cue in cues.cues
    ]
    for cue in known:
        if cue["method"] == "subtractive":
            cue |= {"before": 0.0, "lift": 0.0}
    return rendered(
        "cues.lua.j2", {"cues": known, "cues_name": cues.name, "usual": usual, "name": name}
    )


def about_scene(
    scene: Scene, rows: int, cols: int, colour: ColourTag, *, beside: bool
) -> dict[str, Any]:
    """What templates say of a scene and its video.

    Parameters
    ----------
    scene
        Dome, or stereo system.
    rows, cols
        Pixels of a view.
    colour
        How the video's code values mean light.
    beside
        Whether views lie side by side, else one above the other.

    Returns
    -------
    about
        Values of the templates' names.
    """
    across, down = (scene.views, 1) if beside else (1, scene.views)
    return {
        "scene": scene.name,
        "described": f"domesim {__version__}; {' '.join(scene.description.split())}",
        "width": across * cols,
        "height": down * rows,
        "white": scene.projector.white,
        "density": f"{scene.viewing.pixels_per_degree(rows, cols):.4g}",
        **_about_coding(Coding(scene.projector, colour)),
    }


def _about_coding(coding: Coding) -> dict[str, Any]:
    """What templates say of code values."""
    curve = coding.curve
    about: dict[str, Any] = {
        "coding": coding.colour.named,
        "mixing": matrix(coding.mixing),
        "back": matrix(np.linalg.inv(coding.mixing)),
        "curve": "power",
        "peak": "1.0",
        "exponent": 1.0,
    }
    match curve:
        case SRGB():
            about["curve"] = "srgb"
        case ST2084():
            about["curve"] = "st2084"
            about["white"] = curve.white
        case DCDM():
            about |= {"peak": glsl(curve.peak / curve.white), "exponent": 2.6}
        case Gamma():
            about["exponent"] = curve.exponent
        case Table():
            codes, light = np.array(curve.levels).T
            roots = light ** (1 / 2.2)
            about |= {
                "curve": "table",
                "roots": _bends(codes, roots),
                "codes": _bends(roots, codes),
            }
        case Linear():
            pass
        case _:
            raise InputError(
                f"{coding.colour.source}: no shader knows this curve; use srgb, bt1886, gamma2.2, "
                f"linear, st2084 or dcdm"
            )
    return about


def _bends(at: NDArray[np.float64], values: NDArray[np.float64]) -> list[tuple[str, str]]:
    """Where a curve of straight pieces bends, and by how much its slope grows there."""
    slopes = np.diff(values) / np.diff(at)
    return list(zip(map(glsl, at), map(glsl, np.diff(slopes, prepend=0)), strict=False))


def _about_dome(k: DomeConstants) -> dict[str, Any]:
    """What the dome's template says of its constants."""
    rows, cols = k.screen.shape
    cell_rows, cell_cols = k.gain.shape
    if (np.diff(k.screen.astype(np.int8), axis=1) == 1).sum(axis=1).max() > 1:
        raise InputError("a shader takes screens whose rows are in one piece, got one with holes")
    some = k.screen.any(axis=1)
    spans = np.zeros((-(-rows // _SIDE) * _SIDE, 2))
    spans[:rows, 0] = k.screen.argmax(axis=1) * some
    spans[:rows, 1] = (cols - k.screen[:, ::-1].argmax(axis=1)) * some
    collect = k.collect * k.cell**2
    largest = np.abs(collect.sum(axis=(1, 2))).max()
    feedback = float(np.abs(np.linalg.eigvals(k.core @ _overlap(k))).max())
    return {
        "textures": ("SPANS", "GAIN", "AMBIENT", "SPREAD", "COLLECT", "CORE"),
        "spans_side": _SIDE,
        "spans": _texture(spans.reshape(-1, _SIDE, 2)),
        "gain": _texture(k.gain[..., None]),
        "ambient": _texture(_of_four(np.moveaxis(k.ambient, 0, -1))),
        "spread": _texture(k.spread.reshape(-1, cell_cols, 1)),
        "collect": _texture(collect.reshape(-1, cell_cols, 1) / largest),
        "core": _texture(_of_four(np.moveaxis(k.core, 0, -1)) * largest),
        "rank": len(k.spread),
        "rows": rows,
        "cols": cols,
        "cell": k.cell,
        "cell_rows": cell_rows,
        "cell_cols": cell_cols,
        "steps": math.ceil(math.log(_EXACT) / math.log(feedback / 2 / (1 + feedback / 2))),
        "highest": glsl(_highest(k)),
        "relaxation": glsl(1 / (1 + feedback / 2)),
        **of_any_dome(k),
    }


def _about_pair(k: PairConstants, *, beside: bool) -> dict[str, Any]:
    """What the pair's template says of its constants."""
    return {
        "textures": ("SHARE", "ACROSS", "DOWN"),
        "share": _texture(k.share.reshape(-1, k.share.shape[2], 1)),
        "across": _texture(k.across[..., None]),
        "down": _texture(k.down[..., None]),
        "cell": k.cell,
        "cell_rows": k.share.shape[1],
        "cell_cols": k.share.shape[2],
        **of_any_pair(k, beside=beside),
    }


def of_any_dome(k: DomeConstants) -> dict[str, Any]:
    """What every dome's template says of its constants, whatever textures it has."""
    rows, cols = k.screen.shape
    return {
        "block": k.block,
        "radius": k.radius,
        "block_rows": -(-rows // k.block),
        "block_cols": -(-cols // k.block),
        "intervals": INTERVALS,
        "weights": vector(k.weights),
        "dark": glsl(k.dark),
        "middle": glsl(math.log(k.dark) / 2),
        "variance": glsl(EDGE**2),
        "darkest": glsl(DARKEST),
        "levels": LEVELS,
        "kept": vector(k.kept[0]) if k.kept.any() else "",
    }


def of_any_pair(k: PairConstants, *, beside: bool) -> dict[str, Any]:
    """What every pair's template says of its constants, whatever textures it has.

    Parameters
    ----------
    k
        The constants.
    beside
        Whether views lie side by side, else one above the other.

    Returns
    -------
    about
        Values of the templates' names.
    """
    return {
        "rows": k.rows,
        "cols": k.cols,
        "block": k.block,
        "block_rows": len(k.down),
        "block_cols": len(k.across),
        "beside": beside,
        "matrices": [matrix(each) for each in k.matrices],
        "black": [vector(black) for black in k.black],
        "kept": [vector(kept) for kept in k.kept] if k.kept.any() else [],
        "rounds": -(-turns_of(k) // 2),
        "weights": vector(k.weights),
        "veil": glsl(pair.SHARE),
    }


def counted(k: DomeConstants) -> NDArray[np.float64]:
    """Returns the (cell row, cell col) count of pixels of the screen."""
    return np.asarray(block_sums(k.screen.astype(np.float64), k.cell))


def _overlap(k: DomeConstants) -> NDArray[np.float64]:
    """(rank, rank) what light as each mode has it excites."""
    return np.asarray(np.einsum("jrc,krc,rc->jk", k.collect, k.spread, counted(k)))


def _highest(k: DomeConstants) -> float:
    """Most that there is of light: ambient light, and what reflects from a white screen."""
    excited = k.core @ np.tensordot(k.collect, counted(k), 2)
    return float((k.ambient + np.tensordot(excited, k.spread, 1)).max())


def _texture(values: NDArray[np.floating]) -> _Texture:
    return _Texture(np.asarray(values, np.float32))


def _of_four(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Three channels and an empty one: no GPU takes three."""
    return np.concatenate([values, 0 * values[..., :1]], axis=-1)


def _told(value: Any) -> Any:
    """What a digest is made of."""
    return value.hex if isinstance(value, _Texture) else value


def glsl(value: float) -> str:
    """A number as GLSL reads it."""
    text = repr(float(np.float32(value)))
    return text if "." in text or "e" in text else f"{text}.0"


def vector(values: NDArray[np.floating]) -> str:
    """Three numbers."""
    return f"vec3({', '.join(map(glsl, values.tolist()))})"


def matrix(values: NDArray[np.floating]) -> str:
    """Column by column, as GLSL has them."""
    return f"mat3({', '.join(glsl(each) for each in values.T.ravel().tolist())})"


def rendered(name: str, about: dict[str, Any]) -> str:
    """A template's text, with a digest of all that it is made of.

    Parameters
    ----------
    name
        The template's file.
    about
        Values of its names.

    Returns
    -------
    text
        The shader's source.
    """
    import jinja2  # noqa: PLC0415 - slow to import

    said = repr(sorted((key, _told(value)) for key, value in about.items()))
    about |= {"digest": hashlib.sha256(said.encode()).hexdigest()[:16]}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("compensate.live"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    facts = {
        # A scene's name may have lines, which a player would take for its own
        key: " ".join(printable(value).split()) if isinstance(value, str) else value
        for key, value in about.items()
    }
    text = environment.get_template(name).render(k=SimpleNamespace(**facts))
    return "\n".join(line.rstrip() for line in text.splitlines() if line.strip()) + "\n"
