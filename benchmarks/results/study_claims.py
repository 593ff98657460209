"""What the studies say of their figures: the paper's claims, and intervals that no table has."""

import re
from collections.abc import Sequence
from typing import Any

from benchmarks.results.flown import tracked
from benchmarks.results.section import Records, grouped, paragraphs, table
from benchmarks.results.studies import enough, share_of
from wakedeploy.study.closed_loop import memory
from wakedeploy.study.delay import ALIKE_S
from wakedeploy.study.delay_figure import PAPER_DOMAIN, PAPER_SHIFT_S
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.shift import FLOWN, Shifted, agreement

Says = dict[str, str]  # a study's sentences, by figure
_SENTENCES = re.compile(r"(?<=\.)\s+")
_CLAUSES = re.compile(r";\s+(?![^(\[]*[)\]])")  # a parenthesis stays whole
_AGAINST = re.compile(r", against (.*?) without memory")
_NAME = re.compile(r"[a-z]+(-[a-z]+)*('s)? (errs|is|tracks|has|comes|needs|gains|loses)\b")

IN_THE_PICTURE = "Up to a lead"  # the force error by lead, of every model


def page(records: Records) -> str:
    """Each study's claims and intervals."""
    parts = [
        _delay(records),
        _by_domain(_says(records, "domains"), "Domains", "domains"),
        _by_domain(_says(records, "lead"), "Lead", "lead"),
        _by_domain(_says(records, "pareto"), "Pareto", "pareto"),
        _shift(records),
        _window(records),
    ]
    return paragraphs(
        "# What the studies say",
        "`wakedeploy study` writes sentences for its figures, from the numbers: with intervals, "
        "and with what the paper claims and whether that comes out. This page has them as lists. "
        "[The paper's comparisons](comparisons.md) have the figures and the tables of the same "
        "studies.",
        *parts,
    )


def _says(records: Records, study: str) -> Says:
    says: Says = records.json(f"study-{study}.json")["says"]
    return says


def _listed(*sentences: str) -> str:
    """Each statement on a line of its own; an architecture's name stays as it is written."""
    said = [clause.rstrip(".") for text in sentences for clause in _CLAUSES.split(text)]
    lines = [text if _NAME.match(text) else text[:1].upper() + text[1:] for text in said]
    return "\n".join(f"- {line}." for line in lines)


def _by_domain(says: Says, title: str, study: str) -> str:
    """A study's first sentence and its reservation, then each domain's statements."""
    first, *others = _SENTENCES.split(says[study])
    head = [re.sub(r" \([^)]*\)", "", first)]  # the numbers are in the domains' statements
    head += [sentence for sentence in others if sentence.startswith("Only ")]
    parts = []
    for name, text in says.items():
        if re.fullmatch(rf"{study}-[a-z]+", name) and text.startswith("On "):
            text = _AGAINST.sub(r"; without memory it has \1", text)
            sentences = [s for s in _SENTENCES.split(text) if not s.startswith(IN_THE_PICTURE)]
            parts += [f"### {title} on {name.removeprefix(f'{study}-')}", _listed(*sentences)]
    return paragraphs(f"## {title}", _listed(*head), *parts)


def _delay(records: Records) -> str:
    """Where attention looks and what delays are learned, where the paper has a figure of it."""
    record = records.json("study-delay.json")
    attention = [
        sentence.replace(": here", "; here").replace(", and the present", "; the present")
        for sentence in _SENTENCES.split(record["says"]["delay"])
        if sentence.startswith("In the paper")
    ]
    return paragraphs(
        "## Delay",
        _listed(*attention),
        f"In the paper the learned delay μ is {PAPER_SHIFT_S:g} s longer than the transport delay "
        f"at every separation, wherever training begins. Here two starts each were trained on "
        f"{PAPER_DOMAIN}; the better one on validation counts, mean over {record['seeds']} seeds. "
        f"Ends that are no farther apart than {ALIKE_S:g} s count as one.",
        table(
            ["separation", "transport delay [s]", "μ is longer by [s]", "both starts end at one μ"],
            (_separation(name, rows) for name, rows in _separations(record).items()),
        ),
    )


def _separations(record: dict[str, Any]) -> dict[str, Sequence[dict[str, Any]]]:
    rows = [row for row in record["delays"] if row["domain"] == PAPER_DOMAIN]
    return dict(grouped(rows, "setting"))


def _separation(name: str, rows: Sequence[dict[str, Any]]) -> list[str]:
    runs = list(grouped(rows, "seed").values())
    better = [min(starts, key=lambda row: float(row["validation"])) for starts in runs]
    longer = [row["delay_s"] - row["transport"]["mean_s"] for row in better]
    ends = [[row["delay_s"] for row in starts] for starts in runs]
    alike = sum(max(delays) - min(delays) <= ALIKE_S for delays in ends)
    return [
        name,
        f"{better[0]['transport']['mean_s']:.3f}",
        f"{sum(longer) / len(longer):+.2f}".replace("-", "−"),
        f"{alike} of {len(runs)}",
    ]


def _shift(records: Records) -> str:
    """Whether the order of the models stays where the physics varies more, and memory helps."""
    record, rows = records.json("study-shift.json"), records.rows("study-shift.csv")
    spreads = {
        float(spread): Shifted(float(spread), tuple(tracked(spread_rows).values()))
        for spread, spread_rows in grouped(rows, "spread").items()
    }
    trained = spreads[record["trained"]["others"]]
    stays = {True: "stays", False: "changes", None: "not clear"}
    lines = []
    for spread in FLOWN:
        found, helps = agreement(trained, spreads[spread]), memory(spreads[spread].models)
        assert helps is not None
        order = [stays[found.kept], found.text, f"{found.turned} of {found.apart}"]
        lines.append(
            [
                f"±{100 * spread:.0f} %",
                *(order if spread != trained.spread else ["–"] * len(order)),
                f"{helps.better} of {helps.of}",
                f"{helps.worse} of {helps.of}",
            ]
        )
    return paragraphs(
        "## Shift",
        "In the paper the order of the models stays, and memory helps in flight at every spread. "
        f"Here all models were trained at ±{100 * trained.spread:.0f} %. Kendall's τ is 1 where "
        "the order is the same, with its 90 % interval. Pairs of models count where the flights "
        "separate them at both spreads.",
        table(
            [
                "flown at",
                "the order",
                "Kendall's τ",
                "pairs that change places",
                f"with memory clearly better than {MEMORYLESS}",
                "clearly worse",
            ],
            lines,
        ),
    )


def _window(records: Records) -> str:
    """How much of the past each model needs, those that see only the source's past among them."""
    says = _says(records, "window")["window"]
    shortest = says.partition("err least: ")[2].partition(". Error against")[0]
    lines = []
    for domain, domain_rows in grouped(records.rows("study-window.csv"), "domain").items():
        by_model = grouped(domain_rows, "arch")
        memoryless = f"{share_of(by_model[MEMORYLESS]):.2f}"
        lines += [
            [domain, name, *enough(rows), memoryless]
            for name, rows in by_model.items()
            if len(grouped(rows, "past_s")) > 1
        ]
    return paragraphs(
        "## Window",
        "The past that suffices for an error within 5 % of the least:",
        _listed(shortest),
        "A GRU's past is cut after a training that never scored so young a state. So its line is "
        "at most what it needs. History MLP is trained for each length. Errors are over the "
        "standard deviation.",
        table(
            ["domain", "model", "enough [s]", "kept [bytes]", "error there", "without memory"],
            lines,
        ),
    )
