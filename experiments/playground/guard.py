"""Keeps other sites' pages, other names of this machine, and large uploads away from the page."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

NAMES = frozenset({"127.0.0.1", "localhost"})
MOST_BYTES = 1_000_000
"""Of one upload; an attributes.json of ten components has 70,000."""


class Guard:
    """Refuses what did not come from the page itself: it can write folders in the user's name."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with a reason."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode().lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        status = refusal(headers)
        if not status:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await send({"type": "http.response.start", "status": status, "headers": []})
            await send({"type": "http.response.body", "body": b"refused\n"})


def refusal(headers: dict[str, str]) -> int:
    """The status with which a request is refused, 0 where it may pass.

    Args:
        headers: by lower-case name.
    """
    host = headers.get("host", "")
    origin = headers.get("origin")
    if urlsplit(f"//{host}").hostname not in NAMES:
        return 403
    if origin is not None and urlsplit(origin).netloc != host:
        return 403
    if "transfer-encoding" in headers:
        return 411
    length = headers.get("content-length", "0")
    if not length.isdigit() or int(length) > MOST_BYTES:
        return 413
    return 0
