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

from compensate.solver.anderson import LARGEST, TINY

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


def one(like):  # type: ignore[no-untyped-def]
    """1, of a number's type: with a literal, single precision would become double, and slow."""
    raise NotImplementedError


@overload(one, inline="always")
def _one(like):  # type: ignore[no-untyped-def]
    if like == numba.types.float32:
        return lambda like: np.float32(1)
    return lambda like: 1.0


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
    other_width: Any, weight: Any, damping: Any, stiffness: Any,
) -> None:  # fmt: skip
    """`SeenLevel.feasible` of one primary whose leaks stay in it: planes of both eyes."""
    rows, cols = z.shape
    for i in numba.prange(rows):
        for j in range(cols):
            kl, kr = contrast[i, j], other_contrast[i, j]
            a, b = at(own, i, j), at(other, i, j)
            f, e = at(other_own, i, j), at(other_other, i, j)
            shrink = weight / (weight + damping * at(stiffness, i, j))
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
    cols = plane.shape[1]
    for i in numba.prange(plane.shape[0]):
        rows = np.empty((2, cols), np.float32)
        unit, other = units[i, 0], other_units[i, 0]
        largest, other_largest = TINY, TINY
        for j in range(cols):
            a = unit * codes[i, j]
            first = -(r[i, j] + was[0] * a + was[1] * (other * other_codes[i, j]))
            rows[0, j], rows[1, j] = first, a + first
            largest = max(largest, abs(first))
            other_largest = max(other_largest, abs(a + first))
        unit, other = largest / LARGEST, other_largest / LARGEST
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
        row, unit = np.zeros(9), one(first[i, 0])
        for j in range(first.shape[1]):
            share = sums[i, 0] if j == 0 else (sums[i, 1] if 2 * j == last - 2 else 2.0)
            k, m = 2 * j, 2 * j + 1
            ur, ui = share * u[i, k], share * u[i, m]
            vr, vi = share * v[i, k], share * v[i, m]
            x, y = a[i, k] + p0[i, k], a[i, m] + p0[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, unit / (first[i, j] + sigma[0])
            row[0] += by_u
            row[3] += by_v * d
            row[6] += by_u * d
            x, y = b[i, k] + p1[i, k], b[i, m] + p1[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, unit / (second[i, j] + sigma[1])
            row[1] += by_u
            row[4] += by_v * d
            row[7] += by_u * d
            x, y = c[i, k] + p2[i, k], c[i, m] + p2[i, m]
            by_u, by_v, d = ur * x + ui * y, vr * x + vi * y, unit / (third[i, j] + sigma[2])
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
        unit = one(first[i, 0])
        for j in range(first.shape[1]):
            d0 = unit / (first[i, j] + sigma[0])
            d1 = unit / (second[i, j] + sigma[1])
            d2 = unit / (third[i, j] + sigma[2])
            for k in (2 * j, 2 * j + 1):
                at_v, at_u = v[i, k], u[i, k]
                x = a[i, k] + p0[i, k] - weights[0, 0] * at_v - weights[1, 0] * at_u
                a[i, k] = d0 * x - weights[2, 0] * at_u
                x = b[i, k] + p1[i, k] - weights[0, 1] * at_v - weights[1, 1] * at_u
                b[i, k] = d1 * x - weights[2, 1] * at_u
                x = c[i, k] + p2[i, k] - weights[0, 2] * at_v - weights[1, 2] * at_u
                c[i, k] = d2 * x - weights[2, 2] * at_u


@_COMPILED
def dots3(a: Any, b: Any, c: Any, v: Any, sums: Any) -> None:
    """`DomeHessian._sums` of one mode, of channels: the row's go to `sums` (row, 3), as below."""
    last = a.shape[1]
    for i in numba.prange(a.shape[0]):
        first, beyond = sums[i, 0], sums[i, 1]
        x, y, z = 0.0, 0.0, 0.0
        for k in range(last):
            at_v = (first if k < 2 else (beyond if k >= last - 2 else 2.0)) * v[i, k]
            x += at_v * a[i, k]
            y += at_v * b[i, k]
            z += at_v * c[i, k]
        sums[i, 0], sums[i, 1], sums[i, 2] = x, y, z


@_COMPILED
def weigh3(
    a: Any, b: Any, c: Any, u: Any, squares: Any, polluted: Any, keep: Any, sums: Any
) -> None:  # fmt: skip
    """Omega² of channels, with U times `polluted` (channel); in place unless it is to `keep` them.

    The row's sums go to `sums` (row, 4): U's inner products with that, and the energy. Before, it
    says how much the first and the last column count.
    """
    first, second, third = squares
    p, q, r = polluted
    last = first.shape[1] - 1
    for i in numba.prange(first.shape[0]):
        by_a, by_b, by_c, energy = 0.0, 0.0, 0.0, 0.0
        low, high = sums[i, 0], sums[i, 1]
        for j in range(last + 1):
            share = low if j == 0 else (high if j == last else 2.0)
            f, g, h = first[i, j], second[i, j], third[i, j]
            for k in (2 * j, 2 * j + 1):
                at_u = u[i, k]
                x, y, z = a[i, k] + p * at_u, b[i, k] + q * at_u, c[i, k] + r * at_u
                fx, gy, hz = f * x, g * y, h * z
                at_u *= share
                by_a += at_u * fx
                by_b += at_u * gy
                by_c += at_u * hz
                energy += share * (x * fx + y * gy + z * hz)
                if not keep:
                    a[i, k], b[i, k], c[i, k] = fx, gy, hz
        sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3] = by_a, by_b, by_c, energy


@_COMPILED
def add3(a: Any, b: Any, c: Any, v: Any, weights: Any) -> None:
    """V times `weights` (channel) added to channels, in place."""
    p, q, r = weights
    for i in numba.prange(a.shape[0]):
        for k in range(a.shape[1]):
            at_v = v[i, k]
            a[i, k] += p * at_v
            b[i, k] += q * at_v
            c[i, k] += r * at_v


_INLINE: Any = numba.njit(forceinline=True, error_model="numpy", fastmath=_EXACT)


# An *active set* of one pixel of three primaries is a byte. Bits 0 to 2 say which primaries are at
# a bound, 3 to 5 that it is the upper one, 7 that another set is to be found. From step to step of
# the solver few sets change.
_WRONG = 128
_TURNS, _FEW = 4, 16  # of a row; not if fewer than one of so many pixels have another set


@_INLINE
def entries(matrix: Any) -> Any:
    """Of a matrix of three rows and columns, as numbers: loops over pixels keep these at hand."""
    return (
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 0], matrix[1, 1], matrix[1, 2],
        matrix[2, 0], matrix[2, 1], matrix[2, 2],
    )  # fmt: skip


