"""Train predictors on a set of episodes, and score them on its test episodes."""

import functools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from wakedeploy.api.arguments import (
    MOST_PROCESSES,
    MOST_SEEDS,
    in_python,
    one_of,
    real,
    whole,
    words,
)
from wakedeploy.api.inputs import PathLike, episode_set
from wakedeploy.api.scores import ScoreRow, Scores, Shown, about_run, score_row
from wakedeploy.core.caller import Warn, warn_caller
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.few_samples import few_samples
from wakedeploy.core.files import path_from
from wakedeploy.core.names import ALL, architectures, meant, unknown
from wakedeploy.core.spikes import on_spikes
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    import pandas

    from trainers.preset import Preset
    from trainers.trackers import Tracker
    from trainers.trained_run import TrainedRun
    from trainers.training.runs import RunConfig
    from trainers.training.score import Score
    from wakedeploy.core.episodes import EpisodeSet

_CHANNEL_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}")  # as packages and C have them


class Runs(Sequence["TrainedRun"]):
    """Trained runs with their errors on the test episodes.

    `runs[0]` is the first, `runs["gru"]` the first of an architecture. `folder` is where they lie,
    `scores` their errors: RMSE in the unit of each force channel (N for forces), R² without one.
    `run.predict(observations)` of each gives forces (T, o) for observations (T, d), `run.plot()` a
    test episode and its prediction. KeyError for an architecture that was not trained.
    """

    def __init__(self, runs: Sequence["TrainedRun"], folder: Path, scores: Scores) -> None:
        self._runs, self.folder, self.scores = tuple(runs), folder, scores

    def __len__(self) -> int:
        return len(self._runs)

    @overload
    def __getitem__(self, which: int | str) -> "TrainedRun": ...
    @overload
    def __getitem__(self, which: slice) -> "tuple[TrainedRun, ...]": ...
    def __getitem__(self, which: int | str | slice) -> "TrainedRun | tuple[TrainedRun, ...]":
        if not isinstance(which, str):
            return self._runs[which]
        found = next((run for run in self._runs if run.config.arch == which), None)
        if found is None:
            trained = ", ".join(dict.fromkeys(run.config.arch for run in self._runs))
            raise KeyError(f"{which!r} was not trained; there are {trained}")
        return found

    def to_pandas(self, rows: Shown = "runs") -> "pandas.DataFrame":
        """A row per run or per episode, as `Scores.to_pandas`. UnusableInput without pandas."""
        return self.scores.to_pandas(rows)

    def __repr__(self) -> str:
        return f"<Runs in {self.folder}: {self.scores!r}>"

    def _repr_html_(self) -> str:
        return self.scores._repr_html_()


@dataclass(frozen=True)
class _Manner:
    """How each run is trained, and who hears of it."""

    out: Path
    tracker: "Tracker | None"
    fresh: bool
    device: str
    pictures: bool
    progress: Progress
    warn: Warn
    baselines: "Callable[[int], Mapping[str, Score]]"  # takes the samples of warm-up


