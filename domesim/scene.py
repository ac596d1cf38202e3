"""Theatres as data: a scene file (TOML) -> dome, projector, viewing, observation.

Every key carries its unit; unknown keys are mistakes; all mistakes of a file are listed in one go,
each with its path.
"""

from __future__ import annotations

import difflib
import json
import re
import reprlib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Self, final

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    StrictBool,
    Tag,
    ValidationError,
    field_validator,
    model_validator,
)

from domesim import viewing
from domesim.dome import Dome
from domesim.errors import InputError
from domesim.observation.spherical import ClosedFormDome, closed_form_gain
from domesim.projector import Projector
from domesim.viewing import Viewing

# Strict: neither true nor "0.5" is a number.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, le=1)]
# Beyond these, figures are in another unit, or arithmetic overflows.
Luminance = Annotated[Number, Field(ge=1e-6, le=1e6)]
NoLuminance = Annotated[Number, Field(ge=0, le=1e6)]

_TAGS = ("one number", "a number a primary")
PerPrimary = Annotated[
    Annotated[Share, Tag(_TAGS[0])] | Annotated[tuple[Share, Share, Share], Tag(_TAGS[1])],
    Discriminator(lambda value: _TAGS[isinstance(value, list)]),
]
"""One number for all primaries, or one for each."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class DomeSection(_Section):
    """The shape of the screen: a spherical cap.

    Its tilt is recorded for the picture's sake: a bare dome's reflections do not depend on it.
    """

    radius_m: Annotated[Number, Field(gt=0, le=1000)]
    half_angle_deg: Annotated[Number, Field(ge=1, le=180)] = 90.0
    tilt_deg: Annotated[Number, Field(ge=-90, le=90)] = 0.0

    @field_validator("radius_m")
    @classmethod
    def _measurable(cls, radius: float) -> float:
        if radius < 0.01:
            raise ValueError(f"must be at least 0.01, got {radius:g}")
        return radius


class ScreenSection(_Section):
    """What the screen is made of."""

    albedo: PerPrimary
    perforation: Annotated[Number, Field(ge=0, lt=1)] = 0.0


class LensSection(_Section):
    """Where the projector's lens is, in the dome's frame (x right, y front, z zenith)."""

    position_m: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    corrected: StrictBool = True


class ProjectorSection(_Section):
    """The projector, on the screen.

    White is direct light alone, as a small white patch shows it: a full white frame is brighter
    by its own cross-reflection. Black is a full black frame, as it is seen.
    """

    primaries: str = "BT.709"
    white_cd_m2: Luminance
    black_cd_m2: NoLuminance = 0.0
    lens: LensSection = LensSection()

    @model_validator(mode="after")
    def _possible(self) -> Self:
        Projector(self.primaries, self.white_cd_m2, self.black_cd_m2)
        return self


class AmbientSection(_Section):
    """Light on the screen without any projector, by luminance."""

    luminance_cd_m2: NoLuminance = 0.0


class ViewingSection(_Section):
    """The audience."""

    adaptation_cd_m2: Luminance


class SceneFile(_Section):
    """A whole scene file; ``sources`` says for each figure where it is from."""

    name: str
    description: str = ""
    dome: DomeSection
    screen: ScreenSection
    projector: ProjectorSection
    ambient: AmbientSection = AmbientSection()
    viewing: ViewingSection
    sources: dict[str, str] = {}

    @model_validator(mode="after")
    def _lens_inside(self) -> Self:
        distance = float(np.linalg.norm(self.projector.lens.position_m))
        if distance >= self.dome.radius_m:
            raise ValueError(
                f"projector.lens.position_m: must be inside the sphere of radius "
                f"{self.dome.radius_m:g} m, got {distance:g} m from its centre"
            )
        return self


@final
@dataclass(frozen=True)
class Scene:
    """A theatre: what its projector, screen and audience are.

    Parameters
    ----------
    name, description
        What the theatre is called and is.
    dome
        Its screen.
    albedo
        (3,) albedo of the screen for each primary, holes counted in.
    lens
        Position of the lens in the dome's frame, m, where its falloff is not corrected by the
        projection system; None where it is.
    projector
        Its projector.
    ambient
        Luminance of the unlit screen (projector black and stray light), cd/m².
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    """

    name: str
    description: str
    dome: Dome
    albedo: tuple[float, float, float]
    lens: tuple[float, float, float] | None
    projector: Projector
    ambient: float
    viewing: Viewing
    sources: Mapping[str, str]

    def observation(self, rows: int, cols: int) -> ClosedFormDome:
        """What the audience sees of a domemaster of that size.

        Raises
        ------
        InputError
            If it is not square, or smaller than 2 x 2.
        """
        return ClosedFormDome(
            self.dome,
            rows,
            cols,
            albedo=self.albedo,
            lens_gain=None if self.lens is None else self.dome.lens_gain(rows, cols, self.lens),
            ambient=self.ambient / self.projector.white,
        )


def load_scene(name_or_path: str | Path) -> Scene:
    """The scene of a TOML file, or one of the project's own by its name.

    Raises
    ------
    InputError
        If there is no such scene, or with all mistakes of its file, each with its path.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" and len(path.parts) <= 1:
        return _scene(_bundled(str(name_or_path)), str(name_or_path))
    try:
        text = path.read_bytes().decode()
    except UnicodeDecodeError:
        raise InputError(f"{path}: a scene is a TOML text file in UTF-8, this is not") from None
    except OSError as error:
        raise InputError(
            f"{path}: wanted a scene's .toml file, got '{error.strerror}'. "
            f"Check the path, or use one of {', '.join(scene_names())}"
        ) from error
    return _scene(text, str(path))


