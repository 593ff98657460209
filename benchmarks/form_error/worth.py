"""What a hidden effect is worth to forecasts, if one knew its name: whether it matters at all.

In: a case, its logs, and the folder of its answer. Out: what the true effect, fitted to the flights
that the search had, removes of the forecast error on the sealed ones. An effect that removes
nothing there is rightly called too small to matter, or not called at all.
"""

from collections.abc import Sequence
from pathlib import Path

from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.search.importance import Mattering, mattering
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.gap.systems.gantry.search.saved_fits import Found
from wakedeploy.gap.systems.gantry.steps import open_case


def worth_of(hidden: str, logs: Sequence[Path], answer: Path) -> Mattering:
    """The worth of an effect of the library."""
    case = open_case(logs[0].parent / "rig.toml", logs, workers=1)
    searched = Found.read(answer, case.rig, case.flights)
    alone = next(tried.fit for tried in searched.tried if tried.name == hidden)
    model = searched.base_model
    around, known = refitted(model, fit(model, (hidden,), range(model.episodes), alone.theta))
    found = Found(around, model, searched.base, known, searched.tried)
    (worth,) = mattering(found, case.sealed, [(hidden,)])
    return worth
