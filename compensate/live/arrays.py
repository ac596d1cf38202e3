"""Live pictures by arrays of any library: on a GPU by PyTorch, with the formulas of the library.

`compensate.aim` computes with any array library. Exact clipped subtraction is here for them, as
`compensate.subtract` has it for NumPy. A frame's bytes go to the
device, and those of what is projected come back: nothing else does, but the sums that tell a dome's
floors. On the device a primary's plane lies in one piece.
"""

from __future__ import annotations

from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, Sight
from compensate.aim.dome import lifted
from compensate.aim.pair import veiled
from compensate.devices import fetched, sender_to
from compensate.live.coding import Coding, PixelFormat, stored, views_of
from compensate.live.constants import SETTLED, STEPS, Constants, PairConstants, turns_of
from compensate.live.noise import APART, noise_of, shifts_of
from compensate.subtract import newton_step
from domesim.light import Array, Light, namespace, on_host, total
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.lowrank import LowRankObservation, expand
from domesim.scene import Scene

_PLACES = 1 << 16
"""Places of the table for encoding, of the fourth root of light, between which it is linear."""


@final
class ByArrays:
    """Compensates frames on a device.

    Parameters
    ----------
    scene, constants
        The theatre, or stereo system, and what it means for these frames.
    coding, pixels
        What code values mean, and their layout.
    beside
        Whether views of a pair lie side by side.
    dithers
        Whether codes are rounded with noise.
    device
        As for `compensate.devices.on_device`.

    Raises
    ------
    InputError
        If there is no such device.
    """

    def __init__(
        self,
        scene: Scene,
        constants: Constants,
        coding: Coding,
        pixels: PixelFormat,
        *,
        beside: bool,
        dithers: bool,
        device: str,
    ) -> None:
        send = self._send = sender_to(device)
        self._pixels, self._beside = pixels, beside
        rows, cols = constants.shape
        self._shape = scene.views, rows, cols
        screen = self._screen = scene.screen(rows, cols)
        self._on = send(screen.astype(np.float32))
        self._off = None if screen.all() else send(~screen[:, :, None])
        self._sight = Sight(
            send(screen),
            scene.projector.luminance_weights,
            scene.projector.white,
            scene.viewing.pixels_per_degree(rows, cols),
        )
        self._mixing = coding.mixing if coding.mixes else None
        self._table = send(coding.table(pixels))
        kept = constants.kept.T[:, :, None, None].astype(np.float32)  # (primary, view, 1, 1)
        self._kept = send(kept) if kept.any() else None
        curve = coding.curve_of_each.encode((np.arange(_PLACES + 2) / _PLACES) ** 4.0)
        self._codes = send((curve * (pixels.largest or 1)).astype(np.float32))
        self._noise: Array = send(noise_of(cols)) if dithers and pixels.largest else None
        observation = self._observation = scene.solvable(rows, cols)
        if isinstance(constants, PairConstants):
            self._turns = turns_of(constants)
        elif isinstance(observation, LowRankObservation):
            self._of_master, self._of_aim = (_Subtraction(observation, self._on) for _ in range(2))

    def __call__(self, codes: NDArray[Any], number: int, lift: float) -> NDArray[Any]:
        """The frame (row, col, channel) to project; see `compensate.live.dome`."""
        axis = 1 if self._beside else 0
        frame = self._send(codes.view("u1").reshape(*codes.shape, -1))
        sent = self._views(frame)
        xp = namespace(sent)
        light = xp.stack([self._decoded(sent[..., p, :]) for p in range(3)])
        light = xp.clip(_mixed(light, self._mixing), 0, 1)
        if self._kept is not None:
            light = light + self._kept
        light = light * self._on
        light = xp.moveaxis(self._projected(xp.moveaxis(light, 0, -1), Aim(lift)), -1, 0)
        back = None if self._mixing is None else np.linalg.inv(self._mixing)
        light = xp.clip(_mixed(light, back), 0, 1)
        planes = [self._encoded(light[p, ...], p, number) for p in range(3)]
        if self._pixels.floating:
            halves = fetched(xp.stack(planes, axis=-1))
            views = views_of(codes, self._shape[0], axis)
            return stored(halves, views, self._screen, self._pixels, axis=axis, noise=None)
        result = xp.stack(planes, axis=-2)
        if self._off is not None:
            result = xp.where(self._off[..., None], sent[..., :3, :], result)
        if self._pixels.channels > 3:
            result = xp.concat([result, sent[..., 3:, :]], axis=-2)
        if self._shape[0] > 1:
            result = xp.concat([result[0, ...], result[1, ...]], axis=axis)
        return fetched(result).view(codes.dtype).reshape(codes.shape)

    def _views(self, frame: Array) -> Array:
        """(view, row, col, channel, byte) of a frame's bytes."""
        views, rows, cols = self._shape
        if views == 1:
            return frame[None, ...]
        parts = [frame[:, :cols, ...], frame[:, cols:, ...]]
        if not self._beside:
            parts = [frame[:rows, ...], frame[rows:, ...]]
        return namespace(frame).stack(parts)

    def _decoded(self, sent: Array) -> Array:
        """(view, row, col) light of a primary's bytes (view, row, col, byte)."""
        xp = namespace(sent)
        places = xp.astype(sent[..., 0], xp.int32)
        if self._pixels.size == 2:
            places = places + 256 * xp.astype(sent[..., 1], xp.int32)
        return _taken(self._table, places)

    def _encoded(self, light: Array, primary: int, number: int) -> Array:
        """(view, row, col, byte) of a primary's light, or codes of half precision as float32."""
        xp = namespace(light)
        at = xp.sqrt(xp.sqrt(light)) * _PLACES
        place = xp.astype(at, xp.int32)
        low = _taken(self._codes, place)
        codes = low + (_taken(self._codes, place + 1) - low) * (at - xp.astype(place, at.dtype))
        if self._pixels.floating:
            return codes
        if self._noise is not None:
            codes = codes + self._noise_of(codes, primary, number)
        whole = xp.astype(xp.clip(codes + 0.5, 0, self._pixels.largest), xp.int32)
        if self._pixels.size == 1:
            return xp.astype(whole, xp.uint8)[..., None]
        return xp.stack([xp.astype(each, xp.uint8) for each in (whole & 255, whole >> 8)], axis=-1)

    def _noise_of(self, codes: Array, primary: int, number: int) -> Array:
        """Noise for a primary's codes (view, row, col), as compiled loops have it."""
        xp, (views, rows, cols) = namespace(codes), self._shape
        shifts = self._send(shifts_of(number, rows).astype(np.int32))
        along = xp.arange(cols, dtype=xp.int32, device=codes.device)
        noise = []
        for view in range(views):
            at = shifts[:, None] + (along + (primary + 3 * view) * APART)[None, :]
            near = xp.minimum(codes[view, ...], self._pixels.largest - codes[view, ...])
            second = xp.astype(near >= 0.5, codes.dtype) * _taken(self._noise[1, :], at)
            noise.append(_taken(self._noise[0, :], at) + second)
        return xp.stack(noise)

    def _projected(self, desired: Light, aim: Aim) -> Light:
        """Light that shows the aim of a master; see `compensate.solve`."""
        observation, sight = self._observation, self._sight
        xp = namespace(desired)
        if isinstance(observation, Crosstalk):
            left = observation.observe(self._of_pair(observation, desired)) - desired
            left = xp.maximum(left, xp.zeros_like(left))
            return self._of_pair(observation, veiled(aim, sight, desired, left))
        wanted = observation.direct(desired)  # D is 1 where a grade keeps black
        white = observation.direct(xp.ones_like(desired))
        floor = self._of_master(wanted).floor
        return self._of_aim(lifted(aim, sight, wanted, floor, white)).light

    def _of_pair(self, observation: Crosstalk, seen: Light) -> Light:
        """The light within 0..1 that shows `seen`: see `compensate.subtract`."""
        xp = namespace(seen)
        black = observation.black[:, None, None, :]
        wanted = seen - xp.asarray(black, dtype=seen.dtype, device=seen.device)
        light = xp.clip(wanted, 0, 1)
        for _ in range(self._turns):
            light = xp.clip(wanted - observation.leaked(light), 0, 1)
        return light


