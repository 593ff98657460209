"""Search an architecture's hyper-parameters under the parameter budget."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from wakedeploy.api.arguments import (
    MOST_PROCESSES,
    MOST_TRIALS,
    in_python,
    one_of,
    real,
    whole,
    words,
)
from wakedeploy.api.display import data_frame, html_table
from wakedeploy.api.inputs import PathLike, episode_set, path_of
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARAMETER_BUDGET
from wakedeploy.core.names import architectures, meant, unknown
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    import pandas

    from trainers.trained_run import TrainedRun
    from trainers.tuning.conclude import Found
    from trainers.tuning.plan import Plan
    from trainers.tuning.report import Row
    from trainers.tuning.space import Point
    from trainers.tuning.study import Study
    from trainers.tuning.workers import OnTrials, Work
    from wakedeploy.core.episodes import EpisodeSet


Pruner = Literal["median", "hyperband", "none"]


@dataclass(frozen=True, eq=False, repr=False)
class Tuned:
    """What a study of hyper-parameters found; `best.error` is the validation error.

    That error is a share without unit, 1 for predicting the mean. `run` is the best trial trained
    once more: it predicts forces (T, o), its test RMSE in the unit of each channel. `to_pandas`
    raises UnusableInput without pandas.
    """

    found: "Found"
    work: "Work"
    study: "Study"

    @property
    def best(self) -> "Row":
        """The best trial: its point, validation error, parameters, time of a step [µs]."""
        return self.found.best

    @property
    def run(self) -> "TrainedRun":
        """The best trial as a run, which `export` takes."""
        return self.found.run

    @property
    def preset(self) -> Path:
        """The file that `train(preset=…)` takes."""
        from trainers.tuning.workers import BEST

        return self.work.out / BEST

    def to_pandas(self) -> "pandas.DataFrame":
        """A row per trial: number, state, validation error, trainable parameters, and its point."""
        rows = self.found.rows
        columns: dict[str, Sequence[Any]] = {
            "number": [row.number for row in rows],
            "state": [row.state for row in rows],
            "error": [row.error for row in rows],
            "trainable": [row.parameters for row in rows],
        }
        names = dict.fromkeys(name for row in rows for name in row.point)
        columns |= {name: [row.point.get(name) for row in rows] for name in names}
        return data_frame(columns, index="number")

    def __repr__(self) -> str:
        plan, best = self.work.plan, self.best
        return (
            f"<Tuned {plan.arch} on {plan.domain}: {len(self.found.rows)} trials, the best is"
            f" {best.number} with validation error {best.error:.4g}; {self.preset}>"
        )

    def _repr_html_(self) -> str:
        best = self.best
        rows = [[name, f"{value:.4g}"] for name, value in best.point.items()]
        rows += [["validation error", f"{best.error:.4g}"], ["trainable", f"{best.parameters:,}"]]
        return html_table(
            f"{self.work.plan.arch}, trial {best.number}: {self.preset}", ["", ""], rows
        )


@in_python
def tune(
    data: "EpisodeSet | PathLike",
    arch: str,
    *,
    trials: int = 100,
    out: PathLike | None = None,
    seed: int = 100,
    epochs: int = 60,
    lead_s: float | None = None,
    budget: int = 100_000,
    objective: str = "rmse",
    dimensions: Sequence[str] = (),
    starts: Sequence[str] = (),
    pruner: Pruner = "median",
    workers: int = 1,
    storage: str | None = None,
    study_name: str | None = None,
    device: str = "auto",
    give_up_elsewhere: bool = False,
    progress: Progress = quiet,
    on_begun: "Callable[[Work], None]" = lambda work: None,
    on_trials: "OnTrials | None" = None,
) -> Tuned:
    """Search hyper-parameters by Bayesian optimisation, judged on the validation episodes.

    The same call goes on where it was stopped. Test episodes are looked at once, for the best. A
    trial predicts forces (T, o) from observations (T, d), in the units of the set's channels.

    Args:
        data: The folder of a set, or one that was read from a folder: workers read it, too.
        arch: One architecture.
        trials: Finished in all: pruned and failed ones count, interrupted ones do not.
        out: A folder for the study. Default: `tuned/DOMAIN-ARCH`.
        seed: Of every trial.
        epochs: Of every trial.
        lead_s: Predict the force this many seconds ahead. Default: what the set states, or 0.
        budget: Trials have fewer trainable weights than this.
        objective: "rmse", or with a cost of a step: "rmse,latency" (p99 of the exported one [µs]),
            "rmse,flash", "rmse,ram" [bytes] or "rmse,instructions" (of its C).
        dimensions: Narrowed or fixed ones, such as "hidden=16:64" or "kernel=3,5".
        starts: Presets to begin at: files, or "tuned".
        pruner: What ends a trial that is behind.
        workers: Processes that share the study.
        storage: A PostgreSQL address for many machines. Default: a journal file in `out`.
        study_name: Default: `DOMAIN-ARCH`.
        device: "auto", "cpu" or "cuda".
        give_up_elsewhere: Begin again what other machines were training.
        progress: Called with a stage, the trials or epochs done and their number.
        on_begun: Called with what is about to be searched, and where it is kept.
        on_trials: Called with the study as trials end, in place of `progress`.

    Returns:
        The best trial as a preset and as a trained run, and every trial as a row.

    Raises:
        UnusableInput: A name, a dimension or the set cannot be used; the sentence says what to do.
        CheckFailed: No trial came to its end.
    """
    from trainers.bounds import MOST_EPOCHS
    from trainers.training.device import DEVICES
    from trainers.training.runs import LONGEST_LEAD_S
    from trainers.training.trainer import chosen_lead_s
    from trainers.tuning.plan import make_plan
    from trainers.tuning.study import default_name
    from trainers.tuning.workers import Work

    if not isinstance(arch, str):
        raise UnusableInput(f"arch is {arch!r:.60}: give the name of one architecture.")
    known = meant(arch, architectures())
    if known is None:
        raise UnusableInput(f"{unknown(arch, 'architecture', architectures())}.")
    folder = path_of(out, "out")
    trials = whole("trials", trials, 1, MOST_TRIALS)
    workers = whole("workers", workers, 1, MOST_PROCESSES)
    pruner = one_of("pruner", pruner, get_args(Pruner))  # type: ignore[assignment]
    one_of("device", device, DEVICES)
    if lead_s is not None:
        lead_s = real("lead_s", lead_s, 0.0, LONGEST_LEAD_S)
    episodes = episode_set(data)
    from wakedeploy.api.training import require_names

    require_names(episodes)
    plan = make_plan(
        episodes,
        known,
        lead_s=chosen_lead_s(episodes, lead_s),
        epochs=whole("epochs", epochs, 1, MOST_EPOCHS),
        budget=whole("budget", budget, 1, PARAMETER_BUDGET),
        objective=tuple(name.strip().lower() for name in objective.split(",")),
        seed=whole("seed", seed, 0, 2**31),
        asked=words("dimensions", dimensions),
    )
    work = Work(
        plan,
        _folder_of(data),
        folder or Path("tuned") / default_name(plan),
        storage,
        study_name,
        trials,
        pruner,
        _step_cost(plan),
        device,
        give_up_elsewhere,
    )
    on_begun(work)
    return _tuned(
        work, episodes, workers, _starts(plan, words("starts", starts)), progress, on_trials
    )


def _folder_of(data: "EpisodeSet | PathLike") -> Path:
    """Where a set lies, which every worker reads."""
    from wakedeploy.core.episodes import EpisodeSet

    if not isinstance(data, EpisodeSet):
        return Path(data)
    if data.folder is None:
        raise UnusableInput(
            "The workers of a study read the set from a folder, and this one has none; call"
            " data.write(FOLDER) and give FOLDER."
        )
    return data.folder


def _step_cost(plan: "Plan") -> Any:
    """What measures a step, where the study asks for it."""
    if plan.cost is None:
        return None
    if plan.cost == "latency":
        from export.step_time import step_p99_us

        return step_p99_us
    from export.c.trial_cost import MEASURES

    return MEASURES[plan.cost]


def _starts(plan: "Plan", asked: Sequence[str]) -> "list[Point]":
    """The presets to begin at, as points of the study."""
    from trainers.preset import chosen_preset
    from trainers.tuning.starts import preset_start

    points = []
    for name in asked:
        try:
            preset = chosen_preset(name, plan.arch, plan.domain)
        except UnusableInput as error:
            reason = str(error).partition(";")[0].rstrip(".")  # the advice is for `train`
            raise UnusableInput(
                f"--start {name}: {reason}; give a preset of {plan.arch}, or leave it out."
            ) from error
        if preset is None:
            raise UnusableInput(
                f"--start {name}: every study begins there where its dimensions hold it; leave it"
                " out."
            )
        points.append(preset_start(plan, name, preset))
    return points


def _tuned(
    work: "Work",
    data: "EpisodeSet",
    workers: int,
    starts: "list[Point]",
    progress: Progress,
    on_trials: "OnTrials | None",
) -> Tuned:
    from trainers.tuning.conclude import conclude
    from trainers.tuning.study import all_trials, finished
    from trainers.tuning.workers import run_trials

    study = work.begin(starts)

    def tell(study: "Study") -> None:
        done = len(finished(all_trials(study)))
        progress("Trials", min(done, work.trials), work.trials)

    run_trials(work, study, data, workers, tell if on_trials is None else on_trials)
    stage = "Training the best once more"
    progress(stage, 0, work.plan.epochs)
    found = conclude(work, study, data, lambda done, total: progress(stage, done, total))
    return Tuned(found, work, study)
