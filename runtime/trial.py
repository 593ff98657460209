"""A package is tried in a process of its own, with an end to its time and its memory.

In: a package that has been read, so that its graph is known to be bounded. Out: how its replay came
out, or CheckFailed that says which limit it exceeded. What its bytes do to onnxruntime, a crash or
a hang, ends that process and not the one that is about to fly; Ctrl-C ends it at once.
"""

import json
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from runtime.limits import Limits, limit, ordinary
from runtime.own_process import Ended, run_apart
from runtime.replay import Difference, Replay, replay
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import Package, package_from_bytes

LIMITS = Limits()
_passed: dict[str, Replay] = {}


def require_trial(package: Package, waiting: Callable[[], None] = lambda: None) -> Replay:
    """`tried`, but once for each package in this process: of many flights the first one pays."""
    if package.sha256 not in _passed:
        _passed[package.sha256] = tried(package, waiting=waiting)
    return _passed[package.sha256]


def tried(
    package: Package, limits: Limits = LIMITS, waiting: Callable[[], None] = lambda: None
) -> Replay:
    """Replay a package in a process of its own; `waiting` is called again and again meanwhile.

    Raises CheckFailed where a check fails, where a limit is exceeded or the process dies, and
    UnusableInput where onnxruntime does not take the model.
    """
    asked = json.dumps(asdict(limits))
    try:
        ended = run_apart(
            "runtime.trial", asked, package.model_bytes, seconds=limits.seconds, waiting=waiting
        )
    except TimeoutError as error:
        raise CheckFailed(
            f"The package's trial had not ended after {limits.seconds:g} s: do not fly it; or, if"
            " the computer is busy, try again."
        ) from error
    return _answer(ended, limits)


def _answer(ended: Ended, limits: Limits) -> Replay:
    if ended.status == -signal.SIGXCPU:
        raise CheckFailed(
            f"The package's trial took more than {limits.cpu_s:g} s of processor time: do not fly"
            " it, its steps are too slow for this computer."
        )
    if ended.status != 0:
        raise CheckFailed(f"The package's trial {ended.why}: do not fly it.")
    answer: dict[str, Any] = json.loads(ended.out)
    if "unusable" in answer:
        raise UnusableInput(answer["unusable"])
    if "failed" in answer:
        raise CheckFailed(answer["failed"])
    if "memory" in answer:
        raise CheckFailed(
            f"The package's trial took more than {limits.memory_mib} MiB of memory: do not fly it."
        )
    return Replay(Difference(**answer.pop("difference")), **answer)


def main() -> None:
    """In the process of its own: limits, then the package from standard input, then the answer."""
    limits = Limits(**json.loads(sys.argv[1]))
    ordinary()
    limit(limits)
    sys.stdout.write(json.dumps(_replay_summary(sys.stdin.buffer.read())))


def _replay_summary(model: bytes) -> dict[str, Any]:
    try:
        return asdict(replay(package_from_bytes(model, "the package")))
    except MemoryError:
        return {"memory": "exceeded"}
    except (UnusableInput, CheckFailed) as error:
        if _is_want_of_memory(error.__cause__):
            return {"memory": "exceeded"}
        return {"unusable" if isinstance(error, UnusableInput) else "failed": str(error)}


def _is_want_of_memory(cause: BaseException | None) -> bool:
    """Whether onnxruntime gave up for want of it: std::bad_alloc, or its allocator's words."""
    return "bad_alloc" in str(cause) or "allocate memory" in str(cause).lower()


if __name__ == "__main__":
    main()
