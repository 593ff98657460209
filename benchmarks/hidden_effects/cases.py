"""Which cases the benchmark has: frozen by a list and seeds, sizes from a committed file.

In: `sizes.json`, made once by `calibrate`. Out: `Case`s, each with its hidden truth.
"""

import functools
import importlib.resources
import itertools
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from benchmarks.hidden_effects.outside import OUTSIDE
from wakedeploy.core.rig import Rig
from wakedeploy.physics.constants import Constants, constants_of, spreads_of
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import default_rig

Plant = Literal["first", "second"]
Kind = Literal["effect", "pair", "none", "outside"]
PLANTS: tuple[Plant, Plant] = ("first", "second")
NATS = (15, 50)
FLIGHTS = 7
FLIGHT_S = 20.0
NO_EFFECT = 100
SPOOLS = ("spool-lag-sufferer", "spool-lag-source")
_AT_5_AND_150 = (
    "command-latency",
    "thrust-exponent",
    "battery-sag",
    "axial-inflow-loss",
    "transport-speed",
    "wake-width",
    "tether-spring",
    "added-mass",
    "range-scale",
    "crosswind-offset",
)
PAIRS = (
    ("spool-lag-sufferer", "wake-strength"),
    ("command-latency", "ground-effect"),
    ("thrust-exponent", "transport-speed"),
    ("battery-sag", "crosswind-offset"),
    ("axial-inflow-loss", "wake-width"),
    ("coulomb-friction", "range-scale"),
    ("viscous-friction", "wake-deflection"),
    ("tether-spring", "spool-lag-source"),
    ("added-mass", "wake-decay"),
    ("range-drift", "source-thrust-exponent"),
)
_SHORT = ("spool-lag-sufferer", "tether-spring", "crosswind-offset")
_SHAPES: Mapping[str, Mapping[str, float]] = {  # values beside the one that a size scales
    "ground-effect": {"height_m": 0.2},
    "recirculation": {"height_m": 0.2},
    "tether-spring": {"slack_m": 0.5},
}
# A wake stronger or wider by as much as counts holds the sufferer down on its stop.
_ONLY_LESS = ("wake-strength", "wake-width")
_INWARDS = 0.95  # of the way to a bound, at most


@dataclass(frozen=True)
class Case:
    """One case: what is hidden, in which plant, and from which seed everything else comes.

    `effects` are library effects with absolute values, `outside` others with sizes. `instant` means
    a rig file without spool lag, in truth, too, but for a hidden one.
    """

    name: str
    kind: Kind
    plant: Plant
    seed: int
    nats: int = 0
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    outside: Mapping[str, float] = field(default_factory=dict)
    instant: bool = False

    @property
    def model_rig(self) -> Rig:
        """The rig file that the workflow is given."""
        return _model_rig(self.instant)

    @property
    def truth_names(self) -> tuple[str, ...]:
        """The names of what is hidden."""
        return (*self.effects, *self.outside)

    def truth_constants(self) -> Constants:
        """The plant's constants: the rig file's, off by calibration; effects not yet applied.

        Delays are off by an absolute value: a negative delay is no delay.
        """
        rig = self.model_rig
        rng = np.random.default_rng([self.seed, 4242])
        claimed = {p.constant for name in self.effects for p in LIBRARY[name].parameters}
        constants = constants_of(rig)
        for name, spread in spreads_of(rig).items():
            off = spread * float(rng.standard_normal())
            if name in claimed:
                continue
            constants[name] += abs(off) if name.endswith("delay_s") else off
            if name.startswith(("rail.", "spool.", "wake.")):
                constants[name] = max(constants[name], 0.05 * constants_of(rig)[name])
        return constants


def values_at(name: str, size: float, rig: Rig, sign: int = 1) -> dict[str, float]:
    """A library effect's parameters at a size, in units of their prior scales from neutral.

    Effects that may go both ways go the way of `sign`. Sizes beyond a bound stop short of it.
    """
    base = constants_of(rig)
    values = {}
    for p in LIBRARY[name].parameters:
        neutral = p.neutral_on(base)
        if p.name in _SHAPES.get(name, {}):
            values[p.name] = _SHAPES[name][p.name]
            continue
        way = sign if neutral - p.low > 3.0 * p.scale else 1
        way = -1 if name in _ONLY_LESS else way
        bound = p.high if way > 0 else p.low
        values[p.name] = neutral + way * min(size * p.scale, _INWARDS * abs(bound - neutral))
    return values


