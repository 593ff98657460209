"""Predictors in C: what they take on a Cortex-M4F, how fast they are here, what rounding changes.

    python -m benchmarks.compiled --work FOLDER

Sizes and times are those of the reference shapes. What rounding changes is measured on the test
episodes of the gantry and the fish, with predictors that are trained for it in FOLDER, on a set
that is made there; both stay, and a stopped measurement goes on. `--part` measures one part alone.
"""

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import records
from benchmarks.microcontroller.avr import MCUS, Mcu, on_avr
from benchmarks.microcontroller.boards import BOARDS, CORTEX_M4F, require_tools, self_tested, taken
from benchmarks.microcontroller.cycles import CLOCK_HZ, cycles_of_a_step
from runtime.compiled.compiler import host_compiler, version_of
from runtime.compiled.folder import CFolder, read_c_folder
from runtime.compiled.predictor import CompiledPredictor
from trainers.build import ARCHITECTURES
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.package import read_package

if TYPE_CHECKING:
    from runtime.bench import BenchRow

RECORD = records.FOLDER / "compiled.json"
STUDY = records.FOLDER / "study-pareto.json"
KINDS = ("float32", "float16", "int8")
EPOCHS, MINUTES = 5, 10
DOMAINS = ("gantry", "fish")
_ROUNDS, _STEPS = 40, 50
_FLIGHT_S = 25.0
_TICKS = 352  # with eight seconds before them, all 16 rows in six minutes
_LONG_TICKS = 3300  # for a p99.9
# Shapes that an 8-bit processor may have time for.
SMALL: dict[str, dict[str, Any]] = {
    "agile-mlp": {"hidden": 16},
    "history-mlp": {"hidden": 8, "snapshots": 6},
    "delay-embedding": {"selector": 8, "hidden": 8, "layers": 1, "history_s": 0.2},
    "gru": {"projection": 8, "hidden": 8, "head": 8},
    "tcn": {"channels": 8, "kernel": 2, "blocks": 3},
    "mamba": {"d_model": 8, "d_state": 2, "d_conv": 2},
    "esn": {"neurons": 50},
    "cross-attention": {"embed": 8, "heads": 2, "feed_forward": 8, "head": 8, "history_s": 0.2},
}


def _options() -> argparse.Namespace:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--work", type=Path, required=True)
    asked.add_argument("--part", choices=PARTS, action="append")
    asked.add_argument("--arch", choices=ARCHITECTURES, action="append")
    return asked.parse_args()


def main() -> None:
    """Measure what is asked for and put it into the record."""
    given = _options()
    given.work.mkdir(parents=True, exist_ok=True)
    for part in given.part or PARTS:
        for arch in given.arch or _ALONE.get(part, ARCHITECTURES):
            result = PARTS[part](given.work, arch)
            _keep(part, arch, result)
            print(part, arch, json.dumps(result), flush=True)
        if part == "costs":
            draw_costs()


def _keep(part: str, arch: str, result: dict[str, Any]) -> None:
    """One result into the record, which states the days and commits of all its parts."""
    known: dict[str, Any] = {"parts": {}, "stamps": {}}
    if RECORD.exists():
        known = json.loads(RECORD.read_text(encoding="utf-8"))
    known["parts"].setdefault(part, {})[arch] = result
    known.setdefault("stamps", {})[part] = {"measured": records.today(), "commit": records.COMMIT}
    stamps = known["stamps"].values()
    joined = {
        key: ", ".join(sorted({stamp[key] for stamp in stamps})) for key in ("measured", "commit")
    }
    settings = {
        "compiler": version_of(host_compiler()),
        "clock_hz": CLOCK_HZ,
        "trained": {"epochs": EPOCHS, "gantry_minutes": MINUTES},
        "flight_s": _FLIGHT_S,
    }
    records.write(RECORD, joined | settings | {"parts": known["parts"], "stamps": known["stamps"]})


def reference_package(work: Path, arch: str) -> Path:
    """The architecture at its reference shape, made once."""
    from export.reference import write_reference_packages

    folder = work / "reference"
    path = folder / f"{arch}.onnx"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        write_reference_packages(folder)
    return path


