"""Results of the C export: what each architecture takes on a chip, and what int8 costs."""

from collections.abc import Mapping
from decimal import ROUND_CEILING, Context
from typing import Any

from benchmarks.results.section import ARCHITECTURES, Records, Section, paragraphs, span, table

RECORD, STUDY = "compiled.json", "study-pareto.json"
_KINDS = ("float32", "int8")
_ALLOWED = 0.02  # by which share int8 may make the error grow
_HALF = 0.5  # of onnxruntime's time
_DOMAINS = ("gantry", "fish")
_COSTS = {"flash": "flash_bytes", "RAM": "ram_bytes", "instructions": "instructions"}
_BUILDS = ("c-float32", "c-int8")
# What the C export aims at: a step and the RAM of the GRU on the chip, the tick's p99.9 and the
# memory of the process that flies.
_STEP_MS, _RAM_KB, _TICK_MS, _RSS_MB = 3.0, 8.0, 1.0, 40.0

Parts = Mapping[str, Mapping[str, Any]]


def on_a_chip(records: Records) -> Section:
    """Flash, RAM, instructions and cycles on a Cortex-M4F, and the same forces on every board."""
    parts: Parts = records.json(RECORD)["parts"]
    sizes = parts["sizes"]
    rows = [_chip_row(arch, kind, sizes[arch][kind]) for arch in ARCHITECTURES for kind in _KINDS]
    head = ("architecture", "weights", "flash [kB]", "libm [kB]", "RAM [kB]", "instructions",
            "estimated cycles", "at 168 MHz [ms]", "parity")  # fmt: skip
    slower = sum(sizes[arch]["int8"]["ms"] > sizes[arch]["float32"]["ms"] for arch in ARCHITECTURES)
    worst = max(max(row[kind]["parity"].values()) for row in sizes.values() for kind in row)
    return Section(
        "C on a microcontroller",
        "The reference shapes as C, compiled by gcc -O2 and run on QEMU's Cortex-M4F board. On its"
        " Cortex-M33 board only the forces are compared; instructions, stack and flash are not"
        " measured there.",
        paragraphs(
            table(head, rows),
            _gru_in_time(sizes["gru"]),
            f"int8 saves flash, not time: {slower} of {len(ARCHITECTURES)} take longer with int8"
            " than with float32. int8 keeps biases, tables and matrices of fewer than eight rows in"
            " float32. Of the reservoir it rounds only the recurrent matrix, since the readout was"
            " solved for exactly its echoes.",
            f"On both boards no model and no kind of weights differs by more than {_up(worst)} from"
            " its reference.",
            "Flash is the model's own object by the linker's map. libm is what the step calls of"
            " the C library; it comes on top, once in a firmware. RAM is the state and the deepest"
            " stack of a step. Instructions are counted by the simulator; they are no cycles."
            " Instructions and stack are those of one constant observation.",
            "Cycles are estimated from every executed instruction by Arm's Cortex-M4 manual, plus"
            " five wait states for each 16 bytes of weights that an STM32F405 reads from its flash."
            " The estimate leaves out stalls between floating-point instructions that use each"
            " other's results, and instruction fetches that the flash's cache does not hold. A chip"
            " may take longer.",
        ),
        ("python -m benchmarks.compiled --work work --part sizes",),
    )


def _chip_row(arch: str, kind: str, row: Mapping[str, Any]) -> list[str]:
    return [
        arch,
        kind,
        f"{row['flash'] / 1e3:.0f}",
        f"{row['libm'] / 1e3:.1f}",
        f"{_ram(row):.1f}",
        f"{row['instructions']:,}",
        f"{row['cycles']:,}",
        f"{row['ms']:.2f}",
        _up(max(row["parity"].values())),
    ]


def _gru_in_time(gru: Mapping[str, Mapping[str, Any]]) -> str:
    """The step and the RAM that are aimed at."""
    ram = max(_ram(gru[kind]) for kind in _KINDS)
    rows = []
    for kind in _KINDS:
        took_ms = gru[kind]["ms"]
        rows.append([f"estimated step, {kind}", f"{took_ms:.1f} ms", _aim(took_ms, _STEP_MS, "ms")])
    rows.append(["RAM", f"{ram:.1f} kB", _aim(ram, _RAM_KB, "kB")])
    return table(("the GRU of 71,000 weights", "measured", "aim"), rows)


def _aim(value: float, aim: float, unit: str) -> str:
    """The aim, and whether it is missed."""
    return f"{aim:g} {unit}" + (", missed" if value > aim else "")


def _up(value: float) -> str:
    """Two digits, rounded up: a limit that holds."""
    digits = Context(prec=2, rounding=ROUND_CEILING)
    return f"{float(digits.create_decimal_from_float(value)):.1e}"


def _ram(row: Mapping[str, Any]) -> float:
    return float(row["state"] + row["stack"] + row["static_ram"]) / 1e3


