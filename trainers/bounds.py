"""What hyper-parameters may be: the one place that refuses what no core can be built from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wakedeploy.core.errors import UnusableInput


@dataclass(frozen=True)
class Bound:
    """The smallest and the largest value of a hyper-parameter, both allowed.

    `whole` is for counts whose default, None, does not say that they are.
    """

    low: float
    high: float
    whole: bool = False


COUNT = Bound(1, 100_000)  # a wider layer alone would exceed the budget of trainable weights
LAYERS = Bound(1, 64)
DROPOUT = Bound(0, 0.9)
SECONDS = Bound(0, 3600)
MOST_EPOCHS = 100_000
_SETTINGS = {
    "epochs": Bound(1, MOST_EPOCHS),
    "patience": Bound(1, 100_000),
    "learning_rate": Bound(1e-7, 1),
    "weight_decay": Bound(0, 10),
    "gradient_clip": Bound(1e-6, 1e6),
    "batch": Bound(1, 1_000_000),
    "lanes": Bound(1, 100_000),
    "chunk_steps": Bound(1, 100_000),
}


def check_hyper(arch: str, usual: Any, overrides: Mapping[str, Any]) -> None:
    """Raise UnusableInput for a value out of bounds; `usual` are the reference hyper-parameters."""
    for name, value in overrides.items():
        check_value(arch, usual, name, value)


def check_settings(defaults: Mapping[str, Any], overrides: Mapping[str, Any]) -> None:
    """Raise UnusableInput for an unknown fit setting, or a value out of bounds."""
    for name, value in overrides.items():
        if name not in defaults:
            raise UnusableInput(
                f"There is no fit setting '{name}'; there are {', '.join(defaults)}."
            )
        _check(f"{name} = {value!r}", value, isinstance(defaults[name], int), _SETTINGS[name])


def check_value(arch: str, usual: Any, name: str, value: Any) -> None:
    """Counts are whole; everything else is a number, or None where that is the default.

    The bounds are those of the architecture's own file, else a count's.
    """
    default = getattr(usual, name)
    if value is None and default is None:
        return
    bound = getattr(usual, "bounds", {}).get(name, COUNT)
    count = isinstance(default, int) or bound.whole
    _check(f"{arch}: {name} = {value!r}", value, count, bound)


def _check(name: str, value: Any, count: bool, bound: Bound) -> None:
    usable = isinstance(value, int if count else (int, float)) and not isinstance(value, bool)
    if not usable or not bound.low <= value <= bound.high:
        kind = "whole number" if count else "number"
        raise UnusableInput(f"{name} has to be a {kind} from {bound.low:g} to {bound.high:g}.")
