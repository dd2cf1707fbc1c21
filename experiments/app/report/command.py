"""Write or serve the report of a run, a page that works offline.

    sdr-jax report runs/a             # rewrites runs/a/report.html
    sdr-jax report runs/a --serve     # shows it in a browser, also during the run

RUN is the folder (--out) of `sdr-jax fit`, `camvid`, `cityscapes` or `labelmefacade`. During a run, the run
itself updates the page every 15 seconds; this command rewrites the page of a finished run. Studies write
other reports; their flag --rederive rewrites them.
"""

from __future__ import annotations

from pathlib import Path

from jinja2 import TemplateError

from common.command import Arguments, exit_code
from common.errors import UserError
from common.files import check_file, write
from experiments.app.report import live, page
from experiments.app.report.folder import NAME, SUMMARY, read
from experiments.config import parsers
from experiments.tables.form import INCOMPLETE


def make(path: Path, out: Path | None) -> Path:
    """Write the page of a run, and return its path.

    Args:
        path: the run's folder.
        out: the page; by default in that folder.

    Raises:
        UserError: the folder is not a finished run, one of its files is of another version, or the page
            cannot be written.
    """
    out = out or path / NAME
    if out.is_dir():
        raise UserError(f"--out {out} is a folder; pass a file, such as {out / NAME}")
    if path.is_dir():
        check_file("--out", out)
    try:
        text = page.html(read(path).summary, path)
    except UserError:
        raise
    except (*INCOMPLETE, TemplateError) as error:
        raise UserError(
            f"{path} has a file that this version did not write, or that was changed ({error!r})"
        ) from None
    write(out, text)
    return out


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.report().parse_args(arguments)

    def work() -> None:
        run = options.run
        if options.serve is None:
            print(make(run, options.out))
            return
        if options.out is not None:
            raise UserError(f"--serve shows RUN/{NAME} and cannot be used with --out {options.out}")
        if not run.is_dir():
            what = "is a file" if run.exists() else "does not exist"
            raise UserError(f"{run} {what}; pass the --out folder of a run")
        if (run / SUMMARY).is_file() and not (run / NAME).is_file():
            make(run, None)
        live.serve(run, options.serve)

    return exit_code(work, debug=options.debug, resumes=False)
