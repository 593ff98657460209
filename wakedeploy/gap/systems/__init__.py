"""The systems whose simulation is compared with measurements: a baseline and its effects for each.

In: public recordings in their original layout, flights of a gantry, or a small simulation. Out: a
`Comparison` for `wakedeploy.gap.search`. `response` makes one of a response and a noise,
`logs` one of a user's system; `gantry` has a folder, every other system a file.
"""

import importlib
from pathlib import Path
from typing import Any

from wakedeploy.gap.progress import Progress
from wakedeploy.gap.systems.response import ResponseModel

DOMAINS = ("motor", "fish", "quadrotor", "downwash")


def open_domain(name: str, path: Path | None) -> ResponseModel:
    """The domain's model over the recordings below `path` (none for the simulated `downwash`).

    Raises UnusableInput for recordings that are absent, damaged or too few.
    """
    module = importlib.import_module(f"wakedeploy.gap.systems.{name}")
    model: ResponseModel = module.open_model(path)
    return model


def further(name: str, model: ResponseModel, progress: Progress) -> dict[str, Any]:
    """What a domain adds to the account: independent estimates, profiles, an audit of labels."""
    module = importlib.import_module(f"wakedeploy.gap.systems.{name}")
    result: dict[str, Any] = module.further(model, progress)
    return result
