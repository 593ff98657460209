"""The four steps over files: find, name, add, show, each with an artefact of its own.

In: a rig file and run logs. Out: a folder with `find.json`, `name.json`, `add.json` and the new
`rig.toml`, `show.json`, `result.json` and the report. A step reads what the one before it wrote, so
that a person can stop, look, and go on.
"""

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.inference import Fit, extended, fit
from wakedeploy.gap.few_flights import cannot_tell, headline
from wakedeploy.gap.folder import (
    forget,
    prepare,
    read_plan,
    read_steps,
    refuse_foreign_rig,
    require,
    to_add,
    write_step,
)
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.summary import verdict_sentence
from wakedeploy.gap.rules import sealed_count
from wakedeploy.gap.search.places import forbids_none
from wakedeploy.gap.systems.gantry.flight import Flight, read_flights
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import make_plan, stated_sizes
from wakedeploy.gap.systems.gantry.search.answer import sizes_of, write_answer
from wakedeploy.gap.systems.gantry.search.before_after import show
from wakedeploy.gap.systems.gantry.search.correction import corrected_rig, ranked
from wakedeploy.gap.systems.gantry.search.explainable_error import explainable
from wakedeploy.gap.systems.gantry.search.importance import mattering
from wakedeploy.gap.systems.gantry.search.judgement import judged, parts_of, unexplained
from wakedeploy.gap.systems.gantry.search.naming import (
    Answer,
    Thresholds,
    fitted_base,
    name_effects,
    with_terms,
)
from wakedeploy.gap.systems.gantry.search.places import find_places
from wakedeploy.gap.systems.gantry.search.preliminary_ranking import UNSIMULATED, glance
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.gap.systems.gantry.search.repeatability import repeated
from wakedeploy.gap.systems.gantry.search.saved_fits import Found
from wakedeploy.gap.systems.gantry.search.threshold import known_thresholds, thresholds_for
from wakedeploy.gap.wording import mapping, texts
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.symbolic import SYMBOLIC
from wakedeploy.rig.file import read_rig

Retrain = Callable[[Rig, Rig, Sequence[Path], Path], Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Case:
    """A rig file and its flights, some of them sealed: nothing is fitted to those.

    `is_simulated` says that the thresholds are this rig's own, `rig_path` where its file lies.
    """

    rig: Rig
    flights: tuple[Flight, ...]
    sealed: tuple[Flight, ...]
    thresholds: Thresholds
    is_simulated: bool = True
    rig_path: Path | None = None

    @property
    def in_sample(self) -> bool:
        """Too few flights to seal any: what is shown was also found in them."""
        return not self.sealed

    @functools.cached_property
    def base(self) -> tuple[GantryModel, Fit]:
        """The flights around the motion that the rig file as it is explains, and its fit.

        Fitted once, when `find` or `name` first needs it.
        """
        return fitted_base(with_terms(GantryModel(self.rig, self.flights)))

    @property
    def share(self) -> float:
        """Of the flights, those that are not sealed."""
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
) -> Case:
    """Read rig and logs; the last flights are sealed. The rig's thresholds are simulated once.

    That takes minutes, for which flights too few for a verdict do not wait.
    """
    rig = read_rig(rig_path)
    flights = read_flights(measured, rig)
    split = len(flights) - sealed_count(len(flights))

    steps = functools.partial(progress, "simulating this rig's thresholds, once")
    known = thresholds or known_thresholds(rig)
    if known is None and not cannot_tell(len(flights)):
        known = thresholds_for(rig, workers=workers, progress=steps)
    fitted, sealed = tuple(flights[:split]), tuple(flights[split:])
    return Case(rig, fitted, sealed, known or UNSIMULATED, known is not None, rig_path)


def find(case: Case, out: Path, progress: Progress = quiet) -> dict[str, Any]:
    """Where they disagree; writes `find.json`."""
    progress("fitting the rig file as it is")
    model, base = case.base
    progress("mapping what it leaves")
    found = find_places(model, base, case.thresholds.whiteness, case.thresholds.places)
    header = {
        "rig": None if case.rig_path is None else str(case.rig_path),
        "rig_sha256": case.rig.sha256,
        "logs": [
            {
                "path": f.name,
                "sha256": f.sha256,
                "seconds": f.airborne_s,
                "samples": int(f.counted.sum()),
                "notes": list(f.notes),
                "seed": f.seed,
                "simulated": f.simulated,
            }
            for f in (*case.flights, *case.sealed)
        ],
        "split": {
            "fit": [f.name for f in case.flights],
            "sealed": [f.name for f in case.sealed],
        },
    }
    forget(out, "find")
    return write_step(out, "find", header | found)


