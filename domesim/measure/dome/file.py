"""The survey file (TOML): which photographs show which patterns, and what else is known.

    theatre = "theatre.toml"         # the geometry, with albedos to start from
    unit = "camera"                  # of photographs: "camera", or "cd/m2"

    [camera]
    mapping = "fisheye"              # or "perspective"; "domemaster": already mapped
    position_m = [0.0, -0.5, -0.3]
    look_at_m = [0.0, 1.5, 1.0]
    field_deg = 220.0                # across the circle, or the width of a perspective
    k1 = 0.0                         # radial distortion of a perspective
    circle_px = [1512, 1004, 980]    # col, row, radius of a fisheye's circle in its photographs
    registration = "dots.exr"        # a photograph that tells all of that more exactly
    patterns = "patterns"            # the folder of its pattern

    [colours]                        # if photographs are in the camera's own colours: of
    black = { file = "black.exr" }   # full black, red, green and blue
    red = { file = "red.exr", exposure = 0.5 }
    green = { file = "green.exr" }
    blue = { file = "blue.exr" }

    [[photographs]]
    file = "white.exr"               # raw linear; in the projector's primaries without [colours]
    pattern = "patterns/white.png"   # the domemaster that was projected
    exposure = 1.0

    [[readings]]                     # a meter's; beside photographs, or instead of them
    pattern = "patterns/white.png"
    place_m = [0.0, 5.0, 1.0]
    unit = "cd/m2"                   # or "lux"
    value = 7.1
    error = 0.1                      # standard error

    [known]
    wall = { value = 0.1, error = 0.05 }

Files are sought beside the survey file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames import read_master
from domesim.frames.encodings import encoding_named
from domesim.host.console import about
from domesim.host.files import read_plain
from domesim.host.texts import text_in, toml_in
from domesim.measure.dome.camera import Camera, domemaster_camera
from domesim.measure.dome.colours import mixing, unmixed, unmixed_variance
from domesim.measure.dome.fit import Known
from domesim.measure.dome.model import require_plain
from domesim.measure.dome.nuisances import Errors
from domesim.measure.dome.photographs import Photographs
from domesim.measure.dome.registration import Registered, registered
from domesim.measure.dome.spots import Reading
from domesim.measure.patterns.listing import read_patterns
from domesim.measure.raws import (
    MOST_CLIPPED,
    clipped,
    photograph_named,
    read_photograph,
    refuse_slipped,
    written_exposure,
)
from domesim.measure.rounding import step_of
from domesim.scene import DomeScene, load_dome
from domesim.scene.fields import Number, Place, Section, three
from domesim.scene.loading import scene_content
from domesim.scene.mistakes import all_mistakes
from domesim.scene.screening import decoded

Floats = NDArray[np.float64]

Positive = Annotated[Number, Field(gt=0, le=1e6)]
Small = Annotated[Number, Field(ge=0, le=100)]
Primaries = Positive | tuple[Positive, Positive, Positive]
NoPrimaries = Small | tuple[Small, Small, Small]


class CameraSection(Section):
    """Where photographs were taken from."""

    mapping: Literal["fisheye", "perspective", "domemaster"] = "fisheye"
    position_m: Place | None = None
    look_at_m: Place | None = None
    field_deg: Annotated[Number, Field(gt=0, le=360)] | None = None
    k1: Annotated[Number, Field(ge=-1, le=1)] = 0.0
    circle_px: tuple[Positive, Positive, Positive] | None = None
    registration: str | None = None
    patterns: str = "patterns"

    @model_validator(mode="after")
    def _placed(self) -> Self:
        stated = [self.position_m, self.look_at_m, self.field_deg]
        if self.mapping != "domemaster" and None in stated:
            raise ValueError(f"a {self.mapping} needs position_m, look_at_m and field_deg")
        given_at_all = any(part is not None for part in (*stated, self.registration))
        if self.mapping == "domemaster" and given_at_all:
            raise ValueError("a domemaster has no position_m, look_at_m, field_deg or registration")
        if self.mapping != "perspective" and self.k1 != 0:
            raise ValueError("k1 is of a perspective")
        if self.mapping != "fisheye" and self.circle_px is not None:
            raise ValueError("circle_px is of a fisheye")
        return self


class PhotographSection(Section):
    """One photograph."""

    file: str
    pattern: str
    exposure: Positive = 1.0


class ShotSection(Section):
    """A photograph of a primary, or of black."""

    file: str
    exposure: Positive = 1.0


class ColoursSection(Section):
    """Photographs that tell the camera's own colours."""

    black: ShotSection
    red: ShotSection
    green: ShotSection
    blue: ShotSection

    @property
    def shots(self) -> tuple[ShotSection, ...]:
        """Sections of the black, red, green and blue photographs."""
        return self.black, self.red, self.green, self.blue


class ReadingSection(Section):
    """A meter's reading."""

    pattern: str
    place_m: Place
    unit: Literal["cd/m2", "lux"]
    value: Annotated[Number, Field(ge=0, le=1e6)]
    error: Positive


class KnownSection(Section):
    """A figure from elsewhere, and its standard error."""

    value: Primaries
    error: NoPrimaries = 0.0


