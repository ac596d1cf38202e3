"""Where light pollution will be seen, before anything is solved (section 5 of the paper).

Four maps of a picture, as the eye at its seat has them:

    delta(x) = |residual averaged over some area| > Delta_TVI           (eq. 10)
    v(x)     = sum of the mechanisms' squared changes of response       (eq. 11)
    gamma(x) = saliency: of a dome's own picture, of the *other* eye's of a pair
    Lambda_n = [gamma] delta P(v),    P(v) = 1 - 2^-v                   (eqs. 12 - 14)

and the mask, where Lambda_n exceeds a threshold.

*Normalised* can mean two things. Divided by its largest value, as is usual for maps, the faintest
frame of a show would have a mask as full as the worst: useless for choosing between frames. Here
every map is absolute. delta is 0 or 1. v is in units of a threshold (v = 1: one mechanism on a
plain field is at its own), which P(v) takes to 0..1, with 1/2 at the threshold. P stands for the
chance of seeing; its form is chosen, not fitted. Saliency alone is relative to its frame, and it
may be, because it only ever takes away.

*Combined* cannot be the paper's product alone. No mechanism looks at the mean level: inside a wide
uniform veil v is 0, and so is the product, whatever the veil's brightness; but such a veil is what
a dome's pollution is. So the default counts one mechanism more in eq. 11, the base band that is
missing there, with the threshold that TVI has measured for wide fields:

    v_0 = R(|residual averaged over the widest mechanism's period| / Delta_TVI)²

R is `masking.transducer`, and v_0 = 1 at its threshold like every other mechanism's. A veil is
seen when TVI says so; a ghost in a texture of its own kind is masked as before.

What is polluted? The room's own light (`psi(0)`: projector black, stray light) is desired where it
is part of the grade (`domesim.scene.grade`). Elsewhere it is there in any
frame, so that a viewer cannot tell by it what is wrong with this one, and no frame takes it away
where the picture is black. Neither the desired picture nor the desired picture with that light on
top is pollution: the residual is the distance from the nearest one between. Else every black frame
of a theatre with a black level of 0.007 cd/m² would be wanted for compensation.

The area that eq. 10 averages over is not given. Light adds up, as the average supposes, within
Ricco's area, which is some minutes of arc in the bright fovea and grows in the dark (Barlow 1958,
J. Physiol. 141, 337-350) and off the fovea. The default, a square of 0.25 degrees, is chosen.

A mask that is meant for a solver is better taken from local contrast at all scales
(`Combination.LOCAL_CONTRAST`), in place of eqs. 10-14: v is then in JOD, and P(v) 1/2 at 1 JOD.

The eye is adapted to the desired picture and the room's light, not to the pollution, so that more
is called visible where the picture is black.

The eye's own optics scatter light as the room does. With `Prediction.eye` all pictures above are
those that reach the retina (`vision.glare`): beside bright things the eye is adapted to more light,
and contrasts are relative to it, so that less of the pollution is visible. Without it a viewer has
perfect optics.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import NDArray

from compensate.pose import Posed
from compensate.vision.adaptation import adaptation_luminance
from compensate.vision.differences import visible_difference
from compensate.vision.glare import StrayLight
from compensate.vision.masking import Cortex, masked_difference, transducer
from compensate.vision.resolution import by_resolution
from compensate.vision.saliency import gbvs
from compensate.vision.tvi import MesopicBlend, threshold
from domesim.errors import InputError
from domesim.light import Light
from domesim.light.blocks import block_sums, light_means
from domesim.light.guarded import guarded
from domesim.room.viewing import DomeSeat, Viewing
from domesim.scene import Scene

Planes = NDArray[np.float32]
Mask = NDArray[np.bool_]

FINEST = 8.0
"""Pixels per degree that maps are computed with at least: a finer picture is reduced to a half, a
quarter, ... that still has as many. Little is lost that could pass eq. 10: averaged over a square
of 0.25 degrees, a grating of 4 cycles/degree along its sides is 0."""

FINEST_OF_ONE_VIEW = 5.0
"""The same, where no other view's picture is a ghost. Light that a room reflects is smooth."""

FINEST_CONTRAST = 16.0
"""Pixels per degree, at least, for differences of local contrast, which finer ghosts pass."""

PAPERS = 0.05
"""Threshold of the paper's Fig. 8."""

