"""What one or two flights show of a missing effect: a ranking that concludes nothing.

In: a fitted base of fewer flights than a verdict takes. Out: an inconclusive `Answer`, with the
effect that leads, if one does clearly. Nothing is tried on top of it, and no expression is sought:
neither could be confirmed.
"""

import functools
from collections.abc import Sequence
from dataclasses import replace

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.naming import ranked_by_own_motion, settled
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Round, Thresholds
from wakedeploy.gap.systems.gantry.search.threshold import LEAST
from wakedeploy.physics.effects import LIBRARY

# For a rig whose thresholds are not simulated yet, which takes minutes. Calibration error gave
# wrong effects up to 27 nats on one axis.
UNSIMULATED = replace(LEAST, effect_nats=30.0)


def glance(
    model: GantryModel,
    base: Fit,
    thresholds: Thresholds,
    progress: Progress = quiet,
    disagrees: bool = False,
) -> Answer:
    """Rank the effects on few flights; the best is fitted by itself if it gains enough.

    `disagrees` says that a place stands out from noise. Effects with scanned sizes are tried only
    if something stands out: some of hundreds of sizes fit the noise of so few flights.
    """
    taken = {e.name for e in model.rig.effect}
    names = [n for n in LIBRARY if n not in taken]
    smooth = [n for n in names if not _is_scanned(model, n)] or names
    least = thresholds.effect_nats
    model, base, ranked = _ranked(model, base, smooth, least, progress)
    seen = disagrees or not whiteness(base).passes(thresholds.whiteness)
    if len(smooth) < len(names) and (seen or ranked[0].gain_nats >= least):
        model, base, ranked = _ranked(model, base, names, least, progress)
    best = ranked[0]
    found = best.name if best.gain_nats >= least else ""
    near, fitted = settled(model, best.fit) if found else (model, base)
    return Answer(
        verdict="inconclusive",
        effects=(),
        classes=(),
        rounds=(Round((), tuple(ranked), found, RULES.class_nats, least),),
        model=near,
        base_model=model,
        base=base,
        fit=fitted,
        white=whiteness(fitted),
        unknown=None,
        rest=None,
        thresholds=thresholds,
    )


def _ranked(
    model: GantryModel, base: Fit, names: Sequence[str], least: float, progress: Progress
) -> tuple[GantryModel, Fit, list[Candidate]]:
    stage = f"trying {len(names)} effects"
    progress(stage)
    steps = functools.partial(progress, stage)
    return ranked_by_own_motion(model, base, names, least, steps)


def _is_scanned(model: GantryModel, name: str) -> bool:
    return any(free.scanned for free in model.free((name,)))
