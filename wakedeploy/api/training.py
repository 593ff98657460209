"""Train predictors on a set of episodes, and score finished runs on any set that fits them."""

import functools
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from wakedeploy.api.arguments import MOST_PROCESSES, MOST_SEEDS, in_python, real, whole, words
from wakedeploy.api.inputs import PathLike, episode_set
from wakedeploy.api.scores import ScoreRow, Scores, Shown, score_row
from wakedeploy.core.caller import Warn, warn_caller
from wakedeploy.core.errors import CheckFailed, OutOfRange, UnusableInput
from wakedeploy.core.few_samples import few_samples
from wakedeploy.core.names import ALL, architectures, meant, unknown
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    import pandas

    from trainers.preset import Preset
    from trainers.trackers import Tracker
    from trainers.trained_run import TrainedRun
    from trainers.training.runs import RunConfig
    from trainers.training.score import Score
    from wakedeploy.core.episodes import Episode, EpisodeSet


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
    from trainers.training.baselines import baselines
    from trainers.training.runs import LONGEST_LEAD_S
    from trainers.training.trainer import chosen_lead_s

    seeds, threads = (
        whole("seeds", seeds, 1, MOST_SEEDS),
        whole("threads", threads, 1, MOST_PROCESSES),
    )
    if lead_s is not None:
        lead_s = real("lead_s", lead_s, 0.0, LONGEST_LEAD_S)
    if epochs is not None:
        epochs = whole("epochs", epochs, 1, MOST_EPOCHS)
    data = episode_set(data)
    of_preset = architectures() if preset in (REFERENCE, TUNED) else None
    names = _names(arch) or of_preset or (read_preset(Path(preset)).arch,)
    changed = _changed(hyper or {}, names)
    lead_s = chosen_lead_s(data, lead_s)
    presets = {name: usable_preset(preset, name, data, lead_s, warn) for name in names}
    configs = _configs(data, presets, changed, (seeds, lead_s, epochs, learning_rate))
    _warn_of_long_memory(configs, data, warn)
    _warn_of_few_samples(configs, data, warn)
    opened = _opened(tracker, Path(out), warn)
    beside = functools.cache(lambda warm_up: baselines(data, "test", lead_s, warm_up))
    manner = _Manner(Path(out), opened, fresh, device, pictures, progress, warn, beside)
    with _threads(threads):
        runs = [
            _trained(config, data, manner, f"{number} of {len(configs)}")
            for number, config in enumerate(configs, 1)
        ]
        warm_up = max(config.warm_up_steps for config in configs)
        rows = tuple(_test_row(run, data, warm_up) for run in runs)
        scores = Scores(rows, {lead_s: beside(warm_up)}, runs[0].config.force, "test")
        return Runs(runs, Path(out), scores)


