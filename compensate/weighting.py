"""lambda(r): how much the eye minds a residual (eqs. 3-7 of the paper).

    lambda(r) = A_n A_l T r

T is a *linear-light* opponent transform, A_l the contrast sensitivity (diagonal in Fourier, eq. 4)
and A_n an optional spatial mask. Residuals are Light (view, row, col, primary); weighted residuals
are planes (view, channel, padded row, padded col). Outside the screen the residual is 0, on a
padded grid, so that nothing wraps around.

A domemaster's pixels count equally, as in the paper. They are smaller towards the rim of the screen
(by sin(theta) / theta, 0.64 at a hemisphere's), so an error there counts more than its area.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier, padded_size
from compensate.vision.csf import LowFrequencyFloor, daly
from domesim.errors import InputError
from domesim.light import Array, Light, dot, kind, namespace, require_light
from domesim.light.guarded import guarded
from domesim.light.strips import in_parts, in_strips
from domesim.room.viewing import Viewing

Gains: TypeAlias = NDArray[np.floating[Any]]


class Weighting(ABC):
    """A linear map from residual light to weighted residual planes, with its adjoint."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary) of the residuals that it takes."""

    @property
    @abstractmethod
    def fourier(self) -> Fourier:
        """The transforms it uses, with their count."""

    @property
    @abstractmethod
    def peak(self) -> float:
        """Contrast sensitivity where the weight is 1."""

    @abstractmethod
    def _apply(self, residual: Light) -> Array: ...

    @abstractmethod
    def _adjoint(self, weighted: Array) -> Light: ...

    def apply(self, residual: Light) -> Array:
        """Returns lambda(r), (view, channel, padded row, padded col) planes.

        Raises
        ------
        InputError
            If `residual` has not this weighting's shape.
        """
        require_light(residual, self.shape, who=f"{type(self).__name__} weights residuals; it")
        return self._apply(residual)

    def adjoint(self, weighted: Array) -> Light:
        """Returns light lambda'(w): <lambda(r), w> = <r, lambda'(w)>."""
        return self._adjoint(weighted)

    def energy(self, residual: Light) -> float:
        """Returns ||lambda(r)||²."""
        weighted = self.apply(residual)
        return dot(weighted, weighted)

    def quadratic(self, residual: Light) -> tuple[float, Light]:
        """Returns ||lambda(r)||² and lambda'(lambda(r)), which share their transforms.

        As residuals are 0 off the support and on the padding, lambda' ends on the support.
        """
        weighted = self.apply(residual)
        return dot(weighted, weighted), self._adjoint(weighted)