MARKED = 0.45
"""Threshold of local contrast, 0.86 JOD: a little below those with which a mask holds 96 % of what
ColorVideoVDP marks (note 0009)."""


@final
class Combination(Enum):
    """How the maps make one; see the module's docstring."""

    WITH_VEILS = "with-veils"
    """delta P(v + v_0), without saliency: it tells where a viewer looks first, not what is seen."""

    PAPER = "paper"
    """gamma delta P(v): eq. 13, and of a pair eq. 14. Blind to veils."""

    LOCAL_CONTRAST = "local-contrast"
    """P(v) of v in JOD, the visible difference of local contrast at all scales
    (`vision.differences`: ColorVideoVDP's map), without saliency: where `--only-visible` solves. A
    veil over all of a picture counts by the contrast that it takes alone, so that one over a plain
    field is nothing; which is why it is not the default here."""


@final
class Verdict(Enum):
    """What a frame needs."""

    NOTHING = "nothing visible: leave it alone"
    LEAVE = "worse than untouched by any method: leave it alone"
    SUBTRACT = "subtraction is enough"
    COMPENSATE = "compensation worth while"


@final
@dataclass(frozen=True)
class Prediction:
    """Settings of the prediction.

    Parameters
    ----------
    threshold
        t of Lambda_n, above which the mask is true. None: as `combination` has it, see `least`.
    combination
        How the maps are combined.
    saliency
        Whether gamma is a factor of Lambda_n: eq. 12 or eqs. 13 and 14. None: as `combination` has
        it.
    blend
        Whose threshold holds in mesopic light.
    area
        Side of the square that eq. 10 averages the residual over, degrees.
    negligible
        Visible pollution that is nothing, deg² of each eye's picture; the default, 1, is about what
        the fovea sees at a glance.
    cortex
        The mechanisms of eq. 11; pictures too coarse for them get wider ones.
    eye
        The stray light of the viewer's eyes; None for an eye that scatters none.

    Raises
    ------
    InputError
        If the threshold lies outside 0..1, or the area or what is negligible is no size.
    """

    threshold: float | None = None
    combination: Combination = Combination.WITH_VEILS
    saliency: bool | None = None
    blend: MesopicBlend = MesopicBlend.MORE_SENSITIVE
    area: float = 0.25
    negligible: float = 1.0
    cortex: Cortex = field(default_factory=Cortex)
    eye: StrayLight | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.least < 1:
            raise InputError(f"threshold must lie in 0..1, below 1, got {self.least:g}")
        if not (np.isfinite(self.area) and self.area > 0):
            raise InputError(f"prediction averages over an area above 0 deg, got {self.area:g}")
        if not (np.isfinite(self.negligible) and self.negligible >= 0):
            raise InputError(f"negligible must be at least 0 deg², got {self.negligible:g}")

    @property
    def least(self) -> float:
        """The threshold: by default `PAPERS`, of local contrast `MARKED`."""
        if self.threshold is not None:
            return self.threshold
        return MARKED if self.combination is Combination.LOCAL_CONTRAST else PAPERS

    @property
    def counts_saliency(self) -> bool:
        """Whether gamma is a factor of Lambda_n."""
        if self.saliency is None:
            return self.combination is Combination.PAPER
        return self.saliency


@final
@dataclass(frozen=True)
class Visible:
    """A mask of where pollution is visible.

    Parameters
    ----------
    mask
        (view, row, col) bool: false off the screen.
    shares
        Share of the screen's area that it takes, of each view.
    """

    mask: Mask
    shares: tuple[float, ...]

    @property
    def share(self) -> float:
        """Share of the screen's area, of all views."""
        return sum(self.shares) / len(self.shares)


@final
@dataclass(frozen=True)
class Predicted:
    """The maps of a picture, (view, row, col) each; 0 off the screen.

    Parameters
    ----------
    residual
        psi(x) less the nearest picture without pollution, cd/m².
    tvi
        |averaged residual| / Delta_TVI: delta of eq. 10 is where it exceeds 1.
    masking
        v of eq. 11, in units of a threshold; by the combination with veils, v + v_0.
    saliency
        gamma, 0..1, whether it counts or not.
    prediction
        Lambda_n, 0..1.
    visible
        Where the prediction exceeds its threshold.
    salient
        Share of the screen's area where it would, had saliency counted.
    """

    residual: Planes
    tvi: Planes
    masking: Planes
    saliency: Planes
    prediction: Planes
    visible: Visible
    salient: float

    @property
    def mask(self) -> Mask:
        """The binary mask, (view, row, col)."""
        return self.visible.mask

    @property
    def share(self) -> float:
        """Share of the screen's area, of all views, where pollution is visible."""
        return self.visible.share


