"""How large each effect must be for its strength: pilots with the judge's own measure.

In: the list of effects. Out: `sizes.json`, committed; the benchmark's cases are made from it. A
pilot flies other seeds than any case. The gain grows about with the square of the size; the
exponent is measured between pilots.

    python -m wakedeploy.gap.benchmark.calibrate [NAME…]
"""

import json
import math
import sys
from pathlib import Path

from wakedeploy.files import write_text_whole
from wakedeploy.gap.benchmark.cases import FLIGHTS, SPOOLS, Case, values_at
from wakedeploy.gap.benchmark.measure import Measured
from wakedeploy.gap.benchmark.outside import OUTSIDE
from wakedeploy.gap.benchmark.worlds import flight
from wakedeploy.gap.flight import flight_from_log
from wakedeploy.physics.effects import LIBRARY

PATH = Path(__file__).with_name("sizes.json")
STRENGTHS = (5, 15, 50, 150)
_PILOT_SEED = 990_000
_PILOTS = 3
_CLOSE = 0.2  # a pilot this near to its aim, in the logarithm of nats, ends the search


def main() -> None:
    """Calibrate what the file lacks, or what is named; each result is kept at once."""
    known = json.loads(PATH.read_text()) if PATH.exists() else {}
    wanted = sys.argv[1:] or [*LIBRARY, *(f"{n}@instant" for n in SPOOLS), *OUTSIDE]
    for name in wanted:
        if name not in known or sys.argv[1:]:
            known[name] = calibrated(name)
            write_text_whole(PATH, json.dumps(known, indent=1, sort_keys=True) + "\n")
            print(name, known[name], flush=True)  # noqa: T201


def calibrated(name: str) -> dict[str, float]:
    """Sizes of one effect for every strength, and the pilots they come from."""
    pilots: list[tuple[float, float]] = []
    size = OUTSIDE[name].unit if name in OUTSIDE else 1.0
    for _ in range(_PILOTS):
        gain = max(_gain(name, size), 0.3)
        pilots.append((size, gain))
        if abs(math.log(gain / 30.0)) < _CLOSE:
            break
        size *= min(max((30.0 / gain) ** (1.0 / _exponent(pilots)), 0.15), 6.0)
    size, gain = min(pilots, key=lambda p: abs(math.log(p[1] / 30.0)))
    power = _exponent(pilots)
    return {str(n): float(f"{size * (n / gain) ** (1.0 / power):.4g}") for n in STRENGTHS}


def _exponent(pilots: list[tuple[float, float]]) -> float:
    """With which power of the size the gain grows, between the two newest pilots."""
    if len(pilots) < 2 or pilots[-1][0] == pilots[-2][0]:
        return 2.0
    (s0, g0), (s1, g1) = pilots[-2:]
    return min(max(math.log(g1 / g0) / math.log(s1 / s0), 1.0), 4.0)


def _gain(name: str, size: float) -> float:
    bare, _, instant = name.partition("@")
    label = Case("", "none", "first", 0, instant=bool(instant))
    effects = {} if bare in OUTSIDE else {bare: values_at(bare, size, label.model_rig)}
    outside = {bare: size} if bare in OUTSIDE else {}
    case = Case(name, "effect", "first", _PILOT_SEED, 0, effects, outside, bool(instant))
    rig = case.model_rig
    logs = [flight(case, i).without_truth() for i in range(FLIGHTS)]
    flights = [flight_from_log(log, rig, str(i)) for i, log in enumerate(logs)]
    gain = Measured(rig, flights).strength(effects, outside).nats
    print(f"  {name} at {size:.4g}: {gain:.1f} nats", flush=True)  # noqa: T201
    return gain


if __name__ == "__main__":
    main()
