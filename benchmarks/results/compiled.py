"""Results of the C export: what each architecture takes on a chip, and what int8 costs."""

from collections.abc import Mapping
from typing import Any

from benchmarks.results.section import ARCHITECTURES, Records, Section, paragraphs, table

RECORD = "compiled.json"
_KINDS = ("float32", "int8")
_ALLOWED = 0.02  # by which share int8 may make the error grow
_HALF = 0.5  # of onnxruntime's time

Parts = Mapping[str, Mapping[str, Any]]


def on_a_chip(records: Records) -> Section:
    """Flash, RAM, instructions and cycles on a Cortex-M4F, and the same forces on every board."""
    parts: Parts = records.json(RECORD)["parts"]
    sizes = parts["sizes"]
    rows = [_chip_row(arch, kind, sizes[arch][kind]) for arch in ARCHITECTURES for kind in _KINDS]
    head = ("architecture", "weights", "flash [kB]", "RAM [kB]", "instructions", "estimated cycles",
            "at 168 MHz [ms]", "parity")  # fmt: skip
    gru = sizes["gru"]["float32"]
    worst = max(
        max(by_kind[kind]["parity"].values()) for by_kind in sizes.values() for kind in by_kind
    )
    text = (
        f"The GRU of 71,000 weights takes an estimated {gru['ms']:.1f} ms and {_ram(gru):.1f} kB of"
        f" RAM. On both boards no model and no kind of weights differs by more than {worst:.0e}"
        " from its reference."
    )
    return Section(
        "C on a microcontroller",
        "The reference shapes as C, gcc -O2, in QEMU's Cortex-M4F and Cortex-M33 boards. int8 keeps"
        " biases, tables and matrices of fewer than eight rows in float32, and of the reservoir"
        " all but its recurrent matrix, whose readout was solved for exactly its echoes. Flash is"
        " the model's own object by the linker's map. RAM is state and deepest stack of a step,"
        " painted and looked at. Instructions are counted by the simulator; they are no cycles."
        " Cycles are estimated from every executed instruction by Arm's Cortex-M4 manual, plus five"
        " wait states for each 16 bytes of weights that an STM32F405 reads from its flash.",
        paragraphs(table(head, rows), text),
        ("python -m benchmarks.compiled --work work --part sizes",),
    )


def _chip_row(arch: str, kind: str, footprint: Mapping[str, Any]) -> list[str]:
    return [
        arch,
        kind,
        f"{footprint['flash'] / 1e3:.0f}",
        f"{_ram(footprint):.1f}",
        f"{footprint['instructions']:,}",
        f"{footprint['cycles']:,}",
        f"{footprint['ms']:.2f}",
        f"{max(footprint['parity'].values()):.0e}",
    ]


def _ram(footprint: Mapping[str, Any]) -> float:
    return float(footprint["state"] + footprint["stack"] + footprint["static_ram"]) / 1e3


def on_this_machine(records: Records) -> Section:
    """Time of a step beside onnxruntime and PyTorch, and what int8 does to the error."""
    result = records.json(RECORD)
    host, rounding = result["parts"]["host"], result["parts"]["rounding"]
    flown = result["parts"]["flights"]
    rows = [
        [
            arch,
            *(f"{host[arch][name]:.1f}" for name in ("c-float32", "onnxruntime", "torch")),
            f"{_ratio(host[arch]):.2f}",
            f"{host[arch]['torch'] / host[arch]['c-float32']:.0f}",
            *(f"{100.0 * rounding[arch][d]['int8']['worse']:+.2f}" for d in ("gantry", "fish")),
            f"{flown[arch]['apart_mm']:.3f}",
        ]
        for arch in ARCHITECTURES
    ]
    head = ("architecture", "C [µs]", "onnxruntime [µs]", "PyTorch [µs]", "C / onnxruntime",
            "PyTorch / C", "int8, gantry [%]", "int8, fish [%]", "flights apart [mm]")  # fmt: skip
    quick = sum(_ratio(host[arch]) <= _HALF for arch in ARCHITECTURES)
    kept = sum(
        rounding[arch][d]["int8"]["worse"] <= _ALLOWED
        for arch in ARCHITECTURES
        for d in ("gantry", "fish")
    )
    text = (
        f"{quick} of {len(ARCHITECTURES)} take at most half of onnxruntime's time. With int8"
        f" weights {kept} of {2 * len(ARCHITECTURES)} errors grow by at most {100 * _ALLOWED:g} %."
    )
    return Section(
        "C in the loop",
        "Median time of a step of the reference shapes on one core, all in turns in one process,"
        f" each called from Python as the loop does; {result['compiler']}, -O2 for this processor."
        " int8 is the growth of the RMSE on test episodes by rounding the trained weights. The last"
        " column is how far the tracking errors of two flights are apart, one with the package in"
        " onnxruntime and one with its C, on the same plan.",
        paragraphs(table(head, rows), text),
        (
            "python -m benchmarks.compiled --work work --part host",
            "python -m benchmarks.compiled --work work --part rounding",
            "python -m benchmarks.compiled --work work --part flights",
        ),
    )


