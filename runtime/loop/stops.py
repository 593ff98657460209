"""Thrust that keeps the sufferer from meeting a stop hard, whatever the controller asks for.

In: an estimate. Out: bounds of the thrust. A controller sees an error of height and not the stop
behind it: it asks for full thrust only when the way left is too short. Far from a stop, and at the
speeds of any plan, there are no bounds. If even full thrust is too little, the source idles: its
wake is the one load that the loop can take away.
"""

import math
from dataclasses import dataclass

from runtime.loop.estimate import Estimate
from wakedeploy.core.rig import Rig
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.rail import GRAVITY_MPS2

LOWER_MPS, UPPER_MPS = 0.45, 0.3  # a stop met at this speed is met softly
NEAREST_M = 0.02  # a shorter way left counts as this: so near, readings are mostly noise
LEAST_MPS = 0.15  # a slower sufferer stands, or a controller has time
LEAST_MPS2 = 1.0  # a controller brakes by this much itself
ENOUGH_SHARE = 0.9  # of full thrust: if more is asked for, the source's wake is too much


@dataclass(frozen=True, slots=True)
class Bounds:
    """The least and the largest thrust [N], and whether the motor has too little."""

    least_n: float = -math.inf
    most_n: float = math.inf
    is_short: bool = False


class Stops:
    """One rig's stops, and how long a pulse takes to carry."""

    def __init__(self, rig: Rig) -> None:
        self._travel_m = rig.sufferer.travel_m
        self._mass_kg = believed(rig).sufferer.mass_kg
        self._weight_n = self._mass_kg * GRAVITY_MPS2
        self._full_n = float(believed(rig).thrust.sufferer.thrust_n[-1])
        lag, way_s = believed(rig).spool.sufferer, 0.5 * rig.latency.round_trip_s
        way_s += 0.5 * rig.disturbance.esc_frame_s + unplaced_constants(rig)["command.delay_s"]
        self._up_s, self._down_s = way_s + lag.up_s, way_s + lag.down_s

    def ahead(self, now: Estimate, other_n: float) -> Bounds:
        """The bounds of the thrust [N] that still brake before the stops.

        `other_n`: the force [N] beside thrust and weight.
        """
        carried_n = self._weight_n - other_n
        held_mps2 = (now.rotor_speed**2 - carried_n) / self._mass_kg
        # A speed that may be mere noise does not count.
        sure_mps = float(now.height_cov[1, 1]) ** 0.5
        up_mps2 = _braking(now.z_m, -now.vz_mps - sure_mps, -held_mps2, self._up_s, LOWER_MPS)
        above_m = self._travel_m - now.z_m
        down_mps2 = _braking(above_m, now.vz_mps - sure_mps, held_mps2, self._down_s, UPPER_MPS)
        if up_mps2 > LEAST_MPS2:
            least_n = carried_n + self._mass_kg * up_mps2
            return Bounds(least_n=least_n, is_short=least_n > ENOUGH_SHARE * self._full_n)
        if down_mps2 > LEAST_MPS2:
            return Bounds(most_n=carried_n - self._mass_kg * down_mps2)
        return Bounds()


def _braking(
    left_m: float, speed_mps: float, held_mps2: float, lag_s: float, soft_mps: float
) -> float:
    """The braking [m/s²] that meets a stop `left_m` ahead softly, once the lag is over.

    `speed_mps` and `held_mps2` are towards the stop, now and until then.
    """
    if speed_mps < LEAST_MPS:  # also on the stop with the motor idle
        return 0.0
    left_m -= speed_mps * lag_s + 0.5 * held_mps2 * lag_s**2
    speed_mps += held_mps2 * lag_s
    if speed_mps <= soft_mps:
        return 0.0
    return (speed_mps**2 - soft_mps**2) / (2.0 * max(left_m, NEAREST_M))
