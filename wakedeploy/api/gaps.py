"""Find where simulation and measurement disagree, name the missing effect, add it, show the gap."""

import functools
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from wakedeploy.api.arguments import MOST_PROCESSES, in_python, real, whole
from wakedeploy.api.flights import Flight, Flights
from wakedeploy.api.inputs import PathLike
from wakedeploy.api.systems import is_system, take
from wakedeploy.core.caller import Warn, warn_caller
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.recording import Recording
from wakedeploy.core.rig import Rig
from wakedeploy.gap.folder import RUN_LOG, at_work, require_logs
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.search.artefacts import Result as SystemResult
from wakedeploy.gap.search.artefacts import read_result
from wakedeploy.gap.systems.answers.folder import CORRECTION, planned_in
from wakedeploy.gap.systems.answers.words import sentences
from wakedeploy.gap.systems.files import OF_MJCF, is_mjcf
from wakedeploy.gap.systems.gantry.artefacts import Result
from wakedeploy.gap.systems.gantry.findings import Retraining
from wakedeploy.gap.systems.gantry.folder import StepArtefacts, prepare, read_steps
from wakedeploy.rig.file import read_rig

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from wakedeploy.domains.tables.columns import Columns
    from wakedeploy.gap.systems.gantry.find_name_add_show import Retrain
    from wakedeploy.gap.systems.own_system import System


Shown = Literal["effects", "ranking"]
RETRAINING_MINUTES = (2.0, 600.0)


@dataclass(frozen=True, eq=False, repr=False)
class Gap:
    """What the workflow found, of a rig or of a system of your own, read from its folder.

    `verdict` is "named", "class", "unknown" or "none"; `effects` are the names that were found,
    `classes` the members where the logs cannot tell several apart. `result` is the file itself,
    `result.json` of a rig and `domain.json` of a system: parameters with units and 90 % intervals,
    the gap per channel before and after, each the RMS over the samples (T,) that were sealed, in
    the channel's unit (m for heights), and as `repeated` whether both halves of the logs say the
    same by themselves. `files` are sentences about further files that were
    written, `next` the commands that may follow, both () where they were read from a folder.
    UnusableInput where the folder holds no result.
    """

    folder: Path
    files: tuple[str, ...] = ()
    next: tuple[str, ...] = ()

    @classmethod
    def read(cls, folder: PathLike) -> "Gap":
        """What an earlier run left in its folder; UnusableInput where there is no result."""
        gap = cls(path_from(folder, "folder"))
        _ = gap.result
        return gap

    @functools.cached_property
    def steps(self) -> StepArtefacts:
        """What each step of a rig wrote; UnusableInput for a folder of a system."""
        if isinstance(self.result, SystemResult):
            raise UnusableInput(f"{self.folder} is of a system, whose steps are in its `result`.")
        return read_steps(self.folder)

    @functools.cached_property
    def result(self) -> Result | SystemResult:
        """The content of `result.json` or `domain.json`; UnusableInput where there is neither."""
        ours, other = self.folder / "domain.json", self.folder / "result.json"
        if ours.is_file() and not _is_older(ours, other):
            return read_result(ours)
        found = read_steps(self.folder).result if other.is_file() else None
        if found is None:
            raise UnusableInput(
                f"{self.folder}: there is no result.json of a rig and no domain.json of a system; "
                "run `wakedeploy gap close`, or close_gap."
            )
        return found

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
        """The effects that these logs cannot tell apart; () without any."""
        return tuple(self.result.rivals)

    @property
    def account(self) -> str:
        """The result in plain words, the verdict first."""
        if isinstance(self.result, SystemResult):
            planned = planned_in(self.folder, self.result)
            return "\n".join(sentences(self.result, planned))
        from wakedeploy.gap.report.summary import account

        return account(self.steps.summary)

    @property
    def corrected(self) -> Path | None:
        """The file with what was found; None where nothing was added.

        Of a rig it is `rig.toml`. Of a system it is `correction.toml`, for
        `MyRobot.corrected(gap.corrected)`; it has the constants as they were fitted, too. Where no
        effect was named it has only those that nobody has measured.
        """
        if isinstance(self.result, SystemResult):
            path = self.folder / CORRECTION
            return path if path.is_file() else None
        return None if self.steps.add is None else self.folder / "rig.toml"

    @property
    def rig(self) -> Rig | None:
        """The corrected rig; None where nothing was added, and for a system."""
        path = self.corrected
        return None if path is None or isinstance(self.result, SystemResult) else read_rig(path)

    @property
    def report(self) -> Path:
        """The page with all figures."""
        return self.folder / "report.html"

    def plot(self) -> "Figure":
        """Measured and forecast: the gap of a rig, a sealed stretch of a system's log.

        Raises UnusableInput where nothing has been shown yet.
        """
        from wakedeploy.core import figures
        from wakedeploy.core.figures import showing_itself

        with figures.style():
            drawn = self._drawn()
        if drawn is None:
            raise UnusableInput(
                f"{self.folder}: nothing is shown yet; run `wakedeploy gap close`, or close_gap."
            )
        return showing_itself(drawn)

    def _drawn(self) -> "Figure | None":
        if isinstance(self.result, SystemResult):
            from wakedeploy.gap.report.system_charts import draw_trace

            return draw_trace(self.result.shown.trace)
        from wakedeploy.gap.report.charts import draw_gaps

        return draw_gaps(self.result.gap)

    def to_pandas(self, rows: Shown = "effects") -> "pandas.DataFrame":
        """A table of what was found, or of all that was ranked.

        With "effects" a row is a parameter of an effect that was named: effect, parameter, value,
        90 % interval (low, high), unit. With "ranking" it is an effect of a round of the search:
        round, effect, what it gains on samples (T,) that it was not fitted to with its 90 %
        interval [nat], the gain that chance brings, and whether it was named.

        Raises UnusableInput where pandas is not installed, or where no ranking was kept.
        """
        from wakedeploy.api.display import data_frame

        if rows == "ranking":
            return data_frame(_ranking(self))
        if rows != "effects":
            raise UnusableInput(f'There are no rows {rows!r}; give "effects" or "ranking".')
        sizes = [
            (effect.name, name, size)
            for effect in self.result.effects
            for name, size in effect.parameters.items()
        ]
        columns = {
            "effect": [effect for effect, _, _ in sizes],
            "parameter": [name for _, name, _ in sizes],
        }
        keys = ("value", "low", "high", "unit")
        return data_frame(
            columns | {key: [getattr(size, key) for *_, size in sizes] for key in keys}
        )

    def __repr__(self) -> str:
        named = [n for n in self.effects if n not in self.classes]
        names = ", ".join([*named, " or ".join(self.classes)] if self.classes else named)
        return f"<Gap in {self.folder}: {self.verdict}{': ' if names else ''}{names}>"

    def _repr_html_(self) -> str:
        from markupsafe import Markup

        from wakedeploy.core.pages import picture

        text = Markup("<pre>{}</pre>").format(self.account)
        name = "trace" if isinstance(self.result, SystemResult) else "before_after"
        drawn = self.folder / "figures" / f"{name}.png"
        return text + picture(drawn, "The gap before and after.") if drawn.exists() else text


