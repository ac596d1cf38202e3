"""Projectors and their blends as calibration programs exchange them: MPCDI (VESA, 2.0).

A file is a zip of ``mpcdi.xml`` and what it names: for each projector ("region") an alpha map, a
PNG of what share of its light each pixel sends, a beta map, a PNG of how far it lifts black (a
picture x is sent as α x (1 - β) + β, in light), and a geometry warp, a PFM of where on the screen
each pixel lands. Profile "sl" says where a projector stands (``coordinateFrame``, whose axes of
yaw, pitch and roll are down, right and forward), how it is turned, and between which angles its
light leaves it (``frustum``). Yaw is to the right, pitch up, roll clockwise as the projector sees
it, in this order.
"""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError, reason
from domesim.host.files import read_plain
from domesim.room.beams import lands, on_screen
from domesim.room.dome import Dome
from domesim.room.lenses import field_edges, field_weight, lens_frame
from domesim.room.masks import UPLIFT_GAMMA, grey_of, thinned, written_mask
from domesim.room.theatre import Lens, Mask, Theatre
from domesim.room.unlit import uplift

Floats = NDArray[np.float64]

PROFILE = "sl"
_LARGEST = 1 << 27
"""Bytes of a file, and of each that is in it, unpacked: a warp of 4K has 100 million."""
_PACKED = 16  # times that real masks and warps are packed, at most
_LARGEST_XML = 1 << 22
_TOGETHER = 1 << 27
"""Bytes that masks and warps of all projectors take, unpacked, unless the file itself is large."""
_UNITS = {"mm": 1e-3, "cm": 1e-2, "dm": 0.1, "m": 1.0, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
_FAR = 1e9  # m; no projector reaches so far
_ANGLES = ("leftAngle", "rightAngle", "downAngle", "upAngle")
_STRAIGHT = 0.5  # pixels that a warp may be off an ideal lens, and be taken for one
_STEPS = 12  # of finding which pixel lands at a place


@final
@dataclass(frozen=True, eq=False)
class Region:
    """One projector.

    Parameters
    ----------
    name
        What it is called.
    size
        Columns and rows of its picture.
    lens
        Where it stands, m, how it is turned, and its field, in the file's own frame, x to the
        right, y to the front and z up. With a mask if the file has an alpha map, and with an uplift
        if it has a beta map.
    points
        (row, col, xyz) where its pixels land, m, in that frame; None if the file does not say. Not
        finite where they land nowhere.
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    points: Floats | None


# Reading.


def read_mpcdi(path: Path) -> tuple[Region, ...]:
    """The projectors of a file: the zip, or its XML alone.

    Raises
    ------
    InputError
        If it cannot be read, or is of another profile or without what is needed.
    """
    try:
        content = read_plain(path, _LARGEST)
    except OSError as error:
        raise InputError(f"{path}: wanted an MPCDI file, got '{reason(error)}'") from error
    package = _Package(path, content)
    root = package.root()
    profile = root.get("profile", "").lower()
    if profile != PROFILE:
        raise InputError(
            f"{path}: wanted profile 'sl' (shader lamps), which says where projectors stand, got "
            f"'{profile}'. Export it with that profile."
        )
    files = {each.get("region", ""): each for each in root.iter("fileset")}
    regions = tuple(
        _region(package, node, files.get(node.get("id", "")))
        for display in root.iter("display")
        for node in display.iter("region")
    )
    if not regions:
        raise InputError(f"{path}: wanted regions, one for each projector, got none")
    names = [region.name for region in regions]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: wanted a name for each projector, got {', '.join(names)}")
    return regions


@final
class _Package:
    """A file, and what is in it by name, whatever its case."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self._content = path, content
        self._left = max(_TOGETHER, _PACKED * len(content))
        self._zip: zipfile.ZipFile | None = None
        self._names: dict[str, str] = {}
        if content[:2] == b"PK":
            try:
                self._zip = zipfile.ZipFile(io.BytesIO(content))
            except Exception as error:  # whatever its parsing runs into
                raise self.damaged("a zip that does not open") from error
            self._names = {name.lower(): name for name in self._zip.namelist()}

    def damaged(self, got: str) -> InputError:
        return InputError(f"{self.path}: wanted a whole MPCDI file, got {got}. Export it again.")

    def take(self, size: int) -> None:
        """Count bytes that one of its files takes."""
        self._left -= size
        if self._left < 0:
            raise self.damaged("masks and warps of more bytes than a file of its size holds")

    def read(self, name: str, largest: int = _LARGEST) -> bytes:
        """What is in the package under that name."""
        key = name.replace("\\", "/").lower()
        if self._zip is None or key not in self._names:
            raise self.damaged(f"no {name} in it")
        info = self._zip.getinfo(self._names[key])
        if info.file_size > largest:
            raise self.damaged(f"{info.file_size} bytes of {name}")
        try:
            with self._zip.open(info) as inner:
                return inner.read(largest)  # a header may say less than there is
        except Exception as error:  # zipfile raises whatever its parsing runs into
            raise self.damaged(f"{name} that does not unpack") from error

    def root(self) -> ET.Element:
        """The XML's, with attributes in lower case: programs write xResolution and Xresolution."""
        content = self._content
        if self._zip is not None:
            roots = [name for name in self._names if name.endswith(".xml")]
            best = "mpcdi.xml" if "mpcdi.xml" in roots else next(iter(roots), "mpcdi.xml")
            content = self.read(best, _LARGEST_XML)
        if len(content) > _LARGEST_XML:
            raise self.damaged(f"{len(content)} bytes of XML")
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise self.damaged("XML with a document type")
        try:
            root = ET.fromstring(content)
        except (ET.ParseError, ValueError, LookupError) as error:
            raise self.damaged("XML that does not parse") from error
        if root.tag.lower() != "mpcdi":
            raise self.damaged("XML of something else")
        for node in root.iter():
            lower = {key.lower(): value for key, value in node.attrib.items()}
            node.attrib.clear()
            node.attrib.update(lower)
        return root


def _region(package: _Package, node: ET.Element, files: ET.Element | None) -> Region:
    name = node.get("id", "")
    where = f"region '{name}'"
    size = tuple(
        int(_number(package, node.get(f"{axis}resolution"), f"{axis}Resolution of {where}"))
        for axis in "xy"
    )
    if min(size) < 1 or max(size) > 1 << 16:
        raise package.damaged(f"{size[0]} x {size[1]} px of {where}")
    frame, frustum = node.find("coordinateFrame"), node.find("frustum")
    if frame is None or frustum is None:
        raise InputError(
            f"{package.path}: wanted a coordinateFrame and a frustum for each projector, got none "
            f"for {where}. Export it with them."
        )
    turn = _axes(package, frame, where)
    position = turn @ _vector(package, frame, "pos", where)
    angles = [_degrees(package, frustum, each, where) for each in ("yaw", "pitch", "roll")]
    left, right, down, up = (
        float(np.tan(_degrees(package, frustum, each, where))) for each in _ANGLES
    )
    low, high = np.array([left, down]), np.array([right, up])
    wide = max(abs(np.degrees(np.arctan([*low, *high]))))
    if not (low < high).all() or wide > 85:
        raise InputError(
            f"{package.path}: wanted a field of less than 85 degrees to each side for {where}, its "
            f"edges in order, got {_told(frustum)}. A fisheye cannot be told in MPCDI."
        )
    half = (high - low) / 2
    shift = (high + low) / (high - low)
    plain = _lens(name, position, _turned(angles), half, (float(shift[0]), float(shift[1])))
    points = None if files is None else _points(package, files, turn, where)
    maps = {
        kind: None if files is None else _map(package, files, kind, where)
        for kind in ("alphaMap", "betaMap")
    }
    mask, lift = (
        None if found is None else Mask(_over_field(found, points, plain))
        for found in maps.values()
    )
    return Region(name, (size[0], size[1]), replace(plain, mask=mask, uplift=lift), points)


def _told(frustum: ET.Element) -> str:
    return ", ".join(f"{each} {frustum.findtext(each, '?').strip()[:20]}" for each in _ANGLES)


def _lens(
    name: str,
    position: Floats,
    axes: tuple[Floats, Floats],
    half: Floats,
    shift: tuple[float, float],
) -> Lens:
    """A lens whose right and forward are `axes`, and half of its field `half`, 1 m ahead."""
    right, forward = axes
    ahead = position + forward
    plain = Lens(name, _place(position), _place(ahead), kind="perspective")
    level, up, _ = lens_frame(plain)
    return Lens(
        name,
        plain.position,
        plain.look_at,
        float(np.arctan2(right @ up, right @ level)),
        "perspective",
        float(2 * np.arctan(half[0])),
        float(half[0] / half[1]),
        shift=shift,
    )


def _place(point: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


def _turned(angles: Sequence[float]) -> tuple[Floats, Floats]:
    """Right and forward of a projector after yaw, pitch and roll."""
    (c, s), (cp, sp), (cr, sr) = ((np.cos(each), np.sin(each)) for each in angles)
    forward = np.array([s * cp, c * cp, sp])
    right = np.array([c, -s, 0.0])
    return cr * right - sr * np.cross(right, forward), forward


def _axes(package: _Package, frame: ET.Element, where: str) -> Floats:
    """(3, 3) from the file's coordinates to x right, y front and z up."""
    down, right, forward = (
        _vector(package, frame, each, where) for each in ("yaw", "pitch", "roll")
    )
    turn = np.stack([right, forward, -down])
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3:
        raise package.damaged(f"axes of {where} that are not at right angles, and 1 long")
    return turn


def _vector(package: _Package, node: ET.Element, name: str, where: str) -> Floats:
    return np.array([
        _number(package, node.findtext(f"{name}{axis}"), f"{name}{axis} of {where}")
        for axis in "xyz"
    ])  # fmt: skip


def _degrees(package: _Package, node: ET.Element, name: str, where: str) -> float:
    return float(np.radians(_number(package, node.findtext(name), f"{name} of {where}")))


def _number(package: _Package, text: str | None, what: str) -> float:
    try:
        value = float((text or "").strip())
    except ValueError:
        value = np.nan
    if not abs(value) < _FAR:
        raise package.damaged(f"'{(text or '').strip()[:40]}' for {what}")
    return value


def _named(files: ET.Element, kind: str) -> tuple[ET.Element, str] | None:
    """A file of that kind, and its path; None if there is none."""
    node = files.find(kind)
    path = "" if node is None else (node.findtext("path") or "").strip()
    return None if node is None or not path else (node, path)


def _map(package: _Package, files: ET.Element, kind: str, where: str) -> Floats | None:
    """(row, col) share of light: the codes to the power of the gamma that is in the alpha map's.

    The standard names no gamma of beta maps. Epic's nDisplay takes that of the alpha map, too.
    """
    found = _named(files, kind)
    if found is None:
        return None
    _, name = found
    text = files.findtext("alphaMap/gammaEmbedded") or "1"
    gamma = _number(package, text, f"gammaEmbedded of {where}")
    if not 0.1 <= gamma <= 10:
        raise package.damaged(f"a gamma of {gamma:g} for {where}")
    codes = grey_of(package.read(name), f"{package.path}: {name}")
    package.take(codes.nbytes)
    return np.asarray(codes**gamma)


def _points(package: _Package, files: ET.Element, turn: Floats, where: str) -> Floats | None:
    found = _named(files, "geometryWarpFile")
    if found is None or not found[1].lower().endswith(".pfm"):
        return None
    node, name = found
    unit = (node.findtext("geometricUnit") or "m").strip().lower()
    if unit not in _UNITS:
        raise package.damaged(f"lengths in '{unit[:20]}' for {where}")
    return np.asarray(_pfm(package, name) @ (turn.T * _UNITS[unit]))


_PFM = re.compile(rb"PF\s+([0-9]{1,5})\s+([0-9]{1,5})\s+(-?[0-9.eE+-]{1,20})\s")


def _pfm(package: _Package, name: str) -> Floats:
    """(row, col, 3): rows are stored from the bottom up; a negative scale is little-endian."""
    content = package.read(name)
    head = _PFM.match(content[:100])
    if head is None:
        raise package.damaged(f"{name}, which is no PFM of three channels")
    cols, rows = int(head[1]), int(head[2])
    if len(content) - head.end() < rows * cols * 12 or not rows * cols:
        raise package.damaged(f"{name} that ends early")
    order = "<" if head[3].startswith(b"-") else ">"
    values = np.frombuffer(content, f"{order}f4", rows * cols * 3, head.end())
    with np.errstate(invalid="ignore"):  # NaN of any kind: no light lands anywhere
        places = thinned(values.reshape(rows, cols, 3)[::-1]).astype(np.float64)
    package.take(len(content))
    return np.where(np.abs(places) < _FAR, places, np.nan)


def _over_field(alpha: Floats, points: Floats | None, lens: Lens) -> Floats:
    """`alpha` by where light goes, as an ideal lens would have it: a real one distorts."""
    if points is None:
        return alpha
    rows, cols = alpha.shape
    row, col = np.mgrid[:rows, :cols]
    ideal = np.stack([(col + 0.5) / cols, 1 - (row + 0.5) / rows], -1)
    off = _offsets(points, lens)
    scale = np.array([cols, rows])
    if np.abs(off * scale).max() <= _STRAIGHT:
        return alpha
    place = ideal
    for _ in range(_STEPS):
        place = ideal - _at(off, place)
    return np.asarray(_at(alpha[..., None], place)[..., 0])


def _offsets(points: Floats, lens: Lens) -> Floats:
    """(row, col, (right, up)): how far off light lands, of the field, from an ideal lens's."""
    rows, cols = points.shape[:2]
    right, up, forward = lens_frame(lens)
    low, high = field_edges(lens)
    ray = points - np.asarray(lens.position)
    ahead = ray @ forward
    known = np.isfinite(ray).all(axis=-1) & (ahead > 1e-9)
    ray, ahead = np.where(known[..., None], ray, forward), np.where(known, ahead, 1.0)
    place = (np.stack([ray @ right / ahead, ray @ up / ahead], -1) - low) / (high - low)
    row, col = np.mgrid[:rows, :cols]
    ideal = np.stack([(col + 0.5) / cols, 1 - (row + 0.5) / rows], -1)
    return np.where(known[..., None], place - ideal, 0.0)


def _at(values: Floats, place: Floats) -> Floats:
    """`values` (row, col, channel) at places (..., (right, up)), 0..1."""
    rows, cols = values.shape[:2]
    where = [(1 - place[..., 1]) * rows - 0.5, place[..., 0] * cols - 0.5]
    channels = np.moveaxis(values, -1, 0)
    return np.stack(
        [scipy.ndimage.map_coordinates(each, where, order=1, mode="nearest") for each in channels],
        -1,
    )


def fitted_sphere(points: Floats) -> tuple[Floats, float, float]:
    """Centre and radius of the sphere nearest to points (point, xyz), and how far they are off.

    It solves |p|² = 2 c p + r² - |c|², by least squares; the last is a root mean square, of the
    radius.
    """
    # Points of a plane leave one singular value of 1e-16, which lstsq takes for none
    design = np.column_stack([2 * points, np.ones(len(points))])
    solved, *_ = np.linalg.lstsq(design, np.sum(points**2, axis=1), rcond=None)
    centre = solved[:3]
    radius = float(np.sqrt(max(solved[3] + centre @ centre, 0.0)))
    off = np.linalg.norm(points - centre, axis=1) - radius
    return centre, radius, float(np.sqrt(np.mean(off**2)) / max(radius, 1e-9))


# Writing.


def written_mpcdi(theatre: Theatre, size: tuple[int, int] | None, date: str) -> bytes:
    """The file of a dome's projectors: profile "sl", maps of 16 bits, warps in m.

    Alpha maps are linear in light. Where projectors lift black, there are beta maps; both are to
    the power of 1/2.2 then.

    Parameters
    ----------
    theatre
        The screen and its projectors; their blends are made to sum to 1 on it.
    size
        Columns and rows of each; None for 1920 columns and what rows their fields need.
    date
        Date of the file, ``2026-11-25 20:00:00``.

    Raises
    ------
    InputError
        If there is none, or one is a fisheye.
    """
    dome, lenses = theatre.dome, theatre.lenses
    lifts = theatre.black_contrast is not None or any(lens.uplift is not None for lens in lenses)
    gamma = UPLIFT_GAMMA if lifts else 1.0
    for lens in lenses:
        if lens.kind != "perspective":
            raise InputError(
                f"projector {lens.name!r} is a fisheye; MPCDI has rectangular fields only "
                "(kind = 'perspective')"
            )
    if not lenses:
        raise InputError("there are no projectors to export; name them ([[projector.units]])")
    root = ET.Element(
        "MPCDI", profile=PROFILE, geometry="1", color="1", date=date, version="2.0"
    )  # fmt: skip
    buffer = ET.SubElement(ET.SubElement(root, "display"), "buffer", id="dome")
    files = ET.SubElement(root, "files")
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as package:
        for number, lens in enumerate(lenses, 1):
            cols, rows = size or (1920, max(1, round(1920 / lens.aspect)))
            points = landing(dome, lens, rows, cols)
            alpha = _blend(points, lens, lenses)
            names = {"warp": f"warp{number}.pfm", "alpha": f"alpha{number}.png"}
            _put(package, names["alpha"], written_mask(alpha ** (1 / gamma)))
            if lifts:
                names["beta"] = f"beta{number}.png"
                beta = projected_uplift(theatre, lens, points, alpha)
                _put(package, names["beta"], written_mask(beta ** (1 / gamma)))
            points[~on_screen(dome, points)] = np.nan
            _put(package, names["warp"], _written_pfm(points))
            _describe(buffer, files, lens, (cols, rows), names, gamma)
        ET.indent(root, "    ")
        content = ET.tostring(root, encoding="utf-8", xml_declaration=True)
        _put(package, "mpcdi.xml", content)
    return made.getvalue()


def _put(package: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name)  # of 1980: the same scene gives the same file
    info.compress_type = zipfile.ZIP_DEFLATED
    package.writestr(info, content)


def landing(dome: Dome, lens: Lens, rows: int, cols: int) -> Floats:
    """(row, col, xyz): where each pixel's light meets the sphere or ellipsoid of the screen, m."""
    right, up, forward = lens_frame(lens)
    low, high = field_edges(lens)
    row, col = np.mgrid[:rows, :cols]
    place = np.stack([(col + 0.5) / cols, 1 - (row + 0.5) / rows], -1)
    place = low + place * (high - low)
    rays = forward + place[..., :1] * right + place[..., 1:] * up
    return lands(dome, np.asarray(lens.position), rays)


def _blend(points: Floats, lens: Lens, lenses: Sequence[Lens]) -> Floats:
    """(row, col): the share of light that `lens` sends to `points`, of all that do."""
    total = sum(field_weight(each, points) for each in lenses)
    return np.asarray(field_weight(lens, points) / np.where(total > 0, total, 1.0))


def projected_uplift(theatre: Theatre, lens: Lens, points: Floats, share: Floats) -> Floats:
    """(...): what a projector adds to its black at points (..., xyz), over white.

    It is its own uplift, and its `share` of what hides the edges of overlaps.
    """
    lift = share * uplift(theatre, points)
    if lens.uplift is not None:
        lift += field_weight(replace(lens, blend=0.0, mask=lens.uplift), points)
    return np.where(on_screen(theatre.dome, points), np.clip(lift, 0, 1), 0.0)


def blend_sums(dome: Dome, lenses: Sequence[Lens], size: int = 256) -> tuple[float, float]:
    """Least and largest sum of what projectors send to a place of the screen that one reaches."""
    points = dome.points(size, size)
    total = np.asarray(sum(field_weight(lens, points) for lens in lenses))
    reached = dome.inside(size, size) & (total > 0)
    return (float(total[reached].min()), float(total[reached].max())) if reached.any() else (0, 0)


def _written_pfm(values: Floats) -> bytes:
    rows, cols = values.shape[:2]
    return f"PF\n{cols} {rows}\n-1.0\n".encode() + values[::-1].astype("<f4").tobytes()


def _describe(
    buffer: ET.Element,
    files: ET.Element,
    lens: Lens,
    size: tuple[int, int],
    names: Mapping[str, str],
    gamma: float,
) -> None:
    """What the XML says of a projector."""
    region = ET.SubElement(
        buffer, "region", id=lens.name, xResolution=str(size[0]), yResolution=str(size[1]),
        x="0", y="0", xsize="1", ysize="1",
    )  # fmt: skip
    right, _, forward = lens_frame(lens)
    yaw, pitch = np.arctan2(forward[0], forward[1]), np.arcsin(np.clip(forward[2], -1, 1))
    level, _ = _turned((yaw, pitch, 0.0))
    roll = np.arctan2(-right @ np.cross(level, forward), right @ level)
    (left, down), (right_edge, up) = np.arctan(field_edges(lens))
    angles = {"yaw": yaw, "pitch": pitch, "roll": roll}
    angles |= dict(zip(("rightAngle", "leftAngle", "upAngle", "downAngle"),
                       (right_edge, left, up, down), strict=True))  # fmt: skip
    _texts(ET.SubElement(region, "frustum"), ((k, np.degrees(v)) for k, v in angles.items()))
    axes = {"pos": lens.position, "yaw": (0, 0, -1), "pitch": (1, 0, 0), "roll": (0, 1, 0)}
    frame = ET.SubElement(region, "coordinateFrame")
    for name, vector in axes.items():
        _texts(frame, zip((f"{name}{axis}" for axis in "xyz"), vector, strict=True))
    entry = ET.SubElement(files, "fileset", region=lens.name)
    warp = ET.SubElement(entry, "geometryWarpFile")
    _texts(warp, (("path", names["warp"]), ("interpolation", "linear"), ("geometricUnit", "m"),
                  ("originOf3DData", "idealEyePoint")))  # fmt: skip
    alpha = ET.SubElement(entry, "alphaMap")
    grey = ("componentDepth", "1"), ("bitDepth", "16")
    _texts(alpha, (("path", names["alpha"]), *grey, ("gammaEmbedded", f"{gamma:.1f}")))
    if "beta" in names:
        _texts(ET.SubElement(entry, "betaMap"), (("path", names["beta"]), *grey))


def _texts(node: ET.Element, values: Iterable[tuple[str, str | float]]) -> None:
    for name, value in values:
        text = value if isinstance(value, str) else f"{float(value):.12g}"
        ET.SubElement(node, name).text = text
