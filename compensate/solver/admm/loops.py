"""The solver's inner loops, each fused into one pass over memory, compiled by Numba.

Only `fused` imports this module: Numba is of the extra ``fast``. The loops do what `level`,
`anderson`, `hessian` and `dome` do in strips of NumPy, and with the same results but for rounding.
Spectra are real arrays here, (row, 2 x (col // 2 + 1)), of real and imaginary parts by turns.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba.extending import overload

_EXACT = {"nsz"}  # no sum is reordered, and none is fused with a product: what Numba loads from its
# cache fuses others than what it has just compiled

_COMPILED: Any = numba.njit(
    parallel=True, cache=True, nogil=True, error_model="numpy", fastmath=_EXACT
)


def at(value, row, col):  # type: ignore[no-untyped-def]
    """A number, or an array's element."""
    raise NotImplementedError


@overload(at, inline="always")
def _at(value, row, col):  # type: ignore[no-untyped-def]
    if isinstance(value, numba.types.Array):
        return lambda value, row, col: value[row, col]
    return lambda value, row, col: value


def one(like):  # type: ignore[no-untyped-def]
    """1 in a number's type: a literal would make single precision double, and slow."""
    raise NotImplementedError


@overload(one, inline="always")
def _one(like):  # type: ignore[no-untyped-def]
    if like == numba.types.float32:
        return lambda like: np.float32(1)
    return lambda like: 1.0


@_COMPILED
def towards(out: Any, s: Any, z: Any, weight: Any) -> None:
    """`Level.towards` of a plane."""
    rows, cols = z.shape
    for i in numba.prange(s.shape[0]):
        for j in range(s.shape[1]):
            out[i, j] = -weight * s[i, j]
        if i < rows:
            for j in range(cols):
                out[i, j] += (weight + weight) * z[i, j]


@_COMPILED
def move(s: Any, w: Any, z: Any, relaxation: Any) -> None:
    """`Level.move` of a plane."""
    rows, cols = z.shape
    for i in numba.prange(s.shape[0]):
        if i < rows:
            for j in range(cols):
                w[i, j] -= z[i, j]
        for j in range(s.shape[1]):
            w[i, j] *= relaxation
            s[i, j] += w[i, j]


@_COMPILED
def nearest_pair(  # noqa: PLR0913 - Numba takes plain values
    z: Any, other_z: Any, s: Any, other_s: Any, lower: Any, other_lower: Any, own: Any,
    other_own: Any, other: Any, other_other: Any, width: Any, other_width: Any, shrink: Any,
) -> None:  # fmt: skip
    """`Level.feasible` of one primary whose leaks stay in it: planes of both eyes."""
    rows, cols = z.shape
    for i in numba.prange(rows):
        for j in range(cols):
            a, b = at(own, i, j), at(other, i, j)
            f, e = at(other_own, i, j), at(other_other, i, j)
            left, right = s[i, j] * shrink, other_s[i, j] * shrink
            determinant = a * f - b * e
            x, y = (f * left - b * right) / determinant, (a * right - e * left) / determinant
            low, other_low = lower[i, j], other_lower[i, j]
            high, other_high = low + at(width, i, j), other_low + at(other_width, i, j)
            x1, y1 = min(max(x, low), high), min(max(y, other_low), other_high)
            if x1 != x or y1 != y:
                hx, hy, h = a * a + e * e, b * b + f * f, a * b + e * f
                # Each view's best light where the other's is at its bound
                dx, dy = x1 - x, y1 - y
                x2 = min(max(x - h / hx * dy, low), high)
                y2 = min(max(y - h / hy * dx, other_low), other_high)
                u, v = x2 - x, y2 - y
                first = u * (hx * u + (h + h) * dy) + hy * dy * dy
                second = v * (hy * v + (h + h) * dx) + hx * dx * dx
                if first <= second:
                    x1 = x2
                else:
                    y1 = y2
            z[i, j] = a * x1 + b * y1
            other_z[i, j] = e * x1 + f * y1


@_COMPILED
def advance(
    plane: Any, r: Any, codes: Any, units: Any, other_codes: Any, other_units: Any, was: Any,
    weights: Any, largest_code: Any, tiny: Any,
) -> None:  # fmt: skip
    """`anderson._advance` of two differences."""
    cols = plane.shape[1]
    for i in numba.prange(plane.shape[0]):
        rows = np.empty((2, cols), np.float32)
        unit, other = units[i, 0], other_units[i, 0]
        largest, other_largest = tiny, tiny
        for j in range(cols):
            a = unit * codes[i, j]
            first = -(r[i, j] + was[0] * a + was[1] * (other * other_codes[i, j]))
            rows[0, j], rows[1, j] = first, a + first
            largest = max(largest, abs(first))
            other_largest = max(other_largest, abs(a + first))
        unit, other = largest / largest_code, other_largest / largest_code
        units[i, 0], other_units[i, 0] = unit, other
        for j in range(cols):
            a, b = np.rint(rows[0, j] / unit), np.rint(rows[1, j] / other)
            codes[i, j], other_codes[i, j] = a, b
            plane[i, j] += weights[0] * (unit * a) + weights[1] * (other * b)


