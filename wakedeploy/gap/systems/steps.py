"""Find, name, add and show for a user's system: the steps, and what each leaves in a folder.

In: a `LogModel`. Out: find.json, name.json, correction.toml and domain.json, which the report page
of `gap domain` shows. `judging` decides what is named.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import Fit, fit
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.systems.before_after import shown
from wakedeploy.gap.systems.closing import parameters
from wakedeploy.gap.systems.judging import Named, named, settled, verdict_of
from wakedeploy.gap.systems.logs import LogModel
from wakedeploy.gap.systems.places import find_places, whiteness
from wakedeploy.gap.systems.weighing import weighed

__all__ = [
    "Named", "errors", "fitted_base", "found_document", "named", "named_document",
    "shown_document", "verdict_of",
]  # fmt: skip


def fitted_base(model: LogModel) -> Fit:
    """The system as it is, on the blocks that are not sealed.

    Raises UnusableInput for logs that are too short.
    """
    if model.episodes < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{model.name}: the logs make {model.episodes} blocks; at least {FEWEST_IN_ALL} are "
            "needed, as effects are judged on blocks that they were not fitted to."
        )
    sealed = model.sealed()
    used = [e for e in range(model.episodes) if e not in sealed]
    return settled(model, fit(model, (), used))[0]


def found_document(model: LogModel, base: Fit) -> dict[str, Any]:
    """Where system and logs disagree, as `find.json` has it."""
    places = find_places(model, base)  # type: ignore[arg-type]
    return {
        "domain": model.name,
        "episodes": [b.name for b in model.blocks],
        "sealed": [model.blocks[e].name for e in model.sealed()],
        "where": [vars(p) for p in places],
        "constants": _constants(model, base),
    }


def named_document(model: LogModel, told: Named) -> dict[str, Any]:
    """Which effects, as `name.json` has it."""
    own = parameters(told.found, told.found.hypothesis)
    return {
        "domain": model.name,
        "verdict": verdict_of(told),
        "class": list(told.rivals),
        "threshold_nats": told.rounds[0]["threshold_nats"] if told.rounds else 0.0,
        "effects": [_effect(told, name, own) for name in told.found.hypothesis],
        "parameters": own,
        "constants": _constants(model, told.found),
        "rounds": told.rounds,
        "unsettled": list(told.unsettled),
        "unexplained": [asdict(one) for one in told.leftover],
    }


def shown_document(model: LogModel, told: Named) -> dict[str, Any]:
    """The gap before and after on sealed blocks, and what the page shows beside it."""
    sealed = model.sealed()
    before, after = (errors(model, f, sealed) for f in (told.base, told.found))
    weight = weighed(model, told.base, told.found, sealed)
    return {
        "gap": {
            name: {"before": before[c], "after": after[c], "unit": unit}
            for c, (name, unit) in enumerate(model.channels)
        },
        "forecast_s": model.horizon * model.dt_s,
        "removed": asdict(weight),
        "white": {"before": whiteness(model, told.base), "after": whiteness(model, told.found)},  # type: ignore[arg-type]
        "shown": shown(model, told.base, told.found, sealed),  # type: ignore[arg-type]
        "doubted": list(told.found.hypothesis) if weight.high < 0.0 else [],
    }


def errors(model: LogModel, fitted: Fit, episodes: Sequence[int]) -> list[float]:
    """Root mean square of measured less forecast, by output."""
    parts = np.concatenate(model.disagreements(fitted, episodes), axis=1)
    return [float(np.sqrt(np.nanmean(row**2))) for row in parts]


def _effect(told: Named, name: str, own: dict[str, dict[str, Any]]) -> dict[str, Any]:
    mine = {k.split(".", 1)[1]: v for k, v in own.items() if k.startswith(f"{name}.")}
    return {"name": name, "parameters": mine, "forecast": asdict(told.weights[name])}


def _constants(model: LogModel, fitted: Fit) -> dict[str, dict[str, Any]]:
    """Every constant that was fitted, with its interval."""
    told = {}
    for free in fitted.free:
        if free.name.startswith("constant."):
            low, high = fitted.interval(free.name)
            value = {"value": fitted.value(free.name), "low": low, "high": high}
            told[free.name.removeprefix("constant.")] = value | {"unit": free.unit}
    return told
