"""The moments of a flight at which a fault begins, found in a healthy flight of the same seed."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.injected.fault import NONE
from benchmarks.injected.flight import REST_S, SECONDS, Case, Moment, flown_rows
from runtime.reference import TAKE_OFF_S

FIRST_SEED = 940_000_000
LIFTED_M, ABOVE_STOP_M = 0.005, 0.1
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Healthy:
    """Series of a healthy flight, each (T,): time [s], height [m], its aim [m], and so on."""

    t_s: FloatArray
    z_m: FloatArray
    z_ref_m: FloatArray
    vx_mps: FloatArray
    wake_n: FloatArray
    source_us: FloatArray
    seconds: float  # of its plan

    @property
    def lands_s(self) -> float:
        """When the landing begins [s]."""
        return REST_S + self.seconds - TAKE_OFF_S

    @property
    def vz_mps(self) -> FloatArray:
        """True vertical speed [m/s]."""
        return np.asarray(np.gradient(self.z_m, self.t_s))

    def at(self, score: FloatArray) -> float:
        """When, in the air and off take-off and landing, a score is highest [s]."""
        middle = (self.t_s > REST_S + TAKE_OFF_S + 0.2) & (self.t_s < self.lands_s - 0.2)
        return float(self.t_s[np.argmax(np.where(middle, score, -np.inf))])


def _hover(flight: Healthy, sign: float) -> float:
    moves = np.abs(np.gradient(flight.z_ref_m, flight.t_s)) > 0.01
    return flight.at(sign * flight.z_ref_m - 10.0 * moves)


def _leaving(flight: Healthy) -> float:
    return flight.at(-np.gradient(np.abs(flight.wake_n), flight.t_s))


def _just_above_the_stop(flight: Healthy) -> float:
    return float(flight.t_s[np.flatnonzero(flight.z_m > ABOVE_STOP_M)[-1]])


PHASES: dict[str, Callable[[Healthy], float]] = {
    "at rest": lambda flight: 0.5 * REST_S,
    "lifting off": lambda flight: float(flight.t_s[np.argmax(flight.z_m > LIFTED_M)]) + 0.15,
    "just after take-off": lambda flight: REST_S + TAKE_OFF_S,
    "hovering low": lambda flight: _hover(flight, -1.0),
    "hovering high": lambda flight: _hover(flight, 1.0),
    "climbing fastest": lambda flight: flight.at(flight.vz_mps),
    "descending fastest": lambda flight: flight.at(-flight.vz_mps),
    "deepest in the wake": lambda flight: flight.at(np.abs(flight.wake_n)),
    "leaving the wake": _leaving,
    "carriage at its fastest": lambda flight: flight.at(np.abs(flight.vx_mps)),
    "landing begins": lambda flight: flight.lands_s,
    "10 cm above the stop": _just_above_the_stop,
    "mid take-off": lambda flight: REST_S + 0.5 * TAKE_OFF_S,
    "source at its strongest": lambda flight: flight.at(flight.source_us),
    "after touch-down": lambda flight: flight.lands_s + TAKE_OFF_S + 0.3 * REST_S,
}


def moments(
    phases: Iterable[str] = PHASES, seconds: float = SECONDS, wake_factor: float = 1.0
) -> list[Moment]:
    """When these phases come, each in a flight of its own."""
    seeds = {name: FIRST_SEED + index for index, name in enumerate(PHASES)}
    return [
        Moment(
            name, seeds[name], PHASES[name](_healthy(seeds[name], seconds, wake_factor)), seconds
        )
        for name in phases
    ]


def _healthy(seed: int, seconds: float, wake_factor: float) -> Healthy:
    moment = Moment("", seed, 0.0, seconds)
    rows = flown_rows(Case(NONE.name, moment, wake_factor=wake_factor))

    def series(name: str) -> FloatArray:
        return np.array([float(row[name] or 0.0) for _, row in rows])

    return Healthy(
        t_s=np.array([t_s for t_s, _ in rows]),
        z_m=series("true_z_m"),
        z_ref_m=series("z_ref_m"),
        vx_mps=series("vx_mps"),
        wake_n=series("true_wake_force_n"),
        source_us=series("source_cmd_us"),
        seconds=seconds,
    )
