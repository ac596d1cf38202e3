r"""What two eyes see of a pair, against its master.

The master's disparity says where each eye finds the same thing: there the eyes are fused, and
crosstalk adds to each what the other one has elsewhere. In the bands of `vision.differences` each
eye's signed contrasts T are in multiples of their threshold, and their energies around a place are
the Gaussian means of T². Three figures, 0 where the master is seen:

*Fused loss*, JOD: both eyes' contrasts make one by Ding and Sperling's gain control, and the result
is judged by `vision.differences` as if it were one picture. What the base band has is left out.

*Contrast*, thresholds: the response of two stages to both eyes' contrasts, less that to the
master's, over its difference at threshold; of all bands the fourth root of the mean of fourth
powers, and the mean over the picture.

*Rivalry*: the share of the picture where the eyes rival in some band (`rivalry`), and do not in the
master.

Each is done in the left picture and in the right one, and their mean counts: which eye is which
does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

from compensate.vision.binocular.contrast import BINOCULAR, K, gain_control, two_stage
from compensate.vision.binocular.disparity import Disparity, disparities
from compensate.vision.binocular.rivalry import rivals
from compensate.vision.differences import Band, bands, mutually_masked, pooled, quality_lost
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import Scene

REACH = 2.0
"""Sigma of the Gaussian over which contrast energy is taken, pixels of its band: about a period."""

Floats = NDArray[np.floating[Any]]


@final
@dataclass(frozen=True)
class TwoEyes:
    """What two eyes see of a pair; 0 where the master is seen.

    Attributes
    ----------
    fused_loss
        JOD.
    contrast
        Thresholds.
    rivalry
        Share of the picture.
    rivalry_maps
        (view, row, col) where the eyes rival that do not in the master.
    """

    fused_loss: float
    contrast: float
    rivalry: float
    rivalry_maps: NDArray[np.bool_]


@final
class Pair:
    """A master pair, against which what is seen is compared.

    Parameters
    ----------
    wanted
        (view, row, col, primary) what left and right should see.
    scene
        Where.

    Raises
    ------
    InputError
        If it is no pair, or OpenCV is not installed.
    """

    def __init__(self, wanted: Light, scene: Scene) -> None:
        if len(wanted) != 2:
            raise InputError(f"two eyes see a pair, got {len(wanted)} views")
        self._scene = scene
        self._wanted = self._xyz(wanted)

    @cached_property
    def disparity(self) -> tuple[Disparity, Disparity]:
        """Disparity of the left and of the right picture."""
        white = self._scene.projector.white
        return disparities(*(view[..., 1] / white for view in self._wanted))

    def two_eyes(self, seen: Light) -> TwoEyes:
        """Says what two eyes see.

        Parameters
        ----------
        seen
            (view, row, col, primary) what left and right see.

        Raises
        ------
        InputError
            If it has not the master's shape.
        """
        shown = self._xyz(seen)
        if shown.shape != self._wanted.shape:
            raise InputError(f"two eyes see {self._wanted.shape}, got {shown.shape}")
        found = [self._from(view, shown) for view in (0, 1)]
        loss, contrast, rivalry = (np.mean([each[k] for each in found]) for k in range(3))
        return TwoEyes(
            float(loss), float(contrast), float(rivalry), np.stack([each[3] for each in found])
        )

    def _from(self, view: int, shown: Floats) -> tuple[float, float, float, NDArray[np.bool_]]:
        """The figures in one view's picture, and where it rivals."""
        size = self._wanted.shape[1:3]
        density = self._scene.viewing.pixels_per_degree(*size)
        wanted, seen = (
            np.stack([light[view], self.disparity[view].fused(light[1 - view])])
            for light in (self._wanted, shown)
        )
        squares = []
        fourth = np.zeros(size)
        rival = np.zeros(size, bool)
        for band in bands(wanted, seen, density):
            energies = [_energies(signals) for signals in (band.wanted, band.seen)]
            difference = _fused_difference(band, energies)
            squares.append(np.asarray(np.mean(difference**2, (-2, -1), dtype=np.float64)))
            roots = [np.sqrt(energy[:, 0]) for energy in energies]
            fourth += _fitted(_contrast_change(*roots) ** 4, size)
            new = rivals(*roots[1]) & ~rivals(*roots[0])
            rival |= _fitted(new.astype(np.float32), size) > 0.5
        loss = float(quality_lost(pooled(squares)))
        return loss, float(np.mean(fourth**0.25)), float(rival.mean()), rival

    def _xyz(self, light: Light) -> Floats:
        projector = self._scene.projector
        matrix = (projector.to_xyz * projector.white).T.astype(np.float32)
        return np.asarray(np.maximum(light, 0) @ matrix, np.float32)


def _energies(signals: Floats) -> Floats:
    """(eye, mechanism, row, col) means of T² around each place."""
    return np.asarray(gaussian_filter(signals**2, (0, 0, REACH, REACH), mode="nearest"))


def _fused_difference(band: Band, energies: list[Floats]) -> NDArray[np.float32]:
    """(mechanism, row, col) D_k of the fused picture in one band."""

    def fused(signals: Floats, energy: Floats) -> NDArray[np.float32]:
        own, other = energy.sum(1)  # of all mechanisms
        return np.asarray(gain_control(signals[0], signals[1], own, other), np.float32)

    pictures = (band.wanted, energies[0]), (band.seen, energies[1])
    return mutually_masked(*(fused(signals, energy) for signals, energy in pictures))


def _contrast_change(wanted: Floats, seen: Floats) -> Floats:
    """(row, col) difference of the responses to contrasts (eye, row, col), in thresholds."""
    before, after = (two_stage(*(BINOCULAR * each)) for each in (wanted, seen))
    return np.asarray(np.abs(after - before) / K)


def _fitted(plane: Floats, size: tuple[int, ...]) -> Floats:
    """A band's plane at the picture's size."""
    factors = [wanted / got for wanted, got in zip(size, plane.shape, strict=True)]
    return np.asarray(zoom(plane, factors, order=1, mode="nearest", grid_mode=True))
