"""Results of flights: tracking, latency, endings, and the watch for a gap."""

from collections.abc import Mapping
from typing import Any

from benchmarks.results.section import (
    ARCHITECTURES,
    MEMORYLESS,
    Records,
    Section,
    paragraphs,
    span,
    table,
)
from wakedeploy.cli.demo import MINUTES
from wakedeploy.gap.wording import listed

Row = Mapping[str, Any]


def tracking(records: Records) -> Section:
    """What a predicted force is worth in flight, at both leads."""
    result = records.json("tracking.json")
    rows = result["rows"]
    leads = sorted({row["lead_s"] for row in rows if row["lead_s"] is not None})
    errors = {(row["name"], row["lead_s"]): row for row in rows}
    names = list(dict.fromkeys(row["name"] for row in rows))
    lines = [
        [
            _shown(name),
            *(_error(errors.get((name, lead), errors.get((name, None)))) for lead in leads),
        ]
        for name in names
    ]
    oracle_mm = errors["true force", leads[0]]["rmse_mm"]
    gains = {n: oracle_mm / errors[n, leads[-1]]["rmse_mm"] for n in ARCHITECTURES}
    better = sum(gains[name] > 1.0 for name in ARCHITECTURES if name != MEMORYLESS)
    text = (
        f"With the longer lead, {better} of {len(ARCHITECTURES) - 1} architectures with memory "
        f"track better than the true force at lead 0. {_best(gains)}"
    )
    head = ["feedforward", *(f"lead {1e3 * lead:.0f} ms [mm]" for lead in leads)]
    return Section(
        "Tracking with a predicted force",
        f"Altitude RMSE on the default virtual gantry, mean over {rows[0]['flights']} flights of "
        f"{result['seconds']:g} s ± two standard errors. No architecture was trained on these "
        "flights. The true force is the oracle.",
        paragraphs(table(head, lines), text, _parity(rows)),
        ("python -m benchmarks.tracking --json docs/records/tracking.json",),
    )


def _shown(name: str) -> str:
    return {MEMORYLESS: f"{MEMORYLESS} (no memory)"}.get(name, name)


def _error(row: Row | None) -> str:
    return "–" if row is None else f"{row['rmse_mm']:.1f} ± {row['half_width_mm']:.1f}"


def _best(gains: Mapping[str, float]) -> str:
    best = max(gains, key=lambda name: gains[name])
    return f"The best, {best}, is better by a factor of {gains[best]:.1f}."


def _parity(rows: list[Row]) -> str:
    """How far the exported graphs are from the training-time forward, where the rows state it."""
    stated = [(row["name"], row["parity"]) for row in rows if "parity" in row]
    if not stated:
        return ""
    name, worst = max(
        stated, key=lambda named_parity: named_parity[1]["max_rel"] / named_parity[1]["limit"]
    )
    share = 100.0 * worst["max_rel"] / worst["limit"]
    return (
        f"Parity: of the {len(stated)} packages, one of {name} comes nearest its limit. Its graph "
        f"differs from the training-time forward by {share:.0f} % "
        f"of that limit, over {worst['steps']:,} carried steps."
    )


def demo(records: Records) -> Section:
    """The main job end to end."""
    result = records.json("demo.json")
    lines = [
        [name, f"{error['mean']:.1f} ± {error['standard_error']:.1f}", str(error["flights"])]
        for name, error in result["rmse_mm"].items()
    ]
    gain = result["gain_mm"]
    minutes = result.get("minutes", MINUTES)  # unstated: as many as the demo takes by itself
    return Section(
        "The demo",
        "Altitude RMSE of the flights of `make demo` on the virtual gantry, mean ± standard error. "
        f"The GRU learned from {minutes:g} minutes of simulated flight.",
        paragraphs(
            "![Altitude, error and force of two of these flights](../figures/demo.png)",
            table(["controller", "error [mm]", "flights"], lines),
            f"Flight by flight the feedforward gains {gain['mean']:.1f} ± "
            f"{gain['standard_error']:.1f} mm.",
        ),
        (
            "wakedeploy demo --json demo/result.json",
            "python -m benchmarks.keep demo demo",
        ),
    )


def latency(records: Records) -> Section:
    """From measurement received to command written."""
    result = records.json("latency.json")
    alone, shared = result["busy, --realtime"], result["busy"]
    other = {row["arch"]: row for row in shared["rows"]}
    lines = [
        [
            row["arch"],
            *(f"{row[key]:.2f}" for key in ("p50_ms", "p99_ms", "p999_ms", "max_ms")),
            f"{row['cpu_percent']:.1f} %",
            f"{row['rss_mb']:.0f} MB",
            f"{other[row['arch']]['p999_ms']:.1f}",
        ]
        for row in alone["rows"]
    ]
    missed = [r["arch"] for r in shared["rows"] if r["p999_ms"] > alone["budget_ms"]]
    text = (
        f"The budget is {alone['budget_ms']:.2f} ms: the period less the round trip. With "
        f"`--realtime` the p99.9 is {span([r['p999_ms'] for r in alone['rows']], 2)} ms. Without "
        "it " + (f"{listed(missed)} missed the budget." if missed else "none missed the budget.")
    )
    head = ["architecture", "p50 [ms]", "p99", "p99.9", "max", "CPU of one core", "memory"]
    return Section(
        "Latency",
        "From measurement received to command written, over a pseudo-terminal, paced at 32 Hz with "
        f"every other core busy, {result['ticks']:,} ticks a row, `--realtime`. The last column is "
        "the p99.9 without `--realtime`. No Raspberry Pi has been measured yet.",
        paragraphs(table([*head, "p99.9 without"], lines), text),
        ("python -m benchmarks.latency --json docs/records/latency.json",),
    )


