"""Results of the paper's comparisons on sets: errors, past, lead, step, delays."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.results.section import (
    ARCHITECTURES,
    MEMORYLESS,
    Records,
    Section,
    grouped,
    in_order,
    paragraphs,
    rms,
    span,
    table,
)
from wakedeploy.study.domains import MAIN

Row = Mapping[str, Any]
UNLEARNED = {"zero": "zero", "no-learning observer": "observer of the sufferer's motion"}
RECORDINGS = " --recordings PATH"


def commands(study: str, recordings: str = "") -> tuple[str, ...]:
    """How a study is made again and kept."""
    return (
        f"wakedeploy study {study}{recordings} --out study",
        f"python -m benchmarks.keep study study/{study}",
    )


def picture(study: str, shows: str) -> str:
    """A study's picture."""
    return f"![{shows}](../figures/study-{study}.png)"


def domains(records: Records) -> Section:
    """Eight architectures over six domains."""
    record, rows = records.json("study-domains.json"), records.rows("study-domains.csv")
    names = in_order(row["predictor"] for row in rows)
    errors = _errors(rows)
    columns = list(dict.fromkeys(row["domain"] for row in rows))
    lines = [
        [UNLEARNED.get(name, name), *(_two(errors.get((domain, name))) for domain in columns)]
        for name in names
    ]
    better = [
        str(sum(errors[domain, name] < errors[domain, MEMORYLESS] for name in ARCHITECTURES[1:]))
        for domain in columns
    ]
    lines.append(
        [f"*with memory and better than {MEMORYLESS}, of {len(ARCHITECTURES) - 1}*", *better]
    )
    r2 = [float(r["r2"]) for r in rows if r["predictor"] == "gru" and r["channel"] == "flag_tip_m"]
    text = (
        "The lines *source's past only* see no past of the "
        "sufferer's motion and cannot differentiate the force out of it. "
        "[Their own sentences](studies.md) have intervals and the paper's claims."
    )
    return Section(
        "Eight architectures over six domains",
        f"Test error over the standard deviation, mean over {record['seeds']} seeds: of the "
        "vertical force of quadrotors and Crazyflies, of all channels elsewhere; 1 is predicting "
        "the mean. The split keeps episodes apart that belong together. "
        f"The GRU's R² on the flag is {statistics.fmean(r2):.3f}.",
        paragraphs(
            picture("domains", "Error of each architecture in each domain"),
            table(["predictor", *columns], lines),
            text,
        ),
        commands("domains", RECORDINGS),
    )


def kinds(records: Records) -> Section:
    """Quadrotors by kind of flight."""
    rows = records.rows("study-domains-quadrotor-kinds.csv")
    rows = [row for row in rows if row["channel"] == "force_z_n"]
    columns = list(dict.fromkeys(row["kind"] for row in rows))
    groups = grouped(rows, "kind", "predictor")
    errors = {
        key: statistics.fmean(float(r["rmse"]) for r in group_rows)
        for key, group_rows in groups.items()
    }
    lines = [
        [UNLEARNED.get(name, name), *(_two(errors.get((kind, name))) for kind in columns)]
        for name in in_order(row["predictor"] for row in rows)
    ]
    head = [kind.partition("_")[2] or kind for kind in columns]  # "1_flybelow", as the files say
    return Section(
        "Quadrotors by kind of flight",
        "RMSE of the vertical force in N by kind of test flight, mean over seeds.",
        table(["predictor", *head], lines),
        commands("domains", RECORDINGS),
    )


def _errors(rows: Iterable[Row]) -> dict[tuple[str, str], float]:
    """By domain and predictor: RMSE over the standard deviation, mean over seeds."""
    main_rows = [row for row in rows if MAIN.get(row["domain"], row["channel"]) == row["channel"]]
    found: dict[tuple[str, str], list[float]] = {}
    for (domain, name, _), seed_rows in grouped(main_rows, "domain", "predictor", "seed").items():
        shares = [
            float(row["rmse"]) / float(row["sd"]) for row in seed_rows if float(row["sd"]) > 0.0
        ]
        found.setdefault((domain, name), []).append(rms(shares))
    return {key: statistics.fmean(errors) for key, errors in found.items()}


