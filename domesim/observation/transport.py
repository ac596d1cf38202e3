"""A theatre's light transport as stored: smooth modes and how they excite each other.

Indirect light on a dome screen is smooth, so a few functions m_i on the screen carry it:

    phi(x)[p] = f[p] sum_ij m_i core[p, i, j] (integral of m_j f[p] D x[p] dA) / A_s

with f what multiplies the screen's albedo from place to place (1 on even paint), whatever the room:
tabulated by the path tracer, computed by radiosity, or measured. The first mode is 1 everywhere; a
bare Lambertian cap is core[p, 0, 0] = rho A_s / (4 pi r² - rho A_s) and nothing
else. Modes are stored as samples on a coarse even grid of the domemaster, and pictures of any size
meet them through cubic interpolation, which is separable: two thin matrix products whose transposes
collect light. So a picture of n pixels costs O(n), and its adjoint is exact at any size.

File format (``.npz``, NumPy's zip of arrays, no pickles; version 1): ``format`` (text),
``dome`` (radius m, half-angle, tilt, height ratio, truncation m or NaN), ``modes`` (rank, node,
node), ``core`` and ``core_error`` (primary, rank, rank), ``ambient`` (primary, node, node; 1.0 =
projector white, light that is there without a picture, but for projector black), ``provenance``
(JSON text) and ``sha256`` (of all the others' bytes in that order).
"""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.arrays import read_arrays, write_arrays
from domesim.light import Array, Light, kind, namespace, on_host
from domesim.light.guarded import guarded
from domesim.observation.base import AdjointObservation
from domesim.observation.basis import disc_quadrature
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

FORMAT = "domesim transport 1"
_FIELDS = ("modes", "core", "core_error", "ambient")
NODES = 97
"""Nodes a side of the coarse grid; it reaches `MARGIN` intervals beyond the picture."""
MARGIN = 2
PHOTOGRAPHS = "photographs"
"""The "method" in the provenance of a transport that was measured."""