@in_python
def evaluate(
    runs: "Runs | TrainedRun | Sequence[TrainedRun] | PathLike",
    data: "EpisodeSet | PathLike",
    split: str = "test",
    *,
    progress: Progress = quiet,
    warn: Warn = warn_caller,
) -> Scores:
    """Score finished runs on the episodes of a set.

    Every run is asked for the force (T, o) at its own lead [s]; all are scored on the same samples,
    after one common warm-up.

    Args:
        runs: What `train` returned, one run of it, or a folder: every finished run below counts.
        data: A set, or the folder of one; its channels and rate have to be the runs'.
        split: "train", "validation", "test" or "all".
        progress: Called with a stage, the runs done and their number.
        warn: Called with a sentence about runs in a folder that do not fit the set, about episodes
            that they learned from, and about channels that have other values than in training.
            Default: Python's warnings, the last by `wd.OutOfRange`.

    Returns:
        RMSE in the unit of each channel and R², a row per run in the order of the paper's table,
        the error of each run in each episode, and that of baselines. Those that learn stand beside
        runs that were trained on this very set.

    Raises:
        UnusableInput: There is no finished run, none fits the set, or the split has no episode that
            is long enough.
    """
    place = data
    data = episode_set(data)
    trained = _trained_runs(runs, data, place, progress, warn)
    _warn_of_ranges(trained, data, split, warn)
    _warn_of_learned(trained, data, split, warn)
    warm_up = max(data.warm_up_steps, *(_warm_up_steps(run) for run in trained))
    rows = []
    for number, run in enumerate(trained, 1):
        rows.append(_evaluated(run, data, split, warm_up))
        progress("Evaluating", number, len(trained))
    from trainers.training.baselines import baselines

    # Forces at different times do not compare, so that each lead has its own. What runs have not
    # learned from teaches no baseline either: of other recordings it would know more than they do.
    fitted = all(run.config.data_sha256 == data.sha256 for run in trained)
    leads = sorted({run.config.lead_s for run in trained})
    beside = {s: baselines(data, split, s, warm_up, fitted=fitted) for s in leads}
    if sentence := few_samples({split: min(each["zero"].samples for each in beside.values())}):
        warn(sentence)
    return Scores(tuple(rows), beside, trained[0].config.force, split)


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
    changed: dict[str, dict[str, Any]] = {name: {} for name in names}
    for key, value in hyper.items():
        given, dot, name = key.rpartition(".")
        arch = meant(given, names) if dot else names[0] if len(names) == 1 else None
        if arch is None:
            raise UnusableInput(
                f"hyper {key}: name the architecture too, ARCH.NAME, one of {', '.join(names)}."
            )
        changed[arch][name] = value
    return changed


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
    return score_row(run, "test", found, recorded.seconds)


# --- scoring ------------------------------------------------------------------------------------


def _trained_runs(
    runs: "Runs | TrainedRun | Sequence[TrainedRun] | PathLike",
    data: "EpisodeSet",
    place: object,
    progress: Progress,
    warn: Warn,
) -> "list[TrainedRun]":
    """The runs to score, in the order of the paper's table."""
    from trainers.trained_run import TrainedRun, load_run
    from trainers.training.runs import finished_runs

    if isinstance(runs, TrainedRun):
        runs = [runs]
    _require_runs(runs)
    if isinstance(runs, Sequence) and not isinstance(runs, str):
        trained = list(runs)
        for run in trained:
            if why := misfit(run.config, data):
                raise UnusableInput(
                    f"{run.folder} cannot be evaluated on {_place_text(place)}: {why}."
                )
    else:
        folders = _that_fit(finished_runs(Path(runs)), data, place, warn)
        trained = []
        for number, folder in enumerate(folders, 1):
            trained.append(load_run(folder))
            progress("Reading the runs", number, len(folders))
    return sorted(trained, key=_place_in_table)


def _require_runs(runs: object) -> None:
    """UnusableInput for what is neither a run, nor some, nor a folder of them."""
    from trainers.trained_run import TrainedRun

    if isinstance(runs, str | os.PathLike):
        return
    several = list(runs) if isinstance(runs, Sequence) else [runs]
    strange = next((each for each in several if not isinstance(each, TrainedRun)), None)
    if strange is not None:
        raise UnusableInput(
            f"A {type(strange).__name__} cannot be evaluated; give what train returned, a run of"
            " it, or a folder of runs."
        )
    if not several:
        raise UnusableInput("There is no run to evaluate; give what train returned, or a folder.")


def _place_text(place: object) -> str:
    return f"this {place.domain} set" if hasattr(place, "domain") else str(place)


def _that_fit(folders: list[Path], data: "EpisodeSet", place: object, warn: Warn) -> list[Path]:
    """The runs whose channels and rate are the set's; warns of how many others there are."""
    from trainers.training.runs import read_config

    misfits = {folder: misfit(read_config(folder), data) for folder in folders}
    fitting = [folder for folder in folders if misfits[folder] is None]
    first, why = next(((f, w) for f, w in misfits.items() if w is not None), (None, None))
    if not fitting:
        raise UnusableInput(f"{first} cannot be evaluated on {_place_text(place)}: {why}.")
    if first is not None:
        others = len(folders) - len(fitting)
        warn(f"Left out {others} runs that do not fit the set; {first}: {why}.")
    return fitting


