"""The file of a dome theatre, as it is written.

Places are in the room's frame (x right, y front, z up, from the centre of the dome's sphere), but
for the single lens's, which is in the dome's.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    StrictBool,
    Tag,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import InitErrorDetails

from domesim.errors import InputError
from domesim.observation.crosstalk import Crosstalk, leaks_to_both
from domesim.observation.projector import Projector
from domesim.room.dome import Dome
from domesim.scene.fields import (
    TAGS,
    AmbientSection,
    Coordinate,
    GradeSection,
    LeakOfAView,
    Length,
    Luminance,
    LuminancePerPrimary,
    NoLuminance,
    Number,
    PerPrimary,
    Place,
    Response,
    Section,
    Share,
    ViewingSection,
)


class DomeSection(Section):
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


class LobeSection(Section):
    """Light that a glossy ("gain") screen sends in the mirror direction."""

    share: Share
    roughness: Annotated[Number, Field(ge=0.05, le=1)]


class CavitySection(Section):
    """The shell behind a perforated screen; `back_albedo` is that of the screen's back."""

    depth_m: Length
    albedo: PerPrimary
    back_albedo: PerPrimary = 0.0


def _numbers(value: object) -> NDArray[np.float64]:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf":
        raise ValueError("must be a file, three files, or an array of numbers")
    return np.array(value, np.float64)


def _map_form(value: object) -> str:
    return TAGS[5 if isinstance(value, str) else 6 if isinstance(value, list | tuple) else 7]


AlbedoMap: TypeAlias = Annotated[
    Annotated[str, Tag(TAGS[5])]
    | Annotated[tuple[str, str, str], Tag(TAGS[6])]
    | Annotated[SkipJsonSchema[Any], AfterValidator(_numbers), Tag(TAGS[7])],
    Discriminator(_map_form),
]
"""A file, three files, or an array."""


class ScreenSection(Section):
    """What the screen is made of.

    `albedo_map` is a domemaster of what multiplies the albedo from place to place: a PNG or an EXR
    beside the scene's file, of grey or of a colour that counts by primaries, or three of grey.
    Its values count as they are stored, without a curve. White is as it is seen where that is 1.
    Programs may give an array, (row, col) or (row, col, primary).
    """

    albedo: PerPrimary
    albedo_map: AlbedoMap | None = None
    perforation: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    lobe: LobeSection | None = None
    cavity: CavitySection | None = None


class FloorSection(Section):
    """A level disc; as wide as the wall or the dome unless it says otherwise."""

    height_m: Coordinate
    albedo: PerPrimary
    radius_m: Length | None = None


class WallSection(Section):
    """A round wall from the floor up to the lowest point of the screen, or to `top_m`."""

    albedo: PerPrimary
    radius_m: Length | None = None
    top_m: Coordinate | None = None


class SeatingSection(Section):
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


class BoxSection(Section):
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


class MeshSection(Section):
    """A mesh from a file, next to the scene's: anything else."""

    name: str
    file: str
    albedo: PerPrimary


class LampSection(Section):
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


class ViewpointSection(Section):
    """A place to look from."""

    position_m: Place
    look_at_m: Annotated[Place, AfterValidator(_elsewhere)]
    field_deg: Annotated[Number, Field(ge=5, le=150)] = 100.0


Shift = Annotated[Number, Field(ge=-5, le=5)]


class UnitSection(Section):
    """One of several projectors.

    `shift` is where the middle of its field is, right and up of its axis, in halves of width and
    height. `mask` is a PNG of its blend over the field, in light, beside the scene's file.
    `black_cd_m2` is its black where no other projector reaches: direct light alone. It fills the
    field, unless `blends_black`: blends of glass or metal dim black, too. `uplift` is a PNG of what
    it adds to black, in shares of white, whose codes are to the power of 1/2.2.
    """

    name: str
    position_m: Place
    look_at_m: Annotated[Place, AfterValidator(_elsewhere)]
    field_deg: Annotated[Number, Field(ge=1, le=360)]
    kind: Literal["equidistant", "perspective"] = "equidistant"
    roll_deg: Annotated[Number, Field(ge=-360, le=360)] = 0.0
    aspect: Annotated[Number, Field(ge=0.1, le=10)] = 16 / 9
    blend_deg: Annotated[Number, Field(ge=0, le=90)] = 0.0
    shift: tuple[Shift, Shift] = (0.0, 0.0)
    mask: str | None = None
    black_cd_m2: NoLuminance | None = None
    blends_black: StrictBool = False
    uplift: str | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        rectangular = any(self.shift) or self.mask is not None or self.uplift is not None
        if self.kind == "equidistant" and rectangular:
            raise ValueError(
                "shift, mask and uplift: are of a perspective lens, with a rectangular field"
            )
        if self.kind == "perspective" and self.field_deg >= 175:
            raise ValueError(
                f"field_deg: a perspective lens sees less than 175 degrees, got {self.field_deg:g}"
            )
        return self


