"""The architectures by name, built to fit a domain and kept under the parameter budget."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import torch

from trainers.architecture import Architecture
from trainers.bounds import check_hyper
from trainers.memory import Sizes
from trainers.model import WakeModel
from wakedeploy.core.discovery import ARCHITECTURE, offers
from wakedeploy.core.episodes import window_shape
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARAMETER_BUDGET


class _Architectures(Mapping[str, Architecture]):
    """All that are found, in the order of `offers`; each file is imported when it is asked for."""

    def __getitem__(self, name: str) -> Architecture:
        return offers(ARCHITECTURE)[name].load(Architecture)

    def __contains__(self, name: object) -> bool:
        return name in offers(ARCHITECTURE)

    def __iter__(self) -> Iterator[str]:
        return iter(offers(ARCHITECTURE))

    def __len__(self) -> int:
        return len(offers(ARCHITECTURE))


ARCHITECTURES: Mapping[str, Architecture] = _Architectures()


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
    sizes = _sizes(inputs, outputs, window_s, rate_hz)
    values = hyper_parameters(arch, hyper or {})
    _check_budget(arch, sizes, values)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return ARCHITECTURES[arch].core(sizes, values)


def hyper_parameters(arch: str, overrides: Mapping[str, Any]) -> Any:
    """The architecture's hyper-parameters with some values replaced; UnusableInput for others."""
    if arch not in ARCHITECTURES:
        raise UnusableInput(f"There is no architecture '{arch}'; choose {_names(ARCHITECTURES)}.")
    defaults = ARCHITECTURES[arch].hyper()
    known = dataclasses.asdict(defaults)
    for name in overrides:
        if name not in known:
            raise UnusableInput(f"{arch} has no hyper-parameter '{name}'; it has {_names(known)}.")
    check_hyper(arch, defaults, overrides)
    return dataclasses.replace(defaults, **overrides)


def unfilled(
    arch: str,
    *,
    inputs: int,
    outputs: int,
    window_s: float,
    rate_hz: float,
    hyper: Mapping[str, Any] | None = None,
) -> WakeModel:
    """A core whose weights have shapes and no values: what it would train, and remember.

    No memory is taken for it. Raises UnusableInput for what `build` refuses, but for the budget.
    """
    sizes = _sizes(inputs, outputs, window_s, rate_hz)
    return _unfilled(arch, sizes, hyper_parameters(arch, hyper or {}))


def _sizes(inputs: int, outputs: int, window_s: float, rate_hz: float) -> Sizes:
    k, stride = window_shape(window_s, rate_hz)
    return Sizes(inputs, outputs, k, stride, rate_hz)


def _unfilled(arch: str, sizes: Sizes, values: Any) -> WakeModel:
    with torch.device("meta"), torch.random.fork_rng(devices=[]):
        return ARCHITECTURES[arch].core(sizes, values)


def _check_budget(arch: str, sizes: Sizes, values: Any) -> None:
    trainable = _unfilled(arch, sizes, values).trainable
    if trainable >= PARAMETER_BUDGET:
        shape, usual = dataclasses.asdict(values), dataclasses.asdict(hyper_parameters(arch, {}))
        asked = [f"{name} = {value}" for name, value in shape.items() if value != usual[name]]
        of_these = f" with {', '.join(asked)}" if asked else ""
        raise UnusableInput(
            f"{arch}{of_these} would have {trainable:,} trainable parameters, and the budget is"
            f" fewer than {PARAMETER_BUDGET:,}; choose smaller hyper-parameters."
        )


def _names(names: Mapping[str, Any]) -> str:
    return ", ".join(names)
