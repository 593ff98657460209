"""Results of plain least squares on the recordings that are hard to answer."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "silent-recordings.json"
Row = Mapping[str, Any]


def asked(records: Records) -> Section:
    """What a pendulum, two tanks and an actuator show without the workflow."""
    record = records.json(RECORD)
    return Section(
        "What hard recordings can tell",
        "Three recordings, asked by plain least squares that know nothing of the workflow: how "
        "much friction a pendulum has, how often a tank was full, and whether a valve does less in "
        "one direction.",
        paragraphs(
            "The pendulum's dry friction, from the weak form of its equation of motion:",
            table(
                ["window", "friction", "standard error"],
                [
                    [f"{row['window_s']:g} s", f"{row['friction_nm']:.2f} N m",
                     f"{row['error_nm']:.2f} N m"]
                    for row in record["pendulum"]
                ],
            ),
            _full(record["tanks"]),
            "The actuator's difference equation, judged on eighths of the recording that it was "
            "not fitted to; the *share* is what the valve does in one direction of what it does in "
            "the other, the one whose errors there are smallest:",
            table(
                ["samples", "share", "gain [nats]", "error one ahead", "error ten ahead"],
                [
                    line
                    for part, n in zip(
                        ("searched", "whole"), sorted(record["actuator"]["samples"]), strict=True
                    )
                    for line in _valve(record["actuator"][part], n)
                ],
            ),
        ),
        (f"python -m benchmarks.real_systems.silent --json docs/records/{RECORD}",),
    )  # fmt: skip


def _full(tanks: Row) -> str:
    spells = " and ".join(f"{a} to {b}" for a, b in tanks["spells"])
    return (
        f"When the lower tank was full, or its sensor at its end: samples {spells}. Of these times "
        f"the part that a search looks at holds {tanks['searched']}."
    )


def _valve(rows: Sequence[Row], samples: int) -> list[list[str]]:
    """The linear equation, and the best share."""
    plain = rows[-1]
    best = max(rows, key=lambda row: float(row["log_density"]))
    return [
        [
            str(samples),
            f"{row['share']:g}",
            f"{row['log_density'] - plain['log_density']:.0f}",
            f"{row['one_ahead']:.3f}",
            f"{row['ten_ahead']:.2f}",
        ]
        for row in (plain, best)
    ]