@_INLINE
def times3(m: Any, x: Any, y: Any, z: Any) -> Any:
    """A matrix of `entries` times three numbers."""
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


@_INLINE
def pixel3(
    i: Any, j: Any, s: Any, lowers: Any, widths: Any, damping: Any, least: Any
) -> Any:  # fmt: skip
    """Of one pixel: s; lower and upper bounds by turns; what its damping is above the least."""
    low0, low1, low2 = lowers[0][i, j], lowers[1][i, j], lowers[2][i, j]
    bounds = (
        low0, low0 + at(widths[0], i, j), low1, low1 + at(widths[1], i, j),
        low2, low2 + at(widths[2], i, j),
    )  # fmt: skip
    return (s[0][i, j], s[1][i, j], s[2][i, j]), bounds, at(damping, i, j) - least


@_INLINE
def held3(s: Any, bounds: Any, extra: Any, active: Any, free: Any, coupled: Any) -> Any:
    """The best light with that active set, and how it fits, without a branch.

    Returns
    -------
    x, y, z
        Light.
    under, over
        For each primary, how far it is beyond its bounds: where positive, it is to be active.
    inwards
        For each, how much it pulls away from the bound: where positive, it is to be let go.
    """
    vx, vy, vz = times3(free, s[0], s[1], s[2])
    low0, low1, low2 = bounds[0] - vx, bounds[2] - vy, bounds[4] - vz
    high0, high1, high2 = bounds[1] - vx, bounds[3] - vy, bounds[5] - vz
    unit = one(vx)
    none = unit - unit
    # 1 where a primary is free, and where it is active; what the active ones are
    m0, n0 = (none, unit) if active & 1 else (unit, none)
    m1, n1 = (none, unit) if active & 2 else (unit, none)
    m2, n2 = (none, unit) if active & 4 else (unit, none)
    e0 = n0 * (high0 if active & 8 else low0)
    e1 = n1 * (high1 if active & 16 else low1)
    e2 = n2 * (high2 if active & 32 else low2)
    # Rows and columns of active primaries are the unit matrix's. LDL' of (coupled + extra)
    a00, a11, a22 = coupled[0] + extra, coupled[4] + extra, coupled[8] + extra
    a01, a02, a12 = m0 * m1 * coupled[1], m0 * m2 * coupled[2], m1 * m2 * coupled[5]
    b0 = -m0 * (coupled[1] * e1 + coupled[2] * e2 + extra * vx)
    b1 = -m1 * (coupled[3] * e0 + coupled[5] * e2 + extra * vy)
    b2 = -m2 * (coupled[6] * e0 + coupled[7] * e1 + extra * vz)
    i0 = m0 / a00 + n0
    c01, c02 = a01 * i0, a02 * i0
    i1 = unit / (m1 * a11 + n1 - c01 * a01)
    a12 -= c01 * a02
    c12 = a12 * i1
    b1 -= c01 * b0
    b2 -= c02 * b0 + c12 * b1
    d2 = b2 / (m2 * a22 + n2 - c02 * a02 - c12 * a12)
    d1 = b1 * i1 - c12 * d2
    d0 = b0 * i0 - c01 * d1 - c02 * d2 + e0
    d1 += e1
    d2 += e2
    g0, g1, g2 = times3(coupled, d0, d1, d2)
    g0 += extra * (vx + d0)
    g1 += extra * (vy + d1)
    g2 += extra * (vz + d2)
    g0, g1, g2 = (
        g0 if active & 8 else -g0, g1 if active & 16 else -g1, g2 if active & 32 else -g2,
    )  # fmt: skip
    under = m0 * (low0 - d0), m1 * (low1 - d1), m2 * (low2 - d2)
    over = m0 * (d0 - high0), m1 * (d1 - high1), m2 * (d2 - high2)
    inwards = (
        n0 * g0 * (high0 - low0), n1 * g1 * (high1 - low1),
        n2 * g2 * (high2 - low2),
    )  # fmt: skip
    return (vx + d0, vy + d1, vz + d2), under, over, inwards


