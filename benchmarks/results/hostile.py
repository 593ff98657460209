"""Results about files that may come from anyone."""

from benchmarks.results.section import Records, Section, paragraphs, table


def files(records: Records) -> Section:
    """What became of damaged and forged files, by kind."""
    result = records.json("fuzz.json")
    kinds = sorted(result["kinds"], key=lambda kind: kind["what"])
    lines = [
        [
            kind["what"],
            f"{kind['files']:,}",
            f"{kind['read']:,}",
            f"{kind['refused']:,}",
            str(kind["failed"]),
            f"{kind['files'] / kind['seconds']:,.0f}",
            f"{kind['slowest_s']:.2f} s",
        ]
        for kind in kinds
    ]
    failed = sum(kind["failed"] for kind in kinds)
    limits = (
        f"Reading a file may take {result['slowest_allowed_s']:g} s of processor time (pictures "
        f"more) and {result['most_allowed_mib']} MiB of memory. Another exception, a warning, or a "
        "sentence of several lines or without the file's name is a failure."
    )
    head = ["kind", "files", "read", "refused", "failures", "files a second", "slowest"]
    return Section(
        "Hostile files",
        f"{result['files']:,} damaged and forged files in {result['processor_s'] / 60:.0f} minutes "
        "of processor time, each read by what the commands read it with: "
        f"{failed or 'no'} failure{'' if failed == 1 else 's'}.",
        paragraphs(limits, table(head, lines)),
        (
            "python -m benchmarks.fuzz --minutes "
            f"{result['seconds'] / 60:.0f} --json docs/records/fuzz.json",
        ),
    )