@functools.cache
def sizes() -> dict[str, dict[str, float]]:
    """Size of each effect for each strength in nats, as it was calibrated."""
    text = importlib.resources.files(__package__).joinpath("sizes.json").read_text("utf-8")
    read: dict[str, dict[str, float]] = json.loads(text)
    return read


def hidden_effects() -> list[str]:
    """The library's effects that the benchmark hides: those whose sizes are calibrated."""
    return [name for name in LIBRARY if name in sizes()]


def all_cases(*, repeats: int = 1) -> list[Case]:
    """The full list; `repeats` multiplies seeds, and from 2 on the strengths, too.

    In an order as random as the seeds, so that what an interrupted run has done is a fair sample.
    """
    made: list[Case] = []
    for repeat in range(repeats):
        made += _effect_cases(repeat, NATS if repeats == 1 else (10, 15, 30, 50, 100))
        made += _pair_cases(repeat)
        made += _outside_cases(repeat)
        made += _no_effect_cases(repeat)
    return sorted(made, key=lambda case: (case.seed, case.name))


def short_cases() -> list[Case]:
    """A handful: an effect on each plant, an outside one, and none."""
    cases = all_cases()
    chosen = [
        c
        for c in cases
        if c.nats == 50 and c.kind == "effect" and c.name[:-2] in {f"{name}/50" for name in _SHORT}
    ][:4]
    for kind in ("outside", "none"):
        chosen += [c for c in cases if c.kind == kind][-2:]
    return chosen


def _effect_cases(repeat: int, strengths: tuple[int, ...]) -> list[Case]:
    cases = []
    for count, name in enumerate(hidden_effects()):
        levels_nats = (*strengths, 5, 150) if name in _AT_5_AND_150 else strengths
        for nats, half in itertools.product(levels_nats, (0, 1)):
            number = 2 * repeat + half
            if nats not in strengths and half == count % 2:
                continue
            instant = name in SPOOLS and half == 1
            rig = _model_rig(instant)
            size = size_of(name, nats, instant)
            values = values_at(name, size, rig, 1 if half == 0 else -1)
            plant = PLANTS[(count + half + nats // 50) % 2]
            label = f"{name}/{nats}/{number}"
            cases.append(
                Case(label, "effect", plant, _seed(label), nats, {name: values}, {}, instant)
            )
    return cases


def _pair_cases(repeat: int) -> list[Case]:
    cases = []
    for count, pair in enumerate(PAIRS):
        label = f"{'+'.join(pair)}/50/{repeat}"
        rig = _model_rig(False)
        values = {name: values_at(name, size_of(name, 50, False), rig) for name in pair}
        cases.append(Case(label, "pair", PLANTS[count % 2], _seed(label), 50, values))
    return cases


def _outside_cases(repeat: int) -> list[Case]:
    cases = []
    for count, (name, nats, half) in enumerate(itertools.product(OUTSIDE, NATS, (0, 1))):
        label = f"{name}/{nats}/{2 * repeat + half}"
        size = size_of(name, nats, False)
        plant = PLANTS[(half + count // 4) % 2]
        cases.append(Case(label, "outside", plant, _seed(label), nats, {}, {name: size}))
    return cases


def _no_effect_cases(repeat: int) -> list[Case]:
    labels = [f"none/0/{NO_EFFECT * repeat + i}" for i in range(NO_EFFECT)]
    return [Case(n, "none", PLANTS[i % 2], _seed(n)) for i, n in enumerate(labels)]


def size_of(name: str, nats: int, instant: bool) -> float:
    """The calibrated size, between calibrated strengths by the square root."""
    known = sizes()[f"{name}@instant" if instant else name]
    if str(nats) in known:
        return known[str(nats)]
    nearest = min(known, key=lambda n: abs(np.log(float(n) / nats)))
    return known[nearest] * float(np.sqrt(nats / float(nearest)))


@functools.cache
def _model_rig(instant: bool) -> Rig:
    return default_rig().without("spool") if instant else default_rig()


def _seed(label: str) -> int:
    return zlib.crc32(label.encode()) % 1_000_000
