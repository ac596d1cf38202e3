"""How the compare page stores light: one base, and what differs from it.

Light becomes codes of its cube root,

    v = floor(top (L / peak)^(1/3) + 1/2),    peak: the brightest value of all pictures,

for the cube root spends codes where the eye does: a code is a relative step of 3 / v. What is seen
with a method is mostly the master's light, scaled and with a veil on top. So a picture is predicted
from others, the bases, that were stored before it,

    p = max(sum_k a_k L_k + b, c)

with a_k and b in tiles of `TILE` pixels by least squares of the codes, between whose centres they
are interpolated, and c the picture's least light: what subtraction clips is uniform in a bare dome.
Stored is v minus the code of p, where that is more than 1; a picture without bases is stored as
green, red - green and blue - green. Differences of neighbours in a row (modulo 65536) become bytes,
large ones with two more; all is deflated (zlib) and written in base64.

`pack` takes the largest `top` with which the pictures fit into so many bytes: `Packed.error` says
what that costs. ``templates/compare-light.js`` unpacks.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

POWER = 3.0
TILE = 32
FINEST = 65535
"""Largest `top`."""
STEPS = 16
"""How often `top` may be divided by the root of 2."""
LEAST, PER_OCTAVE = 0.05, 16
"""Faintest difference of a map, JND; and codes in an octave of differences."""

_ESCAPE = 255  # what does not fit into a byte follows in two
_SAMPLE = 8  # sizes are estimated from one row of so many
_FLAT = 5e-4  # light so little above the least, relatively, is the least

Pictures: TypeAlias = NDArray[np.float32]
Codes: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]


@final
@dataclass(frozen=True)
class Packed:
    """Pictures as the page carries them.

    Parameters
    ----------
    top, peak
        As in the module's docstring; `peak` in units of projector white.
    bases
        Numbers of the pictures that each picture is predicted from.
    payloads
        The pictures, in base64.
    """

    top: int
    peak: float
    bases: tuple[tuple[int, ...], ...]
    payloads: tuple[str, ...]

    def error(self, light: float) -> float:
        """Largest relative error of light of that size, 1.0 = projector white."""
        return float(POWER / (self.top * (light / self.peak) ** (1 / POWER)))


def pack(pictures: Sequence[Pictures], mask: Mask, eyes: int, room: float) -> Packed:
    """Encode pictures in at most `room` characters, or with the smallest `top`.

    Parameters
    ----------
    pictures
        (row, col, 3) linear light >= 0 each, 1.0 = projector white: views in order, the left eye's
        and then the right eye's of each. The first view is the base of all.
    mask
        (row, col): what lies outside is not stored.
    eyes
        Pictures of a view, 1 or 2.
    room
        Characters of all payloads.
    """
    peak = max(float(picture[mask].max(initial=0)) for picture in pictures) or 1.0
    planes = [np.where(mask, np.moveaxis(p, -1, 0).astype(np.float64), 0) for p in pictures]
    models = [_modelled(planes, number, eyes, mask) for number in range(len(planes))]
    heads = [model.coefficients for model in models]
    sampled = (room - sum(len(deflated(head)) for head in heads)) / _SAMPLE
    low, high = 0, STEPS
    while low < high:  # the least division that fits, by the sample
        middle = (low + high) // 2
        parts = _encoded(planes, models, mask, peak, _top(middle), _SAMPLE)
        fits = sum(len(deflated(part)) for part in parts) <= sampled
        low, high = (low, middle) if fits else (middle + 1, high)
    while True:
        parts = _encoded(planes, models, mask, peak, _top(low))
        payloads = [deflated(head + part) for head, part in zip(heads, parts, strict=True)]
        if sum(map(len, payloads)) <= room or low == STEPS:
            break
        low += 1
    bases = tuple(model.bases for model in models)
    return Packed(_top(low), peak, bases, tuple(payloads))


def packed_map(differences: NDArray[np.float32], mask: Mask) -> str:
    """(row, col) visible differences, JND, as bytes c of LEAST 2^((c - 1) / PER_OCTAVE); 0 is less.

    Stored are differences along rows, modulo 256.
    """
    octaves = np.log2(np.maximum(differences, 1e-9) / LEAST)
    codes = np.clip(np.rint(PER_OCTAVE * octaves) + 1, 0, 255) * mask
    return deflated(np.diff(codes.astype(np.uint8), axis=1, prepend=np.uint8(0)).tobytes())


def deflated(data: bytes) -> str:
    """Bytes as the page carries them.

    They are noise or zeros: only runs are looked for, which takes a tenth of the time.
    """
    packer = zlib.compressobj(strategy=zlib.Z_RLE)
    return base64.b64encode(packer.compress(data) + packer.flush()).decode("ascii")


def _top(divided: int) -> int:
    return round(FINEST / 2 ** (divided / 2))


@final
@dataclass(frozen=True)
class _Model:
    """How a picture is predicted.

    Parameters
    ----------
    bases
        Numbers of pictures.
    grids
        (primary, base and 1, tile row, tile col) of a and b, float32.
    least
        (primary,) c, float32.
    """

    bases: tuple[int, ...]
    grids: NDArray[np.float32]
    least: NDArray[np.float32]

    @property
    def coefficients(self) -> bytes:
        """How it is stored."""
        return np.concatenate([self.grids.ravel(), self.least]).astype("<f4").tobytes()

    def predict(self, light: Sequence[NDArray[Any]], rows: NDArray[np.intp]) -> NDArray[Any]:
        """(primary, row, col) of p in those rows, from the bases' light there."""
        cols = light[0].shape[-1]
        result = np.zeros_like(light[0])
        for each, base in zip(np.moveaxis(self.grids, 1, 0), [*light, 1.0], strict=True):
            result += _interpolated(each.astype(np.float64), rows, cols) * base
        return np.asarray(np.maximum(result, self.least.astype(np.float64)[:, None, None]))


