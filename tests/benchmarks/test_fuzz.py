"""Damaged files of every cheap kind, some of each: read, or refused in a sentence, at once.

`python -m benchmarks.fuzz` reads others for as long as it is asked to; docs/records/fuzz.json has
how many of which kind it has read. What it judges by is tested here, too.
"""

import os
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz import pool
from benchmarks.fuzz.judge import RAN_OUT, Judge, Verdict
from benchmarks.fuzz.kind import Kind
from benchmarks.fuzz.pool import Batch, Pool, Tally, judged, unread_sound
from benchmarks.fuzz.smallest import smallest
from wakedeploy.core.errors import CheckFailed, UnusableInput

FILES = {
    "rig": 100, "rig-update": 30, "log-csv": 100, "log-mcap": 60, "flight": 8, "reference": 200,
    "expression": 450, "episodes": 75, "run": 75, "run-interrupted": 8, "preset": 100,
    "study": 60, "sweep-plan": 75, "sweep-results": 12, "gap-steps": 50, "gap-add": 30,
    "gap-fits": 20, "gap-benchmark": 15, "fish": 20, "quadrotor": 20, "crazyflie": 30, "motor": 30,
    "table-csv": 50, "table-npz": 50, "table-mat": 10, "table-parquet": 30, "table-hdf5": 6,
    "table-mcap": 20, "table-rosbag": 10, "table-ros-mcap": 10, "table-ulog": 20,
    "table-columns": 50, "mjcf": 150, "own-log": 100, "own-answer": 100,
}  # fmt: skip
SEED = 1


@pytest.fixture
def judge(tmp_path: Path) -> Iterator[Judge]:
    judge = Judge(tmp_path, patience=5.0)  # where other tests run beside this one
    with judge.listening():
        yield judge


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.whole) if name == "table-hdf5" else name
        for name in FILES
    ],
)
def test_damaged_files_are_read_or_refused_in_a_sentence(name: str, judge: Judge) -> None:
    pytest.importorskip("torch")
    from benchmarks.fuzz.kinds import MAKE

    kind = MAKE[name]()
    assert unread_sound(kind) == []
    verdicts = [judged(judge, kind, SEED, number) for number in range(FILES[name])]
    failed = [f"{number}: {v.said}" for number, v in enumerate(verdicts) if v.outcome == "failed"]
    assert not failed, f"python -m benchmarks.fuzz --kind {name} --seed {SEED} --number {failed[0]}"
    assert sum(verdict.outcome == "refused" for verdict in verdicts) > 0.02 * len(verdicts)


def test_a_file_is_made_again_from_its_kind_seed_and_number() -> None:
    kind = kind_of(lambda folder: None)
    made = [kind.damaged(seed, number)[1] for seed in (0, 1) for number in range(40)]
    assert made == [kind.damaged(seed, number)[1] for seed in (0, 1) for number in range(40)]
    assert len({str(one) for one in made}) > 60


def kind_of(read: Callable[[Path], object], **changes: object) -> Kind:
    """A kind of small text files with a reader of its own."""
    sound = ({"a.txt": b"one\ntwo 2\nthree 3.5\n"}, {"a.txt": b"four 4\n", "b.txt": b"five\n"})
    return Kind("text", "texts", sound, read, **changes)


def refuse(sentence: str, cause: type[Exception] | None = None) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        try:
            raise (cause or ValueError)
        except ValueError:
            raise CheckFailed(sentence) from None
        except Exception as error:
            raise UnusableInput(sentence) from error

    return read


def warn(folder: Path) -> None:
    warnings.warn("divided by zero", RuntimeWarning, stacklevel=1)


def spin(folder: Path) -> None:
    began_s = time.process_time()
    while time.process_time() < began_s + 20.0:
        try:
            sum(range(1000))
        except Exception:
            continue


@pytest.mark.parametrize(
    ("read", "outcome", "trouble"),
    [
        (lambda folder: (folder / "a.txt").read_bytes(), "read", ""),
        (refuse("a.txt: it is damaged; copy it again."), "refused", ""),
        (refuse("a.txt: it is too large; copy it again.", MemoryError), "failed", "memory ran out"),
        (refuse("Something is damaged; copy it again."), "failed", "sentence without the file"),
        (refuse("a.txt"), "failed", "sentence that says nothing"),
        (lambda folder: {}["a"], "failed", "KeyError"),
        (lambda folder: [0][10**9], "failed", "IndexError"),
        (warn, "failed", "RuntimeWarning: divided by zero"),
        (lambda folder: print("hello"), "failed", "written: hello"),
        (lambda folder: os.write(2, b"from C"), "failed", "written: from C"),
    ],
)
def test_what_a_reader_does_is_judged(
    read: Callable[[Path], object], outcome: str, trouble: str, tmp_path: Path
) -> None:
    kind, judge = kind_of(read), Judge(tmp_path)
    sound, damaged = kind.sound[0], {"a.txt": b"damaged"}
    with judge.listening():
        verdict = judge.judged(kind, sound, damaged)
    assert (verdict.outcome, verdict.trouble[: len(trouble)]) == (outcome, trouble)


