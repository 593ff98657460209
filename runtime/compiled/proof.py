"""The self-test of a C folder, compiled and run in a process of its own.

In: a folder that has been read. Out: the worst relative difference of each build from what the
training-time forward gave, or CheckFailed.
"""

import re
import signal
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.compiled.compiler import (
    PLAIN,
    BuildFailed,
    Compiler,
    compiled,
    host_compiler,
    native_flags,
    version_of,
)
from runtime.compiled.folder import CFolder, Proof
from runtime.limits import Limits, run_limited
from runtime.own_process import Ended
from wakedeploy.core.errors import shown

_SAID = re.compile(r"max_rel (\S+) over (\d+) steps")
LIMITS = Limits(seconds=120.0, cpu_s=60.0)


@dataclass(frozen=True)
class Proved:
    """How the self-test came out here, build by build."""

    proofs: tuple[Proof, ...]
    steps: int

    @property
    def max_rel(self) -> float:
        """The worst of all builds."""
        return max(proof.max_rel for proof in self.proofs)


def proved(
    folder: CFolder,
    extra_flags: Sequence[str] = (),
    waiting: Callable[[], None] = lambda: None,
) -> Proved:
    """Repeat the self-test at -O2, with the loop's flags and with `extra_flags`.

    Raises UnusableInput where there is no compiler, CheckFailed where a build does not compile,
    exceeds `LIMITS`, or differs by more than the folder's limit. `waiting` is called meanwhile.
    """
    compiler = host_compiler()
    builds = dict.fromkeys((PLAIN, native_flags(compiler)))
    if extra_flags:
        builds[tuple(extra_flags)] = None
    proofs, steps = [], 0
    for flags in builds:
        waiting()
        difference, steps = _tested(folder, compiler, flags, waiting)
        proofs.append(
            Proof(compiler=version_of(compiler), flags=" ".join(flags), max_rel=difference)
        )
    return Proved(tuple(proofs), steps)


_passed: set[str] = set()


def require_proof(folder: CFolder, waiting: Callable[[], None] = lambda: None) -> None:
    """`proved`, but once for each folder in this process: of many flights the first one pays."""
    if folder.sha256 not in _passed:
        proved(folder, waiting=waiting)
        _passed.add(folder.sha256)


def _tested(
    folder: CFolder, compiler: Compiler, flags: Sequence[str], waiting: Callable[[], None]
) -> tuple[float, int]:
    with tempfile.TemporaryDirectory(prefix="wakedeploy-c-") as place:
        program = Path(place) / "self-test"
        compiled([folder.source, folder.test], program, flags, compiler)
        try:
            ended = run_limited(program, LIMITS, waiting)
        except TimeoutError as error:
            what = f"its self-test had not ended after {LIMITS.seconds:g} s with {' '.join(flags)}"
            raise BuildFailed(folder.path, what, "do not fly it.", flags) from error
    if ended.status == -signal.SIGXCPU:
        what = f"its self-test took more than {LIMITS.cpu_s:g} s of processor time"
        raise BuildFailed(folder.path, f"{what} with {' '.join(flags)}", "do not fly it.", flags)
    text = ended.out.decode(errors="replace")
    said = _SAID.search(text)
    if ended.status != 0 or said is None:
        what = f"its self-test fails with {' '.join(flags)} ({_complaint(ended, text)})"
        raise BuildFailed(folder.path, what, "do not fly it, export it again.", flags)
    return float(said[1]), int(said[2])


def _complaint(ended: Ended, text: str) -> str:
    """What a self-test said, else how it ended; one that takes memory beyond its limit crashes."""
    said = shown(text + ended.err.decode(errors="replace"))[:300]
    return said if said and ended.status >= 0 else ended.why
