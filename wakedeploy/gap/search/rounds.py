"""Which effects a system lacks, and what they close on sealed episodes: what each step tells.

In: a `Comparison`. Out: what `find`, `name` and `show` tell of it. `judging` decides what is named;
sealed episodes take no part in that, and what is told of them was not chosen by them.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import Fit, applied, fit, settled
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.search.comparison import Comparison, errors, residual_series
from wakedeploy.gap.search.judging import Named, named, verdict_of
from wakedeploy.gap.search.places import disagreements
from wakedeploy.gap.search.residual_profiles import profiles
from wakedeploy.gap.search.sizes import Sizes, least_squares, over_rounds, parameters
from wakedeploy.gap.search.weighing import weighed

__all__ = [
    "Named", "concluded", "fitted_base", "found_document", "named", "named_document",
    "shown_document", "verdict_of",
]  # fmt: skip


def fitted_base(model: Comparison) -> Fit:
    """The system as it is, on the episodes that are not sealed.

    Raises UnusableInput for too few episodes.
    """
    if model.episodes < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{model.name}: the recordings make {model.episodes} episodes; at least {FEWEST_IN_ALL}"
            " are needed, as effects are judged on episodes that they were not fitted to."
        )
    sealed = model.sealed()
    used = [e for e in range(model.episodes) if e not in sealed]
    return settled(model, fit(model, (), used))[0]


def concluded(model: Comparison, progress: Progress = quiet) -> dict[str, Any]:
    """What find, name and show tell, together."""
    progress("fitting the baseline")
    base = fitted_base(model)
    found = found_document(model, base)
    told = named(model, base, progress)
    return found | named_document(model, told) | shown_document(model, told)


def found_document(model: Comparison, base: Fit) -> dict[str, Any]:
    """Where system and recordings disagree, as `find.json` has it."""
    maps, places = disagreements(*residual_series(model, base, base.episodes))
    return {
        "domain": model.name,
        "episodes": [r.name for r in model.records],
        "sealed": [model.records[e].name for e in model.sealed()],
        "where": places,
        "maps": maps,
        "constants": _constants(base),
    }


def named_document(model: Comparison, told: Named) -> dict[str, Any]:
    """Which effects, as `name.json` has it."""
    own = _sizes(model, told)
    return {
        "domain": model.name,
        "verdict": verdict_of(told),
        "class": list(told.rivals),
        "threshold_nats": told.rounds[0]["threshold_nats"] if told.rounds else 0.0,
        "effects": [_effect(told, name, own) for name in told.found.hypothesis],
        "parameters": own,
        "constants": _constants(told.found),
        "noise": _noise(told.found),
        "rounds": told.rounds,
        "unsettled": list(told.unsettled),
        "unexplained": list(told.leftover),
        "sealed_gain_nats": _sealed_gain(model, told.base, told.found),
        "placebo": _placebo(model, told),
    }


def shown_document(model: Comparison, told: Named) -> dict[str, Any]:
    """The gap before and after on sealed episodes, and what the page shows beside it."""
    sealed = model.sealed()
    before, after = (errors(model, f, sealed) for f in (told.base, told.found))
    weight = weighed(model, told.base, told.found, sealed)
    return {
        "gap": {
            name: {"before": before[c], "after": after[c], "unit": unit}
            for c, (name, unit) in enumerate(model.channels)
        },
        "removed": asdict(weight),
        "doubted": list(told.found.hypothesis) if weight.high < 0.0 else [],
        "white": {
            "before": whiteness(told.base).as_json(),
            "after": whiteness(told.found).as_json(),
        },
        "shown": profiles(model, told.base, told.found, sealed),
    }


def _sealed_gain(model: Comparison, base: Fit, found: Fit) -> float:
    after, before = (applied(model, f, model.sealed()) for f in (found, base))
    return after.log_likelihood - before.log_likelihood


def _placebo(model: Comparison, told: Named) -> dict[str, Any] | None:
    """The best wrong effect in place of the right ones, of those that nothing confuses with them.

    Of the first ranking, without what was found and without the members of any round's class.
    """
    claimed = {*told.found.hypothesis, *(n for r in told.rounds for n in r.get("class", ()))}
    wrong = next((c for c in told.alone if c.name not in claimed), None)
    if not told.found.hypothesis or wrong is None:
        return None
    before, after = (errors(model, f, model.sealed()) for f in (told.base, wrong.fit))
    gain = _sealed_gain(model, told.base, wrong.fit)
    return {"name": wrong.name, "before": before, "after": after, "sealed_gain_nats": gain}


def _sizes(model: Comparison, told: Named) -> Sizes:
    """Of what was found; wider where the innovations are not white."""
    plain = least_squares(model, told.found)
    own = parameters(told.found, told.found.hypothesis, plain)
    if plain is None:
        return own
    return {name: over_rounds(name, entry, told.rounds) for name, entry in own.items()}


def _effect(told: Named, name: str, own: dict[str, dict[str, Any]]) -> dict[str, Any]:
    mine = {k.split(".", 1)[1]: v for k, v in own.items() if k.startswith(f"{name}.")}
    return {"name": name, "parameters": mine, "forecast": asdict(told.weights[name])}


def _constants(fitted: Fit) -> dict[str, dict[str, Any]]:
    """Every constant that was fitted, with its interval."""
    told = {}
    for free in fitted.free:
        if free.name.startswith("constant."):
            low, high = fitted.interval(free.name)
            value = {"value": fitted.value(free.name), "low": low, "high": high}
            told[free.name.removeprefix("constant.")] = value | {"unit": free.unit}
    return told


def _noise(fitted: Fit) -> dict[str, dict[str, Any]]:
    """Noise parameters, which are fitted as logarithms."""
    return {
        f.name: {"value": float(np.exp(fitted.value(f.name))), "unit": f.unit}
        for f in fitted.free
        if f.name.startswith("noise.")
    }
