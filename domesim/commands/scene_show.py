"""``domesim scene show``: a page that shows a theatre, to whoever wrote its scene file."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import numpy as np
import typer
from numpy.typing import NDArray

from domesim.commands.options import Json, Overwrite, Quiet, TransportFile
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.numbers import decimal
from domesim.host.writing import prepare, write_whole
from domesim.inspection import lightmaps
from domesim.inspection.contrast import contrast
from domesim.inspection.coverage import coverage, require_covered
from domesim.inspection.gamuts import colours_of, gamut_drawing
from domesim.inspection.magnitudes import (
    SOURCES,
    projected_star,
    sky_brightness,
    video_star,
)
from domesim.inspection.photometry import Photometry, ghost, photometry
from domesim.inspection.plans import (
    dome_plan,
    dome_section,
    flat_plan,
    flat_section,
)
from domesim.library import load_master
from domesim.light import Light, transfer
from domesim.observation.spherical import bare_gain
from domesim.readings.colorimetry import Colours
from domesim.room.theatre import Theatre, Viewpoint
from domesim.scene import DomeScene, FlatScene, Scene, StereoScene
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import mean_luminance

_VIEW = 300  # pixels across, of what a seat sees
_CUTAWAY = (1080, 720)
_SAMPLES = 16
_MASTER = "the bundled night scene"


def show(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="The scene: its name, or the path of a .toml file.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", help="The page to write: a .html file.", show_default=False)
    ],
    transport: TransportFile = None,
    cutaway: Annotated[
        bool,
        typer.Option(
            "--cutaway/--no-cutaway", help="Domes: render the theatre cut open (about a minute)."
        ),
    ] = True,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show a theatre: plan, section, what seats see, its light, and what the model leaves out."""
    console = Console(quiet=quiet, json=json)
    if out.suffix.lower() != ".html":
        raise InputError(f"--out {out}: the page is a .html, name it so")
    theatre = SceneChoice(scene, transport).load()
    prepare(out, inputs=[scene, transport], overwrite=overwrite)
    if isinstance(theatre, DomeScene):
        require_covered(theatre, scene)
        content, figures = _dome(theatre.one_eye, console, cutaway=cutaway)
    else:
        assert isinstance(theatre, FlatScene)
        content, figures = _flat(theatre)
    write_whole(out, _page(theatre, content).encode())
    console.say(f"  -> {out}")
    console.figures({"scene": theatre.name, "output": str(out)} | figures)


class Row(NamedTuple):
    """A row of a table of figures: what, how much, in what unit, and what it means."""

    key: str
    what: str
    value: float | None
    unit: str
    meaning: str

    @property
    def shown(self) -> str:
        """With three digits, or as many as are before the point."""
        if self.value is None:
            return "∞"
        text = f"{self.value:,.0f}" if abs(self.value) >= 1000 else decimal(self.value)
        return text.replace(",", "\u202f")


class View(NamedTuple):
    """What one place sees."""

    number: int
    title: str
    name: str
    image: str
    words: str


# Domes.


