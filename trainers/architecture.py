"""What an architecture says of itself: everything that is known of it outside its own file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from trainers.dimensions import Dimension
from trainers.model import SolvedModel, WakeModel


@dataclass(frozen=True)
class Architecture:
    """A core and its hyper-parameters, both classes, and how it is trained and drawn.

    `hyper` is a frozen dataclass with the reference values as defaults. It has `dimensions`, what a
    search may change; `bounds`, by name, where a value may not be any number; and `starts`, where
    some changes of the reference are worth a try on any set. `learning_rate` is the peak that suits
    it. `training_s` is how long it trains on half an hour of flights, roughly [s, one thread]; only
    shares of it matter, for progress. `colour` and `marker` are matplotlib's, for studies' figures;
    without them it takes the next that are free.
    """

    core: type[WakeModel]
    hyper: type[Any]
    learning_rate: float = 3e-3
    training_s: float = 40.0
    colour: str = ""
    marker: str = ""

    @property
    def solved(self) -> bool:
        """Whether its readout is solved in one pass, so that there are no epochs."""
        return issubclass(self.core, SolvedModel)

    @property
    def dimensions(self) -> tuple[Dimension, ...]:
        """What a search may change, as the architecture's own file says it."""
        return tuple(self.hyper.dimensions)

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Changes of the usual shape that are worth a try on any set; its own file says them."""
        return tuple(getattr(self.hyper, "starts", ()))
