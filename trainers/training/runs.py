"""Run folders: `<root>/<domain>/<arch>/s<seed>/`, safetensors and JSON only.

`config.json` says what is trained on what. `last.safetensors` is where an interrupted fit goes on,
`best.safetensors` holds the weights that did best on validation. `metrics.json` closes a finished
run and carries the hash of the weights it speaks of. `trainers.trained_run` reads a finished run,
ready to predict; pictures are drawn by who asks for them (`trainers.inspection.pictures`).
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import safetensors.torch
import torch
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError, model_validator
from safetensors import SafetensorError, safe_open
from torch import Tensor

from trainers.build import build
from trainers.model import Predictor
from trainers.present_only import CODE, present_only
from trainers.training.episode_scores import EpisodeScore
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, write_bytes_whole, write_text_whole
from wakedeploy.core.manifest import ObservationChannel, Quantity, Scores
from wakedeploy.core.processes import unheard
from wakedeploy.core.validation import first_problem

# Goes up when equal configurations are fitted to other weights than before: runs of other revisions
# are refused. A number and not a hash of the source, for no edited comment should cost hours; a
# test holds the fits of this revision against stored ones.
TRAINING = 2

LONGEST_LEAD_S = 3600.0
SHORT_HASH = 16  # digits of an episode's hash that a record keeps; no two episodes share so many

CONFIG, METRICS = "config.json", "metrics.json"
BEST, LAST = "best.safetensors", "last.safetensors"
CURVES, PREDICTION, REPORT = "curves.png", "prediction.png", "report.html"
# Why a run goes on with the epochs that it was begun with.
_ANNEALED = (
    ": the learning rate falls over all epochs of a run, so with another number it is another"
)
# What to do about a run in the way, by the command and from Python.
_ELSEWHERE = "choose another --out (out=), or --fresh (fresh=True) to replace it"


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


AnyRecord = TypeVar("AnyRecord", bound=_Record)


class RunConfig(_Record):
    """What is trained on what; two runs of equal configuration give equal weights.

    `hyper` holds every hyper-parameter of the architecture, `settings` how it is fitted.
    `present_only` are the observation channels whose past is kept from the model. `training` is the
    revision of the code that fits it; runs that do not say are of the first.
    """

    format: Literal[1] = 1
    arch: str
    hyper: dict[str, JsonValue]
    domain: str
    rate_hz: float = Field(gt=0, le=1e5)
    lead_s: float = Field(ge=0, le=LONGEST_LEAD_S)
    window_s: float = Field(gt=0, le=1e3)
    warm_up_steps: int = Field(ge=1, le=10**9)
    observation: tuple[ObservationChannel, ...] = Field(min_length=1)
    force: tuple[Quantity, ...] = Field(min_length=1)
    loss_weights: tuple[Annotated[float, Field(gt=0)], ...]
    data_sha256: str
    seed: int = Field(ge=0, lt=2**63)
    settings: dict[str, float | int]
    present_only: tuple[str, ...] = ()
    training: int = 1

    @model_validator(mode="after")
    def _channels_are_known(self) -> Self:
        unknown = set(self.present_only) - {channel.name for channel in self.observation}
        if unknown:
            raise ValueError(f"present_only names {min(unknown)}, which is not observed")
        if len(self.loss_weights) != len(self.force):
            raise ValueError("loss_weights has to have one weight for each force")
        return self


class RidgeErrors(_Record):
    """What a solved readout's ridge was chosen by: mean squared errors, 1 = predicting the mean.

    By force channel, at each of `strengths`; null where one is not finite.
    """

    strengths: tuple[float, ...]
    training: dict[str, tuple[float | None, ...]]
    validation: dict[str, tuple[float | None, ...]]


class RunMetrics(_Record):
    """How a finished run ended; `history` is the loss on validation after each epoch.

    `training_history` is the loss that each epoch descended, as `Standing` in
    `trainers.training.fit` has it, `ridge` what a solved readout was chosen by. `device` is where
    it was fitted; scores are always computed on the CPU. `test_episodes` are the errors in each
    test episode; records of an earlier version have none, and `wd.train` scores such runs anew.
    `validation_samples` are those that were scored there, None in records of an earlier version.
    `learned_from` has the hashes of the training episodes, `SHORT_HASH` digits of each; records of
    an earlier version have none. `data_folder` is where the set lay, if it was read from a folder.
    """

    finished_utc: str
    seconds: float
    epochs: int
    best_epoch: int
    history: tuple[float, ...]
    training_history: tuple[float | None, ...] = ()
    ridge: RidgeErrors | None = None
    trainable: int
    frozen: int
    validation: Scores
    test: Scores
    test_r2_ceiling: dict[str, float] | None
    test_episodes: tuple[EpisodeScore, ...] = ()
    validation_samples: int | None = None
    learned_from: tuple[str, ...] = ()
    weights_sha256: str
    device: str = "cpu"
    data_folder: str | None = None


def run_folder(root: Path, config: RunConfig) -> Path:
    """Where a run of this configuration belongs."""
    return root / config.domain / config.arch / f"s{config.seed}"


def require_same(root: Path, config: RunConfig) -> None:
    """UnusableRun where a run of another configuration lies in the folder of this one.

    A run is continued with the configuration that it was begun with, or not at all.
    """
    folder = run_folder(root, config)
    if not (folder / CONFIG).exists():
        return
    old, new = _flat(read_config(folder)), _flat(config)
    begun = "trained" if (folder / METRICS).exists() else "begun"
    if old["data_sha256"] != new["data_sha256"]:
        raise UnusableRun(f"{folder} was {begun} on other data; {_ELSEWHERE}.")
    if old["training"] != new["training"]:
        raise UnusableRun(
            f"{folder} was {begun} by other code (revision {old['training']}, this is"
            f" {new['training']}); {_ELSEWHERE}."
        )
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) != new.get(name):
            because = _ANNEALED if name == "epochs" else ""
            raise UnusableRun(
                f"{folder} was {begun} with {name} = {old.get(name)}, not {new.get(name)}{because};"
                f" {_ELSEWHERE}."
            )


def _flat(config: RunConfig) -> dict[str, Any]:
    values = config.model_dump()
    groups = values.pop("hyper") | values.pop("settings")
    return {**values, **groups}


def new_predictor(config: RunConfig) -> Predictor:
    """The untrained predictor of a configuration. Raises UnusableInput beyond the budget."""
    inputs, outputs = len(config.observation), len(config.force)
    core = build(
        config.arch,
        inputs=inputs,
        outputs=CODE if config.present_only else outputs,
        window_s=config.window_s,
        rate_hz=config.rate_hz,
        hyper=config.hyper,
        seed=config.seed,
    )
    if config.present_only:
        names = [channel.name for channel in config.observation]
        hidden = [names.index(name) for name in config.present_only]
        core = present_only(core, hidden, inputs, outputs, config.seed)
    return Predictor(config.arch, core, inputs, outputs)


def require_buildable(config: RunConfig) -> None:
    """Raise UnusableInput for a model beyond the budget, without memory for its weights."""
    with torch.device("meta"):
        new_predictor(config)


def restore_best(predictor: Predictor, folder: Path) -> None:
    """Put the best weights so far into the predictor of a run that need not be finished."""
    tensors, _ = read_tensors(folder / BEST)
    try:
        predictor.load_state_dict(tensors)
    except RuntimeError as error:  # torch's word for missing, foreign and misshapen tensors
        raise damaged(folder / BEST, "its tensors are not those of its config.json") from error


def finished_runs(root: Path) -> list[Path]:
    """The folders of all finished runs at or below `root`, in order of their names.

    Raises UnusableInput when there is none.
    """
    folders = sorted(path.parent for path in root.rglob(METRICS)) if root.is_dir() else []
    folders = [folder for folder in folders if (folder / CONFIG).is_file()]
    if root.suffix == ".onnx" and root.is_file():
        raise UnusableInput(
            f"{root} is a package, and no folder of runs; give the runs that it was exported from."
        )
    if not folders and not root.exists():
        raise UnusableInput(
            f"{root} holds no finished run: there is no such folder; name another one, or make a"
            " run with `wakedeploy train`."
        )
    if not folders:
        raise UnusableInput(f"{root} holds no finished run; make one with `wakedeploy train`.")
    return folders


def runs_of(root: Path, arch: str | None = None) -> list[Path]:
    """The finished runs at or below `root`, of one architecture or of all, the newest last.

    Raises UnusableInput when there is none.
    """
    folders = finished_runs(root)
    if arch is not None:
        folders = [folder for folder in folders if read_config(folder).arch == arch]
    if not folders:
        raise UnusableInput(
            f"{root} holds no finished run of {arch}; make one with `wakedeploy train`."
        )
    return sorted(folders, key=lambda folder: read_metrics(folder).finished_utc)


def read_config(folder: Path) -> RunConfig:
    """The configuration of a run, finished or not."""
    return _read(RunConfig, folder / CONFIG)


def read_metrics(folder: Path) -> RunMetrics:
    """How a finished run ended."""
    return _read(RunMetrics, folder / METRICS)


def write_record(path: Path, record: BaseModel) -> None:
    """Write a configuration or metrics whole."""
    write_text_whole(path, record.model_dump_json(indent=1) + "\n")


def write_tensors(path: Path, tensors: Mapping[str, Tensor], facts: Mapping[str, Any]) -> None:
    """Write tensors with a JSON header in one file, whole or not at all."""
    kept = {name: value.detach().contiguous() for name, value in tensors.items()}
    header = {"facts": json.dumps(facts)}
    data = safetensors.torch.save(kept, header)  # its own writer reports a full disk in its own way
    write_bytes_whole(path, data)


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read what `write_tensors` wrote; UnusableInput when it is damaged or foreign."""
    try:
        # An interruption within the library's own code would become an error of the file.
        with unheard(), safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            facts = json_of((file.metadata() or {})["facts"])
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise damaged(path, one_line(error)) from error
    return tensors, facts


class UnusableRun(UnusableInput):
    """What lies in a run's folder is damaged, or another run: without it, training goes."""


def damaged(path: Path, why: str) -> UnusableRun:
    """The sentence for a checkpoint that cannot be used."""
    return UnusableRun(
        f"{path} is damaged ({why}); train this run again with --fresh (fresh=True)."
    )


def _read(kind: type[AnyRecord], path: Path) -> AnyRecord:
    try:
        return kind.model_validate_json(path.read_bytes())
    except FileNotFoundError as error:
        raise UnusableInput(
            f"{path} does not exist; give the folder of a finished run, or finish it with"
            " `wakedeploy train`."
        ) from error
    except ValidationError as error:
        raise damaged(path, first_problem(error)) from error
    except OSError as error:
        raise UnusableInput(f"{path} cannot be read ({one_line(error)}).") from error