@final
class CsfWeighting(Weighting):
    """A_l T on a support: contrast sensitivity of opponent channels.

    Parameters
    ----------
    gains
        (channel, padded row, padded col // 2 + 1) Fourier weights Omega, 1 at the peak, even in
        the row frequency; or (1, ...), shared by all channels. Or what computes them, once they are
        needed.
    opponent
        (channel, primary) T.
    support
        (row, col) bool: where a residual counts; a dome's circle.
    padded
        (rows, cols) of the padded grid.
    peak
        Sensitivity at Omega = 1: weighted contrast times this is in just-noticeable differences.
    views
        How many views residuals have: 1, 2 for a stereo pair, more for several seats; each is
        weighted alone.
    importance
        (view,) how much the energy of each view's residual counts; 1 each if None.
    """

    def __init__(
        self,
        gains: Gains | Callable[[], Gains],
        opponent: NDArray[np.floating[Any]],
        support: NDArray[np.bool_],
        padded: tuple[int, int],
        peak: float = 1.0,
        views: int = 1,
        importance: NDArray[np.floating[Any]] | None = None,
    ) -> None:
        expected = (len(opponent), padded[0], padded[1] // 2 + 1)
        if not callable(gains) and gains.shape not in (expected, (1, *expected[1:])):
            raise InputError(f"CsfWeighting takes gains {expected}, got {gains.shape}")
        if support.shape[0] > padded[0] or support.shape[1] > padded[1]:
            raise InputError(f"padded grid {padded} is smaller than the support {support.shape}")
        self._gains = gains
        self.opponent = opponent
        self.support = support
        self._peak = peak
        self.importance = np.ones(views) if importance is None else importance
        self._alike = bool(np.all(self.importance == 1))
        self._fourier = Fourier(*padded)
        self._converted: dict[tuple[str, ...], tuple[Array, Array, Array, Array]] = {}
        self._squares: dict[tuple[str, ...], list[Array]] = {}

    def with_importance(self, importance: NDArray[np.floating[Any]]) -> CsfWeighting:
        """The same weighting of views that count otherwise; its transforms are counted together."""
        other = CsfWeighting(
            self._gains,
            self.opponent,
            self.support,
            self.padded,
            self.peak,
            len(importance),
            importance,
        )
        other._fourier, other._squares = self._fourier, self._squares
        return other

    def counted_apart(self, within: Fourier | None = None) -> CsfWeighting:
        """The same weighting, with a count of transforms of its own.

        If its planes are parts of larger ones, `within` counts them, too, as shares of those.
        """
        other = self.with_importance(self.importance)
        other._fourier, other._converted = Fourier(*self.padded, within), self._converted
        return other

    @property
    def gains(self) -> Gains:
        """Omega, (channel, padded row, padded col // 2 + 1), or (1, ...)."""
        return self._gains() if callable(self._gains) else self._gains

    @cached_property
    def typical(self) -> float:
        """The median of Omega² of the first channel: small where most frequencies are not seen."""
        return float(np.median(self.gains[0])) ** 2

    def squares(self, light: Light) -> list[Array]:
        """Returns Omega_c² of each channel as arrays like `light`.

        Channels of one sensitivity share one. They are kept for the next frame.
        """
        key = kind(light)
        if key not in self._squares:
            xp = namespace(light)
            first = {
                c: next(k for k in range(c + 1) if np.array_equal(self.gains[k], gain))
                for c, gain in enumerate(self.gains)
            }
            planes = {
                k: xp.asarray(self.gains[k], dtype=light.dtype, device=light.device) ** 2
                for k in set(first.values())
            }
            shared = len(self.gains) == 1
            channels = range(len(self.opponent))
            self._squares[key] = [planes[first[0 if shared else c]] for c in channels]
        return self._squares[key]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return (len(self.importance), *self.support.shape, self.opponent.shape[1])

    @property
    def fourier(self) -> Fourier:
        """The padded grid's transforms."""
        return self._fourier

    @property
    def padded(self) -> tuple[int, int]:
        """(rows, cols) of the padded grid."""
        return self._fourier.rows, self._fourier.cols

    @property
    def peak(self) -> float:
        """Sensitivity at Omega = 1."""
        return self._peak

    def energy(self, residual: Light) -> float:
        """Returns ||lambda(r)||², with one FFT a channel."""
        spectrum = self._weighted_spectrum(residual)
        return self._fourier.dot(spectrum, spectrum)  # eq. 5

    def quadratic(self, residual: Light) -> tuple[float, Light]:
        """See `Weighting`; with two FFTs a channel."""
        spectrum = self._weighted_spectrum(residual)
        energy = self._fourier.dot(spectrum, spectrum)
        gains = self._like(residual)[0]
        spectrum *= gains
        planes = self._fourier.inverse(spectrum, spent=True)
        del spectrum, residual  # of a large picture, a gigabyte each
        return energy, self._to_light(planes)

    def _apply(self, residual: Light) -> Array:
        return self._fourier.inverse(self._weighted_spectrum(residual), spent=True)  # eq. 4

    def _adjoint(self, weighted: Array) -> Light:
        # A_l is its own adjoint: real gains, even in frequency
        spectrum = self._fourier.forward(weighted)
        spectrum *= self._like(weighted)[0]
        return self._to_light(self._fourier.inverse(spectrum, spent=True))

    def _weighted_spectrum(self, residual: Light) -> Array:
        """Spectrum of the convolution K_l * r, by the convolution theorem."""
        gains, opponent, support, _ = self._like(residual)
        xp = namespace(residual)
        planes = xp.zeros(
            (len(self.importance), opponent.shape[0], *self.padded),
            dtype=residual.dtype,
            device=residual.device,
        )
        counting = self._counting(residual, support)
        cols = self.shape[2]

        def fill(view: int, rows: slice) -> None:
            part = residual[view, rows, ...]
            channels = opponent @ xp.reshape(part, (-1, part.shape[2])).T
            channels = xp.reshape(channels, (-1, *part.shape[:2]))
            planes[view, :, rows, :cols] = channels * counting(view, rows)

        in_parts(fill, self.shape, residual)
        spectrum = self._fourier.forward(planes)
        spectrum *= gains  # eq. 6
        return spectrum

    def _to_light(self, planes: Array) -> Light:
        _, opponent, support, _ = self._like(planes)
        xp, shape = namespace(planes), self.shape
        light = xp.empty(shape, dtype=planes.dtype, device=planes.device)
        counting = self._counting(planes, support)
        cols = shape[2]

        def fill(view: int, rows: slice) -> None:
            channels = planes[view, :, rows, :cols] * counting(view, rows)
            light[view, rows, ...] = xp.permute_dims(channels, (1, 2, 0)) @ opponent

        in_parts(fill, shape, planes)
        return light

    def _counting(self, light: Light, support: Array) -> Callable[[int, slice], Array]:
        """Returns (view, rows) -> (row, col), the root of how much each pixel counts."""
        xp, root = namespace(light), self._like(light)[3]

        def counting(view: int, rows: slice) -> Array:
            counted = xp.astype(support[rows, :], light.dtype)
            return counted if self._alike else root[view] * counted

        return counting

    def _like(self, light: Light) -> tuple[Array, Array, Array, Array]:
        xp, key = namespace(light), kind(light)
        if key not in self._converted:
            root = np.sqrt(self.importance)
            gains, opponent, importance = (
                xp.asarray(array, dtype=light.dtype, device=light.device)
                for array in (self.gains, self.opponent, root)
            )
            support = xp.asarray(self.support, device=light.device)  # a bool takes little memory
            self._converted[key] = (gains, opponent, support, importance)
        return self._converted[key]


@final
class Masked(Weighting):
    """A_n lambda: another weighting, then a spatial mask (eq. 7).

    Parameters
    ----------
    mask
        (row, col) or (view, row, col) weights A_n, at least 0; 1 on the padding.
    inner
        The weighting that it masks.
    """

    def __init__(self, mask: NDArray[np.floating[Any]], inner: Weighting) -> None:
        if mask.shape not in (inner.shape[1:3], inner.shape[:3]):
            raise InputError(
                f"Masked takes a mask {inner.shape[1:3]} or {inner.shape[:3]}, got {mask.shape}"
            )
        rows, cols = mask.shape[-2:]
        self.inner = inner
        self.mask = np.ones((*mask.shape[:-2], 1, inner.fourier.rows, inner.fourier.cols))
        self.mask[..., 0, :rows, :cols] = mask

    @property
    def picture(self) -> NDArray[np.floating[Any]]:
        """The mask, as it was given."""
        return self.mask[..., 0, : self.shape[1], : self.shape[2]]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The inner weighting's."""
        return self.inner.shape

    @property
    def fourier(self) -> Fourier:
        """The inner weighting's."""
        return self.inner.fourier

    @property
    def peak(self) -> float:
        """The inner weighting's."""
        return self.inner.peak

    def _apply(self, residual: Light) -> Array:
        weighted = self.inner.apply(residual)
        return weighted * self._like(weighted)  # eq. 7

    def _adjoint(self, weighted: Array) -> Light:
        return self.inner._adjoint(weighted * self._like(weighted))

    def _like(self, planes: Array) -> Array:
        return namespace(planes).asarray(self.mask, dtype=planes.dtype, device=planes.device)


REGULARISATION = 1e-4
"""Default mu, as a share of the peak squared: it keeps invisible frequencies from filling with
noise."""


@final
@dataclass(frozen=True)
class PerceptualWeighting:
    """The settings of the weighting: builds a `CsfWeighting` for a theatre and a picture size.

    Parameters
    ----------
    low_frequency
        The low-frequency policy of luminance, which decides the look of the result.
    chroma_low_frequency
        The policy of the two chroma channels. Chromatic sensitivity does not fall towards low
        frequencies (Mullen 1985, *J. Physiol.* 359, 381-400), so its floor is 1: Daly's fall there
        would paint purple skies (``validation/notes/0003``).
    padding
        Least number of pixels of zero residual around the picture. At 64 the energy is within
        2e-3 of an unbounded plane's (``tests/compensate/vision/test_vision.py``).
    """

    low_frequency: LowFrequencyFloor = field(default_factory=LowFrequencyFloor)
    chroma_low_frequency: LowFrequencyFloor = field(default_factory=lambda: LowFrequencyFloor(1.0))
    padding: int = 64

    def __call__(
        self,
        viewing: Viewing,
        luminance_weights: NDArray[np.floating[Any]],
        support: Array,
        views: int = 1,
    ) -> CsfWeighting:
        """Makes the weighting of pictures that are seen one way.

        All channels get Daly's achromatic sensitivity, as in the paper, but for the policies at low
        frequencies.

        Parameters
        ----------
        viewing
            How pictures are seen.
        luminance_weights
            (primary,) share of each in the luminance of white.
        support
            (row, col) bool: where a residual counts.
        views
            How many pictures.

        Returns
        -------
        weighting
            A_l T.
        """
        rows, cols = support.shape
        padded = (padded_size(rows, self.padding), padded_size(cols, self.padding))

        @cache  # for all weightings that are made of this one
        def gains() -> Gains:
            luma, _ = csf_gains(viewing, (rows, cols), padded, self.low_frequency)
            if self.chroma_low_frequency == self.low_frequency:
                return luma[None]
            chroma, _ = csf_gains(viewing, (rows, cols), padded, self.chroma_low_frequency)
            return np.stack([luma, chroma, chroma])

        peak, _ = _peak(_daly(viewing))
        return CsfWeighting(gains, linear_ycbcr(luminance_weights), support, padded, peak, views)


def csf_gains(
    viewing: Viewing,
    size: tuple[int, int],
    padded: tuple[int, int],
    low_frequency: LowFrequencyFloor,
) -> tuple[Gains, float]:
    """Computes Omega of Daly's sensitivity.

    It is of single precision: it takes as much memory as pictures, and no CSF is known to seven
    digits.

    Parameters
    ----------
    viewing
        How the picture is seen.
    size, padded
        (rows, cols) of the picture, and of the padded grid.
    low_frequency
        The policy below the peak.

    Returns
    -------
    omega, peak
        (padded row, padded col // 2 + 1), 1 at the peak; and the peak's sensitivity.
    """
    row_frequency, col_frequency = Fourier(*padded).frequencies(viewing.pixels_per_degree(*size))
    sensitivity = _daly(viewing)
    peak, most_sensitive = _peak(sensitivity)
    omega = np.empty((padded[0], padded[1] // 2 + 1), np.float32)
    above = padded[0] // 2 + 1  # the other rows are their mirror images

    def fill(_: int, rows: slice) -> None:
        row = np.abs(row_frequency[rows])  # Nyquist's is negative
        frequency = np.hypot(row, col_frequency)
        seen = sensitivity(frequency, np.arctan2(row, col_frequency)) / peak
        omega[rows] = low_frequency(frequency, seen, most_sensitive)

    in_strips(fill, (1, above, omega.shape[1]))
    omega[above:] = omega[1 : padded[0] - above + 1][::-1]
    return omega, peak


Sensitivity: TypeAlias = Callable[[Any, Any], NDArray[np.floating[Any]]]
"""Sensitivity at frequency, cycles/degree, and orientation, radians: the same at two that mirror
each other."""


def _daly(viewing: Viewing) -> Sensitivity:
    return partial(
        daly,
        adaptation=viewing.adaptation,
        image_area=viewing.image_area,
        distance=viewing.distance,
    )


def _peak(sensitivity: Sensitivity) -> tuple[float, Any]:
    """The largest sensitivity, and its frequency, cycles/degree."""
    axis = np.geomspace(0.01, 60, 4096)
    curve = sensitivity(axis, 0.0)
    return float(curve.max()), axis[curve.argmax()]  # neighbours differ by far more than rounding


@guarded(luminance_weights="3")
def linear_ycbcr(luminance_weights: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Returns (channel, primary): Y, Cb, Cr of *linear* light, by ITU-R BT.709's construction.

    Y is luminance; Cb = (B - Y) / (2 (1 - w_B)); Cr = (R - Y) / (2 (1 - w_R)).
    """
    y = np.asarray(luminance_weights, np.float64)
    red, _, blue = np.eye(3)
    return np.stack([y, (blue - y) / (2 * (1 - y[2])), (red - y) / (2 * (1 - y[0]))])