class LensSection(Section):
    """Where the projector's lens is, in the dome's frame (x right, y front, z zenith)."""

    position_m: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    corrected: StrictBool = True


class ProjectorSection(Section):
    """The projector, on the screen.

    White is direct light alone, as a small white patch shows it: a full white frame is brighter
    by its own cross-reflection. Black is a full black frame, as it is seen, and the same all over
    the screen; of projectors whose overlaps are brighter, each unit has its own instead.
    `even_black` says that black is lifted outside overlaps, as little as hides the edges of these:
    by the projectors, for which `domesim scene export` writes it, or in the frames that
    `domesim compensate` writes. Primaries are BT.709, P3-D65,
    P3-DCI, BT.2020, or any RGB colour space of the package colour-science. Response is what the
    projector makes of levels, by whatever file or pipe they come: "bt1886", "srgb", an exponent
    such as "2.2", or pairs of code and light from 0 to 1. Without it files say their curves, or
    what is usual for them counts.
    """

    primaries: str = "BT.709"
    white_cd_m2: Luminance | None = None
    lumens: Annotated[Number, Field(gt=0, le=1e7)] | None = Field(None, validate_default=True)
    black_cd_m2: NoLuminance = 0.0
    response: Response | None = None
    even_black: Literal["projectors", "frames"] | None = None
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
        blacks = [unit.black_cd_m2 is not None for unit in self.units]
        if any(blacks) and not all(blacks):
            missing = [u.name for u in self.units if u.black_cd_m2 is None]
            raise ValueError(f"units: black_cd_m2 is missing of {', '.join(missing)}")
        if any(blacks) and self.black_cd_m2:
            raise ValueError("black_cd_m2: contradicts that of the units: give one of the two")
        if self.even_black and not any(blacks):
            raise ValueError("even_black: needs black_cd_m2 of each of units, got none")
        if self.white_cd_m2 is not None:
            Projector(self.primaries, self.white_cd_m2, self.black_cd_m2)
        return self


class DomeStereoSection(Section):
    """How a 3D dome keeps the eyes apart, and what leaks of direct light all the same.

    ``share``, or ``to_left`` and ``to_right``, is crosstalk of direct light, as on a flat screen: a
    number, one a primary, or a matrix. ``kept_by_reflection`` is what each reflection on the screen
    keeps of circular polarisation; below 0 its hand is turned, as metal does.
    """

    system: Literal["shutter", "spectral", "polarised"]
    share: LeakOfAView | None = None
    to_left: LeakOfAView | None = None
    to_right: LeakOfAView | None = None
    kept_by_reflection: Annotated[Number, Field(ge=-1, le=1)] | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        one_view = [self.to_left is not None, self.to_right is not None]
        if any(one_view) == (self.share is not None) or any(one_view) != all(one_view):
            raise ValueError("needs share, or both to_left and to_right")
        if self.kept_by_reflection is not None and self.system != "polarised":
            raise ValueError(
                f"kept_by_reflection: leave it out, as a {self.system} system keeps the eyes apart "
                f"however often light is reflected"
            )
        try:
            Crosstalk(1, 1, self.leaks)
        except InputError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def kept(self) -> float:
        """What each reflection keeps of the difference of the views."""
        if self.system != "polarised":
            return 1.0
        return self.kept_by_reflection or 0.0

    @property
    def leaks(self) -> NDArray[np.float64]:
        """(view, primary, primary) crosstalk."""
        views = self.to_left, self.to_right
        return leaks_to_both(*(self.share if leak is None else leak for leak in views))


class StarProjectorSection(Section):
    """A star projector beside the video (a hybrid dome): its stars keep their own light.

    `zero_point_lux` is what its star of magnitude 0 brings to the eye.
    """

    image_arcmin: Annotated[Number, Field(gt=0, le=60)] = 1.0
    zero_point_lux: Annotated[Number, Field(gt=0, le=1)] = 2.54e-6


class SkySection(Section):
    """Which light is which magnitude.

    `zero_point` is the magnitude of the video's star that has the light of projector white over one
    square arcminute. Without it stars are as bright as the sky's.
    """

    zero_point: Annotated[Number, Field(ge=-10, le=20)] | None = None
    star_projector: StarProjectorSection | None = None


Three = tuple[Number, Number, Number]


