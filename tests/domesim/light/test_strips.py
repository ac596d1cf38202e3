"""Strips: all of a picture once, in order, and strips within strips."""

from __future__ import annotations

from domesim.light.strips import SAMPLES, in_strips


def test_strips_within_strips_are_done_where_they_are():
    """All threads at once ask for more work than one strip: nobody waits for the others."""

    def inner(view: int, rows: slice) -> int:
        return rows.stop - rows.start

    def outer(view: int, rows: slice) -> list[list[int]]:
        return [in_strips(inner, (1, 3, SAMPLES)) for _ in range(rows.start, rows.stop)]

    assert in_strips(outer, (2, 8, SAMPLES)) == [[[1, 1, 1]]] * 16