@final
@dataclass(frozen=True)
class Transport:
    """The indirect light of one theatre.

    Attributes
    ----------
    dome
        The screen.
    modes
        (rank, node, node) functions on `node_places`, the first of them 1.
    core
        (primary, rank, rank) dimensionless.
    core_error
        (primary, rank, rank) standard errors of `core`.
    ambient
        (primary, node, node) light that is there without a picture, 1.0 = projector white.
    provenance
        How it came about: scene, method, seed, samples, versions, figures.
    """

    dome: Dome
    modes: Floats
    core: Floats
    core_error: Floats
    ambient: Floats
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rank, nodes = len(self.modes), self.modes.shape[-1]
        wanted = {
            "modes": (rank, nodes, nodes),
            "core": (3, rank, rank),
            "core_error": (3, rank, rank),
            "ambient": (3, nodes, nodes),
        }
        for name, shape in wanted.items():
            actual = getattr(self, name)
            if actual.shape != shape:
                raise InputError(f"transport {name} must be {shape}, got {actual.shape}")
            if not np.all(np.isfinite(actual)):
                raise InputError(f"transport {name} has values that are not finite")

    @property
    def rank(self) -> int:
        """Number of modes."""
        return len(self.modes)

    def mean_gain(self) -> Floats:
        """(primary,) mean indirect light of a white picture."""
        means = self._means()
        return np.asarray(np.einsum("i,pij,j->p", means, self.core, means))

    def white_error(self) -> Floats:
        """(primary,) rms standard error of a white picture's indirect light."""
        means = self._means()
        weight = self._gram().diagonal()
        return np.asarray(np.sqrt(np.einsum("i,pij,j->p", weight, self.core_error**2, means**2)))

    def relative_error(self) -> float:
        """Rms standard error of a white picture's indirect light, relative to its mean."""
        return float(np.max(self.white_error() / np.maximum(self.mean_gain(), 1e-30)))

    def reduced(self, tolerance: float = 1e-4, highest: int | None = None) -> Transport:
        """Approximates this transport by the fewest modes within a tolerance.

        By the singular values of all primaries' cores together, in the inner product of the
        screen's area: for one symmetric core, the best approximation of its rank.

        Parameters
        ----------
        tolerance
            Root of the dropped share of the squared singular values.
        highest
            Keep at most so many modes.

        Returns
        -------
        transport
            Of the same screen and grid.
        """
        lower = np.linalg.cholesky(self._gram() + 1e-14 * np.eye(self.rank))
        normal = lower.T @ self.core @ lower  # in orthonormal modes
        stacked = np.concatenate([*normal, *normal.transpose(0, 2, 1)], axis=1)
        vectors, values, _ = np.linalg.svd(stacked, full_matrices=False)
        whole = max(float(np.sum(values**2)), 1e-300)  # a black screen's is 0
        left = np.sqrt(np.cumsum(values[::-1] ** 2)[::-1] / whole)
        # Equal values may be parted: the tolerance allows either to go. Signs and order of modes do
        # not show, as modes stand on both sides of the core
        keep = max(1, int(np.sum(left > tolerance)))
        keep = keep if highest is None else min(keep, highest)
        turned = vectors[:, :keep]
        modes = np.tensordot(turned.T @ np.linalg.inv(lower), self.modes, axes=1)
        squares = (lower @ turned) ** 2  # errors add in squares
        error = squares.T @ self.core_error**2 @ squares
        return replace(
            self,
            modes=modes,
            core=np.asarray(turned.T @ normal @ turned),
            core_error=np.sqrt(error),
        )

    def plus(self, other: Transport) -> Transport:
        """Adds another transport of the same screen; the provenance is this one's.

        Raises
        ------
        InputError
            If they are of different screens, or a first mode is not 1 (as after `reduced`).
        """
        for part in (self, other):
            if not np.allclose(part.modes[0], 1):
                raise InputError(
                    "transports are added before they are reduced: a first mode is not 1"
                )
        if self.dome != other.dome or self.modes.shape[1:] != other.modes.shape[1:]:
            raise InputError("transports of different screens or grids cannot be added")
        modes = np.concatenate([self.modes, other.modes[1:]])  # both begin with 1
        u, v, weight = disc_quadrature(self.dome, 48)
        sampled = sample_nodes(modes, u, v)
        share = weight / weight.sum()
        means = sampled @ share
        means[0] = 0
        spread = sampled[1:] - means[1:, None]
        values, vectors = np.linalg.eigh((spread * share) @ spread.T)
        kept = values > 1e-12 * values.max(initial=0.0)  # rounding leaves 1e-16
        vectors, values = vectors[:, kept], values[kept]
        # Orthonormal, the first still 1; old modes are turn @ new ones
        turn = np.zeros((len(modes), 1 + len(values)))
        turn[0, 0], turn[1:, 0] = 1, means[1:]
        turn[1:, 1:] = vectors * np.sqrt(values)
        centred = modes[1:] - means[1:, None, None]
        fresh = np.tensordot((vectors / np.sqrt(values)).T, centred, axes=1)
        first = turn[: self.rank]
        second = np.concatenate([turn[:1], turn[self.rank :]])
        core = first.T @ self.core @ first + second.T @ other.core @ second
        square = (first.T**2) @ self.core_error**2 @ first**2
        square += (second.T**2) @ other.core_error**2 @ second**2
        return replace(
            self,
            modes=np.concatenate([modes[:1], fresh]),
            core=core,
            core_error=np.sqrt(square),
            ambient=self.ambient + other.ambient,
        )

    def observation(
        self,
        rows: int,
        cols: int,
        *,
        lens_gain: Floats | None = None,
        seen_gain: Floats | None = None,
        ambient: float = 0.0,
        paint: Floats | None = None,
    ) -> TabulatedDome:
        """Makes the observation of domemasters of one size.

        Parameters
        ----------
        rows, cols
            Size of the domemaster.
        lens_gain
            (row, col) irradiance that projectors give the screen; 1 everywhere if absent.
        seen_gain
            (row, col) direct light as it is seen; `lens_gain` if absent (a Lambertian screen).
        ambient
            Luminance of a black picture by the projectors themselves, 1.0 = projector white.
        paint
            (row, col, primary) what multiplies the albedo; one primary stands for all, 1 if absent.

        Returns
        -------
        dome
            It observes light (1, row, col, primary).
        """
        return TabulatedDome(self, rows, cols, lens_gain, seen_gain, ambient, paint)

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        write_arrays(path, self._arrays())

    def _arrays(self) -> dict[str, Any]:
        dome = self.dome
        cut = np.nan if dome.truncated_below is None else dome.truncated_below
        return {
            "format": np.array(FORMAT),
            "dome": np.array([dome.radius, dome.half_angle, dome.tilt, dome.height_ratio, cut]),
            "modes": self.modes,
            "core": self.core,
            "core_error": self.core_error,
            "ambient": self.ambient,
            "provenance": np.array(json.dumps(dict(self.provenance), sort_keys=True)),
        }

    def _gram(self) -> Floats:
        """(rank, rank) means over the screen of products of modes."""
        u, v, weight = disc_quadrature(self.dome, 48)
        sampled = sample_nodes(self.modes, u, v)
        return np.asarray((sampled * weight) @ sampled.T / weight.sum())

    def _means(self) -> Floats:
        u, v, weight = disc_quadrature(self.dome, 48)
        return np.asarray(sample_nodes(self.modes, u, v) @ weight / weight.sum())


