"""Random theatres, virtual photographs of them with faults that are stated, and surveys of both.

Photographs are path-traced (`testing.laboratory`), or computed by radiosity at each pixel, as they
are explained: then nothing but the stated faults differs.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from domesim.errors import InputError
from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.file import read_survey
from domesim.measure.dome.model import Interreflection, Places, nominal_albedos, surfaces_of
from domesim.measure.dome.nuisances import Errors
from domesim.measure.dome.photographs import Photographs, direct_light
from domesim.measure.dome.responses import responses_of
from domesim.measure.dome.run import survey_of
from domesim.measure.dome.without_geometry import DEGREE, found_in
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre, Wall
from domesim.scene import DomeScene
from domesim.scene.fields import three
from domesim.scene.loading import scene_of_text
from domesim.scene.writing import as_toml
from testing.laboratory import NOISE, Faults, patterns_for, photographed, sectors_for
from testing.raws import store_raw

Floats = NDArray[np.float64]
Noise = Callable[[np.random.Generator, Floats], Floats]

RESOLUTION = 6
"""Resolution of radiosity, in which photographs are computed and explained: what differs is
nobody's error."""
PATTERN, PHOTOGRAPH = 128, 96
GAIN = (0.6, 0.8, 1.0)
AMBIENT = 0.003
STATED = Errors()
_MIX = np.array([[0.8, 0.15, 0.05], [0.1, 0.8, 0.1], [0.02, 0.18, 0.8]])
"""(channel, primary) what a sensor's channel sees."""
_EXPOSED = 0.3
"""What a sensor makes of light: white with all that it reflects is below 1."""


PLAN: Mapping[str, Any] = {
    "name": "measured",
    "dome": {"radius_m": 6.0, "tilt_deg": 10.0},
    "screen": {"albedo": [0.6, 0.55, 0.5]},
    "floor": {"height_m": -2.2, "albedo": [0.25, 0.2, 0.15]},
    "wall": {"albedo": 0.1},
    "projector": {"white_cd_m2": 8.0},
    "viewing": {"adaptation_cd_m2": 0.8},
}
"""A small theatre with floor and wall."""
_FURNITURE: Mapping[str, Any] = {
    "seating": {
        "rows": 4,
        "seats_per_row": 8,
        "first_row_m": 2.0,
        "albedo": [0.1, 0.05, 0.05],
        "occupied": 0.5,
    },
    "boxes": [
        {
            "name": "console",
            "low_m": [-1.0, -3.2, -2.2],
            "high_m": [1.0, -2.6, -1.3],
            "albedo": 0.5,
        }
    ],
}


@final
@dataclass(frozen=True)
class Misplaced:
    """How photographs differ from what is described, in stated errors.

    Parameters
    ----------
    place, turn, vignetting
        The camera's.
    model
        Reflected light on screen, floor and wall.
    """

    place: Floats
    turn: Floats
    vignetting: Floats
    model: Floats


def even(rng: np.random.Generator, light: Floats) -> Floats:
    """Noise of an ordinary camera: 1 % of the light, and some in the dark."""
    return np.asarray(np.hypot(0.01 * light, 1e-4) * rng.standard_normal(light.shape))


def heavy(rng: np.random.Generator, light: Floats) -> Floats:
    """Log-normal noise of 20 %: mostly a little too dark, now and then far too bright."""
    drawn = np.exp(rng.standard_normal(light.shape))
    standard = (drawn - np.exp(0.5)) / np.sqrt((np.e - 1) * np.e)
    return np.asarray(0.2 * light * standard + 1e-4 * rng.standard_normal(light.shape))


