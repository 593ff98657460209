"""Results of the first commands: how long a new user waits for them."""

import statistics

from benchmarks.results.section import Records, Section, paragraphs, table


def first_minutes(records: Records) -> Section:
    """Processor and wall seconds of the help and of short virtual flights."""
    result = records.json("first-minutes.json")
    lines = [
        [
            f"`{row['command']}`",
            f"{statistics.median(row['processor_s']):.2f}",
            f"{max(row['processor_s']):.2f}",
            f"{row['bound_s']:g}",
            f"{statistics.median(row['wall_s']):.2f}",
        ]
        for row in result["rows"]
    ]
    over = [
        row["command"]
        for row in result["rows"]
        if statistics.median(row["processor_s"]) > row["bound_s"]
    ]
    verdict = (
        f"Over the bound: {', '.join(f'`{command}`' for command in over)}."
        if over
        else "Every command is within its bound."
    )
    head = ["command", "processor [s], median", "longest", "bound", "wall [s], median"]
    return Section(
        "The first commands",
        f"Each command {result['runs']} times, in a process of its own. Processor seconds count: "
        f"the load average was {result['load']:g} at the beginning, and other work on the same "
        "cores makes wall seconds longer.",
        paragraphs(table(head, lines), verdict),
        ("python -m benchmarks.first_minutes --json docs/records/first-minutes.json",),
    )
