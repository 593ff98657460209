"""Find where simulation and measurement disagree, name the missing effect, add it, show the gap."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from wakedeploy.api.flights import Flight, Flights
from wakedeploy.api.inputs import PathLike
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.gap.folder import at_work, require_logs
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.systems.gantry.artefacts import Result
from wakedeploy.gap.systems.gantry.findings import Retraining
from wakedeploy.gap.systems.gantry.folder import Steps, prepare, read_steps
from wakedeploy.rig.file import read_rig

if TYPE_CHECKING:
    import pandas

    from wakedeploy.gap.systems.gantry.find_name_add_show import Retrain


@dataclass(frozen=True, eq=False, repr=False)
class Gap:
    """What the workflow found, read from its folder.

    `verdict` is "named", "class", "unknown" or "none"; `effects` are the names that were found,
    `classes` the members where the flights cannot tell several apart. `result` is `result.json`:
    parameters with units and 90 % intervals, and the gap per channel before and after, each the RMS
    over the samples (T,) of the flights shown, in the channel's unit (m for heights). UnusableInput
    where the folder holds no result.
    """

    folder: Path

    @classmethod
    def read(cls, folder: PathLike) -> "Gap":
        """What an earlier run left in its folder; UnusableInput where there is no result."""
        gap = cls(Path(folder))
        _ = gap.result
        return gap

    @functools.cached_property
    def steps(self) -> Steps:
        """What each step wrote."""
        return read_steps(self.folder)

    @property
    def result(self) -> Result:
        """The content of `result.json`; UnusableInput where there is none."""
        if self.steps.result is None:
            raise UnusableInput(
                f"{self.folder}: there is no result.json; run `wakedeploy gap close`, or close_gap."
            )
        return self.steps.result

    @property
    def verdict(self) -> str:
        """What was concluded: "named", "class", "unknown" or "none"."""
        return str(self.result.verdict)

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that were named, in the order in which they were found."""
        return tuple(effect.name for effect in self.result.effects)

    @property
    def classes(self) -> tuple[str, ...]:
        """The effects that these flights cannot tell apart; () where there are none such."""
        return tuple(self.result.rivals)

    @property
    def account(self) -> str:
        """The result in plain words, the verdict first."""
        from wakedeploy.gap.report.summary import account

        return account(self.steps.summary)

    @property
    def rig(self) -> Rig | None:
        """The corrected rig; None where nothing was added."""
        return None if self.steps.add is None else read_rig(self.folder / "rig.toml")

    @property
    def report(self) -> Path:
        """The page with all figures."""
        return self.folder / "report.html"

    def to_pandas(self) -> "pandas.DataFrame":
        """A row per parameter of the effects: effect, parameter, value, 90 % interval, unit.

        Raises UnusableInput where pandas is not installed.
        """
        from wakedeploy.api.display import data_frame

        rows = [
            (effect.name, name, size)
            for effect in self.result.effects
            for name, size in effect.parameters.items()
        ]
        columns = {
            "effect": [effect for effect, _, _ in rows],
            "parameter": [name for _, name, _ in rows],
        }
        keys = ("value", "low", "high", "unit")
        return data_frame(
            columns | {key: [getattr(size, key) for *_, size in rows] for key in keys}
        )

    def __repr__(self) -> str:
        names = ", ".join(self.effects or self.classes)
        return f"<Gap in {self.folder}: {self.verdict}{': ' if names else ''}{names}>"

    def _repr_html_(self) -> str:
        from markupsafe import Markup

        from wakedeploy.core.pages import picture

        text = Markup("<pre>{}</pre>").format(self.account)
        drawn = self.folder / "figures" / "before_after.png"
        return text + picture(drawn, "The gap before and after.") if drawn.exists() else text


def close_gap(
    rig: PathLike,
    measured: "Flights | Sequence[Flight | PathLike]",
    out: PathLike,
    *,
    workers: int = 2,
    report: bool = True,
    retrain_minutes: float | None = None,
    plan: bool = True,
    progress: Progress = quiet,
) -> Gap:
    """Find, name and add what a rig file lacks, and show the gap on flights not used before.

    Everything that is written lies in `out`; a second call replaces it. It takes minutes.

    Args:
        rig: The rig file that the flights were flown with.
        measured: Four or more flights of that rig, or the files of their run logs; the last is only
            shown (from six on, two). Columns are (T,), in the units of their names.
        out: The folder for artefacts, figures and report.
        workers: Processes for the rig's thresholds, simulated once.
        report: Draw the report.
        retrain_minutes: Also train a predictor on this much simulated flight [min] of each rig, and
            compare them on the flights shown.
        plan: Where several effects cannot be told apart, look for the manoeuvre that would.
        progress: Called with a stage, its steps done and their number.

    Returns:
        The verdict, the effects with parameters, units and intervals, and the gap per channel.

    Raises:
        UnusableInput: A rig file or a log cannot be used, or `out` cannot be written to.
    """
    from wakedeploy.gap.systems.gantry.workflow import close

    folder, rig_path = Path(out), Path(rig)
    logs = [_log_path(flight) for flight in measured]
    require_logs(logs)
    prepare(folder, rig_path)
    with at_work(folder):
        close(
            rig_path,
            logs,
            folder,
            workers=workers,
            report=report,
            progress=progress,
            retrain=trainer(retrain_minutes, workers, progress),
            plan=plan,
        )
    return Gap.read(folder)


def _log_path(flight: Flight | PathLike) -> Path:
    """Where a flight is recorded; the workflow's artefacts name the file."""
    if not isinstance(flight, Flight):
        return Path(flight)
    if flight.path is None:
        raise UnusableInput("A flight was not recorded in a file; fly it with log=…, or write it.")
    return flight.path


def trainer(minutes: float | None, workers: int, progress: Progress) -> "Retrain | None":
    """What trains predictors on both rigs, and scores them on the flights that are shown."""
    if minutes is None:
        return None
    import trainers.training.trainer  # noqa: F401  what is not installed is told before minutes of fits
    from wakedeploy.gap.systems.gantry.retraining import retrain

    def train(old: Rig, corrected: Rig, logs: Sequence[Path], out: Path) -> Retraining:
        into = out / "retrain"
        return retrain(
            old, corrected, logs, into, minutes=minutes, workers=workers, progress=progress
        )

    return train