@_INLINE
def turned3(active: Any, under: Any, over: Any, inwards: Any) -> Any:
    """The set after one turn of the search, without a branch; `_WRONG` where it is another one.

    All that are out of bounds are held there, or else all that pull inwards are let go.
    """
    out = (
        (1 if max(under[0], over[0]) > 0 else 0) | (2 if max(under[1], over[1]) > 0 else 0)
        | (4 if max(under[2], over[2]) > 0 else 0)
    )  # fmt: skip
    up = (
        (8 if over[0] > 0 else 0) | (16 if over[1] > 0 else 0) | (32 if over[2] > 0 else 0)
    )  # fmt: skip
    inner = (
        (1 if inwards[0] > 0 else 0) | (2 if inwards[1] > 0 else 0) | (4 if inwards[2] > 0 else 0)
    )  # fmt: skip
    let_go = 0 if out else inner
    wrong = _WRONG if out | inner else 0
    return (((active & ~(out << 3)) | out | up) & ~let_go & 63) | wrong


@_INLINE
def searched3(s: Any, bounds: Any, extra: Any, active: Any, free: Any, coupled: Any) -> Any:
    """The active set of the best light, by turns of `held3` and `turned3`.

    They may go round in circles: after some, only the first light that is to be held or let go is
    (Murty 1974, *Opsearch* 11).
    """
    for turn in range(40):
        _, under, over, inwards = held3(s, bounds, extra, active, free, coupled)
        after = turned3(active, under, over, inwards)
        if after < _WRONG:
            break
        if turn < 8:
            active = after & 63
            continue
        for k in range(3):
            if under[k] > 0 or over[k] > 0:
                active = (active & ~(8 << k)) | 1 << k | ((8 << k) if over[k] > 0 else 0)
                break
            if inwards[k] > 0:
                active = active & ~(1 << k)
                break
    return active


@_INLINE
def light3(s: Any, bounds: Any, extra: Any, active: Any, free: Any, coupled: Any) -> Any:
    """The best light with that active set, within the bounds; and whether the set is another."""
    (x, y, z), under, over, inwards = held3(s, bounds, extra, active, free, coupled)
    wrong = max(
        under[0], under[1], under[2], over[0], over[1], over[2], inwards[0], inwards[1], inwards[2],
    )  # fmt: skip
    light = (
        min(max(x, bounds[0]), bounds[1]),
        min(max(y, bounds[2]), bounds[3]),
        min(max(z, bounds[4]), bounds[5]),
    )
    return light, wrong > 0