@numba.njit(inline="always", error_model="numpy", fastmath={"nsz"})
def solve3(m: Any, sigma: Any, x: Any, y: Any, z: Any, b0: Any, b1: Any, b2: Any) -> Any:
    """(sum of x, y, z times three matrices + diag(sigma))^-1 (b0, b1, b2), by LDL'."""
    d0 = x * m[0, 0, 0] + y * m[1, 0, 0] + z * m[2, 0, 0] + sigma[0]
    a10 = x * m[0, 1, 0] + y * m[1, 1, 0] + z * m[2, 1, 0]
    a20 = x * m[0, 2, 0] + y * m[1, 2, 0] + z * m[2, 2, 0]
    a21 = x * m[0, 2, 1] + y * m[1, 2, 1] + z * m[2, 2, 1]
    unit = one(d0)
    i0 = unit / d0
    l10, l20 = a10 * i0, a20 * i0
    d1 = x * m[0, 1, 1] + y * m[1, 1, 1] + z * m[2, 1, 1] + sigma[1] - l10 * a10
    i1 = unit / d1
    e21 = a21 - l20 * a10
    l21 = e21 * i1
    d2 = x * m[0, 2, 2] + y * m[1, 2, 2] + z * m[2, 2, 2] + sigma[2] - l20 * a20 - l21 * e21
    b1 = b1 - l10 * b0
    b2 = (b2 - l20 * b0 - l21 * b1) * (unit / d2)
    b1 = b1 * i1 - l21 * b2
    b0 = b0 * i0 - l10 * b1 - l20 * b2
    return b0, b1, b2


@_COMPILED
def blocks3(a: Any, b: Any, c: Any, plus: Any, squares: Any, matrices: Any, sigma: Any) -> None:
    """`Blocks.solve` of three planes."""
    p0, p1, p2 = plus
    first, second, third = squares
    for i in numba.prange(first.shape[0]):
        for k in range(2 * first.shape[1]):
            j = k // 2
            a[i, k], b[i, k], c[i, k] = solve3(
                matrices, sigma, first[i, j], second[i, j], third[i, j],
                a[i, k] + p0[i, k], b[i, k] + p1[i, k], c[i, k] + p2[i, k],
            )  # fmt: skip


@_COMPILED
def dome3(
    a: Any, b: Any, c: Any, plus: Any, v: Any, u: Any, squares: Any, matrices: Any, sigma: Any,
    sums: Any,
) -> None:  # fmt: skip
    """The first half of `DomeHessian.solve`, of three primaries and one mode.

    The row's inner products go to `sums` (row, 9): of U before, of V and of U after.
    """
    p0, p1, p2 = plus
    first, second, third = squares
    last = 2 * first.shape[1]
    for i in numba.prange(first.shape[0]):
        row = np.zeros(9)
        for k in range(last):
            j = k // 2
            x, y, z = a[i, k] + p0[i, k], b[i, k] + p1[i, k], c[i, k] + p2[i, k]
            share = sums[i, 0] if k < 2 else (sums[i, 1] if k >= last - 2 else 2.0)
            at_u, at_v = share * u[i, k], share * v[i, k]
            row[0] += at_u * x
            row[1] += at_u * y
            row[2] += at_u * z
            x, y, z = solve3(matrices, sigma, first[i, j], second[i, j], third[i, j], x, y, z)
            row[3] += at_v * x
            row[4] += at_v * y
            row[5] += at_v * z
            row[6] += at_u * x
            row[7] += at_u * y
            row[8] += at_u * z
            a[i, k], b[i, k], c[i, k] = x, y, z
        sums[i] = row


@_COMPILED
def correct3(
    a: Any, b: Any, c: Any, v: Any, u: Any, squares: Any, matrices: Any, sigma: Any, weights: Any
) -> None:
    """The second half: subtracts B^-1 of V and U times `weights` (3, primary), and U times."""
    first, second, third = squares
    for i in numba.prange(first.shape[0]):
        for k in range(2 * first.shape[1]):
            j = k // 2
            at_v, at_u = v[i, k], u[i, k]
            x, y, z = solve3(
                matrices, sigma, first[i, j], second[i, j], third[i, j],
                weights[0, 0] * at_v + weights[1, 0] * at_u,
                weights[0, 1] * at_v + weights[1, 1] * at_u,
                weights[0, 2] * at_v + weights[1, 2] * at_u,
            )  # fmt: skip
            a[i, k] -= x + weights[2, 0] * at_u
            b[i, k] -= y + weights[2, 1] * at_u
            c[i, k] -= z + weights[2, 2] * at_u
