"""What a trial of `tune` would cost as C: flash, RAM or instructions, by the objective's name."""

from collections.abc import Callable

from export.c.cost import CCost, c_cost
from export.step_time import unproved_package
from trainers.model import Predictor
from trainers.training.runs import RunConfig
from wakedeploy.core.manifest import FloatArray


def flash_bytes(predictor: Predictor, config: RunConfig, observations: FloatArray) -> float:
    """Bytes of flash for its weights."""
    return float(_cost(predictor, config).flash_bytes)


def ram_bytes(predictor: Predictor, config: RunConfig, observations: FloatArray) -> float:
    """Bytes of RAM for its state and a step's arrays."""
    return float(_cost(predictor, config).ram_bytes)


def instructions(predictor: Predictor, config: RunConfig, observations: FloatArray) -> float:
    """Instructions of a step on a Cortex-M4F, estimated."""
    return float(_cost(predictor, config).instructions)


MEASURES: dict[str, Callable[[Predictor, RunConfig, FloatArray], float]] = {
    "flash": flash_bytes,
    "ram": ram_bytes,
    "instructions": instructions,
}


def _cost(predictor: Predictor, config: RunConfig) -> CCost:
    return c_cost(unproved_package(predictor, config))