def load_transport(path: str | Path) -> Transport:
    """Read a file that `Transport.save` wrote.

    Raises
    ------
    InputError
        If it is no such file, or damaged.
    """
    arrays = read_arrays(Path(path), FORMAT, "transport", ("dome", *_FIELDS, "provenance"))
    try:
        radius, half_angle, tilt, ratio, cut = (float(value) for value in arrays["dome"])
        dome = Dome(radius, half_angle, tilt, ratio, None if np.isnan(cut) else cut)
        provenance = json.loads(str(arrays["provenance"]))
        fields = {name: arrays[name] for name in _FIELDS}
    except InputError:
        raise
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: wanted a transport stored by 'domesim tabulate', this is none or damaged"
        ) from error
    return Transport(dome, **fields, provenance=provenance)


def node_places(nodes: int = NODES) -> Floats:
    """(node,): places of the coarse grid along a side, in the domemaster's -1..1 and beyond."""
    step = 2 / (nodes - 1 - 2 * MARGIN)
    return np.asarray((np.arange(nodes) - MARGIN) * step - 1)


@guarded(places="place, finite")
def interpolation(places: NDArray[np.floating[Any]], nodes: int) -> Floats:
    """Cubic (4-point Lagrange) weights of the nodes at some places.

    Parameters
    ----------
    places
        (place,) along a side of the domemaster, -1..1.
    nodes
        Number of nodes along a side.

    Returns
    -------
    weights
        (node, place).
    """
    cell, weights = _lagrange(places, nodes)
    matrix = np.zeros((nodes, len(places)))
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        matrix[cell + offset, np.arange(len(places))] += weight
    return matrix


@guarded(tables="table node node", u="point, finite", v="point, finite")
def sample_nodes(tables: Floats, u: Floats, v: Floats) -> Floats:
    """Samples functions on the grid of nodes at points of the domemaster.

    Parameters
    ----------
    tables
        (table, node, node) functions.
    u, v
        (point,) to the right and down, -1..1.

    Returns
    -------
    values
        (table, point).
    """
    nodes = tables.shape[-1]
    result = np.zeros((len(tables), len(u)))
    (down, down_weights), (across, across_weights) = _lagrange(v, nodes), _lagrange(u, nodes)
    for a in range(4):
        for b in range(4):
            values = tables[:, down + a - 1, across + b - 1]
            result += values * (down_weights[a] * across_weights[b])
    return result


def _lagrange(
    places: NDArray[np.floating[Any]], nodes: int
) -> tuple[NDArray[np.int64], tuple[Floats, ...]]:
    """Second of the four nodes around a place, and the weights of the four."""
    step = 2 / (nodes - 1 - 2 * MARGIN)
    position = (places + 1) / step + MARGIN
    cell = np.clip(np.floor(position), 1, nodes - 3).astype(np.int64)
    t = position - cell
    return cell, (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )


