"""Ticks on a grid of absolute times, with a clock that the test moves."""

import itertools
import os

import pytest

from runtime.io import realtime
from wakedeploy.core.errors import UnusableInput


class FakeTime:
    def __init__(self):
        self.now_s = 100.0

    def monotonic(self):
        return self.now_s

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now_s += seconds


def paced(work_s):
    """Tick indices, starts and skips when the ticks' work takes these times."""
    fake = FakeTime()
    pacer = realtime.Pacer(0.03125, fake)
    ticks = []
    for seconds in work_s:
        ticks.append(pacer.wait())
        fake.now_s += seconds
    return ticks


def test_ticks_stay_on_the_grid_whatever_the_work_takes():
    ticks = paced([0.001, 0.030, 0.010, 0.002])
    assert [t.index for t in ticks] == [0, 1, 2, 3]
    assert [t.start_s for t in ticks] == pytest.approx([100.0, 100.03125, 100.0625, 100.09375])
    assert [t.late_s for t in ticks] == pytest.approx([0.0] * 4)


def test_a_slow_tick_is_not_repaid_by_a_fast_one():
    ticks = paced([0.050, 0.001, 0.100, 0.001, 0.001])
    assert [t.index for t in ticks] == [0, 2, 3, 6, 7]
    assert [t.skipped for t in ticks] == [0, 1, 0, 2, 0]
    starts = [t.start_s + t.late_s for t in ticks]
    assert min(b - a for a, b in itertools.pairwise(starts)) >= 0.75 * 0.03125


def test_a_tick_may_begin_a_little_late_and_says_so():
    ticks = paced([0.032, 0.001, 0.001])
    assert [t.index for t in ticks] == [0, 1, 2]
    assert ticks[1].late_s == pytest.approx(0.00075)
    assert ticks[2].late_s == pytest.approx(0.0)


@pytest.mark.parametrize(("policy", "asked"), [(os.SCHED_FIFO, 2), (os.SCHED_OTHER, 0)])
def test_what_was_inherited_of_real_time_is_given_back(policy, asked, monkeypatch):
    calls = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: policy)
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, to, param: calls.append(to))
    monkeypatch.setattr(os, "sched_setaffinity", lambda pid, cores: calls.append(set(cores)))
    realtime.become_ordinary()
    assert calls == [os.SCHED_OTHER, set(range(os.cpu_count()))][:asked]


def test_a_machine_that_forbids_real_time_says_what_to_change(monkeypatch):
    def forbidden(*_):
        raise PermissionError

    monkeypatch.setattr(realtime.os, "sched_setscheduler", forbidden)
    with pytest.raises(UnusableInput, match=r"limits\.conf"):
        realtime.become_realtime()