class ErrorsSection(Section):
    """Standard deviations of what is described; see `Errors`."""

    camera_m: Small = Errors.camera_m
    pointing_deg: Small = Errors.pointing_deg
    vignetting: Small = Errors.vignetting
    floor_m: Small = Errors.floor_m
    model_screen: Small = Errors.model_screen
    model_others: Small = Errors.model_others


class SurveyFile(Section):
    """A whole survey file."""

    theatre: str
    unit: Literal["camera", "cd/m2"] = "camera"
    camera: CameraSection | None = None
    colours: ColoursSection | None = None
    photographs: tuple[PhotographSection, ...] = ()
    readings: tuple[ReadingSection, ...] = ()
    known: dict[Literal["gain", "screen", "floor", "wall"], KnownSection] = Field(
        default_factory=dict
    )
    errors: ErrorsSection = ErrorsSection()

    @model_validator(mode="after")
    def _of_some_kind(self) -> Self:
        if not self.photographs and not self.readings:
            raise ValueError("wanted photographs, readings or both")
        if self.photographs and self.camera is None:
            raise ValueError("photographs need a [camera]")
        if self.colours is not None and (self.unit == "cd/m2" or not self.photographs):
            raise ValueError("[colours] are of photographs with unit camera: they tell no cd/m2")
        return self

    @property
    def pattern_names(self) -> list[str]:
        """Files of the patterns, each once."""
        names = [shot.pattern for shot in self.photographs]
        return list(dict.fromkeys([*names, *(one.pattern for one in self.readings)]))

    @property
    def absolute(self) -> bool:
        """Whether white is found in cd/m²."""
        return bool(self.readings) or self.unit == "cd/m2"


@final
@dataclass(frozen=True, eq=False)
class Task:
    """A survey file, with the files that it names.

    Attributes
    ----------
    file
        What is written in it.
    scene
        The theatre as it is described; of lamps nothing is left, as the black photograph has them.
    content
        The theatre's file, as it is written.
    patterns
        (pattern, row, col, primary) light of the projected domemasters.
    photographs, readings
        What was seen of them; one of both may be missing.
    registered
        The camera as the registration pattern tells it, if that was photographed.
    known, errors
        What is known from elsewhere, and how well the description is known.
    digests
        File -> SHA-256.
    """

    file: SurveyFile
    scene: DomeScene
    content: Mapping[str, Any]
    patterns: Floats
    photographs: Photographs | None
    readings: tuple[Reading, ...]
    registered: Registered | None
    known: Mapping[str, Known]
    errors: Errors
    digests: Mapping[str, str]

    @property
    def absolute(self) -> bool:
        """Whether white is found in cd/m²."""
        return self.file.absolute


def read_survey(path: Path, *, plain: bool = False) -> Task:
    """Read a survey file and what it names.

    Parameters
    ----------
    path
        The survey file.
    plain
        Whether to refuse, before photographs are read, a theatre that is more than `require_plain`
        allows.

    Raises
    ------
    InputError
        With all mistakes of the file, or that of the first other file that has one.
    """
    file = _parsed(path)
    folder = path.parent
    where = folder / file.theatre
    named = where if where.suffix == ".toml" else file.theatre
    scene, content = load_dome(named), scene_content(named)
    scene = replace(scene, theatre=replace(scene.theatre, lamps=()))
    if plain:
        with about(path):
            require_plain(scene.theatre)
    names = file.pattern_names
    files = [file.theatre, *names, *(shot.file for shot in file.photographs)]
    theatre = None
    if file.camera is not None and file.camera.registration is not None:
        files.append(file.camera.registration)
        theatre = _registered(file.camera, folder, scene)
    if file.colours is not None:
        files += [shot.file for shot in file.colours.shots]
    # First what a person has made, and can have made wrongly
    photographs = _photographs(file, folder, scene, theatre) if file.photographs else None
    return Task(
        file=file,
        scene=scene,
        content=content,
        patterns=_patterns([folder / name for name in names], scene),
        photographs=photographs,
        readings=tuple(
            Reading(names.index(one.pattern), one.place_m, one.unit, one.value, one.error)
            for one in file.readings
        ),
        registered=theatre,
        known={
            name: Known(three(what.value), three(what.error)) for name, what in file.known.items()
        },
        errors=Errors(**file.errors.model_dump()),
        digests={
            name: hashlib.sha256(found.read_bytes()).hexdigest()
            for name in files
            if (found := photograph_named(folder / name)).is_file()
        },
    )


def _parsed(path: Path) -> SurveyFile:
    try:
        return SurveyFile.model_validate(toml_in(text_in(read_plain(path))))
    except UnicodeDecodeError:
        raise InputError(f"{path}: a survey is a TOML text file in UTF-8, this is not") from None
    except OSError as error:
        raise InputError(f"{path}: wanted a survey's .toml file, got '{error.strerror}'") from error
    except ValidationError as error:
        raise InputError(all_mistakes(error, str(path), SurveyFile)) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None


