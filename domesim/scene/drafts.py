"""First drafts of scene files, with a unit, a comment and a source for every figure in them.

What a person does not say is chosen here, and the file says so: each figure's row of ``[sources]``
is "given", "chosen: why", "derived: how" or a publication.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any, NamedTuple, final

import numpy as np

from domesim.errors import InputError
from domesim.observation.spherical import bare_gain
from domesim.room.dome import Dome
from domesim.room.layouts import BELOW, BLEND, Layout, around
from domesim.room.theatre import Lens
from domesim.scene.writing import as_toml

GIVEN = "given"

ALBEDO, PERFORATION, WHITE, CONTRAST = 0.58, 0.216, 7.0, 5000.0
"""Albedo, open share, white (cd/m²) and contrast of a dome whose owner does not say: those of the
bundled `dome_planetarium`."""
MATTE = 0.95
"""Largest gain that a matte surface is believed to have."""
_ROUGHNESS = 0.3
_STANDING = 1.75  # m, of a person
_LONG = 80  # letters of a line that is broken into rows
_ROW, _SEAT = 1.05, 0.62  # m, between rows and between seats

SYSTEMS = {
    "silver": "stereo_cinema_silver",
    "polarised": "stereo_polarised_paper",
    "spectral": "stereo_spectral",
    "shutter": "stereo_shutter",
}
"""Ways to keep the eyes apart -> the bundled scene whose figures are taken."""

_HOLES = (
    "45 holes of 5/64 in per square inch (Land Between the Lakes, Planetarium Dome Renovation "
    "Project, 2017); about 23 % (planetarium.osu.edu, Dome Screen Installation in Progress, 2013)"
)


@final
@dataclass(frozen=True)
class DomeWish:
    """Wishes for a theatre; None where the draft may choose.

    Parameters
    ----------
    radius
        Radius of the dome's sphere, m.
    tilt, half_angle
        Tilt and half-angle of the dome, degrees.
    projectors, layout
        How many, and where (see `domesim.room.layouts`).
    seats
        Rows, and seats in each.
    albedo, gain, perforation
        Albedo, gain and open share of the screen; a data sheet's gain is along its normal.
    white, lumens
        How bright, cd/m² of direct light or lm on the screen.
    plain
        Whether the room is to be empty, as a survey's is described.

    Raises
    ------
    InputError
        If a figure is impossible, or two contradict each other.
    """

    radius: float
    tilt: float | None = None
    half_angle: float | None = None
    projectors: int = 1
    layout: Layout | None = None
    seats: tuple[int, int] | None = None
    albedo: float | None = None
    gain: float | None = None
    perforation: float | None = None
    white: float | None = None
    lumens: float | None = None
    plain: bool = False

    def __post_init__(self) -> None:
        _within("radius", self.radius, 1, 100, "m")
        _within("tilt", self.lean, 0, 60, "degrees")
        _within("half-angle", self.reach, 45, 120, "degrees")
        _within("projectors", self.projectors, 1, 24)
        if self.layout == "centre" and self.projectors > 1:
            raise InputError(
                f"--projectors: one stands in the centre, got {self.projectors}; choose the layout "
                f"cove or ring"
            )
        for name, seats, most in zip(("seats", "seats"), self.seats or (), (60, 100),
                                     strict=False):  # fmt: skip
            _within(name, seats, 1, most)
        if self.albedo is not None:
            _within("albedo", self.albedo, 0.01, 0.99)
        if self.gain is not None:
            _within("gain", self.gain, 0.01, 10)
        if self.perforation is not None:
            _within("perforation", self.perforation, 0, 0.9)
        if self.white is not None:
            _within("white", self.white, 1e-3, 1e5, "cd/m²")
            if self.lumens is not None:
                raise InputError("--lumens contradicts --white: give one of the two")
        if self.lumens is not None:
            _within("lumens", self.lumens, 1, 1e7, "lm")
        if self.gain is None:
            return
        if self.albedo is None and self.gain > MATTE:
            raise InputError(
                f"--gain: {self.gain:g} is more than matte paint can have, so the screen has a "
                f"lobe: give --albedo (the share of light that it sends back, in all directions), "
                f"too"
            )
        if self.albedo is not None and self.gain < self.albedo:
            raise InputError(
                f"--gain: must be at least the albedo ({self.albedo:g}), got {self.gain:g}: the "
                f"albedo is the gain's mean over all directions. Is one of them with the holes "
                f"counted in?"
            )

    @property
    def lean(self) -> float:
        """Tilt, degrees."""
        return 0.0 if self.tilt is None else self.tilt

    @property
    def reach(self) -> float:
        """Half-angle, degrees."""
        return 90.0 if self.half_angle is None else self.half_angle

    @property
    def dome(self) -> Dome:
        """The screen's shape."""
        return Dome(self.radius, np.radians(self.reach), np.radians(self.lean))

    @property
    def place(self) -> Layout:
        """Where projectors stand."""
        return self.layout or ("centre" if self.projectors == 1 else "cove")

    @property
    def paint(self) -> float:
        """Albedo of the screen between its holes."""
        return self.albedo or self.gain or ALBEDO

    @property
    def holes(self) -> float:
        """Share of the screen that is holes."""
        return PERFORATION if self.perforation is None else self.perforation

    @property
    def luminance(self) -> float:
        """White by direct light alone, cd/m²."""
        if self.lumens is None:
            return WHITE if self.white is None else self.white
        return self.paint * (1 - self.holes) * self.lumens / self.dome.screen_area / np.pi


