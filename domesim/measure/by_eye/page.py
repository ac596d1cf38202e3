"""The page that a viewer turns levels on, and its server.

Each setting is on the disk before the next one is asked for. If the browser, the server or the
machine stops, the viewer goes on where the settings end.
"""

from __future__ import annotations

import http.server
import json
import threading
from dataclasses import asdict
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from domesim.errors import InputError
from domesim.host.pages import hash_of_script
from domesim.host.serving import OwnPage, listening
from domesim.host.writing import write_whole
from domesim.measure.by_eye.session import (
    LARGEST,
    SETTINGS,
    STEP,
    Kind,
    Session,
    blocks_of,
    read_session,
    trials_of,
)

_PLACE = "/settings"


def server(
    folder: Path, kind: Kind, scene: str, digest: str, port: int = 0
) -> http.server.ThreadingHTTPServer:
    """A server of the page at 127.0.0.1; its `serve_forever` returns when all is set.

    Parameters
    ----------
    folder
        Where settings are kept.
    kind, scene, digest
        What is measured: the scene's name and digest.
    port
        Its port; 0 for any that is free.

    Raises
    ------
    InputError
        If the port is not free.
    """

    class Handler(_Handler):
        pass

    Handler.place, Handler.kind, Handler.digest = folder / SETTINGS, kind, digest
    Handler.page = page(kind, scene, digest).encode()
    return listening(Handler, port)


def page(kind: Kind, scene: str, digest: str) -> str:
    """The page: self-contained HTML.

    Parameters
    ----------
    kind, scene, digest
        See `server`.
    """
    import jinja2  # noqa: PLC0415 - slow to import
    from markupsafe import Markup  # noqa: PLC0415 - comes with Jinja

    folder = files("domesim.measure.by_eye").joinpath("templates")
    source, style, code = (
        folder.joinpath(f"by-eye.{end}").read_text(encoding="utf-8")
        for end in ("html.j2", "css", "js")
    )
    plan = {
        "kind": kind,
        "scene": scene,
        "digest": digest,
        "step": STEP,
        "blocks": [asdict(block) for block in blocks_of(kind)],
        "trials": [asdict(trial) for trial in trials_of(kind)],
    }
    told = json.dumps(plan).replace("<", "\\u003c")
    script = f"\nconst PLAN = {told};\n{code}\n"
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(source).render(
        stereo=kind == "stereo",
        scene=scene,
        settings=len(trials_of(kind)),
        style=Markup(style),
        script=Markup(script),
        script_hash=Markup(hash_of_script(script)),
    )


class _Handler(OwnPage):
    place: Path
    kind: Kind
    digest: str
    page: bytes

    def do_GET(self) -> None:  # noqa: N802 - http.server's name
        """Give the page, or the settings so far."""
        if self.path.partition("?")[0] == "/":
            self.give(self.page, "text/html; charset=utf-8")
        elif self.path != _PLACE:
            self.say(HTTPStatus.NOT_FOUND)
        elif (kept := self._kept()) is None:
            self.say(HTTPStatus.NO_CONTENT)
        else:
            self.give(kept.model_dump_json().encode(), "application/json")

    def do_POST(self) -> None:  # noqa: N802 - http.server's name
        """Keep settings, unless others would be lost; end when all are there."""
        if (content := self.posted(LARGEST if self.path == _PLACE else 0)) is None:
            return
        try:
            given = Session.model_validate_json(content)
            kept = self._kept()
            if (given.kind, given.digest) != (self.kind, self.digest):
                raise InputError("of another scene")
            if kept is not None and not given.continues(kept):
                raise InputError("settings that would replace others")
            write_whole(self.place, given.model_dump_json(indent=1).encode())
        except (InputError, ValidationError):
            self.say(HTTPStatus.CONFLICT)
            return
        self.say(HTTPStatus.NO_CONTENT)
        if given.done:  # from another thread: it waits for this one
            threading.Thread(target=self.server.shutdown).start()

    def _kept(self) -> Session | None:
        return read_session(self.place, self.kind, self.digest)
