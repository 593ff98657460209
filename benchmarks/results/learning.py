"""Results of training: time and error, speed beside a plain loop, the flag, tuned shapes."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import (
    Records,
    Section,
    grouped,
    mean_and_sd,
    paragraphs,
    percent,
    span,
    table,
    within,
)
from benchmarks.tuned import ratio

Row = Mapping[str, Any]


def training(records: Records) -> Section:
    """Seconds and error of one training each."""
    rows = records.json("training.json")["rows"]
    lines = [
        [row["arch"], f"{row['trainable']:,}", f"{row['seconds']:.0f}", f"{_r2(row):.3f}"]
        for row in rows
    ]
    return Section(
        "Training on the gantry",
        "Each architecture trained once on 30 minutes of simulated flight, one thread, and scored "
        "on test flights: R² of the force at the rig's lead.",
        table(["architecture", "trainable parameters", "time [s]", "R²"], lines),
        (
            "wakedeploy data make gantry --out sets/gantry --minutes 30 --seed 0",
            "wakedeploy train --data sets/gantry --arch all --out runs --json training.json",
            "python -m benchmarks.keep table training.json training",
        ),
    )


def _r2(row: Row) -> float:
    (value,) = row["r2"].values()
    return float(value)


def flag(records: Records) -> Section:
    """The public recordings of a passive flag behind a foil."""
    rows = records.json("fish.json")["rows"]
    lines = [
        [arch, mean_and_sd([_r2(row) for row in arch_rows], 3)]
        for arch, arch_rows in grouped(rows, "arch").items()
    ]
    return Section(
        "Airfoil and flag",
        "R² of the flag's tip on the test block of the public recordings (passive flag, 30 Hz, "
        "window of 0.5 s, split in time), over 3 seeds. The paper reports 0.57 without memory and "
        "0.96 for its GRU.",
        table(["architecture", "R²"], lines),
        (
            "wakedeploy data import fish PATH --out sets/fish",
            "wakedeploy train --data sets/fish --arch all --seeds 3 --out runs --json fish.json",
            "python -m benchmarks.keep table fish.json fish",
        ),
    )


def speed(records: Records) -> Section:
    """Our training loop beside a plain one, on two machines."""
    fast, slow = (records.json(f"training-speed{end}.json") for end in ("", "-slower-core"))
    other = {row["arch"]: row for row in slow["rows"]}
    lines = [
        [
            row["arch"],
            f"{row['ours_per_s']['median']:,.0f}",
            f"{row['ratio']['median']:.1f}",
            f"{other[row['arch']]['ratio']['median']:.1f}",
            *(_mean(row["errors"].get(k)) for k in ("ours", "plain", "ours, twice as long")),
        ]
        for row in fast["rows"]
    ]
    head = ["architecture", "targets/s", "times the plain loop", "on a slower core"]
    head += ["our error", "the plain loop's", "ours after twice as many targets"]
    rates = [statistics.median(r["core_gflops"] for r in record["rows"]) for record in (fast, slow)]
    text = (
        f"Large matrix products run at {rates[0]:.0f} · 10⁹ operations a second on the first core "
        f"and at {rates[1]:.0f} · 10⁹ on the slower one. Both loops take the same number of "
        "targets, unless the column says otherwise. Errors are RMSE on validation over the "
        "standard deviation, mean over seeds. The second table says where an epoch spends its "
        "time and which share of the core's rate it reaches."
    )
    return Section(
        "Training speed",
        "Our training loop beside a plain PyTorch loop on one core, in alternating turns, on "
        f"{fast['minutes']:g} minutes of simulated flight for {fast['epochs']} epochs and "
        f"{fast['seeds']} seeds. The plain loop stores every window whole, shuffles with a "
        "DataLoader, and uses torch's own GRU and attention.",
        paragraphs(table(head, lines), text, _shares(fast["rows"], other)),
        (
            "python -m benchmarks.training --json docs/records/training-speed.json",
            "python -m benchmarks.training --json docs/records/training-speed-slower-core.json",
        ),
    )


def _mean(values: Sequence[float] | None) -> str:
    return f"{statistics.fmean(values):.3f}" if values else "–"


def _shares(rows: Sequence[Row], slower: Mapping[str, Row]) -> str:
    names = list(rows[0]["shares"])
    lines = [
        [
            row["arch"],
            *(percent(row["shares"][name]) for name in names),
            percent(row["ours_share_of_core"]),
            percent(slower[row["arch"]]["ours_share_of_core"]),
            f"{row['at_once']['per_s'] / row['ours_per_s']['median']:.1f}"
            if row.get("at_once")
            else "–",
        ]
        for row in rows
    ]
    head = ["architecture", *names, "of the core's rate", "of the slower core's"]
    return table([*head, "two at once, times one"], lines)


def tuned(records: Records) -> Section:
    """What hyper-parameter searches gain, in short; the whole is a page of its own."""
    rows = records.json("tuned.json")["rows"]
    shipped = [row for row in rows if row["ships"] == "tuned"]
    surely = [row for row in shipped if ratio(row)[2] < 1.0]
    worse = [row for row in shipped if ratio(row)[0] > 1.0]
    best = sorted(shipped, key=lambda row: ratio(row)[0])[:8]
    lines = [
        [
            row["arch"],
            row["domain"],
            _mean(row["reference"]["errors"]),
            _mean(row["tuned"]["errors"]),
            within(*ratio(row), 2),
        ]
        for row in best
    ]
    text = (
        f"The found shape ships for {len(shipped)} of {len(rows)} pairs, because it was better on "
        f"validation. On test, every tuned seed beats every reference seed in {len(surely)} of "
        f"them; the mean is worse in {len(worse)}. These {len(best)} gain most; "
        "there is [a table of all](tuned.md)."
    )
    trials = [sum(row["trials"].values()) for row in rows]
    head = ["architecture", "domain", "paper's shape", "tuned", "tuned / paper's shape"]
    return Section(
        "Tuned hyper-parameters",
        f"Test error of three seeds, over the standard deviation, after searches of "
        f"{span(trials, 0)} trials. Brackets: the least and the largest ratio of any two seeds.",
        paragraphs(text, table(head, lines)),
        ("python -m benchmarks.tuned sets work --jobs 2",),
    )
