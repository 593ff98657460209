"""What studies train: one run folder per configuration, trained once.

In: a set and what to train on it. Out: the predictor; a stopped run goes on where it was.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.episodes import EpisodeSet

if TYPE_CHECKING:
    from trainers.model import Predictor


def trained(
    data: EpisodeSet,
    arch: str,
    seed: int,
    runs: Path,
    *,
    epochs: int | None = None,
    lead_s: float = 0.0,
    hyper: Mapping[str, Any] | None = None,
) -> "Predictor":
    """The predictor of this configuration; `epochs` is how long it is trained, if not as usual.

    Sets, leads and hyper-parameters may share `runs`: each has a folder of its own there.
    """
    from trainers.training import configure, settings_for, train

    settings = settings_for(arch, epochs=epochs)
    config = configure(data, arch, seed=seed, lead_s=lead_s, hyper=hyper, settings=settings)
    told = [data.sha256[:8], *(f"{name}={value:g}" for name, value in (hyper or {}).items())]
    if lead_s:
        told.append(f"lead={1e3 * lead_s:.1f}ms")
    return train(config, data, runs / "-".join(told)).predictor
