"""Fly the gantry, virtual or real, and look at what was recorded."""

import dataclasses
import functools
import math
import numbers
import os
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack, get_args, overload

from wakedeploy.api.arguments import MOST_PROCESSES, in_python, real, whole
from wakedeploy.api.display import data_frame
from wakedeploy.api.inputs import PathLike, path_of, rig_of
from wakedeploy.core import figures
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.names import unknown
from wakedeploy.core.run_summary import RunSummary, summarise
from wakedeploy.core.runlog import Array, RunLog, read_run_log
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.wording import counted

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from runtime.flights import Flight as Flown
    from runtime.flights import Mean
    from runtime.io.live_feed import LiveFeed
    from runtime.loop.tally import Tally
    from runtime.request import RunRequest
    from wakedeploy.api.predictors import Predictor
    from wakedeploy.core.rig import Rig

SECONDS = 20.0  # of a random plan
SHORTEST_S, LONGEST_S = 1.0, 3600.0  # of one
MOST_FLIGHTS = 10_000
Backend = Literal["onnx", "c"]
_PATHS = ("range_socket", "reference", "arm_file")  # of a place


class Place(TypedDict, total=False):
    """Where and how to fly, beside what `fly` asks for; `runtime.request.RunRequest` says more.

    `port` is the UNO's serial port (default: the virtual gantry, in simulated time), `range_socket`
    where range samples come from then, `realtime` whether the loop takes real-time priority.
    `wall_clock`, `firmware`, `plant_rig`, `hooks` and `plant_seed` belong to the virtual gantry: in
    real time, with the sketch on a simulated UNO, what it is in truth, what disturbs it.
    `reference` is a CSV to fly instead of a random plan, `arm_file` a file to wait for. `wake_off`
    leaves the source idle. `watch_gap` warns when the rig file explains the flight no more.
    `allow_lead_mismatch` flies a package made for another lead. `backend` "onnx" computes a package
    by onnxruntime, "c" as C, which is written and proved once and kept; without it a file flies by
    onnxruntime and a folder as the C that it is.
    """

    port: PathLike | None
    range_socket: PathLike | None
    realtime: bool | None
    wall_clock: bool
    firmware: bool
    plant_rig: "Rig | PathLike | None"
    hooks: str | None
    plant_seed: int | None
    reference: PathLike | None
    arm_file: PathLike | None
    wake_off: bool
    watch_gap: bool
    allow_lead_mismatch: bool
    backend: Backend | None


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """One flight: its run log, a row per tick of 1/32 s, and where it was recorded.

    `flight["z_est_m"]` is a column (T,); its name ends with its unit (`_m`, `_s`, `_n`, `_mps`,
    `_us`). `ended` is "whole", or what ended it; "" if the log does not say. KeyError for an
    unknown column; UnusableInput from `read` for a file that is no run log.
    """

    log: RunLog
    path: Path | None = None
    ended: str = ""
    unrecorded_rmse_m: float = math.nan  # what the loop counted, where there is no log

    @classmethod
    def read(cls, path: PathLike) -> "Flight":
        """Read a recorded flight, `.mcap` or `.csv`.

        An unfinished recording is read as far as it goes. UnusableInput for what is no run log.
        """
        path = path_from(path, "path")
        log = read_run_log(path)
        return cls(log, path, log.metadata.get("ended", ""))

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, column: str) -> Array:
        if column not in self.log:
            raise KeyError(unknown(column, "column of this flight", self.log.columns))
        return self.log[column]

    @property
    def rmse_mm(self) -> float:
        """RMS error of the height while flying [mm]: the true height's in a simulation.

        At a rig, where nobody knows it, the estimated one's. NaN for what never flew.
        """
        if not len(self.log):
            return 1e3 * self.unrecorded_rmse_m
        return 1e3 * self.log.tracking_rmse_m("true_z_m" if "true_z_m" in self.log else "z_est_m")

    @functools.cached_property
    def summary(self) -> RunSummary:
        """The flight in numbers: tracking [m], timing [s], modes, faults, what was lost."""
        return summarise(self.log)

    def to_pandas(self) -> "pandas.DataFrame":
        """A row per tick, indexed by `t_s` [s]; missing values are NaN. Needs pandas.

        Raises UnusableInput where pandas is not installed.
        """
        return data_frame(self.log.columns, index="t_s")

    def plot(self) -> "Figure":
        """A matplotlib figure: height [m], its error [mm], force [N], commands [µs], timing [ms].

        A notebook shows it. `figure.savefig(path)` keeps it. UnusableInput for a flight that was
        not recorded.
        """
        if self._is_unrecorded:
            raise UnusableInput(
                "Nothing of this flight was recorded, so there is nothing to draw; fly it again "
                "with record=True, or with log=FILE."
            )
        from wakedeploy.core.run_figure import draw_run

        title = "Flight" if self.path is None else self.path.name
        return figures.showing_itself(draw_run(self.log, self.summary, title))

    def __repr__(self) -> str:
        name = "" if self.path is None else f" {self.path}"
        ended = f", ended {self.ended}" if self.ended else ""
        flying_s, cut = self.summary.flying_s, "unfinished" in self.log.metadata
        has_flown = flying_s > 0.0 or not math.isnan(self.unrecorded_rmse_m)
        error = f", RMSE {self.rmse_mm:.1f} mm" if has_flown else ""
        if self._is_unrecorded and has_flown:
            return f"<Flight: not recorded{error}{ended}>"
        flight = f"{len(self)} ticks, {flying_s:.1f} s under control{error}{ended}"
        return f"<Flight{name}: {flight}{', cut off' if cut else ''}>"

    @property
    def _is_unrecorded(self) -> bool:
        """Whether there never was a log; one without ticks lies in a file."""
        return not len(self) and self.path is None

    def _repr_png_(self) -> bytes | None:
        """The picture for a notebook, which shows the text alone where there is none."""
        return None if self._is_unrecorded else figures.png_of(self.plot())


