"""``domesim predict``: which frames of a show need what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, final

import typer

from compensate.prediction import Combination, Prediction
from compensate.shows.predicting import MAPS, Predicting, summary_of, worst
from compensate.vision.glare import StrayLight
from compensate.vision.tvi import MesopicBlend
from domesim.commands.options import Place, Telling, grouped
from domesim.commands.shows import Doing, Masters, require_one_seat
from domesim.errors import InputError
from domesim.shows.run import Done
from domesim.shows.work import Writing


@final
@dataclass(frozen=True)
class Seeing:
    """What counts as visible."""

    threshold: Annotated[
        float | None,
        typer.Option(
            help="Prediction, 0..1, above which pollution counts as visible; by default as the "
            "combination has it.",
            show_default=False,
        ),
    ] = None
    combination: Annotated[
        str,
        typer.Option(
            "--combination",
            help="How the maps are combined: with-veils; paper (eqs. 12-14), which is blind to "
            "uniform veils and counts saliency; or instead of them local-contrast, where "
            "compensate --only-visible solves.",
        ),
    ] = Combination.WITH_VEILS.value
    saliency: Annotated[
        bool | None,
        typer.Option(
            "--saliency/--no-saliency",
            help="Count pollution only where a viewer looks first (of a pair, by the other eye's "
            "picture); by default as the combination has it.",
            show_default=False,
        ),
    ] = None
    mesopic: Annotated[
        str,
        typer.Option(
            "--mesopic",
            help="Whose threshold holds in dim light: more-sensitive (of rods and cones), or "
            "cie-191.",
        ),
    ] = MesopicBlend.MORE_SENSITIVE.value
    age: Annotated[
        float | None,
        typer.Option(
            help="Count the stray light of a viewer's eyes of that age in years (CIE 146:2002), "
            "which covers pollution beside bright things; by default none.",
            show_default=False,
        ),
    ] = None

    def prediction(self) -> Prediction:
        """The settings of `triage`.

        Raises
        ------
        InputError
            If an option has no such value.
        """
        combinations = {each.value: each for each in Combination}
        blends = {each.value: each for each in MesopicBlend}
        if self.combination not in combinations:
            raise InputError(
                f"--combination {self.combination!r} is not known; use one of "
                f"{', '.join(combinations)}"
            )
        if self.mesopic not in blends:
            raise InputError(
                f"--mesopic {self.mesopic!r} is not known; use one of {', '.join(blends)}"
            )
        return Prediction(
            self.threshold,
            combinations[self.combination],
            self.saliency,
            blends[self.mesopic],
            eye=None if self.age is None else _eye(self.age),
        )


@grouped
def predict(place: Place, masters: Masters, seeing: Seeing, doing: Doing, telling: Telling) -> None:
    """Tell which frames need compensation, and where: maps of visible light pollution."""
    console = telling.console()
    prediction = seeing.prediction()
    choice, scene = place.load(console)
    require_one_seat(scene, place.seat, "pollution is predicted for one seat")
    show = doing.find(masters, scene)

    def summary(done: Done) -> dict[str, Any]:
        frames = worst(done)
        if len(show.moments) > 1 and done.frames:
            console.say(summary_of(done, frames))
        return {"worst": [frame["input"] for frame in frames]}

    doing.show(
        show,
        Predicting(choice, prediction),
        console,
        what="predicting",
        writing=Writing(MAPS, repair=masters.repair),
        facts={
            **place.about(scene),
            "threshold": prediction.least,
            "combination": prediction.combination.value,
            "saliency": prediction.counts_saliency,
            "mesopic": prediction.blend.value,
            "age": seeing.age,
        },
        summary=summary,
    )


def _eye(age: float) -> StrayLight:
    try:
        return StrayLight(age)
    except InputError as error:
        raise InputError(f"--age {age:g}: {error}") from None
