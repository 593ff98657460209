"""Before any fit: what of a system moves its outputs on these logs, how far, and what looks alike.

In: a `LogModel`. Out: rows of plain numbers. A constant is moved by its spread (a tenth where it
has none), an effect to its first start; how far is in standard deviations of the prediction errors,
all samples together, and what is left of that where everything else may follow.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray, prior_precision
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.progress import Steps, uncounted
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.search.looking import Ground, look
from wakedeploy.gap.systems.blocks import SHORTEST, Log
from wakedeploy.gap.systems.checks import MOST_STEPS
from wakedeploy.gap.systems.logs import LogModel
from wakedeploy.gap.wording import counted, minus

LIKE = 0.95  # correlation of what two leave, from which logs hardly tell them apart
_AHEAD, _FINER, _PLACES = 10, 4, 1000  # samples on, steps for one, places that are tried
_AT_REST_NATS = 1e-3  # a fit's last step promises less
_STUCK = 0.01  # share of samples at a column's end, from which it is called saturated


@dataclass(frozen=True)
class Row:
    """One constant or effect: `moved` and what is `left` [sd], and those that look `like` it."""

    name: str
    moved: float
    left: float
    like: tuple[str, ...]


def checked_base(model: LogModel) -> Fit:
    """Noise and constants fitted, to the end: the table's third digit is to be no accident."""
    begun = fit(model, (), range(model.episodes))
    return fit(model, (), begun.episodes, begun.theta, enough_nats=_AT_REST_NATS)


def rows(model: LogModel, base: Fit, steps: Steps = uncounted) -> list[Row]:
    """Constants first, then effects, in the library's order."""
    known = np.concatenate(whitened(base.slopes))
    prior = np.sqrt(prior_precision(base.free))
    ground = Ground.of(base)
    moved: dict[str, FloatArray] = {}
    remaining: dict[str, FloatArray] = {}
    for i, free in enumerate(base.free):
        if free.name.startswith("constant."):
            size = free.prior_sd if np.isfinite(free.prior_sd) else 0.1 * abs(free.neutral)
            moved[free.name] = known[:, i] * size
            others = [j for j in range(len(base.free)) if j != i]
            remaining[free.name] = _residual(moved[free.name], known[:, others], prior[others])
    for done, name in enumerate(model.library, 1):
        moved[name] = look(model, ground, name).first[:, 0]
        remaining[name] = _residual(moved[name], known, prior)
        steps(done, len(model.library))
    names = list(moved)
    alike = _alike(names, remaining)
    return [
        Row(n, float(np.linalg.norm(moved[n])), float(np.linalg.norm(remaining[n])), alike[n])
        for n in names
    ]


def column_notes(model: LogModel) -> list[str]:
    """What the columns themselves show: ends at which they stay, inputs that never change."""
    notes = []
    logs = model.logs
    if model.episodes < FEWEST_IN_ALL:
        notes.append(
            f"too short for a search: these logs make {counted(model.episodes, 'block')} of at "
            f"least {SHORTEST} samples, and {FEWEST_IN_ALL} are needed; record more. They "
            f"last {_duration(logs, model.dt_s)}; if it was longer, the time's unit is wrong."
        )
    part = model.thinned()
    if part is not model:
        searched = max(b.stop - b.start for b in part.blocks)
        notes.append(
            f"long logs: a search looks at the first {searched} samples of each block; sizes, and "
            "what sealed blocks say, come from all."
        )
    notes += _ranges(model)
    for i, stated in enumerate(model.system.inputs):
        notes += _notes(f"input {stated.name}", np.concatenate([log.inputs[i] for log in logs]))
    for i, shown in enumerate(model.system.outputs):
        values = np.concatenate([log.outputs[i] for log in logs])
        notes += _notes(f"output {shown.name}", values)
        missing = float(np.mean(~np.isfinite(values)))
        if missing > 0.0:
            notes.append(f"output {shown.name}: {missing:.1%} of the samples are not measured.")
    return notes


