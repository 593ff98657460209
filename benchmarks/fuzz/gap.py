"""Kinds of files of the gap workflow: what a step leaves and the next one, or a page, reads."""

import functools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.fuzz import artefacts
from benchmarks.fuzz.archives import npz_file, packed
from benchmarks.fuzz.documents import as_json, json_file, json_lines
from benchmarks.fuzz.gantry import flown, flown_rig
from benchmarks.fuzz.kind import Files, Kind
from benchmarks.hidden_effects.lines import LINES, read_lines
from benchmarks.hidden_effects.page import markdown_of, text_of
from benchmarks.hidden_effects.table import summary
from wakedeploy.cli import gap_plan
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.page import write_report
from wakedeploy.gap.report.shrinkage import channel_lines
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.systems.gantry import find_name_add_show as close
from wakedeploy.gap.systems.gantry import workflow
from wakedeploy.gap.systems.gantry.flight import Flight, flight_from_log
from wakedeploy.gap.systems.gantry.folder import (
    prepare,
    read_plan,
    read_steps,
    refuse_foreign_rig,
)
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.preliminary_ranking import UNSIMULATED
from wakedeploy.gap.systems.gantry.search.saved_fits import FITS, Found

_RIG = "/nowhere/rig.toml"  # of the flights; never read


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {
        "gap-steps": _steps,
        "gap-add": _add,
        "gap-report": _report,
        "gap-fits": _fits,
        "gap-benchmark": _benchmark,
    }


@functools.cache
def _case() -> close.Case:
    """A rig and four flights, the last of them sealed, as if each were another recording."""
    rig = flown_rig()
    flight = flight_from_log(flown().without_truth(), rig, "flight", "")
    flights = [_renamed(flight, i) for i in range(len(artefacts.FLIGHTS))]
    return close.Case(rig, tuple(flights[:-1]), (flights[-1],), UNSIMULATED)


def _renamed(flight: Flight, number: int) -> Flight:
    return replace(flight, name=artefacts.FLIGHTS[number], sha256=f"{number}" * 64)


def _folders(*verdicts: str) -> tuple[Files, ...]:
    case = _case()
    folders = [artefacts.folder(v, case.rig.sha256, case.recordings) for v in verdicts]
    return tuple(
        {f"{step}.json": as_json(artefact) for step, artefact in each.items()} for each in folders
    )


def _steps() -> Kind:
    sound = _folders(*artefacts.VERDICTS)
    ways = {"*.json": json_file}
    return Kind("gap-steps", "gap artefacts", sound, _go_on, ways, writes=True)


def _go_on(folder: Path) -> None:
    """As every gap command ends, and as `gap plan` begins."""
    steps = read_steps(folder)
    account(steps.summary), channel_lines(steps.summary), advice(steps, folder)
    _ = read_plan(folder), steps.option
    workflow.result(_case(), folder)
    if steps.result is not None and steps.result.rivals:
        members = gap_plan._class_in(folder)
        gap_plan._same_rig(folder, _case().rig, None)
        gap_plan._known_sizes(folder, members)


def _add() -> Kind:
    sound = _folders("named", "unknown")
    return Kind(
        "gap-add", "gap artefacts, added", sound, _corrected, {"*.json": json_file}, writes=True
    )


def _corrected(folder: Path) -> None:
    """As `gap add` does."""
    prepare(folder, Path(_RIG))
    refuse_foreign_rig(folder)
    close.add(_case(), folder, from_symbolic=_has_expression(folder))


def _has_expression(folder: Path) -> bool:
    name = read_steps(folder).name
    return name is not None and name.unknown is not None


def _report() -> Kind:
    sound = _folders(*artefacts.VERDICTS)
    ways = {"*.json": json_file}
    return Kind("gap-report", "gap reports", sound, write_report, ways, writes=True,
                slowest_s=10.0)  # fmt: skip


def _fits() -> Kind:
    """What `name` leaves beside its answer, for flights that it was found in."""
    case = _case()
    model = GantryModel(case.rig, case.flights, TERMS)

    def theta(*hypothesis: str) -> list[float]:
        return [parameter.neutral for parameter in model.free(hypothesis)]

    held = {
        "base": theta(), "fit": theta(artefacts.NAMED), "effects": [artefacts.NAMED],
        "tried": [artefacts.NAMED, artefacts.RIVAL], "fitted_gain": [9.0, 1.0],
        "tried_0": theta(artefacts.NAMED), "tried_1": theta(artefacts.RIVAL),
    }  # fmt: skip
    for i, flight in enumerate(case.flights):
        held |= {f"motion_{i}": flight.nominal, f"base_motion_{i}": flight.nominal}
    content = packed({name: np.asarray(value) for name, value in held.items()})

    def read(folder: Path) -> None:
        """As `gap show` does."""
        Found.read(folder, case.rig, case.flights)

    return Kind("gap-fits", "gap fits", ({FITS: content},), read, {"*.npz": npz_file})


_LINE = {
    "name": "stiction/15/1", "kind": "effect", "plant": "second", "seed": 2872, "target_nats": 15,
    "nats": 52.9, "hidden": ["stiction"], "verdict": "class", "right": True, "partial": False,
    "named": ["stiction"], "class": ["stiction", "range-bias"],
    "named_intervals": [{"effect": "stiction", "held": True, "low": 0.1, "high": 0.2}],
    "closed": 0.4, "seconds": 50.7, "commit": "2102ef3d56d5", "measured": "2026-11-22",
    "seconds_flying": 13.3, "fitted_intervals": [], "floor_m": 0.005, "shows": True,
    "class_gains": {"stiction": 12.0}, "closed_by_own_floor": 0.1, "seconds_judging": 7.6,
    "beliefs": [{"confidence": 0.9, "hidden": True}], "modes": [["ARMED", "RUNNING"]],
}  # fmt: skip
_ERROR = {"rmse": 28.4, "low": 25.2, "high": 32.0, "per_flight": [25.8, 30.7]}
_TRACKING = {
    "unit": "mm", "seconds": 20.0, "seeds": [1, 2], "before": _ERROR, "after": _ERROR, "ratio": 0.9,
    "ratio_interval": [0.8, 1.0], "retrain": {"unit": "N", "old_rmse": 0.32, "new_rmse": 0.3},
}  # fmt: skip


def _benchmark() -> Kind:
    kinds = ("effect", "none", "outside", "pair")
    cases = [_LINE | {"name": f"{kind}/1", "kind": kind} for kind in kinds]
    lines = [json.dumps(line) for line in (*cases, _LINE | {"tracking": _TRACKING})]
    sound: tuple[Files, ...] = ({LINES: "\n".join(lines).encode() + b"\n"},)
    return Kind("gap-benchmark", "gap benchmark lines", sound, _tabulate, {"*.jsonl": json_lines})


def _tabulate(folder: Path) -> None:
    """As `python -m benchmarks.hidden_effects --table-only` does."""
    totals = summary(read_lines(folder))
    markdown_of(totals, "benchmark.png", LINES), text_of(totals)
