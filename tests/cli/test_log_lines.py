"""Without a terminal, stderr tells what is done, how far it is and how long the rest takes."""

import time

import pytest

from wakedeploy.cli import log_lines
from wakedeploy.cli.log_lines import LogLines, Stages, duration, stages
from wakedeploy.cli.output import progress

SILENT_S = log_lines._SILENT_S  # before the other tests' commands are silenced


class Clock:
    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(log_lines, "_SILENT_S", SILENT_S)
    monkeypatch.setattr("wakedeploy.cli.log_lines.time", clock)
    return clock


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err.splitlines()


def worked(told: LogLines, clock: Clock, steps: int, total: int, step_s: float) -> None:
    for done in range(1, steps + 1):
        clock.now_s += step_s
        told.tick()
        told.update(done, total)


def test_each_tenth_is_a_line_with_the_time_left(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Flying", 200)
    worked(told, clock, 200, 200, 0.25)  # 50 s
    told.end()
    printed = lines(capsys)
    assert printed[:3] == [
        "Flying …",  # nothing was said for two seconds
        "Flying: 10 %, 5 s so far",
        "Flying: 20 %, about 40 s left",
    ]
    assert printed[-2:] == ["Flying: 90 %, 45 s so far", "Flying: done in 50 s"]
    assert len(printed) == 11


def test_steps_before_say_nothing_of_the_time_left(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Training", 10, done=2)
    clock.now_s += 45.0
    told.update(3, 10)
    assert lines(capsys) == ["Training: 30 %, about 5 min left"]  # 7 of 45 s
    told = LogLines("Training", 10)
    told.update(2, 10)  # at once: done by an earlier command
    clock.now_s += 90.0
    told.update(4, 10)
    assert lines(capsys) == ["Training: 40 %, about 4 min left"]  # 6 of 45 s


def test_quick_tenths_are_two_seconds_apart(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Importing", 100)
    worked(told, clock, 100, 100, 0.0625)  # a tenth takes 0.6 s
    told.end()
    assert [line.split(",")[0] for line in lines(capsys)] == [
        "Importing …",
        "Importing: 64 %",
        "Importing: 96 %",
        "Importing: done in 6 s",
    ]


def test_what_takes_less_than_two_seconds_is_silent(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Training", 10)
    worked(told, clock, 10, 10, 0.19)
    told.end()
    assert lines(capsys) == []


def test_long_tenths_get_a_line_a_minute(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    told = LogLines("Jobs", 100, counted=True)
    worked(told, clock, 9, 100, 45.0)  # less than a tenth
    printed = lines(capsys)
    assert printed[0] == "Jobs …"
    assert "Jobs: 4 of 100, about 71 min left" in printed  # 96 of 45 s, of which one is done
    assert 4 <= len(printed) <= 1 + 9 * 45 / 60


def test_a_long_step_is_known_to_go_on(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    told = LogLines("Trials", 4, counted=True)
    for _ in range(400):
        clock.now_s += 0.5
        told.tick()
    assert lines(capsys) == [
        "Trials …",
        "Trials: 0 of 4, 62 s so far",
        "Trials: 0 of 4, 2 min so far",
        "Trials: 0 of 4, 3 min so far",
    ]


def test_time_left_never_grows_while_a_step_takes_longer_than_those_before(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Fitting", 3)
    clock.now_s += 120.0
    told.update(1, 3)
    for _ in range(600):
        clock.now_s += 0.5
        told.tick()
    assert lines(capsys) == [
        "Fitting: 33 %, about 4 min left",
        "Fitting: 33 %, about 3 min left",
        "Fitting: 33 %, about 2 min left",
        "Fitting: 33 %, 5 min so far",
        "Fitting: 33 %, 6 min so far",
        "Fitting: 33 %, 7 min so far",
    ]


def test_another_description_stands_in_the_lines(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = LogLines("Trials", 4)
    told.describe("1 of 4 trials, best 0.5")
    clock.now_s += 10.0
    told.update(1, 4)
    assert lines(capsys) == ["1 of 4 trials, best 0.5: 25 %, about 30 s left"]


def test_a_stage_is_told_when_it_begins_and_how_far_it_is(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    told = Stages()
    told.tick()
    told("fitting the rig file")
    clock.now_s += 60.0
    told.tick()
    told("trying 4 effects")
    for done in range(1, 5):
        clock.now_s += 3.0
        told("trying 4 effects", done, 4)
    assert lines(capsys) == [
        "… fitting the rig file",
        "… fitting the rig file: 60 s so far",
        "… trying 4 effects",
        "… trying 4 effects: 25 %, 3 s so far",
        "… trying 4 effects: 50 %, 6 s so far",
        "… trying 4 effects: 75 %, 9 s so far",
    ]


def test_quick_steps_promise_nothing_of_what_follows_them(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ranking: forty effects are looked at, then the best are fitted, which takes far longer."""
    told, stage = Stages(), "ranking effects"
    for done in range(1, 41):
        clock.now_s += 0.1
        told(stage, done, 46)
    clock.now_s += 100.0
    told.tick()
    told(stage, 46, 46)
    clock.now_s += 100.0
    told.tick()
    printed = lines(capsys)
    assert not any("left" in line for line in printed)
    assert printed[-2:] == [
        "… ranking effects: 87 %, 2 min so far",
        "… ranking effects: 3 min so far",  # not 100 %: it still goes on
    ]


def test_without_a_terminal_the_clock_is_watched_while_a_block_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(log_lines, "_SILENT_S", 0.05)
    monkeypatch.setattr(log_lines, "_LOOK_S", 0.01)
    with progress("Exporting", 1):
        time.sleep(0.3)
    with stages() as told:
        told("drawing")
    assert lines(capsys) == ["Exporting …", "Exporting: done in 1 s", "… drawing"]


def test_a_failure_is_not_told_as_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(log_lines, "_SILENT_S", 0.0)
    with pytest.raises(ZeroDivisionError), progress("Exporting", 1):
        raise ZeroDivisionError
    assert not any("done" in line for line in lines(capsys))


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.2, "1 s"), (12.4, "12 s"), (99.4, "99 s"), (99.6, "2 min"), (5400.0, "90 min"),
     (9000.0, "2.5 h")],
)  # fmt: skip
def test_times_are_said_in_their_unit(seconds: float, said: str) -> None:
    assert duration(seconds) == said
