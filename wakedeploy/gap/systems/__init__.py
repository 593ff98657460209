"""The systems whose simulation is compared with measurements: a baseline and its effects for each.

In: public recordings in their original layout, flights of a gantry, or a small simulation. Out: a
`Comparison` for `wakedeploy.gap.search`. `response` makes one of a response and a noise,
`logs` one of a user's system; `gantry` has a folder, every other system a file.
"""

import importlib
from pathlib import Path

from wakedeploy.gap.progress import Progress
from wakedeploy.gap.search.artefacts import Result
from wakedeploy.gap.systems.response import ResponseModel

DOMAINS = ("motor", "fish", "quadrotor", "downwash")


def open_domain(name: str, path: Path | None) -> ResponseModel:
    """The domain's model over the recordings below `path` (none for the simulated `downwash`).

    Raises UnusableInput for recordings that are absent, damaged or too few.
    """
    module = importlib.import_module(f"wakedeploy.gap.systems.{name}")
    model: ResponseModel = module.open_model(path)
    return model


def with_further(name: str, model: ResponseModel, result: Result, progress: Progress) -> Result:
    """A result with what the domain alone tells: other estimates, profiles, an audit of labels."""
    module = importlib.import_module(f"wakedeploy.gap.systems.{name}")
    return Result(**{**dict(result), **module.further(model, progress)})