def name(case: Case, out: Path, progress: Progress = quiet) -> dict[str, Any]:
    """Which effect explains it; writes `name.json` and the fits beside it.

    Of too few flights it says which effect leads, and concludes nothing. UnusableInput where `find`
    has not run.
    """
    require(out, "find", case.rig.sha256, case.recordings)
    started = time.monotonic()
    disagrees = forbids_none(read_steps(out).find.get("places", ()))
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
    told = write_answer(answer, out, started)
    return _judged(case, out, answer, told, progress)


def _judged(
    case: Case, out: Path, answer: Answer, told: Mapping[str, Any], progress: Progress
) -> dict[str, Any]:
    """The answer after the sealed flights have said what it is worth; writes `name.json` again."""
    found = Found.of(answer)
    parts = parts_of(told, found.fit.hypothesis)
    progress("asking the sealed flights whether it matters")
    if not parts and told["verdict"] == "unknown":
        judging = GantryModel(case.rig, case.sealed) if case.sealed else None
        moved = None if judging is None else judging.around_own_motion(found.base)
        worth_all = explainable(found.base_model, found.base, moved)
        return write_step(out, "name", unexplained(told, worth_all))
    if not parts:
        return write_step(out, "name", judged(told, (), ()))
    worth = mattering(
        found,
        case.sealed or case.flights,
        parts,
        members=answer.members,
        crossed=case.in_sample,
    )
    after = judged(told, parts, worth)
    if after["verdict"] in ("named", "class"):
        progress("answering again from each half of the flights")
        again = repeated(answer, case.sealed)
        after["repeated"] = None if again is None else again.as_json()
    return write_step(out, "name", after)


def add(
    case: Case, out: Path, *, from_symbolic: bool = False, only: str | None = None
) -> dict[str, Any]:
    """Write the new rig file from `name.json`; the old one stays. Writes `add.json`, `rig.toml`.

    `only` adds one effect of the ranking, as a member of a class, with what is sure, all refitted
    together as `show_gap` does it; `from_symbolic` adds the expression of an unknown effect, with
    the effects that are needed beside it.
    Raises UnusableInput where there is nothing to add; of too few flights only what `only` asks for
    is added.
    """
    require(out, "name", case.rig.sha256, case.recordings)
    named = read_steps(out).name
    digest = sha256_of("".join(f.sha256 for f in case.flights).encode())
    if cannot_tell(len(case.recordings)) and only is None:
        few = headline(len(case.recordings))
        raise UnusableInput(f"{out / 'name.json'}: nothing was concluded, none to add. {few}")
    if from_symbolic and not named.get("unknown"):
        raise UnusableInput(f"{out / 'name.json'}: it has no symbolic expression to add.")
    told = named.get("beside", ()) if from_symbolic else _to_add(case, out, named, only)
    unknown = named["unknown"] if from_symbolic else None
    try:
        corrected, added = corrected_rig(case.rig, told, unknown, digest)
    except UnusableInput as error:
        raise UnusableInput(f"{out / 'name.json'}: {error}") from error
    if not added:
        hint = "; what is too small to matter is added with --effect" if named["effects"] else ""
        hint = "; its expression can be added --from-symbolic" if named.get("unknown") else hint
        hint = "; of a class, one is added with --effect" if named.get("class") else hint
        raise UnusableInput(f"{out / 'name.json'}: no effect that matters was named{hint}.")
    refuse_foreign_rig(out)
    forget(out, "add")
    written = {
        "rig": "rig.toml",
        "old_sha256": case.rig.sha256,
        "new_sha256": corrected.sha256,
        "effects": [e.model_dump(exclude_none=True) for e in added],
    }
    # First what tells of it: a `rig.toml` that nothing tells of would be another hand's.
    added_step = write_step(out, "add", written)
    corrected.write(out / "rig.toml")
    return added_step


