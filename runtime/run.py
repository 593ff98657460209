"""A whole run: open what is needed in order, fly, close everything, say how it went.

In: a `RunRequest`. Out: a `Tally`. Whatever ends the run, the motors idle and the log is closed.
"""

import contextlib
import datetime
import platform
import signal
import threading
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import onnxruntime as ort

import wakedeploy
from runtime.board import BoardNews, last_reset, met_board
from runtime.link import Link
from runtime.loop import PERIOD_S, Loop, require_wait
from runtime.pilot import OBSERVATION
from runtime.prediction import PredictionWorker
from runtime.predictor import PackagePredictor
from runtime.range_source import (
    I2cRangeSource,
    RangeSource,
    SocketRangeSource,
    resting_range_m,
    wait_for_first,
)
from runtime.realtime import become_realtime, quieten_interpreter
from runtime.recorder import Recorder, RecorderReport
from runtime.reference import FlightPlan, random_plan, require_plan_fits
from runtime.reference_file import read_reference
from runtime.sd_notify import ServiceManager
from runtime.standby import begin_standby, stand_by
from runtime.tally import Tally
from runtime.virtual.process import VirtualGantryProcess
from runtime.watch import GapWatch
from wakedeploy.errors import CheckFailed, UnusableInput, one_line
from wakedeploy.failsafes import HINTS
from wakedeploy.files import sha256_of
from wakedeploy.package import Manifest, Package, read_package
from wakedeploy.physics.effects.chain import unplaced_constants
from wakedeploy.rig import LOOP_RATE_HZ, Rig, read_rig

LEAD_TOLERANCE_S = 0.5 * PERIOD_S
SHOW_PERIOD_S = 0.5
# A VL53L0X that nobody has calibrated is off by up to some cm; 5 cm of height are never noise.
OFF_THE_STOP_M = 0.05

Tell = Callable[[Tally], None]
Show = Callable[[float, float], None]
Warn = Callable[[str], None]

_STOPPING = (signal.SIGINT, signal.SIGTERM)
_HANGING_UP = (signal.SIGHUP, signal.SIGQUIT)


@dataclass(frozen=True)
class RunRequest:
    """What to fly, on what. `port` None: the virtual gantry, with `plant_rig` as its truth.

    `rig_path` is the file that `rig` was read from; it is read again where a run has stood by.
    `reference`, a file, or `plan` replaces the random plan of `seconds` and `seed`. `range_socket`
    beside a `port` reads range samples from a plant process instead of I²C. With `firmware` the
    virtual gantry's UNO is the compiled sketch on a simulated chip; its sufferer lies on a spacer
    of `spacer_m`. A `log` that is a folder, or has no suffix, gets a file named by the flight's
    start. With an
    `arm_file` the run stands by until that file appears. `wake_off` leaves the source idle.
    `plant_seed` is the virtual gantry's chance, `seed` unless given; `notes` go into the log's
    metadata.
    """

    rig: Rig
    seconds: float
    seed: int = 0
    rig_path: Path | None = None
    reference: Path | None = None
    plan: FlightPlan | None = None
    package: Path | None = None
    port: str | None = None
    range_socket: Path | None = None
    plant_rig: Rig | None = None
    hooks: str | None = None
    firmware: bool = False
    spacer_m: float = 0.0
    log: Path | None = None
    arm_file: Path | None = None
    realtime: bool = False
    allow_lead_mismatch: bool = False
    watch_gap: bool = False
    wake_off: bool = False
    plant_seed: int | None = None
    notes: Mapping[str, str] = field(default_factory=dict)


def fly(
    request: RunRequest,
    tell: Tell | None = None,
    show: Show | None = None,
    warn: Warn | None = None,
) -> Tally:
    """Carry out a run.

    `tell` is given the tally of every run that flew, however it ended, before anything is raised;
    `show` is called twice a second with the seconds done and those of the whole run; `warn` gets a
    sentence, from another thread, whenever `watch_gap` finds that the rig file stops or starts to
    explain the flight.

    Raises UnusableInput when it cannot begin, CheckFailed when it ended in a failsafe or was not
    recorded whole, KeyboardInterrupt after a stop by hand.
    """
    plan, package = _wanted(request)
    with ExitStack() as opened:
        manager = ServiceManager()
        opened.callback(manager.close)
        port, range_socket = _plant(request, opened)
        if request.realtime:
            become_realtime()  # after the plant's process, which would inherit it
        link = opened.enter_context(Link(port))
        ranges = _ranges(range_socket, opened)
        if request.arm_file is not None:
            _stand_by(request.arm_file, link, ranges, manager, warn, _may_be_virtual(request))
            request = _current(request)  # what is current now, not when the standby began
            plan, package = _wanted(request)
        worker = _worker(package, opened)
        board = met_board(link, may_be_virtual=_may_be_virtual(request))
        if warn is not None and board.warning is not None:
            warn(board.warning)
        wait_for_first(ranges)
        if worker is not None:
            worker.wait_until_warm()
        if not plan.motors_off:
            _require_on_stop(ranges, request.rig)
        recorder = _recorder(request, package, board, opened)
        del package  # its bytes have become a model; megabytes for the reservoir
        watch = GapWatch(request.rig, warn) if request.watch_gap else None
        beat = manager.beat
        loop = Loop(request.rig, link, ranges, plan, worker, recorder, watch=watch, beat=beat)
        loop.tally.log = recorder.path if recorder else None
        manager.ready("flying")
        try:
            with _shown(loop, len(plan) * PERIOD_S, request.rig, show):
                report = _fly_recorded(loop, recorder, manager)
        finally:
            if tell is not None and loop.tally.ticks:
                tell(loop.tally)
    _judge(loop, link, ranges, _recording_told(report))
    return loop.tally


