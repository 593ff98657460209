"""How far ahead a force has to be known on a rig: the true force flown at lead after lead."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.domains.gantry import record

_FIRST_SEED = 800_000_000  # plans that neither training nor the tracking table fly


@dataclass(frozen=True)
class LeadScore:
    """Tracking with the true force fed forward at one lead; mean over the flights."""

    lead_s: float
    rmse_m: float


def sweep(
    rig: Rig,
    leads_s: Sequence[float],
    *,
    flights: int,
    seconds: float,
    progress: Callable[[int, int], None] | None = None,
) -> list[LeadScore]:
    """Score each lead over the same simulated flights. `progress(done, total)` counts flights."""
    scores: list[LeadScore] = []
    for lead_s in leads_s:
        errors_m = []
        for flight in range(flights):
            log = record(rig, seconds=seconds, seed=_FIRST_SEED + flight, lead_oracle_s=lead_s)
            errors_m.append(log.tracking_rmse_m("true_z_m"))
            if progress is not None:
                progress(len(scores) * flights + flight + 1, len(leads_s) * flights)
        scores.append(LeadScore(lead_s, float(np.mean(errors_m))))
    return scores


def best(scores: Sequence[LeadScore]) -> LeadScore:
    """The score with the smallest tracking error."""
    return min(scores, key=lambda score: score.rmse_m)
