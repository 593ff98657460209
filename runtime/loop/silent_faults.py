"""Signs that a part of the rig has failed although everything still answers.

In: what one tick read, estimated and asked for. Out: how long the range sensor has been saying the
same, the sufferer has not lifted, the battery has been gone. Pure steps; `runtime.loop.safety`
says how long is too long, and why.
"""

import math
from dataclasses import dataclass

from runtime.loop.safety import HELD_MPS, HELD_SHARE, RANGE_FROZEN_S
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.rail import GRAVITY_MPS2

AIRBORNE_M = 0.1  # below this a VL53L0X may say the same for long: it measures badly so near
GROUNDED_M = 0.05  # the stop, range noise and the filter's error in a hard landing
REPEAT_CHANCE = 1e-9  # that a healthy sensor repeats itself for long enough to be called frozen
LIFTING_SHARE = 1.5  # of the weight: a thrust that lifts, see `runtime.loop.safety`
# Of the voltage at arming. Below, a lithium cell that was full is at 2.5 V: empty, or cut off. It
# need not fall to zero: behind an emergency stop the ESCs' capacitors hold some for a while.
BATTERY_GONE_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class Signs:
    """For how long each sign has been there [s], and what the next tick has to know."""

    t_s: float = 0.0
    range_frozen_s: float = 0.0
    not_lifting_s: float = 0.0
    battery_gone_s: float = 0.0
    thrust_share: float = 0.0  # what the commands should give by now, over the weight
    range_m: float = float("nan")
    vz_mps: float = 0.0
    held_up_mps: float = 0.0  # the speed that gravity should have taken, and has not
    armed_v: float = 0.0  # the battery's voltage at arming; 0 where none is measured


def may_repeat(rig: Rig) -> bool:
    """Whether a healthy sensor says the same again and again, as its noise is below its step."""
    return frozen_limit_s(rig) > RANGE_FROZEN_S


def frozen_limit_s(rig: Rig) -> float:
    """How long a sensor may say the same in the air [s]; infinite for one that always may.

    Noise below the resolution is mostly rounded away. In the worst case the sufferer stands still
    in the middle of a step, and a reading leaves the step as often as noise exceeds half of it.
    """
    sensor = rig.range_sensor
    step_m = max(sensor.resolution_m, 1e-6)
    if sensor.noise_m >= step_m:
        return RANGE_FROZEN_S
    leaves = math.erfc(step_m / (2.0 * math.sqrt(2.0) * sensor.noise_m)) if sensor.noise_m else 0.0
    if leaves == 0.0:
        return math.inf
    readings = math.log(REPEAT_CHANCE) / math.log1p(-leaves)
    held_s = unplaced_constants(rig)["range.hold_s"]
    return max(RANGE_FROZEN_S, readings * max(sensor.period_s, 1.0 / LOOP_RATE_HZ, held_s))


class SignReader:
    """The constants of one rig, and the pure step."""

    def __init__(self, rig: Rig) -> None:
        self.frozen_limit_s = frozen_limit_s(rig)
        self._weight_n = believed(rig).sufferer.mass_kg * GRAVITY_MPS2

    def step(
        self,
        before: Signs,
        *,
        t_s: float,
        range_m: float,
        z_m: float,
        vz_mps: float,
        thrust_n: float,
        battery_v: float,
    ) -> Signs:
        """Look at one tick: `thrust_n` is what the commands should give by now, after spool.

        A battery can only be gone if one was measured at arming.
        """
        passed_s = max(t_s - before.t_s, 0.0)
        share = thrust_n / self._weight_n
        is_frozen = z_m > AIRBORNE_M and range_m == before.range_m
        is_heavy = z_m < GROUNDED_M and share > LIFTING_SHARE
        is_light = z_m > AIRBORNE_M and share < HELD_SHARE and abs(vz_mps) < HELD_MPS
        owed_mps = (1.0 - share) * GRAVITY_MPS2 * passed_s + vz_mps - before.vz_mps
        is_gone = battery_v < BATTERY_GONE_SHARE * before.armed_v
        return Signs(
            t_s,
            before.range_frozen_s + passed_s if is_frozen else 0.0,
            before.not_lifting_s + passed_s if is_heavy else 0.0,
            before.battery_gone_s + passed_s if is_gone else 0.0,
            share,
            range_m,
            vz_mps,
            max(before.held_up_mps + owed_mps, 0.0) if is_light else 0.0,
            before.armed_v,
        )
