"""Groups of commands: help that is never cut, and what exists in answer to what is mistyped."""

import shlex
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from wakedeploy.cli.output import require_kept
from wakedeploy.core.files import at_home
from wakedeploy.core.names import meant, near

_UNCUT = 10_000

# What people type elsewhere, and what it is called here; the first that a command has is named.
OPTIONS: Mapping[str, tuple[str, ...]] = {
    "--architecture": ("--arch",),
    "--checkpoint": ("--run", "--runs", "--package"),
    "--class-name": ("--class",),
    "--config": ("--rig", "--preset"),
    "--csv": ("--out",),
    "--cuda": ("--device",),
    "--data-dir": ("--data",),
    "--dataset": ("--data",),
    "--dest": ("--out",),
    "--duration": ("--seconds", "--minutes"),
    "--force": ("--fresh",),
    "--gpu": ("--device",),
    "--horizon": ("--lead",),
    "--hyperparameter": ("--hyper", "--dimension"),
    "--input": ("--data", "--measured", "--log"),
    "--jobs": ("--workers",),
    "--log-dir": ("--out",),
    "--logs": ("--measured", "--log"),
    "--lr": ("--learning-rate",),
    "--model": ("--arch", "--package", "--rig"),
    "--n-epochs": ("--epochs",),
    "--n-jobs": ("--workers",),
    "--n-trials": ("--trials",),
    "--num-epochs": ("--epochs",),
    "--num-trials": ("--trials",),
    "--num-workers": ("--workers",),
    "--onnx": ("--package", "--out"),
    "--outdir": ("--out",),
    "--output": ("--out",),
    "--output-dir": ("--out",),
    "--output-file": ("--out",),
    "--overwrite": ("--fresh",),
    "--parallel": ("--workers",),
    "--processes": ("--workers",),
    "--random-seed": ("--seed", "--seeds"),
    "--reset": ("--fresh",),
    "--runs-dir": ("--runs", "--out"),
    "--save": ("--out", "--log", "--json"),
    "--save-dir": ("--out",),
    "--serial": ("--port",),
    "--sim": ("--virtual",),
    "--simulate": ("--virtual",),
    "--target": ("--out",),
    "--time": ("--seconds", "--minutes"),
    "--tty": ("--port",),
    "--weights": ("--run", "--package"),
    "-a": ("--arch",),
    "-d": ("--data",),
    "-e": ("--epochs",),
    "-j": ("--workers",),
    "-n": ("--trials", "--flights"),
    "-o": ("--out",),
    "-p": ("--port", "--package"),
    "-r": ("--rig",),
    "-s": ("--seed", "--seeds"),
}
_RUNS = "The runs' folder stands alone: wakedeploy evaluate runs --data SET."
_MJCF_OPTIONS = ("--mjcf", "--model", "--xml")
_MJCF = (  # where there is a --system
    "A MuJoCo model becomes a system by `wakedeploy gap init my_robot.py --mjcf MODEL.xml`; give "
    "that file by --system."
)
# What is no option here, and where it is instead.
ELSEWHERE: Mapping[tuple[str, str], str] = {
    ("evaluate", "--run"): _RUNS,
    ("evaluate", "--runs"): _RUNS,
    ("evaluate", "--model"): _RUNS,
    ("evaluate", "--checkpoint"): _RUNS,
    ("power", "--json"): "--out is the folder that power.json is written into.",
    ("train", "--batch"): "A preset's [settings] has the batch: --preset FILE.",
    ("tune", "--batch"): "It is a dimension: --dimension batch=VALUE.",
    ("sweep", "--batch"): "A plan's [settings] has the batch.",
    ("train", "--resume"): "A run that was stopped goes on by itself.",
    ("tune", "--resume"): "A study that was stopped goes on by itself.",
    ("sweep", "--resume"): "A sweep that was stopped goes on by itself.",
}
_SAME = {"--batch-size": "--batch", "--bs": "--batch", "-b": "--batch", "--continue": "--resume"}
MEANT_COMMANDS: Mapping[str, str] = {
    "convert": "export",
    "fit": "train",
    "fly": "run-gantry",
    "hpo": "tune",
    "install": "deploy",
    "optimise": "tune",
    "optimize": "tune",
    "plot": "log show",
    "run": "run-gantry",
    "score": "evaluate",
    "search": "tune",
    "simulate": "data make",
    "test": "evaluate",
    "upload": "deploy",
    "validate": "check",
    "verify": "check",
}


