"""Options that commands share which train."""

from collections.abc import Callable
from typing import Any

import click

from wakedeploy.cli.names import SOME_ARCHITECTURES, OptionOfNames
from wakedeploy.cli.numbers import Within
from wakedeploy.core.names import architectures

lead_option = click.option(
    "--lead",
    "lead_s",
    type=Within(0, 10),
    help="Predict the force this many seconds ahead. Default: what the set states, or 0.",
)

device_option = click.option(
    "--device",
    type=click.Choice(["auto", "cpu", "cuda"], case_sensitive=False),
    default="auto",
    show_default=True,
    help="auto: CUDA where torch sees it and the work is large enough.",
)


def architectures_option(
    default: str | None = "all", otherwise: str | None = None
) -> Callable[..., Any]:
    """`--arch`: one or several architectures, or all; `otherwise` says what None stands for."""
    addition = "" if otherwise is None else f" Default: {otherwise}."
    return click.option(
        "--arch",
        cls=OptionOfNames,
        names=architectures,
        type=SOME_ARCHITECTURES,
        metavar="all|NAME[,NAME…]",
        default=default,
        show_default=default is not None,
        help=f"Of {{names}}.{addition}",
    )