def show_gap(
    case: Case,
    out: Path,
    progress: Progress = quiet,
    retrain: Retrain | None = None,
) -> dict[str, Any]:
    """The gap on flights that nothing was fitted to; writes `show.json`.

    UnusableInput where `name` has not run.
    `retrain(old, corrected, logs, out)` gives the predictors' errors on the flights shown; it takes
    minutes, and what was shown before it is written already.
    """
    require(out, "name", case.rig.sha256, case.recordings)
    progress("showing the gap on sealed flights")
    steps = read_steps(out)
    added = [e["name"] for e in steps.add.get("effects", ())]
    found = Found.read(out, case.rig, case.flights)
    model, corrected = _corrected(found, steps.name, added)
    sealed = case.sealed or case.flights
    told = show(
        replace(found, model=model),
        corrected,
        sealed,
        steps.find.get("places", ()),
        members=texts(steps.name.get("class")),
        whiteness_limit=case.thresholds.whiteness,
        in_sample=case.in_sample,
    )
    shown = corrected.hypothesis if corrected is not None else ()
    told["as_if"] = [n for n in shown if n in LIBRARY and n not in added]
    shown_gap = write_step(out, "show", told)
    return shown_gap if retrain is None else retrain_shown(case, out, retrain, progress)


def retrain_shown(
    case: Case, out: Path, retrain: Retrain, progress: Progress = quiet
) -> dict[str, Any]:
    """Add the predictors of both rigs to what `show` told, where something was added."""
    steps = read_steps(out)
    if not steps.add.get("effects"):
        progress("nothing was added to the rig file: no predictor to train")
        return dict(steps.show)
    progress("training predictors on the old and the corrected rig")
    scored = [Path(flight.name) for flight in case.sealed or case.flights]
    trained = dict(retrain(case.rig, read_rig(out / "rig.toml"), scored, out))
    return write_step(out, "show", {**steps.show, "retrain": trained})


def result(case: Case, out: Path) -> dict[str, Any]:
    """`result.json` from the steps that have run."""
    steps = read_steps(out)
    named, shown = steps.name, steps.show
    gap = {
        channel: {k: g[k] for k in ("before", "after", "noise_floor", "unit", "closed") if k in g}
        for channel, g in shown.get("gap", {}).items()
    }
    told = {
        "verdict": named.get("verdict"),
        "effects": named.get("effects", []),
        "class": named.get("class", []),
        "members": _members(named),
        "more_classes": named.get("more_classes", []),
        "others": named.get("others", []),
        "where": [
            {key: p.get(key) for key in (*_WHERE, "words")} for p in steps.find.get("places", ())
        ],
        "gap": gap,
        "placebo": shown.get("placebo", {}),
        "plan": planned(named, out),
        "unknown": named.get("unknown"),
        "beside": named.get("beside", []),
        "rest": named.get("rest"),
        "withdrawn": named.get("withdrawn", []),
        "small": named.get("small"),
        "explainable": named.get("explainable"),
        "repeated": named.get("repeated"),
        "form_exact": named.get("form_exact"),
        "unsettled": named.get("unsettled", []),
        "closest": named.get("closest", ""),
        "worth": named.get("worth"),
        "calibration": named.get("calibration", []),
        "as_if": shown.get("as_if", []),
        "hidden_by": shown.get("hidden_by", []),
        "log_density_gain_nats": shown.get("log_density_gain_nats"),
        "in_sample": shown.get("in_sample"),
        "cross_validated": shown.get("cross_validated"),
        "detectable": named.get("detectable", {}),
        "leading": named.get("leading"),
        "flights": len(case.flights) + len(case.sealed),
    }
    return write_result(out, told)


def write_result(out: Path, told: Mapping[str, Any]) -> dict[str, Any]:
    """`result.json`, with the sentence that heads the report and what it advises to do next."""
    steps = replace(read_steps(out), result=told)
    after = advice(steps, out)
    words = {
        "headline": verdict_sentence(steps.summary),
        "next": None if after is None else after.as_json(),
    }
    return write_step(out, "result", {**told, **words})


