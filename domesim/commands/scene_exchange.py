"""``domesim scene import`` and ``export``: projectors and blends of calibration programs."""

from __future__ import annotations

import re
import tempfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from domesim.commands.options import Json, Overwrite, Quiet
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.writing import prepare, write_together, write_whole
from domesim.room.masks import UPLIFT_GAMMA, written_mask
from domesim.room.theatre import Lens
from domesim.scene import DomeScene, load_dome
from domesim.scene.loading import scene_content
from domesim.scene.mpcdi import Region, blend_sums, fitted_sphere, read_mpcdi, written_mpcdi
from domesim.scene.writing import as_toml

_OFF = 0.01
"""Root mean square that points may be off a sphere, of its radius, and be taken for one."""
_SUMS = 1e-3
_MICROMETRES, _DIGITS = 6, 9
_SIZE = re.compile(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})")


def import_projectors(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="An MPCDI file, or its XML.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", help="The scene's .toml file; blend masks go beside it.", show_default=False
        ),
    ],
    like: Annotated[
        str,
        typer.Option(
            "--like",
            help="A dome's scene that all else is taken from: its screen, white, seats, ...",
        ),
    ] = "dome_hemisphere",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Take projectors, their fields and blends from an MPCDI file into a scene."""
    console = Console(quiet=quiet, json=json)
    if out.suffix.lower() != ".toml":
        raise InputError(f"--out {out}: a scene is a .toml file, name it so")
    base = load_dome(like)
    content, regions = scene_content(like), read_mpcdi(file)
    centre, radius = _screen(regions, file, console)
    radius = base.dome.radius if radius is None else radius
    lenses = [_moved(region.lens, centre) for region in regions]
    masks: dict[str, NDArray[np.float64]] = {}
    for number, lens in enumerate(lenses, 1):
        if lens.mask is not None:
            masks[f"{out.stem}.{number}.mask.png"] = lens.mask.weights
        if lens.uplift is not None:
            lift = lens.uplift.weights ** (1 / UPLIFT_GAMMA)
            masks[f"{out.stem}.{number}.uplift.png"] = lift
    content |= {"name": out.stem, "description": f"Projectors of {file.name}, else {base.name}."}
    content["dome"] = {**content["dome"], "radius_m": radius}
    content["projector"] = _projector(content["projector"], base, len(lenses))
    blacks = content["projector"].pop("units", [{}] * len(lenses))
    content["projector"]["units"] = [
        _unit(lens, f"{out.stem}.{number}", radius) | black
        for number, (lens, black) in enumerate(zip(lenses, blacks, strict=True), 1)
    ]
    prepare(out, *map(out.with_name, masks), inputs=[file, like], overwrite=overwrite)
    sources = {**content.get("sources", {}), "projector.units": f"MPCDI file {file.name}"}
    if regions[0].points is not None:
        sources["dome.radius_m"] = f"fitted to where pixels land, of {file.name}"
    content["sources"] = sources
    written = [(out.with_name(name), written_mask(mask)) for name, mask in masks.items()]
    text = as_toml(content).encode("utf-8", "surrogateescape")
    with tempfile.TemporaryDirectory(prefix="domesim-") as folder:
        for path, made in (*written, (out, text)):
            (Path(folder) / path.name).write_bytes(made)
        try:
            made_scene = load_dome(Path(folder) / out.name)
        except InputError as error:
            raise InputError(f"{file}: {str(error).replace(folder, str(out.parent))}") from None
    write_together([*written, (out, text)])
    sums = blend_sums(made_scene.dome, made_scene.theatre.lenses)
    unmasked = [region.name for region in regions if region.lens.mask is None]
    console.say(
        f"{file}: {len(regions)} projectors ({', '.join(region.name for region in regions)}) on a "
        f"dome of {radius:.4g} m",
        *([f"No blend of {', '.join(unmasked)}: edges are hard (blend_deg)"] if unmasked else []),
        *_sums_in_words(sums),
        f"  -> {out}",
    )
    console.figures(
        {"projectors": len(regions), "radius_m": radius, "blend_sums": list(sums),
         "out": str(out), "masks": [str(path) for path, _ in written]}
    )  # fmt: skip


def export_projectors(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="A dome: its name, or the path of a .toml file.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="The .mpcdi file.", show_default=False)],
    size: Annotated[
        str | None,
        typer.Option(
            help="Columns and rows of each projector: 2560x1600. 1920 columns and what its field "
            "needs if left out.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a dome's projectors, with blends that sum to 1, as an MPCDI file."""
    console = Console(quiet=quiet, json=json)
    chosen = None if size is None else _SIZE.fullmatch(size.lower())
    if size is not None and (chosen is None or max(int(chosen[1]), int(chosen[2])) > 16384):
        raise InputError(f"--size {size!r}: name columns and rows up to 16384, such as 1920x1200")
    theatre = load_dome(scene)
    prepare(out, inputs=[scene], overwrite=overwrite)
    pixels = None if chosen is None else (int(chosen[1]), int(chosen[2]))
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")
    try:
        content = written_mpcdi(theatre.as_projected.theatre, pixels, date)
    except InputError as error:
        raise InputError(f"{scene}: {error}") from None
    write_whole(out, content)
    regions = read_mpcdi(out)
    sums = blend_sums(theatre.dome, [region.lens for region in regions])
    console.say(
        *(f"{each.name}: {each.size[0]} x {each.size[1]} px" for each in regions),
        *_sums_in_words(sums),
        f"  -> {out}",
    )
    console.figures({"projectors": len(regions), "blend_sums": list(sums), "out": str(out)})


