"""What hidden effects are worth to forecasts, if one knew their names: whether they matter at all.

In: a case's logs, the names, and the folder of its answer. Out: what the true effects, fitted to
the flights that the search had, remove of the squared forecast error on the sealed ones. What
removes next to nothing there is rightly called too small to matter, or not called at all.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.find_name_add_show import open_case
from wakedeploy.gap.systems.gantry.search.importance import Removed, mattering
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.gap.systems.gantry.search.saved_fits import Found


def worth_of(
    hidden: tuple[str, ...], logs: Sequence[Path], answer: Path
) -> Mapping[float, Removed]:
    """The share of the squared error that effects of the library remove, by horizon [s]."""
    case = open_case(logs[0].parent / "rig.toml", logs, workers=1)
    searched = Found.read(answer, case.rig, case.flights)
    alone = {tried.name: tried.fit for tried in searched.tried}
    model, start = searched.base_model, dict[str, float]()
    for fitted in (alone[name] for name in reversed(hidden)):  # the first one's constants stand
        start |= {name: fitted.value(name) for name in fitted.names}
    theta = np.array([start[f.name] for f in model.free(hidden)])
    around, known = refitted(model, fit(model, hidden, range(model.episodes), theta))
    found = Found(around, model, searched.base, known, searched.tried)
    (worth,) = mattering(found, case.sealed, [hidden])
    return worth.removed
