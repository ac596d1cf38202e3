"""Photographs of random screens through the eyewear, whose crosstalk is known, and their maps."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from domesim.errors import InputError
from domesim.measure.crosstalk_photographs import crosstalk_maps
from domesim.measure.photographs import (
    Corners,
    Glass,
    Photographs,
    by_edges,
    on_screen,
    read_photographs,
)
from domesim.observation.uncertain import SIGMAS
from domesim.readings.meter import EYES
from testing.raws import store_raw

Floats = NDArray[np.float64]

CELLS = (9, 15)
"""Rows and columns of maps, as the command has them."""
SMALL, LARGE = (96, 180), (160, 300)
"""Photographs, pixels."""
READ_OUT, PHOTONS = 1.2e-4, 4e-6
"""Variance of a pixel is READ_OUT² + PHOTONS x light: 0.3 % of white, 3 % of its ghost; the mean of
some ten photographs of an ordinary camera."""
BLUR = 0.7
"""Standard deviation of the lens's blur, pixels."""
WALL = 0.01
"""Light of the wall around the screen, of white."""
LEAK, DARK = 0.015, 0.005
"""Mean crosstalk, and black, of white."""
_FINER = 4


@final
@dataclass(frozen=True)
class Screen:
    """One screen, its corners read off with one error.

    Attributes
    ----------
    held
        Way -> share of cells of both eyes' maps whose 95 % interval holds the truth.
    off
        Way -> rms relative error of the cells.
    corners_off, corners_z
        Rms error of corners found by edges, in pixels, and in standard errors; NaN if not found.
    """

    held: dict[str, float]
    off: dict[str, float]
    corners_off: float
    corners_z: float


def photographed(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[tuple[Glass, Glass], Corners, Floats]:
    """Photographs of a random screen, its corners, and (eye, row, col) the crosstalk of its cells.

    Crosstalk varies as on the paper's screens (1.1 % to 2.0 %).
    """
    drawn = _drawn(rng, size)
    glasses = []
    for eye, lights in zip(EYES, drawn.light, strict=True):
        black = _noisy(rng, np.zeros(size))
        net = {name: {"W": _noisy(rng, lights[name]) - black} for name in lights}
        glasses.append(Glass(eye, net))
    return (glasses[0], glasses[1]), drawn.corners, drawn.cells


@final
@dataclass(frozen=True)
class _Drawn:
    """A screen as it is: light through each glass, (row, col) of both projectors' white.

    And (eye, row, col) crosstalk of cells, and (eye,) that of the whole screen through the lens.
    """

    light: tuple[dict[str, Floats], dict[str, Floats]]
    corners: Corners
    cells: Floats
    system: Floats


def _drawn(rng: np.random.Generator, size: tuple[int, int]) -> _Drawn:
    rows, cols = size
    inset = np.array([(0.08, 0.1), (0.92, 0.1), (0.92, 0.9), (0.08, 0.9)]) * (cols, rows)
    askew = rng.uniform(-0.04, 0.04, (4, 2)) * rows
    corners = Corners(inset + askew, np.zeros((8, 8)), "as they are")
    finer = Corners(corners.at * _FINER, np.zeros((8, 8)), "as they are")
    grid = np.meshgrid(*(np.arange(count * _FINER) + 0.5 for count in (cols, rows)))
    place = finer.places(grid[0], grid[1])
    on = _covered(place)
    x, y = place[..., 0] - 0.5, place[..., 1] - 0.5
    falling = 1 - 0.4 * (4 * x**2 + 2 * y**2) / 1.5 - 0.2 * x
    finely = [(np.arange(10 * count) + 0.5) / (10 * count) - 0.5 for count in CELLS]
    middle = np.meshgrid(finely[1], finely[0])
    pixels = corners.places(*np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5))
    seen = on_screen(pixels)
    lights, cells, system = [], [], []
    for eye in EYES:
        a = rng.normal(0, (0.2, 0.2, 0.6, 0.6, 0.3))

        def map_(x: Floats, y: Floats, a: Floats = a) -> Floats:
            bent = a[0] * x + a[1] * y + a[2] * x**2 + a[3] * y**2 + a[4] * x * y
            return np.asarray(LEAK * np.exp(bent))

        own = _in_pixels(WALL + on * (falling - WALL))
        other = _in_pixels(LEAK * WALL + on * (falling * map_(x, y) - LEAK * WALL))
        lights.append({eye: own, EYES[1 - EYES.index(eye)]: other})
        means = map_(middle[0], middle[1]).reshape(CELLS[0], 10, CELLS[1], 10)
        cells.append(means.mean(axis=(1, 3)))
        system.append(other[seen].sum() / own[seen].sum())
    return _Drawn((lights[0], lights[1]), corners, np.array(cells), np.array(system))


def _covered(place: Floats) -> Floats:
    """(row, col) share of a pixel that is on the screen."""
    ends = [part for axis in (place[..., 0], place[..., 1]) for part in (axis, 1 - axis)]
    away = [end / np.hypot(*np.gradient(end)) for end in ends]
    return np.asarray(np.prod([np.clip(each + 0.5, 0, 1) for each in away], axis=0))


