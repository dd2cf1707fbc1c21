"""Keeps other sites' pages, other names of this machine, and large uploads away from the page."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

NAMES = ("127.0.0.1", "localhost")
MOST_BYTES = 1_000_000
"""Of one upload; an attributes.json of ten components has 70,000."""


class Guard:
    """Refuses what did not come from the page itself: it can write folders in the user's name."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = TrustedHostMiddleware(app, NAMES)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with a reason."""
        refused = scope["type"] in ("http", "websocket") and refusal(Headers(scope=scope))
        answer = PlainTextResponse("refused\n", refused) if refused else self._app
        await answer(scope, receive, send)


def refusal(headers: Headers) -> int:
    """The status with which a request to this host is refused, 0 where it may pass."""
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != headers.get("host"):
        return 403
    if "transfer-encoding" in headers:
        return 411
    length = headers.get("content-length", "0")
    return 0 if length.isdigit() and int(length) <= MOST_BYTES else 413
