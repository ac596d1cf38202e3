"""What a dry run makes of the times at which its frames ended."""

from __future__ import annotations

import pytest

from domesim.shows.estimate import A_WORKER, _pace


def ends(workers: int, frames: int, start: float, frame: float) -> list[tuple[int, float]]:
    """Workers that start together and take frames in turn; the first frame takes half as much more.

    Parameters
    ----------
    start, frame
        Seconds before the first frame begins, and of a frame.
    """
    known = [
        (worker, start + frame * (1.5 + number))
        for number in range(-(-frames // workers))
        for worker in range(min(workers, frames - number * workers))
    ]
    return sorted(known, key=lambda each: each[1])


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("count", [8, 80, 4000])
def test_a_few_frames_tell_what_many_take(workers: int, count: int) -> None:
    """Until the last is done, and two seconds in which workers end."""
    tried = ends(workers, min(count, A_WORKER * workers), 3, 0.5)
    steady, around = _pace([(w, 100 + t) for w, t in tried], 100, 102 + tried[-1][1])
    took = ends(workers, count, 3, 0.5)[-1][1] + 2
    assert steady == pytest.approx(0.5)
    # Where frames do not divide among workers, some have one less to do
    assert around + steady * count / workers == pytest.approx(took, abs=0.5)


def test_a_single_frame_is_its_own_pace() -> None:
    assert _pace([(1, 7.0)], 3.0, 7.5) == (4.0, 0.5)
