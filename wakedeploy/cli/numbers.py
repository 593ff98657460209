"""Numbers on a command line: what is none, as nan, is refused like one out of range."""

import math
from typing import Any

import click


class Within(click.FloatRange):
    """A number between bounds; click's own lets nan pass, which is neither below nor above one."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number; a usage error for nan and for what is out of range."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{value!r} is no number.", param, ctx)
        return number
