"""Live pictures by arrays of any library: on a GPU by PyTorch, with the formulas of the library.

`compensate.aim` computes with any array library. Exact clipped subtraction is here for them, as
`compensate.solver.baselines` has it of domes, and `deghosting` of pairs.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, Sight, lifted, veiled, with_hue
from compensate.devices import sender_to
from compensate.live.coding import Coding, PixelFormat, stored, views_of
from domesim.light import Light, namespace, on_host, total
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.lowrank import LowRankObservation, expand
from domesim.scene import Scene

_STEPS = 30
_SETTLED = 1e-6  # of white
_TURNS = 12  # of both eyes: exact to 1e-6 of crosstalk of 30 %


@final
class ByArrays:
    """Compensates frames on a device.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    rows, cols
        Of each view.
    coding, pixels
        What code values mean, and their layout.
    beside
        Whether views of a pair lie side by side.
    aim, dithers
        Settings of the aim; whether codes are rounded with noise.
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
        rows: int,
        cols: int,
        coding: Coding,
        pixels: PixelFormat,
        *,
        beside: bool,
        aim: Aim,
        dithers: bool,
        device: str,
    ) -> None:
        self._send = sender_to(device)
        self._aim, self._pixels, self._axis = aim, pixels, 1 if beside else 0
        self._views = scene.views
        self._screen = scene.screen(rows, cols)
        self._on = self._send(self._screen[None, :, :, None].astype(np.float32))
        self._observation = scene.solvable(rows, cols)
        self._sight = Sight(
            self._send(self._screen),
            scene.projector.luminance_weights,
            scene.projector.white,
            scene.viewing.pixels_per_degree(rows, cols),
        )
        self._table = self._send(coding.table(pixels))
        self._mixing = self._send(coding.mixing.astype(np.float32).T)
        self._coding, self._dithers = coding, dithers

    def __call__(self, codes: NDArray[Any], number: int) -> NDArray[Any]:
        """The frame (row, col, channel) to project; see `compensate.live.dome`."""
        views = views_of(codes, self._views, self._axis)
        kind = np.int32 if self._pixels.size == 2 else np.uint8
        bits = views[..., :3].view("<u2") if self._pixels.floating else views[..., :3]
        places = self._send(bits.astype(kind))
        xp = namespace(self._table)
        light = xp.take(self._table, xp.astype(xp.reshape(places, (-1,)), xp.int64))
        light = xp.reshape(light, bits.shape) @ self._mixing
        light = xp.clip(light, 0, 1) * self._on
        found = self._coding.encoded(on_host(self._projected(light)))
        noise = number if self._dithers else None
        return stored(found, views, self._screen, self._pixels, axis=self._axis, noise=noise)

    def _projected(self, desired: Light) -> Light:
        """Light that shows the aim of a master; see `compensate.master`."""
        observation, aim, sight = self._observation, self._aim, self._sight
        xp = namespace(desired)
        if isinstance(observation, Crosstalk):
            left = observation.observe(_of_pair(observation, desired)) - desired
            left = xp.maximum(left, xp.zeros_like(left))
            return _of_pair(observation, veiled(aim, sight, desired, left))
        assert isinstance(observation, LowRankObservation)
        wanted = observation.direct(desired)
        white = observation.direct(xp.ones_like(desired))
        first = _of_dome(observation, wanted, self._on)
        floor = observation.observe(first) - observation.direct(first)
        raised = lifted(aim, sight, wanted, floor, white)
        second = _of_dome(observation, raised, self._on)
        floor = observation.observe(second) - observation.direct(second)
        return _of_dome(observation, with_hue(aim, wanted, raised, floor), self._on)


def _of_dome(observation: LowRankObservation, seen: Light, on: Light) -> Light:
    """The light within 0..1 that shows `seen`, by Newton's method: see `baselines`."""
    xp, f = namespace(seen), observation.factors_like(seen)
    modes = f.spread / f.direct_gain[None, :, :]
    free = [(seen[0, :, :, p] - f.ambient[p, :, :]) / f.direct_gain for p in range(seen.shape[-1])]
    high, ranks = on[0, :, :, 0], range(modes.shape[0])
    excited = np.zeros((len(free), len(ranks)))
    core = on_host(f.core)

    def shown(p: int) -> tuple[Any, Any]:
        own = xp.asarray(excited[p], dtype=seen.dtype, device=seen.device)
        left = free[p] - expand(modes, own)
        return left, xp.minimum(xp.maximum(left, xp.zeros_like(left)), high)

    for _ in range(_STEPS):
        furthest = 0.0
        for p in range(len(free)):
            left, light = shown(p)
            moving = xp.astype((left > 0) & (left < high), seen.dtype)
            sums = [float(total(f.collect[j, :, :] * light)) for j in ranks]
            slopes = [
                [float(total(f.collect[j, :, :] * moving * modes[k, :, :])) for k in ranks]
                for j in ranks
            ]
            system = np.eye(len(ranks)) + core[p] @ np.array(slopes)
            step = np.linalg.solve(system, core[p] @ np.array(sums) - excited[p])
            excited[p] += step
            furthest = max(furthest, float(np.abs(step).max()))
        if furthest < _SETTLED:
            break
    return xp.stack([shown(p)[1] for p in range(len(free))], axis=-1)[None, ...]


def _of_pair(observation: Crosstalk, seen: Light) -> Light:
    """The light within 0..1 that shows `seen`: see `deghosting`."""
    xp = namespace(seen)
    black = xp.asarray(observation.black[:, None, None, :], dtype=seen.dtype, device=seen.device)
    wanted = seen - black
    light = xp.clip(wanted, 0, 1)
    for _ in range(_TURNS):
        light = xp.clip(wanted - observation.leaked(light), 0, 1)
    return light
