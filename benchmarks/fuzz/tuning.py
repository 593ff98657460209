"""Kinds of files around tuning: presets, studies, sweeps."""

import functools
import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from benchmarks.fuzz.documents import json_file, json_lines, toml_file
from benchmarks.fuzz.kind import Kind, put, spoken, taken
from benchmarks.fuzz.learning import LEAD_S, set_files, small_set
from trainers.preset import chosen_preset, read_preset
from trainers.training.trainer import configure, settings_for
from trainers.tuning.conclude import conclude
from trainers.tuning.plan import Plan, make_plan
from trainers.tuning.report import best_of, front_of, importances, rows_of
from trainers.tuning.starts import preset_start
from trainers.tuning.storage import JOURNAL
from trainers.tuning.study import give_back_of_the_dead
from trainers.tuning.workers import Work, run_trials
from wakedeploy.api import training
from wakedeploy.cli import sweep as sweep_command
from wakedeploy.sweep.jobs import Job, Outcome, failure
from wakedeploy.sweep.plan import read_plan
from wakedeploy.sweep.run import sweep


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {
        "preset": _preset,
        "study": _study,
        "study-end": _study_end,
        "sweep-plan": _sweep_plan,
        "sweep-results": _sweep_results,
    }


@functools.cache
def _plan_of_study(*asked: str) -> Plan:
    return make_plan(
        small_set(), "gru", lead_s=LEAD_S, epochs=2, budget=3000, objective=("rmse",), seed=1,
        asked=asked,
    )  # fmt: skip


def _work(folder: Path) -> Work:
    return Work(
        _plan_of_study("hidden=4:16"), folder / "set", folder / "tuned", None, None, 3, "median"
    )


@functools.cache
def _tuned() -> dict[str, bytes]:
    """A study that has come to its end, with its set beside it."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        put(folder / "set", set_files())
        work = _work(folder)
        study = work.begin()
        run_trials(work, study, small_set())
        conclude(work, study, small_set())
        return taken(folder)


def _preset() -> Kind:
    shipped = Path(read_preset.__code__.co_filename).with_name("presets") / "gantry" / "gru.toml"
    found = _tuned()["tuned/best.toml"]
    sound = tuple({"best.toml": content} for content in (found, shipped.read_bytes()))
    return Kind("preset", "presets", sound, _train_with, {"*.toml": toml_file})


def _train_with(folder: Path) -> None:
    """As `train --preset` and `tune --start` begin."""
    asked = str(folder / "best.toml")
    with spoken():
        preset = training.usable_preset(asked, "gru", small_set(), LEAD_S, click.echo)
    assert preset is not None
    settings = settings_for("gru", epochs=None, learning_rate=None, others=preset.settings)
    configure(small_set(), "gru", seed=0, lead_s=LEAD_S, hyper=preset.hyper, settings=settings)
    preset_start(
        _plan_of_study("hidden=4:192"), asked, chosen_preset(asked, "gru", "gantry") or preset
    )


def _study() -> Kind:
    kept = {f"tuned/{JOURNAL}": _tuned()[f"tuned/{JOURNAL}"]}
    ways = {"*.journal": json_lines}
    return Kind("study", "study journals", (kept,), _go_on_tuning, ways, writes=True)


def _go_on_tuning(folder: Path) -> None:
    """Do and print what `tune` does before its next trial."""
    work = _work(folder)
    study = work.begin()
    give_back_of_the_dead(study)
    rows = rows_of(study)
    best_of(rows), front_of(rows), importances(study)


def _study_end() -> Kind:
    ways = {"*.journal": json_lines, "*.toml": toml_file, "*.csv": json_lines}
    names = (f"tuned/{JOURNAL}", "tuned/best.toml", "tuned/trials.csv")
    sound = ({name: _tuned()[name] for name in names},)
    return Kind("study-end", "studies, concluded", sound, _end_study, ways, writes=True)


def _end_study(folder: Path) -> None:
    """As `tune` ends: presets, trials, figures, the best trial's run."""
    work = _work(folder)
    conclude(work, work.begin(), small_set())


