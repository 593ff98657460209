"""Processes of a test's own that begin warm: forked from one that has imported what takes seconds.

What a user starts imports by itself, and so do the commands that tests start as programs.
"""

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path

IMPORTED = ("trainers.training.trainer", "wakedeploy.sweep.jobs", "distributed")


def context() -> ForkServerContext:
    """Where such processes come from, in the place of `multiprocessing.get_context("spawn")`."""
    warm = multiprocessing.get_context("forkserver")
    warm.set_forkserver_preload(list(IMPORTED))
    _begin_hearing_all_signals()
    return warm


def _begin_hearing_all_signals() -> None:
    """What is forked hears what its origin hears, and that begins where it is first asked for.

    In the midst of `wakedeploy.core.processes.pool` that is deaf to SIGTERM: what a test ended
    politely afterwards would run for ever.
    """
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def started(log: Path, work: Callable[..., object], *arguments: object) -> BaseProcess:
    """A process that does `work`, a function of a module, in the folder of its log."""
    process = context().Process(target=_logged, args=(log, work, arguments))
    process.start()
    return process


def _logged(log: Path, work: Callable[..., object], arguments: tuple[object, ...]) -> None:
    with log.open("wb") as written:
        for stream in (1, 2):
            os.dup2(written.fileno(), stream)
    os.chdir(log.parent)
    work(*arguments)
