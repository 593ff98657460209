"""Kinds that act at a sensor, and kinds that change a constant."""

import numpy as np

from wakedeploy.gap.systems.kinds.kind import FloatArray, Kind, Parameter, Parameters

_OF_OUTPUT = {"output": 1}
_SENSORS = "Fraden, Handbook of Modern Sensors, 2016"


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
        self, value: FloatArray, own_states: tuple[FloatArray, ...], p: Parameters
    ) -> tuple[FloatArray, ...]:
        """Derivatives of the kind's own states."""
        return ()


class SensorGain(OutputKind):
    """The sensor shows more, or less."""

    name = "sensor-gain"
    phrase = "a scale error of the sensor of {port}"
    equation = "(1 + error) y"
    source = _SENSORS
    parameters = (Parameter("error", {}, low=-0.9, high=3.0, starts=(0.05, -0.05), prior=0.3),)

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
    """The sensor shows nothing above a limit."""

    name = "sensor-saturation"
    phrase = "a limit above which the sensor of {port} shows nothing"
    equation = "min(y, limit)"
    source = _SENSORS
    parameters = (
        Parameter("limit", {"top": 1}, neutral=1.5, low=-1.5, high=1.5, starts=(0.98, 0.9),
                  prior=1.0),
    )  # fmt: skip

    def reading(
        self,
        value: FloatArray,
        own_states: tuple[FloatArray, ...],
        time_s: FloatArray,
        p: Parameters,
    ) -> FloatArray:
        """Cut above."""
        return np.minimum(value, p["limit"])


class SensorLag(OutputKind):
    """The sensor follows with a time constant."""

    name = "sensor-lag"
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
        self, value: FloatArray, own_states: tuple[FloatArray, ...], p: Parameters
    ) -> tuple[FloatArray, ...]:
        """Towards the value."""
        return ((value - own_states[0]) / np.maximum(p["tau_s"], _SHORTEST_S),)


class SensorDeadTime(OutputKind):
    """The sensor shows what was; to first order in the delay, as Padé has it."""

    name = "sensor-dead-time"
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
        self, value: FloatArray, own_states: tuple[FloatArray, ...], p: Parameters
    ) -> tuple[FloatArray, ...]:
        """Towards the value, within half the delay."""
        return ((value - own_states[0]) / np.maximum(0.5 * p["delay_s"], _SHORTEST_S),)


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
    SensorGain(), SensorBias(), SensorDrift(), SensorSaturation(), SensorLag(), SensorDeadTime(),
)  # fmt: skip
CONSTANT_KINDS = (Scale(), ConstantDrift())
