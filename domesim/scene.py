"""Theatres as data: a scene file (TOML) -> dome, projector, viewing, observation.

Places are in the room's frame (x right, y front, z up, from the centre of the dome's sphere), but
for the single lens's, which is in the dome's. Every key carries its unit; unknown keys are
mistakes; all mistakes of a file are listed in one go, each with its path.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import re
import reprlib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, final, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    StrictBool,
    Tag,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails

from domesim import furniture, viewing
from domesim.dome import Dome
from domesim.errors import InputError
from domesim.lenses import lens_gains, seen_gain
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.spherical import ClosedFormDome, bare_gain
from domesim.observation.transport import TabulatedDome, Transport
from domesim.projector import Projector
from domesim.theatre import (
    Cavity,
    Floor,
    Lamp,
    Lens,
    Lobe,
    Solid,
    Theatre,
    Viewpoint,
    Wall,
)
from domesim.viewing import Viewing

# Strict: neither true nor "0.5" is a number.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, le=1)]
# Beyond these, figures are in another unit, or arithmetic overflows.
Luminance = Annotated[Number, Field(ge=1e-6, le=1e6)]
NoLuminance = Annotated[Number, Field(ge=0, le=1e6)]

_TAGS = ("one number", "a number a primary")
_EITHER = Discriminator(lambda value: _TAGS[isinstance(value, list)])
PerPrimary = Annotated[
    Annotated[Share, Tag(_TAGS[0])] | Annotated[tuple[Share, Share, Share], Tag(_TAGS[1])],
    _EITHER,
]
"""One number for all primaries, or one for each."""
LuminancePerPrimary = Annotated[
    Annotated[NoLuminance, Tag(_TAGS[0])]
    | Annotated[tuple[NoLuminance, NoLuminance, NoLuminance], Tag(_TAGS[1])],
    _EITHER,
]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


Length = Annotated[Number, Field(gt=0, le=1000)]
Coordinate = Annotated[Number, Field(ge=-1000, le=1000)]
Place = tuple[Coordinate, Coordinate, Coordinate]
"""(x, y, z) in the room's frame: x right, y front, z up from the centre of the dome's sphere."""


class DomeSection(_Section):
    """The shape of the screen: a spherical cap, or an ellipsoid's; whole, or cut off level."""

    radius_m: Length
    half_angle_deg: Annotated[Number, Field(ge=1, le=180)] = 90.0
    tilt_deg: Annotated[Number, Field(ge=-90, le=90)] = 0.0
    height_ratio: Annotated[Number, Field(ge=0.2, le=5)] = 1.0
    truncated_below_m: Coordinate | None = None

    @field_validator("radius_m")
    @classmethod
    def _measurable(cls, radius: float) -> float:
        if radius < 0.01:
            raise ValueError(f"must be at least 0.01, got {radius:g}")
        return radius

    @model_validator(mode="after")
    def _possible(self) -> Self:
        try:
            self.shape()
        except InputError as error:
            raise ValueError(str(error).removeprefix("dome ")) from None
        return self

    def shape(self) -> Dome:
        """The dome that this describes."""
        return Dome(
            self.radius_m,
            np.radians(self.half_angle_deg),
            np.radians(self.tilt_deg),
            self.height_ratio,
            self.truncated_below_m,
        )


class LobeSection(_Section):
    """Light that a glossy ("gain") screen sends in the mirror direction."""

    share: Share
    roughness: Annotated[Number, Field(ge=0.05, le=1)]


class CavitySection(_Section):
    """The shell behind a perforated screen; `back_albedo` is that of the screen's back."""

    depth_m: Length
    albedo: PerPrimary
    back_albedo: PerPrimary = 0.0


class ScreenSection(_Section):
    """What the screen is made of."""

    albedo: PerPrimary
    perforation: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    lobe: LobeSection | None = None
    cavity: CavitySection | None = None


