"""What computes live pictures: compiled loops, a GPU by PyTorch, or the library's own NumPy."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.devices import CPU
from compensate.live.coding import Coding, PixelFormat, stored, views_of
from compensate.live.compiled import compiles
from compensate.live.constants import DomeConstants, constants_of
from compensate.pose import Stage
from compensate.solve import solved
from domesim.scene import Scene
from domesim.scene.screening import within_range

Engine: TypeAlias = Callable[[NDArray[Any], int, float], NDArray[Any]]
"""Frame (row, col, channel), its number, and its lift (`compensate.aim.Aim`) -> the frame to
project, kept for `HELD` frames."""

FAST, PLAIN = "numba", "numpy"
"""Names of what computes on the processor."""


def engine_of(
    scene: Scene,
    rows: int,
    cols: int,
    coding: Coding,
    pixels: PixelFormat,
    *,
    beside: bool,
    dithers: bool,
    device: str | None = None,
) -> tuple[str, Engine]:
    """Chooses what computes live pictures.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    rows, cols
        Size of a view, pixels.
    coding, pixels
        What code values mean, and their layout.
    beside
        Whether views of a pair lie side by side.
    dithers
        Whether codes are rounded with noise.
    device
        As for `compensate.devices.on_device`. If None: compiled loops, which are as fast on some
        cores as PyTorch on a GPU; without the extra ``fast``, a GPU where PyTorch finds one.

    Returns
    -------
    name, engine
        The name of what computes, and what compensates frames.

    Raises
    ------
    InputError
        As for `constants_of`; or if there is no such device.
    """
    constants = constants_of(scene, rows, cols)
    device = device or (CPU if compiles() or not has_gpu() else "cuda")
    how: Any = {"beside": beside, "dithers": dithers}
    if device != CPU:
        from compensate.live.arrays import ByArrays  # noqa: PLC0415 - needed on a GPU only

        return device, ByArrays(scene, constants, coding, pixels, device=device, **how)
    if not compiles():
        return PLAIN, _plain(scene, coding, pixels, **how)
    if isinstance(constants, DomeConstants):
        from compensate.live.dome import CompiledDome  # noqa: PLC0415 - of an extra

        return FAST, CompiledDome(constants, coding, pixels, dithers=dithers)
    from compensate.live.pair import CompiledPair  # noqa: PLC0415

    return FAST, CompiledPair(constants, coding, pixels, beside=beside, dithers=dithers)


def has_gpu() -> bool:
    """Says whether PyTorch finds a GPU; it is not imported where there is no sign of one."""
    if not Path("/dev/nvidia0").exists() or importlib.util.find_spec("torch") is None:
        return False
    import torch  # noqa: PLC0415 - it takes seconds

    return bool(torch.cuda.is_available())


def _plain(
    scene: Scene, coding: Coding, pixels: PixelFormat, *, beside: bool, dithers: bool
) -> Engine:
    """`compensate.master` for raw frames."""
    stage = Stage(scene, Aim())
    axis = 1 if beside else 0

    def compensated(codes: NDArray[Any], number: int, lift: float) -> NDArray[Any]:
        views = views_of(codes, scene.views, axis)
        screen = scene.screen(*views.shape[1:3])
        desired, _ = within_range(coding.decoded(views), screen)
        posed = replace(stage.pose(desired), lift=lift)
        projected = coding.encoded(solved(posed, "perceptual").light)
        noise = number if dithers else None
        return stored(projected, views, screen, pixels, axis=axis, noise=noise)

    return compensated
