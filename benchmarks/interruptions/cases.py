"""The commands that are disturbed, what they start from, and what has to come out in the end.

In: a folder. Out: inputs made there by the commands themselves, and a `Case` for each command. What
a case compares is free of times and dates.
"""

import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.interruptions.processes import wakedeploy
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.episodes import stated_sha256
from wakedeploy.core.files import read_json_lines, sha256_of
from wakedeploy.core.package import read_package
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

TESTS = Path(__file__).parents[2] / "tests"
_TIMES = {"seconds", "finished_utc", "host", "data_folder", "date", "commit", "path", "run"}
Words = list[str | Path]


@dataclass(frozen=True)
class Case:
    """A command in an empty folder.

    `read_result` reads what it comes to, of two runs the same. `share` is how often it is disturbed
    beside the others, `kinds` how. `other` are arguments of a second process on the same output. An
    `endless` command is not waited for.
    """

    name: str
    arguments: Words
    read_result: Callable[[Path], Any]
    share: float
    other: Words | None = None
    endless: bool = False
    kinds: tuple[str, ...] = ("kills", "requests", "disks", "twice")


@dataclass(frozen=True)
class World:
    """Inputs of all cases, made once."""

    folder: Path

    def path(self, name: str) -> Path:
        """One of the inputs."""
        return self.folder / name

    def make(self) -> None:
        """Make them with the commands."""
        self.folder.mkdir(parents=True)
        heavier = default_rig().changed(sufferer={"mass_kg": 0.46})
        heavier.write(self.path("heavier.toml"))
        for words in (
            ["rig", "init", "rig.toml"],
            ["data", "make", "gantry", "--minutes", "1", "--out", "set"],
            ["data", "make", "gantry", "--minutes", "2", "--out", "longer"],
            ["train", "--data", "longer", "--arch", "agile-mlp", "--epochs", "2", "--out", "runs"],
            ["export", "--runs", "runs", "--out", "package.onnx"],
            *(_flight("rig", seed) for seed in range(4)),
            *(_flight("heavier", seed) for seed in range(4)),
        ):
            self._do(words)
        _swaps(self.path("swaps"))

    def _do(self, words: list[str]) -> None:
        subprocess.run(
            wakedeploy(*words),
            cwd=self.folder,
            check=True,
            stdout=subprocess.DEVNULL,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )


def cases(world: World) -> list[Case]:
    """Every case but that of `deploy`, which needs a machine to deploy to."""
    data, rig = world.path("set"), world.path("rig.toml")
    logs = [world.path(f"rig-{seed}.mcap") for seed in range(4)]
    others = [world.path(f"heavier-{seed}.mcap") for seed in range(4)]
    tune: Words = ["tune", "--data", data, "--arch", "agile-mlp", "--epochs", "20"]
    tune += ["--trials", "6", "--out", "tuned"]
    close: Words = ["gap", "close", "--out", "gap", "--workers", "2"]
    named: Words = [*close, "--rig", rig, "--measured"]
    fly: Words = ["run-gantry", "--virtual", "--baseline", "--seconds", "12"]
    make: Words = ["data", "make", "gantry", "--minutes", "1", "--out", "set", "--seed"]
    return [
        Case(
            "train",
            ["train", "--data", data, "--arch", "agile-mlp,gru", "--epochs", "15", "--out", "runs"],
            _runs,
            40,
        ),
        Case("tune", tune, _preset, 24),
        Case("tune, two workers", [*tune, "--workers", "2"], _trials, 10),
        Case(
            "sweep",
            [
                *("sweep", "--data", data, "--arch", "agile-mlp,gru", "--epochs", "15"),
                *("--seeds", "2", "--workers", "2", "--out", "sweep"),
            ],
            _rows,
            16,
        ),
        Case("gap close", [*named, *logs[:2]], _gap, 14, other=[*named, *logs[2:]]),
        Case(
            "gap close, thresholds",
            [*close, "--rig", world.path("heavier.toml"), "--measured", *others],
            lambda folder: None,
            6,
            endless=True,
            kinds=("kills", "requests"),
        ),
        Case(
            "export",
            ["export", "--runs", world.path("runs"), "--out", "package.onnx"],
            _package,
            14,
        ),
        Case(
            "calibrate zero",
            ["calibrate", "zero", "--rig", rig, "--virtual", "--out", "desk.toml"],
            lambda folder: (folder / "desk.toml").read_text("utf-8"),
            12,
        ),
        Case("run-gantry", [*fly, "--log", "logs"], _flown, 16),
        Case(
            "run-gantry, real time",
            [*fly[:3], "--seconds", "6", "--wall-clock", "--log", "logs"],
            lambda folder: None,
            4,
            endless=True,  # on a busy machine a flight in real time may end in a failsafe
            kinds=("kills", "requests", "disks"),
        ),
        Case(
            "run-gantry, many flights",
            [*fly, "--flights", "4", "--workers", "2", "--json", "flights.json"],
            lambda folder: json.loads((folder / "flights.json").read_text("utf-8")),
            10,
        ),
        Case("data make", [*make, "0"], _set, 10, other=[*make, "1"]),
        Case(
            "data import",
            ["data", "import", "crazyflie", world.path("swaps"), "--out", "set"],
            _set,
            10,
        ),
        Case(
            "study",
            [
                *("study", "domains", "--domains", "gantry", "--arch", "agile-mlp"),
                *("--quick", "--out", "study"),
            ],
            _study,
            8,
        ),
    ]


