"""Every command with its options, as `--help` has them."""

import re
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from textwrap import dedent

import click

from parts.markdown import plain
from wakedeploy.cli import main

_KEPT = "\b"  # what click reads as: do not refill this paragraph
_FIRST_LEVEL = 2


def markdown(*names: str) -> str:
    """A heading for each of these commands, deeper for those of a group."""
    context = click.Context(main, info_name="wakedeploy")
    return "\n\n".join(_below(main, context, _FIRST_LEVEL, names))


def _below(
    group: click.Group, context: click.Context, level: int, names: Sequence[str]
) -> Iterator[str]:
    for name in names:
        command = group.get_command(context, name)
        if command is None:
            raise ValueError(f"{name}: there is no such command")
        inner = click.Context(command, info_name=name, parent=context)
        yield _section(command, inner, level)
        if isinstance(command, click.Group):
            yield from _below(command, inner, level + 1, command.list_commands(inner))


def _section(command: click.Command, context: click.Context, level: int) -> str:
    title = context.command_path.removeprefix("wakedeploy ")
    parts = [f"{'#' * level} {title}"]
    if not isinstance(command, click.Group):
        usage = " ".join(command.collect_usage_pieces(context))
        parts.append(f"```text\n{context.command_path} {usage}\n```")
    parts += [*_paragraphs(command.help or ""), _options(command, context)]
    return "\n\n".join(filter(None, parts))


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in re.split(r"\n\s*\n", cleandoc(text)):
        first, _, rest = paragraph.lstrip("\n").partition("\n")
        if first.strip() != _KEPT:
            yield plain(paragraph)
        else:
            yield from _kept(rest)


def _kept(text: str) -> Iterator[str]:
    """Lines of a paragraph that is not refilled: words at its margin, commands further in."""
    for commands, lines in _runs(text):
        block = dedent("\n".join(lines))
        yield f"```console\n{block}\n```" if commands else plain(block)


def _runs(text: str) -> Iterator[tuple[bool, list[str]]]:
    run: list[str] = []
    for line in text.splitlines():
        if run and line[:1].isspace() != run[0][:1].isspace():
            yield run[0][:1].isspace(), run
            run = []
        run.append(line)
    if run:
        yield run[0][:1].isspace(), run


def _options(command: click.Command, context: click.Context) -> str:
    """A definition for each option that says what it is for, but for `--help`."""
    told = (option.get_help_record(context) for option in command.get_params(context))
    named = [record for record in told if record and record[1] and "--help" not in record[0]]
    return "\n\n".join(f"`{name}`\n: {plain(words)}" for name, words in named)
