"""Latency as it will be: the real loop, paced at 32 Hz, flying the virtual gantry over its port.

In: packages, a number of ticks. Out: one row per package, measured in a process of its own. The
model runs on its package's example inputs, so that any domain's package can be measured; its force
is computed and then not flown.
"""

import functools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.flyable import Flyable, inputs_of, is_bounded, predictor_of, read_flyable
from runtime.io.link import Link
from runtime.io.range_source import SocketRangeSource, wait_for_first
from runtime.io.realtime import loop_core, quieten_interpreter, take_priority
from runtime.loop.loop import PERIOD_S, Loop, budget_s, require_wait
from runtime.loop.pilot import OBSERVATION
from runtime.loop.prediction_worker import PredictionWorker
from runtime.reference import hold_plan
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.manifest import ObservationChannel
from wakedeploy.core.rig import Rig
from wakedeploy.rig.file import default_rig, parse_rig

ENOUGH_TICKS = 3000  # for a p99.9
STARTING_S = 8.0  # reboot, warm-up and imports, for the progress bar
LIMIT_S = 60.0
_UNBOUNDED = 1e9

Progress = Callable[[int, int], None]
Spread = dict[str, float]  # p50, p99, p999 and max


@dataclass(frozen=True)
class BenchRow:
    """One package's figures; times in ms from measurement received to command written."""

    arch: str
    ticks: int
    p50_ms: float
    p99_ms: float
    p999_ms: float
    max_ms: float
    cpu_percent: float  # of one core, the loop's process alone
    rss_mb: float  # in flight, 10⁶ bytes
    first_call_ms: float
    overruns: int
    realtime: bool  # with SCHED_FIFO, locked memory, a core of its own
    stages_ms: dict[str, Spread] = field(default_factory=dict)

    @property
    def is_preliminary(self) -> bool:
        """Whether there are too few ticks for a p99.9."""
        return self.ticks < ENOUGH_TICKS

    def within(self, budget_ms: float) -> bool:
        """Whether p99.9, or the maximum where there are too few ticks, stays below the budget."""
        return (self.max_ms if self.is_preliminary else self.p999_ms) < budget_ms


def bench_latency(
    packages: Sequence[Path],
    *,
    ticks: int,
    realtime: bool | None = None,
    busy: bool = False,
    rig: Rig | None = None,
    progress: Progress = lambda done, total: None,
) -> list[BenchRow]:
    """Measure packages one after the other; `busy` loads the other cores meanwhile.

    `realtime` None takes the loop's priority where the computer permits it.

    Raises UnusableInput for a package, a rig or a machine that cannot be used, CheckFailed when a
    measuring process ended badly.
    """
    used = rig or default_rig()
    require_wait(used)
    for path in packages:
        read_flyable(path)  # a bad one is refused before minutes are spent on the others
    total, rows = len(packages) * ticks, []
    with _busy_cores() if busy else ExitStack():
        for number, path in enumerate(packages):
            request = {"package": str(path), "ticks": ticks, "realtime": realtime, "rig": used.text}
            advanced = functools.partial(_advanced, progress, number * ticks, total)
            rows.append(_measured(request, advanced))
    progress(total, total)
    return rows


def _advanced(progress: Progress, before: int, total: int, here: int) -> None:
    progress(before + here, total)


