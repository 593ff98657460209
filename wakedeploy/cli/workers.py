"""The option that says how many processes share a command's work."""

import os
from collections.abc import Callable
from typing import Any

import click

_MOST = 16  # by default: each holds some 400 MB


def workers_option(purpose: str = "Processes.") -> Callable[..., Any]:
    """`--workers`, by default one for each core that this process may use."""
    return click.option(
        "--workers",
        type=click.IntRange(1, 512),
        default=lambda: min(len(os.sched_getaffinity(0)), _MOST),
        show_default=f"one per core, at most {_MOST}",
        help=purpose,
    )
