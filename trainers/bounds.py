"""What hyper-parameters may be: the one place that refuses what no core can be built from."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wakedeploy.errors import UnusableInput


@dataclass(frozen=True)
class Bound:
    """The smallest and the largest value of a hyper-parameter, both allowed."""

    low: float
    high: float


_COUNT = Bound(1, 100_000)  # a wider layer alone would exceed the budget of trainable weights
_SECONDS = Bound(0, 3600)
# By name, whatever the architecture; counts that are not named here have the bound above.
_BOUNDS = {
    "layers": Bound(1, 64),
    "dropout": Bound(0, 0.9),
    "kernel": Bound(2, 64),  # of one tap nothing is carried
    "blocks": Bound(1, 12),  # the dilation doubles with each
    "d_conv": Bound(2, 64),
    "neurons": Bound(1, 10_000),  # N² recurrent weights
    "spectral_radius": Bound(0, 10),
    "leak": Bound(0.001, 1),
    "density": Bound(0.001, 1),
    "input_scale": Bound(0, 100),
    "input_offset": Bound(0, 100),
    "initial_delay_s": _SECONDS,
    "initial_spread_s": _SECONDS,
    "gap_s": _SECONDS,
}


def check_hyper(arch: str, defaults: Mapping[str, Any], overrides: Mapping[str, Any]) -> None:
    """Raise UnusableInput for a value out of bounds, or for values that do not fit together."""
    for name, value in overrides.items():
        _check_value(arch, name, value, defaults[name])
    if arch == "cross-attention":
        chosen = {**defaults, **overrides}
        _check_heads(chosen["embed"], chosen["heads"])


def _check_value(arch: str, name: str, value: Any, default: Any) -> None:
    """Counts are whole; everything else is a number, or None where that is the default."""
    if value is None and default is None:
        return
    count = isinstance(default, int)
    bound = _BOUNDS.get(name, _COUNT)
    usable = isinstance(value, int if count else (int, float)) and not isinstance(value, bool)
    if not usable or not bound.low <= value <= bound.high:
        kind = "whole number" if count else "number"
        raise UnusableInput(
            f"{arch}: {name} = {value!r} has to be a {kind} from {bound.low:g} to {bound.high:g}."
        )


def _check_heads(embed: int, heads: int) -> None:
    """Every head has its share of the width; half of the positions are sines, half cosines."""
    step = math.lcm(2, heads)
    if embed % step:
        raise UnusableInput(
            f"cross-attention: embed = {embed} with heads = {heads} has to be a multiple of {step}."
        )
