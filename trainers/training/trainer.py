"""Train one run in its folder: begin, go on where it was stopped, or take it as it is."""

import dataclasses
import datetime
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from trainers.bounds import check_settings
from trainers.build import ARCHITECTURES, hyper_parameters, unfilled
from trainers.model import Predictor, SolvedModel
from trainers.trained_run import TrainedRun, load_run
from trainers.training.device import choose_device
from trainers.training.fit import Fit, FitSettings, Standing, standing_in
from trainers.training.ridge import STRENGTHS, Solution, solve_readout
from trainers.training.runs import (
    BEST,
    CONFIG,
    CURVES,
    LAST,
    LONGEST_LEAD_S,
    METRICS,
    PREDICTION,
    REPORT,
    SHORT_HASH,
    TRAINING,
    RidgeErrors,
    RunConfig,
    RunMetrics,
    damaged,
    new_predictor,
    read_tensors,
    require_same,
    restore_best,
    run_folder,
    write_record,
    write_tensors,
)
from trainers.training.score import Score, score
from trainers.training.tape import Tape, lay_tape
from wakedeploy.core.episodes import FILTERED, SPLITS, Episode, EpisodeSet
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.files import remove_unfinished, sha256_of
from wakedeploy.core.locks import one_at_a_time
from wakedeploy.core.manifest import ObservationChannel, Quantity, Scores
from wakedeploy.core.validation import first_problem

# Called after each epoch with the epochs done and the epochs asked for.
OnEpoch = Callable[[int, int], None]
# Called after each epoch with where the fit stands, all epochs before this one included.
OnStanding = Callable[[Standing], None]

# What a channel may change by and reach, in its unit. Squares of the smaller one lie eight decades
# above the smallest normal number of float32, so that a ten-thousandth of it still counts. Those of
# the larger one can be summed over any set; it is also the largest error that a record holds.
_SMALLEST, _LARGEST = 1e-15, 1e12
_LEAD_KEY = "default_lead_s"  # what a rig's set states in its provenance


def configure(
    data: EpisodeSet,
    arch: str,
    *,
    seed: int,
    lead_s: float,
    hyper: Mapping[str, Any] | None = None,
    settings: FitSettings | None = None,
    present_only: Sequence[str] = (),
) -> RunConfig:
    """The configuration of a run on this set. Raises UnusableInput for what cannot be built.

    The past of the channels `present_only` is kept from the model. Where the model looks back
    further than the set's window, its warm-up lasts until its memory is full.
    """
    _require_moving_forces(data)
    _require_usual_scale(data)
    unknown = set(present_only) - {c.name for c in data.observation}
    if unknown:
        raise UnusableInput(f"{data.domain} has no channel {', '.join(sorted(unknown))}.")
    if {"/", "\\", "\0"} & set(data.domain) or data.domain in (".", ".."):
        raise UnusableInput(
            f"The domain of the set is {data.domain!r}, and runs are kept in a folder that is "
            "called so; give it a plain name."
        )
    values = dataclasses.asdict(hyper_parameters(arch, hyper or {}))
    try:
        return RunConfig(
            arch=arch,
            hyper=values,
            domain=data.domain,
            rate_hz=data.rate_hz,
            lead_s=lead_s,
            window_s=data.window_s,
            warm_up_steps=_warm_up_steps(data, arch, values),
            observation=_observed(data),
            force=tuple(Quantity(name=c.name, unit=c.unit) for c in data.force),
            loss_weights=data.loss_weights,
            data_sha256=data.sha256,
            seed=seed,
            settings=dataclasses.asdict(settings or settings_for(arch)),
            present_only=tuple(present_only),
            training=TRAINING,
        )
    except ValidationError as error:
        raise UnusableInput(f"This {data.domain} set: {first_problem(error)}.") from error


def settings_for(
    arch: str,
    *,
    epochs: int | None = None,
    learning_rate: float | None = None,
    others: Mapping[str, float] | None = None,
) -> FitSettings:
    """How this architecture is fitted, where nothing else is asked for.

    `others` are settings by name, over which `epochs` and `learning_rate` stand. Raises
    UnusableInput for a name or a value that a setting cannot have.
    """
    usual = FitSettings(learning_rate=ARCHITECTURES[arch].learning_rate)
    asked = {"epochs": epochs, "learning_rate": learning_rate}
    changed = {**(others or {}), **{name: v for name, v in asked.items() if v is not None}}
    check_settings(dataclasses.asdict(usual), changed)
    return dataclasses.replace(usual, **changed)  # type: ignore[arg-type]


