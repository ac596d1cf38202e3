"""``domesim domemaster``: a domemaster of a panorama, or of each of a sequence or film."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, final

import numpy as np
import typer

from domesim.commands.options import OutFolder, Overwrite, Repair, Telling, finish, grouped
from domesim.commands.shows import Encoding
from domesim.errors import InputError
from domesim.frames import Frame, write_frame
from domesim.frames.integrity import EQUIRECTANGULAR
from domesim.frames.reading import read_image, unsaid
from domesim.host.writing import prepare
from domesim.light import transfer
from domesim.room.dome import Dome
from domesim.room.panorama import FACES, CubeStrip, Equirectangular, Panorama, domemaster_of
from domesim.shows.show import find_show

CUBE_STRIP = "cube-strip"
_WHITE = 100.0  # cd/m²; any will do, for it cancels out


@final
@dataclass(frozen=True)
class Around:
    """What a panorama is, and which part of it a dome shows."""

    projection: Annotated[
        str,
        typer.Option(
            "--from",
            help=f"What the panorama is: {EQUIRECTANGULAR} (2 : 1, the front in the middle, the "
            f"zenith on top), or {CUBE_STRIP} (6 : 1).",
            show_default=False,
        ),
    ]
    faces: Annotated[
        str | None,
        typer.Option(
            help=f"The order of a cube strip's faces by their letters, such as {FACES}: right, "
            "left, up, down, front, back. The upper's bottom and the lower's top lie at the front.",
            show_default=False,
        ),
    ] = None
    tilt: Annotated[
        float, typer.Option(help="How far the dome's zenith leans to the front, degrees.")
    ] = 0.0
    field: Annotated[
        float, typer.Option(help="What the domemaster shows from rim to rim, degrees.")
    ] = 180.0
    size: Annotated[
        int | None,
        typer.Option(
            help="Pixels along a side of the domemaster; as dense as the panorama by default.",
            show_default=False,
        ),
    ] = None

    def dome(self) -> Dome:
        """The dome that sees it.

        Raises
        ------
        InputError
            If an option cannot be.
        """
        if self.projection not in (EQUIRECTANGULAR, CUBE_STRIP):
            raise InputError(
                f"--from {self.projection!r} is not known; use {EQUIRECTANGULAR} or {CUBE_STRIP}"
            )
        if (self.faces is None) == (self.projection == CUBE_STRIP):
            raise InputError(f"--faces is for --from {CUBE_STRIP}, which needs it: --faces {FACES}")
        if not (0 < self.field <= 360 and -180 <= self.tilt <= 180):
            raise InputError(
                f"--field must be above 0 and at most 360, --tilt from -180 to 180 degrees, got "
                f"{self.field:g} and {self.tilt:g}"
            )
        return Dome(1.0, float(np.radians(self.field / 2)), float(np.radians(self.tilt)))

    def panorama(self, light: Any) -> Panorama:
        """The light of one picture.

        Raises
        ------
        InputError
            If it has another shape.
        """
        return Equirectangular(light) if self.faces is None else CubeStrip(light, self.faces)


@grouped
def domemaster(
    panorama: Annotated[
        str,
        typer.Argument(
            metavar="PANORAMA",
            help="A file, a numbered sequence such as 'show.####.exr', or a video.",
            show_default=False,
        ),
    ],
    around: Around,
    out: OutFolder,
    telling: Telling,
    frames: Annotated[
        str | None, typer.Option(help="Frames of a sequence to do, such as '1-100x10'.")
    ] = None,
    encoding: Encoding = None,
    repair: Repair = False,
    overwrite: Overwrite = False,
) -> None:
    """Make domemasters of panorama pictures: EXR of floats, PNG of 16 bits of others."""
    console, dome = telling.console(), around.dome()
    show = find_show(panorama, frames=frames, encoding=encoding)
    projection = around.projection if around.faces is None else ""
    read = partial(read_image, repair=repair, colour=show.colour, projection=projection)
    sources = [files[0] for files in show.moments]
    suffix = ".exr" if read(sources[0]).floating else ".png"
    targets = [paths[0] for paths in show.outputs(out, suffix)]
    prepare(*targets, inputs=sources, overwrite=overwrite)
    made = []
    for source, target in zip(sources, targets, strict=True):
        figures, line = _made(read(source), target, dome, around)
        made.append(figures)
        console.say(line)
    finish(console, {"frames": made}, [])


def _made(frame: Frame, target: Path, dome: Dome, around: Around) -> tuple[dict[str, Any], str]:
    """Write one domemaster; figures, and a line for a person."""
    if frame.header.eyes is not None:
        raise InputError(
            f"{frame.path}: wanted one view, got a picture that says it is {frame.header.eyes}. "
            "Save left and right as two files."
        )
    curve = transfer.named(frame.colour.transfer, white=_WHITE)
    made = domemaster_of(around.panorama(curve.decode(frame.pixels)), dome, around.size)
    codes = curve.encode(made.light).astype(np.float32)
    bits = frame.bits if frame.floating else 16
    done = Frame(codes, target, frame.colour, bits, floating=frame.floating)
    write_frame(done, target)
    size, loss = len(codes), 100 * made.loss
    told = unsaid(read_image(target, repair=False, colour=frame.colour))
    line = (
        f"{frame.described()}\n  -> {target}: {size} x {size}; back in the panorama, its light is "
        f"{loss:.2g} % off in the mean (root mean square)"
    )
    line += f"\n  written as {told}" if told else ""
    return {"output": str(target), "size": size, "loss_percent": loss}, line
