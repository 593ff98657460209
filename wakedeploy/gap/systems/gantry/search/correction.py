"""A rig with what `name.json` says is missing: its effects as entries of the rig file.

In: a rig, and effects and an expression from `name.json`. Out: the corrected rig, and what was
added to it.
"""

import datetime
from collections.abc import Sequence

from pydantic import ValidationError

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, Rig
from wakedeploy.core.validation import first_problem
from wakedeploy.gap.systems.gantry.findings import Expression, Sized
from wakedeploy.gap.systems.gantry.search.expressions import to_effect
from wakedeploy.physics.effects.chain import require_effects
from wakedeploy.physics.effects.symbolic import SYMBOLIC


def corrected_rig(
    rig: Rig,
    effects: Sequence[Sized],
    unknown: Expression | None,
    digest: str,
) -> tuple[Rig, list[Effect]]:
    """The rig with these effects and the expression `unknown`, and both as its entries.

    `digest` is the hash of the flights that they were found in. Raises UnusableInput for what a rig
    file cannot have.
    """
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    added = [entry_of(effect, digest, date) for effect in effects]
    if unknown is not None:
        known = next((entry for entry in rig.effect if entry.name == SYMBOLIC), None)
        added.append(to_effect(unknown, digest, date, onto=known))
    kept = tuple(entry for entry in rig.effect if entry.name not in {a.name for a in added})
    corrected = rig.model_copy(update={"effect": (*kept, *added)})
    require_effects(corrected)
    return corrected, added


def entry_of(effect: Sized, digest: str, date: str) -> Effect:
    """An effect as a rig file lists it; UnusableInput for impossible sizes."""
    try:
        return Effect(name=effect.name, parameters=effect.entries(), data_sha256=digest, date=date)
    except ValidationError as error:
        why = first_problem(error)
        raise UnusableInput(f"effect {effect.name}: {why}; run `gap name` again.") from error
