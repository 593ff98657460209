"""What a process that runs a stranger's work may take, and a program that runs under it.

In: limits, and a program. Out: the process has them from then on; or the program has run in a
process of its own, and how it ended. The kernel keeps them, should the parent be gone.
"""

import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from runtime.io.realtime import become_ordinary
from runtime.own_process import Ended, run_apart

_MIB = 1 << 20
_OWN_END_S = 1.0  # after the limit, should nobody be left to end it
_MOST_SAID_MIB = 16  # a program that prints for ever ends there


@dataclass(frozen=True)
class Limits:
    """What a trial may take: seconds, processor time, and memory beyond what libraries take.

    A reservoir of 4,000 neurons, the largest package, takes a quarter of the memory.
    """

    seconds: float = 240.0
    cpu_s: float = 120.0
    memory_mib: int = 1024


def limit(limits: Limits) -> None:
    """Let the kernel end this process; libraries have been loaded and do not count."""
    if sys.platform == "win32":
        return
    import resource

    signal.alarm(math.ceil(limits.seconds + _OWN_END_S))
    cpu_s = math.ceil(time.process_time() + limits.cpu_s)
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (_MOST_SAID_MIB * _MIB, _MOST_SAID_MIB * _MIB))
    if sys.platform == "linux":  # elsewhere the kernel does not count it
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + limits.memory_mib * _MIB
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def ordinary() -> None:
    """The loop that tries something anew may have real-time priority; this process has not."""
    if hasattr(os, "sched_getscheduler"):
        become_ordinary()


def run_limited(program: Path, limits: Limits, waiting: Callable[[], None] = lambda: None) -> Ended:
    """Run a program under limits until it ends; `waiting` is called again and again meanwhile.

    Raises TimeoutError after `limits.seconds`; the program is then killed, with those it started.
    """
    asked = json.dumps({"program": str(program), "limits": asdict(limits)})
    return run_apart("runtime.limits", asked, b"", seconds=limits.seconds, waiting=waiting)


def main() -> None:
    """In the process of its own: limits, then the program in this one's place."""
    asked = json.loads(sys.argv[1])
    ordinary()
    limit(Limits(**asked["limits"]))
    if sys.platform != "win32":
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores both, and so would it
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    os.execv(asked["program"], [asked["program"]])  # noqa: S606


if __name__ == "__main__":
    main()
