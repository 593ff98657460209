"""A command whose `--measured` may be followed by several files.

What stands without an option, and an option that is given twice, is answered with what was meant.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import click

_SYSTEM = re.compile(r"\.py(:\w+)?$")  # a file, or one of its classes
_NUMBER = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?")
_EFFECT = re.compile(r"[a-z-]+@\w+")


class Many(click.Command):
    """Lets `--measured` be followed by several files, as a shell's wildcard gives them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat `--measured` before each of the files that follow it.

        UsageError for an option that is given twice, and for a value whose option is left out.
        """
        spread: list[str] = []
        inside = False
        for arg in args:
            if arg.startswith("-") and arg != "-":
                inside = arg == "--measured"
                if inside:
                    continue
                spread.append(arg)
            elif inside:
                spread += ["--measured", arg]
            else:
                spread.append(arg)
        self._require_once(ctx, spread)
        _, beyond, _ = self.make_parser(ctx).parse_args(list(spread))
        asks_for_help = any(name in spread for name in ctx.help_option_names)
        if beyond and not (asks_for_help or ctx.resilient_parsing):
            raise click.UsageError(self._on_bare(ctx, beyond[0], spread), ctx)
        return super().parse_args(ctx, spread)

    def _require_once(self, ctx: click.Context, args: Sequence[str]) -> None:
        """UsageError for an option with one value that is given twice: click takes the last."""
        for param in self.get_params(ctx):
            if not isinstance(param, click.Option) or param.multiple or param.is_flag:
                continue
            for name in param.opts:
                count = sum(arg == name or arg.startswith(f"{name}=") for arg in args)
                if count > 1:
                    raise click.UsageError(f"'{name}' is given {count} times; give it once.", ctx)

    def _on_bare(self, ctx: click.Context, value: str, args: Sequence[str]) -> str:
        """The sentence for a value without an option, with the option that such a value has."""
        known = [name for param in self.get_params(ctx) for name in param.opts]
        meant = next((name for name in _meant(value, args) if name in known), None)
        advice = f"; give it as '{meant} {value}'" if meant else ""
        return f"'{value}' stands without an option{advice}."


def _meant(value: str, args: Sequence[str]) -> list[str]:
    """The options that a value may belong to, the likeliest first."""
    if _SYSTEM.search(value):
        return ["--system"]
    if value.lower().endswith(".toml"):
        has_system = "--system" in args or any(map(_SYSTEM.search, args))
        return ["--columns"] if has_system else ["--rig", "--columns"]
    if value.lower().endswith((".xml", ".mjcf")):
        return ["--mjcf"]  # a model of MuJoCo, which one command alone takes
    if _EFFECT.fullmatch(value):
        return ["--effect", "--class"]
    if ("." in value and not _NUMBER.fullmatch(value)) or Path(value).exists():
        return ["--measured"]
    return []