def on_this_machine(records: Records) -> Section:
    """Time of a step beside onnxruntime and PyTorch, and what int8 does to the error."""
    result = records.json(RECORD)
    return Section(
        "C in the loop",
        "Time of a step of the reference shapes on one core, all in turns in one process, each"
        " called from Python as the loop does. It is the smallest of the rounds' medians."
        f" {result['compiler']}, -O2 for this processor.",
        paragraphs(*_step_times(result["parts"]["host"]), *_int8_errors(result)),
        (
            "python -m benchmarks.compiled --work work --part host",
            "python -m benchmarks.compiled --work work --part rounding",
            "python -m benchmarks.compiled --work work --part flights",
        ),
    )


def _step_times(host: Mapping[str, Mapping[str, float]]) -> tuple[str, str]:
    rows = [
        [
            arch,
            *(f"{host[arch][name]:.1f}" for name in (*_BUILDS, "onnxruntime", "torch")),
            *(f"{_ratio(host[arch], name):.2f}" for name in _BUILDS),
            f"{host[arch]['torch'] / host[arch]['c-float32']:.0f}",
        ]
        for arch in ARCHITECTURES
    ]
    head = ("architecture", "C [µs]", "C, int8 [µs]", "onnxruntime [µs]", "PyTorch [µs]",
            "C / onnxruntime", "C, int8 / onnxruntime", "PyTorch / C")  # fmt: skip
    quick, quick_int8 = (
        sum(_ratio(host[arch], name) <= _HALF for arch in ARCHITECTURES) for name in _BUILDS
    )
    text = (
        f"{quick} of {len(ARCHITECTURES)} take at most half of onnxruntime's time; with int8"
        f" weights {quick_int8} do."
    )
    return table(head, rows), text


def _int8_errors(result: Mapping[str, Any]) -> tuple[str, str, str]:
    rounding, flown = result["parts"]["rounding"], result["parts"]["flights"]
    rows = [
        [
            arch,
            *(f"{100.0 * rounding[arch][d]['int8']['worse']:+.2f}" for d in _DOMAINS),
            f"{flown[arch]['apart_mm']:.3f}",
        ]
        for arch in ARCHITECTURES
    ]
    head = ("architecture", "int8, gantry [%]", "int8, fish [%]", "flights apart [mm]")
    kept = sum(
        rounding[arch][d]["int8"]["worse"] <= _ALLOWED for arch in ARCHITECTURES for d in _DOMAINS
    )
    trained = result["trained"]
    text = (
        f"With int8 weights {kept} of {2 * len(ARCHITECTURES)} errors grow by at most"
        f" {100 * _ALLOWED:g} %. The columns are the growth of the RMSE on test episodes by"
        f" rounding the trained weights. The predictors were trained for {trained['epochs']}"
        f" epochs, those of the gantry on {trained['gantry_minutes']} simulated minutes; longer"
        " training has not been tried."
    )
    flights = (
        "Flights apart is the difference between the tracking errors (RMSE) of two flights, one"
        " with the package in onnxruntime and one with its C. Both fly the same plan of"
        f" {result['flight_s']:g} s with the gantry's predictors from above."
    )
    return table(head, rows), text, flights


def _ratio(row: Mapping[str, float], name: str) -> float:
    return row[name] / row["onnxruntime"]


def paced(records: Records) -> Section:
    """The loop at its own pace, in onnxruntime and in C."""
    parts: Parts = records.json(RECORD)["parts"]
    paced = parts["paced"]
    measured = [arch for arch in ARCHITECTURES if arch in paced]
    rows = [
        [
            arch,
            *(f"{paced[arch][name]['predict_ms']['p50']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['p50_ms']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['p99_ms']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['rss_mb']:.0f}" for name in ("onnxruntime", "c")),
        ]
        for arch in measured
    ]
    head = ("architecture", "predict p50 [ms]", "in C", "tick p50 [ms]", "in C", "tick p99 [ms]",
            "in C", "memory [MB]", "in C")  # fmt: skip
    flown = [row for arch in measured for row in paced[arch].values()]
    priority = " with real-time priority" if all(row["realtime"] for row in flown) else ""
    return Section(
        "C in the loop, at 32 Hz",
        f"From measurement to command over {span([row['ticks'] for row in flown], 0)} ticks, on the"
        f" virtual gantry, in a process of its own{priority} for each row and kind. onnxruntime is"
        " asked through a thread that the loop can stop waiting for; C whose steps take less than a"
        " millisecond is stepped by the loop. Memory is that of the whole process in flight.",
        paragraphs(
            table(head, rows),
            _slower_ticks({arch: paced[arch] for arch in measured}),
            *_whole_tick(parts),
        ),
        (
            "python -m benchmarks.compiled --work work --part paced",
            "python -m benchmarks.compiled --work work --part tick",
        ),
    )