def require_fit(manifest: Manifest, rig: Rig, allow_lead_mismatch: bool = False) -> None:
    """UnusableInput when a package cannot serve this loop: rate, channels, or lead."""
    if abs(manifest.rate_hz - LOOP_RATE_HZ) > 1e-6:
        raise UnusableInput(
            f"The package runs at {manifest.rate_hz:g} Hz and the gantry's loop at "
            f"{LOOP_RATE_HZ:g} Hz; train one on gantry data."
        )
    names = tuple(channel.name for channel in manifest.observation)
    if names != tuple(name for name, _ in OBSERVATION) or len(manifest.force) != 1:
        raise UnusableInput(
            f"The package observes {', '.join(names)}: it is not for the gantry; train one on "
            "gantry data."
        )
    if abs(manifest.lead_s - rig.default_lead_s) > LEAD_TOLERANCE_S and not allow_lead_mismatch:
        raise UnusableInput(
            f"The package predicts {manifest.lead_s:g} s ahead and this rig's commands act after "
            f"{rig.default_lead_s:g} s; train with --lead {rig.default_lead_s:g}, or fly it all "
            "the same with --allow-lead-mismatch."
        )


def _wanted(request: RunRequest) -> tuple[FlightPlan, Package | None]:
    """What is to be flown and with what, read and judged."""
    plan = _plan(request)
    require_plan_fits(plan, request.rig)
    if request.package is None:
        return plan, None
    package = read_package(request.package)
    require_fit(package.manifest, request.rig, request.allow_lead_mismatch)
    require_wait(request.rig)
    return plan, package


def _current(request: RunRequest) -> RunRequest:
    """The request with the rig as its file is now; the plant that was started stays what it is."""
    if request.rig_path is None:
        return request
    plant_rig = request.plant_rig or request.rig
    return replace(request, rig=read_rig(request.rig_path), plant_rig=plant_rig)


def _stand_by(
    arm_file: Path,
    link: Link,
    ranges: RangeSource,
    manager: ServiceManager,
    warn: Warn | None,
    may_be_virtual: bool,
) -> None:
    """Wait with the motors off until a person asks for this flight; a polite kill ends it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        forgotten = begin_standby(arm_file)
        met_board(link, may_be_virtual=may_be_virtual)
        wait_for_first(ranges)
        if warn is not None:
            old = "An old one was taken away unheeded. " if forgotten else ""
            warn(f"{old}Standing by, motors off; to fly: touch {arm_file}")
        manager.ready(f"standing by, motors off; to fly: touch {arm_file}")
        stand_by(arm_file, link, ranges, manager.beat)
        manager.status("about to fly")
    finally:
        signal.signal(signal.SIGTERM, before)


def _require_on_stop(ranges: RangeSource, rig: Rig) -> None:
    """UnusableInput when the sensor at rest does not read what it reads on the stop."""
    range_m, bias_m = resting_range_m(ranges), unplaced_constants(rig)["range.bias_m"]
    if abs(range_m - bias_m) > OFF_THE_STOP_M:
        raise UnusableInput(
            f"At rest the range sensor reads {range_m:.3f} m, and by the rig file it reads "
            f"{bias_m:.3f} m on the stop: take away what the sufferer lies on, or else measure "
            "range_sensor.bias_m with wakedeploy calibrate zero."
        )


def _plan(request: RunRequest) -> FlightPlan:
    """What is given, the reference file's plan, or a random one; without wake if that is asked."""
    if request.plan is not None:
        plan = request.plan
    elif request.reference is not None:
        plan = read_reference(request.reference, request.rig)
    else:
        plan = random_plan(request.rig, request.seconds, request.seed)
    return plan.without_wake(request.rig.limits.pulse_us[0]) if request.wake_off else plan


def _plant(request: RunRequest, opened: ExitStack) -> tuple[str, Path | None]:
    """The port to talk to; for the virtual gantry its process and its range socket."""
    if request.port is not None:
        return request.port, request.range_socket
    truth = request.plant_rig or request.rig
    gantry = VirtualGantryProcess(
        truth,
        seed=request.seed if request.plant_seed is None else request.plant_seed,
        hooks=request.hooks,
        firmware=request.firmware,
        spacer_m=request.spacer_m,
    )
    opened.callback(gantry.close)
    return gantry.port, gantry.range_socket


