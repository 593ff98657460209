"""FlareDW's force label against a plain jet: what the label lacks, and what the jet lacks.

In: flights of `wakedeploy.domains.quadrotor_files`. The baseline is a Gaussian jet whose
momentum is the source's thrust (Landau and Lifshitz, Fluid Mechanics, §36), pressing on the
sufferer; the measurement is the authors' label in three axes, which may be wrong itself. Every
flight is an episode, at 10 Hz: the label's own smoother spans 0.1 s.

Rotor speeds answer to the wake through the controller. Errors of the thrust that the label
subtracts are therefore only looked for where no wake is, beyond 2 m to the side.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.quadrotor_files import (
    MASS_KG,
    RATE_HZ,
    THRUST_FIT,
    THRUST_VALID_RADPS,
    Flight,
    attitude,
    read_flights,
    thrust_n,
    transport_term,
)
from wakedeploy.domains.quadrotor_label_audit import FAR_M, audit
from wakedeploy.gap.evidence.fits import FloatArray, Free
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.domains.domain import GapDomain
from wakedeploy.gap.systems.likelihood.response import ResponseModel, Values, required
from wakedeploy.gap.workflow import concluded

_STRIDE = 20
_MARGIN = 20  # samples at either end, where the label's smoother looks across the cut

EVERYWHERE = {
    "rotating-frame": (Free("rotating-frame.share", "1", 0.0, 1.0, -3.0, 3.0, 1e-2, (0.5,)),),
    "body-drag": (Free("body-drag.n_per_mps", "N s/m", 0.0, 1.0, -5.0, 5.0, 1e-2, (0.5,)),),
    "climb-drag": (Free("climb-drag.n_per_mps", "N s/m", 0.0, 1.0, -9.0, 9.0, 1e-2, (0.5,)),),
    "translational-lift": (
        Free("translational-lift.n_per_m2ps2", "N s²/m²", 0.0, 0.5, -5.0, 5.0, 1e-3, (0.2,)),
    ),
    "label-offset": (Free("label-offset.force_n", "N", 0.0, 1.0, -9.0, 9.0, 1e-2, (0.2,)),),
}
ROTORS = {
    "thrust-slope": (Free("thrust-slope.share", "1", 0.0, 0.2, -2.0, 2.0, 1e-3, (0.1,)),),
    "thrust-range": (
        Free("thrust-range.n_per_radps", "N s/rad", 0.0, 0.2, -2.0, 2.0, 1e-3, (0.05,)),
    ),
    "rotor-spread": (Free("rotor-spread.share", "1", 0.0, 1.0, -9.0, 9.0, 1e-2, (0.5,)),),
    "rotor-clock": (Free("rotor-clock.late_s", "s", 0.0, 0.05, -0.2, 0.3, 1e-3, (0.03, -0.03)),),
}
JET = {
    "transport-delay": (
        Free("transport-delay.delay_s", "s", 0.0, 0.2, -0.2, 0.8, 2e-3, (0.1, 0.3)),
    ),
    "jet-tilt": (Free("jet-tilt.share", "1", 0.0, 1.0, -5.0, 5.0, 1e-2, (0.5,)),),
}


@dataclass(frozen=True, eq=False)
class _Inputs:
    """What the response needs of a flight, at 200 Hz."""

    flight: Flight
    at: NDArray[np.int64]  # (n,) indices of the samples
    thrust: FloatArray
    source_thrust: FloatArray
    axis: FloatArray  # (·, 3) of the sufferer's thrust
    source_axis: FloatArray
    turning: FloatArray  # (·, 3) m ω × v
    rotors: FloatArray  # (·, 4) absolute speeds


class QuadrotorModel(ResponseModel):
    """The label's three axes [N]."""

    name = "quadrotor"
    channels = (("force x", "N"), ("force y", "N"), ("force z", "N"))
    noise_start = ((0.5, 0.2, 0.1), (0.5, 0.2, 0.1), (1.0, 0.2, 0.1))

    def __init__(self, flights: tuple[Flight, ...], *, beyond_m: float | None = None) -> None:
        self.effects = EVERYWHERE | (JET if beyond_m is None else ROTORS)
        self.flights = flights
        self._no_wake = beyond_m is not None
        inputs = [_inputs(f, beyond_m) for f in flights]
        self._inputs = [i for i in inputs if len(i.at) >= 10]
        self.records = [
            Record(i.flight.name, i.at / RATE_HZ, i.flight.label[i.at].T) for i in self._inputs
        ]

    def nuisances(self) -> tuple[Free, ...]:
        """The jet: the area it presses on, its width at the rotors, and how it spreads."""
        if self._no_wake:
            return ()
        return (
            Free("jet.area_m2", "m²", 0.25, 0.25, 0.0, 3.0, 1e-3),
            Free("jet.width_m", "m", 0.45, 0.2, 0.1, 2.0, 1e-3),
            Free("jet.spread", "1", 0.05, 0.1, -0.2, 0.6, 1e-3),
        )

    def response(self, values: Values, episode: int) -> FloatArray:
        """What the label would say (3, n) [N]: the jet's force, and errors of the label."""
        i = self._inputs[episode]
        states = i.flight.sufferer[i.at]
        force = np.zeros((len(i.at), 3))
        force[:, 2] = values.get("label-offset.force_n", 0.0)
        if not self._no_wake:
            force[:, 2] += self._jet(values, i)
        velocity = states[:, 3:6]
        force[:, :2] -= values.get("body-drag.n_per_mps", 0.0) * velocity[:, :2]
        force[:, 2] -= values.get("climb-drag.n_per_mps", 0.0) * velocity[:, 2]
        swept = (velocity[:, :2] ** 2).sum(1)
        force[:, 2] += values.get("translational-lift.n_per_m2ps2", 0.0) * swept
        force -= values.get("rotating-frame.share", 0.0) * i.turning[i.at]
        force += i.axis[i.at] * self._thrust_error(values, i)[:, None]
        return force.T

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Where the sufferer is and how it moves."""
        i = self._inputs[episode]
        s = i.flight.sufferer[i.at]
        return {
            "time": ("s", i.at / RATE_HZ),
            "horizontal distance": ("m", i.flight.distance_m[i.at]),
            "height above source": ("m", i.flight.offset_m[i.at, 2]),
            "speed y": ("m/s", s[:, 4]),
            "climb speed": ("m/s", s[:, 5]),
            "roll rate": ("rad/s", s[:, 12]),
            "rotor speed": ("rad/s", i.rotors[i.at].mean(1)),
            "source thrust": ("N", i.source_thrust[i.at]),
        }

    def _jet(self, values: Values, i: _Inputs) -> FloatArray:
        at = i.at - values.get("transport-delay.delay_s", 0.0) * RATE_HZ
        source = _between(np.hstack([i.flight.source[:, 0:3], i.source_axis]), at)
        offset = i.flight.sufferer[i.at, 0:3] - source[:, :3]
        depth = np.maximum(-offset[:, 2], 0.0)
        lean = values.get("jet-tilt.share", 0.0) * depth[:, None] * source[:, 3:5] / source[:, 5:6]
        aside2 = ((offset[:, :2] + lean) ** 2).sum(1)
        width2 = np.maximum(values["jet.width_m"] + values["jet.spread"] * depth, 0.05) ** 2
        pressure = _between(i.source_thrust, at) / (np.pi * width2) * np.exp(-aside2 / width2)
        return np.asarray(-values["jet.area_m2"] * pressure * (depth > 0.0))

    def _thrust_error(self, values: Values, i: _Inputs) -> FloatArray:
        """True thrust less the label's (n,)."""
        thrust = i.thrust[i.at]
        late_s = values.get("rotor-clock.late_s", 0.0)
        error = _between(i.thrust, i.at - late_s * RATE_HZ) - thrust
        error += values.get("thrust-slope.share", 0.0) * (thrust - MASS_KG * 9.81)
        rotors = i.rotors[i.at]
        error += values.get("rotor-spread.share", 0.0) * THRUST_FIT[0] * rotors.var(1)
        low, high = THRUST_VALID_RADPS
        mean = rotors.mean(1)
        outside = np.maximum(mean - high, 0.0) - np.maximum(low - mean, 0.0)
        return np.asarray(error + values.get("thrust-range.n_per_radps", 0.0) * outside)


