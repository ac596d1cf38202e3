"""Strips: all of a picture once, in order, and strips within strips."""

from __future__ import annotations

import pytest

from domesim.light.strips import SAMPLES, in_strips, threads


def test_strips_within_strips_are_done_where_they_are():
    """All threads at once ask for more work than one strip: nobody waits for the others."""

    def inner(view: int, rows: slice) -> int:
        return rows.stop - rows.start

    def outer(view: int, rows: slice) -> list[list[int]]:
        return [in_strips(inner, (1, 3, SAMPLES)) for _ in range(rows.start, rows.stop)]

    assert in_strips(outer, (2, 8, SAMPLES)) == [[[1, 1, 1]]] * 16


def test_an_error_ends_the_work_and_the_first_strips_is_raised():
    begun = []

    def fails(view: int, rows: slice) -> None:
        begun.append(rows.start)
        raise ValueError(f"strip {rows.start}")

    with pytest.raises(ValueError, match="strip 0"):
        in_strips(fails, (1, 64, SAMPLES))
    assert len(begun) <= threads()


def test_results_come_in_the_order_of_the_strips():
    found = in_strips(lambda view, rows: (view, rows.start), (3, 20, SAMPLES))
    assert found == [(view, row) for view in range(3) for row in range(20)]