@final
@dataclass(frozen=True)
class Triage:
    """What is predicted of a frame as it is, and of what exact clipped subtraction leaves.

    The first tells whether anything need be done at all, the second whether more than subtraction;
    its mask is what a solver has to care for.
    """

    untouched: Predicted
    subtracted: Visible
    verdict: Verdict


def predict(
    posed: Posed, light: Light | None = None, settings: Prediction | None = None
) -> Predicted:
    """Predicts where the pollution of light is visible.

    Parameters
    ----------
    posed
        The master in its scene; of several seats, the first counts.
    light
        (view, row, col, primary) what is projected. Default: the untouched master.
    settings
        See `Prediction`.

    Returns
    -------
    predicted
        All maps, (view, row, col).
    """
    eye = _viewer(posed, settings or Prediction())
    return eye.predicts(posed.desired if light is None else light)


def remaining(posed: Posed, settings: Prediction | None = None) -> Visible:
    """Predicts where the pollution that exact clipped subtraction leaves is visible.

    Parameters
    ----------
    posed, settings
        As for `predict`.

    Returns
    -------
    visible
        The mask alone.
    """
    return _viewer(posed, settings or Prediction()).sees(posed.subtractive)


def triage(posed: Posed, settings: Prediction | None = None) -> Triage:
    """Says whether a frame needs nothing, subtraction or a solver.

    Parameters
    ----------
    posed, settings
        As for `predict`.

    Returns
    -------
    triage
        The maps, and the verdict.
    """
    chosen = settings or Prediction()
    eye = _viewer(posed, chosen)
    untouched = eye.predicts(posed.desired)
    subtracted = eye.sees(posed.subtractive)
    area = posed.scene.viewing.image_area
    if max(untouched.visible.shares) * area <= chosen.negligible:
        verdict = Verdict.NOTHING
    elif max(subtracted.shares) * area <= chosen.negligible:
        verdict = Verdict.SUBTRACT
    else:
        verdict = Verdict.COMPENSATE
    return Triage(untouched, subtracted, verdict)


def reduction(scene: Scene, settings: Prediction, rows: int, cols: int) -> int:
    """Computes by how much a master may be reduced before a prediction, which is no finer.

    Parameters
    ----------
    scene
        Where it is shown.
    settings
        As for `predict`.
    rows, cols
        Size of a view, pixels.

    Returns
    -------
    step
        Side of the blocks of pixels that are averaged; both sides of the view are multiples of it.
        1 where a seat sees places in different sizes.
    """
    if scene.viewing.seat is not None:
        return 1
    by_contrast = settings.combination is Combination.LOCAL_CONTRAST
    finest = FINEST_CONTRAST if by_contrast else _finest(scene)
    step = _step(scene.viewing.pixels_per_degree(rows, cols), finest)
    while rows % step or cols % step:
        step //= 2
    return step


@guarded(mask="... row col")
def regions(mask: Mask, margin: int = 0) -> list[tuple[slice, slice]]:
    """Finds rectangles that hold all that is true in a mask, with a margin around it.

    They are the bounding boxes of what is connected once it is dilated by the margin; boxes that
    overlap or touch are made one, so that no pixel lies in two. Eyes share their rectangles: they
    pollute each other.

    Parameters
    ----------
    mask
        (row, col) or (view, row, col) bool.
    margin
        Pixels that are added on all sides, as far as there is picture.

    Returns
    -------
    boxes
        (rows, cols) of each rectangle.

    Raises
    ------
    InputError
        If the mask has other axes, or the margin is negative.
    """
    found = np.asarray(mask, bool)
    if found.ndim not in (2, 3):
        raise InputError(f"regions takes a mask (row, col) or (view, row, col), got {found.shape}")
    if margin < 0:
        raise InputError(f"regions takes a margin of at least 0 pixels, got {margin}")
    joined = np.asarray(found.any(axis=0) if found.ndim == 3 else found)
    if margin:
        joined = scipy.ndimage.maximum_filter(joined, 2 * margin + 1, mode="constant")
    count = None
    while True:
        boxes = [(rows, cols) for rows, cols in scipy.ndimage.find_objects(_labelled(joined))]
        if len(boxes) == count:
            return boxes
        count = len(boxes)
        joined = np.zeros(joined.shape, bool)
        for box in boxes:
            joined[box] = True