@contextlib.contextmanager
def at_a_port() -> Iterator[Case]:
    """A flight at the port of a virtual gantry, in real time; whether it ends well is not asked."""
    with VirtualGantryProcess(default_rig(), seed=0) as gantry:
        words: Words = ["run-gantry", "--baseline", "--trust-curve", "--seconds", "6"]
        words += ["--port", gantry.port, "--range-socket", gantry.range_socket]
        yield Case("run-gantry, one port", words, lambda folder: None, 4, None, True, ("twice",))


@contextlib.contextmanager
def deploying(world: World, folder: Path) -> Iterator[Case]:
    """The case of `deploy`, to an sshd of this machine whose rig is in `folder`."""
    for path in (TESTS, TESTS / "deployment"):
        if str(path) not in sys.path:
            sys.path.append(str(path))
    from rig_over_ssh import running_rig

    folder.mkdir(parents=True)
    with running_rig(folder) as rig:
        words: Words = ["deploy", "rig", world.path("package.onnx"), "-F", rig.config]
        words += ["--directory", rig.site, "--command", rig.command]

        def read_links(_: Path) -> Any:
            """Where the links lead; what they lead to has to pass its reader."""
            links = rig.links()
            for link in links:
                read_package(rig.site / f"{link}.onnx")
            return links

        yield Case("deploy", words, read_links, 10, kinds=("kills", "requests", "twice"))


def _flight(rig: str, seed: int) -> list[str]:
    fly = ["run-gantry", "--virtual", "--baseline", "--rig", f"{rig}.toml", "--seconds", "12"]
    return [*fly, "--seed", str(seed), "--log", f"{rig}-{seed}.mcap"]


def _swaps(folder: Path) -> None:
    """Recordings of five flights of two Crazyflies, as `data import` reads them, made of noise."""
    folder.mkdir()
    rng, n = np.random.default_rng(0), 400
    widths = {"pos": 3, "vel": 3, "acc": 3, "motor_thrust": 4, "pwm": 4}
    for flight in range(5):
        columns = {"t": 0.01 * np.arange(n)}
        for drone in "ab":
            columns |= {f"{drone}_{k}": 0.1 * rng.random((n, w)) for k, w in widths.items()}
            columns[f"{drone}_quat_xyzw"] = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
            columns[f"{drone}_vbat"] = np.full((n, 1), 3.7)
        np.savez(folder / f"swap_ss_{flight}.npz", **columns)


def _runs(folder: Path) -> Any:
    """Every run's scores, and the hash of its weights."""
    found = sorted(folder.rglob("metrics.json"))
    return {str(path.relative_to(folder)): _timeless(path) for path in found}


def _timeless(path: Path) -> Any:
    return _without_times(json.loads(path.read_text("utf-8")))


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_times(v) for k, v in value.items() if k not in _TIMES}
    return [_without_times(v) for v in value] if isinstance(value, list) else value


def _preset(folder: Path) -> Any:
    """What a study found, and its run; a trial that was begun again has another number."""
    preset = tomllib.loads((folder / "tuned" / "best.toml").read_text("utf-8"))
    error = preset.pop("study")["validation_error"]
    return [preset, error, _runs(folder / "tuned")]


def _trials(folder: Path) -> Any:
    """How many trials a study counts; which comes first is chance with two workers."""
    preset = tomllib.loads((folder / "tuned" / "best.toml").read_text("utf-8"))
    return preset["study"]["trials"]


def _rows(folder: Path) -> Any:
    rows = read_json_lines(folder / "sweep" / "results.jsonl")
    last = {row["identity"]: _without_times(row) for row in rows}
    return [dict(sorted(last.items())), _runs(folder / "sweep")]


def _gap(folder: Path) -> Any:
    steps = ("find", "name", "show", "result")
    by_step = {step: _timeless(folder / "gap" / f"{step}.json") for step in steps}
    page = (folder / "gap" / "report.html").read_bytes()
    return [by_step, sha256_of(page)]


def _package(folder: Path) -> Any:
    return sha256_of((folder / "package.onnx").read_bytes())


def _flown(folder: Path) -> Any:
    """What the newest recording has in it; those of flights that were stopped can be read, too.

    A hidden file is one that was killed before it had its name.
    """
    paths = sorted(path for path in (folder / "logs").glob("*.mcap") if path.name[0] != ".")
    rows = [list(read_run_log(path).rows()) for path in paths]
    return hashlib.sha256(repr(rows[-1]).encode()).hexdigest()


def _set(folder: Path) -> Any:
    files = sorted(path.name for path in (folder / "set").glob("*.npz"))
    return [stated_sha256(folder / "set"), files]


def _study(folder: Path) -> Any:
    return [_timeless(path) for path in sorted(folder.rglob("study.json"))]