def open_model(path: Path | None) -> QuadrotorModel:
    """The model over all flights below `path`."""
    return QuadrotorModel(read_flights(required(path, "quadrotor")))


def further(model: QuadrotorModel, progress: Progress) -> dict[str, Any]:
    """The label where no wake is: a plain audit, and the same four steps beyond 2 m."""
    progress("auditing the label")
    flights = model.flights

    def far_progress(stage: str, done: int = 0, total: int = 0, /) -> None:
        progress(f"far: {stage}", done, total)

    far = QuadrotorModel(flights, beyond_m=FAR_M)
    return {"label": audit(flights), "far": concluded(far, far_progress)}


def _inputs(flight: Flight, beyond_m: float | None) -> _Inputs:
    at = np.arange(_MARGIN, len(flight.label) - _MARGIN, _STRIDE, dtype=np.int64)
    if beyond_m is not None:
        at = at[flight.distance_m[at] > beyond_m]
    return _Inputs(
        flight=flight,
        at=at,
        thrust=thrust_n(flight.sufferer),
        source_thrust=thrust_n(flight.source),
        axis=attitude(flight.sufferer)[:, :, 2],
        source_axis=attitude(flight.source)[:, :, 2],
        turning=MASS_KG * transport_term(flight.sufferer),
        rotors=np.abs(flight.sufferer[:, 22:26]),
    )


def _between(series: FloatArray, at: NDArray[np.floating[Any]]) -> FloatArray:
    """A series at fractional indices, held at its ends."""
    at = np.clip(at, 0.0, len(series) - 1.0)
    low = np.minimum(at.astype(int), len(series) - 2)
    share = at - low
    if series.ndim > 1:
        share = share[:, None]
    return np.asarray(series[low] + share * (series[low + 1] - series[low]))


GAP_DOMAIN = GapDomain(open_model, further)