@in_python
def close_gap(
    system: "System | type[System] | PathLike",
    measured: "Flights | Sequence[Flight | Recording | PathLike] | Recording | PathLike",
    out: PathLike,
    *,
    columns: "Columns | PathLike | None" = None,
    workers: int = 2,
    report: bool = True,
    retrain_minutes: float | None = None,
    plan: bool = True,
    progress: Progress = quiet,
    warn: Warn = warn_caller,
) -> Gap:
    """Find, name and add what a rig file or a system of your own lacks, and show the gap.

    The gap is shown on flights, or on the last quarter of the logs that moves, to which nothing was
    fitted. Everything that is written lies in `out`; a second call replaces what has changed. It
    takes minutes.

    Args:
        system: The rig file that the flights were flown with, or a system of your own: its Python
            file (`"my_robot.py"`, `"my_robot.py:Arm"` for one of several), class or object.
        measured: Of a rig, four or more flights, or the files of their run logs; the last is only
            shown (from six on, two). Of a system, recordings or logs, one or more: files, or
            folders of files that belong together. Columns are (T,), in the units of their names.
        out: The folder for artefacts, figures and report.
        columns: Of a system, what the logs' columns mean, or the `columns.toml` that says so; a CSV
            whose columns have the system's names and units needs none.
        workers: Of a rig, processes for its thresholds, simulated once.
        report: Draw the report.
        retrain_minutes: Of a rig, also train a predictor on this much simulated flight [min] of
            each rig, and compare them on the flights shown.
        plan: Where several effects cannot be told apart, look for the manoeuvre or input that
            would.
        progress: Called with a stage, its steps done and their number.
        warn: Called with what was noticed in logs and handled. Default: a warning of Python.

    Returns:
        The verdict, the effects with parameters, units and intervals, and the gap per channel.

    Raises:
        UnusableInput: A rig file, a system or a log cannot be used, or `out` cannot be written to.
    """
    workers = whole("workers", workers, 1, MOST_PROCESSES)
    if retrain_minutes is not None:
        retrain_minutes = real("retrain_minutes", retrain_minutes, *RETRAINING_MINUTES)
    folder = path_from(out, "out")
    if not _several(measured):
        raise UnusableInput("measured is empty: give flights or logs, one or more.")
    if is_system(system):
        if retrain_minutes is not None:
            raise UnusableInput("retrain_minutes is for a rig; of a system leave it out.")
        taken = take(
            "close",
            system,
            _logs_of_system(measured),
            columns,
            folder,
            progress,
            warn,
            report=report,
            plan=plan,
        )
        return Gap(folder, taken.exported, taken.next)
    if columns is not None:
        raise UnusableInput("columns are for a system of your own; flights of a rig need none.")
    rig_path = _rig_path(system)
    _closed(rig_path, measured, folder, workers, report, retrain_minutes, plan, progress, warn)
    return Gap.read(folder)