def _labelled(mask: NDArray[Any]) -> NDArray[Any]:
    """Numbers of connected components; pixels that only meet at a corner are connected."""
    return np.asarray(scipy.ndimage.label(mask, np.ones((3, 3), int))[0])


@dataclass(frozen=True)
class _Look:
    """What a viewer sees of a frame, on the grid: luminances, cd/m², and eq. 10."""

    wanted: Planes
    seen: Planes
    residual: Planes
    tvi: Planes
    delta: Mask


@final
class _Eye:
    """A viewer of a posed frame, who compares with what is desired."""

    def __init__(self, posed: Posed, settings: Prediction, viewing: Viewing) -> None:
        self._posed, self._settings, self._viewing = posed, settings, viewing
        self._projector = posed.scene.projector
        rows, cols = posed.screen.shape
        finest = viewing.pixels_per_degree(rows, cols)
        step = _step(finest, _finest(posed.scene))
        self._grid = _Grid(posed.screen, step)
        self._per_degree = finest / step
        self._on_screen: dict[int, Planes] = {}  # shares of squares, by their side
        # of very coarse pictures, the widest mechanism that they can hold
        self._lowest = min(settings.cortex.lowest, self._per_degree / 2)
        self._room = posed.seen(np.zeros_like(posed.desired))
        if (kept := posed.setting.kept) is not None:  # it is wanted, as all the master
            self._room = self._room - kept.astype(self._room.dtype)[:, None, None, :]
        by_contrast = settings.combination is Combination.LOCAL_CONTRAST
        self._contrasts = None
        if by_contrast:
            self._contrasts = _Contrasts(posed, self._room, finest, settings.eye)

    @cached_property
    def _picture(self) -> Light:
        return self._grid.mean(self._posed.problem.desired[: self._posed.scene.views])

    @cached_property
    def _desired(self) -> Planes:
        return self._luminance(self._picture)

    @cached_property
    def _with_room(self) -> Planes:
        return self._desired + self._luminance(self._grid.mean(self._room))

    @cached_property
    def _adaptation(self) -> Planes:
        return adaptation_luminance(self._with_room, self._per_degree, self._grid.screen)

    @cached_property
    def _threshold(self) -> NDArray[np.floating[Any]]:
        return threshold(self._adaptation, self._settings.blend)

    @cached_property
    def _saliency(self) -> Planes:
        """(view, row, col) saliency of eq. 14: an eye's pollution is the other's picture."""
        pictures = [self._salient(eye) for eye in self._projector.to_display(self._picture)]
        return np.stack(pictures[::-1])  # eq. 14

    def predicts(self, light: Light) -> Predicted:
        """All maps of projected `light`."""
        full = self._grid.full
        seen = self._posed.seen(light)
        look = self._looks(seen)
        masking = self._masking(look, slice(None), slice(None)) + self._base_band(look)
        saliency = full(self._saliency)
        if self._contrasts is None:
            visible = full(np.where(look.delta, probability(masking), np.float32(0)))  # eq. 12
        else:
            visible = probability(self._contrasts.differences(seen))
        salient = visible * saliency  # eq. 13
        prediction = salient if self._settings.counts_saliency else visible
        return Predicted(
            residual=full(look.residual),
            tvi=full(look.tvi),
            masking=full(masking),
            saliency=saliency,
            prediction=prediction,
            visible=_visible(self._posed, prediction > self._settings.least),
            salient=_visible(self._posed, salient > self._settings.least).share,
        )

    def sees(self, light: Light) -> Visible:
        """The mask alone: v is computed only around pixels that v_0 and delta leave open."""
        least = self._settings.least
        weight = self._saliency if self._settings.counts_saliency else np.float32(1)
        light_seen = self._posed.seen(light)
        if self._contrasts is not None:
            if self._settings.counts_saliency:
                weight = self._grid.full(self._saliency)
            visible = weight * probability(self._contrasts.differences(light_seen))
            return _visible(self._posed, visible > least)
        look = self._looks(light_seen)
        veils = self._base_band(look)
        seen = look.delta & (weight * probability(veils) > least)
        open_ = look.delta & (weight > least) & ~seen
        if open_.any():
            # beyond the widest mechanism's period nothing matters
            part = _bounds(
                np.asarray(open_.any(axis=0)), int(np.ceil(self._per_degree / self._lowest))
            )
            masking = self._masking(look, *part) + veils[:, *part]
            weights = np.broadcast_to(weight, seen.shape)[:, *part]
            seen[:, *part] |= open_[:, *part] & (weights * probability(masking) > least)
        return _visible(self._posed, self._grid.full(seen))

    def _looks(self, light: Light) -> _Look:
        """Luminances that are compared in the light that is seen, and eq. 10."""
        seen = self._luminance(self._grid.mean(light))
        wanted = np.clip(seen, self._desired, self._with_room)
        residual = np.asarray(np.where(self._grid.screen, seen - wanted, 0), np.float32)
        mean = self._averaged(residual, self._settings.area)
        tvi = np.asarray(np.abs(mean) / self._threshold, np.float32)
        delta = (tvi > 1) & self._grid.screen  # eq. 10
        return _Look(wanted, seen, residual, tvi, delta)

    def _masking(self, look: _Look, rows: slice, cols: slice) -> Planes:
        """Masking v (eq. 11) in a part of the picture."""
        wanted, seen, adaptation = (
            self._grid.filled(each)[:, rows, cols]
            for each in (look.wanted, look.seen, self._adaptation)
        )
        # the angle that the part covers, at the same resolution
        viewing = replace(self._viewing, extent=max(wanted.shape[1:]) / self._per_degree)
        cortex = replace(self._settings.cortex, lowest=self._lowest)
        return masked_difference(wanted, seen, adaptation, viewing, cortex=cortex)

    def _base_band(self, look: _Look) -> Planes:
        """v_0, if the combination has it."""
        if self._settings.combination is not Combination.WITH_VEILS:
            return np.zeros_like(look.residual)
        mean = self._averaged(look.residual, 1 / self._lowest)
        return np.asarray(transducer(np.abs(mean) / self._threshold) ** 2)

    def _salient(self, picture: Light) -> Planes:
        """Saliency of (row, col, rgb); the rim of the screen is no feature."""
        whole = self._grid.filled(np.moveaxis(picture, -1, 0))
        return gbvs(np.maximum(np.moveaxis(whole, 0, -1), 0)).astype(np.float32)

    def _averaged(self, planes: Planes, degrees: float) -> Planes:
        """Means over squares, of the screen's pixels only."""
        side = 2 * round((degrees * self._per_degree - 1) / 2) + 1
        if side <= 1:
            return planes

        if side not in self._on_screen:
            screen = self._grid.screen.astype(np.float32)
            self._on_screen[side] = np.maximum(_within(screen, side), 1 / side**2)
        return np.stack([_within(plane, side) / self._on_screen[side] for plane in planes])

    def _luminance(self, light: Light) -> Planes:
        """(view, row, col) as it reaches the retina, cd/m²; a little below 0 is 0."""
        planes: Planes = np.maximum(self._projector.luminance(light), 0)
        if self._settings.eye is None:
            return planes
        planes = np.where(self._grid.screen, planes, np.float32(0))
        return self._settings.eye.seen(planes, self._per_degree)