def computed(
    theatre: Theatre,
    camera: Camera,
    patterns: Floats,
    rng: np.random.Generator,
    noise: Noise = even,
    moved: Camera | None = None,
    vignetting: Sequence[float] | Floats = (0.0, 0.0),
    model: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    resolution: int = RESOLUTION,
) -> Photographs:
    """Photographs of patterns, one each, by radiosity at each pixel.

    Parameters
    ----------
    theatre
        As it is.
    camera
        As it is described.
    patterns
        (pattern, row, col, primary) light of projected domemasters.
    rng, noise
        What is added to a pixel's light.
    moved
        The camera as it is, if it is not as described.
    vignetting
        Light at the rim of the view over that in the middle, less 1: by what grows with the square
        of the distance from the middle, and by what grows with its fourth power.
    model
        Reflected light on screen, floor and wall over that of the model, less 1.
    resolution
        Of radiosity.
    """
    moved = camera if moved is None else moved
    u, v = places_in(PHOTOGRAPH)
    surface, points = looked_at(theatre, moved, u, v)
    numbers = {SURFACES[name]: number for number, name in enumerate(surfaces_of(theatre))}
    on = np.isin(surface, list(numbers))
    kinds = np.array([numbers[int(kind)] for kind in surface[on]])
    lit = direct_light(theatre, patterns)
    direct = np.zeros((len(patterns), len(kinds), 3))
    screen = kinds == 0
    rays = theatre.dome.toward(points[on][screen])
    row, col = theatre.dome.pixel_of(rays, lit.shape[1])
    direct[:, screen] = lit[:, row, col]
    places = Places(kinds, points[on][:, None], direct)
    room = Interreflection(theatre, patterns, resolution)
    seen, albedos = room.seen_from(places), nominal_albedos(theatre)
    light = np.zeros((len(patterns), *u.shape, 3))
    for p in range(3):
        shown = room.shown(p, albedos[:, p], places, seen)[0]
        reflected = (shown - direct[..., p]) * (1 + np.asarray(model)[kinds])
        light[:, on, p] = GAIN[p] * (direct[..., p] + reflected + AMBIENT)
    away = (u**2 + v**2)[..., None]
    light *= (1 + vignetting[0] * away) * (1 + vignetting[1] * away**2)
    light += noise(rng, light)
    light[:, ~on] = 0
    return Photographs(camera, light, np.arange(len(patterns)), np.ones(len(patterns)))


def small_theatre(*, furnished: bool = True) -> DomeScene:
    """A small theatre with floor and wall, and with seats and a console or without."""
    return scene_of({**PLAN, **_FURNITURE} if furnished else PLAN)


def scene_of(content: Mapping[str, Any]) -> DomeScene:
    """A dome as the content of a scene's file describes it."""
    scene = scene_of_text(as_toml(dict(content)), "plan", Path())
    assert isinstance(scene, DomeScene)
    return scene


@final
@dataclass(frozen=True)
class Walls:
    """Walls that are drawn: their albedos, and the floor's depth below the screen, of a radius."""

    albedo: tuple[float, float]
    drop: tuple[float, float]


DARK = Walls((0.05, 0.15), (0.15, 0.3))
NARROW = Walls((0.03, 0.6), (0.05, 0.09))
"""Of any paint, and too narrow to be seen away from edges."""


def theatre(rng: np.random.Generator, walls: Walls | None = None) -> tuple[Theatre, Camera]:
    """A random one, with a wall or without, and its camera."""
    radius = float(rng.uniform(3, 10))
    dome = Dome(radius, np.radians(rng.uniform(80, 90)), np.radians(rng.uniform(0, 12)))
    drop = rng.uniform(*(DARK if walls is None else walls).drop)
    height = min(dome.lowest, 0.0) - float(drop) * radius
    screen, floor = (three(rng.uniform(*ends, 3)) for ends in ((0.3, 0.75), (0.05, 0.3)))
    x, y = (float(part) for part in rng.uniform((-0.1, -0.2), (0.1, 0.0)) * radius)
    # Above the floor by a tripod's height, or in its lower half
    z = height + min(1.6, 0.6 * abs(height))
    camera = Camera((x, y, z), (x, y + 1.5, z + 1.0), np.radians(220.0))
    real = Theatre(dome, screen, floor=Floor(height, dome.widest, floor))
    if walls is not None:
        paint = three(rng.uniform(*walls.albedo, 3))
        real = replace(real, wall=Wall(dome.widest, height, dome.lowest, paint))
    return real, camera


def misplaced(
    theatre: Theatre, camera: Camera, rng: np.random.Generator
) -> tuple[Theatre, Camera, Misplaced]:
    """Both as they are if they are described within `STATED`, and by how many of its errors."""
    off, turn, edge, model = (rng.standard_normal(count) for count in (3, 3, 2, 3))
    sunk = float(rng.standard_normal())
    step = STATED.camera_m * off
    moved = replace(
        camera,
        position=three(np.add(camera.position, step)),
        look_at=three(np.add(camera.look_at, step)),
        turn=three(np.radians(STATED.pointing_deg * turn)),
    )
    floor, wall = theatre.floor, theatre.wall
    assert floor is not None
    floor = replace(floor, height=floor.height - STATED.floor_m * sunk)
    if wall is not None:
        wall = replace(wall, bottom=floor.height)
    return replace(theatre, floor=floor, wall=wall), moved, Misplaced(off, turn, edge, model)


