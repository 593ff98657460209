"""The four steps over files: find, name, add, show, each with an artefact of its own.

In: a rig file and run logs. Out: a folder with `find.json`, `name.json`, `add.json` and the new
`rig.toml`, `show.json`. A step reads what the one before it wrote, so that a person can stop, look,
and go on.
"""

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wakedeploy.core.caller import Warn, unsaid
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import Fit, extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.starts import with_louder_noise
from wakedeploy.gap.few_flights import cannot_tell, headline
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import sealed_count
from wakedeploy.gap.search.places import forbids_none
from wakedeploy.gap.systems.gantry.artefacts import Add, Find, Log, Name, Show, Split, Unflown
from wakedeploy.gap.systems.gantry.findings import Retraining, Sized
from wakedeploy.gap.systems.gantry.flight import Flight, usable_flights
from wakedeploy.gap.systems.gantry.folder import (
    forget,
    read_steps,
    refuse_foreign_rig,
    required,
    write,
)
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.answer import sizes_of, told_of
from wakedeploy.gap.systems.gantry.search.before_after import show
from wakedeploy.gap.systems.gantry.search.correction import corrected_rig
from wakedeploy.gap.systems.gantry.search.explainable_error import explainable
from wakedeploy.gap.systems.gantry.search.importance import mattering
from wakedeploy.gap.systems.gantry.search.judgement import judged, parts_of, unexplained
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, name_effects, with_terms
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Thresholds
from wakedeploy.gap.systems.gantry.search.places import find_places
from wakedeploy.gap.systems.gantry.search.preliminary_ranking import UNSIMULATED, glance
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.gap.systems.gantry.search.repeatability import repeated
from wakedeploy.gap.systems.gantry.search.saved_fits import Found
from wakedeploy.gap.systems.gantry.search.threshold import known_thresholds, thresholds_for
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.symbolic import SYMBOLIC
from wakedeploy.rig.file import read_rig

Retrain = Callable[[Rig, Rig, Sequence[Path], Path], Retraining]


@dataclass(frozen=True, eq=False)
class Case:
    """A rig file and its flights; nothing is fitted to the sealed ones.

    `is_simulated` says that the thresholds are this rig's own; `rig_path` is where its file lies;
    `unflown` are the logs that are left out.
    """

    rig: Rig
    flights: tuple[Flight, ...]
    sealed: tuple[Flight, ...]
    thresholds: Thresholds
    is_simulated: bool = True
    rig_path: Path | None = None
    unflown: tuple[Unflown, ...] = ()

    @property
    def in_sample(self) -> bool:
        """Whether there are too few flights to seal any: those shown were then also fitted."""
        return not self.sealed

    @functools.cached_property
    def base(self) -> tuple[GantryModel, Fit]:
        """The flights around the motion that the unchanged rig file explains, and its fit.

        It is fitted once, when `find` or `name` first needs it.
        """
        return fitted_base(with_terms(GantryModel(self.rig, self.flights)))

    @property
    def share(self) -> float:
        """The share of the flights that is not sealed."""
        return len(self.flights) / (len(self.flights) + len(self.sealed))

    @property
    def recordings(self) -> list[str]:
        """SHA-256 of every log, in the order given."""
        return [flight.sha256 for flight in (*self.flights, *self.sealed)]


def open_case(
    rig_path: Path,
    measured: Sequence[Path],
    *,
    workers: int = 2,
    progress: Progress = quiet,
    thresholds: Thresholds | None = None,
    warn: Warn = unsaid,
) -> Case:
    """Read rig and logs; the last flights are sealed. The rig's thresholds are simulated once.

    That takes minutes; too few flights for a verdict do not wait for it. `warn` is called for each
    log that holds no flight: it is left out.
    """
    rig = read_rig(rig_path)
    flights, unflown = usable_flights(measured, rig)
    for log in unflown:
        warn(log.sentence)
    split = len(flights) - sealed_count(len(flights))

    steps = functools.partial(progress, "simulating this rig's thresholds, once")
    known = thresholds or known_thresholds(rig)
    if known is None and not cannot_tell(len(flights)):
        known = thresholds_for(rig, workers=workers, progress=steps)
    fitted, sealed = tuple(flights[:split]), tuple(flights[split:])
    shown = known or UNSIMULATED
    return Case(rig, fitted, sealed, shown, known is not None, rig_path, tuple(unflown))


def find(case: Case, out: Path, progress: Progress = quiet) -> Find:
    """Find where flights and rig file disagree; write `find.json`."""
    progress("fitting the rig file as it is")
    model, base = case.base
    progress("mapping what it leaves")
    found = find_places(model, base, case.thresholds.whiteness, case.thresholds.places)
    header = {
        "rig": None if case.rig_path is None else str(case.rig_path),
        "rig_sha256": case.rig.sha256,
        "logs": [_log(flight) for flight in (*case.flights, *case.sealed)],
        "unflown": list(case.unflown),
        "split": Split(fit=[f.name for f in case.flights], sealed=[f.name for f in case.sealed]),
    }
    forget(out, "find")
    return write(out, found.model_copy(update=header))


