"""The command line: a file per command, a thin edge over the other packages, and what they share.

In: arguments. Out: text, tables, files and an exit status (0 done, 1 a run or check failed,
2 unusable input, 130 Ctrl-C). May import everything, heavy libraries only inside the command
functions, so that `wakedeploy --help` stays fast.
"""

import errno
import importlib
import os
import signal
import sys
from typing import Any

import click

import wakedeploy
from wakedeploy.cli import shells
from wakedeploy.cli.groups import Group, answered
from wakedeploy.core.errors import (
    WakedeployError,
    installs,
    is_unusable,
    one_line,
    system_sentence,
)
from wakedeploy.core.interruption import interruptible, was_interrupted

COMMANDS = (
    "demo",
    "data",
    "train",
    "tune",
    "evaluate",
    "sweep",
    "export",
    "check",
    "deploy",
    "bench",
    "run-gantry",
    "fly-pair",
    "live",
    "log",
    "gap",
    "study",
    "rig",
    "calibrate",
    "doctor",
)
TRAIN_LIBRARIES = {"torch", "onnx", "onnxscript", "optuna", "numba", "safetensors"}
_AUTO = "auto"
shells.register()


class _Commands(Group):
    """Loads a command's file when it is asked for, and reports failures in one sentence."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """As a program: a polite kill interrupts it as Ctrl-C does, until its work is done."""
        try:
            with interruptible():
                return super().__call__(*args, **kwargs)
        except KeyboardInterrupt:
            sys.exit(_interrupted())
        finally:
            if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
                # What is left is to let go of libraries, and nobody is there to take an exception.
                signal.signal(signal.SIGINT, signal.SIG_DFL)

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """Read the group's own options; what goes wrong here is one line, too."""
        try:
            return super().make_context(*args, **kwargs)
        except OSError as error:
            raise _Told(error) from error
        except KeyboardInterrupt:
            raise click.exceptions.Exit(_interrupted()) from None

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order of a person's work."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command object of `wakedeploy/cli/<name>.py`."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"wakedeploy.cli.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; what it raises becomes one line and an exit status."""
        # Matrices are small here: a second thread costs more than it gains, on a busy machine most.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        try:
            return super().invoke(ctx)
        except click.UsageError as error:
            raise answered(error) from error
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except KeyboardInterrupt:
            ctx.exit(_interrupted())
        except Exception as error:
            if was_interrupted(error):
                ctx.exit(_interrupted())
            if ctx.params["debug"] or getattr(error, "errno", None) == errno.EPIPE:
                raise
            raise _Told(error) from error


def _interrupted() -> int:
    """Say the one word; the exit status that goes with it."""
    click.echo("Interrupted.", err=True)
    return 130


class _Told(click.ClickException):
    """An error as one sentence and its exit status."""

    def __init__(self, error: Exception) -> None:
        super().__init__(_sentence(error))
        unusable = is_unusable(error) or _missing_library(error)
        status = error.exit_status if isinstance(error, WakedeployError) else None
        self.exit_code = status or (2 if unusable else 1)  # type: ignore[misc]


def _sentence(error: Exception) -> str:
    if isinstance(error, WakedeployError):
        return one_line(error)
    library = _missing_library(error)
    if library in TRAIN_LIBRARIES:
        return f"{library} is not installed; this command needs: {installs('train')}."
    if library:
        return f"{library} is not installed; install wakedeploy again: {installs('')}."
    if isinstance(error, OSError) and error.strerror:
        return system_sentence(error)
    kind = type(error).__name__
    return f"unexpected {kind}: {one_line(error)}; `wakedeploy --debug …` shows where it happened."


def _missing_library(error: Exception) -> str | None:
    """The library outside this project that the error says is missing."""
    name = (error.name or "").split(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    return name if name not in ("", "wakedeploy", "trainers", "export", "runtime") else None


def _install_completion(ctx: click.Context, param: click.Parameter, shell: str | None) -> None:
    """Write the completion of a shell, and end."""
    if shell is None or ctx.resilient_parsing:
        return
    from wakedeploy.cli.completion import install, shell_of

    try:
        chosen = shell_of(os.environ) if shell == _AUTO else shell
        lines = install(chosen, ctx.command, os.environ)
    except (WakedeployError, OSError) as error:
        raise _Told(error) from error
    click.echo("\n".join(lines))
    ctx.exit()


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(wakedeploy.__version__, prog_name="wakedeploy")
@click.option(
    "--install-completion",
    type=click.Choice([_AUTO, "bash", "zsh", "fish"], case_sensitive=False),
    is_flag=False,
    flag_value=_AUTO,
    metavar="[bash|zsh|fish]",
    is_eager=True,
    expose_value=False,
    callback=_install_completion,
    help="Write completion by Tab for your shell, and say how to undo it.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """Predict wake forces with small models, and fly them on a gantry.

    \b
    The main job, end to end, on the virtual gantry:
        wakedeploy demo
    """
