"""What ends a flight in a failsafe: each fault by its name in the log, in words, and what to do."""

# By the names of `runtime.loop.safety`: what happened, then after the colon what to do about it.
HINTS = {
    "link_lost": "the board stopped answering: check the USB cable and the board's power",
    "loop_error": "the program failed in flight: the error is told; report it with the log",
    "commands_late": "the board answered far later than latency.round_trip_s: take hubs and other "
    "devices off its USB port, or measure the round trip with wakedeploy calibrate latency",
    "motion_unexplained": "the motion fits neither thrust nor wake, and swings: check the range "
    "sensor's delay, and mass and thrust curve in the rig file",
    "loop_stalled": "the computer stood still: end what else runs on it",
    "battery_lost": "the battery's voltage fell far: check its plug, its charge and the stop",
    "sensor_lost": "no new range sample: check the sensor's wires and that it sees the reflector",
    "sensor_frozen": "the range sensor says the same all the time: switch it off and on again",
    "sensor_jump": "the measured height jumped and stayed there: keep the sensor's beam free",
    "sensor_noisy": "most of what the range sensor says is noise: check its wires, its reflector "
    "and range_sensor.noise_m, and keep sunlight off it",
    "height_impossible": "the range sensor sees the sufferer in the air while nothing carries it: "
    "check what is in its beam, and whether its readings drift",
    "thrust_lost": "the thrust does not follow the command: check the battery, the ESC and the "
    "propeller, that nothing covers the range sensor, and that the wake is not stronger than it",
    "mcu_fault": "the board's deadman or watchdog latched: check its power and the computer's load",
    "mcu_reboot": "the board restarted in flight: check its power supply",
    "recorder_failed": "the run could not be recorded any further: check the disk's free space",
    "operator_stop": "stopped by hand",
    "x_limit": "the carriage left limits.x_m: check the belt and steps_per_m",
    "z_limit": "the sufferer left limits.z_m: check the range sensor and the control gains",
}
# Of the virtual gantry in real time, which has no cable: it answers late where it gets no time.
LATE_GANTRY = (
    "the virtual gantry answered too late, as this computer is too slow or too busy to fly it in "
    "real time: fly in simulated time, without --wall-clock, --live and --foxglove, or end what "
    "else runs on it"
)
# What a computer that stands still can look like from inside.
BY_THE_COMPUTER = ("loop_stalled", "link_lost", "mcu_fault", "sensor_lost")


def hints(*, is_virtual: bool) -> dict[str, str]:
    """The hints of a flight; on a virtual gantry nobody is sent to look at cables."""
    if not is_virtual:
        return HINTS
    return HINTS | {name: f"{in_words(name)}: {_NO_CABLE}" for name in BY_THE_COMPUTER}


_NO_CABLE = (
    "on a virtual gantry that is a fault that was put in, or in real time this computer, if it is "
    "too slow or too busy: fly in simulated time"
)


def in_words(fault: str) -> str:
    """What happened, without what to do; of a fault that is not known here its name."""
    return HINTS.get(fault, fault.replace("_", " ")).partition(":")[0]
