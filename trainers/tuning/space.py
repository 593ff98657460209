"""What a study searches: the architecture's dimensions, resolved for a set, narrowed by hand."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from optuna.distributions import FloatDistribution
from optuna.trial import FrozenTrial, Trial

from trainers.bounds import check_settings, check_value
from trainers.build import ARCHITECTURES
from trainers.dimensions import HISTORY, Choice, Dimension, Span
from trainers.memory import Sizes
from trainers.training.fit import FitSettings
from wakedeploy.core.episodes import whole_steps, window_shape
from wakedeploy.core.errors import UnusableInput

Point = dict[str, float]

SNAPSHOTS = "snapshots"
_DELAY = "initial_delay_s"
_SHARES = {_DELAY: 0.5, "initial_spread_s": 0.125}  # None stands for, of the window


def search_space(
    arch: str, window_s: float, rate_hz: float, asked: Sequence[str] = ()
) -> tuple[Dimension, ...]:
    """The dimensions of an architecture on a set with this window [s] and rate.

    `asked` narrows or fixes some: NAME=LOW:HIGH, or NAME=VALUE[,VALUE…]. Raises UnusableInput for
    an unknown architecture or dimension, and for values that it cannot have.
    """
    if arch not in ARCHITECTURES:
        known = ", ".join(ARCHITECTURES)
        raise UnusableInput(f"There is no architecture '{arch}'; choose {known}.")
    space = {d.name: _resolved(d, window_s, rate_hz) for d in ARCHITECTURES[arch].dimensions}
    for text in asked:
        name, equals, values = text.partition("=")
        if name not in space:
            raise UnusableInput(
                f"--dimension {text}: {arch} has no dimension '{name}'; it has {', '.join(space)}."
            )
        if not equals:
            raise UnusableInput(
                f"--dimension {text}: write {name}=LOW:HIGH, or {name}=VALUE[,VALUE…]."
            )
        space[name] = _narrowed(arch, space[name], values, text)
    return tuple(space.values())


def suggest(trial: Trial, space: Sequence[Dimension]) -> Point:
    """A point of the space, as the trial's sampler draws it; fixed dimensions are not drawn."""
    return {dimension.name: _suggested(trial, dimension) for dimension in space}