def _interpolated(grids: NDArray[Any], rows: NDArray[np.intp], cols: int) -> NDArray[Any]:
    """(primary, row, col) between the tiles' centres; beyond the outermost it is theirs."""
    for axis, places in ((1, rows), (2, np.arange(cols))):
        last = grids.shape[axis] - 1
        at = np.clip((places + 0.5) / TILE - 0.5, 0, last)
        before = np.minimum(at.astype(np.intp), max(last - 1, 0))
        after = np.minimum(before + 1, last)
        share = (at - before).reshape(-1, *(1,) * (2 - axis))
        one, other = np.take(grids, before, axis), np.take(grids, after, axis)
        grids = one * (1 - share) + other * share
    return grids


def _modelled(planes: Sequence[NDArray[Any]], number: int, eyes: int, mask: Mask) -> _Model:
    """The better of two: from the first view, or from the view before.

    Where both views are the same, so are both models, and the first counts.
    """
    view, eye = divmod(number, eyes)
    candidates = {tuple(first + k for k in (eye, 1 - eye)[:eyes])
                  for first in {0, (view - 1) * eyes} if view}  # fmt: skip
    if not candidates:
        return _Model((), np.zeros((3, 0, 1, 1), np.float32), np.zeros(3, np.float32))
    rows = np.arange(0, mask.shape[0], _SAMPLE)
    wanted = np.cbrt(planes[number][:, rows])

    def off(model: _Model) -> float:
        predicted = np.cbrt(model.predict([planes[base][:, rows] for base in model.bases], rows))
        return float(np.log1p(FINEST * np.abs(predicted - wanted))[:, mask[rows]].sum())

    return min((_fitted(planes, number, bases, mask) for bases in sorted(candidates)), key=off)


def _fitted(
    planes: Sequence[NDArray[Any]], number: int, bases: tuple[int, ...], mask: Mask
) -> _Model:
    """Least squares in each tile; where a tile has too little to tell, as in the whole picture."""
    light = planes[number]
    least = np.array([plane[mask].min() for plane in light], np.float32)
    starts = [np.arange(0, side, TILE) for side in mask.shape]
    shape = len(starts[0]), len(starts[1])
    count = len(bases) + 1
    grids = np.empty((3, count, *shape), np.float32)
    for primary, plane in enumerate(light):
        above = mask & (plane > least[primary] * (1 + _FLAT))
        # A code is worth L^(2/3) of light; faint light is not worth more than a thousandth
        weight = above * np.maximum(plane, 1e-3) ** (-4 / 3)
        known = [*(planes[base][primary] for base in bases), np.ones_like(plane)]
        moments = np.empty((*shape, count, count + 1))
        for i, one in enumerate(known):
            for j, other in enumerate([*known, plane]):
                product = np.add.reduceat(weight * one * other, starts[0], axis=0)
                moments[..., i, j] = np.add.reduceat(product, starts[1], axis=1)
        whole = moments.sum((0, 1)) / (moments.shape[0] * moments.shape[1])
        moments += 1e-3 * whole
        squares = moments[..., :count]
        ridge = 1e-12 * np.trace(squares, axis1=-2, axis2=-1)[..., None, None] + 1e-30
        solved = np.linalg.solve(squares + ridge * np.eye(count), moments[..., count:])
        grids[primary] = np.moveaxis(solved[..., 0], -1, 0)
    return _Model(bases, grids, least)


def _encoded(
    planes: Sequence[NDArray[Any]],
    models: Sequence[_Model],
    mask: Mask,
    peak: float,
    top: int,
    every: int = 1,
) -> list[bytes]:
    """What is off the prediction of all pictures; in one row of `every`, if that is above 1."""
    rows = np.arange(0, mask.shape[0], every)
    inside = mask[rows]
    light = peak * (np.arange(top + 1) / top) ** POWER  # of each code
    stored: list[NDArray[Any]] = []
    parts = []
    for plane, model in zip(planes, models, strict=True):
        exact = top * np.cbrt(plane[:, rows] / peak)
        if model.bases:
            predicted = model.predict([stored[base] for base in model.bases], rows)
            before = _coded(predicted, peak, top)
            off = np.where(np.abs(exact - before) > 1, np.floor(exact - before + 0.5), 0)
            off = np.where(inside, off.astype(np.int64), 0)
            codes = before + off
        else:
            codes = np.floor(exact + 0.5).astype(np.int64)
            off = np.where(inside, codes - codes[1], 0)
            off[1] = np.where(inside, codes[1], 0)
        stored.append(light[np.where(inside, codes, 0)])
        parts.append(_bytes(off))
    return parts


def _coded(light: NDArray[Any], peak: float, top: int) -> Codes:
    codes = np.floor(top * np.cbrt(np.maximum(light, 0) / peak) + 0.5)
    return np.asarray(np.minimum(codes, top), np.int64)


def _bytes(values: Codes) -> bytes:
    """Differences along rows, zigzag: small ones, and then those that do not fit."""
    steps = np.diff(values, axis=-1, prepend=0)
    folded = np.where(steps >= 0, 2 * steps, -2 * steps - 1).ravel()
    small = np.minimum(folded, _ESCAPE).astype(np.uint8)
    return small.tobytes() + (folded[folded >= _ESCAPE] - _ESCAPE).astype("<u4").tobytes()
