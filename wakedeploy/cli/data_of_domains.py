"""Commands under `data make` and `data import`: one for each domain, of what the domain tells."""

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import json_option, stage_bars, warn
from wakedeploy.core.discovery import DOMAIN, offers
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.domains.domain import Domain, Recorded, Setting, Simulated

_OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write.",
)
_MINUTES = Within(0.1, 10_000)

Describe = Callable[["EpisodeSet", Path, Path | None], None]


class Domains(Group):
    """A command for each domain that is a `kind`: "Simulated" or "Recorded".

    They are listed without an import of the domains; `describe` is called with what was written.
    """

    def __init__(self, *args: Any, kind: str, describe: Describe, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._kind, self._describe = kind, describe

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The domains' names and the group's own commands, in alphabetical order."""
        from wakedeploy.domains import domain

        found = domain.names_of(getattr(domain, self._kind))
        return sorted({*super().list_commands(ctx), *found})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a domain; its options are looked for when they are needed."""
        if (command := super().get_command(ctx, cmd_name)) is not None:
            return command
        if cmd_name not in self.list_commands(ctx):
            return None
        build = functools.partial(_command, cmd_name, self._describe)
        return _Later(cmd_name, offers(DOMAIN)[cmd_name].title, build)


class _Later(click.Command):
    """A command that is built once more than its name is asked for: domains take time to import."""

    def __init__(self, name: str, title: str, build: Callable[[], click.Command]) -> None:
        self._build = build
        super().__init__(name, short_help=f"{title}.")

    @functools.cached_property
    def _built(self) -> click.Command:
        return self._build()

    def __getattribute__(self, name: str) -> Any:
        if name in ("params", "callback", "help", "epilog"):
            return getattr(self._built, name)
        return super().__getattribute__(name)


def _command(name: str, describe: Describe) -> click.Command:
    from wakedeploy.domains.domain import Simulated, domain

    known = domain(name)
    if isinstance(known, Simulated):
        return _simulation(name, known, describe)
    return _import(name, known, describe)


def _simulation(name: str, known: "Simulated", describe: Describe) -> click.Command:
    """`data make NAME`: minutes, seed and what the domain takes beside them."""

    def simulate(out: Path, json_path: Path | None, **settings: Any) -> None:
        from wakedeploy.api.sets import make_set

        require_writable(out)
        with stage_bars() as bars:
            made = make_set(name, progress=bars, **settings)
        write_set(made, out)
        describe(made, out, json_path)

    command = click.command(name, help=_help(f"make {name}", known))(simulate)
    options = (
        _OUT,
        click.option("--minutes", type=_MINUTES, default=known.minutes, show_default=True),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True),
        *map(_option, known.settings),
        json_option,
    )
    return _with(command, options)


def _import(name: str, known: "Recorded", describe: Describe) -> click.Command:
    """`data import NAME PATH`."""

    def read(path: Path, out: Path, json_path: Path | None, **settings: Any) -> None:
        from wakedeploy.api.sets import import_set

        with stage_bars() as bars:
            made = import_set(name, path, progress=bars, **settings)
        write_set(made, out)
        describe(made, out, json_path)

    command = click.command(name, help=_help(f"import {name}", known))(read)
    path = click.argument("path", type=click.Path(path_type=Path))
    return _with(command, (path, _OUT, *map(_option, known.settings), json_option))


def _with(command: click.Command, options: tuple[Callable[..., Any], ...]) -> click.Command:
    """The command with options in this order: decorators are applied from the last to the first."""
    for option in options:
        option(command)
    return command


def _help(name: str, known: "Domain") -> str:
    examples = "\n".join(f"    wakedeploy data {name} {arguments}" for arguments in known.examples)
    return f"{known.help_text}\n\n\b\nExample:\n{examples}"


def _option(setting: "Setting") -> Callable[..., Any]:
    """A setting as an option of the command line."""
    settings: dict[str, Any] = {
        "default": setting.default,
        "show_default": True,
        "help": setting.help,
    }
    flag = f"--{setting.name.replace('_', '-')}"
    if setting.kind == "choice":
        kind = click.Choice(setting.choices, case_sensitive=False)
        return click.option(flag, setting.name, type=kind, **settings)
    if setting.kind == "number":
        return click.option(flag, setting.name, type=Within(setting.low, setting.high), **settings)
    if setting.kind == "rig":
        return click.option(flag, setting.name, type=click.Path(path_type=Path), help=setting.help)
    return click.option(
        "--package",
        setting.name,
        type=click.Path(dir_okay=False, path_type=Path),
        multiple=True,
        help=setting.help,
    )


def write_set(made: "EpisodeSet", out: Path) -> None:
    """Write a set into its folder, and say of another one that lay there what it was."""
    from wakedeploy.core.episodes import stated_contents

    before = stated_contents(out)
    made.write(out)
    if before is not None and before.sha256 != made.sha256:
        minutes = sum(map(len, made.episodes)) / made.rate_hz / 60.0
        warn(
            f"{out}: {len(made.episodes)} episodes, {minutes:.1f} min, replaced the set that was"
            f" there: {before.domain}, {before.episodes} episodes, {before.minutes:.1f} min."
        )


def require_writable(out: Path) -> None:
    """UnusableInput where a set could not be written, before hours of simulation."""
    if out.exists() and not out.is_dir():
        raise UnusableInput(f"{out}: is a file; give a folder for the episode set.")
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        raise UnusableInput(f"{out}: {there} cannot be written to; choose another --out.")
