"""`wakedeploy --install-completion`: completion by Tab for a person's shell.

In: the shell's name, or $SHELL. Out: a script of its own, and for bash and zsh one line at the end
of the file that they read at their start. Nothing else is changed, and nothing is written where a
file cannot be read.
"""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import click
from click.shell_completion import get_completion_class

from wakedeploy.core.errors import UnusableInput

SHELLS = ("bash", "zsh", "fish")
_HEADER = "# Written by wakedeploy --install-completion, which replaces it."
_MARK = "# wakedeploy: completion by Tab"
# zsh has no compdef before its completion system is loaded, which many do in .zshrc.
_ZSH_FIRST = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit -i }"


class Place(NamedTuple):
    """Where a shell's script goes, and the file that has to read it; None where it looks there."""

    script: Path
    startup: Path | None


def shell_of(environment: Mapping[str, str]) -> str:
    """The shell that a person uses; UnusableInput where it is none of ours."""
    path = environment.get("SHELL", "")
    name = Path(path).name
    if name not in SHELLS:
        shown = f"$SHELL is {path}" if path else "$SHELL is not set"
        raise UnusableInput(
            f"{shown}; say for which shell: wakedeploy --install-completion {'|'.join(SHELLS)}."
        )
    return name


def place_of(shell: str, environment: Mapping[str, str]) -> Place:
    """Where a shell of this person looks for completions."""
    home = Path(environment.get("HOME") or Path.home())
    if shell == "fish":
        config = Path(environment.get("XDG_CONFIG_HOME") or home / ".config")
        return Place(config / "fish" / "completions" / "wakedeploy.fish", None)
    data = Path(environment.get("XDG_DATA_HOME") or home / ".local" / "share")
    script = data / "wakedeploy" / f"completion.{shell}"
    startup = home / ".bashrc"
    if shell == "zsh":
        startup = Path(environment.get("ZDOTDIR") or home) / ".zshrc"
    return Place(script, startup)


def install(shell: str, program: click.Command, environment: Mapping[str, str]) -> list[str]:
    """Write what is missing, and say in sentences what was written and how to undo it.

    Raises UnusableInput where a file cannot be read, or a script there is somebody else's.
    """
    from wakedeploy.core.files import write_text_whole

    script, startup = place_of(shell, environment)
    there, wanted = _read(script), script_of(shell, program)
    if there and _HEADER.encode() not in there:
        raise UnusableInput(f"{script}: is not of wakedeploy; move it away first.")
    before = b"" if startup is None else _read(startup)
    quoted = shlex.quote(str(script))
    line = f"if [ -r {quoted} ]; then . {quoted}; fi  {_MARK}"
    is_read = startup is None or line.encode() in before.splitlines()
    if there != wanted.encode():
        write_text_whole(script, wanted)
    if startup is not None and not is_read:
        _append(startup, line, before)
    return _said(shell, script, startup, is_new=there != wanted.encode(), is_read=is_read)


def script_of(shell: str, program: click.Command) -> str:
    """The script that a shell reads."""
    complete = get_completion_class(shell)
    assert complete is not None, shell
    script = complete(program, {}, "wakedeploy", "_WAKEDEPLOY_COMPLETE").source()
    first = f"{_ZSH_FIRST}\n" if shell == "zsh" else ""
    return f"{_HEADER}\n{first}{script.rstrip()}\n"


def _said(
    shell: str, script: Path, startup: Path | None, *, is_new: bool, is_read: bool
) -> list[str]:
    wrote = [f"wrote {script}"] if is_new else []
    wrote += [] if is_read else [f"added the line that reads it to {startup}"]
    done = " and ".join(wrote) if wrote else f"is in place already, in {script}"
    undo = f"delete {script}"
    if startup is not None:
        undo += f", and from {startup} the line that ends in '{_MARK}'"
    here = "." if startup is None else f"; in this one: . {shlex.quote(str(script))}"
    return [
        f"Completion for {shell}: {done}.",
        f"Shells that start from now on have it{here}",
        f"To undo it, {undo}.",
    ]


def _read(path: Path) -> bytes:
    """A file's bytes, none for one that is not there."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise UnusableInput(
            f"{path}: cannot be read ({error.strerror}), so nothing was written."
        ) from error


def _append(path: Path, line: str, before: bytes) -> None:
    """Add a line at the end, through whatever link the file is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        gap = b"\n" if before and not before.endswith(b"\n") else b""
        file.write(gap + line.encode() + b"\n")
