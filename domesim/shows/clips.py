"""The worst seconds of a show, judged as films: its clips of two seconds.

Frames that are judged one by one say nothing about what changes between them. A model that sees
time takes minutes for seconds of film, so only clips whose frames lose most by themselves are
judged.
"""

from __future__ import annotations

from collections.abc import Sequence

from domesim.errors import InputError
from domesim.frames.messages import joined
from domesim.host.console import Console, complain
from domesim.shows.report import Report
from domesim.shows.timeline import Clip
from domesim.shows.work import Order

SECONDS = 2.0
"""Length of a clip."""


def judge_clips(report: Report, orders: Sequence[Order], count: int, console: Console) -> list[str]:
    """Judges the clips of a show whose frames lose most.

    Parameters
    ----------
    report
        Told of them, the worst first.
    orders
        All frames, in order.
    count
        How many clips; 0 for none.
    console
        Told what is under way.

    Returns
    -------
    failed
        Why one could not be judged; the others are left out then.
    """
    clips = sorted(_clips(report, orders), key=lambda clip: -_mean_loss(report, clip))[:count]
    found = []
    with console.progress("judging films", len(clips)) as start:
        for clip in clips:
            start(clip[0].name)
            try:
                masters = (order.show.read(order.moment, repair=True) for order in clip)
                lost = clip[0].recipe.film(masters, report.rate)
            except (InputError, OSError, MemoryError) as error:
                reason = f"{clip[0].name}: not judged as a film, '{joined(str(error))}'"
                complain(reason)
                return [reason]
            names = clip[0].output[0].name, clip[-1].output[0].name
            found.append(Clip(*names, orders.index(clip[0]) / report.rate, lost))
    report.films = sorted(found, key=lambda film: -next(iter(film.lost.values())))
    for film in report.films:
        told = ", ".join(f"{way} {lost:.2f}" for way, lost in film.lost.items())
        console.say(f"{film.first} to {film.last}, as a film: {told} JOD lost")
    report.film_note = orders[0].recipe.film_note
    console.say(report.film_note)
    return []


def _clips(report: Report, orders: Sequence[Order]) -> list[Sequence[Order]]:
    """Cuts a show into clips, whose frames are all done; the rest goes to the last."""
    length = max(2, round(SECONDS * report.rate))
    starts = range(0, max(len(orders) - length, 0) + 1, length)
    ends = [*starts[1:], len(orders)]
    clips = [orders[start:end] for start, end in zip(starts, ends, strict=True)]
    return [c for c in clips if len(c) > 1 and all(report.loss(order) is not None for order in c)]


def _mean_loss(report: Report, clip: Sequence[Order]) -> float:
    return sum(report.loss(order) or 0 for order in clip) / len(clip)
