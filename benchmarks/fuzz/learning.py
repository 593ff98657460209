"""Kinds of files around learning: episode sets, runs, presets, studies, sweeps, packages."""

import dataclasses
import functools
import hashlib
import json
import random
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import numpy as np

from benchmarks.fuzz.archives import npz_file, safetensors_file
from benchmarks.fuzz.documents import as_json, json_file, json_lines, toml_file
from benchmarks.fuzz.kind import Files, Kind, put, spoken, taken
from benchmarks.fuzz.packages import onnx_file
from export.c.packaging import Wish, export_c
from export.limits import force_channels
from export.packaging import export_predictor
from runtime.compiled.folder import read_c_folder
from runtime.predictor import PackagePredictor
from trainers.preset import chosen_preset, read_preset
from trainers.training.fit import FitSettings
from trainers.training.runs import (
    BEST,
    CONFIG,
    LAST,
    METRICS,
    TrainedRun,
    load_run,
    read_config,
    runs_of,
)
from trainers.training.trainer import chosen_lead_s, configure, settings_for, train
from trainers.tuning.conclude import conclude
from trainers.tuning.plan import Plan, make_plan
from trainers.tuning.report import best_of, front_of, importances, rows_of
from trainers.tuning.starts import preset_start
from trainers.tuning.storage import JOURNAL
from trainers.tuning.study import give_back_of_the_dead
from trainers.tuning.workers import Work, run_trials
from wakedeploy.api import training
from wakedeploy.api.scores import ScoreRow, score_row
from wakedeploy.cli import data as data_command
from wakedeploy.cli import sweep as sweep_command
from wakedeploy.core.episodes import (
    DESCRIPTION,
    Channel,
    Episode,
    EpisodeSet,
    read_episode_set,
    stated_sha256,
)
from wakedeploy.core.manifest import PARITY_STEPS
from wakedeploy.core.package import read_package
from wakedeploy.sweep.jobs import Job, Outcome, failure
from wakedeploy.sweep.plan import read_plan
from wakedeploy.sweep.run import sweep

_RATE_HZ, _WINDOW_S, _LEAD_S = 20.0, 0.5, 0.1
_STEPS = 120
_SETTINGS = FitSettings(epochs=2, batch=64, lanes=8, chunk_steps=20)
_SMALL = {"hidden": 4}
_MENDED = 0.75  # of the damaged folders with hashes have them put right


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {
        "episodes": _episodes,
        "episodes-train": _training,
        "run": _run,
        "run-interrupted": _interrupted,
        "preset": _preset,
        "study": _study,
        "study-end": _study_end,
        "sweep-plan": _sweep_plan,
        "sweep-results": _sweep_results,
        "package": _package,
        "package-run": _package_run,
        "c-folder": _c_folder,
    }


@functools.cache
def small_set() -> EpisodeSet:
    """A set whose force is a late echo of an input, small enough to train on in a second."""
    rng = np.random.default_rng(0)
    names = {"a": "train", "b": "train", "c": "validation", "d": "test"}
    episodes = tuple(_episode(name, rng) for name in names)
    return EpisodeSet(
        domain="gantry",
        rate_hz=_RATE_HZ,
        observation=(Channel("u", "N"), Channel("idle", "1")),
        force=(Channel("f_n", "N"),),
        window_s=_WINDOW_S,
        loss_weights=(1.0,),
        split=names,
        episodes=episodes,
        provenance={
            "default_lead_s": _LEAD_S,
            "recordings": {s: {"files": 1, "independent": 1} for s in set(names.values())},
            "groups": dict.fromkeys(names, "all"),
            "own_motion": ["u"],
        },
    )


def _episode(name: str, rng: np.random.Generator, steps: int = _STEPS) -> Episode:
    u = np.convolve(rng.normal(size=steps + 10), np.full(5, 0.4), "valid")[: steps + 6]
    observation = np.stack([u[6:], rng.normal(size=steps)], axis=1)
    force = 0.1 * (u[:-6] + u[:-6] ** 2)[:, None]
    extras = {"observer_n": force.astype(np.float32)} if name == "a" else {}
    return Episode(name, observation.astype(np.float32), force.astype(np.float32), extras)


