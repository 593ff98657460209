"""The option that says how many processes share a command's work."""

from collections.abc import Callable
from typing import Any

import click

from wakedeploy.core.processes import MOST_WORKERS, default_workers


def workers_option(purpose: str = "Processes.") -> Callable[..., Any]:
    """`--workers`, by default one for each core that this process may use."""
    return click.option(
        "--workers",
        type=click.IntRange(1, 512),
        default=default_workers,
        show_default=f"one per core, at most {MOST_WORKERS}",
        help=purpose,
    )
