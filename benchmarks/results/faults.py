"""Results of faults in flight: what is unsafe, by group and by fault, and false alarms."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, grouped, paragraphs, percent, table

Row = Mapping[str, Any]
EARLIER, PRESENT = "earlier", "present"  # loops
RECORDS = {EARLIER: "faults-earlier.json", PRESENT: "faults.json"}
HEALTHY = {EARLIER: "faults-healthy-earlier.json", PRESENT: "faults-healthy.json"}
PLANTS = {"exact": "exact plant", "mismatched": "other plants"}
BLIND = "faults-blind.json"
NO_FAULT, ALL = "none", "all"


def faults(records: Records) -> Section:
    """What is unsafe when something breaks, by group; what healthy flights suffer from it."""
    campaigns, healthy = _existing(records, RECORDS), _existing(records, HEALTHY)
    newest = list(campaigns.values())[-1]
    return Section(
        "Faults in flight",
        f"Simulated flights of {newest['seconds']:g} s in which one thing breaks, in "
        f"{len(newest['phases'])} phases, with a GRU's feedforward and by PID alone. A flight is "
        "unsafe when the sufferer meets the lower stop faster than 1 m/s or the upper one faster "
        "than 0.5 m/s, or when a motor turns at the end.",
        paragraphs(
            _groups(campaigns),
            "Other plants differ from the rig file as far as calibration leaves it. *Above 1.5 "
            "m/s* counts the flights that are unsafe even if the lower stop may be met so fast. No "
            "command could save the flights of the last row. There is [a table of every "
            "fault](faults.md).",
            _loops(campaigns),
            _false_alarms(healthy),
            _blind(_existing(records, {PRESENT: BLIND})),
            _against_aims(
                newest,
                _newest_rows(records, HEALTHY),
                _newest_rows(records, {PRESENT: BLIND}),
            ),
        ),
        (
            "python -m benchmarks.faults --mismatch --json docs/records/faults.json",
            "python -m benchmarks.faults --healthy 500 --json docs/records/faults-healthy.json",
            "python -m benchmarks.faults --blind 100 --json docs/records/faults-blind.json",
            *_of_the_earlier_loop(campaigns, healthy),
        ),
    )


def _loops(campaigns: Mapping[str, Mapping[str, Any]]) -> str:
    if EARLIER not in campaigns:
        return ""
    return (
        f"The *{EARLIER}* loop is that of commit `{campaigns[EARLIER]['commit']}`. A checkout of "
        "that commit flies it again."
    )


def _of_the_earlier_loop(
    campaigns: Mapping[str, Mapping[str, Any]], healthy: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """How its records are made again: in a checkout whose packages `python -m` finds first."""
    if EARLIER not in campaigns or EARLIER not in healthy:
        return []
    flown = "cd ../earlier && python -m benchmarks.faults"
    return [
        f"git worktree add ../earlier {campaigns[EARLIER]['commit']}",
        f"{flown} --mismatch --json faults.json && cd -",
        "python -m benchmarks.keep faults ../earlier/faults.json faults-earlier",
        f"git -C ../earlier checkout {healthy[EARLIER]['commit']}",
        f"{flown} --healthy 500 --json faults-healthy.json && cd -",
        "python -m benchmarks.keep table ../earlier/faults-healthy.json faults-healthy-earlier",
    ]


def _existing(records: Records, names: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """The records that exist, by the loop that flew."""
    return {
        loop: records.json(name) for loop, name in names.items() if (records.folder / name).exists()
    }


def _groups(campaigns: Mapping[str, Mapping[str, Any]]) -> str:
    """Unsafe flights of all that could be saved, by group; one record beside the other."""
    columns = [
        (loop, plant) for loop, result in campaigns.items() for plant in PLANTS if plant in result
    ]
    head = ["what breaks", "faults"]
    lines: dict[str, list[str]] = {}
    for loop, plant in columns:
        suffix = f", {loop}" if len(campaigns) > 1 else ""
        head += [f"unsafe, {PLANTS[plant]}{suffix}", f"above 1.5 m/s{suffix}"]
        for name, rows in _by_group(campaigns[loop][plant]["faults"]).items():
            lines.setdefault(name, [name, str(len(rows))]).extend(_counted(rows))
    return table(head, lines.values())


def _by_group(rows: Iterable[Row]) -> dict[str, Sequence[Row]]:
    """By group what could be saved, then all of it, then what could not."""
    rows = [row for row in rows if row["group"] != NO_FAULT]
    saveable = [row for row in rows if row["survivable"]]
    lost = [row for row in rows if not row["survivable"]]
    found: dict[str, Sequence[Row]] = dict(grouped(saveable, "group"))
    return found | {ALL: saveable, "not survivable": lost}


def _counted(rows: Sequence[Row]) -> list[str]:
    unsafe, flights = (sum(row[key] for row in rows) for key in ("unsafe", "flights"))
    return [f"{unsafe} of {flights}", str(sum(row["unsafe_above_1_5_mps"] for row in rows))]


def _false_alarms(campaigns: Mapping[str, Mapping[str, Any]]) -> str:
    """Healthy flights that were ended, or flown without their package."""
    lines = [
        [
            f"× {row['wake']}",
            row["pilot"],
            *([loop] if len(campaigns) > 1 else []),
            str(row["flights"]),
            str(row["ended_early"]),
            str(row["unsafe"]),
            percent(row["degraded_share"], 2) if row["pilot"] != "PID" else "–",
        ]
        for loop, result in campaigns.items()
        for row in result["rows"]
    ]
    if not lines:
        return ""
    loop = ["loop"] if len(campaigns) > 1 else []
    head = ["wake", "pilot", *loop, "flights", "ended early", "unsafe", "time DEGRADED"]
    return paragraphs("Nothing breaks in the flights of this table.", table(head, sorted(lines)))


def _blind(campaigns: Mapping[str, Mapping[str, Any]]) -> str:
    """How hard blind descents end, by what is gone and how strong the wake is."""
    lines = [
        [
            row["fault"],
            f"× {row['wake_factor']:g}",
            f"{row['unsafe']} of {row['flights']}",
            *(f"{row[f'{name}_mps']:.2f}" for name in _LANDINGS),
        ]
        for result in campaigns.values()
        for row in result["rows"]
    ]
    if not lines:
        return ""
    head = [
        "what is gone",
        "wake",
        "unsafe",
        "lower, median [m/s]",
        "95 %",
        "worst",
        "upper, worst",
    ]
    return paragraphs(
        "At a random moment the link is cut, or the range sensor falls silent, on plants whose "
        "thrust, friction and wake differ from the rig file.",
        table(head, lines),
    )


def _newest_rows(records: Records, names: Mapping[str, str]) -> list[Row]:
    """The rows of the newest of some records."""
    newest = list(_existing(records, names).values())[-1:]
    return newest[0]["rows"] if newest else []


# What no more than this many flights may do: of a campaign, of 500 healthy ones with wakes up to
# twice as strong, of 100 with stronger ones. A blind descent ends at 1.0 m/s at most.
_STRONGER = "2 to 3"
_MOST_ENDED = {"0.5 to 2": 0, _STRONGER: 1}


def _against_aims(campaign: Mapping[str, Any], healthy: list[Row], blind: list[Row]) -> str:
    """Counts beside what they were to be."""
    lines = []
    for plant in (name for name in PLANTS if name in campaign):
        saveable = _by_group(campaign[plant]["faults"])[ALL]
        lines.append(_aimed(f"unsafe though it could be saved, {PLANTS[plant]}", saveable,
                            "unsafe", 0))  # fmt: skip
    for wake, most in _MOST_ENDED.items():
        rows = [row for row in healthy if row["wake"] == wake]
        if rows:
            lines.append(_aimed(f"healthy, ended early, wake × {wake}", rows, "ended_early", most))
    if blind:
        lines.append(_aimed("blind descents, unsafe at a stop", blind,
                            "unsafe", 0))  # fmt: skip
    return table(["flights", "count", "aim"], lines)


def _aimed(what: str, rows: Sequence[Row], key: str, most: int) -> list[str]:
    count, flights = (sum(row[name] for row in rows) for name in (key, "flights"))
    missed = ", missed" if count > most else ""
    return [what, f"{count} of {flights}", f"{'at most ' if most else ''}{most}{missed}"]


_LANDINGS = ("median_lower", "p95_lower", "worst_lower", "worst_upper")


# Why flights of these faults still end unsafely, or cannot end otherwise.
REASONS = {
    "range 200 ms old": "The stamps say that readings are new. A loop that sees heights of a fifth "
    "of a second ago swings more and more. Only a swing shows how old readings are, and then the "
    "sufferer is fast and near a stop.",
    "range 100 ms old": "As with 200 ms, more slowly.",
    "push -3 N": "A push shows after a tenth of a second, and a command acts a moment later. With "
    "full thrust from then on the sufferer meets the stop from 10 cm at 1.0 m/s, or harder where "
    "it sinks already; in a wake it does so from farther up.",
    "push +2 N": "It begins at rest or in the touch-down, before the loop knows what carries the "
    "sufferer: what lifts it is learnt only while it is seen to move.",
    "range strays 20 %": "By chance most of some readings in a row are strays. The sensor then "
    "counts as one of noise, or a few strays agree.",
    "range strays 70 %": "For two thirds of a second hardly a reading is true. The noise shows "
    "after that time, and the height is lost meanwhile.",
    "range noise 10 cm": "A few readings agree by chance as a push would make them.",
    "range of a hand": "The hand is where the sufferer may be: readings do not jump.",
    "range +0.1 m": "The jump is as small as what a push does within three readings.",
    "range drifts -0.05 m/s": "The sensor has drifted by 0.4 m when the plan lands. The touch-down "
    "sees a stop and no motion where the sufferer hangs in the air.",
    "range drifts -0.2 m/s": "As with 0.05 m/s, by more.",
    "wake x 3": "The wake swings the loop, which looks like late readings, or takes the thrust "
    "that would brake.",
    "thrust +40 %": "It comes down at 1.0 and 1.1 m/s; why was not looked into.",
}


def page(records: Records) -> str:
    """Every fault of the newest record."""
    newest = list(_existing(records, RECORDS).values())[-1]
    return paragraphs(
        "# Faults in flight",
        "Every fault begins in these phases: " + ", ".join(newest["phases"]) + ".",
        "*Noticed* is the median time until a row of the log names a fault or leaves its mode, "
        "over the flights in which one does; their number stands beside it. A dash: no row names "
        "the fault. Either the flight went on as if nothing were, or no tick after the "
        "fault left a row, as with exceptions for ever and a full disk: the ending says which.",
        "Speeds are the hardest contacts with the stops. The carriage's column is how far it was "
        "from home, which counts for nothing in what is unsafe. A fault without a length lasts "
        "for ever.",
        *(
            paragraphs(f"## {PLANTS[plant].capitalize()}", _all(newest[plant]["faults"]))
            for plant in PLANTS
            if plant in newest
        ),
        _unsafe(
            {name: newest[name].get("unsafe_flights", {}) for name in PLANTS if name in newest}
        ),
    )


def _unsafe(found: Mapping[str, Mapping[str, Sequence[str]]]) -> str:
    """Each unsafe flight that some command could have saved, and by fault why it was not."""
    lines = [
        [fault, PLANTS[plant], *_parted(line)]
        for plant, faults in found.items()
        for fault, flights in faults.items()
        for line in flights
    ]
    if not lines:
        return ""
    lines.sort(key=lambda line: line[0])
    head = ["fault", "plant", "phase", "pilot", "lower [m/s]", "upper [m/s]", "ending"]
    reasons = [
        f"- *{name}*: {reason}"
        for name, reason in REASONS.items()
        if any(line[0] in (name, f"{name}, {line[0].rpartition(', ')[2]}") for line in lines)
    ]
    return paragraphs(
        "## Unsafe flights",
        "The motors obey in each of these, and what pushes is less than the thrust reserve.",
        table(head, lines),
        "Why they are unsafe:",
        "\n".join(reasons),
    )


def _parted(line: str) -> list[str]:
    """Phase, pilot, speeds and ending of a line of `benchmarks.injected.table.COLUMNS`."""
    phase, pilot, lower, upper, _, _, _, ended = line.split(", ", 7)
    return [phase, pilot, lower, upper, ended]


def _all(rows: Sequence[Row]) -> str:
    parts = []
    for name, ones in grouped(rows, "group").items():
        parts += [f"### {_titled(name)}", table(_HEAD, (_line(row) for row in ones))]
    return paragraphs(*parts)


_HEAD = ["fault", "unsafe", "lower [m/s]", "upper [m/s]", "carriage [m]", "noticed [s] (flights)"]
_HEAD += ["most common ending"]


def _titled(group: str) -> str:
    return "No fault" if group == NO_FAULT else group.capitalize()


def _line(row: Row) -> list[str]:
    noticed_s = row["median_detection_s"]
    ending, count = next(iter(row["endings"].items()))
    return [
        row["fault"] + ("" if row["survivable"] else " (not survivable)"),
        f"{row['unsafe']} of {row['flights']}",
        f"{row['worst_lower_mps']:.2f}",
        f"{row['worst_upper_mps']:.2f}",
        f"{row['worst_reach_m']:.2f}",
        "–" if noticed_s is None else f"{noticed_s:.2f} ({row['detected']} of {row['flights']})",
        f"{ending} ({count})",
    ]