def _measured(request: dict[str, Any], advanced: Callable[[int], None]) -> BenchRow:
    """One row, from a process that does nothing else."""
    ticks = int(request["ticks"])
    process = subprocess.Popen(
        [sys.executable, "-m", "runtime.bench"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps(request) + "\n")
    process.stdin.close()
    process.stdin = None
    started_s, limit_s = time.monotonic(), LIMIT_S + ticks * PERIOD_S
    try:
        out = _await(process, lambda s: advanced(_ticks_after(s, ticks)), started_s, limit_s)
    except BaseException:
        process.kill()
        process.wait()
        raise
    return _row_of(out, str(request["package"]))


def _await(
    process: "subprocess.Popen[str]",
    elapsed: Callable[[float], None],
    started_s: float,
    limit_s: float,
) -> str:
    while (since_s := time.monotonic() - started_s) < limit_s:
        try:
            return process.communicate(timeout=0.5)[0]
        except subprocess.TimeoutExpired:
            elapsed(since_s)
    raise CheckFailed(f"A measuring process had not ended after {limit_s:.0f} s; see `doctor`.")


def _ticks_after(seconds: float, ticks: int) -> int:
    return min(max(0, int((seconds - STARTING_S) / PERIOD_S)), ticks - 1)


def _row_of(out: str, package: str) -> BenchRow:
    try:
        answer = json.loads(out.strip().rpartition("\n")[2])
    except ValueError as error:
        raise CheckFailed(
            f"{package}: the measuring process died; its message is above."
        ) from error
    if "unusable" in answer:
        raise UnusableInput(answer["unusable"])
    if "failed" in answer:
        raise CheckFailed(answer["failed"])
    return BenchRow(**answer)


class Replayed:
    """A package's predictor fed with its own example, which stands in for the gantry's channels."""

    def __init__(self, package: Flyable) -> None:
        self._predictor = predictor_of(package)
        self._inputs, self._next = inputs_of(package), 0
        anything = tuple(
            ObservationChannel(name=name, unit=unit, min=-_UNBOUNDED, max=_UNBOUNDED)
            for name, unit in OBSERVATION
        )
        self.manifest = package.manifest.model_copy(update={"observation": anything})

    @property
    def ready(self) -> bool:
        """Whether the memory is full."""
        return self._predictor.ready

    def reset(self) -> None:
        """Forget everything."""
        self._predictor.reset()

    def step(self, observation: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """A step's whole work, and no force (1,)."""
        self._predictor.step(self._inputs[self._next % len(self._inputs)])
        self._next += 1
        return np.zeros(1, dtype=np.float32)


def measure(path: Path, ticks: int, realtime: bool | None, rig: Rig) -> BenchRow:
    """Fly `ticks` ticks with a package in this process, and time them."""
    package = read_flyable(path)
    predictor = Replayed(package)
    arch = predictor.manifest.arch
    rig = rig.changed(disturbance={"rest_s": 0.0})
    with ExitStack() as opened:
        gantry = opened.enter_context(VirtualGantryProcess(rig, seed=0))
        is_realtime = take_priority(realtime).is_realtime
        worker = PredictionWorker(predictor, PERIOD_S, bounded=is_bounded(package))
        del package  # its bytes have become a model
        opened.callback(worker.close)
        link = opened.enter_context(Link(gantry.port))
        ranges = SocketRangeSource(gantry.range_socket)
        opened.callback(ranges.close)
        link.handshake()
        wait_for_first(ranges)
        worker.wait_until_warm()
        # Half the range of both motors: the gantry hovers under a steady wake.
        plan = hold_plan(rig, ticks * PERIOD_S, 0.4 * rig.sufferer.travel_m, 1500.0)
        loop = Loop(rig, link, ranges, plan, worker)
        quieten_interpreter()
        cpu_s, wall_s = time.process_time(), time.monotonic()
        loop.run()
        cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
        rss_mb = resident_mb()
    if loop.failsafe_cause:
        raise CheckFailed(
            f"The measuring flight ended in a failsafe ({'+'.join(loop.failsafe_cause)}): this "
            "machine is too busy to pace the virtual gantry."
        )
    return _as_row(arch, loop, worker, 100.0 * cpu_s / wall_s, rss_mb, is_realtime)


def _as_row(
    arch: str,
    loop: Loop,
    worker: PredictionWorker,
    cpu_percent: float,
    rss_mb: float,
    is_realtime: bool,
) -> BenchRow:
    tally = loop.tally
    stages = {name: _spread(np.asarray(times)) for name, times in tally.stages_s.items()}
    stages["wake-up"] = _spread(np.asarray(tally.wake_ups_s))
    total = _spread(tally.totals_s)
    return BenchRow(
        arch=arch,
        ticks=tally.ticks,
        p50_ms=total["p50"],
        p99_ms=total["p99"],
        p999_ms=total["p999"],
        max_ms=total["max"],
        cpu_percent=cpu_percent,
        rss_mb=rss_mb,
        first_call_ms=1e3 * worker.first_call_s,
        overruns=tally.overruns,
        realtime=is_realtime,
        stages_ms=stages,
    )


def _spread(times_s: npt.NDArray[np.float64]) -> Spread:
    p50, p99, p999, top = np.percentile(1e3 * times_s, [50.0, 99.0, 99.9, 100.0])
    return {"p50": float(p50), "p99": float(p99), "p999": float(p999), "max": float(top)}


def resident_mb() -> float:
    """This process's resident memory now, in 10⁶ bytes; NaN where Linux is not."""
    try:
        text = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return float("nan")
    return float(text.split("VmRSS:")[1].split()[0]) * 1024 / 1e6


_SPIN = """
import os, sys
os.sched_setaffinity(0, {int(sys.argv[1])})
while os.getppid() == int(sys.argv[2]):  # so that it ends with the process that started it
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def _busy_cores() -> Iterator[None]:
    """Keep every core but the loop's at work."""
    others, here = sorted(os.sched_getaffinity(0) - {loop_core()}), str(os.getpid())
    spinning = [
        subprocess.Popen([sys.executable, "-c", _SPIN, str(core), here])  # noqa: S603 - fixed text
        for core in others
    ]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def main() -> None:
    """Measure as standard input says; the last line of standard output is the row."""
    request = json.loads(sys.stdin.readline())
    answer: dict[str, Any]
    try:
        rig = parse_rig(request["rig"], "rig")
        row = measure(Path(request["package"]), request["ticks"], request["realtime"], rig)
        answer = asdict(row)
    except UnusableInput as error:
        answer = {"unusable": str(error)}
    except CheckFailed as error:
        answer = {"failed": str(error)}
    sys.stdout.write(json.dumps(answer) + "\n")


def budget_ms(rig: Rig) -> float:
    """The budget of `runtime.loop` in ms."""
    return 1e3 * budget_s(rig)


if __name__ == "__main__":
    main()
