"""What is compared: methods, each with a vision model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from compensate.compensating import CONTOURS, weighting_of
from compensate.contrast import ContrastWeighting, Eye, Texture
from compensate.leeway import Leeway
from compensate.softening import Softening
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting


@final
@dataclass(frozen=True)
class Way:
    """What to project: one of `compensate.methods`, with a vision model.

    Parameters
    ----------
    title
        What it is called.
    method
        Its method.
    eye
        Its vision model.
    """

    title: str
    method: str
    eye: Eye

    @staticmethod
    def plain(title: str, method: str) -> Way:
        """One that asks no vision model."""
        return Way(title, method, PerceptualWeighting())

    @staticmethod
    def uniform(gain: float) -> Way:
        """The paper's weighting."""
        eye = PerceptualWeighting(LowFrequencyFloor(gain))
        return Way(f"the paper's weighting, {gain:g}", "perceptual", eye)

    @staticmethod
    def local(title: str, **settings: Any) -> Way:
        """Weighting of local contrast."""
        return Way(title, "perceptual", ContrastWeighting(**settings))


CHOSEN = "contrast"
"""Of `MAIN`: what is to become the default."""
UNLIMITED = "changes without limit"
"""Of `VARIANTS`: the same, as far from subtraction as the projector goes."""

MAIN: Mapping[str, Way] = {
    "none": Way.plain("nothing", "none"),
    "subtractive": Way.plain("subtraction", "subtractive"),
    "raised-black": Way.plain("range compression", "raised-black"),
    "uniform 0.1": Way.uniform(0.1),
    "uniform 0.3": Way.uniform(0.3),
    CHOSEN: Way.local("local contrast"),
}
"""Tried everywhere."""

VARIANTS: Mapping[str, Way] = {
    way.title: way
    for way in (
        *(
            Way.local(f"low-frequency gain {gain:g}", low_frequency=LowFrequencyFloor(gain))
            for gain in (0.03, 0.15, 0.3)
        ),
        *(Way.local(f"chroma times {chroma:g}", chroma=chroma) for chroma in (1.5, 4.0)),
        *(Way.local(f"floor {floor:g} cd/m²", floor=floor) for floor in (0.03, 0.3)),
        *(Way.local(f"reach {reach:g}°", reach=reach) for reach in (0.0, 0.2)),
        *(Way.local(f"most {most:g} of the adaptation", most=most) for most in (1.0, np.inf)),
        *(Way.local(f"damping {damping:g}", damping=damping) for damping in (1e-4, 0.2)),
        Way.local(UNLIMITED, leeway=None),
        *(
            Way.local(f"changes up to {times:g} times the ghost", leeway=Leeway(times))
            for times in (0.5, 2.0)
        ),
        Way.local("edges not softened", softening=None),
        *(
            Way.local(f"rims' height {height:g}", softening=Softening(height=height))
            for height in (1.2, 2.0)
        ),
        *(
            Way.local(f"half a rim at {contrast:g} times", softening=Softening(contrast=contrast))
            for contrast in (5.0, 45.0)
        ),
        Way.local("rims between many ghosts as beside one", softening=Softening(crowding=0)),
        Way.local("near is 0.1°", softening=Softening(near=0.1)),
        Way.local("changes beside ghosts not held back", softening=Softening(firmness=0)),
        Way.local("any share of light may be lost", leeway=Leeway(share=1.0)),
        Way("contours", "perceptual", weighting_of(CONTOURS)),
        Way.local("texture masks, slope 0.7", texture=Texture(0.7)),
    )
}
"""Tried at the usual luminance."""

WAYS: Mapping[str, Way] = {**MAIN, **VARIANTS}
SHOWN = ("none", "subtractive", "uniform 0.1", CHOSEN)
"""In pictures."""