def close(
    rig_path: Path,
    measured: Sequence[Path],
    out: Path,
    *,
    workers: int = 2,
    report: bool = True,
    progress: Progress = quiet,
    thresholds: Thresholds | None = None,
    retrain: Retrain | None = None,
    plan: bool = True,
) -> dict[str, Any]:
    """All steps; returns `result.json`'s content. An interruption leaves finished steps usable.

    Where a class is left and `plan` is wanted, a search for the manoeuvre that splits it follows.
    Retraining comes last: it takes the longest, and only adds to a result that stands by then.
    """
    prepare(out, rig_path)
    refuse_foreign_rig(out)  # minutes of fitting should not end at it
    case = open_case(rig_path, measured, workers=workers, progress=progress, thresholds=thresholds)
    find(case, out, progress)
    named = name(case, out, progress)
    if to_add(named["effects"]) and case.sealed:  # what none can confirm is added when asked for
        add(case, out)
    show_gap(case, out, progress)
    if plan and len(named["class"]) > 1:
        stage = "looking for the manoeuvre that would split the class"
        progress(stage)
        sizes, steps = stated_sizes(named, named["class"]), functools.partial(progress, stage)
        made = make_plan(case.rig, named["class"], sizes=sizes, progress=steps)
        write_step(out, "plan", made.as_json())
    told = _concluded(case, out, report, progress)
    if retrain is None:
        return told
    retrain_shown(case, out, retrain, progress)
    return _concluded(case, out, report, progress)


def _concluded(case: Case, out: Path, report: bool, progress: Progress) -> dict[str, Any]:
    told = result(case, out)
    if report:
        from wakedeploy.gap.report.page import write_report  # draws; slow to import

        progress("drawing the report")
        write_report(out)
    return told


def _members(named: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What each effect of the class would be, as the last round that ranked it fitted it."""
    told = {
        name: {k: entry.get(k) for k in ("name", "confidence", "parameters")}
        for name, entry in ranked(named).items()
    }
    leading = mapping(named.get("leading"))
    names = texts(leading.get("names")) if leading.get("clear") else texts(named.get("class"))
    return [told[name] for name in names if name in told]


def planned(named: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """What would split a class: the manoeuvre found for it, or what the library says."""
    if not named.get("class"):
        return {}
    found, keys = read_plan(out), ("sentence", "manoeuvre", "flights", "seconds", "split_by")
    if found.get("class") == named["class"]:
        return {key: found.get(key) for key in keys}
    return {"sentence": named.get("split_by", "")}


_WHERE = ("channel", "coordinate", "low", "high", "residual", "unit", "q_value")


def _to_add(
    case: Case, out: Path, named: Mapping[str, Any], only: str | None
) -> list[Mapping[str, Any]]:
    """The effects that were named, and the one asked for; sizes of the fit that `show` judges."""
    effects = to_add(named.get("effects", ()))
    if only is None:
        return effects
    if only not in ranked(named):
        raise UnusableInput(f"name.json ranks no effect {only!r}; give one that it lists.")
    names = [*(e["name"] for e in effects if e["name"] != only), only]
    found = Found.read(out, case.rig, case.flights)
    _, fitted = _corrected(found, named, names)
    if fitted is None or fitted is found.fit:  # its slopes, and so intervals, were not kept
        return [e for e in named.get("together", ()) if e["name"] in names]
    return [{"name": n, "parameters": sizes_of(fitted, n)} for n in names]


def _as_if(found: Found, named: Mapping[str, Any]) -> tuple[GantryModel, Fit | None]:
    """What the corrected rig file would have, had it been given what was named."""
    names = [str(e["name"]) for e in named.get("effects", ())]
    if named.get("verdict") in ("class", "inconclusive") and found.fit.hypothesis:
        return found.model, found.fit
    return _corrected(found, named, names) if names else (found.model, None)


def _corrected(
    found: Found, named: Mapping[str, Any], added: Sequence[str]
) -> tuple[GantryModel, Fit | None]:
    """The fit whose effects the corrected rig file has, an expression's terms included.

    What was not fitted together by the search is fitted here, from the sizes that it ranked last:
    the same each time for one folder.
    """
    if SYMBOLIC in added or (added and set(added) == set(found.fit.hypothesis)):
        return found.model, found.fit
    settled = {e["name"] for e in named.get("effects", ())}
    if texts(named.get("class")) and set(added) <= settled:
        return found.model, found.fit  # the best member stands for its class
    if not added:
        return _as_if(found, named)
    hypothesis = tuple(added)
    free = found.model.free(hypothesis)
    sizes = {
        f"{effect}.{name}": p.get("value")
        for effect, entry in ranked(named).items()
        for name, p in entry.get("parameters", {}).items()
    }
    start = [
        value if sizes.get(f.name) is None else sizes[f.name]
        for f, value in zip(free, extended(found.base, free), strict=True)
    ]
    return refitted(found.model, fit(found.model, hypothesis, found.base.episodes, np.array(start)))
