"""The compare page: one HTML file in which master and results are looked at, into the dark.

An 8-bit picture has no steps left where light pollution does its harm: from black to 1/100 of
white, sRGB has 25 codes. So the page carries linear light in finer codes
(`compensate.page.packing`), which the browser turns into display codes under the exposure that the
reader chooses. The page is no larger than `BYTES` for up to 1024 x 1024 pixels: noisy pictures get
coarser codes, and the page says how coarse.

Beside the light it carries maps of what is seen of the differences from the master. In a stereo
page each view has two pictures. What two eyes make of a view (their difference, an anaglyph, the
ghost) is computed in the browser, and so is what is seen of a dome from its seats. The page asks
for nothing from outside: style and script are inlined, and its content security policy forbids all
requests.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jinja2 import Environment, StrictUndefined
from numpy.typing import NDArray
from scipy.sparse import csr_array

from compensate.page.packing import (
    FINEST,
    LEAST,
    PER_OCTAVE,
    POWER,
    TILE,
    Packed,
    deflated,
    pack,
    packed_map,
)
from compensate.vision.differences import EXPONENT, JOD, STILL, in_thresholds
from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.pages import hash_of_script
from domesim.light.rounding import ROUNDING
from domesim.room.theatre import Theatre

FloatArray: TypeAlias = NDArray[np.floating[Any]]
Mask: TypeAlias = NDArray[np.bool_]

KINDS = ("master", "seen", "projected")
SCRIPTS = (
    "compare-light.js",
    "compare-stereo.js",
    "compare-plots.js",
    "compare-visible.js",
    "compare-dome.js",
    "compare.js",
)
BYTES = 6_000_000
"""Largest size of a page, bytes, up to 1024 x 1024 pixels; larger pictures get as much a pixel."""
MAP_SIZE = 512
"""Longest side of a map of visible differences, pixels."""


@dataclass(frozen=True)
class View:
    """One picture of the page.

    Attributes
    ----------
    name : str
        What the reader calls it; unique in a page.
    light : (row, col, 3) float32 or float64
        Linear, 1.0 = projector white, in the primaries of the display (BT.709). The left eye's if
        there is a right one's.
    note : str
        One line below the name.
    kind : "master" | "seen" | "projected"
        What should be seen, what is seen, or what the projectors are sent.
    right : (row, col, 3) float32 or float64, optional
        The right eye's light; the views of a page have it all, or none.
    lost : (eye, row, col) float32, optional
        Map of what is seen of the difference from the master, JOD, as of `compensate.ruler`; it may
        have fewer pixels than the light.

    """

    name: str
    light: FloatArray
    note: str = ""
    kind: str = "seen"
    right: FloatArray | None = None
    lost: NDArray[np.floating[Any]] | None = None


@dataclass(frozen=True)
class Figure:
    """A row of the table of figures: one quantity, as text, for each view that has it."""

    name: str
    unit: str
    values: Mapping[str, str]  # view name -> text
    meaning: str = ""  # one plain sentence


def write_page(
    path: str | os.PathLike[str],
    views: Sequence[View],
    *,
    title: str,
    subtitle: str,
    white: float,
    figures: Sequence[Figure] = (),
    facts: Mapping[str, str] = {},
    size: int = 1024,
    mask: Mask | None = None,
    theatre: Theatre | None = None,
) -> None:
    """Write the compare page of `views` to `path`, whole or not at all.

    Parameters
    ----------
    path : path-like
        The HTML file; its folder exists.
    views : sequence of View
        All of one shape, all mono or all stereo. The first of kind "master" is what the others
        are compared with.
    title, subtitle : str
        The page's heading.
    white : float
        Luminance of projector white, cd/m².
    figures : sequence of Figure
        Rows of the table of figures.
    facts : mapping of str to str
        How the page was made: scene, solver status, versions, command line.
    size : int
        The longest side in pixels; larger views are area-averaged in linear light.
    mask : (row, col) bool, optional
        True on the screen. What lies outside is neither shown nor averaged.
    theatre : Theatre, optional
        The dome, of which the views are domemasters: they can then be seen from its seats, and the
        probe also gives the direction in the dome.

    Raises
    ------
    InputError
        If the views cannot be shown together, or the file cannot be written.

    """
    _require_settings(white, size)
    _require_views(views, mask)
    _require_figures(figures, views)
    rows, cols = views[0].light.shape[:2]
    on_screen = np.ones((rows, cols), np.bool_) if mask is None else mask
    eyes = 1 if views[0].right is None else 2
    pictures = [
        _reduce(light, on_screen, size)
        for view in views
        for light in (view.light, view.right)[:eyes]
        if light is not None
    ]
    small_mask = pictures[0][1]
    maps = _maps(views, small_mask)
    scripts = [f"\n{_resource(name)}\n" for name in SCRIPTS]
    html = _environment().from_string(_resource("compare.html.j2"))

    def rendered(packed: Packed) -> bytes:
        data = {
            "rows": small_mask.shape[0],
            "cols": small_mask.shape[1],
            "sourceRows": rows,
            "sourceCols": cols,
            "white": float(white),
            "peak": packed.peak,
            "power": POWER,
            "top": packed.top,
            "tile": TILE,
            "bases": packed.bases,
            "stereo": eyes == 2,
            "dome": None if theatre is None else _dome(theatre),
            "maps": maps.settings,
            "views": [{"name": v.name, "note": v.note, "kind": v.kind} for v in views],
        }
        page = html.render(
            title=title,
            subtitle=subtitle,
            data=data,
            reduced=small_mask.shape != (rows, cols),
            eyes=eyes,
            figures=figures,
            facts=facts,
            style=_resource("compare.css"),
            scripts=scripts,
            hashes=[hash_of_script(script) for script in scripts],
            payloads=packed.payloads,
            maps=maps.payloads,
            mask_payload=deflated(np.packbits(small_mask).tobytes()),
            errors=[(share, 100 * packed.error(share)) for share in (1e-2, 1e-4)],
        )
        return page.encode("utf-8", "replace")  # names of files may be any bytes

    empty = Packed(FINEST, 1.0, ((),) * len(pictures), ("",) * len(pictures))
    pixels = max(1.0, small_mask.size / 1024**2)
    room = BYTES * pixels - len(rendered(empty)) - 1000  # for digits of what is not yet known
    packed = pack([picture for picture, _ in pictures], small_mask, eyes, room)
    write_whole(Path(path), rendered(packed))


@dataclass(frozen=True)
class _Maps:
    """Maps of visible differences, as the page carries them; `settings` is None without any."""

    settings: dict[str, Any] | None
    payloads: list[tuple[int, int, str]]  # view, eye, base64


def _maps(views: Sequence[View], mask: Mask) -> _Maps:
    payloads = []
    size = (0, 0)
    for number, view in enumerate(views):
        for eye, lost in enumerate(() if view.lost is None else view.lost):
            side = min(MAP_SIZE, max(lost.shape))
            everywhere = np.ones(lost.shape, np.bool_)
            small, _ = _reduce(lost[..., None].repeat(3, axis=-1), everywhere, side)
            size = small.shape[:2]
            at = [np.arange(n) * m // n for n, m in zip(size, mask.shape, strict=True)]
            packed = packed_map(in_thresholds(small[..., 0]), mask[np.ix_(*at)])
            payloads.append((number, eye, packed))
    if not payloads:
        return _Maps(None, [])
    settings = {"rows": size[0], "cols": size[1], "least": LEAST, "perOctave": PER_OCTAVE}
    return _Maps(settings | {"jod": JOD, "exponent": EXPONENT, "still": STILL}, payloads)


def _dome(theatre: Theatre) -> dict[str, Any]:
    """What a picture from a seat is computed of, in the room's frame: m and degrees."""
    dome, floor, wall = theatre.dome, theatre.floor, theatre.wall
    seats = [
        {
            "name": name,
            "eye": [round(float(x), 4) for x in place.position],
            "lookAt": [round(float(x), 4) for x in place.look_at],
            "field": round(float(np.degrees(place.field)), 3),
        }
        for name, place in theatre.viewpoints.items()
    ]
    return {
        "radius": dome.radius,
        "halfAngle": float(np.degrees(dome.half_angle)),
        "tilt": float(np.degrees(dome.tilt)),
        "heightRatio": dome.height_ratio,
        "truncatedBelow": dome.truncated_below,
        "floor": None if floor is None else [float(floor.height), float(floor.radius)],
        "wall": None if wall is None else [float(wall.radius), float(wall.bottom), float(wall.top)],
        "gain": not theatre.lambertian,
        "seats": seats,
    }