_PLAN = b"""data = ["set", "short"]
arch = ["gru", "tcn"]
seeds = 2
lead = [0.0, 0.1]
preset = ["reference", "best.toml"]

[settings]
epochs = [2, 3]
learning_rate = 0.01

[hyper.gru]
hidden = [4, 8]

[hyper.tcn]
kernel = 3

[[generate]]
name = "short"
domain = "gantry"
minutes = 5
seed = 1
settings = { rig = "rig.toml" }

[[generate]]
name = "ships"
domain = "ship"
minutes = 5
settings = { level = "slender" }

[[generate]]
name = "air"
domain = "downwash"
minutes = 0.5
settings = { spread = 0.2 }
"""
_PLAIN_PLAN = b'data = "set"\narch = "all"\nseeds = 3\n'


def _sweep_plan() -> Kind:
    from benchmarks.fuzz.gantry import rig_files

    beside = {"set/dataset.json": b"{}", **rig_files()[0], "best.toml": _gru_preset()}
    sound = tuple({"plan.toml": text, **beside} for text in (_PLAN, _PLAIN_PLAN))
    ways = {"*.toml": toml_file}
    return Kind("sweep-plan", "sweep plans", sound, lambda f: read_plan(f / "plan.toml"), ways)


def _gru_preset() -> bytes:
    return _tuned()["tuned/best.toml"]


class _Idle:
    """An executor that carries out nothing: every job that is handed to it has failed."""

    def __init__(self) -> None:
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        """Take a job."""
        self._jobs.append(job)

    def finished(self) -> Iterator[tuple[Job, Outcome]]:
        """Give every job back."""
        while self._jobs:
            job = self._jobs.pop()
            yield job, failure(job, "not carried out")

    def cancel(self) -> None:
        """Nothing runs."""


_SMALL_PLAN = b'data = "set"\narch = ["gru", "esn"]\nseeds = 1\n[hyper.gru]\nhidden = 4\n'


def _sweep_results() -> Kind:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        put(folder, {"plan.toml": _SMALL_PLAN} | {f"set/{k}": v for k, v in set_files().items()})
        sweep(read_plan(folder / "plan.toml"), folder / "out", _Idle())  # type: ignore[arg-type]
        files = taken(folder)
    lines = [_as_done(json.loads(line)) for line in files["out/results.jsonl"].splitlines()]
    files["out/results.jsonl"] = b"".join(json.dumps(line).encode() + b"\n" for line in lines)
    files.pop("out/results.csv")
    asked = ("out/results.jsonl", "out/sweep.json")
    ways = {"*.jsonl": json_lines, "*.json": json_file}
    kept = {name: files[name] for name in asked}
    beside = {name: content for name, content in files.items() if name not in asked}

    def go_on(folder: Path) -> None:
        """As `sweep` does with a folder whose jobs are done."""
        put(folder, beside)
        plan, out = read_plan(folder / "plan.toml"), folder / "out"
        report = sweep(plan, out, _Idle())  # type: ignore[arg-type]
        with spoken():
            sweep_command._tell(report, out, None)

    names = ("--retry-failed",)  # the sentence about failed jobs names this, and no file
    return Kind("sweep-results", "sweep results", (kept,), go_on, ways, names=names, writes=True)


def _as_done(row: dict[str, object]) -> dict[str, object]:
    """A row as a finished training leaves it."""
    scores = {"rmse": {"f_n": 0.1}, "r2": {"f_n": 0.9}}
    outcome = {"trainable": 99, "frozen": 0, "epochs": 2, "best_epoch": 1, "validation": scores}
    outcome |= {"test": scores, "test_r2_ceiling": None, "device": "cpu", "run": "runs/x"}
    return row | {"state": "done", "reason": None, "seconds": 1.5} | outcome
