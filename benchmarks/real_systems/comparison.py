"""What people use today, on the same recordings and the same sealed blocks.

`python -m benchmarks.real_systems.comparison --json docs/records/system-comparison.json` fits, for
each case with its effect left out: the textbook system's constants by least squares of its
forecasts; PySINDy (de Silva et al., 2020) on what the system leaves of its rates; and a small
network on the same. Each is then judged as the answers of `benchmarks.real_systems` are: the root
mean square of measured less forecast on blocks that took no part. What is left of the rates comes
from the corrections of the fitted system's filter: states that no sensor shows have it, too.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pysindy
from scipy.optimize import least_squares
from sklearn.neural_network import MLPRegressor

from benchmarks.real_systems.answering import recordings_of, system_of
from benchmarks.real_systems.cases import CASES, Case
from benchmarks.records import COMMIT, write
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import append_json_line, read_json_lines
from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.search.comparison import errors
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.system import StateSpace

DEGREE, THRESHOLD = 3, 0.05  # of the polynomial library; share of the largest rate
LAYERS = (32, 32)
_FINE = 4  # midpoint steps for one of the system's
_MOST_TRIES = 8  # of the least-squares fit, each with slopes by every constant
Learnt = Callable[[FloatArray], FloatArray]


def compared(case: Case) -> dict[str, Any]:
    """Errors by output and way, and seconds; UnusableInput where the recordings are refused."""
    began_s = time.process_time()
    system, recordings = system_of(case, "out"), recordings_of(case, "out")
    model = LogModel(system, recordings)
    base = fitted_base(model)
    sealed = model.sealed()
    errors_by_way = {
        "stated": errors(model, _stated(base), sealed),
        "fitted": errors(model, base, sealed),
    }
    errors_by_way["plain"] = errors(model, plain_fit(model, base), sealed)
    points, rates = corrections(model, base)
    for name, learn in (("pysindy", _sindy), ("network", _network)):
        hybrid = LogModel(_joined(system, model, _within(learn(points, rates), rates)), recordings)
        errors_by_way[name] = errors(hybrid, base, sealed)
    return {
        "errors": {
            channel: {name: _finite(values[k]) for name, values in errors_by_way.items()}
            | {"unit": unit}
            for k, (channel, unit) in enumerate(model.channels)
        },
        "forecast_s": model.horizon * model.dt_s,
        "seconds": time.process_time() - began_s,
    }


def plain_fit(model: LogModel, base: Fit) -> Fit:
    """Constants by least squares of the forecasts of every block that is not sealed."""
    places = [i for i, f in enumerate(base.free) if f.name.startswith("constant.")]
    stated = _stated(base)
    if not places:
        return stated
    scale = np.array([model.sizes[f"y {name}"] for name, _ in model.channels])[:, None]
    unit = np.array([abs(base.free[i].neutral) or 1.0 for i in places])

    def off(shares: FloatArray) -> FloatArray:
        theta = stated.theta.copy()
        theta[places] = shares * unit
        parts = model.disagreements(replace(stated, theta=theta), base.episodes)
        return np.asarray(np.nan_to_num(np.concatenate([(p / scale).ravel() for p in parts])))

    low = np.array([base.free[i].low for i in places]) / unit
    high = np.array([base.free[i].high for i in places]) / unit
    start = np.clip(stated.theta[places] / unit, low, high)
    found = least_squares(off, start, bounds=(low, high), diff_step=1e-3, max_nfev=_MOST_TRIES)
    theta = stated.theta.copy()
    theta[places] = found.x * unit
    return replace(stated, theta=theta)


def corrections(model: LogModel, base: Fit) -> tuple[FloatArray, FloatArray]:
    """States and inputs (N, d) on blocks that are not sealed, and what their rates lack (N, r).

    What a rate lacks is the filter's correction of the state one sample later, over the sample.
    """
    run = model.run((), base.theta[None], base.episodes)
    acting, pieces = model.acting(()), run.pieces
    count = len(model.system.states)
    values = {f.name: np.array([v]) for f, v in zip(base.free, base.theta, strict=True)}
    c = acting.constants({n: v[None] for n, v in values.items()}, np.zeros((1, 1)))
    points, lacking = [], []
    driven = [list(model.system.states).index(n) for n in model.driven]
    for s in range(pieces.sample.shape[1]):
        inside = np.flatnonzero(pieces.scored[:-1, s] & pieces.scored[1:, s])
        states = run.states[:, :count, 0, s]
        log, at = model.logs[pieces.log[s]], pieces.sample[inside, s]
        inputs, steps = log.inputs[:, at], model.system.steps
        means = log.driving.reshape(len(inputs), log.inputs.shape[1] * steps, -1).mean(2)
        driving = [means[:, steps * at + j] for j in range(steps)]
        now, later = states[inside].T, states[inside + 1].T
        predicted = _advanced(model, now, driving, c)
        points.append(np.vstack([now, inputs]).T)
        lacking.append(((later - predicted) / model.dt_s)[driven].T)
    return np.concatenate(points), np.concatenate(lacking)


def _advanced(
    model: LogModel, states: FloatArray, driving: Sequence[FloatArray], c: Any
) -> FloatArray:
    """The system's states (n, N) a sample later, its inputs (i, N) for each of its steps."""
    system, x, h = model.system, states, model.system.step_s / _FINE

    def rates(x: FloatArray, inputs: FloatArray) -> FloatArray:
        named = dict(zip([i.name for i in system.inputs], inputs, strict=True))
        state = system.point("state", dict(zip(system.states, x, strict=True)))
        found = system.rates(state, system.point("input", named), c)
        return np.array([np.broadcast_to(np.squeeze(v), x.shape[1:]) for v in found.values()])

    for inputs in driving:
        if system.has_step:
            return rates(x, inputs)
        for _ in range(_FINE):
            x = x + h * rates(x + 0.5 * h * rates(x, inputs), inputs)
    return x


