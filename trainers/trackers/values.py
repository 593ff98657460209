"""What a tracker gets of a run, by the same names in each: settings, epochs, scores, its end."""

import json
import math
import re
from collections.abc import Iterator

from trainers.training.fit import FitSettings, Standing, learning_rate
from trainers.training.runs import RunConfig, RunMetrics
from trainers.training.trainer import idle_settings

Scalar = float | int | str | bool

VALIDATION_LOSS = "loss/validation"
FINISHED, INTERRUPTED, FAILED = "finished", "interrupted", "failed"


def parameters(config: RunConfig) -> dict[str, Scalar]:
    """What the run was asked for: every hyper-parameter, what its fit uses, and on what.

    `hyper.NAME` and `fit.NAME` are those of `config.json`; what is no number or word is JSON.
    """
    idle = idle_settings(config.arch)
    fit = {f"fit.{name}": v for name, v in config.settings.items() if name not in idle}
    numbers = {
        "arch": config.arch,
        "domain": config.domain,
        "seed": config.seed,
        "lead_s": config.lead_s,
        "rate_hz": config.rate_hz,
        "window_s": config.window_s,
        "data_sha256": config.data_sha256,
        "present_only": list(config.present_only),
        **{f"hyper.{name}": value for name, value in config.hyper.items()},
        **fit,
    }
    plain = (int, float, str)
    return {n: v if isinstance(v, plain) else json.dumps(v) for n, v in numbers.items()}


def epochs(
    config: RunConfig, standing: Standing, after: int
) -> Iterator[tuple[int, dict[str, float]]]:
    """What each epoch after that many came to: losses, 1 = predicting the mean, and the rate.

    The learning rate is the one that the epoch began with; a solved readout has none.
    """
    missing = standing.epoch - len(standing.training_history)
    descends = "learning_rate" not in idle_settings(config.arch)
    settings = FitSettings(**config.settings)  # type: ignore[arg-type]
    for epoch in range(after + 1, standing.epoch + 1):
        numbers = {VALIDATION_LOSS: standing.history[epoch - 1]}
        if epoch > missing:
            numbers["loss/training"] = standing.training_history[epoch - missing - 1]
        if descends:
            numbers["learning_rate"] = learning_rate(settings, epoch - 1)
        yield epoch, {name: value for name, value in numbers.items() if math.isfinite(value)}


def finals(metrics: RunMetrics) -> dict[str, float]:
    """How a finished run ended; RMSE in the channels' units."""
    scores = {
        named(split, kind, channel): value
        for split, scores in (("validation", metrics.validation), ("test", metrics.test))
        for kind, values in (("rmse", scores.rmse), ("r2", scores.r2))
        for channel, value in values.items()
        if value is not None
    }
    return {
        **scores,
        "best_epoch": metrics.best_epoch,
        "seconds": metrics.seconds,
        "trainable": metrics.trainable,
        "frozen": metrics.frozen,
    }


def standing_of(metrics: RunMetrics) -> Standing:
    """Where the fit of a finished run stood at its end."""
    learned = tuple(math.nan if loss is None else loss for loss in metrics.training_history)
    return Standing(metrics.history, learned)


def named(*parts: str) -> str:
    """A name that both trackers take: anything else than letters, digits and _ . - becomes _."""
    return "/".join(re.sub(r"[^A-Za-z0-9_.\-]", "_", part) for part in parts)