def endings(records: Records) -> Section:
    """False endings of healthy flights, and how soon a failure is noticed."""
    result = records.json("thrust-lost.json")
    lines = []
    for row in result["rows"]:
        delays = row.get("delay_in_the_air_p50_p90_max_s")
        delay_cells = [f"{delays[0]:.2f}", f"{delays[2]:.2f}"] if delays else ["–", "–"]
        lines.append([row["case"], str(row["flights"]), str(row["named"]), *delay_cells])
    blocked = next(row for row in result["rows"] if "unnoticed_off_m" in row)
    off_m = [abs(value) for value in blocked["unnoticed_off_m"]]
    unnoticed = (
        f"{len(off_m)} things in the beam were not noticed; they were {span(off_m, 2)} m from the "
        "sufferer."
        if off_m
        else "Everything in the beam ended its flight."
    )
    text = (
        f"{unnoticed} {blocked['seen_too_low']} made the sufferer seem too low, and one of these "
        f"let it rise by {blocked['risen_p50_max_m'][1]:.2f} m."
    )
    head = ["case", "flights", "ended by the supervisor", "noticed after [s], median", "longest"]
    return Section(
        "Flights that end early",
        f"Simulated flights of {result['seconds']:g} s whose constants are off as far as "
        "calibration leaves them: healthy flights, batteries that are pulled at a random moment, "
        "and things that come into the range sensor's beam. In a healthy flight every ending is a "
        "false one.",
        paragraphs(table(head, lines), text),
        ("python -m benchmarks.thrust_lost --json docs/records/thrust-lost.json",),
    )


def soak(records: Records) -> Section:
    """What grows, drifts, leaks or gets lost in many hours."""
    record = records.json("soak.json")
    longest, log = record["longest"], record["longest"]["log"]
    held = longest["growth"]
    lines = [
        ["rows lost, commands unanswered", f"{record['lost']}, {record['unanswered']}"],
        [
            "open descriptors, first and last",
            f"{held['descriptors'][0]}, {held['descriptors'][-1]}",
        ],
        [
            "memory, first and last",
            f"{held['resident_mb'][0]:.0f}, {held['resident_mb'][-1]:.0f} MB",
        ],
        ["memory's growth, second half", f"{longest['resident_mb_per_h']:.1f} MB/h"],
        ["log", f"{log['mb_per_h']:.1f} MB/h"],
        ["latest tick after its time on the grid", f"{log['latest_ms']:.2f} ms"],
        ["drift of the ticks, first tenth to last", f"{log['drift_us']:.1f} µs"],
        ["oldest pulse that a row tells of", f"{log['oldest_pulse_ms']:.0f} ms"],
    ]
    hours = longest["ticks"] / (32 * 3600)
    flights = len(record["ended"])
    return Section(
        "Many hours in one flight",
        f"{record['ticks']:,} ticks in {flights} {'flight' if flights == 1 else 'flights'}, "
        f"{'with a package' if record['arch'] else 'PID alone'}, in simulated time: the loop, the "
        f"wire, the board and the recorder are those of the rig. The longest took {hours:.1f} h.",
        paragraphs(
            table(["", "measured"], lines),
            "Kept until the flight ends are the log's index, which is written then, and the "
            "summary's numbers of each tick. How much of the growth is theirs was not measured.",
        ),
        (
            "wakedeploy data make gantry --minutes 6 --out sets/gantry",
            "wakedeploy train --data sets/gantry --arch gru --epochs 12",
            "wakedeploy export --arch gru",
            "python -m benchmarks.soak --package gru.onnx --json docs/records/soak.json",
        ),
    )


def watch(records: Records) -> Section:
    """What `run-gantry --watch-gap` notices."""
    result = records.json("watch.json")
    lines = [
        [
            row["effect"],
            str(row["flights"]),
            str(round(row["noticed"] * row["flights"])),
            "–" if row["median_s"] is None else f"{row['median_s']:.1f}",
        ]
        for row in result["rows"]
    ]
    head = ["what the rig file lacks", "flights", "warned", "after [s], median"]
    return Section(
        "The watch for a gap in flight",
        "How often and how soon `run-gantry --watch-gap` warns, in flights of "
        f"{result['seconds']:g} s with calibration errors of the size that the rig file states. "
        "The first row has no effect: each of its warnings is false.",
        paragraphs(
            table(head, lines), f"The watch takes {result['ms_per_tick']:.2f} ms of a core a tick."
        ),
        ("python -m benchmarks.watch --json docs/records/watch.json",),
    )
