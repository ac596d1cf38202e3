"""Options of subcommands that compensate: what a picture is made for, and what computes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, final

import typer

from compensate.aim import Aim
from compensate.aim.settings import MOST_LIFT
from compensate.devices import CPU
from compensate.shows.compensating import Compensating
from domesim.errors import InputError
from domesim.scene.choice import SceneChoice


@final
@dataclass(frozen=True)
class Aiming:
    """What a picture is made for, and what computes it."""

    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Perceptual: certified distance from the least cost at which to stop; 1e-3 by "
            "default.",
            show_default=False,
        ),
    ] = None
    quality: Annotated[
        bool,
        typer.Option("--quality", help="Perceptual: --tolerance 1e-4, for about twice the time."),
    ] = False
    lift: Annotated[
        float | None,
        typer.Option(
            help="Perceptual: how many times the missing light dark places are lifted, and how "
            "strong the veils around ghosts are: from 0, plain subtraction with the deepest black, "
            f"to {MOST_LIFT:g}; {Aim().lift:g} by default.",
            show_default=False,
        ),
    ] = None
    low_frequency_gain: Annotated[
        float | None,
        typer.Option(
            help="--weighting paper: how much coarse luminance errors count, 0..1 of the most "
            "visible ones; 0.1 by default.",
            show_default=False,
        ),
    ] = None
    eye: Annotated[
        str | None,
        typer.Option(
            "--weighting",
            help="Perceptual: contrast, the default, lifts dark places with their surroundings "
            "where light is missing, and hides the edges of ghosts; paper minimises the difference "
            "of light by one adaptation luminance and Daly's sensitivity, with a certificate.",
            show_default=False,
        ),
    ] = None
    device: Annotated[
        str,
        typer.Option(
            "--device",
            help="--weighting paper: what computes: cpu; cuda or cuda:1, a GPU by PyTorch (extra "
            "gpu), which starts 5 s later and pays for sequences.",
        ),
    ] = CPU

    def recipe(
        self,
        choice: SceneChoice,
        method: str = "perceptual",
        *,
        only_visible: bool = False,
        spatial: bool = False,
    ) -> Compensating:
        """What is done to each frame, in the ways of `Compensating`.

        Raises
        ------
        InputError
            If both options of the tolerance are given.
        """
        if self.quality and self.tolerance is not None:
            raise InputError(
                f"--quality is --tolerance 1e-4, got --tolerance {self.tolerance:g}, too"
            )
        tolerance = 1e-4 if self.quality else self.tolerance
        return Compensating(
            choice,
            method,
            1e-3 if tolerance is None else tolerance,
            self.eye,
            self.lift,
            self.low_frequency_gain,
            self.device,
            only_visible,
            spatial,
        )