def _log(flight: Flight) -> Log:
    return Log(
        path=flight.name,
        sha256=flight.sha256,
        seconds=flight.airborne_s,
        samples=int(flight.counted.sum()),
        notes=list(flight.notes),
        seed=flight.seed,
        simulated=flight.simulated,
    )


def name(case: Case, out: Path, progress: Progress = quiet) -> Name:
    """Find which effect explains it; write `name.json` and the fits beside it.

    With too few flights it says which effect leads, and concludes nothing. UnusableInput if `find`
    has not run.
    """
    steps = required(out, "find", case.rig.sha256, case.recordings)
    started = time.monotonic()
    disagrees = steps.find is not None and forbids_none(steps.find.places)
    progress("fitting the rig file as it is")
    model, base = case.base
    if cannot_tell(len(case.flights)):
        answer = glance(model, base, case.thresholds, progress, disagrees=disagrees)
        return write_answer(answer, out, started, case.is_simulated)
    answer = name_effects(
        case.rig,
        model,
        case.thresholds,
        progress,
        base=base,
        share=case.share,
        disagrees=disagrees,
    )
    progress("comparing what could be told apart")
    named = _judged(case, out, answer, write_answer(answer, out, started), progress)
    if named.verdict == "none" and answer.instead is not None:
        # A formula that the sealed flights do not bear out took the place of effects that they may.
        effects = answer.instead
        again = _judged(case, out, effects, write_answer(effects, out, started), progress)
        if again.verdict == "none":  # these are not borne out either: the formula is reported
            Found.of(answer).write(out)
            return write(out, named)
        return again
    return named


def write_answer(answer: Answer, out: Path, started_s: float, is_simulated: bool = True) -> Name:
    """Write `name.json`, and the fits beside it; the search began at `started_s`, monotonic.

    `is_simulated` says that the thresholds are the rig's own.
    """
    named = told_of(answer, started_s, is_simulated)
    forget(out, "name")
    Found.of(answer).write(out)
    return write(out, named)


def _judged(case: Case, out: Path, answer: Answer, named: Name, progress: Progress) -> Name:
    """The answer after the sealed flights' judgement; writes `name.json` again."""
    found = Found.of(answer)
    parts = parts_of(named, found.fit.hypothesis)
    progress("asking the sealed flights whether it matters")
    if not parts and named.verdict == "unknown":
        judging = GantryModel(case.rig, case.sealed) if case.sealed else None
        moved = None if judging is None else judging.around_own_motion(found.base)
        worth_all = explainable(found.base_model, found.base, moved)
        return write(out, unexplained(named, worth_all))
    if not parts:
        return write(out, judged(named, (), ()))
    worth = mattering(
        found,
        case.sealed or case.flights,
        parts,
        members=answer.members,
        crossed=case.in_sample,
    )
    after = judged(named, parts, worth)
    if after.verdict in ("named", "class"):
        progress("answering again from each half of the flights")
        after = after.model_copy(update={"repeated": repeated(answer, case.sealed)})
    return write(out, after)


def add(case: Case, out: Path, *, from_symbolic: bool = False, only: str | None = None) -> Add:
    """Write the new rig file from `name.json`; the old one stays. Writes `add.json`, `rig.toml`.

    `only` adds one effect of the ranking, as a member of a class, with what is sure, all refitted
    together as `show_gap` does it. `from_symbolic` adds the expression of an unknown effect, with
    the effects that are needed beside it. With too few flights only what `only` asks for is added.
    Raises UnusableInput if there is nothing to add.
    """
    named = _named(out, case)
    digest = sha256_of("".join(f.sha256 for f in case.flights).encode())
    if cannot_tell(len(case.recordings)) and only is None:
        few = headline(len(case.recordings))
        raise UnusableInput(f"{out / 'name.json'}: nothing was concluded, none to add. {few}")
    if from_symbolic and named.unknown is None:
        raise UnusableInput(f"{out / 'name.json'}: it has no symbolic expression to add.")
    effects = named.beside if from_symbolic else _to_add(case, out, named, only)
    unknown = named.unknown if from_symbolic else None
    try:
        corrected, added = corrected_rig(case.rig, effects, unknown, digest)
    except UnusableInput as error:
        raise UnusableInput(f"{out / 'name.json'}: {error}") from error
    if not added:
        hint = "; what is too small to matter is added with --effect" if named.effects else ""
        hint = "; its expression can be added --from-symbolic" if named.unknown else hint
        hint = "; of a class, one is added with --effect" if named.rivals else hint
        raise UnusableInput(f"{out / 'name.json'}: no effect that matters was named{hint}.")
    refuse_foreign_rig(out)
    forget(out, "add")
    written = Add(
        rig="rig.toml", old_sha256=case.rig.sha256, new_sha256=corrected.sha256, effects=added
    )
    # First the file that names it: a `rig.toml` that no file names would be another hand's.
    write(out, written)
    corrected.write(out / "rig.toml")
    return written


