"""Signs that a part of the rig has failed although everything still answers.

In: what one tick read, estimated and asked for. Out: since when the range sensor has been saying
the same, the sufferer has not lifted, the battery has been gone. Pure steps; `runtime.safety` says
how long is too long, and why.
"""

from dataclasses import dataclass

from wakedeploy.physics.effects.chain import believed
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig import Rig

AIRBORNE_M = 0.1  # below, a VL53L0X may say the same for long: so near it measures badly
GROUNDED_M = 0.05  # the stop, range noise and the filter's error in a hard landing
LIFTING_SHARE = 1.5  # of the weight: a thrust that lifts, see `runtime.safety`


@dataclass(frozen=True, slots=True)
class Signs:
    """For how long each sign has been there [s], and what the next tick has to know."""

    t_s: float = 0.0
    range_frozen_s: float = 0.0
    not_lifting_s: float = 0.0
    battery_gone_s: float = 0.0
    thrust_share: float = 0.0  # what the commands should give by now, over the weight
    range_m: float = float("nan")
    has_battery: bool = False


class SignReader:
    """The constants of one rig, and the pure step."""

    def __init__(self, rig: Rig) -> None:
        # Readings that differ by less than a millimetre repeat themselves in a healthy sensor, too.
        self._is_noisy = rig.range_sensor.noise_m >= max(rig.range_sensor.resolution_m, 1e-6)
        self._weight_n = believed(rig).sufferer.mass_kg * GRAVITY_MPS2

    def step(
        self,
        before: Signs,
        *,
        t_s: float,
        range_m: float,
        z_m: float,
        thrust_n: float,
        battery_v: float,
    ) -> Signs:
        """Look at one tick: `thrust_n` is what the commands should give by now, after spool.

        `battery_v` is 0 where no battery is measured; it can only be gone once it was there.
        """
        passed_s = max(t_s - before.t_s, 0.0)
        share = thrust_n / self._weight_n
        is_frozen = self._is_noisy and z_m > AIRBORNE_M and range_m == before.range_m
        is_heavy = z_m < GROUNDED_M and share > LIFTING_SHARE
        is_gone = before.has_battery and battery_v == 0.0
        return Signs(
            t_s,
            before.range_frozen_s + passed_s if is_frozen else 0.0,
            before.not_lifting_s + passed_s if is_heavy else 0.0,
            before.battery_gone_s + passed_s if is_gone else 0.0,
            share,
            range_m,
            before.has_battery or battery_v > 0.0,
        )
