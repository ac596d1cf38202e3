"""What is seen of an input at one place, by one way: judges, laws and plain figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.aim import Aim
from compensate.pose import Eye, Posed, pose
from compensate.solve import solved
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import Scene
from validation import laws, panel, seen
from validation.closeups import closeup, exposure, uncorrectable
from validation.experiment import Missing, Panel
from validation.hearing import heard
from validation.inputs import Input
from validation.judges import luminance

Way: TypeAlias = tuple[str, Eye] | Callable[[Light, Scene], Light]
"""Method of `compensate.methods`, and what pictures are made for; or a method of one's own."""

DEFAULT, NOTHING, SUBTRACTION = "default", "nothing", "subtraction"
"""Names of ways; the first is the product's default."""
WAYS: Mapping[str, tuple[str, Eye]] = {
    NOTHING: ("none", Aim()),
    SUBTRACTION: ("subtractive", Aim()),
    "range compression": ("raised-black", Aim()),
    DEFAULT: ("perceptual", Aim()),
}
"""Method of `compensate.methods`, and what pictures are made for."""
SLOW: Mapping[str, tuple[str, Eye]] = {"paper's weighting": ("perceptual", PerceptualWeighting())}
"""A method that takes too long for all places."""
KNOB: Mapping[str, tuple[str, Eye]] = {
    f"lift {lift:g}": ("perceptual", Aim(lift=lift))
    for lift in (0.5, 1.0, 1.5, 2.5)
    if lift != Aim().lift
}
"""Other settings of the default's one knob."""

LIFTED, BASE = 1.05, 2.0
"""Ratio of bases from which on a place counts as lifted; sigma of the base, degrees."""
LIT = 0.3
"""Share of the brightest luminance from which on things count as lit."""
BLACK = 1e-5
"""Luminance below which a master is pure black, white = 1."""


@final
@dataclass(frozen=True)
class Cell:
    """One way at one place.

    Parameters
    ----------
    judged, laws, plain
        Name of a judge, a law or a plain figure -> its figure. What a picture has not is left out,
        and what is not installed.
    panels
        The picture, if one was asked for.
    """

    judged: dict[str, float]
    laws: dict[str, float]
    plain: dict[str, float]
    panels: tuple[Panel, ...] = ()


@final
class Case:
    """An input at one place, and what its ways have in common.

    Parameters
    ----------
    one, light
        The input, and what reads it.
    scene
        Where it is shown.
    """

    def __init__(self, one: Input, light: Callable[[], Light], scene: Scene) -> None:
        self.one, self._light, self.scene = one, light, scene
        self._posed: dict[str, Posed] = {}

    def posed(self, eye: Eye) -> Posed:
        """The input, made for `eye`."""
        key = repr(eye)
        if key not in self._posed:
            self._posed[key] = pose(self._light(), self.scene, eye)
        return self._posed[key]

    @property
    def plain(self) -> Posed:
        """The input, made for the default."""
        return self.posed(Aim())

    @cached_property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns that pictures show: of a pair, the region where a ghost is left."""
        if self.scene.views == 1:
            return slice(None), slice(None)
        return uncorrectable(self.plain)

    @cached_property
    def brighter(self) -> int:
        """Factor by which pictures are brightened."""
        return exposure(self.plain.wanted[:1, *self.window], self.scene)

    def picture(self, title: str, light: Light) -> Panel:
        """Panel of what the only, or the left, eye sees in the window."""
        return closeup(title, light[:1, *self.window], self.scene, brighter=self.brighter)

    @cached_property
    def untouched(self) -> Light:
        """What is seen of the master as it is."""
        return self.plain.seen(self.plain.desired)

    @cached_property
    def subtracted(self) -> Light:
        """What subtraction shows."""
        return self.plain.seen(self.plain.subtractive)

    @cached_property
    def exact(self) -> NDArray[np.bool_]:
        """(view, row, col) pixels that subtraction shows exactly, and that are not black."""
        return seen.exact(self.plain.wanted, self.subtracted, self.scene)


def measure(
    case: Case,
    way: Way,
    judges: Iterable[panel.Judge],
    picture: str = "",
    store: Path | None = None,
) -> Cell:
    """Every figure of one way; with a picture of that title, if it has one.

    `store`: folder of what judges said, if there is one.
    """
    posed = case.plain if callable(way) else case.posed(way[1])
    light = way(posed.desired, case.scene) if callable(way) else solved(posed, way[0]).light
    master, shown = posed.wanted, posed.seen(light)
    judged = {}
    for judge in judges:
        try:
            judged[judge.name] = heard(judge, master, shown, case.scene, store)
        except Missing:
            continue
    figures = {**_of_all(case, shown), **(_of_dome if len(master) == 1 else _of_pair)(case, shown)}
    return Cell(
        judged,
        _lawful(case, shown),
        {name: figure for name, figure in figures.items() if figure is not None},
        (case.picture(picture, shown),) if picture else (),
    )


def _lawful(case: Case, light: Light) -> dict[str, float]:
    """The figures of all laws that speak of the picture."""
    shown = laws.Shown(
        case.plain.wanted, case.untouched, case.subtracted, light, case.scene, case.one.balls
    )
    asked = (law for law in laws.LAWS if len(light) == 1 or not law.of_domes)
    found = {law.name: law.figure(shown) for law in asked}
    return {name: figure for name, figure in found.items() if figure is not None}


def _of_all(case: Case, shown: Light) -> dict[str, float | None]:
    master, scene = case.plain.wanted, case.scene
    unlifted = case.exact & (_base_ratio(master, shown, scene) <= LIFTED)
    kept = seen.light_kept(master, shown, unlifted, scene)
    bright = luminance(master, scene)
    lit = bright > LIT * bright.max()
    return {
        "light kept where exact": None if kept is None else kept.median,
        "5th percentile of it": None if kept is None else kept.fifth,
        "shifted where exact": seen.chroma_shift(master, shown, unlifted, scene),
        "black, cd/m²": seen.black_level(shown, scene),
        "light of lit things": float(luminance(shown, scene)[lit].sum() / bright[lit].sum()),
    }


def _of_dome(case: Case, shown: Light) -> dict[str, float | None]:
    master, scene = case.plain.wanted, case.scene
    colours = seen.saturation_and_hue(master, shown, scene)
    return {
        "hue shift in the dark, °": None if colours is None else colours.hue_shift,
        "saturation in the dark": None if colours is None else colours.saturation,
    }


def _of_pair(case: Case, shown: Light) -> dict[str, float | None]:
    black = case.plain.screen & (luminance(case.plain.desired, case.scene) < BLACK)
    added = luminance(shown - case.subtracted, case.scene)[black]
    return {
        ADDED: float(added.mean()) if black.mean() > 0.01 else None,
    }


ADDED = "light added to pure black"
"""Mean over pixels, more than subtraction shows there, white = 1."""


def _base_ratio(master: Light, shown: Light, scene: Scene) -> NDArray[Any]:
    """(view, row, col) how many times brighter the local mean of the logarithm is."""
    sigma = BASE * scene.viewing.pixels_per_degree(*master.shape[1:3])
    dark = seen.NOT_BLACK / scene.projector.white
    logs = [np.log(np.maximum(luminance(light, scene), 0) + dark) for light in (master, shown)]
    rise = gaussian_filter(logs[1] - logs[0], (0, sigma, sigma), mode="nearest")
    return np.asarray(np.exp(rise))
