"""Optional trackers of trainings: TensorBoard and MLflow.

In: a run's configuration, where its fit stands, its scores and pictures. Out: event files, or runs
in MLflow's store. Only the module of its name imports a library. A run that is resumed, or was
trained before, is reported whole: the tracker gets what it lacks.
"""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

from trainers.trackers.values import FAILED, FINISHED, INTERRUPTED
from trainers.trained_run import TrainedRun
from trainers.training.fit import Standing
from trainers.training.runs import RunConfig
from wakedeploy.core.errors import UnusableInput, installs, one_line


class Tracked(Protocol):
    """One run in a tracker; nothing is written before the first call."""

    def stands(self, standing: Standing) -> None:
        """Report the epochs not reported yet."""

    def finished(self, run: TrainedRun, pictures: Sequence[Path]) -> None:
        """Report a finished run: the epochs not reported yet, its scores, its pictures."""

    def close(self, how: str) -> None:
        """Nothing more comes; `how` is FINISHED, INTERRUPTED or FAILED."""


class Tracker(Protocol):
    """`whereabouts` says where it keeps things and how to look; `failures` is what it may raise."""

    whereabouts: str
    failures: tuple[type[Exception], ...]

    def why(self, failure: Exception) -> str:
        """A failure in one line, without a password that its address may hold."""

    def track(self, config: RunConfig, folder: Path, fresh: bool) -> Tracked:
        """A run in its folder; `fresh` forgets an earlier one that lay there."""


TRACKERS = ("tensorboard", "mlflow")


def open_tracker(name: str, out: Path) -> Tracker:
    """The tracker of that name for the runs below `out`.

    Raises UnusableInput where its library is not installed or its store cannot be used.
    """
    if importlib.util.find_spec(name) is None:
        raise UnusableInput(
            f"--tracker {name}: {name} is not installed; install it: {installs(name)}."
        )
    try:
        return _opened(name, out)
    except ImportError as error:  # of another library's version, found out when it is used
        raise UnusableInput(
            f"--tracker {name}: {name} does not work as it is installed ({one_line(error)});"
            f" install it anew: {installs(name)}."
        ) from error


def _opened(name: str, out: Path) -> Tracker:
    if name == "tensorboard":
        from trainers.trackers.tensorboard import TensorBoard

        return TensorBoard(out)
    from trainers.trackers.mlflow import MlFlow

    return MlFlow(out)


class Following:
    """A run as it is reported to a tracker, if any. A tracker that fails stops no training."""

    def __init__(
        self, tracked: Tracked | None, tracker: Tracker | None, warn: Callable[[str], None]
    ) -> None:
        self._tracked, self._tracker, self._warn = tracked, tracker, warn

    def stands(self, standing: Standing) -> None:
        """As `Tracked.stands`."""
        self._tell(lambda tracked: tracked.stands(standing))

    def finished(self, run: TrainedRun, pictures: Sequence[Path]) -> None:
        """As `Tracked.finished`."""
        self._tell(lambda tracked: tracked.finished(run, pictures))

    def close(self, how: str) -> None:
        """As `Tracked.close`."""
        self._tell(lambda tracked: tracked.close(how))

    def _tell(self, call: Callable[[Tracked], None]) -> None:
        if self._tracked is None or self._tracker is None:
            return
        try:
            call(self._tracked)
        except self._tracker.failures as error:
            self._tracked = None
            self._warn(
                f"The tracker fails ({self._tracker.why(error)}); training goes on without it, and"
                " the same command catches up what it lacks."
            )


@contextlib.contextmanager
def following(
    tracker: Tracker | None,
    config: RunConfig,
    folder: Path,
    *,
    fresh: bool,
    warn: Callable[[str], None],
) -> Iterator[Following]:
    """Report the run that is trained in the block to `tracker`, if there is one."""
    tracked = tracker.track(config, folder, fresh) if tracker is not None else None
    following = Following(tracked, tracker, warn)
    try:
        yield following
    except BaseException as error:
        following.close(INTERRUPTED if isinstance(error, KeyboardInterrupt) else FAILED)
        raise
    following.close(FINISHED)
