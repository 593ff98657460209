"""What effects do along the flights: the force that they make, and what ignoring it costs.

In: a model, a fit, names of its hypothesis. Out: newtons, and millimetres of tracking error: the
rig's controller would have to answer a force that its feedforward does not know.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.systems.gantry.flight import DT_S, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.physics.effects.chain import default_lead_s


@dataclass(frozen=True)
class Cost:
    """Root mean square of a force [N], and of the tracking error it causes [m] with its ends."""

    force_n: float
    tracking_m: float
    low_m: float
    high_m: float


def cost_of(model: GantryModel, fitted: Fit, part: Sequence[str]) -> Cost:
    """What some effects make and cost along a model's flights, with ends at 90 % over flights."""
    changes = changes_of(model, fitted, part)
    squares = np.concatenate([change**2 for change in changes])
    errors = np.array([_rms(tracking_error(model.rig, change)) for change in changes])
    low, high = mean_ends(errors**2)
    middle = float(np.sqrt(np.mean(errors**2)))
    return Cost(float(np.sqrt(squares.mean())), middle, float(low**0.5), float(high**0.5))


def force_of(model: GantryModel, fitted: Fit, part: Sequence[str]) -> float:
    """Root mean square [N] of some effects' change of the force in the air."""
    squares = np.concatenate([change**2 for change in changes_of(model, fitted, part)])
    return float(np.sqrt(squares.mean()))


def changes_of(model: GantryModel, fitted: Fit, part: Sequence[str]) -> list[FloatArray]:
    """The force [N] that some effects add in the air, step by step for each flight."""
    is_part = [any(f.name.startswith(f"{name}.") for name in part) for f in fitted.free]
    neutral = np.array([f.neutral for f in fitted.free])
    plain = replace(fitted, theta=np.where(is_part, neutral, fitted.theta))
    changes = []
    for episode, flight in enumerate(model.flights):
        with_it, without = (model.forces(hypothesis, episode) for hypothesis in (fitted, plain))
        change = with_it.acceleration[0] * with_it.inertia_kg
        change = change - without.acceleration[0] * without.inertia_kg
        inside = [change[a:b] for a, b in zip(flight.start, flight.stop, strict=True)]
        changes.append(np.concatenate(inside))
    return changes


def tracking_error(rig: Rig, force_n: FloatArray) -> FloatArray:
    """Height error [m] (N,) of the rig's PID under a force (N,) that it does not know.

    Linear: a mass, the rig file's gains, and a command that takes effect a lead later.
    """
    control, mass_kg = rig.control, rig.sufferer.mass_kg
    late = max(round(default_lead_s(rig) / DT_S), 1)
    commands = np.zeros(len(force_n) + late)
    height = speed = integral = 0.0
    error = np.empty(len(force_n))
    for k, force in enumerate(force_n):
        speed += (float(force) - commands[k]) / mass_kg * DT_S
        height += speed * DT_S
        integral += height * DT_S
        commands[k + late] = control.kp_n_per_m * height + control.kd_ns_per_m * speed
        commands[k + late] += control.ki_n_per_ms * integral
        error[k] = height
    return error


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def mean_ends(squares: FloatArray) -> tuple[float, float]:
    """Student's 90 % interval of a mean square, over flights."""
    if len(squares) < 2:
        return 0.0, np.inf
    reach = student_t.ppf(0.95, len(squares) - 1) * squares.std(ddof=1) / len(squares) ** 0.5
    return max(float(squares.mean() - reach), 0.0), float(squares.mean() + reach)
