"""Predicted against realised naming: what `gap power` expects of each case of the gap benchmark.

Reads `cases.jsonl` of a `python -m benchmarks.hidden_effects` run and flies each rig file's
flights without any effect. For all hidden single effects together, by the
strength that was judged in the flights, and by the share that was promised, the share that should
be named, the share that was, and the same for "right", a class with the effect included. Takes a
minute:

    python -m benchmarks.gap_power gap-benchmark --json docs/records/gap-power.json
"""

import argparse
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import records
from benchmarks.hidden_effects.cases import FLIGHT_S, FLIGHTS, Case, all_cases
from benchmarks.hidden_effects.lines import read_lines
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.separation import gather
from wakedeploy.gap.report.power_page import SURELY
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import plausible_size
from wakedeploy.gap.systems.gantry.planning.rates import Draws, fitted_share
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.gap.systems.gantry.search.threshold import thresholds_for
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY

FIRST_SEED = 930_000_000  # beyond those of all cases
STRENGTHS = (0.0, 15.0, 50.0, float("inf"))  # nats, judged
PROMISED = (0.0, 0.2, 0.8, SURELY, 1.001)


def main() -> None:
    """Compare, print, write."""
    options = _options()
    lines = {line["name"]: line for line in read_lines(options.folder) if "error" not in line}
    cases = [c for c in all_cases() if c.kind == "effect" and c.name in lines]
    rows: list[dict[str, Any]] = []
    for instant in (False, True):
        rows += compared([c for c in cases if c.instant is instant], lines)
    result = {"all": summary(rows)}
    for low, high in itertools.pairwise(STRENGTHS):
        result[f"{low:g} to {high:g} nats"] = summary(within(rows, "judged_nats", low, high))
    for low, high in itertools.pairwise(PROMISED):
        result[f"promised {low:g} to {min(high, 1.0):g}"] = summary(
            within(rows, "predicted_named", low, high)
        )
    result["cases"] = rows
    if options.json:
        records.write(options.json, result)
    print(json.dumps({k: v for k, v in result.items() if k != "cases"}, indent=1))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of a `python -m benchmarks.hidden_effects` run")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def compared(cases: Sequence[Case], lines: dict[str, Any]) -> list[dict[str, Any]]:
    """One row per case of one rig file."""
    if not cases:
        return []
    rig = cases[0].model_rig
    logs = [record(rig, seconds=FLIGHT_S, seed=FIRST_SEED + i) for i in range(FLIGHTS)]
    flights = [flight_from_log(log.without_truth(), rig, str(i)) for i, log in enumerate(logs)]
    model, base = fitted_base(GantryModel(rig, flights))
    evidence = gather(model, base, tuple(LIBRARY), {n: plausible_size(rig, n) for n in LIBRARY})
    draws = Draws.of(evidence, share=fitted_share(FLIGHTS))
    threshold = thresholds_for(rig).effect_nats
    rows = []
    for case in cases:
        (name,) = case.effects
        first = LIBRARY[name].parameters[0]
        neutral = first.neutral_on(constants_of(rig))
        amount = evidence.columns[evidence.of(name)[0]].amount
        factor = (case.effects[name][first.name] - neutral) / amount
        outcome = draws.outcomes(name, np.array([factor]), threshold)
        line = lines[case.name]
        rows.append(
            {
                "case": case.name,
                "plant": case.plant,
                "judged_nats": line["nats"],
                "predicted_named": float(outcome.named[0]),
                "predicted_right": float(outcome.in_class[0]),
                "named": line["verdict"] == "named" and line["named"] == [name],
                "right": bool(line["right"]),
            }
        )
    return rows


def within(
    rows: Sequence[dict[str, Any]], key: str, low: float, high: float
) -> list[dict[str, Any]]:
    """The rows in which a number is at least `low` and less than `high`."""
    return [row for row in rows if low <= row[key] < high]


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Means of a group, None of an empty one."""
    keys = ("predicted_named", "named", "predicted_right", "right")
    means = {k: float(np.mean([row[k] for row in rows])) if rows else None for k in keys}
    return {"cases": len(rows)} | means


if __name__ == "__main__":
    main()
