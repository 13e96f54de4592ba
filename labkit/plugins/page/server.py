"""Offers the files of the page to browsers on this computer."""

from __future__ import annotations

import functools
import http.server
from pathlib import Path

from labkit.errors import InputError


class Handler(http.server.SimpleHTTPRequestHandler):
    """Answers with the files of a folder, which the browser asks for again each time, and writes no log."""

    def end_headers(self) -> None:
        """Ask the browser to load each file again."""
        self.send_header("Cache-Control", "no-cache")
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Write nothing."""

    def handle(self) -> None:
        """Answer a browser, which may go away."""
        try:
            super().handle()
        except ConnectionError:  # somebody closed the tab
            self.close_connection = True


def serve(folder: Path, port: int) -> http.server.ThreadingHTTPServer:
    """Return a server for a folder, at a port of this computer alone; 0 chooses a free one. Raises InputError."""
    handler = functools.partial(Handler, directory=str(folder))
    try:
        return http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be used ({reason})", field="port", value=port, allowed="another, or none") from None