@dataclass(frozen=True, eq=False, repr=False)
class Flights(Sequence[Flight]):
    """Flights of one controller, each with a seed of its own.

    `rmse_mm` is the mean error of the height [mm] over those that ended whole, `rmse_se_mm` its
    standard error (NaN for one flight). `baseline` are the same plans flown by PID alone, None
    where these are such flights. `flights[0]` is a `Flight`, its columns (T,), whose log is read
    then; UnusableInput where it was not recorded.
    """

    flown: "tuple[Flown, ...]"
    baseline: "Flights | None" = None
    folder: Path | None = None
    _logs: dict[int, RunLog] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.flown)

    @overload
    def __getitem__(self, which: int) -> Flight: ...
    @overload
    def __getitem__(self, which: slice) -> Sequence[Flight]: ...
    def __getitem__(self, which: int | slice) -> Flight | Sequence[Flight]:
        if isinstance(which, slice):
            return [self[i] for i in range(*which.indices(len(self)))]
        flown = self.flown[which]
        path = None if self.folder is None else self.folder / flown.log_name
        if flown.seed in self._logs:
            return Flight(self._logs[flown.seed], path, flown.ended)
        if path is None:
            raise UnusableInput(
                f"The flight of seed {flown.seed} was not recorded; fly it again with record=True,"
                " or with log=FOLDER."
            )
        return Flight(read_run_log(path), path, flown.ended)

    @property
    def rmse_mm(self) -> float:
        """Mean RMS error of the true height [mm] over those that ended whole; NaN for none."""
        return 1e3 * self._mean().value_m

    @property
    def rmse_se_mm(self) -> float:
        """The standard error of `rmse_mm` [mm]."""
        return 1e3 * self._mean().standard_error_m

    @property
    def gain(self) -> "Mean | None":
        """PID's error less this one's, flight by flight: mean and standard error [m]."""
        from runtime.flights import gain_of

        return None if self.baseline is None else gain_of([*self.baseline.flown, *self.flown])

    @property
    def gain_mm(self) -> float:
        """The mean of `gain` [mm]; NaN for flights of PID alone."""
        return math.nan if self.gain is None else 1e3 * self.gain.value_m

    @property
    def ended_early(self) -> "tuple[Flown, ...]":
        """Those that did not end whole, PID's included."""
        from runtime.flights import WHOLE

        return tuple(flight for flight in self.all_flown if flight.ended != WHOLE)

    def to_pandas(self) -> "pandas.DataFrame":
        """A row per flight: controller, seed, how it ended, RMSE [mm]; PID's are among them.

        Raises UnusableInput where pandas is not installed.
        """
        rows = self.all_flown
        return data_frame(
            {
                "controller": [row.controller for row in rows],
                "seed": [row.seed for row in rows],
                "ended": [row.ended for row in rows],
                "rmse_mm": [1e3 * row.rmse_m for row in rows],
            }
        )

    def plot(self) -> "Figure":
        """A matplotlib figure: each flight's RMSE [mm] by its seed, the means as lines."""
        with figures.style():
            drawn, axes = figures.figure(size=(7.0, 3.2))
            for flights, colour in ((self.baseline, figures.LIMIT), (self, figures.MEASURED)):
                if flights is None:
                    continue
                errors_mm = [1e3 * flight.rmse_m for flight in flights.flown]
                label = f"{flights._controller}: {flights._rmse_text}"
                seeds = [flight.seed for flight in flights.flown]
                axes.plot(seeds, errors_mm, "o", markersize=4, color=colour, label=label)
                axes.axhline(flights.rmse_mm, color=colour, linewidth=0.8)
            axes.set(xlabel="seed of the flight", ylabel="RMSE [mm]")
            axes.set_ylim(bottom=0.0)
            axes.xaxis.get_major_locator().set_params(integer=True)
            figures.legend(axes, ncols=1)
        return figures.showing_itself(drawn)

    @property
    def all_flown(self) -> "tuple[Flown, ...]":
        """Every flight in numbers, PID's first: controller, seed, how it ended, RMSE [m]."""
        return (*(() if self.baseline is None else self.baseline.flown), *self.flown)

    def _mean(self) -> "Mean":
        from runtime.flights import mean_of

        return mean_of(self.flown, self.flown[0].controller)

    @property
    def _controller(self) -> str:
        from runtime.flights import PID

        return "PID alone" if self.flown[0].controller == PID else "PID and feedforward"

    @property
    def _rmse_text(self) -> str:
        error = "" if math.isnan(self.rmse_se_mm) else f" ± {self.rmse_se_mm:.1f}"
        return f"RMSE {self.rmse_mm:.1f}{error} mm"

    def __repr__(self) -> str:
        text = f"<{counted(len(self), 'Flight')}, {self._controller}: {self._rmse_text}"
        other = "" if self.baseline is None else f"; PID alone {self.baseline.rmse_mm:.1f} mm"
        early = len(self.ended_early)
        return f"{text}{other}{f'; {early} ended early' if early else ''}>"

    def _repr_png_(self) -> bytes:
        return figures.png_of(self.plot())


