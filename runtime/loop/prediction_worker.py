"""Predictions with a time limit: the model has a thread of its own, and the loop's wait ends.

onnxruntime releases the interpreter's lock while it computes, so the wait can end in time. A late
result is not used, but the model's memory has still seen its observation. C takes the same time
for every step and needs no thread if that time is short.
"""

import math
import queue
import statistics
import threading
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from runtime.io.realtime import Pacer, yield_to_the_loop
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import Manifest

FloatArray = npt.NDArray[np.float32]

AT_ONCE_S = 0.001  # waking a thread, 0.15 ms, is not worth it for a bounded step this short
WARM_UP_CALLS = 50
WARM_UP_LIMIT_S = 30.0
MOST_WAITING = 32  # observations; with more the memory is given up and filled anew


class Stepper(Protocol):
    """What the worker runs: `runtime.predictor.PackagePredictor`, or something shaped like it."""

    manifest: Manifest

    @property
    def ready(self) -> bool:
        """Whether the memory is full."""

    def reset(self) -> None:
        """Forget everything."""

    def step(self, observation: npt.ArrayLike) -> FloatArray:
        """The force (o,) for an observation (d,)."""


@dataclass(frozen=True, slots=True)
class Result:
    """A force [N] that came in time, and whether the memory was full when it was made."""

    force_n: float
    ready: bool


class Predictions(Protocol):
    """Where the loop asks for a force by a deadline. Trained ranges `low` and `high` are (d,)."""

    lead_s: float
    low: FloatArray
    high: FloatArray

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force for an observation (d,); None if it is not there by `deadline_s`."""

    def is_possible(self, force_n: float) -> bool:
        """Whether training has shown that a force [N] is possible; False for NaN."""

    def reset(self) -> None:
        """Forget the memory; the observations from now on fill it anew."""


def predicted(predictor: Stepper, observation: FloatArray) -> Result:
    """One step of a predictor; if it fails, NaN, which degrades the mode."""
    try:
        force_n = float(predictor.step(observation)[0])
    except Exception:  # onnxruntime's exceptions have no common base
        force_n = math.nan
    return Result(force_n, predictor.ready)


class PredictionWorker:
    """Owns a predictor and its thread; warms it up at the loop's pace.

    Steps that are `bounded` (they wait for nothing and always do the same work) are done by the
    caller itself if the warm-up has shown that they are short; the thread then ends.
    """

    def __init__(self, predictor: Stepper, period_s: float, *, bounded: bool = False) -> None:
        self._predictor, self._period_s = predictor, period_s
        self.lead_s = predictor.manifest.lead_s
        channels = predictor.manifest.observation
        self.low = np.array([c.min for c in channels], dtype=np.float32)  # (d,)
        self.high = np.array([c.max for c in channels], dtype=np.float32)  # (d,)
        self._asked: queue.SimpleQueue[tuple[int, FloatArray | None]] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[tuple[int, Result]] = queue.SimpleQueue()
        self._count = 0
        self._lost_one = False
        self._closing = False
        self._bounded, self._at_once = bounded, False
        self._warm = threading.Event()
        self.first_call_s = 0.0
        self._thread = threading.Thread(target=self._run, name="prediction", daemon=True)
        self._thread.start()

    def wait_until_warm(self) -> None:
        """Return when the warm-up calls are over; CheckFailed if they take too long."""
        if not self._warm.wait(WARM_UP_LIMIT_S):
            raise CheckFailed(
                f"The model's {WARM_UP_CALLS} warm-up calls were not over after "
                f"{WARM_UP_LIMIT_S:g} s: this machine is too slow for it, or too busy; see "
                "`wakedeploy doctor`."
            )

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force for an observation (d,); None if it is not there by `deadline_s`."""
        if self._at_once:
            result = predicted(self._predictor, observation)
            return result if time.monotonic() < deadline_s else None
        self._count += 1
        if self._asked.qsize() >= MOST_WAITING:
            self._lost_one = True
            return None
        if self._lost_one:
            self.reset()
        self._asked.put((self._count, observation))
        return self._await(deadline_s)

    def is_possible(self, force_n: float) -> bool:
        """Whether training has shown that a force [N] is possible; False for NaN."""
        return self._predictor.manifest.force[0].is_possible(force_n)

    def reset(self) -> None:
        """Forget the memory; the observations from now on fill it anew."""
        self._lost_one = False
        if self._at_once:
            self._predictor.reset()
        else:
            self._asked.put((self._count, None))

    def close(self) -> None:
        """End the thread after the step that it is in."""
        self._closing = True
        self.reset()
        self._thread.join(timeout=1.0)

    def _await(self, deadline_s: float) -> Result | None:
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            try:
                number, result = self._done.get(timeout=left_s)
            except queue.Empty:
                return None
            if number == self._count:
                return result
        return None

    def _run(self) -> None:
        # It inherits the loop's priority and core: the loop's timed wait could never interrupt it.
        yield_to_the_loop()
        self._warm_up()
        while not self._at_once:
            number, observation = self._asked.get()
            if self._closing:
                return
            if observation is None:
                self._predictor.reset()
            else:
                self._done.put((number, predicted(self._predictor, observation)))

    def _warm_up(self) -> None:
        """Call the model at the loop's pace until caches, clocks and allocations have settled."""
        observation = 0.5 * (self.low + self.high)
        started_s = time.monotonic()
        predicted(self._predictor, observation)
        self.first_call_s = time.monotonic() - started_s
        pacer, took_s = Pacer(self._period_s), list[float]()
        for _ in range(WARM_UP_CALLS - 1):
            pacer.wait()
            started_s = time.monotonic()
            predicted(self._predictor, observation)
            took_s.append(time.monotonic() - started_s)
        self._predictor.reset()
        self._at_once = self._bounded and statistics.median(took_s) < AT_ONCE_S
        self._warm.set()