@final
class TabulatedDome(AdjointObservation):
    """A theatre whose indirect light is stored as a `Transport`; made by it."""

    def __init__(
        self,
        transport: Transport,
        rows: int,
        cols: int,
        lens_gain: Floats | None,
        seen_gain: Floats | None,
        ambient: float,
        paint: Floats | None,
    ) -> None:
        dome = transport.dome
        self._screen = dome.inside(rows, cols)
        gain = np.ones((rows, cols))
        if lens_gain is not None:
            gain = np.where(self._screen, lens_gain, 1.0)
        seen = gain if seen_gain is None else seen_gain
        if not bool(np.all(seen[self._screen] > 0) and np.all(gain[self._screen] > 0)):
            raise InputError("lens gain must be above 0 everywhere on the screen")
        self.transport = transport
        on = self._screen[..., None]
        self._paint = on if paint is None else paint * on
        # (row, col, primary), as is the paint
        self._direct_gain = np.where(on, seen[..., None] * self._paint, 1.0)
        areas = dome.screen_areas(rows, cols)
        self._areas = areas / areas.sum()
        self._flux = (self._areas * gain)[..., None] * self._paint
        nodes = transport.modes.shape[-1]
        places = (np.arange(rows) + 0.5) * (2 / rows) - 1
        self._weights = interpolation(places, nodes)
        self._strips = _strips(self._weights)
        grid = self._weights.T @ transport.ambient @ self._weights
        self._ambient = (grid + ambient) * np.moveaxis(self._paint, -1, 0)
        self._kept: dict[tuple[str, ...], _Factors] = {}

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(1, row, col, primary)."""
        rows, cols = self._screen.shape
        return 1, rows, cols, self.transport.core.shape[0]

    @property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col) bool: pixels whose centre is on the screen."""
        return self._screen

    def lit(self, added: Floats) -> TabulatedDome:
        """Adds light without a picture: (row, col, primary), as it is seen."""
        dome = copy.copy(self)
        dome._ambient, dome._kept = self._ambient + np.moveaxis(added, -1, 0), {}
        return dome

    @property
    def coloured(self) -> bool:
        """Whether paint multiplies the primaries' albedos each in its own way."""
        return bool(self._paint.shape[2] > 1)

    def low_rank(self, tolerance: float = 5e-3, highest: int = 8) -> LowRankDome:
        """The observation with few modes, each of the picture's size: what a solver needs.

        Its memory grows with their square. At the default tolerance the reflected light of small
        patches is kept to some 0.3 % (of a planetarium: five modes).

        Parameters
        ----------
        tolerance, highest
            As for `Transport.reduced`.

        Returns
        -------
        dome
            Of the same size.

        Raises
        ------
        InputError
            If it is `coloured`.
        """
        if self.coloured:
            raise InputError("low_rank takes one paint for all primaries, got a coloured one")
        return LowRankDome(self, self.transport.reduced(tolerance, highest))

    def _observe(self, light: Light) -> Light:
        return self._linear(light) + self._like(light).ambient

    def _direct(self, light: Light) -> Light:
        return light * namespace(light).reshape(self._like(light).direct, self.shape)

    def _linear(self, light: Light) -> Light:
        k = self._like(light)
        return self._carried(light, k.flux, k.core, k.leave)

    def _adjoint(self, light: Light) -> Light:
        k = self._like(light)
        return self._carried(
            light, k.leave, namespace(light).permute_dims(k.core, (0, 2, 1)), k.flux
        )

    def excitation(self, light: Light) -> Floats:
        """Collects `light` on the nodes as modes do: (primary, node, node).

        The sum of its product with a mode m is the integral of m D x dA / A_s.
        """
        light = self._guarded(light, "collects")
        return on_host(self._collected(light, self._like(light).flux))

    def means(self, light: Light) -> Floats:
        """Weights (primary, node, node) that average functions on the nodes by `light`.

        The mean is over the screen's area; light off the screen does not count.
        """
        light = self._guarded(light, "averages")
        repeated = np.repeat(self._areas * self._screen, self.shape[-1], axis=1)
        xp = namespace(light)
        return on_host(
            self._collected(light, xp.asarray(repeated, dtype=light.dtype, device=light.device))
        )

    def on_pixels(self, grids: Floats, like: Light) -> Light:
        """Spreads functions on the grid of nodes over the pixels.

        Parameters
        ----------
        grids
            (primary, node, node) functions.
        like
            Light of the library, precision and device that is wanted.

        Returns
        -------
        light
            (1, row, col, primary), as paint shows them; 0 off the screen.
        """
        k, xp = self._like(like), namespace(like)
        sent = xp.asarray(np.asarray(grids), dtype=like.dtype, device=like.device)
        result = xp.zeros(self.shape, dtype=like.dtype, device=like.device)
        self._spread(xp.reshape(result, (self.shape[1], -1)), sent, k.leave)
        return result

    def _carried(self, light: Light, enter: Array, core: Array, leave: Array) -> Light:
        """D light + leave modes core modes' (enter light), in strips that fit a cache."""
        xp, k = namespace(light), self._like(light)
        rows, cols, primaries = light.shape[1:]
        nodes = k.weights.shape[0]
        sums = xp.reshape(self._collected(light, enter), (primaries, nodes * nodes))
        excited = (core @ (sums @ xp.permute_dims(k.modes, (1, 0)))[:, :, None])[:, :, 0]
        grids = xp.reshape(xp.astype(excited @ k.modes, light.dtype), (primaries, nodes, nodes))
        flat = xp.reshape(light, (rows, cols * primaries))
        result = xp.empty_like(flat)
        self._spread(result, grids, leave, flat)
        return xp.reshape(result, self.shape)

    def _collected(self, light: Light, enter: Array) -> Array:
        """(primary, node, node) float64 sums of enter times light, by the nodes' weights."""
        xp, k = namespace(light), self._like(light)
        rows, cols, primaries = light.shape[1:]
        nodes = k.weights.shape[0]
        flat = xp.reshape(light, (rows, cols * primaries))
        down = xp.zeros((nodes, cols * primaries), dtype=light.dtype, device=light.device)
        for first, last, low, high in self._strips:
            strip = flat[first:last, :] * enter[first:last, :]
            down[low:high, :] += k.weights[low:high, first:last] @ strip
        down = xp.permute_dims(xp.reshape(down, (nodes, cols, primaries)), (2, 0, 1))
        return xp.astype(down @ xp.permute_dims(k.weights, (1, 0)), xp.float64)

    def _spread(
        self, result: Array, grids: Array, leave: Array, direct: Array | None = None
    ) -> None:
        """Fill `result` (row, col primary) with leave times grids, and D times direct light."""
        k, xp = self._like(result), namespace(result)
        cols, primaries = self.shape[2:]
        nodes = k.weights.shape[0]
        wide = xp.reshape(xp.permute_dims(grids @ k.weights, (1, 2, 0)), (nodes, cols * primaries))
        for first, last, low, high in self._strips:
            part = xp.permute_dims(k.weights[low:high, first:last], (1, 0)) @ wide[low:high, :]
            part *= leave[first:last, :]
            if direct is not None:
                part += direct[first:last, :] * k.direct[first:last, :]
            result[first:last, :] = part

    def _direct_adjoint(self, light: Light) -> Light:
        return self._direct(light)

    def _like(self, light: Light) -> _Factors:
        key = kind(light)
        if key not in self._kept:
            xp = namespace(light)
            t = self.transport

            def convert(array: Any, dtype: Any) -> Array:
                return xp.asarray(np.ascontiguousarray(array), dtype=dtype, device=light.device)

            def plane(array: Any) -> Array:
                # Broadcasting along an axis of three is slow: (row, col primary) instead.
                narrow = np.asarray(array, np.float32 if "32" in key[1] else np.float64)
                rows, cols, primaries = self.shape[1:]
                wide = np.broadcast_to(narrow, (rows, cols, primaries))
                return convert(wide.reshape(rows, -1), light.dtype)

            self._kept[key] = _Factors(
                direct=plane(self._direct_gain),
                flux=plane(self._flux),
                leave=plane(self._paint),
                weights=convert(self._weights, light.dtype),
                ambient=convert(np.moveaxis(self._ambient, 0, -1)[None], light.dtype),
                modes=convert(t.modes.reshape(t.rank, -1), xp.float64),
                core=convert(t.core, xp.float64),
            )
        return self._kept[key]