def _sindy(points: FloatArray, rates: FloatArray) -> Learnt:
    """Sparse polynomials of scaled states and inputs, by sequentially thresholded least squares."""
    centre, size = points.mean(0), np.maximum(points.std(0), 1e-12)
    largest = np.maximum(rates.std(0), 1e-300)
    library = pysindy.PolynomialLibrary(degree=DEGREE)
    scaled = (points - centre) / size
    features = np.asarray(library.fit_transform(scaled))
    optimizer = pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a rate for which nothing is left
        optimizer.fit(features, rates / largest)
    weights = np.asarray(optimizer.coef_)

    def learnt(at: FloatArray) -> FloatArray:
        scaled_rates = np.asarray(library.transform((at - centre) / size)) @ weights.T
        return np.asarray(scaled_rates * largest)

    return learnt


def _network(points: FloatArray, rates: FloatArray) -> Learnt:
    """A small network of scaled states and inputs, stopped early on a tenth of the samples."""
    centre, size = points.mean(0), np.maximum(points.std(0), 1e-12)
    largest = np.maximum(rates.std(0), 1e-300)
    network = MLPRegressor(
        hidden_layer_sizes=LAYERS, early_stopping=True, max_iter=200, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of iterations: it is stopped early or not at all
        targets = rates / largest
        network.fit((points - centre) / size, targets if targets.shape[1] > 1 else targets[:, 0])

    def learnt(at: FloatArray) -> FloatArray:
        scaled_rates = np.asarray(network.predict((at - centre) / size)).reshape(len(at), -1)
        return np.asarray(scaled_rates * largest)

    return learnt


def _within(learnt: Learnt, rates: FloatArray) -> Learnt:
    """No farther than what was seen: polynomials run off outside of it."""
    low, high = rates.min(0), rates.max(0)
    return lambda at: np.clip(np.nan_to_num(learnt(at)), low, high)


def _joined(system: StateSpace, model: LogModel, learnt: Learnt) -> StateSpace:
    """The system with what was learnt added to its driven rates."""
    cls, driven = type(system), model.driven
    method = "step" if system.has_step else "derivative"
    share = model.dt_s if system.has_step else 1.0

    def rates(self: StateSpace, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        state_rates = dict(getattr(cls, method)(self, state, inputs, c))
        values = [getattr(state, n) for n in cls.states]
        values += [getattr(inputs, i.name) for i in cls.inputs]
        shape = np.broadcast_shapes(*(np.shape(v) for v in values))
        at = np.array([np.broadcast_to(v, shape).ravel() for v in values], dtype=float).T
        more = learnt(np.nan_to_num(np.clip(at, -1e12, 1e12)))
        for k, name in enumerate(driven):
            state_rates[name] = state_rates[name] + share * more[:, k].reshape(shape)
        return state_rates

    joined: StateSpace = type(cls.__name__, (cls,), {method: rates})()
    return checked(joined)


def _stated(base: Fit) -> Fit:
    """Constants as the textbook has them."""
    constant = np.array([f.name.startswith("constant.") for f in base.free])
    neutral = np.array([f.neutral for f in base.free])
    return replace(base, theta=np.where(constant, neutral, base.theta))


def _finite(value: float) -> float | None:
    """JSON has no infinity; a forecast that runs off is null."""
    return float(value) if np.isfinite(value) else None


def run(cases: Sequence[Case], out: Path) -> dict[str, dict[str, Any]]:
    """Every case's row by name; those that the present commit has are kept."""
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "comparison.jsonl"
    known = {row["case"]: row for row in read_json_lines(kept) if row["commit"] == COMMIT}
    for case in cases:
        if case.name in known:
            continue
        try:
            result = compared(case)
        except UnusableInput as error:
            result = {"refused": str(error)}
        known[case.name] = {"case": case.name, "commit": COMMIT, **result}
        append_json_line(kept, known[case.name])
        click.echo(f"{case.name}: {result.get('errors', result)}")
    return known


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/real-systems"))
@click.option("--case", "chosen", multiple=True, type=click.Choice([c.name for c in CASES]))
@click.option("--json", "record", type=click.Path(path_type=Path), help="write the record here")
def main(out: Path, chosen: tuple[str, ...], record: Path | None) -> None:
    """Print each row; write the record of all."""
    known = run([c for c in CASES if not chosen or c.name in chosen], out)
    if record is not None:
        rows = [{k: v for k, v in known[c.name].items() if k != "commit"} for c in CASES
                if c.name in known]  # fmt: skip
        write(record, {"pysindy": pysindy.__version__, "rows": rows})


if __name__ == "__main__":
    main()
