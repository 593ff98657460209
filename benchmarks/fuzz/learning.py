"""Kinds of files around learning: episode sets, runs, packages."""

import dataclasses
import functools
import hashlib
import json
import random
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.fuzz.archives import npz_file, safetensors_file
from benchmarks.fuzz.documents import as_json, json_file
from benchmarks.fuzz.kind import Files, Kind, put, spoken, taken
from benchmarks.fuzz.packages import onnx_file
from export.c.packaging import Wish, export_c
from export.limits import force_channels
from export.packaging import export_predictor
from runtime.compiled.folder import read_c_folder
from runtime.predictor import PackagePredictor
from trainers.trained_run import TrainedRun, load_run
from trainers.training.fit import FitSettings
from trainers.training.runs import BEST, CONFIG, LAST, METRICS, read_config, runs_of
from trainers.training.trainer import chosen_lead_s, configure, train
from wakedeploy.api.scores import ScoreRow, about_run, score_row
from wakedeploy.cli import data as data_command
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

_RATE_HZ, _WINDOW_S, LEAD_S = 20.0, 0.5, 0.1
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
            "default_lead_s": LEAD_S,
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
    """A run's scores as `train` prints them."""
    tested = run.metrics.test
    episodes = run.metrics.test_episodes
    found = (tested.rmse, tested.r2, episodes)
    return score_row(about_run(run), "test", found, run.metrics.seconds)


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
        text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
        document["checksum"] = hashlib.sha256(text.encode()).hexdigest()
        files[folder + DESCRIPTION] = as_json(document)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return


@functools.cache
def _trained(arch: str) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as place:
        data = small_set()
        hyper = {"neurons": 12} if arch == "esn" else _SMALL
        config = configure(data, arch, seed=0, lead_s=LEAD_S, hyper=hyper, settings=_SETTINGS)
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
    config = configure(data, "gru", seed=0, lead_s=LEAD_S, hyper=_SMALL, settings=_SETTINGS)
    if read_config(place) == config:
        train(config, data, folder)


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
