"""Options that commands share which train."""

import click

lead_option = click.option(
    "--lead",
    "lead_s",
    type=click.FloatRange(0, 10),
    help="Predict the force this many seconds ahead. Default: what the set states, or 0.",
)

device_option = click.option(
    "--device",
    type=click.Choice(["auto", "cpu", "cuda"]),
    default="auto",
    show_default=True,
    help="auto: CUDA where torch sees it and the work is large enough.",
)
