"""Other domains through the same interface: a baseline model plus effects for each.

In: public recordings in their original layout, or a small simulation. Out: the same verdict as for
flights of the gantry. `coloured` turns a response and a noise into a `Model` of
`wakedeploy.gap.inference`; `closing` fits, ranks, names and shows; the other files are one domain
each. May import what `wakedeploy.gap` may.
"""

import importlib
from pathlib import Path
from typing import Any

from wakedeploy.gap.domains.coloured import ResponseModel
from wakedeploy.gap.progress import Progress

DOMAINS = ("motor", "fish", "quadrotor", "downwash")


def open_domain(name: str, path: Path | None) -> ResponseModel:
    """The domain's model over the recordings below `path` (none for the simulated `downwash`).

    Raises UnusableInput for recordings that are absent, damaged or too few.
    """
    module = importlib.import_module(f"wakedeploy.gap.domains.{name}")
    model: ResponseModel = module.open_model(path)
    return model


def further(
    name: str, model: ResponseModel, simulations: int, seed: int, progress: Progress
) -> dict[str, Any]:
    """What a domain adds to the account: independent estimates, profiles, an audit of labels."""
    module = importlib.import_module(f"wakedeploy.gap.domains.{name}")
    result: dict[str, Any] = module.further(model, simulations, seed, progress)
    return result