def _dome(
    scene: DomeScene, console: Console, *, cutaway: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    light = photometry(scene, lightmaps.SIZE)
    maps = lightmaps.pictures(coverage(scene.theatre, lightmaps.SIZE), light)
    master, seen, means = _night(scene)
    places = marked(scene.theatre)
    traces = _traces(console)
    tables, figures = _dome_tables(scene, light, means)
    content = {
        "tables": tables,
        "cutaway": _cut_open(scene, master, console) if cutaway and traces else None,
        "drawings": [
            ("Plan, from above", dome_plan(scene, places)),
            ("Section, from the right", dome_section(scene, places)),
            ("Gamut, CIE 1976 u'v'", gamut_drawing(colours_of(scene.projector))),
        ],
        "maps": [_url(each, "png") for each in maps],
        "views": _views(scene, seen, places) if traces else [],
        "left_out": _left_out(scene),
        "master": _MASTER,
    }
    return content, figures


def _traces(console: Console) -> bool:
    """Whether rays can be traced; if not, it says why."""
    from domesim.pathtrace.llvm import load_mitsuba  # noqa: PLC0415 - slow to import

    try:
        load_mitsuba()
    except InputError as fault:
        console.say(str(fault), "The page is without the views of seats and the theatre cut open")
        return False
    return True


def marked(theatre: Theatre) -> dict[str, Viewpoint]:
    """The places whose view is shown: corners and middles of the seats, and what has a name."""
    seats = theatre.seats
    rows: dict[float, list[str]] = {}
    for name, view in seats.items():
        rows.setdefault(view.position[1], []).append(name)
    ordered = [rows[y] for y in sorted(rows, reverse=True)]
    chosen: dict[str, Viewpoint] = {}
    for row in dict.fromkeys((0, len(ordered) // 2, len(ordered) - 1)) if ordered else ():
        across = sorted(ordered[row], key=lambda name: seats[name].position[0])
        for name in dict.fromkeys((across[0], across[len(across) // 2], across[-1])):
            chosen[name] = seats[name]
    named = {
        name: view
        for name, view in theatre.viewpoints.items()
        if name not in seats and not (seats and name in ("front", "centre", "back"))
    }
    if chosen or named:
        return chosen | named
    dome = theatre.dome
    ahead = dome.surface(np.array(dome.half_angle / 2), np.array(np.pi / 2)) @ dome.to_room.T
    return {
        "centre of the dome": Viewpoint(
            (0.0, 0.0, 0.0), (float(ahead[0]), float(ahead[1]), float(ahead[2]))
        )
    }


def _night(scene: DomeScene) -> tuple[Light, Light, dict[str, float]]:
    """The bundled scene: its light, what is seen of it, and means in cd/m²."""
    path = resources.files("scenes").joinpath("masters", "night.exr")
    master, _ = load_master(str(path), scene)
    observation = scene.observation(*master.shape[1:3])
    seen, direct = observation.observe(master), observation.direct(master)
    means = {
        "picture_direct_cd_m2": mean_luminance(direct, scene),
        "picture_pollution_cd_m2": mean_luminance(seen - direct, scene),
    }
    return master, seen, means


def _dome_tables(
    scene: DomeScene, light: Photometry, means: Mapping[str, float]
) -> tuple[list[tuple[str, list[Row]]], dict[str, Any]]:
    dome, theatre, figures = scene.dome, scene.theatre, light.figures()
    weights = scene.projector.luminance_weights
    mean = np.asarray(scene.albedo) * theatre.mean_paint
    albedo = float(weights @ mean)
    closed = float(weights @ [bare_gain(rho, dome) for rho in mean])
    room = [
        Row("radius_m", "Radius of the sphere", dome.radius, "m", ""),
        Row("screen_m2", "Area of the screen", dome.screen_area, "m²", ""),
        Row("tilt_deg", "Lean to the front", float(np.degrees(dome.tilt)), "°", ""),
        Row("albedo", "Albedo of the screen", albedo, "", "its holes counted in"),
    ]
    if light.albedo is not None:
        room += [
            Row("albedo_least", "least, by its map", figures["albedo_least"], "", "of a primary"),
            Row("albedo_most", "largest", figures["albedo_most"], "", "of a primary"),
        ]
    if theatre.lobe is not None and theatre.lobe.share > 0:
        share = theatre.lobe.share
        room.append(Row("lobe_share", "Of it in a gain lobe", 100 * share, "%", ""))
    room += [
        Row("projectors", "Projectors", max(1, len(theatre.lenses)), "", ""),
        Row("seats", "Seats", len(theatre.seats), "", "that have room"),
    ]
    names = {
        "white_direct_cd_m2": ("White, direct light", "cd/m²", "a small white patch, nearly"),
        "white_reflected_cd_m2": ("reflected light", "cd/m²", "what a white frame adds by itself"),
        "white_frame_cd_m2": ("White frame", "cd/m²", "all together"),
        "black_frame_cd_m2": ("Black level", "cd/m²", "a black frame, stray light included"),
        "sequential_contrast": ("Sequential contrast", ": 1", "a white frame over a black one"),
        "checkerboard_lit_cd_m2": ("Checkerboard, white fields", "cd/m²", "12 × 4 fields"),
        "checkerboard_dark_cd_m2": ("black fields", "cd/m²", "reflected light, mostly"),
        "checkerboard_contrast": ("Contrast by the checkerboard", ": 1", "as ANSI contrast"),
        "white_unevenness": ("Unevenness of white", ": 1", "brightest over darkest place"),
        "lumens": ("Flux of white", "lm", "on the screen, all projectors"),
    }
    rows = [Row(key, what, figures[key], unit, why) for key, (what, unit, why) in names.items()]
    pictures = [
        Row("picture_direct_cd_m2", "Night scene, direct", means["picture_direct_cd_m2"], "cd/m²",
            "mean over the screen"),
        Row("picture_pollution_cd_m2", "reflected and stray",
            means["picture_pollution_cd_m2"], "cd/m²", ""),
        Row("closed_form_share", "Reflected over direct light", 100 * closed, "%",
            "of white, by the closed form of the bare screen"),
        Row("reflected_share", "the same, as observed here",
            100 * light.reflected / light.direct, "%",
            "of white" if scene.known is None else "of white, by the room's transport"),
    ]  # fmt: skip
    tables = [("Light", rows), ("The room", room), ("Averages", pictures)]
    tables.append(("Colours", _colours(colours_of(scene.projector))))
    tables.append(("Sky and stars", _stars(scene, light.black, means["picture_pollution_cd_m2"])))
    return tables, {row.key: row.value for _, rows in tables for row in rows}


def _colours(colours: Colours) -> list[Row]:
    """White and gamut of a projector."""
    figures = colours.figures()
    rows = [
        Row("white_cct_k", "White, colour temperature", figures["white_cct_k"], "K", "Ohno 2013"),
        Row("white_duv", "beside Planck's locus", figures["white_duv"], "Duv", "+ is greener"),
        Row("white_from_d65_delta_e_2000", "White from D65", figures["white_from_d65_delta_e_2000"],
            "", "Delta E 2000"),
        Row("white_from_d65_delta_e_itp", "the same", figures["white_from_d65_delta_e_itp"],
            "", "Delta E ITP"),
    ]  # fmt: skip
    return rows + [
        Row(f"coverage {name}", f"Gamut covers {name}", 100 * share, "%", "by area in u'v'")
        for name, share in colours.coverage.items()
    ]


def _stars(scene: DomeScene, black: float, polluted: float) -> list[Row]:
    """How dark a sky of black can be, alone and under the night scene, in magnitudes."""
    alone, under = (video_star(scene, luminance, 0.0) for luminance in (black, polluted))
    rows = []
    for key, place, luminance, faintest in (
        ("black_sky", "Black frame", black, alone),
        ("night_sky", "Black in the night scene", polluted, under),
    ):
        brightness = sky_brightness(luminance)
        told = brightness if np.isfinite(brightness) else None
        rows += [
            Row(f"{key}_mag_arcsec2", place, told, "mag/arcsec²", "more is darker"),
            Row(f"{key}_faintest_star", "faintest star", faintest.crumey, "mag",
                f"a point; {faintest.told} by {SOURCES}"),
        ]  # fmt: skip
    factor = 10 ** (0.4 * (alone.crumey - under.crumey))
    rows.append(Row("stars_brighter", "Stars must be brighter by", factor, "times",
                    "than over a black frame, to be seen in the night scene"))  # fmt: skip
    return rows + _projected(scene, black, polluted)


def _projected(scene: DomeScene, black: float, polluted: float) -> list[Row]:
    """What the video takes from a star projector beside it."""
    stray = max(0.0, scene.ambient - scene.projector.black)
    off, *beside = (projected_star(scene, light) for light in (stray, black, polluted))
    if off is None:
        return []
    rows = [Row("star_projector", "Star projector, video off", off.crumey, "mag", "")]
    for key, what, seen in zip(
        ("black", "night"), ("beside a black frame", "beside the night scene"), beside, strict=True
    ):
        assert seen is not None  # as it is with the video off
        taken = off.crumey - seen.crumey
        why = f"{seen.told} by {SOURCES}; the video takes {taken:.1f}"
        rows.append(Row(f"star_projector_{key}", what, seen.crumey, "mag", why))
    return rows


def _views(scene: DomeScene, seen: Light, places: Mapping[str, Viewpoint]) -> list[View]:
    from domesim.pathtrace.glance import glance  # noqa: PLC0415 - not for other commands

    light = np.asarray(scene.projector.to_display(seen)[0])
    views = []
    for number, (name, place) in enumerate(places.items(), 1):
        view = glance(scene.theatre, light, place, _VIEW)
        x, y, z = place.position
        words = f"{view.screen_share:.0%} of the view is screen; eye at {x:.2f}, {y:.2f}, {z:.2f} m"
        title = name.replace("row", "row ").replace("-seat", ", seat ")
        views.append(View(number, title, name, _jpeg(view.picture), words))
    return views


def _cut_open(scene: DomeScene, master: Light, console: Console) -> str:
    from domesim.pathtrace.cutaway import cutaway  # noqa: PLC0415 - loads Mitsuba

    console.say("Rendering the theatre cut open (about a minute; --no-cutaway leaves it out)")
    shown = np.clip(scene.projector.to_display(master)[0], 0, 1)
    width, height = _CUTAWAY
    return _jpeg(cutaway(scene.theatre, shown, width=width, height=height, samples=_SAMPLES))


def _left_out(scene: DomeScene) -> dict[str, Any]:
    """What the observation of a theatre does not know, and what to do about it."""
    if scene.transport is not None:
        approximation = scene.approximation
        return {
            "by": "a stored transport of the whole theatre",
            "reasons": [] if approximation is None else [approximation],
            "way": None,
        }
    by_hand = scene.known is None
    return {
        "by": "the closed form of the bare screen" if by_hand else "radiosity of the bare room",
        "reasons": list(scene.left_out),
        "way": f"domesim tabulate {scene.argument} --out room.npz",
        "then": f"domesim scene show {scene.argument} --transport room.npz --out room.html",
    }


# 3D screens.


def _flat(scene: FlatScene) -> tuple[dict[str, Any], dict[str, Any]]:
    lit = scene.projector
    width, height = scene.size
    glasses = "through the glasses" if scene.views > 1 else ""
    rows = [
        Row("width_m", "Width of the screen", width, "m", ""),
        Row("height_m", "Height", height, "m", ""),
        Row("distance_m", "Viewing distance", scene.viewing.distance, "m", ""),
        Row("white_cd_m2", "White", lit.white, "cd/m²", glasses),
        Row("black_cd_m2", "Black level", lit.black, "cd/m²", glasses),
    ]  # fmt: skip
    colours = colours_of(scene.projector)
    tables = [("The system", rows), ("Colours", _colours(colours))]
    if scene.way is not None:
        tables.append(("System contrast", _contrast(scene)))
    else:
        sequential = lit.white / lit.black if lit.black > 0 else None
        rows.append(Row("sequential_contrast", "Sequential contrast", sequential, ": 1", ""))
    seats = _seats(scene) if isinstance(scene, StereoScene) else []
    figures = {row.key: row.value for _, each in tables for row in each}
    figures |= {f"crosstalk {seat['name']}": seat["mean"] for seat in seats}
    drawn = list(scene.places)
    content = {
        "tables": tables,
        "drawings": [
            ("Plan, from above", flat_plan(scene)),
            ("Section, from the side", flat_section(scene)),
            ("Gamut, CIE 1976 u'v'", gamut_drawing(colours)),
        ],
        "seats": seats,
        "placed": isinstance(scene, StereoScene) and scene.theatre is not None,
        "drawn": drawn,
        "crosstalk": scene.facts().get("Crosstalk"),
    }
    return content, figures


def _seats(scene: StereoScene) -> list[dict[str, Any]]:
    """Crosstalk at each seat, for the page."""
    seats = []
    for number, name in enumerate(scene.seats, 1):
        crosstalk = ghost(scene, name)
        mean, most = float(crosstalk.shares.mean()), float(crosstalk.shares.max())
        seats.append(
            {
                "number": number,
                "name": name,
                "mean": mean,
                "most": most,
                "matrices": crosstalk.matrices.tolist(),
                "maps": [_cells(eye, most) for eye in crosstalk.shares],
            }
        )
    return seats


def _contrast(scene: FlatScene) -> list[Row]:
    measured = contrast(scene)
    figures = measured.figures()
    parts = [
        Row(f"ansi_black {name}", name, light, "cd/m²", f"{measured.share(name):.0%} of that")
        for name, light in measured.parts.items()
    ]
    return [
        Row("sequential_contrast", "Sequential contrast", measured.sequential, ": 1",
            "a full white frame over a full black one"),
        Row("ansi_contrast", "ANSI contrast", measured.ansi, ": 1", "16 fields, in the room"),
        *(Row(key, what, cast("float", figures[key]), "cd/m²", "") for key, what in (
            ("ansi_white_cd_m2", "White fields"), ("ansi_black_cd_m2", "Black fields"))),
        *parts,
    ]  # fmt: skip


def _cells(shares: NDArray[np.float64], most: float) -> list[tuple[int, int, float, float]]:
    """(col, row, depth of the colour 0..1, share) of each cell of a map."""
    scale = max(most, 1e-12)
    return [
        (col, row, float(np.clip(shares[row, col] / scale, 0, 1)), float(shares[row, col]))
        for row in range(shares.shape[0])
        for col in range(shares.shape[1])
    ]


# The page.


def _page(scene: Scene, content: dict[str, Any]) -> str:
    import jinja2  # noqa: PLC0415 - slow to import

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    folder = resources.files("domesim.commands").joinpath("templates")
    template = environment.from_string(folder.joinpath("show.html.j2").read_text("utf-8"))
    style = folder.joinpath("show.css").read_text("utf-8")
    dome = isinstance(scene, DomeScene)
    return template.render(scene=scene, dome=dome, style=style, facts=scene.facts(), **content)


def _jpeg(picture: NDArray[np.floating]) -> str:
    """A data URL of display-linear light (row, col, rgb)."""
    from PIL import Image  # noqa: PLC0415 - few commands need it

    codes = transfer.SRGB().encode(np.clip(np.asarray(picture, np.float32), 0, 1))
    stored = io.BytesIO()
    image = Image.fromarray(np.round(codes * 255).astype(np.uint8))
    image.save(stored, "JPEG", quality=88, optimize=True)
    return _url(stored.getvalue(), "jpeg")


def _url(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
