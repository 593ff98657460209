"""All steps at once, and what stands above them: `result.json` and the report.

In: a rig file and run logs, or a folder in which some steps have run. Out: the folder with all
artefacts, `result.json` and the report.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from wakedeploy.core.caller import Warn, unsaid
from wakedeploy.gap import workflow
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.summary import verdict_sentence
from wakedeploy.gap.systems.gantry.artefacts import Add, Artefact, Find, Name, Plan, Result, Show
from wakedeploy.gap.systems.gantry.find_name_add_show import (
    Case,
    Retrain,
    add,
    find,
    name,
    open_case,
    retrain_shown,
    show_gap,
)
from wakedeploy.gap.systems.gantry.findings import Answer, Effect, Judged, Splitting
from wakedeploy.gap.systems.gantry.folder import (
    StepArtefacts,
    parts,
    prepare,
    read_plan,
    read_steps,
    refuse_foreign_rig,
    write,
)
from wakedeploy.gap.systems.gantry.planning.plan import make_plan, stated_sizes
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds


@dataclass(frozen=True, eq=False)
class CaseSteps:
    """The steps of a rig file and its flights, for `workflow.run`."""

    case: Case
    out: Path
    progress: Progress = quiet

    def find(self) -> Find:
        """Find where flights and rig file disagree."""
        return find(self.case, self.out, self.progress)

    def name(self) -> Name:
        """Find which effect explains it."""
        return name(self.case, self.out, self.progress)

    def add(self) -> Add | Name:
        """Add what matters, if a sealed flight confirms it; the answer if nothing is added."""
        named = read_steps(self.out).name or self.name()
        return add(self.case, self.out) if named.to_add and self.case.sealed else named

    def show(self) -> Show:
        """Show the gap before and after, on flights that nothing was fitted to."""
        return show_gap(self.case, self.out, self.progress)


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
    warn: Warn = unsaid,
) -> Result:
    """Run all steps; return what `result.json` says. An interruption leaves finished steps usable.

    If a class is left and `plan` is wanted, a search for the manoeuvre that splits it follows.
    Retraining comes last: it takes the longest, and only adds to a finished result.
    """
    prepare(out, rig_path)
    refuse_foreign_rig(out)  # minutes of fitting should not end at it
    case = open_case(
        rig_path, measured, workers=workers, progress=progress, thresholds=thresholds, warn=warn
    )
    steps: workflow.Steps[Artefact] = CaseSteps(case, out, progress)
    workflow.run(steps, "close")
    steps_left = read_steps(out)
    if plan and steps_left.name is not None and len(steps_left.name.rivals) > 1:
        _plan(case, out, steps_left.name, progress)
    concluded = _concluded(case, out, report, progress)
    if retrain is None or steps_left.show is None:
        return concluded
    retrain_shown(case, out, retrain, steps_left.show, progress)
    return _concluded(case, out, report, progress)


def _plan(case: Case, out: Path, named: Name, progress: Progress) -> None:
    stage = "looking for the manoeuvre that would split the class"
    progress(stage)
    sizes, steps = stated_sizes(named, named.rivals), functools.partial(progress, stage)
    write(out, make_plan(case.rig, named.rivals, sizes=sizes, progress=steps).as_artefact)


def _concluded(case: Case, out: Path, report: bool, progress: Progress) -> Result:
    concluded = result(case, out)
    if report:
        from wakedeploy.gap.report.page import write_report  # draws; slow to import

        progress("drawing the report")
        write_report(out)
    return concluded


def result(case: Case, out: Path) -> Result:
    """`result.json` from the steps that have run."""
    steps = read_steps(out)
    content = parts(steps.name, Answer) | parts(steps.show, Judged)
    return write_result(
        out,
        Result(
            **content,
            members=[] if steps.name is None else _members(steps.name),
            where=[] if steps.find is None else steps.find.places,
            unflown=[] if steps.find is None else steps.find.unflown,
            plan=None if steps.name is None else planned(steps.name.rivals, steps.name, out),
            flights=len(case.flights) + len(case.sealed),
        ),
    )


def write_result(out: Path, result: Result) -> Result:
    """Write `result.json`, with the sentence that heads the report and what to do next."""
    steps = replace(read_steps(out), result=result)
    heads = {"headline": verdict_sentence(steps.summary), "next": advice(steps, out)}
    return write(out, result.model_copy(update=heads))


def plan_kept(out: Path, plan: Plan) -> bool:
    """Write `plan.json`; return whether the result is of this class, and so names the plan now."""
    write(out, plan)
    steps: StepArtefacts = read_steps(out)
    if steps.result is None or steps.result.rivals != plan.rivals:
        return False
    splitting = planned(plan.rivals, steps.name, out)
    write_result(out, steps.result.model_copy(update={"plan": splitting}))
    return True


def planned(rivals: Sequence[str], named: Name | None, out: Path) -> Splitting | None:
    """What would split a class: the manoeuvre found for it, or what the library says."""
    if not rivals:
        return None
    found = read_plan(out)
    if found is not None and found.rivals == list(rivals):
        return Splitting(**{key: getattr(found, key) for key in Splitting.model_fields})
    return Splitting(sentence="" if named is None else named.split_by)


def _members(named: Name) -> list[Effect]:
    """Each effect of the class, as the last round that ranked it fitted it."""
    leading = named.leading
    names = leading.names if leading is not None and leading.clear else named.rivals
    found = [named.ranked[name] for name in names if name in named.ranked]
    return [
        Effect(name=entry.name, confidence=entry.confidence, parameters=entry.parameters)
        for entry in found
    ]