def show_gap(
    case: Case,
    out: Path,
    progress: Progress = quiet,
    retrain: Retrain | None = None,
) -> Show:
    """The gap on flights that nothing was fitted to; writes `show.json`.

    UnusableInput if `name` has not run. `retrain(old, corrected, logs, out)` gives the predictors'
    errors on the flights shown. It takes minutes; `show.json` is written before it starts.
    """
    named = _named(out, case)
    progress("showing the gap on sealed flights")
    steps = read_steps(out)
    added = [] if steps.add is None else [effect.name for effect in steps.add.effects]
    found = Found.read(out, case.rig, case.flights)
    model, corrected = _corrected(found, named, added)
    shown_gap = show(
        replace(found, model=model),
        corrected,
        case.sealed or case.flights,
        [] if steps.find is None else steps.find.places,
        members=named.rivals,
        whiteness_limit=case.thresholds.whiteness,
        in_sample=case.in_sample,
    )
    shown = corrected.hypothesis if corrected is not None else ()
    as_if = [n for n in shown if n in LIBRARY and n not in added]
    shown_gap = write(out, shown_gap.model_copy(update={"as_if": as_if}))
    return shown_gap if retrain is None else retrain_shown(case, out, retrain, shown_gap, progress)


def retrain_shown(
    case: Case, out: Path, retrain: Retrain, shown: Show, progress: Progress = quiet
) -> Show:
    """Add the predictors of both rigs to what `show` found, if something was added."""
    if read_steps(out).add is None:
        progress("nothing was added to the rig file: no predictor to train")
        return shown
    progress("training predictors on the old and the corrected rig")
    scored = [Path(flight.name) for flight in case.sealed or case.flights]
    trained = retrain(case.rig, read_rig(out / "rig.toml"), scored, out)
    return write(out, shown.model_copy(update={"retrain": trained}))


def _named(out: Path, case: Case) -> Name:
    """What `name` left about these flights; UnusableInput if it has not run on them."""
    named = required(out, "name", case.rig.sha256, case.recordings).name
    assert named is not None
    return named


def _to_add(case: Case, out: Path, named: Name, only: str | None) -> Sequence[Sized]:
    """The effects that were named, and the one asked for, with the sizes that `show` judges."""
    effects = named.to_add
    if only is None:
        return effects
    if only not in named.ranked:
        raise UnusableInput(f"name.json ranks no effect {only!r}; give one that it lists.")
    names = [*(e.name for e in effects if e.name != only), only]
    found = Found.read(out, case.rig, case.flights)
    _, fitted = _corrected(found, named, names)
    if fitted is None or fitted is found.fit:  # its slopes, and so its intervals, were not kept
        return [e for e in named.together if e.name in names]
    return [Sized(name=n, parameters=sizes_of(fitted, n)) for n in names]


def _as_if(found: Found, named: Name) -> tuple[GantryModel, Fit | None]:
    """The fit that the corrected rig file would have, had it been given what was named."""
    names = [effect.name for effect in named.effects]
    if named.verdict in ("class", "inconclusive") and found.fit.hypothesis:
        return found.model, found.fit
    return _corrected(found, named, names) if names else (found.model, None)


def _corrected(found: Found, named: Name, added: Sequence[str]) -> tuple[GantryModel, Fit | None]:
    """The fit whose effects the corrected rig file has, an expression's terms included.

    Effects that the search did not fit together are fitted here, from the sizes of the last
    ranking; this gives the same for the same folder.
    """
    if SYMBOLIC in added or (added and set(added) == set(found.fit.hypothesis)):
        return found.model, found.fit
    if named.rivals and set(added) <= {effect.name for effect in named.effects}:
        return found.model, found.fit  # the best member stands for its class
    if not added:
        return _as_if(found, named)
    hypothesis = tuple(added)
    free = found.model.free(hypothesis)
    sizes = {
        f"{effect}.{name}": size.value
        for effect, entry in named.ranked.items()
        for name, size in entry.parameters.items()
    }
    start = np.array([sizes.get(f.name, np.nan) for f in free])
    start = np.where(np.isnan(start), extended(found.base, free), start)
    start = with_louder_noise(free, start)
    return refitted(found.model, fit(found.model, hypothesis, found.base.episodes, start))
