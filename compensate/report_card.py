"""The report card: crosstalk of a stereo system, and of a pair in it, in others' words.

A *system* is judged by what each eye sees of four plain frames (own picture black or white, the
other's black or white; L_KW: own black, other white), in the words of Woods [1]; of many views, all
others are black or white:

    system crosstalk = (L_KW - L_KK) / (L_WK - L_KK)        extinction ratio = 1 / system crosstalk

A *pair* has his viewer crosstalk, leaked over own light at each place, and what two eyes see of it
(`vision.binocular.pair`): as it is, subtracted, compensated. A *quilt* is told of as its views are
seen, each alone: which two of them a viewer's eyes see, depends on where he stands. None of these
counts light of lens and room.

A *room*, if a scene describes one, has its system contrast (`domesim.inspection.contrast`), and
what the eye's own stray light leaves of that (`vision.glare`).

Limits, with whose they are: a step of 1 % is visible, 5.8 % is perceptible but does not annoy [2];
5 to 10 % is often acceptable, less with higher contrast or larger disparity [3]. Those of ISO/IEC
and of DIGSS were not found in text that is public, and are left out.

[1] A. J. Woods, "Crosstalk in stereoscopic displays: a review", J. Electronic Imaging 21, 040902
(2012). [2] "73.4: Investigation of crosstalk in a 2-view 3D display", SID Symposium Digest,
abstract.
[3] L. Wang et al., J. Display Technology 7, 208 (2011), as van Baar et al. 2011, section 2, has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.figures import Appraisal
from compensate.pose import Posed
from compensate.solve import solved
from compensate.vision.binocular.pair import Pair
from compensate.vision.glare import StrayLight
from domesim.inspection.contrast import boards, means
from domesim.light import Light
from domesim.observation.stereo import VIEWS, view_names
from domesim.scene import FlatScene, StereoScene

VISIBLE, ANNOYING, ACCEPTABLE = 0.01, 0.058, 0.1
"""Crosstalk that is a visible step; that does not annoy yet; the most that is often acceptable."""
METHODS = {"none": "as it is", "subtractive": "subtracted", "perceptual": "compensated"}
EYES_AGE = 35.0
"""Years: chosen, of an audience."""
GRID = (9, 16)
"""Rows and cols of the plain frames: a map of crosstalk is smooth."""


@final
@dataclass(frozen=True)
class Crosstalk:
    """What one eye sees of the other's picture, mean over the screen, and worst place.

    Attributes
    ----------
    system, worst
        System crosstalk.
    extinction
        Extinction ratio; None without crosstalk.
    """

    system: float
    worst: float
    extinction: float | None

    @property
    def verdict(self) -> str:
        """What it means for an audience, in words."""
        if self.worst < VISIBLE:
            return "below a visible step (1 %)"
        if self.worst <= ANNOYING:
            return "perceptible, not annoying by itself (up to 5.8 %)"
        if self.worst <= ACCEPTABLE:
            return "often acceptable, less so with high contrast or large disparity (up to 10 %)"
        return "more than is acceptable (10 %)"


@final
@dataclass(frozen=True)
class Way:
    """What two eyes see of a pair by one method.

    Attributes
    ----------
    fused_loss, contrast, rivalry
        As of `TwoEyes`.
    one_eye
        Quality lost for each eye alone, JOD (`compensate.ruler`).
    """

    fused_loss: float
    contrast: float
    rivalry: float
    one_eye: float


def crosstalk(scene: StereoScene) -> dict[str, Crosstalk]:
    """Computes the crosstalk of each eye, or view, without light of lens and room.

    Parameters
    ----------
    scene
        Scene of one chosen seat.
    """
    observation, views = scene.crosstalk_alone.observation(*GRID), scene.views

    def seen(view: int, whites: NDArray[Any]) -> NDArray[Any]:
        frame: Light = np.ones((views, *GRID, 3)) * np.reshape(whites, (-1, 1, 1, 1))
        return np.asarray(scene.projector.luminance(observation.observe(frame))[view])

    crosstalks = {}
    names = VIEWS if views == len(VIEWS) else view_names(views)
    for view, (name, own) in enumerate(zip(names, np.eye(views), strict=True)):
        kk, wk, kw = (seen(view, whites) for whites in (0 * own, own, 1 - own))
        leak = (kw - kk) / (wk - kk)
        system = float((kw - kk).mean() / (wk - kk).mean())
        crosstalks[name] = Crosstalk(system, float(leak.max()), 1 / system if system > 0 else None)
    return crosstalks


def to_the_eye(scene: FlatScene, age: float = EYES_AGE) -> tuple[float, float]:
    """White and black fields of the checkerboard with the eye's own stray light, cd/m².

    They are seen from the scene's viewing distance. The eye looks at each field in turn.
    """
    both, seen = boards(scene)
    rows = both.shape[1]
    height = np.degrees(scene.size[1] / scene.viewing.distance)
    # Fields are as wide as the screen is: the eye needs square pixels
    cols = round(rows * scene.size[0] / scene.size[1])
    at = np.minimum((np.arange(cols) + 0.5) * both.shape[2] / cols, both.shape[2] - 1).astype(int)
    return means(both[..., at], StrayLight(age).seen(seen[..., at], rows / height))


def ways(posed: Posed) -> dict[str, Way]:
    """Says what two eyes see of a pair, by each of `METHODS`.

    Raises
    ------
    InputError
        If it is no pair, or OpenCV is not installed.
    """
    pair = Pair(posed.wanted[: posed.scene.views], posed.scene)
    appraisal, by_method = Appraisal(posed), {}
    for method in METHODS:
        light = solved(posed, method).light
        two = pair.two_eyes(posed.seen(light))
        by_method[method] = Way(two.fused_loss, two.contrast, two.rivalry, appraisal.loss(light))
    return by_method


def losses(posed: Posed) -> dict[str, float]:
    """Computes the quality that one eye loses, JOD, by each of `METHODS`: the mean of all views."""
    appraisal = Appraisal(posed)
    return {method: appraisal.loss(solved(posed, method).light) for method in METHODS}


def viewer_crosstalk(posed: Posed) -> Mapping[str, float]:
    """Divides leaked by own light of the untouched pair: median, and share above 10 %."""
    scene = posed.scene
    assert isinstance(scene, StereoScene)
    luminance, black = scene.projector.luminance, np.zeros_like(posed.desired)
    observation = scene.crosstalk_alone.observation(*black.shape[1:3])
    own, stray = luminance(posed.desired), luminance(observation.observe(black))
    leaked = luminance(observation.observe(posed.desired) - posed.desired)
    ratio = np.maximum(leaked - stray, 0) / np.maximum(own + stray, 1e-6 * scene.projector.white)
    return {
        "median": float(np.median(ratio)),
        "share_above_10": float(np.mean(ratio > ACCEPTABLE)),
    }


def disparity(posed: Posed) -> Mapping[str, float]:
    """Ends of the disparity that is sure, and the share that is."""
    left, _ = Pair(posed.wanted[: posed.scene.views], posed.scene).disparity
    sure = left.shift[left.sure] if left.sure.any() else np.zeros(1)
    density = posed.scene.viewing.pixels_per_degree(*left.shift.shape)
    far, near = np.percentile(sure, [1, 99]) / density
    return {
        "nearest_deg": float(near),
        "farthest_deg": float(far),
        "sure": float(left.sure.mean()),
    }
