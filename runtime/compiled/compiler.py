"""This machine's C compiler: found, asked, and never run twice for the same source."""

import functools
import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from wakedeploy.core.errors import CheckFailed, UnusableInput, shown

PLAIN = ("-O2",)
NATIVE = ("-O2", "-march=native")  # what the loop runs
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")
_USUAL = ("cc", "gcc", "clang")
_LIMIT_S = 300.0  # of a compilation; the largest reservoir takes some seconds


class BuildFailed(CheckFailed):
    """A build that does not compile, does not end or differs.

    `what` says what happened with `flags`, `advice` what to do with a folder that was exported.
    """

    def __init__(self, path: Path, what: str, advice: str, flags: Sequence[str]) -> None:
        super().__init__(f"{path}: {what}; {advice}")
        self.what, self.flags = what, tuple(flags)


Compiler = tuple[str, ...]  # a program and the arguments that always come first


def host_compiler() -> Compiler:
    """The command that the variable CC holds, else the first of cc, gcc and clang.

    Raises UnusableInput where there is none, or not the one that CC names.
    """
    if named := os.environ.get("CC", "").strip():
        return _named_by_cc(named)
    for name in _USUAL:
        if (found := shutil.which(name)) is not None:
            return (found,)
    raise UnusableInput(
        "There is no C compiler on this machine (CC, cc, gcc and clang were looked for): install"
        " one, as by `sudo apt install gcc`."
    )


def _named_by_cc(named: str) -> Compiler:
    try:
        program, *arguments = shlex.split(named)
    except ValueError as error:
        raise UnusableInput(
            f"CC={shown(named)} is no command ({error}): correct the variable CC, or unset it."
        ) from error
    found = shutil.which(program)
    if found is None:
        raise UnusableInput(
            f"CC={shown(named)}: there is no such program: correct the variable CC, or unset it."
        )
    return (found, *arguments)


@functools.cache
def version_of(compiler: Compiler) -> str:
    """The first line that a compiler says about itself."""
    ended = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False)  # noqa: S603
    return shown(ended.stdout.partition("\n")[0]) or Path(compiler[0]).name


def takes(compiler: Compiler, flags: Sequence[str]) -> bool:
    """Whether a compiler knows these flags; not every one has a native processor."""
    command = [*compiler, *flags, "-x", "c", "-c", os.devnull, "-o", os.devnull]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0  # noqa: S603


def native_flags(compiler: Compiler) -> tuple[str, ...]:
    """The flags of the loop, as far as this compiler knows them."""
    return NATIVE if takes(compiler, NATIVE) else PLAIN


def compiled(
    sources: Sequence[Path], out: Path, flags: Sequence[str], compiler: Compiler | None = None
) -> Path:
    """Compile and link sources into `out`; CheckFailed with the compiler's first complaint."""
    command = [*(compiler or host_compiler()), *STRICT, *flags, "-o", out, *sources, "-lm"]
    try:
        ended = subprocess.run(  # noqa: S603
            list(map(str, command)), capture_output=True, text=True, timeout=_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        what = f"its compilation had not ended after {_LIMIT_S:g} s"
        raise BuildFailed(sources[0], what, "export it again.", flags) from error
    if ended.returncode != 0:
        said = next((line for line in ended.stderr.splitlines() if "error" in line), ended.stderr)
        name = Path(str(command[0])).name
        raise BuildFailed(
            sources[0],
            f"{name} {' '.join(flags)} does not compile it ({shown(said)[:300]})",
            "export it again, or name another compiler by CC.",
            flags,
        )
    return out


def shared_library(source: Path, flags: Sequence[str] | None = None) -> Path:
    """The library of a source, from the cache where it has been compiled here before."""
    compiler = host_compiler()
    used = native_flags(compiler) if flags is None else tuple(flags)
    out = kept_folder() / f"{source.stem}-{_key(source, compiler, used)}.so"
    if not out.exists():
        with tempfile.TemporaryDirectory(dir=out.parent) as folder:
            made = compiled(
                [source], Path(folder) / out.name, (*used, "-shared", "-fPIC"), compiler
            )
            made.replace(out)
    return out


def _key(source: Path, compiler: Compiler, flags: Sequence[str]) -> str:
    """What a library was made of; a native one is for one processor only."""
    said = hashlib.sha256("\0".join((*compiler, version_of(compiler), *flags)).encode())
    said.update(_processor().encode())
    for path in (source, source.with_suffix(".h")):
        said.update(path.read_bytes())
    return said.hexdigest()[:32]


@functools.cache
def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    return "\n".join(sorted({line for line in lines if line.startswith(("flags", "Features"))}))


def kept_folder() -> Path:
    """A folder for what need not be compiled or written twice; only this user writes to it."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(home) / "wakedeploy" / "c"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return _passing()
    return folder if os.access(folder, os.W_OK) else _passing()


@functools.cache
def _passing() -> Path:
    """Where nothing can be kept, a folder for as long as this process lives."""
    held = tempfile.TemporaryDirectory(prefix="wakedeploy-c-")
    _held.append(held)
    return Path(held.name)


_held: "list[tempfile.TemporaryDirectory[str]]" = []
