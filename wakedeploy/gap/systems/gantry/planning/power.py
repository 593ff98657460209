"""What flights of a rig can and cannot tell, before any of them is flown.

In: a rig, the number of flights and their length. Out: for each effect of the library, the smallest
sizes that are detected and named, and the rivals that remain; also how many minutes of flight name
it, which sensor would, and what ignoring it costs in millimetres. Flights are simulated; then the
likelihood that `name` uses judges what is missing from them.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import Rig
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.separation import (
    Evidence,
    gain_nats,
    gather,
    loss_nats,
    lost_to_form,
)
from wakedeploy.gap.few_flights import in_words
from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES
from wakedeploy.gap.systems.gantry.flight import Flight, flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import plausible_size
from wakedeploy.gap.systems.gantry.planning.rates import (
    Draws,
    fitted_share,
    flights_needed,
    null_quantile,
    smallest_sizes,
)
from wakedeploy.gap.systems.gantry.planning.sensors import SENSORS, Sensor, with_sensor
from wakedeploy.gap.systems.gantry.planning.tracking import tracking_rmse_m, with_effect
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.physics.constants import spreads_of
from wakedeploy.physics.effects import LIBRARY

TRACKING_SEED = 8101
TRACKING_S = 20.0
_FLIGHT_SEED = 8000
_FACTOR_ONE = np.ones(1)
_CLEARLY = 0.1  # a sensor must name an effect this much more often to be worth its price

Advance = Callable[[], None]


@dataclass(frozen=True)
class EffectPower:
    """What the flights say about one effect; sizes are changes of its first parameter.

    `size` is one prior scale; the fields after it hold at that size.

    `named` and `detected` are shares of data sets. `rivals` would stay within the margin. `flights`
    and `minutes` are what naming takes; None if no number of flights does it. `calibrate_to` is the
    spread that the rig file would have to state, if only calibration helps. `sensor` is the
    cheapest that names it from these flights; None if there is none, or none is needed. `cost_mm`
    is what ignoring it adds to the tracking error; None if the flight ends in a failsafe.
    """

    name: str
    stage: str
    parameter: str
    unit: str
    size: float
    detectable: float | None
    nameable: float | None
    gain_nats: float
    detected: float
    named: float
    rivals: tuple[str, ...]
    flights: float | None
    minutes: float | None
    calibrate_to: float | None
    sensor: str | None
    cost_mm: float | None
    split_by: str
    lost_to_form: float

    @property
    def verdict(self) -> str:
        """In a word: named, class, or too small."""
        if self.named >= RULES.sure_share:
            return "named"
        return "class" if self.rivals else "too small"


@dataclass(frozen=True, eq=False)
class Power:
    """The whole answer. `loss_nats` (C, C); `named_with` (C, S + 1): share named, first as is."""

    rig_sha256: str
    flights: int
    seconds: float
    rest_s: float
    threshold_nats: float
    threshold_source: str
    tracking_mm: float
    effects: tuple[EffectPower, ...]
    loss_nats: FloatArray
    named_with: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """The effects' names."""
        return tuple(e.name for e in self.effects)

    @property
    def flight_s(self) -> float:
        """The length of one flight with its rests [s]."""
        return self.seconds + 2.0 * self.rest_s

    @property
    def purchase(self) -> tuple[Sensor, tuple[str, ...]] | None:
        """The sensor that names the most further effects (the cheapest of equals), and which."""
        without = self.named_with[:, 0] >= RULES.sure_share
        gained = [
            tuple(
                name
                for name, was, share, before in zip(
                    self.names,
                    without,
                    self.named_with[:, k + 1],
                    self.named_with[:, 0],
                    strict=True,
                )
                if not was and share >= max(RULES.sure_share, before + _CLEARLY)
            )
            for k in range(len(SENSORS))
        ]
        best = max(range(len(SENSORS)), key=lambda k: (len(gained[k]), -SENSORS[k].euros))
        return (SENSORS[best], gained[best]) if gained[best] else None

    @property
    def naming_rate(self) -> float:
        """The share of effects at one prior scale that will be named."""
        return float(np.mean([e.named for e in self.effects]))

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Effects that these flights would leave together, each group once."""
        groups = {tuple(sorted((e.name, *e.rivals))) for e in self.effects if e.rivals}
        return tuple(sorted(groups))

    def splitter(self, group: Sequence[str]) -> Sensor | None:
        """The cheapest sensor that surely names every effect of a class; None without one."""
        members = [self.names.index(name) for name in group]
        least = self.named_with[members].min(axis=0)[1:]
        able = [
            sensor
            for sensor, share in zip(SENSORS, least, strict=True)
            if share >= RULES.sure_share
        ]
        return min(able, key=lambda sensor: sensor.euros, default=None)

    def as_json(self) -> dict[str, Any]:
        """The content of power.json."""
        splitters = [self.splitter(group) for group in self.classes]
        return {
            "rig_sha256": self.rig_sha256,
            "flights": self.flights,
            "seconds": self.seconds,
            "threshold_nats": self.threshold_nats,
            "threshold_source": self.threshold_source,
            "margin_nats": RULES.margin_nats,
            "sure": RULES.sure_share,
            "naming_rate": self.naming_rate,
            "tracking_mm": self.tracking_mm,
            "classes": [list(group) for group in self.classes],
            "class_sensors": [None if sensor is None else sensor.name for sensor in splitters],
            "effects": [asdict(e) | {"verdict": e.verdict} for e in self.effects],
            "loss_nats": self.loss_nats.tolist(),
            "sensors": [asdict(sensor) for sensor in SENSORS],
            "named_with": self.named_with.tolist(),
        }


@dataclass(frozen=True, eq=False)
class Simulated:
    """Simulated flights of the unchanged rig, and what they say about the library's effects."""

    model: GantryModel
    base: Fit
    evidence: Evidence


