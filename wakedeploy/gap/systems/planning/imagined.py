"""Logs that have not been recorded: a system simulated from its inputs, with the noise of its logs.

In: a `LogModel`, a fit and inputs. Out: outputs as they would be logged. Rates are integrated in
fine steps by Runge and Kutta's fourth order, apart from the filter that judges the logs afterwards;
dry friction is held over each.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.signal import lfilter

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.systems.kinds.inputs import shifted
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.between_samples import between
from wakedeploy.gap.systems.likelihood.blocks import driving_of, parts_in_step
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.system import Input
from wakedeploy.physics.friction import rubbed

_FINE = 4  # steps of one of the model's
_LOST = 1e9  # a state this far away has run off


def imagined(
    model: LogModel, fitted: Fit, columns: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Outputs (L, n) by name along logged inputs (L, n) by name; NaN from where it has run off.

    Each of the L logs starts where the first real one did, at rest. Pushes on rates and noise of
    sensors are drawn anew, alike in all.
    """
    acting = model.acting(fitted.hypothesis)
    values = model.values(fitted.hypothesis, fitted.theta)
    random = np.random.default_rng(0)
    steps = model.system.steps
    finely = steps * parts_in_step(model.system)

    def later(stated: Input, row: FloatArray) -> FloatArray:
        parts = between(row, stated.hold, finely)
        return shifted(parts, stated.delay_s / model.dt_s * finely)

    lanes, count = next(iter(columns.values())).shape
    driving = [
        driving_of(
            model.system, {i.name: later(i, columns[i.name][k]) for i in model.system.logged}
        )
        for k in range(lanes)
    ]
    driven = {
        i.name: np.array([_finely(acting.parts(i.name, rows, values)) for rows in driving])
        for i in model.system.inputs
    }
    pushes = _pushes(model, acting, values, count, random)
    noise = np.array([np.exp(values[f"noise.{o.name}"]) for o in model.system.outputs])
    first = np.zeros(len(acting.states))
    first[: len(model.system.states)] = model.first_states()
    for speed in model.system.kinematic().values():
        first[acting.states.index(speed)] = 0.0
    x = np.repeat(first[:, None], lanes, axis=1)
    shown = np.empty((len(noise), lanes, count))
    spread = {n: np.full(lanes, v) for n, v in values.items()}
    spread |= acting.formed({n: v[None, :] for n, v in spread.items()})
    with np.errstate(all="ignore"):
        for t in range(count):
            x[:, ~(np.abs(x).max(0) < _LOST)] = np.nan
            time_s = np.full(lanes, t * model.dt_s)
            c = acting.constants(spread, time_s)
            for j in range(steps):
                u = {n: rows[:, steps * t + j] for n, rows in driven.items()}
                if not j:
                    mean = {n: parts.mean(1) for n, parts in u.items()}
                    at = max(steps * t - 1, 0)
                    before = {n: rows[:, at].mean(1) for n, rows in driven.items()}
                    shown[:, :, t] = acting.readings(x, mean, c, spread, time_s, None, before)
                x = _advanced(acting, x, u, (c, spread, time_s), pushes[:, t : t + 1])
    shown += noise[:, None, None] * random.standard_normal((len(noise), 1, count))
    return {o.name: shown[i] for i, o in enumerate(model.system.outputs)}


def _pushes(
    model: LogModel,
    acting: Acting,
    values: Mapping[str, float],
    count: int,
    random: np.random.Generator,
) -> FloatArray:
    """What acts on the rates of all states beside the model, (k, count): white, and lasting."""
    pushes = np.zeros((len(acting.states), count))
    for name in model.driven:
        sd = float(np.exp(values[f"force.{name}"]))
        keep = float(np.exp(-model.dt_s / np.exp(values[f"lasting.{name}"])))
        lasting = float(np.exp(values[f"push.{name}"]))
        fresh = lasting * (1.0 - keep**2) ** 0.5 * random.standard_normal(count)
        lasts = lfilter([1.0], [1.0, -keep], fresh)
        pushes[acting.states.index(name)] = sd * random.standard_normal(count) + lasts
    return pushes


def _finely(parts: FloatArray) -> FloatArray:
    """What an input is in the parts of every step, (n, parts), in _FINE parts, (n, _FINE)."""
    if parts.shape[1] < _FINE:
        return np.repeat(parts, _FINE // parts.shape[1], axis=1)
    return np.asarray(parts.reshape(len(parts), _FINE, -1).mean(2))


def _advanced(
    acting: Acting,
    x: FloatArray,
    u: Mapping[str, FloatArray],
    given: tuple[Any, ...],
    push: FloatArray,
) -> FloatArray:
    """States (k, L) one of the model's steps later; inputs `u` (L, _FINE) change within it."""
    if acting.system.has_step:
        mean = {n: parts.mean(1) for n, parts in u.items()}
        return _stepped(acting, x, (mean, *given), push, acting.system.step_s)
    for i in range(_FINE):
        now = {n: parts[:, i] for n, parts in u.items()}
        x = _stepped(acting, x, (now, *given), push, acting.system.step_s / _FINE)
    return x


def _stepped(
    acting: Acting, x: FloatArray, given: tuple[Any, ...], push: FloatArray, h_s: float
) -> FloatArray:
    """States (k, L) a step of `h_s` later, inputs held over it."""
    free = _on(acting, x, given, push, h_s, np.zeros_like(x))
    rub = _rubbing(acting, x, free, given, 1.0 if acting.system.has_step else h_s)
    return _on(acting, x, given, push, h_s, rub) if rub.any() else free


def _on(
    acting: Acting,
    x: FloatArray,
    given: tuple[Any, ...],
    push: FloatArray,
    h_s: float,
    rub: FloatArray,
) -> FloatArray:
    """The same with friction adding `rub` (k, L) to every derivative, or next state."""
    if acting.system.has_step:
        return np.asarray(acting.rates(x, *given) + h_s * push + rub)
    k1 = acting.rates(x, *given) + rub
    k2 = acting.rates(x + 0.5 * h_s * k1, *given) + rub
    k3 = acting.rates(x + 0.5 * h_s * k2, *given) + rub
    k4 = acting.rates(x + h_s * k3, *given) + rub
    return np.asarray(x + h_s * ((k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0 + push))


def _rubbing(
    acting: Acting, begun: FloatArray, free: FloatArray, given: tuple[Any, ...], h: float
) -> FloatArray:
    """What dry friction adds to derivatives, or next states, (k, L) over a step from `begun`.

    `free` are the states after it without friction.
    """
    added = np.zeros_like(begun)
    strengths, turnings, answers = acting.rubbed(begun, *given)
    for place, strength, turning, answer in zip(
        acting.dry, strengths, turnings, answers, strict=True
    ):
        after, most = free[place] + h * added[place], h * answer[place] * strength
        rubs = most > 0.0
        share = (rubbed(begun[place], after, most, turning) - after) / np.where(rubs, most, 1.0)
        added += np.where(rubs, share, 0.0) * strength * answer
    return added
