"""A command whose `--measured` may be followed by several files."""

import click


class Many(click.Command):
    """Lets `--measured` be followed by several files, as a shell's wildcard gives them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat `--measured` before each of the files that follow it."""
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
        return super().parse_args(ctx, spread)