def _two(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def window(records: Records) -> Section:
    """How much of the past is enough."""
    records.json("study-window.json")
    rows = records.rows("study-window.csv")
    lines = []
    for domain, domain_rows in grouped(rows, "domain").items():
        by_model = grouped(domain_rows, "arch")
        memoryless = share_of(by_model[MEMORYLESS])
        for name in ("history-mlp", "gru"):
            found = enough(by_model[name])
            lines.append([domain, name, *found, f"{memoryless:.2f}"])
    return Section(
        "How much of the past is enough",
        "The shortest past with an error within 5 % of the model's least. History MLP is trained "
        "anew for each length. The GRU is trained once and its past is cut, which gives an upper "
        "bound. Errors are over the standard deviation.",
        paragraphs(
            picture("window", "Error by how much of the past is seen"),
            table(
                ["domain", "model", "enough [s]", "kept [bytes]", "error there", "without memory"],
                lines,
            ),
        ),
        commands("window", RECORDINGS),
    )


def share_of(rows: Sequence[Row]) -> float:
    """Mean error as a share of the standard deviation."""
    return statistics.fmean(float(row["rmse"]) / float(row["sd"]) for row in rows)


def enough(rows: Sequence[Row]) -> list[str]:
    """The shortest past within 5 % of the least error, what it takes to keep, and its error."""
    lengths = grouped(rows, "past_s")
    errors = {past: share_of(past_rows) for past, past_rows in lengths.items()}
    suffice = [past for past in errors if errors[past] <= 1.05 * min(errors.values())]
    enough = min(suffice, key=lambda past: float(past or math.inf))  # of a state, "" is all of it
    shown = f"{float(enough):.3g}" if enough else "all of it"
    return [shown, str(lengths[enough][0]["bytes"]), f"{errors[enough]:.2f}"]


def pareto(records: Records) -> Section:
    """Error against parameters and step time."""
    record, rows = records.json("study-pareto.json"), records.rows("study-pareto.csv")
    lines = []
    for domain, domain_rows in grouped(rows, "domain").items():
        models = [row for row in domain_rows if row["step_p99_ms"]]
        best = min(models, key=lambda row: float(row["error"]))
        lines.append(
            [
                domain,
                _front(models, "front_of_parameters"),
                _front(models, "front_of_step"),
                best["predictor"],
                f"{float(best['error']):.3f}",
                f"{int(best['trainable']):,}",
                f"{float(best['step_p99_ms']):.2f}",
            ]
        )
    steps = [float(row["step_p99_ms"]) for row in rows if row["step_p99_ms"]]
    text = (
        f"The p99 of a paced step is {span(steps, 2)} ms in the quietest round. Steps whose rounds "
        "overlap count as equal."
    )
    head = ["domain", "none beats: error and parameters", "none beats: error and step"]
    head += ["least error", "its error", "trainable", "step p99 [ms]"]
    return Section(
        "Error against parameters and step time",
        f"Every architecture in every domain; steps are paced at 32 Hz, {record['ticks']:,} ticks "
        f"in four rounds. Errors are over the standard deviation, {record['seeds']} seeds.",
        paragraphs(
            picture("pareto", "Error against trainable parameters and against a step's time"),
            table(head, lines),
            text,
        ),
        commands("pareto", RECORDINGS),
    )


def _front(rows: Sequence[Row], name: str) -> str:
    return ", ".join(row["predictor"] for row in rows if row[name] == "1")


def delay(records: Records) -> Section:
    """Where models look back to."""
    record = records.json("study-delay.json")
    rows = records.rows("study-delay-embedding.csv")
    looks = []
    for attention in record["attention"]:
        way = attention["transport"]
        peaks = attention["peaks_s"]
        looks.append(
            [
                attention["domain"],
                f"{way['mean_s']:.3f} [{way['low_s']:.3f}, {way['high_s']:.3f}]",
                f"{attention['source_lag_s']:.3f}",
                f"{attention['peak_s']:.3f} ({span(peaks, 3)})",
                f"{attention['mean_age_s']:.3f}",
            ]
        )
    slopes = []
    for domain, domain_rows in grouped(rows, "domain").items():
        trend = record["trends"][domain]
        best = [row for row in domain_rows if row["best_start"] == "1"]
        outside = statistics.fmean(float(row["outside_window"]) for row in best)
        slopes.append(
            [
                domain,
                *(f"{trend[key]['slope']:.2f}" for key in ("delay_s", "mean_age_s")),
                f"{_agreeing(domain_rows)} of {len(grouped(domain_rows, 'setting', 'seed'))}",
                f"{100 * outside:.0f} %",
            ]
        )
    return Section(
        "Where models look back to",
        "The age at which Cross-Attention weighs most, and the delay μ that Delay Embedding "
        "learns, against the wake's own transport delay. A slope of 1 follows the transport delay.",
        paragraphs(
            picture("delay", "What Cross-Attention weighs by age, and the delays that are learned"),
            table(
                [
                    "domain",
                    "transport delay [s]",
                    "source's lag [s]",
                    "attention peaks [s]",
                    "mean [s]",
                ],
                looks,
            ),
            table(
                [
                    "domain",
                    "slope of μ",
                    "slope of the kernels' mean age",
                    "both starts end within 0.05 s",
                    "μ outside the window",
                ],
                slopes,
            ),
        ),
        commands("delay"),
    )


def _agreeing(rows: Sequence[Row]) -> int:
    """In how many trainings all starts end at one delay."""
    ends = [
        [float(r["delay_s"]) for r in start_rows]
        for start_rows in grouped(rows, "setting", "seed").values()
    ]
    return sum(max(delays) - min(delays) <= 0.05 for delays in ends)


def basin(records: Records) -> Section:
    """Where Delay Embedding ends, by where it starts."""
    records.json("study-basin.json")
    rows = records.rows("study-basin.csv")
    lines = []
    for end, end_rows in sorted(grouped(rows, "ended_at").items(), key=lambda item: -len(item[1])):
        delays, r2 = ([float(row[key]) for row in end_rows] for key in ("delay_s", "r2"))
        lines.append([end, str(len(end_rows)), span(delays, 3), span(r2, 3)])
    return Section(
        "Where Delay Embedding ends, by where it starts",
        f"{len(rows)} trainings on the flag recordings, from {len(grouped(rows, 'start_s'))} "
        "starts. The alias is half a flapping period from the true delay. *At no clear cost* means "
        "that its R² is not clearly lower.",
        paragraphs(
            picture("basin", "Where Delay Embedding ends, by where it starts"),
            table(["ended at", "trainings", "delay μ [s]", "R²"], lines),
            picture("fish-scatter", "True and predicted displacement of the flag"),
        ),
        commands("basin", RECORDINGS),
    )
