"""What is tried: masters, and the pollutions and luminances at which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, final

import numpy as np

from compensate.bundled import bundled_night
from domesim.frames import Master, read_master
from domesim.light import Light
from domesim.scene import Scene, load_scene
from domesim.scene.screening import decoded, within_range
from testing import content, masters, pairs
from testing.places import DOME_SCENE, STEREO_SCENE, dome_at, stereo_at
from validation import data
from validation.experiment import Work

CROSSTALK = (0.02, 0.05, 0.1)
"""Shares of light that reach the other eye."""
ALBEDOS = (0.3, 0.5, 0.7)
CROSSTALK_PLACES = ((0.02, 48.0), (0.05, 15.0), (0.1, 48.0), (0.1, 5.0))
ALBEDO_PLACES = ((0.3, 5.0), (0.5, 15.0), (0.7, 48.0))
"""Crosstalk, or albedo, with the luminance of white, cd/m²."""
USUAL_CROSSTALK, USUAL_ALBEDO, USUAL_LUMINANCE = 0.05, 0.5, 15.0
"""Usual crosstalk and albedo, at which pictures are shown; and the luminance of white, cd/m², at
which variants are tried."""
PAIRS = ("trunks", "fog", "motorcycle", data.SEQUENCE[0], "fence", "museum")
"""Pairs of the test data."""
DOMES: Mapping[str, str] = {
    "full dome": "dm3d_fulldome_2K.jpg",
    "pillars": "dm3d_pillars_hdr_512.exr",
    "dark sky": "kho_darksky_1024.png",
    "Milky Way": "milkyway_eso_1024.png",
    "Stellarium": "stellarium_night_1024.png",
    "golf": "golf_384.exr",
    "dawn": "dawn_384.exr",
    "mall": "mall_384.exr",
    "notice": "notice_384.exr",
}
"""Domemasters of the test data."""
CHOOSING = frozenset(
    {
        *("trunks", "fog", "motorcycle", data.SEQUENCE[0], "generated", "lamps"),
        *("night", "generated dome", "full dome", "pillars", "dawn", "notice"),
        *("art on black", "film frame", "aurora", "chess"),
        *("ten stars", "smooth limb", "dark notice", "dark reds", "first codes"),
    }
)
"""Inputs that settings were chosen on, at fewer places. All others are for reporting."""
WIDEST, DOME_SIZE = 512, 384
"""Width of pairs, and size of domemasters, at most, pixels."""
QUICK_WIDTH, QUICK_SIZE = 96, 64
"""Width of the pair and size of the domemaster of a quick run, pixels."""

PAIRED, DOMEMASTERS = "pairs", "domemasters"
"""Kinds of inputs."""

Place: TypeAlias = tuple[str, float, float]
"""Name of an input, its pollution, its luminance."""


@final
@dataclass(frozen=True)
class Input:
    """A master, and where it is shown.

    Parameters
    ----------
    read
        Returns its light.
    scene
        The scene of a pollution and a luminance of white, cd/m².
    pollutions
        Pollutions to try.
    usual
        The pollution at which pictures are shown.
    balls
        Smooth balls that are known to be in it: x, y and radius, as in `content.charts`.
    """

    read: Callable[[], Light]
    scene: Callable[[float, float], Scene]
    pollutions: Sequence[float]
    usual: float
    balls: Sequence[tuple[float, float, float]] = ()

    @property
    def kind(self) -> str:
        """Kind of the input: `PAIRED` or `DOMEMASTERS`."""
        return PAIRED if self.scene is stereo_at else DOMEMASTERS


def reported_domemasters(work: Work) -> tuple[Mapping[str, Input], list[str]]:
    """Domemasters of `wanted` on which nothing was chosen; in a quick run, all that it has."""
    inputs, left_out = wanted(work)
    found = {
        name: one
        for name, one in inputs.items()
        if one.kind == DOMEMASTERS and (work.quick or name not in CHOOSING)
    }
    return found, left_out


def wanted(work: Work) -> tuple[Mapping[str, Input], list[str]]:
    """Inputs by name, and why others are not measured."""
    quick = work.quick
    width, size = (QUICK_WIDTH, QUICK_SIZE) if quick else (WIDEST, DOME_SIZE)
    night = _of_dome(partial(domemaster, bundled_night, size), quick=quick)
    street = _of_pair(partial(content.PAIRS["night street"], width), quick=quick)
    if quick:
        return {"night street": street, "night": night}, ["Most inputs: with a full run"]
    present, left_out = data.present(PAIRS)
    found = {name: _of_pair(partial(_pair, name), quick=False) for name in present}
    found["generated"] = _of_pair(partial(pairs.generated, width, work.seed), quick=False)
    for name, draw in content.PAIRS.items():
        found[name] = _of_pair(partial(draw, width), quick=False)
    found |= {"night": night, "generated dome": _of_dome(partial(masters.night, size), quick=False)}
    folder = data.data_folder() / "dome"
    for name, file in DOMES.items():
        if (folder / file).is_file():
            read = partial(read_master, [folder / file], repair=True)
            found[name] = _of_dome(partial(domemaster, read, size), quick=False)
        else:
            left_out.append(f"{name}: needs {folder / file}; set {data.FOLDER}")
    for name, draw in content.DOMES.items():
        found[name] = replace(
            _of_dome(partial(draw, size), quick=False),
            balls=[ball[:3] for ball in content.BALLS.get(name, ())],
        )
    return found, left_out


def orrery(kind: str, size: int) -> Light:
    """Renders a frame as ``domesim master --kind KIND`` does.

    Parameters
    ----------
    kind
        What ``--kind`` takes.
    size
        Pixels a side.

    Returns
    -------
    light
        (view, row, col, primary), 0..1.
    """
    from scenes.artwork.orrery.cameras import views  # noqa: PLC0415 - slow to import
    from scenes.artwork.orrery.orrery import Orrery  # noqa: PLC0415
    from scenes.artwork.orrery.picture import Settings as How  # noqa: PLC0415
    from scenes.artwork.orrery.picture import Studio  # noqa: PLC0415

    looks = views(kind)
    frame = Studio(How(size=size, samples=16, orrery=Orrery(seed=7, loop=60.0)), looks).frame(0.0)
    return np.clip(np.stack([frame[name] for name in looks]), 0, 1)


def places(work: Work, name: str, one: Input) -> list[Place]:
    """Lists the places at which an input is shown.

    Parameters
    ----------
    work
        A quick run has one luminance.
    name, one
        The input.

    Returns
    -------
    places
        Its name, pollution and luminance of white, cd/m².
    """
    if work.quick:
        return [(name, pollution, USUAL_LUMINANCE) for pollution in one.pollutions]
    chosen = CROSSTALK_PLACES if one.kind == PAIRED else ALBEDO_PLACES
    return [(name, *place) for place in chosen]


def kinds(inputs: Mapping[str, Input]) -> dict[str, list[str]]:
    """Names of the inputs of each kind of which there are any."""
    found = {
        kind: [name for name, one in inputs.items() if one.kind == kind]
        for kind in (PAIRED, DOMEMASTERS)
    }
    return {kind: names for kind, names in found.items() if names}


def words(place: Place) -> str:
    """A place's name."""
    name, pollution, white = place
    return f"{name} at {pollution:g}, {white:g} cd/m²"


def _of_pair(read: Callable[[], Light], *, quick: bool) -> Input:
    return Input(read, stereo_at, (USUAL_CROSSTALK,) if quick else CROSSTALK, USUAL_CROSSTALK)


def _of_dome(read: Callable[[], Light], *, quick: bool) -> Input:
    return Input(read, dome_at, (USUAL_ALBEDO,) if quick else ALBEDOS, USUAL_ALBEDO)


def _pair(name: str) -> Light:
    """The pair, no wider than `WIDEST`."""
    light, _ = data.from_data(name, load_scene(STEREO_SCENE))
    return pairs.no_wider(light, WIDEST)


def domemaster(read: Callable[[], Master], size: int) -> Light:
    """Reads a domemaster in small.

    Parameters
    ----------
    read
        Reads it.
    size
        Pixels a side, at most.

    Returns
    -------
    light
        (1, row, col, primary), 0..1 on the screen.
    """
    scene = load_scene(DOME_SCENE)
    light = decoded(read(), scene)
    light = pairs.no_wider(light, size)
    return within_range(light, scene.screen(*light.shape[1:3]))[0]