def _closed(
    rig_path: Path,
    measured: "Flights | Sequence[Flight | Recording | PathLike] | Recording | PathLike",
    folder: Path,
    workers: int,
    report: bool,
    retrain_minutes: float | None,
    plan: bool,
    progress: Progress,
    warn: Warn,
) -> None:
    """All steps of a rig."""
    from wakedeploy.gap.systems.gantry.workflow import close

    logs = [_log_path(flight) for flight in _several(measured)]
    require_logs(logs, RUN_LOG)
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
            warn=warn,
        )


def _is_older(path: Path, other: Path) -> bool:
    """Whether another file is there that was written later."""
    return other.is_file() and path.stat().st_mtime_ns < other.stat().st_mtime_ns


def _needed(searched: Any, each: Any) -> float:
    """What an effect had to gain: its round's threshold, if nothing else is said."""
    return float(searched.threshold_nats if math.isnan(each.needed_nats) else each.needed_nats)


def _ranking(gap: Gap) -> dict[str, list[Any]]:
    """Every round's effects, with what they gain, by column."""
    searched = gap.result if isinstance(gap.result, SystemResult) else gap.steps.name
    if searched is None:
        raise UnusableInput(f"{gap.folder}: there is no name.json; run `wakedeploy gap name`.")
    rounds: list[Any] = list(searched.rounds)
    ranked = [(k, r, each) for k, r in enumerate(rounds, 1) for each in r.ranking]
    named = {*gap.effects, *gap.classes}
    return {
        "round": [k for k, _, _ in ranked],
        "effect": [each.name for *_, each in ranked],
        "gain_nats": [each.gain_nats for *_, each in ranked],
        "low_nats": [each.interval[0] for *_, each in ranked],
        "high_nats": [each.interval[1] for *_, each in ranked],
        "threshold_nats": [_needed(r, each) for _, r, each in ranked],
        "named": [each.name in named for *_, each in ranked],
    }


def _several(measured: Any) -> list[Any]:
    """What was measured, one or more."""
    is_several = isinstance(measured, Iterable) and not isinstance(
        measured, (str, bytes, os.PathLike, Flight, Recording)
    )
    return list(measured) if is_several else [measured]


def _logs_of_system(measured: Any) -> "list[Recording | PathLike]":
    is_table = isinstance(measured, Mapping) or hasattr(measured, "to_dict")
    logs = [measured] if is_table else _several(measured)  # and not its columns' names
    if any(isinstance(log, Flight) for log in logs):
        raise UnusableInput(
            "A flight is of a rig; give a system recordings (wd.read_log) or files of its logs."
        )
    return logs


def _rig_path(given: Any) -> Path:
    """The file of a rig; UnusableInput for what is neither that nor a system."""
    if isinstance(given, Rig):
        raise UnusableInput("A rig is given by its file; keep it by rig.write(FILE) and give that.")
    if not isinstance(given, (str, os.PathLike)):
        raise UnusableInput(
            f"{given!r:.60} is no rig file and no system; give a path, or a System of your own."
        )
    path = path_from(given, "rig")
    if is_mjcf(path):
        raise UnusableInput(f"{path} {OF_MJCF}")
    return path


def _log_path(flight: "Flight | Recording | PathLike") -> Path:
    """Where a flight is recorded; the workflow's artefacts name the file."""
    if isinstance(flight, Recording):
        raise UnusableInput("A recording is of a system; give a rig flights or their run logs.")
    if not isinstance(flight, Flight):
        return path_from(flight, "measured")
    if flight.path is None:
        raise UnusableInput("A flight was not recorded in a file; fly it with log=…, or write it.")
    return flight.path


def trainer(minutes: float | None, workers: int, progress: Progress) -> "Retrain | None":
    """What trains predictors on both rigs, and scores them on the flights that are shown."""
    if minutes is None:
        return None
    import trainers.training.trainer  # noqa: F401  refuses before minutes of fits, if not installed
    from wakedeploy.gap.systems.gantry.retraining import retrain

    def train(old: Rig, corrected: Rig, logs: Sequence[Path], out: Path) -> Retraining:
        into = out / "retrain"
        return retrain(
            old, corrected, logs, into, minutes=minutes, workers=workers, progress=progress
        )

    return train