@_INLINE
def hold3(
    i: Any, a: Any, b: Any, c: Any, s: Any, lowers: Any, widths: Any, damping: Any, least: Any,
    free: Any, coupled: Any, active: Any,
) -> None:  # fmt: skip
    """The best light of a row, and its active sets.

    Most sets are what they were. Where few are, turns of the whole row take several pixels at once.
    What is left is searched for pixel by pixel.
    """
    cols = active.shape[1]
    for turn in range(_TURNS):
        for j in range(cols):
            at_pixel, bounds, extra = pixel3(i, j, s, lowers, widths, damping, least)
            was = active[i, j]
            (x, y, z), wrong = light3(at_pixel, bounds, extra, was, free, coupled)
            active[i, j] = was | _WRONG if wrong else was
            a[i, j], b[i, j], c[i, j] = x, y, z
        many = 0  # counted here: 64 bits in the loop above would halve the pixels that it takes
        for j in range(cols):
            many += active[i, j] >> 7
        if many * _FEW < cols or turn == _TURNS - 1:
            break
        for j in range(cols):
            at_pixel, bounds, extra = pixel3(i, j, s, lowers, widths, damping, least)
            was = active[i, j] & 63
            _, under, over, inwards = held3(at_pixel, bounds, extra, was, free, coupled)
            active[i, j] = turned3(was, under, over, inwards) & 63
    for j in range(cols):
        if active[i, j] & _WRONG:
            at_pixel, bounds, extra = pixel3(i, j, s, lowers, widths, damping, least)
            found = searched3(at_pixel, bounds, extra, active[i, j] & 63, free, coupled)
            (x, y, z), _ = light3(at_pixel, bounds, extra, found, free, coupled)
            active[i, j] = found
            a[i, j], b[i, j], c[i, j] = x, y, z