def described(real: Theatre, rng: np.random.Generator, walls: Walls | None = None) -> Theatre:
    """The same of other paints."""
    floor, wall = real.floor, real.wall
    assert floor is not None
    if wall is not None:
        assert walls is not None
        wall = replace(wall, albedo=three(rng.uniform(*walls.albedo, 3)))
    return replace(real, albedo=(0.5,) * 3, floor=replace(floor, albedo=(0.15,) * 3), wall=wall)


@final
@dataclass(frozen=True)
class Sensor:
    """A camera that saves raw files, in its own colours.

    Parameters
    ----------
    bits
        Of a code.
    read_out
        Standard deviation of a pixel in the dark, codes.
    slip, slipped
        Exposure of one photograph over that of the others, and which.
    said
        Whether it writes its exposures down.
    """

    bits: int
    read_out: float
    slip: float = 1.0
    slipped: int = 0
    said: bool = True

    def noise(self, rng: np.random.Generator, light: Floats) -> Floats:
        """Noise of 1 % of the light, and of read-out."""
        codes = (2**self.bits - 1) * _EXPOSED
        spread = np.hypot(NOISE * light, self.read_out / codes)
        return np.asarray(spread * rng.standard_normal(light.shape))

    @property
    def gains(self) -> Floats:
        """(primary,) what a photograph has of a unit of light."""
        return _EXPOSED * np.diag(_MIX)

    def stored(self, folder: Path, dome: Dome, patterns: Floats, shots: Photographs) -> Path:
        """Writes raw files, and the survey that lists them.

        Parameters
        ----------
        folder
            Where to.
        dome
            The screen.
        patterns
            (pattern, row, col, primary), black first, of which `shots` has one each, and then the
            primaries.
        shots
            The photographs.
        """
        (folder / "theatre.toml").write_text(theatre_file(dome))
        camera, colours = shots.camera, ("red", "green", "blue")
        lines = [
            'theatre = "theatre.toml"',
            "[camera]",
            f"position_m = {list(camera.position)}",
            f"look_at_m = {list(camera.look_at)}",
            f"field_deg = {float(np.degrees(camera.field))}",
            "[colours]",
            *(f'{name} = {{ file = "{name}" }}' for name in ("black", *colours)),
        ]
        names = ["black", *(str(number) for number in range(1, len(patterns))), *colours]
        for number, (name, light) in enumerate(zip(names, shots.light @ _MIX.T, strict=True)):
            times = self.slip if number == self.slipped else 1.0
            exposed = np.minimum(_EXPOSED * times * light, 1)
            seconds = times / 60 if self.said else 0.0
            store_raw(folder / f"{name}.dng", exposed, bits=self.bits, seconds=seconds)
            if number < len(patterns):
                Image.fromarray(np.round(255 * patterns[number]).astype(np.uint8)).save(
                    folder / f"pattern-{name}.png"
                )
                lines += ["[[photographs]]", f'file = "{name}"', f'pattern = "pattern-{name}.png"']
        (folder / "survey.toml").write_text("\n".join(lines))
        return folder / "survey.toml"


def _primaries(patterns: Floats) -> Floats:
    """(primary, row, col, primary) full red, green and blue."""
    return np.asarray(patterns[1] * np.eye(3)[:, None, None])


@final
@dataclass(frozen=True)
class Trial:
    """What a survey of one theatre found.

    Parameters
    ----------
    z
        Figure -> found less true in stated standard errors, by primary or axis.
    off
        Figure -> found over true less 1, by primary.
    complete
        Whether all was answered.
    cpu_s
        CPU time of the fit, s.
    plausible
        Whether noise explains the photographs.
    refused
        What the product said if it refused the photographs; nothing else is told then.
    """

    z: dict[str, tuple[float, ...]]
    off: dict[str, tuple[float, ...]]
    complete: bool
    cpu_s: float
    plausible: bool = True
    refused: str = ""


def _refused(words: str) -> Trial:
    return Trial({}, {}, complete=False, cpu_s=0.0, plausible=False, refused=words)