def reference_c(work: Path, arch: str, kind: str) -> Path:
    """The same as C, made once."""
    from export.c.packaging import Wish, export_c

    folder = work / "c" / f"{arch}-{kind}"
    if not folder.exists():
        wish: Any = Wish(kind, tolerance=1.0)  # type: ignore[arg-type]
        export_c(read_package(reference_package(work, arch)), folder, wish)
    return folder


def sizes(work: Path, arch: str) -> dict[str, Any]:
    """Flash, RAM, instructions and estimated cycles on a Cortex-M4F; parity on every board."""
    require_tools()
    result = {}
    for kind in KINDS:
        folder = read_c_folder(reference_c(work, arch, kind))
        found = taken(folder, CORTEX_M4F)
        executed, cycles = cycles_of_a_step(folder)
        result[kind] = {
            "instructions": found.instructions,
            "executed_in_trace": executed,
            "cycles": cycles,
            "ms": 1e3 * cycles / CLOCK_HZ,
            "flash": found.flash,
            "libm": found.libm,
            "state": found.state,
            "stack": found.stack,
            "static_ram": found.static_ram,
            "parity": {board.name: self_tested(folder, board) for board in BOARDS},
            "parity_here": max(p.max_rel for p in folder.document.proofs),
            "limit": folder.document.limit,
        }
    return result


def host(work: Path, arch: str) -> dict[str, Any]:
    """Time of a step here, in µs: C, onnxruntime and PyTorch eager in turns."""
    from runtime.predictor import PackagePredictor

    package = read_package(reference_package(work, arch))
    steppers: dict[str, Callable[[np.ndarray], object]] = {
        f"c-{kind}": CompiledPredictor(read_c_folder(reference_c(work, arch, kind))).step
        for kind in KINDS
    }
    steppers["onnxruntime"] = PackagePredictor(package).step
    steppers["torch"] = _eager(arch)
    rounds: dict[str, list[float]] = {name: [] for name in steppers}
    inputs = package.example.observation
    for number in range(_ROUNDS):
        for name, step in steppers.items():
            took = [_timed_us(step, inputs[i]) for i in range(_STEPS)]
            if number:  # the first warms up
                rounds[name].append(statistics.median(took))
    return {name: min(medians) for name, medians in rounds.items()}


def _timed_us(step: Callable[[np.ndarray], object], observation: np.ndarray) -> float:
    began = time.perf_counter_ns()
    step(observation)
    return (time.perf_counter_ns() - began) / 1e3


def _eager(arch: str) -> Callable[[np.ndarray], object]:
    """The trained module itself, one observation at a time, its window or state carried."""
    import torch

    from export.reference import reference_config
    from trainers.training.runs import new_predictor

    torch.set_num_threads(1)
    predictor = new_predictor(reference_config(arch)).eval()
    memory = predictor.memory
    held: dict[str, Any] = {"state": predictor.initial_state(1), "past": []}

    def step(observation: np.ndarray) -> object:
        with torch.inference_mode():
            newest = torch.from_numpy(observation)[None]
            if memory.kind == "none":
                return predictor.step(newest)
            if memory.kind == "window":
                past = [*(held["past"] or [newest] * memory.k)[1 - memory.k :], newest]
                held["past"] = past
                return predictor.step(torch.stack(past, 1))
            force, held["state"] = predictor.step(newest, held["state"])
            return force

    return step


def rounding(work: Path, arch: str) -> dict[str, Any]:
    """What int8 and float16 weights change on test episodes, by domain."""
    return {domain: _rounding_on(work, arch, domain) for domain in DOMAINS}


def _rounding_on(work: Path, arch: str, domain: str) -> dict[str, Any]:
    from export.c.packaging import Wish, export_c
    from export.c.real import real_samples
    from export.example import rollout
    from export.limits import limited
    from trainers.trained_run import load_run
    from wakedeploy.core.episodes import read_episode_set

    data = read_episode_set(the_set(work, domain))
    run = load_run(the_run(work, arch, domain))
    package = read_package(the_package(work, arch, domain))
    force = package.manifest.force
    predictor = run.predictor.eval()
    result: dict[str, Any] = {}
    for kind in ("float16", "int8"):
        with tempfile.TemporaryDirectory() as place:
            wish = Wish(kind, tolerance=10.0)
            made = export_c(
                package, Path(place) / "c", wish,
                forward=lambda o: limited(rollout(predictor, o), force),
                real=real_samples(data, package.manifest),
            )  # fmt: skip
        document = made.document
        assert document.rounding is not None
        assert document.rounding.worse is not None
        result[kind] = {
            "worse": document.rounding.worse,
            "rmse": document.rounding.rmse,
            "float_rmse": document.rounding.float_rmse,
            "rel_rms": document.rounding.rel_rms,
            "parity": max(p.max_rel for p in document.proofs),
        }
    return result


