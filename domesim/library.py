"""What a program of one's own needs: a master's light, what is seen of it, and a file of that.

load_master -> Light -> compensate.compensate -> Light -> observe -> Light -> save
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, Master, read_master, write_master
from domesim.frames.encodings import encoding_named
from domesim.frames.views import made_for
from domesim.light import Light, LightT, as_sent, on_host, require_finite, require_light
from domesim.observation.transport import Transport
from domesim.scene import DomeScene, Scene
from domesim.scene.loading import AnyScene, as_scene
from domesim.scene.screening import decoded, encoded

Files: TypeAlias = str | Path | Sequence[str | Path]
"""One file; or two, left and right."""


def load_master(path: Files, scene: AnyScene, encoding: str | None = None) -> tuple[Light, Master]:
    """Read a master as light on the screen of a scene.

    Parameters
    ----------
    path
        An EXR, PNG, TIFF, DPX, JPEG or JPEG 2000 file; or two files, left and right.
    scene
        Where it is shown: light is in units of its projector's white and in its primaries. A
        scene, its name or its file.
    encoding
        What the code values mean, such as "srgb" or "st2084:p3-d65" (`domesim.frames.encodings`);
        None to go by the scene's response, or else by the file.

    Returns
    -------
    light
        (view, row, col, primary) float32. Highlights may be above 1
        (`domesim.scene.screening.within_range` clips them).
    master
        What else the files hold: ``master.colour``, ``master.described()``; `save` takes it.

    Raises
    ------
    InputError
        If a file cannot be read, or has other views than the scene.
    """
    shown_in = as_scene(scene)
    response = shown_in.projector.response
    colour = response if encoding is None else encoding_named(encoding, "encoding")
    master = read_master(_listed(path), colour=colour)
    return decoded(master, shown_in), master


def observe(light: LightT, scene: AnyScene) -> LightT:
    """What the audience sees of projected light.

    Parameters
    ----------
    light
        (view, row, col, primary), 1.0 = projector white.
    scene
        The theatre, or stereo system; or its name or file.

    Returns
    -------
    seen
        The same axes, library and device; of several seats, their views one after the other.

    Raises
    ------
    InputError
        If it is no light, has a value that is not finite, or is not of the scene's views.
    """
    require_light(light, who="observe")
    require_finite(light, who="observe")
    scene = as_scene(scene)
    seen: LightT = scene.observation(*light.shape[1:3]).observe(light)
    return seen


def render(light: LightT, scene: AnyScene, *, error: float = 0.05, seed: int = 0) -> LightT:
    """What the audience of a dome sees of projected light, by path tracing: noisy, and unbiased.

    Parameters
    ----------
    light
        (1, row, col, primary), 1.0 = projector white.
    scene
        A dome theatre; or its name or file.
    error
        Standard error to reach: rms over pixels, relative to the mean reflected light.
    seed
        Seed of the random numbers.

    Returns
    -------
    seen
        The same axes, library and device.

    Raises
    ------
    InputError
        If it is no light of a dome, or a setting is impossible.
    """
    from domesim.pathtrace.observation import PathTracedDome  # noqa: PLC0415 - loads Mitsuba
    from domesim.pathtrace.tracer import Settings  # noqa: PLC0415

    require_light(light, who="render", primaries=3)
    require_finite(light, who="render")
    dome = _dome(scene, "render")
    rows, cols = light.shape[1:3]
    how = Settings(error=error, seed=seed)
    traced = PathTracedDome(dome.theatre, rows, cols, how, black=dome.black_frame(rows, cols))
    seen: LightT = as_sent(traced.observe(on_host(light)), light)
    return seen


def tabulate(scene: AnyScene, *, error: float = 5e-4, seed: int = 0) -> Transport:
    """Trace the light transport of a dome theatre, with all that is in it.

    Parameters
    ----------
    scene
        A dome theatre; or its name or file. ``scene.with_transport`` takes what is returned.
    error
        Standard error of white's reflected light to reach, relative.
    seed
        Seed of the random numbers.

    Returns
    -------
    transport
        `Transport.save` writes it, for ``--transport``.

    Raises
    ------
    InputError
        If it is no dome, or a setting is impossible.
    """
    from domesim.pathtrace.tabulate import tabulate as traced  # noqa: PLC0415 - loads Mitsuba

    dome = _dome(scene, "tabulate")
    about = {"scene": dome.name, "digest": dome.digest}
    return traced(dome.theatre, error=error, seed=seed, provenance=about).transport


def _dome(scene: AnyScene, who: str) -> DomeScene:
    found = as_scene(scene)
    if not isinstance(found, DomeScene) or found.views > 1:
        raise InputError(f"{who} takes a dome theatre of one view, got {found.name}")
    return found


def save(light: Light, path: Files, scene: AnyScene, like: Master | None = None) -> float:
    """Write light as a picture.

    Parameters
    ----------
    light
        (view, row, col, primary), 1.0 = projector white.
    path
        One file; or two, left and right. The suffix names the format.
    scene
        Whose projector the light is of.
    like
        A master that `load_master` gave: the file gets its encoding, metadata and, off the screen,
        its picture. Without one it is linear, an EXR.

    Returns
    -------
    clipped
        Share of the screen's pixels whose colour the file cannot hold.

    Raises
    ------
    InputError
        If a file cannot be written.
    InputError
        If the light has another size than `like`, or there are not as many files as views.
    """
    require_light(light, who="save", primaries=3)
    require_finite(light, who="save")
    light, scene = on_host(light), as_scene(scene)
    paths = _listed(path)
    screen = scene.screen(*light.shape[1:3])
    if like is None:
        like, screen = _linear(light, scene), np.ones_like(screen)
    if light.shape[1:3] != (size := like.frames[0].pixels.shape[:2]):
        raise InputError(f"save takes light of its master's size, {size}, got {light.shape[1:3]}")
    result, clipped = encoded(made_for(like, paths), light, scene, screen)
    write_master(result, paths)
    return clipped


def _listed(path: Files) -> list[Path]:
    if not isinstance(path, str | Path | Sequence):
        raise InputError(f"wanted a path, or two, got a {type(path).__name__}")
    return [Path(path)] if isinstance(path, str | Path) else [Path(each) for each in path]


def _linear(light: Light, scene: Scene) -> Master:
    """A master that holds any light, if its projector's primaries have a name."""
    projector = scene.projector
    primaries = projector.primaries if projector.measured is None else "BT.2020"
    colour = ColourTag("linear", primaries, "domesim")
    pixels = np.zeros(light.shape[1:], np.float32)
    frame = Frame(pixels, Path("light.exr"), colour, 32, floating=True)
    return Master((frame,) * len(light), "single" if len(light) == 1 else "files")
