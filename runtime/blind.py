"""The pulses of a descent without commands: every command says them to the board."""

from wakedeploy.rig import Rig


def blind_pulses(rig: Rig) -> tuple[float, float]:
    """The sufferer's pulses [µs] while the board brakes and while it sinks: both idle."""
    idle_us, _ = rig.limits.pulse_us
    return idle_us, idle_us
