"""Results about the simulators and the firmware: speed, open constants, mutants."""

from benchmarks.results.section import Records, Section, paragraphs, percent, span, table


def downwash_speed(records: Records) -> Section:
    """How fast the 2D downwash flies."""
    result = records.json("downwash-speed.json")
    lines = [
        [name, f"{speed['median']:.0f}", f"{speed['worst']:.0f}"]
        for name, speed in result["times_real_time"].items()
    ]
    return Section(
        "Speed of the 2D downwash",
        f"Recorded seconds over seconds of one core, {result['episodes']} episodes of "
        f"{result['seconds']:g} s in lockstep, over {result['turns']} turns.",
        table(["job", "times real time, median", "worst turn"], lines),
        ("python -m benchmarks.downwash --turns 2 --json docs/records/downwash-speed.json",),
    )


def field_step(records: Records) -> Section:
    """The compiled field step beside numpy."""
    record = records.json("field.json")
    lines = [
        ["compiled step", f"{record['numba_us']:.0f} µs"],
        ["the same in numpy", f"{record['numpy_us']:.0f} µs"],
        [
            "ratio, median and worst turn",
            f"{record['ratio']:.1f}, {record['ratio_worst_turn']:.1f}",
        ],
        ["operations at the core's fastest rate", f"{record['arithmetic_alone_us']:.0f} µs"],
        ["memory traffic that cannot be avoided", f"{record['least_traffic_alone_us']:.0f} µs"],
        ["memory traffic of this code", f"{record['present_traffic_alone_us']:.0f} µs"],
    ]
    return Section(
        "One step of the 2D field",
        f"Time of one step of a grid of {record['columns']} × {record['rows']} cells on one core.",
        table(["", "time"], lines),
        ("python -m benchmarks.field --json docs/records/field.json",),
    )


def estimates(records: Records) -> Section:
    """What hangs on the constants that the paper leaves open, in short."""
    result = records.json("downwash-estimates.json")
    worlds = [world for world in result.values() if isinstance(world, dict)]
    ratios = [world["agile-mlp share"] / world["history-mlp share"] for world in worlds]
    gains = [100 * world["history-mlp gain"] for world in worlds]
    body = (
        f"Over {len(worlds)} variants, the error without memory is {span(ratios, 1)} times the "
        f"error with memory. The model with memory reaches {span(gains, 0)} % of the oracle's "
        "gain in flight. There is [a table of all variants](downwash-estimates.md)."
    )
    return Section(
        "Constants that the paper leaves open",
        "The 2D downwash with each open constant made smaller and larger, and with other grids.",
        body,
        ("python -m benchmarks.downwash_estimates --json docs/records/downwash-estimates.json",),
    )


def frames(records: Records) -> Section:
    """Frames, damaged frames and noise against the firmware's decisions."""
    record = records.json("frames.json")
    valid = sum(record[kind] for kind in ("hellos", "arms", "disarms", "commands", "extreme"))
    lines = [
        ["valid frames, extreme values among them", valid],
        ["valid frames with any sequence number", record["stale"]],
        ["frames with turned bits, lost, changed or repeated bytes", record["damaged"]],
        ["frames that were cut", record["cut"]],
        ["frames of another type or length, checksum right", record["misshapen"]],
        ["pieces of noise of up to 79 bytes", record["noise"]],
        ["all", record["frames"]],
    ]
    text = (
        f"In {_rounded(record['ticks'])} ticks of 100 µs the board armed {record['flights']:,} "
        f"times, and silence latched it {record['latched']:,} times. Nothing failed."
    )
    return Section(
        "Damaged frames",
        "The firmware's decisions, compiled with the sanitizers of addresses and of undefined "
        "behaviour, against a model that was written from the protocol alone. Every answer has to "
        "be the model's. In every tick pulses stay within the limits and the slew, steps within "
        "the speed, and motors idle where nothing flies.",
        paragraphs(table(["what was sent", ""], [[k, f"{n:,}"] for k, n in lines]), text),
        (
            f"python -m benchmarks.frames --count {record['frames']} "
            "--json docs/records/frames.json",
        ),
    )


def _rounded(count: int) -> str:
    return f"{count / 1e9:.1f} · 10⁹"


def mutants(records: Records) -> Section:
    """Whether the tests notice changes of the firmware's decisions."""
    record = records.json("mutants.json")
    lines = [
        ["changes that can be noticed from outside", str(record["tried"])],
        ["noticed", f"{record['noticed']} ({percent(record['share'], 1)})"],
        ["changes that behave as the original does", str(len(record["equivalent"]))],
        ["changes that do not compile", str(record["no_program"])],
    ]
    return Section(
        "Mutants of the firmware",
        "Each decision of the firmware changed by one token at a time: do the tests notice?",
        paragraphs(table(["", "changes"], lines)),
        ("make mutants",),
    )


def firmware_size(records: Records) -> Section:
    """How much of the UNO the sketch takes."""
    lines = [
        [row["memory"], *(f"{row[f'{name}bytes']:,}" for name in ("", "ceiling_", "chip_"))]
        for row in records.json("firmware-size.json")["rows"]
    ]
    return Section(
        "Size of the firmware",
        "The sketch as it is uploaded to the UNO. A test fails above the ceilings.",
        paragraphs(table(["memory", "bytes", "ceiling", "the UNO has"], lines)),
        ("python -m benchmarks.firmware_size --json docs/records/firmware-size.json",),
    )
