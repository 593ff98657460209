"""What is found by its name: a module in its kind's folder, or an entry point of another package.

Architectures, effects and domains are not listed anywhere. One of this project is a module of the
folder `Kind.package` that defines `Kind.constant` at its top level. One of another package is an
entry point of the group `Kind.group`, which names such a constant. Names are listed without an
import of what they name: torch and numba take seconds to load.
"""

import ast
import contextlib
import functools
import importlib
import importlib.util
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from wakedeploy.core.errors import UnusableInput, one_line

T = TypeVar("T")

_ORDER = Path(__file__).with_name("order.toml")


@dataclass(frozen=True)
class Kind:
    """A kind of thing that is found: what it is called, and where it may stand."""

    what: str
    group: str
    package: str
    constant: str


ARCHITECTURE = Kind(
    "architecture", "wakedeploy.architectures", "trainers.architectures", "ARCHITECTURE"
)
DOMAIN = Kind("domain", "wakedeploy.domains", "wakedeploy.domains", "DOMAIN")
EFFECTS = Kind("effect", "wakedeploy.effects", "wakedeploy.physics.effects", "EFFECTS")


@dataclass(frozen=True)
class Offer:
    """A name, and the constant of a module that it stands for; `by` is the package that has it."""

    kind: Kind
    name: str
    module: str
    constant: str
    by: str = "wakedeploy"

    @functools.cached_property
    def title(self) -> str:
        """The first line of the module's description, read without importing it."""
        docstring = ast.get_docstring(ast.parse(self._text)) or ""
        return docstring.partition("\n")[0].rstrip(".")

    @functools.cached_property
    def maker(self) -> str:
        """What makes the constant, as the text says: DOMAIN = Maker(…); "" if it does not."""
        made = re.search(rf"^{self.constant}\b[^=\n]*= *(\w+)\(", self._text, re.MULTILINE)
        return made[1] if made else ""

    @functools.cached_property
    def _text(self) -> str:
        with contextlib.suppress(ImportError, OSError):
            spec = importlib.util.find_spec(self.module)
            if spec is not None and spec.origin is not None:
                return Path(spec.origin).read_text(encoding="utf-8")
        return ""

    def load(self, expected: type[T]) -> T:
        """The constant. Raises UnusableInput where another package's cannot be used.

        Errors in modules of this project are not hidden.
        """
        try:
            found = getattr(importlib.import_module(self.module), self.constant)
        except Exception as error:
            if self.by == "wakedeploy":
                raise
            raise self._unusable(one_line(error) or type(error).__name__) from error
        if not isinstance(found, expected):
            raise self._unusable(f"it is no {expected.__name__}")
        return found

    def _unusable(self, why: str) -> UnusableInput:
        return UnusableInput(
            f"{self.kind.what} '{self.name}' of the package {self.by}: {self.module}:"
            f"{self.constant} cannot be used ({why}); mend the package, or uninstall it."
        )


@functools.cache
def offers(kind: Kind) -> Mapping[str, Offer]:
    """All of a kind by name: those of `order.toml` first, in its order, then the others by name.

    Raises UnusableInput where two packages offer the same name.
    """
    found: dict[str, Offer] = {}
    for offer in (*_of_folder(kind), *_of_other_packages(kind)):
        if offer.name in found:
            packages = f"{found[offer.name].by} and {offer.by}"
            raise UnusableInput(
                f"The packages {packages} both offer the {kind.what} '{offer.name}';"
                f" uninstall {offer.by}, or rename it there."
            )
        found[offer.name] = offer
    order = tomllib.loads(_ORDER.read_text()).get(kind.what, [])
    first = [name for name in order if name in found]
    return {name: found[name] for name in dict.fromkeys([*first, *sorted(found)])}


def _of_folder(kind: Kind) -> list[Offer]:
    """The folder's modules that define the constant, as their text says."""
    spec = importlib.util.find_spec(kind.package)
    assert spec is not None
    assert spec.submodule_search_locations
    defined = re.compile(rf"^{kind.constant}\b[^=\n]*=", re.MULTILINE)
    found = []
    for folder in spec.submodule_search_locations:
        for path in sorted(Path(folder).glob("[!_]*.py")):
            if defined.search(path.read_text(encoding="utf-8")):
                name, module = path.stem.replace("_", "-"), f"{kind.package}.{path.stem}"
                found.append(Offer(kind, name, module, kind.constant))
    return found


def _of_other_packages(kind: Kind) -> list[Offer]:
    from importlib.metadata import entry_points  # takes longer to load than the rest of --help

    return [
        Offer(
            kind,
            point.name,
            point.module,
            point.attr or kind.constant,
            by=point.dist.name if point.dist else point.module,
        )
        for point in sorted(entry_points(group=kind.group), key=lambda point: point.name)
    ]