@in_python
def train(
    data: "EpisodeSet | PathLike",
    arch: str | Sequence[str] | None = None,
    *,
    seeds: int = 1,
    lead_s: float | None = None,
    out: PathLike = "runs",
    epochs: int | None = None,
    learning_rate: float | None = None,
    hyper: Mapping[str, Any] | None = None,
    preset: str = "reference",
    threads: int = 1,
    device: str = "auto",
    fresh: bool = False,
    tracker: str | None = None,
    pictures: bool = True,
    progress: Progress = quiet,
    warn: Warn = warn_caller,
) -> Runs:
    """Fit one, several or all architectures on the training episodes of a set.

    A run that is finished with the same data and settings is not trained again, and one that was
    stopped goes on. Of an episode a predictor sees observations (T, d) and learns forces (T, o), in
    the units of the set's channels. All scores are of the same samples: where a predictor looks
    back further than the set's `window_s` [s], they begin once its memory is full.

    Args:
        data: A set, or the folder of one.
        arch: A name, several, or "all". Default: all, or the one of the preset's file.
        seeds: How many runs of each architecture, seeds 0, 1, …
        lead_s: Predict the force this many seconds ahead. Default: what the set states, or 0.
        out: The folder of all runs; each lies in `<domain>/<arch>/s<seed>`.
        epochs: Default: 60, or those of the preset. A finished run is not lengthened.
        learning_rate: Its peak. Default: 0.003, Mamba 0.01.
        hyper: Changed hyper-parameters, `{"gru.hidden": 48}`; of a single architecture also
            `{"hidden": 48}`.
        preset: "reference" (the paper's shapes), "tuned" (those that ship for the set's domain) or
            the file that `tune` wrote: its shape, and its fit with the search's epochs.
        threads: CPU threads of torch meanwhile. On the CPU the same number gives the same weights.
        device: "auto", "cpu" or "cuda".
        fresh: Replace runs that lie in `out` already.
        tracker: "tensorboard" or "mlflow": also report losses, scores and pictures to it.
        pictures: Draw `curves.png` and `prediction.png` into the folder of each run, and write its
            page, `report.html`.
        progress: Called with a stage, the epochs done and their number.
        warn: Called with what you should know, in a sentence. Default: Python's warnings.

    Returns:
        The runs, architecture by architecture.

    Raises:
        UnusableInput: The set, a name or a setting cannot be used; the sentence says what to do.
        CheckFailed: A fit diverged.
    """
    from trainers.bounds import MOST_EPOCHS
    from trainers.preset import REFERENCE, TUNED, read_preset
    from trainers.trackers import TRACKERS
    from trainers.training.baselines import baselines
    from trainers.training.runs import LONGEST_LEAD_S, require_same
    from trainers.training.trainer import chosen_lead_s

    seeds, threads = (
        whole("seeds", seeds, 1, MOST_SEEDS),
        whole("threads", threads, 1, MOST_PROCESSES),
    )
    if lead_s is not None:
        lead_s = real("lead_s", lead_s, 0.0, LONGEST_LEAD_S)
    if epochs is not None:
        epochs = whole("epochs", epochs, 1, MOST_EPOCHS)
    if tracker is not None:
        tracker = one_of("tracker", tracker, TRACKERS)
    folder = path_from(out, "out")
    data = episode_set(data)
    require_names(data)
    of_preset = architectures() if preset in (REFERENCE, TUNED) else None
    names = _names(arch) or of_preset or (read_preset(path_from(preset, "preset")).arch,)
    changed = _changed(hyper or {}, names)
    lead_s = chosen_lead_s(data, lead_s)
    presets = {name: usable_preset(preset, name, data, lead_s, warn) for name in names}
    configs = _configs(data, presets, changed, (seeds, lead_s, epochs, learning_rate))
    for config in () if fresh else configs:  # before the first of them takes its minutes
        require_same(folder, config)
    _warn_of_long_memory(configs, data, warn)
    _warn_of_few_samples(configs, data, warn)
    for sentence in on_spikes(data):
        warn(sentence)
    opened = _opened(tracker, folder, warn)
    beside = functools.cache(lambda warm_up: baselines(data, "test", lead_s, warm_up))
    manner = _Manner(folder, opened, fresh, device, pictures, progress, warn, beside)
    with _threads(threads):
        runs = [
            _trained(config, data, manner, f"{number} of {len(configs)}")
            for number, config in enumerate(configs, 1)
        ]
        warm_up = max(config.warm_up_steps for config in configs)
        rows = tuple(_test_row(run, data, warm_up) for run in runs)
        scores = Scores(rows, {lead_s: beside(warm_up)}, runs[0].config.force, "test")
        return Runs(runs, folder, scores)


# --- what is trained ----------------------------------------------------------------------------


def _names(arch: str | Sequence[str] | None) -> tuple[str, ...]:
    """The architectures asked for, in the order asked; () where none is."""
    if arch is None:
        return ()
    asked = words("arch", arch)
    if not asked:
        raise UnusableInput("arch is empty: name an architecture, or leave arch out for all.")
    if ALL in asked:
        return architectures()
    found = []
    for name in asked:
        known = meant(name, architectures())
        if known is None:
            raise UnusableInput(f"{unknown(name, 'architecture', architectures())}.")
        found.append(known)
    return tuple(dict.fromkeys(found))


