"""The worker around a model: waits no longer than told, forgets nothing, survives what raises."""

import math
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from runtime.io.realtime import FIFO_PRIORITY
from runtime.loop import prediction_worker
from runtime.loop.prediction_worker import PredictionWorker
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import ForceChannel, ObservationChannel

OBSERVATION = np.zeros(1, np.float32)


class Model:
    """Counts what it has seen since the last reset; holds while a test wants it to."""

    def __init__(self):
        channel = ObservationChannel(name="a", unit="1", min=-1.0, max=3.0)
        force = ForceChannel(name="f", unit="N", min=-1e6, max=1e6)
        told = {"observation": (channel,), "force": (force,), "lead_s": 0.09}
        self.manifest = type("Manifest", (), told)
        self.go = threading.Event()
        self.go.set()
        self.seen, self.broken = 0, False

    @property
    def ready(self):
        return self.seen >= 2

    def reset(self):
        self.seen = 0

    def step(self, observation):
        self.go.wait(10.0)
        if self.broken:
            raise RuntimeError("no such node")
        self.seen += 1
        return np.array([self.seen], np.float32)


@pytest.fixture
def model():
    return Model()


@pytest.fixture
def worker(model):
    made = PredictionWorker(model, 0.001)
    made.wait_until_warm()
    yield made
    model.go.set()
    made.close()


def soon():
    return time.monotonic() + 10.0


def test_after_the_warm_up_the_memory_is_empty_and_fills(worker):
    results = [worker.step(OBSERVATION, soon()) for _ in range(3)]
    assert [r.force_n for r in results] == [1.0, 2.0, 3.0]
    assert [r.ready for r in results] == [False, True, True]
    assert worker.first_call_s > 0.0
    assert (worker.low[0], worker.high[0]) == (-1.0, 3.0)


def test_a_model_that_does_not_get_warm_is_never_flown(model, monkeypatch):
    monkeypatch.setattr(prediction_worker, "WARM_UP_LIMIT_S", 0.05)
    model.go.clear()
    cold = PredictionWorker(model, 0.001)
    with pytest.raises(CheckFailed, match=r"not over after 0\.05 s"):
        cold.wait_until_warm()
    model.go.set()
    cold.close()


def test_a_late_result_is_not_used_but_its_observation_is_remembered(worker, model):
    worker.step(OBSERVATION, soon())
    model.go.clear()
    before_s = time.monotonic()
    assert worker.step(OBSERVATION, before_s + 0.05) is None
    assert worker.step(OBSERVATION, before_s) is None
    model.go.set()
    assert worker.step(OBSERVATION, soon()).force_n == 4.0


def test_a_reset_counts_from_there(worker):
    worker.step(OBSERVATION, soon())
    worker.reset()
    assert worker.step(OBSERVATION, soon()).force_n == 1.0


def test_a_model_that_raises_gives_no_number_and_goes_on(worker, model):
    model.broken = True
    assert math.isnan(worker.step(OBSERVATION, soon()).force_n)
    model.broken = False
    assert worker.step(OBSERVATION, soon()).force_n == 1.0


def test_a_model_that_hangs_piles_nothing_up_and_starts_anew(worker, model):
    model.go.clear()
    for _ in range(3 * prediction_worker.MOST_WAITING):
        assert worker.step(OBSERVATION, 0.0) is None
    assert worker._asked.qsize() <= prediction_worker.MOST_WAITING
    model.go.set()
    while worker._asked.qsize():
        time.sleep(0.001)
    assert worker.step(OBSERVATION, soon()).force_n == 1.0


def test_a_force_that_training_never_came_near_is_not_possible(model, worker):
    model.manifest.force = (ForceChannel(name="f", unit="N", min=-1.0, max=0.0),)
    assert not worker.is_possible(worker.step(OBSERVATION, soon()).force_n)  # 1, a width away
    assert worker.is_possible(0.4)
    assert not worker.is_possible(math.nan)


def where(model):
    """The threads that step a model, as it is used from now on."""
    found, step = set(), model.step

    def noted(observation):
        found.add(threading.current_thread().name)
        return step(observation)

    model.step = noted
    return found


@pytest.mark.parametrize(("bounded", "takes_s"), [(True, 0.0), (True, 0.002), (False, 0.0)])
def test_only_bounded_steps_that_are_short_are_done_by_the_loop_itself(bounded, takes_s):
    model = Model()
    step = model.step
    # A sleep of no time would let every other process go first.
    model.step = lambda observation: (takes_s and time.sleep(takes_s), step(observation))[1]
    worker = PredictionWorker(model, 0.001, bounded=bounded)
    worker.wait_until_warm()
    threads = where(model)
    here = bounded and takes_s == 0.0
    assert [worker.step(OBSERVATION, soon()).force_n for _ in range(2)] == [1.0, 2.0]
    assert threads == {threading.current_thread().name if here else "prediction"}
    worker.reset()
    assert worker.step(OBSERVATION, soon()).force_n == 1.0
    late = worker.step(OBSERVATION, time.monotonic())
    assert late is None
    worker.close()
    assert not worker._thread.is_alive()


needs_fifo = pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="needs SCHED_FIFO")


def thread_of_a_worker(model):
    """Policy and priority of a worker's thread, made by a thread of the loop's own priority."""
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    worker = PredictionWorker(model, 0.001)
    worker.wait_until_warm()
    number = worker._thread.native_id
    found = os.sched_getscheduler(number), os.sched_getparam(number).sched_priority
    worker.close()
    return found


@needs_fifo
def test_a_model_computes_below_a_loop_of_real_time(model):
    """At the loop's own priority the loop's timed wait could not end before the model does."""
    with ThreadPoolExecutor(1) as loop:  # a thread of its own: the tests stay as they were
        try:
            policy, priority = loop.submit(thread_of_a_worker, model).result()
        except PermissionError:
            pytest.skip("this user may not use SCHED_FIFO")
    assert policy == os.SCHED_FIFO  # an ordinary program could push it aside with the lock held
    assert 0 < priority < FIFO_PRIORITY


@needs_fifo
@pytest.mark.parametrize(("policy", "asked"), [("SCHED_FIFO", 1), ("SCHED_OTHER", 0)])
def test_the_worker_asks_for_less_where_it_has_inherited_real_time(
    policy, asked, model, monkeypatch
):
    calls = []

    def set_by_name(pid, to, param):
        calls.append((threading.current_thread().name, to, param.sched_priority))

    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: getattr(os, policy))
    monkeypatch.setattr(os, "sched_setscheduler", set_by_name)
    worker = PredictionWorker(model, 0.001)
    worker.wait_until_warm()
    worker.close()
    assert calls == [("prediction", os.SCHED_FIFO, 1)][:asked]
