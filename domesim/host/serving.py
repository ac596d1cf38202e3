"""A page of this machine for this machine: a server that nobody else can reach, read or write."""

from __future__ import annotations

import http.server
import re
from http import HTTPStatus
from typing import Any

from domesim.errors import InputError, reason

NAMES = ("127.0.0.1", "localhost")
"""Names of this machine in the page's address."""
_LENGTH = re.compile(r"[0-9]{1,9}", re.ASCII)


def listening(
    handler: type[http.server.BaseHTTPRequestHandler], port: int
) -> http.server.ThreadingHTTPServer:
    """A server at 127.0.0.1; it runs by `serve_forever`.

    Parameters
    ----------
    handler
        What it answers: a class on `OwnPage`.
    port
        Its port; 0 for any that is free.

    Raises
    ------
    InputError
        If the port is not free.
    """
    try:
        return http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    except OSError as error:
        raise InputError(
            f"--port {port}: wanted to listen there, got '{reason(error)}'; name another"
        ) from error


class OwnPage(http.server.BaseHTTPRequestHandler):
    """What a page's server refuses and says, whatever the page is."""

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
        self.say(HTTPStatus.BAD_REQUEST)
        return False

    def end_headers(self) -> None:
        """Adds what holds for all that is sent: it is for this page alone."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()

    def posted(self, largest: int) -> bytes | None:
        """What the page sends; None if it has no length, or too large a one: that is answered."""
        length = self.headers.get("Content-Length", "")
        size = int(length) if _LENGTH.fullmatch(length) else 0
        if 0 < size <= largest:
            return self.rfile.read(size)
        self.close_connection = True  # what follows is not read
        self.say(HTTPStatus.BAD_REQUEST)
        return None

    def give(self, content: bytes, kind: str) -> None:
        """Sends a file of that media type."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def say(self, status: HTTPStatus) -> None:
        """Sends a status alone."""
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - http.server's name
        """Nothing: each request would be a line."""