def the_set(work: Path, domain: str) -> Path:
    """The set in the work folder; the gantry's is simulated, the fish's imported."""
    from wakedeploy.cli import main as command

    folder = work / domain
    if not folder.exists():
        how = ["data", "make", domain, "--minutes", str(MINUTES)]
        if domain == "fish":
            how = ["data", "import", domain, str(records.ROOT.parent / "shared" / "data" / "fish")]
        command([*how, "--out", str(folder)], standalone_mode=False)
    return folder


def the_run(work: Path, arch: str, domain: str) -> Path:
    """A trained run in the work folder."""
    from trainers.training.runs import runs_of
    from wakedeploy.cli import main as command

    runs = work / f"runs-{domain}"
    command(
        ["train", "--data", str(the_set(work, domain)), "--arch", arch, "--epochs", str(EPOCHS),
         "--no-pictures", "--out", str(runs)],
        standalone_mode=False,
    )  # fmt: skip
    return runs_of(runs, arch)[-1]


def the_package(work: Path, arch: str, domain: str) -> Path:
    """Its package."""
    from wakedeploy.cli import main as command

    path = work / f"{domain}-{arch}.onnx"
    if not path.exists():
        run = the_run(work, arch, domain)
        data = str(the_set(work, domain))
        command(["export", "--run", str(run), "--data", data, "--out", str(path)],
                standalone_mode=False)  # fmt: skip
    return path


def flights(work: Path, arch: str) -> dict[str, Any]:
    """How far two flights of the same plan are apart, with the package and with its C."""
    from export.c.packaging import Wish, export_c
    from runtime.request import RunRequest
    from runtime.run import fly
    from wakedeploy.rig.file import default_rig

    package = the_package(work, arch, "gantry")
    folder = work / "c" / f"gantry-{arch}"
    if not folder.exists():
        export_c(read_package(package), folder, Wish())
    asked = RunRequest(default_rig(), _FLIGHT_S, seed=7)
    errors = {}
    for name, path in (("onnx", package), ("c", folder), ("pid", None)):
        errors[name] = 1e3 * fly(_with(asked, path)).true_rmse_m
    return errors | {"apart_mm": abs(errors["onnx"] - errors["c"])}


def paced(work: Path, arch: str) -> dict[str, Any]:
    """The loop at 32 Hz with the package in onnxruntime and with its C, one after the other."""
    from runtime.bench import bench_latency

    paths = (reference_package(work, arch), reference_c(work, arch, "float32"))
    rows = bench_latency(paths, ticks=_TICKS)
    return {name: _timings(row) for name, row in zip(("onnxruntime", "c"), rows, strict=True)}


def tick(work: Path, arch: str) -> dict[str, Any]:
    """The loop at 32 Hz with C and real-time priority, long enough for a p99.9."""
    from runtime.bench import bench_latency

    (row,) = bench_latency([reference_c(work, arch, "float32")], ticks=_LONG_TICKS, realtime=True)
    return _timings(row) | {"p999_ms": row.p999_ms, "stages_ms": row.stages_ms}


def _timings(row: "BenchRow") -> dict[str, Any]:
    return {
        "predict_ms": row.stages_ms["t_predict_s"],
        "p50_ms": row.p50_ms,
        "p99_ms": row.p99_ms,
        "max_ms": row.max_ms,
        "rss_mb": row.rss_mb,
        "ticks": row.ticks,
        "realtime": row.realtime,
    }


def avr(work: Path, arch: str) -> dict[str, Any]:
    """What fits two AVRs, and how long a step takes there: the reference shape, and a small one."""
    result: dict[str, Any] = {"small": {"hyper": SMALL[arch]}}
    for kind in ("float32", "int8"):
        folder = read_c_folder(reference_c(work, arch, kind))
        result[kind] = {mcu.name: _on_avr(folder, mcu) for mcu in MCUS}
    small = read_c_folder(_small_c(work, arch))
    result["small"] |= {mcu.name: _on_avr(small, mcu) for mcu in MCUS}
    return result


