"""Results of the gap workflow on systems that others built and recorded."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "real-systems.json"
Row = Mapping[str, Any]
_JUDGED = ("right", "partly", "class", "wrong", "nothing", "refused")


def named(records: Records) -> Section:
    """What was named on each recording, how large it is, and what it changes."""
    rows: Sequence[Row] = records.json(RECORD)["rows"]
    head = ["recording", "expected", "named", "size", "judged", "built in", "halves", "seconds"]
    return Section(
        "Systems that others built and recorded",
        f"The gap workflow on {len(rows)} public recordings, each with a textbook system that "
        "lacks what the literature names.",
        paragraphs(
            _counts(rows),
            table(head, [_line(row) for row in rows]),
            _BUILT_IN,
            *_asked_in_halves(rows),
            "Where nothing right was named, the effect that gains most alone, with its interval:",
            table(
                ["recording", "chance brings up to", "gain", "why it is not named"],
                [_leader(row) for row in rows if row["left_out"] in ("nothing", "wrong")],
            ),
            "Root mean square of measured less forecast on sealed blocks:",
            table(
                ["recording", "output", "forecast over", "as stated", "constants fitted",
                 "with what was named"],
                [line for row in rows for line in _errors(row)],
            ),
        ),
        ("python -m benchmarks.real_systems --json docs/records/real-systems.json",),
    )  # fmt: skip


_BUILT_IN = (
    "*Judged*: right, where an expected effect is named and nothing that the literature does not "
    "know there; partly, where something else is named beside it; class, where what is known is "
    "among rivals. "
    "*Built in*: the answer once the textbook system has the effect; right is that nothing "
    "matters, next is another effect that the literature knows. A dash is what was not asked. "
    "*Halves*: what the two halves of "
    "the recording name. What was expected stands in `benchmarks/real_systems/cases.py`, with "
    "its sources. *Constants fitted* is the system as it is, its constants and noise fitted."
)


def _counts(rows: Sequence[Row]) -> str:
    """How often each judgement fell, in a sentence."""
    out = [row["left_out"] for row in rows]
    counts = ", ".join(f"{out.count(j)} {j}" for j in _JUDGED if j in out)
    built_in = [row for row in rows if "left_in" in row]
    good = [row for row in built_in if row["left_in"] in ("right", "next")]
    both = sum(row["left_out"] in ("right", "class") for row in good)
    halves = [row["halves"] for row in rows if "halves" in row]
    return (
        f"With the effect left out: {counts}.\n\nWith it built in, {len(good)} of {len(built_in)} "
        "answers are right or name what else is known; that says something only where the effect "
        f"had been named when it was left out, in {both} of them.\n\nThe halves of "
        f"{halves.count('same')} of {len(halves)} recordings, each searched by itself, give the "
        f"same answer.{_repeated(rows)}"
        f"{_of_other_commits(rows)}"
    )


def _repeated(rows: Sequence[Row]) -> str:
    """How often the search's own halves say what it found first."""
    asked = [again for row in rows if (again := row["answers"]["out"].get("repeated"))]
    if not asked:
        return ""
    agree = sum(again["agree"] for again in asked)
    return f" Of {len(asked)} answers both halves say what was found first in {agree}."


def _of_other_commits(rows: Sequence[Row]) -> str:
    """A table of the answers that another commit than the record's gave, earlier or later."""
    lines = []
    parts = {"out": "left out", "in": "built in", "first": "left out, a half of the log"}
    for part, of in parts.items():
        commits = [row["answers"].get(part, {}).get("commit") for row in rows]
        lines += [[of, f"`{c}`", str(commits.count(c))] for c in sorted({c for c in commits if c})]
    if not lines:
        return ""
    return "\n\nAnswers of other commits:\n\n" + table(["effect", "commit", "answers"], lines)


def _line(row: Row) -> list[str]:
    out = row["answers"]["out"]
    built_in = row["answers"].get("in")
    return [
        row["case"],
        ", ".join(row["expected"]),
        _names(out),
        _sizes(out),
        row["left_out"],
        f"{row['left_in']}: {_names(built_in)}" if built_in else "–",
        _halves(row),
        f"{out['seconds']:.0f}" if "seconds" in out else "–",
    ]


def _asked_in_halves(rows: Sequence[Row]) -> list[str]:
    """What both halves say of what the search found first, where it asked them."""
    asked = [row for row in rows if row["answers"]["out"].get("repeated")]
    if not asked:
        return []
    said = [[row["case"], _said(row["answers"]["out"]["repeated"])] for row in asked]
    return [
        "Whether each half of the logs, asked by the search itself, leads with what was found "
        "first or with a member of its class, at a size whose interval meets the other's:",
        table(["recording", "both say so"], said),
    ]


def _said(again: Row) -> str:
    """Whether both halves say what was found; else what they lead with."""
    led = [half["leading"] for half in again["halves"]]
    if again["agree"]:
        return "yes"
    return "no: other sizes" if led[0] == led[1] else f"no: {led[0]} / {led[1]}"


def _leader(row: Row) -> list[str]:
    """The strongest candidate of a case that nothing right was named in."""
    out = row["answers"]["out"]
    first = out["leading"][0]
    low, high = first["interval"]
    gain = f"{first['name']} {first['gain_nats']:.0f} [{low:.0f}, {high:.0f}] nats"
    why = first["judged"] if first["judged"] != "accepted" else "it is"
    return [row["case"], f"{out['threshold_nats']:.0f} nats", gain, why]


def _names(answer: Row) -> str:
    """What an answer names, or why it names nothing."""
    if "refused" in answer:
        return "refused"
    found = [effect["name"] for effect in answer["effects"]]
    rivals = [name for name in answer["class"] if name not in found]
    names = ", ".join(found) + f" (or {', '.join(rivals)})" * bool(rivals)
    return names or {"none": "none that matters"}.get(answer["verdict"], answer["verdict"])


def _sizes(answer: Row) -> str:
    return "; ".join(
        f"{name} {size['value']:.3g} [{size['low']:.3g}, {size['high']:.3g}] {size['unit']}"
        for effect in answer.get("effects", ())
        for name, size in effect["parameters"].items()
    )


def _halves(row: Row) -> str:
    halves = [row["answers"][p] for p in ("first", "second") if p in row["answers"]]
    if len(halves) < 2:
        return "–"
    if row.get("halves") == "same":
        return f"same: {_names(halves[0])}"
    return f"{row.get('halves', 'refused')}: {_names(halves[0])} / {_names(halves[1])}"


def _errors(row: Row) -> list[list[str]]:
    out = row["answers"]["out"]
    return [
        [row["case"], name, f"{out['forecast_s']:.3g} s",
         *(f"{errors[k]:.3g} {errors['unit']}" for k in ("stated", "fitted", "found"))]
        for name, errors in out.get("errors", {}).items()
    ]  # fmt: skip
