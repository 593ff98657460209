"""Options that take names: in any case, checked at once, completed by Tab."""

from collections.abc import Callable, Sequence
from typing import Any

import click
from click.shell_completion import CompletionItem

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import ALL, architectures, domains, meant, one_of, unknown

Names = Callable[[], Sequence[str]]


class OneName(click.ParamType[str]):
    """One of some names."""

    name = "name"

    def __init__(self, what: str, names: Names) -> None:
        self._what, self._names = what, names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name as it is spelled here."""
        found = meant(value, self._names())
        if found is None:
            raise _refused(param, unknown(value, self._what, self._names()))
        return found

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        """The names that begin so."""
        return [CompletionItem(name) for name in _begun(incomplete, self._names())]


class SeveralNames(click.ParamType[tuple[str, ...]]):
    """Names with commas between them, or all; each once."""

    name = "names"

    def __init__(self, what: str, names: Names) -> None:
        self._what, self._names = what, names

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """The names as they are spelled here."""
        if isinstance(value, tuple):
            return value
        given = value if isinstance(value, list) else [value]  # of an option that was repeated
        found = list[str]()
        for name in ",".join(given).split(","):
            if meant(name, [ALL]):
                found += self._names()
                continue
            known = meant(name, self._names())
            if known is None:
                raise _refused(param, unknown(name.strip(), self._what, [ALL, *self._names()]))
            found.append(known)
        return tuple(dict.fromkeys(found))

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        """The names that the last one may become, behind those that are there."""
        before, comma, last = incomplete.rpartition(",")
        unused = [name for name in self._names() if name not in before.split(",")]
        begun = _begun(last, unused if comma else [*unused, ALL])
        return [CompletionItem(f"{before}{comma}{name}") for name in begun]


class FileOrName(click.ParamType[str]):
    """A file, or one of some names in any case; several with commas between them."""

    name = "text"

    def __init__(self, *names: str) -> None:
        self._names = names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The same, names as they are spelled here."""
        return ",".join(meant(name, self._names) or name for name in value.split(","))

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        """The names that begin so, or files."""
        begun = [CompletionItem(name) for name in _begun(incomplete, self._names)]
        return begun or [CompletionItem(incomplete, type="file")]


def _refused(param: click.Parameter | None, why: str) -> UnusableInput:
    if param is None:
        return UnusableInput(f"{why}.")
    is_option = isinstance(param, click.Option)
    return UnusableInput(f"{param.opts[0] if is_option else param.human_readable_name}: {why}.")


def _begun(incomplete: str, names: Sequence[str]) -> list[str]:
    begun = incomplete.lower().replace("_", "-")
    return [name for name in names if name.startswith(begun)]


def _effects() -> list[str]:
    from wakedeploy.physics.effects import LIBRARY

    return list(LIBRARY)


ARCHITECTURE = OneName("architecture", architectures)
SOME_ARCHITECTURES = SeveralNames("architecture", architectures)
SOME_DOMAINS = SeveralNames("domain", domains)
EFFECT = OneName("effect", _effects)
PRESET = FileOrName("reference", "tuned")


class OptionOfNames(click.Option):
    """An option whose help lists what there is; it is looked for when the help is shown.

    Given more than once, it has the names of all: the last one alone is what click would take.
    """

    def __init__(self, *args: Any, names: Names, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._names = names

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Let the parser keep each value; the option's type makes one list of them."""
        parser.add_option(self, self.opts, self.name, action="append", nargs=self.nargs)

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """The option and its help, `{names}` in it replaced by the names."""
        shown = super().get_help_record(ctx)
        return shown and (shown[0], shown[1].replace("{names}", one_of(self._names())))