@final
@dataclass(frozen=True)
class StereoWish:
    """Wishes for a 3D screen; None where the draft may choose.

    Parameters
    ----------
    system
        One of `SYSTEMS`.
    width, height
        Size of the screen, m.
    distance
        Distance of the seat in the middle from the screen, m.
    white
        Through the glasses, cd/m².

    Raises
    ------
    InputError
        If a figure is impossible.
    """

    system: str
    width: float
    height: float | None = None
    distance: float | None = None
    white: float | None = None

    def __post_init__(self) -> None:
        if self.system not in SYSTEMS:
            raise InputError(
                f"--system: {self.system!r} is not known; use one of {', '.join(SYSTEMS)}"
            )
        _within("width", self.width, 0.1, 100, "m")
        for name in ("height", "distance"):
            if getattr(self, name) is not None:
                _within(name, getattr(self, name), 0.1, 200, "m")
        if self.white is not None:
            _within("white", self.white, 1e-3, 1e5, "cd/m²")


class Figure(NamedTuple):
    """One key: its value, its unit and meaning, and where it is from."""

    key: str
    value: Any
    comment: str
    source: str


class Part(NamedTuple):
    """A section: its heading, lines of advice, and its keys."""

    heading: str
    advice: tuple[str, ...]
    figures: tuple[Figure, ...]


def dome_draft(wish: DomeWish, name: str) -> str:
    """A dome theatre's scene file.

    Raises
    ------
    InputError
        If projectors cannot be placed so.
    """
    lenses: tuple[Lens, ...] = ()
    if wish.place != "centre":
        lenses = around(wish.dome, wish.projectors, wish.place)
    placed = (
        f"{len(lenses)} projectors ({wish.place})" if lenses else "one projector, in the centre"
    )
    about = f"A dome of {2 * wish.radius:g} m, leaning by {wish.lean:g} degrees; {placed}."
    parts = [_dome(wish), *_screen(wish), *_room(wish), *_light(wish), *_units(wish, lenses)]
    sources = {}
    if lenses:
        sources["projector.units"] = (
            f"derived: placed by domesim scene new (layout {wish.place}), with the narrowest "
            f"fields that cover all of the screen; their shape and blends of {BLEND:g} degrees are "
            f"chosen"
        )
    head = (
        "A dome theatre. Lengths in m, angles in degrees, luminance in cd/m². The origin is the",
        "centre of the dome's sphere: x to the audience's right, y to their front, z up.",
    )
    return _written(head, name, about, parts, sources)


def stereo_draft(wish: StereoWish, name: str) -> str:
    """A stereo system's scene file."""
    known = SYSTEMS[wish.system]
    content = tomllib.loads(resources.files("scenes").joinpath(f"{known}.toml").read_text())
    head = (
        "A 3D screen. Lengths in m, luminance in cd/m² through the glasses. The origin is the",
        "middle of the screen: x to the audience's right, y to the screen (seats: y < 0), z up.",
        f"Crosstalk is that of the bundled {known}. Measure yours (docs/measuring.md).",
    )
    about = f"A 3D screen, {wish.width:g} m wide ({wish.system})."
    copied = {
        key: f"{text} (as in {known})"
        for key, text in content["sources"].items()
        if key.startswith(("crosstalk", "seats"))
    }
    return _written(head, name, about, list(_stereo_parts(wish, content, known)), copied)


# A dome, section by section.