def _worker(package: Package | None, opened: ExitStack) -> PredictionWorker | None:
    if package is None:
        return None
    worker = PredictionWorker(PackagePredictor(package), PERIOD_S)
    opened.callback(worker.close)
    return worker


def _ranges(range_socket: Path | None, opened: ExitStack) -> RangeSource:
    source = SocketRangeSource(range_socket) if range_socket else I2cRangeSource()
    opened.callback(source.close)
    return source


def _may_be_virtual(request: RunRequest) -> bool:
    """Whether there is a plant process; its range socket is named where the port is, too."""
    return request.port is None or request.range_socket is not None


def _recorder(
    request: RunRequest, package: Package | None, board: BoardNews, opened: ExitStack
) -> Recorder | None:
    if request.log is None:
        return None
    is_virtual = request.port is None
    started = datetime.datetime.now(datetime.UTC)
    log = _folder_or_file(request.log)
    if log.is_dir():
        log = log / f"{started:%Y%m%dT%H%M%SZ}.mcap"
    told = metadata(
        request.rig,
        package,
        seed=request.seed,
        started=started,
        simulated=is_virtual,
    )
    told |= board.metadata
    if request.reference is not None:
        told |= {"reference_sha256": sha256_of(request.reference.read_bytes())}
    if is_virtual:
        told |= truth_metadata(request.plant_rig or request.rig, request.hooks)
    recorder = Recorder(log, told | dict(request.notes))
    opened.callback(recorder.close)
    return recorder


def _folder_or_file(log: Path) -> Path:
    """As given; a folder that is not there yet is made. Else every flight would be its one file."""
    if not log.suffix and not log.exists():
        try:
            log.mkdir(parents=True)
        except OSError as error:
            raise UnusableInput(f"{log}: no folder can be made ({one_line(error)}).") from error
    return log


def truth_metadata(plant_rig: Rig, hooks: str | None) -> dict[str, str]:
    """What a simulated run's log says about its plant: the rig that was true, and the hooks."""
    return {
        "plant_rig_toml": plant_rig.text,
        "plant_rig_sha256": plant_rig.sha256,
        "hooks": hooks or "",
    }


def metadata(
    rig: Rig, package: Package | None, *, seed: int, started: datetime.datetime, simulated: bool
) -> dict[str, str]:
    """What a run log says about its run."""
    return {
        "rig_toml": rig.text,
        "rig_sha256": rig.sha256,
        "package_sha256": package.sha256 if package else "",
        "lead_s": f"{package.manifest.lead_s:g}" if package else "",
        "seed": str(seed),
        "started_utc": started.isoformat(timespec="seconds"),
        "wakedeploy_version": wakedeploy.__version__,
        "python_version": platform.python_version(),
        "numpy_version": np.__version__,
        "onnxruntime_version": ort.__version__,
        "rate_hz": f"{LOOP_RATE_HZ:g}",
        "simulated": "true" if simulated else "false",
    }


def _fly_recorded(
    loop: Loop, recorder: Recorder | None, manager: ServiceManager
) -> RecorderReport | None:
    """Run the loop; the recording is closed in any case."""
    quieten_interpreter()
    with _stopping_by_hand(loop):
        try:
            loop.run()
        finally:
            # No beats from here.
            manager.stopping(f"ended: {loop.tally.ended or 'before take-off'}")
            report = recorder.close() if recorder else None
    return report


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


def _recording_told(report: RecorderReport | None) -> str:
    """What is wrong with a recording that is not whole; "" if it is."""
    if report and report.error:
        return f"{report.error}; {report.written} ticks are in the log, {report.dropped} are not."
    if report and report.dropped:
        return (
            f"{report.dropped} of {report.dropped + report.written} ticks were not recorded: the "
            "disk is too slow; record to another one."
        )
    return ""


@contextlib.contextmanager
def _stopping_by_hand(loop: Loop) -> Iterator[None]:
    """Ctrl-C, a polite kill, a closed terminal bring the sufferer down; Ctrl-C again drops it.

    Only that: of a closing terminal both the shell and the kernel tell, within a millisecond.
    """

    def ask(number: int, frame: types.FrameType | None) -> None:
        if loop.stop_asked and number == signal.SIGINT:
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


def _judge(loop: Loop, link: Link, ranges: RangeSource, recording: str) -> None:
    """CheckFailed naming what ended the flight, what to do about it, and what is not recorded."""
    cause = loop.failsafe_cause
    if recording and (not cause or cause[0] in ("recorder_failed", "operator_stop")):
        raise CheckFailed(recording)
    # What else was found in the same tick comes first: a unit bound to the port is also told to
    # stop when the cable is pulled.
    if cause[:1] == ("operator_stop",):
        raise KeyboardInterrupt
    if cause:
        # A port that is gone explains whatever else is, then a sensor that says why it stopped.
        failed = ranges.failure if "sensor_lost" in cause else None
        why = link.failure or failed or HINTS[cause[0]]
        if reset := last_reset(loop.last_reset):
            why += f"; its last reset: {reset}"
        told = f"The flight ended in a failsafe ({'+'.join(cause)}): {why}"
        raise CheckFailed(f"{told}. {recording}" if recording else told)
