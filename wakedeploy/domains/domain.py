"""What a domain says of itself: all that commands, sweeps and studies know of it.

A module of this folder is a domain if it has a constant `DOMAIN`, which is one of these. Another
package offers its own by an entry point of the group `wakedeploy.domains`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from wakedeploy.core.discovery import DOMAIN, offers
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput

OnStep = Callable[[int, int], None]


@dataclass(frozen=True)
class Setting:
    """What a domain takes beside a path, or minutes and seed; on the command line as `--NAME`.

    One of `choices`, a number from `low` to `high`, the rig that is simulated, or packages that
    fly in it; `help` is for a user.
    """

    name: str
    kind: Literal["choice", "number", "rig", "packages"]
    help: str
    default: Any = None
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0

    def require(self, value: Any, where: str = "") -> None:
        """UnusableInput for a value that it cannot have; the sentence begins with `where`."""
        if self.kind == "choice" and value not in self.choices:
            known = " or ".join(self.choices)
            raise UnusableInput(f"{where}{self.name} = {value!r} has to be {known}.")
        if self.kind == "number" and not (
            isinstance(value, int | float) and self.low <= value <= self.high
        ):
            raise UnusableInput(
                f"{where}{self.name} = {value!r} has to be a number from {self.low:g} to"
                f" {self.high:g}."
            )


@dataclass(frozen=True)
class _Domain:
    """What is true of all domains.

    `main` is the force channel that figures show. `help_text` is paragraphs and `examples` the
    arguments behind its command, both for the command's help.
    """

    main: str
    help_text: str
    examples: tuple[str, ...]


@dataclass(frozen=True)
class Simulated(_Domain):
    """A domain whose episodes are simulated.

    `make(minutes=, seed=, progress=, **settings)` returns the set, the same for the same seed;
    with `workers=` where it starts processes. By default it makes `minutes`; studies make
    `study_minutes` or, for a quick look, `quick_minutes`.
    """

    make: Callable[..., EpisodeSet]
    minutes: float = 30.0
    study_minutes: float = 30.0
    quick_minutes: float = 2.0
    settings: tuple[Setting, ...] = ()


@dataclass(frozen=True)
class Recorded(_Domain):
    """A domain whose episodes are imported from recordings in their original layout.

    `read(folder, progress, **settings)` returns the set from a folder and a function of files done
    and of how many; `pattern` finds one file of each recording.
    """

    read: Callable[..., EpisodeSet]
    pattern: str
    settings: tuple[Setting, ...] = ()


Domain = Simulated | Recorded


def domain(name: str) -> Domain:
    """The domain of this name, which `wakedeploy.core.names.domains` has."""
    return offers(DOMAIN)[name].load(_Domain)  # type: ignore[return-value]


def names_of(kind: type[Domain]) -> list[str]:
    """The domains that are simulated, or recorded, by name; none is imported that says so."""
    return [
        name
        for name, offer in offers(DOMAIN).items()
        if (offer.maker or type(domain(name)).__name__) == kind.__name__
    ]