def misfit(config: "RunConfig", data: "EpisodeSet") -> str | None:
    """What keeps a run from reading a set, in words; None when nothing does."""
    for kind, wanted, there in (
        ("observation", config.observation, data.observation),
        ("force", config.force, data.force),
    ):
        names, given = [(c.name, c.unit) for c in wanted], [(c.name, c.unit) for c in there]
        if names != given:
            return f"its {kind} channels are {_listed(names)}, the set has {_listed(given)}"
    if abs(config.rate_hz - data.rate_hz) > 1e-6 * config.rate_hz:
        return f"it was trained at {config.rate_hz:g} Hz, the set is at {data.rate_hz:g} Hz"
    return None


def _listed(channels: list[tuple[str, str]]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in channels)


def _warn_of_ranges(
    trained: "list[TrainedRun]", data: "EpisodeSet", split: str, warn: Warn
) -> None:
    """Tell once of each set that was learned from where this one has other values."""
    import numpy as np

    from wakedeploy.core.observations import out_of_range

    others = {r.config.data_sha256: r for r in trained if r.config.data_sha256 != data.sha256}
    episodes = data.part(split)
    if not others or not episodes:  # scoring refuses a split without episodes, and says why
        return
    # Python's warnings are filtered by category; any other `warn` takes a sentence alone.
    tell = functools.partial(warn_caller, category=OutOfRange) if warn is warn_caller else warn
    seen = np.concatenate([episode.observation for episode in episodes])  # (T, d)
    for run in others.values():
        if sentence := out_of_range(seen, run.config.observation):
            tell(f"{run.folder}: {sentence}")


def _warn_of_learned(
    trained: "list[TrainedRun]", data: "EpisodeSet", split: str, warn: Warn
) -> None:
    """Say where runs are scored on what they learned from, unless just that was asked for."""
    scored = data.part(split)
    known: set[str] = set()
    for run in trained:
        of_this_set = run.config.data_sha256 == data.sha256
        if not (of_this_set and split == "train"):
            known |= {e.name for e in scored if _learned(run, data, e, of_this_set)}
    if known:
        warn(
            f"{len(known)} of the {len(scored)} episodes scored, such as {min(known)}, were learned"
            " from: errors there say nothing of new recordings. Score by --split test"
            ' (split="test"), or on a set that no run has seen.'
        )


def _learned(run: "TrainedRun", data: "EpisodeSet", episode: "Episode", of_this_set: bool) -> bool:
    """Whether a run was trained on an episode of a set; by its split where it recorded no hash."""
    from trainers.training.runs import SHORT_HASH

    if not run.metrics.learned_from:
        return of_this_set and data.split[episode.name] == "train"
    return episode.sha256[:SHORT_HASH] in run.metrics.learned_from


def _place_in_table(run: "TrainedRun") -> tuple[int, int]:
    """Architectures in the order of Table I, then seeds."""
    from trainers.build import ARCHITECTURES

    return list(ARCHITECTURES).index(run.config.arch), run.config.seed


def _warm_up_steps(run: "TrainedRun") -> int:
    """When a run may be scored; the records of an earlier version may say it too early."""
    return max(run.config.warm_up_steps, run.predictor.memory.reach)


def _evaluated(run: "TrainedRun", data: "EpisodeSet", split: str, warm_up: int) -> ScoreRow:
    from trainers.training.score import score

    began = time.monotonic()
    result = score(run.predictor, data, split, run.config.lead_s, warm_up)
    found = (result.rmse, result.r2, result.episodes)
    return score_row(run, split, found, time.monotonic() - began)