class FloorSection(_Section):
    """A level disc; as wide as the wall or the dome unless it says otherwise."""

    height_m: Coordinate
    albedo: PerPrimary
    radius_m: Length | None = None


class WallSection(_Section):
    """A round wall from the floor up to the lowest point of the screen, or to `top_m`."""

    albedo: PerPrimary
    radius_m: Length | None = None
    top_m: Coordinate | None = None


class SeatingSection(_Section):
    """Rows of seats that face the front, and the people in some of them."""

    rows: Annotated[int, Field(strict=True, ge=1, le=60)]
    seats_per_row: Annotated[int, Field(strict=True, ge=1, le=100)]
    first_row_m: Coordinate
    row_spacing_m: Annotated[Number, Field(ge=0.5, le=10)] = 1.0
    seat_spacing_m: Annotated[Number, Field(ge=0.4, le=10)] = 0.6
    rise_m: Annotated[Number, Field(ge=0, le=2)] = 0.0
    albedo: PerPrimary
    occupied: Share = 0.0
    audience_albedo: PerPrimary = 0.2
    seed: Annotated[int, Field(strict=True, ge=0)] = 0


class BoxSection(_Section):
    """A box between two corners: a projection booth, a console."""

    name: str
    low_m: Place
    high_m: Place
    albedo: PerPrimary

    @field_validator("high_m")
    @classmethod
    def _above(cls, high: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        low = info.data.get("low_m", high)
        if low is not high and not np.all(np.less(low, high)):
            raise ValueError(
                f"must be above low_m in x, y and z, got {list(high)} over {list(low)}"
            )
        return high


class MeshSection(_Section):
    """A mesh from a file, next to the scene's: anything else."""

    name: str
    file: str
    albedo: PerPrimary


class LampSection(_Section):
    """A small rectangle of light that is always on; it shines towards `normal`."""

    name: str
    position_m: Place
    normal: Place
    width_m: Length
    height_m: Length
    luminance_cd_m2: LuminancePerPrimary

    @field_validator("normal")
    @classmethod
    def _directed(cls, normal: tuple[float, ...]) -> tuple[float, ...]:
        if not np.linalg.norm(normal) > 1e-9:
            raise ValueError(f"must have a length, got {list(normal)}")
        return normal


def _elsewhere(look_at: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
    if look_at == info.data.get("position_m"):
        raise ValueError(f"must be another place than position_m, got {list(look_at)}")
    return look_at


class ViewpointSection(_Section):
    """A place to look from."""

    position_m: Place
    look_at_m: Annotated[Place, AfterValidator(_elsewhere)]
    field_deg: Annotated[Number, Field(ge=5, le=150)] = 100.0


class UnitSection(_Section):
    """One of several projectors."""

    name: str
    position_m: Place
    look_at_m: Annotated[Place, AfterValidator(_elsewhere)]
    field_deg: Annotated[Number, Field(ge=1, le=360)]
    kind: Literal["equidistant", "perspective"] = "equidistant"
    roll_deg: Annotated[Number, Field(ge=-360, le=360)] = 0.0
    aspect: Annotated[Number, Field(ge=0.1, le=10)] = 16 / 9
    blend_deg: Annotated[Number, Field(ge=0, le=90)] = 0.0

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.kind == "perspective" and self.field_deg >= 175:
            raise ValueError(
                f"field_deg: a perspective lens sees less than 175 degrees, got {self.field_deg:g}"
            )
        return self


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
    white_cd_m2: Luminance | None = None
    lumens: Annotated[Number, Field(gt=0, le=1e7)] | None = Field(None, validate_default=True)
    black_cd_m2: NoLuminance = 0.0
    lens: LensSection = LensSection()
    units: tuple[UnitSection, ...] = ()

    @field_validator("lumens")
    @classmethod
    def _one_of_two(cls, lumens: float | None, info: ValidationInfo) -> float | None:
        if "white_cd_m2" not in info.data:
            return lumens
        if lumens is None and info.data["white_cd_m2"] is None:
            raise ValueError("is missing, and so is white_cd_m2: one of the two says how bright")
        if lumens is not None and info.data["white_cd_m2"] is not None:
            raise ValueError("contradicts white_cd_m2: give one of the two")
        return lumens

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.units and any(self.lens.position_m):
            raise ValueError("lens.position_m: is for one projector; with units, place each unit")
        if self.white_cd_m2 is not None:
            Projector(self.primaries, self.white_cd_m2, self.black_cd_m2)
        return self


class AmbientSection(_Section):
    """Light on the screen without any projector, by luminance."""

    luminance_cd_m2: NoLuminance = 0.0


class ViewingSection(_Section):
    """The audience."""

    adaptation_cd_m2: Luminance


Standing: TypeAlias = WallSection | SeatingSection


def _line_error(key: tuple[str | int, ...], message: str) -> InitErrorDetails:
    return InitErrorDetails(type="value_error", loc=key, input=None, ctx={"error": message})


class SceneFile(_Section):
    """A whole scene file; ``sources`` says for each figure where it is from."""

    name: str
    description: str = ""
    dome: DomeSection
    screen: ScreenSection
    projector: ProjectorSection
    ambient: AmbientSection = AmbientSection()
    floor: FloorSection | None = None
    wall: WallSection | None = None
    seating: SeatingSection | None = None
    boxes: tuple[BoxSection, ...] = ()
    meshes: tuple[MeshSection, ...] = ()
    lamps: tuple[LampSection, ...] = ()
    viewpoints: dict[str, ViewpointSection] = {}
    viewing: ViewingSection
    sources: dict[str, str] = {}

    @field_validator("projector")
    @classmethod
    def _lenses_inside(cls, projector: ProjectorSection, info: ValidationInfo) -> ProjectorSection:
        if "dome" not in info.data:
            return projector
        dome = info.data["dome"].shape()
        places: dict[tuple[str | int, ...], Any] = {
            ("lens", "position_m"): projector.lens.position_m
        }
        for number, unit in enumerate(projector.units):
            places["units", number, "position_m"] = np.asarray(unit.position_m) @ dome.to_room
        mistakes = [
            _line_error(
                key,
                f"must be inside {dome.whole}, got {np.linalg.norm(place):g} m from its centre",
            )
            for key, place in places.items()
            if not dome.encloses(place)
        ]
        if mistakes:
            raise ValidationError.from_exception_data("projector", mistakes)
        return projector

    @field_validator("wall", "seating")
    @classmethod
    def _stands_on_floor(cls, section: Standing | None, info: ValidationInfo) -> Standing | None:
        floor = info.data.get("floor", ...)  # absent if it has mistakes itself
        if section is not None and floor is None:
            raise ValueError("needs a [floor] to stand on, got none")
        if isinstance(section, WallSection) and isinstance(floor, FloorSection):
            top = section.top_m
            if top is not None and top <= floor.height_m:
                place = f"above the floor ({floor.height_m:g} m)"
                mistake = _line_error(("top_m",), f"must be {place}, got {top:g}")
                raise ValidationError.from_exception_data("wall", [mistake])
        return section

    @property
    def digest(self) -> str:
        """SHA-256 of all that light transport depends on."""
        parts = {"name", "description", "sources", "viewing", "viewpoints", "ambient"}
        content = self.model_dump(mode="json", exclude=parts, warnings=False)
        content["projector"].pop("black_cd_m2")
        if not self.lamps:  # their light is stored in units of white
            for key in ("primaries", "white_cd_m2", "lumens"):
                content["projector"].pop(key)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@final
@dataclass(frozen=True)
class Scene:
    """A theatre: what its projector, screen and audience are.

    Parameters
    ----------
    name, description
        What the theatre is called and is.
    theatre
        Its screen, and all that light meets in it.
    projector
        Its projector.
    ambient
        Luminance of the unlit screen (projector black and stray light), cd/m².
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    digest
        SHA-256 of all that light transport depends on.
    transport
        Its light transport, tabulated or measured; None for the closed form.
    """

    name: str
    description: str
    theatre: Theatre
    projector: Projector
    ambient: float
    viewing: Viewing
    sources: Mapping[str, str]
    digest: str
    transport: Transport | None = None

    @property
    def dome(self) -> Dome:
        """The screen's shape."""
        return self.theatre.dome

    @property
    def albedo(self) -> tuple[float, float, float]:
        """Albedo of the screen for each primary, holes counted in."""
        return self.theatre.screen_albedo

    def observation(self, rows: int, cols: int) -> LowRankObservation | TabulatedDome:
        """What the audience sees of a domemaster of that size.

        By the stored transport if there is one, else by the closed form of the bare screen, which
        is an approximation if `approximation` says so.

        Raises
        ------
        InputError
            If it is not square, or smaller than 2 x 2.
        """
        gains = None
        if self.theatre.lenses or not self.theatre.lambertian:
            gains = lens_gains(self.theatre, rows, cols)
        gain = None if gains is None else gains.sum(0)
        black = self.ambient / self.projector.white
        if self.transport is not None:
            seen = None if gains is None else seen_gain(self.theatre, gains)
            return self.transport.observation(
                rows, cols, lens_gain=gain, seen_gain=seen, ambient=black
            )
        return ClosedFormDome(
            self.dome, rows, cols, albedo=self.albedo, lens_gain=gain, ambient=black
        )

    def solvable(self, rows: int, cols: int) -> LowRankObservation:
        """`observation` in the form that solvers need: of a stored transport, the strong modes."""
        exact = self.observation(rows, cols)
        return exact.low_rank() if isinstance(exact, TabulatedDome) else exact

    @property
    def approximation(self) -> str | None:
        """Why `observation` is only an approximation of this theatre, in one line; None if not."""
        if self.transport is not None:
            shadowed = self.transport.provenance.get("shadowed", 0.0)
            left_out = []
            if shadowed >= _SHADOWED:
                left_out.append(
                    f"{shadowed:.1%} of the screen lies in shadows of what is before a projector"
                )
            if self.theatre.shines_back:
                left_out.append("a ghost of the picture shines back through the screen's holes")
            if not left_out:
                return None
            return (
                f"approximate: {'; '.join(left_out)}. A stored transport, which is smooth, leaves "
                f"that out ('domesim render' does not)"
            )
        reasons = self.theatre.departures()
        if not reasons:
            return None
        return (
            f"approximate: the closed form knows the bare screen only, but {'; '.join(reasons)}. "
            f"For the whole theatre: domesim tabulate {self.name} --out FILE.npz, then --transport"
        )

    def with_transport(self, transport: Transport) -> Scene:
        """The same scene with a stored transport.

        Raises
        ------
        InputError
            If it is another theatre's.
        """
        made_for = transport.provenance.get("digest", self.digest)
        if transport.dome != self.dome or made_for != self.digest:
            known = transport.provenance.get("scene", "another theatre")
            raise InputError(
                f"the stored transport is of {known!r}, or of {self.name!r} before it was changed; "
                f"run domesim tabulate {self.name} again"
            )
        return replace(self, transport=transport)


def load_scene(name_or_path: str | Path) -> Scene:
    """The scene of a TOML file, or one of the project's own by its name.

    Raises
    ------
    InputError
        If there is no such scene, or with all mistakes of its file, each with its path.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" and len(path.parts) <= 1:
        return _scene(_bundled(str(name_or_path)), str(name_or_path), Path())
    try:
        text = path.read_bytes().decode()
    except UnicodeDecodeError:
        raise InputError(f"{path}: a scene is a TOML text file in UTF-8, this is not") from None
    except OSError as error:
        raise InputError(
            f"{path}: wanted a scene's .toml file, got '{error.strerror}'. "
            f"Check the path, or use one of {', '.join(scene_names())}"
        ) from error
    return _scene(text, str(path), path.parent)


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


def _scene(text: str, where: str, folder: Path) -> Scene:
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a ValueError also for a number too long
        raise InputError(f"{where}: not valid TOML: {error}") from None
    try:
        return _built(SceneFile.model_validate(content), folder)
    except ValidationError as error:
        raise InputError(_all_mistakes(error, where)) from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


_SHADOWED = 2e-3
"""Share of the screen that may lie in shadow without a word: what rim pixels amount to."""


def _built(file: SceneFile, folder: Path) -> Scene:
    theatre = _theatre(file, folder)
    for rho in theatre.screen_albedo:
        # Refuses what no frame can change: a sphere that keeps all its light.
        bare_gain(rho, theatre.dome)
    lit = file.projector
    white = lit.white_cd_m2
    if white is None:
        weights = Projector(lit.primaries, 1.0).luminance_weights
        irradiance = (lit.lumens or 0.0) / theatre.dome.screen_area / _mean_gain(theatre)
        white = float(weights @ theatre.screen_albedo) * irradiance / np.pi
    projector = Projector(lit.primaries, white, lit.black_cd_m2)
    # Lamps are known in cd/m², light in units of white.
    lamps = tuple(
        replace(lamp, luminance=_three(np.asarray(lamp.luminance) / white))
        for lamp in theatre.lamps
    )
    return Scene(
        name=file.name,
        description=file.description,
        theatre=replace(theatre, lamps=lamps),
        projector=projector,
        ambient=lit.black_cd_m2 + file.ambient.luminance_cd_m2,
        viewing=viewing.from_dome_centre(theatre.dome, file.viewing.adaptation_cd_m2),
        sources=file.sources,
        digest=_with_meshes(file, theatre),
    )


def _mean_gain(theatre: Theatre, size: int = 128) -> float:
    """Mean irradiance of the screen by its projectors, over that of the ideal one's."""
    if theatre.corrected:
        return 1.0
    areas = theatre.dome.screen_areas(size, size)
    return float(np.sum(areas * lens_gains(theatre, size, size).sum(0)) / areas.sum())


def _with_meshes(file: SceneFile, theatre: Theatre) -> str:
    """The file's digest, with what is in the files that it names."""
    if not file.meshes:
        return file.digest
    digest = hashlib.sha256(file.digest.encode())
    for solid in theatre.solids:
        digest.update(solid.vertices.tobytes() + solid.faces.tobytes())
    return digest.hexdigest()


def _theatre(file: SceneFile, folder: Path) -> Theatre:
    dome, screen = file.dome.shape(), file.screen
    cavity, lobe = screen.cavity, screen.lobe
    floor, wall = _floor_and_wall(file, dome)
    solids, viewpoints = _furniture(file, floor, dome, folder)
    return Theatre(
        dome=dome,
        albedo=_three(screen.albedo),
        perforation=screen.perforation,
        cavity=None
        if cavity is None
        else Cavity(cavity.depth_m, _three(cavity.albedo), _three(cavity.back_albedo)),
        lobe=None if lobe is None else Lobe(lobe.share, lobe.roughness),
        floor=floor,
        wall=wall,
        solids=solids,
        lamps=tuple(_lamp(lamp) for lamp in file.lamps),
        lenses=_lenses(file.projector, dome),
        corrected=file.projector.lens.corrected,
        viewpoints=viewpoints,
    )


def _floor_and_wall(file: SceneFile, dome: Dome) -> tuple[Floor | None, Wall | None]:
    if file.floor is None:
        return None, None
    wall = None
    radius = dome.widest
    if file.wall is not None:
        radius = file.wall.radius_m or radius
        top = dome.lowest if file.wall.top_m is None else file.wall.top_m
        if top > file.floor.height_m:
            wall = Wall(radius, file.floor.height_m, top, _three(file.wall.albedo))
    floor = Floor(file.floor.height_m, file.floor.radius_m or radius, _three(file.floor.albedo))
    return floor, wall


def _furniture(
    file: SceneFile, floor: Floor | None, dome: Dome, folder: Path
) -> tuple[tuple[Solid, ...], dict[str, Viewpoint]]:
    solids: list[Solid] = []
    viewpoints: dict[str, Viewpoint] = {}
    front = dome.surface(np.array(dome.half_angle / 2), np.array(np.pi / 2)) @ dome.to_room.T
    if file.seating is not None and floor is not None:
        seats = file.seating
        rows, viewpoints = furniture.seating(
            floor_height=floor.height,
            rows=seats.rows,
            seats_per_row=seats.seats_per_row,
            first_row=seats.first_row_m,
            row_spacing=seats.row_spacing_m,
            seat_spacing=seats.seat_spacing_m,
            rise=seats.rise_m,
            within=floor.radius,
            albedo=_three(seats.albedo),
            occupied=seats.occupied,
            audience_albedo=_three(seats.audience_albedo),
            seed=seats.seed,
            look_at=(float(front[0]), float(front[1]), float(front[2])),
        )
        solids += rows
    solids += [
        furniture.box(box.name, box.low_m, box.high_m, _three(box.albedo)) for box in file.boxes
    ]
    solids += [
        furniture.from_file(folder / mesh.file, mesh.name, _three(mesh.albedo))
        for mesh in file.meshes
    ]
    for name, view in file.viewpoints.items():
        viewpoints[name] = Viewpoint(view.position_m, view.look_at_m, np.radians(view.field_deg))
    return tuple(solids), viewpoints


def _lenses(projector: ProjectorSection, dome: Dome) -> tuple[Lens, ...]:
    if projector.units:
        return tuple(
            Lens(
                unit.name,
                unit.position_m,
                unit.look_at_m,
                np.radians(unit.roll_deg),
                unit.kind,
                np.radians(unit.field_deg),
                unit.aspect,
                np.radians(unit.blend_deg),
            )
            for unit in projector.units
        )
    lens = projector.lens
    if lens.corrected and not any(lens.position_m):
        return ()
    # A single lens is given in the dome's frame.
    place = dome.to_room @ np.asarray(lens.position_m)
    x, y, z = (float(value) for value in place)
    zenith = dome.to_room[:, 2] * dome.radius
    ahead = (x + float(zenith[0]), y + float(zenith[1]), z + float(zenith[2]))
    return (Lens("lens", (x, y, z), ahead, field=2 * np.pi),)


def _lamp(lamp: LampSection) -> Lamp:
    normal = np.asarray(lamp.normal, np.float64)
    normal /= np.linalg.norm(normal)
    reference = np.array([0.0, 0, 1]) if abs(normal[2]) < 0.999 else np.array([0.0, 1, 0])
    across = np.cross(reference, normal)
    across *= lamp.width_m / 2 / np.linalg.norm(across)
    up = np.cross(normal, across)
    up *= lamp.height_m / 2 / np.linalg.norm(up)
    return Lamp(
        lamp.name, lamp.position_m, _three(across), _three(up), _three(lamp.luminance_cd_m2)
    )


def _three(value: ArrayLike) -> tuple[float, float, float]:
    x, y, z = np.broadcast_to(np.asarray(value, np.float64), 3)
    return float(x), float(y), float(z)


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
        if isinstance(part, int) or part not in model.model_fields:
            continue  # the number or name of one of several
        inner = _models_in(model.model_fields[part].annotation)
        if not inner:
            return []
        model = inner[0]
    return list(model.model_fields)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Models in an annotation such as `X`, ``X | None``, ``tuple[X, ...]`` or ``dict[str, X]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _suggestion(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, 1)
    return f" (did you mean {close[0]!r}?)" if close else ""
