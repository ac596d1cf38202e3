"""``domesim measure by-eye``: crosstalk, or a dome's albedo, by a viewer who turns a level."""

from __future__ import annotations

import hashlib
from typing import Annotated

import numpy as np
import typer

from domesim.commands.options import Json, OutFolder, Overwrite, Quiet, finish
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.files import read_plain
from domesim.host.writing import prepare, write_whole
from domesim.measure.by_eye.page import server
from domesim.measure.by_eye.session import SETTINGS, Kind, read_session
from domesim.scene import DomeScene, StereoScene, load_scene, scene_names
from domesim.scene.loading import scene_content, scene_of_text

MEASURED = "measured.toml"


def by_eye(
    scene: Annotated[
        str,
        typer.Option(
            "--scene",
            "--dome",
            "--stereo",
            help="The dome or the 3D screen: a scene's name or .toml file.",
            show_default=False,
            autocompletion=scene_names,
        ),
    ],
    out: OutFolder,
    port: Annotated[
        int,
        typer.Option(help="Port of the page's address; 0 for any that is free.", min=0, max=65535),
    ] = 8643,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Measure crosstalk, or a dome's albedo, by eye: a page to play in the room.

    A viewer turns a level until nothing changes any more, by keys or a gamepad. Each setting is
    kept at once; started again, the session goes on. See docs/measuring-by-eye.md.
    """
    from domesim.measure.by_eye.result import Result, with_crosstalk  # noqa: PLC0415 - SciPy

    console = Console(quiet=quiet, json=json)
    described = load_scene(scene)
    content = scene_content(scene)
    kind: Kind = "dome" if isinstance(described, DomeScene) else "stereo"
    if not isinstance(described, DomeScene | StereoScene) or described.views > 2:
        raise InputError(f"--scene {scene}: wanted a dome or a 3D screen of two views")
    measured, name = out / MEASURED, out.resolve().name
    if kind == "stereo":  # what would be refused in the end is refused now
        try:
            nothing = [(np.zeros(3), np.zeros(3))] * 2
            scene_of_text(with_crosstalk(content, name, nothing), scene, out)
        except InputError as error:
            raise InputError(f"{error} ([crosstalk] is what by-eye replaces)") from None
    prepare(measured, inputs=[scene], overwrite=overwrite)
    session = read_session(out / SETTINGS, kind, described.digest)
    if session is None or not session.done:
        with server(out, kind, described.name, described.digest, port) as running:
            console.say(
                f"Open http://127.0.0.1:{running.server_address[1]}/ in the room (Ctrl-C: a break)"
            )
            running.serve_forever()
        session = read_session(out / SETTINGS, kind, described.digest)
    assert session is not None
    found = Result(described, session)
    digest = hashlib.sha256(read_plain(out / SETTINGS)).hexdigest()
    text = found.scene_text(content, name, digest)
    scene_of_text(text, str(measured), out)
    write_whole(measured, text.encode("utf-8", "surrogateescape"))
    console.say(*found.lines(), f"  -> {measured}")
    master = "MASTER" if kind == "dome" else "--left L.####.exr --right R.####.exr"
    console.say(f"Use it: domesim compensate {master} --scene {measured}")
    finish(console, {"output": str(measured), **found.figures()}, [])
