"""The page of an unfinished run, which the run keeps up to date and a browser on this machine can show."""

from __future__ import annotations

import shlex
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from common.command import PROGRAM
from common.errors import UserError
from common.files import write
from common.folder import CONFIG, read_config
from common.loopback import HOST, check_port, refusal
from experiments.app.report import page
from experiments.app.report.folder import NAME, RunFolder
from experiments.session.session import Session
from experiments.tables.form import Report


def watch(run: Session[Any], first_fields: Report) -> None:
    """Make a run update its page as it makes progress, at most every `page.EVERY` seconds.

    Args:
        run: the run.
        first_fields: the fields of its report that are known at the start.
    """
    out, config = run.config.out, read_config(run.config.out)

    def update(share: float, line: str) -> None:
        records = run.evaluations.records, run.finals.records
        folder = RunFolder(out, first_fields, config, *records, None, None, None, None)
        text = page.under_way(folder, page.Status(share, line))
        write(out / NAME, text, sync=False)

    command = shlex.join([PROGRAM, "report", str(out), "--serve"])
    run.progress.say(f"Report so far: {out / NAME}; {command} shows it in a browser")
    run.progress.tell(page.EVERY, update)


def serve(folder: Path, port: int) -> None:
    """Serve the page in a run's folder until Ctrl-C; an unfinished run updates it.

    Args:
        folder: the run's folder.
        port: the port on 127.0.0.1.

    Raises:
        UserError: the port cannot be used, or the folder is none of a run.
    """
    check_port(port, "--serve")
    if not (folder / CONFIG).is_file():
        raise UserError(
            f"{folder} is not the folder of a run: it has no {CONFIG}; pass the --out folder of a run"
        )

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
        print(f"http://{HOST}:{server.server_port} (press Ctrl-C to stop)", flush=True)
        server.serve_forever()


def _text(folder: Path) -> bytes:
    """The page as it is now; before it exists, a page that reloads itself."""
    try:
        return (folder / NAME).read_bytes()
    except FileNotFoundError:
        wait = f'<meta http-equiv="refresh" content="{page.EVERY}">'
        return f"{wait}<p>There is no {NAME} yet.</p>".encode()
