"""Predictors: made from a trained run, loaded from a file or as C, stepped through observations."""

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeGuard, Unpack

import numpy as np
import numpy.typing as npt

from runtime.compiled.folder import RUN_FILES
from runtime.flyable import Flyable, Predicting, predictor_of, read_flyable
from wakedeploy.api.arguments import in_python
from wakedeploy.api.compiled import AsC, c_of_package, c_of_run, wish_of
from wakedeploy.api.display import html_table
from wakedeploy.api.inputs import PathLike, episode_set, path_of, rig_of
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import at_home, path_from
from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.observations import (
    in_order,
    series_of,
    warn_of_other_rate,
    warn_out_of_range,
)
from wakedeploy.core.package import Package
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    from runtime.compiled.folder import CFolder
    from runtime.compiled.proof import Proved
    from runtime.replay import Replay
    from trainers.trained_run import TrainedRun
    from wakedeploy.api.training import Runs
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.core.rig import Rig


class Predictor:
    """A package or a folder of C that predicts; channels and their units are those of its manifest.

    `predict` takes whole series (T, d) from a cold start; `step` goes on from call to call, one
    observation (d,) at a time, until `reset`. Forces are those `lead_s` seconds ahead of the newest
    observation, float32. The first that counts is that of step `manifest.warm_up_steps`. A
    copy, also for another process, begins with an empty memory. Raises UnusableInput for another
    shape, CheckFailed where onnxruntime gives up.
    """

    def __init__(self, package: Flyable, path: Path) -> None:
        self.package, self.path = package, path
        self._live: Predicting | None = None

    def __getstate__(self) -> dict[str, object]:
        """What a copy takes over: no session, which belongs to one process, nor its memory."""
        return self.__dict__ | {"_live": None}

    @property
    def manifest(self) -> Manifest:
        """What the package says of itself: channels with units and ranges, rate, lead, errors."""
        return self.package.manifest

    @property
    def lead_s(self) -> float:
        """How far ahead of the newest observation the force is predicted [s]."""
        return self.manifest.lead_s

    @property
    def ready(self) -> bool:
        """Whether the newest force of `step` counts: the warm-up is over."""
        return self._live is not None and self._live.ready

    def predict(self, observations: npt.ArrayLike) -> FloatArray:
        """Forces (T, o) for observations (T, d), or (B, T, o) for B series (B, T, d).

        Every call begins with an empty memory and leaves that of `step` alone. The columns of a
        DataFrame or a dict are taken by their names, those of an array in the manifest's order.
        Raises UnusableInput for another shape, a missing channel or what is no number. Warns by
        `wd.OutOfRange` where a channel has other values than in training, as in another unit, or
        where the index of a DataFrame tells another rate; `step` does not.
        """
        given = series_of(observations, self.manifest.observation)  # (T, d) or (B, T, d)
        warn_out_of_range(given, self.manifest.observation)
        if self.manifest.memory.kind != "none":
            warn_of_other_rate(observations, self.manifest.rate_hz)
        series = given[None] if given.ndim == 2 else given  # (B, T, d)
        runner = predictor_of(self.package, batch=len(series))
        stepped = [runner.step(newest) for newest in series.swapaxes(0, 1)]  # T times (B, o)
        outputs = len(self.manifest.force)
        forces = np.stack(stepped, axis=1) if stepped else np.empty((len(series), 0, outputs))
        return (forces[0] if given.ndim == 2 else forces).astype(np.float32)

    def step(self, observation: npt.ArrayLike) -> FloatArray:
        """The force (o,) for the newest observation (d,), with what it remembers of those before.

        A row of a DataFrame and a dict are taken by their names. NaN, and what a mask hides, gives
        NaN; where a state remembers it, also all forces until `reset`. Raises UnusableInput for
        another shape, a missing channel and what is no number.
        """
        if self._live is None:
            self._live = predictor_of(self.package)
        self._require_single(observation)
        return self._live.step(in_order(observation, self.manifest.observation))

    def _require_single(self, observation: npt.ArrayLike) -> None:
        """UnusableInput for a batch of one, which the loop gives, and gets a batch for."""
        try:
            shape = np.shape(observation)
        except ValueError:  # lists of several lengths: the step says so
            return
        if len(shape) == 2:
            names = [channel.name for channel in self.manifest.observation]
            raise UnusableInput(
                f"The observation has shape {shape}; give one of shape ({len(names)},):"
                f" {', '.join(names)}; a series is for predict."
            )

    def reset(self) -> None:
        """Forget everything that `step` was given."""
        if self._live is not None:
            self._live.reset()

    def check(self, rig: "Rig | PathLike | None" = None) -> "Replay | Proved":
        """Verify every promise that can be tried without torch.

        A package's example rollout is replayed in a process of its own and compared with what the
        training-time forward gave. The self-test of C is compiled and run.
        With a `rig` its rate [Hz], channels, forces and lead [s] have to be those of that rig's
        loop.

        Raises:
            CheckFailed: It does not do what it promises, or takes too long or too much memory.
            UnusableInput: It does not fit the rig.
        """
        checked = _checked(self.package)
        if rig is not None:
            self._require_fit(rig_of(rig))
        return checked

    def _require_fit(self, rig: "Rig") -> None:
        """UnusableInput where the loop of a rig cannot fly it."""
        from runtime.loop.loop import require_wait
        from runtime.request import require_fit

        require_fit(self.manifest, rig)
        require_wait(rig)

    def _error(self, channel: str) -> str:
        """The error on test episodes, where the package states it."""
        test = self.manifest.test
        return "" if test is None else f", test RMSE {test.rmse[channel]:.3g}"

    def __repr__(self) -> str:
        m = self.manifest
        observed = ", ".join(f"{c.name} [{c.unit}]" for c in m.observation)
        forces = ", ".join(f"{c.name} [{c.unit}]" for c in m.force)
        return (
            f"<Predictor {m.arch} of {self.path}: {observed} → {forces} {m.lead_s:g} s ahead at"
            f" {m.rate_hz:g} Hz, {m.trainable:,} trainable parameters>"
        )

    def _repr_html_(self) -> str:
        m = self.manifest
        rows = [
            *(["observes", f"{c.name} [{c.unit}]", f"{c.min:.3g} to {c.max:.3g} in training"]
              for c in m.observation),
            *(["predicts", f"{c.name} [{c.unit}]", f"{m.lead_s:g} s ahead{self._error(c.name)}"]
              for c in m.force),
            ["rate", f"{m.rate_hz:g} Hz", f"used from step {m.warm_up_steps} on"],
        ]  # fmt: skip
        title = f"{self.path}: {m.arch}, {m.trainable:,} trainable parameters"
        return html_table(title, ["", "", ""], rows)