def surveyed(
    seed: int,
    *,
    walls: Walls | None = None,
    noise: Noise = even,
    traced: bool = False,
    sensor: Sensor | None = None,
    resolution: int = RESOLUTION,
) -> Trial:
    """Photograph a random theatre and measure it.

    Parameters
    ----------
    seed
        Seed of all random numbers.
    walls
        What its wall is like, if it has one; it is described as one of another paint.
    noise
        Noise of computed photographs.
    traced
        Whether photographs are path-traced, with noise of an ordinary camera.
    sensor
        What computed photographs are taken by, as raw files that a survey lists; if None, they are
        light itself.
    resolution
        Of radiosity, by which photographs are computed and explained.
    """
    rng = np.random.default_rng(seed)
    stated, camera = theatre(rng, walls)
    real, moved, off = misplaced(stated, camera, rng)
    patterns = patterns_for(real.dome, PATTERN)
    vignetting = STATED.vignetting * off.vignetting
    if traced:
        faults = Faults(
            NOISE,
            gain=GAIN,
            vignetting=-float(vignetting[0]),
            camera_m=three(STATED.camera_m * off.place),
            turn_deg=three(STATED.pointing_deg * off.turn),
        )
        ambient = (AMBIENT,) * 3
        shots = photographed(real, camera, patterns, faults, ambient=ambient, seed=seed)
    else:
        errors = np.array([STATED.model_screen, STATED.model_others, STATED.model_others])
        model = errors * off.model
        lit = patterns if sensor is None else np.concatenate([patterns, _primaries(patterns)])
        noise = noise if sensor is None else sensor.noise
        shots = computed(real, camera, lit, rng, noise, moved, vignetting, model, resolution)
    told = described(stated, rng, walls)
    gain = np.array(GAIN)
    if sensor is not None:
        with tempfile.TemporaryDirectory() as folder:
            listed = sensor.stored(Path(folder), stated.dome, patterns, shots)
            try:
                read = read_survey(listed).photographs
            except InputError as error:
                return _refused(str(error).removeprefix(folder))
        assert read is not None
        shots, gain = read, gain * sensor.gains
    started = time.process_time()
    try:
        found = survey_of(told, patterns, shots, {}, STATED, profile=False, resolution=resolution)[
            1
        ]
    except InputError as error:
        if sensor is None:
            raise
        return _refused(str(error))
    seconds = time.process_time() - started
    truth = np.concatenate([[gain], nominal_albedos(real)])

    def by_name(values: Floats) -> dict[str, tuple[float, ...]]:
        return {name: tuple(row.tolist()) for name, row in zip(found.names, values, strict=True)}

    z = by_name((found.value - truth) / found.error)
    for kind, true in (("camera", off.place), ("turn about", off.turn)):
        pairs = [found.nuisances[f"{kind} {axis}"] for axis in "xyz"]
        z[kind] = tuple(
            (value - one) / error for (value, error), one in zip(pairs, true.tolist(), strict=True)
        )
    return Trial(z, by_name(found.value / truth - 1), found.complete, seconds, found.plausible)


@final
@dataclass(frozen=True)
class Alone:
    """What a survey without geometry finds, by primary.

    Parameters
    ----------
    white, reflected
        Light found over the truth, less 1.
    z
        Error of the reflected light in standard errors, as stated.
    """

    white: tuple[float, ...]
    reflected: tuple[float, ...]
    z: tuple[float, ...]


def surveyed_alone(noise: Noise, seed: int) -> Alone:
    """Photograph a theatre with some noise; nothing else is told."""
    rng = np.random.default_rng(seed)
    real, camera = theatre(rng)
    patterns = sectors_for(real.dome, PATTERN)
    found = found_in(
        responses_of(real, patterns, computed(real, camera, patterns, rng, noise), DEGREE), real
    )
    reflected = _reflected(real, patterns[1:2])
    return Alone(
        tuple((found.gain / GAIN - 1).tolist()),
        tuple((found.white / reflected - 1).tolist()),
        tuple(((found.white - reflected) / found.white_error).tolist()),
    )


def _reflected(theatre: Theatre, white: Floats) -> Floats:
    """(primary,) mean light over the screen that a white picture has beyond its direct light."""
    dome, size = theatre.dome, 24
    inside = dome.inside(size, size)
    points, areas = dome.points(size, size)[inside], dome.screen_areas(size, size)[inside]
    lit = direct_light(theatre, white)
    row, col = dome.pixel_of(dome.toward(points), lit.shape[1])
    places = Places(np.zeros(len(points), np.int64), points[:, None], lit[:, row, col])
    model, albedos = Interreflection(theatre, white, RESOLUTION), nominal_albedos(theatre)
    seen = model.seen_from(places)
    light = [model.shown(p, albedos[:, p], places, seen)[0][0] for p in range(3)]
    return np.asarray((np.stack(light) - places.direct[0].T) @ areas / areas.sum())


def theatre_file(dome: Dome) -> str:
    """A theatre's file that tells of its dome, and of the rest as little as can be."""
    return as_toml(
        {
            "name": "theatre",
            "dome": {
                "radius_m": dome.radius,
                "half_angle_deg": float(np.degrees(dome.half_angle)),
                "tilt_deg": float(np.degrees(dome.tilt)),
            },
            "screen": {"albedo": 0.5},
            "projector": {"white_cd_m2": 8.0},
            "viewing": {"adaptation_cd_m2": 0.5},
        }
    )
