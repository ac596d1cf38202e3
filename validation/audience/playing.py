"""A study's page on this machine: a server that nobody else can reach keeps each answer at once.

It serves the page and the pictures, and takes a viewer's answers after each choice, written whole
before it says so. If the browser, the server or the machine stops, the viewer goes on where the
answers end. Without the server the page works from the folder, too; then the browser keeps the
answers, and gives them as a file when the viewer is done.
"""

from __future__ import annotations

import http.server
import re
from http import HTTPStatus
from pathlib import Path

from pydantic import ValidationError

from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.files import read_plain
from domesim.host.serving import OwnPage, listening
from validation.audience.files import ANSWERS, LARGEST, Answers, Study, require_of

_PICTURE = re.compile(r"/pictures/[A-Za-z0-9_.-]+\.png")
_VIEWER = re.compile(r"/answers/([0-9]{1,4})")


def server(folder: Path, study: Study, port: int = 0) -> http.server.ThreadingHTTPServer:
    """A server of the study's page at 127.0.0.1; it runs by `serve_forever`.

    Parameters
    ----------
    folder, study
        The study.
    port
        Its port; 0 for any that is free.

    Raises
    ------
    InputError
        If the port is not free.
    """

    class Handler(_Handler):
        pass

    Handler.folder, Handler.study = folder, study
    return listening(Handler, port)


def answers_path(folder: Path, viewer: int) -> Path:
    """Where a viewer's answers are kept."""
    return folder / ANSWERS / f"viewer-{viewer:03}.json"


class _Handler(OwnPage):
    folder: Path
    study: Study

    def do_GET(self) -> None:  # noqa: N802 - http.server's name
        """Give the page, a picture, or a viewer's answers so far."""
        asked = self.path.partition("?")[0]
        if asked == "/":
            self._give(self.folder / "index.html", "text/html; charset=utf-8")
        elif _PICTURE.fullmatch(asked):
            self._give(self.folder / asked[1:], "image/png")
        elif match := _VIEWER.fullmatch(asked):
            path = answers_path(self.folder, int(match[1]))
            if path.is_file():
                self._give(path, "application/json")
            else:
                self.say(HTTPStatus.NO_CONTENT)
        else:
            self.say(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:  # noqa: N802 - http.server's name
        """Keep a viewer's answers."""
        match = _VIEWER.fullmatch(self.path)
        if (content := self.posted(LARGEST if match else 0)) is None:
            return
        assert match is not None
        try:
            given = Answers.model_validate_json(content)
            require_of(given, self.study, self.path)
            if given.viewer != int(match[1]):
                raise InputError("another viewer's")
            self._keep(given)
        except (InputError, ValidationError, OSError):
            self.say(HTTPStatus.CONFLICT)
        else:
            self.say(HTTPStatus.NO_CONTENT)

    def _keep(self, given: Answers) -> None:
        """Write answers, unless others would be lost."""
        path = answers_path(self.folder, given.viewer)
        path.parent.mkdir(exist_ok=True)
        if path.is_file():
            kept = Answers.model_validate_json(read_plain(path, LARGEST))
            if given.answers[: len(kept.answers)] != kept.answers:
                raise InputError("answers that would replace others")
        write_whole(path, given.model_dump_json(indent=1).encode())

    def _give(self, path: Path, kind: str) -> None:
        try:
            content = read_plain(path)
        except (InputError, OSError):
            self.say(HTTPStatus.NOT_FOUND)
            return
        self.give(content, kind)