def _require_settings(white: float, size: int) -> None:
    if not (np.isfinite(white) and white > 0):
        raise InputError(f"the compare page takes projector white > 0 cd/m², got {white}")
    if size < 16:
        raise InputError(f"the compare page takes a size of at least 16 pixels, got {size}")


def _require_views(views: Sequence[View], mask: Mask | None) -> None:
    if not views:
        raise InputError("the compare page needs at least one view, got none")
    names = [view.name for view in views]
    if len(set(names)) < len(names):
        raise InputError(f"the compare page needs a different name for each view, got {names}")
    first = views[0]
    if first.light.ndim != 3 or first.light.shape[2] != 3 or first.light.size == 0:
        raise InputError(
            f"view {first.name!r} must have axes (row, col, 3), got shape {first.light.shape}"
        )
    if mask is not None and (mask.dtype != np.bool_ or mask.shape != first.light.shape[:2]):
        raise InputError(
            f"the mask must be bool {first.light.shape[:2]}, got {mask.dtype} {mask.shape}"
        )
    if mask is not None and not mask.any():
        raise InputError("the mask must be True somewhere on the screen, got False everywhere")
    mono = [view.name for view in views if view.right is None]
    if 0 < len(mono) < len(views):
        raise InputError(
            f"the views of a compare page must all have a right eye's picture or none, got {mono} "
            "without"
        )
    for view in views:
        if view.kind not in KINDS:
            raise InputError(
                f"view {view.name!r} must be of kind {' | '.join(KINDS)}, got {view.kind}"
            )
        _require_light(f"view {view.name!r}", view.light, first.light.shape, mask)
        if view.right is not None:
            _require_light(f"view {view.name!r}, right eye,", view.right, first.light.shape, mask)
        if view.lost is not None:
            _require_map(view, 1 if view.right is None else 2)