def idle_settings(arch: str) -> set[str]:
    """The fit settings that change nothing for an architecture, by its dimensions."""
    if ARCHITECTURES[arch].solved:
        return {field.name for field in dataclasses.fields(FitSettings)}
    searched = {dimension.name for dimension in ARCHITECTURES[arch].dimensions}
    return {"batch", "lanes", "chunk_steps"} - searched


def stated_lead_s(data: EpisodeSet) -> float:
    """The lead in seconds that a set's rig asks for; 0 where the set states none."""
    stated = data.provenance.get(_LEAD_KEY, 0.0)
    if (
        isinstance(stated, bool)
        or not isinstance(stated, int | float)
        or not 0 <= stated <= LONGEST_LEAD_S
    ):
        where = "the set" if data.folder is None else data.folder / "dataset.json"
        raise UnusableInput(
            f"{where}: {_LEAD_KEY} = {repr(stated)[:40]} is no number from 0 to"
            f" {LONGEST_LEAD_S:g}; ask for a lead."
        )
    return float(stated)


def chosen_lead_s(data: EpisodeSet, asked_s: float | None) -> float:
    """The lead in seconds that was asked for, else the one that the set's rig asks for."""
    return stated_lead_s(data) if asked_s is None else asked_s


def train(
    config: RunConfig,
    data: EpisodeSet,
    root: Path,
    *,
    on_epoch: OnEpoch = lambda done, total: None,
    on_standing: OnStanding = lambda standing: None,
    fresh: bool = False,
    device: str = "cpu",
) -> TrainedRun:
    """The finished run of this configuration: as it lies there, continued, or trained anew.

    `device` is "cpu", "cuda" or "auto". On CUDA the same seed gives nearly the same weights, on the
    CPU exactly the same. Raises UnusableRun when the folder holds a run of another configuration
    or a damaged one (unless `fresh`), UnusableInput for a set with too little, or where CUDA is
    asked for in vain; CheckFailed when the fit diverged.
    """
    folder = run_folder(root, config)
    predictor = new_predictor(config)
    device = choose_device(device, predictor, FitSettings(**config.settings))  # type: ignore[arg-type]
    if fresh or not (folder / METRICS).exists():
        # Before anything is written, or of an earlier run goes.
        require_enough(data, config.lead_s, config.warm_up_steps)
    with one_at_a_time(folder):  # of two that train the same, the second finds it done
        remove_unfinished(folder)
        if fresh:
            _clear(folder)
        require_same(root, config)
        if (folder / METRICS).exists():
            return load_run(folder)
        write_record(folder / CONFIG, config)
        if isinstance(predictor.core, SolvedModel):
            ended = _solve(folder, config, data, predictor, device)
            on_epoch(1, 1)
        else:
            callbacks = (on_epoch, on_standing)
            ended = _descend(folder, config, data, predictor, device, *callbacks)
        _finish(folder, config, data, ended, device)
        return load_run(folder)


def tapes(data: EpisodeSet, lead_s: float, warm_up: int | None = None) -> tuple[Tape, Tape]:
    """What is learned from, and what decides when it has been learned.

    Both are scored after `warm_up` samples, None: the set's. Raises UnusableInput where the set has
    too little of either.
    """
    steps = data.warm_up_steps if warm_up is None else warm_up
    return lay_tape(data, "train", lead_s, steps), lay_tape(data, "validation", lead_s, steps)


def require_enough(data: EpisodeSet, lead_s: float, warm_up: int | None = None) -> None:
    """UnusableInput where a split has nothing left after warm-up and lead, or another's episode.

    The warm-up is in samples, None: the set's.
    """
    _require_apart(data)
    steps = data.warm_up_steps if warm_up is None else warm_up
    for split in SPLITS:
        lay_tape(data, split, lead_s, steps)


def new_fit(
    config: RunConfig,
    predictor: Predictor,
    learned: Tape,
    held_out: Tape,
    device: str = "cpu",
) -> Fit:
    """The descent of a configuration, before its first epoch."""
    return Fit(
        predictor,
        learned,
        held_out,
        loss_weights=config.loss_weights,
        warm_up=config.warm_up_steps,
        settings=FitSettings(**config.settings),  # type: ignore[arg-type]
        seed=config.seed,
        device=device,
    )


def _require_moving_forces(data: EpisodeSet) -> None:
    """UnusableInput for a force that is the same in all training episodes."""
    episodes = data.part("train")
    for i, channel in enumerate(data.force):
        first = episodes[0].force[0, i] if episodes else 0.0
        if episodes and all((episode.force[:, i] == first).all() for episode in episodes):
            raise UnusableInput(
                f"{_where(data)}: the force {channel.name} is {first:.6g} {channel.unit} in all"
                " training episodes, which is nothing to learn; give episodes in which it changes,"
                " or leave the channel out."
            )


