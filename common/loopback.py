"""Which requests a page served on this machine answers: its own, none from other sites or names."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from email.message import Message

from common.errors import UserError

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
MOST_BYTES = 1_000_000
"""The most bytes of one upload; an attributes.json of ten components has 70,000."""


def refusal(headers: Mapping[str, str] | Message) -> int:
    """Choose the status with which to refuse a request, 0 if it may pass.

    A page of another site may send requests here, and another name may resolve to this machine: both show
    in the headers.
    """
    host, origin = headers.get("host", ""), headers.get("origin", "")
    if host.partition(":")[0].lower() not in NAMES:
        return 400
    if origin and origin.partition("://")[2] != host:  # no address is parsed: it may be malformed
        return 403
    if headers.get("transfer-encoding", ""):
        return 411
    length = headers.get("content-length", "0")
    is_short = length.isascii() and length.isdigit() and len(length) <= len(str(MOST_BYTES))
    return 0 if is_short and int(length) <= MOST_BYTES else 413


def check_port(port: int, flag: str = "--port") -> None:
    """Raise UserError unless a page can be served at a port."""
    if not 1 <= port <= 65535:
        raise UserError(f"{flag} must lie in 1..65535, not {port}")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise UserError(f"{flag} {port}: {error.strerror}; choose another") from None
