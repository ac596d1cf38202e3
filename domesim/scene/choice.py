"""Which scene, as a command line names it: what is sent to whoever works on its frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, final

import numpy as np

from domesim.errors import InputError
from domesim.host.console import about
from domesim.observation.transport import load_transport
from domesim.scene import CinemaScene, DomeScene, Scene, StereoScene, load_scene
from domesim.scene.crosstalk_maps import load_maps


@final
@dataclass(frozen=True)
class SceneChoice:
    """A scene by its name.

    Parameters
    ----------
    name
        One of the project's own, or the path of a TOML file.
    transport
        A file of stored light transport, or of crosstalk maps; None for none.
    seat
        One seat; of a stereo scene also "all"; None for the scene's own.
    content
        Digest of what these files hold; "" if it is not known yet.
    """

    name: str
    transport: Path | None = None
    seat: str | None = None
    content: str = ""
    _scene: Scene | None = field(default=None, repr=False, compare=False)

    def load(self) -> Scene:
        """The scene; the one that `settled` was given, but in other processes.

        Raises
        ------
        InputError
            If a file cannot be read or holds something else than `content`, files do not belong
            together, or there is no such seat.
        """
        if self._scene is not None:
            return self._scene
        scene = self._loaded()
        if self.content and _digest(scene) != self.content:
            raise InputError(
                f"{self.name}: wanted the scene that the job began with, got another; its files "
                f"were changed, or are not the same on this machine"
            )
        return scene

    def settled(self, scene: Scene) -> SceneChoice:
        """The same choice for other processes: of files that hold what `scene` was loaded from."""
        path = Path(self.name)
        name = self.name if len(path.parts) <= 1 and path.suffix != ".toml" else path.absolute()
        transport = None if self.transport is None else self.transport.absolute()
        return replace(
            self, name=str(name), transport=transport, content=_digest(scene), _scene=scene
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without the scene, which may be large: other processes load it."""
        return {**vars(self), "_scene": None}

    def settings(self) -> dict[str, Any]:
        """What results depend on, for JSON."""
        return {"scene": Path(self.name).name, "seat": self.seat, "scene_content": self.content}

    def options(self) -> dict[str, str]:
        """The options that chose it: name -> value."""
        found = {"--scene": Path(self.name).name}
        if self.transport is not None:
            found["--transport"] = self.transport.name
        return found if self.seat is None else {**found, "--seat": self.seat}

    def _loaded(self) -> Scene:
        scene = load_scene(self.name)
        if isinstance(scene, CinemaScene):
            for option, value in (("--transport", self.transport), ("--seat", self.seat)):
                if value is not None:
                    raise InputError(
                        f"{option} {value}: {scene.name} is a 2-D cinema, whose room its scene "
                        f"file describes, the same for all seats; leave it out"
                    )
        if self.transport is not None:
            with about(self.transport):
                if isinstance(scene, StereoScene):
                    scene = scene.with_maps(load_maps(self.transport))
                elif isinstance(scene, DomeScene):
                    scene = scene.with_transport(load_transport(self.transport))
        if isinstance(scene, StereoScene):
            if self.seat == "all":
                scene = scene.seen_from(*scene.seats)
            elif self.seat is not None:
                scene = scene.seen_from(self.seat)
        elif isinstance(scene, DomeScene) and self.seat is not None:
            scene = scene.seen_from(self.seat)
        return scene


def _digest(scene: Scene) -> str:
    """Digest of all that a scene is made of: the same in all processes."""
    found = hashlib.sha256()
    for part in _parts(scene):
        found.update(part)
    return found.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """What a value holds, one after the other; no two different ones give the same."""
    if isinstance(value, np.generic):
        value = value.item()  # whose text does not depend on NumPy's settings
    yield f"({type(value).__qualname__} ".encode()
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape} ".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        for item in value.items():
            yield from _parts(item)
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _parts(item)
    elif value is None or isinstance(value, str | int | float | complex | bytes | Enum | Path):
        yield repr(value).encode()
    elif is_dataclass(value):
        for each in filter(lambda each: each.compare, fields(value)):
            yield from _parts(getattr(value, each.name))
    else:
        yield from _parts(vars(value))
    yield b")"