# Recordings by the name that their authors gave them, which is no kind of thing.
PROPER_NAMES: Mapping[str, str] = {"flaredw": "quadrotor"}


class CarefulContext(click.Context):
    """A command's options, which are looked at together before it runs."""

    def invoke(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command, unless it would write over what it reads."""
        if args and args[0] is self.command.callback:
            require_kept(self)
        return super().invoke(*args, **kwargs)


class Group(click.Group):
    """Commands in any case, with `_` or `-`; each has its whole first sentence in the list."""

    group_class = type

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is meant."""
        given = PROPER_NAMES.get(args[0].lower(), args[0])
        name = meant(given, self.list_commands(ctx)) or args[0]
        called, command, others = super().resolve_command(ctx, [name, *args[1:]])
        if command is None:
            return called, command, others
        if not isinstance(command, click.Group):
            command.context_class = CarefulContext
        return called, command, _at_home(command, others)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands, each with its first sentence."""
        rows = [
            (name, command.get_short_help_str(_UNCUT))
            for name in self.list_commands(ctx)
            if (command := self.get_command(ctx, name)) is not None
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _at_home(command: click.Command, args: list[str]) -> list[str]:
    """The arguments with the home folder for `~` in `--out=~/runs`, which bash leaves as it is."""
    paths = {flag for p in command.params if isinstance(p.type, click.Path) for flag in p.opts}
    found = []
    for each in args:
        flag, _, value = each.partition("=")
        is_at_home = flag in paths and value.split("/", 1)[0] == "~"
        found.append(f"{flag}={at_home(Path(value))}" if is_at_home else each)
    return found


def answered(error: click.UsageError) -> click.UsageError:
    """The error of somebody who mistyped, with what they may have meant; others as they are."""
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        return _no_option(error, error.ctx)
    if isinstance(error, click.NoSuchCommand) and error.ctx is not None:
        return _no_command(error, error.ctx)
    return error


def _no_option(error: click.NoSuchOption, ctx: click.Context) -> click.UsageError:
    has = {name for param in ctx.command.get_params(ctx) for name in param.opts}
    asked = error.option_name.lower().replace("_", "-")
    known = next((name for name in OPTIONS.get(asked, ()) if name in has), None)
    advice = ELSEWHERE.get((str(ctx.info_name), _SAME.get(asked, asked)))
    if known is not None:
        advice = f"Did you mean '{known}'?"
    if asked in _MJCF_OPTIONS and "--system" in has:
        advice = _MJCF
    if advice is None:
        # Of names this short the two hyphens alone make one look like another.
        bare = {name.lstrip("-"): name for name in error.possibilities or ()}
        close = [bare[name] for name in near(asked.lstrip("-"), bare)]
        return click.NoSuchOption(error.option_name, possibilities=close, ctx=ctx)
    return click.UsageError(f"No such option '{error.option_name}'. {advice}", ctx)


def _no_command(error: click.NoSuchCommand, ctx: click.Context) -> click.UsageError:
    group, given = ctx.command, error.command_name
    assert isinstance(group, click.Group)
    meant_here = near(given, group.list_commands(ctx))
    if ctx.parent is None and given in MEANT_COMMANDS:
        meant_here = [MEANT_COMMANDS[given]]
    root = ctx.find_root()
    found = meant_here or [path for path in _paths(root) if meant(given, [path.split()[-1]])]
    has = "" if meant_here or ctx.parent is None else f" {_has(ctx, group)}"
    if not found:
        return click.UsageError(f"No such command '{given}'.{has}", ctx) if has else error
    called = str(ctx.command_path if meant_here else root.info_name)
    choices = " or ".join(f"'{called} {name}'" for name in found)
    return click.UsageError(f"No such command '{given}'. Did you mean {choices}?{has}", ctx)


def _has(ctx: click.Context, group: click.Group) -> str:
    """What there is in a group, for who looks for something there that is elsewhere or nowhere."""
    return f"'{ctx.command_path}' has {', '.join(group.list_commands(ctx))}."


def _paths(ctx: click.Context) -> Iterator[str]:
    """All commands below a group, as they are called behind its own name."""
    group = ctx.command
    if not isinstance(group, click.Group):
        return
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        yield name
        if isinstance(command, click.Group):
            yield from (f"{name} {path}" for path in _paths(click.Context(command)))


def same_command() -> str:
    """The command that runs, as a person would type it again."""
    return shlex.join(["wakedeploy", *sys.argv[1:]])
