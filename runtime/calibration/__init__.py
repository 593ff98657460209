"""Measuring a rig's constants at the rig: one small file per procedure.

In: run logs of a short session, flown by the loop of every other run, and the rig file. Out: values
with their spreads, and sentences about them. Each procedure records what it needs and has a pure
`estimate`; refusals are CheckFailed in one sentence. It is a part of the runtime because it runs on
the Pi, where only the base install is.
"""

from dataclasses import dataclass, field

from wakedeploy.core.errors import CheckFailed
from wakedeploy.rig.update import Calibrated


@dataclass(frozen=True)
class Outcome:
    """What a procedure found: constants by dotted name, and what else there is to say."""

    constants: dict[str, Calibrated]
    sentences: tuple[str, ...] = field(default=())


def require(true: bool, otherwise: str) -> None:
    """CheckFailed with a sentence that says why a result is not to be believed."""
    if not true:
        raise CheckFailed(f"{otherwise} Nothing was written.")