def _require_apart(data: EpisodeSet) -> None:
    """UnusableInput where an episode of one split lies in another one too, under another name."""
    first: dict[str, Episode] = {}
    copies = []
    for split in SPLITS:
        for episode in data.part(split):
            known = first.setdefault(episode.sha256, episode)
            if data.split[known.name] != split:
                copies.append((known, episode))
    if not copies:
        return
    (known, copy), others = copies[0], len(copies) - 1
    more = f", and {others} more are copies" if others else ""
    raise UnusableInput(
        f"{_where(data)}: the {data.split[copy.name]} episode {copy.name} is the"
        f" {data.split[known.name]} episode {known.name}, sample by sample{more}. Errors on what"
        " was learned say nothing of new recordings; leave copies out, or give them to one split."
    )


def _require_usual_scale(data: EpisodeSet) -> None:
    """UnusableInput for a channel whose numbers float32 cannot square, as training does."""
    for kind, channels in (("observation", data.observation), ("force", data.force)):
        lows, highs = (
            np.array([getattr(e.arrays[kind], bound)(0) for e in data.episodes], float)
            for bound in ("min", "max")
        )  # (E, channels)
        for channel, low, high in zip(channels, lows.min(0), highs.max(0), strict=True):
            spread, most = high - low, max(abs(low), abs(high))
            if most > _LARGEST or 0.0 < spread < _SMALLEST:
                what = f"reaches {most:.3g}" if most > _LARGEST else f"changes by {spread:.3g}"
                raise UnusableInput(
                    f"{_where(data)}: the {kind} {channel.name} {what} {channel.unit}, and what is"
                    f" trained on has to change by {_SMALLEST:g} at least and reach {_LARGEST:g} at"
                    " most, since float32 cannot square more; leave out a channel that is zero but"
                    " for rounding, else use another unit: to = … in"
                    " columns.toml, or other numbers and their unit in the EpisodeSet."
                )


def _where(data: EpisodeSet) -> str:
    """How a set is called in a sentence."""
    return f"This {data.domain} set" if data.folder is None else str(data.folder)


def _tapes_of(config: RunConfig, data: EpisodeSet) -> tuple[Tape, Tape]:
    return tapes(data, config.lead_s, config.warm_up_steps)


def _warm_up_steps(data: EpisodeSet, arch: str, hyper: Mapping[str, Any]) -> int:
    """The set's warm-up, or a longer one where the model's window is full later."""
    sizes = {"inputs": len(data.observation), "outputs": len(data.force)}
    core = unfilled(arch, **sizes, window_s=data.window_s, rate_hz=data.rate_hz, hyper=hyper)
    return max(data.warm_up_steps, core.memory.reach)


def _observed(data: EpisodeSet) -> tuple[ObservationChannel, ...]:
    """The observation channels, the range that each takes in training, and its filter in words."""
    episodes = data.part("train")
    if not episodes:
        raise UnusableInput(f"This {data.domain} set has no training episode; make it longer.")
    filtered = _filtered(data)
    low = [min(float(e.observation[:, i].min()) for e in episodes) for i in _columns(data)]
    high = [max(float(e.observation[:, i].max()) for e in episodes) for i in _columns(data)]
    return tuple(
        ObservationChannel(
            name=c.name, unit=c.unit, min=low[i], max=high[i], filtered=filtered.get(c.name, "")
        )
        for i, c in enumerate(data.observation)
    )


def _filtered(data: EpisodeSet) -> dict[str, str]:
    """How observations of a set were filtered, by their names."""
    stated = data.provenance.get(FILTERED, {})
    if not isinstance(stated, dict) or not all(isinstance(text, str) for text in stated.values()):
        where = "the set" if data.folder is None else data.folder / "dataset.json"
        raise UnusableInput(
            f"{where}: provenance.{FILTERED} has no text for each filtered observation; import the"
            " set again."
        )
    return {name: str(text) for name, text in stated.items()}


def _columns(data: EpisodeSet) -> range:
    return range(len(data.observation))


def _clear(folder: Path) -> None:
    for name in (METRICS, LAST, BEST, CONFIG, CURVES, PREDICTION, REPORT):
        (folder / name).unlink(missing_ok=True)


