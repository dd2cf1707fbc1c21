"""The page of a run while it goes on: the run writes it anew, and a browser on this machine can show it."""

from __future__ import annotations

import shlex
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from common.files import write
from common.folder import read_config
from common.interrupt import PROGRAM
from common.loopback import HOST, check_port, refusal
from experiments.app.report import page
from experiments.app.report.folder import NAME, RunFolder
from experiments.session.session import Session
from experiments.tables.form import Report


def watch(run: Session[Any], known: Report) -> None:
    """Make a run write its page anew as it makes progress, at most every `page.EVERY` seconds.

    Args:
        run: the run.
        known: the fields of its report that are known at the start.
    """
    out, config = run.config.out, read_config(run.config.out)

    def told(share: float, said: str) -> None:
        records = run.evaluations.records, run.finals.records
        found = RunFolder(out, known, config, *records, None, None, None, None)
        text = page.under_way(found, page.Status(share, said))
        write(out / NAME, text, sync=False)

    command = shlex.join([PROGRAM, "report", str(out), "--serve"])
    run.progress.say(f"Page: {out / NAME}, as the run goes on; {command} shows it")
    run.progress.tell(page.EVERY, told)


def serve(folder: Path, port: int) -> None:
    """Serve the page in a run's folder until Ctrl-C; an unfinished run writes it anew.

    Args:
        folder: the run's folder.
        port: the port on this machine's own address.

    Raises:
        UserError: the port cannot be used.
    """
    check_port(port, "--serve")

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status = refusal(self.headers) or (200 if self.path == "/" else 404)
            data = b"refused\n" if status != 200 else _text(folder)
            self.send_response(status)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(data)))
            self.send_header("Cache-Control", "no-store")
            if (folder / NAME).exists():
                changed = (folder / NAME).stat().st_mtime
                self.send_header("Last-Modified", self.date_time_string(changed))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: Any) -> None:
            """Do not log requests."""

    with ThreadingHTTPServer((HOST, port), Answer) as server:
        print(f"http://{HOST}:{server.server_port} (Ctrl-C ends it)", flush=True)
        server.serve_forever()


def _text(folder: Path) -> bytes:
    """The page as it is now; before it exists, a page that reloads itself."""
    try:
        return (folder / NAME).read_bytes()
    except FileNotFoundError:
        wait = f'<meta http-equiv="refresh" content="{page.EVERY}">'
        return f"{wait}<p>There is no {NAME} yet.</p>".encode()