def _dome(wish: DomeWish) -> Part:
    master = (
        "a domemaster is a hemisphere (fulldome.org, Dome Master Show File Format 1.0, section II)"
    )
    return Part(
        "[dome]",
        (),
        (
            Figure("radius_m", wish.radius, "m, of the sphere: half of its width", GIVEN),
            Figure(
                "half_angle_deg",
                wish.reach,
                "degrees, from the zenith to the rim: 90 is a hemisphere",
                _or_given(wish.half_angle is not None, master),
            ),
            Figure(
                "tilt_deg",
                wish.lean,
                "degrees, that the zenith leans to the front",
                _or_given(wish.tilt is not None, "chosen: level"),
            ),
        ),
    )


def _screen(wish: DomeWish) -> Iterator[Part]:
    source = GIVEN
    if wish.albedo is None:
        source = "chosen: as dome_planetarium; no vendor's figure found"
        if wish.gain is not None:
            source = "given as the gain of a matte screen, which is its albedo"
    shares = ", ".join(
        f"{bare_gain(rho, wish.dome):.0%} at {rho:g}" for rho in (0.2, 0.3, 0.45, 0.6, 0.8)
    )
    yield Part(
        "[screen]",
        (
            "The albedo is the share of light that the paint sends back, to all sides together.",
            "A matte (Lambertian) screen's gain equals its albedo. A gain above the albedo is a",
            "lobe: brighter along the normal, where gain is measured, against a white standard",
            "of gain 1 (Da-Lite, Angles of Reflection, issue 12; Elite Screens, Terminology).",
            "Darker paint takes more lumens, and gives the picture its blacks back. A white",
            "picture reflects so much of its light on itself in this dome, by albedo with holes",
            f"counted in: {shares}.",
            "No vendor's albedo was found. Measure yours: domesim measure dome, docs/measuring.md.",
        ),
        (
            Figure("albedo", wish.paint, "share, of the paint between the holes", source),
            Figure(
                "perforation",
                wish.holes,
                "share of the screen that is holes; black behind, without a [screen.cavity]",
                _or_given(wish.perforation is not None, _HOLES),
            ),
        ),
    )
    if wish.gain is None or wish.gain <= wish.paint:
        return
    more = wish.gain / wish.paint
    # Along the normal a lobe of GGX facets is 1 / (4 alpha²) times as bright as a matte screen
    rough = float(min(_ROUGHNESS, 0.5 / np.sqrt(more)))
    share = min(1.0, (more - 1) / (0.25 / rough**2 - 1))
    told = f"gain {wish.gain:g} along the normal, at the albedo {wish.paint:g}"
    yield Part(
        "[screen.lobe]",
        (f"Both keys together make the {told}.",),
        (
            Figure("share", round(share, 4), "share of the reflected light", f"derived: {told}"),
            Figure(
                "roughness",
                round(rough, 4),
                "0.05 (a mirror) to 1: how wide the lobe is",
                "chosen: data sheets tell the width as the half-gain angle; fit it to yours",
            ),
        ),
    )


def _room(wish: DomeWish) -> Iterator[Part]:
    radius = wish.radius
    # Lower than the projectors by who stands there, with a head's room
    floor = wish.dome.lowest - BELOW * radius - _STANDING - 0.25
    dark = "chosen: dark carpet, paint and cloth, as dome_planetarium; no reflectance published"
    usual = "chosen: as dome_planetarium"
    yield Part(
        "[floor]",
        (),
        (
            Figure(
                "height_m",
                round(floor, 2),
                "m; the floor is as wide as the dome unless radius_m says otherwise",
                f"chosen: who stands ({_STANDING:g} m) is below the projectors' beams",
            ),
            Figure("albedo", 0.1, "share of light sent back", dark),
        ),
    )
    yield Part(
        "[wall]",
        ("From the floor up to the lowest point of the screen, unless top_m says otherwise.",),
        (Figure("albedo", 0.08, "share of light sent back", dark),),
    )
    if wish.plain:
        return
    rows, across = wish.seats or (
        int(np.clip(1.2 * radius / _ROW, 1, 60)),
        int(np.clip(1.25 * radius / _SEAT, 2, 100)),
    )
    source = _or_given(wish.seats is not None, "chosen: what fits into the middle of the room")
    yield Part(
        "[seating]",
        ("Rows face the front. Seats that have no room are left out.",),
        (
            Figure("rows", rows, "rows", source),
            Figure("seats_per_row", across, "seats in a row", source),
            Figure(
                "first_row_m",
                round(_ROW * (rows - 1) / 2 - 0.1 * radius, 2),
                "m, y of the front row; the others are behind it",
                "chosen: the middle of the seats is a little behind the dome's",
            ),
            Figure("row_spacing_m", _ROW, "m, from row to row", usual),
            Figure("seat_spacing_m", _SEAT, "m, from seat to seat", usual),
            Figure(
                "rise_m",
                round(float(min(0.6, _ROW * np.tan(np.radians(wish.lean)))), 2),
                "m, that a row is higher than the one before it",
                "chosen: as steep as the dome leans, at most 0.6 m",
            ),
            Figure("albedo", 0.1, "share of light that seats send back", dark),
            Figure("occupied", 0.8, "share of the seats with somebody in them", usual),
            Figure("audience_albedo", 0.2, "share of light that people send back", dark),
        ),
    )