@_COMPILED
def nearest3(
    a: Any, b: Any, c: Any, s0: Any, s1: Any, s2: Any, lowers: Any, widths: Any, damping: Any,
    least: Any, free: Any, coupled: Any, opponent: Any, active: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.answer` of three primaries."""
    for i in numba.prange(a.shape[0]):
        of, by = entries(free), entries(coupled)
        hold3(i, a, b, c, (s0, s1, s2), lowers, widths, damping, least, of, by, active)


@_COMPILED
def towards3(
    a: Any, b: Any, c: Any, s0: Any, s1: Any, s2: Any, lowers: Any, widths: Any, damping: Any,
    least: Any, free: Any, coupled: Any, opponent: Any, active: Any, weights: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.towards` of three primaries."""
    rows, cols = active.shape
    weight0, weight1, weight2 = weights
    for i in numba.prange(s0.shape[0]):
        of, by, to = entries(free), entries(coupled), entries(opponent)
        inside = 0
        if i < rows:
            inside = cols
            hold3(i, a, b, c, (s0, s1, s2), lowers, widths, damping, least, of, by, active)
        for j in range(inside):
            x, y, z = a[i, j], b[i, j], c[i, j]
            x, y, z = times3(to, x + x, y + y, z + z)
            a[i, j] = weight0 * (x - s0[i, j])
            b[i, j] = weight1 * (y - s1[i, j])
            c[i, j] = weight2 * (z - s2[i, j])
        for j in range(inside, s0.shape[1]):
            a[i, j] = -weight0 * s0[i, j]
            b[i, j] = -weight1 * s1[i, j]
            c[i, j] = -weight2 * s2[i, j]


@_COMPILED
def move3(
    s0: Any, s1: Any, s2: Any, w0: Any, w1: Any, w2: Any, lowers: Any, widths: Any, damping: Any,
    least: Any, free: Any, coupled: Any, opponent: Any, active: Any, over: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.move` of three primaries, after `towards3` of the same s."""
    rows, cols = active.shape
    for i in numba.prange(s0.shape[0]):
        of, by, to = entries(free), entries(coupled), entries(opponent)
        for j in range(cols if i < rows else 0):
            s, bounds, extra = pixel3(i, j, (s0, s1, s2), lowers, widths, damping, least)
            (x, y, z), _ = light3(s, bounds, extra, active[i, j], of, by)
            x, y, z = times3(to, x, y, z)
            w0[i, j] -= x
            w1[i, j] -= y
            w2[i, j] -= z
        for j in range(s0.shape[1]):
            w0[i, j] *= over
            w1[i, j] *= over
            w2[i, j] *= over
            s0[i, j] += w0[i, j]
            s1[i, j] += w1[i, j]
            s2[i, j] += w2[i, j]


@_COMPILED
def lower_bound3(
    a: Any, b: Any, c: Any, w0: Any, w1: Any, w2: Any, lowers: Any, widths: Any, damping: Any,
    least: Any, opponent: Any, inverse: Any, weights: Any, curvature: Any,
) -> float:  # fmt: skip
    """`OpponentLevel.lower_bound` of three primaries; a, b, c go from what s went to, to g_F.

    `least` is that of the damping of planes, which counts on the padding alone.
    """
    rows, cols = lowers[0].shape
    weight0, weight1, weight2 = weights
    known = 0.0
    for i in numba.prange(a.shape[0]):
        to, back = entries(opponent), entries(inverse)
        half, nothing = one(a[i, 0]) / (one(a[i, 0]) + one(a[i, 0])), a[i, 0] - a[i, 0]
        parts = np.empty(a.shape[1], a.dtype)
        inside = cols if i < rows else 0
        for j in range(inside):
            x, y, z = w0[i, j], w1[i, j], w2[i, j]
            g0, g1, g2 = a[i, j] - weight0 * x, b[i, j] - weight1 * y, c[i, j] - weight2 * z
            part = half * (x * g0 + y * g1 + z * g2)
            g0, g1, g2 = (
                to[0] * g0 + to[3] * g1 + to[6] * g2, to[1] * g0 + to[4] * g1 + to[7] * g2,
                to[2] * g0 + to[5] * g1 + to[8] * g2,
            )  # fmt: skip
            x, y, z = times3(back, x, y, z)
            damped = at(damping, i, j)
            part += half * damped * (x * x + y * y + z * z)
            g0, g1, g2 = g0 + damped * x, g1 + damped * y, g2 + damped * z
            low0, low1, low2 = lowers[0][i, j], lowers[1][i, j], lowers[2][i, j]
            d0 = x - low0 if g0 > 0 else low0 + at(widths[0], i, j) - x
            d1 = y - low1 if g1 > 0 else low1 + at(widths[1], i, j) - y
            d2 = z - low2 if g2 > 0 else low2 + at(widths[2], i, j) - z
            bound0 = d0 * (curvature + curvature) <= abs(g0)
            bound1 = d1 * (curvature + curvature) <= abs(g1)
            bound2 = d2 * (curvature + curvature) <= abs(g2)
            part -= abs(g0) * d0 if bound0 else nothing
            part -= abs(g1) * d1 if bound1 else nothing
            parts[j] = part - (abs(g2) * d2 if bound2 else nothing)
            g0 = nothing if bound0 else g0
            g1 = nothing if bound1 else g1
            g2 = nothing if bound2 else g2
            a[i, j] = back[0] * g0 + back[3] * g1 + back[6] * g2
            b[i, j] = back[1] * g0 + back[4] * g1 + back[7] * g2
            c[i, j] = back[2] * g0 + back[5] * g1 + back[8] * g2
        for j in range(inside, a.shape[1]):
            x, y, z = w0[i, j], w1[i, j], w2[i, j]
            g0, g1, g2 = a[i, j] - weight0 * x, b[i, j] - weight1 * y, c[i, j] - weight2 * z
            parts[j] = -half * (x * (g0 + least * x) + y * (g1 + least * y) + z * (g2 + least * z))
            a[i, j], b[i, j], c[i, j] = nothing, nothing, nothing
        row = 0.0
        for j in range(a.shape[1]):
            row += parts[j]
        known += row
    return known


@_COMPILED
def finer3(
    s0: Any, s1: Any, s2: Any, active: Any, light: Any, dual: Any, coarse: Any, ratios: Any,
    lowers: Any, widths: Any, opponent: Any,
) -> None:  # fmt: skip
    """`OpponentLevel.of_coarser` of three primaries: s, and active sets, of the coarser level's."""
    rows, cols = active.shape
    ratio0, ratio1, ratio2 = ratios
    for i in numba.prange(s0.shape[0]):
        to = entries(opponent)
        for j in range(s0.shape[1]):
            s0[i, j] = ratio0 * dual[0][i // 2, j // 2]
            s1[i, j] = ratio1 * dual[1][i // 2, j // 2]
            s2[i, j] = ratio2 * dual[2][i // 2, j // 2]
        for j in range(cols if i < rows else 0):
            low0, low1, low2 = lowers[0][i, j], lowers[1][i, j], lowers[2][i, j]
            x, y, z = light[0][i // 2, j // 2], light[1][i // 2, j // 2], light[2][i // 2, j // 2]
            x = min(max(x, low0), low0 + at(widths[0], i, j))
            y = min(max(y, low1), low1 + at(widths[1], i, j))
            z = min(max(z, low2), low2 + at(widths[2], i, j))
            x, y, z = times3(to, x, y, z)
            s0[i, j] += x
            s1[i, j] += y
            s2[i, j] += z
            active[i, j] = coarse[i // 2, j // 2]
