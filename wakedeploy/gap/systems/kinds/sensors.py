"""Kinds that act at a sensor, and kinds that change a constant."""

from collections.abc import Mapping

import numpy as np

from wakedeploy.gap.systems.kinds.kind import FloatArray, Kind, Parameter, Parameters, pace

_OF_OUTPUT = {"output": 1}
_SENSORS = "Fraden, Handbook of Modern Sensors, 2016"
_CLEARLY = 3.0  # sd of a sensor's noise, by which a reading is clearly below a limit


class OutputKind(Kind):
    """Acts between what the system does and what is logged."""

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """What the sensor shows of a value."""
        raise NotImplementedError

    def own_rates(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        p: Parameters,
        dt_s: float,
        discrete: bool,
    ) -> tuple[FloatArray, ...]:
        """Derivatives of the kind's own states; of a `discrete` system, means over a sample."""
        return ()

    def at_once(self, p: Parameters, step_s: float) -> FloatArray | float:
        """The share of a jump that a reading shows in its own step, for a kind with own states.

        An output that an input changes directly jumps with it, and a reading is one of its step:
        the share is a mean over the step, so that a kind vanishes as its time does.
        """
        return 1.0

    def reading_near(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
        measured: FloatArray,
        sd: FloatArray,
    ) -> FloatArray:
        """The same where the logged reading and its sd (L,) are known, to correct a state by."""
        return self.reading(value, own_states, time_s, p)


class SensorGain(OutputKind):
    """The sensor shows more, or less."""

    name = "sensor-gain"
    is_gain = True
    phrase = "a scale error of the sensor of {port}"
    equation = "(1 + error) y"
    source = _SENSORS
    parameters = (Parameter("error", {}, low=-0.9, high=3.0, starts=(0.05, -0.05), prior=0.3),)

    def inputs_answered(self, sizes: Mapping[str, float]) -> float:
        """What the gain is in all."""
        return 1.0 + sizes["error"]

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """Scaled."""
        return np.asarray((1.0 + p["error"]) * value)


class SensorBias(OutputKind):
    """The sensor is off by a constant."""

    name = "sensor-bias"
    is_constant = True
    phrase = "a constant error of the sensor of {port}"
    equation = "y + bias"
    source = _SENSORS
    parameters = (Parameter("bias", _OF_OUTPUT, starts=(0.1, -0.1), prior=0.5),)

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """Moved."""
        return np.asarray(value + p["bias"])


class SensorDrift(OutputKind):
    """The sensor's zero moves with time."""

    name = "sensor-drift"
    phrase = "a drift of the zero of the sensor of {port}"
    equation = "y + rate t"
    source = _SENSORS
    parameters = (Parameter("rate", {"output": 1, "span": -1}, starts=(0.1, -0.1), prior=0.5),)

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """Moved by a line over time."""
        return np.asarray(value + p["rate"] * time_s)


class SensorSaturation(OutputKind):
    """The sensor shows nothing above a limit, so that is no less than the largest reading."""

    name = "sensor-saturation"
    phrase = "a limit above which the sensor of {port} shows nothing"
    equation = "min(y, limit)"
    source = _SENSORS
    needs = ("cut above",)
    parameters = (
        Parameter("limit", _OF_OUTPUT, origin="top", neutral=3.0, low=0.0, high=3.0,
                  starts=(0.0,), prior=3.0),
    )  # fmt: skip
    _sign = 1.0

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """Cut beyond."""
        beyond = np.minimum(self._sign * value, self._sign * p["limit"])
        return np.asarray(self._sign * beyond)

    def reading_near(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
        measured: FloatArray,
        sd: FloatArray,
    ) -> FloatArray:
        """A reading that is clearly within the limit was not cut, wherever the state is thought.

        Cut there, it would have no slope: no reading would call back a state that is too far.
        """
        is_whole = self._sign * (p["limit"] - measured) > _CLEARLY * sd
        return np.where(is_whole, value, self.reading(value, own_states, time_s, p))


class SensorFloor(SensorSaturation):
    """The sensor shows nothing below a limit, as one of range does that is too near."""

    name = "sensor-floor"
    phrase = "a limit below which the sensor of {port} shows nothing"
    equation = "max(y, limit)"
    needs = ("cut below",)
    parameters = (
        Parameter("limit", _OF_OUTPUT, origin="bottom", neutral=-3.0, low=-3.0, high=0.0,
                  starts=(0.0,), prior=3.0),
    )  # fmt: skip
    _sign = -1.0


