"""Workers that read: each a fork of this process with a limit of memory, replaced when it dies.

The parent hands out batches (a kind, its first number, how many) and hears of each what became of
its files. Which number a worker is at stands in shared memory, so that what kills it is known.
"""

import collections
import contextlib
import json
import math
import mmap
import multiprocessing
import os
import resource
import signal
import struct
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path

from benchmarks.fuzz.judge import RAN_OUT, Judge, Verdict
from benchmarks.fuzz.kind import Files, Kind

MOST_MIB = 512  # of memory above what a worker begins with
_ROOM = 4  # times as much address space for one more reading, where address space ran out
_BATCH_S = 2.0
_GROWTH = 4  # times the batch before, at most: the first ones say little of their time
_MOST_SHARE = 30.0
_SILENT_S = 60.0  # of processor time: what hangs where no signal is heard
_FILES_PER_WORKER = 50_000
_FIRST_PATIENCE = 60.0  # with the first read, which imports and compiles
_EXAMPLES = 3  # of one failure that are kept
_fork = multiprocessing.get_context("fork")


@dataclass
class Tally:
    """What became of the files of one kind; `seconds` are the processor's, damaging included."""

    files: int = 0
    read: int = 0
    refused: int = 0
    failed: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    most_mib: float = 0.0

    def add(self, verdict: Verdict) -> None:
        """Count one file."""
        self.files += 1
        setattr(self, verdict.outcome, getattr(self, verdict.outcome) + 1)
        self.slowest_s = max(self.slowest_s, verdict.seconds)

    def join(self, other: "Tally") -> None:
        """Count those of another worker."""
        for name in ("files", "read", "refused", "failed", "seconds"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.most_mib = max(self.most_mib, other.most_mib)


@dataclass(frozen=True)
class Failure:
    """One file that was neither read nor refused as it should be."""

    kind: str
    number: int
    verdict: Verdict


@dataclass
class Batch:
    """Files of one kind in order of their numbers."""

    kind: str
    first: int
    count: int


@dataclass
class Outcome:
    """What came of a batch: what became of its files, and some of the failures."""

    batch: Batch
    tally: Tally = field(default_factory=Tally)
    failures: list[Failure] = field(default_factory=list)
    died_at: int | None = None  # the file that ended the worker, and with it what it had found


class Pool:
    """Runs batches on some workers until the time is over."""

    def __init__(self, kinds: Mapping[str, Kind], seed: int, workers: int) -> None:
        self._kinds, self._seed = kinds, seed
        self._workers = [_Worker(kinds, seed) for _ in range(workers)]
        self._next = dict.fromkeys(kinds, 0)
        self._spent_s: dict[str, float] = dict.fromkeys(kinds, 0.0)
        self._under_way: collections.Counter[str] = collections.Counter()
        self._read: collections.Counter[str] = collections.Counter()
        self._last: dict[str, int] = {}
        self._again: list[Batch] = []  # a dead worker's, around the file that ended it

    def outcomes(self, seconds: float) -> Iterator[Outcome]:
        """Batches as they end, until so much wall-clock time has gone by."""
        ends_s = time.monotonic() + seconds
        try:
            for worker in self._workers:
                worker.begin(self._batch())
            while any(worker.is_busy for worker in self._workers):
                for worker in self._ready():
                    outcome = worker.ended()
                    self._learn(outcome)
                    yield outcome
                    if time.monotonic() < ends_s:
                        worker.begin(self._batch())
        finally:
            for worker in self._workers:
                worker.close()

    def _ready(self) -> list["_Worker"]:
        """Workers that have ended a batch, have died, or have hung and are killed for it."""
        busy = [worker for worker in self._workers if worker.is_busy]
        ready = wait([worker.connection for worker in busy], timeout=1.0)
        for worker in busy:
            worker.kill_if_silent()
        return [worker for worker in busy if worker.connection in ready]

    def _batch(self) -> Batch:
        """The next files of the kind that had the least of its share of time.

        Kinds that are cheap to read have a larger one: by the root of files a second, to a bound.
        """
        if self._again:
            return self._again.pop()

        def due(name: str) -> float:
            coming_s = self._under_way[name] * _BATCH_S
            return (self._spent_s[name] + coming_s) / min(math.sqrt(self._rate(name)), _MOST_SHARE)

        name = min(self._kinds, key=due)
        count = min(self._wanted(name), _GROWTH * self._last.get(name, 1))
        self._last[name] = count
        batch = Batch(name, self._next[name], count)
        self._next[name] += count
        self._under_way[name] += 1
        return batch

    def _wanted(self, name: str) -> int:
        """As many files as take a batch's time, by all that were read before."""
        return max(1, round(self._rate(name) * _BATCH_S))

    def _rate(self, name: str) -> float:
        """Files of a kind in a second of the processor, as far as they were read."""
        return max(self._read[name], 1) / max(self._spent_s[name], 1e-3)

    def _learn(self, outcome: Outcome) -> None:
        name, tally = outcome.batch.kind, outcome.tally
        if outcome.died_at is not None:
            rest = _around(outcome.batch, outcome.died_at)
            self._again += rest
            self._under_way[name] += len(rest)
        self._under_way[name] -= 1
        self._spent_s[name] += tally.seconds
        self._read[name] += tally.files


def _around(batch: Batch, number: int) -> list[Batch]:
    """The files of a batch before and after one of them."""
    before, after = number - batch.first, batch.first + batch.count - number - 1
    parts = Batch(batch.kind, batch.first, before), Batch(batch.kind, number + 1, after)
    return [part for part in parts if part.count]


class _Worker:
    """One process at a time, in a folder of its own."""

    def __init__(self, kinds: Mapping[str, Kind], seed: int) -> None:
        self._kinds, self._seed = kinds, seed
        shared = "/dev/shm" if Path("/dev/shm").is_dir() else None
        self._folder = tempfile.TemporaryDirectory(prefix="wakedeploy-fuzz-", dir=shared)
        self._at = mmap.mmap(-1, 8)
        self._batch: Batch | None = None
        self._done = 0
        self._start()

    @property
    def is_busy(self) -> bool:
        """Whether it has a batch."""
        return self._batch is not None

    def begin(self, batch: Batch) -> None:
        """Hand it a batch."""
        if self._done > _FILES_PER_WORKER:
            self._stop()
            self._start()
        self._batch, self._seen, self._seen_s = batch, -1, 0.0
        self._at[:] = struct.pack("<q", batch.first)
        self.connection.send(batch)

    def ended(self) -> Outcome:
        """What came of the batch, also where the worker has died of it."""
        batch = self._batch
        assert batch is not None
        self._batch = None
        try:
            outcome: Outcome = self.connection.recv()
        except (EOFError, ConnectionError):
            return self._died(batch)
        self._done += outcome.tally.files
        return outcome

    def kill_if_silent(self) -> None:
        """End a process that spends a minute on one file: no signal reaches its interpreter."""
        at, spent_s = struct.unpack("<q", self._at[:])[0], _processor_s(self._process.pid)
        if at != self._seen:
            self._seen, self._seen_s = at, spent_s
        elif spent_s - self._seen_s > _SILENT_S:
            self._process.kill()

    def close(self) -> None:
        """End the process and remove its folder."""
        self._stop()
        self._folder.cleanup()

    def _died(self, batch: Batch) -> Outcome:
        self._process.join()
        code = self._process.exitcode or 0
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"
        number = struct.unpack("<q", self._at[:])[0]
        failure = Failure(batch.kind, number, Verdict("failed", how, how, "the process"))
        tally = Tally(files=1, failed=1)
        self._start()
        return Outcome(batch, tally, [failure], number)

    def _start(self) -> None:
        self.connection, theirs = _fork.Pipe()
        arguments = (theirs, self._kinds, self._seed, Path(self._folder.name), self._at)
        self._process = _fork.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        self._done = 0

    def _stop(self) -> None:
        with contextlib.suppress(OSError):
            self.connection.send(None)
        self._process.join(5)
        self._process.kill()
        self._process.join()
        self.connection.close()


def limit_memory() -> None:
    """Let this process take no more address space than so much above what it has."""
    _limit_memory(MOST_MIB)


def _limit_memory(most_mib: int) -> None:
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = taken * resource.getpagesize() + (most_mib << 20)
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def _processor_s(pid: int | None) -> float:
    """The processor time that a process has taken; 0 for one that is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _own_processor_s() -> float:
    """The processor time of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def _resident_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _work(
    connection: Connection, kinds: Mapping[str, Kind], seed: int, folder: Path, at: mmap.mmap
) -> None:
    """Read batch after batch until none comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_memory()
    judge = Judge(folder)
    with judge.listening():
        while (batch := connection.recv()) is not None:
            connection.send(_done(judge, kinds[batch.kind], seed, batch, at))


def _done(judge: Judge, kind: Kind, seed: int, batch: Batch, at: mmap.mmap) -> Outcome:
    outcome = Outcome(batch)
    alike: collections.Counter[tuple[str, str]] = collections.Counter()
    before_kib, began_s = _resident_kib(), _own_processor_s()
    for number in range(batch.first, batch.first + batch.count):
        at[:] = struct.pack("<q", number)
        verdict = judged(judge, kind, seed, number)
        outcome.tally.add(verdict)
        if verdict.outcome == "failed":
            alike[verdict.signature] += 1
            if alike[verdict.signature] <= _EXAMPLES:
                outcome.failures.append(Failure(kind.name, number, verdict))
    outcome.tally.seconds = _own_processor_s() - began_s
    outcome.tally.most_mib = (_resident_kib() - before_kib) / 1024
    return outcome


def judged(judge: Judge, kind: Kind, seed: int, number: int) -> Verdict:
    """The verdict on one file, which is made here; what fails in making it is a failure, too."""
    try:
        sound, damaged = kind.damaged(seed, number)
        verdict = judge.judged(kind, sound, damaged)
        if verdict.trouble == RAN_OUT:
            return _with_room(judge, kind, sound, damaged) or verdict
        return verdict
    except Exception:
        return Verdict("failed", traceback.format_exc()[-4000:], "the fuzzer itself", "benchmarks")


def _with_room(judge: Judge, kind: Kind, sound: Files, damaged: Files) -> Verdict | None:
    """Judged where there is address space for it: None if memory was taken, or it ran out again.

    A C library may ask for what a damaged header states, and refuse before it writes there: only
    pages that were written count.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            _limit_memory(MOST_MIB * _ROOM)
            spent_s = math.ceil(time.process_time() + _SILENT_S)
            resource.setrlimit(resource.RLIMIT_CPU, (spent_s, spent_s))
            before_kib = _resident_kib()
            verdict = judge.judged(kind, sound, damaged)
            fits = _resident_kib() - before_kib <= MOST_MIB << 10
            os.write(writing, json.dumps(asdict(verdict) if fits else None).encode())
        finally:
            os._exit(0)  # whatever happens, this is no second worker
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        found = pipe.read()
    os.waitpid(child, 0)
    answer = json.loads(found) if found else None  # nothing, if it has died
    verdict = None if answer is None else Verdict(**answer)
    return None if verdict is None or verdict.trouble == RAN_OUT else verdict


def unread_sound(kind: Kind) -> list[Failure]:
    """The sound folders of a kind, by their places, that its reader does not take."""
    with tempfile.TemporaryDirectory() as place:
        judge = Judge(Path(place), _FIRST_PATIENCE)
        with judge.listening():
            verdicts = [judge.judged(kind, sound, {}) for sound in kind.sound]
    return [Failure(kind.name, i, v) for i, v in enumerate(verdicts) if v.outcome != "read"]


def alone() -> None:
    """One thread for every library: a fork must find no others."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