def power(
    rig: Rig,
    *,
    flights: int,
    seconds: float,
    threshold_nats: float | None = None,
    names: Sequence[str] | None = None,
    workers: int = 2,
    progress: Callable[[str, int, int], None] | None = None,
) -> Power:
    """Simulate the flights and answer for every effect that the rig file does not have yet.

    `threshold_nats` is the simulated one of `name`; without it, the same quantile of Gaussian draws
    is taken. `progress(stage, done, total)` is called as things finish. Raises UnusableInput for
    fewer flights than a name takes, or for a rig that cannot fly them.
    """
    if flights < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{in_words(flights).capitalize()} cannot confirm an effect: plan at least "
            f"{FEWEST_IN_ALL}."
        )
    chosen = _chosen(rig, names)
    flown = _fly(workers, rig, flights, seconds, _telling(progress, "flying", flights))
    costs, plain_mm = _costs(workers, rig, chosen, _telling(progress, "tracking", len(chosen) + 1))
    simulated = _judged(rig, flown, chosen, _telling(progress, "judging", len(chosen)))
    threshold = null_quantile(simulated.evidence) if threshold_nats is None else threshold_nats
    named_with = _named_with_sensors(
        simulated, threshold, _telling(progress, "sensors", len(SENSORS) + 1)
    )
    evidence = _Told(rig, simulated, threshold, seconds + 2.0 * rig.disturbance.rest_s)
    advance = _telling(progress, "sizes", len(chosen))
    effects = []
    for i, name in enumerate(chosen):
        effects.append(evidence.effect(name, named_with[i], costs[name]))
        advance()
    return Power(
        rig_sha256=rig.sha256,
        flights=flights,
        seconds=seconds,
        rest_s=rig.disturbance.rest_s,
        threshold_nats=threshold,
        threshold_source="Gaussian draws" if threshold_nats is None else "simulated flights",
        tracking_mm=plain_mm,
        effects=tuple(effects),
        loss_nats=evidence.loss,
        named_with=named_with,
    )


def step_count(rig: Rig, flights: int) -> int:
    """The number of calls that `power` makes to `progress` for the whole library."""
    effects = len(_chosen(rig, None))
    return flights + effects + 1 + effects + len(SENSORS) + 1 + effects


