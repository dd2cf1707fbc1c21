"""Completion of commands, flags and their values by bash, and by zsh through bashcompinit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from shell.command import Parser

SCRIPT = """\
# eval "$(PROGRAM --completion)" in ~/.bashrc; in ~/.zshrc after: autoload -U bashcompinit && bashcompinit
_PROGRAM() {
    local at=1 words=
    [[ ${COMP_WORDS[1]} == GROUP ]] && at=2
    local command=${COMP_WORDS[at]} before=${COMP_WORDS[COMP_CWORD-1]} word=${COMP_WORDS[COMP_CWORD]}
    if (( COMP_CWORD == 1 )); then words="COMMANDS"
    elif (( COMP_CWORD == at )); then words="MEMBERS"
    else case "$command $before" in
VALUES
        *) [[ $word == -* ]] && case "$command" in
FLAGS
        esac ;;
    esac; fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}
complete -o default -F _PROGRAM PROGRAM
"""
"""Where no word is known, names of files are completed."""


def script(program: str, parsers: Mapping[str, Parser], group: str, members: Sequence[str]) -> str:
    """A script for the shell to read, once.

    Args:
        program: the name of all commands.
        parsers: of every command.
        group: the command that some of them stand behind.
        members: names of those.
    """
    commands = [*(name for name in parsers if name not in members), group, "--help", "--version"]
    flags = [
        f'            {name}) words="{" ".join(_flags(parser))}" ;;'
        for name, parser in parsers.items()
    ]
    values = [line for name, parser in parsers.items() for line in _values(name, parser)]
    text = SCRIPT.replace("_PROGRAM", f"_{program.replace('-', '_')}")
    for name, own in {
        "PROGRAM": program,
        "GROUP": group,
        "COMMANDS": " ".join(commands),
        "MEMBERS": " ".join(members),
        "VALUES": "\n".join(values),
        "FLAGS": "\n".join(flags),
    }.items():
        text = text.replace(name, own)
    return text


def _flags(parser: Parser) -> list[str]:
    return sorted(flag for flag in parser.flags() if flag.startswith("--"))


def _values(name: str, parser: Parser) -> Iterator[str]:
    """What may stand behind a flag, or the command itself, where that is one of few words."""
    for flag, choices in parser.flags().items():
        if choices:
            yield f'        "{name} {flag}") words="{" ".join(choices)}" ;;'
    if first := parser.first():
        yield f'        "{name} {name}") words="{" ".join(first)}" ;;'
