"""The scene that a command line names, as it is sent to workers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

from domesim.errors import InputError
from domesim.host.files import open_plain
from domesim.scene import Scene, load_scene


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
    black, ambient, gamut
        What belongs to the grade, as of `domesim.scene.grade.Grade`; None for the scene's own.
    content
        Digest of what these files hold; "" if it is not known yet.
    """

    name: str
    transport: Path | None = None
    seat: str | None = None
    black: str | None = None
    ambient: str | None = None
    gamut: str | None = None
    content: str = ""
    _scene: Scene | None = field(default=None, repr=False, compare=False)

    def load(self) -> Scene:
        """Loads the scene, or returns the one that `settled` took.

        Raises
        ------
        InputError
            If a file cannot be read or holds something else than `content`, files do not belong
            together, or there is no such seat.
        """
        if self._scene is not None:
            return self._scene
        scene = load_scene(self.name).asked(self.transport, self.seat)
        scene = scene.with_grade(self.black, self.ambient, self.gamut)
        if self.content and self._content_of(scene) != self.content:
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
        content = self._content_of(scene)
        return replace(self, name=str(name), transport=transport, content=content, _scene=scene)

    def __getstate__(self) -> dict[str, Any]:
        """Without the scene, which may be large: other processes load it."""
        return {**vars(self), "_scene": None}

    def settings(self) -> dict[str, Any]:
        """Settings that results depend on, for JSON."""
        return {
            "scene": Path(self.name).name,
            "seat": self.seat,
            "black": self.black,
            "ambient": self.ambient,
            "gamut": self.gamut,
            "scene_content": self.content,
        }

    def options(self) -> dict[str, str]:
        """The options that chose it: name -> value."""
        options = {"--scene": Path(self.name).name}
        if self.transport is not None:
            options["--transport"] = self.transport.name
        chosen = {name: getattr(self, name) for name in ("seat", "black", "ambient", "gamut")}
        return options | {f"--{name}": value for name, value in chosen.items() if value is not None}

    def _content_of(self, scene: Scene) -> str:
        """SHA-256 of what the scene was made from: its file, files named there, and the transport.

        It does not depend on the seat, on what belongs to the grade, on where the files are, nor on
        comments in the scene's.
        """
        if self.transport is None:
            return scene.content
        with open_plain(self.transport) as file:
            transport = hashlib.file_digest(file, "sha256").hexdigest()
        return hashlib.sha256(f"{scene.content} {transport}".encode()).hexdigest()