def _light(wish: DomeWish) -> Iterator[Part]:
    white = wish.luminance
    bright = Figure("lumens", wish.lumens, "lm, of all projectors, on the screen", GIVEN)
    if wish.lumens is None:
        bright = Figure(
            "white_cd_m2",
            white,
            "cd/m², of a small white patch: direct light alone",
            _or_given(wish.white is not None, "chosen: 2 fL, as dome_planetarium"),
        )
    black = (
        f"chosen: {CONTRAST:g} : 1, as dome_planetarium; vendors publish sequential contrasts only"
    )
    yield Part(
        "[viewing]",
        (),
        (
            Figure(
                "adaptation_cd_m2",
                _short(0.1 * white),
                "cd/m², that the eye is adapted to",
                "chosen: a mean picture level of 10 % of white",
            ),
        ),
    )
    yield Part(
        "[projector]",
        (),
        (
            Figure(
                "primaries",
                "BT.709",
                "or P3-D65, BT.2020",
                "chosen: the primaries of most digital domemasters",
            ),
            bright,
            Figure("black_cd_m2", _short(white / CONTRAST), "cd/m², of a whole black frame", black),
        ),
    )
    yield Part(
        "[projector.lens]",
        (),
        (
            Figure(
                "corrected",
                True,
                "whether the projection system evens out falloff and blends",
                "chosen: as by most systems",
            ),
        ),
    )


_PLACES = {
    "cove": "In a cove just under the rim, looking across. Numbered from the back over the right.",
    "ring": "On a level ring under the screen's lowest point. Numbered from the back, right first.",
}


def _units(wish: DomeWish, lenses: Sequence[Lens]) -> Iterator[Part]:
    """Projectors, whose one source is told for all."""
    for number, lens in enumerate(lenses):
        flat = lens.kind == "perspective"
        yield Part(
            "[[projector.units]]",
            () if number else (_PLACES[wish.place],),
            (
                Figure("name", lens.name, "as reports call it", ""),
                Figure("position_m", list(lens.position), "m, of the lens", ""),
                Figure("look_at_m", list(lens.look_at), "m, what it is aimed at", ""),
                Figure("roll_deg", _degrees(lens.roll), "degrees, about its axis", ""),
                Figure(
                    "kind", lens.kind, "a rectangular field" if flat else "a circular field", ""
                ),
                Figure("field_deg", _degrees(lens.field), "degrees, full width of the field", ""),
                *(
                    [Figure("aspect", lens.aspect, "width over height of the field", "")]
                    if flat
                    else []
                ),
                Figure(
                    "blend_deg", _degrees(lens.blend), "degrees, soft edge inside the field", ""
                ),
            ),
        )


# A stereo system.


_COMMENTS = {
    "share": "share of the other eye's light that an eye sees",
    "to_left": "what the left eye sees of the right one's light, rows R, G, B",
    "to_right": "what the right eye sees of the left one's light, rows R, G, B",
    "table.levels": "light, 0 to 1 of white",
    "table.to_left": "added to the left eye's light: its level (row), the other's (column)",
    "table.to_right": "added to the right eye's light: its level (row), the other's (column)",
    "polarisation.lenses_m": "m, of the left and the right eye's projector",
    "polarisation.depolarising_share": "share of the screen that forgets the polarisation",
    "polarisation.roughness": "0.05 to 1: how wide the screen's lobe is",
    "polarisation.projector_leak": "light of the wrong hand, over that of the right hand",
    "polarisation.glasses_leak": "the same, of the glasses",
    "name": "as --seat calls it",
    "position_m": "m, of the head",
    "map": "times the figures above, from left to right on the screen",
    "map_left": "times the figures above, for the left eye, from left to right on the screen",
    "map_right": "the same for the right eye",
}