def _checked(package: Flyable) -> "Replay | Proved":
    """A package replayed, or C proved again."""
    from runtime.compiled.proof import proved
    from runtime.trial import tried

    return tried(package) if isinstance(package, Package) else proved(package)


@in_python
def load(path: PathLike) -> Predictor:
    """Read a package, one `.onnx` file, or a folder of C, without torch.

    C is compiled when it first predicts. It is a program: load only one that you would run.

    Args:
        path: The file or the folder that `export` wrote.

    Returns:
        The predictor; `predictor.predict(observations)` takes (T, d) and gives forces (T, o), in
        the units that its manifest names.

    Raises:
        UnusableInput: What is there is absent, foreign, damaged, of another release, or asks for
            what no package may.
    """
    require_path(path)
    place = path_from(path, "path")
    _refuse_run(place)
    return Predictor(read_flyable(place), place)


def require_path(package: object) -> None:
    """UnusableInput for what names no file, as a run that was trained and not exported."""
    if not isinstance(package, str | os.PathLike) or not os.fspath(package):
        raise UnusableInput(
            f"{package!r:.80} is no path of a package; wd.export makes one of a trained run."
        )


def _refuse_run(path: Path) -> None:
    """UnusableInput for the folder of a run, finished or not."""
    if all((path / name).is_file() for name in RUN_FILES):
        raise UnusableInput(
            f"{path}: is the folder of a run; make a package of it by wd.export({str(path)!r}), or"
            " `wakedeploy export`, and load that."
        )