@overload
def fly(
    package: "Predictor | PathLike | None" = ...,
    *,
    flights: None = ...,
    rig: "Rig | PathLike | None" = ...,
    seconds: float = ...,
    seed: int = ...,
    log: PathLike | None = ...,
    record: bool = ...,
    workers: int = ...,
    progress: Progress = ...,
    tell: "Callable[[Tally], None]" = ...,
    warn: Callable[[str], None] | None = ...,
    live: "LiveFeed | None" = ...,
    **place: Unpack[Place],
) -> Flight: ...


@overload
def fly(
    package: "Predictor | PathLike | None" = ...,
    *,
    flights: int,
    rig: "Rig | PathLike | None" = ...,
    seconds: float = ...,
    seed: int = ...,
    log: PathLike | None = ...,
    record: bool = ...,
    workers: int = ...,
    progress: Progress = ...,
    tell: "Callable[[Tally], None]" = ...,
    warn: Callable[[str], None] | None = ...,
    **place: Unpack[Place],
) -> Flights: ...


@in_python
def fly(
    package: "Predictor | PathLike | None" = None,
    *,
    flights: int | None = None,
    rig: "Rig | PathLike | None" = None,
    seconds: float = SECONDS,
    seed: int = 0,
    log: PathLike | None = None,
    record: bool = True,
    workers: int = 2,
    progress: Progress = quiet,
    tell: "Callable[[Tally], None]" = lambda tally: None,
    warn: Callable[[str], None] | None = None,
    live: "LiveFeed | None" = None,
    **place: Unpack[Place],
) -> Flight | Flights:
    """Fly the gantry at 32 Hz: at rest, a random plan, at rest again.

    Without a `port` it is the virtual gantry in simulated time: much faster than real time, and the
    same to the digit on computers of one architecture.

    Args:
        package: The predictor whose force [N] is fed forward. None: PID alone.
        flights: So many, of seeds from `seed` on, PID alone beside the package. None: one flight.
        rig: The rig, or its file. Default: the default rig.
        seconds: Of the random plan [s], 1 to 3600; 3 s of rest come before and after.
        seed: Of the plan, and of the virtual gantry's chance.
        log: Record here: a file for one flight, a folder for several.
        record: Without a `log`, keep the run log in memory. False: only the errors are known.
        workers: Processes for several flights.
        progress: Called with a stage, and the flights or seconds done and their number.
        tell: Called with the tally of a single flight, however it ended, before anything is raised.
        warn: Called with sentences of the board and the computer during a single flight.
        live: Where a single flight's rows go as they come (`wakedeploy.live`).
        **place: Where and how: see `wakedeploy.api.flights.Place`.

    Returns:
        A `Flight` whose columns are (T,), one value per tick; several as `Flights`, those of the
        package, with PID's as their `baseline`.

    Raises:
        UnusableInput: The flight cannot begin; the sentence says why.
        CheckFailed: A single flight ended in a failsafe, or was not recorded whole.
        KeyboardInterrupt: It was stopped by hand.
    """
    if flights is not None:
        flights = whole("flights", flights, 1, MOST_FLIGHTS)
    workers = whole("workers", workers, 1, MOST_PROCESSES)
    if live is not None and not callable(getattr(live, "stop_asked", None)):
        raise UnusableInput(f"live is {live!r:.60}: give what wakedeploy.live makes, or None.")
    request = request_of(package, rig, seconds, seed, log, **place)
    with tempfile.TemporaryDirectory() as temporary:
        kept = request.log is None and record
        if kept:
            request = dataclasses.replace(request, log=_inside(Path(temporary), flights))
        if flights is None:
            return _one_flown(request, kept, progress, tell, warn, live)
        return _many_flown(request, flights, kept, workers, progress)