@functools.cache
def set_files() -> Files:
    """The set as a folder."""
    with tempfile.TemporaryDirectory() as place:
        small_set().write(Path(place))
        return taken(Path(place))


def _episodes() -> Kind:
    ways = {"*.npz": npz_file, "*.json": json_file}
    sound = (set_files(),)
    return Kind("episodes", "episode sets", sound, _show_set, ways, mend_set)


def _show_set(folder: Path) -> None:
    """As `data show` does, and a sweep that finds the set there."""
    with spoken():
        data_command._describe(read_episode_set(folder), folder, None)
    stated_sha256(folder)


def _training() -> Kind:
    ways = {"*.npz": npz_file, "*.json": json_file}
    sound = ({f"set/{name}": content for name, content in set_files().items()},)
    return Kind("episodes-train", "episode sets, trained on", sound, _train_on, ways,
                lambda draw, files: mend_set(draw, files, "set/"), names=("This ", "fit"),
                writes=True)  # fmt: skip


def _train_on(folder: Path) -> None:
    """As `train` does, for an epoch."""
    data = read_episode_set(folder / "set")
    lead_s = chosen_lead_s(data, None)
    settings = dataclasses.replace(_SETTINGS, epochs=1)
    config = configure(data, "gru", seed=0, lead_s=lead_s, hyper=_SMALL, settings=settings)
    run = train(config, data, folder / "runs")
    _row(run).as_json()


def _row(run: TrainedRun) -> ScoreRow:
    """As `train` tells of a run."""
    tested = run.metrics.test
    return score_row(run, "test", tested.rmse, tested.r2, run.metrics.seconds)


def mend_set(draw: random.Random, files: dict[str, bytes], folder: str = "") -> None:
    """Hashes that fit the damaged arrays and the damaged description, as a forger would do."""
    if draw.random() > _MENDED:
        return
    try:
        document = json.loads(files[folder + DESCRIPTION])
        for entry in document["episodes"]:
            content = files[folder + entry["file"]]
            entry["sha256"] = hashlib.sha256(content).hexdigest()
        plain = {key: value for key, value in document.items() if key != "checksum"}
        told = json.dumps(plain, sort_keys=True, separators=(",", ":"))
        document["checksum"] = hashlib.sha256(told.encode()).hexdigest()
        files[folder + DESCRIPTION] = as_json(document)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return


@functools.cache
def _trained(arch: str) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as place:
        data = small_set()
        hyper = {"neurons": 12} if arch == "esn" else _SMALL
        config = configure(data, arch, seed=0, lead_s=_LEAD_S, hyper=hyper, settings=_SETTINGS)
        folder = train(config, data, Path(place)).folder
        return taken(folder)


def _run() -> Kind:
    ways = {"*.safetensors": safetensors_file, "*.json": json_file}
    sound = tuple(
        {name: _trained(arch)[name] for name in (CONFIG, METRICS, BEST)} for arch in ("gru", "esn")
    )
    return Kind("run", "run folders", sound, _read_run, ways, _mend_run)


def _read_run(folder: Path) -> None:
    """As `export` and `evaluate` do."""
    (found,) = runs_of(folder)
    run = load_run(found)
    _row(run).as_json()


def _mend_run(draw: random.Random, files: dict[str, bytes]) -> None:
    """The weights' hash, as the metrics state it."""
    if draw.random() > _MENDED:
        return
    try:
        metrics = json.loads(files[METRICS])
        metrics["weights_sha256"] = hashlib.sha256(files[BEST]).hexdigest()
        files[METRICS] = as_json(metrics)
    except (ValueError, KeyError, TypeError, RecursionError):
        return


