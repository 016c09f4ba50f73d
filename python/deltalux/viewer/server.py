"""The server of a view: its page, and one socket a page, on this machine alone.

Web sockets are not covered by the same-origin rule: whoever connects must come from our own page (``Host`` and
``Origin``), and know the token of this run.
"""

from __future__ import annotations

import http
import json
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .client import Client
from .messages import MOST_BYTES, parsed
from .requests import Requests
from .stage import Stage

__all__ = ["DEFAULT_PORT", "Server", "check_installed"]

DEFAULT_PORT = 8765
_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_PAGE = Path(__file__).parent / "page"
_MEDIA = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; media-src blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self' http://127.0.0.1:* http://localhost:*"
)
_HELLO = 10.0
"""Seconds within which a page must say its token."""
_WINDOW, _MOST = 2.0, 800
"""Seconds, and how many messages of one page in them."""
_WRONG_TOKEN, _TOO_MANY = 4401, 1008


def check_installed() -> None:
    """Refuses to begin where what the server stands on is missing; ModuleNotFoundError says how to get it."""
    try:
        import websockets.sync.server  # noqa: F401
    except ImportError:
        raise ModuleNotFoundError(
            "expected the package websockets, which the live view needs: pip install 'deltalux[view]'"
        ) from None


class Server:
    """Serves a stage on one port.

    Parameters
    ----------
    stage
        What is played.
    requests
        What pages may ask for.
    welcome
        What a page is told at the start.
    host, port
        Where to listen; another address than this machine's own must be meant. Port 0: any that is free.

    Raises
    ------
    ModuleNotFoundError
        If `websockets` is not installed.
    ValueError
        If the host is all addresses at once: requests are held to name the one.
    OSError
        If the port is taken.
    """

    def __init__(
        self, stage: Stage, requests: Requests, welcome: Callable[[], dict[str, Any]], host: str, port: int
    ) -> None:
        check_installed()
        from websockets.sync.server import serve

        if host in ("", "0.0.0.0", "::"):
            raise ValueError(f"expected one address of this machine, by which others call it, got {host!r}")
        self._stage, self._requests, self._welcome = stage, requests, welcome
        self.token = secrets.token_urlsafe(16)
        self._files = {f"/{own.name}": own for own in _PAGE.iterdir() if own.suffix in _MEDIA}
        self._clients: dict[int, Client] = {}
        self._count, self._lock = 0, threading.Lock()
        listening = socket.create_server((host, port))
        self.port = listening.getsockname()[1]
        self._hosts = {f"{own}:{self.port}" for own in (*_LOOPBACK, host)}
        self._server = serve(
            self._talk,
            sock=listening,
            process_request=self._page,
            compression=None,
            max_size=MOST_BYTES,
            server_header="deltalux",
            close_timeout=2.0,
        )
        self.url = f"http://{host}:{self.port}/#{self.token}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    def start(self) -> None:
        """Listens."""
        self._thread.start()

    def end(self) -> None:
        """Closes all pages' sockets and listens no more."""
        self._server.shutdown()
        self._thread.join(5.0)

    def say(self, words: Mapping[str, Any], but: int = 0) -> None:
        """Tells all pages, but one that knows."""
        with self._lock:
            clients = [client for number, client in self._clients.items() if number != but]
        for client in clients:
            client.say(words)

    # HTTP: the page's files, for those who know where they are.

    def _page(self, connection: Any, request: Any) -> Any:
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        def answer(status: http.HTTPStatus, media: str, body: bytes) -> Any:
            headers = Headers()
            for name, value in {
                "Content-Type": media,
                "Content-Length": str(len(body)),
                "Content-Security-Policy": _POLICY,
                "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer",
                "Cache-Control": "no-store",
                "Connection": "close",
            }.items():
                headers[name] = value
            return Response(status.value, status.phrase, headers, body)

        def refused(status: http.HTTPStatus) -> Any:
            return answer(status, "text/plain; charset=utf-8", status.phrase.encode())

        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return refused(http.HTTPStatus.FORBIDDEN)
        path = request.path.partition("?")[0]
        if path == "/live":
            if len(origins) != 1 or origins[0].removeprefix("http://") not in self._hosts:
                return refused(http.HTTPStatus.FORBIDDEN)
            return None
        file = self._files.get("/index.html" if path == "/" else path)
        if file is None:
            return refused(http.HTTPStatus.NOT_FOUND)
        return answer(http.HTTPStatus.OK, _MEDIA[file.suffix], file.read_bytes())

    # One page's socket: this thread listens, another one sends.

    def _talk(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            if not self._known(connection):
                connection.close(_WRONG_TOKEN, "expected the token of the address that the view printed")
                return
            with self._lock:
                self._count += 1
                client = Client(self._stage, connection.send, self._count)
                self._clients[client.number] = client
        except ConnectionClosed:
            return
        sender = threading.Thread(target=self._send, args=(connection, client), daemon=True)
        try:
            client.say({"welcome": {**self._welcome(), "client": client.number}})
            client.want({})
            sender.start()
            self._listen(connection, client)
        except ConnectionClosed:
            pass
        finally:
            with self._lock:
                self._clients.pop(client.number, None)
            client.leave()

    def _known(self, connection: Any) -> bool:
        """Whether the first message has the token."""
        try:
            message = connection.recv(timeout=_HELLO)
            found = json.loads(message)
        except (TimeoutError, ValueError, RecursionError):
            return False
        said = found.get("hello") if isinstance(found, dict) else None
        return isinstance(said, str) and secrets.compare_digest(said.encode(), self.token.encode())

    def _send(self, connection: Any, client: Client) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            client.run(self._welcome)
        except ConnectionClosed:
            pass
        except Exception as error:
            # A fault of ours in one page's thread must not look like a stopped picture.
            client.leave()
            connection.close(1011, f"{type(error).__name__}: {error}"[:100])
            raise

    def _listen(self, connection: Any, client: Client) -> None:
        times: deque[float] = deque()
        for message in connection:
            now = time.monotonic()
            times.append(now)
            while times[0] < now - _WINDOW:
                times.popleft()
            if len(times) > _MOST:
                connection.close(_TOO_MANY, "too many messages")
                return
            try:
                for kind, value in parsed(message).items():
                    taken = self._requests.do(client, kind, value)
                    if taken:
                        self.say({"state": taken, "by": client.number}, but=client.number)
            except (ValueError, TimeoutError, OSError) as error:
                client.say({"problem": " ".join(str(error).split())})
                # The page has it in its own copy by now.
                client.say({"state": self._stage.state(), "by": 0})
