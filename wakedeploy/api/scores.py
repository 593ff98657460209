"""Errors of trained predictors as a table: a row per run, beside what they have to beat."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from wakedeploy.api.display import data_frame, html_table
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import Quantity
from wakedeploy.gap.wording import counted

if TYPE_CHECKING:
    import pandas

    from trainers.trained_run import TrainedRun
    from trainers.training.episode_scores import EpisodeScore
    from trainers.training.score import Score

Shown = Literal["runs", "episodes"]
Found = tuple[
    Mapping[str, float], Mapping[str, float | None], "Sequence[EpisodeScore]"
]  # rmse, R², and the errors in each episode


@dataclass(frozen=True)
class About:
    """What is known of a run, or of a package that was exported from one, without any error.

    `run` is the run's folder or the package's file, `lead_s` how far ahead it predicts [s],
    `device` where it was trained. A package knows neither its settings nor its device.
    """

    run: str
    arch: str
    seed: int
    lead_s: float
    hyper: dict[str, Any]
    settings: dict[str, float | int]
    kept_from: list[str]
    data_sha256: str
    trainable: int
    frozen: int
    device: str | None


@dataclass(frozen=True)
class ScoreRow(About):
    """The errors of one run on one split, as `train --json` and `evaluate --json` write them.

    `rmse` is in each force channel's unit, `r2` None where the force never changes; both are pooled
    over the split. `episodes` has the errors in each episode: its name, the samples that were
    scored, `rmse`, and `relative`, which is rmse by that of predicting zero there. `seconds` is
    what training or scoring took.
    """

    split: str
    rmse: dict[str, float]
    r2: dict[str, float | None]
    episodes: "tuple[EpisodeScore, ...]"
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """The row as a plain dictionary."""
        return asdict(self)

    @property
    def configuration(self) -> dict[str, Any]:
        """Everything that may tell two runs of an architecture apart, but for the seed."""
        kept = {"kept_from": self.kept_from, "data": self.data_sha256[:8]}
        return {"lead_s": self.lead_s, **self.settings, **self.hyper, **kept}


def about_run(run: "TrainedRun") -> About:
    """What a finished run was trained with."""
    return About(
        run=str(run.folder),
        arch=run.config.arch,
        seed=run.config.seed,
        lead_s=run.config.lead_s,
        hyper=dict(run.config.hyper),
        settings=dict(run.config.settings),
        kept_from=list(run.config.present_only),
        data_sha256=run.config.data_sha256,
        trainable=run.metrics.trainable,
        frozen=run.metrics.frozen,
        device=run.metrics.device,
    )


def score_row(about: About, split: str, found: Found, seconds: float) -> ScoreRow:
    """The row of a run or a package: its errors on a split, and what is known of it."""
    rmse, r2, episodes = found
    return ScoreRow(
        **vars(about),
        split=split,
        rmse=dict(rmse),
        r2=dict(r2),
        episodes=tuple(episodes),
        seconds=round(seconds, 3),
    )


@dataclass(frozen=True, repr=False)
class Scores:
    """Errors of several runs on the same samples, forces (T, o), of one split.

    `rows` has a `ScoreRow` per run or package; `force` are the channels with their units. By lead
    [s] and name, `baselines` has what a predictor has to beat: zero, the training set's mean force,
    linear regressions on one tick and on a window, and a set's observer of the sufferer's motion.
    RMSE is in the channel's unit (N for forces), R² has none. `to_pandas` raises UnusableInput
    where pandas is not installed.
    """

    rows: tuple[ScoreRow, ...]
    baselines: Mapping[float, Mapping[str, "Score"]]
    force: tuple[Quantity, ...]
    split: str

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        channel = self.force[0]
        scores = [f"{r.arch} s{r.seed} {r.rmse[channel.name]:.4g}" for r in self.rows[:8]]
        more = f", and {len(self) - 8} more" if len(self) > 8 else ""
        errors = f"RMSE {channel.name} [{channel.unit}]: {', '.join(scores)}{more}"
        return f"<Scores of {counted(len(self), 'run')} on {self.split} episodes; {errors}>"

    def to_pandas(self, rows: Shown = "runs") -> "pandas.DataFrame":
        """A table of the errors over all episodes, or in each.

        With "runs" a row is a run: architecture, seed, lead, parameters, RMSE and R² per channel.
        With "episodes" it is an episode as a run predicts it: architecture, seed, lead, the
        episode's name, the samples that were scored, RMSE per channel in its unit, and RMSE by that
        of predicting zero in the same samples.

        Raises UnusableInput where pandas is not installed.
        """
        if rows == "episodes":
            return data_frame(self._by_episode())
        if rows != "runs":
            raise UnusableInput(f'There are no rows {rows!r}; give "runs" or "episodes".')
        columns: dict[str, Sequence[Any]] = {
            "arch": [r.arch for r in self.rows],
            "seed": [r.seed for r in self.rows],
            "lead_s": [r.lead_s for r in self.rows],
            "trainable": [r.trainable for r in self.rows],
        }
        for name in (channel.name for channel in self.force):
            columns |= {f"rmse_{name}": [r.rmse[name] for r in self.rows]}
            columns |= {f"r2_{name}": [r.r2[name] for r in self.rows]}
        return data_frame(columns | {"seconds": [r.seconds for r in self.rows]})

    def _by_episode(self) -> dict[str, list[Any]]:
        pairs = [(run, episode) for run in self.rows for episode in run.episodes]
        columns: dict[str, list[Any]] = {
            "arch": [run.arch for run, _ in pairs],
            "seed": [run.seed for run, _ in pairs],
            "lead_s": [run.lead_s for run, _ in pairs],
            "episode": [episode.episode for _, episode in pairs],
            "samples": [episode.samples for _, episode in pairs],
        }
        for name in (channel.name for channel in self.force):
            columns[f"rmse_{name}"] = [episode.rmse[name] for _, episode in pairs]
            columns[f"relative_{name}"] = [episode.relative[name] for _, episode in pairs]
        return columns

    def _repr_html_(self) -> str:
        columns = ["architecture", "seed", "lead [s]", "trainable"]
        for channel in self.force:
            columns += [f"RMSE {channel.name} [{channel.unit}]", f"R² {channel.name}"]
        rows = [
            [r.arch, str(r.seed), f"{r.lead_s:g}", f"{r.trainable:,}", *self._cells(r)]
            for r in self.rows
        ]
        rows += [
            [name, "", f"{lead_s:g}", "", *self._cells(score)]
            for lead_s, scores in self.baselines.items()
            for name, score in scores.items()
        ]
        counts = {score["zero"].samples for score in self.baselines.values()}
        samples = " or ".join(f"{count:,}" for count in sorted(counts))
        return html_table(f"{self.split.capitalize()} episodes ({samples} samples)", columns, rows)

    def _cells(self, scored: "ScoreRow | Score") -> list[str]:
        cells = []
        for name in (channel.name for channel in self.force):
            r2 = scored.r2[name]
            cells += [f"{scored.rmse[name]:.4g}", "—" if r2 is None else f"{r2:.4f}"]
        return cells
