"""What all command lines share: help, errors in one line, and exit codes."""

from __future__ import annotations

import argparse
import ast
import os
import re
import shlex
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterable, Sequence, Set
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from common.errors import Unfinished, UserError, printable, printable_lines, suggestion

PROGRAM = "sdr-jax"
"""The first word of all commands."""
USAGE, BUG, INTERRUPTED, UNREAD = 2, 70, 130, 141
"""Exit codes: an error of the user; a bug; Ctrl-C; the reader of the output is gone (``| head``)."""
DEBUG = "--debug"
"""Flag of every command: show where an error comes from."""
HELP = ("-h", "--help", "--help-all")
Arguments = Sequence[str] | argparse.Namespace | None
"""Words of a command line, by default those of the program; or the result of its parser."""
Relation = tuple[str, Sequence[str], Sequence[str]]
"""A flag, those of which it needs one, and those with which it has no effect."""
_parsed: str | None = None
_running: str | None = None
"""The command line parsed last, and the one that `exit_code` runs."""


class _Layout(argparse.HelpFormatter):
    """Fills paragraphs to the width of the terminal, keeps the layout of examples, and shows defaults."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        parts = re.split(r"\n\s*\n", text.strip("\n"))
        return "\n\n".join(_laid_out(part, width) for part in parts) + "\n"

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        values = self._format_args(action, self._get_default_metavar_for_optional(action))
        return f"{', '.join(action.option_strings)} {values}"

    def _get_help_string(self, action: argparse.Action) -> str:
        text, default = action.help or "", action.default
        hidden = default in (None, "", argparse.SUPPRESS) or isinstance(default, bool | list)
        if hidden or not action.option_strings:
            return text
        return f"{text} (default: %(default)s)".strip()


def _laid_out(paragraph: str, width: int) -> str:
    """Fill a paragraph; a comment of an example goes on its own line if it does not fit."""
    if not paragraph.startswith((" ", f"{PROGRAM} ")):
        return textwrap.fill(paragraph, width)
    lines = textwrap.indent(textwrap.dedent(paragraph), "    ").splitlines()
    if max(map(len, lines)) > width:
        parts = [re.split(r" +(?=# )", line.rstrip(), maxsplit=1) for line in lines]
        lines = [
            line
            for command, *comments in parts
            for line in (*(f"    {comment}" for comment in comments), *_broken(command, width))
        ]
    return "\n".join(lines)


def _broken(command: str, width: int) -> list[str]:
    """Break a command into lines that end with a backslash."""
    parts = textwrap.wrap(
        command.strip(), width - 2, initial_indent="    ", subsequent_indent="        ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
    return [*(f"{part} \\" for part in parts[:-1]), parts[-1]]


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with exit code 2.

    ``--help`` shows the options of the parser itself; ``--help-all`` adds those of its groups.

    Args:
        name: the command after `PROGRAM`, such as "render".
        description: the help's first part; indented paragraphs keep their layout.

    Attributes:
        relations: what flags need and exclude.
    """

    def __init__(self, name: str, description: str | None) -> None:
        super().__init__(
            prog=f"{PROGRAM} {name}",
            description=description,
            formatter_class=_Layout,
            allow_abbrev=False,
            add_help=False,
        )
        self._positionals.title = "arguments"
        self._rare: list[argparse._ArgumentGroup] = []
        self.relations: list[Relation] = []
        self._common = self.add_argument_group("about this command")
        add = self._common.add_argument
        add("-h", "--help", action=_Help, everything=False, help="show this help")
        add(DEBUG, action="store_true", help="show where an error comes from")

    def group(self, title: str) -> Callable[..., argparse.Action]:
        """Add a group of options that only ``--help-all`` shows; returns its ``add_argument``."""
        if not self._rare:
            self._common.add_argument("--help-all", action=_Help, everything=True)
        self._rare.append(self.add_argument_group(title))
        return self._rare[-1].add_argument

    def format_help(self, everything: bool = False) -> str:
        """Format the short help, or all of it."""
        formatter = self._get_formatter()
        formatter.add_usage(self.usage or self._usage(), [], [])
        formatter.add_text(self.description)
        rare = [action for group in self._rare for action in group._group_actions]
        for action in self._common._group_actions:
            if "--help-all" in action.option_strings:
                titles = ", ".join(str(group.title) for group in self._rare)
                count = sum(action.help != argparse.SUPPRESS for action in rare)
                action.help = f"show {count} more options: {titles}"
        groups = [g for g in self._action_groups if g is not self._common]
        for group in (*groups, self._common):
            if everything or group not in self._rare:
                formatter.start_section(group.title)
                formatter.add_text(group.description)
                actions = [
                    a for a in group._group_actions if not (everything and a.dest == "help_all")
                ]
                formatter.add_arguments(actions)
                formatter.end_section()
        return formatter.format_help()

    def _usage(self) -> str:
        """Format the usage line: required arguments in the order of the help."""
        words = []
        for action in self._actions:
            value = action.metavar or "|".join(action.choices or ()) or action.dest.upper()
            more = " ..." if action.nargs in ("+", "*") else ""
            if not action.option_strings:
                words.append(f"[{value}]" if action.nargs in ("?", "*") else f"{value}{more}")
            elif action.required:
                words.append(f"{action.option_strings[-1]} {value}{more}")
        return " ".join(["%(prog)s", *words, "[options]"])

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse `Arguments`; unknown options are reported before missing ones."""
        if isinstance(args, argparse.Namespace):
            return args
        words = sys.argv[1:] if args is None else list(args)
        actions = self._option_string_actions
        for k, word in enumerate(takewhile("--".__ne__, words)):
            flag, equals, value = word.partition("=")
            if not flag.startswith("--") or flag in actions:
                continue
            if (flag := flag.replace("_", "-")) not in actions:
                shown = [name for name, a in actions.items() if a.help != argparse.SUPPRESS]
                self.error(f"no option {word.partition('=')[0]}{suggestion(flag, shown)}")
            words[k] = flag + equals + value
        global _parsed
        parsed = super().parse_args(words, namespace)
        typed = {word.partition("=")[0] for word in takewhile("--".__ne__, words)}
        if fault := unmet(self.relations, typed):
            self.error(fault)
        _parsed = shlex.join([*self.prog.split(), *words])
        return parsed

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(USAGE, f"{self.prog}: error: {printable(' '.join(message.split()))}\n")


class _Help(argparse.Action):
    """Shows the help and ends the program."""

    def __init__(self, option_strings: Any, dest: str, everything: bool, help: str = "") -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)
        self.default, self.everything = argparse.SUPPRESS, everything

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        parser.exit(exit_code(lambda: print(parser.format_help(self.everything), end="")))


def unmet(relations: Iterable[Relation], used: Set[str]) -> str | None:
    """Say which of the flags in use lacks another, or has no effect with one; None if all are fine."""
    for flag, needs, excludes in relations:
        if flag in used and needs and used.isdisjoint(needs):
            return f"{flag} needs {' or '.join(needs)}"
        for other in used & {*excludes} if flag in used else ():
            return f"{flag} has no effect with {other}"
    return None


def docstring(module: str) -> str:
    """Read the docstring of a module from its file; only its package is loaded."""
    return ast.get_docstring(ast.parse(path_of(module).read_text(encoding="utf-8"))) or ""


def path_of(module: str) -> Path:
    """Find the file that `python -m module` runs; only the outermost package is loaded."""
    package, *names = module.split(".")
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    place = Path(spec.origin).parent.joinpath(*names)
    return place / "__main__.py" if place.is_dir() else place.with_suffix(".py")


def say(text: str) -> None:
    """Print lines of a result; names in files of others cannot control the terminal."""
    print(printable_lines(text), flush=True)


def running_command() -> str | None:
    """The command line that is running, as one would type it; None in a job called from Python."""
    return _running


def size(text: str) -> tuple[int, int]:
    """Read width and height in pixels from ``640x320``, for ``argparse``."""
    width, cross, height = text.partition("x")
    try:
        if not cross:
            raise ValueError
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must look like 640x320, not {text!r}") from None


def exit_code(
    work: Callable[[], int | None],
    also: tuple[type[Exception], ...] = (),
    *,
    users: tuple[type[Exception], ...] = (UserError,),
    debug: bool = False,
    resumes: bool = True,
) -> int:
    """Run a job, and turn errors into one line on standard error and an exit code.

    Args:
        work: the job, which may return an exit code.
        also: errors that end with code 1 and are nobody's fault, such as workers that died.
        users: errors that end with code 2, which the user can fix; `Unfinished` ends with 1.
        debug: whether to print the traceback before the line.
        resumes: whether the same command resumes a stopped job.
    """
    global _parsed, _running
    outer, _running, _parsed = _running, _parsed, None
    hint = "; once this is fixed, the same command resumes" if resumes else ""
    try:
        code = work()
        sys.stdout.flush()  # at exit an error would have another code
        return code or 0
    except Unfinished as error:
        return _fail(error, str(error), 1, debug)
    except users as error:
        return _fail(error, str(error), USAGE, debug)
    except BrokenPipeError:  # as with ``| head``; the rest cannot be written at exit either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(error, f"{where}{error.strerror or error}{hint}", USAGE, debug)
    except also as error:
        return _fail(error, str(error), 1, debug)
    except MemoryError as error:
        reason = str(error) or "too little is free"
        return _fail(error, f"out of memory: {reason}; smaller sizes need less", USAGE, debug)
    except KeyboardInterrupt:
        hint = "; the same command resumes" if resumes else ""
        print(f"\nstopped{hint}", file=sys.stderr, flush=True)
        return INTERRUPTED
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{os.path.basename(last.filename)}, line {last.lineno}"
        bug = f"a bug in sdr-jax: {type(error).__name__}: {error} ({where})"
        return _fail(error, f"{bug}; {DEBUG} shows the traceback", BUG, debug)
    finally:
        _running = outer


def _fail(error: Exception, message: str, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exception(error)
    print(f"error: {printable(' '.join(message.split()))}", file=sys.stderr, flush=True)
    return code
