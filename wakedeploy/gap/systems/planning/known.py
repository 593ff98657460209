"""What `gap name` left in a folder, for a plan: the class, and the sizes that were fitted.

In: a folder, and the model of its system. Out: an answer and parameters by effect.
"""

from collections.abc import Sequence
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.search.artefacts import Answer, object_of, stated
from wakedeploy.gap.systems.likelihood.logs import LogModel

NAME = "name.json"
_ANEW = "run `wakedeploy gap name` anew, with the same --system, --measured and --out"


def stated_answer(out: Path | None) -> Answer | None:
    """What `gap name` left in a folder; None without one.

    Raises UnusableInput where it left nothing that can be read.
    """
    if out is None:
        return None
    path = out / NAME
    return stated(path, object_of(path, _ANEW), Answer, _ANEW)


def stated_sizes(
    out: Path, answer: Answer, model: LogModel, names: Sequence[str]
) -> dict[str, tuple[float, ...]]:
    """The parameters of the effects as the round that left them open fitted them, else the last.

    A later round ranks a member beside the one that was taken: nothing is left for it to explain.

    Raises UnusableInput for an effect of the answer that the system does not have, and for one
    that is ranked without values that its parameters can have.
    """
    path = out / NAME
    for name in answer.rivals:
        if name not in model.effects:
            raise UnusableInput(f"{path}: {name!r} is no effect of {model.name}; {_ANEW}.")
    ranking = {e.name: e.parameters for r in answer.rounds for e in r.ranking}
    for searched in answer.rounds:
        if set(searched.rivals) & set(answer.rivals):
            ranking |= {e.name: e.parameters for e in searched.ranking if e.name in answer.rivals}
    sizes = {}
    for name in names:
        if name not in ranking or name not in model.effects:
            continue
        for free in model.effects[name]:
            size = ranking[name].get(free.name)
            if size is None or not free.low <= size.value <= free.high:  # false for NaN, too
                raise UnusableInput(
                    f"{path}: {free.name} has no value between {free.low:g} and {free.high:g}; "
                    f"{_ANEW}."
                )
        sizes[name] = tuple(ranking[name][free.name].value for free in model.effects[name])
    return sizes
