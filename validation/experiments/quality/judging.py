"""What one way does for one input at one place, as the judges see it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.contrast import Eye
from compensate.master import Posed, pose, solved
from domesim.light import Light
from domesim.scene import Scene
from validation import judges
from validation.crops import Crop
from validation.experiment import Missing, Panel
from validation.experiments.quality.contour import ghost_contours
from validation.experiments.quality.inputs import Place
from validation.experiments.quality.pictures import heatmap
from validation.experiments.quality.ways import CHOSEN, WAYS, Way
from validation.hue import shift_in_the_dark

NEW = 0.5
"""JOD that a place loses over the worse of subtraction and nothing, to count as a new artefact."""
TOO_BRIGHT_BY = 1e-5
"""Light that subtraction leaves where it clips; less is rounding."""


@final
@dataclass(frozen=True)
class Cell:
    """What one way does for an input at one place.

    Parameters
    ----------
    clipped
        Share of pixels that subtraction clips.
    error
        Visible error as the chosen weighting counts it, JND rms.
    cost
        What the chosen weighting minimises.
    allowed
        Whether it may choose this light.
    flip, quality
        FLIP, and ColorVideoVDP in JOD: means of both eyes; None if not installed.
    contour, contrast_contour
        Ghost contours where subtraction clips, of light and of contrast; None without one.
    hue
        Shift of hue of the darker half of a domemaster, degrees; None of a pair.
    seconds
        Of the solution.
    status
        Name of the solver's `Status`.
    gap
        Certified.
    new
        Share of the screen that is worse by `NEW` than with subtraction and with nothing, as the
        heatmap has it; None if not installed.
    panels
        What is seen, and the heatmap, of the left eye's dark crop or of the domemaster.
    """

    clipped: float
    error: float
    cost: float
    allowed: bool
    flip: float | None
    quality: float | None
    contour: float | None
    contrast_contour: float | None
    hue: float | None
    seconds: float
    status: str
    gap: float | None
    new: float | None
    panels: tuple[Panel, ...]


Cells: TypeAlias = Mapping[Place, Mapping[str, Cell]]
"""What every way does, by its name in `WAYS`."""


@final
class Case:
    """An input at one place, and what its ways have in common."""

    def __init__(self, light: Callable[[], Light], scene: Scene) -> None:
        self._light, self.scene = light, scene
        self._posed: dict[str, Posed] = {}

    def posed(self, eye: Eye) -> Posed:
        """The input as a problem of a vision model."""
        key = repr(eye)
        if key not in self._posed:
            self._posed[key] = pose(self._light(), self.scene, eye)
        return self._posed[key]

    @property
    def plain(self) -> Posed:
        """By the chosen weighting."""
        return self.posed(WAYS[CHOSEN].eye)

    @property
    def desired(self) -> Light:
        """What should be seen."""
        desired: Light = self.plain.problem.desired
        return desired

    @cached_property
    def crop(self) -> Crop:
        """What pictures show of it."""
        return Crop(self.plain)

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """(view, row, col): where subtraction shows more than is wanted."""
        left = self.plain.residual(self.plain.subtractive)
        found: NDArray[np.bool_] = np.any(left > TOO_BRIGHT_BY, axis=-1)
        return found

    @cached_property
    def usual_loss(self) -> NDArray[np.float32]:
        """(view, row, col) JOD that is lost by the worse of subtraction and nothing."""
        lights = (self.plain.subtractive, self.plain.desired)
        return np.maximum(*(self.judged(self.plain.seen(light))[1] for light in lights))

    def judged(self, seen: Light) -> tuple[float, NDArray[np.float32]]:
        """JOD of what is seen, and (view, row, col) what of it is lost where."""
        return judges.colorvideovdp_map(self.desired, seen, self.scene)

    def allows(self, light: Light) -> bool:
        """Whether the chosen weighting may project it."""
        return bool(np.abs(self.plain.problem.project(light) - light).max() <= TOO_BRIGHT_BY)

    def contours(self, light: Light) -> tuple[float | None, float | None]:
        """Ghost contours of what is projected, of light and of contrast.

        None of a dome, and without a ghost.
        """
        if self.scene.views == 1:
            return None, None
        posed = self.plain
        density = self.scene.viewing.pixels_per_degree(*posed.screen.shape)
        master, shown, untouched = (
            judges.luminance(seen, self.scene)
            for seen in (self.desired, posed.seen(light), posed.seen(posed.desired))
        )
        return ghost_contours(master, shown, untouched, self.clipped, density)


def measure(case: Case, way: Way, *, pictures: bool = False) -> Cell:
    """One way at one place.

    Parameters
    ----------
    case
        The input there.
    way
        What to project.
    pictures
        Whether pictures and the heatmap are wanted.
    """
    posed = case.posed(way.eye)
    begin = time.perf_counter()
    result = solved(posed, way.method)
    seconds = time.perf_counter() - begin
    seen, scene = posed.seen(result.light), case.scene
    panels = [case.crop.panel(way.title, seen)] if pictures else []
    quality, new = None, None
    try:
        quality, loss = case.judged(seen)
    except Missing:
        pass  # said in `left_out`
    else:
        new = float(np.mean((loss > case.usual_loss + NEW)[:, posed.screen]))
        if pictures:
            panels.append(heatmap(case.crop, f"{way.title}: lost", loss))
    contour, contrast_contour = case.contours(result.light)
    return Cell(
        clipped=posed.clipped,
        error=case.plain.visible_error(result.light),
        cost=case.plain.problem.cost(result.light),
        allowed=case.allows(result.light),
        flip=judges.if_installed(judges.flip, case.desired, seen, scene),
        quality=quality,
        contour=contour,
        contrast_contour=contrast_contour,
        hue=shift_in_the_dark(case.desired, seen, scene) if scene.views == 1 else None,
        seconds=seconds,
        status=result.status.name,
        gap=result.gap,
        new=new,
        panels=tuple(panels),
    )
