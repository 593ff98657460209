"""The commands that there are, by the words that call them."""

import click

from wakedeploy.cli import main


def _below(group: click.Group, path: tuple[str, ...]) -> dict[tuple[str, ...], click.Command]:
    found: dict[tuple[str, ...], click.Command] = {}
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        found[(*path, name)] = command
        if isinstance(command, click.Group):
            found |= _below(command, (*path, name))
    return found


EVERY = _below(main, ())