def request_of(
    package: "Predictor | PathLike | None",
    rig: "Rig | PathLike | None",
    seconds: float,
    seed: int,
    log: PathLike | None = None,
    **place: Unpack[Place],
) -> "RunRequest":
    """What to fly, as the loop takes it."""
    from runtime.request import RunRequest
    from wakedeploy.core.rig import Rig

    _require_plan(seconds, seed)
    if (chance := place.get("plant_seed")) is not None:
        _require_seed("plant_seed", chance)
    others: dict[str, Any] = dict(place)
    path = _package_path(package)
    if _flies_c(others.pop("backend", None), path):
        from export.c.kept import kept_c

        others["as_c"] = kept_c
    if (plant := others.pop("plant_rig", None)) is not None:
        others["plant_rig"] = rig_of(plant, "plant_rig")
    for name in _PATHS:
        if name in others:
            others[name] = path_of(others[name], name)
    _require_stop_by_hand(others)
    if others.get("port") is not None:
        others["port"] = os.fspath(path_from(others["port"], "port"))
    return RunRequest(
        rig=rig_of(rig),
        rig_path=None if isinstance(rig, Rig) else path_of(rig, "rig"),
        package=path,
        seconds=seconds,
        seed=seed,
        log=path_of(log, "log"),
        **others,
    )


def _require_stop_by_hand(place: Mapping[str, object]) -> None:
    """UnusableInput for a rig in a thread beside the main one, which alone hears Ctrl-C."""
    asked = next((n for n in ("port", "arm_file") if place.get(n) is not None), None)
    if asked is not None and threading.current_thread() is not threading.main_thread():
        raise UnusableInput(
            f"{asked} is for a rig, and this is not the main thread, which alone hears Ctrl-C; fly"
            " it there, or in a process of its own."
        )