@final
class _Seated:
    """A viewer in a seat of a dome, whose pixels per degree differ from place to place."""

    def __init__(self, posed: Posed, settings: Prediction, seat: DomeSeat) -> None:
        self._posed, self._settings = posed, settings
        self._scale = seat.scale(*posed.screen.shape)

    def predicts(self, light: Light) -> Predicted:
        """As `_Eye`'s."""
        names = ("residual", "tvi", "masking", "saliency", "prediction")

        def at(factor: float) -> tuple[Planes, ...]:
            viewing = self._posed.scene.viewing
            viewing = replace(viewing, extent=viewing.extent / factor, seat=None)
            eye = _Eye(self._posed, self._settings, viewing)
            found = eye.predicts(light)
            return tuple(getattr(found, name) for name in names)

        maps = dict(zip(names, by_resolution(self._scale, self._posed.screen, at), strict=True))
        least, prediction = self._settings.least, maps["prediction"]
        salient = prediction * (1 if self._settings.counts_saliency else maps["saliency"])
        return Predicted(
            **maps,
            visible=_visible(self._posed, prediction > least),
            salient=_visible(self._posed, salient > least).share,
        )

    def sees(self, light: Light) -> Visible:
        """As `_Eye`'s."""
        return self.predicts(light).visible


def _viewer(posed: Posed, settings: Prediction) -> _Eye | _Seated:
    viewing = posed.scene.viewing
    if viewing.seat is None:
        return _Eye(posed, settings, viewing)
    return _Seated(posed, settings, viewing.seat)


