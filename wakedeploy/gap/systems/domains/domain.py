"""What a domain of the gap workflow is: how it is opened, and what it adds to its answer."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wakedeploy.core.discovery import offers
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.search.artefacts import Result
from wakedeploy.gap.systems.domains import KIND
from wakedeploy.gap.systems.likelihood.response import ResponseModel


@dataclass(frozen=True)
class GapDomain:
    """A baseline and its effects over recordings.

    `opened` makes the model of the recordings below a folder (None where `is_simulated`) and raises
    UnusableInput for recordings that are absent, damaged or too few. `further` has what the domain
    alone adds, as fields of `Result`: other estimates, profiles, an audit of labels.
    """

    opened: Callable[[Path | None], ResponseModel]
    further: Callable[[Any, Progress], dict[str, Any]]
    is_simulated: bool = False

    def completed(self, model: ResponseModel, result: Result, progress: Progress) -> Result:
        """A result with what the domain alone adds."""
        return Result(**{**dict(result), **self.further(model, progress)})


def gap_domain(name: str) -> GapDomain:
    """The domain of a name that `offers(KIND)` has."""
    return offers(KIND)[name].load(GapDomain)
