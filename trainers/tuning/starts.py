"""Where a study begins: the paper's shape, what its architecture's file adds to it, presets.

Bayesian optimisation draws its first ten points blindly; these are better than blind.
"""

import contextlib
import dataclasses
from collections.abc import Mapping

from trainers.build import ARCHITECTURES
from trainers.preset import Preset
from trainers.training.trainer import idle_settings
from trainers.tuning.plan import Plan
from trainers.tuning.space import Point, point_of
from wakedeploy.core.errors import UnusableInput


def reference_point(plan: Plan) -> Point | None:
    """The paper's shape as a point of the study; None where the study does not hold it."""
    with contextlib.suppress(UnusableInput):
        return _point(plan, {})
    return None


def usual_starts(plan: Plan) -> list[Point]:
    """The architecture's own changes of the paper's shape, those that the study holds."""
    points = []
    for changes in ARCHITECTURES[plan.arch].starts:
        with contextlib.suppress(UnusableInput):
            points.append(_point(plan, changes))
    return points


def preset_start(plan: Plan, asked: str, preset: Preset) -> Point:
    """A preset as a point of the study; what it does not say is as in the paper's shape.

    Raises UnusableInput for a preset that the study does not hold.
    """
    values = {**preset.settings, **preset.hyper}
    searched = {dimension.name for dimension in plan.dimensions}
    kept = dataclasses.asdict(plan.settings()) | dataclasses.asdict(
        ARCHITECTURES[plan.arch].hyper()
    )
    for name in sorted(set(values) - searched - idle_settings(plan.arch)):
        if values[name] != kept[name]:
            raise UnusableInput(
                f"--start {asked}: {name} = {values[name]:g} is not searched, and this study trains"
                f" with {kept[name]:g}."
            )
    try:
        return _point(plan, values)
    except UnusableInput as error:
        raise UnusableInput(f"--start {asked}: {error}") from error


def _point(plan: Plan, changes: Mapping[str, float]) -> Point:
    values = {**dataclasses.asdict(plan.settings()), **changes}
    return point_of(plan.arch, plan.dimensions, plan.window_s, plan.rate_hz, values)
