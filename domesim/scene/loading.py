"""A scene file (TOML), or one of the project's own by its name -> Scene.

All mistakes of a file are listed in one go, each with its path.
"""

from __future__ import annotations

import copy
import difflib
import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from domesim.errors import InputError
from domesim.host.files import read_plain
from domesim.host.texts import text_in, toml_in
from domesim.scene import dome, stereo
from domesim.scene.base import Scene
from domesim.scene.dome import DomeScene
from domesim.scene.dome_file import DomeFile
from domesim.scene.flat import cinema
from domesim.scene.flat_file import CinemaFile
from domesim.scene.mistakes import all_mistakes, suggestion
from domesim.scene.stereo import StereoScene
from domesim.scene.stereo_file import StereoFile


def load_scene(name_or_path: str | Path | Mapping[str, Any], **changes: Any) -> Scene:
    """The scene of a TOML file, one of the project's own by its name, or one in memory.

    Scenes of the same content are equal, can be pickled, and can be keys of a dictionary.

    Parameters
    ----------
    name_or_path
        Path of a .toml file; a name; or what such a file holds, such as `scene_content` returns:
        sections by name. Paths in that are from the current folder.
    changes
        Keys to be replaced, by their section: ``load_scene("dome_hemisphere", screen={"albedo":
        0.4})``. None takes a key or a section out.

    Returns
    -------
    scene
        As it is described.

    Raises
    ------
    InputError
        If there is no such scene, or with all mistakes of its file, each with its path.
    """
    if changes and not isinstance(name_or_path, Mapping):
        load_scene(name_or_path)  # tells its own mistakes
        name_or_path = scene_content(name_or_path)
    if isinstance(name_or_path, Mapping):
        content = _merged(name_or_path, changes)
        return _named(content, f"scene {content.get('name', 'in memory')!r}", Path(), file="")
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            f"wanted a scene, the name of one or the path of its file, got a "
            f"{type(name_or_path).__name__}"
        )
    text, folder = _scene_text(name_or_path)
    return scene_of_text(text, str(name_or_path), folder)


def _merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of what a file holds, with changes; None takes out."""
    merged = copy.deepcopy(dict(content))
    for key, value in changes.items():
        if value is None:
            merged.pop(key, None)
        elif isinstance(value, Mapping) and isinstance(merged.get(key, {}), Mapping):
            merged[key] = _merged(merged.get(key, {}), value)
        else:
            merged[key] = copy.deepcopy(value)
    return merged


AnyScene: TypeAlias = Scene | str | Path | Mapping[str, Any]
"""A scene, its name, the path of its file, or what that holds."""


def as_scene(scene: AnyScene) -> Scene:
    """Return a scene; load it if it is named.

    Raises
    ------
    InputError
        As for `load_scene`, and for what is neither a scene nor a name.
    """
    return scene if isinstance(scene, Scene) else load_scene(scene)


def scene_content(name_or_path: str | Path) -> dict[str, Any]:
    """What a scene's file holds, to be changed and written anywhere; the scene has been loaded.

    Paths of files beside it are whole.

    Raises
    ------
    InputError
        If there is no such scene.
    """
    text, folder = _scene_text(name_or_path)
    content = toml_in(text)
    for mesh in content.get("meshes", []):
        mesh["file"] = str((folder / mesh["file"]).resolve())
    ambient = content.get("ambient", {})
    if "photograph" in ambient:
        ambient["photograph"] = str((folder / ambient["photograph"]).resolve())
    screen = content.get("screen", {})
    if (named := screen.get("albedo_map")) is not None:
        alone = isinstance(named, str)
        whole = [str((folder / each).resolve()) for each in ([named] if alone else named)]
        screen["albedo_map"] = whole[0] if alone else whole
    for unit in content.get("projector", {}).get("units", []):
        for key in {"mask", "uplift"} & unit.keys():
            unit[key] = str((folder / unit[key]).resolve())
    return content


def _scene_text(name_or_path: str | Path) -> tuple[str, Path]:
    """The text of a scene's file, and the folder that its paths are from.

    Raises
    ------
    InputError
        If there is no such scene.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" and len(path.parts) <= 1:
        return _bundled(str(name_or_path)), Path()
    try:
        return text_in(read_plain(path)), path.parent
    except UnicodeDecodeError:
        raise InputError(f"{path}: a scene is a TOML text file in UTF-8, this is not") from None
    except OSError as error:
        raise InputError(
            f"{path}: wanted a scene's .toml file, got '{error.strerror}'. "
            f"Check the path, or use one of {', '.join(scene_names())}"
        ) from error


