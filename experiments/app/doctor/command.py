"""Check the installation and a folder of labelled images.

    sdr-jax doctor                              # versions, GPU, renderers, extras
    sdr-jax doctor DATA                         # and the folder: a page in runs/doctor
    sdr-jax doctor DATA --write DATA/target.yaml     # writes the proposed target.yaml
    sdr-jax doctor DATA --target camvid         # reads the folder by an existing target

The folder is read by its own target.yaml or by that of a known data set with the same layout and label
values. Otherwise doctor proposes a target.yaml, in which you fill in what it cannot know, such as the names
of classes.
"""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from common.command import Arguments, exit_code, say
from common.errors import UserError, counted
from common.files import check_file, check_folder, write
from common.folder import refuse_unwritable
from experiments.config import parsers

OUT = Path("runs/doctor")
PAGE, SHEET = "doctor.html", "doctor.png"
WIDE = 640
"""The largest width of an image on the page."""


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
        out: folder of the page and the image, by default `OUT`.

    Returns:
        0, or 2 if the folder cannot be used as it is.

    Raises:
        UserError: there are no labelled images, a file is wrong, ``write_to`` exists, or a target is named
            with it.
    """
    from experiments.app.doctor import machine

    if data is None and not (target is None and write_to is None and out is None):
        raise UserError("--target, --write and --out need DATA, a folder of labelled images")
    if target is not None and write_to is not None:
        raise UserError(
            f"--write {write_to} proposes a file, and --target {target} names one; use only one of them"
        )
    if write_to is not None:
        check_file("--write", write_to)
        if write_to.exists():
            raise UserError(
                f"--write {write_to} exists; run doctor without --write to check it, or name another file"
            )
    if out is not None:
        refuse_unwritable(out)
    if data is not None:
        check_folder(data, "one with images and labels")
    facts, extras, problems = machine.look()
    if data is None:  # otherwise the folder's lines matter more
        facts = [*facts, *extras]
    width = max(len(name) for name, _ in facts)
    for name, value in facts:
        say(f"{name:{width}s}  {value}")
    for problem in problems:
        say(f"! {problem}")
    return 0 if data is None else _folder(data, target, write_to, out or OUT)


def _folder(data: Path, target: str | None, write_to: Path | None, out: Path) -> int:
    import yaml

    from common.labels.target_file import find_target, parse_target
    from experiments.app.doctor.outlines import line
    from experiments.app.doctor.propose import Proposal, propose
    from experiments.app.doctor.survey import Fault, survey

    if target is not None:
        target_file = find_target(target, data)
        proposal = Proposal("", [])
    else:
        proposal = propose(data)
        target_file = parse_target(proposal.text, str(data / "target.yaml"))
    findings = survey(target_file, data)
    # Outlines of 0 %, too, are the file's own: they say that annotators draw holes.
    has_outlines = target_file.outlines or "outlines" in (yaml.safe_load(proposal.text) or {})
    boundaries, examples = _outlines(target_file, findings, propose=not has_outlines)
    if proposal.text and (outlines := line(boundaries)) and not has_outlines:
        proposal = Proposal(f"{proposal.text.rstrip()}\n{outlines}", proposal.notes)
    if write_to is not None:
        write(write_to, proposal.text)
    say(f"\n{data} as {target_file.name}: {_counts(findings)}")
    for note in proposal.notes:
        say(f"  {note}")
    if findings.sizes:
        _print_tables(findings, boundaries)
    has_renders = any(target_file.rendered)
    if not has_renders:
        cure = "name the engine's classes in the file, and run doctor again to see run times"
        lacking = Fault("no class has 'renders', which fit needs", cure)
        findings = findings._replace(faults=[*findings.faults, lacking])
    for fault in findings.faults:
        say(f"! {fault.what}\n    {fault.fix}")
    can_train = has_renders and bool(findings.sizes)
    costs = _costs(target_file, data, findings) if can_train else Costs()
    if costs.minutes:
        if costs.fit:
            say(f"fit: {costs.fit}")
        say(
            f"Estimated minutes on {costs.cores} cores, from a measurement of {costs.measured} seconds:"
        )
    elif can_train:
        say("! run times unknown: this machine cannot train or render, see above")
    for command, minutes in costs.minutes:
        say(f"  {minutes:>6s}  {command}")
    _write_page(target_file, findings, out, data, proposal, costs, boundaries, examples)
    ending = f"; wrote {write_to}" if write_to is not None else ""
    say(f"{out / PAGE} and {out / SHEET} show images with their labels{ending}")
    if write_to is None and target is None and not (data / "target.yaml").exists():
        say(f"\nProposed file, which --write FILE writes:\n\n{proposal.text}")
    return 0 if findings.usable else 2


def _print_tables(findings: Any, boundaries: Sequence[Any]) -> None:
    """Print the sizes of the images, the shares of the classes, and their boundaries with the sky."""
    sizes = ", ".join(f"{count} of {w}x{h}" for (w, h), count in findings.sizes[:4])
    more = " and others" if len(findings.sizes) > 4 else ""
    say(f"  sizes: {sizes}{more}")
    wide = max(len(name) for name in (*(share.name for share in findings.classes), "ignored"))
    say(f"  {'class':{wide}s}  pixels %  images %  mean row  rendered as")
    for share in findings.classes:
        row = f"{share.row:8.2f}" if share.share else f"{'-':>8s}"
        renders = ", ".join(share.renders) or "(trained on labels alone)"
        say(
            f"  {share.name:{wide}s}  {100 * share.share:8.2f}  {100 * share.images:8.0f}  {row}  {renders}"
        )
    ignored = f"{100 * findings.ignored:8.2f}  (of all pixels; {findings.read} labels read)"
    say(f"  {'ignored':{wide}s}  {ignored}")
    if boundaries:
        say("  boundary with the sky: pixel sides that touch the sky, per pixel of the class")
        say(f"  {'class':{wide}s}  labels  renders  with outline")
        for row in boundaries:
            outline = f"{100 * row.outline:g} %: {row.outlined:.2f}" if row.outline else "-"
            say(f"  {row.name:{wide}s}  {row.real:6.2f}  {row.exact:7.2f}  {outline}")


def _counts(findings: Any) -> str:
    return ", ".join(
        f"{counted(count, 'image')} of {counted(findings.groups[split], 'group')} in {split}"
        for split, count in findings.counts.items()
    ) or "no images"  # fmt: skip


def _outlines(target: Any, findings: Any, propose: bool) -> tuple[list[Any], list[tuple[str, Any]]]:
    """The boundaries of labels and renders, and images of both; none where nothing can be compared."""
    from experiments.app.doctor import outlines
    from scene.render import RendererError
    from seg.data import load

    if not findings.usable or not any(target.rendered):
        return [], []
    width, height = findings.size
    labels = load(findings.labelled, target, (height, width)).labels
    try:
        renders = outlines.renders(findings.size)
    except RendererError:  # the machine's own lines say so
        return [], []
    rows = outlines.compare(target, labels, renders, propose)
    return rows, outlines.pictures(target, labels, renders, rows)


class Costs(NamedTuple):
    """Run times of commands on this machine."""

    minutes: Sequence[tuple[str, str]] = ()  # of each command; none where nothing runs
    fit: str = ""  # the size and time of fit
    cores: int = 0
    measured: int = 0  # seconds


def _costs(target: Any, data: Path, findings: Any) -> Costs:
    """Measure the pace of this machine, and estimate the run times of commands for a folder."""
    from common.workers.pool import cores
    from experiments.app.doctor import costs
    from experiments.config.trainers import trainers_of, usable_gpus
    from experiments.evaluation.pace import SECONDS, Crew
    from experiments.session import session

    workers = cores()
    try:
        pace = session.measured_here(workers)
    except RuntimeError:  # a RendererError, or JAX finds no device
        return Costs()
    choice = costs.choice(target, data, findings.photographs, pace)
    size = findings.size if choice is None else choice.size
    rows, crew = [], Crew(pace, workers, trainers_of(None, usable_gpus()))
    for command, cost in costs.commands(target, data, size).items():
        minutes = crew.seconds_of(cost) / 60
        rows.append((command, f"{minutes:.1f}" if minutes < 10 else f"{minutes:.0f}"))
    fit = "" if choice is None else choice.text(workers)
    return Costs(rows, fit, workers, round(2 * SECONDS))


def _write_page(
    target: Any,
    findings: Any,
    out: Path,
    root: Path,
    proposal: Any,
    costs: Costs,
    boundaries: Any,
    examples: Any,
) -> None:
    """Write the page and the image."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    from experiments.app.doctor.survey import overlays, sheet

    width, height = findings.size
    size = min(width, WIDE), round(height * min(1, WIDE / width))
    overlaid = overlays(target, findings.shown, size)
    out.mkdir(parents=True, exist_ok=True)
    write(out / SHEET, _png(sheet([image for _, image in overlaid], target)))
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    page = environment.get_template("page.html").render(
        target=target,
        survey=findings,
        root=root,
        counts=_counts(findings),
        costs=costs,
        text=proposal.text,
        notes=proposal.notes,
        boundaries=boundaries,
        examples=_embedded(examples),
        overlays=_embedded(overlaid),
    )
    write(out / PAGE, page)


def _embedded(images: Any) -> list[dict[str, str]]:
    """Images with their names, as data URIs."""
    return [
        {"name": name, "data": "data:image/png;base64," + base64.b64encode(_png(image)).decode()}
        for name, image in images
    ]


def _png(image: Any) -> bytes:
    data = io.BytesIO()
    image.save(data, "PNG")
    return data.getvalue()


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.doctor().parse_args(arguments)
    os.environ["NPROC"] = "1"  # XLA's threads, as in all commands that train
    return exit_code(
        lambda: diagnose(options.data, options.target, options.write, options.out),
        debug=options.debug,
        resumes=False,
    )
