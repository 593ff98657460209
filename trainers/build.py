"""The eight architectures by name, built to fit a domain and kept under the parameter budget."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from trainers.agile_mlp import AgileMlp, AgileMlpHyper
from trainers.cross_attention import CrossAttention, CrossAttentionHyper
from trainers.delay_embedding import DelayEmbedding, DelayEmbeddingHyper
from trainers.esn import Esn, EsnHyper
from trainers.gru import Gru, GruHyper
from trainers.history_mlp import HistoryMlp, HistoryMlpHyper
from trainers.mamba import Mamba, MambaHyper
from trainers.memory import Sizes
from trainers.model import WakeModel
from trainers.tcn import Tcn, TcnHyper
from wakedeploy.episodes import window_shape
from wakedeploy.errors import UnusableInput

PARAMETER_BUDGET = 100_000  # trainable weights must stay below this (paper, § Model Architectures)


@dataclass(frozen=True)
class Architecture:
    """A core and its hyper-parameters, both classes, and the peak learning rate that suits it."""

    core: type[WakeModel]
    hyper: type[Any]
    learning_rate: float = 3e-3


ARCHITECTURES: dict[str, Architecture] = {
    "agile-mlp": Architecture(AgileMlp, AgileMlpHyper),
    "history-mlp": Architecture(HistoryMlp, HistoryMlpHyper),
    "delay-embedding": Architecture(DelayEmbedding, DelayEmbeddingHyper),
    "gru": Architecture(Gru, GruHyper),
    "tcn": Architecture(Tcn, TcnHyper),
    "mamba": Architecture(Mamba, MambaHyper, learning_rate=1e-2),
    "esn": Architecture(Esn, EsnHyper),
    "cross-attention": Architecture(CrossAttention, CrossAttentionHyper),
}


def build(
    arch: str,
    *,
    inputs: int,
    outputs: int,
    window_s: float,
    rate_hz: float,
    hyper: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> WakeModel:
    """A core with freshly drawn weights, the same for the same seed.

    `hyper` overrides single values of the architecture's reference hyper-parameters. Raises
    UnusableInput for an unknown name, an unknown or impossible hyper-parameter, and for a model
    of PARAMETER_BUDGET trainable parameters or more.
    """
    k, stride = window_shape(window_s, rate_hz)
    sizes = Sizes(inputs, outputs, k, stride, rate_hz)
    values = hyper_parameters(arch, hyper or {})
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        core = ARCHITECTURES[arch].core(sizes, values)
    return _within_budget(arch, core)


def hyper_parameters(arch: str, overrides: Mapping[str, Any]) -> Any:
    """The architecture's hyper-parameters with some values replaced; UnusableInput for others."""
    if arch not in ARCHITECTURES:
        raise UnusableInput(f"There is no architecture '{arch}'; choose {_names(ARCHITECTURES)}.")
    defaults = ARCHITECTURES[arch].hyper()
    known = dataclasses.asdict(defaults)
    for name, value in overrides.items():
        if name not in known:
            raise UnusableInput(f"{arch} has no hyper-parameter '{name}'; it has {_names(known)}.")
        _check_value(arch, name, value, known[name])
    return dataclasses.replace(defaults, **overrides)


def _check_value(arch: str, name: str, value: Any, default: Any) -> None:
    """Counts are whole and positive; everything else is a finite number of 0 or more."""
    if value is None and default is None:
        return
    count = isinstance(default, int)
    usable = isinstance(value, int if count else (int, float)) and not isinstance(value, bool)
    if not usable or not (1 if count else 0) <= value < float("inf"):
        bound = "a whole number of at least 1" if count else "a number of at least 0"
        raise UnusableInput(f"{arch}: {name} = {value!r} has to be {bound}.")


def _within_budget(arch: str, core: WakeModel) -> WakeModel:
    if core.trainable >= PARAMETER_BUDGET:
        raise UnusableInput(
            f"{arch} would have {core.trainable:,} trainable parameters, and the budget is fewer"
            f" than {PARAMETER_BUDGET:,}; choose smaller hyper-parameters."
        )
    return core


def _names(names: Mapping[str, Any]) -> str:
    return ", ".join(names)
