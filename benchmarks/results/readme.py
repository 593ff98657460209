"""What README.md takes from the records: the end of the demo, and the table of results."""

import contextlib
import io
import statistics
from collections.abc import Callable

from benchmarks.hidden_effects.table import summary
from benchmarks.results.section import ARCHITECTURES, MEMORYLESS, Records, percent, span, table
from wakedeploy.cli.demo import tell

_LARGEST_MISFIT = 0.04  # of a model's form, up to which the aims are


def filled(text: str, records: Records) -> str:
    """The README with what the present records give; ValueError where a mark is missing."""
    for name, made in PARTS.items():
        begins, ends = f"<!-- {name}: made by `make results` -->\n", f"\n<!-- end of {name} -->"
        before, begun, rest = text.partition(begins)
        _, ended, after = rest.partition(ends.strip("\n"))
        if not (begun and ended):
            raise ValueError(f"README.md: the marks around the {name} are missing")
        text = before + begins + made(records) + ends + after
    return text


def demo(records: Records) -> str:
    """The end of what `make demo` prints, but for how long it took on the record's busy machine."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        tell(records.json("demo.json"))
    shown = printed.getvalue().partition("Picture: ")[0].strip()
    return f"```text\n{shown}\n```"


def results(records: Records) -> str:
    """One line for each thing that a reader asks first."""
    rows = [*_tracking(records), _latency(records), *_learning(records), *_gap(records)]
    return table(["what", "measured", "aim or bound"], rows)


def _tracking(records: Records) -> list[list[str]]:
    rows = records.json("tracking.json")["rows"]
    ahead_s = max(row["lead_s"] for row in rows if row["lead_s"] is not None)
    error = {(row["name"], row["lead_s"]): f"{row['rmse_mm']:.1f} mm" for row in rows}
    ahead = f"force {1e3 * ahead_s:.0f} ms ahead"
    return [
        ["altitude error in flight, PID alone", error["PID alone", None], ""],
        [f"the same, {ahead} without memory", error[MEMORYLESS, ahead_s], ""],
        [
            f"the same, {ahead} by a GRU",
            error["gru", ahead_s],
            f"{error['true force', ahead_s]} with the true force",
        ],
    ]


def _latency(records: Records) -> list[str]:
    record = records.json("latency.json")["busy, --realtime"]
    p999 = [row["p999_ms"] for row in record["rows"]]
    what = "from measurement to command, 999 ticks of 1,000, two busy cores"
    return [what, f"{span(p999, 1)} ms", f"{record['budget_ms']:.2f} ms"]


def _learning(records: Records) -> list[list[str]]:
    trained = {row["arch"]: row for row in records.json("training.json")["rows"]}
    largest = max(trained[arch]["trainable"] for arch in ARCHITECTURES)
    flag = [
        row["r2"]["flag_tip_m"] for row in records.json("fish.json")["rows"] if row["arch"] == "gru"
    ]
    return [
        ["training a GRU on half an hour of flight", f"{trained['gru']['seconds']:.0f} s", ""],
        ["trainable parameters, the largest of the eight", f"{largest:,}", "100,000"],
        [
            "R² of a GRU on the airfoil-and-flag recordings",
            f"{statistics.fmean(flag):.3f}",
            "paper 0.96",
        ],
    ]


def _gap(records: Records) -> list[list[str]]:
    totals = summary(records.lines("gap-benchmark.jsonl"))
    names = {
        "right_from_50_nats": (
            "simulated gantry, an effect hidden that the flights show clearly: named",
            "≥ 95 %",
        ),
        "false_alarms": ("the same, nothing hidden: something named or suspected", "≤ 5 %"),
    }
    rows = [
        [what, f"{totals[key]['count']} of {totals[key]['of']}", bar]
        for key, (what, bar) in names.items()
    ]
    return [*rows, *_other_forms(records), *_real_systems(records)]


def _other_forms(records: Records) -> list[list[str]]:
    rows = [r for r in records.json("form-error.json")["rows"] if r["dose"] <= _LARGEST_MISFIT]
    hidden = [r["answer"] for r in rows if r["matters"]]
    plain = [r["answer"] for r in rows if not r["hidden"]]
    what = f"gantries whose wake differs from the model's by up to {percent(_LARGEST_MISFIT)}"
    right = f"{hidden.count('right')} of {len(hidden)}"
    alarms = f"{len(plain) - plain.count('right')} of {len(plain)}"
    return [
        [f"{what}, an effect that matters hidden: its name or class", right, "≥ 85 %"],
        ["the same, nothing hidden: something named or suspected", alarms, "≤ 5 %"],
    ]


def _real_systems(records: Records) -> list[list[str]]:
    rows = records.json("real-systems.json")["rows"]
    left_out = [row["left_out"] for row in rows]
    left_in = [row["left_in"] for row in rows if row.get("left_in")]
    named = sum(answer in ("right", "class") for answer in left_out)
    settled = sum(answer in ("right", "next") for answer in left_in)
    return [
        [
            "robots and plants that others recorded, a known effect left out: its name or class",
            f"{named} of {len(left_out)}, {left_out.count('wrong')} wrong",
            "≥ 90 %",
        ],
        [
            "the same, the effect built in: nothing named, or what else is known",
            f"{settled} of {len(left_in)}, {left_in.count('wrong')} wrong",
            "",
        ],
    ]


PARTS: dict[str, Callable[[Records], str]] = {"demo": demo, "results": results}