def _in_pixels(light: Floats) -> Floats:
    """Through the lens, on a sensor."""
    rows, cols = (count // _FINER for count in light.shape)
    blurred = gaussian_filter(light, BLUR * _FINER, mode="nearest")
    return np.asarray(blurred.reshape(rows, _FINER, cols, _FINER).mean(axis=(1, 3)))


def _noisy(
    rng: np.random.Generator, light: Floats, read_out: float = READ_OUT, dark: float = DARK
) -> NDArray[np.float32]:
    seen = (light + dark)[..., None] * np.array([0.45, 0.5, 0.35])
    spread = np.sqrt(read_out**2 + PHOTONS * seen)
    return np.asarray(seen + spread * rng.standard_normal(seen.shape), np.float32)


def screen(seed: int, wrong: float, size: tuple[int, int]) -> Screen:
    """Photograph a screen, read its corners off with an error, and measure."""
    rng = np.random.default_rng(seed)
    glasses, corners, truth = photographed(rng, size)
    read = corners.at + wrong * rng.standard_normal((4, 2))
    ways = {
        "exact": Corners(read, np.zeros((8, 8)), "read off"),
        "stated": Corners(read, wrong**2 * np.eye(8), "read off"),
    }
    ways["edges"] = found = by_edges(glasses, replace(ways["exact"], origin="not found"))
    off = (found.at - corners.at).ravel()
    seen = found.origin != "not found"
    held, errors = {}, {}
    for way, placed in ways.items():
        values, spread = _measured(glasses, placed, size)
        held[way] = float(np.mean(np.abs(values - truth) < SIGMAS * spread))
        errors[way] = float(np.sqrt(np.mean((values / truth - 1) ** 2)))
    return Screen(
        held,
        errors,
        float(np.sqrt(np.mean(off**2))) if seen else np.nan,
        float(np.sqrt(np.mean(off**2 / np.diag(found.covariance)))) if seen else np.nan,
    )


@final
@dataclass(frozen=True)
class RawScreen:
    """One screen in a camera's raw files.

    Attributes
    ----------
    off, error
        (eye,) error of the whole screen's crosstalk in standard errors, and these relative to the
        truth.
    cells
        Share of cells of both eyes' maps whose 95 % interval holds the truth.
    refused
        What the product said if it refused the photographs; nothing else is told then.
    """

    off: list[float]
    error: list[float]
    cells: float
    refused: str = ""


def raw_screen(
    seed: int,
    size: tuple[int, int],
    *,
    bits: int = 14,
    read_out: float = 1.0,
    slip: float = 1.0,
    said: bool = True,
) -> RawScreen:
    """Photograph a screen by a camera that saves raw files, and measure.

    Parameters
    ----------
    seed
        Seed of all random numbers.
    size
        Pixels of a photograph: half as many as the sensor's.
    bits, read_out
        Of a code; and standard deviation of a pixel in the dark, codes.
    slip
        Exposure of one photograph, over that of the others.
    said
        Whether the camera wrote its exposures down.
    """
    rng = np.random.default_rng([seed, 55])
    drawn = _drawn(rng, size)
    slipped, dark = int(rng.integers(6)), DARK * rng.uniform(0.2, 1.2)
    read = np.round(drawn.corners.at + 0.5 * rng.standard_normal((4, 2)), 1).tolist()
    lines = ["[photographs]", f"corners = {read}"]
    with tempfile.TemporaryDirectory() as name:
        folder, number = Path(name), 0
        for eye, lights in zip(EYES, drawn.light, strict=True):
            lines.append(f"[photographs.{eye}]")
            for shown, light in (("black", np.zeros(size)), *lights.items()):
                times = slip if number == slipped else 1.0
                shot = _noisy(rng, light, read_out / (2**bits - 1), dark) * (0.95 * times)
                seconds = times / 60 if said else 0.0
                store_raw(
                    folder / f"{eye}-{shown}.dng",
                    np.asarray(shot, np.float64),
                    bits=bits,
                    seconds=seconds,
                )
                lines.append(f'{shown} = "{eye}-{shown}"')
                number += 1
        listed = folder / "photographs.toml"
        listed.write_text("\n".join([*lines, "[projector]", "white_cd_m2 = 15.0"]))
        try:
            shots = read_photographs(listed)
            maps = crosstalk_maps(shots, CELLS, size[1] / size[0])
        except InputError as error:
            return RawScreen([], [], np.nan, str(error).removeprefix(name))
    found = np.array([(each.system, each.system_error) for each in maps]).T
    cells = np.array([each.system * each.share for each in maps])
    errors = np.array([each.system * each.share_error for each in maps])
    return RawScreen(
        ((found[0] - drawn.system) / found[1]).tolist(),
        (found[1] / drawn.system).tolist(),
        float(np.mean(np.abs(cells - drawn.cells) < SIGMAS * errors)),
    )


def _measured(
    glasses: tuple[Glass, Glass], corners: Corners, size: tuple[int, int]
) -> tuple[Floats, Floats]:
    """(eye, row, col) crosstalk as it is found, and standard errors."""
    rows, cols = size
    place = corners.places(*np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5))
    shots = Photographs("screen", glasses, place, corners, 15.0, 0.01, None, "")
    maps = crosstalk_maps(shots, CELLS, cols / rows)
    values = [each.system * each.share for each in maps]
    errors = [each.system * each.share_error for each in maps]
    return np.array(values), np.array(errors)