def _require_plan(seconds: object, seed: object) -> None:
    """UnusableInput for a random plan that no gantry flies."""
    real("seconds", seconds, SHORTEST_S, LONGEST_S)
    _require_seed("seed", seed)


def _require_seed(name: str, seed: object) -> None:
    if not isinstance(seed, numbers.Integral) or isinstance(seed, bool) or int(seed) < 0:
        raise UnusableInput(f"{name} is {seed!r:.60}: give a whole number from 0 on.")


def _package_path(package: "Predictor | PathLike | None") -> Path | None:
    """The file of a package; UnusableInput for a trained run, and whatever else has none."""
    from wakedeploy.api.predictors import Predictor, require_path

    if isinstance(package, Predictor):
        return package.path
    if package is not None:
        require_path(package)
    return path_of(package, "package")


def _flies_c(backend: str | None, package: Path | None) -> bool:
    """Whether C is to be made of a package; UnusableInput where nothing flies as it is asked."""
    if backend is None:
        return False
    if backend not in get_args(Backend):
        raise UnusableInput(
            f"backend {backend!r}: packages fly by {' or '.join(get_args(Backend))}."
        )
    if package is None:
        raise UnusableInput("A backend belongs to a package; PID alone has nothing to predict.")
    if backend == "onnx" and package.is_dir():
        raise UnusableInput(
            f"{package}: a folder of C flies as C; give the package that it was made from, or leave"
            " the backend out."
        )
    return backend == "c"


def _inside(folder: Path, flights: int | None) -> Path:
    """Where a recording goes that is read back at once: a file, or a folder for several."""
    return folder / "flight.mcap" if flights is None else folder


def _one_flown(
    request: "RunRequest",
    kept: bool,
    progress: Progress,
    tell: "Callable[[Tally], None]",
    warn: Callable[[str], None] | None,
    live: "LiveFeed | None",
) -> Flight:
    from runtime.run import fly as run

    failed: list[Exception] = []

    def show(done_s: float, total_s: float) -> None:
        try:
            if not failed:
                progress("Flying", round(done_s), round(total_s))
        except Exception as error:  # in a thread beside the loop, and no reason to end a flight
            failed.append(error)

    tally = run(request, tell=tell, show=None if progress is quiet else show, warn=warn, live=live)
    if failed:
        raise failed[0]
    if tally.log is None:
        rmse_m = tally.true_rmse_m if request.is_virtual else tally.rmse_m
        return Flight(RunLog.from_rows([]), None, tally.ended, rmse_m)
    log = read_run_log(tally.log)
    return Flight(log, None if kept else tally.log, tally.ended)


def _many_flown(
    request: "RunRequest", flights: int, kept: bool, workers: int, progress: Progress
) -> Flights:
    from runtime.flights import FEEDFORWARD, PID, fly_many

    if not request.in_lockstep:
        raise UnusableInput(
            "Several flights are flown in simulated time, by the virtual gantry alone: leave port"
            " and wall_clock out."
        )
    if request.watch_gap:
        raise UnusableInput("watch_gap belongs to a single flight; leave it out.")
    steps = functools.partial(progress, "Flying")
    steps(0, flights * (1 if request.package is None else 2))
    flown = fly_many(request, flights, workers=workers, progress=steps)
    baseline = _collected(
        [flight for flight in flown if flight.controller == PID], request.log, kept
    )
    if request.package is None:
        return baseline
    fed = _collected(
        [flight for flight in flown if flight.controller == FEEDFORWARD], request.log, kept
    )
    return dataclasses.replace(fed, baseline=baseline)


def _collected(flown: "Sequence[Flown]", folder: Path | None, kept: bool) -> Flights:
    """One controller's flights; with their logs in memory where the folder will not last."""
    if folder is None or not kept:
        return Flights(tuple(flown), folder=folder)
    logs = {flight.seed: read_run_log(folder / flight.log_name) for flight in flown}
    return Flights(tuple(flown), _logs=logs)