def _photographs(
    file: SurveyFile, folder: Path, scene: DomeScene, found: Registered | None
) -> Photographs:
    assert file.camera is not None
    camera = file.camera
    listed: list[PhotographSection | ShotSection] = [*file.photographs]
    if file.colours is not None:
        listed += file.colours.shots
    paths = [photograph_named(folder / shot.file) for shot in listed]
    read = [_light(path, camera) for path in paths]
    refuse_slipped(
        [
            (path, written, shot.exposure)
            for path, (_, written), shot in zip(paths, read, listed, strict=True)
        ],
        way_out="write its exposure down as it was, or take it again",
    )
    shots, colours = (
        [light for light, _ in part]
        for part in (read[: len(file.photographs)], read[len(file.photographs) :])
    )
    if len({shot.shape for shot in shots}) > 1:
        raise InputError("photographs must be of one size")
    light = np.stack(shots)
    step = np.full(3, step_of(shots))
    if file.colours is not None:
        black, *primaries = (
            light / shot.exposure for light, shot in zip(colours, file.colours.shots, strict=True)
        )
        if any(one.shape != shots[0].shape for one in (black, *primaries)):
            raise InputError("colours: photographs must be of the same size as the others")
        matrix = mixing(black, primaries)
        light, step = unmixed(light, matrix), np.sqrt(unmixed_variance(step**2, matrix))
    return Photographs(
        _camera(camera, scene) if found is None else found.camera,
        light,
        np.array([file.pattern_names.index(shot.pattern) for shot in file.photographs]),
        np.array([shot.exposure for shot in file.photographs]),
        three(step),
    )


def _camera(section: CameraSection, scene: DomeScene) -> Camera:
    if section.position_m is None or section.look_at_m is None or section.field_deg is None:
        return domemaster_camera(scene.theatre)
    return Camera(
        section.position_m,
        section.look_at_m,
        float(np.radians(section.field_deg)),
        mapping="perspective" if section.mapping == "perspective" else "fisheye",
        distortion=section.k1,
    )


def _registered(section: CameraSection, folder: Path, scene: DomeScene) -> Registered:
    assert section.registration is not None
    path = photograph_named(folder / section.registration)
    listed = read_patterns(folder / section.patterns)
    dots = [each for each in listed.patterns if each.kind == "registration"]
    dome = scene.dome
    half_angle = 0.0 if listed.dome is None else listed.dome["half_angle_deg"]
    if not dots or abs(half_angle - np.degrees(dome.half_angle)) > 1e-6:
        raise InputError(
            f"{folder / section.patterns}: wanted a registration pattern of a dome with a "
            f"half-angle of {np.degrees(dome.half_angle):g} degrees; write patterns of this theatre"
        )
    names = "azimuth_deg", "angle_deg", "radius_deg"
    markers = np.array([[dot[name] for name in names] for dot in dots[0].parameters["markers"]])
    try:
        return registered(
            dome, markers, _light(path, section, measured=False)[0], _camera(section, scene)
        )
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _patterns(paths: list[Path], scene: DomeScene) -> Floats:
    lights: list[Floats] = []
    for path in paths:
        master = read_master([path], colour=scene.projector.response)
        light = np.asarray(decoded(master, scene)[0], np.float64)
        if lights and light.shape != lights[0].shape:
            raise InputError(f"{path}: patterns must be of one size, as {paths[0].name}")
        lights.append(light * scene.dome.inside(*light.shape[:2])[..., None])
    return np.stack(lights)


def _light(
    path: Path, camera: CameraSection, *, measured: bool = True
) -> tuple[Floats, float | None]:
    """(row, col, primary) raw linear values, and the exposure that the camera wrote down.

    A photograph of places only may be clipped.
    """
    frame = read_photograph(path, encoding_named("linear"))
    said = frame.header.colour
    if said is not None and not said.assumed and said.transfer != "linear":
        raise InputError(
            f"{path}: wanted a linear photograph, got {said.named} ({said.source}). Use the "
            f"camera's raw file, or develop it without a curve ({ADVICE['develop'].given()}, or a "
            f"linear EXR)."
        )
    part = _circle(path, frame.pixels.shape, camera)
    share = float(np.mean(clipped(frame)[1][part]))
    if measured and share > MOST_CLIPPED:
        raise InputError(
            f"{path}: {share:.1%} of the pixels are saturated; expose it shorter, and write the "
            "exposure down"
        )
    return np.asarray(frame.pixels[part], np.float64), written_exposure(frame)


def _circle(path: Path, size: Sequence[int], camera: CameraSection) -> tuple[slice, slice]:
    """Rows and columns of the square about a fisheye's circle; all if none is stated."""
    if camera.circle_px is None:
        return slice(None), slice(None)
    col, row, radius = camera.circle_px
    side = round(2 * radius)
    top, left = round(row - side / 2), round(col - side / 2)
    if min(top, left) < 0 or top + side > size[0] or left + side > size[1]:
        raise InputError(
            f"{path}: camera.circle_px must lie in the photograph, {size[1]} x {size[0]} pixels "
            f"(of a raw file, half as many as its sensor's), got {list(camera.circle_px)}"
        )
    return slice(top, top + side), slice(left, left + side)
