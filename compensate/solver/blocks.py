"""Small symmetric matrices of planes: one matrix for each frequency."""

from __future__ import annotations

import numpy as np

from domesim.light import Array

Spectrum = Array  # (plane, padded row, padded col // 2 + 1) complex


def blocks_times(blocks: list[list[Array]], spectrum: Spectrum) -> Spectrum:
    """(plane, ...) product of a matrix of planes with a spectrum."""
    result = np.empty_like(spectrum)
    term = np.empty_like(spectrum[0])
    for p, row in enumerate(blocks):
        np.multiply(row[0], spectrum[0], out=result[p])
        for q in range(1, len(row)):
            np.multiply(row[q], spectrum[q], out=term)
            result[p] += term
    return result


def inverted(matrix: list[list[Array]]) -> list[list[Array]]:
    """Inverse of a symmetric positive definite matrix of planes, in place, by sweeps.

    A sweep of every pivot turns a symmetric matrix into minus its inverse and keeps it symmetric,
    so that only one triangle is computed (Goodnight 1979, *The American Statistician* 33, 149).
    """
    size = len(matrix)
    a = {(p, q): matrix[p][q].copy() for p in range(size) for q in range(p, size)}

    def entry(p: int, q: int) -> Array:
        return a[min(p, q), max(p, q)]

    for k in range(size):
        pivot = 1 / a[k, k]
        scaled = {p: entry(p, k) * pivot for p in range(size) if p != k}
        for p, q in a:
            if k not in (p, q):
                a[p, q] -= entry(p, k) * scaled[q]
        for p, plane in scaled.items():
            a[min(p, k), max(p, k)] = plane
        a[k, k] = -pivot
    for plane in a.values():
        np.negative(plane, out=plane)
    return [[entry(p, q) for q in range(size)] for p in range(size)]
