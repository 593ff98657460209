"""A whole run: open what is needed in order, fly, close everything, say how it went.

In: a `RunRequest`. Out: a `Tally`. Whatever ends the run, the motors idle and the log is closed.
"""

import contextlib
import datetime
import functools
import itertools
import platform
import signal
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.flyable import Flyable
from runtime.io.board import BoardNews, met_board
from runtime.io.live_feed import LiveFeed
from runtime.io.range_source import RangeSource, resting_range_m, wait_for_first
from runtime.io.realtime import Clock
from runtime.io.sd_notify import ServiceManager
from runtime.live_view import run_view
from runtime.loop.loop import PERIOD_S, Loop
from runtime.loop.prediction_worker import PredictionWorker
from runtime.loop.tally import Tally
from runtime.loop.watch import GapWatch
from runtime.place import Place, opened_place
from runtime.request import RunRequest, Show, Tell, Warn, wanted
from runtime.standby import begin_standby, stand_by
from runtime.verdict import judge, recording_sentence
from wakedeploy.core.errors import UnusableInput, WakedeployError, one_line, why
from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.version import VERSION
from wakedeploy.physics.effects.chain import unplaced_constants

if TYPE_CHECKING:
    from runtime.io.recorder import Recorder, RecorderReport

SHOW_PERIOD_S = 0.5
# A VL53L0X that nobody has calibrated is off by up to some cm; 5 cm of height are never noise.
OFF_THE_STOP_M = 0.05

_STOPPING = (signal.SIGINT, signal.SIGTERM)
_HANGING_UP = (signal.SIGHUP, signal.SIGQUIT)


def fly(
    request: RunRequest,
    tell: Tell | None = None,
    show: Show | None = None,
    warn: Warn | None = None,
    live: LiveFeed | None = None,
) -> Tally:
    """Carry out a run.

    `tell` gets the tally of every run that flew, however it ended, before anything is raised.
    `show` is called twice a second with the seconds done and those of the whole run. `warn` gets
    sentences about board and computer before a flight. During it, `warn` is called from another
    thread when the rig file stops or starts to explain the flight (`watch_gap`). `live` gets every
    row; its page may ask for the way down, as Ctrl-C does.

    Raises UnusableInput when it cannot begin, CheckFailed when it ended in a failsafe or was not
    recorded whole, KeyboardInterrupt after a stop by hand.
    """
    try:
        return _flown(request, tell, show, warn, live)
    except WakedeployError as error:
        _tell(live, phase="ended", reason=one_line(error))
        raise


def _flown(
    request: RunRequest,
    tell: Tell | None,
    show: Show | None,
    warn: Warn | None,
    live: LiveFeed | None,
) -> Tally:
    plan, package = wanted(request)
    with ExitStack() as opened:
        manager = ServiceManager()
        opened.callback(manager.close)
        beat = functools.partial(_beat, manager, live)
        place = opened_place(request, opened)
        link, ranges, clock = place.link, place.ranges, place.clock
        if request.arm_file is not None:
            _tell(
                live,
                phase="standby",
                arm_file=str(request.arm_file),
                **run_view(request, request.log),
            )
            _stand_by(request.arm_file, place, manager, beat, warn, _may_be_virtual(request))
            request = request.current()  # what is current now, not when the standby began
            plan, package = wanted(request, beat)
        forecast = place.predictions(package, opened) if package is not None else None
        board = met_board(link, may_be_virtual=_may_be_virtual(request))
        if warn is not None and board.warning is not None:
            warn(board.warning)
        wait_for_first(ranges, clock)
        if isinstance(forecast, PredictionWorker):
            forecast.wait_until_warm()
        if not plan.motors_off:
            _require_on_stop(ranges, request.rig, clock)
        recorder = _recorder(request, package, board, opened)
        log = recorder.path if recorder else None
        _tell(live, phase="about to fly", **run_view(request, log))
        del package  # its bytes have become a model; megabytes for the reservoir
        watch = GapWatch(request.rig, warn) if request.watch_gap else None
        loop = Loop(
            request.rig, link, ranges, plan, forecast, recorder, clock, watch, manager.beat,
            onlooker=live, is_timed=not place.is_simulated_time,
        )  # fmt: skip
        loop.tally.log = log
        if warn is not None and place.priority is not None:
            warn(place.priority.sentence)
        beat()  # the last moment at which a stop means: do not begin
        manager.ready("flying")
        _tell(live, phase="flying")
        place.settle()
        # A thread beside a loop of real-time priority is what that is to prevent.
        shown = None if place.is_realtime else show
        try:
            with _shown(loop, len(plan) * PERIOD_S, request.rig, shown), _no_log_of_nothing(loop):
                report = _fly_recorded(loop, recorder, manager)
        finally:
            _tell(live, phase="ended", ended=loop.tally.ended or "before take-off")
            if tell is not None and loop.tally.ticks:
                tell(loop.tally)
    said = recording_sentence(report)
    judge(loop, link, ranges, said, is_virtual=request.is_virtual, is_realtime=place.is_realtime)
    return loop.tally


