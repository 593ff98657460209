"""How a failsafe comes down: under control while the height is known, else by a ladder of pulses.

In: where and when it began. Out: the aim or the pulse of each tick, and whether it is over.
"""

import math
from dataclasses import dataclass

from runtime.blind import BlindPulses, ladder_s
from runtime.reference import Reference
from wakedeploy.rig import Limits

# After these the height is not known, or cannot be controlled. A controller would wind up against
# motors without a battery, and jump when it comes back. A lost link is not among them: where
# commands still arrive the loop lands, and where they do not the board follows its own ladder.
BLINDING = frozenset({"sensor_lost", "sensor_frozen", "sensor_jump", "thrust_lost", "battery_lost"})
DESCENT_MPS = 0.25
DESCENT_LIMIT = 2.0  # times what the way down takes; then the motors stop wherever it is
LEAST_DESCENT_LIMIT_S = 8.0
LANDED_M = 0.03


@dataclass(frozen=True, slots=True)
class Descent:
    """Where and when it began; `blind` has the pulses of one whose height is not known."""

    start_s: float
    z_m: float
    x_m: float
    blind: BlindPulses | None = None


def descent_reference(descent: Descent, t_s: float, idle_us: float) -> Reference:
    """The aim on the way down [SI]: a straight line in time, the source idle, the carriage held."""
    fallen_m = DESCENT_MPS * (t_s - descent.start_s)
    landing = fallen_m >= descent.z_m
    z_m = 0.0 if landing else descent.z_m - fallen_m
    return Reference(z_m, 0.0 if landing else -DESCENT_MPS, 0.0, descent.x_m, 0.0, idle_us)


def has_landed(descent: Descent, t_s: float, z_m: float, limits: Limits) -> bool:
    """Whether the motors may be switched off."""
    since_s = t_s - descent.start_s
    if descent.blind is not None or not math.isfinite(z_m):
        return since_s >= ladder_s(limits)
    at_end = DESCENT_MPS * since_s >= descent.z_m
    limit_s = max(LEAST_DESCENT_LIMIT_S, DESCENT_LIMIT * descent.z_m / DESCENT_MPS)
    return (at_end and z_m < LANDED_M) or since_s > limit_s