class MeasuredSection(Section):
    """Where measured figures are from, and how sure they are (`domesim measure dome`).

    `values` and `standard_errors` have one number a primary for each of `parameters`; the gain is
    white by direct light alone, in `unit`. Albedos are with the screen's holes counted in.
    `correlations` has a row of each parameter in each primary, as "R screen", in the order of
    `parameters` of R, then of G, then of B; and so have its columns.
    """

    date: str
    survey: str
    unit: str
    parameters: tuple[str, ...]
    chi2: Number
    degrees_of_freedom: Annotated[int, Field(strict=True)]
    model_error: Number
    values: dict[str, Three]
    standard_errors: dict[str, Three]
    correlations: dict[str, tuple[Annotated[Number, Field(ge=-1.001, le=1.001)], ...]]
    sha256: dict[str, str]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for name in ("values", "standard_errors"):
            if sorted(getattr(self, name)) != sorted(self.parameters):
                raise ValueError(f"{name} must have one row for each of {list(self.parameters)}")
        rows = [f"{primary} {name}" for primary in "RGB" for name in self.parameters]
        if list(self.correlations) != rows:
            raise ValueError(f"correlations must have rows {rows}, got {list(self.correlations)}")
        if any(len(row) != len(rows) for row in self.correlations.values()):
            raise ValueError(f"correlations must have {len(rows)} numbers in each row")
        return self

    def covariance(self, names: Sequence[str]) -> NDArray[np.float64]:
        """(name, primary, name, primary) of some parameters."""
        count = len(self.parameters)
        whole = np.array(list(self.correlations.values())).reshape(3, count, 3, count)
        errors = np.array([self.standard_errors[name] for name in names])
        mine = [self.parameters.index(name) for name in names]
        chosen = whole[:, mine][:, :, :, mine].transpose(1, 0, 3, 2)
        return np.asarray(errors[:, :, None, None] * chosen * errors)


Standing: TypeAlias = WallSection | SeatingSection


def _line_error(key: tuple[str | int, ...], message: str) -> InitErrorDetails:
    return InitErrorDetails(type="value_error", loc=key, input=None, ctx={"error": message})


class DomeFile(Section):
    """A whole scene file; ``sources`` says for each figure where it is from."""

    name: str
    description: str = ""
    dome: DomeSection
    screen: ScreenSection
    projector: ProjectorSection
    ambient: AmbientSection = AmbientSection()
    grade: GradeSection = GradeSection()
    floor: FloorSection | None = None
    wall: WallSection | None = None
    seating: SeatingSection | None = None
    boxes: tuple[BoxSection, ...] = ()
    meshes: tuple[MeshSection, ...] = ()
    lamps: tuple[LampSection, ...] = ()
    viewpoints: dict[str, ViewpointSection] = Field(default_factory=dict)
    viewing: ViewingSection
    sky: SkySection = SkySection()
    sources: dict[str, str] = Field(default_factory=dict)
    measured: MeasuredSection | None = None
    stereo: DomeStereoSection | None = None

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

    @field_validator("measured")
    @classmethod
    def _of_even_paint(
        cls, measured: MeasuredSection | None, info: ValidationInfo
    ) -> MeasuredSection | None:
        screen = info.data.get("screen")
        if measured is not None and screen is not None and screen.albedo_map is not None:
            raise ValueError("is of a screen of even paint; leave it or screen.albedo_map out")
        return measured

    @field_validator("stereo")
    @classmethod
    def _matt(
        cls, stereo: DomeStereoSection | None, info: ValidationInfo
    ) -> DomeStereoSection | None:
        screen = info.data.get("screen")
        glossy = screen is not None and screen.lobe is not None
        if stereo is not None and glossy and stereo.kept not in (0, 1):
            way_out = "leave it out: beside [screen.lobe] no closed form knows what is kept"
            mistakes = [_line_error(("kept_by_reflection",), way_out)]
            raise ValidationError.from_exception_data("stereo", mistakes)
        return stereo

    @property
    def digest(self) -> str:
        """SHA-256 of all that light transport depends on."""
        parts = {"name", "description", "sources", "viewing", "viewpoints", "ambient", "measured"}
        parts |= {"stereo", "sky", "grade"}  # what one view's light does is stored
        left: dict[str, Any] = {**dict.fromkeys(parts, True), "screen": {"albedo_map"}}
        content = self.model_dump(mode="json", exclude=left, warnings=False)
        for key in ("black_cd_m2", "even_black", "response"):
            content["projector"].pop(key)
        for unit in content["projector"]["units"]:
            for key in ("black_cd_m2", "blends_black", "uplift"):
                unit.pop(key)
            for key, usual in (("shift", [0.0, 0.0]), ("mask", None)):
                if unit[key] == usual:
                    unit.pop(key)
        if not self.lamps:  # their light is stored in units of white
            for key in ("primaries", "white_cd_m2", "lumens"):
                content["projector"].pop(key)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