@in_python
def export(
    run: "TrainedRun | Runs | Predictor | PathLike",
    out: PathLike | None = None,
    *,
    data: "EpisodeSet | PathLike | None" = None,
    c: PathLike | None = None,
    progress: Progress = quiet,
    **as_c: Unpack[AsC],
) -> Predictor:
    """Turn a trained run into one self-contained file that the Pi runs, and into C.

    The exported graph is stepped beside the training-time forward over at least 3,200 samples; a
    difference above the limit (1e-5 of the force's range) leaves no file. With `c` it also becomes
    a folder of C, which is compiled here and passes the same gate.

    Args:
        run: A run, its folder, or what `train` returned for a single one. With `c` also a package
            or its file, which becomes C alone.
        out: The file to write. Default: `ARCH.onnx`.
        data: The set it was trained on. Default: where the run knows it to lie; for a package none.
        c: The new folder for C.
        progress: Called with a stage, the steps done and their number.
        **as_c: How C shall be: see `wakedeploy.api.compiled.AsC`.

    Returns:
        The predictor in the file, or with `c` the one in that folder: observations (T, d) to forces
        (T, o), in the units of its channels.

    Raises:
        UnusableInput: There is no such run, the set is another one than it was trained on, or C
            cannot be as it shall.
        CheckFailed: What was exported and the training-time forward differ, or rounded weights
            exceed their tolerance.
    """
    if c is None and as_c:
        raise UnusableInput(f"{', '.join(as_c)}: belongs to C; give c=FOLDER too.")
    if _is_file(run):
        run = load(run)
    if isinstance(run, Predictor):
        return _package_as_c(run.package, out, data, c, progress, as_c)
    from export.packaging import export_run
    from trainers.trained_run import episodes_of

    wish = None if c is None else wish_of(path_from(c, "c"), as_c)
    trained = _one_run(run)
    path = path_of(out, "out") or Path(f"{trained.config.arch}.onnx")
    episodes = episodes_of(trained) if data is None else episode_set(data)
    progress("Exporting", 0, 1)
    made = export_run(trained, episodes, path, lambda n, total: progress("Exporting", n, total))
    if c is None or wish is None:
        return Predictor(made, path)
    steps = _writing_c(progress)
    return _predictor_of_c(c_of_run(made, trained, path_from(c, "c"), wish, episodes, steps))


def _is_file(run: object) -> TypeGuard[PathLike]:
    """Whether a file is named, which is a package: a run is a folder."""
    return isinstance(run, str | os.PathLike) and at_home(Path(run)).is_file()


def _package_as_c(
    package: Flyable,
    out: PathLike | None,
    data: "EpisodeSet | PathLike | None",
    c: PathLike | None,
    progress: Progress,
    as_c: AsC,
) -> Predictor:
    """C of what is a package already; UnusableInput where that is not what is asked for."""
    if c is None or out is not None:
        raise UnusableInput("A package is exported already; give c=FOLDER for C of it, and no out.")
    if not isinstance(package, Package):
        raise UnusableInput(f"{package.path}: is C already; give its package or its run.")
    wish, episodes = wish_of(path_from(c, "c"), as_c), None if data is None else episode_set(data)
    steps = _writing_c(progress)
    return _predictor_of_c(c_of_package(package, path_from(c, "c"), wish, episodes, steps))


def _predictor_of_c(folder: "CFolder") -> Predictor:
    return Predictor(folder, folder.path)


def _writing_c(progress: Progress) -> Callable[[int, int], None]:
    return functools.partial(progress, "Writing C")


def _one_run(run: "TrainedRun | Runs | PathLike") -> "TrainedRun":
    """The run that is given; UnusableInput where several are."""
    from trainers.trained_run import TrainedRun, load_run
    from wakedeploy.api.training import Runs

    if isinstance(run, TrainedRun):
        return run
    if not isinstance(run, Runs):
        return load_run(path_from(run, "run"))
    if len(run) != 1:
        raise UnusableInput(
            f"{run.folder}: {len(run)} runs were trained; export one of them, such as runs[0] or"
            f' runs["{run[0].config.arch}"].'
        )
    return run[0]