@final
@dataclass(frozen=True)
class _Factors:
    """Arrays that a `TabulatedDome` multiplies by, in one library."""

    direct: Array
    flux: Array
    leave: Array
    weights: Array
    ambient: Array
    modes: Array
    core: Array


@final
class LowRankDome(LowRankObservation):
    """A `TabulatedDome` with a few modes; made by its `low_rank`."""

    def __init__(self, dome: TabulatedDome, transport: Transport) -> None:
        weights = dome._weights
        modes = weights.T @ transport.modes @ weights
        collect = modes * dome._flux[..., 0]
        modes *= dome._paint[..., 0]
        factors = LowRank(
            direct_gain=dome._direct_gain[..., 0],
            spread=modes,
            core=transport.core,
            collect=collect,
            ambient=dome._ambient,
        )
        super().__init__(factors, dome.screen)


def _strips(weights: Floats, height: int = 32) -> list[tuple[int, int, int, int]]:
    """Strips of picture rows, and the nodes that reach them: (first, last, low, high)."""
    strips = []
    for first in range(0, weights.shape[1], height):
        last = min(first + height, weights.shape[1])
        reached = np.flatnonzero(weights[:, first:last].any(axis=1))
        strips.append((first, last, int(reached[0]), int(reached[-1]) + 1))
    return strips
