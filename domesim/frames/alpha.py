"""Alpha: code values as stored <-> those of the picture over black, which is what is projected.

Straight ("unassociated") colours are multiplied by alpha in linear light (Porter and Duff 1984),
so that what lies under an alpha of 0 is black. Associated ones are light over black already.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.frame import Frame
from domesim.light import transfer

Codes = NDArray[np.float32]

_WHITE = 100.0  # cd/m²; any will do, for it cancels out
_ROUNDING = 0.5 / 65535


def opacity(plane: NDArray[Any]) -> NDArray[np.float64]:
    """(row, col) alpha, 0..1, of samples as stored."""
    if np.issubdtype(plane.dtype, np.integer):
        return plane / np.float64(np.iinfo(plane.dtype).max)
    return np.clip(np.nan_to_num(plane.astype(np.float64)), 0, 1)


def is_opaque(plane: NDArray[Any]) -> bool:
    """Whether alpha is 1 everywhere."""
    return bool(opacity(plane).min() >= 1)


def shown_over_black(frame: Frame) -> Frame:
    """Composites `frame` over black by its alpha."""
    header = frame.header
    alpha = header.alpha
    if alpha is None or is_opaque(header.extra[alpha]):
        return frame
    taken = "straight" if header.straight else "multiplied by alpha"
    note = f"over black where its alpha lets it through, its colours taken as {taken}"
    noted = replace(header, notes=(*header.notes, note))
    if not header.straight:
        return replace(frame, header=noted)
    if not opacity(header.extra[alpha]).any() and frame.pixels.any():
        way = ADVICE["no alpha of a film" if header.file is None else "no alpha"].given()
        raise InputError(
            f"{frame.path}: wanted an alpha that lets something through, got 0 everywhere over a "
            "picture (captures of games have that). Export it without alpha "
            f"({way})."
        )
    shown = over_black(frame.pixels, header.extra[alpha], frame.colour.transfer)
    return replace(frame, pixels=shown, header=noted)


def over_black(codes: Codes, plane: NDArray[Any], curve: str) -> Codes:
    """(row, col, 3) straight code values of that transfer function -> those over black."""
    alpha, function = opacity(plane), transfer.named(curve, white=_WHITE)
    partly = alpha < 1
    shown = codes.copy()
    light = function.decode(codes[partly].astype(np.float64)) * alpha[partly][:, None]
    shown[partly] = function.encode(light)
    return shown


def straightened(
    codes: Codes, plane: NDArray[Any], curve: str, *, floating: bool
) -> tuple[Codes, NDArray[Any]]:
    """Code values over black -> straight ones, and their alpha.

    Alpha is raised where no colour would do: the picture is brighter than it, or, of floating
    formats, it is 0.
    """
    alpha, function = opacity(plane), transfer.named(curve, white=_WHITE)
    light = function.decode(codes.astype(np.float64))
    needed = np.clip(light.max(axis=-1) / function.decode(np.ones(3)).max(), 0, 1)
    if floating:
        needed[alpha > 0] = 0
    top = np.iinfo(plane.dtype).max if np.issubdtype(plane.dtype, np.integer) else None
    enough = needed if top is None else np.ceil(needed * top - _ROUNDING)
    raised = np.where(needed > alpha + _ROUNDING, enough, plane).astype(plane.dtype)
    alpha = opacity(raised)
    straight = np.where(alpha[..., None] > 0, codes, np.float32(0))
    partly = (alpha > 0) & (alpha < 1)
    straight[partly] = function.encode(light[partly] / alpha[partly][:, None])
    return straight if floating else np.minimum(straight, 1), raised
