"""Before a flight: what the board is armed with, and what it must then report of itself."""

from runtime.io.protocol import Arm, Status
from runtime.reference import FlightPlan
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig


def arm_limits(rig: Rig, motors_off: bool = False) -> Arm:
    """The rig's limits as the MCU takes them; with `motors_off` nothing turns a motor.

    The MCU refuses an empty range of pulses; no ESC starts a microsecond above idle.
    """
    limits, stepper = rig.limits, rig.stepper
    idle_us, full_us = limits.pulse_us
    return Arm(
        idle_us,
        idle_us + 1.0 if motors_off else full_us,
        round(limits.slew_us_per_s),
        round(1000.0 * limits.source_descent_s),
        round(1000.0 * limits.sufferer_descent_s),
        round(stepper.max_speed_mps * stepper.steps_per_m),
        round(stepper.max_accel_mps2 * stepper.steps_per_m),
        round(1000.0 * limits.brake_s),
        round(1000.0 * limits.sink_s),
        round(limits.sink_rate_us_per_s),
    )


def require_home(armed: Status, *, is_plant: bool) -> None:
    """UnusableInput when the carriage is not where its steps are counted from.

    Nobody can push that of a plant process, which `rig virtual` serves.
    """
    if not armed.homed and is_plant:
        raise UnusableInput(
            "The carriage of this virtual gantry is not at its home mark, from where its steps are "
            "counted; end `wakedeploy rig virtual` by Ctrl-C, begin it anew and start again."
        )
    if not armed.homed:
        raise UnusableInput(
            "The carriage is not at its home mark, from where its steps are counted; switch "
            "the stepper's supply off, push it there, switch it on and start again."
        )


def require_battery(armed: Status, rig: Rig, plan: FlightPlan) -> None:
    """UnusableInput when a battery that can be measured is not there for a flight."""
    if rig.battery.has_divider and not armed.battery_mv and not plan.motors_off:
        raise UnusableInput(
            "The board measures no battery: release the emergency stop, plug the battery in "
            "and start again; a rig without a divider has no battery.has_divider."
        )