def _sums_in_words(sums: tuple[float, float]) -> list[str]:
    """What to say of least and largest sums of blends."""
    if max(abs(each - 1) for each in sums) <= _SUMS:
        return ["Blends sum to 1 within 0.1 %"]
    return [f"Blends sum to {sums[0]:.4g} to {sums[1]:.4g} where a projector reaches, not to 1"]


def _screen(
    regions: tuple[Region, ...], file: Path, console: Console
) -> tuple[tuple[float, float, float], float | None]:
    """Centre and radius of the sphere that pixels land on; the origin and None if nobody says."""
    clouds = [region.points.reshape(-1, 3) for region in regions if region.points is not None]
    points = np.concatenate(clouds) if clouds else np.zeros((0, 3))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 4:
        console.say("The file does not say where light lands: the dome is that of --like")
        return (0.0, 0.0, 0.0), None
    centre, radius, off = fitted_sphere(points[:: max(1, len(points) // 100_000)])
    if not off <= _OFF:
        raise InputError(
            f"{file}: wanted pixels that land on a sphere, got ones {off:.1%} of its radius off. "
            f"Is it a dome?"
        )
    x, y, z = _metres(centre)
    return (x, y, z), float(f"{radius:.6g}")


def _projector(old: dict[str, Any], base: DomeScene, count: int) -> dict[str, Any]:
    """What another scene tells of so many projectors, and of each of as many units its black."""
    kept = {key: old[key] for key in old.keys() - {"lens", "even_black", "units"}}
    if not any(lens.black for lens in base.theatre.lenses):
        return kept
    blacks = [
        {key: unit[key] for key in ("black_cd_m2", "blends_black") if key in unit}
        for unit in old["units"]
    ]
    if len(blacks) == count:
        return {**kept, "units": blacks}
    return {**kept, "black_cd_m2": base.projector.black}


def _moved(lens: Lens, centre: tuple[float, float, float]) -> Lens:
    """A lens in a frame whose origin is at `centre`."""
    x, y, z = np.subtract(lens.position, centre).tolist()
    a, b, c = np.subtract(lens.look_at, centre).tolist()
    return replace(lens, position=(x, y, z), look_at=(a, b, c))


def _unit(lens: Lens, stem: str, radius: float) -> dict[str, Any]:
    """A projector as a scene's file has it."""
    position = np.asarray(lens.position)
    ahead = position + radius * (np.asarray(lens.look_at) - position)
    shift = [round(value, _DIGITS) for value in lens.shift]
    return {
        "name": lens.name,
        "position_m": _metres(position),
        "look_at_m": _metres(ahead),
        "kind": "perspective",
        "field_deg": round(float(np.degrees(lens.field)), _DIGITS),
        "aspect": round(lens.aspect, _DIGITS),
        "roll_deg": round(float(np.degrees(lens.roll)), _DIGITS) + 0.0,
        **({"shift": shift} if any(shift) else {}),
        **({"mask": f"{stem}.mask.png"} if lens.mask is not None else {}),
        **({"uplift": f"{stem}.uplift.png"} if lens.uplift is not None else {}),
    }


def _metres(place: NDArray[np.float64]) -> list[float]:
    return [round(float(value), _MICROMETRES) + 0.0 for value in place]
