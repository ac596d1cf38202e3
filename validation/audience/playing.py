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
from typing import Any

from pydantic import ValidationError

from domesim.errors import InputError, reason
from domesim.frames import write_whole
from validation.audience.files import ANSWERS, Answers, Study, require_of

_LARGEST = 1 << 20
"""Bytes of a viewer's answers."""
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
    try:
        return http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
    except OSError as error:
        raise InputError(
            f"--port {port}: wanted to listen there, got '{reason(error)}'; name another"
        ) from error


def answers_path(folder: Path, viewer: int) -> Path:
    """Where a viewer's answers are kept."""
    return folder / ANSWERS / f"viewer-{viewer:03}.json"


class _Handler(http.server.BaseHTTPRequestHandler):
    folder: Path
    study: Study

    def do_GET(self) -> None:
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
                self._say(HTTPStatus.NO_CONTENT)
        else:
            self._say(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Keep a viewer's answers."""
        match = _VIEWER.fullmatch(self.path)
        size = int(self.headers.get("Content-Length") or 0)
        # Another page in the same browser may not write here
        own = self.headers.get("Origin") in (None, f"http://{self.headers.get('Host')}")
        if match is None or not 0 < size <= _LARGEST or not own:
            self._say(HTTPStatus.BAD_REQUEST)
            return
        try:
            given = Answers.model_validate_json(self.rfile.read(size))
            require_of(given, self.study, self.path)
            if given.viewer != int(match[1]):
                raise InputError("another viewer's")
            self._keep(given)
        except (InputError, ValidationError, OSError):
            self._say(HTTPStatus.CONFLICT)
        else:
            self._say(HTTPStatus.NO_CONTENT)

    def _keep(self, given: Answers) -> None:
        """Write answers, unless others would be lost."""
        path = answers_path(self.folder, given.viewer)
        path.parent.mkdir(exist_ok=True)
        if path.is_file():
            kept = Answers.model_validate_json(path.read_bytes())
            if given.answers[: len(kept.answers)] != kept.answers:
                raise InputError("answers that would replace others")
        write_whole(path, given.model_dump_json(indent=1).encode())

    def _give(self, path: Path, kind: str) -> None:
        try:
            content = path.read_bytes()
        except OSError:
            self._say(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def _say(self, status: HTTPStatus) -> None:
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - http.server's name
        """Nothing: each picture would be a line."""