def _changed(hyper: Mapping[str, Any], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The changed hyper-parameters by architecture; each that is trained has an entry."""
    if not isinstance(hyper, Mapping):
        raise UnusableInput(f'hyper is {hyper!r:.60}: give {{"ARCH.NAME": value}}.')
    changed: dict[str, dict[str, Any]] = {name: {} for name in names}
    for key, value in hyper.items():
        if not isinstance(key, str):
            raise UnusableInput(f"hyper has {key!r:.60}: give {{'ARCH.NAME': value}}.")
        given, dot, name = key.rpartition(".")
        arch = meant(given, names) if dot else names[0] if len(names) == 1 else None
        if arch is None:
            raise UnusableInput(
                f"hyper {key}: name the architecture too, ARCH.NAME, one of {', '.join(names)}."
            )
        changed[arch][name] = value
    return changed


def require_names(data: "EpisodeSet") -> None:
    """UnusableInput for a channel's name that no package, and no C, can have."""
    for channel in (*data.observation, *data.force):
        if not _CHANNEL_NAME.fullmatch(channel.name):
            raise UnusableInput(
                f"the channel {channel.name!r:.60} cannot be trained on: call it by letters, digits"
                " and '_', a letter first, at most 100 of them."
            )


def _configs(
    data: "EpisodeSet",
    presets: "Mapping[str, Preset | None]",
    changed: Mapping[str, Mapping[str, Any]],
    asked: tuple[int, float, int | None, float | None],
) -> "list[RunConfig]":
    """What is trained: every architecture with every seed."""
    from trainers.training.trainer import configure, settings_for

    seeds, lead_s, epochs, rate = asked
    configs = []
    for name, preset in presets.items():
        others = preset.settings if preset is not None else None
        settings = settings_for(name, epochs=epochs, learning_rate=rate, others=others)
        shape = {**(preset.hyper if preset else {}), **changed[name]}
        configs += [
            configure(data, name, seed=seed, lead_s=lead_s, hyper=shape, settings=settings)
            for seed in range(seeds)
        ]
    return configs


def usable_preset(
    asked: str, arch: str, data: "EpisodeSet", lead_s: float, warn: Warn
) -> "Preset | None":
    """The preset asked for; warns where it was found for another lead or on another set.

    Two sets of a domain need not be alike: simulated and measured flights are both "gantry".
    """
    from trainers.preset import REFERENCE, chosen_preset

    found = chosen_preset(asked, arch, data.domain)
    if found is None:
        return None
    if found.study.get("ships") == REFERENCE:
        warn(
            f"The tuned preset of {arch} on {data.domain} sets is the paper's shape: what"
            f" {found.study.get('trials')} trials found was no better with other seeds."
        )
        return found
    found_s = found.study.get("lead_s", lead_s)
    if found_s != lead_s:
        warn(
            f"The preset of {arch} was found for a lead of {found_s:g} s; this trains for"
            f" {lead_s:g} s (--lead {found_s:g}, lead_s={found_s:g} in Python, repeats it)."
        )
    if found.study.get("data_sha256") not in (None, data.sha256):
        warn(
            f"The preset of {arch} was found on another set ({found.study.get('data')}, "
            f"{found.study.get('trials')} trials, {found.study.get('date')})."
        )
    return found


def _warn_of_long_memory(configs: "list[RunConfig]", data: "EpisodeSet", warn: Warn) -> None:
    """Say which architectures look back further than the set's window, and what follows."""
    longer = [config for config in configs if config.warm_up_steps > data.warm_up_steps]
    if not longer:
        return
    names = ", ".join(dict.fromkeys(map(_with_history, longer)))
    steps = max(config.warm_up_steps for config in longer)
    warn(
        f"window_s of the set is {data.window_s:g}, and {names} look back further. The scores in"
        f" the table begin {steps} samples ({steps / data.rate_hz:g} s) into each episode, where"
        " every memory is full. Choose a shorter memory, or make the set with a longer window_s, to"
        " compare with other runs."
    )


def _warn_of_few_samples(configs: "list[RunConfig]", data: "EpisodeSet", warn: Warn) -> None:
    """Say where the table's errors, or the choice of the best epoch, rest on few samples."""
    from trainers.training.tape import scored_samples

    late, lead_s = max(config.warm_up_steps for config in configs), configs[0].lead_s
    counts = {s: scored_samples(data, s, lead_s, late) for s in ("validation", "test")}
    if sentence := few_samples(counts):
        warn(sentence)


def _with_history(config: "RunConfig") -> str:
    """An architecture with the length of its memory, where it states that in seconds."""
    history_s = config.hyper.get("history_s")
    return config.arch if history_s is None else f"{config.arch} (history_s = {history_s:g})"


def _opened(tracker: str | None, out: Path, warn: Warn) -> "Tracker | None":
    """The tracker asked for; prints where it keeps what it gets."""
    from trainers.trackers import open_tracker

    if tracker is None:
        return None
    opened = open_tracker(tracker, out)
    warn(opened.whereabouts)
    return opened


# --- training -----------------------------------------------------------------------------------


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let torch compute with `count` threads in the block."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _trained(config: "RunConfig", data: "EpisodeSet", manner: _Manner, number: str) -> "TrainedRun":
    """Train one run and draw it; of one that was interrupted or diverged, what there is."""
    from trainers.inspection.pictures import write_pictures, write_pictures_so_far
    from trainers.inspection.report import write_run_report
    from trainers.trackers import following
    from trainers.training.runs import run_folder
    from trainers.training.trainer import train

    folder = run_folder(manner.out, config)
    epochs = functools.partial(manner.progress, f"Training {config.arch} s{config.seed} ({number})")
    epochs(0, int(config.settings["epochs"]))
    with following(manner.tracker, config, folder, fresh=manner.fresh, warn=manner.warn) as tracked:
        try:
            run = train(
                config, data, manner.out,
                on_epoch=epochs, on_standing=tracked.stands, fresh=manner.fresh,
                device=manner.device,
            )  # fmt: skip
        except (KeyboardInterrupt, CheckFailed):
            _drawn(lambda: write_pictures_so_far(folder, data), manner)
            raise
        run = _with_test_episodes(run, data)
        tracked.finished(run, _drawn(lambda: write_pictures(run, data), manner))
        _drawn(lambda: [write_run_report(run, manner.baselines(config.warm_up_steps))], manner)
    return run


def _with_test_episodes(run: "TrainedRun", data: "EpisodeSet") -> "TrainedRun":
    """A run with its errors in each test episode; of one that was finished before, scored anew.

    Its record stays as it was written.
    """
    from trainers.training.score import score

    if run.metrics.test_episodes:
        return run
    warm_up = run.config.warm_up_steps
    found = score(run.predictor, data, "test", run.config.lead_s, warm_up).episodes
    return replace(run, metrics=run.metrics.model_copy(update={"test_episodes": found}))


def _drawn(write: Callable[[], list[Path]], manner: _Manner) -> list[Path]:
    """What was drawn; a picture that cannot be written costs no result."""
    if not manner.pictures:
        return []
    try:
        return write()
    except UnusableInput as error:
        manner.warn(f"No pictures: {error}")
        return []


def _test_row(run: "TrainedRun", data: "EpisodeSet", warm_up: int) -> ScoreRow:
    """A run's errors after the warm-up of the table, in samples; as recorded where it is its."""
    from trainers.training.score import score

    recorded = run.metrics
    found = (recorded.test.rmse, recorded.test.r2, recorded.test_episodes)
    if warm_up != run.config.warm_up_steps:
        later = score(run.predictor, data, "test", run.config.lead_s, warm_up)
        found = (later.rmse, later.r2, later.episodes)
    return score_row(about_run(run), "test", found, recorded.seconds)