def step_notes(model: LogModel, base: Fit) -> list[str]:
    """Outputs that finer steps of the model would move by more than their sensor's noise."""
    ends = np.cumsum([0, *(log.outputs.shape[1] for log in model.logs)])
    first, stop = max(itertools.pairwise(ends), key=lambda ends: ends[1] - ends[0])
    if model.system.has_step or stop - first <= _AHEAD:
        return []
    at = np.unique(np.linspace(first, stop - 1 - _AHEAD, _PLACES).astype(np.int64))
    acting = model.acting(())
    values = {name: np.array([v]) for name, v in model.values((), base.theta).items()}
    with np.errstate(all="ignore"):
        coarse, fine = (model.filter.advanced(acting, values, at, _AHEAD, k) for k in (1, _FINER))
        off = np.median(np.abs(fine - coarse), axis=1)  # an unstable state sends some far off
    return [
        f"{output.name}: the model's steps are too coarse; over {_AHEAD} samples they are off by "
        f"{error:.2g} {output.unit}, {error / noise:.2g} times its noise. {_finer(model, ratio)}"
        for output, error in zip(model.system.outputs, off, strict=True)
        for noise in [float(np.exp(base.value(f"noise.{output.name}")))]
        for ratio in [float(error / noise)]
        if 1.0 < ratio < math.inf
    ]


def _finer(model: LogModel, ratio: float) -> str:
    """What to do about steps that are off by so many times the noise: errors fall with squares."""
    wanted = model.system.steps * math.sqrt(2.0 * ratio)
    rows = model.logs[0].rows
    fitting = (k for k in range(2, MOST_STEPS + 1) if k % rows == 0 or rows % k == 0)
    steps = next((k for k in fitting if k >= wanted), None)
    return "Give it a higher `rate_hz`." if steps is None else f"State `steps = {steps}`."


def _duration(logs: Sequence[Log], dt_s: float) -> str:
    """How long logs are together."""
    return f"{dt_s * sum(log.outputs.shape[1] for log in logs):.3g} s"


def _ranges(model: LogModel) -> list[str]:
    """Where each column lies, in the system's unit: a wrong unit shows here first."""
    system = model.system
    named = [(f"input {i.name}", i.unit) for i in system.inputs]
    named += [(f"output {o.name}", o.unit) for o in system.outputs]
    every = np.concatenate([np.concatenate([log.inputs, log.outputs]) for log in model.logs], 1)
    ends = zip(np.nanmin(every, axis=1), np.nanmax(every, axis=1), strict=True)
    return [
        f"{name}: {minus(f'{low:.4g}')} to {minus(f'{high:.4g}')} {unit}"
        for (name, unit), (low, high) in zip(named, ends, strict=True)
    ]


def _notes(what: str, values: FloatArray) -> list[str]:
    values = values[np.isfinite(values)]
    if np.ptp(values) == 0.0:
        return [f"{what} never changes: nothing can be learnt from it."]
    notes = []
    for end, word in ((values.max(), "most"), (values.min(), "least")):
        share = float(np.mean(values == end))
        if share > _STUCK and len(np.unique(values)) > 20:
            notes.append(f"{what} is at its {word}, {end:.4g}, in {share:.1%} of the samples.")
    return notes


def _residual(moved: FloatArray, known: FloatArray, prior: FloatArray) -> FloatArray:
    """What is left of a change where known directions follow as their priors let them."""
    q, _ = np.linalg.qr(np.vstack([known, np.diag(prior)]))
    padded = np.concatenate([moved, np.zeros(len(prior))])
    return np.asarray(padded - q @ (q.T @ padded))[: len(moved)]


def _alike(names: Sequence[str], remaining: dict[str, FloatArray]) -> dict[str, tuple[str, ...]]:
    """Names whose remainders have nearly the same shape."""
    norm = {n: float(np.linalg.norm(remaining[n])) for n in names}
    there = [n for n in names if norm[n] > 0.0]
    alike: dict[str, tuple[str, ...]] = dict.fromkeys(names, ())
    for n in there:
        alike[n] = tuple(
            m for m in there
            if m != n and abs(float(remaining[n] @ remaining[m])) > LIKE * norm[n] * norm[m]
        )  # fmt: skip
    return alike