class _Told:
    """Puts together what is known about each effect."""

    def __init__(self, rig: Rig, simulated: Simulated, threshold: float, flight_s: float) -> None:
        evidence = simulated.evidence
        self._rig, self._evidence = rig, evidence
        self._threshold, self._flight_s = threshold, flight_s
        self._draws = Draws.of(evidence, share=fitted_share(len(evidence.gram)))
        self.loss = loss_nats(evidence)
        self._gain = gain_nats(evidence)
        self._lost = lost_to_form(evidence, simulated.base.free)

    def effect(self, name: str, named_with: FloatArray, cost_mm: float | None) -> EffectPower:
        """Everything about one effect; `named_with` (S + 1,)."""
        i, effect = self._evidence.names.index(name), LIBRARY[name]
        column = self._evidence.columns[self._evidence.of(name)[0]]
        detectable, nameable = smallest_sizes(self._draws, name, self._threshold)
        outcome = self._draws.outcomes(name, _FACTOR_ONE, self._threshold)
        needed = flights_needed(self._evidence, name, self._threshold)
        near = [
            rival
            for j, rival in enumerate(self._evidence.names)
            if j != i and self.loss[i, j] < RULES.margin_nats
        ]
        is_seen = outcome.detected[0] >= RULES.sure_share
        return EffectPower(
            name=name,
            stage=effect.stage,
            parameter=effect.parameters[0].name,
            unit=effect.parameters[0].unit,
            size=column.amount,
            detectable=_finite(detectable * abs(column.amount)),
            nameable=_finite(nameable * abs(column.amount)),
            gain_nats=float(self._gain[i]),
            detected=float(outcome.detected[0]),
            named=float(outcome.named[0]),
            rivals=tuple(near) if is_seen else (),
            flights=_finite(np.ceil(needed)),
            minutes=_finite(np.ceil(needed) * self._flight_s / 60.0),
            calibrate_to=None if np.isfinite(needed) else self._calibration(name, nameable),
            sensor=_cheapest(named_with),
            cost_mm=cost_mm,
            split_by=effect.split_by,
            lost_to_form=float(self._lost[i]),
        )

    def _calibration(self, name: str, nameable: float) -> float | None:
        """The spread with which a calibrated constant's plausible change would be named.

        What flights cannot name for want of calibration grows with the spread that is stated.
        """
        constant = LIBRARY[name].parameters[0].constant
        spread = None if constant is None else spreads_of(self._rig).get(constant)
        if spread is None or not np.isfinite(nameable) or nameable <= 1.0:
            return None
        return spread / nameable


def _chosen(rig: Rig, names: Sequence[str] | None) -> tuple[str, ...]:
    present = {entry.name for entry in rig.effect}
    return tuple(name for name in (names or LIBRARY) if name not in present)


def _cheapest(named_with: FloatArray) -> str | None:
    """The cheapest sensor that names an effect which is not named without it."""
    if named_with[0] >= RULES.sure_share:
        return None
    enough = max(RULES.sure_share, named_with[0] + _CLEARLY)
    able = [s for s, share in zip(SENSORS, named_with[1:], strict=True) if share >= enough]
    return min(able, key=lambda s: s.euros).name if able else None


def _named_with_sensors(simulated: Simulated, threshold: float, advance: Advance) -> FloatArray:
    """Share of data sets in which each effect is named, without a sensor and with each, (C, S+1).

    A sensor counts only through what it splits and shows; the threshold stays the same.
    """
    evidence = simulated.evidence
    columns = []
    for sensor in (None, *SENSORS):
        seen = evidence
        if sensor is not None:
            seen = with_sensor(evidence, simulated.model, simulated.base, sensor)
        draws = Draws.of(seen, share=fitted_share(len(seen.gram)))
        columns.append([draws.outcomes(n, _FACTOR_ONE, threshold).named[0] for n in evidence.names])
        advance()
    return np.array(columns).T


def _judged(
    rig: Rig, flights: Sequence[Flight], names: Sequence[str], advance: Advance
) -> Simulated:
    model, base = fitted_base(GantryModel(rig, flights))
    sizes = {name: plausible_size(rig, name) for name in names}
    return Simulated(model, base, gather(model, base, names, sizes, advance))


def _fly(workers: int, rig: Rig, count: int, seconds: float, advance: Advance) -> list[Flight]:
    jobs = [(rig, seconds, _FLIGHT_SEED + i) for i in range(count)]
    return parallel_map(_one_flight, jobs, workers=workers, steps=lambda done, total: advance())


def _one_flight(job: tuple[Rig, float, int]) -> Flight:
    rig, seconds, seed = job
    return flight_from_log(
        record(rig, seconds=seconds, seed=seed), rig, f"a simulated flight of {seconds:g} s"
    )


def _costs(
    workers: int, rig: Rig, names: Sequence[str], advance: Advance
) -> tuple[dict[str, float | None], float]:
    """Millimetres of RMSE that each effect adds, and the RMSE without any."""
    jobs = [(rig, rig)]
    jobs += [(with_effect(rig, name, plausible_size(rig, name)), rig) for name in names]
    plain, *worse = parallel_map(
        _one_rmse_mm, jobs, workers=workers, steps=lambda done, total: advance()
    )
    costs = [w - plain if np.isfinite(w) else None for w in worse]
    return dict(zip(names, costs, strict=True)), plain


def _one_rmse_mm(job: tuple[Rig, Rig]) -> float:
    truth, rig = job
    return 1e3 * tracking_rmse_m(truth, rig, seconds=TRACKING_S, seed=TRACKING_SEED)


def _telling(progress: Callable[[str, int, int], None] | None, stage: str, total: int) -> Advance:
    """A callback without arguments that counts the steps of one stage."""
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(stage, done, total)

    return advance


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
