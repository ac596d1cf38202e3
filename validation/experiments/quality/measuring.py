"""What is seen of an input at one place, by one way, as the judges and plain figures have it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.aim import Aim
from compensate.ghosts import edge_sigma
from compensate.pose import Eye, Posed, pose
from compensate.solve import solved
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import Scene
from validation import panel, seen
from validation.crops import Crop
from validation.experiment import Missing, Panel
from validation.experiments.quality.contour import ghost_contours
from validation.judges import luminance

DEFAULT, NOTHING, SUBTRACTION, PAPER = "contrast", "nothing", "subtraction", "paper's weighting"
"""Names of ways; the first is the product's default."""
LOWER = "lift 1"
"""The setting of the knob that judges of structure prefer in domes."""
WAYS: Mapping[str, tuple[str, Eye]] = {
    NOTHING: ("none", Aim()),
    SUBTRACTION: ("subtractive", Aim()),
    "range compression": ("raised-black", Aim()),
    PAPER: ("perceptual", PerceptualWeighting()),
    DEFAULT: ("perceptual", Aim()),
}
"""Method of `compensate.methods`, and what pictures are made for."""
KNOB: Mapping[str, tuple[str, Eye]] = {
    LOWER: ("perceptual", Aim(lift=1.0)),
    "lift 4": ("perceptual", Aim(lift=4.0)),
}
"""Other settings of the default's one knob."""

LIFTED, BASE = 1.05, 2.0
"""Ratio of bases from which on a place counts as lifted; sigma of the base, degrees."""
LIT = 0.3
"""Share of the brightest luminance from which on things count as lit."""


@final
@dataclass(frozen=True)
class Cell:
    """One way at one place; None where a figure is of the other kind of input, or not installed.

    Parameters
    ----------
    judged
        Name of a judge -> its figure.
    kept, kept_fifth
        Light kept at pixels that subtraction shows exactly and whose base is not lifted: median and
        5th percentile of the light over the master's.
    shifted
        Share of them whose u'v' is off by more than 0.01.
    structure
        Share of the structure in each of `seen.BANDS` that is seen.
    hue, saturation
        Colours of a dome's dark half: shift in degrees, and share that is kept.
    halos
        Share of the screen.
    black
        1st percentile of luminance, cd/m².
    contour, contrast_contour, other_eye
        Figures of a pair's ghosts where subtraction clips: contours of light and of contrast, and
        the correlation of the residual's slopes with those of the other eye's picture.
    lit
        Light of lit things over the master's.
    panels
        The picture.
    """

    judged: dict[str, float]
    kept: float | None
    kept_fifth: float | None
    shifted: float | None
    structure: tuple[float | None, ...]
    hue: float | None
    saturation: float | None
    halos: float | None
    black: float
    contour: float | None
    contrast_contour: float | None
    other_eye: float | None
    lit: float
    panels: tuple[Panel, ...]


@final
class Case:
    """An input at one place, and what its ways have in common."""

    def __init__(self, light: Callable[[], Light], scene: Scene) -> None:
        self._light, self.scene = light, scene
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
    def crop(self) -> Crop:
        """What pictures show of it."""
        return Crop(self.plain)

    @cached_property
    def subtracted(self) -> Light:
        """What subtraction shows."""
        return self.plain.seen(self.plain.subtractive)

    @cached_property
    def exact(self) -> NDArray[np.bool_]:
        """(view, row, col) pixels that subtraction shows exactly, and that are not black."""
        return seen.exact(self.plain.wanted, self.subtracted, self.scene)

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """(view, row, col) pixels at which subtraction shows too much."""
        above = np.any(self.subtracted - self.plain.wanted > seen.EXACT, axis=-1)
        return np.asarray(above & self.plain.screen)


def measure(
    case: Case, way: tuple[str, Eye], judges: tuple[panel.Judge, ...], picture: str
) -> Cell:
    """Every figure of one way; with a picture of that title, if it has one."""
    method, eye = way
    posed, scene = case.posed(eye), case.scene
    master, shown = posed.wanted, posed.seen(solved(posed, method).light)
    judged = {}
    for judge in judges:
        try:
            judged[judge.name] = judge.judge(master, shown, scene)
        except Missing:
            continue
    unlifted = case.exact & (_base_ratio(master, shown, scene) <= LIFTED)
    kept = seen.light_kept(master, shown, unlifted, scene)
    dome = scene.views == 1
    colours = seen.saturation_and_hue(master, shown, scene) if dome else None
    contours: tuple[float | None, float | None] = (None, None)
    if not dome:
        contours = _contours(case, shown)
    bright = luminance(master, scene)
    lit = bright > LIT * bright.max()
    return Cell(
        judged,
        None if kept is None else kept.median,
        None if kept is None else kept.fifth,
        seen.chroma_shift(master, shown, unlifted, scene),
        tuple(seen.structure_seen(master, shown, scene, *band) for band in seen.BANDS),
        None if colours is None else colours.hue_shift,
        None if colours is None else colours.saturation,
        seen.halos(master, shown, scene) if dome else None,
        seen.black_level(shown, scene),
        *contours,
        None if dome else _of_the_other_eye(case, shown),
        float(luminance(shown, scene)[lit].sum() / bright[lit].sum()),
        (case.crop.panel(picture, shown),) if picture else (),
    )


def _base_ratio(master: Light, shown: Light, scene: Scene) -> NDArray[Any]:
    """(view, row, col) how many times brighter the local mean of the logarithm is."""
    sigma = BASE * scene.viewing.pixels_per_degree(*master.shape[1:3])
    dark = seen.NOT_BLACK / scene.projector.white
    logs = [np.log(np.maximum(luminance(light, scene), 0) + dark) for light in (master, shown)]
    rise = gaussian_filter(logs[1] - logs[0], (0, sigma, sigma), mode="nearest")
    return np.asarray(np.exp(rise))


def _contours(case: Case, shown: Light) -> tuple[float | None, float | None]:
    master, now, before = (
        luminance(light, case.scene)
        for light in (case.plain.wanted, shown, case.plain.seen(case.plain.desired))
    )
    density = case.scene.viewing.pixels_per_degree(*shown.shape[1:3])
    return ghost_contours(master, now, before, case.clipped, density)


def _of_the_other_eye(case: Case, shown: Light) -> float | None:
    """Share of the other eye's slopes in the residual's, over what subtraction leaves there."""
    sigma = edge_sigma(case.scene.viewing.pixels_per_degree(*shown.shape[1:3]))

    def slopes(light: Light) -> NDArray[Any]:
        plane = luminance(light, case.scene)
        found = [
            gaussian_filter(plane, (0, sigma, sigma), order=order, mode="nearest")
            for order in ((0, 1, 0), (0, 0, 1))
        ]
        return np.stack(found)[:, case.clipped]

    other = slopes(case.plain.wanted[::-1])
    energy = float(np.sum(other**2))
    if not energy:
        return None
    return float(np.sum(slopes(shown - case.plain.wanted) * other)) / energy
