"""Packages on a machine at the rig: copied, checked there, made current in one step, and back.

In: a package and a `Remote`. Out: a folder there with the packages under their hashes, and two
links, `current.onnx` and `previous.onnx`. Whatever fails, the old current stays.
"""

import contextlib
import secrets
import shlex
import signal
from collections.abc import Iterator
from dataclasses import dataclass

from wakedeploy.core.errors import CheckFailed, UnusableInput, WakedeployError
from wakedeploy.core.package import Package
from wakedeploy.deploy.remote import ANSWER_LIMIT_S, Ended, Remote

HASH_LETTERS = 16  # of a package's SHA-256, which name its file
_MARK = "wakedeploy-link "  # tells our lines from what a login there may print

# Exit statuses of the lines of shell below, beside those of what they run.
_NOT_WRITTEN, _DAMAGED, _IN_THE_WAY, _NOTHING_BEFORE, _NOT_SWAPPED = 70, 71, 72, 73, 74
_TIMED_OUT, _NOT_EXECUTABLE, _NOT_FOUND, _KILLED = 124, 126, 127, 128
CHECK_LIMIT_S = 300  # the check there ends itself before, unless the machine hangs
_END_S = 5  # between asking it to end and ending it


@dataclass(frozen=True)
class Links:
    """Names of the packages that the two links lead to; None for a link that is not there."""

    current: str | None
    previous: str | None