def scene_names() -> list[str]:
    """Names of the project's own scenes."""
    folder = resources.files("scenes")
    return sorted(
        item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")
    )


def _bundled(name: str) -> str:
    names = scene_names()
    if name not in names:
        raise InputError(
            f"scene {name!r} is not known{_suggestion(name, names)}; "
            f"use one of {', '.join(names)}, or the path of a .toml file"
        )
    return resources.files("scenes").joinpath(f"{name}.toml").read_text()


def _scene(text: str, where: str) -> Scene:
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a ValueError also for a number too long
        raise InputError(f"{where}: not valid TOML: {error}") from None
    try:
        return _built(SceneFile.model_validate(content))
    except ValidationError as error:
        raise InputError(_all_mistakes(error, where)) from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _built(file: SceneFile) -> Scene:
    dome = Dome(
        file.dome.radius_m, np.radians(file.dome.half_angle_deg), np.radians(file.dome.tilt_deg)
    )
    albedo = np.broadcast_to(file.screen.albedo, 3) * (1 - file.screen.perforation)
    for rho in albedo:
        # Refuses what no frame can change: a sphere that keeps all its light.
        closed_form_gain(float(rho), dome.radius, dome.screen_area)
    lens = file.projector.lens
    return Scene(
        name=file.name,
        description=file.description,
        dome=dome,
        albedo=(float(albedo[0]), float(albedo[1]), float(albedo[2])),
        lens=None if lens.corrected else lens.position_m,
        projector=Projector(
            file.projector.primaries, file.projector.white_cd_m2, file.projector.black_cd_m2
        ),
        ambient=file.projector.black_cd_m2 + file.ambient.luminance_cd_m2,
        viewing=viewing.from_dome_centre(dome, file.viewing.adaptation_cd_m2),
        sources=file.sources,
    )


def _all_mistakes(error: ValidationError, where: str) -> str:
    mistakes = list(dict.fromkeys(_mistake(item) for item in error.errors()))
    if len(mistakes) == 1:
        return f"{where}: {mistakes[0]}"
    return "\n  ".join([f"{where} has {len(mistakes)} mistakes:", *mistakes])


def _mistake(item: Any) -> str:
    path = _key_path(item["loc"])
    match item["type"]:
        case "extra_forbidden":
            known = _keys_at(item["loc"][:-1])
            hint = _suggestion(str(item["loc"][-1]), known) or f"; known: {', '.join(known)}"
            return f"{path}: is not a key of a scene{hint}"
        case "missing":
            return f"{path}: is missing"
        case "value_error":
            message = str(item["ctx"]["error"])
            return f"{path}: {message}" if path else message
        case "model_type":
            wanted = f"a section [{path}]"
        case "too_long":
            wanted = f"{item['ctx']['max_length']} values"
        case _:
            wanted = item["msg"].removeprefix("Input should be ")
    return f"{path}: must be {wanted}, got {reprlib.repr(item['input'])}"


def _key_path(location: Iterable[int | str]) -> str:
    """``screen.albedo[1]``, without the tags of the union, which are no keys."""
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in _TAGS:
            key = part if re.fullmatch(r"[\w-]+", part, re.ASCII) else json.dumps(part)
            path += f".{key}" if path else key
    return path


def _keys_at(location: Iterable[int | str]) -> list[str]:
    model: type[BaseModel] = SceneFile
    for part in location:
        annotation = model.model_fields[str(part)].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)


def _suggestion(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, 1)
    return f" (did you mean {close[0]!r}?)" if close else ""
