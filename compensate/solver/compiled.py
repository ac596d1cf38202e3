"""The solver's inner loops, each fused into one pass over memory, compiled by Numba.

Only `fused` imports this module: Numba is of the extra ``fast``. The loops do what `level`,
`anderson` and `hessian` do in strips of NumPy, and with the same results but for rounding. Spectra
are real arrays here, (row, 2 x (col // 2 + 1)), of real and imaginary parts by turns.
"""

from __future__ import annotations

import os
from typing import Any

import numba
import numpy as np
from numba.extending import overload

# Before OpenMP is loaded, which is at the first loop. Threads that wait for others in a busy loop
# made a solution ten times slower while other programs ran, and are no faster while none do.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

_EXACT = {"contract", "nsz"}  # of fast-math: no sum is reordered

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


@_COMPILED
def towards(out: Any, s: Any, lower: Any, width: Any, damping: Any, weight: Any) -> None:
    """`Level.towards`."""
    rows, cols = lower.shape
    for i in numba.prange(s.shape[0]):
        for j in range(s.shape[1]):
            out[i, j] = -weight * s[i, j]
        if i < rows:
            for j in range(cols):
                z = s[i, j] * (weight / (weight + at(damping, i, j)))
                z = min(max(z, lower[i, j]), lower[i, j] + at(width, i, j))
                out[i, j] += (weight + weight) * z


@_COMPILED
def move(
    s: Any, w: Any, lower: Any, width: Any, damping: Any, weight: Any, relaxation: Any
) -> None:
    """`Level.move`."""
    rows, cols = lower.shape
    for i in numba.prange(s.shape[0]):
        if i < rows:
            for j in range(cols):
                z = s[i, j] * (weight / (weight + at(damping, i, j)))
                z = min(max(z, lower[i, j]), lower[i, j] + at(width, i, j))
                w[i, j] -= z
        for j in range(s.shape[1]):
            w[i, j] *= relaxation
            s[i, j] += w[i, j]


@_COMPILED
def lower_bound(
    free: Any, s: Any, w: Any, lower: Any, width: Any, damping: Any, weight: Any, curvature: Any
) -> float:
    """`Level.lower_bound`."""
    rows, cols = lower.shape
    known = 0.0
    for i in numba.prange(s.shape[0]):
        part = 0.0
        inside = cols if i < rows else 0
        for j in range(inside):
            x, damped = w[i, j], at(damping, i, j)
            upper = lower[i, j] + at(width, i, j)
            z = min(max(s[i, j] * (weight / (weight + damped)), lower[i, j]), upper)
            slope = weight * (z + z - s[i, j] - x)
            g = slope + damped * x
            distance = x - lower[i, j] if g > 0 else upper - x
            bound = distance * (curvature + curvature) <= abs(g)
            free[i, j] = 0 if bound else g
            part += 0.5 * x * g - (abs(g) * distance if bound else 0)
        for j in range(inside, s.shape[1]):
            x = w[i, j]
            free[i, j] = 0
            slope = -weight * (s[i, j] + x)
            part -= x * (slope + 0.5 * at(damping, i, j) * x) - 0.5 * x * slope
        known += part
    return known


@_COMPILED
def nearest_pair(
    z: Any, other_z: Any, s: Any, other_s: Any, contrast: Any, other_contrast: Any, lower: Any,
    other_lower: Any, own: Any, other_own: Any, other: Any, other_other: Any, width: Any,
    other_width: Any, shrink: Any,
) -> None:  # fmt: skip
    """`SeenLevel.feasible` of one primary whose leaks stay in it: planes of both eyes."""
    rows, cols = z.shape
    for i in numba.prange(rows):
        for j in range(cols):
            kl, kr = contrast[i, j], other_contrast[i, j]
            a, b = at(own, i, j), at(other, i, j)
            f, e = at(other_own, i, j), at(other_other, i, j)
            left, right = s[i, j] * shrink / kl, other_s[i, j] * shrink / kr
            determinant = a * f - b * e
            x, y = (f * left - b * right) / determinant, (a * right - e * left) / determinant
            low, other_low = lower[i, j], other_lower[i, j]
            high, other_high = low + at(width, i, j), other_low + at(other_width, i, j)
            x1, y1 = min(max(x, low), high), min(max(y, other_low), other_high)
            if x1 != x or y1 != y:
                hx, hy = (kl * a) ** 2 + (kr * e) ** 2, (kl * b) ** 2 + (kr * f) ** 2
                h = kl * kl * a * b + kr * kr * e * f
                # Each eye's best light where the other's is at its bound
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
            z[i, j] = kl * (a * x1 + b * y1)
            other_z[i, j] = kr * (e * x1 + f * y1)


