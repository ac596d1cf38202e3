"""Where a further frame's time goes, pass by pass, and what each moves through memory.

Bytes are counted where strips of whole pictures are taken or put: of the master's codes, of light,
of the codes to project, and of the areas of a dome's pixels. What a pass makes of a strip lies in
caches, and does not count; nor do the few places around stars.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final
from unittest.mock import patch

import numpy as np

from compensate.aim import dome
from compensate.figures import Appraisal
from compensate.master import solve_frame
from compensate.pose import Stage
from domesim.frames import Master, read_master, write_master
from domesim.light import Light
from domesim.light.planes import empty_light, once
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.scene import load_scene, screening

HEADER = f"{'pass of a further frame':<40}{'core-ms':>9}{'bytes a pixel':>15}"
_MOVED: list[int] = []
"""Bytes taken or put, strip by strip, of any thread."""


@final
@dataclass(frozen=True)
class Pass:
    """One part of a frame's work.

    Parameters
    ----------
    name
        What it does.
    cpu_s
        Core-seconds, the least of some frames.
    moved
        Bytes for each pixel of the picture.
    """

    name: str
    cpu_s: float
    moved: float


def line(found: Pass) -> str:
    """What was found, under `HEADER`."""
    return f"{found.name:<40}{1000 * found.cpu_s:>9.0f}{found.moved:>15.1f}"


def passes(path: Path, scene: str, out: Path, frames: int = 4) -> list[Pass]:
    """Does a dome's frame some times, pass by pass.

    Parameters
    ----------
    path
        The master.
    scene
        A dome of one view.
    out
        Where the frame to project goes.
    frames
        How many times; the first one does not count.

    Returns
    -------
    passes
        In their order; the last one is all of them.
    """
    stage = Stage(load_scene(scene))
    times = [_measured(stage, path, out, time.process_time) for _ in range(frames)]
    with _counting():
        moved = _measured(stage, path, out, lambda: sum(_MOVED))
    rows, cols = read_master([path]).frames[0].pixels.shape[:2]
    found = [
        Pass(name, min(each[name] for each in times[1:]), count / (rows * cols))
        for name, count in moved.items()
    ]
    return [*found, Pass("all", sum(x.cpu_s for x in found), sum(x.moved for x in found))]


def _measured(
    stage: Stage, path: Path, out: Path, measure: Callable[[], float]
) -> dict[str, float]:
    """What is measured after each pass of a frame, less what was before."""
    found: dict[str, float] = {}

    def step(name: str, work: Callable[[], Any]) -> Any:
        before = measure()
        result = work()
        found[name] = measure() - before
        return result

    master = step("reading", lambda: _read(path))
    posed, beyond = step("what is seen of the master", lambda: stage.pose_frame(master))
    step("subtraction's sums", lambda: posed.exact)
    solution = step(
        "the aim, and its subtraction", lambda: solve_frame(master, posed, beyond, "perceptual")
    )
    appraisal = Appraisal(posed)
    frame, clipped = step("light to codes", solution.encoded)
    glance = step("what is seen of it", lambda: appraisal.glance(solution.result.light))
    step("compressing, writing", lambda: _written(frame, out))
    step("figures", lambda: solution.figures(appraisal, clipped, glance=glance))
    stored = step("reading back", lambda: _read(out))
    step("what is lost as stored", lambda: appraisal.loss(screening.decoder(stored, posed.scene)))
    return found


def _read(path: Path) -> Master:
    master = read_master([path], halves=True)
    return _counted_codes(master)


def _written(frame: Master, out: Path) -> None:
    write_master(frame, [out])
    _MOVED.append(sum(each.pixels.nbytes for each in frame.frames))


def _counted_codes(master: Master) -> Master:
    """A master that was read, whose codes count what is taken of them."""
    _MOVED.append(sum(each.pixels.nbytes for each in master.frames))
    frames = tuple(replace(each, pixels=each.pixels.view(_Counted)) for each in master.frames)
    return replace(master, frames=frames)


class _Counted(np.ndarray):
    """An array that notes the bytes of what is taken of it, and put."""

    def __getitem__(self, key: Any) -> Any:
        part = self.view(np.ndarray)[key]
        _MOVED.append(once(np.asarray(part)).nbytes)
        return part

    def __setitem__(self, key: Any, value: Any) -> None:
        whole = self.view(np.ndarray)
        _MOVED.append(whole[key].nbytes)
        whole[key] = value


@contextmanager
def _counting() -> Iterator[None]:
    """Light, codes to project and areas count what is taken of them, and put."""

    def empty(*shape: Any) -> Light:
        return empty_light(*shape).view(_Counted)

    real = LowRankObservation.on_screen_like

    def factors(observation: LowRankObservation, light: Light) -> LowRank:
        found = real(observation, light)
        return replace(found, collect=found.collect.view(_Counted))

    with ExitStack() as stack:
        stack.enter_context(patch.object(dome, "empty_light", empty))
        stack.enter_context(patch.object(screening, "empty_light", empty))
        stack.enter_context(patch.object(LowRankObservation, "on_screen_like", factors))
        yield
