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
from domesim.host.files import read_plain
from validation.audience.files import ANSWERS, LARGEST, Answers, Study, require_of

NAMES = ("127.0.0.1", "localhost")
"""Names of this machine in the page's address."""
_PICTURE = re.compile(r"/pictures/[A-Za-z0-9_.-]+\.png")
_LENGTH = re.compile(r"[0-9]{1,9}", re.ASCII)
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

    def parse_request(self) -> bool:
        """Refuses what another site's page asks in the same browser.

        Such a page may have a name of its own that leads to this machine: its Host is another one.
        """
        if not super().parse_request():
            return False
        port = self.connection.getsockname()[1]
        hosts = {f"{name}:{port}" for name in NAMES}
        said = self.headers.get_all("Host", [])
        origins = self.headers.get_all("Origin", [])
        own = {f"http://{each}" for each in hosts}
        if len(said) == 1 and said[0].lower() in hosts and set(origins) <= own:
            return True
        self._say(HTTPStatus.BAD_REQUEST)
        return False

    def end_headers(self) -> None:
        """Adds what holds for all that is sent: it is for this page alone."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()

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
        length = self.headers.get("Content-Length", "")
        size = int(length) if _LENGTH.fullmatch(length) else 0
        if match is None or not 0 < size <= LARGEST:
            self.close_connection = True  # what follows is not read
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
            kept = Answers.model_validate_json(read_plain(path, LARGEST))
            if given.answers[: len(kept.answers)] != kept.answers:
                raise InputError("answers that would replace others")
        write_whole(path, given.model_dump_json(indent=1).encode())

    def _give(self, path: Path, kind: str) -> None:
        try:
            content = read_plain(path)
        except (InputError, OSError):
            self._say(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _say(self, status: HTTPStatus) -> None:
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - http.server's name
        """Nothing: each picture would be a line."""