def _on_avr(folder: CFolder, mcu: Mcu) -> dict[str, Any]:
    found = on_avr(folder, mcu)
    if not found.why_not:
        _require_alike(found.force, folder)
    return {"flash": found.flash, "ram": found.ram, "ms": found.ms, "why_not": found.why_not}


def _require_alike(force: tuple[float, ...], folder: CFolder) -> None:
    """The second step's force on the chip is that of this machine."""
    here = CompiledPredictor(folder)
    inputs = np.full(len(folder.manifest.observation), 0.1, np.float32)
    here.step(inputs)
    if not np.allclose(force, here.step(inputs), rtol=1e-4, atol=1e-6):
        raise CheckFailed(f"{folder.path}: on the AVR the force is {force}")


def _small_c(work: Path, arch: str) -> Path:
    from export.c.packaging import Wish, export_c
    from export.reference import reference_config
    from export.step_time import unproved_package
    from trainers.training.runs import new_predictor

    folder = work / "c" / f"small-{arch}"
    if not folder.exists():
        config = reference_config(arch).model_copy(update={"hyper": SMALL[arch]})
        export_c(unproved_package(new_predictor(config).eval(), config), folder, Wish())
    return folder


def _with(request: Any, package: Path | None) -> Any:
    from dataclasses import replace

    return replace(request, package=package, allow_lead_mismatch=True)


def costs(work: Path, arch: str) -> dict[str, Any]:
    """What the study's shape takes as C, beside the error that the study of costs measured."""
    return {domain: _costs_on(work, arch, domain) for domain in DOMAINS}


def _costs_on(work: Path, arch: str, domain: str) -> dict[str, Any]:
    """Cost of a shape does not depend on its weights: an untrained one stands for the study's."""
    from export.c.cost import c_cost
    from export.step_time import unproved_package
    from trainers.training.runs import new_predictor
    from trainers.training.trainer import configure
    from wakedeploy.core.episodes import read_episode_set

    (studied,) = [p for p in _studied()["points"] if (p["domain"], p["arch"]) == (domain, arch)]
    data = read_episode_set(the_set(work, domain))
    config = configure(data, arch, seed=0, lead_s=0.0)
    predictor = new_predictor(config).eval()
    trainable = sum(p.numel() for p in predictor.parameters() if p.requires_grad)
    if trainable != studied["trainable"]:
        raise CheckFailed(
            f"{STUDY}: on {domain} {arch} has {studied['trainable']} weights, here {trainable}:"
            " measure `study pareto` anew."
        )
    cost = asdict(c_cost(unproved_package(predictor, config)))
    return cost | {key: studied[key] for key in ("errors", "error", "trainable")}


def _studied() -> dict[str, Any]:
    study: dict[str, Any] = json.loads(STUDY.read_text(encoding="utf-8"))
    return study


def draw_costs() -> None:
    """The picture of error against bytes and instructions, from the record."""
    from wakedeploy.core import figures
    from wakedeploy.study.pareto import Point
    from wakedeploy.study.pareto_figure import CHIP_COSTS, panels

    measured = json.loads(RECORD.read_text(encoding="utf-8"))["parts"]["costs"]
    by_domain = {
        domain: [
            Point(
                domain, arch, tuple(costs[domain]["errors"]), costs[domain]["trainable"], 0, (),
                flash_bytes=costs[domain]["flash_bytes"], ram_bytes=costs[domain]["ram_bytes"],
                instructions=costs[domain]["instructions"],
            )
            for arch, costs in measured.items()
        ]
        for domain in DOMAINS
    }  # fmt: skip
    drawn = panels(by_domain, {domain: {} for domain in DOMAINS}, CHIP_COSTS)
    figures.save(drawn, records.FIGURES / "c-costs.png")


PARTS: dict[str, Callable[[Path, str], dict[str, Any]]] = {
    "sizes": sizes,
    "host": host,
    "rounding": rounding,
    "flights": flights,
    "paced": paced,
    "tick": tick,
    "avr": avr,
    "costs": costs,
}
# A minute and three quarters each: of one that remembers, and takes the longest of the dense ones.
_ALONE = {"tick": ("gru",)}


if __name__ == "__main__":
    main()
