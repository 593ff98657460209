"""Kinds that act on a logged input before it reaches the system.

Each maps a whole column (n,) to another; the log's sample time is `dt_s`. What they act on was
measured, so they need no state in the filter, but for what came before the log: an input that was
moving then reaches the system from where no column says. What is late adds states for that: those
of a lag decay, that of a dead time ends with it.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from scipy.signal import lfilter

from wakedeploy.gap.systems.kinds.kind import FloatArray, Kind, Parameter, Parameters, pace
from wakedeploy.physics.kalman import limited_rate, slack

_LJUNG = "Ljung, System Identification, 1999"
_OF_INPUT = {"input": 1}
_AHEAD = 3.0  # time constants


class InputKind(Kind):
    """Acts on a column of the log."""

    by_sample: ClassVar[bool] = False  # whether it acts on samples, and not on parts of them
    passes_laws: ClassVar[bool] = False  # whether it does the same before a law and behind it

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """What reaches the system, (n,), of what was logged, (n,)."""
        raise NotImplementedError

    def own_rates(
        self, own_states: tuple[FloatArray, ...], p: Parameters, dt_s: float, discrete: bool
    ) -> tuple[FloatArray, ...]:
        """Derivatives of the kind's own states; of a `discrete` system, means over a sample."""
        return ()

    def from_before(
        self, own_states: tuple[FloatArray, ...], since_s: FloatArray, p: Parameters, dt_s: float
    ) -> FloatArray:
        """What they add to the column, so long after the log began."""
        return own_states[-1]

    def unsettled(self, column: FloatArray, p: Parameters, dt_s: float) -> float:
        """How far the kind's own states may be from 0 where a logged column (n,) begins, as sd."""
        return 0.0

    def remaining(self, since_s: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Which share of that is left so long after the log began."""
        return np.zeros_like(since_s)


class DeadTime(InputKind):
    """The input acts later."""

    name = "dead-time"
    is_delay = True
    passes_laws = True
    phrase = "a delay before {port} acts"
    equation = "u(t − delay)"
    source = _LJUNG
    own_states = 1
    parameters = (
        Parameter("delay_s", {"time": 1}, low=0.0, high=200.0, starts=(1.0, 3.0, 10.0, 30.0),
                  step=0.02, prior=30.0),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """The column, later by a time that need not be whole samples."""
        return shifted(column, p["delay_s"] / dt_s)

    def own_rates(
        self, own_states: tuple[FloatArray, ...], p: Parameters, dt_s: float, discrete: bool
    ) -> tuple[FloatArray, ...]:
        """No rate: the command before the log acts until the first one in the log does."""
        return (np.zeros_like(own_states[0]),)

    def from_before(
        self, own_states: tuple[FloatArray, ...], since_s: FloatArray, p: Parameters, dt_s: float
    ) -> FloatArray:
        """How far that is from the first command, as long as it acts; its mean over a sample."""
        return np.asarray(own_states[0] * np.clip((p["delay_s"] - since_s) / dt_s, 0.0, 1.0))

    def unsettled(self, column: FloatArray, p: Parameters, dt_s: float) -> float:
        """As far as commands go in the whole log: many a script begins with a step."""
        return float(np.sqrt(np.mean((column - column[0]) ** 2)))

    def remaining(self, since_s: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """All, until the first command acts."""
        return np.asarray(np.where(since_s < p["delay_s"], 1.0, 0.0))


class Lag(InputKind):
    """The input follows its command with one time constant."""

    name = "lag"
    is_slow = True
    phrase = "a lag with which {port} follows its command"
    equation = "tau u' + u = command"
    source = _LJUNG
    own_states = 1
    parameters = (
        Parameter("tau_s", {"time": 1}, low=0.0, high=1000.0, starts=(1.0, 3.0, 10.0, 40.0),
                  step=0.02, prior=50.0),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Means over each sample of a first-order response to a held input."""
        return lagged(column, p["tau_s"] / dt_s)

    def own_rates(
        self, own_states: tuple[FloatArray, ...], p: Parameters, dt_s: float, discrete: bool
    ) -> tuple[FloatArray, ...]:
        """Towards 0."""
        return (-own_states[0] * pace(p["tau_s"], dt_s, discrete, least_s=dt_s),)

    def unsettled(self, column: FloatArray, p: Parameters, dt_s: float) -> float:
        """As far as the command goes in the time that follows, as it may have gone before."""
        return _moved(column, float(p["tau_s"]) / dt_s)

    def remaining(self, since_s: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """An exponential."""
        return np.exp(-since_s / max(float(p["tau_s"]), dt_s))


class SecondOrderLag(InputKind):
    """The input follows its command as a damped oscillator does: two time constants, or ringing.

    Its own states are what is left of u + tau u' and of u from before the log: see `_free`.
    """

    name = "second-order-lag"
    is_slow = True
    simpler = ("lag", "dead-time")
    phrase = "a lag of second order with which {port} follows its command"
    equation = "tau² u'' + 2 damping tau u' + u = command"
    source = _LJUNG
    own_states = 2
    parameters = (
        Parameter("tau_s", {"time": 1}, low=0.0, high=500.0,
                  starts=(0.5, 2.0, 6.0, 20.0, 2.0, 6.0, 20.0), step=0.02, prior=30.0),
        Parameter("damping", {}, neutral=1.0, low=0.1, high=2.0,
                  starts=(1.0, 1.0, 1.0, 1.0, 0.4, 0.4, 0.4), step=0.02, prior=0.5),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """The mean over each sample of the response to a held column, exactly."""
        samples, damping = float(p["tau_s"]) / dt_s, float(p["damping"])
        if samples < 1e-3:
            return column
        free, both = _free(damping), np.ones(2)
        cosine, sine = _swinging(damping, np.array(1.0 / samples))
        a = cosine * np.eye(2) + sine * (free + damping * np.eye(2))  # over a sample
        c = samples * np.linalg.solve(free, a - np.eye(2))[1]  # of where it begins, in its mean
        b, d = both - a @ both, 1.0 - c.sum()
        first, second = -np.trace(a), np.linalg.det(a)
        over = [d, c @ b + first * d, c @ a @ b + first * (c @ b) + second * d]
        return np.asarray(column[0] + lfilter(over, [1.0, first, second], column - column[0]))

    def own_rates(
        self, own_states: tuple[FloatArray, ...], p: Parameters, dt_s: float, discrete: bool
    ) -> tuple[FloatArray, ...]:
        """As an oscillator that is let go."""
        tau_s, damping = np.maximum(p["tau_s"], dt_s), p["damping"]
        ahead, y = own_states
        free = (1.0 - 2.0 * damping) * ahead - (2.0 - 2.0 * damping) * y, ahead - y
        if not discrete:
            return free[0] / tau_s, free[1] / tau_s
        cosine, sine = _swinging(damping, dt_s / tau_s)

        def later(x: FloatArray, rate: FloatArray) -> FloatArray:
            return np.asarray((cosine * x + sine * (rate + damping * x) - x) / dt_s)

        return later(ahead, free[0]), later(y, free[1])

    def unsettled(self, column: FloatArray, p: Parameters, dt_s: float) -> float:
        """As of one lag that takes as long."""
        damping = float(p["damping"])
        longer = 2.0 * max(damping, 1.0 / damping)
        return _moved(column, longer * float(p["tau_s"]) / dt_s)

    def remaining(self, since_s: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """What the oscillator leaves, or what it swings within."""
        damping = float(p["damping"])
        cosine, sine = _swinging(damping, since_s / max(float(p["tau_s"]), dt_s))
        swings = max(1.0 - damping**2, 0.0) ** 0.5
        return np.asarray(np.hypot(cosine + damping * sine, swings * sine))


class RateLimit(InputKind):
    """The input changes no faster than a limit."""

    name = "rate-limit"
    is_slow = True
    phrase = "a limit to how fast {port} changes"
    equation = "|u'| ≤ rate = 1/slowness"
    source = "Khalil, Nonlinear Systems, 2002"
    parameters = (
        Parameter("slowness", {"time": 1, "input": -1}, low=0.0, high=300.0,
                  starts=(1.0, 4.0, 15.0), step=0.02, prior=30.0, inverse="rate"),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Each sample as near as the limit lets it come."""
        return np.asarray(limited_rate(column, dt_s / max(float(p["slowness"]), 1e-12)))


class Hold(InputKind):
    """The input is renewed once a period only; a controller has that of whole samples."""

    name = "sample-and-hold"
    by_sample = True
    passes_laws = True
    phrase = "a hold that renews {port} only once a period"
    equation = "u(t) = command(period ⌊t/period⌋)"
    source = "Åström and Wittenmark, Computer-Controlled Systems, 1997"
    parameters = (
        Parameter("period_s", {"time": 1}, low=0.0, high=200.0, starts=(),
                  scanned=(2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 20, 30), step=1.0, prior=20.0,
                  finest_share=0.01),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """The newest of the renewed samples; between two whole periods a blend of both."""
        period = max(float(p["period_s"]) / dt_s, 1.0)
        at = np.arange(len(column))
        whole, part = int(period), period - int(period)
        held = column[(at // whole) * whole]
        return np.asarray((1.0 - part) * held + part * column[(at // (whole + 1)) * (whole + 1)])


class Quantisation(InputKind):
    """The input has steps."""

    name = "quantisation"
    phrase = "steps to which {port} is rounded"
    equation = "u = step · round(command/step)"
    source = "Widrow and Kollár, Quantization Noise, 2008"
    parameters = (
        Parameter(
            "step",
            _OF_INPUT,
            low=0.0,
            high=4.0,
            starts=(0.2, 0.5, 1.0),
            step=0.02,
            scanned=tuple(np.geomspace(0.1, 1.6, 20)),
            finest_share=0.02,
        ),
    )

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Rounded to whole steps."""
        step = float(p["step"])
        return column if step < 1e-12 else np.asarray(step * np.round(column / step))


class DeadBand(InputKind):
    """Small inputs do nothing, larger ones act less."""

    name = "dead-band"
    phrase = "a dead band in which small values of {port} do nothing"
    equation = "sign(u) max(|u| − half_width, 0)"
    source = "Khalil, Nonlinear Systems, 2002"
    needs = ("still",)
    parameters = (
        Parameter("half_width", _OF_INPUT, low=0.0, high=2.0, starts=(0.05, 0.3), prior=0.5),
    )

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """What exceeds the band."""
        return np.asarray(np.sign(column) * np.maximum(np.abs(column) - p["half_width"], 0.0))


class Backlash(InputKind):
    """The input has to take up a play when it turns."""

    name = "backlash"
    phrase = "play that {port} takes up whenever it turns"
    equation = "u follows its command at ± width/2"
    source = "Nordin and Gutman, Automatica 38, 2002"
    parameters = (Parameter("width", _OF_INPUT, low=0.0, high=4.0, starts=(0.05, 0.3), prior=0.5),)

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Pushed along by the edges of the play."""
        return np.asarray(slack(column, 0.5 * max(float(p["width"]), 0.0)))


class Saturation(InputKind):
    """Large inputs are cut."""

    name = "saturation"
    phrase = "a limit that cuts large values of {port}"
    equation = "max(min(u, limit), -limit)"
    source = "Khalil, Nonlinear Systems, 2002"
    parameters = (
        Parameter("limit", _OF_INPUT, origin="largest", low=-4.0, high=0.0, starts=(-0.1, -0.5),
                  prior=1.0),
    )  # fmt: skip

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Clipped on both sides."""
        limit = max(float(p["limit"]), 0.0)
        return np.clip(column, -limit, limit)


class Gain(InputKind):
    """The input acts more, or less, than it says."""

    name = "gain"
    is_gain = True
    phrase = "a gain by which {port} acts more, or less, than it says"
    equation = "(1 + error) u"
    source = _LJUNG
    parameters = (Parameter("error", {}, low=-1.0, high=3.0, starts=(0.1, -0.1), prior=0.5),)

    def inputs_answered(self, sizes: Mapping[str, float]) -> float:
        """What the gain is in all."""
        return 1.0 + sizes["error"]

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Scaled."""
        return np.asarray((1.0 + p["error"]) * column)


class Bias(InputKind):
    """The input is off by a constant."""

    name = "bias"
    is_constant = True
    phrase = "a constant offset of {port}"
    equation = "u + bias"
    source = _LJUNG
    parameters = (Parameter("bias", _OF_INPUT, starts=(0.1, -0.1), prior=1.0),)

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Moved."""
        return np.asarray(column + p["bias"])


class Drift(InputKind):
    """The input's gain changes with time, as with a battery."""

    name = "drift"
    phrase = "a gain of {port} that changes with time"
    equation = "(1 + rate t) u"
    source = _LJUNG
    parameters = (
        Parameter("rate", {"span": -1}, low=-1.0, high=3.0, starts=(0.1, -0.1), prior=0.5),
    )

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """Scaled by a line over time, 1 at the beginning of the log."""
        return np.asarray((1.0 + p["rate"] * dt_s * np.arange(len(column))) * column)


class Asymmetry(InputKind):
    """Inputs of one sign act more than those of the other."""

    name = "asymmetry"
    phrase = "a difference between positive and negative {port}"
    equation = "u + error |u|"
    source = "Nordin and Gutman, Automatica 38, 2002"
    needs = ("turning",)
    parameters = (Parameter("error", {}, low=-1.0, high=1.0, starts=(0.1, -0.1), prior=0.3),)

    def filtered(self, column: FloatArray, p: Parameters, dt_s: float) -> FloatArray:
        """The part that changes with the sign added."""
        return np.asarray(column + p["error"] * np.abs(column))


def shifted(column: FloatArray, samples: float) -> FloatArray:
    """A held column (n,), later by a number of samples: its mean over each sample, exactly."""
    whole = int(np.floor(samples))
    part = float(samples) - whole
    at = np.arange(len(column)) - whole
    newer = column[np.clip(at, 0, len(column) - 1)]
    return np.asarray((1.0 - part) * newer + part * column[np.clip(at - 1, 0, len(column) - 1)])


def lagged(column: FloatArray, samples: float) -> FloatArray:
    """The mean over each sample of a first-order response to a held column (n,)."""
    if samples < 1e-3:
        return column
    keep = float(np.exp(-1.0 / samples))
    share = samples * (1.0 - keep)  # of where a sample begins, in its mean
    ends, _ = lfilter([1.0 - keep], [1.0, -keep], column, zi=[keep * column[0]])
    begins = np.concatenate([column[:1], ends[:-1]])
    return np.asarray(column + share * (begins - column))


def _free(damping: float) -> FloatArray:
    """Rates of (y + tau y', y) of an oscillator that is let go, in times of tau."""
    return np.array([[1.0 - 2.0 * damping, 2.0 * damping - 2.0], [1.0, -1.0]])


def _swinging(damping: FloatArray | float, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """exp(−d a) cosh(r a) and exp(−d a) sinh(r a)/r with r² = d² − 1, at times `along` of tau.

    With them exp(A a) = cosine + sine (A + d), as A has the eigenvalues −d ± r.
    """
    root = np.sqrt(np.asarray(damping, dtype=complex) ** 2 - 1.0 + 1e-9)  # not 0 at damping 1
    ahead, behind = np.exp((root - damping) * along), np.exp((-root - damping) * along)
    return np.real(0.5 * (ahead + behind)), np.real(0.5 * (ahead - behind) / root)


def _moved(column: FloatArray, samples: float) -> float:
    """How far a column (n,) goes from where it begins, as an RMS that looks so far ahead.

    Of what is three time constants away a third counts still: the command may have turned just
    before the log began, and stood still for some time after.
    """
    if samples < 1e-3:
        return 0.0
    weight = np.exp(-np.arange(len(column)) / (_AHEAD * samples))
    return float(np.sqrt(np.average((column - column[0]) ** 2, weights=weight)))


KINDS = (
    DeadTime(), Lag(), SecondOrderLag(), RateLimit(), Hold(), Quantisation(), DeadBand(),
    Backlash(), Saturation(), Gain(), Bias(), Drift(), Asymmetry(),
)  # fmt: skip