def _stereo_parts(wish: StereoWish, content: dict[str, Any], known: str) -> Iterator[Part]:
    scale = wish.width / content["screen"]["width_m"]
    shape = content["screen"]["height_m"] / content["screen"]["width_m"]
    distance = round(scale * content["viewing"]["distance_m"], 2)
    away = wish.distance or distance
    yield Part(
        "[screen]",
        (),
        (
            Figure("width_m", wish.width, "m", GIVEN),
            Figure(
                "height_m",
                wish.height or round(shape * wish.width, 3),
                "m",
                _or_given(wish.height is not None, f"chosen: the shape of {known}"),
            ),
        ),
    )
    lit, same = content["projector"], f"chosen: as in {known}"
    white = wish.white or lit["white_cd_m2"]
    yield Part(
        "[projector]",
        ("What an eye sees of its own projector, through the glasses.",),
        (
            Figure("primaries", lit["primaries"], "of the projector", same),
            Figure(
                "white_cd_m2",
                white,
                "cd/m²",
                _or_given(wish.white is not None, f"chosen: as in {known}"),
            ),
            Figure(
                "black_cd_m2",
                _short(white * lit["black_cd_m2"] / lit["white_cd_m2"]),
                "cd/m²",
                f"chosen: the sequential contrast of {known}",
            ),
        ),
    )
    yield Part(
        "[viewing]",
        (),
        (
            Figure(
                "distance_m",
                away,
                "m, from the seat in the middle to the screen",
                _or_given(wish.distance is not None, f"chosen: as many widths as in {known}"),
            ),
            Figure(
                "adaptation_cd_m2",
                content["viewing"]["adaptation_cd_m2"],
                "cd/m², that the eye is adapted to",
                same,
            ),
        ),
    )
    own = {key: value for key, value in content["crosstalk"].items() if not isinstance(value, dict)}
    inner = {key: value for key, value in content["crosstalk"].items() if isinstance(value, dict)}
    if own:
        figures = [Figure(key, value, _COMMENTS[key], "") for key, value in own.items()]
        yield Part("[crosstalk]", (), tuple(figures))
    for name, table in inner.items():
        figures = []
        for key, value in table.items():
            moved = (
                [_scaled(place, scale, away / distance) for place in value]
                if key == "lenses_m"
                else value
            )
            figures.append(Figure(key, moved, _COMMENTS[f"{name}.{key}"], ""))
        yield Part(f"[crosstalk.{name}]", (), tuple(figures))
    for seat in content.get("seats", ()):
        figures = []
        for key, value in seat.items():
            moved = _scaled(value, scale, away / distance) if key == "position_m" else value
            figures.append(Figure(key, moved, _COMMENTS[key], ""))
        yield Part("[[seats]]", (), tuple(figures))


def _scaled(place: Sequence[float], scale: float, further: float) -> list[float]:
    """A place of the bundled cinema in one of another size, whose depth is `further` times that."""
    x, y, z = place
    return [round(scale * x, 2), round(scale * further * y, 2), round(scale * z, 2)]


# Text.


def _written(
    head: Sequence[str], name: str, about: str, parts: Sequence[Part], sources: dict[str, str]
) -> str:
    """The file: every figure with its comment, and all sources at the end."""
    lines = [f"# {line}" for line in head]
    lines += ["", _line("name", name, "as reports call it"), _line("description", about, "")]
    told: dict[str, str] = {}
    for part in parts:
        lines += ["", part.heading, *(f"# {line}" for line in part.advice)]
        lines += [_line(each.key, each.value, each.comment) for each in part.figures]
        told |= {
            f"{part.heading.strip('[]')}.{each.key}": each.source
            for each in part.figures
            if each.source
        }
    lines += ["", "# Where figures are from: given by you, chosen or derived here, or published."]
    return "\n".join([*lines, as_toml({"sources": told | sources}).strip(), ""])


def _line(key: str, value: Any, comment: str) -> str:
    line = as_toml({key: value}).strip()
    if len(line) > _LONG and isinstance(value, list):
        rows = [f"    {as_toml({'': row}).strip().partition(' = ')[2]}," for row in value]
        return "\n".join([f"# {comment}", f"{key} = [", *rows, "]"])
    return f"{line}  # {comment}" if comment else line


def _or_given(given: bool, otherwise: str) -> str:
    return GIVEN if given else otherwise


def _degrees(angle: float) -> float:
    return round(float(np.degrees(angle)), 1)


def _short(value: float) -> float:
    """Rounds to three significant digits."""
    return float(f"{value:.3g}")


def _within(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise InputError(
            f"--{name}: must be {low:g} to {high:g} {unit}".rstrip() + f", got {value:g}"
        )
