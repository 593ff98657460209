"""What hyper-parameters may be: the one place that refuses what no core can be built from."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wakedeploy.core.errors import UnusableInput


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
    "neurons": Bound(1, 4000),  # N² recurrent weights: 64 MB, the largest package
    "spectral_radius": Bound(0, 10),
    "leak": Bound(0.001, 1),
    "density": Bound(0.001, 1),
    "input_scale": Bound(0, 100),
    "input_offset": Bound(0, 100),
    "initial_delay_s": _SECONDS,
    "initial_spread_s": _SECONDS,
    "gap_s": _SECONDS,
    "history_s": _SECONDS,
    "snapshots": Bound(2, 1000),
}
_WHOLE = {"snapshots"}  # counts whose default, None, does not say so
_SETTINGS = {
    "epochs": Bound(1, 100_000),
    "patience": Bound(1, 100_000),
    "learning_rate": Bound(1e-7, 1),
    "weight_decay": Bound(0, 10),
    "gradient_clip": Bound(1e-6, 1e6),
    "batch": Bound(1, 1_000_000),
    "lanes": Bound(1, 100_000),
    "chunk_steps": Bound(1, 100_000),
}


def check_hyper(arch: str, defaults: Mapping[str, Any], overrides: Mapping[str, Any]) -> None:
    """Raise UnusableInput for a value out of bounds, or for values that do not fit together."""
    for name, value in overrides.items():
        check_value(arch, name, value, defaults[name])
    if arch == "cross-attention":
        chosen = {**defaults, **overrides}
        _check_heads(chosen["embed"], chosen["heads"])


def check_settings(defaults: Mapping[str, Any], overrides: Mapping[str, Any]) -> None:
    """Raise UnusableInput for a fit setting that there is none of, or a value out of bounds."""
    for name, value in overrides.items():
        if name not in defaults:
            raise UnusableInput(
                f"There is no fit setting '{name}'; there are {', '.join(defaults)}."
            )
        _check(f"{name} = {value!r}", value, isinstance(defaults[name], int), _SETTINGS[name])


def check_value(arch: str, name: str, value: Any, default: Any) -> None:
    """Counts are whole; everything else is a number, or None where that is the default."""
    if value is None and default is None:
        return
    count = isinstance(default, int) or name in _WHOLE
    _check(f"{arch}: {name} = {value!r}", value, count, _BOUNDS.get(name, _COUNT))


def _check(told: str, value: Any, count: bool, bound: Bound) -> None:
    usable = isinstance(value, int if count else (int, float)) and not isinstance(value, bool)
    if not usable or not bound.low <= value <= bound.high:
        kind = "whole number" if count else "number"
        raise UnusableInput(f"{told} has to be a {kind} from {bound.low:g} to {bound.high:g}.")


def _check_heads(embed: int, heads: int) -> None:
    """Every head has its share of the width; half of the positions are sines, half cosines."""
    step = math.lcm(2, heads)
    if embed % step:
        raise UnusableInput(
            f"cross-attention: embed = {embed} with heads = {heads} has to be a multiple of {step}."
        )