def _slower_ticks(paced: Parts) -> str:
    """Where the median tick is longer in C, although the prediction is shorter."""
    longer = [
        arch for arch, row in paced.items() if row["c"]["p50_ms"] > row["onnxruntime"]["p50_ms"]
    ]
    if not longer:
        return ""
    quicker = all(
        paced[arch]["c"]["predict_ms"]["p50"] < paced[arch]["onnxruntime"]["predict_ms"]["p50"]
        for arch in longer
    )
    why = " C predicts sooner there, too; the rest of the tick takes longer." if quicker else ""
    return (
        f"In {len(longer)} of {len(paced)} rows the median tick takes longer in C than in"
        f" onnxruntime: {', '.join(longer)}.{why} Each row and kind was flown once."
    )


def _whole_tick(parts: Parts) -> tuple[str, ...]:
    """The long flight for a p99.9 and the aims, where it has been measured."""
    if "tick" not in parts:
        return ()
    (arch, row), *_ = parts["tick"].items()
    rows = [
        ["median", f"{row['p50_ms']:.2f} ms", ""],
        ["p99.9", f"{row['p999_ms']:.2f} ms", _aim(row["p999_ms"], _TICK_MS, "ms")],
        ["longest", f"{row['max_ms']:.2f} ms", ""],
        ["memory of the process", f"{row['rss_mb']:.0f} MB", _aim(row["rss_mb"], _RSS_MB, "MB")],
    ]
    return (
        table((f"whole tick of the {arch} in C", "measured", "aim"), rows),
        f"This flight has {row['ticks']:,} ticks with `--realtime`.",
    )


def against_error(records: Records) -> Section:
    """Error against what a step takes, and who is beaten by none."""
    measured = records.json(RECORD)["parts"]["costs"]
    study = records.json(STUDY)
    rows = [
        [
            arch,
            *(f"{measured[arch][domain]['error']:.3f}" for domain in _DOMAINS),
            *(f"{measured[arch]['gantry'][key] / 1e3:.1f}" for key in _COSTS.values()),
        ]
        for arch in ARCHITECTURES
    ]
    head = ("architecture", "error, gantry", "error, fish", "flash, gantry [kB]",
            "RAM, gantry [kB]", "instructions, gantry [10³]")  # fmt: skip
    beaten_by_none = table(
        ("none beats in error and", *_DOMAINS),
        [
            [what, *(", ".join(_front(measured, domain, key)) for domain in _DOMAINS)]
            for what, key in _COSTS.items()
        ],
    )
    return Section(
        "Error against bytes and instructions",
        "The error is that of the study of error against parameters: RMSE over the standard"
        f" deviation on test episodes, the mean of {study['seeds']} seeds. The costs are those of"
        " the same shapes as C with float32 weights. Bytes are counted, without code and libm;"
        " instructions are estimated for a Cortex-M4F.",
        paragraphs(
            "![Error against flash, RAM and instructions](../figures/c-costs.png)",
            table(head, rows),
            beaten_by_none,
        ),
        ("python -m benchmarks.compiled --work work --part costs",),
    )


def _front(measured: Parts, domain: str, key: str) -> list[str]:
    """Architectures that no other beats in error without costing more."""
    points = {arch: (row[domain]["error"], row[domain][key]) for arch, row in measured.items()}
    return [
        arch
        for arch in ARCHITECTURES
        if not any(
            all(a <= b for a, b in zip(other, points[arch], strict=True)) and other != points[arch]
            for other in points.values()
        )
    ]


def on_an_avr(records: Records) -> Section:
    """What fits an Arduino, and how long it takes there."""
    avr: Parts = records.json(RECORD)["parts"]["avr"]
    rows = []
    for arch in ARCHITECTURES:
        for kind in (*_KINDS, "small"):
            row = avr[arch][kind]
            shape = "reference" if kind != "small" else _shape(row["hyper"])
            weights = kind if kind != "small" else "float32"
            cells = [_fitted(row[mcu]) for mcu in ("ATmega328P", "ATmega2560")]
            if any(cell != "–" for cell in cells):
                rows.append([arch, shape, weights, *cells])
    return Section(
        "C on an 8-bit AVR",
        "Time of a step at 16 MHz on simulated chips (simavr, which counts cycles), with flash and"
        " RAM of the whole program, stack included. Shapes that fit neither chip are left out; – is"
        " no room. avr-gcc -Os.",
        table(("architecture", "shape", "weights", "ATmega328P (UNO)", "ATmega2560 (Mega)"), rows),
        ("python -m benchmarks.compiled --work work --part avr",),
    )


def _shape(hyper: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in hyper.items())


def _fitted(row: Mapping[str, Any]) -> str:
    if row["why_not"]:
        return "–"
    return f"{row['ms']:.0f} ms, {row['flash'] / 1e3:.1f} kB, {row['ram'] / 1e3:.2f} kB"