@dataclass(frozen=True)
class Site:
    """Where packages go: a machine, a folder there, and its wakedeploy command."""

    remote: Remote
    directory: str
    command: str

    def deploy(self, package: Package, name: str) -> Links:
        """Copy a package there, check it there, make it current; the links afterwards.

        `name` is what errors call it. Raises UnusableInput or CheckFailed naming the step that
        failed; the copy is removed then and the links are as they were.
        """
        temporary = f".incoming-{secrets.token_hex(8)}"
        self._copy(package, temporary)
        with self._removed_unless_done(temporary):
            self._check(f"packages/{temporary}", name)
            return self._make_current(package, temporary)

    def roll_back(self) -> Links:
        """Check the previous package there again and exchange the two links."""
        self._links(f"{self._enter}; {_READ_LINKS}; {_REQUIRE_PREVIOUS}; {_TELL_LINKS}")
        self._check("previous.onnx", "the previous package")
        return self._links(
            f"{self._enter}; {_READ_LINKS}; {_REQUIRE_PREVIOUS}; "
            # First what is asked for: should the power fail in between, it has been done.
            f"{_point('current.onnx', '$previous')} && {_point('previous.onnx', '$current')} "
            f"|| exit {_NOT_SWAPPED}; {_TELL_LINKS}"
        )

    def _copy(self, package: Package, temporary: str) -> None:
        """Send the bytes and compare their hash; a copy cut short is removed by the far end."""
        packages, path = f"{self._folder}/packages", f"{self._folder}/packages/{temporary}"
        d, p, t = (shlex.quote(place) for place in (self._folder, packages, path))
        ended = self.remote.run(
            f"umask 022; mkdir -p {p} || exit {_NOT_WRITTEN}; "
            # After a power cut; a link is followed by nobody before it has its name.
            f"find {p} -name '.incoming-*' -mmin +60 -exec rm -f {{}} +; "
            f"find {d} -maxdepth 1 -name '.new-*' -mmin +60 -exec rm -f {{}} +; "
            f"cat > {t} || {{ rm -f {t}; exit {_NOT_WRITTEN}; }}; "
            f'[ "$(sha256sum < {t})" = "{package.sha256}  -" ] '
            f"|| {{ rm -f {t}; exit {_DAMAGED}; }}; "
            f"sync {t} || {{ rm -f {t}; exit {_NOT_WRITTEN}; }}",
            package.model_bytes,
        )
        if ended.status == _DAMAGED:
            raise CheckFailed(
                f"{self.remote.target}: the copy has another SHA-256 than the package; its disk or "
                "the connection damages data, start again."
            )
        if ended.status:
            raise CheckFailed(
                f"{self.remote.target}: the package cannot be written to {self.directory} "
                f"({_said(ended)}); free some space there, or name another --directory."
            )

    def _check(self, where: str, name: str) -> None:
        """Try the package there; against the rig, too, where a rig file lies in the folder."""
        command = shlex.quote(_path(self.command) if "/" in self.command else self.command)
        path, rig = (shlex.quote(f"{self._folder}/{file}") for file in (where, "rig.toml"))
        # Not the last command of the line: a shell that becomes its last command would hand over
        # a death by signal, which ssh cannot tell from a lost connection.
        limited = f"timeout -k {_END_S} {CHECK_LIMIT_S} {command}"
        ended = self.remote.run(
            f"if [ -e {rig} ]; then {limited} check {path} --rig {rig}; "
            f"else {limited} check {path}; fi; exit $?",
            limit_s=ANSWER_LIMIT_S + CHECK_LIMIT_S + _END_S,
        )
        if ended.status == 0:
            return
        target = self.remote.target
        if ended.status in (_NOT_FOUND, _NOT_EXECUTABLE):
            raise UnusableInput(
                f"{target}: there is no {self.command} to check the package with "
                f"({_said(ended)}); install it there, or name it with --command, "
                "such as --command venv/bin/wakedeploy."
            )
        if ended.status == _TIMED_OUT:
            raise CheckFailed(
                f"{target}: `{self.command} check` had not ended after {CHECK_LIMIT_S} s and was"
                f" ended there; try `{self.command} doctor` there."
            )
        if ended.status > _KILLED:
            raise CheckFailed(
                f"{target}: `{self.command} check` was ended there by "
                f"{_signal_name(ended.status - _KILLED)}{_reason(ended.status - _KILLED)}; "
                f"try `{self.command} doctor` there."
            )
        said = _said(ended).replace(where.rpartition("/")[2], name)
        raise CheckFailed(f"{target}: `{self.command} check` failed there: {said}")

    def _make_current(self, package: Package, temporary: str) -> Links:
        file = f"packages/{package.sha256[:HASH_LETTERS]}.onnx"
        links = (
            # First what a rollback goes to: should the power fail in between, both are the old one.
            f'{{ [ -z "$current" ] || {_point("previous.onnx", "$current")}; }} '
            f"&& {_point('current.onnx', file)}"
        )
        return self._links(
            f"{self._enter}; {_READ_LINKS}; "
            f"[ ! -e current.onnx ] || [ -L current.onnx ] || exit {_IN_THE_WAY}; "
            f"mv -f packages/{temporary} {file} || exit {_NOT_SWAPPED}; "
            f'[ "$current" = {file} ] || {{ {links}; }} || exit {_NOT_SWAPPED}; {_TELL_LINKS}'
        )

    def _links(self, script: str) -> Links:
        """Run a line that reads or changes the links, and ends with telling them."""
        ended = self.remote.run(script)
        target, where = self.remote.target, self.directory
        if ended.status == _IN_THE_WAY:
            raise UnusableInput(
                f"{target}: {where}/current.onnx is a file and no link of this command's; move it "
                "away, and start again."
            )
        if ended.status == _NOTHING_BEFORE:
            raise UnusableInput(
                f"{target}: {where} has no earlier package to go back to; deploy the one you want."
            )
        if ended.status:
            raise CheckFailed(f"{target}: the links in {where} cannot be changed: {_said(ended)}")
        lines = [line for line in ended.stdout.splitlines() if line.startswith(_MARK)]
        names = [line.removeprefix(_MARK).strip().removeprefix("packages/") for line in lines]
        return Links(*(name or None for name in names))

    @contextlib.contextmanager
    def _removed_unless_done(self, temporary: str) -> Iterator[None]:
        try:
            yield
        except BaseException:  # Ctrl-C as well
            with contextlib.suppress(WakedeployError):  # the first error is the one to report
                self.remote.run(f"rm -f {shlex.quote(f'{self._folder}/packages/{temporary}')}")
            raise

    @property
    def _folder(self) -> str:
        return _path(self.directory)

    @property
    def _enter(self) -> str:
        return f"cd {shlex.quote(self._folder)} || exit {_NOTHING_BEFORE}"


_READ_LINKS = "current=$(readlink current.onnx); previous=$(readlink previous.onnx)"
_REQUIRE_PREVIOUS = f'[ -n "$previous" ] && [ "$previous" != "$current" ] || exit {_NOTHING_BEFORE}'
_TELL_LINKS = (
    f"sync . ; for link in current previous; do "
    f'printf "{_MARK}%s\\n" "$(readlink $link.onnx)"; done'
)


def _point(link: str, to: str) -> str:
    """Shell that makes a link anew, in one step for whoever looks at it, or does the same."""
    return f'{{ ln -sfn "{to}" .new-{link}-$$ && mv -fT .new-{link}-$$ {link}; }}'


def _path(path: str) -> str:
    """A path there, from the home folder; `~` would not survive its quotes."""
    path = path.removeprefix("~/").rstrip("/") or "."
    return path if path.startswith("/") else f"./{path}"


def _said(ended: Ended) -> str:
    return ended.last_words or f"exit status {ended.status}, without a word"


def _reason(number: int) -> str:
    """Who sends a signal that no program sends itself."""
    if number != signal.SIGKILL:
        return ""
    return f", for want of memory or because it went on after {CHECK_LIMIT_S} s"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