def split(arch: str, point: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """A point's hyper-parameters, and its fit settings.

    Both are drawn by themselves: a delay that begins beyond the point's own history begins at its
    end, since from outside hardly any gradient would lead it back.
    """
    names = _hyper_names(arch)
    hyper = {name: value for name, value in point.items() if name in names}
    if _DELAY in hyper and HISTORY.name in hyper:
        hyper[_DELAY] = min(hyper[_DELAY], hyper[HISTORY.name])
    return hyper, {name: value for name, value in point.items() if name not in names}


def in_effect(arch: str, point: Point, rate_hz: float) -> Point:
    """A point with the values that a model at this rate is built with.

    `snapshots` and `history_s` become those of the window that fits into the samples: a history
    of 15 samples has 16 snapshots, however many more were asked for.
    """
    hyper, settings = split(arch, point)
    snapshots, history_s = hyper.get(SNAPSHOTS), hyper.get(HISTORY.name)
    if snapshots is None or history_s is None:
        return {**hyper, **settings}
    if snapshots >= 2 and whole_steps(history_s * rate_hz) >= 1:  # others are refused when built
        built = Sizes(1, 1, 1, 1, rate_hz).looking_back(history_s, int(snapshots))
        lasts_s = built.window_memory.reach / rate_hz
        hyper |= {SNAPSHOTS: built.k, HISTORY.name: legible(HISTORY.name, lasts_s)}
    return {**hyper, **settings}


def legible(name: str, drawn: float) -> float:
    """To a microsecond, or to four digits: what is drawn is trained with as its preset says it."""
    return round(drawn, 6) if name.endswith("_s") else float(f"{drawn:.4g}")


def trained_point(arch: str, trial: FrozenTrial) -> Point:
    """What a trial that was drawn was trained with, as far as it was drawn."""
    point = {
        name: legible(name, value)
        if isinstance(trial.distributions[name], FloatDistribution)
        else value
        for name, value in trial.params.items()
    }
    hyper, settings = split(arch, point)
    return {name: {**hyper, **settings}[name] for name in point}


def point_of(
    arch: str,
    space: Sequence[Dimension],
    window_s: float,
    rate_hz: float,
    values: Mapping[str, float],
) -> Point:
    """A shape as a point of the space; what `values` does not say is as without a preset.

    On a set with this window [s] and rate. Raises UnusableInput for what the space does not hold.
    """
    usual = dataclasses.asdict(ARCHITECTURES[arch].hyper()) | dict(values)
    window_s = usual.get(HISTORY.name) or window_s
    count, stride = window_shape(window_s, rate_hz)
    lasts_s = (count - 1) * stride / rate_hz  # a whole number of strides, hardly the window itself
    unstated = {name: share * lasts_s for name, share in _SHARES.items()}
    unstated |= {SNAPSHOTS: count, HISTORY.name: window_s}
    if SNAPSHOTS in usual and usual[SNAPSHOTS] is None:
        usual[HISTORY.name] = lasts_s  # as many snapshots fill it evenly
    point = {}
    for dimension in space:
        value = usual[dimension.name]
        if value is None:
            value = unstated[dimension.name]
        if not _holds(dimension, value):
            raise UnusableInput(f"{dimension.name} = {value:g} is not within {dimension}.")
        if isinstance(dimension, Span) or len(dimension.values) > 1:
            point[dimension.name] = value
    return point


def _hyper_names(arch: str) -> set[str]:
    return {field.name for field in dataclasses.fields(ARCHITECTURES[arch].hyper)}


def _resolved(dimension: Dimension, window_s: float, rate_hz: float) -> Dimension:
    """Shares of the window become seconds, to three digits, so that people can read them.

    No history has more snapshots than samples: beyond them another number would change nothing.
    """
    if isinstance(dimension, Span) and dimension.name == SNAPSHOTS:
        samples = math.floor(HISTORY.high * window_s * rate_hz + 1e-6) + 1
        return dataclasses.replace(dimension, high=max(dimension.low, min(dimension.high, samples)))
    if isinstance(dimension, Choice) or not dimension.of_window:
        return dimension
    low, high = (float(f"{bound * window_s:.3g}") for bound in (dimension.low, dimension.high))
    if dimension.name == HISTORY.name:  # one of less than a sample would be none
        low = max(low, legible(HISTORY.name, 1.0 / rate_hz))
    return dataclasses.replace(dimension, low=low, high=high, of_window=False)


def _narrowed(arch: str, dimension: Dimension, values: str, text: str) -> Dimension:
    low, colon, high = values.partition(":")
    parts = (low, high) if colon else values.split(",")
    numbers = [_number(arch, dimension, part, text) for part in parts]
    if not colon:
        return Choice(dimension.name, tuple(dict.fromkeys(numbers)))
    if numbers[0] >= numbers[1]:
        raise UnusableInput(f"--dimension {text}: the lower bound has to be below the upper one.")
    if isinstance(dimension, Choice):
        return Span(dimension.name, numbers[0], numbers[1])
    if dimension.whole and (numbers[0] - dimension.low) % dimension.step:
        raise UnusableInput(
            f"--dimension {text}: {dimension.name} goes up in steps of {dimension.step}; begin at a"
            f" multiple of it, as {dimension.low:g} is."
        )
    log = dimension.log and numbers[0] > 0
    return dataclasses.replace(dimension, low=numbers[0], high=numbers[1], log=log)


def _number(arch: str, dimension: Dimension, part: str, text: str) -> float:
    """One value of a dimension, whole where the dimension is, and possible for what it names."""
    try:
        value = json.loads(part)
    except ValueError as error:
        raise UnusableInput(f"--dimension {text}: '{part}' is not a number.") from error
    usual = ARCHITECTURES[arch].hyper()
    try:
        if value is None:
            raise UnusableInput(f"'{part}' is not a number.")
        if dimension.name in _hyper_names(arch):
            check_value(arch, usual, dimension.name, value)
        else:
            check_settings(dataclasses.asdict(FitSettings()), {dimension.name: value})
    except UnusableInput as error:
        raise UnusableInput(f"--dimension {text}: {error}") from error
    number: float = value if dimension.whole else float(value)
    return number


def _suggested(trial: Trial, dimension: Dimension) -> float:
    if isinstance(dimension, Choice):
        if len(dimension.values) == 1:
            return dimension.values[0]
        chosen: Any = trial.suggest_categorical(dimension.name, dimension.values)
        return float(chosen) if not dimension.whole else int(chosen)
    name, low, high, log = dimension.name, dimension.low, dimension.high, dimension.log
    if dimension.whole:
        return trial.suggest_int(name, int(low), int(high), step=dimension.step, log=log)
    return legible(name, trial.suggest_float(name, low, high, log=log))


def _holds(dimension: Dimension, value: float) -> bool:
    if isinstance(dimension, Choice):
        return value in dimension.values
    on_step = not dimension.whole or (value - dimension.low) % dimension.step == 0
    return dimension.low <= value <= dimension.high and on_step
