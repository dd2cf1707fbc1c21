"""Report on this machine and on a folder of labelled images: `sdr-jax doctor`."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from common.command import Arguments, exit_code
from common.errors import UserError
from common.files import check_file, write
from experiments.config import parsers

if TYPE_CHECKING:
    from experiments.config import TargetName

OUT = Path("runs/doctor")
PAGE, SHEET = "doctor.html", "doctor.png"
OF_COMMANDS: dict[str, TargetName] = {
    "camvid": "camvid",
    "cityscapes": "cityscapes",
    "labelmefacade": "labelmefacade",
}
"""Targets with their own command."""
WIDE = 640
"""The largest width of a picture on the page."""


def diagnose(
    data: Path | None,
    target: str | None = None,
    write_to: Path | None = None,
    out: Path | None = None,
) -> int:
    """Check the machine and a folder, and print the findings.

    Args:
        data: folder of labelled images; None checks the machine alone.
        target: name or path of a target's file; by default the folder's own, or a proposal.
        write_to: where to write the proposal.
        out: folder of the page and the picture, by default `OUT`.

    Returns:
        0, or 2 if the folder cannot be used as it is.

    Raises:
        UserError: there are no labelled images, a file is wrong, ``write_to`` exists, or a target is given
            with it.
    """
    from experiments.app.doctor import machine

    if data is None and not (target is None and write_to is None and out is None):
        raise UserError("--target, --write and --out need DATA, a folder of labelled images")
    if target is not None and write_to is not None:
        raise UserError(
            f"--write {write_to} writes a proposed file, --target {target} names one that exists; give one"
        )
    if write_to is not None:
        if write_to.exists():
            raise UserError(f"--write {write_to} exists; name another file, or remove it")
        check_file("--write", write_to)
    found = machine.look()
    width = max(len(name) for name, _ in found.facts)
    for name, value in found.facts:
        print(f"{name:{width}s}  {value}")
    for line in found.amiss:
        print(f"! {line}")
    return 0 if data is None else _folder(data, target, write_to, out or OUT)


def _folder(data: Path, target: str | None, write_to: Path | None, out: Path) -> int:
    from common.labels.target_file import find_target, parse_target
    from experiments.app.doctor.outlines import line
    from experiments.app.doctor.propose import Proposal, propose
    from experiments.app.doctor.survey import survey

    if target is not None:
        own = find_target(target, data)
        if not data.is_dir():
            raise UserError(f"{data}: no such folder; expected one with images and labels")
        proposal = Proposal("", [])
    else:
        proposal = propose(data)
        own = parse_target(proposal.text, str(data / "target.yaml"))
    seen = survey(own, data)
    drawn, pair = _outlines(own, seen)
    if proposal.text and (outlines := line(drawn)) and not own.outlines:
        proposal = Proposal(f"{proposal.text.rstrip()}\n{outlines}", proposal.notes)
    if write_to is not None:
        write(write_to, proposal.text)
    print(f"\n{data} as {own.name}: {_counted(seen)}")
    for note in proposal.notes:
        print(f"  {note}")
    sizes = ", ".join(f"{count} of {w}x{h}" for (w, h), count in seen.sizes[:4])
    more = " and others" if len(seen.sizes) > 4 else ""
    print(f"  sizes: {sizes}{more}")
    wide = max(map(len, own.classes))
    print(f"  {'class':{wide}s}  pixels %  images %  mean row  rendered as")
    for one in seen.classes:
        row = f"{one.row:8.2f}" if one.share else f"{'-':>8s}"
        renders = ", ".join(one.renders) or "labels alone"
        print(
            f"  {one.name:{wide}s}  {100 * one.share:8.2f}  {100 * one.images:8.0f}  {row}  {renders}"
        )
    print(f"  {'void':{wide}s}  {100 * seen.void:8.2f}  (of all pixels; {seen.read} label files)")
    if drawn:
        print(
            "  boundary with the sky per area: sides at which the sky begins, over the pixels of a class"
        )
        print(f"  {'class':{wide}s}  labels  renders  outlined by")
        for row in drawn:
            by = f"{100 * row.outline:g} %: {row.outlined:.2f}" if row.outline else "-"
            print(f"  {row.name:{wide}s}  {row.real:6.2f}  {row.exact:7.2f}  {by}")
    for fault in seen.faults:
        print(f"! {fault.what}\n    {fault.mend}")
    costs = _costs(own, data, seen) if any(own.rendered) else Costs()
    if not any(own.rendered):
        print(
            "! no class has 'renders', which fit needs: edit the file, then run doctor again for minutes"
        )
    elif costs.minutes:
        if costs.fit:
            print(f"fit: {costs.fit}")
        print(
            f"Minutes on {costs.cores} cores, about, after {costs.measured} seconds of measurement:"
        )
    else:
        print("! minutes are not known: nets or streets cannot be made here, see above")
    for command, minutes in costs.minutes:
        print(f"  {minutes:>6s}  {command}")
    _pictures(own, seen, out, data, proposal.text, costs, drawn, pair)
    written = f"; {write_to} has the file" if write_to is not None else ""
    print(f"{out / PAGE} and {out / SHEET} show images with their labels{written}")
    if write_to is None and target is None and not (data / "target.yaml").exists():
        print(f"\nThe file that is proposed; --write FILE writes it:\n\n{proposal.text}")
    return 0 if seen.usable else 2


def _counted(seen: Any) -> str:
    return ", ".join(
        f"{count} images of {seen.groups[split]} groups in {split}"
        for split, count in seen.counts.items()
    ) or "no images"  # fmt: skip


def _outlines(target: Any, seen: Any) -> tuple[list[Any], list[tuple[str, Any]]]:
    """The boundaries of labels and renders, and pictures of both; none where nothing can be compared."""
    from experiments.app.doctor import outlines
    from scene.render import RendererError
    from seg.data import load

    if not seen.usable or not any(target.rendered):
        return [], []
    width, height = seen.size
    labels = load(seen.labelled, target, (height, width)).labels
    try:
        renders = outlines.renders(seen.size)
    except RendererError:  # the machine's own lines say so
        return [], []
    rows = outlines.compare(target, labels, renders)
    return rows, outlines.pictures(target, labels, renders, rows)


class Costs(NamedTuple):
    """What commands cost on this machine."""

    minutes: Sequence[tuple[str, str]] = ()  # of each command; none where nothing runs
    fit: str = ""  # the size and time of fit
    cores: int = 0
    measured: int = 0  # seconds


def _costs(target: Any, data: Path, seen: Any) -> Costs:
    """Measure the pace of this machine, and estimate what commands for a folder take."""
    from experiments.app.doctor import costs, machine
    from experiments.evaluation.pace import SECONDS
    from experiments.session import session

    cores = machine.cores()
    try:
        pace = session.measured_here(cores)
    except RuntimeError:  # a RendererError, or JAX finds no device
        return Costs()
    choice = costs.choice(target, data, seen.photographs, pace)
    size = seen.size if choice is None else choice.size
    rows = []
    for command, cost in costs.commands(target, data, size, OF_COMMANDS).items():
        minutes = pace.seconds_of(cost, cores) / 60
        rows.append((command, f"{minutes:.1f}" if minutes < 10 else f"{minutes:.0f}"))
    fit = "" if choice is None else choice.text(cores)
    return Costs(rows, fit, cores, round(2 * SECONDS))


def _pictures(
    target: Any,
    seen: Any,
    out: Path,
    root: Path,
    text: str,
    costs: Costs,
    drawn: Any,
    pair: Any,
) -> None:
    """Write the page and the picture."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    from experiments.app.doctor.survey import overlays, sheet

    width, height = seen.size
    shown = overlays(target, seen.shown, (min(width, WIDE), round(height * min(1, WIDE / width))))
    out.mkdir(parents=True, exist_ok=True)
    write(out / SHEET, _png(sheet([own for _, own in shown], target)))
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    page = environment.get_template("page.html").render(
        target=target,
        survey=seen,
        root=root,
        counted=_counted(seen),
        costs=costs,
        text=text,
        drawn=drawn,
        pair=_embedded(pair),
        pictures=_embedded(shown),
    )
    write(out / PAGE, page)


def _embedded(pictures: Any) -> list[dict[str, str]]:
    """Pictures with their names, as data URIs."""
    return [
        {"name": name, "data": "data:image/png;base64," + base64.b64encode(_png(one)).decode()}
        for name, one in pictures
    ]


def _png(picture: Any) -> bytes:
    data = io.BytesIO()
    picture.save(data, "PNG")
    return data.getvalue()


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.doctor().parse_args(arguments)
    os.environ["NPROC"] = "1"  # XLA's threads, as for nets of all commands
    return exit_code(
        lambda: diagnose(options.data, options.target, options.write, options.out),
        debug=options.debug,
        goes_on=False,
    )
