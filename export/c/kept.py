"""The C of a package, written once for each package and kept for its next flight.

In: a package. Out: its folder of C in this user's cache. It is written in a process of its
own: what the export loads stays out of the one that flies.
"""

import contextlib
import functools
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from runtime.compiled.compiler import host_compiler, kept_folder
from runtime.compiled.folder import CFolder, read_c_folder
from runtime.io.realtime import become_ordinary
from runtime.own_process import run_apart
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.locks import one_at_a_time
from wakedeploy.core.package import Package, package_from_bytes

_LIMIT_S = 600.0  # a reservoir of 4,000 neurons takes a minute


def kept_c(package: Package, waiting: Callable[[], None] = lambda: None) -> CFolder:
    """The C of a package with float32 weights, written now unless that has been done here before.

    `waiting` is called again and again meanwhile. Raises what `export.c.packaging.export_c` does.
    """
    host_compiler()  # raises before anything is begun
    name = f"{package.manifest.arch}-{_key(package)}"
    folder = kept_folder() / "packages" / name
    with one_at_a_time(folder.parent, name, traceless=True):
        with contextlib.suppress(UnusableInput):  # not there, or damaged: written anew
            return read_c_folder(folder)
        shutil.rmtree(folder, ignore_errors=True)
        _write(package, folder, waiting)
        return read_c_folder(folder)


def _key(package: Package) -> str:
    """What its C depends on: the package, and what writes C."""
    said = hashlib.sha256(package.sha256.encode())
    said.update(_writers().encode())
    return said.hexdigest()[:32]


@functools.cache
def _writers() -> str:
    said = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        said.update(source.read_bytes())
    return said.hexdigest()


def _write(package: Package, folder: Path, waiting: Callable[[], None]) -> None:
    try:
        ended = run_apart(
            __name__, str(folder), package.model_bytes, seconds=_LIMIT_S, waiting=waiting
        )
    except TimeoutError as error:
        raise CheckFailed(
            f"The package had not become C after {_LIMIT_S:g} s: fly it without --backend c; or, if"
            " the computer is busy, try again."
        ) from error
    if ended.status != 0:
        raise CheckFailed(f"What makes C of the package {ended.why}: fly it without --backend c.")
    numbers: dict[str, str] = json.loads(ended.out)
    if "unusable" in numbers:
        raise UnusableInput(numbers["unusable"])
    if "failed" in numbers:
        raise CheckFailed(numbers["failed"])


def main() -> None:
    """In the process of its own: the package from standard input, C into the folder, the answer."""
    from export.c.packaging import Wish, export_c

    if hasattr(os, "sched_getscheduler"):
        become_ordinary()  # the loop that waits may have real-time priority
    failure = {}
    try:
        package = package_from_bytes(sys.stdin.buffer.read(), "the package")
        export_c(package, Path(sys.argv[1]), Wish())
    except (UnusableInput, CheckFailed) as error:
        failure = {"unusable" if isinstance(error, UnusableInput) else "failed": str(error)}
    sys.stdout.write(json.dumps(failure))


if __name__ == "__main__":
    main()
