"""Which state of the code this is, for results that outlive it."""

import shutil
import subprocess
from pathlib import Path


def frozen_at() -> str:
    """The git commit of this code, "-dirty" if it has been changed since; "" outside git."""
    git = shutil.which("git")
    if git is None:
        return ""
    root = Path(__file__).parents[1]
    command = [
        git,
        "-C",
        str(root),
        "describe",
        "--always",
        "--abbrev=12",
        "--dirty",
        "--exclude=*",
    ]
    told = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    return told.stdout.strip() if told.returncode == 0 else ""