class SensorLag(OutputKind):
    """The sensor follows with a time constant."""

    name = "sensor-lag"
    is_slow = True
    phrase = "a lag of the sensor of {port}"
    equation = "tau y' + y = value"
    source = _SENSORS
    own_states = 1
    parameters = (
        Parameter("tau_s", {"time": 1}, low=0.0, high=500.0, starts=(1.0, 4.0, 15.0), step=0.02,
                  prior=30.0),
    )  # fmt: skip

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """The lagged value."""
        return np.asarray(own_states[0] + 0.0 * value)

    def own_rates(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        p: Parameters,
        dt_s: float,
        discrete: bool,
    ) -> tuple[FloatArray, ...]:
        """Towards the value."""
        return ((value - own_states[0]) * pace(p["tau_s"], dt_s, discrete, _SHORTEST_S),)

    def at_once(self, p: Parameters, step_s: float) -> FloatArray | float:
        """The mean of the response over a step."""
        steps = np.maximum(p["tau_s"], _SHORTEST_S) / step_s
        return np.asarray(1.0 - steps * -np.expm1(-1.0 / steps))


class SensorDeadTime(OutputKind):
    """The sensor shows what was; to first order in the delay, as Padé has it."""

    name = "sensor-dead-time"
    is_slow = True
    is_delay = True
    phrase = "a delay of the sensor of {port}"
    equation = "y(t − delay)"
    source = "Baker and Graves-Morris, Padé Approximants, 1996"
    own_states = 1
    parameters = (
        Parameter("delay_s", {"time": 1}, low=0.0, high=100.0, starts=(1.0, 4.0, 12.0), step=0.02,
                  prior=20.0),
    )  # fmt: skip

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """The all-pass response."""
        return np.asarray(2.0 * own_states[0] - value)

    def own_rates(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        p: Parameters,
        dt_s: float,
        discrete: bool,
    ) -> tuple[FloatArray, ...]:
        """Towards the value, within half the delay."""
        return ((value - own_states[0]) * pace(0.5 * p["delay_s"], dt_s, discrete, _SHORTEST_S),)

    def at_once(self, p: Parameters, step_s: float) -> FloatArray | float:
        """The part of a step that is left once the delay is over."""
        return np.maximum(1.0 - np.asarray(p["delay_s"]) / step_s, 0.0)


class ConstantKind(Kind):
    """Acts on a constant."""

    def value(self, constant: FloatArray, time_s: FloatArray, p: Parameters) -> FloatArray:
        """What the constant is then."""
        raise NotImplementedError


class Scale(ConstantKind):
    """The constant is another than was measured."""

    name = "scale"
    phrase = "a correction of the constant {port}"
    equation = "(1 + error) c"
    source = "Ljung, System Identification, 1999"
    parameters = (Parameter("error", {}, low=-0.95, high=10.0, starts=(0.2, -0.2), prior=1.0),)

    def value(self, constant: FloatArray, time_s: FloatArray, p: Parameters) -> FloatArray:
        """Scaled."""
        return np.asarray(constant * (1.0 + p["error"]))


class ConstantDrift(ConstantKind):
    """The constant changes along the log, as by warming."""

    name = "constant-drift"
    phrase = "a change of the constant {port} along the log"
    equation = "(1 + rate t) c"
    source = "Ljung, System Identification, 1999"
    parameters = (
        Parameter("rate", {"span": -1}, low=-0.95, high=3.0, starts=(0.1, -0.1), prior=0.5),
    )

    def value(self, constant: FloatArray, time_s: FloatArray, p: Parameters) -> FloatArray:
        """Scaled by a line over time."""
        return np.asarray(constant * (1.0 + p["rate"] * time_s))


_SHORTEST_S = 1e-5


OUTPUT_KINDS = (
    SensorGain(), SensorBias(), SensorDrift(), SensorSaturation(), SensorFloor(), SensorLag(),
    SensorDeadTime(),
)  # fmt: skip
CONSTANT_KINDS = (Scale(), ConstantDrift())
