"""``domesim master``: render frames of the orrery, to try the other commands on."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from domesim.commands.options import Json, OutFolder, Quiet, finish
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.writing import prepare
from domesim.shows.sequences import parse_frames

if TYPE_CHECKING:
    from scenes.artwork.orrery.cameras import View
    from scenes.artwork.orrery.picture import Picture, Settings

_BT709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Chromaticities (x, y) of red, green, blue and white: Recommendation ITU-R BT.709-6, item 1.3."""

Kind = Annotated[
    str,
    typer.Option(
        help="dome (domemasters), dome-stereo (left and right domemasters) or stereo (left and "
        "right 16:9 pictures)."
    ),
]
Frames = Annotated[
    str, typer.Option(help="Frames to render, such as '1-24'; frame 1 is at 0 seconds.")
]
Loop = Annotated[float, typer.Option(help="Seconds after which the film starts over.")]
Size = Annotated[int, typer.Option(help="Width, pixels: also the height of domemasters.")]
Samples = Annotated[
    int, typer.Option(help="Paths to the pixel: less noise. Best are 16, 64, 256 and 1024.")
]
Seed = Annotated[int, typer.Option(help="Same seed, same film. Others start elsewhere.")]
Interaxial = Annotated[float, typer.Option(help="Stereo: distance of the two eyes, m.")]
Convergence = Annotated[
    float,
    typer.Option(
        help="Stereo: distance of the screen, m: a dome's radius. What is as far has no parallax; "
        "'inf' for parallel rays."
    ),
]


def master(
    out: OutFolder,
    kind: Kind = "dome",
    frames: Frames = "1",
    fps: Annotated[float, typer.Option(help="Frames in a second.")] = 24.0,
    loop: Loop = 60.0,
    size: Size = 1024,
    samples: Samples = 64,
    seed: Seed = 7,
    interaxial: Interaxial = 0.065,
    convergence: Convergence = 8.0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Render masters of a 3D scene, mono or stereo: an orrery in a dark hall, linear EXR."""
    # Slow to import: see tests/test_architecture.py.
    from scenes.artwork.orrery.cameras import views  # noqa: PLC0415
    from scenes.artwork.orrery.orrery import Orrery  # noqa: PLC0415
    from scenes.artwork.orrery.picture import Settings, Studio  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    numbers = sorted(parse_frames(frames))
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"--fps must be above 0, got {fps:g}")
    settings = Settings(size=size, samples=samples, orrery=Orrery(seed=seed, loop=loop))
    looks = views(kind, interaxial=interaxial, convergence=convergence)
    targets = {
        (number, name): out / f"orrery{name}.{number:04d}.exr"
        for number in numbers
        for name in looks
    }
    prepare(*targets.values())
    done: list[dict[str, Any]] = []
    with console.progress("rendering", len(numbers) + 1) as start:
        start("the hall")
        studio = Studio(settings, looks)
        for number in numbers:
            start(f"frame {number}")
            began, moment = clock.monotonic(), (number - 1) / fps
            files = []
            for name, picture in studio.frame(moment).items():
                path = targets[number, name]
                _write(picture, path, looks[name], settings)
                files.append(str(path))
            took = clock.monotonic() - began
            console.say(f"frame {number}: rendered in {took:.1f} s\n  -> {', '.join(files)}")
            done.append({"frame": number, "time_s": moment, "took_s": took, "files": files})
    finish(console, {"kind": kind, "fps": fps, "loop_s": loop, "frames": done}, [])


def _write(picture: Picture, path: Path, view: View, settings: Settings) -> None:
    """Write a half-float EXR that states its primaries, whole or not at all."""
    from domesim.frames import ColourTag, Frame, write_frame  # noqa: PLC0415
    from domesim.frames.frame import Header  # noqa: PLC0415

    made_with = f"domesim master, seed {settings.orrery.seed}, {settings.samples} samples"
    colour = ColourTag("linear", "BT.709", "rendered")
    attributes = (
        ("chromaticities", "float[8]", _BT709),
        ("ImageDescription", "string", f"{view.description}; {made_with}"),
    )
    # With its colour "as read", or the writer would leave out primaries that are usual.
    header = Header(attributes=attributes, colour=colour)
    write_frame(Frame(picture, path, colour, 16, floating=True, header=header), path)