def _solve(
    folder: Path, config: RunConfig, data: EpisodeSet, predictor: Predictor, device: str
) -> "_Ended":
    """The reservoir's way: one pass, nothing to resume."""
    began = time.monotonic()
    learned, held_out = (tape.to(device) for tape in _tapes_of(config, data))
    loss, found = solve_readout(predictor.to(device), learned, held_out, config.loss_weights)
    write_tensors(folder / BEST, predictor.state_dict(), {"epoch": 1})
    return _Ended(Standing((loss,)), time.monotonic() - began, _ridge_errors(config, found))


def _ridge_errors(config: RunConfig, found: Solution) -> RidgeErrors:
    names = [channel.name for channel in config.force]
    by_channel = [
        {name: _finite(errors) for name, errors in zip(names, table.T.tolist(), strict=True)}
        for table in (found.training, found.validation)
    ]
    return RidgeErrors(strengths=STRENGTHS, training=by_channel[0], validation=by_channel[1])


def _finite(values: Sequence[float]) -> tuple[float | None, ...]:
    """JSON knows no NaN."""
    return tuple(value if math.isfinite(value) else None for value in values)


def _descend(
    folder: Path,
    config: RunConfig,
    data: EpisodeSet,
    predictor: Predictor,
    device: str,
    on_epoch: OnEpoch,
    on_standing: OnStanding,
) -> "_Ended":
    """Epoch by epoch, each saved whole: one file, so that weights and optimiser always agree."""
    fit = new_fit(config, predictor, *_tapes_of(config, data), device=device)
    seconds = _resume(folder / LAST, fit)
    began = time.monotonic() - seconds
    while not fit.finished:
        standing = fit.run_epoch()
        if not math.isfinite(standing.history[-1]):
            raise CheckFailed(
                f"{folder}: training diverged in epoch {standing.epoch}; try --fresh (fresh=True)"
                " with a smaller --learning-rate (learning_rate=)."
            )
        if standing.improved:
            write_tensors(folder / BEST, predictor.state_dict(), {"epoch": standing.epoch})
        facts = {**dataclasses.asdict(standing), "seconds": time.monotonic() - began}
        write_tensors(folder / LAST, fit.tensors(), facts)
        on_standing(standing)
        on_epoch(standing.epoch, fit.settings.epochs)
    return _Ended(fit.standing, time.monotonic() - began)


def _resume(path: Path, fit: Fit) -> float:
    """Go on where the fit was stopped; the seconds it has taken so far."""
    if not path.exists():
        return 0.0
    tensors, facts = read_tensors(path)
    try:
        fit.restore(tensors, standing_in(facts))
        return float(facts["seconds"])
    except (KeyError, ValueError, TypeError, RuntimeError) as error:
        raise damaged(path, "it is not a checkpoint of this run") from error


@dataclasses.dataclass(frozen=True)
class _Ended:
    """How a fit ended, and the seconds that it took."""

    standing: Standing
    seconds: float
    ridge: RidgeErrors | None = None


def _finish(folder: Path, config: RunConfig, data: EpisodeSet, ended: _Ended, device: str) -> None:
    """Score the best weights and close the run."""
    predictor = new_predictor(config)
    restore_best(predictor, folder)
    validation, test = (
        score(predictor, data, split, config.lead_s, config.warm_up_steps)
        for split in ("validation", "test")
    )
    metrics = RunMetrics(
        finished_utc=datetime.datetime.now(datetime.UTC).isoformat(),
        seconds=ended.seconds,
        epochs=ended.standing.epoch,
        best_epoch=ended.standing.best_epoch,
        history=ended.standing.history,
        training_history=_finite(ended.standing.training_history),
        ridge=ended.ridge,
        trainable=predictor.trainable,
        frozen=predictor.frozen,
        validation=_scores(validation, folder),
        test=_scores(test, folder),
        test_r2_ceiling=test.ceiling,
        test_episodes=test.episodes,
        validation_samples=validation.samples,
        learned_from=tuple(episode.sha256[:SHORT_HASH] for episode in data.part("train")),
        weights_sha256=sha256_of((folder / BEST).read_bytes()),
        device=device,
        data_folder=None if data.folder is None else str(data.folder),
    )
    write_record(folder / METRICS, metrics)


def _scores(found: Score, folder: Path) -> Scores:
    """The errors as a record holds them; CheckFailed where they are no numbers."""
    try:
        return Scores(rmse=found.rmse, r2=found.r2)
    except ValidationError as error:
        raise CheckFailed(
            f"{folder}: the errors of the best weights are not finite ({first_problem(error)});"
            " train again with --fresh (fresh=True)."
        ) from error
