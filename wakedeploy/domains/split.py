"""How simulated episodes are shared out: whole, in the order in which they were flown."""

from collections.abc import Sequence

_HELD_OUT = 0.15


def split_in_order(names: Sequence[str]) -> dict[str, str]:
    """70 % training, then 15 % validation, then 15 % test, at least one episode of the last two."""
    held_out = max(1, round(_HELD_OUT * len(names)))
    test, validation = len(names) - held_out, len(names) - 2 * held_out
    return {
        name: "test" if i >= test else "validation" if i >= validation else "train"
        for i, name in enumerate(names)
    }
