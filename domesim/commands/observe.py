"""``domesim observe``: what the audience sees."""

from __future__ import annotations

from domesim.commands.options import Place, Telling, grouped
from domesim.commands.shows import Doing, Masters, Results, require_one_seat
from domesim.errors import InputError
from domesim.shows.observing import Observing


@grouped
def observe(
    place: Place, masters: Masters, results: Results, doing: Doing, telling: Telling
) -> None:
    """Simulate what the audience sees of a frame or sequence: reflected light, or crosstalk."""
    console = telling.console()
    choice, scene = place.load(console)
    require_one_seat(scene, place.seat, "what is seen is seen from one seat")
    if scene.viewing.seat is not None:
        raise InputError(
            f"--seat {place.seat}: a dome shows all seats the same light; leave --seat out"
        )
    doing.show(
        doing.find(masters, scene),
        Observing(choice),
        console,
        what="observing",
        writing=results.writing(scene, repair=masters.repair),
        facts=place.about(scene),
    )