def _beat(manager: ServiceManager, live: LiveFeed | None) -> None:
    """What is done again and again before a flight; a stop then ends the run, as Ctrl-C does."""
    manager.beat()
    if live is not None and live.stop_asked():
        raise KeyboardInterrupt


def _tell(live: LiveFeed | None, **news: object) -> None:
    if live is not None:
        live.tell(news)


def _stand_by(
    arm_file: Path,
    place: Place,
    manager: ServiceManager,
    beat: Callable[[], None],
    warn: Warn | None,
    may_be_virtual: bool,
) -> None:
    """Wait with the motors off until a person asks for this flight; a polite kill ends it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        forgotten = begin_standby(arm_file)
        met_board(place.link, may_be_virtual=may_be_virtual)
        wait_for_first(place.ranges, place.clock)
        if warn is not None:
            old = "An old one was taken away unheeded. " if forgotten else ""
            warn(f"{old}Standing by, motors off; to fly: touch {arm_file}")
        manager.ready(f"standing by, motors off; to fly: touch {arm_file}")
        stand_by(arm_file, place.link, place.ranges, beat)
        manager.status("about to fly")
    finally:
        signal.signal(signal.SIGTERM, before)


def _require_on_stop(ranges: RangeSource, rig: Rig, clock: Clock) -> None:
    """UnusableInput when the sensor at rest does not read what it reads on the stop."""
    range_m, bias_m = resting_range_m(ranges, clock), unplaced_constants(rig)["range.bias_m"]
    if abs(range_m - bias_m) > OFF_THE_STOP_M:
        raise UnusableInput(
            f"At rest the range sensor reads {range_m:.3f} m, and by the rig file it reads "
            f"{bias_m:.3f} m on the stop: take away what the sufferer lies on, or else measure "
            "range_sensor.bias_m with wakedeploy calibrate zero."
        )


def _may_be_virtual(request: RunRequest) -> bool:
    """Whether there is a plant process; its range socket is named where the port is, too."""
    return request.is_virtual or request.range_socket is not None


def _recorder(
    request: RunRequest, package: Flyable | None, board: BoardNews, opened: ExitStack
) -> "Recorder | None":
    if request.log is None:
        return None
    from runtime.io.recorder import Recorder  # with MCAP and its compressors

    started = datetime.datetime.now(datetime.UTC)
    log = _folder_or_file(request.log)
    known = metadata(
        request.rig, package, seed=request.seed, started=started, simulated=request.is_virtual
    )
    known |= board.metadata
    files = {"rig_file": request.rig_path, "package_file": request.package}
    known |= {key: path.name for key, path in files.items() if path is not None}
    if request.reference is not None:
        known |= {"reference_sha256": sha256_of(request.reference.read_bytes())}
    if request.is_virtual:
        known |= truth_metadata(request.truth, request.hooks)
    began_ns = int(started.timestamp() * 1e9) if request.in_lockstep else None
    begin = functools.partial(
        Recorder, metadata=known | dict(request.notes), simulated_from_ns=began_ns
    )
    recorder = _in_folder(log, started, begin) if log.is_dir() else begin(log)
    opened.callback(recorder.close)
    return recorder


def _in_folder(
    folder: Path, started: datetime.datetime, begin: "Callable[[Path], Recorder]"
) -> "Recorder":
    """A recording named by the flight's start; several flights may begin in the same second."""
    from runtime.io.recorder import Taken

    for number in itertools.count(1):
        again = f"-{number}" if number > 1 else ""
        with contextlib.suppress(Taken):
            return begin(folder / f"{started:%Y%m%dT%H%M%SZ}{again}.mcap")
    raise AssertionError("numbers do not end")


