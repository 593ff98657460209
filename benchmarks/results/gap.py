"""Results of the gap workflow on the gantry: its demo, hidden effects, promises."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.page import headline
from benchmarks.hidden_effects.table import summary
from benchmarks.results.section import Records, Section, paragraphs, percent, table, within

Row = Mapping[str, Any]


def demo(records: Records) -> Section:
    """The paper's missing effect, found and flown."""
    record = records.json("gap-demo.json")
    result, tracking = record["result"], record["demo"]["tracking"]
    rows = [
        [
            effect["name"],
            name,
            within(estimate["value"], estimate["low"], estimate["high"], 0, 1e3) + " ms",
        ]
        for effect in result["effects"]
        for name, estimate in effect["parameters"].items()
    ]
    ahead = result["gap"]["height 0.25 s ahead"]
    placebo, retrained = result["placebo"], record["retrain"]
    flown = tracking["feedforward"]
    before_and_after = [
        ["forecast error 0.25 s ahead, sealed flights", *_mm(ahead["before"], ahead["after"])],
        [f"the same with a placebo, {placebo['name']}", *_mm(placebo["before"], placebo["after"])],
        ["the same from noise alone", "", f"{1e3 * ahead['noise_floor']:.1f} mm"],
        [
            "predictor's error on the measured force",
            f"{retrained['old_rmse']:.3f} N",
            f"{retrained['new_rmse']:.3f} N",
        ],
        ["tracking error, PID alone", *_flown(tracking["pid"])],
        ["tracking error with the predictor", *_flown(flown)],
    ]
    text = (
        f"The verdict is *{result['verdict']}*. The whole demo took "
        f"{record['demo']['seconds']:.0f} s on two cores. Its seeds are fixed and its rig is "
        "otherwise calibrated exactly: the demo is a story, and the benchmark below is the proof."
    )
    return Section(
        "The gap demo",
        "A rig file says that motors follow at once; the virtual gantry's motors lag by 60 ms up "
        "and 100 ms down. The workflow sees flights with PID alone. Brackets: 90 % intervals.",
        paragraphs(
            "![Where simulation and flights disagree, the name, the values, and the errors before "
            "and after](../figures/gap-demo-story.png)",
            table(["named effect", "parameter", "value"], rows),
            table(["", "before", "after"], before_and_after),
            text,
        ),
        ("wakedeploy gap demo --out gap-demo", "python -m benchmarks.keep gap-demo gap-demo"),
    )


FORM_ERROR = "form-error.json"


def form_error(records: Records) -> Section:
    """What is answered about gantries whose form is not the model's."""
    record = records.json(FORM_ERROR)
    lines = [
        [
            percent(point["dose"], 0),
            f"{point['misfit_mn']:.0f} mN",
            *(_counted(point[key]) for key in ("false_alarms", "right", "useless", "too_small")),
            str(point["added_worse"]),
        ]
        for point in record["curve"]
    ]
    head = ["misfit", "largest", "something is missing, where nothing is", "right name or class"]
    head += ['useless "unknown"', "too small to matter: right", "made the forecast worse"]
    return Section(
        "Models whose form is not exact",
        "Gantries written from other equations: four families of jet profile, four of friction, "
        "and others of motor, sensor and noise. The misfit is what is left of the wake's steady "
        "force after the model has been calibrated within its spreads, of its root mean square. A "
        "hidden effect matters where it would improve the sealed forecasts if its name were known.",
        paragraphs(table(head, lines), _answers(record["rows"]), _earlier(record)),
        (
            "python -m benchmarks.form_error --out build/form-error --per-dose 20 --per-effect 4"
            " --record",
        ),
    )


FORM_LOSSES = "form-losses.json"
_TELLING = 0.1  # of an effect's evidence; less is not worth a line


