"""How large each effect must be for its strength, measured in pilots.

In: the list of effects. Out: `sizes.json`, committed; the benchmark's cases are made from it. The
pilots fly other seeds than any case. What an effect of some size would change in the innovations of
flights without it, less what noise and calibration can explain, is the expected gain in nats: half
its square. Then it is flown at the size for 50 nats, and all its sizes are corrected by what that
gains. The judge measures what each case really has.

    python -m benchmarks.hidden_effects.calibrate [--refine]
"""

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.hidden_effects.cases import FLIGHTS, SPOOLS, Case, values_at
from benchmarks.hidden_effects.measure import Measured
from benchmarks.hidden_effects.outside import OUTSIDE
from benchmarks.hidden_effects.worlds import flight
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.processes import default_workers, pool
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.physics.constants import spreads_of
from wakedeploy.physics.effects import LIBRARY

FloatArray = npt.NDArray[np.float64]
PATH = Path(__file__).with_name("sizes.json")
STRENGTHS = (5, 15, 50, 150)
_PILOT_SEED = 990_000
_HALVINGS = 9
_CORRECTIONS = (0.4, 2.5)
_LINEAR_SD = 0.6
# A resting sufferer is not flying: what stiction changes is not linear in anything.
_BY_HAND = {
    "command-latency": {"5": 0.8, "15": 1.35, "50": 2.0, "150": 2.5},
    "esc-frame": {"5": 0.43, "15": 0.67, "50": 1.05, "150": 1.7},
    "pwm-dead-band": {"5": 0.95, "15": 1.3, "50": 2.0, "150": 3.5},
    "pwm-quantisation": {"5": 1.0, "15": 1.5, "50": 2.3, "150": 3.8},
    "range-drift": {"5": 2.0, "15": 3.5, "50": 6.4, "150": 11.0},
    "sample-and-hold": {"5": 0.45, "15": 0.55, "50": 0.68, "150": 0.69},
    "spool-lag-sufferer": {"5": 0.4, "15": 0.5, "50": 0.62, "150": 0.8},
    "wake-inflow-loss": {"5": 0.12, "15": 0.2, "50": 0.37, "150": 0.65},
    "stiction": {"5": 0.8, "15": 1.5, "50": 3.0, "150": 5.0},
}
_STEPPED = tuple(_BY_HAND)
# Effects on a calibrated constant: the base follows them until calibration forbids it, five
# standard deviations away, and then has nothing; sizes in calibration's standard deviations.
_OF_SPREAD = {"5": 3.0, "15": 4.5, "50": 5.3, "150": 6.0}
_CALIBRATED = (
    "thrust-coefficient",
    "thrust-exponent",
    "source-thrust-exponent",
    "range-bias",
    "transport-speed",
    "wake-strength",
    "wake-width",
    "wake-spreading",
)
_SMALLEST, _LARGEST = 0.01, 40.0  # in prior scales, or units of an outside effect


def main() -> None:
    """Calibrate every effect, or only correct the sizes by pilots that fly them; print both."""
    if "--refine" in sys.argv[1:]:
        refine()
        return
    known: dict[str, dict[str, float]] = {}
    for instant, names in ((False, [*LIBRARY, *OUTSIDE]), (True, list(SPOOLS))):
        pilot = Pilot(instant)
        for name in names:
            key = f"{name}@instant" if instant else name
            known[key] = {str(n): pilot.size(name, float(n)) for n in STRENGTHS}
            known[key] = _BY_HAND.get(name, known[key])
            if name in _CALIBRATED:
                known[key] = of_spread(name, pilot.rig)
            write_text_whole(PATH, json.dumps(known, indent=1, sort_keys=True) + "\n")
            print(key, known[key], flush=True)


def of_spread(name: str, rig: Rig) -> dict[str, float]:
    """Sizes of an effect on one calibrated constant, in its prior's scale."""
    (p,) = LIBRARY[name].parameters
    spread = spreads_of(rig)[p.constant or ""]
    return {n: float(f"{sd * spread / p.scale:.4g}") for n, sd in _OF_SPREAD.items()}


def refine() -> None:
    """Fly each effect at its size for 50 nats and correct its sizes for what that gains."""
    known: dict[str, dict[str, float]] = json.loads(PATH.read_text())
    with pool(default_workers()) as several:
        gains = several.map(flown_nats, known, [sizes["50"] for sizes in known.values()])
        for (key, sizes), gain in zip(list(known.items()), gains, strict=True):
            share = float(np.clip(np.sqrt(50.0 / max(gain, 1.0)), *_CORRECTIONS))
            known[key] = {n: float(f"{share * size:.4g}") for n, size in sizes.items()}
            write_text_whole(PATH, json.dumps(known, indent=1, sort_keys=True) + "\n")
            print(f"{key} at {sizes['50']}: {gain:.1f} nats, times {share:.2f}", flush=True)