def scene_of_text(text: str, where: str, folder: Path) -> Scene:
    """The scene that a TOML text describes.

    Parameters
    ----------
    text
        TOML.
    where
        The file that it is taken for.
    folder
        Where files lie that it names.

    Returns
    -------
    scene
        As it is described.

    Raises
    ------
    InputError
        With all mistakes, each with its path.
    """
    try:
        content = toml_in(text)
    except (ValueError, RecursionError) as error:  # a ValueError also for a number too long
        raise InputError(f"{where}: not valid TOML: {error}") from None
    return _named(content, where, folder, file=where)


def _named(content: dict[str, Any], where: str, folder: Path, file: str) -> Scene:
    """The scene of `content`; mistakes begin with `where`."""
    try:
        return _described(content, where, folder, file)
    except InputError as error:
        if str(error).startswith(where):
            raise
        between = " " if str(error).startswith("has ") else ": "
        raise InputError(f"{where}{between}{error}") from None


def load_dome(name_or_path: str | Path) -> DomeScene:
    """`load_scene` for what only a dome theatre has.

    Raises
    ------
    InputError
        As for `load_scene`, and if it is a stereo system.
    """
    scene = load_scene(name_or_path)
    if not isinstance(scene, DomeScene):
        raise InputError(f"{name_or_path}: wanted a dome theatre, got a flat screen")
    return scene


def load_stereo(name_or_path: str | Path) -> StereoScene:
    """`load_scene` for what only a stereo system has.

    Raises
    ------
    InputError
        As for `load_scene`, and if it is a dome theatre.
    """
    scene = load_scene(name_or_path)
    if not isinstance(scene, StereoScene):
        raise InputError(f"{name_or_path}: wanted a stereo system, got another theatre")
    return scene


def scene_names() -> list[str]:
    """Names of the project's own scenes."""
    folder = resources.files("scenes")
    return sorted(
        item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")
    )


def _bundled(name: str) -> str:
    names = scene_names()
    if name not in names:
        raise InputError(
            f"scene {name!r} is not known{suggestion(name, names)}; "
            f"use one of {', '.join(names)}, or the path of a .toml file"
        )
    return resources.files("scenes").joinpath(f"{name}.toml").read_text()


def _described(content: dict[str, Any], where: str, folder: Path, file: str) -> Scene:
    """The scene of a file that says which kind it is."""
    kind = _kind(content)
    scene: Scene
    digest = ""  # which has what is in the files that it names
    try:
        if kind is StereoFile:
            scene = stereo.built(StereoFile.model_validate(content), folder)
            digest = scene.digest
        elif kind is CinemaFile:
            scene = cinema(CinemaFile.model_validate(content))
        else:
            scene = dome.built(DomeFile.model_validate(content), folder)
            digest = scene.digest
    except ValidationError as error:
        raise InputError(all_mistakes(error, where, kind)) from None
    text = json.dumps(content, sort_keys=True, default=str) + digest
    return replace(scene, file=file, content=hashlib.sha256(text.encode()).hexdigest())


def _kind(content: dict[str, Any]) -> type[DomeFile | StereoFile | CinemaFile]:
    """A dome theatre has a dome, a stereo system crosstalk, a 2-D cinema its room or lens.

    One misspelt section does not make it another kind, whose mistakes would be listed then. So what
    else only flat screens have counts, too.

    Raises
    ------
    InputError
        If it has a flat screen, and none of these.
    """
    if "dome" in content:
        return DomeFile
    screen, seen = (_keys(content, name) for name in ("screen", "viewing"))
    if difflib.get_close_matches("crosstalk", content, 1):
        return StereoFile
    if not ({"width_m", "height_m"} & screen or "distance_m" in seen):
        return DomeFile
    if any(difflib.get_close_matches(name, content, 1) for name in ("room", "lens", "port_glass")):
        return CinemaFile
    raise InputError(
        "a flat screen needs [crosstalk] (3D), or [room] or [lens] (2-D), got none of them"
    )


def _keys(content: dict[str, Any], name: str) -> set[str]:
    section = content.get(name)
    return set(section) if isinstance(section, dict) else set()