def form_losses(records: Records) -> Section:
    """What the correction of the model's form costs each effect."""
    record = records.json(FORM_LOSSES)
    lost = [row for row in record["rows"] if row["lost"] >= _TELLING]
    lines = [[r["effect"], percent(r["lost"], 0), f"{r['gain_nats']:.0f}"] for r in lost]
    others = len(record["rows"]) - len(lost)
    return Section(
        "What the model's own form costs effects",
        "Every hypothesis has a smooth correction of wake and friction, which can look like an "
        f"effect. On {record['flights']} simulated flights of {record['seconds']:.0f} s, each "
        "effect at its plausible size. What loses much has to be stronger to be named: fly "
        "longer, or state a smaller `[discrepancy]` where the form is known to be better.",
        paragraphs(
            table(["effect", "of its evidence lost", "left [nats]"], lines),
            f"The other {others} effects lose less than {percent(_TELLING, 0)}.",
        ),
        ("python -m benchmarks.form_losses",),
    )


def _earlier(record: Row) -> str:
    """Which sets were not asked again, by commit."""
    commits = Counter(row["commit"] for row in record["rows"])
    earlier = [f"{n} are of `{c}`" for c, n in sorted(commits.items()) if c != record["commit"]]
    return f"Some sets were not asked again: {', '.join(earlier)}." if earlier else ""


def _counted(share: Row) -> str:
    return f"{share['count']} of {share['of']}" if share["of"] else "–"


def _answers(rows: Sequence[Row]) -> str:
    """The sets that were answered otherwise, each in its own words."""
    wrong = [row for row in rows if row["answer"] != "right"]
    parts = []
    for what, some in (
        ("nothing", [row for row in wrong if not row["hidden"]]),
        ("something", [row for row in wrong if row["hidden"]]),
    ):
        if some:
            parts += [f"Answered otherwise where {what} is hidden:", "", *map(_answer, some), ""]
    return "\n".join(parts).rstrip()


def _answer(row: Row) -> str:
    said = row["unknown"] or ", ".join(row["named"] or row["class"])
    return f"- {row['case']}: {row['verdict']}{f', {said}' if said else ''}"


def _mm(*metres: float) -> list[str]:
    return [f"{1e3 * value:.1f} mm" for value in metres]


def _flown(row: Row) -> list[str]:
    ends = (row["before"], row["after"])
    return [f"{within(end['rmse'], end['low'], end['high'], 1)} mm" for end in ends]


def hidden_effects(records: Records) -> Section:
    """The benchmark in short; the whole is a page of its own."""
    lines = records.lines("gap-benchmark.jsonl")
    return Section(
        "Hidden effects",
        f"{len(lines)} cases in two plants. The second plant imports nothing of the project. The "
        "judge knows what is hidden. Strength is the gain in log-likelihood on held-out flights, "
        "in nats. Brackets: Wilson's 95 % intervals.",
        paragraphs(
            headline(summary(lines)),
            "There are [the tables behind these](gap-benchmark.md).",
        ),
        (
            "python -m benchmarks.hidden_effects --workers 2 --out gap-benchmark",
            "python -m benchmarks.keep gap-benchmark gap-benchmark",
        ),
    )


def power(records: Records) -> Section:
    """What `gap power` promises and what came true."""
    result = records.json("gap-power.json")
    rows = [
        [
            _group(name),
            str(group["cases"]),
            *(percent(group[k]) for k in ("predicted_named", "named", "predicted_right", "right")),
        ]
        for name, group in result.items()
        if isinstance(group, dict)
    ]
    head = ["cases", "number", "promised: named", "named", "promised: right", "right"]
    return Section(
        "Promises of gap power",
        "What `gap power` promises for the cases of the benchmark, beside what came true. The bar "
        "is a difference of at most ten points.",
        table(head, rows),
        ("python -m benchmarks.gap_power gap-benchmark --json docs/records/gap-power.json",),
    )


def _group(name: str) -> str:
    return name.replace(" to inf nats", " nats and above").replace("promised ", "promise of ")
