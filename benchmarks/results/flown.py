"""Results of the paper's comparisons in flight: closed loop, shifted physics, leads."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.results.section import (
    ARCHITECTURES,
    Records,
    Section,
    grouped,
    in_order,
    paragraphs,
    percent,
    rms,
    table,
    within,
)
from benchmarks.results.studies import commands, picture
from wakedeploy.study.closed_loop import Tracked, memory, recovered

Row = Mapping[str, Any]


def closed_loop(records: Records) -> Section:
    """Tracking on the 2D downwash."""
    records.json("study-closed-loop.json")
    rows = records.rows("study-closed-loop.csv")
    flown = tracked(rows)
    lines = [
        [name, f"{1e3 * flown[name].mean_m:.1f}", _gain(flown, name)] for name in in_order(flown)
    ]
    text = (
        f"{_memory(flown)} The mean force is a constant. Its gain is large because the "
        "controller has no integral action and most of the wake is its mean."
    )
    return Section(
        "Tracking on the 2D downwash",
        f"RMS tracking error over {len(grouped(rows, 'flight'))} flights and all training seeds. "
        "The gain is the share of what the oracle, the true force, takes off the error. Brackets: "
        "90 % intervals over flights and seeds.",
        paragraphs(
            picture("closed-loop", "Tracking error with each predictor"),
            table(["feedforward", "error [mm]", "share of the oracle's gain"], lines),
            text,
        ),
        commands("closed-loop"),
    )


def tracked(rows: Sequence[Row]) -> dict[str, Tracked]:
    """Each line's errors (seeds, flights) [m]."""
    return {
        name: Tracked(
            name,
            np.array(
                [
                    [float(row["tracking_rms_m"]) for row in seed]
                    for seed in grouped(predictor_rows, "training seed").values()
                ]
            ),
        )
        for name, predictor_rows in grouped(rows, "predictor").items()
    }


def _gain(flown: Mapping[str, Tracked], name: str) -> str:
    """The share of the oracle's gain, with its interval."""
    gained = recovered(flown[name], flown["no compensation"], flown["oracle"])
    if name in ("no compensation", "oracle") or gained is None:
        return "–"
    if gained.low is None or gained.high is None:
        return percent(gained.share)
    return within(gained.share, gained.low, gained.high, 0, 100.0) + " %"


def _memory(flown: Mapping[str, Tracked]) -> str:
    """How many models with memory are clearly better than the one without."""
    found = memory([flown[name] for name in ARCHITECTURES])
    if found is None:
        return ""
    return (
        f"Of {found.of} models with memory, {found.better} track clearly better than the one "
        f"without and {found.worse} clearly worse."
    )


def shift(records: Records) -> Section:
    """Trained on one spread of physics, flown in others."""
    record, rows = records.json("study-shift.json"), records.rows("study-shift.csv")
    spreads = {
        _spread(s): tracked(spread_rows) for s, spread_rows in grouped(rows, "spread").items()
    }
    names = ["mean force", *ARCHITECTURES]
    lines = [[name, *(_gain(flown, name) for flown in spreads.values())] for name in names]
    verdicts = [f"- At {spread}: {_memory(flown)}" for spread, flown in spreads.items()]
    trained = record["trained"]["others"]
    return Section(
        "Trained on one physics, flown in another",
        f"The share of the oracle's gain in {record['flights']} flights of {record['seconds']:g} s "
        "on the 2D downwash, by how much wake speed, diffusivity and separation vary. All are "
        f"trained at ±{100 * trained:.0f} %; those of the column ±0 % without variation.",
        paragraphs(
            picture("shift", "Tracking in physics that vary more than those of training"),
            table(["feedforward", *spreads], lines),
            "\n".join(verdicts),
        ),
        commands("shift"),
    )


def _spread(text: str) -> str:
    return f"±{100 * float(text):.0f} %"


def lead(records: Records) -> Section:
    """How far ahead a wake can be known, and what that is worth."""
    record, rows = records.json("study-lead.json"), records.rows("study-lead.csv")
    parts = []
    for domain, domain_rows in grouped(rows, "domain").items():
        leads = sorted({row["lead_s"] for row in domain_rows if row["lead_s"]}, key=float)
        lines = []
        for name, mine in grouped(domain_rows, "predictor").items():
            errors = {
                at: 1e3 * rms([float(row["tracking_rms_m"]) for row in some])
                for at, some in grouped(mine, "lead_s").items()
            }
            lines.append([name, *(_cell(errors, at) for at in leads)])
        head = [f"{domain} [mm]", *(f"{1e3 * float(at):.0f} ms" for at in leads)]
        parts.append(table(head, lines))
    return Section(
        "How far ahead a force should be known",
        f"Tracking error in mm by lead, over {record['flights']} flights of {record['seconds']:g} "
        "s and all training seeds. On the gantry a command acts late; on the 2D downwash thrust "
        "follows at once.",
        paragraphs(
            picture("lead", "Force and tracking error by how far ahead the force is predicted"),
            *parts,
        ),
        commands("lead"),
    )


def _cell(errors: Mapping[str, float], at: str) -> str:
    value = errors.get(at, errors.get(""))
    return "–" if value is None else f"{value:.1f}"
