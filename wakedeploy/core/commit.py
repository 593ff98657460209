"""Which state of the code this is, for results that outlive it."""

import functools
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path


def frozen_at(written: Sequence[str] = ()) -> str:
    """The git commit of this code, "-dirty" if it has been changed since; "" outside git.

    Files below `written` (paths from the root) may change: they are what the caller makes.
    """
    commit = _git("describe", "--always", "--abbrev=12", "--exclude=*")
    if commit is None:
        return ""
    others = [f":(exclude){path}" for path in written]
    clean = _git("diff", "--quiet", "HEAD", "--", ".", *others) is not None
    return commit if clean else f"{commit}-dirty"


@functools.cache
def present_commit() -> str:
    """The commit of this code, looked up once: what is edited while a command runs is not in it."""
    return frozen_at()


def _git(*arguments: str) -> str | None:
    """What git says of this checkout; None where it fails, or where there is none."""
    git = shutil.which("git")
    if git is None:
        return None
    command = [git, "-C", str(Path(__file__).parents[2]), *arguments]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    return answer.stdout.strip() if answer.returncode == 0 else None