@_COMPILED
def advance(
    plane: Any, r: Any, codes: Any, units: Any, other_codes: Any, other_units: Any, was: Any,
    weights: Any,
) -> None:  # fmt: skip
    """`anderson._advance` of two differences."""
    most, tiny = numba.float32(32767), numba.float32(1e-37)
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
        unit, other = largest / most, other_largest / most
        units[i, 0], other_units[i, 0] = unit, other
        for j in range(cols):
            a, b = np.rint(rows[0, j] / unit), np.rint(rows[1, j] / other)
            codes[i, j], other_codes[i, j] = a, b
            plane[i, j] += weights[0] * (unit * a) + weights[1] * (other * b)


@numba.njit(inline="always", error_model="numpy", fastmath={"contract", "nsz"})
def solve3(m: Any, sigma: Any, x: Any, y: Any, z: Any, b0: Any, b1: Any, b2: Any) -> Any:
    """(sum of x, y, z times three matrices + diag(sigma))^-1 (b0, b1, b2), by LDL'."""
    d0 = x * m[0, 0, 0] + y * m[1, 0, 0] + z * m[2, 0, 0] + sigma[0]
    a10 = x * m[0, 1, 0] + y * m[1, 1, 0] + z * m[2, 1, 0]
    a20 = x * m[0, 2, 0] + y * m[1, 2, 0] + z * m[2, 2, 0]
    a21 = x * m[0, 2, 1] + y * m[1, 2, 1] + z * m[2, 2, 1]
    i0 = 1 / d0
    l10, l20 = a10 * i0, a20 * i0
    d1 = x * m[0, 1, 1] + y * m[1, 1, 1] + z * m[2, 1, 1] + sigma[1] - l10 * a10
    i1 = 1 / d1
    e21 = a21 - l20 * a10
    l21 = e21 * i1
    d2 = x * m[0, 2, 2] + y * m[1, 2, 2] + z * m[2, 2, 2] + sigma[2] - l20 * a20 - l21 * e21
    b1 = b1 - l10 * b0
    b2 = (b2 - l20 * b0 - l21 * b1) * (1 / d2)
    b1 = b1 * i1 - l21 * b2
    b0 = b0 * i0 - l10 * b1 - l20 * b2
    return b0, b1, b2


@_COMPILED
def pair3(
    l0: Any, l1: Any, l2: Any, r0: Any, r1: Any, r2: Any, plus: Any, squares: Any,
    sums: Any, differences: Any, sigma: Any,
) -> None:  # fmt: skip
    """`PairHessian.solve` of three primaries, whose directions leak alike."""
    p0, p1, p2, q0, q1, q2 = plus
    first, second, third = squares
    half = np.float32(0.5)
    for i in numba.prange(first.shape[0]):
        for k in range(2 * first.shape[1]):
            j = k // 2
            x, y, z = first[i, j], second[i, j], third[i, j]
            a0, b0 = l0[i, k] + p0[i, k], r0[i, k] + q0[i, k]
            a1, b1 = l1[i, k] + p1[i, k], r1[i, k] + q1[i, k]
            a2, b2 = l2[i, k] + p2[i, k], r2[i, k] + q2[i, k]
            s0, s1, s2 = solve3(sums, sigma, x, y, z, a0 + b0, a1 + b1, a2 + b2)
            d0, d1, d2 = solve3(differences, sigma, x, y, z, a0 - b0, a1 - b1, a2 - b2)
            l0[i, k], r0[i, k] = half * (s0 + d0), half * (s0 - d0)
            l1[i, k], r1[i, k] = half * (s1 + d1), half * (s1 - d1)
            l2[i, k], r2[i, k] = half * (s2 + d2), half * (s2 - d2)