def _visible(posed: Posed, seen: Mask) -> Visible:
    areas = posed.setting.areas
    return Visible(seen, tuple(float(np.sum(view * areas) / np.sum(areas)) for view in seen))


@final
class _Contrasts:
    """Compares what is seen with what is desired, by local contrast at all scales."""

    def __init__(self, posed: Posed, room: Light, finest: float, eye: StrayLight | None) -> None:
        self._eye = eye
        step = _step(finest, FINEST_CONTRAST)
        self._grid, self._per_degree = _Grid(posed.screen, step), finest / step
        projector = posed.scene.projector
        self._to_xyz = (projector.to_xyz * projector.white).T.astype(np.float32)
        self._desired = self._grid.mean(posed.problem.desired[: posed.scene.views])
        self._with_room = self._desired + self._grid.mean(room)

    def differences(self, seen: Light) -> Planes:
        """Visible differences of the light that is seen, (view, row, col), JOD."""
        here = self._grid.mean(seen)
        wanted = np.clip(here, self._desired, self._with_room)
        lost = visible_difference(self._xyz(wanted), self._xyz(here), self._per_degree)
        return self._grid.full(lost)

    def _xyz(self, light: Light) -> Light:
        """XYZ of light as it reaches the retina, cd/m²; 0 off the screen."""
        xyz = np.where(self._grid.screen[..., None], light, np.float32(0)) @ self._to_xyz
        if self._eye is None:
            return xyz
        return np.moveaxis(self._eye.seen(np.moveaxis(xyz, -1, 1), self._per_degree), 1, -1)


@final
class _Grid:
    """Blocks of `step` x `step` pixels, and back; the last ones may be cut off by the edge."""

    def __init__(self, screen: Mask, step: int) -> None:
        self._fine, self._step = screen, step
        self.screen: Mask = block_sums(screen.astype(np.float32), step) > 0

    def mean(self, light: Light) -> Light:
        """Means over the blocks' pixels on the screen, (view, row, col, primary)."""
        if self._step == 1:
            return np.asarray(light)
        return np.ascontiguousarray(light_means(light, self._step, self._fine), np.float32)

    def full(self, planes: NDArray[Any]) -> NDArray[Any]:
        """Planes of the blocks as planes of pixels: 0 off the screen."""
        rows, cols = self._fine.shape
        tall = planes.repeat(self._step, axis=1)[:, :rows] if self._step > 1 else planes
        wide = tall.repeat(self._step, axis=2)[..., :cols] if self._step > 1 else tall
        return np.where(self._fine, wide, planes.dtype.type(0))

    def filled(self, planes: Planes) -> Planes:
        """Planes with their mean off the screen, so that its rim is no edge of a veil."""
        if self.screen.all():
            return planes
        means = np.array([plane[self.screen].mean() for plane in planes], np.float32)
        return np.where(self.screen, planes, means[:, None, None])


def _within(plane: Planes, side: int) -> Planes:
    """Means over squares around pixels; 0 beyond the edge."""
    return np.asarray(scipy.ndimage.uniform_filter(plane, side, mode="constant"))


def _finest(scene: Scene) -> float:
    return FINEST if scene.views > 1 else FINEST_OF_ONE_VIEW


def _step(per_degree: float, finest: float) -> int:
    """Factor by which a picture can be reduced and still has `finest` pixels per degree."""
    return int(2 ** max(0, int(np.floor(np.log2(per_degree / finest)))))


@guarded
def probability(masking: Planes) -> Planes:
    """Returns P(v) = 1 - 2^-v."""
    return np.asarray(-np.expm1(-np.float32(np.log(2)) * masking))


def _bounds(mask: Mask, margin: int) -> tuple[slice, slice]:
    """The rectangle of all that is true, with a margin as far as there is picture."""
    places = (np.flatnonzero(mask.any(axis=1 - axis)) for axis in (0, 1))
    rows, cols = (slice(max(0, int(at[0]) - margin), int(at[-1]) + margin + 1) for at in places)
    return rows, cols