def _folder_or_file(log: Path) -> Path:
    """As given; a folder that is not there yet is made. Else every flight would be its one file."""
    if not log.suffix and not log.exists():
        try:
            log.mkdir(parents=True)
        except OSError as error:
            raise UnusableInput(
                f"{log}: no folder can be made ({why(error)}); name another place for --log."
            ) from error
    return log


def truth_metadata(plant_rig: Rig, hooks: str | None) -> dict[str, str]:
    """What a simulated run's log says about its plant: the rig that was true, and the hooks."""
    return {
        "plant_rig_toml": plant_rig.text,
        "plant_rig_sha256": plant_rig.sha256,
        "hooks": hooks or "",
    }


def metadata(
    rig: Rig, package: Flyable | None, *, seed: int, started: datetime.datetime, simulated: bool
) -> dict[str, str]:
    """What a run log says about its run."""
    return {
        "rig_toml": rig.text,
        "rig_sha256": rig.sha256,
        "package_sha256": package.sha256 if package else "",
        "lead_s": f"{package.manifest.lead_s:g}" if package else "",
        "seed": str(seed),
        "started_utc": started.isoformat(timespec="seconds"),
        "wakedeploy_version": VERSION,
        "python_version": platform.python_version(),
        "numpy_version": np.__version__,
        "onnxruntime_version": _onnxruntime_version(),
        "rate_hz": f"{LOOP_RATE_HZ:g}",
        "simulated": "true" if simulated else "false",
    }


def _onnxruntime_version() -> str:
    """Without loading it, which takes a quarter of a second and megabytes; "" where it is not."""
    try:
        return version("onnxruntime")
    except PackageNotFoundError:
        return ""


def _fly_recorded(
    loop: Loop, recorder: "Recorder | None", manager: ServiceManager
) -> "RecorderReport | None":
    """Run the loop; the recording is closed in any case."""
    with _stopping_by_hand(loop):
        try:
            loop.run()
        finally:
            # No beats from here.
            manager.stopping(f"ended: {loop.tally.ended or 'before take-off'}")
            report = recorder.close(loop.tally.ended) if recorder else None
    return report


@contextlib.contextmanager
def _no_log_of_nothing(loop: Loop) -> Iterator[None]:
    """A start that is refused leaves no log: it would stand in the way of the next one."""
    try:
        yield
    except UnusableInput:
        if loop.tally.log is not None and not loop.tally.ticks:
            loop.tally.log.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def _shown(loop: Loop, flight_s: float, rig: Rig, show: Show | None) -> Iterator[None]:
    """Show how far the loop is from a thread beside it, which only reads one counter."""
    if show is None:
        yield
        return
    total_s = flight_s + 2.0 * rig.disturbance.rest_s
    over = threading.Event()

    def run() -> None:
        while not over.wait(SHOW_PERIOD_S):
            show(loop.tally.ticks * PERIOD_S, total_s)

    thread = threading.Thread(target=run, name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(timeout=1.0)  # a terminal may be held for as long as someone likes


@contextlib.contextmanager
def _stopping_by_hand(loop: Loop) -> Iterator[None]:
    """Ctrl-C, a polite kill, a closed terminal bring the sufferer down; Ctrl-C again drops it.

    Nothing else drops it: a closing terminal is signalled by shell and kernel within a millisecond.
    Only the main thread hears any of it: in another one, where no rig is flown, all stays as it is.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ask(number: int, frame: types.FrameType | None) -> None:
        if loop.stop_asked and number == signal.SIGINT:
            loop.is_dropped = True
            raise KeyboardInterrupt
        loop.stop_asked = True

    # `nohup` asks that a closed terminal be nobody's concern.
    heard = [n for n in _HANGING_UP if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, ask) for number in (*_STOPPING, *heard)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