def _require_light(who: str, light: FloatArray, shape: tuple[int, ...], mask: Mask | None) -> None:
    if light.shape != shape:
        raise InputError(
            f"{who} must have the first view's shape {shape}, got {light.shape}; resample it first"
        )
    if not np.issubdtype(light.dtype, np.floating):
        raise InputError(
            f"{who} must be float32 or float64 linear light, got {light.dtype}; "
            "decode its code values first"
        )
    lit = light if mask is None else light[mask]
    if not np.isfinite(lit).all():
        raise InputError(f"{who} must be finite on the screen, got NaN or infinity")
    if lit.min() < -ROUNDING:
        raise InputError(f"{who} must be light >= 0, got {lit.min():.3g}")


def _require_map(view: View, eyes: int) -> None:
    lost = view.lost
    assert lost is not None
    if lost.ndim != 3 or len(lost) != eyes or lost.size == 0:
        raise InputError(
            f"view {view.name!r} must have a map ({eyes}, row, col), got shape {lost.shape}"
        )
    if not (np.isfinite(lost).all() and lost.min() >= 0):
        raise InputError(f"view {view.name!r} must have a map of finite differences >= 0")


def _require_figures(figures: Sequence[Figure], views: Sequence[View]) -> None:
    names = {view.name for view in views}
    for figure in figures:
        strangers = set(figure.values) - names
        if strangers:
            raise InputError(
                f"figure {figure.name!r} must give values for views of the page, "
                f"got {sorted(strangers)}"
            )


def _reduce(light: FloatArray, mask: Mask, size: int) -> tuple[NDArray[np.float32], Mask]:
    """Average `light` over the area of larger pixels, `size` on the longest side.

    Only what is on the screen counts, so that its rim does not darken; a pixel of the reduced
    mask is one that lies on the screen by half or more.
    """
    lit = np.where(mask[:, :, None], np.maximum(light, 0), 0).astype(np.float32)
    rows, cols = mask.shape
    scale = size / max(rows, cols)
    if scale >= 1:
        return lit, mask
    vertical = _averaging(rows, max(1, round(rows * scale)))
    horizontal = _averaging(cols, max(1, round(cols * scale)))

    def average(plane: NDArray[np.float32]) -> NDArray[np.float32]:
        reduced: NDArray[np.float32] = (horizontal @ (vertical @ plane).T).T
        return reduced

    coverage = average(mask.astype(np.float32))
    # A dome that is thinner than a pixel everywhere would otherwise vanish.
    small_mask: Mask = coverage >= min(0.5, float(coverage.max()))
    total = np.stack([average(lit[:, :, primary]) for primary in range(3)], axis=-1)
    reduced = np.where(small_mask[..., None], total / np.maximum(coverage, 1e-6)[..., None], 0)
    return reduced.astype(np.float32), small_mask


def _averaging(before: int, after: int) -> csr_array[Any, tuple[int, int]]:
    """Return (after, before) weights: each new pixel's share of each old one, rows summing to 1."""
    edges = np.linspace(0, before, after + 1)
    first = np.floor(edges[:-1]).astype(int)
    reach = int(np.ceil(before / after)) + 1
    old = first[:, None] + np.arange(reach)
    overlap = np.minimum(old + 1, edges[1:, None]) - np.maximum(old, edges[:-1, None])
    weight = np.clip(overlap, 0, None) * (after / before)
    new = np.broadcast_to(np.arange(after)[:, None], old.shape)
    inside = weight > 0
    inside &= old < before
    return csr_array(
        (weight[inside].astype(np.float32), (new[inside], old[inside])), shape=(after, before)
    )


def _environment() -> Environment:
    return Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )


def _resource(name: str) -> str:
    return files("compensate.page").joinpath("templates", name).read_text(encoding="utf-8")
