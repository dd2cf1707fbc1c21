"""Refuses requests from other sites, under other host names, and with large uploads."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from common.loopback import refusal


class Guard:
    """Refuses requests that do not come from the page itself."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with a reason."""
        refused = scope["type"] in ("http", "websocket") and refusal(Headers(scope=scope))
        answer = PlainTextResponse("refused\n", refused) if refused else self._app
        await answer(scope, receive, send)