@_COMPILED
def pair1(
    left: Any, right: Any, plus: Any, square: Any, sums: Any, differences: Any, sigma: Any
) -> None:
    """`PairHessian.solve` of one primary, whose directions leak alike."""
    p, q = plus
    half = np.float32(0.5)
    for i in numba.prange(square.shape[0]):
        for j in range(square.shape[1]):
            s = half / (sums * square[i, j] + sigma)
            d = half / (differences * square[i, j] + sigma)
            for k in (2 * j, 2 * j + 1):
                a, b = left[i, k] + p[i, k], right[i, k] + q[i, k]
                total, difference = (a + b) * s, (a - b) * d
                left[i, k], right[i, k] = total + difference, total - difference


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
    """The second half: less B^-1 of V and U times `weights` (3, primary), and less U times."""
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


@_COMPILED
def channels3_sums(
    a: Any, b: Any, c: Any, plus: Any, v: Any, u: Any, squares: Any, sigma: Any, sums: Any
) -> None:  # fmt: skip
    """`dome3`'s inner products, of planes that are channels, which it leaves as they are."""
    p0, p1, p2 = plus
    first, second, third = squares
    last = 2 * first.shape[1]
    for i in numba.prange(first.shape[0]):
        row = np.zeros(9)
        for j in range(first.shape[1]):
            share = sums[i, 0] if j == 0 else (sums[i, 1] if 2 * j == last - 2 else 2.0)
            k, m = 2 * j, 2 * j + 1
            ur, ui = share * u[i, k], share * u[i, m]
            vr, vi = share * v[i, k], share * v[i, m]
            x, y = a[i, k] + p0[i, k], a[i, m] + p0[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, 1 / (first[i, j] + sigma[0])
            row[0] += by_u
            row[3] += by_v * d
            row[6] += by_u * d
            x, y = b[i, k] + p1[i, k], b[i, m] + p1[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, 1 / (second[i, j] + sigma[1])
            row[1] += by_u
            row[4] += by_v * d
            row[7] += by_u * d
            x, y = c[i, k] + p2[i, k], c[i, m] + p2[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, 1 / (third[i, j] + sigma[2])
            row[2] += by_u
            row[5] += by_v * d
            row[8] += by_u * d
        sums[i] = row


@_COMPILED
def channels3(
    a: Any, b: Any, c: Any, plus: Any, v: Any, u: Any, squares: Any, sigma: Any, weights: Any
) -> None:  # fmt: skip
    """`dome3` and `correct3` of planes that are channels."""
    p0, p1, p2 = plus
    first, second, third = squares
    for i in numba.prange(first.shape[0]):
        for j in range(first.shape[1]):
            d0 = 1 / (first[i, j] + sigma[0])
            d1 = 1 / (second[i, j] + sigma[1])
            d2 = 1 / (third[i, j] + sigma[2])
            for k in (2 * j, 2 * j + 1):
                at_v, at_u = v[i, k], u[i, k]
                x = a[i, k] + p0[i, k] - weights[0, 0] * at_v - weights[1, 0] * at_u
                a[i, k] = d0 * x - weights[2, 0] * at_u
                x = b[i, k] + p1[i, k] - weights[0, 1] * at_v - weights[1, 1] * at_u
                b[i, k] = d1 * x - weights[2, 1] * at_u
                x = c[i, k] + p2[i, k] - weights[0, 2] * at_v - weights[1, 2] * at_u
                c[i, k] = d2 * x - weights[2, 2] * at_u


_INLINE: Any = numba.njit(inline="always", error_model="numpy", fastmath={"contract", "nsz"})


@_INLINE
def pinned3(
    low0: Any, low1: Any, low2: Any, high0: Any, high1: Any, high2: Any, d0: Any, d1: Any, d2: Any,
    coupled: Any, pinned: Any,
) -> Any:  # fmt: skip
    """The least d'(coupled)d within bounds, by its active set; `pinned` by which are pinned."""
    at0, at1, at2 = d0, d1, d2
    held = 0
    for _ in range(8):
        # Who is out of bounds is pinned to the bound
        change = 0
        if d0 < low0 or d0 > high0:
            at0, change = (low0 if d0 < low0 else high0), 1
        if d1 < low1 or d1 > high1:
            at1, change = (low1 if d1 < low1 else high1), change | 2
        if d2 < low2 or d2 > high2:
            at2, change = (low2 if d2 < low2 else high2), change | 4
        if change == 0:
            # ... and let go if it pulls inwards
            if held & 1 and low0 < high0:
                g = coupled[0, 0] * d0 + coupled[0, 1] * d1 + coupled[0, 2] * d2
                change |= 1 if (g < 0 if at0 == low0 else g > 0) else 0
            if held & 2 and low1 < high1:
                g = coupled[1, 0] * d0 + coupled[1, 1] * d1 + coupled[1, 2] * d2
                change |= 2 if (g < 0 if at1 == low1 else g > 0) else 0
            if held & 4 and low2 < high2:
                g = coupled[2, 0] * d0 + coupled[2, 1] * d1 + coupled[2, 2] * d2
                change |= 4 if (g < 0 if at2 == low2 else g > 0) else 0
            if change == 0:
                break
            held &= ~change
        else:
            held |= change
        e0 = at0 if held & 1 else 0 * d0
        e1 = at1 if held & 2 else 0 * d1
        e2 = at2 if held & 4 else 0 * d2
        d0 = pinned[held, 0, 0] * e0 + pinned[held, 0, 1] * e1 + pinned[held, 0, 2] * e2
        d1 = pinned[held, 1, 0] * e0 + pinned[held, 1, 1] * e1 + pinned[held, 1, 2] * e2
        d2 = pinned[held, 2, 0] * e0 + pinned[held, 2, 1] * e1 + pinned[held, 2, 2] * e2
        d0 = e0 if held & 1 else d0
        d1 = e1 if held & 2 else d1
        d2 = e2 if held & 4 else d2
    return min(max(d0, low0), high0), min(max(d1, low1), high1), min(max(d2, low2), high2)


@_INLINE
def best3(
    p: Any, q: Any, r: Any, bounds: Any, extra: Any, free: Any, coupled: Any, pinned: Any,
    relaxation: Any, settled: Any,
) -> Any:  # fmt: skip
    """The best light of one pixel, of s."""
    low0, high0, low1, high1, low2, high2 = bounds
    x = free[0, 0] * p + free[0, 1] * q + free[0, 2] * r
    y = free[1, 0] * p + free[1, 1] * q + free[1, 2] * r
    z = free[2, 0] * p + free[2, 1] * q + free[2, 2] * r
    low0, low1, low2 = low0 - x, low1 - y, low2 - z
    high0, high1, high2 = high0 - x, high1 - y, high2 - z
    d0, d1, d2 = 0 * p, 0 * q, 0 * r
    if max(low0, low1, low2, -high0, -high1, -high2) > 0:
        d0, d1, d2 = pinned3(low0, low1, low2, high0, high1, high2, d0, d1, d2, coupled, pinned)
    if extra != 0:
        for _ in range(200):
            g = coupled[0, 0] * d0 + coupled[0, 1] * d1 + coupled[0, 2] * d2 + extra * (x + d0)
            e0 = min(max(d0 - relaxation * g / (coupled[0, 0] + extra), low0), high0)
            g = coupled[1, 0] * e0 + coupled[1, 1] * d1 + coupled[1, 2] * d2 + extra * (y + d1)
            e1 = min(max(d1 - relaxation * g / (coupled[1, 1] + extra), low1), high1)
            g = coupled[2, 0] * e0 + coupled[2, 1] * e1 + coupled[2, 2] * d2 + extra * (z + d2)
            e2 = min(max(d2 - relaxation * g / (coupled[2, 2] + extra), low2), high2)
            moved = max(abs(e0 - d0), abs(e1 - d1), abs(e2 - d2))
            d0, d1, d2 = e0, e1, e2
            if moved <= settled:
                break
    return x + d0, y + d1, z + d2


@_INLINE
def bounds3(i: Any, j: Any, lowers: Any, widths: Any) -> Any:
    """Of one pixel: lower and upper ones of three primaries by turns."""
    low0, low1, low2 = lowers[0][i, j], lowers[1][i, j], lowers[2][i, j]
    return (
        low0, low0 + at(widths[0], i, j), low1, low1 + at(widths[1], i, j),
        low2, low2 + at(widths[2], i, j),
    )  # fmt: skip


@_COMPILED
def nearest3(
    a: Any, b: Any, c: Any, s0: Any, s1: Any, s2: Any, lowers: Any, widths: Any, damping: Any,
    free: Any, coupled: Any, pinned: Any, opponent: Any, constants: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.answer` of three primaries."""
    rows, cols = a.shape
    least, relaxation, settled = constants
    for i in numba.prange(rows):
        for j in range(cols):
            bounds, extra = bounds3(i, j, lowers, widths), at(damping, i, j) - least
            p, q, r = s0[i, j], s1[i, j], s2[i, j]
            a[i, j], b[i, j], c[i, j] = best3(
                p, q, r, bounds, extra, free, coupled, pinned, relaxation, settled
            )


@_COMPILED
def towards3(
    a: Any, b: Any, c: Any, s0: Any, s1: Any, s2: Any, lowers: Any, widths: Any, damping: Any,
    free: Any, coupled: Any, pinned: Any, opponent: Any, constants: Any, weights: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.towards` of three primaries."""
    rows, cols = lowers[0].shape
    t = opponent + opponent
    least, relaxation, settled = constants
    weight0, weight1, weight2 = weights
    for i in numba.prange(s0.shape[0]):
        inside = cols if i < rows else 0
        for j in range(inside):
            bounds, extra = bounds3(i, j, lowers, widths), at(damping, i, j) - least
            p, q, r = s0[i, j], s1[i, j], s2[i, j]
            x, y, z = best3(p, q, r, bounds, extra, free, coupled, pinned, relaxation, settled)
            a[i, j] = weight0 * (t[0, 0] * x + t[0, 1] * y + t[0, 2] * z - p)
            b[i, j] = weight1 * (t[1, 0] * x + t[1, 1] * y + t[1, 2] * z - q)
            c[i, j] = weight2 * (t[2, 0] * x + t[2, 1] * y + t[2, 2] * z - r)
        for j in range(inside, s0.shape[1]):
            a[i, j] = -weight0 * s0[i, j]
            b[i, j] = -weight1 * s1[i, j]
            c[i, j] = -weight2 * s2[i, j]


@_COMPILED
def move3(
    s0: Any, s1: Any, s2: Any, w0: Any, w1: Any, w2: Any, lowers: Any, widths: Any, damping: Any,
    free: Any, coupled: Any, pinned: Any, opponent: Any, constants: Any, over: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.move` of three primaries, without what s went to."""
    rows, cols = lowers[0].shape
    t = opponent
    least, relaxation, settled = constants
    for i in numba.prange(s0.shape[0]):
        inside = cols if i < rows else 0
        for j in range(s0.shape[1]):
            p, q, r = s0[i, j], s1[i, j], s2[i, j]
            x, y, z = 0 * p, 0 * p, 0 * p
            if j < inside:
                bounds, extra = bounds3(i, j, lowers, widths), at(damping, i, j) - least
                x, y, z = best3(p, q, r, bounds, extra, free, coupled, pinned, relaxation, settled)
            w0[i, j] = over * (w0[i, j] - t[0, 0] * x - t[0, 1] * y - t[0, 2] * z)
            w1[i, j] = over * (w1[i, j] - t[1, 0] * x - t[1, 1] * y - t[1, 2] * z)
            w2[i, j] = over * (w2[i, j] - t[2, 0] * x - t[2, 1] * y - t[2, 2] * z)
            s0[i, j], s1[i, j], s2[i, j] = p + w0[i, j], q + w1[i, j], r + w2[i, j]


@_COMPILED
def move_from(s: Any, w: Any, asked: Any, half: Any, relaxation: Any) -> None:
    """`OpponentLevel.move` of one plane."""
    for i in numba.prange(s.shape[0]):
        for j in range(s.shape[1]):
            r = relaxation * (w[i, j] - half * asked[i, j] - s[i, j] / 2)
            w[i, j] = r
            s[i, j] += r
