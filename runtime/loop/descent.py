"""How a failsafe comes down: by control while the height is known, else by a ladder of pulses.

In: where and when it began. Out: the aim or the pulse of each tick, and whether it is over.
"""

from dataclasses import dataclass

from runtime.loop.blind import BlindPulses, ladder_s
from runtime.reference import Reference
from wakedeploy.core.rig_sections import Limits

# After these faults the height is not known, or cannot be controlled. A controller would wind up
# against motors without a battery, and jump when it comes back. A lost link is not among them: if
# commands still arrive the loop lands, and if they do not the board follows its own ladder.
BLINDING = frozenset(
    {
        "sensor_lost",
        "sensor_frozen",
        "sensor_jump",
        "sensor_noisy",
        "height_impossible",
        "thrust_lost",
        "battery_lost",
    }
)
# Those of them after which the last height may long have been wrong, or the speed is a fall's.
HEIGHTLESS = frozenset({"sensor_frozen", "thrust_lost", "battery_lost"})
# After these the loop itself swings: it lands with half the bandwidth.
SWINGING = frozenset({"commands_late", "motion_unexplained", "range_late"})
DESCENT_MPS = 0.25
DESCENT_LIMIT = 2.0  # times the usual way down; then it touches down wherever it is
LEAST_DESCENT_LIMIT_S = 8.0
LANDED_M = 0.03


@dataclass(frozen=True, slots=True)
class Descent:
    """Where and when it began; `blind` has the pulses if the height is not known.

    `limit_s` [s, on the clock of `start_s`] ends a controlled descent wherever it is.
    """

    start_s: float
    z_m: float
    x_m: float
    limit_s: float
    blind: BlindPulses | None = None

    def line_m(self, t_s: float) -> float:
        """The height that a controlled descent aims at [m]."""
        return max(self.z_m - DESCENT_MPS * (t_s - self.start_s), 0.0)


def descent_reference(descent: Descent, t_s: float, idle_us: float) -> Reference:
    """The aim on the way down [SI]: a straight line in time, the source idle, the carriage held."""
    z_m = descent.line_m(t_s)
    return Reference(z_m, -DESCENT_MPS if z_m > 0.0 else 0.0, 0.0, descent.x_m, 0.0, idle_us)


def is_down(descent: Descent, t_s: float, z_m: float) -> bool:
    """Whether a controlled descent is at its end, where the touch-down begins."""
    at_end = descent.line_m(t_s) <= 0.0
    return (at_end and z_m < LANDED_M) or t_s > descent.limit_s


def limit_s(t_s: float, z_m: float) -> float:
    """The latest time [s] at which a controlled descent that begins now ends."""
    return t_s + max(LEAST_DESCENT_LIMIT_S, DESCENT_LIMIT * z_m / DESCENT_MPS)


def has_landed(descent: Descent, t_s: float, limits: Limits) -> bool:
    """Whether a blind descent's ladder is over."""
    return t_s - descent.start_s >= ladder_s(limits)