def flown_nats(key: str, size: float) -> float:
    """What an effect of this size gains on flights of the first plant that have it."""
    name, _, instant = key.partition("@")
    rig = Case("", "none", "first", 0, instant=bool(instant)).model_rig
    effects = {} if name in OUTSIDE else {name: values_at(name, size, rig)}
    outside = {name: size} if name in OUTSIDE else {}
    case = Case(key, "effect", "first", _PILOT_SEED, 0, effects, outside, bool(instant))
    logs = [flight(case, i).without_truth() for i in range(FLIGHTS)]
    flights = [flight_from_log(log, rig, str(i)) for i, log in enumerate(logs)]
    return Measured(rig, flights).strength(effects, outside).nats


class Pilot:
    """Flights without any effect, and what effects would change in them."""

    def __init__(self, instant: bool) -> None:
        case = Case("pilot", "none", "first", _PILOT_SEED, instant=instant)
        self.rig: Rig = case.model_rig
        logs = [flight(case, i).without_truth() for i in range(FLIGHTS)]
        flights = [flight_from_log(log, self.rig, str(i)) for i, log in enumerate(logs)]
        self._measured = Measured(self.rig, flights)
        base = self._measured.base
        self._scores = base.slopes.scores
        parts = []
        for score, de in zip(self._scores, base.slopes.innovation, strict=True):
            parts.append(de * np.sqrt(score.weight / score.variance)[:, None])
        precision = np.array([0.0 if np.isinf(f.prior_sd) else f.prior_sd**-1 for f in base.free])
        self._explained, _ = np.linalg.qr(np.vstack([*parts, np.diag(precision)]))
        self._padding = np.zeros(len(precision))

    def size(self, name: str, nats: float) -> float:
        """The size at which an effect is expected to gain this much; four digits."""
        unit = OUTSIDE[name].unit if name in OUTSIDE else 1.0
        low, high = _SMALLEST * unit, _LARGEST * unit
        expected = self._expectation(name)
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(low * high))
            if expected(middle) < nats:
                low = middle
            else:
                high = middle
        return float(f"{np.sqrt(low * high):.4g}")

    def _expectation(self, name: str) -> Callable[[float], float]:
        known: dict[float, float] = {}

        def expected(size: float) -> float:
            if size not in known:
                known[size] = self._grown(name, size)
            return known[size]

        return expected

    def _values(self, name: str, size: float) -> dict[str, float]:
        return {"size": size} if name in OUTSIDE else values_at(name, size, self.rig)

    def _grown(self, name: str, size: float) -> float:
        """Nats at a size, for smooth effects from one that is small enough to be linear."""
        small = size
        nats, most = self.nats(name, self._values(name, small))
        while most > _LINEAR_SD and name not in _STEPPED:
            small *= 0.5
            nats, most = self.nats(name, self._values(name, small))
        return nats * (size / small) ** 2

    def nats(self, name: str, values: Mapping[str, float]) -> tuple[float, float]:
        """What an effect at these values is expected to gain on the pilot's flights.

        Also the largest change of an innovation, in standard deviations.
        """
        model, base = self._measured.model, self._measured.base
        free = model.free((name,))
        theta = extended(base, free)
        fitted = dict(zip(base.names, base.theta, strict=True))
        constant = {p.name: p.constant for p in model.effect(name).parameters}
        for i, parameter in enumerate(free):
            parameter_name = parameter.name.removeprefix(f"{name}.")
            if parameter_name in values:
                # From where calibration has put a constant, not from the rig's value.
                centre = fitted.get(constant[parameter_name] or "", parameter.neutral)
                theta[i] = centre + values[parameter_name] - parameter.neutral
        parts: list[FloatArray] = []
        for episode, before in enumerate(self._scores):
            after = model.score((name,), theta, episode)
            change = after.innovation - before.innovation
            parts.append(change * np.sqrt(before.weight / before.variance))
        change = np.concatenate([*parts, self._padding])
        rest = change - self._explained @ (self._explained.T @ change)
        return 0.5 * float(rest @ rest), float(np.abs(change).max())


if __name__ == "__main__":
    main()