def _ratio(times: Mapping[str, float]) -> float:
    return times["c-float32"] / times["onnxruntime"]


def paced(records: Records) -> Section:
    """The loop at its own pace, in onnxruntime and in C."""
    parts: Parts = records.json(RECORD)["parts"]
    paced = parts["paced"]
    rows = [
        [
            arch,
            *(f"{paced[arch][name]['predict_ms']['p50']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['p50_ms']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['p99_ms']:.2f}" for name in ("onnxruntime", "c")),
            *(f"{paced[arch][name]['rss_mb']:.0f}" for name in ("onnxruntime", "c")),
        ]
        for arch in ARCHITECTURES
        if arch in paced
    ]
    head = ("architecture", "predict p50 [ms]", "in C", "tick p50 [ms]", "in C", "tick p99 [ms]",
            "in C", "memory [MB]", "in C")  # fmt: skip
    ticks = next(iter(paced.values()))["c"]["ticks"]
    return Section(
        "C in the loop, at 32 Hz",
        f"From measurement to command over {ticks} ticks, on the virtual gantry, in a process of"
        " its own for each row and kind. onnxruntime is asked through a thread that the loop can"
        " stop waiting for; C whose steps take less than a millisecond is stepped by the loop."
        " Memory is that of the whole process in flight.",
        paragraphs(table(head, rows), _whole_tick(parts)),
        (
            "python -m benchmarks.compiled --work work --part paced",
            "python -m benchmarks.compiled --work work --part tick",
        ),
    )


def _whole_tick(parts: Parts) -> str:
    """The long flight for a p99.9, where it has been measured."""
    if "tick" not in parts:
        return ""
    (arch, tick), *_ = parts["tick"].items()
    return (
        f"Over {tick['ticks']:,} ticks with `--realtime` the whole tick of the {arch} in C takes"
        f" {tick['p50_ms']:.2f} ms at the median, {tick['p999_ms']:.2f} ms at p99.9 and"
        f" {tick['max_ms']:.2f} ms at most; the process holds {tick['rss_mb']:.0f} MB."
    )


def on_an_avr(records: Records) -> Section:
    """What fits an Arduino, and how long it takes there."""
    avr: Parts = records.json(RECORD)["parts"]["avr"]
    rows = []
    for arch in ARCHITECTURES:
        for kind in (*_KINDS, "small"):
            by_mcu = avr[arch][kind]
            shape = "reference" if kind != "small" else _shape(by_mcu["hyper"])
            weights = kind if kind != "small" else "float32"
            cells = [_fitted(by_mcu[mcu]) for mcu in ("ATmega328P", "ATmega2560")]
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


def _fitted(on_mcu: Mapping[str, Any]) -> str:
    if on_mcu["why_not"]:
        return "–"
    return f"{on_mcu['ms']:.0f} ms, {on_mcu['flash'] / 1e3:.1f} kB, {on_mcu['ram'] / 1e3:.2f} kB"