def _interrupted() -> Kind:
    ways = {"*.safetensors": safetensors_file, "*.json": json_file}
    kept = {name: _trained("gru")[name] for name in (CONFIG, LAST, BEST)}
    prefix = "gantry/gru/s0/"
    sound = ({prefix + name: content for name, content in kept.items()},)
    return Kind("run-interrupted", "runs to go on with", sound, _go_on, ways, writes=True)


def _go_on(folder: Path) -> None:
    """As `train` does with a run that was stopped: pictures, then the rest."""
    data, place = small_set(), folder / "gantry/gru/s0"
    config = configure(data, "gru", seed=0, lead_s=_LEAD_S, hyper=_SMALL, settings=_SETTINGS)
    if read_config(place) == config:
        train(config, data, folder)


@functools.cache
def _plan_of_study(*asked: str) -> Plan:
    return make_plan(
        small_set(), "gru", lead_s=_LEAD_S, epochs=2, budget=3000, objective=("rmse",), seed=1,
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
        preset = training.usable_preset(asked, "gru", small_set(), _LEAD_S, click.echo)
    assert preset is not None
    settings = settings_for("gru", epochs=None, learning_rate=None, others=preset.settings)
    configure(small_set(), "gru", seed=0, lead_s=_LEAD_S, hyper=preset.hyper, settings=settings)
    preset_start(
        _plan_of_study("hidden=4:192"), asked, chosen_preset(asked, "gru", "gantry") or preset
    )


def _study() -> Kind:
    kept = {f"tuned/{JOURNAL}": _tuned()[f"tuned/{JOURNAL}"]}
    ways = {"*.journal": json_lines}
    return Kind("study", "study journals", (kept,), _go_on_tuning, ways, writes=True)


def _go_on_tuning(folder: Path) -> None:
    """As `tune` does before its next trial, and with what it tells."""
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

    names = ("--retry-failed",)  # that jobs have failed is told of no file
    return Kind("sweep-results", "sweep results", (kept,), go_on, ways, names=names, writes=True)


def _as_done(row: dict[str, object]) -> dict[str, object]:
    """A row as a finished training leaves it."""
    scores = {"rmse": {"f_n": 0.1}, "r2": {"f_n": 0.9}}
    told = {"trainable": 99, "frozen": 0, "epochs": 2, "best_epoch": 1, "validation": scores}
    told |= {"test": scores, "test_r2_ceiling": None, "device": "cpu", "run": "runs/x"}
    return row | {"state": "done", "reason": None, "seconds": 1.5} | told


@functools.cache
def _packages() -> tuple[Files, ...]:
    made, long = [], (_episode("long", np.random.default_rng(1), PARITY_STEPS),)
    for arch in ("gru", "esn"):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            put(folder / "run", _trained(arch))
            run, path = load_run(folder / "run"), folder / "p.onnx"
            force = force_channels(run.config.force, [e.force for e in long])
            export_predictor(run.predictor, run.config, force, long, path, test=run.metrics.test)
            made.append({"p.onnx": (folder / "p.onnx").read_bytes()})
    return tuple(made)


def _package() -> Kind:
    ways = {"*.onnx": onnx_file}
    return Kind("package", "packages", _packages(), lambda f: read_package(f / "p.onnx"), ways)


def _package_run() -> Kind:
    ways = {"*.onnx": onnx_file}
    return Kind("package-run", "packages, run", _packages(), _step, ways, names=("",))


@functools.cache
def _c_folders() -> tuple[Files, ...]:
    """The package's smaller one as C."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        put(folder, _packages()[0])
        made = export_c(read_package(folder / "p.onnx"), folder / "c", Wish())
        return ({path.name: path.read_bytes() for path in made.path.iterdir()},)


def _c_folder() -> Kind:
    return Kind("c-folder", "folders of C", _c_folders(), read_c_folder)


def _step(folder: Path) -> None:
    """As a flight begins: a session, and its first steps."""
    package = read_package(folder / "p.onnx")
    predictor = PackagePredictor(package)
    for observation in package.example.observation[:3]:
        predictor.step(observation)
