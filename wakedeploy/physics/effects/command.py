"""Effects on the way of a command: from the MCU's output to the pulse that an ESC accepts."""

import numpy as np
import numpy.typing as npt

from wakedeploy.physics.effects.base import Effect, Parameter, Values


class CommandLatency(Effect):
    """A dead time between MCU and ESC."""

    name = "command-latency"
    physics = "A command reaches the ESCs later than the link's round trip tells."
    equation = "u′(t) = u(t − latency_s)"
    stage = "command"
    parameters = (
        Parameter(
            "latency_s",
            "s",
            scale=0.02,
            low=0.0,
            high=0.15,
            constant="command.delay_s",
            # Servo frames against the loop's ticks give the likelihood several peaks.
            starts=(0.5, 1.25, 2.25, 3.5),
        ),
    )
    confused_with = ("spool-lag-sufferer", "esc-frame", "range-delay")
    split_by = "thrust steps up and down: a dead time shifts the response, a lag bends it"
    shows_in = ("sufferer-speed", "source-speed")


class EscFrame(Effect):
    """The servo frame's period."""

    name = "esc-frame"
    physics = "The ESC takes over a command only with the next servo frame."
    equation = "u′(t) = u(t_k) from t_k = t_0 + k · frame_s on, for frame_s"
    stage = "command"
    parameters = (
        Parameter(
            "frame_s", "s", scale=0.01, low=0.0, high=0.1, constant="disturbance.esc_frame_s"
        ),
    )
    confused_with = ("command-latency",)
    split_by = "the time at which the UNO applies each pulse"
    shows_in = ("sufferer-speed", "source-speed")


class PwmDeadBand(Effect):
    """An ESC that ignores small changes."""

    name = "pwm-dead-band"
    physics = "An ESC ignores a pulse that differs too little from the last one it accepted."
    equation = "u′ = u if |u − u_k| ≥ band_us else u_k"
    stage = "command"
    parameters = (
        Parameter(
            "band_us",
            "us",
            scale=5.0,
            low=0.0,
            high=50.0,
            starts=(0.5, 1.0, 2.0),
            # Which commands it swallows depends on all before: a climb ends on the next ledge.
            scanned=(2.0, 40.0, 1.005),
            summits_apart=0.02,
        ),
    )
    confused_with = ("pwm-quantisation", "stiction")
    split_by = "a slow triangle of the sufferer's command"
    shows_in = ("sufferer-speed", "source-speed")

    def pulse_us(
        self, p: Values, pulse_us: float, applied_us: float, motor: str, idle_us: float
    ) -> float:
        """The old pulse [µs] until the new one is a band away from it."""
        return applied_us if abs(pulse_us - applied_us) < p["band_us"] else pulse_us

    def pulses_us(
        self, p: Values, pulses_us: npt.NDArray[np.float64], motor: str, idle_us: float
    ) -> npt.NDArray[np.float64]:
        """The same, without a call for each frame."""
        band_us, applied_us, taken = p["band_us"], idle_us, []
        low_us, high_us = applied_us - band_us, applied_us + band_us
        for pulse_us in pulses_us.tolist():
            if pulse_us <= low_us or pulse_us >= high_us:
                applied_us = pulse_us
                low_us, high_us = applied_us - band_us, applied_us + band_us
            taken.append(applied_us)
        return np.array(taken)


class PwmQuantisation(Effect):
    """A timer that counts in coarse steps."""

    name = "pwm-quantisation"
    physics = "Pulse widths exist only in steps of a timer, counted from the idle pulse."
    equation = "u′ = u_idle + step_us · round((u − u_idle) / step_us)"
    stage = "command"
    parameters = (
        Parameter(
            "step_us",
            "us",
            scale=5.0,
            low=0.0,
            high=40.0,
            starts=(0.5, 1.0, 2.0),
            # Hover is 50 steps of 15 us from idle: a step of 0.3 % more puts it elsewhere.
            scanned=(3.0, 30.0, 1.0015),
        ),
    )
    confused_with = ("pwm-dead-band", "stiction")
    split_by = "a slow triangle of the sufferer's command"
    shows_in = ("sufferer-speed", "source-speed")

    def pulse_us(
        self, p: Values, pulse_us: float, applied_us: float, motor: str, idle_us: float
    ) -> float:
        """The nearest pulse [µs] that the timer can make."""
        step_us = p["step_us"]
        if step_us <= 0.0:
            return pulse_us
        return idle_us + step_us * round((pulse_us - idle_us) / step_us)

    def pulses_us(
        self, p: Values, pulses_us: npt.NDArray[np.float64], motor: str, idle_us: float
    ) -> npt.NDArray[np.float64]:
        """The same for all frames at once."""
        step_us = p["step_us"]
        if step_us <= 0.0:
            return pulses_us
        return np.asarray(idle_us + step_us * np.round((pulses_us - idle_us) / step_us))


EFFECTS: tuple[Effect, ...] = (CommandLatency(), EscFrame(), PwmDeadBand(), PwmQuantisation())