def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    kind, judge = kind_of(spin, slowest_s=0.2), Judge(tmp_path)
    with judge.listening():
        verdict = judge.judged(kind, kind.sound[0], {})
    assert (verdict.outcome, verdict.trouble) == ("failed", "Hang")
    assert verdict.seconds < 15.0


def test_damage_is_undone_before_the_next_file(judge: Judge) -> None:
    seen = []
    kind = kind_of(lambda folder: seen.append({p.name: p.read_bytes() for p in folder.iterdir()}))
    for damaged in ({"a.txt": b"x"}, {"c.txt": b"y"}, {}):
        judge.judged(kind, kind.sound[1], damaged)
    whole = dict(kind.sound[1])
    assert seen == [whole | {"a.txt": b"x"}, whole | {"c.txt": b"y"}, whole]


def test_a_failing_file_is_made_small(judge: Judge) -> None:
    def read(folder: Path) -> None:
        if b"six" in (folder / "a.txt").read_bytes():
            raise KeyError("six")

    kind = kind_of(read)
    damaged = {"a.txt": bytes(range(200)) + b"six" + bytes(500), "b.txt": b"x"}
    verdict = judge.judged(kind, kind.sound[0], damaged)
    assert smallest(judge, kind, kind.sound[0], damaged, verdict) == {"a.txt": b"six"}


@pytest.mark.whole
@pytest.mark.parametrize(
    ("reserve", "outcomes"), [(np.empty, {"refused"}), (np.ones, {"refused", "failed"})]
)
def test_memory_counts_that_is_written_not_what_is_asked_for(
    reserve: Callable[[int], object], outcomes: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    most_mib = 128  # less than workers have: what is written in vain is written sooner
    monkeypatch.setattr(pool, "MOST_MIB", most_mib)

    def read(folder: Path) -> None:
        try:
            large = b"\xff" in (folder / "a.txt").read_bytes()
            reserve((most_mib + 64) << 17 if large else 1)
        except MemoryError as error:
            raise UnusableInput(f"{folder}: states a size that is not its own.") from error
        raise UnusableInput(f"{folder}: is damaged, which shows further on.")

    kind = kind_of(read, ways={"*": lambda draw, data, other: draw.choice((b"\xff", b"x"))})
    tally, failures = Tally(), []
    for outcome in Pool({"text": kind}, 0, 1).outcomes(60.0):
        tally.join(outcome.tally)
        failures += outcome.failures
        if tally.files > 20:
            break
    assert {name for name in ("read", "refused", "failed") if getattr(tally, name)} == outcomes
    assert {failure.verdict.trouble for failure in failures} <= {RAN_OUT}


def test_a_reading_that_is_given_more_room_and_dies_of_it_ran_out_of_memory(tmp_path: Path) -> None:
    worker = os.getpid()

    def read(folder: Path) -> None:
        if os.getpid() != worker:
            os.kill(os.getpid(), signal.SIGKILL)
        raise UnusableInput("a.txt: no room for it; close something.") from MemoryError()

    kind, judge = kind_of(read), Judge(tmp_path)
    with judge.listening():
        verdict = judged(judge, kind, 0, 1)
    assert (verdict.outcome, verdict.trouble) == ("failed", RAN_OUT)


def test_workers_that_die_are_told_with_the_file_that_killed_them() -> None:
    def read(folder: Path) -> None:
        if not (folder / "a.txt").read_bytes():
            os.kill(os.getpid(), signal.SIGKILL)
        if b"\xff" in (folder / "a.txt").read_bytes():
            bytearray(1 << 30)

    kind = kind_of(read, ways={"*": lambda draw, data, other: draw.choice((b"", b"\xff", b"x"))})
    workers, failures, files = Pool({"text": kind}, 0, 1), [], 0
    troubles: set[str] = set()
    for outcome in workers.outcomes(60.0):
        failures += outcome.failures
        files += outcome.tally.files
        assert isinstance(outcome.batch, Batch)
        troubles |= {failure.verdict.trouble for failure in outcome.failures}
        if len(troubles) > 1:
            break
    assert troubles == {"killed by SIGKILL", "MemoryError"}
    assert files >= len(failures)
    for failure in failures:
        content = kind.damaged(0, failure.number)[1]["a.txt"]
        assert content == {"MemoryError": b"\xff"}.get(failure.verdict.trouble, b"")


def test_a_verdict_is_known_by_its_trouble_and_place() -> None:
    one = Verdict("failed", "at 3", "KeyError", "a.py:3")
    assert one.signature == Verdict("failed", "at 4", "KeyError", "a.py:3").signature