class _Shown(NamedTuple):
    """(1, row, col, primary) light that is projected, and what is there of pollution."""

    light: Light
    floor: Light


@final
class _Subtraction:
    """Exact subtraction in a dome, by Newton's method from where the last frame ended.

    See `compensate.subtract`; it ends as `compensate.live.dome.CompiledDome` does.

    Parameters
    ----------
    observation
        Of the dome.
    on
        (row, col) 1 on the screen, 0 elsewhere.
    """

    def __init__(self, observation: LowRankObservation, on: Array) -> None:
        self._on, self._factors = on, observation.factors_like(on)
        factors = observation.factors
        self._core = factors.core
        self._strongest = np.abs(factors.spread / factors.direct_gain).max(axis=(1, 2))
        self._excited = np.zeros(self._core.shape[:2])

    def __call__(self, seen: Light) -> _Shown:
        """Light within 0..1 that shows `seen`."""
        xp, excited = namespace(seen), self._excited
        for _ in range(STEPS):
            found = [self._sums(self._shown(seen, p)[0]) for p in range(len(excited))]
            sums, slopes = np.split(on_host(xp.stack(found)), [1], axis=1)
            step = newton_step(self._core, sums[:, 0], slopes, excited)
            excited += step
            if (np.abs(step) @ self._strongest).max() < SETTLED:
                break
        shown = [self._shown(seen, p) for p in range(len(excited))]
        return _Shown(*(xp.moveaxis(xp.stack(each), 0, -1) for each in zip(*shown, strict=True)))

    def _shown(self, seen: Light, primary: int) -> tuple[Array, Array]:
        """(1, row, col) light of a primary, and its floor."""
        xp, f = namespace(seen), self._factors
        excited = xp.asarray(self._excited[primary], dtype=seen.dtype, device=seen.device)
        floor = expand(f.spread, excited) + f.ambient[primary, :, :]
        light = (seen[..., primary] - floor) / f.direct_gain
        return xp.minimum(xp.maximum(light, xp.zeros_like(light)), self._on), floor[None, ...]

    def _sums(self, light: Array) -> Array:
        """(1 + rank, rank) what light excites, and its slopes by what is excited."""
        xp, f = namespace(light), self._factors
        ranks = range(len(self._strongest))
        moving = xp.astype((light > 0) & (light < self._on), light.dtype)[0, ...] / f.direct_gain
        sums = [total(f.collect[j, :, :] * light[0, ...]) for j in ranks]
        slopes = [
            total(f.collect[j, :, :] * moving * f.spread[k, :, :]) for j in ranks for k in ranks
        ]
        return xp.reshape(xp.stack(sums + slopes), (-1, len(ranks)))


def _taken(table: Array, places: Array) -> Array:
    """Numbers of a table (place,) at places of any shape."""
    xp = namespace(table)
    return xp.reshape(xp.take(table, xp.reshape(places, (-1,))), places.shape)


def _mixed(light: Array, matrix: NDArray[Any] | None) -> Array:
    """(primary, ...) light in other primaries; the same light if there is no matrix."""
    if matrix is None:
        return light
    planes = range(light.shape[0])
    return namespace(light).stack(
        [sum(float(row[p]) * light[p, ...] for p in planes) for row in matrix]
    )
