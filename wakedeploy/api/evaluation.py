"""Score finished runs and packages on any set that fits them."""

import functools
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from wakedeploy.api.arguments import in_python
from wakedeploy.api.contenders import Contender, contenders
from wakedeploy.api.inputs import PathLike, episode_set
from wakedeploy.api.scores import ScoreRow, Scores, score_row
from wakedeploy.core.caller import Warn, warn_caller
from wakedeploy.core.errors import OutOfRange
from wakedeploy.core.few_samples import few_samples
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    from trainers.trained_run import TrainedRun
    from wakedeploy.api.predictors import Predictor
    from wakedeploy.api.training import Runs
    from wakedeploy.core.episodes import EpisodeSet


@in_python
def evaluate(
    runs: "Runs | TrainedRun | Predictor | Sequence[TrainedRun | Predictor] | PathLike",
    data: "EpisodeSet | PathLike",
    split: str = "test",
    *,
    progress: Progress = quiet,
    warn: Warn = warn_caller,
) -> Scores:
    """Score finished runs, or packages as they would fly, on the episodes of a set.

    Every run is asked for the force (T, o) at its own lead [s]; all are scored on the same samples,
    after one common warm-up.

    Args:
        runs: What `train` returned, one run of it, what `load` or `export` returned, several of
            these, or a path: of a package or a folder of C, or of a folder, where every finished
            run below counts, or every package, if there is no run.
        data: A set, or the folder of one; its channels and rate have to be the runs'.
        split: "train", "validation", "test" or "all".
        progress: Called with a stage, the runs done and their number.
        warn: Called with a sentence about what in a folder cannot be read or does not fit the set,
            about episodes that were learned from, and about channels that have other values than in
            training. Default: Python's warnings, the last by `wd.OutOfRange`.

    Returns:
        RMSE in the unit of each channel and R², a row per run in the order of the paper's table,
        the error of each run in each episode, and that of baselines. Those that learn stand beside
        runs that were trained on this very set.

    Raises:
        UnusableInput: There is no finished run, none fits the set, one that is named cannot be read
            or does not fit, or the split has no episode that is long enough.
        CheckFailed: A package's step fails.
    """
    place = data
    data = episode_set(data)
    scored = contenders(runs, data, place, progress, warn)
    _warn_of_ranges(scored, data, split, warn)
    _warn_of_learned(scored, data, split, warn)
    warm_up = max(data.warm_up_steps, *(each.warm_up_steps for each in scored))
    rows = []
    for number, each in enumerate(scored, 1):
        rows.append(_scored(each, data, split, warm_up))
        progress("Evaluating", number, len(scored))
    from trainers.training.baselines import baselines

    # Forces at different times do not compare, so that each lead has its own. What runs have not
    # learned from teaches no baseline either: of other recordings it would know more than they do.
    fitted = all(each.about.data_sha256 == data.sha256 for each in scored)
    leads = sorted({each.about.lead_s for each in scored})
    beside = {s: baselines(data, split, s, warm_up, fitted=fitted) for s in leads}
    if sentence := few_samples({split: min(each["zero"].samples for each in beside.values())}):
        warn(sentence)
    return Scores(tuple(rows), beside, scored[0].force, split)


def _warn_of_ranges(
    scored: Sequence[Contender], data: "EpisodeSet", split: str, warn: Warn
) -> None:
    """Tell once of each set that was learned from where this one has other values."""
    import numpy as np

    from wakedeploy.core.observations import out_of_range

    others = {e.about.data_sha256: e for e in scored if e.about.data_sha256 != data.sha256}
    episodes = data.part(split)
    if not others or not episodes:  # scoring refuses a split without episodes, and says why
        return
    # Python's warnings are filtered by category; any other `warn` takes a sentence alone.
    tell = functools.partial(warn_caller, category=OutOfRange) if warn is warn_caller else warn
    seen = np.concatenate([episode.observation for episode in episodes])  # (T, d)
    for each in others.values():
        if sentence := out_of_range(seen, each.observation):
            tell(f"{each.about.run}: {sentence}")


def _warn_of_learned(
    scored: Sequence[Contender], data: "EpisodeSet", split: str, warn: Warn
) -> None:
    """Say where runs are scored on what they learned from, unless just that was asked for."""
    episodes = data.part(split)
    known: set[str] = set()
    for each in scored:
        if not (each.about.data_sha256 == data.sha256 and split == "train"):
            known |= {e.name for e in episodes if each.has_learned(data, e)}
    if known:
        warn(
            f"{len(known)} of the {len(episodes)} episodes scored, such as {min(known)}, were"
            " learned from: errors there say nothing of new recordings. Score by --split test"
            ' (split="test"), or on a set that no run has seen.'
        )


def _scored(each: Contender, data: "EpisodeSet", split: str, warm_up: int) -> ScoreRow:
    from trainers.training.score import compared
    from trainers.training.tape import lay_tape

    began = time.monotonic()
    lead_s = each.about.lead_s
    tape = lay_tape(data, split, lead_s, warm_up)
    forces = tape.force.new_tensor(each.forces(tape))  # (N, o)
    found = compared(forces, tape, data, split, lead_s, warm_up)
    seconds = time.monotonic() - began
    return score_row(each.about, split, (found.rmse, found.r2, found.episodes), seconds)
